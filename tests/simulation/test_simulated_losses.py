"""A controller dies with the part in the arm gripper, and its journal is lost as well."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from stories import play

from controller.cell.custody.known_journals import JournalLostError
from controller.cell.journal import Journal
from simulation.cell import SimulatedCell
from simulation.loop import SimulatedLoop

STEP_S = 0.05


class Story:
    """A cell, and a copy of its journal from before the part was gripped."""

    def __init__(self, loop: SimulatedLoop, cell: SimulatedCell, folder: Path) -> None:
        self.loop, self.cell, self.older = loop, cell, folder
        folder.mkdir()

    @property
    def files(self) -> list[Path]:
        return sorted(self.cell.folder.glob("journal.sqlite*"))

    @property
    def journal(self) -> bytes | None:
        path = self.cell.journal_path
        return path.read_bytes() if path.exists() else None

    @property
    def holder(self) -> str:
        return str(self.cell.truth()["parts"][0]["custody"])

    async def until(self, is_so: Callable[[], bool]) -> None:
        while not is_so():  # noqa: ASYNC110  the world tells nobody
            await asyncio.sleep(STEP_S)

    async def killed_with_the_part(self) -> None:
        controller = self.cell.controller()
        controller.start()
        await self.until(self.cell.journal_path.exists)
        await self.until(lambda: controller.state == "acquiring")
        for one in self.files:
            shutil.copyfile(one, self.older / one.name)
        await self.until(lambda: self.holder == "arm")
        controller.kill()
        await asyncio.sleep(1.0)

    def lose(self, how: str) -> None:
        for one in self.files:
            one.unlink()
        path = self.cell.journal_path
        if how == "empty":
            path.touch()
        elif how == "older copy":
            for one in self.older.iterdir():
                shutil.copyfile(one, path.with_name(one.name))
        elif how == "another":
            Journal(path, "other").close()


@pytest.mark.parametrize(
    "how",
    [
        "gone",
        *(pytest.param(how, marks=pytest.mark.slow) for how in ("empty", "older copy", "another")),
    ],
)
def test_a_part_in_an_arm_without_power_is_not_dropped_when_the_journal_is_lost(
    tmp_path: Path, how: str
) -> None:
    async def story(one: Story) -> None:
        await one.killed_with_the_part()
        one.cell.befall("power", device="arm")
        one.lose(how)
        there = one.journal
        await asyncio.sleep(1.0)
        one.cell.befall("power", device="arm", on=True)  # it has lost its positions
        for _ in range(2):  # nothing that the first refusal leaves behind lets the second pass
            with pytest.raises(JournalLostError, match="What the grippers hold is unknown"):
                await one.cell.controller(recovery="auto").start()
        assert one.holder == "arm"
        assert one.journal == there

    play(tmp_path, Story, story)


def test_a_journal_deleted_while_the_arm_moves_with_the_part_stops_it_and_bars_the_next_start(
    tmp_path: Path,
) -> None:
    async def story(one: Story) -> None:
        controller = one.cell.controller()
        task = controller.start()
        await one.until(one.cell.journal_path.exists)
        await one.until(lambda: one.holder == "arm")
        lost_s = one.cell.now_s()
        for path in one.files:
            path.unlink()
        outcome = (await task).outcome
        assert (outcome.end, outcome.code) == ("aborted", "journal")
        assert one.cell.now_s() - lost_s < 10.0  # at the next row
        assert one.holder == "arm"
        with pytest.raises(JournalLostError):
            await one.cell.controller(recovery="auto").start()
        assert one.holder == "arm"
        assert not one.cell.journal_path.exists()

    play(tmp_path, Story, story)
