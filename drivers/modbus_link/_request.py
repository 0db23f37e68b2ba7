"""One Modbus request and the only reply that answers it. No link, no clock, no log.

RTU has no transaction number: a late reply looks like the answer to the last request, even
with another function code (modbus_devices.md 8.7). Everything that a reply repeats of its request
is therefore compared.
"""

from dataclasses import dataclass
from enum import IntEnum

from pymodbus.pdu import ExceptionResponse, ModbusPDU


class FunctionCode(IntEnum):
    """Function codes that the cell's devices use."""

    READ_COILS = 1
    READ_DISCRETE_INPUTS = 2
    READ_HOLDING_REGISTERS = 3
    READ_INPUT_REGISTERS = 4
    WRITE_COIL = 5
    WRITE_REGISTER = 6
    WRITE_COILS = 15
    WRITE_REGISTERS = 16


_READS_BITS = (FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS)
_READS_REGISTERS = (FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS)
_MAX_BITS = 2000  # Modbus application protocol V1.1b3, 6.1
_MAX_REGISTERS = 125  # the same, 6.3


@dataclass(frozen=True, slots=True)
class Request:
    """One request to a unit.

    Attributes
    ----------
    function : its function code
    address : first register or bit, zero based as on the wire
    count : registers or bits
    values : values to write; empty for a read
    """

    function: FunctionCode
    address: int
    count: int = 1
    values: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        limit = (
            _MAX_BITS
            if self.function in (*_READS_BITS, FunctionCode.WRITE_COILS)
            else _MAX_REGISTERS
        )
        if not 1 <= self.count <= limit:
            raise ValueError(f"count must be 1..{limit}, not {self.count}")
        if not 0 <= self.address <= 0x10000 - self.count:
            raise ValueError(f"address must be 0..{0x10000 - self.count}, not {self.address}")
        if not self.is_read and len(self.values) != self.count:
            raise ValueError(f"{len(self.values)} values for {self.count} places")
        if not all(0 <= value <= 0xFFFF for value in self.values):
            raise ValueError(f"registers hold 0..65535, not {self.values}")

    @property
    def is_read(self) -> bool:
        """Whether repeating it is harmless."""
        return self.function in _READS_BITS + _READS_REGISTERS

    def __str__(self) -> str:
        what = f"{self.function.name.lower()} 0x{self.address:04X}"
        return f"{what} x {self.count}" if self.is_read else f"{what} = {list(self.values)}"

    def is_answered_by(self, reply: ModbusPDU) -> bool:
        """Return whether a reply fits the request: same function, place, size and echo."""
        if isinstance(reply, ExceptionResponse):
            return reply.function_code & 0x7F == self.function
        if reply.function_code != self.function:
            return False
        if self.function in _READS_BITS:
            return len(reply.bits) == (self.count + 7) // 8 * 8  # pymodbus pads to whole bytes
        if self.function in _READS_REGISTERS:
            return len(reply.registers) == self.count
        if reply.address != self.address:
            return False
        match self.function:
            case FunctionCode.WRITE_COIL:
                return bool(reply.bits[0]) == bool(self.values[0])
            case FunctionCode.WRITE_REGISTER:
                return reply.registers[0] == self.values[0]
            case _:
                return reply.count == self.count

    def looks_like(self, other: "Request") -> bool:
        """Return whether the other's reply could pass for the answer to this one."""
        if self.function != other.function:
            return False
        if self.function in _READS_BITS:
            return (self.count + 7) // 8 == (other.count + 7) // 8
        if self.function in _READS_REGISTERS:
            return self.count == other.count
        return self.address == other.address and self.count == other.count
