"""The planner's interface to an arm of any kind.

An arm has six joints; a configuration is a row q (6,) in rad and mm. Poses are in the arm's own
frame: origin on the floor of the cell, z up; `CellLayout.T_world_arm` says where that is. The
TCP's x axis is the approach, its y axis the one that the jaws move along. An arm's model stands
beside its driver, which knows nothing of this module: it fits by its shape (ADR 25). It is a
dataclass of numbers and arrays, by which cached plans are found again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, Protocol

from controller.arrays import BoolArray, FloatArray, IntArray

from ..geometry import SolidBox

__all__ = ["JOINT_COUNT", "ArmLink", "ArmModel", "JointLimit", "SweepPhase", "TimingModel"]

JOINT_COUNT = 6


class ArmLink(SolidBox, Protocol):
    """One moving link, as a box in the link's frame.

    Neighbours along the chain are kept apart by the joint limits, not by these coarse boxes; so
    each link lists the boxes it has to be checked against. Links count from the base, and the
    checks of one link apply to all further out: once a link may touch the table, so may the next.
    """

    @property
    def name(self) -> str:
        """The name that people use."""

    @property
    def may_touch_base(self) -> bool:
        """True where the joint limits do not keep it off the arm's column."""

    @property
    def may_touch_table(self) -> bool:
        """True where the joint limits do not keep it off the table."""

    @property
    def keeps_clear_of(self) -> Literal["gripper", "fingers", "nothing"]:
        """The bodies of the arm gripper with which it may collide.

        `gripper`: body, fingers and held part; `fingers`: these without the body, which is its
        neighbour; `nothing`: none of them.
        """


class JointLimit(Protocol):
    """One linear limit of the joints: ``low <= weights @ q <= high`` [rad, mm]."""

    @property
    def name(self) -> str:
        """The name that people use."""

    @property
    def weights(self) -> FloatArray:
        """Weight of each joint (6,)."""

    @property
    def low(self) -> float:
        """Lower bound."""

    @property
    def high(self) -> float:
        """Upper bound."""


