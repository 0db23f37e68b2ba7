"""Models of a CSG text (docs/csg.md): shapes, set operations, placements."""

from typing import Annotated, Any, Final, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from controller.config import is_cell_file, is_recipe

from .units import MM_PER_UNIT, SPELLINGS

Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
Length = Annotated[float, Field(gt=0, le=1e6)]
Radius = Annotated[float, Field(ge=0, le=1e6)]
Point = tuple[Coordinate, Coordinate]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Outline = Annotated[tuple[Point, ...], Field(min_length=3, max_length=5000)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Block(_Section):
    """A box on z = 0 with the z axis through its middle, or between two corners."""

    size: tuple[Length, Length, Length] | None = None
    from_: Vector | None = Field(default=None, alias="from")
    to: Vector | None = None

    @model_validator(mode="after")
    def _size_or_corners(self) -> Self:
        if (self.size is None) == (self.from_ is None) or (self.from_ is None) != (self.to is None):
            raise ValueError("give `size: [x, y, z]`, or `from: [x, y, z]` and `to: [x, y, z]`")
        if self.from_ is not None and self.to is not None:
            for low, high in zip(self.from_, self.to, strict=True):
                if low >= high:
                    raise ValueError("each coordinate of `to` must be above that of `from`")
        return self


def _check_size(radius: object | None, diameter: object | None) -> None:
    if (radius is None) == (diameter is None):
        raise ValueError("give either `radius` or `diameter`")


class Cylinder(_Section):
    """A cylinder up the z axis from z = 0."""

    radius: Length | None = None
    diameter: Length | None = None
    height: Length

    @model_validator(mode="after")
    def _radius_or_diameter(self) -> Self:
        _check_size(self.radius, self.diameter)
        return self

    @property
    def radius_units(self) -> float:
        """The radius, in the text's unit."""
        return self.radius if self.radius is not None else (self.diameter or 0.0) / 2


class Cone(_Section):
    """A cone or its frustum up the z axis from z = 0: bottom, then top."""

    radius: tuple[Radius, Radius] | None = None
    diameter: tuple[Radius, Radius] | None = None
    height: Length

    @model_validator(mode="after")
    def _radius_or_diameter(self) -> Self:
        _check_size(self.radius, self.diameter)
        return self

    @model_validator(mode="after")
    def _is_not_a_line(self) -> Self:
        if max(self.radii_units) == 0:
            raise ValueError("bottom and top cannot both be 0")
        return self

    @property
    def radii_units(self) -> tuple[float, float]:
        """Bottom and top radius, in the text's unit."""
        if self.radius is not None:
            return self.radius
        bottom, top = self.diameter or (0.0, 0.0)
        return bottom / 2, top / 2


class Sphere(_Section):
    """A ball round the origin."""

    radius: Length | None = None
    diameter: Length | None = None

    @model_validator(mode="after")
    def _radius_or_diameter(self) -> Self:
        _check_size(self.radius, self.diameter)
        return self

    @property
    def radius_units(self) -> float:
        """The radius, in the text's unit."""
        return self.radius if self.radius is not None else (self.diameter or 0.0) / 2


class Extrude(_Section):
    """An outline in x and y, with holes, drawn up from z = 0."""

    outline: Outline
    holes: Annotated[tuple[Outline, ...], Field(max_length=500)] = ()
    height: Length


class Revolve(_Section):
    """An outline in radius and z, turned once round the z axis."""

    outline: Annotated[tuple[tuple[Radius, Coordinate], ...], Field(min_length=3, max_length=5000)]


class Turn(_Section):
    """A turn about an axis through the origin, anticlockwise seen against the axis."""

    about: Literal["x", "y", "z"] | Vector
    deg: Annotated[float, Field(ge=-360, le=360)]

    @field_validator("about", mode="before")
    @classmethod
    def _axis(cls, value: Any) -> Any:  # noqa: ANN401 - whatever the text says
        if isinstance(value, str) and value in {"x", "y", "z"}:
            return value
        if (
            isinstance(value, list)
            and len(value) == 3
            and all(isinstance(v, float) for v in value)
            and any(value)
        ):
            return value
        raise ValueError("must be x, y, z or a direction as in [1, 0, 1]")


PRIMITIVES: Final = ("block", "cylinder", "cone", "sphere", "extrude", "revolve")
KINDS: Final = (*PRIMITIVES, "union", "difference", "intersection", "use")


class Shape(_Section):
    """One shape of one kind, first turned, then moved."""

    block: Block | None = None
    cylinder: Cylinder | None = None
    cone: Cone | None = None
    sphere: Sphere | None = None
    extrude: Extrude | None = None
    revolve: Revolve | None = None
    union: Annotated[tuple["Shape", ...], Field(min_length=1)] | None = None
    difference: Annotated[tuple["Shape", ...], Field(min_length=2)] | None = None
    intersection: Annotated[tuple["Shape", ...], Field(min_length=2)] | None = None
    use: str | None = None
    turn: tuple[Turn, ...] = ()
    move: Vector = (0.0, 0.0, 0.0)

    @field_validator("turn", mode="before")
    @classmethod
    def _one_turn_is_a_list_of_one(cls, value: object) -> object:
        return [value] if isinstance(value, dict) else value

    @model_validator(mode="after")
    def _is_of_one_kind(self) -> Self:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            found = " and ".join(f"`{kind}`" for kind in given) or "none"
            raise ValueError(f"is of one kind, {found} found; use one of {', '.join(KINDS)}")
        return self

    @property
    def kind(self) -> str:
        """The one of `KINDS` that the shape is."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)


class CsgText(_Section):
    """A part as a CSG text."""

    unit: str
    density_g_cm3: Annotated[float, Field(gt=0, le=30)] | None = None
    tolerance_mm: Annotated[float, Field(ge=1e-4, le=10)] = 0.01
    shapes: dict[str, Shape] = {}
    part: Shape

    @model_validator(mode="before")
    @classmethod
    def _is_no_other_file(cls, tree: Any) -> Any:  # noqa: ANN401 - pydantic's signature
        if is_recipe(tree):
            raise ValueError("is a recipe, not a CAD file; name it with --recipe, or name its part")
        if is_cell_file(tree):
            raise ValueError("is a cell file, not a CAD file; name it with --cell")
        return tree

    @field_validator("unit")
    @classmethod
    def _is_known(cls, unit: str) -> str:
        if SPELLINGS.get(unit, unit) not in MM_PER_UNIT:
            raise ValueError(
                f"{unit!r:.40} is not a known unit; use one of {', '.join(MM_PER_UNIT)}"
            )
        return unit
