"""The command that an alarm is passed on to: what it gets, and that nobody waits for it."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from controller.cell.journal import rows
from controller.cell.operator.notices import ALIVE_COUNT_MAX, Notices


def event(message: str = "tray accept (4 parts) is full", number: int | None = 424) -> Any:
    alarm = None
    if number is not None:
        alarm = rows.AlarmFields(number=number, code="tray_full", device="trays", action="empty it")
    return rows.CellEvent(
        name="part_problem", answer="handled", source="a", target="b", message=message, alarm=alarm
    )


def script(folder: Path, text: str) -> tuple[str, ...]:
    path = folder / "notify.py"
    path.write_text(text)
    return sys.executable, str(path)


def test_a_command_gets_the_alarm_and_its_run(tmp_path: Path) -> None:
    command = script(
        tmp_path, "import sys; open('got.json', 'w').write(sys.stdin.read())"
    )  # in the cell file's folder
    notices = Notices(command, tmp_path, {"run": "r1", "cell": "c"})
    notices.take(event())
    notices.close()
    got = json.loads((tmp_path / "got.json").read_text())
    assert (got["run"], got["cell"], got["number"], got["code"]) == ("r1", "c", 424, "tray_full")
    assert (got["message"], got["action"]) == ("tray accept (4 parts) is full", "empty it")


def test_what_is_no_alarm_runs_nothing(tmp_path: Path) -> None:
    command = script(tmp_path, "open('ran', 'w')")
    notices = Notices(command, tmp_path, {})
    notices.take(event(number=None))
    Notices((), tmp_path, {}).take(event())
    notices.close()
    assert not (tmp_path / "ran").exists()


def test_a_command_that_does_not_exist_is_named_in_the_log(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Notices(("no-such-program",), tmp_path, {}).take(event())
    assert "on_alarm: no-such-program: No such file" in caplog.text


def test_commands_that_hang_and_do_not_read_hold_nobody_up(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    command = script(tmp_path, "import time; time.sleep(600)")
    notices = Notices(command, tmp_path, {})
    for _ in range(ALIVE_COUNT_MAX + 1):
        notices.take(event(message="x" * 500_000))  # more than a pipe holds
    assert "this alarm is left out" in caplog.text
    for process in notices._alive:
        process.kill()
        process.wait()
        assert process.stdin is not None
        assert process.stdin.closed
