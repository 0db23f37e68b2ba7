"""Leases: one user at a time, no waiting in a circle, and what a dead controller leaves."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cell.custody.left_leases import left_leases
from controller.cell.errors import LeaseError
from controller.cell.journal import Body, Journal, read_rows, rows
from controller.cell.machine import NEEDS, Effect, Resource
from controller.cell.services import Leases
from drivers.clock import CellClock

R = Resource


def silent() -> Leases:
    return Leases(lambda row: None, CellClock(1000.0))


Takings = list[tuple[frozenset[Resource], frozenset[Resource]]]
SETS = st.frozensets(st.sampled_from(Resource), min_size=1, max_size=5)


@settings(deadline=None, max_examples=150)
@given(st.lists(st.lists(st.tuples(SETS, SETS), max_size=3), min_size=2, max_size=5), st.data())
def test_whatever_many_ask_for_all_get_it_and_never_two_the_same(
    programs: list[Takings], data: st.DataObject
) -> None:
    leases = silent()
    users: dict[Resource, set[int]] = {one: set() for one in Resource}
    refused: list[int] = []

    async def work(number: int, takings: Takings, pauses: list[int]) -> None:
        for first, second in takings:
            async with leases.hold(f"task {number}", first):
                await using(number, first, pauses)
                # more within: only what comes after all it has
                is_later = min(o.place for o in second) > max(o.place for o in first)
                try:
                    async with leases.hold(f"task {number}", second):
                        await using(number, second - first, pauses)
                except LeaseError:
                    refused.append(number)
                    assert not is_later
                    assert not second <= first

    async def using(number: int, what: frozenset[Resource], pauses: list[int]) -> None:
        for one in what:
            users[one].add(number)
        for _ in range(pauses.pop() if pauses else 1):
            await asyncio.sleep(0)
            assert all(len(users[one]) <= 1 for one in what)
        for one in what:
            users[one].discard(number)

    async def all_of_them() -> None:
        # no wait may last: there is no circle to wait in
        async with asyncio.timeout(20):
            pauses = [data.draw(st.lists(st.integers(0, 4), max_size=6)) for _ in programs]
            await asyncio.gather(
                *(work(i, p, w) for i, (p, w) in enumerate(zip(programs, pauses, strict=True)))
            )

    asyncio.run(all_of_them())
    assert leases.owners == {}


async def test_what_comes_earlier_is_refused_to_who_has_something_later() -> None:
    leases = silent()
    async with leases.hold("place", [R.ARM]):
        with pytest.raises(LeaseError, match="place requests the trays after it took the arm"):
            async with leases.hold("place", [R.TRAYS]):
                pass
    assert leases.owners == {}


async def test_what_a_task_has_counts_for_itself_and_for_tasks_it_starts() -> None:
    leases = silent()

    async def inner() -> None:
        async with leases.hold("a part of it", [R.ARM]):
            assert leases.owners[R.ARM] == "home"

    async with leases.hold("home", list(R)), asyncio.TaskGroup() as both:
        both.create_task(inner())
        both.create_task(inner())


async def test_a_stop_needs_nothing_and_a_cancelled_action_gives_back() -> None:
    leases = silent()
    begun = asyncio.Event()

    async def grasping() -> None:
        async with leases.hold("grasp", NEEDS[Effect.GRASP]):
            begun.set()
            await asyncio.Event().wait()

    task = asyncio.create_task(grasping())
    await begun.wait()
    async with leases.hold("abort_motion", NEEDS[Effect.ABORT_MOTION]):
        assert set(leases.owners) == set(NEEDS[Effect.GRASP])
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert leases.owners == {}


async def test_a_lease_that_nobody_gives_back_is_named_with_its_owner() -> None:
    leases = Leases(lambda row: None, CellClock(100_000.0))
    begun = asyncio.Event()

    async def forever() -> None:
        async with leases.hold("grasp", [R.ARM]):
            begun.set()
            await asyncio.Event().wait()

    task = asyncio.create_task(forever())
    await begun.wait()
    with pytest.raises(LeaseError, match="waited 60 s for the arm, which grasp has"):
        async with leases.hold("place", [R.TRAYS, R.ARM]):
            pass
    assert set(leases.owners) == {R.ARM}  # what it had meanwhile is given back
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def test_every_action_says_what_it_needs_and_what_stops_needs_nothing() -> None:
    assert set(NEEDS) == set(Effect)
    for effect in (Effect.HOLD, Effect.STOP_MOTION, Effect.ABORT_MOTION, Effect.CLEAR_FAULT):
        assert NEEDS[effect] == ()
    # what moves the arm has it, and its gripper
    for effect in (Effect.GRASP, Effect.PRESENT, Effect.HAND_OFF, Effect.PLACE, Effect.WITHDRAW):
        assert {R.ARM, R.ARM_GRIPPER} <= set(NEEDS[effect])
    assert R.FIXED_GRIPPER in NEEDS[Effect.HAND_OFF]


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    opened = Journal(tmp_path / "journal.sqlite", "first")
    yield opened
    opened.close()


def take(by: str, *resources: str) -> Body:
    return rows.LeaseTaken(by=by, resources=resources)


def test_what_a_killed_run_had_is_left_and_what_it_gave_back_is_not(journal: Journal) -> None:
    journal.write(take("acquire", "table"))
    journal.write(rows.LeaseReturned(by="acquire", resources=("table",)))
    journal.write(take("grasp", "table", "arm"))
    (left,) = left_leases(list(read_rows(journal.path)))
    assert (left.by, left.resources, left.run) == ("grasp", ("table", "arm"), "first")
    assert left.words.startswith("held, owner dead: table, arm; taken by grasp of run first at 20")


def test_a_later_run_that_took_and_returned_leaves_nothing(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    for run, is_killed in (("first", True), ("second", False)):
        journal = Journal(path, run)
        journal.write(take("grasp", "arm"))
        if not is_killed:
            journal.write(rows.LeaseReturned(by="grasp", resources=("arm",)))
        journal.close()
    assert left_leases(list(read_rows(path))) == ()
