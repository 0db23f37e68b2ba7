"""What commands print: JSON lines for machines on stdout, sentences for people.

Once the terminal is closed or the reader of a pipe has left, output is lost and nothing fails,
least of all the stop of an arm. File names may hold bytes that are no text, or that control a
terminal, so all output is made printable first.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import IO, Any, cast

from rich.console import Console


class _Door:
    """A standard stream, looked up on each use; drops what is written once nobody reads it."""

    def __init__(self, name: str) -> None:
        self._name = name
        self.is_gone = False

    @property
    def _stream(self) -> IO[str]:
        return cast(IO[str], getattr(sys, self._name))

    def write(self, text: str) -> int:
        """Write; drop the text once nobody reads it."""
        try:
            return self._stream.write(text)
        except (OSError, ValueError):  # ValueError: the stream was closed
            self._give_up()
            return len(text)

    def flush(self) -> None:
        """Flush; drop the text once nobody reads it."""
        try:
            self._stream.flush()
        except (OSError, ValueError):
            self._give_up()

    def _give_up(self) -> None:
        self.is_gone = True
        # what is still buffered must not fail again when the process ends
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
    """Return whether a reader of the output has left."""
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


def write_error_line(text: str) -> None:
    """Write a line as it is on stderr, neither wrapped nor marked up."""
    _err.write(printable(text, sys.stderr.encoding) + "\n")
    _err.flush()


def write_control(text: str) -> None:
    """Write control sequences to the terminal that stdout is; our own alone."""
    _out.write(text)
    _out.flush()


def printable(text: str, encoding: str | None = "utf-8") -> str:
    """Return a text with unprintable characters spelt out as escapes."""
    shown = "".join(
        c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape").decode() for c in text
    )
    return _encodable(shown, encoding)


def _encodable(text: str, encoding: str | None) -> str:
    encoding = encoding or "utf-8"
    return text.encode(encoding, errors="backslashreplace").decode(encoding)
