"""Contacts of the arm and what it holds, against points on the surfaces and against FCL."""

from __future__ import annotations

import pickle
from dataclasses import replace

import fcl
import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from planning_cell import emulated_layout
from scipy.spatial.transform import Rotation

from controller.planning import Box
from controller.planning.geometry import PartShape, PlacedShape, Triangles, stack
from controller.planning.motion import Scene, tcp_pose
from drivers.umi_scara.model.kinematics import within_limits

LAYOUT = emulated_layout()
LOW = np.array([*np.radians([-88.0, -150.0, -120.0]), -870.0, *np.radians([-97.0, -130.0])])
HIGH = np.array([*np.radians([88.0, 140.0, 120.0]), -10.0, *np.radians([3.0, 175.0])])


def angle_bracket() -> trimesh.Trimesh:
    """An L of two plates, 70 x 40 x 70, 8 thick: two thirds of its box are air."""
    foot = trimesh.creation.box((70.0, 40.0, 8.0))
    wall = trimesh.creation.box((8.0, 40.0, 62.0))
    wall.apply_translation([-31.0, 0.0, 35.0])
    mesh = trimesh.util.concatenate([foot, wall])
    mesh.apply_translation([0.0, 0.0, -31.0])
    return mesh


MESH = angle_bracket()
SHAPE = PartShape(np.asarray(MESH.vertices), np.asarray(MESH.faces))
SURFACE = trimesh.sample.sample_surface_even(MESH, 8000, seed=1)[0]
SPACING_MM = 2.5  # farther than this no point of the surface is from a sample
T_TIP_PART = np.eye(4)
T_TIP_PART[:3, :3] = Rotation.from_euler("xyz", [20, -35, 50], degrees=True).as_matrix()
T_TIP_PART[:3, 3] = 12.0, 3.0, -5.0
HELD = PlacedShape(SHAPE, T_TIP_PART)
EXACT = Scene(LAYOUT, 60.0, 85.0, carried_mesh=HELD)
COARSE = Scene(LAYOUT, 60.0, 85.0, carried=HELD.box)
BARE = Scene(LAYOUT, 60.0, 85.0)