class TimingModel(Protocol):
    """Duration of joint moves, and the arm's course during them."""

    @property
    def joint_speeds(self) -> FloatArray:
        """Full speed of each joint (6,) [rad/s, mm/s]."""

    def move_seconds(self, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
        """Return the forecast of single moves between (..., 6): (...), 0 where nothing moves."""

    def travel_seconds(self, q_from: FloatArray, q_to: FloatArray) -> FloatArray:
        """Return the seconds at full speed between (..., 6): (...), a metric of joint space."""

    def courses(
        self, q_from: FloatArray, q_to: FloatArray, count: int
    ) -> tuple[FloatArray, FloatArray]:
        """Return the possible courses of the arm over time in one move (6,) to (6,).

        Parameters
        ----------
        q_from, q_to : (6,) rows of joints
        count : instants of each way the move may go

        Returns
        -------
        q : (m, 6) configurations
        share : (m,) share of the motion done at that instant, 0 to 1
        """

    def stray(self, step: FloatArray) -> FloatArray:
        """Return a bound (6,) on the deviation from the joint line in a move by `step` (6,)."""


class SweepPhase(Protocol):
    """One phase of a motion: all joints that it may pass, ``join @ angles`` within bounds."""

    @property
    def what(self) -> str:
        """The phase in words."""

    @property
    def low(self) -> FloatArray:
        """Lower bounds of the independent angles (6,) [rad, mm]."""

    @property
    def high(self) -> FloatArray:
        """Upper bounds (6,)."""

    @property
    def join(self) -> FloatArray:
        """Matrix from these angles to the joints, (6, 6)."""


class ArmModel(Protocol):
    """An arm of six joints: its kinematics, its volume and its timing.

    Its joint limits are linear: if both ends of a joint line are within them, all of it is.
    """

    @property
    def tool_mm(self) -> float:
        """Distance from the wrist's centre to the TCP, along the approach axis."""

    @property
    def reach_mm(self) -> float:
        """Largest distance of the wrist's centre from the arm's vertical axis."""

    @property
    def joint_names(self) -> Sequence[str]:
        """Name of each joint, ending in its unit: `_rad` or `_mm`."""

    @property
    def joint_limits(self) -> Sequence[JointLimit]:
        """Limits that every allowed configuration meets; `within_limits` may be narrower.

        By no more than the rounding of a target to whole steps of the motors.
        """

    @property
    def links(self) -> Sequence[ArmLink]:
        """Moving links from the base on, in the order of `link_frames`."""

    @property
    def link_pairs(self) -> Sequence[tuple[int, int]]:
        """Links by index that may touch each other."""

    @property
    def swept(self) -> Mapping[str, SolidBox]:
        """Volumes that links sweep wherever the arm goes: name -> box in the arm's frame."""

    @property
    def timing(self) -> TimingModel:
        """Timing model of its moves."""

    def forward(self, q: FloatArray) -> FloatArray:
        """Return T_arm_tcp (..., 4, 4) of configurations (..., 6); limits are not checked."""

    def link_frames(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the links' frames at (n, 6): rotations (n, k, 3, 3), origins (n, k, 3) [mm]."""

    def inverse(self, T_arm_tcp: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return all configurations within limits that bring the TCP to poses (n, 4, 4).

        Along a Cartesian path a branch changes continuously, so that a straight line of the TCP
        keeps its branch. Where a pose leaves a joint free, each value tried is a branch.

        Returns
        -------
        index, branch : (m,) number of each pose in the order of the poses, and its branch
        q : (m, 6)
        """

    def branches(self, T_arm_tcp: FloatArray) -> FloatArray:
        """Return all branches' configurations, beyond limits too: (..., b, 6), NaN if none.

        For messages about targets out of reach.
        """

    def within_limits(self, q: FloatArray) -> BoolArray:
        """Return a mask (...) of configurations (..., 6) within the limits; NaN is outside."""

    def limit_report(self, q: FloatArray) -> str:
        """Return the worst passed limit of one q (6,), and by how much, in words."""

    def spread(self, unit: FloatArray) -> FloatArray:
        """Return configurations for numbers drawn evenly from 0 to 1, (n, 6) -> (n, 6).

        They cover the joint ranges, more densely where the arm has most room; some may be outside
        the limits.
        """

    def radii_mm(
        self, q_from: FloatArray, q_to: FloatArray, far_mm: float, beside_mm: float
    ) -> FloatArray:
        """Return a bound on the motion of any point of arm, gripper or part with each joint.

        Parameters
        ----------
        q_from, q_to : (6,) ends of a joint line, on which it holds
        far_mm, beside_mm : reach of gripper and part from the wrist's centre, and from the approach
            axis

        Returns
        -------
        (6,) [mm per rad or mm]
        """

    def detours(
        self, q_from: FloatArray, q_to: FloatArray
    ) -> Iterator[Sequence[Sequence[FloatArray]]]:
        """Yield groups of joint paths round possible obstacles, the likeliest group first.

        Each path is a list of (6,) from `q_from` to `q_to`, both included.
        """

    def retreats(self, q: FloatArray, count: int) -> FloatArray:
        """Return the retreats (n, count, 6) of the arm from crowded configurations (n, 6)."""

    def homing_sweep(self, low: FloatArray, high: FloatArray) -> Sequence[SweepPhase]:
        """Return the range of the joints in each phase of a homing that opens no jaw.

        Empty for an arm that has no such homing.

        Parameters
        ----------
        low, high : (6,) bounds of the joints at its beginning
        """

    def move_sweep(self, q_from: FloatArray, q_to: FloatArray) -> SweepPhase:
        """Return the range of the joints in one move (6,) to (6,), with motors in step or not."""

    def describe(self, q: FloatArray) -> str:
        """Return one q (6,) as text, in degrees and mm."""
