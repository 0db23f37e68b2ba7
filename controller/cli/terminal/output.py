"""The output of commands: JSON lines for machines on stdout, sentences for people.

Once the terminal is closed or the reader of a pipe has left, output is lost and nothing fails,
least of all the stop of an arm. File names may hold bytes that are no text, or that control a
terminal, so all output is made printable first.

A command that moves something writes within `relayed`: then a thread writes, and a terminal that
was stopped or a pipe that nobody empties holds nothing up.
"""

import json
import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import IO, Any, TextIO, cast

from rich.console import Console

from messages.form import KEYS_ASKED, with_said

from .relay import TextRelay, write_whole

_relays: dict[str, TextRelay] = {}  # by the stream's name, while a thread writes


class _Door:
    """A standard stream, looked up on each use; drops its output once nobody reads it.

    Parameters
    ----------
    name : name of the stream
    is_live : True if the text may be left out for a slow reader
    """

    def __init__(self, name: str, *, is_live: bool = False) -> None:
        self._name = name
        self._is_live = is_live
        self.is_gone = False

    @property
    def _stream(self) -> TextIO:
        return cast(TextIO, getattr(sys, self._name))

    def write(self, text: str) -> int:
        """Write, or have a thread write; drop the text once nobody reads it."""
        if relay := _relays.get(self._name):
            relay.put(self._write_whole, text, is_live=self._is_live)
            return len(text)
        try:
            return self._stream.write(text)
        except (OSError, ValueError):  # ValueError: the stream was closed
            self._give_up()
            return len(text)

    def _write_whole(self, text: str) -> None:
        try:
            write_whole(self._stream, text)
        except (OSError, ValueError):
            self._give_up()

    def flush(self) -> None:
        """Flush; drop the text once nobody reads it."""
        if self._name in _relays:
            return
        try:
            self._stream.flush()
        except (OSError, ValueError):
            self._give_up()

    def _give_up(self) -> None:
        self.is_gone = True
        self.drop()

    def drop(self) -> None:
        """Discard everything written to the stream from now on."""
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
_live_out, _live_err = _Door("stdout", is_live=True), _Door("stderr", is_live=True)
log_stream = cast(TextIO, _live_err)  # of log handlers
stdout = Console(file=cast(IO[str], _out), highlight=False, soft_wrap=True)
stderr = Console(file=cast(IO[str], _err), highlight=False, soft_wrap=True)


def is_output_gone() -> bool:
    """Return whether a reader of the output has left."""
    return any(door.is_gone for door in (_out, _err, _live_out, _live_err))


@contextmanager
def relayed() -> Iterator[None]:
    """Have a thread write all output of the block; in the end wait for its reader to take it.

    Texts still unwritten are dropped, so that the process can end. Live lines that were left out
    are counted, and reported on stderr.
    """
    if _relays:
        yield
        return
    for door in (_out, _err):
        door.flush()
    out = TextRelay()
    # in their order, where both are one terminal or one file
    _relays.update(stdout=out, stderr=out if _is_one_file() else TextRelay())
    try:
        yield
    finally:
        if lost_count := lost_line_count():
            warn(f"{lost_count} lines of progress were left out: the output was not read in time")
        for name, relay in tuple(_relays.items()):
            if not relay.finish():
                (_out if name == "stdout" else _err).drop()
        _relays.clear()


def _is_one_file() -> bool:
    """Return whether stdout and stderr go to the same place."""
    try:
        return os.path.sameopenfile(sys.stdout.fileno(), sys.stderr.fileno())
    except (OSError, ValueError, AttributeError):
        return False


def lost_line_count() -> int:
    """Return the number of live lines that a slow reader has lost so far."""
    return sum(relay.lost_count for relay in {id(one): one for one in _relays.values()}.values())


def is_output_behind() -> bool:
    """Return whether the reader of stderr has not taken everything yet."""
    return "stderr" in _relays and _relays["stderr"].is_behind


def emit(body: Mapping[str, Any], *, is_live: bool = False) -> None:
    """Print one JSON object on a line of its own; a live one may be left out (`relayed`)."""
    text = json.dumps(with_said(body), ensure_ascii=False, separators=(",", ":"))
    door = _live_out if is_live else _out
    door.write(_encodable(text, sys.stdout.encoding) + "\n")
    door.flush()


def print_line(text: str, *, style: str | None = None) -> None:
    """Print a sentence for people on stdout."""
    stdout.print(printable(text, stdout.encoding), style=style, markup=False)


def warn(text: str) -> None:
    """Print a sentence for people on stderr."""
    stderr.print(printable(text, stderr.encoding), markup=False)


def refuse(error: object) -> None:
    """Print on stderr why a command does not do what it was asked to.

    For the page, which puts it into words, as JSON with key and values of the sentence
    (`KEYS_ASKED`).
    """
    if KEYS_ASKED in os.environ:
        body = with_said({"event": "refused", "error": str(error)})
        write_error_line(json.dumps(body, ensure_ascii=False))
    else:
        warn(f"cellctl: {error}")


def write_error_line(text: str, *, is_live: bool = False) -> None:
    """Write a line unchanged on stderr, neither wrapped nor marked up; see `emit`."""
    door = _live_err if is_live else _err
    door.write(printable(text, sys.stderr.encoding) + "\n")
    door.flush()


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
