"""The gripper's place, measured before the panel; and a view that only its gripper's sides show."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shown_part import (
    CAMERA,
    hand,
    moved,
    part,
    perfect,
    photograph,
    samples,
    shown,
    task,
)

from controller.imaging import RayCaster, render_maps, view_roi
from controller.inspection import (
    OUTLINE,
    PicturedView,
    ViewResult,
    ViewScene,
    WorldBox,
    before_part,
    box_mesh,
    make_scene,
    with_measured_holder,
)
from controller.inspection.grasp_pose import backlit_outline, fit_grasp
from controller.inspection.view import NotEvaluated, Strictness, compare_view, outline_view
from controller.recognition.fitting import twist

Array = NDArray[np.float64]
T = shown(20, 12, 5)
GAPS = {  # how the gripper stands beside its place: the hand [mm], how much wider the jaws are [mm]
    "as expected": ((0.0, 0.0, 0.0), 0.0),
    "beside its place": ((0.7, 0.0, -0.6), 0.0),
    "opened wider": ((0.0, 0.0, 0.0), 1.2),
    "both": ((-0.5, 0.0, 0.5), -0.5),
}


def standing(gap: str) -> tuple[WorldBox, ...]:
    """The hand as it truly stands; the first two boxes are its fingers."""
    (shift, wider), boxes = GAPS[gap], list(hand(T))
    line = boxes[0].T[:3, 3] - boxes[1].T[:3, 3]
    line /= np.linalg.norm(line)
    out = []
    for number, box in enumerate(boxes):
        pose = box.T.copy()
        pose[:3, 3] += shift
        if number < 2:
            pose[:3, 3] += (0.5 - number) * wider * line
        out.append(WorldBox(pose, box.half_mm))
    return tuple(out)


def measured(true: tuple[WorldBox, ...]) -> tuple[ViewScene, ViewScene]:
    """The scene as expected and as measured in the picture of a gripper that stands elsewhere."""
    seen = task(T)
    scene = make_scene(seen)
    dark = silhouette(true) | render_maps(part().caster, T, CAMERA, (0, 0, *CAMERA.size_px)).mask
    # the tests' renderer draws what is far from the part on a coarse raster
    light = cv2.GaussianBlur(np.where(dark, 8.0, 205.0), (0, 0), 0.7)
    noise = np.random.default_rng(1).normal(0, 1.0, light.shape)
    backlit = backlit_outline(np.round(light + noise).astype(np.uint8), scene)
    roi = view_roi(part().solid.mesh.vertices, T, CAMERA)
    assert roi is not None
    maps = render_maps(part().caster, T, CAMERA, roi)
    found = with_measured_holder(scene, CAMERA, maps, backlit.share)
    return before_part(scene, maps, CAMERA), before_part(found, maps, CAMERA)


def silhouette(boxes: tuple[WorldBox, ...]) -> NDArray[np.bool_]:
    width, height = CAMERA.size_px
    return render_maps(RayCaster(box_mesh(boxes)), np.eye(4), CAMERA, (0, 0, width, height)).mask


@pytest.mark.parametrize("gap", GAPS)
def test_the_gripper_is_masked_where_the_picture_shows_it_and_hardly_more(gap: str) -> None:
    true = standing(gap)
    expected, found = measured(true)
    # the whole of what stands there, where it is not behind the part, with the blur of its edge
    roi = view_roi(part().solid.mesh.vertices, T, CAMERA)
    assert roi is not None
    x0, y0, x1, y1 = roi
    at_part = np.zeros(found.holder_mask.shape, dtype=bool)
    at_part[y0:y1, x0:x1] = True
    behind = render_maps(part().caster, T, CAMERA, (0, 0, *CAMERA.size_px)).mask
    beside = silhouette(true) & ~behind & at_part
    assert beside.sum() > 500
    assert not (beside & ~found.holder_mask).any()
    if gap == "as expected":
        assert found.holder_mask[at_part].sum() < 0.9 * expected.holder_mask[at_part].sum()
    # of the fingers nothing shows how far they reach: the palm is out of the picture
    assert max(found.margins_px[:2]) <= 7 < min(expected.margins_px)


@pytest.mark.parametrize("gap", GAPS)
def test_a_fingers_place_is_as_true_as_its_margin_says(gap: str) -> None:
    _, found = measured(standing(gap))
    for true, box, margin in zip(standing(gap)[:2], found.boxes, found.margins_px, strict=False):
        off_px = CAMERA.project(box.T[None, :3, 3]) - CAMERA.project(true.T[None, :3, 3])
        assert np.linalg.norm(off_px) < margin


def test_a_gripper_that_stands_out_of_its_boxes_has_a_margin_for_that() -> None:
    # covers of 1 mm on all sides that no calibration knows of: 5 px
    _, bare = measured(hand(T))
    _, covered = measured(tuple(WorldBox(box.T, box.half_mm + 1.0) for box in hand(T)))
    for wide, usual in zip(covered.margins_px[:2], bare.margins_px[:2], strict=True):
        assert 4 <= wide - usual <= 9


def test_a_gripper_of_which_nothing_shows_keeps_its_margin() -> None:
    scene = make_scene(task(T))
    share = np.zeros(CAMERA.size_px[::-1], dtype=np.float32)
    roi = view_roi(part().solid.mesh.vertices, T, CAMERA)
    assert roi is not None
    maps = render_maps(part().caster, T, CAMERA, roi)
    assert with_measured_holder(scene, CAMERA, maps, share) is scene
    # two standard deviations of hand and fingers, 1.3 mm, and the blur of their edge
    assert set(scene.margins_px) == {9}


# ------------------------------------------------------------------ a view without an outline


def window(T_world_part: Array) -> tuple[WorldBox, ...]:
    """Four slats before the part: its outline and its bore are behind them, a window is free."""
    boxes = []
    for x, y, half in (
        (-14.0, 0.0, (12.0, 20.0, 2.0)),
        (24.0, 0.0, (2.0, 20.0, 2.0)),
        (10.0, 17.5, (12.0, 2.5, 2.0)),
        (10.0, -17.5, (12.0, 2.5, 2.0)),
    ):
        pose = np.eye(4)
        pose[:3, 3] = x, y, 21.0
        boxes.append(WorldBox(T_world_part @ pose, np.array(half)))
    return tuple(boxes)


FRONT = shown(2, 1)
OTHERS = (shown(-25, -8, 10), shown(80, 0))  # square to each other, they leave little open


@cache
def through_the_window(moved_mm: float = 0.0, other_count: int = 2) -> ViewResult:
    """The view through the window, with the pose that other views of the grasp give.

    Parameters
    ----------
    moved_mm : by how much the part has moved in the jaws since the other views
    other_count : number of other views
    """
    slip = twist(np.radians([0.3, -0.4, 0.2]), np.array([0.4, 0.2, -0.3]), part().solid.centroid_mm)
    others = OTHERS[:other_count]
    tasks = [
        task(FRONT, window(FRONT), "window"),
        *(task(pose, None, f"open {i}") for i, pose in enumerate(others)),
    ]
    true = [moved(FRONT, (moved_mm, 0.0, 0.0), 0.0) @ slip, *(pose @ slip for pose in others)]
    pictures = [
        photograph(perfect(), pose, one.holder) for pose, one in zip(true, tasks, strict=True)
    ]
    outlined = [outline_view(PicturedView(*pair)) for pair in zip(tasks, pictures, strict=True)]
    fit = fit_grasp(part(), [one for one in outlined if not isinstance(one, NotEvaluated)])
    assert fit is not None
    pose = fit.view("window")
    assert pose is not None
    assert pose.is_hidden
    strictness = Strictness(view_count=len(tasks))
    window_view = compare_view(part(), samples(), outlined[0], pose, strictness)
    if isinstance(window_view, NotEvaluated):
        return window_view.result(samples())
    return window_view.judged()


def test_a_view_whose_outline_the_gripper_hides_is_compared_at_the_grasps_pose() -> None:
    result = through_the_window()
    assert result.evaluated, result.reason
    assert result.findings == ()
    assert any(c.compared.any() and not c.reason for c in result.checks if c.name != OUTLINE)
    (outline,) = (check for check in result.checks if check.name == OUTLINE)
    assert not outline.compared.any()


@pytest.mark.parametrize("moved_mm", [0.8, 1.5])
def test_a_part_that_slipped_since_the_other_view_is_not_compared_there(moved_mm: float) -> None:
    result = through_the_window(moved_mm)
    lit = [check for check in result.checks if check.name != OUTLINE]
    assert lit
    assert all(check.reason for check in lit)
    assert not result.compared.any()
    assert result.findings == ()


def test_one_other_view_may_leave_the_pose_too_open() -> None:
    result = through_the_window(other_count=1)
    assert not result.evaluated
    assert "the other views leave its place open by" in result.reason
