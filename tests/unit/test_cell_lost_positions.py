"""An arm that has lost its positions, with a part in a gripper: when homing with it is proposed.

What has to follow is written down by hand, from who holds the part and what is known of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.cell.custody import Custody
from controller.cell.journal import Row, rows
from controller.cell.recovery import (
    Interrupted,
    Proposal,
    World,
    fold_interrupted,
    lost_bounds,
    propose,
)
from controller.planning.motion import Swept, segment_seconds
from drivers.kinds import Signal

LAYOUT = emulated_layout()
EYE = tuple(tuple(float(x) for x in row) for row in np.eye(4))
FREE = Swept(pieces=100)
TIGHT = Swept("zed goes up to its stop", "station_panel", (430.0, 30.0, 440.0), 7)
LOST = "arm: an IP has restarted: its positions are lost; home it"
HELD_MM = 20.0
HOME, VIEW = (0.0, 0.0, 0.0, -200.0, -0.2, 0.0), (0.8, 0.0, 0.0, -200.0, -1.0, 0.0)
OFF_RAD, OFF_MM = 0.06, 12.0  # a stopped arm stands so near its path (recovery/trail.py)


def hold(gripper: str) -> rows.HoldNoted:
    holder = "arm" if gripper == "arm" else "fixture"
    grasp = rows.GraspFields(
        id="A1", T_part_tcp=EYE, opening_mm=HELD_MM, pre_open_mm=40.0, contact_mm2=50.0,
        load=0.1, score=0.9, holder=holder,
    )  # fmt: skip
    return rows.HoldNoted.model_validate(
        {"gripper": gripper, "grasp": grasp, "T_part_tcp": EYE, "opening_mm": HELD_MM, "number": 1}
    )


def custody(value: Custody) -> rows.CustodyChanged:
    return rows.CustodyChanged(name=value.key)


IN_ARM: tuple[rows.Body, ...] = (
    rows.StoodFree(q=HOME),
    hold("arm"),
    custody(Custody.IN_ARM),
    rows.StoodFree(q=HOME),
    rows.PathBegun(waypoints=(VIEW,)),
)
IN_FIXED: tuple[rows.Body, ...] = (
    *IN_ARM,
    hold("fixed"),
    custody(Custody.IN_BOTH),
    rows.Intent(name=rows.Once.RELEASE_ARM, retreat=(HOME,)),
    custody(Custody.IN_FIXED),
    rows.PathBegun(waypoints=(HOME,)),
    rows.PathEnded(),
    rows.StoodFree(q=HOME),
)
ARRIVED = (*IN_ARM, rows.PathEnded())


def left_by(bodies: Sequence[rows.Body]) -> Interrupted:
    began = rows.RunBegan(cell={}, devices={}, emulated_devices=())
    found = [
        Row(n, "", 0.0, "run", 1, body.kind, _name(body), body.model_dump(mode="json"))
        for n, body in enumerate([began, rows.Homed(), *bodies])
    ]
    left = fold_interrupted(found, "run", 1)
    assert left is not None
    return left


def _name(body: rows.Body) -> str:
    return body.name if isinstance(body, rows.NamedBody) else body.row_name


def lost(q_kept: np.ndarray | None = None, **more: object) -> World:
    fields: dict[str, object] = {
        "q": None, "positions": LOST, "arm_mm": None, "is_arm_pressing": False,
        "fixed_mm": 85.0, "does_fixed_touch": False, "is_fixed_ready": True,
        "barrier": Signal.NOT_OK, "q_kept": q_kept,
    }  # fmt: skip
    return World(**(fields | more))  # type: ignore[arg-type]


def proposed(bodies: Sequence[rows.Body], swept: Swept | None = FREE, **more: object) -> Proposal:
    return propose(left_by(bodies), lost(**more), LAYOUT, swept)


def test_with_the_part_in_the_arm_gripper_and_free_space_it_homes_if_a_person_accepts() -> None:
    found = proposed(ARRIVED)
    assert found.person == ""
    assert found.homing is not None
    assert not found.is_proven  # --auto-recover is refused
    assert found.homing.bounds.arm_opening_mm == HELD_MM
    assert "zed goes straight up" in found.first_motion
    assert "opens nothing" in found.steps[0]
    for word in ("fingertips", "holds the part", "nobody has moved the arm"):
        assert word in found.look
    evidence = "\n".join(found.evidence)
    assert "nothing proves that nobody has moved it" in evidence
    assert "may have had no power" in evidence
    assert "keeps 10 mm" in evidence


def test_where_the_space_is_not_free_a_person_is_told_what_it_would_touch() -> None:
    found = proposed(ARRIVED, TIGHT)
    assert found.homing is None
    assert "too close to station panel" in found.person
    assert "zed goes up to its stop" in found.person
    assert LOST in found.person


def test_space_that_nobody_looked_at_is_not_free() -> None:
    found = proposed(ARRIVED, None)
    assert found.homing is None
    assert "not checked" in found.person


@pytest.mark.parametrize("name", sorted(set(rows.Once) - {rows.Once.OPEN_ARM_GRIPPER}))
def test_what_a_gripper_was_about_to_do_is_for_a_person(name: rows.Once) -> None:
    found = proposed((*ARRIVED, rows.Intent(name=name)))
    assert found.homing is None
    assert "cut off while it did" in found.person


@pytest.mark.parametrize(
    "fixed",
    [
        {"does_fixed_touch": True, "fixed_mm": 30.0},
        {"barrier": Signal.OK},
        {"barrier": Signal.UNKNOWN},
        {"is_fixed_ready": False},
    ],
    ids=["touches", "sees something", "no reading", "not ready"],
)
def test_a_fixed_gripper_that_is_not_known_to_be_clear_is_for_a_person(
    fixed: dict[str, object],
) -> None:
    found = proposed(ARRIVED, **fixed)
    assert found.homing is None
    assert "fixed gripper" in found.person


def test_with_the_part_in_the_fixed_gripper_the_empty_arm_homes_past_it() -> None:
    holds = {"does_fixed_touch": True, "fixed_mm": 30.0, "barrier": Signal.OK}
    found = proposed(IN_FIXED, **holds)
    assert found.person == ""
    assert found.homing is not None
    assert found.homing.bounds.arm_opening_mm is None
    assert found.homing.bounds.T_part_tcp is None
    assert found.homing.bounds.T_part_fixed is not None
    assert "do not reach round the part" in found.look
    gone = proposed(IN_FIXED)
    assert gone.homing is None
    assert "does not report its hold" in gone.person


@pytest.mark.parametrize("where", [Custody.LOST, Custody.ON_TABLE, Custody.IN_BOTH])
def test_elsewhere_a_person_has_to_look(where: Custody) -> None:
    found = proposed((*ARRIVED, custody(where)))
    assert found.homing is None
    assert found.person


def test_homing_that_was_cut_off_is_not_begun_again() -> None:
    begun = rows.HomingBegun(low=HOME, high=VIEW, opening_mm=HELD_MM)
    found = proposed((*ARRIVED, begun))
    assert "homing with the part was interrupted" in found.person
    ended = rows.HomedWithPart(q=HOME, opening_mm=HELD_MM)
    left = left_by((*ARRIVED, begun, ended, rows.StoodFree(q=HOME)))
    assert left.is_homed
    assert not left.is_homing
    assert left.trail.between == pytest.approx(np.array([HOME]))


# --- where it may stand ---------------------------------------------------------------------------
def test_an_arm_that_came_to_the_end_of_its_path_is_taken_to_be_there() -> None:
    bounds = lost_bounds(left_by(ARRIVED), lost(), LAYOUT)
    off = np.array([OFF_RAD] * 3 + [OFF_MM] + [OFF_RAD] * 2)
    assert bounds.low == pytest.approx(np.array(VIEW) - off)
    assert bounds.high == pytest.approx(np.array(VIEW) + off)


def test_an_arm_that_was_under_way_may_be_anywhere_between() -> None:
    bounds = lost_bounds(left_by(IN_ARM), lost(), LAYOUT)
    assert bounds.low[0] == pytest.approx(HOME[0] - OFF_RAD)
    assert bounds.high[0] == pytest.approx(VIEW[0] + OFF_RAD)
    assert not bounds.known.any()


def test_the_axes_that_one_board_has_kept_show_how_far_the_others_had_come() -> None:
    halfway = -0.6  # of the pitch from -0.2 to -1.0
    kept = np.array([np.nan] * 4 + [halfway, 0.0])
    bounds = lost_bounds(left_by(IN_ARM), lost(kept), LAYOUT)
    assert bounds.known.tolist() == [False] * 4 + [True, True]
    assert np.ptp([bounds.low[4], bounds.high[4]]) < 0.01
    # the shoulder had half of its 0.8 rad behind it, or what it does in half a second less
    seconds = float(segment_seconds(LAYOUT, np.array(HOME), np.array(VIEW)))
    late = 0.5 / seconds * 0.8
    assert bounds.high[0] == pytest.approx(0.4 + 2 * OFF_RAD, abs=1e-6)
    assert bounds.low[0] == pytest.approx(max(0.0, 0.4 - OFF_RAD - late) - OFF_RAD, abs=1e-6)
