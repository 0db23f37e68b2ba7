"""The source of a jog's orders: keys in a terminal, or lines of a file or a pipe."""

import asyncio
import os
import shutil
import stat
import sys
import termios
import tty
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from controller.bring_up.jogging import ArmReading
from controller.cell.operator import Answer, Question
from controller.config import ConfigError
from controller.config.files import read_text

from ..terminal.output import emit, print_line, printable, warn, write_control

KEYS: Final[Mapping[str, str]] = {
    **{key: f"joint {n} +" for n, key in enumerate("qwerty", 1)},
    **{key: f"joint {n} -" for n, key in enumerate("asdfgh", 1)},
    "i": "x +", "k": "x -", "j": "y +", "l": "y -", "u": "z +", "o": "z -",
    ".": "advance +", ",": "advance -",
    "v": "heading +", "b": "heading -", "n": "tilt +", "m": "tilt -", "c": "spin +", "x": "spin -",
    "1": "step 1", "2": "step 2", "3": "step 3", "7": "speed 5", "8": "speed 10", "9": "speed 25",
    "=": "open arm", "-": "close arm", ">": "open fixed", "<": "close fixed",
    "!": "home", "p": "park", "\r": "take", "\n": "take", "Q": "quit", "\x04": "quit",
}  # fmt: skip
HELP: Final = """\
joints 1 to 6     + q w e r t y     - a s d f g h
TCP in the world  x + i, - k     y + j, - l     z + u, - o
TCP on its way    forward .  back ,     heading v b     tilt n m     spin about it c x
step 1 2 3        speed 5 % 7, 10 % 8, 25 % 9
arm gripper       open =  close -      fixed gripper  open >  close <
home !   park p   typed order : (motor, lamp, amounts)   this page ?   quit Q
STOP              space or Esc; Ctrl-C stops and ends"""
ESC: Final = "\x1b"
STOPS: Final = (" ", ESC)
# Bytes that follow an Esc within this time are the rest of an arrow or function key, and no order.
REST_OF_KEY_WALL_S: Final = 0.1
MAX_SCRIPT_BYTES: Final = 1 << 20


@contextmanager
def single_keys(fd: int) -> Iterator[None]:
    """Have a terminal pass on each key at once and unseen; restore it afterwards.

    Ctrl-C still interrupts. A terminal that is gone by then is left alone.

    Parameters
    ----------
    fd : descriptor of the terminal
    """
    before = termios.tcgetattr(fd)
    try:
        tty.setcbreak(fd, termios.TCSANOW)
        yield
    finally:
        with suppress(termios.error, OSError):
            termios.tcflush(fd, termios.TCIFLUSH)
            termios.tcsetattr(fd, termios.TCSANOW, before)


class _Input:
    """Bytes of standard input as they arrive, on the event loop."""

    def __init__(self, on_text: Callable[[str], None]) -> None:
        self._on_text = on_text

    @contextmanager
    def heard(self, fd: int) -> Iterator[None]:
        """Pass on the input while the block runs; an empty text is the end."""
        loop = asyncio.get_running_loop()

        def read() -> None:
            try:
                data = os.read(fd, 4096)
            except BlockingIOError:
                return
            except OSError:  # the terminal is gone
                data = b""
            if not data:
                loop.remove_reader(fd)
            self._on_text(data.decode(errors="replace"))

        loop.add_reader(fd, read)
        try:
            yield
        finally:
            loop.remove_reader(fd)