def random_rows(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    q = LOW + rng.random((n, 6)) * (HIGH - LOW)
    return q[within_limits(q)]


def gap_mm(points: np.ndarray, box: Box) -> float:
    """Return how far the nearest of the points is from a solid box."""
    inside = np.abs((points - box.T[:3, 3]) @ box.T[:3, :3]) - box.half_mm
    return float(np.linalg.norm(np.maximum(inside, 0.0), axis=1).min())


def part_gaps(q: np.ndarray) -> float:
    """Return the gap between the held part and the nearest thing it may touch, less margins."""
    T = tcp_pose(LAYOUT, q) @ T_TIP_PART
    points = SURFACE @ T[:3, :3].T + T[:3, 3]
    still = [box for _, box in BARE.statics()] + [LAYOUT.column]
    links = BARE.arm_boxes(q)[:3]
    gaps = [gap_mm(points, box) for box in still] + [float(points[:, 2].min())]
    # links and part keep 3 mm of each other whatever the margin, here 5 mm
    return min(*gaps, *(gap_mm(points, box) + 2.0 for box in links))


def test_triangles_decide_what_the_held_part_touches() -> None:
    q = random_rows(3, 6000)
    q = q[BARE.free(q, 5.0)]
    found = EXACT.free(q, 5.0)
    doubtful = np.flatnonzero(~COARSE.free(q, 5.0))[:90]
    gaps = np.array([part_gaps(row) for row in q[doubtful]])
    free = found[doubtful]
    assert not np.any(free & (gaps < 5.0 - 1e-6)), "nothing within the margin may pass for free"
    # boxes grown by a margin are at most a corner's diagonal farther out
    assert np.all(free[gaps > 5.0 * np.sqrt(3) + SPACING_MM])
    assert np.count_nonzero(free) > 10
    assert np.count_nonzero(~free) > 10


def test_what_boxes_find_free_is_free_of_triangles_too() -> None:
    q = random_rows(4, 5000)
    assert not np.any(COARSE.free(q, 4.0) & ~EXACT.free(q, 4.0))
    assert np.count_nonzero(EXACT.free(q, 4.0) & ~COARSE.free(q, 4.0)) > 10


def test_an_answer_does_not_depend_on_what_else_is_asked() -> None:
    q = random_rows(5, 800)
    together = EXACT.contacts(q, 5.0)
    one_by_one = np.concatenate([EXACT.contacts(row[None], 5.0) for row in q[:150]])
    np.testing.assert_array_equal(together[:150], one_by_one)
    order = np.random.default_rng(1).permutation(len(q))
    np.testing.assert_array_equal(EXACT.contacts(q[order], 5.0), together[order])


def test_a_margin_for_each_row_is_that_row_s_margin() -> None:
    q = random_rows(6, 600)
    margins = np.linspace(0.0, 30.0, len(q))
    rows = EXACT.free(q, margins)
    alone = [bool(EXACT.free(q[k : k + 1], margins[k])[0]) for k in range(0, len(q), 5)]
    assert rows[::5].tolist() == alone


@settings(max_examples=25, deadline=None)
@given(margin=st.floats(0.0, 20.0), more=st.floats(0.0, 30.0), seed=st.integers(0, 99))
def test_a_wider_margin_frees_nothing(margin: float, more: float, seed: int) -> None:
    q = random_rows(seed, 60)
    assert not np.any(EXACT.free(q, margin + more) & ~EXACT.free(q, margin))


def test_the_part_may_be_handed_in_row_by_row() -> None:
    q = random_rows(7, 500)
    hand = stack([*LAYOUT.arm_gripper.body, *LAYOUT.arm_gripper.fingers(60.0)])
    rows = (np.repeat(hand[0][None], len(q), axis=0), np.repeat(hand[1][None], len(q), axis=0))
    poses = np.repeat(T_TIP_PART[None], len(q), axis=0)
    np.testing.assert_array_equal(
        BARE.contacts(q, 5.0, arm_gripper=rows, part=(SHAPE, poses)), EXACT.contacts(q, 5.0)
    )


def test_a_standing_part_may_be_reached_into() -> None:
    """A fingertip between the two plates of an angle is inside its box and touches nothing."""
    q = np.array([0.3, -0.5, 0.2, -500.0, -np.pi / 2, 0.0])
    tip = tcp_pose(LAYOUT, q)
    shut = replace(BARE, arm_opening_mm=0.0)
    T = np.eye(4)
    T[:3, 3] = tip[:3, 3] + [-22.0, 0.0, 20.0]  # the foot below the tips, the wall away from them
    T_turned = T.copy()
    T_turned[:3, :3] = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    hand = shut.arm_boxes(q)[3:]
    gaps = [min(gap_mm(SURFACE @ P[:3, :3].T + P[:3, 3], b) for b in hand) for P in (T, T_turned)]
    assert gaps[0] > 5.0, "as built: 20 mm above the middle of a part 66 high with a foot of 8"
    assert gaps[1] == 0.0
    assert shut.free(q[None], 2.0)[0]
    assert not replace(shut, standing=(PlacedShape(SHAPE, T).box,)).free(q[None], 2.0)[0]
    assert replace(shut, standing_meshes=(PlacedShape(SHAPE, T),)).free(q[None], 2.0)[0]
    assert not replace(shut, standing_meshes=(PlacedShape(SHAPE, T_turned),)).free(q[None], 2.0)[0]


def test_two_parts_that_overlap_touch_and_two_apart_do_not() -> None:
    q = np.array([0.3, -0.5, 0.2, -400.0, -np.pi / 2, 0.0])
    T_world = tcp_pose(LAYOUT, q) @ T_TIP_PART
    apart = T_world.copy()
    apart[:3, 3] += [0.0, 0.0, -150.0]
    assert EXACT.free(q[None], 2.0)[0]
    for T, is_free in ((T_world, False), (apart, True)):
        scene = replace(EXACT, standing_meshes=(PlacedShape(SHAPE, T),))
        assert scene.free(q[None], 2.0)[0] == is_free
        names = scene.names()
        assert is_free or names[scene.contacts(q[None], 2.0)[0]] == "the part standing there"


def test_a_small_box_inside_a_thick_part_does_not_pass_for_free() -> None:
    block = trimesh.creation.box((80.0, 80.0, 80.0))
    triangles = Triangles(PartShape(np.asarray(block.vertices), np.asarray(block.faces)))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xy", [30, 20], degrees=True).as_matrix()
    T[:3, 3] = 100.0, -50.0, 30.0
    triangles.place(T)
    small = np.full(3, 5.0)
    assert triangles.touch(np.eye(3), T[:3, 3] + [8.0, 3.0, -6.0], small), "no surface is near"
    assert not triangles.touch(np.eye(3), T[:3, 3] + [0.0, 0.0, 90.0], small)


def test_a_shape_survives_the_way_to_another_process() -> None:
    SHAPE.model  # noqa: B018  -- built, and lives outside Python
    back = pickle.loads(pickle.dumps(SHAPE))
    q = random_rows(8, 400)
    scene = replace(EXACT, carried_mesh=PlacedShape(back, T_TIP_PART))
    np.testing.assert_array_equal(scene.contacts(q, 5.0), EXACT.contacts(q, 5.0))


def test_links_and_hand_touch_the_cell_where_fcl_says_so() -> None:
    """Bare boxes, no margin: FCL on the arm's boxes against all that stands."""
    q = random_rows(9, 400)
    still = [
        fcl.CollisionObject(fcl.Box(*(2 * b.half_mm)), fcl.Transform(b.T[:3, :3], b.T[:3, 3]))
        for _, b in BARE.statics()
    ]
    found = BARE.contacts(q, 0.0)
    names = BARE.names()
    seen = 0
    for row, contact in zip(q, found, strict=True):
        touched = False
        for box in BARE.arm_boxes(row):
            moving = fcl.CollisionObject(
                fcl.Box(*(2 * box.half_mm)), fcl.Transform(box.T[:3, :3], box.T[:3, 3])
            )
            touched |= any(
                fcl.collide(moving, other, fcl.CollisionRequest(), fcl.CollisionResult())
                for other in still
            )
        with_cell = contact > 0 and names[contact] not in ("the arm itself", "column")
        seen += touched
        if contact != 0:  # the table comes first and hides the rest
            assert with_cell == touched
    assert seen > 20


def test_the_arm_s_own_boxes_are_where_its_scene_has_them() -> None:
    q = random_rows(10, 300)
    q = q[BARE.free(q, 5.0)][:20]
    for row in q:
        for box in BARE.arm_boxes(row):
            probed = replace(BARE, standing=(Box(box.T, np.full(3, 1.0)),))
            name = probed.names()[probed.contacts(row[None], 0.0)[0]]
            assert name == "the part standing there"


def test_what_a_calibration_leaves_open_widens_every_margin_but_the_arm_s_own() -> None:
    q = random_rows(6, 2000)
    unsure = Scene(replace(LAYOUT, place_u_mm=3.0), 60.0, 85.0, carried_mesh=HELD)
    # k = 2: 6 mm more to what stands in the cell, and to the table
    found = unsure.contacts(q, 5.0, 1.5)
    np.testing.assert_array_equal(found, EXACT.contacts(q, 11.0, 7.5))
    assert (found != EXACT.contacts(q, 5.0, 1.5)).any()
