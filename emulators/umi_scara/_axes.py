"""The structure of the arm: seven motors, their scaling, their stops and the ends of homing.

Facts: umi_rtx.md 1.3 (which motor answers where), §4.2 (stop labels), §5.1 to §5.5 (scaling and
ranges), §5.7 and 7 (motion model). *True counts* are encoder counts whose zero is the arm's own:
zed 0 at the top stop, every other joint 0 straight ahead. What the IPs report is relabelled.

Sections (§) are those of umi_rtx.md.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

CONTROLLER_COUNT: Final = 5  # controllers 0 to 4 in each IP; umi_rtx.md 0.3
IP_COUNT: Final = 2


class Axis(Enum):
    """One motor of the arm; the two wrist motors act together on pitch and roll."""

    ELBOW = "elbow"
    SHOULDER = "shoulder"
    ZED = "zed"
    YAW = "yaw"
    GRIPPER = "gripper"
    WRIST1 = "wrist1"
    WRIST2 = "wrist2"


@dataclass(frozen=True, slots=True)
class AxisFacts:
    """Facts of one motor.

    Attributes
    ----------
    ip, ctl : its board and controller, umi_rtx.md 1.3
    nominal_counts_per_s : speed at SPEED 100, umi_rtx.md 7
    lower_counts, upper_counts : its own stops [true counts]; infinite where only a combined limit
        holds, umi_rtx.md 5.2, and 4.2 for the elbow
    home_counts : value written to CURRENT_POSITION at the end of homing, umi_rtx.md 4.2
    max_force : default MAX_FORCE, umi_rtx.md 7
    """

    ip: int
    ctl: int
    nominal_counts_per_s: float
    lower_counts: float
    upper_counts: float
    home_counts: int
    max_force: int = 40


FACTS: Final[dict[Axis, AxisFacts]] = {
    Axis.ELBOW: AxisFacts(1, 0, 643.0, -2629.0, 2206.0, -2629),  # 5.2 rounds its stop to -2630
    Axis.SHOULDER: AxisFacts(1, 1, 672.0, -2630.0, 2630.0, 2630),
    Axis.ZED: AxisFacts(1, 2, 412.0, -3554.0, 0.0, 0, max_force=50),
    Axis.YAW: AxisFacts(1, 3, 1071.0, -math.inf, math.inf, -1947),
    Axis.GRIPPER: AxisFacts(1, 4, 1400.0, -30.0, 1200.0, 0),
    Axis.WRIST1: AxisFacts(0, 2, 1400.0, -math.inf, math.inf, -3101),
    Axis.WRIST2: AxisFacts(0, 3, 1400.0, -math.inf, math.inf, 459),
}

# Combined limits; umi_rtx.md 5.2, and 4.2 for the yaw
YAW_COUNTS_PER_ELBOW_COUNT: Final = 1.0 / 3.0
# |Y - E/3|, the gripper against the forearm; 5.2 rounds it to 1071. Stops beside the labels that
# homing writes there would be errors of an arm that has none: one count of elbow is 0.3 mm.
YAW_TO_ELBOW_LIMIT_COUNTS: Final = (
    FACTS[Axis.ELBOW].home_counts * YAW_COUNTS_PER_ELBOW_COUNT - FACTS[Axis.YAW].home_counts
)
PITCH_LIMITS_COUNTS: Final = (-2642.0, 108.0)  # W1 + W2
ROLL_LIMITS_COUNTS: Final = (-3560.0, 4882.0)  # W1 - W2

# Scaling; umi_rtx.md 5.1
SHOULDER_COUNTS_PER_DEG: Final = 29.221
ELBOW_COUNTS_PER_DEG: Final = 14.611
YAW_COUNTS_PER_DEG: Final = 9.740
WRIST_COUNTS_PER_DEG: Final = 13.487
ZED_COUNTS_PER_MM: Final = 3.750
# counts of the axes that turn; both wrist motors turn pitch and roll
COUNTS_PER_DEG: Final[dict[Axis, float]] = {
    Axis.SHOULDER: SHOULDER_COUNTS_PER_DEG,
    Axis.ELBOW: ELBOW_COUNTS_PER_DEG,
    Axis.YAW: YAW_COUNTS_PER_DEG,
    Axis.WRIST1: WRIST_COUNTS_PER_DEG,
    Axis.WRIST2: WRIST_COUNTS_PER_DEG,
}

# Jaw opening over counts, the fit of London Hackspace; umi_rtx.md 5.5
JAW_MM_PER_COUNT: Final = 0.0584
JAW_MM_PER_COUNT2: Final = 1.07e-5


@dataclass(frozen=True, slots=True)
class ArmJoints:
    """The true joints.

    Attributes
    ----------
    shoulder_rad, elbow_rad : positive counter-clockwise from above, umi_rtx.md 6.2
    yaw_rad : angle of the yaw *motor*; the heading is shoulder + elbow / 2 + yaw, umi_rtx.md 5.4
    zed_mm : 0 at the top, negative below
    pitch_rad : 0 level, negative pointing down
    roll_rad : about the approach axis
    jaw_opening_mm : between the jaws
    """

    shoulder_rad: float = 0.0
    elbow_rad: float = 0.0
    yaw_rad: float = 0.0
    zed_mm: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    jaw_opening_mm: float = 0.0

    @property
    def q(self) -> tuple[float, ...]:
        """All joints but the jaws, in the order of the chain that the world has of this arm."""
        return (
            self.shoulder_rad, self.elbow_rad, self.yaw_rad,
            self.zed_mm, self.pitch_rad, self.roll_rad,
        )  # fmt: skip


def gripper_counts_to_mm(counts: float) -> float:
    """Return the jaw opening [mm] at a gripper position [true counts], never below 0."""
    return max(0.0, JAW_MM_PER_COUNT * counts + JAW_MM_PER_COUNT2 * counts * counts)


def gripper_mm_to_counts(opening_mm: float) -> float:
    """Return the gripper position [true counts] at which the jaws are ``opening_mm`` apart."""
    b, a = JAW_MM_PER_COUNT, JAW_MM_PER_COUNT2
    return (math.sqrt(b * b + 4.0 * a * opening_mm) - b) / (2.0 * a)


def joints_of(counts: dict[Axis, float]) -> ArmJoints:
    """Return the joint values of true motor positions [true counts]; umi_rtx.md 5.3, 5.5, 6.3."""
    w1, w2 = counts[Axis.WRIST1], counts[Axis.WRIST2]
    return ArmJoints(
        shoulder_rad=math.radians(counts[Axis.SHOULDER] / SHOULDER_COUNTS_PER_DEG),
        elbow_rad=math.radians(counts[Axis.ELBOW] / ELBOW_COUNTS_PER_DEG),
        yaw_rad=math.radians(counts[Axis.YAW] / YAW_COUNTS_PER_DEG),
        zed_mm=counts[Axis.ZED] / ZED_COUNTS_PER_MM,
        pitch_rad=math.radians((w1 + w2) / (2.0 * WRIST_COUNTS_PER_DEG)),
        roll_rad=math.radians((w1 - w2) / (2.0 * WRIST_COUNTS_PER_DEG)),
        jaw_opening_mm=gripper_counts_to_mm(counts[Axis.GRIPPER]),
    )
