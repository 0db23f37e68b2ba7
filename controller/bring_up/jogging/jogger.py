"""Carries jog orders out: checks each motion, then moves through the cell's services.

Before the arm is homed its positions are invalid: a motor may be tried, a little and with little
force, and the arm may home (docs/protocols/umi_rtx.md 10). All else is refused until then. Each
motion is checked against soft limits and against all obstacles in the cell file; objects on the
table or in a gripper are unknown.
"""

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.devices.stopping import stop_side_by_side
from controller.planning.motion import Scene, slides, tcp_pose
from drivers.errors import DeviceError
from drivers.kinds import Encoders, FirstContact, Stop
from messages import say

from ..bench import Bench
from .goals import (
    RefusedMotionError,
    inside_limits,
    near_by,
    require_free,
    shifted,
    turned,
    turned_joint,
)
from .orders import MAX_SPEED_PERCENT, STEPS, JogOrder, Verb

FIRST_PERCENT: Final = 10.0  # first speed, in percent of the usual one
# Longer motions of the TCP are cut, so that it keeps to its line, or where it turns.
PIECE_MM: Final = 20.0
PIECE_DEG: Final = 2.0
# The least force that both kinds of gripper know; what they then hold is hardly pressed.
ARM_FORCE: Final = 20
FIXED_FORCE_N: Final = 20.0
# Largest distance from the last goal that rounding to counts and dead bands leave; the arm goes on
# from there.
AT_GOAL_RAD: Final = 0.01
AT_GOAL_MM: Final = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class ArmReading:
    """The arm's state.

    Attributes
    ----------
    q : (6,) joints; None before homing
    T_world_tcp : (4, 4); None before homing
    is_slide : mask of the joints that slide
    counts : count of each motor's encoder, by name; empty if the arm shows none
    arm_opening_mm : None before homing
    fixed_opening_mm : as the fixed gripper reports it
    step_mm, step_deg : size of one step
    speed_percent : percentage of the usual speed
    """

    q: FloatArray | None
    T_world_tcp: FloatArray | None
    is_slide: tuple[bool, ...]
    counts: Mapping[str, int]
    arm_opening_mm: float | None
    fixed_opening_mm: float
    step_mm: float
    step_deg: float
    speed_percent: float

    @property
    def joints(self) -> tuple[float, ...]:
        """The joints in degrees and mm; empty before homing."""
        if self.q is None:
            return ()
        return tuple(
            float(v) if slide else float(np.degrees(v))
            for v, slide in zip(self.q, self.is_slide, strict=True)
        )

    @property
    def words(self) -> str:
        """The whole reading on one line."""
        parts = []
        if self.T_world_tcp is None:
            parts.append("not homed")
        else:
            x, y, z = self.T_world_tcp[:3, 3]
            parts.append(f"TCP x {x:.1f} y {y:.1f} z {z:.1f} mm, {_pointing(self.T_world_tcp)}")
            units = ("mm" if slide else "deg" for slide in self.is_slide)
            joints = zip(self.joints, units, strict=True)
            parts.append("joints " + ", ".join(f"{v:.2f} {unit}" for v, unit in joints))
        if self.counts:
            parts.append("counts " + ", ".join(f"{n} {v}" for n, v in self.counts.items()))
        arm = "?" if self.arm_opening_mm is None else f"{self.arm_opening_mm:.1f}"
        parts.append(f"openings arm {arm} mm, fixed {self.fixed_opening_mm:.1f} mm")
        parts.append(
            f"step {self.step_mm:g} mm, {self.step_deg:g} deg; speed {self.speed_percent:g} %"
        )
        return " | ".join(parts)


def _pointing(T: FloatArray) -> str:
    approach = T[:3, 0]
    tilt_deg = float(np.degrees(np.arcsin(np.clip(approach[2], -1, 1))))
    flat = approach if abs(tilt_deg) < 85 else T[:3, 1]
    of = "heading" if abs(tilt_deg) < 85 else "jaws' axis at"
    return f"tilt {tilt_deg:.1f}, {of} {np.degrees(np.arctan2(flat[1], flat[0])):.1f} deg"


