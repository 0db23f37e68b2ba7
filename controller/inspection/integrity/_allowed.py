"""Allowed deviations of a good part's faces from the CAD model."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from .._pose import PosedPart
from ..characteristics.limits import ToleranceClass, linear_tolerance_mm


@dataclass(frozen=True, slots=True)
class Allowances:
    """Allowed differences of a good part that is clean except for dust.

    Attributes
    ----------
    tolerance_class : class of general tolerances (references.md S15) for the places of faces
    form_mm : standard deviation of an edge's unevenness over some millimetres
    false_alarms : mean number of false findings per good part and check of an outline
    """

    tolerance_class: ToleranceClass = "m"
    form_mm: float = 0.02
    false_alarms: float = 1e-3


def allowed_mm(part: PosedPart, tolerance_class: ToleranceClass) -> FloatArray:
    """Return the allowed growth and shift of each face in either direction, (f, 2) [mm].

    The allowance of a plane follows from the size of the part across it; that of a round face from
    its diameter, and for its centre from the size of the part.
    """
    size = float(np.ptp(part.solid.mesh.bounds, axis=0).max())
    place = linear_tolerance_mm(size, tolerance_class) or 0.0
    out = []
    for face in part.solid.faces:
        if face.kind == "plane":
            across = np.asarray(part.solid.mesh.vertices) @ face.normal
            out.append((linear_tolerance_mm(float(np.ptp(across)), tolerance_class) or 0.0, 0.0))
        elif face.kind == "cylinder":
            tolerance = linear_tolerance_mm(2 * face.radius_mm, tolerance_class) or 0.0
            out.append((0.5 * tolerance, place))
        else:
            out.append((place, place))
    return np.array(out).reshape(-1, 2)
