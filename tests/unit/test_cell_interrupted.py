"""What a start makes of a part in a gripper, for every moment at which a run can be cut off.

The way of one part is written down row by row, as the actions journal it, and beside it by hand
what has to follow at each cut: from what the two grippers do, not from the rules of the code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.cell.custody import Custody
from controller.cell.journal import Row, rows
from controller.cell.recovery import Proposal, World, fold_interrupted, propose
from drivers.kinds import Signal

ARM_MM, FIXED_MM, OPEN_MM, WIDE_MM = 20.0, 30.0, 40.0, 85.0
EYE = tuple(tuple(float(x) for x in row) for row in np.eye(4))


def q(x: float) -> tuple[float, ...]:
    return (x, 0.0, 0.0, 0.0, 0.0, 0.0)


def grasp(name: str, holder: str, opening_mm: float) -> rows.GraspFields:
    return rows.GraspFields(
        id=name, T_part_tcp=EYE, opening_mm=opening_mm, pre_open_mm=OPEN_MM, contact_mm2=50.0,
        load=0.1, score=0.9, holder=holder,
    )  # fmt: skip


def hold(number: int, *, is_expected: bool = False) -> rows.HoldNoted:
    return rows.HoldNoted(
        gripper="arm", grasp=grasp(f"A{number}", "arm", ARM_MM), T_part_tcp=EYE,
        opening_mm=ARM_MM, is_expected=is_expected, number=number,
    )  # fmt: skip


FIXED_HOLD = rows.HoldNoted(
    gripper="fixed", grasp=grasp("F1", "fixture", FIXED_MM), T_part_tcp=EYE, opening_mm=FIXED_MM
)


def path(*to: float) -> rows.PathBegun:
    return rows.PathBegun(waypoints=tuple(q(x) for x in to))


def free(x: float) -> rows.StoodFree:
    return rows.StoodFree(q=q(x))


def once(name: rows.Once, retreat: float | None = None, **more: float | str) -> rows.Intent:
    away = () if retreat is None else (q(retreat),)
    return rows.Intent.model_validate({"name": name, "retreat": away, **more})


def held_by(custody: Custody) -> rows.CustodyChanged:
    return rows.CustodyChanged(name=custody.key)


# One part's way: off the table, to a view, to the fixed gripper and back, into its tray. Joint
# values are places: 3 at the table, 7 and 10 at the fixed gripper, 13 over the tray.
WAY: tuple[tuple[str, rows.Body], ...] = (
    ("parked", free(0)),
    ("goes to the part", path(1, 2)),
    ("comes down", path(3)),
    ("expects grasp 1", hold(1, is_expected=True)),
    ("closes", once(rows.Once.GRASP, 2, expected_mm=ARM_MM)),
    ("has closed", rows.OnceDone(name=rows.Once.GRASP)),
    ("knows grasp 1", hold(1)),
    ("has it", held_by(Custody.IN_ARM)),
    ("lifts", path(2)),
    ("lifted", free(2)),
    ("goes to a view", path(4, 5)),
    ("at a view", free(5)),
    ("goes to the fixed gripper", path(6, 7)),
    ("fixed closes", once(rows.Once.HAND_OFF, expected_mm=FIXED_MM)),
    ("fixed has closed", rows.OnceDone(name=rows.Once.HAND_OFF)),
    ("both", held_by(Custody.IN_BOTH)),
    ("knows fixed grasp", FIXED_HOLD),
    ("arm opens", once(rows.Once.RELEASE_ARM, 8, open_mm=OPEN_MM)),
    ("arm has opened", rows.OnceDone(name=rows.Once.RELEASE_ARM)),
    ("fixed has it", held_by(Custody.IN_FIXED)),
    ("retreats", path(8)),
    ("retreated", free(8)),
    ("comes back", path(9)),
    ("approaches", path(10)),
    ("expects grasp 2", hold(2, is_expected=True)),
    ("closes again", once(rows.Once.RECEIVE, expected_mm=ARM_MM)),
    ("has closed again", rows.OnceDone(name=rows.Once.RECEIVE)),
    ("knows grasp 2", hold(2)),
    ("both again", held_by(Custody.IN_BOTH)),
    ("fixed opens", once(rows.Once.RELEASE_FIXED, 11, open_mm=WIDE_MM)),
    ("fixed has opened", rows.OnceDone(name=rows.Once.RELEASE_FIXED)),
    ("has it again", held_by(Custody.IN_ARM)),
    ("leaves", path(11)),
    ("left", free(11)),
    ("goes over the tray", path(12, 13)),
    ("lets go", once(rows.Once.SORT, 12, open_mm=OPEN_MM, tray="accept")),
    ("has let go", rows.OnceDone(name=rows.Once.SORT)),
)
NAMES = [name for name, _ in WAY]

# How the jaws of arm and fixed gripper may stand.
ARM_ON = {"arm_mm": ARM_MM, "is_arm_pressing": True}
ARM_OPEN = {"arm_mm": OPEN_MM, "is_arm_pressing": False}
ARM_SHUT = {"arm_mm": 0.5, "is_arm_pressing": True}
FIXED_ON = {"fixed_mm": FIXED_MM, "does_fixed_touch": True, "barrier": Signal.OK}
# stopped, it stands where it held the part and reports nothing of it; its light barrier does
FIXED_STOPPED = {"fixed_mm": FIXED_MM, "does_fixed_touch": False, "barrier": Signal.OK}
FIXED_OPEN = {"fixed_mm": WIDE_MM, "does_fixed_touch": False, "barrier": Signal.NOT_OK}
# the part between wide open jaws
FIXED_ROUND_IT = FIXED_OPEN | {"barrier": Signal.OK}
FIXED_SHUT = {"fixed_mm": 25.0, "does_fixed_touch": False, "barrier": Signal.NOT_OK}

# By hand: cut after this row; the jaws; where the arm stands; what follows: who has the part in the
# end, which gripper opens, the places the arm goes to, what became of the unresolved intent.
CUTS: tuple[tuple[str, dict[str, object], float, str, str, tuple[float, ...], str], ...] = (
    # the jaws closed, or had not yet: at the table the part rests in any case
    ("closes", ARM_ON | FIXED_OPEN, 3, "in_arm", "", (2,), "done"),
    ("closes", ARM_OPEN | FIXED_OPEN, 3, "on_table", "arm", (2,), "not done"),
    ("closes", ARM_SHUT | FIXED_OPEN, 3, "on_table", "arm", (2,), "unknown"),
    ("has closed", ARM_ON | FIXED_OPEN, 3, "in_arm", "", (2,), "done"),
    ("knows grasp 1", ARM_ON | FIXED_OPEN, 3, "in_arm", "", (2,), "done"),
    ("has it", ARM_ON | FIXED_OPEN, 3, "in_arm", "", (2,), ""),
    ("has it", ARM_SHUT | FIXED_OPEN, 3, "lost", "", (2,), ""),
    # on the way up it may only go on: back down the part would meet the table
    ("lifts", ARM_ON | FIXED_OPEN, 2.5, "in_arm", "", (2,), ""),
    ("lifts", ARM_ON | FIXED_OPEN, 2, "in_arm", "", (), ""),
    ("lifted", ARM_ON | FIXED_OPEN, 2, "in_arm", "", (), ""),
    ("goes to a view", ARM_ON | FIXED_OPEN, 2, "in_arm", "", (), ""),
    ("goes to a view", ARM_ON | FIXED_OPEN, 3, "in_arm", "", (2,), ""),
    ("goes to a view", ARM_ON | FIXED_OPEN, 4.5, "in_arm", "", (4, 2), ""),
    ("goes to a view", ARM_SHUT | FIXED_OPEN, 4.5, "lost", "", (4, 2), ""),
    ("at a view", ARM_ON | FIXED_OPEN, 5, "in_arm", "", (), ""),
    # the hand-off: until the arm gripper was to open, it keeps the part
    ("goes to the fixed gripper", ARM_ON | FIXED_ROUND_IT, 7, "in_arm", "", (6, 5), ""),
    ("fixed closes", ARM_ON | FIXED_ROUND_IT, 7, "in_arm", "fixed", (6, 5), "not done"),
    ("fixed closes", ARM_ON | FIXED_ON, 7, "in_arm", "fixed", (6, 5), "done"),
    ("fixed closes", ARM_ON | FIXED_SHUT, 7, "in_arm", "fixed", (6, 5), "unknown"),
    ("fixed has closed", ARM_ON | FIXED_ON, 7, "in_arm", "fixed", (6, 5), "done"),
    ("both", ARM_ON | FIXED_ON, 7, "in_arm", "fixed", (6, 5), ""),
    ("knows fixed grasp", ARM_ON | FIXED_ON, 7, "in_arm", "fixed", (6, 5), ""),
    # the arm gripper was to open: if it has, only the retreat leads away from the part
    ("arm opens", ARM_ON | FIXED_ON, 7, "in_arm", "fixed", (6, 5), "not done"),
    ("arm opens", ARM_ON | FIXED_SHUT, 7, "in_arm", "fixed", (6, 5), "not done"),
    ("arm opens", ARM_OPEN | FIXED_ON, 7, "in_fixture", "arm", (8,), "done"),
    ("arm opens", {"arm_mm": 22.0, "is_arm_pressing": False} | FIXED_ON, 7,
     "in_fixture", "arm", (8,), "unknown"),
    ("arm opens", ARM_OPEN | FIXED_OPEN, 7, "lost", "", (8,), "done"),
    ("arm has opened", ARM_OPEN | FIXED_ON, 7, "in_fixture", "arm", (8,), "done"),
    ("fixed has it", ARM_OPEN | FIXED_ON, 7, "in_fixture", "arm", (8,), ""),
    ("fixed has it", ARM_OPEN | FIXED_OPEN, 7, "lost", "", (8,), ""),
    ("retreats", ARM_OPEN | FIXED_ON, 7.5, "in_fixture", "", (8,), ""),
    ("retreated", ARM_OPEN | FIXED_ON, 8, "in_fixture", "", (), ""),
    ("comes back", ARM_OPEN | FIXED_ON, 8.5, "in_fixture", "", (8,), ""),
    ("approaches", ARM_OPEN | FIXED_ON, 9.5, "in_fixture", "", (9, 8), ""),
    # and back: until the fixed gripper was to open, it keeps the part
    ("expects grasp 2", ARM_OPEN | FIXED_ON, 10, "in_fixture", "", (9, 8), ""),
    ("closes again", ARM_OPEN | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "not done"),
    ("closes again", ARM_ON | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "done"),
    ("closes again", ARM_SHUT | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "unknown"),
    ("has closed again", ARM_ON | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "done"),
    ("knows grasp 2", ARM_ON | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "done"),
    ("both again", ARM_ON | FIXED_ON, 10, "in_fixture", "arm", (9, 8), ""),
    # the fixed gripper was to open: if it has, the arm leaves with the part
    ("fixed opens", ARM_ON | FIXED_ON, 10, "in_fixture", "arm", (9, 8), "not done"),
    ("fixed opens", ARM_ON | FIXED_ROUND_IT, 10, "in_arm", "fixed", (11,), "done"),
    ("fixed has opened", ARM_ON | FIXED_ROUND_IT, 10, "in_arm", "fixed", (11,), "done"),
    ("has it again", ARM_ON | FIXED_ROUND_IT, 10, "in_arm", "fixed", (11,), ""),
    ("leaves", ARM_ON | FIXED_ROUND_IT, 10.5, "in_arm", "", (11,), ""),
    ("left", ARM_ON | FIXED_OPEN, 11, "in_arm", "", (), ""),
    ("goes over the tray", ARM_ON | FIXED_OPEN, 12.5, "in_arm", "", (12, 11), ""),
    # over its tray: it is let go there, or it is not
    ("lets go", ARM_ON | FIXED_OPEN, 13, "in_arm", "", (12, 11), "not done"),
    ("lets go", ARM_OPEN | FIXED_OPEN, 13, "placed", "arm", (12,), "done"),
    ("lets go", {"arm_mm": 22.0, "is_arm_pressing": False} | FIXED_OPEN, 13,
     "placed", "arm", (12,), "unknown"),
    ("has let go", ARM_OPEN | FIXED_OPEN, 13, "placed", "arm", (12,), "done"),
)  # fmt: skip
# By hand: the same after a stop, where the fixed gripper keeps the part; it presses first.
STOPPED: tuple[tuple[str, dict[str, object], float, str, tuple[float, ...]], ...] = (
    ("arm opens", ARM_OPEN, 7, "arm", (8,)),
    ("arm opens", {"arm_mm": 22.0, "is_arm_pressing": False}, 7, "arm", (8,)),
    ("arm has opened", ARM_OPEN, 7, "arm", (8,)),
    ("fixed has it", ARM_OPEN, 7, "arm", (8,)),
    ("retreats", ARM_OPEN, 7.5, "", (8,)),
    ("retreated", ARM_OPEN, 8, "", ()),
    ("comes back", ARM_OPEN, 8.5, "", (8,)),
    ("approaches", ARM_OPEN, 9.5, "", (9, 8)),
    ("expects grasp 2", ARM_OPEN, 10, "", (9, 8)),
    ("closes again", ARM_OPEN, 10, "arm", (9, 8)),
    ("closes again", ARM_ON, 10, "arm", (9, 8)),
    ("closes again", ARM_SHUT, 10, "arm", (9, 8)),
    ("both again", ARM_ON, 10, "arm", (9, 8)),
)
# By hand: after a stop the arm gripper keeps the part; the fixed gripper is not needed.
NOT_NEEDED: tuple[tuple[str, float, str], ...] = (
    ("fixed closes", 7, "fixed"), ("both", 7, "fixed"), ("arm opens", 7, "fixed"),
    ("fixed opens", 10, "fixed"),
)  # fmt: skip
# What else the stopped fixed gripper may look like: then nothing is to be confirmed.
NOT_ON_PART: tuple[dict[str, object], ...] = (
    {"barrier": Signal.NOT_OK, "fixed_mm": FIXED_MM - 2},
    {"barrier": Signal.UNKNOWN},
    {"fixed_mm": FIXED_MM + 2},
    {"fixed_mm": FIXED_MM - 2},
    {"is_fixed_ready": False},
)
# By hand as well: what journal and grippers say does not fit together, so that a person looks.
CONTRADICTIONS: tuple[tuple[str, dict[str, object], float], ...] = (
    ("has it", ARM_OPEN | FIXED_OPEN, 3),
    ("at a view", ARM_OPEN | FIXED_OPEN, 5),
    ("at a view", ARM_ON | FIXED_ON, 5),
    ("at a view", ARM_ON | FIXED_OPEN, 8),  # somebody has moved the arm
    ("fixed closes", ARM_OPEN | FIXED_ON, 7),
    ("fixed closes", ARM_SHUT | FIXED_SHUT, 7),
    ("both", ARM_OPEN | FIXED_SHUT, 7),
    ("arm opens", ARM_SHUT | FIXED_SHUT, 7),
    ("fixed has it", ARM_OPEN | FIXED_SHUT | {"barrier": Signal.OK}, 7),
    ("closes again", ARM_ON | FIXED_OPEN, 10),
    ("both again", ARM_ON | FIXED_OPEN, 10),
    ("fixed opens", ARM_OPEN | FIXED_OPEN, 10),
    ("lets go", ARM_SHUT | FIXED_OPEN, 13),
    ("at a view", ARM_ON | FIXED_OPEN | {"is_fixed_ready": False}, 5),
    ("at a view", ARM_ON | FIXED_OPEN | {"q": None}, 5),
)


def journal_until(last: str) -> list[Row]:
    began = rows.RunBegan(serials=("S-1",), lot="L7")
    bodies = [began, rows.Homed(), *(row for _, row in WAY[: NAMES.index(last) + 1])]
    return [
        Row(n, "2026-01-02T03:04:05+00:00", 0.0, "run-1", None if n < 2 else 1, one.kind,
            rows.name_of(one), one.as_json())
        for n, one in enumerate(bodies)
    ]  # fmt: skip


def proposed(last: str, jaws: dict[str, object], at: float) -> Proposal:
    left = fold_interrupted(journal_until(last), "run-1", 1)
    assert left is not None
    world = World(
        q=np.array(q(at)), positions="proven", arm_mm=None, is_arm_pressing=False, fixed_mm=0.0,
        does_fixed_touch=False, is_fixed_ready=True, barrier=Signal.UNKNOWN,
    )  # fmt: skip
    return propose(left, replace(world, **jaws), emulated_layout())  # type: ignore[arg-type]


@pytest.mark.parametrize(("last", "jaws", "at", "custody", "opens", "places", "done"), CUTS)
def test_a_run_that_was_cut_off_goes_on_as_it_is_listed_by_hand(
    last: str, jaws: dict[str, object], at: float, custody: str, opens: str,
    places: Sequence[float], done: str,
) -> None:  # fmt: skip
    found = proposed(last, jaws, at)
    assert found.person == ""
    assert found.custody.key == custody
    words = found.case.opens.value
    assert (words.split()[1] if words else "") == opens
    assert found.leaving is not None
    assert [w[0] for w in found.leaving.waypoints] == list(places)
    assert (found.case.done or "") == done
    assert found.is_proven


@pytest.mark.parametrize(("last", "jaws", "at"), CONTRADICTIONS)
def test_where_journal_and_grippers_contradict_each_other_a_person_looks(
    last: str, jaws: dict[str, object], at: float
) -> None:
    found = proposed(last, jaws, at)
    assert found.person
    assert not found.is_proven
    assert found.steps == ()


@pytest.mark.parametrize(("last", "jaws", "at", "opens", "places"), STOPPED)
def test_a_stopped_fixed_gripper_presses_before_anything_else(
    last: str, jaws: dict[str, object], at: float, opens: str, places: Sequence[float]
) -> None:
    found = proposed(last, jaws | FIXED_STOPPED, at)
    assert found.person == ""
    assert found.custody is Custody.IN_FIXED
    assert found.case.is_fixed_unconfirmed
    assert found.steps[0] == "the fixed gripper presses once more: it closes, and opens nothing"
    assert found.preview == found.steps[0]
    words = found.case.opens.value
    assert (words.split()[1] if words else "") == opens
    assert found.leaving is not None
    assert [w[0] for w in found.leaving.waypoints] == list(places)
    assert found.is_proven
    reports = proposed(last, jaws | FIXED_ON, at)
    assert not reports.case.is_fixed_unconfirmed
    assert found.steps[1:] == reports.steps


@pytest.mark.parametrize(("last", "at", "opens"), NOT_NEEDED)
def test_a_fixed_gripper_that_is_to_open_presses_nothing(last: str, at: float, opens: str) -> None:
    found = proposed(last, ARM_ON | FIXED_STOPPED, at)
    assert found.custody is Custody.IN_ARM
    assert found.case.opens.value.split()[1] == opens
    assert not found.case.is_fixed_unconfirmed
    assert found.steps[0].startswith("the arm gripper presses")


@pytest.mark.parametrize("more", NOT_ON_PART)
def test_a_fixed_gripper_that_does_not_stand_on_the_part_has_nothing_to_confirm(
    more: dict[str, object],
) -> None:
    found = proposed("retreated", ARM_OPEN | FIXED_STOPPED | more, 8)
    assert not found.case.is_fixed_unconfirmed
    assert found.person or found.custody is Custody.LOST


def test_every_moment_with_a_part_in_a_gripper_is_listed() -> None:
    held = NAMES[NAMES.index("closes") :]
    assert {name for name, *_ in CUTS} == set(held)


@pytest.mark.parametrize(("last", "jaws", "at", "custody", "opens", "places", "done"), CUTS)
def test_a_gripper_opens_only_beside_one_that_holds_or_where_the_part_may_stay(
    last: str, jaws: dict[str, object], at: float, custody: str, opens: str,
    places: Sequence[float], done: str,
) -> None:  # fmt: skip
    arm_holds = jaws["arm_mm"] == ARM_MM
    fixed_holds = bool(jaws["does_fixed_touch"])
    if opens == "fixed":
        assert arm_holds
    if opens == "arm":
        assert fixed_holds or at in (3, 13)  # at the table, over its tray


@pytest.mark.parametrize(
    ("last", "at", "places"),
    [("parked", 0, ()), ("goes to the part", 1.5, (1, 0)), ("comes down", 3, (2, 1, 0)),
     ("expects grasp 1", 3, (2, 1, 0))],
)  # fmt: skip
def test_with_the_part_on_the_table_only_the_arm_goes_back(
    last: str, at: float, places: Sequence[float]
) -> None:
    found = proposed(last, ARM_OPEN | FIXED_OPEN, at)
    assert found.is_arm_alone
    assert found.custody is Custody.ON_TABLE
    assert found.leaving is not None
    assert [w[0] for w in found.leaving.waypoints] == list(places)
    assert proposed(last, ARM_OPEN | FIXED_ON, at).person  # something is in the fixed gripper


def test_a_part_that_was_taken_off_the_table_goes_on_itself() -> None:
    assert not proposed("closes", ARM_OPEN | FIXED_OPEN, 3).is_arm_alone
    assert not proposed("lifted", ARM_ON | FIXED_OPEN, 2).is_arm_alone
