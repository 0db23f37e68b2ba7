"""The text of a STEP file as the kernel reads it: UTF-8, from any encoding of other programs.

ISO 10303-21 wants names in ASCII with escapes; the kernel takes UTF-8 as well. Other programs write
the code page of their computer, which the file does not name.
"""

import re
from pathlib import Path
from typing import Final

from controller.config.files import encoding_of, utf8_of

from ...errors import CoordinatesCadError, UnreadableCadError

# A comment or a string; an apostrophe in a comment begins no string.
STRING: Final = re.compile(rb"/\*.*?\*/|'(?:[^']|'')*'", re.DOTALL)
HEAD: Final = rb"#(\d+)\s*=\s*(CARTESIAN_POINT|DIRECTION)\s*\(\s*'(?:[^']|'')*'\s*,\s*\("
TOO_MANY: Final = re.compile(HEAD + rb"(?:[^,()]*,){3}")
# 1e12 mm is farther than any part; single precision ends at 1e38, double at 1e308
BEYOND: Final = re.compile(HEAD + rb"[^()]*?([-+]?\d[\d.]*[Ee]\+?(?:1[2-9]|[2-9]\d|\d{3,}))\b")
CODE_PAGE_TEXT: Final = "Names in the file are not UTF-8; they were read as code page 1252."


def has_code_page(data: bytes) -> bool:
    """Return True if a file's text is in a code page that it does not name."""
    if encoding_of(data) != "utf-8-sig":
        return False
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return True
    return False


def for_kernel(data: bytes) -> bytes:
    r"""Return a file's text in UTF-8, lines ended by a line feed.

    A string that is not UTF-8 is read as code page 1252; the five undefined bytes are shown by
    number, as ``\x81``.
    """
    data = utf8_of(data)
    if has_code_page(data):
        data = STRING.sub(lambda found: _in_utf8(found[0]), data)
        data = data.decode("utf-8", errors="replace").encode()
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def _in_utf8(text: bytes) -> bytes:
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        # the escape of a backslash in a STEP file is two of them
        return text.decode("cp1252", errors="backslashreplace").replace("\\x", r"\\x").encode()
    return text


def check_numbers(path: Path, text: bytes) -> None:
    """Refuse points that the kernel would silently misread.

    Parameters
    ----------
    path : path of the file, for messages
    text : as `for_kernel` returns it

    Raises
    ------
    UnreadableCadError : a point has more than three coordinates, as with decimal commas
    CoordinatesCadError : a coordinate is beyond sense
    """
    if match := TOO_MANY.search(text):
        raise UnreadableCadError(
            f"{path}: #{match[1].decode()} is a {match[2].decode()} of more than three numbers; "
            "are its decimals written with commas? Export it with decimal points"
        )
    if match := BEYOND.search(text):
        raise CoordinatesCadError(
            f"{path}: #{match[1].decode()}, a {match[2].decode()}, holds {match[3].decode():.40}, "
            "which is beyond sense; export it again"
        )