class Jogger:
    """Moves the cell by orders, one after another.

    Parameters
    ----------
    bench : devices and services of the visit
    """

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._step = 1
        self._speed_percent = FIRST_PERCENT
        self._is_slide = slides(bench.layout.arm)
        self._goal: tuple[FloatArray, FloatArray] | None = None

    async def read(self) -> ArmReading:
        """Return the arm's present state; nothing moves.

        Raises
        ------
        DeviceError : a device does not answer
        """
        bench = self._bench
        is_homed = bench.arm.is_homed
        q = await bench.arm.read_q() if is_homed else None
        # the driver itself: a proxy that counts verbs has their names, but is no such arm
        arm = bench.devices.arm
        step_mm, step_deg = STEPS[self._step]
        return ArmReading(
            q=q,
            T_world_tcp=None if q is None else tcp_pose(bench.layout, q),
            is_slide=self._is_slide,
            counts=await arm.read_encoders() if isinstance(arm, Encoders) else {},
            arm_opening_mm=await bench.arm.read_opening_mm() if is_homed else None,
            fixed_opening_mm=(await bench.devices.gripper.status()).opening_mm,
            step_mm=step_mm,
            step_deg=step_deg,
            speed_percent=self._speed_percent,
        )

    async def halt(self) -> None:
        """Halt arm and fixed gripper; nothing is released.

        Raises
        ------
        DeviceError : one of them did not confirm
        """
        bench = self._bench
        found = await stop_side_by_side(
            {"arm": lambda: bench.arm.stop(Stop.DEAD), "gripper": bench.devices.gripper.stop},
            bench.clock,
            bench.cell.detection.stop_confirm_s,
        )
        self._goal = None
        for name, error in found.items():
            raise DeviceError(
                say("{name}: did not confirm the stop: {error}", name=name, error=error)
            ) from error

    async def carry_out(self, order: JogOrder) -> str:
        """Carry out an order; return a sentence on the result.

        Raises
        ------
        RefusedMotionError : the motion is not allowed; nothing has moved
        CellError, DeviceError : the cell or a device does not allow it, or it was stopped
        """
        act: Callable[[JogOrder], Awaitable[str]] = {
            Verb.HOME: self._home,
            Verb.MOTOR: self._try_motor,
            Verb.JOINT: self._move_joint,
            Verb.SHIFT: self._move_tcp,
            Verb.TURN: self._move_tcp,
            Verb.PARK: self._park,
            Verb.OPEN: self._open,
            Verb.CLOSE: self._close,
            Verb.LAMP: self._switch_lamp,
            Verb.STEP: self._set_step,
            Verb.SPEED: self._set_speed,
        }.get(order.verb, _nothing)
        return await act(order)

    # ---- before homing ---------------------------------------------------------------------------
    async def _home(self, order: JogOrder) -> str:
        self._goal = None
        await self._bench.home_in_turn()
        return "homed"

    async def _try_motor(self, order: JogOrder) -> str:
        bench, arm = self._bench, self._bench.devices.arm
        if not isinstance(arm, FirstContact):
            raise RefusedMotionError("this arm offers no single motors; `home` finds its positions")
        if arm.is_homed:
            raise RefusedMotionError("the arm is homed: move it by its joints")
        if order.what not in arm.motors:
            raise RefusedMotionError(f"no motor `{order.what:.40}`: {', '.join(arm.motors)}")
        await bench.person.confirm(
            "try_motor", f"The motor {order.what} moves next, a little. Ready?"
        )
        what = f"the motor {order.what} moves a little and back"
        async with bench.moving(what, is_arm=True):
            await bench.arm.enable_power()
            tried = await arm.try_motor(order.what)
        return (
            f"{tried.motor} was sent {tried.ordered_counts:+d} counts, went "
            f"{tried.went_counts:+d} and came back to {tried.back_counts:+d} in "
            f"{tried.seconds:.1f} s"
        )

    def _require_homed(self) -> None:
        if not self._bench.arm.is_homed:
            raise RefusedMotionError(
                "the arm is not homed, so its positions are invalid: order `home`, or try "
                "a motor with `motor NAME`"
            )

    # ---- the arm ---------------------------------------------------------------------------------
    async def _origin(self) -> tuple[FloatArray, FloatArray]:
        """Return the joints (6,) and the pose (4, 4) at which the next motion starts.

        The start is the last goal if the arm is there: so steps add up, and rounding to whole
        counts does not.
        """
        self._require_homed()
        q = await self._bench.arm.read_q()
        if self._goal is not None:
            off = np.abs(q - self._goal[0])
            if (off <= np.where(self._is_slide, AT_GOAL_MM, AT_GOAL_RAD)).all():
                return self._goal
        return q, tcp_pose(self._bench.layout, q)

    async def _move_joint(self, order: JogOrder) -> str:
        q, _ = await self._origin()
        number = int(order.what)
        is_slide = 1 <= number <= len(self._is_slide) and self._is_slide[number - 1]
        by = order.by(STEPS[self._step][0 if is_slide else 1])
        goal = turned_joint(self._bench.layout.arm, q, number, by)
        await self._follow((q, goal))
        self._goal = goal, tcp_pose(self._bench.layout, goal)
        return f"joint {number} by {by:+g} {'mm' if is_slide else 'deg'}"

    async def _move_tcp(self, order: JogOrder) -> str:
        q, T = await self._origin()
        is_shift = order.verb is Verb.SHIFT
        by = order.by(STEPS[self._step][0 if is_shift else 1])
        moved = shifted if is_shift else turned
        count = max(1, int(np.ceil(abs(by) / (PIECE_MM if is_shift else PIECE_DEG))))
        path = [q]
        for number in range(1, count + 1):
            path.append(
                near_by(self._bench.layout, path[-1], moved(T, order.what, by * number / count))
            )
        await self._follow(tuple(path))
        self._goal = path[-1], moved(T, order.what, by)
        return f"{order.what} by {by:+g} {'mm' if is_shift else 'deg'}"

    async def _follow(self, path: tuple[FloatArray, ...]) -> None:
        """Check a path that begins at the arm's position, then move along it.

        Raises
        ------
        RefusedMotionError : some of it is not allowed; nothing has moved
        """
        scene = self._scene()
        for one, other in pairwise(path):
            require_free(scene, one, other)
        self._goal = None
        for q in path[1:]:
            await self._go(q)

    def _scene(self) -> Scene:
        """Return the obstacles for the arm, with added clearance until the arm is calibrated."""
        bench = self._bench
        if "arm" not in bench.cell.calibration:
            return bench.scene()
        layout = bench.layout
        return Scene(layout, layout.arm_gripper.max_mm, layout.fixed_open_mm)

    async def _park(self, order: JogOrder) -> str:
        self._require_homed()
        bench = self._bench
        self._goal = None
        park_q = np.asarray(bench.layout.park_q, dtype=float)
        begin = inside_limits(bench.layout.arm, await bench.arm.read_q(), park_q)
        await self._go(begin)
        for q in await bench.path_to(park_q, self._scene(), "to the park"):
            await self._go(q)
        return "parked"

    async def _go(self, q: FloatArray) -> None:
        await self._bench.motion.follow((q,), first_speed=self._speed_percent / 100)

    # ---- jaws and lamps --------------------------------------------------------------------------
    async def _open(self, order: JogOrder) -> str:
        return await (self._open_arm if order.what == "arm" else self._open_fixed)(order.amount)

    async def _open_arm(self, opening_mm: float | None) -> str:
        self._require_homed()
        bench = self._bench
        wanted_mm = _opening(opening_mm, bench.arm.max_opening_mm)
        if (await bench.arm.read_jaws()).is_pressing:
            await bench.person.confirm(
                "open_jaws", "The arm gripper presses: the object it holds will fall. Open it?"
            )
        await bench.move_jaws(
            f"the arm gripper moves to {wanted_mm:.0f} mm",
            lambda: bench.arm.move_gripper_mm(wanted_mm),
        )
        return f"the arm gripper is at {await bench.arm.read_opening_mm():.1f} mm"

    async def _open_fixed(self, opening_mm: float | None) -> str:
        bench, gripper = self._bench, self._bench.devices.gripper
        wanted_mm = _opening(opening_mm, gripper.max_opening_mm)
        if (await gripper.status()).has_contact:
            await bench.person.confirm(
                "open_jaws", "The fixed gripper holds something, which will fall. Open it?"
            )
        await self._activate_fixed()
        await bench.move_jaws(
            f"the fixed gripper moves to {wanted_mm:.0f} mm", lambda: gripper.open_to(wanted_mm)
        )
        return f"the fixed gripper is at {(await gripper.status()).opening_mm:.1f} mm"

    async def _activate_fixed(self) -> None:
        bench, gripper = self._bench, self._bench.devices.gripper
        if not (await gripper.status()).is_activated:
            await bench.person.confirm(
                "activate", "The fixed gripper activates: its jaws open and close. Is it empty?"
            )
            await bench.move_jaws("the fixed gripper activates", gripper.activate)

    async def _close(self, order: JogOrder) -> str:
        bench = self._bench
        if order.what == "arm":
            self._require_homed()
            await bench.move_jaws("the arm gripper closes", lambda: bench.arm.grasp(ARM_FORCE))
            return f"the arm gripper stands at {await bench.arm.read_opening_mm():.1f} mm"
        gripper = bench.devices.gripper
        await self._activate_fixed()
        await bench.move_jaws(
            "the fixed gripper closes", lambda: gripper.close_on(0.0, force_n=FIXED_FORCE_N)
        )
        status = await gripper.status()
        held = ", on something" if status.has_contact else ""
        return f"the fixed gripper stands at {status.opening_mm:.1f} mm{held}"

    async def _switch_lamp(self, order: JogOrder) -> str:
        lights = self._bench.devices.lights
        if order.what not in lights.names:
            raise RefusedMotionError(f"no lamp `{order.what:.40}`: {', '.join(lights.names)}")
        await lights.set({order.what: order.amount or 0.0})
        return f"{order.what} {'on' if order.amount else 'off'}"

    # ---- how far and how fast --------------------------------------------------------------------
    async def _set_step(self, order: JogOrder) -> str:
        self._step = int(order.amount or 1) - 1
        mm, deg = STEPS[self._step]
        return f"one step is {mm:g} mm or {deg:g} deg"

    async def _set_speed(self, order: JogOrder) -> str:
        self._speed_percent = min(order.amount or FIRST_PERCENT, MAX_SPEED_PERCENT)
        return f"{self._speed_percent:g} % of the usual speed"


def _opening(wanted_mm: float | None, most_mm: float) -> float:
    if wanted_mm is not None and wanted_mm > most_mm:
        raise RefusedMotionError(
            say(
                "it opens to {most_mm:.1f} mm, not to {wanted_mm:g}",
                most_mm=most_mm,
                wanted_mm=wanted_mm,
            )
        )
    return most_mm if wanted_mm is None else wanted_mm


async def _nothing(order: JogOrder) -> str:
    return ""
