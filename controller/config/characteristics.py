"""The characteristics in a recipe and a set of views. Millimetres, degrees."""

from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from .yaml_models import Section, WrongKeyError

CONFORMANCE_PROBABILITY: Final = 0.95  # default of S8 without another agreement

ToleranceClass = Literal["f", "m", "c", "v"]
Kind = Literal[
    "diameter",
    "position",
    "distance",
    "length",
    "width",
    "radius",
    "angle",
    "straightness",
    "roundness",
]
Name = Annotated[str, Field(min_length=1, max_length=120)]
Size = Annotated[float, Field(ge=0, le=5000)]
Deviation = Annotated[float, Field(ge=0, le=100)]
Reason = Annotated[str, Field(min_length=4, max_length=200)]
Coordinate = Annotated[float, Field(ge=-1e5, le=1e5)]
RESULTS: Final = frozenset(
    {"event", "measured_mm", "U_mm", "verdict", "views", "reason", "balloon", "source", "unit"}
)


def _face_number(name: str) -> str:
    if not (name[:1] in ("F", "f") and name[1:].isdigit() and len(name) <= 7):
        raise ValueError(f"must be faces by their numbers, as in [F3, F12], not {name!r:.20}")
    return name


FaceNumber = Annotated[str, AfterValidator(_face_number)]


class LimitsSection(Section):
    """Limits of one characteristic.

    Attributes
    ----------
    lower, upper : limits of the value
    critical : two independent looks must agree
    """

    lower: Size | None = None
    upper: Size | None = None
    critical: bool = False

    @model_validator(mode="after")
    def _limits_in_order(self) -> "LimitsSection":
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise WrongKeyError(
                ("lower",), f"{self.lower:g} mm is above `upper`, which is {self.upper:g} mm"
            )
        return self


class CharacteristicSection(LimitsSection):
    """One entry of `inspection.characteristics` of a recipe.

    Attributes
    ----------
    id : id of a characteristic, as `cellctl check` lists it; without its number all alike are meant
    faces : instead of `id`: the face of a hole or a boss, or the two planes of a distance
    kind : characteristic of a feature
    nominal : nominal value in place of the CAD model's
    plus, minus : allowed deviation above and below its nominal value
    fit : class of tolerance, as H7
    ignore : reason why it is not measured
    """

    id: Name | None = None
    faces: Annotated[tuple[FaceNumber, ...], Field(min_length=1, max_length=2)] | None = None
    kind: Kind | None = None
    nominal: Size | None = None
    plus: Deviation | None = None
    minus: Deviation | None = None
    fit: Annotated[str, Field(min_length=2, max_length=5)] | None = None
    ignore: Reason | None = None

    @model_validator(mode="after")
    def _is_one_thing(self) -> "CharacteristicSection":
        if (self.id is None) == (self.faces is None):
            raise ValueError("needs either `id` or `faces`")
        ways = {
            "`fit`": self.fit is not None,
            "`plus` and `minus`": self.plus is not None or self.minus is not None,
            "`lower` and `upper`": self.lower is not None or self.upper is not None,
        }
        stated = [way for way, is_stated in ways.items() if is_stated]
        if len(stated) > 1:
            raise ValueError(f"has limits in two ways: {' and '.join(stated)}; keep one")
        if self.ignore is not None and (stated or self.nominal is not None):
            raise ValueError("is left out by `ignore` and has limits; keep one")
        if self.ignore is None and not stated and self.nominal is None and not self.critical:
            raise ValueError("states nothing: give limits, `critical: true` or `ignore: reason`")
        return self


class GivenSection(LimitsSection):
    """One characteristic of a set of views, in the words of the lines that `inspect` prints.

    Attributes
    ----------
    id : id of a characteristic of the part, or a name for the one at `p_part_mm`
    kind, p_part_mm, axis : type, position, and axis or direction, in the CAD frame
    nominal_mm : nominal length in place of the CAD model's
    """

    id: Name | None = None
    kind: Kind | None = None
    p_part_mm: tuple[Coordinate, Coordinate, Coordinate] | None = None
    axis: tuple[Coordinate, Coordinate, Coordinate] | None = None
    nominal_mm: Size | None = None

    @model_validator(mode="before")
    @classmethod
    def _without_results(cls, tree: Any) -> Any:  # noqa: ANN401 - pydantic's signature
        """Leave out the fields of a result, so that a line of results can be given as input."""
        if not isinstance(tree, dict):
            return tree
        return {key: value for key, value in tree.items() if key not in RESULTS}

    @model_validator(mode="after")
    def _is_named_or_placed(self) -> "GivenSection":
        if self.id is None and (self.kind is None or self.p_part_mm is None):
            raise ValueError("needs `id`, or `kind` and `p_part_mm`")
        if self.axis is not None and not any(self.axis):
            raise WrongKeyError(("axis",), "must be a direction, not [0, 0, 0]")
        return self
