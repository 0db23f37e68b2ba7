"""Custody belongs to the cell: what any run may have left in a gripper stops the next start."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from controller.cell.custody import (
    CellIdentity,
    Custody,
    GripperName,
    Held,
    fold_custody,
    read_folded,
)
from controller.cell.custody.openings import Occupancy, Opening, judge_arm, judge_fixed
from controller.cell.custody.release_guard import least_held_mm
from controller.cell.custody.start_check import PartMayBeHeldError, require_empty_grippers
from controller.cell.journal import Journal, Row, read_rows
from controller.cell.journal.rows import RunBegan
from drivers.gripper_modbus import ActivationState, Counts, GripperStatus, ObjectState
from drivers.io_modbus import Signal
from drivers.umi_scara import ArmIdentity, Ip, JawReading

ARM, FIXED = GripperName.ARM, GripperName.FIXED


def began(
    name: str = "north",
    arm: str = "/dev/arm",
    gripper: str = "10.0.0.5:502",
    emulated: Sequence[str] = (),
    pid: int | None = 1,
) -> dict[str, Any]:
    return {
        "cell": {"name": name},
        "devices": {"arm": {"address": arm}, "gripper": {"address": gripper, "unit": 9}},
        "emulated_devices": list(emulated),
        "emulator": {} if pid is None else {"pid": pid, "started_wall_s": 5.0},
    }


def identity(body: dict[str, Any]) -> CellIdentity:
    return CellIdentity.of(RunBegan.model_validate(body))


HERE = identity(began())
WORDS = {"arm": ARM, "fixed": FIXED}


def rows_of(*words: str, run: str = "run-1", body: dict[str, Any] | None = None) -> list[Row]:
    """Return rows from words: ``+grasp`` an intent, ``=grasp`` its outcome, ``in_arm`` custody."""
    kinds = {"+": "intent", "=": "outcome"}
    rows = [
        Row(0, "2026-01-02T03:04:05+00:00", 0.0, run, None, "event", "run_began", body or began())
    ]
    for word in words:
        kind, name = kinds.get(word[0], "custody"), word.lstrip("+=")
        rows.append(Row(len(rows), "2026-01-02T03:04:05+00:00", 0.0, run, 1, kind, name, {}))
    return rows


def folded(rows: Sequence[Row], here: CellIdentity = HERE) -> set[GripperName]:
    return {one.gripper for one in fold_custody(rows, here)}


# one part's way with a regrasp by hand-off, as the actions journal it
WAY = (
    "+grip", "=grip", "in_arm", "+hand_off", "=hand_off", "in_both", "+release", "=release",
    "in_fixture", "+take_back", "=take_back", "in_both", "+fixture_release", "=fixture_release",
    "in_arm", "+sort", "=sort", "placed",
)  # fmt: skip
# who may hold the part if the controller is killed right after so many rows of it: told by hand,
# from what the two grippers do, not from the tables of the code
HOLDERS = (
    "", "arm", "arm", "arm", "both", "both", "both", "both", "both",
    "fixed", "both", "both", "both", "both", "both",
    "arm", "arm", "arm", "",
)  # fmt: skip


@pytest.mark.parametrize("count", range(len(WAY) + 1))
def test_a_kill_after_any_row_leaves_a_holder_that_is_named(count: int) -> None:
    expected = {"": set(), "arm": {ARM}, "fixed": {FIXED}, "both": {ARM, FIXED}}[HOLDERS[count]]
    assert folded(rows_of(*WAY[:count])) == expected


def test_a_missed_grip_leaves_nothing() -> None:
    assert folded(rows_of("+grip", "=grip", "on_table")) == set()


def test_a_lost_part_may_hang_anywhere() -> None:
    assert folded(rows_of("+grip", "=grip", "in_arm", "lost")) == {ARM, FIXED}


def test_what_the_operator_took_out_is_out() -> None:
    assert folded([*rows_of("in_arm"), *rows_of("removed", run="run-2")]) == set()


def test_custody_outlives_runs_that_never_came_to_a_part() -> None:
    rows = [*rows_of("in_arm"), *rows_of(run="run-2"), *rows_of(run="run-3")]
    (held,) = fold_custody(rows, HERE)
    assert (held.run, held.part, held.custody) == ("run-1", 1, Custody.IN_ARM)


def test_a_name_of_custody_that_is_not_known_counts_as_unknown() -> None:
    assert folded(rows_of("in_the_moon")) == {ARM, FIXED}


def test_a_run_without_its_first_row_may_have_been_here() -> None:
    assert folded(rows_of("in_arm")[1:]) == {ARM}


def test_a_run_whose_first_row_cannot_be_read_may_have_been_here() -> None:
    assert folded(rows_of("in_arm", body={"devices": "none of your business"})) == {ARM}


@pytest.mark.parametrize(
    ("then", "now", "expected"),
    [
        # a cell with another name and other addresses is another cell
        (began("south", "/dev/b", "b:1"), began(), set()),
        # a cable in another socket, a gateway's new address, an edited name: the same cell
        (began(arm="/dev/b", gripper="b:1"), began(), {ARM, FIXED}),
        (began("south"), began(), {ARM, FIXED}),
        # an emulated cell is the same one while its process is
        (
            began(emulated=("arm", "gripper"), pid=1),
            began(emulated=("arm", "gripper"), pid=2),
            set(),
        ),
        (
            began(emulated=("arm", "gripper"), pid=1),
            began(emulated=("arm", "gripper"), pid=1),
            {ARM, FIXED},
        ),
        (began(emulated=("arm", "gripper")), began(), set()),
        # an emulator at addresses given by hand outlives its runs: as a real cell
        (began(emulated=("arm", "gripper"), pid=None), began(), {ARM, FIXED}),
        (
            began("south", "/dev/b", "b:1", emulated=("arm", "gripper"), pid=None),
            began(emulated=("arm", "gripper"), pid=None),
            set(),
        ),
        # a mix: only what is real stays
        (began(emulated=("gripper",), pid=1), began(emulated=("gripper",), pid=2), {ARM}),
    ],
)  # fmt: skip
def test_custody_belongs_to_grippers_not_to_folders(
    then: dict[str, Any], now: dict[str, Any], expected: set[GripperName]
) -> None:
    assert folded(rows_of("in_both", body=then), identity(now)) == expected


def test_a_journal_that_was_set_aside_leaves_every_real_gripper_in_doubt() -> None:
    aside = Row(
        1, "2026-01-02T03:04:05+00:00", 0.0, "run-1", None, "event", "journal_set_aside", {}
    )
    assert folded([aside]) == {ARM, FIXED}
    assert folded([aside], identity(began(emulated=("arm", "gripper")))) == set()
    assert folded([aside, *rows_of("removed", run="run-1")]) == set()


# ---- what the grippers say ----

KNOWN = ArmIdentity({Ip.ARM: (1, 1), Ip.WRIST: (1, 1)}, frozenset())


@pytest.mark.parametrize(
    ("identity", "jaws", "expected"),
    [
        (KNOWN, JawReading(is_pressing=True, opening_mm=22.0), Occupancy.MAY_HOLD),
        (KNOWN, JawReading(is_pressing=True, opening_mm=0.4), Occupancy.EMPTY),
        (KNOWN, JawReading(is_pressing=True, opening_mm=85.3), Occupancy.EMPTY),  # its own end
        # a stop may have taken the pressure: no proof
        (KNOWN, JawReading(is_pressing=False, opening_mm=22.0), Occupancy.UNREADABLE),
        (
            ArmIdentity({}, frozenset({Ip.ARM})),
            JawReading(is_pressing=True, opening_mm=22.0),
            Occupancy.UNREADABLE,
        ),
    ],
)
def test_the_arm_gripper_says_what_it_can(
    identity: ArmIdentity, jaws: JawReading, expected: Occupancy
) -> None:
    assert judge_arm(jaws, identity, 85.5).occupancy is expected


def status(opening_mm: float, what: ObjectState, *, going: bool = True, active: bool = True) -> Any:
    return GripperStatus(
        at_s=0.0,
        is_powered_on=active,
        is_going=going,
        activation=ActivationState.ACTIVE if active else ActivationState.RESET,
        object=what,
        fault=0,
        controller_fault=0,
        requested_counts=Counts(0),
        position_counts=Counts(0),
        opening_mm=opening_mm,
        current_ma=0,
    )


@pytest.mark.parametrize(
    ("reading", "barrier", "expected"),
    [
        (status(30, ObjectState.CONTACT_CLOSING), Signal.NOT_OK, Occupancy.HOLDS),
        (status(30, ObjectState.CONTACT_OPENING), Signal.NOT_OK, Occupancy.HOLDS),
        (status(0.3, ObjectState.CONTACT_CLOSING), Signal.NOT_OK, Occupancy.EMPTY),
        (status(85, ObjectState.AT_POSITION), Signal.NOT_OK, Occupancy.EMPTY),
        (status(40, ObjectState.AT_POSITION), Signal.NOT_OK, Occupancy.EMPTY),
        # Ctrl-C stops the jaws on the part: contact says nothing any more, the width does
        (status(30, ObjectState.AT_POSITION, going=False), Signal.NOT_OK, Occupancy.MAY_HOLD),
        (status(85, ObjectState.AT_POSITION, going=False), Signal.NOT_OK, Occupancy.EMPTY),
        (status(30, ObjectState.MOVING), Signal.NOT_OK, Occupancy.MAY_HOLD),
        (status(30, ObjectState.MOVING, active=False), Signal.NOT_OK, Occupancy.UNREADABLE),
        # the light barrier is believed whatever the jaws say
        (status(85, ObjectState.AT_POSITION), Signal.OK, Occupancy.HOLDS),
        (status(30, ObjectState.MOVING, active=False), Signal.OK, Occupancy.HOLDS),
        (status(85, ObjectState.AT_POSITION), Signal.UNKNOWN, Occupancy.EMPTY),
    ],
)  # fmt: skip
def test_the_fixed_gripper_says_what_it_can(
    reading: GripperStatus, barrier: Signal, expected: Occupancy
) -> None:
    assert judge_fixed(reading, barrier, 85.0).occupancy is expected


# ---- the decision ----

HELD = Held(ARM, Custody.IN_ARM, "run-1", 2, "2026-01-02T03:04:05+00:00", "jaws at 20.0 mm")


def says(arm: Occupancy, fixed: Occupancy) -> tuple[Opening, Opening]:
    return Opening(ARM, arm, "arm's reason"), Opening(FIXED, fixed, "fixed's reason")


SILENT = says(Occupancy.UNREADABLE, Occupancy.UNREADABLE)


@pytest.fixture
def check(tmp_path: Path) -> Callable[..., Any]:
    """Run the check with a journal of its own; return the rows it wrote."""

    async def run(
        known: Sequence[Held], openings: Any, *, removed: bool, pressed: bool | None = None
    ) -> list[Row]:
        async def press() -> bool:
            assert pressed is not None, "nobody has allowed the jaws to move"
            return pressed

        journal = Journal(tmp_path / "journal.sqlite", "run-2")
        try:
            await require_empty_grippers(known, openings, journal, press, is_part_removed=removed)
        finally:
            journal.close()
        return list(read_rows(tmp_path / "journal.sqlite"))

    return run


async def test_a_cold_start_with_nothing_known_may_begin(check: Callable[..., Any]) -> None:
    rows = await check((), SILENT, removed=False)
    assert [row.kind for row in rows] == ["observation"]


async def test_the_message_says_what_where_since_when_and_what_to_do(
    check: Callable[..., Any], tmp_path: Path
) -> None:
    with pytest.raises(PartMayBeHeldError) as caught:
        await check((HELD,), SILENT, removed=False)
    message = str(caught.value)
    assert message == (
        "The arm gripper may hold a part: part 2 of run run-1, in the arm gripper "
        "(jaws at 20.0 mm) since 2026-01-02 03:04:05 UTC. Nothing has moved. To go on with the "
        "part, start with --auto-recover, or use `cellctl recover --accept`. To take the part out: "
        "`cellctl recover --cell CELL --open arm` opens the gripper while you hold it; then start "
        "again with --part-removed."
    )
    assert caught.value.custody is Custody.IN_ARM
    assert [r.name for r in read_rows(tmp_path / "journal.sqlite")][-1] == "start_refused"


async def test_the_operators_word_is_journaled_as_custody(check: Callable[..., Any]) -> None:
    rows = await check((HELD,), SILENT, removed=True)
    assert (rows[-1].kind, rows[-1].name) == ("custody", "removed")
    assert rows[-1].body["by"] == "operator"
    assert "run-1" in rows[-1].body["before"]


async def test_a_needless_word_is_no_change_of_custody(check: Callable[..., Any]) -> None:
    rows = await check((), SILENT, removed=True)
    assert [row.kind for row in rows] == ["observation"]


@pytest.mark.parametrize("removed", [False, True])
@pytest.mark.parametrize(
    "openings",
    [says(Occupancy.HOLDS, Occupancy.EMPTY), says(Occupancy.UNREADABLE, Occupancy.HOLDS)],
)
async def test_a_gripper_that_reports_an_object_is_believed_more_than_anybody(
    check: Callable[..., Any], openings: Any, removed: bool
) -> None:
    with pytest.raises(PartMayBeHeldError, match="holds a part"):
        await check((), openings, removed=removed)


async def test_a_doubtful_opening_asks_for_the_operators_word(check: Callable[..., Any]) -> None:
    doubtful = says(Occupancy.UNREADABLE, Occupancy.MAY_HOLD)
    with pytest.raises(PartMayBeHeldError, match="The fixed gripper may hold a part"):
        await check((), doubtful, removed=False)
    rows = await check((), doubtful, removed=True)
    assert rows[-1].name == "removed"


async def test_stalled_jaws_are_pressed_once_more_after_the_operators_word(
    check: Callable[..., Any],
) -> None:
    stalled = says(Occupancy.MAY_HOLD, Occupancy.EMPTY)
    with pytest.raises(PartMayBeHeldError, match="may hold a part"):
        await check((HELD,), stalled, removed=False)
    with pytest.raises(PartMayBeHeldError, match=r"holds a part.*stay open"):
        await check((HELD,), stalled, removed=True, pressed=True)
    rows = await check((HELD,), stalled, removed=True, pressed=False)
    assert rows[-1].name == "removed"


async def test_an_opening_that_cannot_be_read_is_not_empty(check: Callable[..., Any]) -> None:
    for occupancy in (Occupancy.UNREADABLE, Occupancy.EMPTY):
        with pytest.raises(PartMayBeHeldError):
            await check((HELD,), says(occupancy, Occupancy.EMPTY), removed=False)


def test_both_grippers_are_named_once(tmp_path: Path) -> None:
    async def press() -> bool:
        raise AssertionError("nobody has allowed the jaws to move")

    both = (HELD, replace(HELD, gripper=FIXED))
    journal = Journal(tmp_path / "journal.sqlite", "run-2")
    with pytest.raises(PartMayBeHeldError) as caught:
        asyncio.run(require_empty_grippers(both, SILENT, journal, press, is_part_removed=False))
    journal.close()
    assert str(caught.value).startswith("The arm gripper and the fixed gripper may hold a part: ")
    assert str(caught.value).count("run-1") == 1


def test_the_journal_gives_what_is_folded_and_no_more(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.sqlite", "run-1")
    for kind, name in (
        ("event", "run_began"), ("event", "start"), ("intent", "follow_path"), ("intent", "grip"),
        ("outcome", "grip"),
        ("custody", "in_arm"), ("event", "journal_set_aside"),
    ):  # fmt: skip
        journal.record(kind, name)  # type: ignore[arg-type]  # words of a table
    journal.close()
    rows = read_folded(tmp_path / "journal.sqlite")
    assert [row.name for row in rows] == ["run_began", "grip", "in_arm", "journal_set_aside"]


def test_a_joint_path_that_was_cut_off_changes_nothing_of_custody() -> None:
    rows = rows_of("on_table", "+follow_path")
    rows[-1].body["effect_class"] = "absolute"
    assert folded(rows) == set()
    assert folded(rows_of("on_table", "+follow_path")) == {ARM, FIXED}  # of no class: as ever


@pytest.mark.parametrize("gripped_mm", [0.8, 1.5, 2.0, 3.0, 5.0, 60.0])
def test_empty_jaws_are_told_from_any_part_and_a_thin_one_from_none(gripped_mm: float) -> None:
    # pads give a little, and readings scatter: a tenth of a millimetre of a thin part
    assert least_held_mm(gripped_mm) < gripped_mm - min(0.1 * gripped_mm, 1.0)
    assert least_held_mm(gripped_mm) > 0.2  # a calibrated zero is known to less
