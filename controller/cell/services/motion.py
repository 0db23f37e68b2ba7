"""Moves the arm along checked paths, and remembers them, so that it can move back.

The journal gets each path before the arm sets out, and each place where the arm stood free of
everything: the way back is known even to a later run. Every waypoint passes the gate. A pause *now*
stops the arm between two waypoints. Afterwards it continues to the same waypoint: the path to it is
free from any stop between them. Homing begins anew.
"""

from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from math import ceil

import numpy as np

from controller.arrays import FloatArray
from controller.cell.errors import InterlockError
from controller.cell.journal import Body
from controller.cell.journal.rows import (
    EffectClass,
    FirstMotion,
    HomedWithPart,
    HomingBegun,
    Joints,
    PathBegun,
    PathEnded,
    StoodFree,
    TouchedDown,
)
from controller.cell.machine import SafePoint
from controller.imaging import rotation_angle
from controller.planning import JointPath
from controller.planning.model import CellLayout
from controller.planning.motion import move_seconds, segment_seconds, tcp_pose, travel_seconds
from drivers.clock import CellClock
from drivers.errors import ArmStalledError, MotionStoppedError
from drivers.kinds import Arm
from messages import key, say

from .gate import Gate, Mover
from .interlocks import Interlocks

# A part that met the tray this far above its place has slipped in the jaws; one that met something
# higher up may stand on anything. A fall from this height does no harm.
TOUCH_MM = 10.0
# decimals of joint values in the journal: 1e-6 rad, 1e-6 mm
DECIMALS = 6
# A motion outside the steps of a plan may take this many times its forecast, and so much more.
WORST_SHARE, WORST_MORE_S = 1.25, 3.0
# Duration of each piece of a slow motion at full speed: at a quarter of that speed, gripper and
# part then stray 3 mm more than planned, and 36 mm in one move (69 moves of two simulated parts).
SLOW_PIECE_S = 0.4


def rounded(path: Iterable[FloatArray]) -> tuple[Joints, ...]:
    """Return a joint path rounded as in the journal."""
    return tuple(tuple(round(float(x), DECIMALS) for x in q) for q in path)


