"""Facts of the e-Series arms: links, limits, payload; universal_robots.md 1.

Sections (§) are those of universal_robots.md.
"""

import math
from dataclasses import dataclass
from typing import Final

JOINTS: Final = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
JOINT_COUNT: Final = len(JOINTS)
CYCLE_S: Final = 1.0 / 500.0  # control cycle of the e-Series, §2.4

_TURN: Final = 2.0 * math.pi

Joints6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class UrFacts:
    """Facts of one model; §1.

    Attributes
    ----------
    name : of the model, as the dashboard has it without the series
    number : robot type of the configuration data, §4.3
    d1_mm, a2_mm, a3_mm, d4_mm, d5_mm, d6_mm : Denavit-Hartenberg lengths; the others are zero
    speed_limits_rad_per_s : largest speeds of the joints
    limits_rad : largest positions of the joints, the same in both directions
    payload_max_kg : largest payload
    """

    name: str
    number: int
    d1_mm: float
    a2_mm: float
    a3_mm: float
    d4_mm: float
    d5_mm: float
    d6_mm: float
    speed_limits_rad_per_s: Joints6
    limits_rad: Joints6 = (_TURN, _TURN, math.pi, _TURN, _TURN, _TURN)
    payload_max_kg: float

    @property
    def dh_a_mm(self) -> Joints6:
        """Lengths along x."""
        return (0.0, self.a2_mm, self.a3_mm, 0.0, 0.0, 0.0)

    @property
    def dh_d_mm(self) -> Joints6:
        """Offsets along z."""
        return (self.d1_mm, 0.0, 0.0, self.d4_mm, self.d5_mm, self.d6_mm)


DH_ALPHA_RAD: Final[Joints6] = (math.pi / 2, 0.0, 0.0, math.pi / 2, -math.pi / 2, 0.0)


def _deg(*values: float) -> Joints6:
    one, two, three, four, five, six = (math.radians(value) for value in values)
    return one, two, three, four, five, six


UR3E: Final = UrFacts(
    name="UR3",
    number=3,
    d1_mm=151.85,
    a2_mm=-243.55,
    a3_mm=-213.2,
    d4_mm=131.05,
    d5_mm=85.35,
    d6_mm=92.1,
    speed_limits_rad_per_s=_deg(180, 180, 180, 360, 360, 360),
    payload_max_kg=3.0,
)
UR5E: Final = UrFacts(
    name="UR5",
    number=1,
    d1_mm=162.5,
    a2_mm=-425.0,
    a3_mm=-392.2,
    d4_mm=133.3,
    d5_mm=99.7,
    d6_mm=99.6,
    speed_limits_rad_per_s=_deg(180, 180, 180, 180, 180, 180),
    payload_max_kg=5.0,
)
UR10E: Final = UrFacts(
    name="UR10",
    number=2,
    d1_mm=180.7,
    a2_mm=-612.7,
    a3_mm=-571.55,
    d4_mm=174.15,
    d5_mm=119.85,
    d6_mm=116.55,
    speed_limits_rad_per_s=_deg(120, 120, 180, 180, 180, 180),
    payload_max_kg=12.5,
)
MODELS: Final = {"ur3e": UR3E, "ur5e": UR5E, "ur10e": UR10E}


@dataclass(frozen=True, slots=True, kw_only=True)
class Software:
    """A version of the controller's software, which decides on the layout of some packets.

    Attributes
    ----------
    major, minor, bugfix, build : the version
    """

    major: int = 5
    minor: int = 11
    bugfix: int = 1
    build: int = 108318

    @property
    def text(self) -> str:
        """The version as the dashboard prints it."""
        return f"{self.major}.{self.minor}.{self.bugfix}.{self.build}"

    def is_at_least(self, major: int, minor: int) -> bool:
        """Return whether this is that version or a later one."""
        return (self.major, self.minor) >= (major, minor)


def software_of(text: str) -> Software:
    """Return the version that a text such as ``5.11`` or ``3.4.1`` names.

    Raises
    ------
    ValueError : it names none
    """
    try:
        numbers = [int(word) for word in text.split(".")]
    except ValueError as error:
        raise ValueError(f"software {text!r}: numbers between dots, such as 5.11.1") from error
    if not 2 <= len(numbers) <= 4 or min(numbers) < 0:
        raise ValueError(f"software {text!r}: two to four numbers between dots, such as 5.11.1")
    major, minor, bugfix, build = [*numbers, 0, 0][:4]
    return Software(major=major, minor=minor, bugfix=bugfix, build=build)
