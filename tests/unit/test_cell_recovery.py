"""What the cell does when a part slips, falls or fails to be handed off, with scripted devices.

The table, the actions and the journal are the real ones; arm, fixed gripper, cameras and the
compute service are fakes that keep one fact: who has the part. Plans are drawn by hand.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cell.batch import PartRecord, RunProgress, assemble, product_of
from controller.cell.compute import Located
from controller.cell.custody import ALONE, Custody
from controller.cell.custody.release_guard import ReleaseGuard
from controller.cell.errors import PartFaultError, PartProblemError, ReleaseRefusedError
from controller.cell.journal import Journal, read_rows
from controller.cell.machine import (
    BACK,
    ENDS,
    ENTRY,
    PARKING,
    STILL_HELD,
    WORK,
    Act,
    Budgets,
    CellMachine,
    Effect,
    Event,
    PartFault,
    Recovery,
    decide,
)
from controller.cell.services import fault_policy
from controller.cell.services.records import Shown
from controller.config import FaultsSection, load_cell, load_recipe
from controller.config.view_set import load_view_set, parse_view_set
from controller.imaging import inverse_pose
from controller.inspection import FaceVerdict, PartInspection, PartVerdict, Verdict, ViewResult
from controller.planning import (
    Ambiguity,
    FaceToShowAgain,
    GiveStep,
    Grasp,
    InArm,
    InFixedGripper,
    Look,
    NoPlanError,
    OnTable,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    Proof,
    ReceiveStep,
    SetDown,
    Start,
    Step,
    shown_pose,
)
from controller.planning.model import HeldHypothesis
from controller.recognition import Sighting
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.errors import ArmStalledError
from drivers.gripper_modbus import Hold
from drivers.io_modbus import Signal
from drivers.wires import UNTAPPED

ROOT = Path(__file__).parents[2]
LAYOUT = build_layout(load_cell(ROOT / "recipes/cells/emulated.yaml"))
SAMPLES = 10
WIDTH_MM, FIXTURE_MM = 20.0, 30.0
EYE = np.eye(4)


def grasp(name: str, holder: Any = "arm", width: float = WIDTH_MM) -> Grasp:
    return Grasp(name, EYE, width, width + 8, 100.0, 0.3, 0.9, holder)


A, B, F = grasp("A"), grasp("B"), grasp("F", "fixture", FIXTURE_MM)


def q(number: float) -> np.ndarray:
    return LAYOUT.park_q + np.array([number / 100, 0, 0, 0, 0, 0])


def mask(*samples: int) -> np.ndarray:
    out = np.zeros(SAMPLES, dtype=bool)
    out[list(samples)] = True
    return out


def pick() -> Pick:
    return Pick(
        seconds=1.0, label="pick", grasp=A, motion_in=(q(1), q(2)), pre_open_mm=28.0,
        motion_down=(q(3),), expected_opening_mm=WIDTH_MM, motion_up=(q(4),),
    )  # fmt: skip


def show(name: str, at: float, *samples: int, held: Grasp = A) -> Present:
    return Present(
        seconds=1.0, label=f"show {name}", view_id=name, grasp=held, motion=(q(at),), q=q(at),
        T_world_part=shown_pose(LAYOUT, q(at), held.T_part_tcp),
        direction_part=np.array([0.0, 0.0, 1.0]), seen=mask(*samples), square_to=-1,
        expected_opening_mm=WIDTH_MM,
    )  # fmt: skip


def over() -> GiveStep:
    return GiveStep(
        seconds=1.0, label="hand off", grasp=A, fixed_grasp=F, fixed_pre_open_mm=60.0,
        motion=(q(20), q(21)), fixed_expected_opening_mm=FIXTURE_MM, arm_open_mm=28.0,
        retreat=(q(22),),
    )  # fmt: skip


def back() -> ReceiveStep:
    return ReceiveStep(
        seconds=1.0, label="receive back", grasp=B, fixed_grasp=F, motion_in=(q(23),),
        pre_open_mm=28.0, approach=(q(24),), expected_opening_mm=WIDTH_MM, fixed_open_mm=60.0,
        motion_out=(q(25),),
    )  # fmt: skip


def down() -> SetDown:
    return SetDown(
        seconds=1.0, label="set down", grasp=A, motion=(q(30),), motion_down=(q(31),), open_mm=28.0,
        motion_up=(q(32),), T_world_part=EYE, pose_index=1,
    )  # fmt: skip


def plan(*steps: Step) -> Plan:
    place = Place(
        seconds=1.0, label="place", tray="accept", grasp=A, motion=(q(40),), motion_down=(q(41),),
        open_mm=28.0, motion_up=(q(42),), T_world_part=EYE, tilt_rad=0.0,
    )  # fmt: skip
    park = Park(seconds=1.0, label="park", motion=(LAYOUT.park_q,))
    trays = ("accept", "reject", "quarantine")
    return Plan(
        steps=steps, place={t: replace(place, tray=t) for t in trays},
        park=dict.fromkeys(trays, park), covered_fraction=1.0, covered_U=0.0,
        reachable_fraction=1.0, unseen=(), grasps=(A,), proof=Proof(0.0, 0.0, "none"),
    )  # fmt: skip


@dataclass
class PaperCell:
    """The one fact, and what was done to it. Faults are functions called at each arm move."""

    clock: CellClock
    has: str = "table"
    q: np.ndarray = field(default_factory=lambda: LAYOUT.park_q)
    hand_mm: float = 85.0
    fixture_mm: float = 85.0
    at_move: Callable[[int], None] = lambda number: None
    moves: list[np.ndarray] = field(default_factory=list)
    opened_on_part: list[str] = field(default_factory=list)
    fixture_openings: list[tuple[int, float]] = field(default_factory=list)
    take_back_mm: float = WIDTH_MM
    fixture_takes: bool = True
    grasps: int = 0
    miss: int = 0

    # the arm
    async def move_joints(self, target: np.ndarray) -> None:
        self.moves.append(target)
        self.q = target
        self.at_move(len(self.moves))

    async def read_q(self) -> np.ndarray:
        return self.q

    async def move_gripper_mm(self, opening_mm: float) -> float:
        if opening_mm > self.hand_mm and self.has in ("arm", "both"):
            if self.has == "arm":
                self.opened_on_part.append("arm")
            self.has = "fixture" if self.has == "both" else "table"
        self.hand_mm = opening_mm
        return opening_mm

    async def grasp(self, force: int, *, speed_share: float = 1.0) -> float:
        self.grasps += 1
        if self.has == "table" and np.allclose(self.q, q(3)):
            if self.miss:
                self.miss -= 1
                self.hand_mm = 0.0
                return 0.0
            self.has = "arm"
        elif self.has == "fixture" and np.allclose(self.q, q(24)):
            self.hand_mm = self.take_back_mm
            if abs(self.take_back_mm - WIDTH_MM) < 2:
                self.has = "both"
            return self.hand_mm
        self.hand_mm = WIDTH_MM if self.has in ("arm", "both") else 0.0
        return self.hand_mm

    async def read_opening_mm(self) -> float:
        return self.hand_mm

    async def stop(self, *args: object) -> None:
        return None


class PaperFixture:
    """The fixed gripper of a paper cell."""

    max_opening_mm = 85.0

    def __init__(self, cell: PaperCell) -> None:
        self.cell = cell

    async def hold(self) -> Hold:
        return Hold.HELD if self.cell.has in ("fixture", "both") else Hold.LOST

    async def status(self) -> Any:
        has_contact = self.cell.has in ("fixture", "both")
        return SimpleNamespace(
            opening_mm=self.cell.fixture_mm, has_contact=has_contact, is_moving=False
        )

    async def open_to(self, opening_mm: float) -> None:
        if self.cell.has == "fixture":
            self.cell.opened_on_part.append("fixture")
            self.cell.has = "table"
        if self.cell.has == "both":
            self.cell.has = "arm"
        self.cell.fixture_mm = opening_mm
        self.cell.fixture_openings.append((len(self.cell.moves), opening_mm))

    async def close_on(self, opening_mm: float, force_n: float) -> Any:
        if self.cell.fixture_takes and self.cell.has == "arm":
            self.cell.has = "both"
            self.cell.fixture_mm = FIXTURE_MM
            return SimpleNamespace(opening_mm=FIXTURE_MM, object_detected=True)
        self.cell.fixture_mm = 4.0
        return SimpleNamespace(opening_mm=4.0, object_detected=True)


class PaperCamera:
    """A picture is bright where the part is in the hand while it is taken."""

    is_paused = True

    def __init__(self, cell: PaperCell) -> None:
        self.cell = cell

    async def pause(self) -> None:
        return None

    async def resume(self) -> None:
        return None

    async def frame_after(self, t_s: float, timeout_s: float) -> Any:
        level = 255 if self.cell.has == "arm" else 254
        return SimpleNamespace(image=np.full((64, 64), level, np.uint8), white=255)


class PaperLights:
    names = ("table_backlight", "station_backlight")

    async def set(self, levels: Mapping[str, float], settle: bool) -> float:
        return 0.0

    async def all_off(self) -> None:
        return None


@dataclass
class PaperCompute:
    """Answers from lists; notes what it was asked."""

    cell: PaperCell
    plans: list[Plan | NoPlanError]
    starts: list[Start] = field(default_factory=list)
    asked_seen: list[np.ndarray | None] = field(default_factory=list)
    avoided: list[frozenset[str]] = field(default_factory=list)
    short: list[frozenset[FaceToShowAgain]] = field(default_factory=list)
    short_faces: list[tuple[int, ...]] = field(default_factory=list)  # of each judging
    shown: list[str] = field(default_factory=list)
    in_field: bool = True
    parkings: list[Start] = field(default_factory=list)
    to_trays: Plan | None = field(default_factory=plan)
    looks: int = 0
    shift_mm: dict[str, float] = field(default_factory=dict)
    blind: set[str] = field(default_factory=set)
    identified: tuple[int, ...] = ()
    hold_searches: int = 0
    located: dict[str, Located] = field(default_factory=dict)
    ahead_counts: list[int] = field(default_factory=list)
    by_view: dict[str, np.ndarray] = field(default_factory=dict)

    async def prepare(self) -> float:
        return 0.0

    async def recognise(self, glowing: Any, lit: Any) -> tuple[Sighting, ...]:
        self.looks += 1
        if self.cell.has != "table" or not self.in_field:
            return ()
        return (
            Sighting(
                part="holder", pose_index=0, R=EYE[:3, :3], x_mm=0.0, y_mm=0.0, theta_rad=0.0,
                T_world_part=EYE, score=1.0, covariance=None, ambiguous_with=(), area_mm2=1.0,
                box_px=(0, 0, 1, 1), residual_px=0.1,
            ),
        )  # fmt: skip

    async def plan(
        self,
        start: Start,
        seen: Any,
        avoid: frozenset[str],
        alternatives: Any,
        around: Any,
        short: frozenset[FaceToShowAgain],
    ) -> Plan:
        assert around == ALONE
        self.short.append(short)
        self.starts.append(start)
        self.asked_seen.append(None if seen is None else seen.copy())
        self.avoided.append(avoid)
        answer = self.plans.pop(0)
        if isinstance(answer, NoPlanError):
            raise answer
        for step in answer.presents:
            self.by_view[step.view_id] = step.seen
        return answer

    async def plan_to_trays(self, start: Start, avoid: frozenset[str], around: Any) -> Plan:
        self.parkings.append(start)
        if self.to_trays is None:
            raise NoPlanError("no way to a tray")
        return self.to_trays

    async def path_home(self, *args: object) -> tuple[np.ndarray, ...]:
        return (LAYOUT.park_q,)

    async def locate(
        self, view: str, expected: Any, holder: Any, backlit: Any, *more: object
    ) -> Located:
        name = re.sub(r"~\d+$", "", view)
        in_hand = backlit[0, 0] == 255 and name not in self.blind
        self.shown.append(name)
        T = expected.copy()
        T[0, 3] += self.shift_mm.pop(name, 0.0)
        self.located[view] = Located(in_hand, "" if in_hand else "no outline", T)
        return self.located[view]

    async def inspect(self, view: str, *args: object) -> ViewResult:
        return self._result(view)

    def _result(self, view: str) -> ViewResult:
        if view not in self.located:
            seen = mask(8, 9)
            return ViewResult(view, True, "", EYE, EYE, 0.0, 0.0, 0.0, (), seen, np.zeros((0, 2)))
        name = re.sub(r"~\d+$", "", view)
        where = self.located[view]
        in_hand = where.evaluated
        return ViewResult(
            view_id=view, evaluated=in_hand, reason=where.reason,
            T_world_part_expected=where.T_world_part,
            T_world_part_measured=where.T_world_part if in_hand else None,
            shift_mm=0.0, turn_rad=0.0, residual_px=0.1,
            findings=(), compared=self.by_view[name] if in_hand else mask(),
            outline_px=np.zeros((0, 2)),
        )  # fmt: skip

    async def inspect_on_table(self, view: str, T: Any, *more: object) -> ViewResult:
        self.shown.append(re.sub(r"~\d+$", "", view))
        return ViewResult(view, True, "", T, T, 0.0, 0.0, 0.0, (), mask(8, 9), np.zeros((0, 2)))

    async def identify(self, *args: object) -> tuple[int, ...]:
        return self.identified

    async def find_hold(self, expected: Any, *args: object) -> Any:
        self.hold_searches += 1
        return expected if self.cell.has == "arm" else None

    async def judge_ahead(self, set_path: Path, text: str, view_count: int) -> bool:
        assert parse_view_set(set_path, text).views
        self.ahead_counts.append(view_count)
        return len(self.ahead_counts) % 2 == 1

    async def judge(self, set_path: Path) -> PartInspection:
        views = tuple(self._result(view.id) for view in load_view_set(set_path).views)
        assert views  # what is judged can be read by anybody
        short = self.short_faces.pop(0) if self.short_faces else ()
        verdict = Verdict.INDETERMINATE if short else Verdict.PASS
        faces = tuple(
            FaceVerdict(i, f"F{i} plane", 9.0, 0.4, Verdict.NOT_EVALUATED, (), "dark")
            for i in short
        )
        ledger = PartVerdict(verdict, ("fine",), faces, 1.0, (), short_faces=short)
        return PartInspection(verdict, ("fine",), views, (), (), ledger)

    async def surface_share(self, samples: np.ndarray) -> float:
        return float(samples.sum()) / SAMPLES


class PaperRun:
    """Drives table and actions, event by event, until the cell rests."""

    def __init__(self, folder: Path, *plans: Plan | NoPlanError) -> None:
        clock = CellClock(1000.0)
        self.cell = PaperCell(clock)
        self.compute = PaperCompute(self.cell, list(plans))
        devices: Any = SimpleNamespace(
            arm=self.cell,
            gripper=PaperFixture(self.cell),
            lights=PaperLights(),
            io=SimpleNamespace(signal=self._signal),
            overhead=PaperCamera(self.cell),
            inspection=PaperCamera(self.cell),
            wires=UNTAPPED,
        )
        self.journal = folder / "journal.sqlite"
        self._journal = Journal(self.journal, "run")
        cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
        holder = product_of(self.compute, load_recipe(ROOT / "recipes/holder.yaml"), cell)
        batch = assemble(
            (holder,), cell, LAYOUT, devices, clock, self._journal, folder, RunProgress(),
            lambda: None,
        )  # fmt: skip
        self.record, self.actions, self._motion = batch.record, batch.actions, batch.motion
        self._gate = batch.gate
        self.machine = CellMachine("idle")
        self.problem: PartProblemError | None = None
        self.states: list[str] = []

    def learns_by(self, budgets: Budgets) -> None:
        self.record.products = (replace(self.record.product, budgets=budgets),)

    def _signal(self, name: str) -> Signal:
        if name == "part_in_gripper":
            return Signal.OK if self.cell.has in ("fixture", "both") else Signal.NOT_OK
        return Signal.OK

    def run(self) -> PaperRun:
        asyncio.run(asyncio.wait_for(self._run(), 600))
        self._journal.close()
        return self

    async def _run(self) -> None:
        self._gate.permits.issue("start")
        await self._motion.start_from(LAYOUT.park_q)
        event = Event.START
        while True:
            decision = self.machine.dispatch(event)
            assert decision.answer == "handled", (event, decision)
            self.states.append(decision.target.removeprefix("execute_"))
            if not decision.effects:
                return
            try:
                event = await self.actions.perform(decision.effects[0])
            except PartProblemError as problem:
                self.problem, event = problem, Event.PART_PROBLEM

    @property
    def troubles(self) -> list[str]:
        rows = read_rows(self.journal)
        return [r.body["trouble"] for r in rows if r.name == "recovery"]

    @property
    def custody(self) -> list[str]:
        return [r.name for r in read_rows(self.journal) if r.kind == "custody"]

    def was_well(self) -> None:
        assert self.problem is None, self.problem
        assert self.machine.state == "complete"
        assert self.record.finished[0].tray == "accept"
        assert self.cell.opened_on_part == ["arm"]  # once, over the tray


def test_nothing_going_wrong_recovers_from_nothing(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0, 1), over(), back(), show("v2", 11, 2, held=B))
    ).run()
    run.was_well()
    assert run.troubles == []
    assert run.compute.shown == ["v1", "v2"]


def test_a_part_that_falls_is_taken_again_and_its_seen_faces_are_left_out(tmp_path: Path) -> None:
    first = plan(pick(), show("v1", 10, 0, 1), show("v2", 11, 2, 3), show("v3", 12, 4))
    # the second planner is stubborn and shows v1 again: the cell passes it by once the hold is seen
    second = plan(pick(), show("v3", 12, 4), show("v1", 10, 0, 1))
    run = PaperRun(tmp_path, first, second)

    def fall(number: int) -> None:
        if np.allclose(run.cell.q, q(12)) and run.cell.has == "arm" and len(run.compute.starts) < 2:
            run.cell.has = "table"

    run.cell.at_move = fall
    run.run()
    run.was_well()
    assert run.troubles == ["part_lost"]
    seen = run.compute.asked_seen[1]
    assert seen is not None
    assert (seen == mask(0, 1, 2, 3)).all()
    assert run.compute.shown == ["v1", "v2", "v3"]
    assert isinstance(run.compute.starts[1], OnTable)
    assert run.custody == ["in_arm", "lost", "on_table", "in_arm", "placed"]


def test_a_part_that_fell_out_of_the_cameras_sight_is_asked_for(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, plan(pick(), show("v1", 10, 0)))

    def fall(number: int) -> None:
        if np.allclose(run.cell.q, q(10)):
            run.cell.has, run.compute.in_field = "table", False

    run.cell.at_move = fall
    run.run()
    assert run.machine.state == "held"
    assert run.problem is not None
    assert run.problem.code == "part_lost"
    assert "camera over the table" in str(run.problem)
    assert run.troubles == ["part_lost", "part_not_seen", "part_not_seen"]
    assert run.compute.looks == 1 + 3  # it may have been rolling: the table is looked at again
    assert run.record.part.custody is Custody.LOST


def test_a_part_that_falls_again_and_again_is_a_persons(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, *[plan(pick(), show("v1", 10, 0)) for _ in range(9)])

    def fall(number: int) -> None:
        if np.allclose(run.cell.q, q(10)) and run.cell.has == "arm":
            run.cell.has = "table"

    run.cell.at_move = fall
    run.run()
    assert run.machine.state == "held"
    assert run.problem is not None
    assert run.problem.code == "part_lost"
    assert run.troubles == ["part_lost"] * 2


def test_a_missed_grip_is_tried_again_from_a_new_look(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, plan(pick()), plan(pick(), show("v1", 10, 0)))
    run.cell.miss = 1
    run.run()
    run.was_well()
    assert run.troubles == ["grip_missed"]
    assert run.states.count("acquiring") == 2


def test_a_grip_measured_far_from_the_planned_one_is_planned_on_with_as_it_is(
    tmp_path: Path,
) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), show("v2", 11, 1)), plan(show("v2", 11, 1))
    )
    run.compute.shift_mm["v1"] = 2.5
    run.run()
    run.was_well()
    assert run.troubles == ["held_otherwise"]
    start = run.compute.starts[1]
    assert isinstance(start, InArm)
    # the hand is where it was, the part 2.5 mm along x from where it should be
    T = shown_pose(LAYOUT, q(10), EYE)
    T[0, 3] += 2.5
    expected = inverse_pose(T) @ shown_pose(LAYOUT, q(10), EYE)
    assert np.allclose(start.grasp.T_part_tcp, expected, atol=1e-9)
    assert run.compute.shown == ["v1", "v2"]


def test_a_hand_off_that_fails_keeps_the_part_and_is_planned_anew(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path,
        plan(pick(), show("v1", 10, 0), over(), back()),
        plan(over(), back()),
        plan(show("v2", 11, 1)),
    )
    run.cell.fixture_takes = False
    run.run()
    run.was_well()
    assert run.troubles == ["hand_off_failed", "hand_off_failed"]
    assert all(isinstance(start, InArm) for start in run.compute.starts[1:])
    # among the arm's fingers it opens no wider than on the way in; wide once the arm has left
    at = next(i for i, move in enumerate(run.cell.moves) if np.allclose(move, q(21)))
    opened = [mm for count, mm in run.cell.fixture_openings if count == at + 1]
    assert opened == [60.0]
    assert (at + 3, 85.0) in run.cell.fixture_openings
    # the second failure rules the grip out
    assert run.compute.avoided == [frozenset(), frozenset(), frozenset({"F"})]
    # the way back is the way in, backwards, to where the view was
    at = next(i for i, move in enumerate(run.cell.moves) if np.allclose(move, q(21)))
    assert [float(m[0]) for m in run.cell.moves[at : at + 3]] == [
        pytest.approx(float(q(n)[0])) for n in (21, 20, 10)
    ]


def test_a_take_back_that_fails_leaves_the_part_in_the_fixed_gripper(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path,
        plan(pick(), show("v1", 10, 0), over(), back(), show("v2", 11, 1, held=B)),
        plan(back(), show("v2", 11, 1, held=B)),
    )
    run.cell.take_back_mm = 33.0  # other faces than planned, so not this grip again

    def heal(number: int) -> None:
        if len(run.compute.starts) == 2:
            run.cell.take_back_mm = WIDTH_MM

    run.cell.at_move = heal
    run.run()
    run.was_well()
    assert run.troubles == ["take_back_failed"]
    start = run.compute.starts[1]
    assert isinstance(start, InFixedGripper)
    assert run.compute.avoided[1] == {"B"}
    T_world_part = shown_pose(LAYOUT, q(21), EYE)
    assert np.allclose(T_world_part @ start.grasp.T_part_tcp, LAYOUT.T_world_fixed_tcp, atol=1e-9)
    assert run.compute.shown == ["v1", "v2"]


def test_without_a_new_plan_a_held_part_goes_on_with_the_old_one(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), show("v2", 11, 1)), NoPlanError("none today")
    )
    run.compute.shift_mm["v1"] = 2.5
    run.run()
    run.was_well()
    assert run.compute.shown == ["v1", "v2"]


def test_what_the_camera_over_the_table_shows_counts_as_far_as_the_plan_says(
    tmp_path: Path,
) -> None:
    look = Look(
        seconds=0.0, label="look", view_id="top", T_world_part=EYE,
        direction_part=np.array([0.0, 0.0, 1.0]), seen=mask(7, 8),
    )  # fmt: skip
    again = NoPlanError("nothing more")
    run = PaperRun(tmp_path, plan(look, pick(), show("v1", 10, 0)), again).run()
    run.was_well()
    # sample 7 was promised by the look and not compared: one more plan is asked for
    assert run.compute.shown == ["top", "v1"]
    seen = run.compute.asked_seen[1]
    assert seen is not None
    assert (seen == mask(0, 8)).all()


def test_a_part_set_down_is_looked_at_and_taken_with_another_grip(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), down()), plan(pick(), show("v2", 11, 1))
    ).run()
    assert run.problem is None
    assert run.machine.state == "complete"
    assert run.troubles == []
    assert run.custody == ["in_arm", "on_table", "in_arm", "placed"]
    assert run.states.count("withdrawing") == 1


def test_what_could_not_be_compared_gets_one_more_plan_and_no_second(tmp_path: Path) -> None:
    first = plan(pick(), show("v1", 10, 0), show("v2", 11, 1, 2))
    run = PaperRun(tmp_path, first, plan(show("v3", 12, 1, 2)))
    run.compute.blind = {"v2", "v3"}
    run.run()
    run.was_well()
    assert run.troubles == ["seen_too_little"]
    assert run.compute.shown == ["v1", "v2", "v3"]
    seen = run.compute.asked_seen[1]
    assert seen is not None
    assert (seen == mask(0)).all()


def test_a_face_of_which_too_little_was_compared_is_shown_from_another_grasp(
    tmp_path: Path,
) -> None:
    first = plan(pick(), show("v1", 10, 0, 1, 2))
    again = plan(show("v3", 12, 1))
    run = PaperRun(tmp_path, first, again)
    run.compute.short_faces = [(3,)]
    run.run()
    run.was_well()
    assert run.troubles == ["seen_too_little"]
    assert run.compute.shown == ["v1", "v3"]
    assert run.compute.short == [
        frozenset(),
        frozenset(FaceToShowAgain(grasp.id, 3) for grasp in first.grasps),
    ]
    rows = list(read_rows(run.journal))
    assert [row.body["verdict"] for row in rows if row.name == "verdict"] == ["pass"]


def test_a_face_that_no_other_grasp_shows_stays_open(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, plan(pick(), show("v1", 10, 0, 1, 2)), plan())
    run.compute.short_faces = [(3,), (3,)]
    run.run()
    assert run.problem is None
    assert run.compute.shown == ["v1"]
    assert run.troubles == ["seen_too_little"]
    assert run.record.finished[0].tray == "quarantine"


def test_a_further_plan_that_promises_next_to_nothing_is_not_driven(tmp_path: Path) -> None:
    first = plan(pick(), show("v1", 10, 0), show("v2", 11, 1, 2))
    run = PaperRun(tmp_path, first, plan(show("v1", 10, 0)))
    run.compute.blind = {"v2"}
    run.run()
    run.was_well()
    assert run.compute.shown == ["v1", "v2"]


def test_a_part_taken_over_without_a_plan_is_driven_even_a_plan_that_promises_nothing(
    tmp_path: Path,
) -> None:
    """The interrupted run had planned again for what was not seen: its old plan is gone."""
    run = PaperRun(tmp_path, plan(pick(), show("v1", 10, 8)))
    recognise = run.compute.recognise

    async def seen_before() -> ViewResult:
        return await run.compute.inspect_on_table("v0", EYE, None, None)

    async def take_over(glowing: Any, lit: Any) -> tuple[Sighting, ...]:
        part = run.record.part
        part.recoveries = [Recovery(PartFault.SEEN_TOO_LITTLE, "too little", Act.OTHER_VIEW)]
        part.files["v0"] = {"table_backlight": "pictures/v0.png"}
        part.pending.append(
            Shown(
                view="v0", hold=None, q=q(0), expected=EYE, holder=(),
                backlit=np.zeros((4, 4), np.uint8), lamps=(),
                is_hold_measured=False, T_part_tcp=None, task=asyncio.create_task(seen_before()),
            )
        )  # fmt: skip
        return await recognise(glowing, lit)

    run.compute.recognise = take_over  # type: ignore[method-assign]
    run.run()
    run.was_well()
    assert run.compute.shown == ["v0", "v1"]


# --- decisions ----------------------------------------------------------------------------------


POLICY = fault_policy(FaultsSection())
# what the cell does by itself, fault by fault, written down by hand: actions in order, then the end
BY_DEFAULT = {
    "grasp_missed": ["re_pose", "re_pose", "hold"],
    "grasp_wrong": ["re_pose", "re_pose", "hold"],
    "dropped": ["re_pose", "re_pose", "hold"],
    "not_seen": ["retry", "retry", "hold"],
    "hold_not_seen": ["re_pose", "re_pose", "hold"],
    "held_otherwise": ["re_pose", "re_pose", "re_pose", "re_pose", "park_part"],
    "hand_off_failed": ["retry", "regrasp", "park_part"],
    "receive_failed": ["regrasp", "regrasp", "park_part"],
    "seen_too_little": ["other_view", "skip_characteristic"],
    "ambiguous": ["park_part"],
}


@pytest.mark.parametrize("fault", list(PartFault))
def test_each_fault_is_recovered_from_as_often_as_listed_and_then_ends(fault: PartFault) -> None:
    past: list[Recovery] = []
    done = []
    while (act := decide(POLICY, fault, past).act) not in ENDS:
        past.append(Recovery(fault, "again", act))
        done.append(act.value)
        assert len(past) < 10
    assert [*done, act.value] == BY_DEFAULT[fault.name.lower()]


def test_all_faults_together_are_bounded_too() -> None:
    past: list[Recovery] = []
    for fault in [t for t in PartFault for _ in range(9)]:
        if decide(POLICY, fault, past).act not in ENDS:
            past.append(Recovery(fault, "again"))
    learnt = {PartFault.HELD_OTHERWISE, PartFault.SEEN_TOO_LITTLE}
    assert sum(one.fault not in learnt for one in past) == 6


@pytest.mark.parametrize("fault", list(PartFault))
def test_a_part_above_tray_to_the_quarantine_tray_is_not_parked_again(fault: PartFault) -> None:
    past = [Recovery(fault, "again")] * 20
    assert decide(POLICY, fault, past, is_parked=True).act in (Act.HOLD, Act.SKIP)


def test_a_recipe_replaces_single_classes_of_the_cells_policy() -> None:
    cell = FaultsSection.model_validate({"grasp_missed": [{"do": "abort"}], "times_in_all": 9})
    recipe = FaultsSection.model_validate(
        {"dropped": [{"do": "re_pose", "times": 5, "delay_s": 3}, {"do": "hold"}]}
    )
    policy = fault_policy(cell.replaced_by(recipe))
    assert policy.times_in_all == 9
    assert decide(policy, PartFault.GRASP_MISSED, []).act is Act.ABORT
    rung = decide(policy, PartFault.DROPPED, [Recovery(PartFault.DROPPED, "x")] * 4)
    assert (rung.act, rung.delay_s) == (Act.RE_POSE, 3)


@pytest.mark.parametrize(
    ("fault", "stages"),
    [
        (PartFault.GRASP_MISSED, ["grasping"]),
        (PartFault.GRASP_WRONG, ["grasping"]),
        (PartFault.DROPPED, ["grasping", "presenting", "handing", "lowering", "placing"]),
        (PartFault.NOT_SEEN, ["recognising"]),
        (PartFault.HOLD_NOT_SEEN, ["inspecting", "planning"]),
        (PartFault.HELD_OTHERWISE, ["inspecting", "presenting"]),
        (PartFault.HAND_OFF_FAILED, ["handing"]),
        (PartFault.RECEIVE_FAILED, ["handing"]),
        (PartFault.SEEN_TOO_LITTLE, ["inspecting"]),
        (PartFault.AMBIGUOUS, ["presenting"]),
    ],
)
def test_the_table_takes_each_recovery_wherever_its_fault_comes_up(
    fault: PartFault, stages: list[str]
) -> None:
    events = {BACK[fault][0]} | ({PARKING[0]} if fault in STILL_HELD else set())
    for stage in stages:
        for event in events:
            assert CellMachine(f"execute_{stage}").dispatch(event).answer == "handled"


# --- parking ------------------------------------------------------------------------------------


def test_a_part_that_no_hand_off_takes_goes_into_the_quarantine_tray(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), over(), back()), *[plan(over(), back())] * 2
    )
    run.cell.at_move = lambda number: setattr(run.cell, "fixture_takes", False)
    run.run()
    assert run.problem is None
    assert run.machine.state == "complete"
    assert run.troubles == ["hand_off_failed"] * 3
    (start,) = run.compute.parkings
    assert isinstance(start, InArm)
    part = run.record.finished[0]
    assert part.tray == "quarantine"
    assert part.verdict is not None
    assert part.verdict.verdict is Verdict.INDETERMINATE  # judged PASS by what was shown
    assert part.verdict.reasons[0].startswith("parked: hand-off: the fixed gripper closed to")


def deciding(at: float) -> Present:
    """The view that tells a holder from its twin, and from itself in another pose."""
    solid: Any = SimpleNamespace()
    lying = tuple(HeldHypothesis(name, solid, EYE) for name in ("holder", "twin", "holder"))
    return replace(show("D0", at), ambiguity=Ambiguity(lying, "backlit", 2.0))


def test_a_part_that_the_deciding_view_knows_is_inspected(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, plan(pick(), deciding(9), show("v1", 10, 0, 1)))
    run.compute.identified = (0,)
    run.run().was_well()
    assert run.troubles == []


@pytest.mark.parametrize(
    ("left", "reason"),
    [
        ((0, 1), "does not decide between holder and twin"),
        ((0, 2), "does not decide between 2 poses of holder"),
        ((1,), "the part in the arm gripper is twin, the recipe is for holder"),
    ],
)
def test_a_part_that_may_be_another_goes_into_the_quarantine_tray(
    tmp_path: Path, left: tuple[int, ...], reason: str
) -> None:
    run = PaperRun(tmp_path, plan(pick(), deciding(9), show("v1", 10, 0, 1)))
    run.compute.identified = left
    run.run()
    assert run.problem is None, run.problem
    assert run.machine.state == "complete"
    assert run.troubles == ["ambiguous"]
    part = run.record.finished[0]
    assert part.tray == "quarantine"
    assert part.verdict is not None
    assert part.verdict.verdict is Verdict.INDETERMINATE
    assert reason in part.verdict.reasons[0]
    assert "v1" not in run.compute.shown  # it is not judged by the CAD of another part
    assert run.compute.hold_searches == 0


def test_what_looks_like_no_hypothesis_is_held_for_a_person(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, plan(pick(), deciding(9), show("v1", 10, 0, 1)))
    run.run()
    assert run.machine.state == "held"
    assert run.problem is not None
    assert run.problem.code == "unknown_object"


def test_a_part_that_cannot_be_parked_is_held_and_a_person_is_called(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), over(), back()), *[plan(over(), back())] * 2
    )
    run.compute.to_trays = None
    run.cell.at_move = lambda number: setattr(run.cell, "fixture_takes", False)
    run.run()
    assert run.machine.state == "held"
    assert run.problem is not None
    assert run.problem.code == "hand_off_failed"
    assert "cannot be parked: no way to a tray" in str(run.problem)
    assert run.record.part.custody is Custody.IN_ARM


def test_a_parked_part_that_falls_is_picked_up_and_parked_still(tmp_path: Path) -> None:
    run = PaperRun(
        tmp_path, plan(pick(), show("v1", 10, 0), over(), back()), *[plan(over(), back())] * 2
    )
    run.compute.to_trays = plan()
    fell: list[int] = []

    def fault(number: int) -> None:
        run.cell.fixture_takes = False
        if run.compute.parkings and not fell and np.allclose(run.cell.q, q(40)):
            fell.append(number)
            run.cell.has, run.compute.to_trays = "table", plan(pick())

    run.cell.at_move = fault
    run.run()
    assert run.problem is None, run.problem
    assert run.troubles == [*["hand_off_failed"] * 3, "part_lost"]
    assert [type(start) for start in run.compute.parkings] == [InArm, OnTable]
    assert run.record.finished[0].tray == "quarantine"


# --- lowering -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("above_mm", "is_let_go"), [(3.7, True), (30.0, False)])
def test_a_slipped_part_that_touches_down_early_is_let_go_there_but_not_high_above(
    tmp_path: Path, above_mm: float, is_let_go: bool
) -> None:
    run = PaperRun(tmp_path, plan(pick(), show("v1", 10, 0)))

    def meet(number: int) -> None:
        if np.allclose(run.cell.q, q(41)):
            run.cell.q = q(41) + np.array([0, 0, 0, above_mm, 0, 0])  # the fourth joint is zed
            raise ArmStalledError("arm: zed stalled")

    run.cell.at_move = meet
    if not is_let_go:
        with pytest.raises(ArmStalledError):
            run.run()
        assert run.cell.has == "arm"
        return
    run.run()
    run.was_well()
    (row,) = (r.body for r in read_rows(run.journal) if r.name == "touched_down")
    assert row["left_mm"] == pytest.approx(above_mm, abs=0.1)


# --- what a batch learns --------------------------------------------------------------------------


def test_a_source_is_avoided_once_it_has_failed_so_often_within_its_window() -> None:
    budgets = Budgets(demote_after=2, window=3)
    assert budgets.fail("grasp A", "slipped") is None
    budgets.succeed("grasp A")
    budgets.succeed("grasp A")
    assert budgets.fail("grasp A", "slipped") is None  # the first failure is out of the window
    assert budgets.fail("view A-V1", "dark") is None
    demotion = budgets.fail("grasp A", "slipped again")
    assert demotion is not None
    assert (demotion.failure_count, demotion.use_count, demotion.reason) == (2, 3, "slipped again")
    assert budgets.grasps == {"A"}
    assert budgets.fail("grasp A", "x") is None  # reported once


def test_a_grasp_that_slips_again_and_again_is_not_planned_for_later_parts(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, *[plan(pick(), show("v1", 10, 0)) for _ in range(4)])
    run.learns_by(Budgets(demote_after=2, window=20))

    def fall(number: int) -> None:
        is_held = np.allclose(run.cell.q, q(10)) and run.cell.has == "arm"
        if is_held and len(run.compute.starts) < 3:
            run.cell.has = "table"

    run.cell.at_move = fall
    run.run()
    run.was_well()
    # the third plan, after the second slip, leaves it out
    assert run.compute.avoided == [frozenset(), frozenset(), frozenset({"A"})]
    rows = [r.body for r in read_rows(run.journal) if r.name == "demoted"]
    assert [(r["source"], r["failures"]) for r in rows] == [("grasp A", 2)]


def test_without_a_plan_but_by_avoided_grasps_they_are_used_after_all(tmp_path: Path) -> None:
    run = PaperRun(tmp_path, NoPlanError("none without A"), plan(pick(), show("v1", 10, 0)))
    run.learns_by(Budgets(demote_after=1, window=5))
    run.record.budgets.fail("grasp A", "slipped")
    run.run()
    run.was_well()
    assert run.compute.avoided == [frozenset({"A"}), frozenset()]


def test_only_views_that_were_truly_compared_are_remembered() -> None:
    part = PartRecord(1)
    assert part.in_sight is None
    good = ViewResult("a", True, "", EYE, EYE, 0, 0, 0, (), mask(1), np.zeros((0, 2)))
    part.results = [
        good,
        replace(good, evaluated=False, compared=mask(5)),
        replace(good, compared=mask(2)),
    ]
    assert part.in_sight is not None
    assert (part.in_sight == mask(1, 2)).all()


# --- never both open ----------------------------------------------------------------------------


def guard_of(cell: PaperCell) -> ReleaseGuard:
    between = lambda name: Signal.OK if cell.has in ("fixture", "both") else Signal.NOT_OK  # noqa: E731
    arm: Any = cell
    fixture: Any = PaperFixture(cell)
    io: Any = SimpleNamespace(signal=between)
    return ReleaseGuard(arm, fixture, io)


BOOKS = {"table": Custody.ON_TABLE, "arm": Custody.IN_ARM, "both": Custody.IN_BOTH,
         "fixture": Custody.IN_FIXED}  # fmt: skip


@given(
    st.sampled_from(["arm", "both", "fixture"]),
    st.sampled_from([Custody.IN_ARM, Custody.IN_BOTH, Custody.IN_FIXED, Custody.UNKNOWN]),
    st.lists(st.sampled_from(["hand", "fixture"]), min_size=1, max_size=4),
)
def test_no_order_of_openings_leaves_a_held_part_without_a_holder_while_the_books_name_one(
    has: str, booked: Custody, openings: list[str]
) -> None:
    # the books may be wrong in one way only: a receiver that is believed to hold and does not
    if booked is not Custody.UNKNOWN and BOOKS[has] is not booked and booked is not Custody.IN_BOTH:
        return
    cell = PaperCell(CellClock(), has=has)
    cell.hand_mm = WIDTH_MM if has in ("arm", "both") else 0.0
    cell.fixture_mm = FIXTURE_MM if has in ("fixture", "both") else 4.0
    guard = guard_of(cell)

    async def open_all() -> None:
        custody = booked
        for which in openings:
            try:
                if which == "hand":
                    await guard.open_arm(80.0, custody)
                    custody = Custody.IN_FIXED if custody is Custody.IN_BOTH else custody
                else:
                    await guard.open_fixed(80.0, custody, WIDTH_MM)
                    custody = Custody.IN_ARM if custody is Custody.IN_BOTH else custody
            except ReleaseRefusedError:
                continue

    asyncio.run(open_all())
    assert cell.has in ("arm", "both", "fixture")
    assert cell.opened_on_part == []


def test_the_hand_lets_go_on_purpose_only_where_it_says_so() -> None:
    cell = PaperCell(CellClock(), has="arm", hand_mm=WIDTH_MM)
    guard = guard_of(cell)
    with pytest.raises(ReleaseRefusedError, match="alone holds"):
        asyncio.run(guard.open_arm(80.0, Custody.IN_ARM))
    asyncio.run(guard.open_arm(80.0, Custody.IN_ARM, lets_go=True))
    assert cell.has == "table"


def test_a_lost_part_that_hangs_in_the_fixed_gripper_keeps_it_closed() -> None:
    cell = PaperCell(CellClock(), has="fixture", fixture_mm=25.0)
    with pytest.raises(ReleaseRefusedError, match="between"):
        asyncio.run(guard_of(cell).open_fixed(85.0, Custody.LOST, 0.0))


def test_no_jaw_of_the_cell_opens_but_through_the_guard() -> None:
    opening = re.compile(r"\.(move_gripper_mm|open_jaws|open_to|open_on|activate)\(")
    found = {
        (file.name, match.group(1))
        for file in sorted((ROOT / "controller/cell").rglob("*.py"))
        for match in opening.finditer(file.read_text())
        # a measured gripper passes on what it is told, in the driver's own readings
        if file.name not in ("release_guard.py", "measured_gripper.py")
    }
    # activating moves the jaws, and comes after homing has found the fixed gripper empty;
    # `cellctl recover` opens for a person who holds the part and said so
    assert found == {("grippers.py", "activate"), ("releasing.py", "open_to")}


def test_commissioning_opens_jaws_that_a_visit_has_found_empty_or_a_person_holds_below() -> None:
    folder = ROOT / "controller/bring_up"
    opening = re.compile(r"\.(move_gripper_mm|open_jaws|open_to|open_on)\(")
    found = {file.name for file in folder.rglob("*.py") if opening.search(file.read_text())}
    # `boards` and `taking` open on a plate for a person who has said that they hold it; `touching`
    # and `hand_off` open the arm's jaws about a plate that the fixed gripper holds; jogging has a
    # rule of its own; a dry run (`session`) opens empty ones
    assert found == {
        "bench.py",
        "boards.py",
        "devices.py",
        "guided.py",
        "hand_off.py",
        "jogger.py",
        "look.py",
        "session.py",
        "taking.py",
        "touching.py",
    }
    assert "require_empty_grippers" in (folder / "visit.py").read_text()


def test_every_effect_of_recovery_is_something_the_actions_can_do() -> None:
    done = {*ENTRY.values(), *WORK.values()}
    assert {Effect.WITHDRAW, Effect.SET_DOWN} <= done
    for error in PartFault:
        assert PartFaultError(error, "x").code == error.value
