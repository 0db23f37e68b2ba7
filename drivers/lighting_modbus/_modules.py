"""Register maps of the Waveshare Analog Output 8CH (B) and Relay 8CH: modbus_devices.md 6.1, 6.2.

Each writes only values that differ from the module's known ones; they are forgotten as soon as a
write may or may not have arrived.
"""

from collections.abc import Sequence
from typing import Final

from messages import key, say

from ..errors import DeviceError, RefusedError, WrongDeviceError
from ..modbus_link import FunctionCode, ModbusLink, ModbusUnit, Request, always
from ._config import CHANNEL_COUNT, MAX_MV

FIRST_CHANNEL: Final = 0x0000
VERSION_REGISTER: Final = 0x8000  # 0x0064 is V1.00
_CHECK: Final = key("its supply, its slave id, RS-485 A and B, 9600 8N1")


def _unit(link: ModbusLink, unit: int, name: str, spacing_s: float, probe: Request) -> ModbusUnit:
    version = Request(FunctionCode.READ_HOLDING_REGISTERS, VERSION_REGISTER)
    return link.unit(unit, name, spacing_s=spacing_s, probes=(version, probe), check=_CHECK)


def _version_text(register: int) -> str:
    return f"V{register // 100}.{register % 100:02}"


class AnalogModule:
    """Eight 0-10 V outputs, one holding register each, in millivolts.

    Parameters
    ----------
    link : the line it is on
    unit : its slave id
    spacing_s : least pause between two exchanges with it [cell s]
    """

    def __init__(self, link: ModbusLink, unit: int, spacing_s: float) -> None:
        probe = Request(FunctionCode.READ_HOLDING_REGISTERS, FIRST_CHANNEL, 2)
        self.unit = _unit(link, unit, key("analog output module"), spacing_s, probe)
        self._known_mv: tuple[int, ...] | None = None

    async def identify(self) -> str:
        """Return the version; WrongDeviceError when this is not the (B) module."""
        try:
            (version,) = await self.unit.read_holding_registers(VERSION_REGISTER, 1)
            outputs_mv = await self.read()
        except RefusedError as error:
            raise _wrong(self.unit, "Waveshare Analog Output 8CH (B)", str(error)) from error
        if max(outputs_mv) > MAX_MV:
            # The plain module holds 0..20000 microampere in the same registers.
            found = say(
                "an output of {outputs_mv}, so perhaps the 0-20 mA module",
                outputs_mv=max(outputs_mv),
            )
            raise _wrong(self.unit, "Waveshare Analog Output 8CH (B), 0-10 V", found)
        return _version_text(version)

    async def read(self) -> tuple[int, ...]:
        """Return all outputs [mV]."""
        self._known_mv = await self.unit.read_holding_registers(FIRST_CHANNEL, CHANNEL_COUNT)
        return self._known_mv

    async def known(self) -> tuple[int, ...]:
        """Return all outputs [mV]; read them only if they are not known."""
        return await self.read() if self._known_mv is None else self._known_mv

    async def write(self, wanted_mv: Sequence[int], *, force: bool) -> bool:
        """Set the outputs to the wanted voltages in one FC16; return whether anything was sent."""
        known_mv = self._known_mv
        first, last = 0, CHANNEL_COUNT - 1
        if known_mv is not None and not force:
            changed = [i for i in range(CHANNEL_COUNT) if wanted_mv[i] != known_mv[i]]
            if not changed:
                return False
            first, last = changed[0], changed[-1]
        self._known_mv = None
        await self.unit.write_registers(
            FIRST_CHANNEL + first, wanted_mv[first : last + 1], again=always
        )
        self._known_mv = tuple(wanted_mv)
        return True


class RelayModule:
    """Eight relays, one coil each.

    Parameters
    ----------
    link : the line it is on
    unit : its slave id
    spacing_s : least pause between two exchanges with it [cell s]
    """

    def __init__(self, link: ModbusLink, unit: int, spacing_s: float) -> None:
        probe = Request(FunctionCode.READ_COILS, FIRST_CHANNEL, CHANNEL_COUNT)
        self.unit = _unit(link, unit, key("relay module"), spacing_s, probe)
        self._known: tuple[bool, ...] | None = None

    async def identify(self) -> str:
        """Return the version; WrongDeviceError when this is not the relay module."""
        try:
            (version,) = await self.unit.read_holding_registers(VERSION_REGISTER, 1)
            await self.read()
        except RefusedError as error:
            raise _wrong(self.unit, "Waveshare Modbus RTU Relay 8CH", str(error)) from error
        return _version_text(version)

    async def read(self) -> tuple[bool, ...]:
        """Return for every relay whether it is closed."""
        self._known = await self.unit.read_coils(FIRST_CHANNEL, CHANNEL_COUNT)
        return self._known

    async def known(self) -> tuple[bool, ...]:
        """Return the relays; read them only if they are not known."""
        return await self.read() if self._known is None else self._known

    async def write(self, wanted: Sequence[bool], *, force: bool) -> bool:
        """Set the relays to the wanted state in one FC15; return whether anything was sent."""
        if self._known == tuple(wanted) and not force:
            return False
        self._known = None
        await self.unit.write_coils(FIRST_CHANNEL, wanted, again=always)
        self._known = tuple(wanted)
        return True


def _wrong(unit: ModbusUnit, expected: str, found: str) -> DeviceError:
    return WrongDeviceError(
        say(
            "{unit}: expected a {expected}, found {found}; check slave id and "
            "port, or which device is wired there",
            unit=unit,
            expected=expected,
            found=found,
        )
    )