class Motion:
    """The arm, as the actions move it.

    Parameters
    ----------
    arm : the device
    interlocks : admit each path
    clock : clock of the cell
    gate : gate that holds a pause, and requires the permit to move
    layout : layout with the arm's kinematics and timing, to preview a motion
    note : takes the rows of the journal
    secure : function that takes a row and returns once it is on the disk
    """

    def __init__(
        self,
        arm: Arm,
        interlocks: Interlocks,
        clock: CellClock,
        gate: Gate,
        layout: CellLayout,
        note: Callable[[Body], object] = lambda row: None,
        secure: Callable[[Body], Awaitable[object]] | None = None,
    ) -> None:
        self._arm = arm
        self._interlocks = interlocks
        self._clock = clock
        self._gate = gate
        self._layout = layout
        self._note = note
        self._secure = secure
        # waypoints since the arm last stood free of everything: moving back along them is free too
        self._trail: list[FloatArray] = []

    @property
    def sweeps_to_home(self) -> bool:
        """Whether the arm moves its joints to find their references."""
        return sweeps_to_home(self._layout)

    @property
    def homing_words(self) -> str:
        """What is shown before the arm homes and parks."""
        if self.sweeps_to_home:
            return key("homing the arm; it sweeps its whole workspace")
        return key("getting the arm ready; it opens and closes its jaws, then it parks")

    async def homing_preview(self) -> FirstMotion:
        """Return the first motion of homing."""
        return await (homing_preview if self.sweeps_to_home else jaws_preview)()

    async def home(self) -> None:
        """Allow motor power and find the references, if not known; may sweep the whole reach.

        Raises
        ------
        NoPermitError : nothing may move
        DeviceError : the arm finds no reference
        """
        while True:
            async with self._gate.moving(self.homing_preview, Mover.ARM):
                await self._arm.enable_power()
                if self._arm.is_homed:
                    return
                try:
                    await self._arm.home()
                except MotionStoppedError:
                    if not self._gate.was_interrupted:
                        raise
                else:
                    return

    async def home_with_part(self, row: HomingBegun, q_estimate: FloatArray) -> float:
        """Press the arm gripper and find all references, opening no jaw; return its opening [mm].

        Parameters
        ----------
        row : for the journal, before anything moves
        q_estimate : (6,) approximate joints of the arm

        Raises
        ------
        NoPermitError : nothing may move
        InterlockError : the door was opened meanwhile
        DeviceError : the arm finds no reference, or its jaws were moved
        """
        async with self._gate.moving(_homing_with_part, Mover.ARM):
            await self._keep(row)
            await self._arm.enable_power()
            try:
                opening_mm = await self._arm.home_keeping_jaws(q_estimate, row.opening_mm)
            except MotionStoppedError as error:
                if not self._gate.was_interrupted:
                    raise
                # the way that was proven free begins where the arm stood before, not half-way
                raise InterlockError(
                    key(
                        "the door was opened while the arm homed with a part, and the position "
                        "of the arm is unknown now: `cellctl recover --open arm` gives you the "
                        "part; then close the door and start again"
                    ),
                    "guard_closed",
                ) from error
        at = await self._arm.read_q()
        (q,) = rounded([at])
        self._note(HomedWithPart(q=q, opening_mm=round(opening_mm, 3)))
        self._trail = [at]
        self._note_free()
        return opening_mm

    async def _keep(self, row: Body) -> None:
        """Journal a row before the byte that it announces."""
        if self._secure is None:
            self._note(row)
        else:
            await self._secure(row)

    def restore(self, trail: Iterable[FloatArray], *, is_free: bool) -> None:
        """Take over the trail of an interrupted run, and journal it as this run's own.

        Parameters
        ----------
        trail : waypoints (6,), oldest first; the arm stands at the last one
        is_free : True if it stood free of everything at the first one
        """
        self._trail = list(trail)
        rest = self._trail
        if is_free:
            (q,) = rounded(self._trail[:1])
            self._note(StoodFree(q=q))
            rest = self._trail[1:]
        if rest:
            self._note(PathBegun(effect_class=EffectClass.ABSOLUTE, waypoints=rounded(rest)))

    async def enable_power(self) -> None:
        """Allow motor power; nothing moves."""
        await self._arm.enable_power()

    async def start_from(self, q: FloatArray) -> None:
        """Move to a configuration (6,) clear of everything; moving back ends there."""
        await self._move(q)
        self._trail = [q]
        self._note_free()
        self._gate.reach(SafePoint.PARKED, ends_step=True)

    async def follow(self, path: JointPath, first_speed: float = 1.0) -> None:
        """Move along a joint path, each waypoint (6,).

        Parameters
        ----------
        path : waypoints
        first_speed : speed of the first move, as a share of the usual speed

        Raises
        ------
        InterlockError : an interlock rule does not hold
        NoPermitError : nothing may move
        DeviceError : the arm does not get there
        """
        await self._admit(path)
        await self._begin(path)
        self._forecast(path)
        for number, q in enumerate(path):
            self._trail.append(q)
            await self._move_at(q, first_speed if number == 0 else 1.0)
        self._note(PathEnded())

    async def lower(self, path: JointPath) -> None:
        """Lower the part along a joint path, each waypoint (6,); end early on touching down.

        A part that has slipped in the jaws hangs lower than planned and meets tray or table first.

        Raises
        ------
        InterlockError : an interlock rule does not hold
        ArmStalledError : it met something further above than a part slips
        DeviceError : the arm does not get there
        """
        try:
            await self.follow(path)
        except ArmStalledError as error:
            q = await self._arm.read_q()
            left = tcp_pose(self._layout, path[-1])[:3, 3] - tcp_pose(self._layout, q)[:3, 3]
            if np.linalg.norm(left) > TOUCH_MM:
                raise
            self._trail[-1] = q
            left_mm = round(float(np.linalg.norm(left)), 1)
            self._note(TouchedDown(left_mm=left_mm, error=str(error)))

    async def _admit(self, path: JointPath) -> None:
        """Have the interlocks admit a path; wait at the gate while their rules may come true."""
        await self._gate.until_admitted(
            partial(self._interlocks.admit_path, path), lambda: self._preview(path[0])
        )

    async def _begin(self, path: Iterable[FloatArray], *, is_back: bool = False) -> None:
        """Journal a path before its first byte: a start after a power cut finds the arm on it."""
        row = PathBegun(effect_class=EffectClass.ABSOLUTE, waypoints=rounded(path), is_back=is_back)
        await self._keep(row)

    def mark_free(self) -> None:
        """Mark that the arm stands clear of everything: moving back ends here from now on."""
        del self._trail[:-1]
        self._note_free()

    def _note_free(self) -> None:
        if self._trail:
            (q,) = rounded(self._trail[-1:])
            self._note(StoodFree(q=q))

    def reach(self, point: SafePoint, *, ends_step: bool = False) -> None:
        """Mark that the cell stands at a safe point, where a pause may begin."""
        self._gate.reach(point, ends_step=ends_step)

    @property
    def can_go_back(self) -> bool:
        """Whether the arm can be moved back by a waypoint."""
        return len(self._trail) > 1

    async def go_back(self, count: int, first_speed: float = 1.0) -> None:
        """Move back along the last ``count`` waypoints, to the arm's position before them.

        Parameters
        ----------
        count : number of waypoints
        first_speed : speed of the first move, as a share of the usual speed

        Raises
        ------
        InterlockError : an interlock rule does not hold
        NoPermitError : nothing may move
        DeviceError : the arm does not get there
        """
        path = [self._trail[-2 - i] for i in range(count)]
        del self._trail[-count:]
        await self._admit(tuple(path))
        await self._begin(path, is_back=True)
        self._forecast(tuple(path))
        for number, q in enumerate(path):
            await self._move_at(q, first_speed if number == 0 else 1.0)
        self._note(PathEnded())

    async def ring_down(self) -> None:
        """Wait until the stopped arm stands still enough for a picture."""
        await self._clock.sleep(self._layout.cell_times.ringing_s)

    async def read_q(self) -> FloatArray:
        """Return the arm's joints (6,)."""
        return await self._arm.read_q()

    async def _move_at(self, q: FloatArray, speed: float) -> None:
        """Move to a waypoint (6,), in short moves if it is to be slow.

        Motors run at whole speeds, rounded up: at a quarter of the speed a long move strays from
        its line up to four times as far as planned, and a short one does not.
        """
        if speed < 1.0:
            origin = await self._arm.read_q()
            seconds = float(travel_seconds(self._layout, origin, q))
            count = max(1, ceil(seconds / SLOW_PIECE_S))
            for number in range(1, count):
                await self._move(origin + number / count * (q - origin), speed)
        await self._move(q, speed)

    async def _move(self, q: FloatArray, speed: float = 1.0) -> None:
        share = {} if speed == 1.0 else {"speed_share": speed}
        while True:
            async with self._gate.moving(partial(self._preview, q), Mover.ARM):
                try:
                    await self._arm.move_joints(q, **share)
                except MotionStoppedError:
                    if not self._gate.was_interrupted:
                        raise
                else:
                    return

    def _forecast(self, path: JointPath) -> None:
        """Note the longest duration of this path, for a pause that waits for its end."""
        origin = self._trail[-1:] or list(path[:1])
        seconds = move_seconds(self._layout, np.stack([*origin, *path])) if path else 0.0
        self._gate.begin_path(WORST_SHARE * seconds + WORST_MORE_S)

    async def _preview(self, goal: FloatArray) -> FirstMotion:
        origin = await self._arm.read_q()
        T_goal, T_origin = tcp_pose(self._layout, goal), tcp_pose(self._layout, origin)
        tcp_mm = float(np.linalg.norm(T_goal[:3, 3] - T_origin[:3, 3]))
        turn_deg = float(np.degrees(rotation_angle(T_origin[:3, :3].T @ T_goal[:3, :3])))
        seconds = float(segment_seconds(self._layout, origin, goal))
        x, y, z = T_goal[:3, 3]
        return FirstMotion(
            words=say(
                "the arm moves its TCP by {tcp_mm:.0f} mm, to x {x:.0f} y {y:.0f} "
                "z {z:.0f} mm, and turns it by {turn_deg:.0f} degrees, in about "
                "{seconds:.1f} s",
                tcp_mm=tcp_mm,
                x=x,
                y=y,
                z=z,
                turn_deg=turn_deg,
                seconds=seconds,
            ),
            origin=tuple(round(float(v), 4) for v in origin),
            goal=tuple(round(float(v), 4) for v in goal),
            tcp_mm=round(tcp_mm, 1),
            turn_deg=round(turn_deg, 1),
            seconds=round(seconds, 2),
        )


def sweeps_to_home(layout: CellLayout) -> bool:
    """Return whether a cell's arm moves its joints to find their references.

    Parameters
    ----------
    layout : the cell as planning sees it
    """
    phases = layout.arm.homing_sweep(layout.park_q, layout.park_q)
    return any(bool((phase.high > phase.low).any()) for phase in phases)


async def homing_preview() -> FirstMotion:
    """Return the first motion of an arm that sweeps to home."""
    return FirstMotion(words=key("the arm homes: it sweeps its whole reach and moves its jaws"))


async def jaws_preview() -> FirstMotion:
    """Return the first motion of an arm whose encoders are absolute."""
    return FirstMotion(
        words=key("the arm opens and closes its jaws where it stands, then it goes to park")
    )


async def _homing_with_part() -> FirstMotion:
    return FirstMotion(
        words=key(
            "the arm gripper presses, then the arm homes slowly without opening it: zed goes "
            "up first"
        )
    )
