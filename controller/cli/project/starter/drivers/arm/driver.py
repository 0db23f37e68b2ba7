"""Driver of the ACME arm over TCP: joints in radians and jaws in millimetres in, text out.

The arm is invented. Its wire is lines of text (manual, section 5): `STATE` is answered with six
joints in degrees, the opening in mm, and 0 or 1 for moving, pressing and power; `POWER`,
`MOVE j1 .. j6 percent`, `JAWS mm newtons` and `STOP` with `OK`, or `NO reason`. Put your arm's wire
in place of `_Line`, and keep the verbs. Its encoders are absolute: homing moves no joint.
"""

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.clock import CellClock
from drivers.errors import (
    ArmStalledError,
    BadReplyError,
    DeviceError,
    LinkError,
    MotionStoppedError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    StalledError,
    UnpluggedError,
)
from drivers.kinds import ArmDescription, ArmDriver, JawReading, Site, Stop

from .model import SixAxis

Floats = NDArray[np.float64]

POLL_S: Final = 0.01
STOP_S: Final = 1.0  # an arm that still moves then does not obey
ARRIVED_RAD: Final = 2e-3
ARRIVED_MM: Final = 0.3
KEPT_RAD: Final = 5e-3  # an arm that stands farther off was moved by somebody
MAX_FORCE_N: Final = 60  # manual, 2.4


@dataclass(frozen=True, slots=True)
class Settings:
    """The keys that `settings:` of the cell file may have.

    Attributes
    ----------
    max_opening_mm : opening of the gripper on the arm [mm]
    move_s : the longest move [s]
    """

    max_opening_mm: float = 85.0
    move_s: float = 30.0


@dataclass(frozen=True, slots=True)
class Shape:
    """The keys that `arm.shape:` of the cell file has."""

    upper_mm: float
    fore_mm: float
    tool_mm: float
    park_deg: tuple[float, float, float, float, float, float]
    height_mm: float = 430.0
    ahead_mm: float = 60.0

    def __post_init__(self) -> None:
        if min(self.upper_mm, self.fore_mm) < 2.0 * self.ahead_mm:
            raise ValueError("upper arm and forearm are longer than twice ahead_mm")


@dataclass(frozen=True, slots=True)
class Identity:
    """The arm that answered."""

    was_restarted: bool


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """The arm's state: joints (6,) [rad], jaws [mm]."""

    q: Floats
    opening_mm: float
    is_moving: bool
    is_pressing: bool
    has_power: bool


