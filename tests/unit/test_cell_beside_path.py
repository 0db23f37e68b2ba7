"""An arm that stands beside its path after a kill: where it may go, and what proves that.

The place is one that a simulated kill led to: the axes of the first board stopped 0.2 s before
those of the wrist, each on a share of its own. Whether a place is free is judged independently: by
configurations drawn from all that the motors may pass, each looked at by itself.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.cell.compute import Job, answers
from controller.cell.custody import Custody
from controller.cell.journal import Row, rows
from controller.cell.recovery import (
    Interrupted,
    Trail,
    World,
    beside_path,
    classify,
    fold_interrupted,
    propose,
)
from controller.planning.geometry import Box
from controller.planning.motion import ProvenMove, Scene, Swept, prove_move, tcp_pose
from drivers.kinds import Signal

LAYOUT = emulated_layout()
# kill 951045, at the commit at which it was found [rad, rad, rad, mm, rad, rad]
POINTS = np.array(
    [
        [0.6997, -0.7879, -2.0864, -310.519, -0.83, 1.424],
        [0.6695, 0.4867, -1.4541, -20.0, -0.9626, 2.2828],
        [0.6393, 1.7613, -0.8218, -598.7186, -1.0952, 3.1416],
    ]
)
STANDS = np.array([0.6391, 1.443, -0.93, -447.7333, -1.0747, 2.99])
PART = Box.from_bounds(-20, 20, -10, 10, -15, 15)
ARM_MM, FIXED_MM = 20.0, 85.0


def trail() -> Trail:
    found = Trail()
    found.take(rows.StoodFree(q=tuple(POINTS[0])))
    found.take(rows.PathBegun(waypoints=tuple(tuple(q) for q in POINTS[1:])))
    return found


def test_each_axis_on_its_own_share_of_one_move_is_beside_that_move() -> None:
    begin = trail().begin_beside(STANDS)
    assert begin is not None
    np.testing.assert_array_equal(begin, POINTS[1])
    assert trail().leaving(STANDS) is None  # nothing has proven it


def test_what_is_proven_leads_back_to_where_that_move_began_and_on_to_where_it_stood_free() -> None:
    half = (STANDS + POINTS[1]) / 2
    way = trail().leaving(STANDS, (half, POINTS[1]))
    assert way is not None
    assert way.is_back
    assert way.is_free_at_end
    np.testing.assert_array_equal(way.waypoints, [half, POINTS[1], POINTS[0]])


def test_a_proof_that_leads_elsewhere_counts_for_nothing() -> None:
    assert trail().leaving(STANDS, (POINTS[0],)) is None


@pytest.mark.parametrize(
    ("axis", "value"), [(0, 0.75), (1, 1.9), (2, -0.7), (3, -640.0), (4, -0.85), (5, 3.3)]
)
def test_an_axis_outside_its_move_is_for_a_person(axis: int, value: float) -> None:
    q = STANDS.copy()
    q[axis] = value
    assert trail().begin_beside(q) is None
    assert trail().leaving(q, (POINTS[1],)) is None


def test_an_arm_on_its_line_needs_no_proof() -> None:
    on_line = POINTS[1] + 0.75 * (POINTS[2] - POINTS[1])
    assert trail().begin_beside(on_line) is None
    assert trail().leaving(on_line) is not None


# --- what the start makes of it -------------------------------------------------------------------

EYE = tuple(tuple(float(x) for x in row) for row in np.eye(4))
FREE = ProvenMove((POINTS[1],), Swept(pieces=5))
TIGHT = ProvenMove((), Swept("the arm moves", "station_panel", (430.0, 30.0, 440.0), 7))


def left_by(custody: Custody = Custody.IN_ARM, *more: rows.Body) -> Interrupted:
    grasp = rows.GraspFields(
        id="A1", T_part_tcp=EYE, opening_mm=ARM_MM, pre_open_mm=40.0, contact_mm2=50.0,
        load=0.1, score=0.9, holder="arm",
    )  # fmt: skip
    bodies: list[rows.Body] = [
        rows.RunBegan(cell={}, devices={}, emulated_devices=()),
        rows.Homed(),
        rows.HoldNoted(gripper="arm", grasp=grasp, T_part_tcp=EYE, opening_mm=ARM_MM, number=1),
        rows.CustodyChanged(name=custody.key),
        rows.StoodFree(q=tuple(POINTS[0])),
        rows.PathBegun(waypoints=tuple(tuple(q) for q in POINTS[1:])),
        *more,
    ]
    found = [
        Row(n, "", 0.0, "run", 1, one.kind, rows.name_of(one), one.as_json())
        for n, one in enumerate(bodies)
    ]
    left = fold_interrupted(found, "run", 1)
    assert left is not None
    return left


WORLD = World(
    q=STANDS, positions="proven", arm_mm=ARM_MM, is_arm_pressing=True, fixed_mm=FIXED_MM,
    does_fixed_touch=False, is_fixed_ready=True, barrier=Signal.NOT_OK,
)  # fmt: skip


def test_with_a_proof_the_start_goes_on_by_itself_and_without_one_a_person_looks() -> None:
    found = propose(left_by(), WORLD, LAYOUT, None, FREE)
    assert found.person == ""
    assert found.is_proven
    assert found.leaving is not None
    np.testing.assert_array_equal(found.leaving.waypoints, [POINTS[1], POINTS[0]])
    assert "out of step" in "\n".join(found.evidence)
    for nothing in (None, TIGHT):
        refused = propose(left_by(), WORLD, LAYOUT, None, nothing)
        assert refused.person.startswith("the arm stands beside the path")
        assert not refused.is_proven
        assert refused.leaving is None


def test_the_person_reads_what_comes_too_close() -> None:
    found = propose(left_by(), WORLD, LAYOUT, None, TIGHT)
    assert "too close to station panel (TCP about 430, 30, 440 mm)" in found.person


def test_the_proof_is_for_the_part_as_the_grippers_have_it_and_their_openings_as_read() -> None:
    left, world = left_by(), replace(WORLD, arm_mm=ARM_MM - 0.3, fixed_mm=61.0)
    beside_it = rows.SightingFields(
        part=None, pose_index=-1, x_mm=1.0, y_mm=2.0, theta_deg=0.0, score=1.0, box_px=(0, 0, 9, 9)
    )
    left.take(rows.Sightings(sightings=(beside_it, beside_it), taken=0))
    beside = beside_path(left, world, classify(left, world))
    assert beside is not None
    q, begin, arm_mm, T_part_tcp, fixed_mm, T_part_fixed, around = beside.arguments
    assert around.neighbours == (beside_it,)
    np.testing.assert_array_equal([q, begin], [STANDS, POINTS[1]])
    assert (arm_mm, fixed_mm, T_part_fixed) == (ARM_MM - 0.3, 61.0, None)
    np.testing.assert_array_equal(T_part_tcp, np.eye(4))


@pytest.mark.parametrize(
    ("left", "world"),
    [
        (left_by(Custody.LOST), replace(WORLD, arm_mm=0.5)),
        (left_by(Custody.ON_TABLE), replace(WORLD, arm_mm=40.0)),
        (left_by(Custody.IN_ARM, rows.Intent(name=rows.Once.HAND_OFF)), WORLD),
        (left_by(), replace(WORLD, arm_mm=40.0)),  # the jaws contradict the journal
        (left_by(), replace(WORLD, q=POINTS[1] + 0.5 * (POINTS[2] - POINTS[1]))),  # on its line
    ],
)
def test_elsewhere_no_proof_decides(left: Interrupted, world: World) -> None:
    assert beside_path(left, world, classify(left, world)) is None


# --- the proof ------------------------------------------------------------------------------------


def scene(**walls: Box) -> Scene:
    layout = replace(LAYOUT, obstacles={**LAYOUT.obstacles, **walls})
    return Scene(layout, ARM_MM, FIXED_MM, PART)


def drawn(q_from: np.ndarray, q_to: np.ndarray, count: int) -> np.ndarray:
    """Return configurations with each motor on a share of its own: pitch and roll share theirs."""
    share = np.random.default_rng(7).random((count, 6))
    step = q_to - q_from
    q = q_from + share * step
    one, other = share[:, 4] * (step[4] + step[5]), share[:, 5] * (step[4] - step[5])
    q[:, 4], q[:, 5] = q_from[4] + (one + other) / 2, q_from[5] + (one - other) / 2
    return q


def test_a_free_move_is_free_whichever_motor_goes_first() -> None:
    found = prove_move(scene(), STANDS, POINTS[1])
    assert found.swept.is_free
    np.testing.assert_array_equal(found.waypoints[-1], POINTS[1])  # the trail goes by that
    for a, b in pairwise([STANDS, *found.waypoints]):
        assert scene().free(drawn(a, b, 600), 4.9).all()


def test_a_wall_that_only_a_lagging_axis_meets_blocks_the_move_or_shortens_its_pieces() -> None:
    """The wall is beyond the reach of the line, and where elbow alone would take the part."""
    q = STANDS.copy()
    q[1] = POINTS[1][1]  # the elbow has gone back, nothing else
    x, y, z = tcp_pose(LAYOUT, q)[:3, 3]
    wall = Box.from_bounds(x - 5, x + 5, y - 5, y + 5, z - 5, z + 5)
    assert not scene(wall=wall).free(q[None], 5.0)[0]
    line = STANDS + np.linspace(0, 1, 400)[:, None] * (POINTS[1] - STANDS)
    assert scene(wall=wall).free(line, 5.0).all()
    found = prove_move(scene(wall=wall), STANDS, POINTS[1])
    for a, b in pairwise([STANDS, *found.waypoints]):
        assert scene(wall=wall).free(drawn(a, b, 600), 4.9).all()
    assert len(found.waypoints) > 1


def test_what_stands_on_the_line_itself_is_named() -> None:
    x, y, z = tcp_pose(LAYOUT, (STANDS + POINTS[1]) / 2)[:3, 3]
    post = Box.from_bounds(x - 5, x + 5, y - 5, y + 5, z - 40, z + 40)
    found = prove_move(scene(post=post), STANDS, POINTS[1])
    assert found.waypoints == ()
    assert found.swept.touches == "post"


def test_the_worker_looks_at_the_part_in_its_gripper_and_at_the_one_that_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A bar of 160 mm reaches a post that the empty gripper passes; by itself it is far away."""
    bounds = np.array([[-6.0, -80.0, -6.0], [6.0, 80.0, 6.0]])
    at = tcp_pose(LAYOUT, POINTS[1])
    x, y, z = at[:3, 3] + 70.0 * at[:3, 1]
    post = Box.from_bounds(x - 5, x + 5, y - 5, y + 5, z - 5, z + 5)
    layout = replace(LAYOUT, obstacles={**LAYOUT.obstacles, "post": post})
    solid = SimpleNamespace(mesh=SimpleNamespace(bounds=bounds))
    monkeypatch.setattr(
        answers.homing, "context", lambda job: SimpleNamespace(layout=layout, solid=solid)
    )
    job, near = Job(Path("recipe.yaml"), Path("cell.yaml")), POINTS[1] + 0.1 * (STANDS - POINTS[1])
    empty = Scene(layout, ARM_MM, FIXED_MM)
    carries = Scene(layout, ARM_MM, FIXED_MM, Box.from_bounds(-6, 6, -80, 80, -6, 6))
    line = near + np.linspace(0, 1, 50)[:, None] * (POINTS[1] - near)
    assert empty.free(line, 5.0).all()
    assert not carries.free(line, 5.0).all()
    with_part = answers.proven_back(job, near, POINTS[1], ARM_MM, np.eye(4), FIXED_MM, None)
    assert with_part.waypoints == ()
    assert with_part.swept.touches == "post"
    without = answers.proven_back(job, near, POINTS[1], ARM_MM, None, FIXED_MM, np.eye(4))
    assert without.swept.is_free
