"""What is printed when nobody reads any more, and a stop before the cell is at work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from controller.cell.batch import Dispatcher
from controller.cell.custody import Custody
from controller.cell.journal import Journal, read_rows
from controller.cli.running.ends import CommandEnds
from controller.processes import worker_pool

ROOT = Path(__file__).resolve().parents[2]

PRINTER = """
import sys
from controller.cli.terminal.output import emit, is_output_gone, print_line, warn
sys.stdin.read()
for i in range(20000):
    emit({"line": i}); print_line("to people"); warn("more")
assert is_output_gone()
open(sys.argv[1], "w").write("done")
"""


def test_a_reader_that_leaves_fails_nothing(tmp_path: Path) -> None:
    done = tmp_path / "done"
    process = subprocess.Popen(
        [sys.executable, "-c", PRINTER, str(done)],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    for stream in (process.stdout, process.stderr, process.stdin):
        assert stream is not None
        stream.close()  # the readers leave, then the printing begins
    assert process.wait(60) == 0
    assert done.read_text() == "done"


@pytest.mark.parametrize(("asking", "code"), [("request_stop", "stop"), ("request_abort", "gone")])
async def test_a_stop_before_the_first_motion_keeps_the_cell_from_moving(
    tmp_path: Path, asking: str, code: str
) -> None:
    journal = Journal(tmp_path / "journal.sqlite", "run")
    part = SimpleNamespace(custody=Custody.ON_TABLE, tray=None)
    record = cast(Any, SimpleNamespace(part=part))
    nobody = cast(Any, None)  # no action to take, nothing to stop: any call would fail
    gate = cast(Any, SimpleNamespace())
    dispatcher = Dispatcher(nobody, record, nobody, (), journal, gate, nobody, nobody)
    getattr(dispatcher, asking)("because", code)
    outcome = await dispatcher.run()
    journal.close()
    assert (outcome.end, outcome.message, outcome.code) == ("stopped", "because", code)
    assert [row.name for row in read_rows(tmp_path / "journal.sqlite")] == ["at_rest"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP])
def test_before_anything_is_connected_a_signal_ends_the_command(number: signal.Signals) -> None:
    whoever_started_us = signal.signal(number, signal.SIG_DFL)  # nohup ignores hang-ups
    try:
        with pytest.raises(KeyboardInterrupt), CommandEnds().heard():
            os.kill(os.getpid(), number)
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, whoever_started_us)


def test_whoever_ignores_hang_ups_is_left_alone() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with CommandEnds().heard():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_worker_that_works_ahead_has_less_priority() -> None:
    own = os.nice(0)
    with worker_pool(niceness=5) as pool:
        assert pool.submit(os.nice, 0).result() == min(own + 5, 19)


PARENT = """
import os, signal, sys, time
from controller.processes import worker_pool
if __name__ == "__main__":
    with worker_pool() as pool:
        print(pool.submit(os.getpid).result(), flush=True)
        pool.submit(time.sleep, 600)
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_worker_ends_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    # the pipe ends when the last process that holds it has ended: parent, worker, its tracker
    said = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, timeout=600, check=False,
    ).stdout  # fmt: skip
    assert said.strip().isdigit()


def test_a_worker_leaves_a_stop_of_the_whole_group_to_its_parent() -> None:
    with worker_pool() as pool:
        worker = pool.submit(os.getpid).result()
        os.kill(worker, signal.SIGTERM)  # as `timeout` sends it to each process of a command
        assert pool.submit(os.getpid).result() == worker


def test_a_worker_at_work_is_not_waited_for() -> None:
    with worker_pool() as pool:
        worker = pool.submit(os.getpid).result()
        pool.submit(signal.pause)
    assert not Path(f"/proc/{worker}").exists()
