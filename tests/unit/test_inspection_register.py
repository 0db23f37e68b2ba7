"""How a lit picture lies on the predicted outline: shifts are found, and not made up."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from controller.arrays import FloatArray, Grey
from controller.inspection.registration import (
    confirm_edges,
    register,
    register_edges,
)

HEIGHT, WIDTH = 300, 400
LEFT, RIGHT, TOP, BOTTOM = 120.0, 280.0, 60.0, 240.0


def bar(x_px: float = 0.0, y_px: float = 0.0) -> Grey:
    """A bright bar before a dark ground, its edges where the outline is but for a shift."""
    x, y = np.meshgrid(np.arange(WIDTH) - x_px, np.arange(HEIGHT) - y_px)
    inside = np.minimum.reduce([x - LEFT, RIGHT - x, y - TOP, BOTTOM - y])
    share = np.clip(inside + 0.5, 0.0, 1.0)
    return np.round(20.0 + 150.0 * share).astype(np.uint8)


def side(name: str) -> tuple[FloatArray, FloatArray]:
    """Return points (n, 2) a pixel apart along a side of the bar, and their normals."""
    rows, columns = np.arange(TOP + 5, BOTTOM - 4), np.arange(LEFT + 5, RIGHT - 4)
    normal = {"left": (-1, 0), "right": (1, 0), "top": (0, -1), "bottom": (0, 1)}[name]
    if name in ("left", "right"):
        points = np.column_stack([np.full(len(rows), LEFT if name == "left" else RIGHT), rows])
    else:
        points = np.column_stack([columns, np.full(len(columns), TOP if name == "top" else BOTTOM)])
    return points.astype(float), np.tile(np.array(normal, float), (len(points), 1))


def outline(*names: str) -> tuple[FloatArray, FloatArray]:
    sides = [side(name) for name in names]
    return np.vstack([s[0] for s in sides]), np.vstack([s[1] for s in sides])


@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.0, 0.0), (0.0, -2.0), (1.5, 1.5), (-3.0, 2.0)])
def test_a_shift_is_measured_where_all_sides_show(shift: tuple[float, float]) -> None:
    edge, normals = outline("left", "right", "top", "bottom")
    found = register(bar(*shift), edge, normals)
    assert found is not None
    # one in ten is what is held back for want of profiles
    np.testing.assert_allclose(found.shift_px, shift, atol=0.1 * np.hypot(*shift) + 0.05)


def test_a_few_profiles_of_another_edge_are_no_shift_along_a_side_that_shows_nothing_else() -> None:
    """Of the lower side a short piece shows, and it lies beside the outline as a chamfer does."""
    edge, normals = outline("left", "right")
    points, down = side("bottom")
    points, down = points[:24] - [0.0, 1.4], down[:24]
    found = register(bar(), np.vstack([edge, points]), np.vstack([normals, down]))
    assert found is not None
    assert np.linalg.norm(found.shift_px) < 1.0


def test_a_true_shift_along_a_side_of_which_half_shows_is_found() -> None:
    edge, normals = outline("left", "right")
    points, down = side("bottom")
    half = len(points) // 2
    stacked = np.vstack([edge, points[:half]]), np.vstack([normals, down[:half]])
    found = register(bar(0.0, 2.0), *stacked)
    assert found is not None
    assert np.linalg.norm(found.shift_px) > 1.0


# --- pictures whose outline hardly shows: all edges at once --------------------------------------


def faint(shift: tuple[float, float], seed: int, blur_px: float = 0.7) -> Grey:
    """A bar four grey levels above its ground, as dark steel before a dark wall."""
    rng = np.random.default_rng(seed)
    picture = (bar(*shift).astype(float) - 20.0) * 4.0 / 150.0 + 18.0
    soft = cv2.GaussianBlur(picture, (0, 0), blur_px)
    return np.round(soft + rng.normal(0, 0.6, soft.shape)).astype(np.uint8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.0, 0.0), (0.0, -4.0), (-1.6, 1.6)])
def test_a_shift_of_a_dark_picture_is_measured_by_all_edges(shift: tuple[float, float]) -> None:
    edges = outline("left", "right", "top", "bottom")
    assert register(faint(shift, 1), *edges) is None  # the outline's single steps do not show
    found = register_edges(faint(shift, 1), *edges)
    assert found is not None
    np.testing.assert_allclose(found.shift_px, shift, atol=0.3)


def test_a_dark_picture_out_of_focus_is_as_wide_as_its_blur() -> None:
    edges = outline("left", "right", "top", "bottom")
    widths = []
    for blur_px in (0.7, 1.6, 2.5):
        found = register_edges(faint((0.0, 0.0), 2, blur_px), *edges)
        widths.append(found.width_px if found is not None else np.inf)
    assert widths[0] < 1.0
    assert widths[1] > widths[0] + 0.45
    assert widths[2] > widths[0] + 0.45


def test_edges_that_run_one_way_or_do_not_show_tell_no_shift() -> None:
    assert register_edges(faint((0.0, 0.0), 3), *outline("left", "right")) is None
    noise = np.random.default_rng(4).normal(20, 0.6, (HEIGHT, WIDTH)).round().astype(np.uint8)
    assert register_edges(noise, *outline("left", "right", "top", "bottom")) is None


@pytest.mark.parametrize("along", [0.0, 3.0])
def test_edges_that_run_one_way_confirm_a_pose_they_lie_on(along: float) -> None:
    edge, normals = outline("left", "right")
    picture = bar(0.0, along)  # a shift along them shows in no edge
    assert register_edges(picture, edge, normals) is None
    found = confirm_edges(picture, edge, normals, 1.0)
    assert found is not None
    assert abs(found.shift_px[0]) <= 0.5


@pytest.mark.parametrize("across", [-4.0, 2.0, 5.0])
def test_edges_that_lie_beside_a_pose_do_not_confirm_it(across: float) -> None:
    edge, normals = outline("left", "right")
    assert confirm_edges(bar(across, 0.0), edge, normals, 1.0) is None


def test_a_picture_that_shows_nothing_confirms_nothing() -> None:
    edge, normals = outline("left", "right", "top", "bottom")
    noise = np.random.default_rng(5).normal(20.0, 2.0, (HEIGHT, WIDTH))
    assert confirm_edges(np.round(noise).astype(np.uint8), edge, normals, 1.0) is None
