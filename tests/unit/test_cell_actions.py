"""Single actions and services of the cell, each built by its constructor with small fakes."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions import (
    AbortMotionAction,
    Actions,
    CompleteAction,
    PlaceAction,
    WithdrawAction,
)
from controller.cell.batch import RunProgress
from controller.cell.custody import Custody
from controller.cell.devices.stopping import Stopping
from controller.cell.errors import InterlockError, PartFaultError, PartProblemError
from controller.cell.journal import Body, Journal, read_rows
from controller.cell.journal.rows import HoldNoted, Intent, PathBegun, StoodFree
from controller.cell.machine import Budgets, Effect, Event, PartFault
from controller.cell.services import (
    Disambiguation,
    Gate,
    Interlocks,
    Leases,
    Motion,
    Permits,
    Recoveries,
    Retries,
    fault_policy,
)
from controller.cell.services.records import AboveTray, BatchRecord, grasp_of
from controller.config import FaultsSection, load_cell
from controller.inspection import PartVerdict, Verdict
from controller.planning import Grasp, NoMotionError
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.io_modbus import Signal

ANY: Any = SimpleNamespace
ROOT = Path(__file__).parents[2]
LAYOUT = build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))


@pytest.fixture
def journal(tmp_path: Path) -> Any:
    opened = Journal(tmp_path / "journal.sqlite", "run")
    yield opened
    opened.close()


@pytest.fixture
def record(journal: Journal) -> BatchRecord:
    return record_of(journal, 1)


def record_of(journal: Journal, count: int) -> BatchRecord:
    """Return the record of a batch of so many parts of one recipe, its first part begun."""
    product: Any = ANY(number=0, count=count, budgets=Budgets(1_000, 1_000))
    made = BatchRecord(journal, RunProgress(), lambda: None, products=(product,))
    made.begin_part()
    return made


def recoveries_of(record: BatchRecord, **faults: Any) -> Recoveries:
    section = FaultsSection.model_validate(faults)
    return Recoveries(record, lambda: fault_policy(section), CellClock(1000.0))


def leases_of(record: BatchRecord) -> Leases:
    return Leases(record.note, CellClock(1000.0))


def test_a_state_begins_without_the_label_of_the_one_before(journal: Journal) -> None:
    shown = RunProgress()
    lines: list[tuple[str, str]] = []
    record = BatchRecord(journal, shown, lambda: lines.append((shown.state, shown.label)))
    record.show_state("planning")
    record.show("planning")
    record.show_state("grasping")
    record.show("pick it up")
    record.show_state("grasping")  # no change: what the operator sees still holds
    assert lines[-3:] == [("grasping", ""), ("grasping", "pick it up"), ("grasping", "pick it up")]


def test_how_long_a_plan_takes_is_shown_while_it_is_followed_only(journal: Journal) -> None:
    shown = RunProgress()
    record = BatchRecord(journal, shown, lambda: None)
    record.show("place in tray accept", remaining_s=25.0)
    record.show_state("placing")
    assert shown.remaining_s == 25.0
    record.show_state("complete", is_at_work=False)
    assert shown.remaining_s is None


class Arm:
    """Goes wherever it is sent."""

    def __init__(self) -> None:
        self.been: list[float] = []

    async def move_joints(self, q: np.ndarray) -> None:
        self.been.append(float(q[0]))

    async def read_q(self) -> np.ndarray:
        return at(self.been[-1])


def at(x: float) -> np.ndarray:
    return np.array([x, 0, 0, 0, 0, 0])


def io(signal: Signal = Signal.OK) -> Any:
    return SimpleNamespace(signal=lambda name: signal)


def motion_of(arm: Any, inputs: Any = None, note: Any = lambda row: None) -> Motion:
    clock = CellClock(1000.0)
    permits = Permits(ANY(write=lambda row: None))
    permits.issue("start")
    interlocks = interlocks_of(inputs or io(), clock)
    return Motion(arm, interlocks, clock, Gate(permits, clock), LAYOUT, note)


def interlocks_of(inputs: Any, clock: CellClock) -> Interlocks:
    async def status() -> Any:
        return ANY(opening_mm=85.0, is_moving=False, has_contact=False)

    fixed: Any = ANY(status=status, max_opening_mm=85.0)
    record: Any = ANY()
    retries = Retries(record, lambda: fault_policy(FaultsSection()), clock)
    return Interlocks(inputs, fixed, LAYOUT, lambda: Custody.ON_TABLE, retries)


async def test_a_slow_motion_is_made_of_short_moves_on_its_line_and_the_rest_of_whole_ones() -> (
    None
):
    """At 23 degrees a second the shoulder takes 2 s for 46: five moves of 0.4 s each."""
    made: list[tuple[float, float]] = []

    class Slow(Arm):
        async def move_joints(self, q: np.ndarray, *, speed_share: float = 1.0) -> None:
            made.append((float(np.degrees(q[0])), speed_share))
            await super().move_joints(q)

    arm = Slow()
    arm.been.append(0.0)
    motion = motion_of(arm)
    await motion.follow((at(np.radians(46.0)), at(np.radians(-23.0))), 0.25)
    places, shares = zip(*made, strict=True)
    np.testing.assert_allclose(places, [9.2, 18.4, 27.6, 36.8, 46.0, -23.0])
    assert shares == (0.25,) * 5 + (1.0,)
    made.clear()
    await motion.go_back(1, 0.25)  # 69 degrees in 3 s
    places, shares = zip(*made, strict=True)
    np.testing.assert_allclose(places, -23.0 + 69.0 / 8 * np.arange(1, 9))
    assert set(shares) == {0.25}


async def test_the_way_back_is_the_way_in_backwards_as_far_as_the_arm_stood_free() -> None:
    arm = Arm()
    motion = motion_of(arm)
    await motion.start_from(at(0))
    await motion.follow((at(1), at(2)))
    motion.mark_free()
    assert not motion.can_go_back
    await motion.follow((at(3), at(4)))
    await motion.go_back(2)
    assert arm.been == [0, 1, 2, 3, 4, 3, 2]


async def test_with_the_door_open_the_arm_stays_where_it_is() -> None:
    arm = Arm()
    motion = motion_of(arm, io(Signal.NOT_OK))
    with pytest.raises(InterlockError):
        await motion.follow((at(1),))
    assert arm.been == []


class Gripper:
    """Both grippers of the cell, as the actions see them."""

    is_something_in_fixed = False

    def __init__(self, record: BatchRecord) -> None:
        self.record = record
        self.done: list[str] = []

    async def openings_mm(self) -> tuple[float, float]:
        return 20.0, 85.0

    async def open_fixed(self, opening_mm: float | None = None) -> None:
        self.done.append("open fixed")

    async def press_and_require_hold(self) -> None:
        self.done.append("check")

    async def let_go(self, intent: Intent, opening_mm: float, retreat: Any) -> None:
        self.done.append(f"{intent.name} {intent.as_json()}")


class Paths:
    """Knows a path home from some places only."""

    def __init__(self, *free_x: float) -> None:
        self.free_x = free_x

    async def path_home(self, q: np.ndarray, *_: object) -> Any:
        if float(q[0]) not in self.free_x:
            raise NoMotionError("boxed in")
        return (at(100),)


async def test_an_arm_that_is_boxed_in_goes_back_until_a_path_leads_home(
    record: BatchRecord,
) -> None:
    arm, gripper = Arm(), Gripper(record)
    motion = motion_of(arm)
    await motion.start_from(at(0))
    await motion.follow((at(1), at(2), at(3)))
    record.part.custody = Custody.LOST
    compute: Any = Paths(1)
    action = WithdrawAction(compute, motion, gripper, recoveries_of(record), record)  # type: ignore[arg-type]
    assert await action.run() is Event.WITHDRAWN
    assert arm.been == [0, 1, 2, 3, 2, 1, 100]
    assert gripper.done == ["open fixed"]  # what was lost may hang there, and does not


async def test_an_arm_that_no_path_leads_home_is_a_persons(record: BatchRecord) -> None:
    arm: Any = Arm()
    motion = motion_of(arm)
    await motion.start_from(at(0))
    await motion.follow((at(1),))
    action = WithdrawAction(
        ANY(path_home=Paths().path_home), motion, Gripper(record), recoveries_of(record), record,  # type: ignore[arg-type]
    )  # fmt: skip
    with pytest.raises(PartProblemError) as error:
        await action.run()
    assert error.value.code == "no_way_home"
    assert arm.been == [0, 1, 0]


@pytest.mark.parametrize(
    ("names", "left", "says"),
    [
        (("holder", "widget"), (1,), "is widget, the recipe is for holder"),
        (("holder", "widget"), (0, 1), "decide between holder and widget"),
        (("holder", "holder"), (0, 1), "decide between 2 poses of holder"),
    ],
)
async def test_a_view_that_does_not_show_the_recipes_part_alone_is_a_part_fault(
    record: BatchRecord, names: tuple[str, ...], left: tuple[int, ...], says: str
) -> None:
    with pytest.raises(PartFaultError, match=says) as error:
        await resolved(record, names, left)
    assert error.value.fault is PartFault.AMBIGUOUS


async def test_a_view_of_no_hypothesis_is_a_persons(record: BatchRecord) -> None:
    says = "matches none of holder, widget; take it out with"
    with pytest.raises(PartProblemError, match=says):
        await resolved(record, ("holder", "widget"), ())


async def resolved(record: BatchRecord, names: tuple[str, ...], left: tuple[int, ...]) -> None:
    async def identify(*_: object) -> tuple[int, ...]:
        return left

    ambiguity = ANY(hypotheses=[ANY(name=name) for name in names], light="backlit")
    view = Disambiguation(ANY(identify=identify), record)
    await view.resolve(ambiguity, ANY(width_mm=20.0, opening_mm=20.0), at(0), ANY(), ())


@pytest.mark.parametrize(
    ("verdict", "tray"),
    [
        (Verdict.PASS, "accept"),
        (Verdict.FAIL, "reject"),
        (Verdict.INDETERMINATE, "quarantine"),
    ],
)
async def test_a_part_goes_into_the_tray_its_verdict_names(
    record: BatchRecord, verdict: Verdict, tray: str
) -> None:
    arm: Any = Arm()
    trays = {name: number for number, name in enumerate(("accept", "reject", "quarantine"), 1)}
    step = {
        name: ANY(motion=(at(n),), motion_down=(), motion_up=(), open_mm=30.0)
        for name, n in trays.items()
    }
    part: Any = record.part
    part.plan = ANY(place=step, park=dict.fromkeys(trays, ANY(motion=(at(0),))))
    part.verdict = PartVerdict(verdict, ("because",), (), 1.0, ())
    steps: Any = ANY(begin=lambda step: 0.0, end=lambda *_, **__: None)
    gripper: Any = Gripper(record)
    assert await PlaceAction(steps, motion_of(arm), gripper, record).run() is Event.PLACED
    assert (part.tray, part.custody) == (tray, Custody.PLACED)
    assert arm.been == [trays[tray], 0]
    # it is looked at before it is let go, not after
    assert gripper.done == ["check", "check", f"sort {{'tray': '{tray}'}}"]


@pytest.mark.parametrize(
    ("verdict", "went_to", "been"),
    [
        (Verdict.PASS, "accept", []),  # it stands there already
        (Verdict.FAIL, "accept", [1.5, 0.5, 2.5, 2.0]),  # back the way it came, then to the other
        (Verdict.INDETERMINATE, "quarantine", []),
    ],
)
async def test_an_arm_that_went_on_before_the_verdict_ends_above_the_right_tray(
    record: BatchRecord, verdict: Verdict, went_to: str, been: list[float]
) -> None:
    arm: Any = Arm()
    trays = {name: number for number, name in enumerate(("accept", "reject", "quarantine"), 1)}
    step = {
        name: ANY(
            tray=name, motion=(at(n + 0.5), at(n)), motion_down=(at(n + 10),), motion_up=(at(n),),
            open_mm=30.0,
        )
        for name, n in trays.items()
    }  # fmt: skip
    part: Any = record.part
    part.plan = ANY(place=step, park=dict.fromkeys(trays, ANY(motion=(at(0),))))
    part.verdict = PartVerdict(verdict, ("because",), (), 1.0, ())
    ended: list[float] = []
    steps: Any = ANY(
        begin=lambda step: 7.0, end=lambda step, started_s, **__: ended.append(started_s)
    )
    motion = motion_of(arm)
    await motion.start_from(at(0.5))  # where the last view was presented
    await motion.follow(step[went_to].motion)
    part.above_tray = AboveTray(went_to, 3.0)
    arm.been.clear()
    assert await PlaceAction(steps, motion, Gripper(record), record).run() is Event.PLACED  # type: ignore[arg-type]
    tray = {Verdict.PASS: "accept", Verdict.FAIL: "reject"}.get(verdict, "quarantine")
    assert (part.tray, part.above_tray) == (tray, None)
    assert arm.been == [*been, trays[tray] + 10, trays[tray], 0]
    # its seconds count from when the arm set out for the tray that it is in
    assert ended == [3.0 if tray == went_to else 7.0]


async def test_the_lamps_stay_on_until_the_last_part_is_done(journal: Journal) -> None:
    record = record_of(journal, 2)
    dark: list[int] = []

    async def all_dark() -> None:
        dark.append(record.parts_left)

    action = CompleteAction(record, ANY(all_dark=all_dark))
    events = []
    for _ in range(2):
        record.part.verdict = PartVerdict(Verdict.PASS, ("fine",), (), 1.0, ())
        record.part.tray = "accept"
        events.append(await action.run())
        record.begin_part()
    assert events == [Event.PART_DONE, Event.BATCH_DONE]
    assert dark == [0]
    assert [part.number for part in record.finished] == [1, 2]


async def test_an_abort_writes_down_which_device_confirmed_it(
    journal: Journal, tmp_path: Path
) -> None:
    dropped: list[bool] = []

    async def confirm(*_: object) -> None: ...

    async def refuse(*_: object) -> None:
        raise OSError("gone")

    stopping = Stopping(ANY(stop=confirm), ANY(stop=refuse), ANY(all_off=confirm), CellClock())
    views: Any = ANY(drop_pending=lambda: dropped.append(True))
    assert await AbortMotionAction(stopping, views, journal).run() is Event.ABORT_DONE
    assert dropped == [True]
    rows = [(row.name, row.body["device"]) for row in read_rows(tmp_path / "journal.sqlite")]
    assert rows == [("stopped", "arm"), ("stop_not_confirmed", "gripper"), ("stopped", "lights")]


def test_an_effect_without_an_action_is_known_before_anything_moves(record: BatchRecord) -> None:
    with pytest.raises(ValueError, match="no action for abort_motion"):
        Actions(dict.fromkeys(list(Effect)[:2], ANY()), recoveries_of(record), leases_of(record))


async def test_a_part_fault_leads_where_its_recovery_action_says(record: BatchRecord) -> None:
    async def fail() -> Event:
        raise PartFaultError(PartFault.GRASP_MISSED, "on nothing")

    actions = Actions(
        dict.fromkeys(Effect, ANY(run=fail)), recoveries_of(record), leases_of(record)
    )
    events = [await actions.perform(Effect.GRASP) for _ in range(2)]
    assert events == [Event.GRASP_MISSED] * 2
    with pytest.raises(PartProblemError, match="waits for you"):
        await actions.perform(Effect.GRASP)


def test_a_drop_that_two_notice_is_booked_once(record: BatchRecord) -> None:
    recoveries = recoveries_of(record)
    for words in ("by the jaws", "by the keep-alive"):
        recoveries.book(PartFaultError(PartFault.DROPPED, words))
    assert [one.reason for one in record.part.recoveries] == ["by the jaws"]
    recoveries.forget_drop()
    recoveries.book(PartFaultError(PartFault.DROPPED, "again"))
    assert len(record.part.recoveries) == 2


async def test_the_journal_knows_the_way_back_before_the_arm_sets_out() -> None:
    noted: list[Body] = []

    class Bold(Arm):
        async def move_joints(self, q: np.ndarray) -> None:
            announced = [w[0] for row in noted if isinstance(row, PathBegun) for w in row.waypoints]
            assert not noted or float(q[0]) in announced
            await super().move_joints(q)

    motion = motion_of(Bold(), note=noted.append)
    await motion.start_from(at(0))
    await motion.follow((at(1), at(2)))
    motion.mark_free()
    await motion.follow((at(3), at(4)))
    await motion.go_back(2)
    short = [
        f"free {row.q[0]:g}" if isinstance(row, StoodFree)
        else f"{'back' if row.is_back else 'on'} {' '.join(f'{w[0]:g}' for w in row.waypoints)}"
        for row in noted if isinstance(row, StoodFree | PathBegun)
    ]  # fmt: skip
    assert short == ["free 0", "on 1 2", "free 2", "on 3 4", "back 3 2"]


def test_a_grasp_is_read_from_its_row_to_the_last_bit(
    record: BatchRecord, journal: Journal
) -> None:
    T = np.eye(4)
    T[:3, 3] = [1 / 3, np.pi, -1e-9]
    grasp = Grasp(
        id="g7", T_part_tcp=T, opening_mm=20.1, pre_open_mm=30.2, contact_mm2=55.5, load=0.1,
        score=0.7, holder="arm", margin=0.95, is_inner=True, on_table=True,
    )  # fmt: skip
    record.expect_hold(grasp)
    record.take_hold(grasp, 19.8)
    expected, held = (
        HoldNoted.model_validate(row.body) for row in read_rows(journal.path) if row.name == "hold"
    )
    again = grasp_of(held.grasp)
    assert (again.T_part_tcp == T).all()
    assert [getattr(again, one.name) for one in fields(Grasp) if one.name != "T_part_tcp"] == [
        "g7", 20.1, 30.2, 55.5, 0.1, 0.7, "arm", 0.95, True, True
    ]  # fmt: skip
    assert (expected.is_expected, held.is_expected) == (True, False)
    assert (held.opening_mm, held.number, expected.number) == (19.8, 1, 1)
