"""A part that slipped in the jaws is found again in the picture before the backlight panel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from controller import inspection as inspecting
from controller.cad import load_solid, sample_surface
from controller.cell.compute.held_search import find_hold
from controller.config import load_cell
from controller.imaging import inverse_pose, render_maps, transform
from controller.inspection import PosedPart
from controller.setup.layout import build_layout
from controller.setup.optics import panel_corners

ROOT = Path(__file__).parents[2]
CELL = load_cell(ROOT / "recipes/cells/emulated.yaml")
LAYOUT = build_layout(CELL)


@pytest.fixture(scope="module")
def part() -> PosedPart:
    solid = load_solid(ROOT / "recipes/parts/idler_riser.stl")
    return PosedPart(solid)


def slip(along: float, across: float, turn_deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    return np.array([[c, 0, s, along], [0, 1, 0, 0], [-s, 0, c, across], [0, 0, 0, 1.0]])


def task_of(part: PosedPart) -> inspecting.ViewTask:
    T = np.eye(4)
    T[:3, :3] = [[0.8, 0.0, 0.6], [0.0, 1.0, 0.0], [-0.6, 0.0, 0.8]]
    T[:3, 3] = LAYOUT.station_mm - T[:3, :3] @ part.solid.centroid_mm
    return inspecting.ViewTask(
        view_id="v", camera=LAYOUT.inspection, T_world_part_expected=T, holder=(),
        panel_mm=panel_corners(CELL, "station_backlight"), lamps=(),
        limits=inspecting.InspectionLimits(),
    )  # fmt: skip


def picture(part: PosedPart, T: np.ndarray, task: inspecting.ViewTask) -> np.ndarray:
    width, height = task.camera.size_px
    mask = render_maps(part.caster, T, task.camera, (0, 0, width, height)).mask
    return np.where(mask, 20, 220).astype(np.uint8)


# the pads' line is nearly the line of sight here, so that all of a slip shows in the picture
HAND = np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1.0]])


@pytest.mark.parametrize(
    ("along", "across", "turn_deg"), [(0.0, 0.0, 0.0), (7.0, 0.0, -5.0), (-9.0, 3.0, 12.0)]
)
def test_a_slip_along_or_about_the_pads_is_measured(
    part: PosedPart, along: float, across: float, turn_deg: float
) -> None:
    task = task_of(part)
    T = task.T_world_part_expected @ HAND @ slip(along, across, turn_deg) @ inverse_pose(HAND)
    samples = sample_surface(part.solid)
    found = find_hold(part, samples, task, HAND, picture(part, T, task))
    assert found is not None
    corners = np.asarray(part.solid.mesh.vertices)
    off = transform(found, corners) - transform(T, corners)
    # along the line of sight a shadow tells little: 700 mm away, 1 mm is 0.1 px at the rim
    assert np.abs(off[:, [0, 2]]).max() < 0.4


def test_an_empty_hand_is_no_slip(part: PosedPart) -> None:
    task = task_of(part)
    empty = np.full(task.camera.size_px[::-1], 220, np.uint8)
    assert find_hold(part, sample_surface(part.solid), task, HAND, empty) is None


def test_a_dark_picture_tells_nothing(part: PosedPart) -> None:
    task = task_of(part)
    dark = np.full(task.camera.size_px[::-1], 15, np.uint8)
    assert find_hold(part, sample_surface(part.solid), task, HAND, dark) is None


def test_another_part_in_the_hand_is_not_taken_for_this_one(part: PosedPart) -> None:
    task = task_of(part)
    other = load_solid(ROOT / "recipes/parts/holder.stl")
    T = task.T_world_part_expected.copy()
    T[:3, 3] = LAYOUT.station_mm - T[:3, :3] @ other.centroid_mm
    strange = picture(PosedPart(other), T, task)
    assert find_hold(part, sample_surface(part.solid), task, HAND, strange) is None
