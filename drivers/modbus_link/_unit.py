"""One device on a link: its unit id, its pace, and reads and writes in its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ._request import FunctionCode, Request

if TYPE_CHECKING:
    from ._link import ModbusLink


@dataclass(frozen=True, slots=True)
class ModbusUnit:
    """The way to one device; got from `ModbusLink.unit`.

    Each method raises what `ModbusLink.exchange` raises. Addresses are zero based, as on the wire.

    Attributes
    ----------
    link : the line it is on
    unit : its unit id
    name : what messages call it
    spacing_s : least pause between two exchanges [cell s]
    probes : harmless reads to resynchronise with
    check : what to check when it is silent
    """

    link: ModbusLink
    unit: int
    name: str
    spacing_s: float
    probes: tuple[Request, ...]
    check: str

    def __post_init__(self) -> None:
        if not 1 <= self.unit <= 255:
            raise ValueError(f"{self.name}: unit must be 1..255, not {self.unit}")

    def __str__(self) -> str:
        return f"{self.name} (unit {self.unit} at {self.link.address})"

    async def read_coils(self, address: int, count: int) -> tuple[bool, ...]:
        """Read coils (FC01)."""
        return await self._bits(FunctionCode.READ_COILS, address, count)

    async def read_discrete_inputs(self, address: int, count: int) -> tuple[bool, ...]:
        """Read discrete inputs (FC02)."""
        return await self._bits(FunctionCode.READ_DISCRETE_INPUTS, address, count)

    async def read_holding_registers(self, address: int, count: int) -> tuple[int, ...]:
        """Read holding registers (FC03)."""
        request = Request(FunctionCode.READ_HOLDING_REGISTERS, address, count)
        return await self.link.exchange(request, self)

    async def read_input_registers(self, address: int, count: int) -> tuple[int, ...]:
        """Read input registers (FC04)."""
        request = Request(FunctionCode.READ_INPUT_REGISTERS, address, count)
        return await self.link.exchange(request, self)

    async def write_coil(self, address: int, value: bool) -> None:
        """Write one coil (FC05)."""
        request = Request(FunctionCode.WRITE_COIL, address, 1, (int(value),))
        await self.link.exchange(request, self)

    async def write_register(self, address: int, value: int) -> None:
        """Write one register (FC06)."""
        request = Request(FunctionCode.WRITE_REGISTER, address, 1, (value,))
        await self.link.exchange(request, self)

    async def write_coils(self, address: int, values: Sequence[bool]) -> None:
        """Write several coils in one request (FC15)."""
        bits = tuple(int(value) for value in values)
        await self.link.exchange(Request(FunctionCode.WRITE_COILS, address, len(bits), bits), self)

    async def write_registers(self, address: int, values: Sequence[int]) -> None:
        """Write several registers in one request (FC16)."""
        words = tuple(values)
        request = Request(FunctionCode.WRITE_REGISTERS, address, len(words), words)
        await self.link.exchange(request, self)

    async def _bits(self, function: FunctionCode, address: int, count: int) -> tuple[bool, ...]:
        bits = await self.link.exchange(Request(function, address, count), self)
        return tuple(bool(bit) for bit in bits)
