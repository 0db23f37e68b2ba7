"""Work of child processes for the page: one at a time, watched, cancelled, bounded."""

from __future__ import annotations

import asyncio
import json
import sys
from pathlib import Path

import pytest

from controller.page.work import (
    MESSAGE_MAX,
    NICENESS,
    BusyError,
    ChildWork,
    Workshop,
    WorkState,
)
from messages import Message

TALKS = """
import json, sys
print(json.dumps({"event": "progress", "stage": "thinking"}), file=sys.stderr)
print("cellctl: /secret/place/a.yaml:3: is odd", file=sys.stderr)
print(json.dumps({"arguments": sys.argv[1:]}))
"""
WAITS = """
import sys
print("here", file=sys.stderr, flush=True)
sys.stdin = None
import threading
threading.Event().wait()
"""
STUBBORN = f"import signal\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\n{WAITS}"
SAYS_NO = "print('{\"problems\": [1]}')\nraise SystemExit(1)"
REFUSES = """
import json, sys
from messages import say
from messages.form import with_said
missing = say("{path}: {what} is missing", path="/secret/place/a.yaml", what="a part")
for error in (missing, "x" * 501):
    print(json.dumps(with_said({"event": "refused", "error": error})), file=sys.stderr)
print(json.dumps({"event": "progress"}), file=sys.stderr)
print(json.dumps({"event": "progress", "said": 1}), file=sys.stderr)
"""
LIMITS = """
import json, os, resource
names = ("RLIMIT_CPU", "RLIMIT_DATA", "RLIMIT_FSIZE", "RLIMIT_CORE")
while resource.getrlimit(resource.RLIMIT_CORE)[1] != 0:
    pass
print(json.dumps({name: resource.getrlimit(getattr(resource, name))[0] for name in names}))
print(json.dumps({"priority": os.getpriority(os.PRIO_PROCESS, 0)}))
"""


def program(text: str) -> Workshop:
    return Workshop((sys.executable, "-c", text))


async def heard(work: ChildWork) -> None:
    while not work.messages:  # noqa: ASYNC110 - the child says so, in its own time
        await asyncio.sleep(0)


def nothing(_: Path) -> tuple[str, ...]:
    return ()


async def test_what_a_child_prints_is_its_result_and_its_messages_name_no_folder() -> None:
    shop = program(TALKS)
    async with shop.open():
        work = shop.start(
            "part", "a", "ada", lambda folder: (str(folder), "x"), within=Path("/secret/place")
        )
        await shop.ended()
        assert work.state is WorkState.DONE
        assert work.bodies() == [{"arguments": [str(work.folder), "x"]}]
        assert work.stage == "thinking"
        assert work.messages == ["a.yaml:3: is odd"]
        assert shop.last("part", "a") is work
        assert work.folder.is_dir()
    assert not work.folder.exists()


async def test_only_one_thing_is_at_work() -> None:
    shop = program(WAITS)
    async with shop.open():
        first = shop.start("plan", "a", "ada", nothing)
        with pytest.raises(BusyError, match="plan of a"):
            shop.start("plan", "b", "bob", nothing)
        assert shop.running is first
        assert shop.last("plan", "b") is None


@pytest.mark.parametrize("text", [WAITS, STUBBORN])
async def test_work_is_cancelled_and_its_process_is_gone(
    text: str,
) -> None:
    shop = Workshop((sys.executable, "-c", text), patience_s=0.2)
    async with shop.open():
        work = shop.start("plan", "a", "ada", nothing)
        await heard(work)
        assert await shop.cancel()
        assert shop.running is None
        assert work.state is WorkState.CANCELLED
        assert work.code is not None
        assert work.code < 0  # ended by a signal, and waited for
        assert not await shop.cancel()


async def test_work_that_is_cancelled_before_its_process_is_there_ends_too() -> None:
    shop = program(WAITS)
    async with shop.open():
        work = shop.start("plan", "a", "ada", nothing)
        assert await shop.cancel()
        assert work.state is WorkState.CANCELLED


async def test_the_end_of_the_page_is_the_end_of_its_work() -> None:
    shop = program(WAITS)
    async with shop.open():
        work = shop.start("plan", "a", "ada", nothing)
        await heard(work)
    assert work.code is not None
    assert shop.running is None


async def test_a_command_that_says_no_is_told_from_one_that_cannot_be_started() -> None:
    shop = program(SAYS_NO)
    async with shop.open():
        work = shop.start("check", "a", "ada", nothing)
        await shop.ended()
        assert work.state is WorkState.REFUSED
        assert work.bodies() == [{"problems": [1]}]
    shop = Workshop(("/no/such/program",))
    async with shop.open():
        work = shop.start("check", "a", "ada", nothing)
        await shop.ended()
        assert work.state is WorkState.REFUSED
        assert "cannot be started" in work.messages[0]


async def test_a_child_goes_after_all_others_and_is_bounded() -> None:
    shop = program(LIMITS)
    async with shop.open():
        work = shop.start("part", "a", "ada", nothing)
        await shop.ended()
        limits, priority = work.bodies()
    assert limits == {
        "RLIMIT_CPU": 1800,
        "RLIMIT_DATA": 6_000_000_000,
        "RLIMIT_FSIZE": 500_000_000,
        "RLIMIT_CORE": 0,
    }
    assert priority["priority"] >= NICENESS


async def test_the_result_before_goes_when_the_same_is_done_again() -> None:
    shop = program(TALKS)
    async with shop.open():
        first = shop.start("part", "a", "ada", nothing)
        await shop.ended()
        second = shop.start("part", "a", "ada", nothing)
        await shop.ended()
        assert not first.folder.exists()
        assert shop.last("part", "a") is second


async def test_garbage_in_place_of_json_is_no_result() -> None:
    shop = program("print('{half')")
    async with shop.open():
        work = shop.start("part", "a", "ada", nothing)
        await shop.ended()
        assert work.bodies() == []
        assert json.dumps(work.facts())


async def test_a_refusal_keeps_its_key_and_names_no_folder_either() -> None:
    shop = program(REFUSES)
    async with shop.open():
        work = shop.start("part", "a", "ada", nothing, within=Path("/secret/place"))
        await shop.ended()
    refusal, cut, odd = work.messages
    assert isinstance(refusal, Message)
    assert (refusal, refusal.key) == ("a.yaml: a part is missing", "{path}: {what} is missing")
    assert cut == "x" * MESSAGE_MAX
    assert odd == '{"event": "progress", "said": 1}'