class KeyPilot:
    """A person at a terminal.

    Keys pressed while something moves are dropped, so that nothing moves on after the key is
    released; a stop key works at any time.

    Parameters
    ----------
    who : they are
    fd : descriptor of the terminal
    takes : meaning of Enter; empty if it takes nothing
    """

    is_live = True
    ends_at_refusal = False

    def __init__(self, who: str, fd: int, takes: str = "") -> None:
        self._who = f"{who} at the terminal"
        self._fd = fd
        self._takes = takes
        self._keys: asyncio.Queue[str] | None = None
        self._stop = asyncio.Event()
        self._is_gone = False
        self._deaf_until_s = 0.0
        self._is_typing = False
        self._shown: list[str] = []

    @contextmanager
    def heard(self) -> Iterator[None]:
        """Hear keys while the block runs."""
        with single_keys(self._fd), _Input(self._on_text).heard(self._fd):
            self._write(HELP + (f"\nEnter             {self._takes}" if self._takes else ""))
            try:
                yield
            finally:
                self._erase()

    def _on_text(self, text: str) -> None:
        if not text:
            self._is_gone = True
        now_s = asyncio.get_running_loop().time()
        for key in text:
            # a space within a typed order is a letter of it
            self._is_typing = (self._is_typing or key == ":") and key not in "\r\n" + ESC
            if key in STOPS and not self._is_typing:
                self._stop.set()
            if now_s < self._deaf_until_s and key not in STOPS:
                continue
            if key == ESC:
                self._deaf_until_s = now_s + REST_OF_KEY_WALL_S
            if self._keys is not None:
                self._keys.put_nowait(key)
        if self._is_gone:
            self._stop.set()
            if self._keys is not None:
                self._keys.put_nowait("")

    @contextmanager
    def _listening(self) -> Iterator[None]:
        """Take keys while the block runs; at all other times they are dropped."""
        self._keys = asyncio.Queue()
        try:
            yield
        finally:
            self._keys = None

    async def _key(self) -> str:
        """Return the next key; empty once the terminal is gone."""
        assert self._keys is not None, "somebody is listening"
        return "" if self._is_gone else await self._keys.get()

    async def order(self) -> str | None:
        """Return the order of the next key that has one; None once the terminal is gone."""
        self._stop.clear()
        self._is_typing = False
        with self._listening():
            while key := await self._key():
                if key in STOPS:
                    return "stop"
                if key == "?":
                    self._write(HELP)
                elif key == ":":
                    if text := await self._typed():
                        return text
                elif key in KEYS and (self._takes or KEYS[key] != "take"):
                    return KEYS[key]
        return None

    async def _typed(self) -> str:
        """Return an order typed letter by letter; empty if it was given up."""
        text = ""
        self._erase()
        write_control("order: ")
        while key := await self._key():
            if key in "\r\n" or key == ESC:
                write_control("\n")
                return "" if key == ESC else text
            if key in "\x7f\b":
                text = text[:-1]
            elif key.isprintable():
                text += key
            write_control("\r\x1b[Korder: " + printable(text))
        return ""

    async def wants_stop(self) -> None:
        """Return once a stop key was pressed since the order, or the terminal is gone."""
        await self._stop.wait()

    async def decide(self, question: Question) -> Answer | None:
        """Return the answer given by key; None once the terminal is gone."""
        choices = question.choices
        lines = [question.text]
        lines += [f"  {n}  {choice.words}" for n, choice in enumerate(choices, 1)]
        self._write("\n".join(lines))
        last = str(len(choices)) if len(choices) > 1 else ""
        with self._listening():
            while key := await self._key():
                key = {"y": "1", "n": last, " ": last, ESC: last}.get(key, key)
                if key.isdigit() and 1 <= int(key) <= len(choices):
                    return Answer(choices[int(key) - 1].key, self._who)
                self._write(f"press a key from 1 to {len(choices)}; y is 1")
        return None

    # ---- what is seen ----------------------------------------------------------------------------
    def show(self, reading: ArmReading) -> None:
        """Write the arm's state over the earlier one."""
        columns = max(20, shutil.get_terminal_size().columns - 1)
        lines = [line[:columns] for line in reading.words.split(" | ")]
        if self._shown != lines:
            self._erase()
            write_control("\n".join(lines) + "\n")
            self._shown = lines

    def done(self, order: str, words: str) -> None:
        """Write the result of an order."""
        if words:
            self._write(words)

    def refused(self, order: str, why: str) -> None:
        """Write why an order was not carried out."""
        self._write(f"not done: {order}: {why}", style="bold red")

    def _write(self, text: str, *, style: str | None = None) -> None:
        self._erase()
        print_line(text, style=style)

    def _erase(self) -> None:
        if self._shown:
            write_control(f"\r\x1b[{len(self._shown)}A\x1b[J")
            self._shown = []


