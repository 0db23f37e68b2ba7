"""Driver of the ACME gripper over Modbus: millimetres and newtons in, registers out.

The gripper is invented. Put the register map of your device's manual in place of the first block,
with its sections, and keep the verbs: they are what the cell calls. It does not know what is held.
"""

import asyncio
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

from drivers.errors import (
    DeviceError,
    FaultError,
    MotionStoppedError,
    RefusedError,
    StalledError,
    WrongDeviceError,
)
from drivers.kinds import Driver, FixedGripper, Hold, Site
from drivers.modbus_link import FunctionCode, ModbusLink, Request, always
from drivers.supervisor import BlindStop

# ---- register map; holding registers, zero based: manual, section 4 -----------------------------
STATUS, OPENING = 0, 1  # 4.1: bits below; hundredths of a millimetre
TARGET, FORCE, COMMAND = 10, 11, 12  # 4.2: hundredths of a millimetre, tenths of a newton, verb
PRODUCT, FIRMWARE = 100, 101  # 4.4
MOVING, CONTACT, ACTIVATED, FAULT = 1, 2, 4, 8  # 4.1
GO, STOP, ACTIVATE = 1, 2, 3  # 4.2
PRODUCT_NUMBER: Final = 0xAC3E  # 4.4
STEPS_PER_MM: Final = 100  # 4.1
STEPS_PER_N: Final = 10  # 4.2
MIN_FORCE_N, MAX_FORCE_N = 5.0, 100.0  # 2.3

POLL_S: Final = 0.02
STOP_S: Final = 1.0  # a gripper that still moves then does not obey
ARRIVED_MM: Final = 0.5
SLIP_MM: Final = 1.0  # jaws that closed on by this have lost the part
OVER_TRAVEL_MM: Final = 5.0  # sent further than the part, which is to stop the jaws


@dataclass(frozen=True, slots=True)
class Settings:
    """The keys that `settings:` of the cell file may have.

    Attributes
    ----------
    max_opening_mm : opening between the fingers that are mounted [mm]
    move_s : the longest move [s]
    """

    max_opening_mm: float = 80.0
    move_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Reading:
    """The gripper's state."""

    opening_mm: float
    is_moving: bool
    has_contact: bool
    is_activated: bool
    has_fault: bool

    @property
    def has_arrived(self) -> bool:
        """Whether the last move met nothing."""
        return self.is_activated and not (self.is_moving or self.has_contact or self.has_fault)


@dataclass(frozen=True, slots=True)
class Grasp:
    """The result of a grasp."""

    object_detected: bool
    opening_mm: float


