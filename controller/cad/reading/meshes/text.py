"""Texts of mesh files from other programs: encodings, line ends, decimal commas.

Only the words of the format and its numbers count. Names and comments are never decoded, so they
may be in any code page.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.config.files import utf8_of

from ...errors import CadError, CoordinatesCadError, UnreadableCadError

NUMBER: Final = rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
WHOLE_NUMBER: Final = re.compile(NUMBER)
COMMA_NUMBER: Final = re.compile(rb"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
NOT_FINITE: Final = re.compile(rb"(?i)[-+]?(?:nan|inf|1\.#).*")


@dataclass(frozen=True, slots=True, eq=False)
class MeshText:
    """The text of a mesh file in bytes, lines ended by a line feed, without a byte order mark."""

    path: Path
    data: bytes

    @classmethod
    def of(cls, data: bytes, path: Path) -> "MeshText":
        """Return a file's text.

        Parameters
        ----------
        data : UTF-8 or any code page that agrees with ASCII; UTF-16 or UTF-32 is converted
        path : path of the file, for messages

        Raises
        ------
        UnreadableCadError : it is no text
        """
        data = utf8_of(data)
        if (at := data.find(b"\0")) >= 0:
            raise UnreadableCadError(
                f"{path}: byte {at} is not text; is it the right file? export it again"
            )
        return cls(path, data.replace(b"\r\n", b"\n").replace(b"\r", b"\n"))

    def error(self, at: int, problem: str, kind: type[CadError] = UnreadableCadError) -> CadError:
        """Return the error for a fault at a byte.

        Parameters
        ----------
        at : byte of the text
        problem : description of the error, as it follows the line number
        kind : kind of the error
        """
        line = self.data.count(b"\n", 0, at) + 1
        return kind(f"{self.path}: line {line}: {problem}; export it again")

    def no_number(self, at: int, token: bytes) -> CadError:
        """Return the error for a token in a number's place."""
        word = token.decode(errors="replace")
        if NOT_FINITE.fullmatch(token) or WHOLE_NUMBER.fullmatch(token):
            return self.error(at, f"{word:.40} is no finite number", CoordinatesCadError)
        return self.error(at, f"{word!r:.40} is no number")

    def number(self, at: int, token: bytes) -> float:
        """Return a number of the line at a byte.

        Raises
        ------
        CoordinatesCadError : not finite
        UnreadableCadError : no number
        """
        if WHOLE_NUMBER.fullmatch(token) is None:
            raise self.no_number(at, token)
        value = float(token)
        if value - value != 0.0:
            raise self.no_number(at, token)
        return value

    def with_points(self, rows: "re.Pattern[bytes]") -> "MeshText":
        """Return the text with decimal points in place of decimal commas.

        ``1,5 2,5 3,0`` has one plain meaning, provided that no number of the file has a point;
        otherwise a comma may separate thousands, or one number from the next.

        Parameters
        ----------
        rows : matches whatever holds lengths

        Raises
        ------
        UnreadableCadError : commas of another meaning
        """
        if b"," not in self.data:
            return self
        comma = point = -1
        for row in rows.finditer(self.data):
            if point < 0 and b"." in row[0]:
                point = row.start()
            if b"," not in row[0]:
                continue
            comma = row.start() if comma < 0 else comma
            for token in row[0].split():
                if b"," in token and COMMA_NUMBER.fullmatch(token) is None:
                    raise self.error(
                        row.start(),
                        f"{token.decode(errors='replace')!r:.40} is no number; numbers are "
                        "written with a decimal point and kept apart by blanks",
                    )
        if comma >= 0 and point >= 0:
            point_line = self.data.count(b"\n", 0, point) + 1
            raise self.error(
                comma,
                f"has a comma in a number, line {point_line} a point; with both, a comma may stand "
                "for a decimal point or for thousands",
            )
        if comma < 0:
            return self
        swap: Callable[[re.Match[bytes]], bytes] = lambda row: row[0].replace(b",", b".")  # noqa: E731
        return MeshText(self.path, rows.sub(swap, self.data))
