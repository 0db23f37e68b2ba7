"""The fixed gripper confirms its hold by pressing: it only closes, and what it finds is believed.

A fake fixed gripper has one fact, how wide what is between its jaws is, and keeps all that it was
sent to do. What has to follow is written down by hand.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controller.cell.actions.recover import RecoverAction
from controller.cell.custody import Custody
from controller.cell.errors import InterlockError, NoPermitError, PartFaultError, PartProblemError
from controller.cell.journal import Journal, Once, read_rows, rows
from controller.cell.recovery import Case, Interrupted, Leaving, Opens, Proposal
from controller.cell.services import Gate, Grippers, Permits, Retries, fault_policy
from controller.cell.services.records import BatchRecord, RunProgress
from controller.config import FaultsSection
from drivers.clock import CellClock
from drivers.kinds import Hold, Signal

ANY: Any = SimpleNamespace
EYE = tuple(tuple(float(x) for x in row) for row in np.eye(4))
HELD_MM = 30.0
FURTHER_MM = 8.0  # the jaws are sent so much further than the part (drivers/gripper_modbus)


@dataclass
class Fixed:
    """A stopped fixed gripper; `part_mm` is the width of what is between its jaws."""

    part_mm: float = HELD_MM
    stands_mm: float = HELD_MM
    events: list[str] = field(default_factory=list)
    targets_mm: list[float] = field(default_factory=list)
    is_held: bool = False
    max_opening_mm: float = 85.0

    async def status(self) -> Any:
        return ANY(opening_mm=self.stands_mm, has_contact=self.is_held, is_moving=False)

    async def hold(self) -> Hold:
        return Hold.HELD if self.is_held else Hold.NOTHING

    async def close_on(self, opening_mm: float, force_n: float) -> Any:
        assert force_n == 20.0
        target_mm = max(0.0, opening_mm - FURTHER_MM)
        assert target_mm <= self.stands_mm, "the jaws would open"
        self.events.append("press")
        self.targets_mm.append(target_mm)
        self.stands_mm = min(self.stands_mm, max(target_mm, self.part_mm))
        self.is_held = self.part_mm > target_mm
        return ANY(opening_mm=self.stands_mm, object_detected=self.is_held)

    async def open_to(self, opening_mm: float) -> None:
        self.events.append("the fixed gripper opens")


class Cell:
    """Grippers with a real gate, record and journal."""

    def __init__(self, folder: Path) -> None:
        clock = CellClock(1000.0)
        self.journal = Journal(folder / "journal.sqlite", "run")
        self.fixed = Fixed()
        self.events = self.fixed.events
        self.record = BatchRecord(self.journal, RunProgress(), lambda: None)
        self.record.begin_part()
        self.permits = Permits(self.journal)
        self.permits.issue("start")
        self.barred = ""
        arm: Any = ANY(move_gripper_mm=self._arm_opens)
        grasp: Any = ANY(force_n=20.0, width_tolerance_mm=2.0)
        self.grippers = Grippers(
            arm, self.fixed, ANY(signal=lambda name: Signal.OK), self.record, lambda: grasp,
            Gate(self.permits, clock), ANY(admit_jaws=self._admit),
            Retries(self.record, lambda: fault_policy(FaultsSection()), clock),
        )  # fmt: skip

    def _admit(self) -> None:
        if self.barred:
            raise InterlockError(self.barred, "guard_closed")

    async def _arm_opens(self, opening_mm: float) -> float:
        self.events.append("the arm gripper opens")
        return opening_mm

    @property
    def custodies(self) -> list[str]:
        return [row.name for row in read_rows(self.journal.path) if row.kind == "custody"]


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.journal.close()


@pytest.mark.parametrize(
    ("force_n", "setting_per_n", "setting"),
    [(30.0, 1.0, 30), (30.0, 1.5, 45), (60.0, 1.5, 60), (20.0, 0.5, 20)],
)
async def test_the_cell_file_makes_a_force_a_setting_of_the_arm_gripper(
    force_n: float, setting_per_n: float, setting: int, cell: Cell
) -> None:
    given: list[int] = []

    async def grasp(force: int) -> float:
        given.append(force)
        return HELD_MM

    arm: Any = ANY(grasp=grasp)
    about: Any = ANY(force_n=force_n, width_tolerance_mm=2.0)
    clock = CellClock(1000.0)
    grippers = Grippers(
        arm, cell.fixed, ANY(signal=lambda name: Signal.OK), cell.record, lambda: about,
        Gate(cell.permits, clock), ANY(admit_jaws=lambda: None),
        Retries(cell.record, lambda: fault_policy(FaultsSection()), clock), setting_per_n,
    )  # fmt: skip
    await cell.record.set_custody(Custody.ON_TABLE)
    await grippers.close_arm(Once.GRASP, HELD_MM)
    assert given == [setting]


async def test_a_part_that_is_there_is_held_again_and_nothing_opened(cell: Cell) -> None:
    await cell.record.set_custody(Custody.IN_FIXED)
    await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert cell.events == ["press"]
    assert cell.custodies == ["in_fixture"]
    await cell.grippers.require_fixed_holds()


async def test_jaws_that_stand_narrower_are_not_sent_wider(cell: Cell) -> None:
    await cell.record.set_custody(Custody.IN_FIXED)
    cell.fixed.stands_mm = cell.fixed.part_mm = HELD_MM - 1
    await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert cell.fixed.targets_mm == [HELD_MM - 1 - FURTHER_MM]


async def test_nothing_between_the_jaws_is_a_lost_part(cell: Cell) -> None:
    await cell.record.set_custody(Custody.IN_FIXED)
    cell.fixed.part_mm = 0.0
    with pytest.raises(PartFaultError, match="left the fixed gripper"):
        await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert cell.custodies == ["in_fixture", "lost"]


@pytest.mark.parametrize(
    ("custody", "part_mm"),
    # held by both, the arm gripper may have what the fixed gripper has not; and a part that gives
    # in by 3 mm is not held as it was
    [(Custody.IN_BOTH, 0.0), (Custody.IN_FIXED, HELD_MM - 3), (Custody.IN_BOTH, HELD_MM - 3)],
)
async def test_a_part_that_is_held_otherwise_is_for_a_person(
    cell: Cell, custody: Custody, part_mm: float
) -> None:
    await cell.record.set_custody(custody)
    cell.fixed.part_mm = part_mm
    with pytest.raises(PartProblemError, match="pressed once more") as raised:
        await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert raised.value.code == "recovery_contradicted"
    assert not isinstance(raised.value, PartFaultError)
    assert cell.custodies[-1] == "unknown"
    assert cell.events == ["press"]


async def test_behind_an_open_door_it_does_not_press(cell: Cell) -> None:
    await cell.record.set_custody(Custody.IN_FIXED)
    cell.barred = "the door is open"
    with pytest.raises(InterlockError):
        await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert cell.events == []


async def test_without_a_permit_it_does_not_press(cell: Cell) -> None:
    await cell.record.set_custody(Custody.IN_FIXED)
    cell.permits.withdraw("stop")
    with pytest.raises(NoPermitError):
        await cell.grippers.press_fixed_and_require_hold(HELD_MM)
    assert cell.events == []


# --- going on -------------------------------------------------------------------------------------
def proposal(custody: Custody, opens: Opens = Opens.NONE) -> Proposal:
    grasp = rows.GraspFields(
        id="F1", T_part_tcp=EYE, opening_mm=HELD_MM, pre_open_mm=40.0, contact_mm2=50.0, load=0.1,
        score=0.9, holder="fixture",
    )  # fmt: skip
    left = Interrupted("old", 1, rows.RunBegan(), custody=custody)
    hold = rows.HoldNoted(gripper="fixed", grasp=grasp, T_part_tcp=EYE, opening_mm=HELD_MM)
    left.fixed_hold = hold
    left.expected_hold = hold.model_copy(update={"gripper": "arm"})
    case = Case(custody, opens=opens, is_fixed_unconfirmed=True, was=custody)
    way = Leaving((np.zeros(6),), is_free_at_end=True, is_back=False)
    return Proposal(
        left, case, np.zeros(6), way, Custody.IN_FIXED, ("", ), "", is_proven=True, person="",
    )  # fmt: skip


async def recover(cell: Cell, found: Proposal) -> Any:
    async def follow(*_: object) -> None:
        cell.events.append("the arm moves")

    async def take_over() -> Proposal:
        await cell.record.set_custody(found.left.custody)
        return found

    motion: Any = ANY(follow=follow, mark_free=lambda: None)
    action = RecoverAction(
        ANY(take_over=take_over), motion, cell.grippers, cell.record, cell.fixed, ANY(), ANY()
    )
    return await action.run()


async def test_the_arm_moves_only_once_the_press_has_confirmed_the_part(cell: Cell) -> None:
    await recover(cell, proposal(Custody.IN_FIXED))
    assert cell.events == ["press", "the arm moves"]


async def test_a_press_that_finds_nothing_sends_the_arm_away_and_the_part_is_looked_for(
    cell: Cell,
) -> None:
    cell.fixed.part_mm = 0.0
    with pytest.raises(PartFaultError) as raised:
        await recover(cell, proposal(Custody.IN_FIXED))
    assert raised.value.fault.value == "part_lost"
    assert cell.events == ["press", "the arm moves"]
    assert cell.custodies[-1] == "lost"


async def test_the_arm_gripper_opens_only_once_the_press_has_confirmed_the_part(cell: Cell) -> None:
    await recover(cell, proposal(Custody.IN_BOTH, Opens.ARM))
    assert cell.events == ["press", "the arm gripper opens", "the arm moves"]


@pytest.mark.parametrize("custody", [Custody.IN_BOTH, Custody.IN_FIXED])
async def test_the_arm_gripper_stays_closed_where_the_press_finds_nothing(
    cell: Cell, custody: Custody
) -> None:
    cell.fixed.part_mm = 0.0
    with pytest.raises(PartProblemError) as raised:
        await recover(cell, proposal(custody, Opens.ARM))
    assert not isinstance(raised.value, PartFaultError)  # which the cell would recover from
    assert cell.events == ["press"]
    assert cell.custodies[-1] == "unknown"


async def test_a_fixed_gripper_that_reports_its_hold_does_not_press(cell: Cell) -> None:
    cell.fixed.is_held = True
    found = proposal(Custody.IN_FIXED)
    await recover(cell, replace(found, case=replace(found.case, is_fixed_unconfirmed=False)))
    assert cell.events == ["the arm moves"]
