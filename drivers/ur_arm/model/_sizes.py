"""Published figures of each arm: lengths, speeds and link boxes.

Sections (§) are those of ur.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

__all__ = ["SIZES", "UrSize"]

Bounds = tuple[float, float, float, float, float, float]  # x, y, z, each low and high


@dataclass(frozen=True, slots=True)
class UrSize:
    """The lengths of one arm (§1.1), by their Denavit-Hartenberg names [mm].

    Attributes
    ----------
    d1 : base to the shoulder's axis
    a2, a3 : upper arm and forearm; below 0, as published
    d4 : offset of wrist 1, along the axis of shoulder and elbow
    d5 : wrist 1 to wrist 2
    d6 : wrist 2 to the flange
    """

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float


@dataclass(frozen=True, slots=True)
class Published:
    """All that is published of one arm.

    Attributes
    ----------
    size : lengths
    deg_per_s : largest speed of each joint (§1.2)
    boxes : each link's box in its own frame, rounded outwards [mm] (§1.3); the forearm's end, which
        is round about wrist 1's axis, is in wrist 1's box
    """

    size: UrSize
    deg_per_s: tuple[float, float, float, float, float, float]
    boxes: Mapping[str, Bounds]


SIZES: Final[Mapping[str, Published]] = MappingProxyType(
    {
        "ur3e": Published(
            UrSize(151.85, -243.55, -213.2, 131.05, 85.35, 92.1),
            (180, 180, 180, 360, 360, 360),
            {
                "shoulder": (-47, 47, -63, 47, -58, 59),
                "upper": (-283, 48, -47, 47, 62, 178),
                "fore": (-180, 38, -38, 38, -20, 78),
                "wrist1": (-34, 34, -50, 47, -152, 33),
                "wrist2": (-33, 33, -47, 51, -36, 32),
                "wrist3": (-32, 32, -38, 32, -42, 0),
            },
        ),
        "ur5e": Published(
            UrSize(162.5, -425.0, -392.2, 133.3, 99.7, 99.6),
            (180, 180, 180, 180, 180, 180),
            {
                "shoulder": (-61, 61, -75, 61, -64, 72),
                "upper": (-485, 61, -61, 61, 60, 210),
                "fore": (-351, 59, -58, 58, -50, 61),
                "wrist1": (-41, 41, -54, 57, -183, 39),
                "wrist2": (-40, 40, -57, 54, -47, 40),
                "wrist3": (-38, 38, -44, 38, -46, 0),
            },
        ),
        "ur10e": Published(
            UrSize(180.7, -612.7, -571.55, 174.15, 119.85, 116.55),
            (120, 120, 180, 180, 180, 180),
            {
                "shoulder": (-77, 77, -95, 77, -82, 94),
                "upper": (-673, 77, -77, 77, 94, 270),
                "fore": (-523, 59, -58, 58, -19, 106),
                "wrist1": (-48, 48, -67, 58, -193, 48),
                "wrist2": (-47, 47, -57, 68, -54, 47),
                "wrist3": (-45, 45, -52, 46, -49, 0),
            },
        ),
        "ur5": Published(
            UrSize(89.159, -425.0, -392.25, 109.15, 94.65, 82.3),
            (180, 180, 180, 180, 180, 180),
            {
                "shoulder": (-60, 60, -71, 60, -66, 69),
                "upper": (-485, 60, -60, 60, 70, 205),
                "fore": (-353, 58, -59, 58, -41, 71),
                "wrist1": (-39, 39, -48, 58, -151, 40),
                "wrist2": (-39, 39, -58, 48, -46, 39),
                "wrist3": (-38, 38, -43, 38, -35, 0),
            },
        ),
    }
)
