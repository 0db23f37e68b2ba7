"""General tolerances for dimensions without individual ones on the drawing (references.md S15)."""

from math import inf, radians
from typing import Final, Literal

ToleranceClass = Literal["f", "m", "c", "v"]
TOLERANCE_CLASSES: Final[tuple[ToleranceClass, ...]] = ("f", "m", "c", "v")

# Each row has the largest size [mm] and the permissible deviations of classes f, m, c and v; None
# where the standard gives none. The first row of lengths begins at 0.5 mm.
Row = tuple[float, tuple[float | None, float | None, float | None, float | None]]
LINEAR: Final[tuple[Row, ...]] = (  # S15, table 1 [mm]
    (3, (0.05, 0.1, 0.2, None)),
    (6, (0.05, 0.1, 0.3, 0.5)),
    (30, (0.1, 0.2, 0.5, 1.0)),
    (120, (0.15, 0.3, 0.8, 1.5)),
    (400, (0.2, 0.5, 1.2, 2.5)),
    (1000, (0.3, 0.8, 2.0, 4.0)),
    (2000, (0.5, 1.2, 3.0, 6.0)),
    (4000, (None, 2.0, 4.0, 8.0)),
)
RADII: Final[tuple[Row, ...]] = (  # S15, table 2: broken edges, radii and chamfers [mm]
    (3, (0.2, 0.2, 0.4, 0.4)),
    (6, (0.5, 0.5, 1.0, 1.0)),
    (inf, (1.0, 1.0, 2.0, 2.0)),
)
ANGLES: Final[tuple[Row, ...]] = (  # S15, table 3: by the shorter side of the angle [deg]
    (10, (1.0, 1.0, 1.5, 3.0)),
    (50, (1 / 2, 1 / 2, 1.0, 2.0)),
    (120, (1 / 3, 1 / 3, 1 / 2, 1.0)),
    (400, (1 / 6, 1 / 6, 1 / 4, 1 / 2)),
    (inf, (1 / 12, 1 / 12, 1 / 6, 1 / 3)),
)


def linear_tolerance_mm(size_mm: float, tolerance_class: ToleranceClass) -> float | None:
    """Return the permissible deviation of a length in either direction; None where there is none.

    Sizes below 0.5 mm, for which a drawing must state limits, take the first row.
    """
    return _deviation(LINEAR, size_mm, tolerance_class)


def radius_tolerance_mm(radius_mm: float, tolerance_class: ToleranceClass) -> float | None:
    """Return the permissible deviation of a radius or a chamfer; None where there is none."""
    return _deviation(RADII, radius_mm, tolerance_class)


def angle_tolerance_rad(shorter_side_mm: float, tolerance_class: ToleranceClass) -> float:
    """Return the permissible deviation of an angle by the length of its shorter side."""
    deviation = _deviation(ANGLES, shorter_side_mm, tolerance_class)
    assert deviation is not None
    return radians(deviation)


def _deviation(
    rows: tuple[Row, ...], size_mm: float, tolerance_class: ToleranceClass
) -> float | None:
    column = TOLERANCE_CLASSES.index(tolerance_class)
    for largest, deviations in rows:
        if size_mm <= largest + 1e-6:  # margin for rounding of a nominal size from a mesh
            return deviations[column]
    return None
