"""The Robotiq URCap's server on the controller: the gripper's registers as lines of text.

It passes on to the gripper what a client sets and reads it back; what a value means is the
gripper's own affair (`emulators.gripper_modbus`); universal_robots.md 6.
"""

import struct
from typing import Final

from emulators.gripper_modbus import RobotiqDevice

_OUTPUT_START, _INPUT_START = 0x03E8, 0x07D0
_BYTE_COUNT: Final = 6
# Where a variable stands: byte, lowest bit and width in the six bytes of outputs or inputs
_OUTPUTS: Final = {
    "ACT": (0, 0, 1),
    "GTO": (0, 3, 1),
    "ATR": (0, 4, 1),
    "ARD": (0, 5, 1),
    "POS": (3, 0, 8),
    "SPE": (4, 0, 8),
    "FOR": (5, 0, 8),
}
_INPUTS: Final = {
    "STA": (0, 4, 2),
    "OBJ": (0, 6, 2),
    "FLT": (2, 0, 8),
    "PRE": (3, 0, 8),
    "POS": (4, 0, 8),  # read, it is where the fingers are
    "COU": (5, 0, 8),
}
ACK: Final = b"ack"
UNKNOWN: Final = b"?"
LINE_BYTES_MAX: Final = 1024


class UrcapSession:
    """One client of the URCap's port.

    Parameters
    ----------
    gripper : the gripper on the flange
    """

    def __init__(self, gripper: RobotiqDevice) -> None:
        self._gripper = gripper
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the replies to the lines that are complete now, each on its own."""
        self._rest += data
        replies = []
        while (cut := self._rest.find(b"\n")) >= 0:
            line, self._rest = self._rest[:cut], self._rest[cut + 1 :]
            replies.append(self._answer(line.decode("ascii", "replace").split()))
        if len(self._rest) > LINE_BYTES_MAX:
            self._rest = b""
        return replies

    def _answer(self, words: list[str]) -> bytes:
        match words:
            case ["GET", name]:
                value = self._get(name)
                return UNKNOWN if value is None else f"{name} {value}".encode()
            case ["SET", *pairs] if pairs and len(pairs) % 2 == 0:
                return ACK if self._set(pairs[::2], pairs[1::2]) else UNKNOWN
        return UNKNOWN

    def _get(self, name: str) -> int | None:
        if name == "SID":
            return self._gripper.unit
        if name in _INPUTS:
            place, start = _INPUTS[name], _INPUT_START
        elif name in _OUTPUTS:
            return None if not self._gripper.is_powered else _bits(self._written, _OUTPUTS[name])
        else:
            return None
        reply = self._gripper.request(struct.pack(">BHH", 0x03, start, _BYTE_COUNT // 2), 0.0)
        return None if reply is None else _bits(reply[2:], place)

    @property
    def _written(self) -> bytes:
        """The outputs as they stand in the gripper, whoever wrote them."""
        return self._gripper.written

    def _set(self, names: list[str], texts: list[str]) -> bool:
        outputs = bytearray(self._written)
        for name, text in zip(names, texts, strict=True):
            if name == "SID":
                if text != str(self._gripper.unit):
                    return False
                continue
            if name not in _OUTPUTS or not text.isdecimal():
                return False
            byte, low, width = _OUTPUTS[name]
            value = int(text)
            if value >= 1 << width:
                return False
            mask = ((1 << width) - 1) << low
            outputs[byte] = outputs[byte] & ~mask | value << low
        pdu = struct.pack(">BHHB", 0x10, _OUTPUT_START, _BYTE_COUNT // 2, _BYTE_COUNT)
        return self._gripper.request(pdu + bytes(outputs), 0.0) is not None


def _bits(data: bytes, place: tuple[int, int, int]) -> int:
    byte, low, width = place
    return data[byte] >> low & ((1 << width) - 1)