class AcmeGripper:
    """One gripper.

    Parameters
    ----------
    link : its line, shared with other devices; the cell closes it
    unit : its Modbus unit
    settings : of the cell file
    """

    model = "ACME gripper"

    def __init__(self, link: ModbusLink, unit: int, settings: Settings) -> None:
        # harmless reads whose answers differ in length: after a late answer on a serial line, the
        # link reads them until question and answer are in step again
        probes = tuple(
            Request(FunctionCode.READ_HOLDING_REGISTERS, STATUS, count) for count in (1, 2)
        )
        self._unit = link.unit(unit, "gripper", probes=probes)
        self._settings = settings
        self._clock = link.clock
        self._verb = asyncio.Lock()  # one motion at a time; a stop does not wait for it
        self._stop_count = 0
        self._grasped_mm: float | None = None
        self._is_lost = False
        self.firmware = ""

    @property
    def max_opening_mm(self) -> float:
        """The largest opening of the jaws [mm]."""
        return self._settings.max_opening_mm

    async def connect(self) -> Reading:
        """Check the identity, return the first reading; nothing moves, a held part stays held.

        Raises
        ------
        WrongDeviceError : another device answers
        """
        try:
            product, firmware = await self._unit.read_holding_registers(PRODUCT, 2)
        except RefusedError as error:
            raise WrongDeviceError(f"{self._unit}: expected an {self.model}, {error}") from error
        if product != PRODUCT_NUMBER:
            raise WrongDeviceError(
                f"{self._unit}: expected an {self.model}, found product {product:04X}; check "
                "address and unit"
            )
        self.firmware = f"{firmware >> 8}.{firmware & 0xFF}"
        return await self.status()

    async def aclose(self) -> None:
        """Leave the device unchanged."""

    async def status(self) -> Reading:
        """Return a fresh reading. Faults are in it, not raised."""
        bits, steps = await self._unit.read_holding_registers(STATUS, 2)
        reading = Reading(
            opening_mm=steps / STEPS_PER_MM,
            is_moving=bool(bits & MOVING),
            has_contact=bool(bits & CONTACT),
            is_activated=bool(bits & ACTIVATED),
            has_fault=bool(bits & FAULT),
        )
        if self._grasped_mm is not None and not reading.is_moving:
            slipped_mm = abs(reading.opening_mm - self._grasped_mm)
            self._is_lost |= not reading.has_contact or slipped_mm > SLIP_MM
        return reading

    async def hold(self) -> Hold:
        """Return the state of the last grasp's hold. A loss stays a loss."""
        reading = await self.status()
        if self._grasped_mm is None:
            return Hold.NOTHING
        if self._is_lost:
            return Hold.LOST
        is_known = reading.is_activated and not reading.is_moving
        return Hold.HELD if is_known else Hold.UNKNOWN

    async def wait_lost(self) -> None:
        """Wait until the gripped part is known to be gone; a silent device is no loss."""
        while not self._is_lost:
            with suppress(DeviceError):  # whoever uses the gripper next is told
                await self.status()
            await self._clock.sleep(POLL_S)

    async def activate(self) -> None:
        """Make it ready to move.

        Raises
        ------
        FaultError : it reports a fault
        """
        async with self._verb:
            # sets a state and starts no motion: may be sent again
            await self._unit.write_register(COMMAND, ACTIVATE, again=always)
            self._check_fault(await self.status())

    async def open_to(self, opening_mm: float) -> Reading:
        """Move empty jaws to an opening; return the reading there.

        Raises
        ------
        ValueError : it does not open so far; nothing has been sent
        StalledError : something was in the way
        FaultError, MotionStoppedError : a fault, or a stop, ended it
        """
        self._check_opening(opening_mm)
        reading = await self._move(opening_mm, MAX_FORCE_N / 2)
        if abs(reading.opening_mm - opening_mm) > ARRIVED_MM:
            raise StalledError(
                f"gripper: the jaws ended at {reading.opening_mm:.1f} mm on their way to "
                f"{opening_mm:.1f} mm; see what is between or beside them"
            )
        return reading

    async def close_on(self, opening_mm: float, *, force_n: float) -> Grasp:
        """Close on a part of about this width; return how it ended. Nothing there is no error.

        Raises
        ------
        ValueError : opening or force are out of range; nothing has been sent
        FaultError, MotionStoppedError : a fault, or a stop, ended it
        """
        self._check_opening(opening_mm)
        if not MIN_FORCE_N <= force_n <= MAX_FORCE_N:  # False for NaN, too
            raise ValueError(
                f"gripper: {MIN_FORCE_N:g} to {MAX_FORCE_N:g} N allowed, not {force_n:g} N"
            )
        reading = await self._move(max(0.0, opening_mm - OVER_TRAVEL_MM), force_n)
        if reading.has_contact:
            self._grasped_mm = reading.opening_mm
        return Grasp(reading.has_contact, reading.opening_mm)

    def blind_stop(self) -> BlindStop | None:
        """Return a stop in bytes, for the supervisor to send if this process cannot."""
        return self._unit.blind_write(COMMAND, STOP)

    async def stop(self) -> None:
        """Stop the jaws where they are; return once a reading confirms it.

        Raises
        ------
        StalledError : they still move
        """
        self._stop_count += 1
        await self._unit.write_register(COMMAND, STOP, again=always)
        deadline_s = self._clock.attended_s() + self._clock.patience_s(STOP_S)
        while (await self.status()).is_moving:
            if self._clock.attended_s() > deadline_s:
                raise StalledError("gripper: does not obey a stop; cut its power")
            await self._clock.sleep(POLL_S)

    def _check_opening(self, opening_mm: float) -> None:
        if not (math.isfinite(opening_mm) and 0.0 <= opening_mm <= self.max_opening_mm):
            raise ValueError(
                f"gripper: opens 0 to {self.max_opening_mm:g} mm, not {opening_mm:g} mm"
            )

    def _check_fault(self, reading: Reading) -> None:
        if reading.has_fault:
            raise FaultError("gripper: reports a fault; manual, section 6", FAULT)

    async def _move(self, opening_mm: float, force_n: float) -> Reading:
        stop_count = self._stop_count
        async with self._verb:
            self._check_fault(await self.status())
            if self._stop_count != stop_count:  # it was stopped before it began
                raise MotionStoppedError("gripper: stopped")
            self._grasped_mm, self._is_lost = None, False
            goal = (round(STEPS_PER_MM * opening_mm), round(STEPS_PER_N * force_n), GO)
            try:
                # never `again`: a motion that is sent twice may happen twice
                await self._unit.write_registers(TARGET, goal)
                return await self._arrival(stop_count)
            except (DeviceError, asyncio.CancelledError):
                await asyncio.shield(self._stop_anyway())
                raise

    async def _arrival(self, stop_count: int) -> Reading:
        deadline_s = self._clock.attended_s() + self._clock.patience_s(self._settings.move_s)
        while True:
            reading = await self.status()
            if self._stop_count != stop_count:
                raise MotionStoppedError(f"gripper: stopped at {reading.opening_mm:.1f} mm")
            self._check_fault(reading)
            if not reading.is_moving:
                return reading
            if self._clock.attended_s() > deadline_s:
                raise StalledError(f"gripper: not there after {self._settings.move_s:g} s")
            await self._clock.sleep(POLL_S)

    async def _stop_anyway(self) -> None:
        """Stop while another error is under way already, which says more than a failed stop."""
        with suppress(DeviceError):
            await self.stop()


def _build(site: Site, settings: Settings) -> AcmeGripper:
    """Return the gripper of a cell file; opens nothing yet."""
    return AcmeGripper(site.open_link(), site.section["unit"], settings)


DRIVER: Driver[FixedGripper, Settings] = Driver(Settings, _build, max_force_n=lambda _: MAX_FORCE_N)
