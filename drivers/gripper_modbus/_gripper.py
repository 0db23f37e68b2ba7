"""The verbs of a Robotiq 2F gripper: open, close, stop, in millimetres and newtons.

Sequences after modbus_devices.md 2.6. It does not know which part it holds, and it never decides
to drop one: activating, which moves the jaws, happens only on request.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import Final, Self

from messages import key, say

from ..errors import (
    BadReplyError,
    DeviceError,
    FaultError,
    MotionStoppedError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    StalledError,
    UnpluggedError,
    WrongDeviceError,
)
from ..kinds import Hold
from ..modbus_link import FunctionCode, ModbusLink, Request, VerbLock, always
from ..supervisor import BlindStop
from ._config import GripperConfig
from ._monitor import GripperMonitor
from ._registers import (
    ACTIVATE,
    GO_TO,
    INPUT_REGISTER,
    OUTPUT_REGISTER,
    RELEASING_FAULT,
    ActivationState,
    Counts,
    FaultClass,
    ObjectState,
    encode_outputs,
    fault_of,
)
from ._status import GraspResult, GripperStatus, judge_grasp, judge_hold

log = logging.getLogger(__name__)

STOP_TRIES: Final = 3
RESET_TIMEOUT_S: Final = 1.0
RELEASE_TIMEOUT_S: Final = 10.0  # a full stroke at the slowest speed is 4.3 s, §2.5
MOVE_MARGIN: Final = 1.5  # speed is only quasi linear, §2.5
MOVE_MARGIN_S: Final = 1.0
# errors after which the state is read back
NOT_KNOWN_TO_BE_DONE: Final = (ReplyTimeoutError, UnpluggedError)


class StoppedError(MotionStoppedError):
    """A move was ended by `Gripper.stop`, or by another master, before it arrived."""


class Gripper:
    """A Robotiq 2F gripper behind a Modbus link that others may share.

    Usable as ``async with``; leaving it ends the keep-alive and moves nothing. Every verb may
    raise what `ModbusUnit` raises besides its own errors. `open_on` is for scripts and
    commissioning.

    Parameters
    ----------
    link : the line it is on; not closed by the gripper
    config : its slave id, calibration and limits
    name : name used in messages
    """

    def __init__(
        self, link: ModbusLink, config: GripperConfig | None = None, name: str = "gripper"
    ) -> None:
        self.config = config or GripperConfig()
        self.name = name
        self._clock = link.clock
        self._unit = link.unit(
            self.config.unit,
            name,
            spacing_s=self.config.spacing_s,
            probes=tuple(
                Request(FunctionCode.READ_HOLDING_REGISTERS, INPUT_REGISTER, count)
                for count in (1, 2)
            ),
            check=(
                say(
                    "its 24 V supply, its slave id {unit}, RS-485 A and B, 115200 8N1 "
                    "(a Robotiq also stays silent when it does not like a request)",
                    unit=self.config.unit,
                )
            ),
        )
        self._monitor = GripperMonitor(self._unit, self.config)
        self._verb = VerbLock(link)
        self._stopping: set[asyncio.Future[None]] = set()
        self._stop_count = 0  # a move ends once it counts on

    async def __aenter__(self) -> Self:
        await self.connect()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.aclose()

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return "Robotiq 2F"

    @property
    def max_opening_mm(self) -> float:
        """The largest opening of the jaws [mm]."""
        return self.config.open_mm

    async def connect(self) -> GripperStatus:
        """Check as far as the map allows that this is a 2F, keep it awake; return its status.

        Moves nothing. A gripper that is already holding a part is taken over as it is.

        Raises
        ------
        WrongDeviceError : the device that answers is no Robotiq 2F
        """
        expected = key("expected a Robotiq 2F gripper, which never answers with an exception")
        advice = key("check slave id and port, or which device is wired there")
        try:
            status = await self.status()
        except RefusedError as error:
            raise WrongDeviceError(
                say(
                    "{unit}: {expected}, found {error}; {advice}",
                    unit=self._unit,
                    expected=expected,
                    error=error,
                    advice=advice,
                )
            ) from error
        except BadReplyError as error:
            raise WrongDeviceError(
                say(
                    "{unit}: expected a Robotiq 2F gripper, found {error}; {advice}",
                    unit=self._unit,
                    error=error,
                    advice=advice,
                )
            ) from error
        if self._monitor.grasp is None and status.is_activated and status.has_contact:
            self._monitor.grasp = judge_grasp(status, status.object, 0.0, self.config)
        self._monitor.keep_awake()
        return status

    async def aclose(self) -> None:
        """End the keep-alive. The jaws stay as they are; the gripper will show fault 09."""
        if self._stopping:
            await asyncio.wait(self._stopping)
        await self._monitor.aclose()

    @property
    def latest(self) -> GripperStatus | None:
        """The last reading, at most ``keep_alive_s`` old while all is well; see its ``at_s``."""
        return self._monitor.latest

    async def status(self) -> GripperStatus:
        """Return a fresh reading. Faults are in it, not raised."""
        return await self._monitor.status()

    async def hold(self) -> Hold:
        """Return the state of the last grasp's hold. A loss stays a loss."""
        status = await self.status()
        if self._monitor.lost.is_set():
            return Hold.LOST
        return judge_hold(self._monitor.grasp, status, self.config)

    async def wait_lost(self) -> None:
        """Wait until the keep-alive, or any reading, notices that the gripped part is gone."""
        await self._monitor.lost.wait()

    async def activate(self) -> GripperStatus:
        """Make the gripper ready to move, unless it is; return its status.

        **Moves the jaws** unless it is already active, and so drops what they hold. Also the way
        out of a major fault. Cancelling it deactivates the gripper, which is what stops it.

        Raises
        ------
        FaultError : activation failed; the message has the reason and what to do
        StoppedError : `stop` ended it
        """
        stop_count = self._stop_count
        async with self._verb.held("activate"):
            status = await self.status()
            if status.is_activated and not (
                status.has_fault and fault_of(status.fault).kind is FaultClass.MAJOR
            ):
                return status
            self._forget_grasp()
            try:
                return await self._activate(status, stop_count)
            except asyncio.CancelledError:
                await self._on_the_way_out(self._deactivate)
                raise

    async def open_to(
        self, opening_mm: float, speed_mm_s: float | None = None, force_n: float | None = None
    ) -> GripperStatus:
        """Move the jaws, nothing between them, to an opening; return the status there.

        Parameters
        ----------
        opening_mm : opening between the fingertips, 0..85 for a 2F-85 [mm]
        speed_mm_s : 20..150 for a 2F-85 [mm/s]
        force_n : 20..235 for a 2F-85 [N]

        Raises
        ------
        StalledError : something was in the way, or they never arrived
        FaultError : the gripper has a fault, which is its ``code``
        PositionLostError : it is not activated, or lost its power meanwhile
        StoppedError : `stop` ended it
        """
        status = await self._move(self.config.opening_mm_to_counts(opening_mm), speed_mm_s, force_n)
        is_there = abs(status.opening_mm - opening_mm) <= self.config.arrival_tolerance_mm
        if status.object is not ObjectState.AT_POSITION and not is_there:
            raise StalledError(
                say(
                    "{name}: the jaws met an obstacle at {opening_mm:.1f} mm while "
                    "moving to {target_mm:.1f} mm; see what is between or beside them",
                    name=self.name,
                    opening_mm=status.opening_mm,
                    target_mm=opening_mm,
                )
            )
        return status

    async def close_on(
        self, opening_mm: float = 0.0, speed_mm_s: float | None = None, force_n: float | None = None
    ) -> GraspResult:
        """Close on a part and hold it; return the result of the grasp.

        Parameters
        ----------
        opening_mm : expected on the part, 0 when unknown; the jaws are sent ``over_travel_mm``
            further, so a missing part does not close them altogether [mm]
        speed_mm_s : speed of the jaws [mm/s]; by default the configured one
        force_n : force on the part [N]; by default the configured one

        Raises
        ------
        What `open_to` raises, but contact is the aim here.
        """
        target_mm = max(0.0, opening_mm - self.config.over_travel_mm)
        return await self._take(
            target_mm, opening_mm, ObjectState.CONTACT_CLOSING, speed_mm_s, force_n
        )

    async def open_on(
        self, opening_mm: float, speed_mm_s: float | None = None, force_n: float | None = None
    ) -> GraspResult:
        """Open inside a part, such as a ring, and hold it from within; return as `close_on`.

        Parameters
        ----------
        opening_mm : expected inside the part [mm]; the jaws are sent ``over_travel_mm``
            further, to the widest opening at most
        speed_mm_s : speed of the jaws [mm/s]; by default the configured one
        force_n : force on the part [N]; by default the configured one
        """
        target_mm = min(self.config.open_mm, opening_mm + self.config.over_travel_mm)
        return await self._take(
            target_mm, opening_mm, ObjectState.CONTACT_OPENING, speed_mm_s, force_n
        )

    def blind_stop(self) -> BlindStop | None:
        """Return the jaws' stop in bytes, for the supervisor to send if this process cannot.

        None unless the gripper was last seen active: the command carries rACT = 1 (see `stop`).
        """
        status = self._monitor.latest
        if status is None or not status.is_activated:
            return None
        return self._unit.blind_write(OUTPUT_REGISTER, ACTIVATE << 8)

    async def stop(self) -> GripperStatus:
        """Stop the jaws, which keep what they hold; return the status that confirms it.

        A gripper without activation is left alone: the stop command carries rACT = 1, which
        would start one. One that is activating is deactivated, since nothing else stops it.

        Raises
        ------
        StalledError : the jaws still move after `STOP_TRIES` stop commands
        """
        self._stop_count += 1
        status = self._monitor.latest
        if status is None or not status.is_activated:
            status = await self.status()
        for _ in range(STOP_TRIES):
            if not status.is_powered_on:
                return status
            try:
                if status.activation is ActivationState.ACTIVATING:
                    await self._deactivate()
                else:
                    await self._unit.write_register(OUTPUT_REGISTER, ACTIVATE << 8, again=always)
            except NOT_KNOWN_TO_BE_DONE as error:
                log.warning("stopping: %s", error)
            status = await self.status()
            if status.is_activated and not status.is_going:
                return status
        raise StalledError(
            say(
                "{name}: acknowledged, but did not obey {stop_tries} stop "
                "commands; cut its power if the jaws still move",
                name=self.name,
                stop_tries=STOP_TRIES,
            )
        )

    async def _take(
        self,
        target_mm: float,
        expected_mm: float,
        contact: ObjectState,
        speed_mm_s: float | None,
        force_n: float | None,
    ) -> GraspResult:
        self.config.opening_mm_to_counts(expected_mm)  # the jaws must be able to be that wide
        status = await self._move(self.config.opening_mm_to_counts(target_mm), speed_mm_s, force_n)
        self._monitor.grasp = judge_grasp(status, contact, expected_mm, self.config)
        return self._monitor.grasp

    async def _move(
        self, target: Counts, speed_mm_s: float | None, force_n: float | None
    ) -> GripperStatus:
        """Go to a position and return the reading that ended the move."""
        config = self.config
        speed_mm_s = config.default_speed_mm_s if speed_mm_s is None else speed_mm_s
        outputs = encode_outputs(
            ACTIVATE | GO_TO,
            target,
            config.speed_to_byte(speed_mm_s),
            config.force_to_byte(config.default_force_n if force_n is None else force_n),
        )
        stop_count = self._stop_count
        async with self._verb.held("move"):
            before = await self.status()
            self._require_ready(before)
            self._require_not_stopped(stop_count, before)
            self._forget_grasp()
            distance_mm = abs(before.opening_mm - config.counts_to_opening_mm(target))
            limit_s = MOVE_MARGIN * distance_mm / speed_mm_s + MOVE_MARGIN_S
            was_asked = before.is_going and before.requested_counts == target
            try:
                await self._write(
                    outputs,
                    lambda now: now.is_going and now.requested_counts == target and not was_asked,
                    stop_count,
                )
                return await self._arrival(target, limit_s, stop_count)
            except asyncio.CancelledError:
                await self._on_the_way_out(self.stop)
                raise

    def _require_not_stopped(self, stop_count: int, status: GripperStatus) -> None:
        if self._stop_count != stop_count:
            raise StoppedError(
                say(
                    "{name}: stopped at {opening_mm:.1f} mm",
                    name=self.name,
                    opening_mm=status.opening_mm,
                )
            )

    async def _arrival(self, target: Counts, limit_s: float, stop_count: int) -> GripperStatus:
        deadline_s = self._monitor.deadline_s(limit_s)
        is_under_way = False
        while True:
            status = await self.status()
            self._require_ready(status)
            self._require_not_stopped(stop_count, status)
            if status.is_going and status.requested_counts == target:
                is_under_way = True
                if status.object is not ObjectState.MOVING:
                    return status
            elif is_under_way:  # before that it is the old state: refreshed every 5 ms only
                raise StoppedError(
                    say(
                        "{name}: stopped at {opening_mm:.1f} mm",
                        name=self.name,
                        opening_mm=status.opening_mm,
                    )
                )
            if self._clock.attended_s() > deadline_s:
                await self._quietly(self.stop)
                raise StalledError(
                    say(
                        "{name}: not arrived after {limit_s:.1f} s, stopped at "
                        "{opening_mm:.1f} mm; look at the jaws",
                        name=self.name,
                        limit_s=limit_s,
                        opening_mm=status.opening_mm,
                    )
                )
            await self._monitor.pause()

    async def _activate(self, status: GripperStatus, stop_count: int) -> GripperStatus:
        if status.fault == RELEASING_FAULT:
            status = await self._monitor.until(
                lambda now: now.fault != RELEASING_FAULT,
                RELEASE_TIMEOUT_S,
                key("automatic release"),
            )
        is_activating = status.is_powered_on and status.activation is ActivationState.ACTIVATING
        if not is_activating or fault_of(status.fault).kind is FaultClass.MAJOR:
            await self._deactivate()
            await self._monitor.until(
                lambda now: now.activation is ActivationState.RESET and not now.is_powered_on,
                RESET_TIMEOUT_S,
                "reset",
            )
            self._require_not_stopped(stop_count, status)
            await self._write(encode_outputs(ACTIVATE), lambda now: now.is_powered_on, stop_count)
        status = await self._monitor.until(
            lambda now: now.is_activated or self._stop_count != stop_count,
            self.config.activation_timeout_s,
            "activation",
            stop_at_major=True,
        )
        self._require_not_stopped(stop_count, status)
        return status

    async def _write(
        self,
        outputs: tuple[int, int, int],
        has_arrived: Callable[[GripperStatus], bool],
        stop_count: int | None = None,
    ) -> None:
        """Write the output block; after silence or "later" look whether it arrived, then repeat it.

        Outputs are absolute, so a repetition moves nothing twice. But a stop that came between
        would be undone by it.

        Parameters
        ----------
        outputs : the block
        has_arrived : test of a reading for arrival
        stop_count : number of stops at the start of the verb; None for outputs that set nothing in
            motion

        Raises
        ------
        StoppedError : `stop` came before the repetition
        """

        async def is_missing() -> bool:
            status = await self.status()
            if has_arrived(status):
                return False
            if stop_count is not None:
                self._require_not_stopped(stop_count, status)
            return True

        try:
            await self._unit.write_registers(OUTPUT_REGISTER, outputs, again=is_missing)
        except NOT_KNOWN_TO_BE_DONE as error:
            log.warning("reading back: %s", error)
            if await is_missing():
                await self._unit.write_registers(OUTPUT_REGISTER, outputs)

    async def _deactivate(self) -> None:
        await self._write(encode_outputs(0), lambda now: not now.is_powered_on)

    def _require_ready(self, status: GripperStatus) -> None:
        if status.has_fault:
            raise FaultError(
                say("{name}: {fault_text}", name=self.name, fault_text=status.fault_text),
                status.fault,
            )
        if not status.is_activated:
            raise PositionLostError(
                say(
                    "{name}: not activated (gSTA {activation}), so it was just "
                    "switched on or lost its power; see what it holds, then activate "
                    "it: its jaws will move",
                    name=self.name,
                    activation=int(status.activation),
                )
            )

    def _forget_grasp(self) -> None:
        self._monitor.grasp = None
        self._monitor.lost.clear()

    async def _on_the_way_out(self, action: Callable[[], Awaitable[object]]) -> None:
        """Send a stop before a cancellation passes on; a second cancellation cannot prevent it."""
        task = asyncio.ensure_future(self._quietly(action))
        self._stopping.add(task)
        task.add_done_callback(self._stopping.discard)
        await asyncio.shield(task)

    async def _quietly(self, action: Callable[[], Awaitable[object]]) -> None:
        """Run a stop while another error is already being raised: log its failure only."""
        try:
            await action()
        except DeviceError as error:
            log.error("%s: could not be stopped: %s", self.name, error)
