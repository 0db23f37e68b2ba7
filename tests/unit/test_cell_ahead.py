"""The next part, planned while the arm has the one before: taken up only where all is as it was."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions.plan import PlanAction
from controller.cell.batch import RunProgress
from controller.cell.compute import Pickable
from controller.cell.custody import Around, TrayRecord
from controller.cell.journal import Journal, read_rows
from controller.cell.journal.rows import StoredFields
from controller.cell.machine import GRASP, Budgets
from controller.cell.services.records import BatchProduct, BatchRecord, matrix
from controller.cell.services.table import Taking
from controller.planning import NoPlanError, OnTable
from controller.recognition import Alternative, Sighting

ANY: Any = SimpleNamespace


def at(part: str | None, x_mm: float, y_mm: float = 0.0, **more: Any) -> Sighting:
    T = np.eye(4)
    T[:2, 3] = x_mm, y_mm
    known: dict[str, Any] = {
        "part": part,
        "pose_index": 0,
        "R": np.eye(3),
        "x_mm": x_mm,
        "y_mm": y_mm,
        "theta_rad": 0.0,
        "T_world_part": None if part is None else T,
        "score": 0.99,
        "covariance": np.eye(3) * 1e-4,
        "ambiguous_with": (),
        "area_mm2": 100.0,
        "box_px": (int(x_mm), int(y_mm), int(x_mm) + 20, int(y_mm) + 20),
        "residual_px": 0.1,
    }
    return Sighting(**(known | more))


FIRST, NEXT, LAST = at("plate", 10.0), at("plate", 80.0), at("block", 150.0)


class Service:
    """A compute service that plans at once, and notes what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[str, Any]] = []
        self.may_go_on = asyncio.Event()
        self.may_go_on.set()
        self.plans = asyncio.Event()
        self.refuses = False
        self.turns: tuple[float, ...] | None = (0.0,)

    async def pickable(self, seen: Any) -> tuple[Pickable, ...]:
        self.asked.append(("pickable", len(seen)))
        return tuple(Pickable(3, 60.0) for _ in seen)

    async def unseen_turns(self, seen: Any) -> tuple[tuple[float, ...] | None, ...]:
        return (self.turns,) * len(seen)

    async def plan(
        self, start: Any, seen: Any, avoid: Any, alternatives: Any, around: Around, *_: Any
    ) -> Any:
        self.asked.append(("plan", (start, avoid, around)))
        self.plans.set()
        await self.may_go_on.wait()
        if self.refuses:
            raise NoPlanError("no path")
        return ANY(
            steps=(), seconds_by_step=(), forecast_s=60.0, covered_fraction=0.9, covered_U=0.0,
            reachable_fraction=0.9, unseen=(), number=len(self.asked),
        )  # fmt: skip


class Cell:
    """What is left of a cell where only the table matters."""

    def __init__(self, folder: Path, count: int = 3, nests: int = 0, ahead: bool = True) -> None:
        self.path = folder / "journal.sqlite"
        self.journal = Journal(self.path, "run")
        self.now, self.ahead = Service(), Service()
        recipe: Any = ANY(part=Path("plate.stl"), name="plate", serial_code=None)
        policy: Any = None
        service: Any = self.now
        other: Any = self.ahead if ahead else None
        self.product = BatchProduct(0, recipe, count, service, policy, Budgets(1, 9), other)
        trays = TrayRecord({"accept": nests} if nests else {})
        self.record = BatchRecord(self.journal, RunProgress(), lambda: None, trays, (self.product,))
        self.taking = Taking(self.record)
        self.record.begin_part()

    async def first(self, *seen: Sighting) -> None:
        """Take the first part off the table and begin to look ahead, as a grasp does."""
        assert await self.taking.take(seen)
        self.record.part.plan = ANY(place={"accept": ANY(T_world_part=np.eye(4))})
        self.now.asked.clear()
        self.taking.look_ahead()

    async def next(self, *seen: Sighting) -> None:
        """Begin the next part with a fresh look."""
        self.record.finish_part()
        self.record.begin_part()
        assert await self.taking.take(seen)

    async def plan(self) -> Any:
        """Return what the part at hand is planned by, as the action has it."""

        async def nothing(*_: Any) -> None:
            return None

        service: Any = self.now
        action = PlanAction(
            service, ANY(wait=nothing), self.taking, ANY(take_all=nothing),
            ANY(measure_again=nothing), ANY(), self.record,
        )  # fmt: skip
        await action.run()
        return self.record.part.plan

    def rows(self, name: str) -> list[dict[str, Any]]:
        return [row.body for row in read_rows(self.path) if row.name == name]


