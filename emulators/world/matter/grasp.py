"""Grasps: jaws that close on the exact part, and a hold as compliant pads give it.

A rigid friction grasp of a physics engine creeps and twists; ADR 2 says what
is done instead. A finger pushes a part at rest along; once both pads are on it, it is eased
into the seat that `pads` finds on the exact mesh and is then carried by the gripper, until the jaws
open, the load is too much for the area that touches, or another gripper tears it away.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ..layout import GripperLayout
from ..poses import between, invert, rotation_about, rotation_angle
from ..shapes import Array, Box
from .pads import Felt, Pads, Seat

CAPTURE_MM: Final = 1.5  # both exact gaps below this: the pads are on the part
COMPLIANCE_MM: Final = 2.5  # largest offset of a part held elsewhere at which both pads bear
TEAR_MM: Final = 4.0  # pads yield no more than this when two grippers pull at one part
TEAR_RAD: Final = math.radians(5.0)
_OPENED_MM: Final = 0.4  # jaws this much wider than the part no longer press
_SEATED_MM: Final = 0.05
MIN_AREA_MM2: Final = 8.0  # a corner or an edge between rubber pads slips out
PAD_FRICTION: Final = 0.8  # rubber on metal
GRAVITY_M_PER_S2: Final = 9.81
_SLIP_RAD_PER_S: Final = math.radians(90.0)
_EASE_MM_PER_S: Final = 40.0
_EASE_RAD_PER_S: Final = math.radians(40.0)


@dataclass(slots=True, eq=False)
class Hold:
    """A part between two pads.

    Attributes
    ----------
    seat : final pose of the part, and opening at which the jaws stop
    T_tcp_part : present grasp
    T_start, opening_start_mm : grasp and opening at the start of the easing
    is_seated : the jaws have stopped on it
    """

    part: int
    seat: Seat
    T_tcp_part: Array
    T_start: Array
    opening_start_mm: float
    is_seated: bool = False
    force_n: float = 60.0


@dataclass(slots=True, eq=False)
class Gripper:
    """One gripper of the cell, with its hold.

    Attributes
    ----------
    T_world_tcp : pose of its TCP frame
    opening_mm, before_mm : openings of the jaws, now and a step ago
    finger_bodies : pybullet's, +y first
    must_open : a part has been lost from these jaws: they hold nothing until they have opened
    misses : the next part between the pads is missed: a fault
    last_hold : its last grasp of the part that it had last
    passing : parts that still overlap with the fingers after a release, and do not feel them
    """

    name: str
    layout: GripperLayout
    T_world_tcp: Array
    opening_mm: float
    before_mm: float
    finger_boxes: tuple[Box, Box]
    pads: Pads
    finger_bodies: tuple[int, int] = (-1, -1)
    limit_mm: float | None = None
    hold: Hold | None = None
    must_open: bool = False
    misses: bool = False
    last_hold: Hold | None = None
    passing: set[int] = field(default_factory=set)

    def T_world_finger(self, side: int) -> Array:
        """Return the pose of a finger's box in the world; side 0 is +y."""
        sign = 1.0 if side == 0 else -1.0
        T = self.T_world_tcp.copy()
        T[:3, 3] += T[:3, 1] * (sign * self.opening_mm / 2.0)
        return T

    @property
    def is_closing(self) -> bool:
        """Whether the jaws have come closer in the last step."""
        return self.opening_mm < self.before_mm - 1e-7

    def jaw_region_mm(self) -> tuple[Array, float]:
        """Return a sphere around all that the pads can reach: middle (3,) and radius [mm]."""
        half = self.layout.fingers.pad_length_mm / 2.0
        centre = self.T_world_tcp[:3, 3] - half * self.T_world_tcp[:3, 0]
        return centre, math.hypot(half, self.opening_mm / 2.0, self.layout.fingers.width_mm)

    def capture(self, part: int, seat: Seat, T_tcp_part: Array, force_n: float) -> None:
        """Begin to hold a part; the jaws will stop at the seat's opening.

        Parameters
        ----------
        part : its number in the world
        seat : rest of the part between the pads
        T_tcp_part : (4, 4) pose of the part in the TCP frame as the pads meet it [mm]
        force_n : force of the pads
        """
        self.limit_mm = min(seat.opening_mm, self.opening_mm)
        self.hold = Hold(
            part,
            seat,
            T_tcp_part,
            T_tcp_part,
            max(self.opening_mm, seat.opening_mm),
            False,
            force_n,
        )

    def is_as_wide_as(self, hold: Hold) -> bool:
        """Return whether the jaws still have the opening at which they held a part."""
        return abs(self.opening_mm - hold.seat.opening_mm) <= _OPENED_MM

    def resume(self, hold: Hold) -> None:
        """Hold a part again as before; the jaws have not moved."""
        self.hold, self.last_hold = hold, None
        hold.T_tcp_part, hold.is_seated = hold.seat.T_tcp_part, True
        self.limit_mm = min(hold.seat.opening_mm, self.opening_mm)
        self.must_open = False
        self.passing.discard(hold.part)

    def follow_jaws(self) -> bool:
        """Ease the part into its seat as the jaws close; return whether they have let it go."""
        hold = self.hold
        if hold is None:
            return False
        if hold.is_seated:
            return self.opening_mm > hold.seat.opening_mm + _OPENED_MM
        stroke_mm = hold.opening_start_mm - hold.seat.opening_mm
        done_mm = hold.opening_start_mm - self.opening_mm
        if done_mm < -_OPENED_MM:
            return True
        fraction = 1.0 if stroke_mm < 1e-6 else max(0.0, min(1.0, done_mm / stroke_mm))
        hold.T_tcp_part = between(hold.T_start, hold.seat.T_tcp_part, fraction)
        if self.opening_mm <= hold.seat.opening_mm + _SEATED_MM:
            hold.T_tcp_part = hold.seat.T_tcp_part
            hold.is_seated = True
        return False

    def settle_into_seat(self, dt_s: float) -> None:
        """Let pads that another gripper had bent spring back."""
        hold = self.hold
        if hold is None or not hold.is_seated or hold.T_tcp_part is hold.seat.T_tcp_part:
            return
        off_mm, off_rad = apart(hold.T_tcp_part, hold.seat.T_tcp_part)
        need = max(off_mm / (_EASE_MM_PER_S * dt_s), off_rad / (_EASE_RAD_PER_S * dt_s))
        if need <= 1.0:
            hold.T_tcp_part = hold.seat.T_tcp_part
        else:
            hold.T_tcp_part = between(hold.T_tcp_part, hold.seat.T_tcp_part, 1.0 / need)

    def bear(self, centre_mm: Array, mass_kg: float, dt_s: float) -> bool:
        """Let weight pull at a part that only this gripper bears; return whether it falls out.

        Parameters
        ----------
        centre_mm : (3,) the part's centre of mass, world
        mass_kg : mass of the part
        dt_s : length of the step [world s]
        """
        hold = self.hold
        if hold is None or not hold.is_seated:
            return False
        weight_n = mass_kg * GRAVITY_M_PER_S2
        friction_n = 2.0 * PAD_FRICTION * hold.force_n
        if hold.seat.area_mm2 < MIN_AREA_MM2 or weight_n > friction_n:
            return True
        T = self.T_world_tcp
        arm_mm = T[:3, :3].T @ (centre_mm - T[:3, 3]) - hold.seat.centre_mm
        down = -T[2, :3]  # world's -z in the TCP frame
        twist_nmm = weight_n * float(arm_mm[2] * down[0] - arm_mm[0] * down[2])
        # on a round pad friction acts at two thirds of the radius
        holds_nmm = friction_n * 2.0 / 3.0 * math.sqrt(hold.seat.area_mm2 / math.pi)
        if abs(twist_nmm) > holds_nmm:
            angle_rad = math.copysign(_SLIP_RAD_PER_S * dt_s, twist_nmm)
            T = np.eye(4)
            T[:3, :3] = rotation_about(np.array((0.0, 1.0, 0.0)), angle_rad)
            T[:3, 3] = hold.seat.centre_mm - T[:3, :3] @ hold.seat.centre_mm
            self.shift_hold(T)
        return False

    def shift_hold(self, T: Array) -> None:
        """Move the part in the pads by ``T``, in the TCP frame; seat and all."""
        hold = self.hold
        if hold is None:
            return
        seat = hold.seat
        hold.seat = Seat(
            T @ seat.T_tcp_part,
            seat.opening_mm,
            seat.area_mm2,
            seat.centre_mm,
            seat.shift_mm,
            seat.turn_rad,
        )
        hold.T_tcp_part = hold.seat.T_tcp_part


