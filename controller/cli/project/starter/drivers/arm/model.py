"""How the ACME arm is built: six revolute joints, the last three through one point.

It fits the planner's `ArmModel` (controller/planning/model/arm.py), which says what each function
owes, and imports nothing of the controller. Put your arm's lengths, limits, links and speeds in
place of these; an arm of another design needs `forward`, `link_frames` and `branches` anew.

Joints q = [turret, shoulder, elbow, roll, bend, flange] in rad. Shoulder and elbow lift the upper
arm and the forearm above the horizontal; roll and flange turn about the forearm and about the
approach axis, bend between them. The arm's frame has its origin on the floor under the turret's
axis, x ahead, z up.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOW_RAD = np.radians([-170.0, -40.0, -155.0, -175.0, -120.0, -175.0])
HIGH_RAD = np.radians([170.0, 170.0, 155.0, 175.0, 120.0, 175.0])
NAMES = ("turret", "shoulder", "elbow", "roll", "bend", "flange")
STRAIGHT = 1e-9  # sine of the bend below which roll and flange are one axis


def about(axis: int, angle_rad: Floats) -> Floats:
    """Return rotations (..., 3, 3) about x, y or z."""
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    R = np.zeros((*np.shape(angle_rad), 3, 3))
    R[..., axis, axis] = 1.0
    R[..., i, i] = R[..., j, j] = np.cos(angle_rad)
    R[..., j, i] = np.sin(angle_rad)
    R[..., i, j] = -R[..., j, i]
    return R


@dataclass(frozen=True, eq=False)
class Link:
    """A link as a box in its frame."""

    name: str
    T: Floats
    half_mm: Floats
    may_touch_base: bool = True
    may_touch_table: bool = True
    keeps_clear_of: Literal["gripper", "fingers", "nothing"] = "gripper"


@dataclass(frozen=True, eq=False)
class Limit:
    """A limit of the joints: ``low <= weights @ q <= high`` [rad]."""

    name: str
    weights: Floats
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Sweep:
    """A range of joints (6,) that a motion may pass [rad]."""

    what: str
    low: Floats
    high: Floats
    join: Floats


def box(name: str, bounds: Sequence[float], **flags: object) -> Link:
    """Return a link.

    Parameters
    ----------
    name : for people
    bounds : ``(x low, x high, y low, y high, z low, z high)`` in the link's frame [mm]
    flags : fields of `Link`
    """
    low, high = np.array(bounds[::2], float), np.array(bounds[1::2], float)
    T = np.eye(4)
    T[:3, 3] = (low + high) / 2
    return Link(name, T, (high - low) / 2, **flags)  # type: ignore[arg-type]


@dataclass(frozen=True)
class Trapezoids:
    """Each joint has a motor of its own; all are stretched to the slowest one's time."""

    speeds: tuple[float, ...] = tuple(np.radians([90.0, 80.0, 100.0, 180.0, 180.0, 240.0]).tolist())
    ramp_s: float = 0.3
    command_s: float = 0.02

    @property
    def joint_speeds(self) -> Floats:
        """Full speed of each joint (6,) [rad/s]."""
        return np.array(self.speeds)

    def move_seconds(self, q_from: Floats, q_to: Floats) -> Floats:
        """Return the seconds of single moves between (..., 6), 0 where nothing moves."""
        share_s = self.travel_seconds(q_from, q_to)
        short = 2.0 * np.sqrt(share_s * self.ramp_s)
        seconds = np.where(share_s >= self.ramp_s, share_s + self.ramp_s, short) + self.command_s
        return np.where(share_s > 1e-9, seconds, 0.0)

    def travel_seconds(self, q_from: Floats, q_to: Floats) -> Floats:
        """Return the seconds at full speed between (..., 6)."""
        step = np.abs(np.asarray(q_to) - np.asarray(q_from))
        return np.asarray((step / self.joint_speeds).max(axis=-1))

    def courses(self, q_from: Floats, q_to: Floats, count: int) -> tuple[Floats, Floats]:
        """Return configurations on the way of one move, and the shares of it done there.

        Parameters
        ----------
        q_from, q_to : (6,) its ends
        count : number of instants
        """
        share = np.linspace(0.0, 1.0, count)
        return q_from + share[:, None] * (q_to - q_from), share

    def stray(self, step: Floats) -> Floats:
        """Return how far a move may leave the joint line (6,): not at all."""
        return np.zeros_like(step)