class AcmeArm:
    """One arm with its gripper.

    Parameters
    ----------
    host, port : where it is
    settings : of the cell file
    clock : the cell's clock
    reply_s : a line that is silent for so long is gone [s]
    limits : whose `within_limits` says which joints are allowed
    """

    model = "ACME arm"

    def __init__(
        self,
        host: str,
        port: int,
        settings: Settings,
        clock: CellClock,
        *,
        reply_s: float,
        limits: SixAxis,
    ) -> None:
        self._settings, self._clock, self._limits = settings, clock, limits
        self._line = _Line(host, port, clock, reply_s)
        self._verb = asyncio.Lock()  # one motion at a time; a stop does not wait for it
        self._stop_count = 0
        self._is_homed = False
        self._identity: Identity | None = None

    @property
    def identity(self) -> Identity | None:
        """What `connect` found."""
        return self._identity

    @property
    def is_homed(self) -> bool:
        """Whether positions are valid."""
        return self._is_homed

    @property
    def max_opening_mm(self) -> float:
        """Largest opening of its gripper [mm]."""
        return self._settings.max_opening_mm

    async def connect(self) -> Identity:
        """Open the line, return the arm's identity; nothing moves."""
        await self._line.aclose()
        state = await self._state()
        self._identity = Identity(was_restarted=not state.has_power)
        self._is_homed = False
        return self._identity

    async def aclose(self) -> None:
        """Stop, and release the line; opens no jaw."""
        if self._line.is_open:
            with suppress(DeviceError):
                await self.stop(Stop.DEAD)
        self._is_homed = False
        await self._line.aclose()

    async def enable_power(self) -> None:
        """Switch the motors on."""
        await self._order("POWER")

    async def home(self) -> None:
        """Open the jaws; the encoders are absolute, and no joint moves."""
        await self._move_jaws(self.max_opening_mm, MAX_FORCE_N // 2)
        self._is_homed = True

    async def take_over_positions(self, between: Floats) -> None:
        """Take over the positions of a controller before this one; nothing moves.

        Raises
        ------
        PositionLostError : the arm is not on the way on which it was sent
        """
        if np.isnan(await self.read_kept_q(between)).any():
            raise PositionLostError("arm: is not where it was sent; somebody has moved it")
        self._is_homed = True

    async def read_kept_q(self, between: Floats) -> Floats:
        """Return the joints (6,) that are where the arm was sent; NaN for the others."""
        q = (await self._state()).q
        low, high = between.min(axis=0) - KEPT_RAD, between.max(axis=0) + KEPT_RAD
        return np.where((q >= low) & (q <= high), q, np.nan)

    async def home_keeping_jaws(self, q_estimate: Floats, opening_mm: float | None) -> float:
        """Be homed without a motion; return the opening of the jaws, which stay.

        Raises
        ------
        PositionLostError : the jaws were opened meanwhile; nothing has moved
        """
        del q_estimate  # the encoders know
        state = await self._state()
        if opening_mm is not None and state.opening_mm > opening_mm + ARRIVED_MM:
            raise PositionLostError("arm: the jaws were opened; see what became of the part")
        self._is_homed = True
        return state.opening_mm

    async def read_q(self) -> Floats:
        """Return the joints (6,) [rad]."""
        self._check_homed()
        return (await self._state()).q

    async def move_joints(self, q: Floats, *, speed_share: float = 1.0) -> None:
        """Move to joints (6,) [rad]; return when the arm is there.

        Raises
        ------
        ValueError : beyond a limit; nothing has been sent
        ArmStalledError : it came to rest elsewhere, or is too slow; it is stopped
        MotionStoppedError : a stop ended it
        """
        target = np.asarray(q, dtype=np.float64)
        if target.shape != (6,) or not bool(self._limits.within_limits(target)):
            raise ValueError(f"arm: {self._limits.limit_report(target)}")
        if not 0.0 < speed_share <= 1.0:
            raise ValueError(f"arm: a speed share is above 0 to 1, not {speed_share:g}")
        self._check_homed()
        joints = " ".join(f"{joint:.4f}" for joint in np.degrees(target))
        state = await self._carry_out(f"MOVE {joints} {100.0 * speed_share:.1f}")
        off_rad = float(np.abs(state.q - target).max())
        if off_rad > ARRIVED_RAD:
            raise ArmStalledError(
                f"arm: stands {np.degrees(off_rad):.2f} deg from its target; see what it met"
            )

    async def stop(self, kind: Stop) -> None:
        """Stop all axes; return once a reading confirms it. It knows one kind of stop.

        Raises
        ------
        StalledError : it still moves
        """
        del kind
        self._stop_count += 1
        await self._line.ask("STOP")
        deadline_s = self._clock.attended_s() + self._clock.patience_s(STOP_S)
        while (await self._state()).is_moving:
            if self._clock.attended_s() > deadline_s:
                raise StalledError("arm: does not obey a stop; press the emergency stop")
            await self._clock.sleep(POLL_S)

    async def grasp(self, force: int, *, speed_share: float = 1.0) -> float:
        """Close the jaws until they stall; return the opening [mm].

        Raises
        ------
        ValueError : the force is out of range
        """
        del speed_share  # its jaws know one speed
        if not 0 < force <= MAX_FORCE_N:
            raise ValueError(f"arm: presses with 1 to {MAX_FORCE_N} N, not {force} N")
        return (await self._move_jaws(0.0, force)).opening_mm

    async def move_gripper_mm(self, opening_mm: float) -> float:
        """Move empty jaws to an opening [mm]; return the one reached.

        Raises
        ------
        ValueError : they do not open so far
        StalledError : something is between them
        """
        if not 0.0 <= opening_mm <= self.max_opening_mm:  # False for NaN, too
            raise ValueError(f"arm: the jaws open 0 to {self.max_opening_mm:g} mm")
        reached_mm = (await self._move_jaws(opening_mm, MAX_FORCE_N // 2)).opening_mm
        if abs(reached_mm - opening_mm) > ARRIVED_MM:
            raise StalledError(f"arm: the jaws ended at {reached_mm:.1f} mm")
        return reached_mm

    async def read_opening_mm(self) -> float:
        """Return the opening of the jaws [mm]."""
        return (await self._state()).opening_mm

    async def read_jaws(self) -> JawReading:
        """Return the state of the jaws; nothing moves."""
        state = await self._state()
        return JawReading(state.is_pressing, state.opening_mm)

    async def drive_jaws(self, by_mm: float) -> float:
        """Open (below 0: close) the jaws by a travel [mm]; return the travel they made."""
        before_mm = await self.read_opening_mm()
        target_mm = float(np.clip(before_mm + by_mm, 0.0, self.max_opening_mm))
        return (await self._move_jaws(target_mm, MAX_FORCE_N // 2)).opening_mm - before_mm

    def _check_homed(self) -> None:
        if not self._is_homed:
            raise PositionLostError("arm: is not homed")

    async def _move_jaws(self, opening_mm: float, force_n: int) -> State:
        return await self._carry_out(f"JAWS {opening_mm:.2f} {force_n}")

    async def _carry_out(self, order: str) -> State:
        """Send a motion once, and return the state in which it came to rest."""
        stop_count = self._stop_count
        async with self._verb:
            if self._stop_count != stop_count:  # it was stopped before it began
                raise MotionStoppedError("arm: stopped")
            try:
                await self._order(order)
                return await self._at_rest(stop_count)
            except (DeviceError, asyncio.CancelledError):
                with suppress(DeviceError):  # the error under way says more
                    await asyncio.shield(self.stop(Stop.DEAD))
                raise

    async def _at_rest(self, stop_count: int) -> State:
        deadline_s = self._clock.attended_s() + self._clock.patience_s(self._settings.move_s)
        while True:
            state = await self._state()
            if self._stop_count != stop_count:
                raise MotionStoppedError("arm: stopped on its way")
            if not state.is_moving:
                return state
            if self._clock.attended_s() > deadline_s:
                raise ArmStalledError(f"arm: not there after {self._settings.move_s:g} s")
            await self._clock.sleep(POLL_S)

    async def _order(self, words: str) -> None:
        answer = await self._line.ask(words)
        if answer.startswith("NO "):
            raise RefusedError(f"arm: `{words}` was refused: {answer[3:]}", 0)
        if answer != "OK":
            raise BadReplyError(f"arm: `{words}` was answered with `{answer:.60}`")

    async def _state(self) -> State:
        answer = await self._line.ask("STATE")
        try:
            *joints, opening_mm, moving, pressing, power = map(float, answer.split())
            if len(joints) != 6:
                raise ValueError(joints)
        except ValueError as error:
            raise BadReplyError(f"arm: `STATE` was answered with `{answer:.60}`") from error
        q = np.radians(joints)
        return State(q, opening_mm, moving == 1.0, pressing == 1.0, power == 1.0)


class _Line:
    """A TCP connection with one question in flight; opened when it is needed.

    A question that was cancelled or not answered ends the connection: a late answer must not be
    taken for the next one's.
    """

    def __init__(self, host: str, port: int, clock: CellClock, reply_s: float) -> None:
        self._host, self._port, self._clock, self._reply_s = host, port, clock, reply_s
        self._streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._turn = asyncio.Lock()

    @property
    def is_open(self) -> bool:
        """Whether there is a connection."""
        return self._streams is not None

    async def ask(self, words: str) -> str:
        """Send a line; return the line that answers it.

        Raises
        ------
        LinkError : nothing came back
        """
        async with self._turn:
            is_done = False
            try:
                async with self._clock.timeout(self._reply_s):
                    if self._streams is None:
                        self._streams = await asyncio.open_connection(self._host, self._port)
                    reader, writer = self._streams
                    writer.write(f"{words}\n".encode())
                    answer = await reader.readuntil(b"\n")
                is_done = True
            except TimeoutError as error:
                raise ReplyTimeoutError(f"arm: no answer to `{words}`") from error
            except (OSError, asyncio.IncompleteReadError) as error:
                raise UnpluggedError(f"arm: {self._host}:{self._port}: {error}") from error
            except asyncio.LimitOverrunError as error:
                raise LinkError(f"arm: `{words}`: a line without an end") from error
            finally:
                if not is_done:
                    await self.aclose()
        return answer.decode("ascii", "replace").strip()

    async def aclose(self) -> None:
        """End the connection."""
        if self._streams is not None:
            self._streams[1].transport.abort()
            self._streams = None


def _describe(shape: Shape) -> ArmDescription[SixAxis]:
    """Return the arm with these lengths, for planning; asks no device."""
    arm = SixAxis(shape.height_mm, shape.ahead_mm, shape.upper_mm, shape.fore_mm, shape.tool_mm)
    return ArmDescription(arm, np.radians(shape.park_deg))


def _build(site: Site, settings: Settings) -> AcmeArm:
    """Return the arm of a cell file; opens nothing yet."""
    host, _, port = site.address.rpartition(":")
    limits = _describe(site.shape).model
    return AcmeArm(host, int(port), settings, site.clock, reply_s=site.silence_s, limits=limits)


DRIVER: ArmDriver[Settings, Shape, SixAxis] = ArmDriver(Settings, _build, Shape, _describe)
