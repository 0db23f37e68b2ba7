"""The verbs of an OnRobot RG2 or RG6: open, close, stop, in millimetres and newtons.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
import logging
import math
from dataclasses import dataclass
from typing import Final

from messages import key, say

from ..errors import (
    DeviceError,
    FaultError,
    MotionStoppedError,
    RefusedError,
    ReplyTimeoutError,
    StalledError,
    UnpluggedError,
    WrongDeviceError,
)
from ..kinds import Hold
from ..modbus_link import FunctionCode, ModbusLink, Request, VerbLock, always
from ..supervisor import BlindStop
from ._registers import (
    BOX_UNIT,
    COMMAND_REGISTER,
    CONTROL_REGISTER,
    POWER_CYCLE,
    PRODUCT_COUNT,
    PRODUCT_REGISTER,
    SAFETY,
    STATE_COUNT,
    STATUS_REGISTER,
    STOP,
    Flag,
    Model,
    decode_state,
    encode_command,
)

log = logging.getLogger(__name__)

MOVE_S: Final = 10.0  # §3.5
SETTLE_S: Final = 0.05  # §3.5: until then busy may not be set yet
POLL_S: Final = 0.02
HOLD_POLL_S: Final = 0.1
STOP_S: Final = 1.0
BOOT_S: Final = 5.0  # §3.3: about 1 s
# excess of the target, so that the part and not the target stops the jaws
OVER_TRAVEL_MM: Final = 8.0
ARRIVED_MM: Final = 1.0
SLIP_MM: Final = 1.5
FREE_FORCE_SHARE: Final = 0.5  # share of the greatest force, with nothing between the jaws


@dataclass(frozen=True, slots=True)
class RgReading:
    """The gripper's state.

    Attributes
    ----------
    flags : status, §3.3
    opening_mm : opening between the fingertips
    """

    flags: Flag
    opening_mm: float

    @property
    def is_moving(self) -> bool:
        """Whether the jaws are moving."""
        return bool(self.flags & Flag.BUSY)

    @property
    def has_contact(self) -> bool:
        """Whether something stopped the jaws."""
        return not self.is_moving and bool(self.flags & Flag.GRASP)

    @property
    def has_arrived(self) -> bool:
        """Whether the last move met nothing."""
        return not self.is_moving and not self.has_contact and not self.has_fault

    @property
    def has_fault(self) -> bool:
        """Whether a safety switch prevents a move."""
        return bool(self.flags & SAFETY)

    @property
    def is_activated(self) -> bool:
        """Whether it can be moved: there is no activation, §3.2."""
        return not self.has_fault


@dataclass(frozen=True, slots=True)
class RgGrasp:
    """The result of a grasp."""

    object_detected: bool
    opening_mm: float


class RgGripper:
    """One gripper behind a Compute Box.

    Parameters
    ----------
    link : the line to the box; not closed by the gripper
    model : model required, one of two
    unit : unit of the side of the quick changer it is on
    """

    def __init__(self, link: ModbusLink, model: Model, unit: int) -> None:
        self._model = model
        self._clock = link.clock
        probes = tuple(
            Request(FunctionCode.READ_HOLDING_REGISTERS, STATUS_REGISTER, n) for n in (1, 2)
        )
        check = key(
            "the box's power, its address, the tool's cable, and that nobody else is connected"
        )
        self._unit = link.unit(unit, "gripper", probes=probes, check=check)
        self._box = link.unit(BOX_UNIT, "Compute Box", check=check)
        self._verb = VerbLock(link)
        self._stop_count = 0
        self._grasped_mm: float | None = None
        self._is_lost = False
        self.firmware = ""

    @property
    def model(self) -> str:
        """The device's name in messages and the journal."""
        return say("OnRobot {name}", name=self._model.name)

    @property
    def max_opening_mm(self) -> float:
        """The largest opening of the jaws [mm]."""
        return self._model.max_opening_mm

    async def connect(self) -> RgReading:
        """Check the device's identity; return the gripper's state. Nothing moves.

        A gripper that already presses on something is taken over as it is.

        Raises
        ------
        WrongDeviceError : it is another tool
        """
        try:
            product = await self._unit.read_holding_registers(PRODUCT_REGISTER, PRODUCT_COUNT)
        except RefusedError as error:
            raise WrongDeviceError(
                say(
                    "{unit}: expected an {model}, {error}",
                    unit=self._unit,
                    model=self.model,
                    error=error,
                )
            ) from error
        if product[0] != self._model.product:
            raise WrongDeviceError(
                say(
                    "{unit}: expected an {model}, product {product:02X}, found product "
                    "{found:02X}; check `settings: {{model}}` and `unit`",
                    unit=self._unit,
                    model=self.model,
                    product=self._model.product,
                    found=product[0],
                )
            )
        self.firmware = f"{product[4] >> 8}.{product[4] & 0xFF} build {product[5]}"
        reading = await self.status()
        if self._grasped_mm is None and reading.has_contact:
            self._grasped_mm = reading.opening_mm
        return reading

    async def aclose(self) -> None:
        """Leave the device unchanged."""

    async def status(self) -> RgReading:
        """Return a fresh reading. Faults are in it, not raised."""
        registers = await self._unit.read_holding_registers(STATUS_REGISTER, STATE_COUNT)
        reading = RgReading(*decode_state(registers))
        if (
            self._grasped_mm is not None
            and not reading.is_moving
            and not (reading.has_contact and abs(reading.opening_mm - self._grasped_mm) <= SLIP_MM)
        ):
            self._is_lost = True
        return reading

    async def hold(self) -> Hold:
        """Return the state of the last grasp's hold. A loss stays a loss."""
        reading = await self.status()
        if self._grasped_mm is None:
            return Hold.NOTHING
        if self._is_lost:
            return Hold.LOST
        return Hold.UNKNOWN if reading.is_moving or reading.has_fault else Hold.HELD

    async def wait_lost(self) -> None:
        """Wait until the gripped part is known to be gone."""
        while not self._is_lost:
            try:
                await self.status()
            except DeviceError as error:
                log.debug("looking again: %s", error)
            await self._clock.sleep(HOLD_POLL_S)

    async def activate(self) -> RgReading:
        """Make it ready to move if a safety switch was triggered; return a reading.

        Then its power is switched off and on, which it needs (§3.3).

        Raises
        ------
        FaultError : a switch is still pressed, or the fault has come back
        LinkError : it does not answer any more
        """
        async with self._verb.held("activate"):
            reading = await self.status()
            if not reading.has_fault:
                return reading
            await self._box.write_register(COMMAND_REGISTER, POWER_CYCLE)
            deadline_s = self._clock.attended_s() + self._clock.patience_s(BOOT_S)
            while True:
                await self._clock.sleep(HOLD_POLL_S)
                try:
                    reading = await self.status()
                except (ReplyTimeoutError, UnpluggedError):
                    if self._clock.attended_s() > deadline_s:
                        raise
                    continue
                if not reading.has_fault:
                    return reading
                if self._clock.attended_s() > deadline_s:
                    raise self._fault(reading)

    async def open_to(self, opening_mm: float) -> RgReading:
        """Move the jaws, nothing between them, to an opening; return their state there.

        Raises
        ------
        ValueError : it does not open so far; nothing has been sent
        StalledError : something was in their path, or they never arrived
        FaultError : a safety switch prevents it
        MotionStoppedError : `stop` ended it
        """
        self._check(opening_mm)
        force_n = FREE_FORCE_SHARE * self._model.max_force_n
        reading = await self._move(opening_mm, force_n)
        if abs(reading.opening_mm - opening_mm) > ARRIVED_MM:
            raise StalledError(
                say(
                    "gripper: the jaws ended at {opening_mm:.1f} mm on their way to "
                    "{target_mm:.1f} mm; see what is between or beside them",
                    opening_mm=reading.opening_mm,
                    target_mm=opening_mm,
                )
            )
        return reading

    async def close_on(self, opening_mm: float, *, force_n: float) -> RgGrasp:
        """Close on a part and hold it; return the result of the grasp.

        Parameters
        ----------
        opening_mm : expected on the part [mm]; the jaws are sent further
        force_n : on the part [N]

        Raises
        ------
        ValueError : opening or force are out of range; nothing has been sent
        FaultError, MotionStoppedError, StalledError : as in `open_to`
        """
        self._check(opening_mm)
        if not 0.0 < force_n <= self._model.max_force_n:
            raise ValueError(
                f"an {self.model} presses with up to {self._model.max_force_n:g} N, "
                f"not {force_n:g} N"
            )
        reading = await self._move(max(0.0, opening_mm - OVER_TRAVEL_MM), force_n)
        if reading.has_contact:
            self._grasped_mm = reading.opening_mm
        return RgGrasp(reading.has_contact, reading.opening_mm)

    def blind_stop(self) -> BlindStop | None:
        """Return the jaws' stop in bytes, for the supervisor to send if this process cannot."""
        return self._unit.blind_write(CONTROL_REGISTER, STOP)

    async def stop(self) -> RgReading:
        """Stop the jaws; return the reading that confirms it.

        Raises
        ------
        StalledError : they still move after a second
        """
        self._stop_count += 1
        deadline_s = self._clock.attended_s() + self._clock.patience_s(STOP_S)
        while True:
            try:
                await self._unit.write_register(CONTROL_REGISTER, STOP, again=always)
            except (ReplyTimeoutError, UnpluggedError) as error:
                log.warning("stopping: %s", error)
            reading = await self.status()
            if not reading.is_moving:
                return reading
            if self._clock.attended_s() > deadline_s:
                raise StalledError(key("gripper: does not obey a stop; cut its power if it moves"))
            await self._clock.sleep(POLL_S)

    def _check(self, opening_mm: float) -> None:
        if not (math.isfinite(opening_mm) and 0.0 <= opening_mm <= self.max_opening_mm):
            raise ValueError(f"the jaws open 0..{self.max_opening_mm:g} mm, not {opening_mm:g} mm")

    def _fault(self, reading: RgReading) -> FaultError:
        names = ", ".join(str(flag.name).lower() for flag in SAFETY if flag in reading.flags)
        return FaultError(
            say(
                "gripper: {names}; free the safety switch, take the part out, then activate it",
                names=names,
            ),
            int(reading.flags & SAFETY),
        )

    async def _move(self, opening_mm: float, force_n: float) -> RgReading:
        """Go to an opening; return the reading that ended the move."""
        stop_count = self._stop_count
        async with self._verb.held("move"):
            before = await self.status()
            if before.has_fault:
                raise self._fault(before)
            if before.is_moving:  # after a loss, say: busy, it would not take the command
                await self.stop()
                stop_count += 1
            if self._stop_count != stop_count:  # before it has begun
                raise MotionStoppedError(
                    say("gripper: stopped at {opening_mm:.1f} mm", opening_mm=before.opening_mm)
                )
            self._grasped_mm, self._is_lost = None, False

            async def is_missing() -> bool:
                """Whether the command has started no motion, and no stop came since."""
                return not (await self.status()).is_moving and self._stop_count == stop_count

            try:
                await self._unit.write_registers(
                    COMMAND_REGISTER, encode_command(force_n, opening_mm), again=is_missing
                )
                return await self._arrival(stop_count)
            except asyncio.CancelledError:
                await asyncio.shield(self._quiet_stop())
                raise
            except (ReplyTimeoutError, UnpluggedError):
                await self._quiet_stop()
                raise

    async def _arrival(self, stop_count: int) -> RgReading:
        begun_s = self._clock.attended_s()
        was_busy = False
        while True:
            reading = await self.status()
            if self._stop_count != stop_count:
                raise MotionStoppedError(
                    say("gripper: stopped at {opening_mm:.1f} mm", opening_mm=reading.opening_mm)
                )
            if reading.has_fault:
                raise self._fault(reading)
            was_busy = was_busy or reading.is_moving
            passed_s = self._clock.attended_s() - begun_s
            if not reading.is_moving and (was_busy or passed_s > SETTLE_S):
                return reading
            if passed_s > self._clock.patience_s(MOVE_S):
                await self._quiet_stop()
                raise StalledError(
                    say("gripper: not arrived after {move_s:g} s; look at the jaws", move_s=MOVE_S)
                )
            await self._clock.sleep(POLL_S)

    async def _quiet_stop(self) -> None:
        """Stop while another error is being raised already: log its failure only."""
        try:
            await self.stop()
        except DeviceError as error:
            log.error("gripper: could not be stopped: %s", error)
