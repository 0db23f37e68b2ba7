"""The catalogue of alarms holds every code that the code raises, and none that it does not."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from controller.cell.alarms import ALARMS, BY_CODE, Severity, alarm_of, code_of, device_named
from controller.cell.alarms.catalogue import class_code
from controller.cell.alarms.page import page
from controller.cell.batch import BatchEnd
from controller.cell.devices.interlocks import BUILT_IN_RULES
from controller.cell.devices.interlocks.rules import STALE
from controller.cell.errors import PartFaultError, PartProblemError, PolicyAbortError
from controller.cell.machine import PartFault
from drivers.errors import ArmStalledError, ReplyTimeoutError

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("controller/bring_up", "controller/cell", "controller/cli/running", "drivers")
# The roots of what stops or refuses something. Errors of parts have codes of their own.
ROOTS = {"CellError", "DeviceError", "JournalError", "OSError"}
OWN_CODE = {"PartProblemError", "PartFaultError", "PolicyAbortError"}
# callable -> which positional argument is the code
CODE_AT = {"PartProblemError": 0, "request_stop": 1, "request_abort": 1, "report": 2, "_Note": 3,
           "BatchEnd": 2, "RunOutcome": 2, "alarm_of": 0, "code": 0}  # fmt: skip
# rows that stand for an alarm without being an error
ROW_ALARMS = {"stop_not_confirmed", "device_retried", "demoted", "loop_late"}


def trees() -> Iterator[tuple[Path, ast.Module]]:
    for room in (*ROOMS, "controller/results/run"):
        for path in sorted((ROOT / room).rglob("*.py")):
            if "alarms" not in path.parts:
                yield path, ast.parse(path.read_text(encoding="utf-8"))


def error_codes() -> set[str]:
    """Return the codes of all public classes below the roots."""
    bases = {
        node.name: {ast.unparse(base).rpartition(".")[2] for base in node.bases}
        for _, tree in trees()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    found = set(ROOTS)
    while more := {name for name, of in bases.items() if of & found} - found:
        found |= more
    # one make's own kind of a catalogued error has that one's alarm
    kinds = {n for n in found if any(class_code(b) in BY_CODE for b in bases.get(n, set()) - ROOTS)}
    public = {n for n in found if not n.startswith("_") and n not in OWN_CODE}
    return {class_code(n) for n in public if n not in kinds or class_code(n) in BY_CODE}


def is_code(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def is_end(path: Path, node: ast.Tuple) -> bool:
    """Return whether a tuple is a (message, code) of the table of signals that end a run."""
    return path.name == "ends.py" and len(node.elts) == 2 and all(map(is_code, node.elts))


def literal_codes() -> set[str]:
    """Return every text in the place of a code, in calls and in the table of signals."""
    found = set()
    for path, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func).rpartition(".")[2]
                at = CODE_AT.get(name)
                # a question has a code of its own: it is no alarm
                given = [k.value for k in node.keywords if k.arg == "code" and name != "Question"]
                if at is not None and len(node.args) > at:
                    given.append(node.args[at])
                found |= {str(ast.literal_eval(one)) for one in given if is_code(one)}
            elif isinstance(node, ast.arguments):
                names = [arg.arg for arg in node.args]
                for arg, default in zip(reversed(names), reversed(node.defaults), strict=False):
                    if arg == "code" and is_code(default):
                        found.add(str(ast.literal_eval(default)))
            elif isinstance(node, ast.Tuple) and is_end(path, node):
                found.add(str(ast.literal_eval(node.elts[1])))
    return found - {""}


def raised() -> set[str]:
    rules = {rule.code for rule in BUILT_IN_RULES}
    rules.add(STALE)
    return error_codes() | literal_codes() | {fault.value for fault in PartFault} | rules


def test_every_code_that_is_raised_has_an_alarm() -> None:
    assert raised() - set(BY_CODE) == set()


def test_every_alarm_is_raised_somewhere() -> None:
    assert set(BY_CODE) - raised() - ROW_ALARMS == set()


def test_the_walk_finds_what_it_is_for() -> None:
    assert {"no_way_home", "stop", "terminal_gone", "worker_gone", "homing", "cut_off"} <= raised()


def test_numbers_and_codes_are_given_once_and_every_alarm_has_all_its_words() -> None:
    assert len({alarm.number for alarm in ALARMS}) == len(ALARMS) == len(BY_CODE)
    for alarm in ALARMS:
        texts = (alarm.code, alarm.device, alarm.words, alarm.unknown, alarm.action)
        assert all(text and text == text.strip() and "|" not in text for text in texts), alarm
        assert not alarm.words.endswith("."), "it stands within a sentence"


def test_numbers_do_not_change() -> None:
    # people write them down: a number once given is never given to another alarm
    assert {n: BY_CODE[code].number for n, code in enumerate(
        ["stop", "estop", "silent_line", "stall", "grip_missed", "part_lost", "journal"]
    )} == {0: 101, 1: 201, 2: 303, 3: 320, 4: 401, 5: 403, 6: 901}  # fmt: skip


def test_the_page_on_alarms_is_what_the_catalogue_draws() -> None:
    drawn = (ROOT / "docs" / "alarms.md").read_text(encoding="utf-8")
    assert drawn == page(), "run: python -m controller.cell.alarms.page > docs/alarms.md"


class OneMakersError(ReplyTimeoutError):
    """As a driver from elsewhere may have it."""


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (OneMakersError("x"), "reply_timeout"),
        (ArmStalledError("x"), "stall"),
        (FileNotFoundError("x"), "file"),
        (PartProblemError("no_part", "x"), "no_part"),
        (PartFaultError(PartFault.DROPPED, "x"), "part_lost"),
        (PolicyAbortError("x", "grip_wrong"), "grip_wrong"),
        (ZeroDivisionError("x"), "internal"),
    ],
)
def test_an_error_has_the_code_of_its_class_or_of_the_nearest_above(
    error: Exception, code: str
) -> None:
    assert code_of(error) == code


@pytest.mark.parametrize(
    ("message", "device"),
    [
        ("gripper: no answer from unit 9", "gripper"),
        ("camera /dev/video0: no frame exposed after 3 s", "camera"),
        ("I/O block (unit 1 at x): refused", "I/O block"),
        ("something else", "device"),
        ("an alarm: nobody warmed it up", "device"),
    ],
)
def test_a_device_is_named_by_its_message_where_any_device_may_be_meant(
    message: str, device: str
) -> None:
    assert device_named(alarm_of("reply_timeout"), message) == device


def test_an_outcome_has_its_alarm() -> None:
    alarm = BatchEnd("held", "the jaws closed on nothing", "grip_missed", "on the table").alarm
    assert alarm is not None
    assert (alarm.number, alarm.severity) == (401, Severity.RECOVERED)
    assert BatchEnd("complete", "", "", "").alarm is None