class LinePilot:
    """Orders line by line; a refused one ends them.

    Parameters
    ----------
    answers : give each question its first choice, on an emulated cell alone
    as_json : print JSON lines
    """

    is_live = False
    ends_at_refusal = True

    def __init__(self, *, answers: bool, as_json: bool) -> None:
        self._answers = answers
        self._as_json = as_json
        self._lines: asyncio.Queue[str | None] = asyncio.Queue()
        self._rest = ""
        self._stop = asyncio.Event()

    @contextmanager
    def heard(self, source: Path | None) -> Iterator[None]:
        """Read lines while the block runs.

        Parameters
        ----------
        source : file of orders, None for standard input

        Raises
        ------
        ConfigError : the file cannot be read
        """
        if source is not None or stat.S_ISREG(os.fstat(sys.stdin.fileno()).st_mode):
            self._on_text(sys.stdin.read() if source is None else script_text(source))
            self._on_text("")
            yield
            return
        with _Input(self._on_text).heard(sys.stdin.fileno()):
            yield

    def _on_text(self, text: str) -> None:
        *lines, self._rest = (self._rest + text).split("\n")
        if not text:
            lines, self._rest = [self._rest], ""
        for line in lines:
            order = line.split("#")[0].strip()
            if order == "stop":
                self._stop.set()
            if order:
                self._lines.put_nowait(order)
        if not text:
            self._lines.put_nowait(None)

    async def order(self) -> str | None:
        """Return the next line that holds an order; None after the last one."""
        self._stop.clear()
        line = await self._lines.get()
        if line is None:
            self._lines.put_nowait(None)
        return line

    async def wants_stop(self) -> None:
        """Return once a line `stop` has arrived since the order."""
        await self._stop.wait()

    async def decide(self, question: Question) -> Answer | None:
        """Return the first choice if a helper answers; else nobody is there."""
        if not self._answers:
            return None
        return Answer(question.choices[0].key, "--yes")

    def show(self, reading: ArmReading) -> None:
        """Print the arm's state."""
        if not self._as_json:
            print_line(reading.words)
            return
        T = reading.T_world_tcp
        emit(
            {
                "event": "reading",
                "joints": [round(v, 4) for v in reading.joints],
                "counts": dict(reading.counts),
                "T_world_tcp": None if T is None else [[round(float(v), 6) for v in r] for r in T],
                "arm_opening_mm": reading.arm_opening_mm,
                "fixed_opening_mm": reading.fixed_opening_mm,
                "step_mm": reading.step_mm,
                "step_deg": reading.step_deg,
                "speed_percent": reading.speed_percent,
            }
        )

    def done(self, order: str, words: str) -> None:
        """Print the result of an order."""
        if self._as_json:
            emit({"event": "done", "order": order, "words": words})
        else:
            print_line(f"> {order}: {words}" if words else f"> {order}")

    def refused(self, order: str, why: str) -> None:
        """Print why an order was not carried out."""
        if self._as_json:
            emit({"event": "refused", "order": order, "why": why})
        else:
            warn(f"> {order}: refused: {why}")


def script_text(source: Path) -> str:
    """Return the text of a file of orders.

    Raises
    ------
    ConfigError : it cannot be read
    """
    text = read_text(source, "a file of orders")
    if len(text) > MAX_SCRIPT_BYTES:
        raise ConfigError(f"{source}: is larger than {MAX_SCRIPT_BYTES} bytes")
    return text
