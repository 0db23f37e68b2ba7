"""What the commands print: JSON lines for machines on stdout, sentences for people.

A terminal may be closed, and the reader of a pipe may leave: what is printed afterwards is lost,
and nothing fails for it, least of all the stop of an arm.
Names of files may be no text, and may hold what turns a terminal's colours round. So what is
printed is made printable first.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any, cast

from rich.console import Console


class _Door:
    """A standard stream, looked up anew each time, that turns to nothing once nobody reads it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.is_gone = False

    @property
    def _stream(self) -> IO[str]:
        return cast(IO[str], getattr(sys, self._name))

    def write(self, text: str) -> int:
        """Write, or lose what nobody can read any more."""
        try:
            return self._stream.write(text)
        except (OSError, ValueError):  # the latter: a stream that was closed
            self._give_up()
            return len(text)

    def flush(self) -> None:
        """Flush, or lose what nobody can read any more."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            self._give_up()

    def _give_up(self) -> None:
        self.is_gone = True
        # what the stream still holds must not fail again at the end of the process
        with suppress(OSError, ValueError):
            nothing = os.open(os.devnull, os.O_WRONLY)
            try:
                os.dup2(nothing, self._stream.fileno())
            finally:
                os.close(nothing)

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401  (whatever the stream has)
        return getattr(self._stream, name)


_out, _err = _Door("stdout"), _Door("stderr")
stdout = Console(file=cast(IO[str], _out), highlight=False, soft_wrap=True)
stderr = Console(file=cast(IO[str], _err), highlight=False, soft_wrap=True)


def is_output_gone() -> bool:
    """Return whether somebody who read what is printed has left."""
    return _out.is_gone or _err.is_gone


def emit(body: Mapping[str, Any]) -> None:
    """Print one JSON object on a line of its own."""
    text = json.dumps(body, ensure_ascii=False, separators=(",", ":"))
    _out.write(_encodable(text, sys.stdout.encoding) + "\n")
    _out.flush()


def print_line(text: str, *, style: str | None = None) -> None:
    """Print a sentence for people on stdout."""
    stdout.print(printable(text, stdout.encoding), style=style, markup=False)


def warn(text: str) -> None:
    """Print a sentence for people on stderr."""
    stderr.print(printable(text, stderr.encoding), markup=False)


def printable(text: str, encoding: str | None = "utf-8") -> str:
    """Return a text with what no terminal should get spelt out, as an escape."""
    shown = "".join(
        c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text
    )
    return _encodable(shown, encoding)


def _encodable(text: str, encoding: str | None) -> str:
    encoding = encoding or "utf-8"
    return text.encode(encoding, errors="backslashreplace").decode(encoding)
