"""Calibrations as earlier versions wrote them (docs/promises.md)."""

from collections.abc import Mapping
from math import radians
from typing import Any, Final

# Until 0.2 an arm's figures were keys of their own, those of a UMI RTX, its zeros in degrees.
_ZEROS: Final = ("shoulder", "elbow", "yaw", "pitch", "roll")
_PLAIN: Final = {"zed_zero_mm": 0.0, "yaw_per_elbow": 0.0, "sag_mm": 0.0}
_LENGTHS: Final = ("upper_mm", "fore_mm", "tool_mm")


def figures_of_one_make(given: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the keys of an arm's calibration, its figures by name."""
    if "figures" in given or not all(name in given for name in _LENGTHS):
        return given
    rest = dict(given)
    figures = {name: rest.pop(name) for name in _LENGTHS}
    off_y, off_z = rest.pop("tool_off_mm", (0.0, 0.0))
    zero_deg = rest.pop("zero_deg", {})
    figures |= {"tool_off_y_mm": off_y, "tool_off_z_mm": off_z}
    figures |= {f"{joint}_rad": radians(zero_deg.get(joint, 0.0)) for joint in _ZEROS}
    figures |= {name: rest.pop(name, default) for name, default in _PLAIN.items()}
    return {**rest, "figures": figures}
