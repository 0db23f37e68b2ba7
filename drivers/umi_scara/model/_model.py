"""One arm: its lengths, the space of its links, and its speeds."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from . import _detours, kinematics
from ._figures import UmiFigures
from ._homing_sweep import SweepPhase, homing_sweep
from ._joint_limits import JointLimit, joint_limits
from ._timing import UmiTiming, move_sweep
from .kinematics import ArmGeometry

__all__ = ["LinkBox", "UmiModel"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# headings tried where the gripper points straight down and the heading is free
HEADINGS_RAD: Final = np.radians(np.arange(-180.0, 180.0, 30.0))
# a gripper this close to straight down counts as straight down: its heading would be noise
VERTICAL: Final = 2e-3
# ranges of random joints, low and high; the limits are `kinematics.JOINT_RANGES`. The folded elbow
# and the last degrees are left out, which lead nowhere
DRAWN_FROM: Final = np.array(
    [
        [*np.radians([-90.0, -175.0, -190.0]), -900.0, *np.radians([-97.0, -131.0])],
        [*np.radians([90.0, 150.0, 185.0]), -10.0, *np.radians([3.0, 180.0])],
    ]
)
TOP_SHARE: Final = 0.2  # share of zed's range near the top, where the arm has most room
_ZED: Final = kinematics.Q_ORDER.index("zed_mm")

# Clear of what: "gripper" is body, fingers and held part, "fingers" leaves the body out
Clear = Literal["gripper", "fingers", "nothing"]


@dataclass(frozen=True, slots=True, eq=False)
class LinkBox:
    """A box around a link, in the link's frame, and the bodies that it may touch.

    Attributes
    ----------
    T : (4, 4) pose of the box's centre
    half_mm : (3,) half of each edge
    may_touch_base, may_touch_table : the joint limits do not keep it off the column or the table
    keeps_clear_of : boxes of the arm gripper that it must not touch
    """

    name: str
    T: Floats
    half_mm: Floats
    may_touch_base: bool = True
    may_touch_table: bool = True
    keeps_clear_of: Clear = "gripper"


@dataclass(frozen=True, slots=True, eq=False)
class UmiModel:
    """The UMI RTX in one cell; joints and frames as in `kinematics`.

    Attributes
    ----------
    geometry : its lengths
    links : carriage, upper arm and forearm, see `of_boxes`
    timing : timing model of its moves
    """

    geometry: ArmGeometry
    links: tuple[LinkBox, ...]
    timing: UmiTiming = field(default_factory=UmiTiming)

    @classmethod
    def of_boxes(
        cls,
        geometry: ArmGeometry,
        boxes: Mapping[str, tuple[Floats, Floats]],
        timing: UmiTiming | None = None,
    ) -> "UmiModel":
        """Return the arm with links of these boxes.

        Parameters
        ----------
        geometry : its lengths
        boxes : for each of `kinematics.LINKS`, pose (4, 4) and half edges (3,) [mm] in its frame
        timing : as fitted to this arm; the nominal one if None

        Raises
        ------
        KeyError : a link has no box
        """
        # carriage and upper arm ride on the column above everything; the palm is beside the
        # forearm's end and the neck inside it
        links = (
            LinkBox("carriage", *boxes["carriage"], may_touch_base=False, may_touch_table=False),
            LinkBox("upper", *boxes["upper"], may_touch_base=False, may_touch_table=False),
            LinkBox("fore", *boxes["fore"], keeps_clear_of="fingers"),
        )
        return cls(geometry, links, timing or UmiTiming())

    @property
    def figures(self) -> UmiFigures:
        """What a calibration finds of it."""
        return UmiFigures(self.geometry)

    def measured(self, values: Floats) -> "UmiModel":
        """Return the arm with the values (13,) of its figures."""
        return replace(self, geometry=self.figures.geometry(values))

    @property
    def tool_mm(self) -> float:
        """From the wrist's centre to the TCP, along the approach axis."""
        return self.geometry.tool_mm

    @property
    def reach_mm(self) -> float:
        """The reach of the wrist's centre from the shoulder axis."""
        return self.geometry.upper_mm + self.geometry.fore_mm

    @property
    def joint_names(self) -> Sequence[str]:
        """Name of each joint, ending in its unit."""
        return kinematics.Q_ORDER

    @property
    def joint_limits(self) -> Sequence[JointLimit]:
        """The limits fulfilled by every target that the arm accepts."""
        return joint_limits()

    @property
    def link_pairs(self) -> Sequence[tuple[int, int]]:
        """Links that may touch each other: none, they lie above each other."""
        return ()

    @property
    def swept(self) -> Mapping[str, LinkBox]:
        """The carriage's travel, from the table to the top, in the arm's frame."""
        carriage = self.links[0]
        reach = np.abs(carriage.T[:3, :3]) @ carriage.half_mm
        low, high = carriage.T[:3, 3] - reach, carriage.T[:3, 3] + reach
        low[2], high[2] = 0.0, self.geometry.wrist_height_mm + high[2]
        T = np.eye(4)
        T[:3, 3] = (low + high) / 2
        return {"carriage's travel": LinkBox("carriage", T, (high - low) / 2)}

    def forward(self, q: Floats) -> Floats:
        """Return T_arm_tcp (..., 4, 4) of joints (..., 6); limits are not checked."""
        return kinematics.forward(q, self.geometry)

    def link_frames(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the links' frames of joints (n, 6): rotations (n, 3, 3, 3), origins (n, 3, 3)."""
        return kinematics.link_frames(q, self.geometry)

    def inverse(self, T_arm_tcp: Floats) -> tuple[Ints, Ints, Floats]:
        """Return all joints within limits that bring the TCP to poses (n, 4, 4).

        The branch number means the same for all poses of one orientation (elbow sign, wrist branch
        or heading), so that a straight line keeps its branch.

        Returns
        -------
        index, branch : (m,) number of each pose in the order of the poses, and its branch
        q : (m, 6)
        """
        down = np.hypot(T_arm_tcp[:, 0, 0], T_arm_tcp[:, 1, 0]) < VERTICAL
        if down.any():
            T_arm_tcp = T_arm_tcp.copy()
            T_arm_tcp[down, :3, :3] = _straightened(T_arm_tcp[down, :3, :3])
        return kinematics.inverse_legal(T_arm_tcp, self.geometry, heading_rad=HEADINGS_RAD)

    def branches(self, T_arm_tcp: Floats) -> Floats:
        """Return the joints of all branches, limits ignored: (..., b, 6), NaN for none."""
        return kinematics.inverse(T_arm_tcp, self.geometry)[0]

    def within_limits(self, q: Floats) -> NDArray[np.bool_]:
        """Return whether the arm would accept joints (..., 6): (...) bool; NaN is outside."""
        return kinematics.within_limits(q)

    def limit_report(self, q: Floats) -> str:
        """Return the worst passed limit of one q (6,), and by how much."""
        return kinematics.limit_report(q)

    def spread(self, unit: Floats) -> Floats:
        """Return joints for numbers drawn evenly from 0 to 1, (n, 6): half of them near the top."""
        low, high = DRAWN_FROM
        q = low + unit * (high - low)
        q[::2, _ZED] = high[_ZED] + (q[::2, _ZED] - high[_ZED]) * TOP_SHARE
        return np.asarray(q)

    def radii_mm(self, q_from: Floats, q_to: Floats, far_mm: float, beside_mm: float) -> Floats:
        """Return a bound on the travel of any point of arm, gripper or part with each joint.

        Parameters
        ----------
        q_from, q_to : (6,) ends of a joint line, on which it holds
        far_mm, beside_mm : reach of gripper and part from the wrist's centre, and from the approach
            axis

        Returns
        -------
        (6,) [mm per rad or mm]
        """
        arm = self.geometry
        elbows = np.array([q_from[1], q_to[1]])
        # the wrist is farthest from the shoulder where the elbow is straightest
        bent = 0.0 if elbows.min() <= 0.0 <= elbows.max() else float(np.abs(elbows).min())
        wrist = np.hypot(arm.upper_mm + arm.fore_mm * np.cos(bent), arm.fore_mm * np.sin(bent))
        # half of the elbow's turn is taken back from the gripper (umi_rtx.md 5.4)
        return np.array([wrist + far_mm, arm.fore_mm + far_mm / 2, far_mm, 1.0, far_mm, beside_mm])

    def detours(self, q_from: Floats, q_to: Floats) -> Iterator[Sequence[Sequence[Floats]]]:
        """Yield groups of joint paths (6,) to (6,) over obstacles in between."""
        return _detours.detours(q_from, q_to)

    def retreats(self, q: Floats, count: int) -> Floats:
        """Return joints (n, 6) on their way straight up: (n, count, 6)."""
        return _detours.lifts(q, count)

    def homing_sweep(self, low: Floats, high: Floats) -> Sequence[SweepPhase]:
        """Return the joints swept by homing with shut jaws, started from within bounds (6,)."""
        return homing_sweep(low, high)

    def move_sweep(self, q_from: Floats, q_to: Floats) -> SweepPhase:
        """Return the joints swept by one move, whether or not its motors keep step."""
        return move_sweep(q_from, q_to)

    def describe(self, q: Floats) -> str:
        """Return one q (6,) in degrees and mm."""
        shown = [*np.degrees(q[:3]), q[3], *np.degrees(q[4:])]
        return "(" + ", ".join(f"{v:.0f}" for v in shown) + ")"


def _straightened(R: Floats) -> Floats:
    """Return rotations (n, 3, 3) that are nearly vertical with their x axis exactly so."""
    out = np.zeros_like(R)
    out[:, 2, 0] = np.sign(R[:, 2, 0])
    y = R[:, :, 1].copy()
    y[:, 2] = 0.0
    out[:, :, 1] = y / np.linalg.norm(y, axis=1, keepdims=True)
    out[:, :, 2] = np.cross(out[:, :, 0], out[:, :, 1])
    return out
