"""One arm: its lengths, the space of its links, and its speeds.

Sections (§) are those of ur.md.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from messages import key, say

from . import _detours, kinematics
from ._figures import UrFigures
from ._sizes import UrSize
from ._timing import UrTiming

__all__ = ["JointLimit", "LinkBox", "SweepPhase", "UrModel"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Clear = Literal["gripper", "fingers", "nothing"]

# §1.2. The elbow turns as far as the others, but beyond half a turn the forearm is in the upper arm
LIMITS_RAD: Final = np.radians([360.0, 360.0, 180.0, 360.0, 360.0, 360.0])
# A pose is reached by angles that are a whole turn apart; each joint is used within half a turn of
# its middle. This much before the cut it is not used at all, so that a straight line of the TCP,
# which turns a joint by less between two of its points, never jumps from one side to the other
CUT_RAD: Final = float(np.radians(5.0))
# An arm as it was made is reached by steps from the drawing's joints; each leaves the square of the
# error before. Beyond these errors of the TCP there is no such pose
_STEPS: Final = 8
_REACHED_MM: Final = 1e-3
_REACHED_RAD: Final = 1e-6
_LEVER_MM: Final = 300.0  # weighs turns against shifts
_DAMPING: Final = 1e-9  # where two axes turn about one line, no joint runs away
# joints, as drawn at random, to either side of their middle: an elbow folded farther leads nowhere
DRAWN_RAD: Final = np.radians([175.0, 90.0, 155.0, 175.0, 140.0, 175.0])
# links that may touch each other: all but neighbours, and wrist 1 and 3, which never meet (§1.3)
LINK_PAIRS: Final = ((0, 2), (0, 3), (0, 4), (0, 5), (1, 3), (1, 4), (1, 5), (2, 4), (2, 5))


@dataclass(frozen=True, slots=True, eq=False)
class LinkBox:
    """A box around a link, in the link's frame, and the bodies that it may touch.

    Attributes
    ----------
    T : (4, 4) pose of the box's centre
    half_mm : (3,) half of each edge
    may_touch_base, may_touch_table : it could reach the base, the table
    keeps_clear_of : boxes of the arm gripper that it must not touch
    """

    name: str
    T: Floats
    half_mm: Floats
    may_touch_base: bool = True
    may_touch_table: bool = True
    keeps_clear_of: Clear = "gripper"

    @classmethod
    def of_bounds(
        cls,
        name: str,
        bounds: Sequence[float],
        *,
        may_touch_base: bool = True,
        may_touch_table: bool = True,
        keeps_clear_of: Clear = "gripper",
    ) -> "LinkBox":
        """Return the box between bounds.

        Parameters
        ----------
        name : name that people use
        bounds : x, y, z, each low and high [mm]
        may_touch_base, may_touch_table, keeps_clear_of : as of the class
        """
        low, high = np.array(bounds[::2], np.float64), np.array(bounds[1::2], np.float64)
        T = np.eye(4)
        T[:3, 3] = (low + high) / 2
        half = (high - low) / 2
        return cls(name, T, half, may_touch_base, may_touch_table, keeps_clear_of)


@dataclass(frozen=True, slots=True, eq=False)
class JointLimit:
    """One linear limit: ``low <= weights @ q <= high`` [rad]."""

    name: str
    weights: Floats
    low: float
    high: float


@dataclass(frozen=True, slots=True, eq=False)
class SweepPhase:
    """One phase of a motion: joints ``join @ angles`` with angles from `low` to `high` (6,)."""

    what: str
    low: Floats
    high: Floats
    join: Floats


@dataclass(frozen=True, slots=True, eq=False)
class UrModel:
    """An arm with parallel shoulder, elbow and wrist 1; joints and frames as in `kinematics`.

    Attributes
    ----------
    name : its model, such as ``ur5e``
    size : lengths
    links : link boxes in the order of `kinematics.LINKS`
    timing : timing model of its moves
    flange_to_tcp_mm : flange to TCP, along the flange's axis
    jaws_rad : direction in which the jaws move, about the flange's axis from its x axis
    middle_rad : (6,) each joint is used within half a turn of this
    made : (6, 6) differences of its frames from their drawing, as `kinematics.link_frames`; 0 until
        measured
    """

    name: str
    size: UrSize
    links: tuple[LinkBox, ...]
    timing: UrTiming
    flange_to_tcp_mm: float
    jaws_rad: float
    middle_rad: Floats
    made: Floats = field(default_factory=kinematics.AS_DRAWN.copy)

    @property
    def figures(self) -> UrFigures:
        """What a calibration finds of it."""
        return UrFigures(self)

    def measured(self, values: Floats) -> "UrModel":
        """Return the arm with the values (36,) of its figures."""
        made = np.asarray(values, np.float64).reshape(self.made.shape)
        return replace(self, made=made)

    @property
    def tool_mm(self) -> float:
        """Distance from the wrist's centre, where the axes of wrist 2 and 3 meet, to the TCP."""
        return self.size.d6 + self.flange_to_tcp_mm + float(self.made[-1, 3])

    @property
    def reach_mm(self) -> float:
        """Largest distance of the wrist's centre from the base's axis."""
        size = self.size
        return float(np.hypot(abs(size.a2) + abs(size.a3) + size.d5, size.d4)) + self._off_mm

    @property
    def joint_names(self) -> Sequence[str]:
        """Name of each joint, ending in its unit."""
        return tuple(f"{name}_rad" for name in kinematics.JOINTS)

    @property
    def joint_limits(self) -> Sequence[JointLimit]:
        """The range of each joint."""
        rows = zip(kinematics.JOINTS, np.eye(6), LIMITS_RAD.tolist(), strict=True)
        return tuple(JointLimit(name, row, -limit, limit) for name, row, limit in rows)

    @property
    def link_pairs(self) -> Sequence[tuple[int, int]]:
        """Links by index that may touch each other."""
        return LINK_PAIRS

    @property
    def swept(self) -> Mapping[str, LinkBox]:
        """The turn of the shoulder about the base's axis, in the arm's frame."""
        box = self.links[0]
        reach = float(np.hypot(*(np.abs(box.T[:2, 3]) + box.half_mm[:2])))
        middle, half = self.size.d1 + box.T[2, 3], box.half_mm[2]
        bounds = (-reach, reach, -reach, reach, middle - half, middle + half)
        return {"shoulder's turn": LinkBox.of_bounds("shoulder", bounds)}

    def forward(self, q: Floats) -> Floats:
        """Return T_arm_tcp (..., 4, 4) of joints (..., 6); limits are not checked."""
        return self._forward(*self.link_frames(q))

    def link_frames(self, q: Floats) -> tuple[Floats, Floats]:
        """Return the links' frames of joints (n, 6): rotations (n, 6, 3, 3), origins (n, 6, 3)."""
        return kinematics.link_frames(q, self.size, self.made)

    def branches(self, T_arm_tcp: Floats) -> Floats:
        """Return the joints of all branches, (..., 8, 6), each within half a turn of its middle.

        NaN where a branch does not exist.
        """
        T = np.asarray(T_arm_tcp, np.float64)
        q = kinematics.flange_branches(T @ np.linalg.inv(self._tcp_on_flange()), self.size)
        if self.made.any():
            q = self._as_made(q, T)
        return np.asarray(self.middle_rad - np.pi + (q - self.middle_rad + np.pi) % (2 * np.pi))

    def inverse(self, T_arm_tcp: Floats) -> tuple[Ints, Ints, Floats]:
        """Return the joints of the branches that bring the TCP to poses (n, 4, 4).

        The image of each joint is the one about its middle; those a whole turn away are the same
        pose. Limits are met by all of them; near the cut, half a turn from the middle, there are
        none.

        Returns
        -------
        index, branch : (m,) number of each pose in the order of the poses, and its branch
        q : (m, 6)
        """
        q = self.branches(T_arm_tcp)
        free = np.abs(q - self.middle_rad) <= np.pi - CUT_RAD
        # elbow and wrist 2 turn back where they come to half a turn, so that they never jump
        free[..., [2, 4]] = True
        index, branch = np.nonzero(free.all(axis=-1) & self.within_limits(q))
        return index, branch, q[index, branch]

    def within_limits(self, q: Floats) -> NDArray[np.bool_]:
        """Return whether joints (..., 6) are within the limits: (...) bool; NaN is outside."""
        return np.asarray((np.abs(np.asarray(q)) <= LIMITS_RAD).all(axis=-1))

    def limit_report(self, q: Floats) -> str:
        """Return the worst passed limit of one q (6,), and by how much."""
        passed = np.abs(np.asarray(q)) - LIMITS_RAD
        if not np.isfinite(passed).all():
            return "no such pose"
        worst = int(np.argmax(passed))
        if passed[worst] <= 0.0:
            return key("within limits")
        return say(
            "{joint} passed by {passed_deg:.1f} deg ({end_deg:.0f} deg is the end)",
            joint=kinematics.JOINTS[worst],
            passed_deg=np.degrees(passed[worst]),
            end_deg=np.degrees(LIMITS_RAD[worst]),
        )

    def spread(self, unit: Floats) -> Floats:
        """Return joints about their middles for numbers drawn evenly from 0 to 1, (n, 6)."""
        q = self.middle_rad + (2.0 * np.asarray(unit) - 1.0) * DRAWN_RAD
        return np.asarray(np.clip(q, -LIMITS_RAD, LIMITS_RAD))

    def radii_mm(self, q_from: Floats, q_to: Floats, far_mm: float, beside_mm: float) -> Floats:
        """Return a bound on the travel of any point of arm, gripper or part with each joint.

        Parameters
        ----------
        q_from, q_to : (6,) ends of a joint line, on which it holds
        far_mm, beside_mm : reach of gripper and part from the wrist's centre, and from the approach
            axis

        Returns
        -------
        (6,) [mm per rad]
        """
        size = self.size
        upper, fore = abs(size.a2), abs(size.a3)
        elbows = np.array([q_from[2], q_to[2]])
        # the wrist is farthest from the shoulder where the elbow is straightest
        bent = 0.0 if elbows.min() <= 0.0 <= elbows.max() else float(np.abs(elbows).min())
        wrist = float(np.hypot(upper + fore * np.cos(bent), fore * np.sin(bent)))
        # the corner of each link farthest from its own joint's origin
        corner = [
            float(np.linalg.norm(np.abs(link.T[:3, 3]) + link.half_mm)) for link in self.links
        ]
        hand = max(size.d5 + max(far_mm, corner[4], size.d6 + corner[5]), corner[3])
        shoulder = max(wrist + hand, upper + corner[2], corner[1])
        base = max(float(np.hypot(wrist, size.d4)) + hand, upper + corner[2], *corner[:2])
        elbow = max(fore + hand, corner[2])
        wrist2 = max(far_mm, corner[4], size.d6 + corner[5])
        drawn = np.array([base, shoulder, elbow, hand, wrist2, max(beside_mm, corner[5])])
        return np.asarray(drawn + self._off_mm)

    def detours(self, q_from: Floats, q_to: Floats) -> Iterator[Sequence[Sequence[Floats]]]:
        """Yield groups of joint paths (6,) to (6,) over obstacles in between."""
        return _detours.detours(q_from, q_to)

    def retreats(self, q: Floats, count: int) -> Floats:
        """Return joints (n, 6) on their way to a drawn posture: (n, count, 6)."""
        share = np.linspace(0.0, 1.0, count)[:, None]
        q = np.asarray(q, np.float64)
        return np.asarray(q[:, None] + share * (_detours.drawn(q) - q)[:, None])

    def homing_sweep(self, low: Floats, high: Floats) -> Sequence[SweepPhase]:
        """Return nothing: its encoders are absolute, and it homes by no motion of a joint."""
        return ()

    def move_sweep(self, q_from: Floats, q_to: Floats) -> SweepPhase:
        """Return the joints swept by one move, whether or not its joints keep step."""
        ends = np.stack([q_from, q_to])
        return SweepPhase("the arm moves", ends.min(axis=0), ends.max(axis=0), np.eye(6))

    def describe(self, q: Floats) -> str:
        """Return one q (6,) in degrees."""
        return "(" + ", ".join(f"{v:.0f}" for v in np.degrees(q)) + ")"

    @property
    def _off_mm(self) -> float:
        """Bound on how far any point is from where the drawing has it [mm]."""
        size = self.size
        lever_mm = size.d1 + abs(size.a2) + abs(size.a3) + size.d4 + size.d5 + size.d6
        turned = np.linalg.norm(self.made[:, :3], axis=1) * (lever_mm + self.flange_to_tcp_mm)
        return float(np.sum(turned + np.linalg.norm(self.made[:, 3:], axis=1)))

    def _forward(self, R: Floats, origin: Floats) -> Floats:
        """Return T_arm_tcp (..., 4, 4) of the links' frames."""
        T = np.zeros((*R.shape[:-3], 4, 4))
        T[..., 3, 3] = 1.0
        T[..., :3, :3] = R[..., -1, :, :]
        T[..., :3, 3] = origin[..., -1, :]
        return T @ self._tcp_on_flange()

    def _as_made(self, q: Floats, T_arm_tcp: Floats) -> Floats:
        """Return the joints (..., 8, 6) of the arm as made, near those of the drawing.

        NaN where there are none.

        Parameters
        ----------
        q : (..., 8, 6) joints by the drawing
        T_arm_tcp : (..., 4, 4) target
        """
        there = np.isfinite(q[..., 0])
        rows = q[there]
        goal = np.broadcast_to(T_arm_tcp[..., None, :, :], (*q.shape[:-1], 4, 4))[there]
        left = np.arange(len(rows))  # most are there after two steps
        for number in range(_STEPS + 1):
            error, jac = self._error(rows[left], goal[left])
            off_mm = _LEVER_MM * np.linalg.norm(error[:, :3], axis=1)
            is_off = (off_mm > _REACHED_MM) | (np.linalg.norm(error[:, 3:], axis=1) > _REACHED_RAD)
            left, error, jac = left[is_off], error[is_off], jac[is_off]
            if not len(left) or number == _STEPS:
                break
            # damped least squares
            square = jac @ np.swapaxes(jac, -1, -2) + _DAMPING * np.eye(6)
            step = np.swapaxes(jac, -1, -2) @ np.linalg.solve(square, error[..., None])
            rows[left] += step[..., 0]
        rows[left] = np.nan
        out = np.full_like(q, np.nan)
        out[there] = rows
        return out

    def _error(self, q: Floats, goal: Floats) -> tuple[Floats, Floats]:
        """Return what the TCP lacks to its goals (n, 6), and its derivatives (n, 6, 6) by joints.

        Shift over `_LEVER_MM`, then turn [rad].
        """
        R, origin = self.link_frames(q)
        T = self._forward(R, origin)
        off = goal[:, :3, :3] @ np.swapaxes(T[:, :3, :3], -1, -2)
        turn = np.stack(
            [off[:, 2, 1] - off[:, 1, 2], off[:, 0, 2] - off[:, 2, 0], off[:, 1, 0] - off[:, 0, 1]],
            axis=1,
        )
        axes = R[:, :, :, 2]
        arms = np.cross(axes, T[:, None, :3, 3] - origin) / _LEVER_MM
        jac = np.concatenate([np.swapaxes(arms, 1, 2), np.swapaxes(axes, 1, 2)], axis=1)
        shift = (goal[:, :3, 3] - T[:, :3, 3]) / _LEVER_MM
        return np.concatenate([shift, turn / 2.0], axis=1), jac

    def _tcp_on_flange(self) -> Floats:
        """Return T_flange_tcp (4, 4): x is the flange's axis, y the direction of the jaws."""
        cos, sin = np.cos(self.jaws_rad), np.sin(self.jaws_rad)
        T = np.eye(4)
        T[:3, 0] = 0.0, 0.0, 1.0
        T[:3, 1] = cos, sin, 0.0
        T[:3, 2] = -sin, cos, 0.0
        T[2, 3] = self.flange_to_tcp_mm
        return np.asarray(T @ kinematics.moved_pose(self.made[-1]))