@dataclass(frozen=True, eq=False)
class SixAxis:
    """The arm; lengths in mm.

    Attributes
    ----------
    height_mm, ahead_mm : of the shoulder above the floor, and before the turret's axis
    upper_mm, fore_mm : shoulder to elbow, elbow to the wrist's centre
    tool_mm : wrist's centre to TCP
    """

    height_mm: float = 430.0
    ahead_mm: float = 60.0
    upper_mm: float = 420.0
    fore_mm: float = 390.0
    tool_mm: float = 177.0
    timing: Trapezoids = field(default_factory=Trapezoids)

    @property
    def reach_mm(self) -> float:
        """Largest distance of the wrist's centre from the turret's axis."""
        return self.ahead_mm + self.upper_mm + self.fore_mm

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Name of each joint, with its unit."""
        return tuple(f"{name}_rad" for name in NAMES)

    @property
    def joint_limits(self) -> tuple[Limit, ...]:
        """Limits that every allowed configuration meets."""
        return tuple(map(Limit, NAMES, np.eye(6), LOW_RAD.tolist(), HIGH_RAD.tolist()))

    @property
    def links(self) -> tuple[Link, ...]:
        """Moving links from the base on, in the order of `link_frames`."""
        above = {"may_touch_base": False, "may_touch_table": False}
        return (
            box("turret", [-90, 130, -80, 80, -110, 70], **above),
            box("upper", [-50, self.upper_mm + 50, -50, 50, -50, 50], **above),
            box("fore", [-60, self.fore_mm + 20, -40, 40, -40, 40], keeps_clear_of="fingers"),
            box("wrist", [-35, 35, -35, 35, -35, 35], keeps_clear_of="nothing"),
        )

    @property
    def link_pairs(self) -> tuple[tuple[int, int], ...]:
        """Links by index that may touch each other."""
        return ((0, 2), (0, 3), (1, 3))

    @property
    def swept(self) -> Mapping[str, Link]:
        """Volumes that links sweep wherever the arm goes."""
        reach = float(np.hypot(130.0, 80.0))
        h = self.height_mm
        return {"turret": box("turret", [-reach, reach, -reach, reach, h - 110, h + 70])}

    # ---- forward --------------------------------------------------------------------------------
    def _arm(self, q: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the turret's turn, the forearm's, shoulder and elbow in the arm's frame."""
        turret = about(2, q[..., 0])
        shoulder = self.ahead_mm * turret[..., :, 0] + [0.0, 0.0, self.height_mm]
        upper = turret @ about(1, -q[..., 1])
        elbow = shoulder + self.upper_mm * upper[..., :, 0]
        return turret, turret @ about(1, -(q[..., 1] + q[..., 2])), shoulder, elbow

    def forward(self, q: Floats) -> Floats:
        """Return T_arm_tcp (..., 4, 4) of configurations (..., 6)."""
        q = np.asarray(q, float)
        _, fore, _, elbow = self._arm(q)
        R = fore @ about(0, q[..., 3]) @ about(1, q[..., 4]) @ about(0, q[..., 5])
        T = np.zeros((*q.shape[:-1], 4, 4))
        T[..., 3, 3] = 1.0
        T[..., :3, :3] = R
        T[..., :3, 3] = elbow + self.fore_mm * fore[..., :, 0] + self.tool_mm * R[..., :, 0]
        return T

    def link_frames(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the links' frames at (n, 6): rotations (n, 4, 3, 3), origins (n, 4, 3) [mm]."""
        turret, fore, shoulder, elbow = self._arm(q)
        upper = turret @ about(1, -q[..., 1])
        wrist = fore @ about(0, q[..., 3]) @ about(1, q[..., 4])
        centre = elbow + self.fore_mm * fore[..., :, 0]
        axis = np.broadcast_to([0.0, 0.0, self.height_mm], shoulder.shape)
        R = np.stack([turret, upper, fore, wrist], axis=1)
        return R, np.stack([axis, shoulder, elbow, centre], axis=1)

    # ---- inverse --------------------------------------------------------------------------------
    def branches(self, T_arm_tcp: Floats) -> Floats:
        """Return (..., 8, 6): turret ahead or behind, elbow either way, wrist either way."""
        T = np.asarray(T_arm_tcp, float)
        wrist = T[..., :3, 3] - self.tool_mm * T[..., :3, 0]
        level = np.hypot(wrist[..., 0], wrist[..., 1])
        up = wrist[..., 2] - self.height_mm
        rows = []
        for behind in (False, True):
            turret = np.arctan2(wrist[..., 1], wrist[..., 0]) + (np.pi if behind else 0.0)
            ahead = (-level if behind else level) - self.ahead_mm
            away2 = ahead**2 + up**2
            u, f = self.upper_mm, self.fore_mm
            cos_elbow = (away2 - u**2 - f**2) / (2 * u * f)
            is_there = np.abs(cos_elbow) <= 1.0 + 1e-12
            bent = np.where(is_there, np.arccos(np.clip(cos_elbow, -1, 1)), np.nan)
            for sign in (1.0, -1.0):
                elbow = sign * bent
                towards = np.arctan2(up, ahead)
                shoulder = towards - np.arctan2(f * np.sin(elbow), u + f * np.cos(elbow))
                fore = about(2, turret) @ about(1, -(shoulder + elbow))
                R = np.swapaxes(fore, -1, -2) @ T[..., :3, :3]
                sine = np.hypot(R[..., 0, 1], R[..., 0, 2])
                is_straight = sine < STRAIGHT
                for flip in (1.0, -1.0):
                    bend = flip * np.arctan2(sine, R[..., 0, 0])
                    roll = np.arctan2(flip * R[..., 1, 0], -flip * R[..., 2, 0])
                    flange = np.arctan2(flip * R[..., 0, 1], flip * R[..., 0, 2])
                    # one axis: all of the turn is the flange's
                    roll = np.where(is_straight, 0.0, roll)
                    flange = np.where(is_straight, np.arctan2(R[..., 2, 1], R[..., 1, 1]), flange)
                    joints = [turret, shoulder, elbow, roll, bend, flange]
                    rows.append(np.stack(joints, axis=-1))
        q = np.stack(rows, axis=-2)
        centre = (LOW_RAD + HIGH_RAD) / 2  # each range is less than a turn: one image is in it
        return (q - centre + np.pi) % (2 * np.pi) - np.pi + centre

    def inverse(self, T_arm_tcp: Floats) -> tuple[NDArray[np.int64], NDArray[np.int64], Floats]:
        """Return all configurations within limits that bring the TCP to poses (n, 4, 4)."""
        q = self.branches(T_arm_tcp)
        index, branch = np.nonzero(self.within_limits(q))
        return index, branch, q[index, branch]

    # ---- limits ---------------------------------------------------------------------------------
    def within_limits(self, q: Floats) -> NDArray[np.bool_]:
        """Return which configurations (..., 6) are within the limits."""
        q = np.asarray(q)
        return np.asarray(((q >= LOW_RAD) & (q <= HIGH_RAD)).all(axis=-1))

    def limit_report(self, q: Floats) -> str:
        """Return the worst passed limit of one q (6,) in words."""
        passed = np.maximum(LOW_RAD - q, q - HIGH_RAD)
        worst = int(np.argmax(passed))
        if passed[worst] <= 0:
            return "within limits"
        return f"{NAMES[worst]} passed by {np.degrees(passed[worst]):.1f} deg"

    def spread(self, unit: Floats) -> Floats:
        """Return configurations for numbers drawn evenly from 0 to 1, (n, 6)."""
        return np.asarray(LOW_RAD + unit * (HIGH_RAD - LOW_RAD))

    def radii_mm(self, q_from: Floats, q_to: Floats, far_mm: float, beside_mm: float) -> Floats:
        """Return how far any point of arm, gripper or part moves with each joint (6,) [mm/rad].

        Parameters
        ----------
        q_from, q_to : (6,) ends of a joint line, on which it holds
        far_mm, beside_mm : reach of gripper and part from the wrist's centre, and from the approach
            axis
        """
        elbows = np.array([q_from[2], q_to[2]])
        bent = 0.0 if elbows.min() <= 0.0 <= elbows.max() else float(np.abs(elbows).min())
        wrist = np.hypot(self.upper_mm + self.fore_mm * np.cos(bent), self.fore_mm * np.sin(bent))
        from_shoulder = max(wrist + far_mm, self.upper_mm + 100.0)
        return np.array(
            [
                *(self.ahead_mm + from_shoulder, from_shoulder, self.fore_mm + far_mm),
                *(far_mm, far_mm, beside_mm),
            ]
        )

    # ---- round what stands in the way -----------------------------------------------------------
    def _drawn_up(self, q: Floats) -> Floats:
        """Return configurations (..., 6) with upper arm up, forearm level, tool down."""
        out = q.copy()
        out[..., 1], out[..., 2] = np.radians(100.0), np.radians(-100.0)
        out[..., 3], out[..., 4] = 0.0, np.radians(90.0)
        return out

    def detours(self, q_from: Floats, q_to: Floats) -> Iterator[list[list[Floats]]]:
        """Yield groups of joint paths round what may be in the way, the likeliest first."""
        up_from, up_to = self._drawn_up(q_from), self._drawn_up(q_to)
        keep_from, keep_to = up_from.copy(), up_to.copy()
        keep_from[3:], keep_to[3:] = q_from[3:], q_to[3:]
        yield [
            [q_from, keep_from, q_to],
            [q_from, keep_to, q_to],
            [q_from, keep_from, keep_to, q_to],
            [q_from, up_from, up_to, q_to],
            [q_from, keep_from, up_from, up_to, keep_to, q_to],
        ]

    def retreats(self, q: Floats, count: int) -> Floats:
        """Return ways (n, count, 6) out of crowded configurations (n, 6)."""
        share = np.linspace(0.0, 1.0, count)[:, None]
        return q[:, None] + share * (self._drawn_up(q) - q)[:, None]

    def homing_sweep(self, low: Floats, high: Floats) -> tuple[Sweep, ...]:
        """Return nothing: its encoders are absolute, and no joint moves for its homing."""
        return ()

    def move_sweep(self, q_from: Floats, q_to: Floats) -> Sweep:
        """Return the range of one move: each joint has a motor of its own."""
        ends = np.stack([q_from, q_to])
        return Sweep("it moves", ends.min(axis=0), ends.max(axis=0), np.eye(6))

    def describe(self, q: Floats) -> str:
        """Return one q (6,) as text, in degrees."""
        return "(" + ", ".join(f"{v:.0f}" for v in np.degrees(q)) + ")"
