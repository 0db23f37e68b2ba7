"""Plans for a part that is not alone on the table, judged by a checker with geometry of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from planning_cell import emulated_layout
from planning_checker import check

from controller.cad import Solid, make_solid, sample_surface, stable_poses
from controller.planning import (
    Box,
    CellLayout,
    Look,
    NoMotionError,
    PlanOptions,
    PreparedPart,
    SetDown,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.geometry import PartShape, PlacedShape, Triangles
from controller.planning.model import OnTable
from controller.planning.regrasps import pick_paths, rests

LAYOUT = emulated_layout()
X_MM, Y_MM = 350.0, 20.0
HALF = np.array([30.0, 20.0, 15.0])


def solid_of(extents: tuple[float, float, float], name: str) -> Solid:
    return make_solid(trimesh.creation.box(extents), name, "0123456789abcdef", where=name)


BLOCK = solid_of((60.0, 40.0, 30.0), "block")
# the stable pose in which the block rests on its largest face
FLAT = next(p for p in stable_poses(BLOCK) if abs(p.R[2, 2]) > 0.99)
T_START = resting_pose(BLOCK, FLAT, X_MM, Y_MM, 0.0)


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    options = PlanOptions(arm_grasps_per_pose=8, arm_grasps_round=8, fixed_grasps=8)
    return prepare_part(BLOCK, sample_surface(BLOCK, 5.0), LAYOUT, options)


def axes_of_footprint() -> tuple[float, float]:
    """Return the block's half widths along the world's x and y as it rests."""
    across = np.abs(T_START[:3, :3]) @ HALF
    return float(across[0]), float(across[1])


def standing(low: tuple[float, float, float], high: tuple[float, float, float]) -> PlacedShape:
    """Return a block with these corners in the world."""
    solid = solid_of(tuple(np.subtract(high, low)), "other")  # type: ignore[arg-type]
    T = np.eye(4)
    T[:3, 3] = np.add(low, high) / 2
    return PlacedShape(PartShape.of(solid), T)


def among(*others: PlacedShape) -> CellLayout:
    return replace(LAYOUT, neighbours=others)


def for_checker(layout: CellLayout) -> CellLayout:
    """Return the cell with its neighbours as boxes that stand in it, which the checker knows."""
    boxes = {
        f"neighbour {k}": Box(n.T, n.shape.box.half_mm) for k, n in enumerate(layout.neighbours)
    }
    return replace(layout, neighbours=(), obstacles={**layout.obstacles, **boxes})


def test_a_plan_among_neighbours_touches_none_of_them(prepared: PreparedPart) -> None:
    wide, deep = axes_of_footprint()
    gap = 1.0
    layout = among(
        standing(
            (X_MM + wide + gap, Y_MM - 25.0, 0.0), (X_MM + wide + gap + 40.0, Y_MM + 25.0, 60.0)
        ),
        standing((X_MM - 60.0, Y_MM - deep - 90.0, 0.0), (X_MM, Y_MM - deep - 50.0, 100.0)),
    )
    start = OnTable(FLAT.index, T_START)
    plan = plan_from(prepared, layout, start)
    assert check(plan, for_checker(layout), BLOCK, start) == []
    # what the camera over the table sees of a part among others is not judged
    assert not any(isinstance(step, Look) for step in plan.steps)


def test_the_plan_for_the_part_alone_would_have_touched(prepared: PreparedPart) -> None:
    # or the test above shows nothing: fingers come down where a neighbour stands on both sides
    wide, deep = axes_of_footprint()
    start = OnTable(FLAT.index, T_START)
    alone = plan_from(prepared, LAYOUT, start)
    walled = for_checker(
        among(
            standing((X_MM + wide + 1, Y_MM - 60, 0.0), (X_MM + wide + 30, Y_MM + 60, 60.0)),
            standing((X_MM - wide - 30, Y_MM - 60, 0.0), (X_MM - wide - 1, Y_MM + 60, 60.0)),
            standing((X_MM - wide, Y_MM + deep + 1, 0.0), (X_MM + wide, Y_MM + deep + 30, 60.0)),
            standing((X_MM - wide, Y_MM - deep - 30, 0.0), (X_MM + wide, Y_MM - deep - 1, 60.0)),
        )
    )
    assert check(alone, walled, BLOCK, start) != []


def test_a_part_walled_in_is_refused_with_what_is_in_the_way(prepared: PreparedPart) -> None:
    wide, deep = axes_of_footprint()
    layout = among(
        standing((X_MM + wide + 1, Y_MM - 60, 0.0), (X_MM + wide + 30, Y_MM + 60, 60.0)),
        standing((X_MM - wide - 30, Y_MM - 60, 0.0), (X_MM - wide - 1, Y_MM + 60, 60.0)),
        standing((X_MM - wide, Y_MM + deep + 1, 0.0), (X_MM + wide, Y_MM + deep + 30, 60.0)),
        standing((X_MM - wide, Y_MM - deep - 30, 0.0), (X_MM + wide, Y_MM - deep - 1, 60.0)),
    )
    with pytest.raises(NoMotionError, match="touches another object on the table"):
        pick_paths(prepared, layout, T_START)


def test_a_part_under_another_waits_for_that_one(prepared: PreparedPart) -> None:
    # a lintel over one end of the block, on a post of its own
    wide, _ = axes_of_footprint()
    layout = among(
        standing((X_MM + wide - 10, Y_MM - 15, 34.0), (X_MM + wide + 30, Y_MM + 15, 44.0))
    )
    with pytest.raises(NoMotionError, match="is over it; take that one away first"):
        pick_paths(prepared, layout, T_START)


def test_a_part_that_touches_another_is_lifted_straight_up_and_over_it(
    prepared: PreparedPart,
) -> None:
    wide, _ = axes_of_footprint()
    top = 110.0
    # found in pictures a little into each other
    layout = among(
        standing((X_MM + wide - 0.1, Y_MM - 10, 0.0), (X_MM + wide + 20, Y_MM + 10, top))
    )
    for path in pick_paths(prepared, layout, T_START):
        assert path.up[-1][3] - path.up[0][3] >= top  # the carriage goes up by as much
    assert pick_paths(prepared, layout, T_START)


def test_a_set_down_is_aimed_away_from_neighbours(prepared: PreparedPart) -> None:
    (x_low, x_high), (y_low, y_high) = LAYOUT.set_down_mm
    middle = ((x_low + x_high) / 2, (y_low + y_high) / 2)
    other = standing((middle[0] - 20, middle[1] - 20, 0.0), (middle[0] + 20, middle[1] + 20, 30.0))
    for rest in rests(BLOCK, prepared.poses, among(other)):
        centre = rest.T_world_part[:3, :3] @ BLOCK.centroid_mm + rest.T_world_part[:3, 3]
        assert x_low <= centre[0] <= x_high
        assert y_low <= centre[1] <= y_high
        assert np.abs(centre[:2] - middle).max() >= 60.0
    for rest in rests(BLOCK, prepared.poses, LAYOUT):
        centre = rest.T_world_part[:3, :3] @ BLOCK.centroid_mm + rest.T_world_part[:3, 3]
        np.testing.assert_allclose(centre[:2], middle, atol=1e-6)


def test_a_plan_that_sets_down_among_neighbours_is_free_of_contact() -> None:
    # without a second gripper the lower face is shown after a set-down
    lone = replace(LAYOUT, fixed_gripper=None)
    options = PlanOptions(arm_grasps_per_pose=8, arm_grasps_round=8)
    part = prepare_part(BLOCK, sample_surface(BLOCK, 5.0), lone, options)
    middle = LAYOUT.set_down_mm.mean(axis=1)
    other = standing((middle[0] - 15, middle[1] - 15, 0.0), (middle[0] + 15, middle[1] + 15, 40.0))
    layout = replace(lone, neighbours=(other,))
    T = resting_pose(BLOCK, FLAT, float(middle[0]), float(middle[1]) + 75.0, 0.3)
    start = OnTable(FLAT.index, T)
    plan = plan_from(part, layout, start)
    assert any(isinstance(step, SetDown) for step in plan.steps)
    assert check(plan, for_checker(layout), BLOCK, start) == []


def test_shrunk_shapes_and_shapes_that_meet() -> None:
    shape = PartShape.of(BLOCK)
    np.testing.assert_allclose(shape.shrunk(0.5).box.half_mm, HALF - 0.5, atol=1e-9)
    np.testing.assert_allclose(shape.shrunk(50.0).box.half_mm, HALF / 2, atol=1e-9)
    one, other = Triangles(shape), Triangles(shape)
    T = np.eye(4)
    one.place(T)
    for beside, meets in ((59.5, True), (60.5, False)):
        T = np.eye(4)
        T[0, 3] = beside
        other.place(T)
        assert one.meets(other) == meets