@pytest.fixture
def cell(tmp_path: Path) -> Any:
    made: list[Cell] = []

    def make(**more: Any) -> Cell:
        made.append(Cell(tmp_path, **more))
        return made[0]

    yield make
    for one in made:
        one.journal.close()


def run(story: Callable[[], Any]) -> None:
    asyncio.run(story())


def test_the_next_part_is_planned_beside_the_one_at_hand_and_by_that_plan(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT, LAST)
        await one.ahead.plans.wait()
        ((_, (start, avoid, around)),) = [a for a in one.ahead.asked if a[0] == "plan"]
        assert isinstance(start, OnTable)
        assert start.T_world_part[0, 3] == NEXT.x_mm
        assert avoid == frozenset()
        assert [n.x_mm for n in around.neighbours] == [LAST.x_mm]
        # nothing was asked of the service that the arm waits for
        assert one.now.asked == []
        await one.next(LAST, NEXT)
        assert one.record.part.sighting is NEXT
        plan = await one.plan()
        assert plan.number == len(one.ahead.asked)
        assert one.now.asked == []
        assert [row.get("is_ahead", False) for row in one.rows("plan")] == [True]
        assert one.rows("plan_dropped") == []

    run(story)


MOVED = (
    ("the part was pushed", (at("plate", 80.8), LAST), "plate at x 80, y 0 mm is not as"),
    ("it was turned", (at("plate", 80.0, theta_rad=0.02), LAST), "plate at x 80"),
    ("it was turned over", (at("plate", 80.0, pose_index=1), LAST), "plate at x 80"),
    ("a neighbour was pushed", (NEXT, at("block", 150.0, -0.7)), "block at x 150"),
    ("a neighbour is gone", (NEXT,), "block at x 150"),
    ("another part was laid", (NEXT, LAST, at("plate", 200.0)), "plate at x 200, y 0 mm is new"),
    ("something unknown was laid", (NEXT, LAST, at(None, 200.0)), "an unknown object at x 200"),
    ("a neighbour is another part now", (NEXT, at("plate", 150.0)), "block at x 150"),
)


@pytest.mark.parametrize(("_", "seen", "words"), MOVED, ids=lambda m: m if m is str else None)
def test_whoever_was_at_the_table_is_noticed_and_the_part_planned_anew(
    cell: Any, _: str, seen: tuple[Sighting, ...], words: str
) -> None:
    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT, LAST)
        await one.next(*seen)
        (dropped,) = one.rows("plan_dropped")
        assert words in dropped["reason"]
        await one.plan()
        ((_, (start, _, around)),) = [a for a in one.now.asked if a[0] == "plan"]
        # from where it is now, among what is there now
        assert start.T_world_part[0, 3] == one.record.part.sighting.x_mm
        assert len(around.neighbours) == len(seen) - 1
        assert [row.get("is_ahead", False) for row in one.rows("plan")] == [False]

    run(story)


def test_two_looks_at_what_nobody_moved_agree(cell: Any) -> None:
    """Recognition reads the same part a tenth of a millimetre and of a degree off."""

    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT, LAST)
        again = replace(NEXT, x_mm=80.1, theta_rad=0.002, box_px=(81, 0, 101, 19))
        await one.next(again, LAST)
        await one.plan()
        assert one.rows("plan_dropped") == []
        assert one.now.asked == []
        assert one.record.part.sighting is again  # what is known of it is the fresh look's

    run(story)


