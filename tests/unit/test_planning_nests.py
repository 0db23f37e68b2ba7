"""Parts are put into the nests of trays: flat, within the nest, clear of what stands beside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from planning_cell import emulated_layout
from planning_checker import check

from controller.cad import make_solid, sample_surface, stable_poses
from controller.planning import (
    Box,
    CellLayout,
    Nest,
    NoPlanError,
    OnTable,
    PlanOptions,
    PreparedPart,
    Tray,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.geometry import PartShape, PlacedShape

LAYOUT = emulated_layout()
BLOCK = make_solid(
    trimesh.creation.box((60.0, 40.0, 30.0)), "block", "0123456789abcdef", where="block"
)
FLAT = next(p for p in stable_poses(BLOCK) if abs(p.R[2, 2]) > 0.99)
START = OnTable(FLAT.index, resting_pose(BLOCK, FLAT, 350.0, 20.0, 0.4))


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    options = PlanOptions(arm_grasps_per_pose=8, arm_grasps_round=8, fixed_grasps=8)
    return prepare_part(BLOCK, sample_surface(BLOCK, 5.0), LAYOUT, options)


def grid(tray: Tray, turn_rad: float | None = None) -> Tray:
    """Return a tray with two by two nests, numbered along x first."""
    (x, y), (w, h) = tray.centre_mm, tray.size_mm
    nests = tuple(
        Nest((x + i * w / 4, y + j * h / 4), (w / 2, h / 2), turn_rad)
        for j in (-1, 1)
        for i in (-1, 1)
    )
    return replace(tray, nests=nests)


def with_nests(next_nest: int, turn_rad: float | None = None) -> CellLayout:
    trays = {
        name: replace(grid(tray, turn_rad), next_nest=next_nest)
        for name, tray in LAYOUT.trays.items()
    }
    return replace(LAYOUT, trays=trays)


def corners_at(T: np.ndarray) -> np.ndarray:
    """Return the block's corners (8, 3) at a pose."""
    corners = np.asarray(trimesh.creation.box((60.0, 40.0, 30.0)).vertices)
    return np.asarray(corners @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize("number", [0, 3])
def test_a_part_is_set_down_flat_within_the_next_nest(prepared: PreparedPart, number: int) -> None:
    layout = with_nests(number)
    plan = plan_from(prepared, layout, START)
    assert set(plan.place) == {"accept", "reject", "quarantine"}
    for name, place in plan.place.items():
        corners = corners_at(place.T_world_part)
        nest = layout.trays[name].nests[number]
        assert np.abs(corners[:, 0] - nest.centre_mm[0]).max() <= nest.size_mm[0] / 2 + 1e-6
        assert np.abs(corners[:, 1] - nest.centre_mm[1]).max() <= nest.size_mm[1] / 2 + 1e-6
        # four corners on one level: it stands flat, as low as it is let go
        assert np.ptp(np.sort(corners[:, 2])[:4]) == pytest.approx(0.0, abs=1e-6)
        assert place.tilt_rad == 0.0
    assert check(plan, layout, BLOCK, START) == []


def test_a_nest_that_keeps_the_turn_has_parts_turned_alike(prepared: PreparedPart) -> None:
    turn = np.radians(30.0)
    for name, place in plan_from(prepared, with_nests(1, turn), START).place.items():
        R, up = place.T_world_part[:3, :3], place.T_world_part[2, :3]
        # each stable pose of a block has an edge along x: turned, along 30 degrees, or across it
        axis = int(np.argmax(np.abs(up)))
        along = R[:, (axis + 1) % 3]
        angle = np.degrees(np.arctan2(along[1], along[0])) % 90.0
        assert angle == pytest.approx(30.0, abs=1e-4), name


def test_a_part_is_put_beside_those_that_stand_there(prepared: PreparedPart) -> None:
    first = plan_from(prepared, with_nests(0), START)
    second = with_nests(1)
    stored = tuple(
        PlacedShape(PartShape.of(BLOCK), place.T_world_part) for place in first.place.values()
    )
    layout = replace(second, stored=stored)
    plan = plan_from(prepared, layout, START)
    boxes = {f"stored {k}": Box(s.T, s.shape.box.half_mm) for k, s in enumerate(stored)}
    walled = replace(second, obstacles={**layout.obstacles, **boxes})
    assert check(plan, walled, BLOCK, START) == []


def test_nests_too_small_for_the_part_are_named_with_their_room(prepared: PreparedPart) -> None:
    trays = {
        name: replace(tray, nests=(Nest(tray.centre_mm, (35.0, 25.0)),))
        for name, tray in LAYOUT.trays.items()
    }
    with pytest.raises(NoPlanError, match="nest 1 of tray accept, which has room for 35 x 25 mm"):
        plan_from(prepared, replace(LAYOUT, trays=trays), START)
