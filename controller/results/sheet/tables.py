"""Rows of the page's tables of features and tolerances."""

from collections.abc import Sequence

import numpy as np

from controller.cad.compiled import CompiledPart
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance, Tolerance

from ._words_of import vector

Row = tuple[str, str, str, str]


def feature_rows(part: CompiledPart) -> tuple[Row, ...]:
    """Return of each feature its label, position, axis and surfaces."""
    return tuple(
        (
            feature.label,
            vector(feature.position_mm, 2),
            vector(feature.axis),
            _faces(feature.faces),
        )
        for feature in part.features
    )


def tolerance_rows(part: CompiledPart) -> tuple[Row, ...]:
    """Return of each tolerance its kind, limits, datums and surfaces."""
    return tuple(_tolerance_row(tolerance) for tolerance in part.tolerances)


def _tolerance_row(tolerance: Tolerance) -> Row:
    match tolerance:
        case Dimension():
            other = f" to {_faces(tolerance.other_faces)}" if tolerance.other_faces else ""
            return _words(tolerance.kind), _limits(tolerance), "", _faces(tolerance.faces) + other
        case GeometricTolerance():
            zone = f"{'⌀ ' if tolerance.is_diameter else ''}{tolerance.value_mm:g} mm"
            more = ", at maximum material" if tolerance.at_maximum_material else ""
            datums = " | ".join(tolerance.datums)
            return _words(tolerance.kind), zone + more, datums, _faces(tolerance.faces)
        case Datum():
            return "datum", tolerance.letter, "", _faces(tolerance.faces)


def _limits(dimension: Dimension) -> str:
    if dimension.is_angle:
        scale, unit, sign = float(np.degrees(1.0)), "°", ""
    else:
        scale, unit, sign = 1.0, " mm", "⌀ " if "diameter" in dimension.kind else ""
    text = f"{sign}{scale * dimension.nominal:.6g}{unit}"
    if dimension.fit:
        text += f" {dimension.fit}"
    if dimension.lower is not None and dimension.upper is not None:
        low, high = scale * dimension.lower, scale * dimension.upper
        text += f" ±{high:.4g}" if abs(low + high) < 1e-9 else f" {high:+.4g} / {low:+.4g}"
    return text


def _words(kind: str) -> str:
    return kind.replace("_", " ")


def _faces(faces: Sequence[int]) -> str:
    return ", ".join(f"F{face}" for face in faces) or "not named in the file"
