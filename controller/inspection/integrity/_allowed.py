"""Allowed deviations of a good part's faces from the CAD model."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray

from .._pose import PosedPart
from ..characteristics.limits import ToleranceClass, linear_tolerance_mm


@dataclass(frozen=True, slots=True)
class Allowances:
    """Differences that a good part, clean but for dust, may show.

    Attributes
    ----------
    tolerance_class : general tolerances (references.md S15), of where faces lie
    form_mm : how uneven an edge may be over some millimetres, standard deviation
    false_alarms : differences of good parts taken for findings, per part and check of an outline
    """

    tolerance_class: ToleranceClass = "m"
    form_mm: float = 0.02
    false_alarms: float = 1e-3


def allowed_mm(part: PosedPart, tolerance_class: ToleranceClass) -> FloatArray:
    """Return the allowed deviation of each face to either side, (f, 2): grown, and moved [mm].

    A plane is held to the size of the part across it, a round face to its diameter and its centre
    to the size of the part.
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
