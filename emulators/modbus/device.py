"""A bus's requirement on a device: take a request PDU, give a reply PDU or keep silent."""

from typing import Final, Protocol

EXCEPTION_BIT: Final = 0x80
ILLEGAL_FUNCTION: Final = 0x01
ILLEGAL_ADDRESS: Final = 0x02
ILLEGAL_VALUE: Final = 0x03
GATEWAY_TARGET_SILENT: Final = 0x0B


class ModbusDevice(Protocol):
    """One device behind a unit number.

    Attributes
    ----------
    unit : the number it answers to, 1 to 255; a master may change it
    hears_broadcast : True if requests to unit 0 reach it
    """

    unit: int
    hears_broadcast: bool

    def request(self, pdu: bytes, now_s: float) -> bytes | None:
        """Carry out one request and return the reply; None is silence.

        Parameters
        ----------
        pdu : function code and data
        now_s : instant at which the request was complete [world s]
        """
        ...


class RefusedRequest(Exception):  # noqa: N818 (an outcome of the protocol, not an error of ours)
    """A request that a device answers with an exception.

    Attributes
    ----------
    code : the Modbus exception code
    """

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code:02X}")
        self.code = code


def exception_pdu(function: int, code: int) -> bytes:
    """Return the PDU of an exception reply."""
    return bytes(((function | EXCEPTION_BIT) & 0xFF, code))
