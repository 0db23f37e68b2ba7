"""Requirements of a drawing: dimensions, geometric tolerances, datums (ISO 1101, 5459).

They come with the model if a STEP file (AP242) holds them as data, not only as drawn text; all in
mm and rad, whatever units the designer used.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Dimension:
    """A size or a distance, with limits or without.

    Attributes
    ----------
    kind : as STEP calls it, as ``size_diameter`` or ``location_linear_distance``
    nominal : mm, or rad where ``is_angle``
    lower, upper : deviations from it, ``lower <= upper``, both with sign; None where the general
        tolerance of the drawing applies
    faces : surfaces it is of; of a distance the first end
    other_faces : the other end of a distance
    is_angle : whether it is in rad
    fit : class of tolerance (ISO 286), as ``H7``; empty where there is none
    """

    kind: str
    nominal: float
    lower: float | None
    upper: float | None
    faces: tuple[int, ...]
    other_faces: tuple[int, ...] = ()
    is_angle: bool = False
    fit: str = ""


@dataclass(frozen=True, slots=True)
class GeometricTolerance:
    """A tolerance of form, orientation, location or run-out.

    Attributes
    ----------
    kind : as STEP calls it, as ``position`` or ``profile_of_surface``
    value_mm : width of the zone
    is_diameter : whether the zone is round
    datums : letters in the order of precedence
    faces : surfaces it is of
    at_maximum_material : whether the zone grows as the feature shrinks (ISO 2692)
    """

    kind: str
    value_mm: float
    is_diameter: bool
    datums: tuple[str, ...]
    faces: tuple[int, ...]
    at_maximum_material: bool = False


@dataclass(frozen=True, slots=True)
class Datum:
    """Surfaces that geometric tolerances refer to.

    Attributes
    ----------
    letter : its name
    faces : the surfaces; empty where the file names none
    """

    letter: str
    faces: tuple[int, ...]


Tolerance = Dimension | GeometricTolerance | Datum
