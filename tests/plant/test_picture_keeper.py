"""The bridge keeps pictures between runs, by a process that it ends when a run begins."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from fake_plant import FakePlant

from controller.cell.journal import JOURNAL_NAME
from controller.plant.keeping import PictureKeeper
from controller.plant.model import CellState
from controller.plant.plant import PlantError

# Stands for `cellctl`: notes how it was called, then ends as a file says, or by a signal.
FAKE = """
import json, pathlib, sys, time
folder = pathlib.Path(sys.argv[1])
try:
    with (folder / "calls.jsonl").open("a") as calls:
        print(json.dumps(sys.argv[2:]), file=calls)
    while not (folder / "end").exists():
        time.sleep(0.01)
except KeyboardInterrupt:
    (folder / "interrupted").touch()
    sys.exit(130)
text = (folder / "end").read_text()
print(text, file=sys.stderr)
sys.exit(1 if text else 0)
"""


class AskedPlant(FakePlant):
    """Counts how often its state is asked."""

    asked_count = 0

    async def state(self) -> CellState:
        self.asked_count += 1
        return await super().state()


class Keeping:
    """A keeper in front of a fake cell and a fake command."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.runs = folder / "runs"
        self.runs.mkdir()
        (self.runs / JOURNAL_NAME).touch()
        (folder / "fake.py").write_text(FAKE)
        self.program = (sys.executable, str(folder / "fake.py"), str(folder))
        self.keeper = PictureKeeper(self.runs, self.program, period_s=0.01)
        self.plant = AskedPlant()

    def calls(self) -> list[list[str]]:
        path = self.folder / "calls.jsonl"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    async def until(self, count: int) -> None:
        """Wait until the command was called so often."""
        await self.seen(lambda: len(self.calls()) >= count)

    async def seen(self, is_so: Callable[[], bool]) -> None:
        """Wait until something is so that another process does."""
        async with asyncio.timeout(60):
            while not is_so():  # noqa: ASYNC110 - another process sets no event
                await asyncio.sleep(0.01)


@pytest.fixture
def at(tmp_path: Path) -> Keeping:
    return Keeping(tmp_path)


async def test_pictures_are_kept_again_and_again_between_runs(at: Keeping) -> None:
    (at.folder / "end").write_text("")
    serving = asyncio.create_task(at.keeper.serve(at.plant))
    await at.until(3)
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    assert at.calls()[0] == ["history", "--keep-pictures", "--json", "--runs", str(at.runs)]


async def test_nothing_is_kept_while_a_run_is_on_or_before_the_first(at: Keeping) -> None:
    (at.folder / "end").write_text("")
    await at.plant.become(state="execute", run="R1")
    serving = asyncio.create_task(at.keeper.serve(at.plant))
    await at.seen(lambda: at.plant.asked_count > 5)
    assert at.calls() == []
    (at.runs / JOURNAL_NAME).unlink()
    await at.plant.become(state="free", run=None)
    await at.seen(lambda: at.plant.asked_count > 10)
    assert at.calls() == []
    (at.runs / JOURNAL_NAME).touch()
    await at.until(1)
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


async def test_a_run_that_begins_ends_the_copying(at: Keeping) -> None:
    serving = asyncio.create_task(at.keeper.serve(at.plant))
    await at.until(1)
    await at.plant.become(state="execute", run="R1")
    await at.seen((at.folder / "interrupted").exists)
    assert not serving.done()
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)


async def test_a_bridge_that_ends_ends_the_copying(at: Keeping) -> None:
    serving = asyncio.create_task(at.keeper.serve(at.plant))
    await at.until(1)
    serving.cancel()
    await asyncio.gather(serving, return_exceptions=True)
    assert (at.folder / "interrupted").exists()


async def test_a_copying_that_does_not_end_when_asked_is_killed(at: Keeping) -> None:
    fake = at.folder / "fake.py"
    ignoring = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
    fake.write_text(ignoring + fake.read_text())
    at.keeper = PictureKeeper(at.runs, at.program, period_s=0.01, end_s=0.1)
    serving = asyncio.create_task(at.keeper.serve(at.plant))
    await at.until(1)
    serving.cancel()
    async with asyncio.timeout(60):
        await asyncio.gather(serving, return_exceptions=True)
    assert not (at.folder / "interrupted").exists()


async def test_the_commands_last_sentence_is_the_error(at: Keeping) -> None:
    (at.folder / "end").write_text("s3://plant: access refused: check the key and its rights")
    with pytest.raises(PlantError, match="access refused"):
        await at.keeper.serve(at.plant)
