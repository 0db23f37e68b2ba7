"""Keys and lines become orders; a stop is heard at any time, all else only when it is awaited."""

from __future__ import annotations

import asyncio
import os
import pty
import termios
from collections.abc import AsyncIterator, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from controller.bring_up.jogging import read_order
from controller.cell.operator import Choice, Question
from controller.cli.bring_up.pilots import KEYS, KeyPilot, LinePilot, single_keys

QUESTION = Question("may_move", "May it move?", (Choice("yes", "go on"), Choice("stop", "end")))


class Keyboard:
    """A pseudo-terminal whose other end is typed on."""

    def __init__(self, pilot: KeyPilot, typing: int) -> None:
        self.pilot, self._typing = pilot, typing
        self._unread = 0
        self._is_read = asyncio.Event()
        hear = pilot._on_text

        def count(text: str) -> None:
            hear(text)
            self._unread -= len(text)
            if self._unread <= 0:
                self._is_read.set()

        pilot._on_text = count  # type: ignore[method-assign]  # before it is heard

    async def is_heard(self) -> None:
        """Let the loop read all that was typed; the kernel hands it on when it likes."""
        await self._is_read.wait()
        for _ in range(5):
            await asyncio.sleep(0)

    def press(self, keys: str) -> None:
        self._unread += len(keys)
        self._is_read.clear()
        os.write(self._typing, keys.encode())

    def hang_up(self) -> None:
        os.close(self._typing)
        self._typing = -1

    def close(self) -> None:
        if self._typing >= 0:
            os.close(self._typing)


@contextmanager
def terminal() -> Iterator[tuple[int, int]]:
    typing, screen = pty.openpty()
    try:
        yield typing, screen
    finally:
        os.close(screen)


@pytest.fixture
async def keyboard() -> AsyncIterator[Keyboard]:
    with terminal() as (typing, screen):
        pilot = KeyPilot("a tester", screen)
        board = Keyboard(pilot, typing)
        with pilot.heard():
            yield board
        board.close()


def test_every_key_stands_for_an_order_that_can_be_read() -> None:
    for text in KEYS.values():
        read_order(text)


async def test_a_key_gives_its_order_and_what_is_unknown_gives_none(keyboard: Keyboard) -> None:
    keyboard.press("Zq")
    assert await keyboard.pilot.order() == "joint 1 +"


async def test_keys_pressed_while_something_moves_are_dropped(keyboard: Keyboard) -> None:
    keyboard.press("i")
    assert await keyboard.pilot.order() == "x +"
    keyboard.press("iiii")  # held down, while the arm moves
    await keyboard.is_heard()
    ordered = asyncio.create_task(keyboard.pilot.order())
    await keyboard.is_heard()
    assert not ordered.done()
    keyboard.press("k")
    assert await ordered == "x -"


@pytest.mark.parametrize("key", [" ", "\x1b", "\x1b[A"], ids=["space", "Esc", "arrow"])
async def test_a_stop_is_heard_while_something_moves(keyboard: Keyboard, key: str) -> None:
    keyboard.press("i")
    await keyboard.pilot.order()
    moving = asyncio.create_task(keyboard.pilot.wants_stop())
    await keyboard.is_heard()
    assert not moving.done()
    keyboard.press(key)
    await moving


async def test_a_stop_right_behind_an_order_is_not_lost(keyboard: Keyboard) -> None:
    keyboard.press("i ")
    assert await keyboard.pilot.order() == "x +"
    await keyboard.pilot.wants_stop()


async def test_an_order_may_be_typed_and_its_spaces_are_no_stop(keyboard: Keyboard) -> None:
    keyboard.press(":joint 1  9\x7f8\n")
    assert await keyboard.pilot.order() == "joint 1  8"
    stop = asyncio.create_task(keyboard.pilot.wants_stop())
    await keyboard.is_heard()
    assert not stop.done()
    stop.cancel()


async def test_the_rest_of_an_arrow_key_is_no_order(keyboard: Keyboard) -> None:
    keyboard.press("\x1b[1q")  # would else be step 1 and joint 1
    assert await keyboard.pilot.order() == "stop"
    ordered = asyncio.create_task(keyboard.pilot.order())
    await keyboard.is_heard()
    assert not ordered.done()
    ordered.cancel()


async def test_a_question_takes_its_keys_alone(keyboard: Keyboard) -> None:
    for keys, choice in (("qy", "yes"), ("n", "stop"), ("2", "stop"), (" ", "stop")):
        keyboard.press(keys)
        answer = await keyboard.pilot.decide(QUESTION)
        assert answer is not None
        assert (answer.key, answer.who) == (choice, "a tester at the terminal")


async def test_a_terminal_that_is_gone_stops_and_gives_no_more_orders(keyboard: Keyboard) -> None:
    keyboard.hang_up()
    assert await keyboard.pilot.order() is None
    await keyboard.pilot.wants_stop()
    assert await keyboard.pilot.decide(QUESTION) is None


def test_a_terminal_is_put_back_whatever_ends_the_keys() -> None:
    with terminal() as (typing, screen):
        before = termios.tcgetattr(screen)

        def interrupted() -> None:
            with single_keys(screen):
                assert termios.tcgetattr(screen) != before
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert termios.tcgetattr(screen) == before
        os.close(typing)


async def test_lines_of_a_file_are_orders_without_their_remarks(tmp_path: Path) -> None:
    script = tmp_path / "orders"
    script.write_text("# first\nhome\n\nx 5  # a little\nstop")
    pilot = LinePilot(answers=False, as_json=False)
    with pilot.heard(script):
        assert [await pilot.order() for _ in range(5)] == ["home", "x 5", "stop", None, None]
        assert await pilot.decide(QUESTION) is None


async def test_a_helper_answers_only_where_it_was_said_to() -> None:
    answer = await LinePilot(answers=True, as_json=False).decide(QUESTION)
    assert answer is not None
    assert (answer.key, answer.who) == ("yes", "--yes")
