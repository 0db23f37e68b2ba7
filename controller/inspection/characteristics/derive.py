"""Characteristics of a part, derived from its CAD file (docs/characteristics.md)."""

from controller.cad import Solid, find_features
from controller.cad.compiled import CompiledPart

from ._types import Characteristic
from .drafting import nominal_characteristics, with_drawn
from .limits import ToleranceClass


def derive(
    part: Solid | CompiledPart, tolerance_class: ToleranceClass = "m"
) -> tuple[Characteristic, ...]:
    """Return the characteristics of a part, numbered from 1 in the order of a drawing.

    Parameters
    ----------
    part : its CAD model; a compiled part carries the limits stated in its file
    tolerance_class : class of ISO 2768-1, for characteristics without limits of their own
    """
    if not isinstance(part, CompiledPart):
        return nominal_characteristics(part, find_features(part), tolerance_class)
    found = nominal_characteristics(part.solid, part.features, tolerance_class)
    return with_drawn(part.solid, found, part.tolerances, tolerance_class)
