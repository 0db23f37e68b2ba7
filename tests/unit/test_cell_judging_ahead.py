"""What is judged while the arm goes on: in pieces, one at a time, and never of what was dropped."""

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from controller.cell.services import Background, JudgingAhead
from controller.cell.services.records import PartRecord


def bench(part: PartRecord, judge_ahead: Any, background: Background) -> JudgingAhead:
    record: Any = SimpleNamespace(part=part, product=None)
    compute: Any = SimpleNamespace(judge_ahead=judge_ahead)
    part_file: Any = SimpleNamespace(
        text=lambda part, product, views: f"{len(views)} views", path=lambda part: Path("file")
    )
    return JudgingAhead(record, compute, background, part_file)


def shown() -> Any:
    return SimpleNamespace()


def test_a_grasp_that_is_over_is_judged_piece_by_piece_until_nothing_is_left() -> None:
    async def run() -> list[tuple[str, int]]:
        asked: list[tuple[str, int]] = []
        is_done = asyncio.Event()

        async def judge_ahead(path: Path, text: str, view_count: int) -> bool:
            asked.append((text, view_count))
            if len(asked) == 3:
                is_done.set()
            return len(asked) < 3

        part = PartRecord(number=1)
        part.pending = [shown(), shown()]
        ahead = bench(part, judge_ahead, Background())
        ahead.begin()
        await is_done.wait()
        await ahead.aclose()
        return asked

    assert asyncio.run(run()) == [("2 views", 2)] * 3


def test_nothing_is_asked_of_a_part_whose_judging_ahead_was_dropped() -> None:
    async def run() -> int:
        asked = 0

        async def judge_ahead(*_: object) -> bool:
            nonlocal asked
            asked += 1
            return True

        background, is_free = Background(), asyncio.Event()
        busy = asyncio.create_task(background.put(is_free.wait))
        part = PartRecord(number=1)
        part.pending = [shown()]
        ahead = bench(part, judge_ahead, background)
        ahead.begin()
        await asyncio.sleep(0)
        await ahead.aclose()
        is_free.set()
        await busy
        return asked

    assert asyncio.run(run()) == 0


def test_slow_questions_are_put_one_after_the_other() -> None:
    async def run() -> list[str]:
        log: list[str] = []

        async def slow(name: str) -> None:
            log.append(f"{name} asked")
            await asyncio.sleep(0)
            log.append(f"{name} answered")

        background = Background()
        await asyncio.gather(background.put(slow, "a"), background.put(slow, "b"))
        return log

    assert asyncio.run(run()) == ["a asked", "a answered", "b asked", "b answered"]


def test_a_grasp_that_is_over_comes_before_the_views_that_wait_and_is_not_interrupted() -> None:
    async def run() -> list[str]:
        log: list[str] = []
        is_judged = asyncio.Event()

        async def own(name: str) -> None:
            log.append(name)
            await asyncio.sleep(0)

        async def judge_ahead(*_: object) -> bool:
            log.append("ahead")
            await asyncio.sleep(0)
            if log.count("ahead") == 3:
                is_judged.set()
            return log.count("ahead") < 3

        background = Background()
        part = PartRecord(number=1)
        part.pending = [shown()]
        views = [asyncio.create_task(background.put(own, f"v{i}")) for i in range(5)]
        ahead = bench(part, judge_ahead, background)
        ahead.begin()
        await asyncio.wait_for(is_judged.wait(), 60)
        await asyncio.gather(*views)
        await ahead.aclose()
        return log

    log = asyncio.run(run())
    first = log.index("ahead")
    assert log[first : first + 3] == ["ahead"] * 3
    assert first < 5, "some of the views that waited come after it"
    assert [one for one in log if one != "ahead"] == [f"v{i}" for i in range(5)]