def apart(T_one: Array, T_other: Array) -> tuple[float, float]:
    """Return the distance of two poses [mm, rad]."""
    R = T_one[:3, :3].T @ T_other[:3, :3]
    return float(np.linalg.norm(T_one[:3, 3] - T_other[:3, 3])), rotation_angle(R)


def bears(felt: Felt, opening_mm: float, *, is_held: bool) -> bool:
    """Return whether both pads are on a part.

    Parameters
    ----------
    felt : surface before each pad
    opening_mm : distance between the pads
    is_held : True if another gripper keeps it where it is; pads then give by `COMPLIANCE_MM`
    """
    upper_mm, lower_mm = felt.gaps_mm(opening_mm)
    if is_held:
        return min(upper_mm, lower_mm) <= 0.5 and abs(upper_mm - lower_mm) / 2.0 <= COMPLIANCE_MM
    return max(upper_mm, lower_mm) <= CAPTURE_MM


def make_gripper(name: str, layout: GripperLayout, opening_mm: float) -> Gripper:
    """Return a gripper; its fingers' boxes stand in frames that move with the jaws.

    Parameters
    ----------
    name : name in the world
    layout : its place in the cell and the size of its fingers
    opening_mm : distance between the pads to begin with
    """
    f = layout.fingers
    half = f.width_mm / 2.0
    plus = Box(
        f"{name} finger +",
        np.array((-f.length_mm, 0.0, -half)),
        np.array((0.0, f.thickness_mm, half)),
    )
    minus = Box(
        f"{name} finger -",
        np.array((-f.length_mm, -f.thickness_mm, -half)),
        np.array((0.0, 0.0, half)),
    )
    return Gripper(name, layout, layout.T_world_tcp, opening_mm, opening_mm, (plus, minus), Pads(f))


def relative(T_world_tcp: Array, T_world_part: Array) -> Array:
    """Return the pose of a part in the TCP frame."""
    T: Array = invert(T_world_tcp) @ T_world_part
    return T
