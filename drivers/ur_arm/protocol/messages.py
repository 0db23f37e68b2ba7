"""Messages on the script port: what the controller says of a refused line (§4.3).

Sections (§) are those of ur.md.
"""

import struct
from typing import Final

from messages import say

__all__ = ["MessageReader", "message_text"]

HEADER: Final = struct.Struct(">IB")  # size with the header, type
ROBOT_MESSAGE: Final = 20
MAX_SIZE: Final = 1 << 16  # a state package is about 1 kB
_OF_MESSAGE: Final = struct.Struct(">Qbb")  # time stamp, source, kind
# bytes before the text, by kind; the title of a key message is cut off too
_TEXT, _ERROR_CODE, _KEY, _EXCEPTION = 0, 6, 7, 10
_BEFORE: Final = {_TEXT: 0, _ERROR_CODE: 20, _KEY: 8, _EXCEPTION: 8}


class MessageReader:
    """Cuts the stream of the script port into packages, and returns the messages in it."""

    def __init__(self) -> None:
        self._data = bytearray()

    def feed(self, data: bytes) -> list[str]:
        """Return the texts of messages that are whole now; other packages are dropped.

        A stream that is not one of packages is dropped as a whole: nothing depends on it.
        """
        self._data += data
        found = []
        while len(self._data) >= HEADER.size:
            size, kind = HEADER.unpack_from(self._data)
            if not HEADER.size <= size <= MAX_SIZE:
                self._data.clear()
                break
            if len(self._data) < size:
                break
            body = bytes(self._data[HEADER.size : size])
            del self._data[:size]
            if kind == ROBOT_MESSAGE and (text := message_text(body)):
                found.append(text)
        return found


def message_text(body: bytes) -> str:
    """Return the text of a robot message, empty for one that reports nothing wrong.

    Parameters
    ----------
    body : package without its header
    """
    if len(body) < _OF_MESSAGE.size:
        return ""
    kind = _OF_MESSAGE.unpack_from(body)[2]
    rest = body[_OF_MESSAGE.size :]
    if kind not in _BEFORE or len(rest) < _BEFORE[kind]:
        return ""
    text = rest[_BEFORE[kind] :]
    if kind == _KEY and text:
        text = text[1 + text[0] :]
    words = text.decode("utf-8", "replace").strip("\0 \r\n")
    if kind == _EXCEPTION:
        line, column = struct.unpack_from(">ii", rest)
        return say("line {line}, column {column}: {words}", line=line, column=column, words=words)
    if kind == _ERROR_CODE:
        code, argument = struct.unpack_from(">ii", rest)
        return f"C{code}A{argument}{': ' if words else ''}{words}"
    return words