@pytest.mark.parametrize(
    ("turns", "turn_deg", "is_kept"),
    [((0.0, 90.0, 180.0, -90.0), 90.0, True), ((0.0, 180.0), 90.0, False), (None, 37.0, True)],
)
def test_a_turn_that_nobody_can_see_is_read_as_planned(
    cell: Any, turns: tuple[float, ...] | None, turn_deg: float, *, is_kept: bool
) -> None:
    """Of a part with four equal sides each look may name another one as its first."""

    async def story() -> None:
        one = cell()
        one.ahead.turns = turns
        await one.first(FIRST, NEXT)
        turn_rad = float(np.radians(turn_deg))
        T = np.eye(4)
        c, s = np.cos(turn_rad), np.sin(turn_rad)
        T[:2, :2] = (c, -s), (s, c)
        T[:2, 3] = NEXT.x_mm, NEXT.y_mm
        await one.next(replace(NEXT, theta_rad=turn_rad, T_world_part=T))
        part = one.record.part
        assert (part.plan_ahead is not None) is is_kept
        # in the frame of the plan, or as it was read
        expected = NEXT.T_world_part if is_kept else T
        assert part.sighting.T_world_part == pytest.approx(expected, abs=1e-9)
        row = one.rows("sightings")[-1]["sightings"][0]
        assert row["theta_deg"] == pytest.approx(0.0 if is_kept else turn_deg, abs=1e-6)

    run(story)


def test_a_plan_that_is_still_being_made_is_waited_for(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        one.ahead.may_go_on.clear()
        await one.first(FIRST, NEXT)
        fresh = asyncio.create_task(one.next(NEXT))
        for _ in range(20):
            await asyncio.sleep(0)
        assert not fresh.done()
        one.ahead.may_go_on.set()
        await fresh
        await one.plan()
        assert one.now.asked == []

    run(story)


def test_no_plan_ahead_is_no_fault(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        one.ahead.refuses = True
        await one.first(FIRST, NEXT)
        await one.next(NEXT)
        await one.plan()
        assert [kind for kind, _ in one.now.asked] == ["plan"]

    run(story)


@pytest.mark.parametrize("more", [{"ahead": False}, {"count": 1}])
def test_nothing_is_planned_ahead_without_a_worker_or_another_part_to_do(
    cell: Any, more: dict[str, Any]
) -> None:
    async def story() -> None:
        one = cell(**more)
        await one.first(FIRST, NEXT)
        for _ in range(10):
            await asyncio.sleep(0)
        assert one.ahead.asked == []

    run(story)


def test_a_part_that_may_be_another_one_is_left_to_the_fresh_look(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        twin = Alternative("twin", 0, 0.0, np.eye(4))
        await one.first(FIRST, at("plate", 80.0, ambiguous_with=(twin,)))
        for _ in range(10):
            await asyncio.sleep(0)
        assert not any(kind == "plan" for kind, _ in one.ahead.asked)

    run(story)


def stored(nest: int, tray: str = "accept") -> StoredFields:
    return StoredFields(tray=tray, nest=nest, part="plate", T_world_part=matrix(np.eye(4)))


@pytest.mark.parametrize(
    ("put", "is_kept"), [((stored(0),), True), ((), False), ((stored(0, "reject"),), False)]
)
def test_a_plan_ahead_counts_on_the_nest_that_the_part_before_gets(
    cell: Any, put: tuple[StoredFields, ...], is_kept: bool
) -> None:
    async def story() -> None:
        one = cell(nests=4)
        await one.first(FIRST, NEXT)
        await one.ahead.plans.wait()
        one.record.trays.stored = put
        await one.next(NEXT)
        assert (one.record.part.plan_ahead is not None) is is_kept
        assert bool(one.rows("plan_dropped")) is not is_kept

    run(story)


def test_a_grasp_that_failed_meanwhile_is_not_planned_with(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT)
        await one.ahead.plans.wait()
        one.product.budgets.fail(GRASP + "A1", "it slipped")
        await one.next(NEXT)
        assert one.record.part.plan_ahead is None
        assert "a grasp is avoided" in one.rows("plan_dropped")[0]["reason"]

    run(story)


def test_after_a_person_was_asked_nothing_ahead_is_believed(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT)
        one.taking.forget()
        await one.next(NEXT)
        assert one.record.part.plan_ahead is None

    run(story)


def test_a_lost_part_is_sought_again_without_the_plan_for_the_next_one(cell: Any) -> None:
    async def story() -> None:
        one = cell()
        await one.first(FIRST, NEXT)
        # the part at hand fell out of the gripper, and lies elsewhere
        fallen = at("plate", 40.0)
        assert await one.taking.take((fallen, NEXT))
        assert one.record.part.sighting is fallen
        assert one.record.part.plan_ahead is None
        # it is found and done; the next one still lies where its plan begins
        await one.next(NEXT)
        await one.plan()
        assert [kind for kind, _ in one.now.asked if kind == "plan"] == []

    run(story)
