"""One pose for all views of a grasp: as true as it says, and blind to a part's own size."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod
from numpy.typing import NDArray
from scipy.stats import norm
from shown_part import blank, bore, boss, cross_bore, part, perfect, photograph, pocket, shown, task

from controller.imaging import transform
from controller.inspection import PicturedView, ViewPictures, ViewScene, ViewTask, make_scene
from controller.inspection.grasp_pose import (
    GraspPose,
    OutlinedView,
    PoseSettings,
    backlit_outline,
    chord_px,
    fit_grasp,
)
from controller.recognition.fitting import twist

Array = NDArray[np.float64]
LOOKS = ((0.0, 0.0), (35.0, 20.0), (-70.0, 30.0))  # turn and tilt [deg]
SLIP = ((0.7, -0.9, 0.6), (0.9, -0.6, 0.7))  # of the grasp, part frame [mm], [deg]


def errors(seed: int = 3) -> list[tuple[Array, Array]]:
    """How the arm is off in each view: (3,) mm and (3,) rad."""
    rng = np.random.default_rng(seed)
    return [(rng.normal(0, 0.1, 3), np.radians(rng.normal(0, 0.1, 3))) for _ in LOOKS]


def true_poses() -> list[Array]:
    centre = part().solid.centroid_mm
    slip = twist(np.radians(SLIP[1]), np.array(SLIP[0]), centre)
    return [
        shown(turn, tilt) @ twist(rad, mm, centre) @ slip
        for (turn, tilt), (mm, rad) in zip(LOOKS, errors(), strict=True)
    ]


def outlined(
    seen: ViewTask, pictures: ViewPictures, scene: ViewScene | None = None
) -> OutlinedView:
    scene = scene or make_scene(seen)
    backlit = backlit_outline(pictures.backlit, scene)
    return OutlinedView(PicturedView(seen, pictures), scene, backlit)


def fitted(body: Body, poses: list[Array] | None = None) -> GraspPose:
    views = []
    for number, ((turn, tilt), T_true) in enumerate(zip(LOOKS, poses or true_poses(), strict=True)):
        T = shown(turn, tilt)
        seen = task(T, holder=(), view_id=f"v{number}")
        views.append(outlined(seen, photograph(body, T_true, (), ())))
    fit = fit_grasp(part(), views)
    assert fit is not None
    return fit


@cache
def of_perfect() -> GraspPose:
    return fitted(perfect())


def away(fit: GraspPose) -> list[Array]:
    """How far each view's pose is from the truth, (6,): centre of mass, rotation, world."""
    centre = part().solid.centroid_mm[None]
    out = []
    for view, T_true in zip(fit.views, true_poses(), strict=True):
        shift = transform(T_true, centre)[0] - transform(view.T_world_part_measured, centre)[0]
        R = T_true[:3, :3] @ view.T_world_part_measured[:3, :3].T
        turn = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        out.append(np.concatenate([shift, turn]))
    return out


def test_a_pose_is_as_near_to_the_truth_as_it_says() -> None:
    fit = of_perfect()
    for off, view in zip(away(fit), fit.views, strict=True):
        # along the camera's axis, world y, 0.1 mm of the arm's own error is what is known
        assert np.abs(off[[0, 2]]).max() < 0.015
        chi2 = off @ np.linalg.solve(view.covariance, off)
        assert chi2 < 16.8  # 99 % of six freedoms
        # the renderer has four by four rays a pixel, and edges along its rows
        assert view.residual_px < 0.25
        assert view.paired > 0.99


def test_views_share_the_grasp() -> None:
    fit = of_perfect()
    centre = part().solid.centroid_mm
    together = twist(np.radians(SLIP[1]), np.array(SLIP[0]), centre)
    off = fit.shift_mm - (transform(together, centre[None])[0] - centre)
    off = np.concatenate([off, fit.rotation_rad - np.radians(SLIP[1])])
    assert off @ np.linalg.solve(fit.covariance, off) < 16.8
    assert np.sqrt(np.diag(fit.covariance))[:3].max() < 0.12


def test_a_perfect_parts_faces_are_where_they_should_be() -> None:
    for face in of_perfect().faces:
        assert abs(face.grown_mm) < 3 * face.u_grown_mm
        assert abs(face.grown_mm) < 0.05


def test_a_bore_too_wide_has_grown_inwards() -> None:
    wide = rod(5.3, 40, 48).translate((-11, 3, 0))
    fit = fitted((blank() + boss()) - wide - cross_bore() - pocket())
    wall = next(f.id for f in part().solid.faces if abs(f.radius_mm - 5) < 0.1)
    found = next(f for f in fit.faces if f.face_id == wall)
    assert found.grown_mm == pytest.approx(-0.3, abs=3 * found.u_grown_mm)
    assert found.grown_mm < -0.2


def test_a_bore_out_of_place_moves_its_face_and_not_the_pose() -> None:
    body = (blank() + boss()) - bore().translate((0.8, 0, 0)) - cross_bore() - pocket()
    fit = fitted(body)
    for off, view in zip(away(fit), fit.views, strict=True):
        assert np.abs(off[[0, 2]]).max() < 0.06
        assert off @ np.linalg.solve(view.covariance, off) < 16.8
    wall = next(f.id for f in part().solid.faces if abs(f.radius_mm - 5) < 0.1)
    moved = next(f for f in fit.faces if f.face_id == wall)
    assert moved.moved_mm[:2] == pytest.approx([0.8, 0.0], abs=0.06)


def test_a_block_too_long_stays_too_long() -> None:
    body = (box(46.8, 34, 24) + boss()) - bore() - cross_bore() - pocket()
    fit = fitted(body)
    by_id = {f.face_id: f for f in fit.faces}
    ends = [f.id for f in part().solid.faces if f.kind == "plane" and abs(f.normal[0]) > 0.99]
    widest = sorted(ends, key=lambda i: -abs(part().solid.faces[i].centre_mm[0]))[:2]
    assert sum(by_id[i].grown_mm for i in widest) == pytest.approx(0.8, abs=0.12)


def test_a_part_larger_all_round_is_not_taken_for_a_nearer_one() -> None:
    body = perfect().translate(tuple(-part().solid.centroid_mm)).scale((1.01, 1.01, 1.01))
    fit = fitted(body.translate(tuple(part().solid.centroid_mm)))
    # 1 % of 700 mm would be 7 mm nearer
    for off in away(fit):
        assert abs(off[1]) < 0.5


def test_what_the_arm_is_off_from_view_to_view_is_bounded() -> None:
    poses = true_poses()
    centre = part().solid.centroid_mm
    poses[1] = poses[1] @ twist(np.zeros(3), np.array([2.0, 0.0, 0.0]), centre)
    fit = fitted(perfect(), poses)
    # a part that slipped between two views is off by more than any arm
    assert max(view.deviation_mm for view in fit.views) > 3 * PoseSettings().view_mm
    assert max(view.deviation_mm for view in of_perfect().views) < 3 * PoseSettings().view_mm


def test_no_outline_no_pose() -> None:
    seen = task(shown(), holder=())
    bright = np.full((512, 640), 200, dtype=np.uint8)
    assert fit_grasp(part(), [outlined(seen, ViewPictures(bright, {}))]) is None


@pytest.mark.parametrize("sigma_px", [0.6, 0.8, 1.2])
def test_the_chord_of_a_blurred_edge_is_off_its_half_level_by_so_much(sigma_px: float) -> None:
    slope = 1 / (np.sqrt(2 * np.pi) * sigma_px)
    rng = np.random.default_rng(1)
    edge = rng.uniform(0, 1, 4000)
    before, after = norm.cdf((0 - edge) / sigma_px), norm.cdf((1 - edge) / sigma_px)
    off = (0.5 - before) / (after - before) - edge
    assert chord_px(slope) == pytest.approx(np.sqrt(np.mean(off**2)), rel=0.03)


def test_a_panel_darker_at_its_rim_shifts_no_edge() -> None:
    T = shown()
    picture = photograph(perfect(), T, (), ()).backlit
    fade = np.linspace(1.0, 0.75, picture.shape[1])
    faded = np.round(picture * fade).astype(np.uint8)
    scene = make_scene(task(T, holder=()))
    even, uneven = (backlit_outline(p, scene).outline for p in (picture, faded))
    near = np.linalg.norm(even.points[:, None] - uneven.points[None, ::5], axis=2).argmin(axis=0)
    off = ((uneven.points[::5] - even.points[near]) * even.normals[near]).sum(axis=1)
    assert abs(float(np.median(off))) < 0.01


def outline_of(number: int, *, is_hidden: bool = False, is_absent: bool = False) -> OutlinedView:
    """One look; with nothing of its outline before the panel, or with no part there."""
    turn, tilt = LOOKS[number]
    seen = task(shown(turn, tilt), holder=(), view_id=f"v{number}")
    body = box(6, 6, 6).translate((12, 8, 14)) if is_absent else perfect()
    scene = make_scene(seen)
    if is_hidden:
        scene = replace(scene, panel=np.zeros_like(scene.panel))
    return outlined(seen, photograph(body, true_poses()[number], (), ()), scene)


@pytest.mark.parametrize("number", range(len(LOOKS)))
def test_a_view_that_shows_no_outline_has_the_grasps_pose_within_the_arms_error(
    number: int,
) -> None:
    fit = fit_grasp(part(), [outline_of(i, is_hidden=i == number) for i in range(len(LOOKS))])
    assert fit is not None
    assert fit.missing == ()
    pose = fit.views[number]
    assert [v.is_hidden for v in fit.views] == [i == number for i in range(len(LOOKS))]
    off = away(fit)[number]
    assert off @ np.linalg.solve(pose.covariance, off) < 16.8
    # what the arm may be off from view to view is not known of this one
    assert np.sqrt(np.diag(pose.covariance))[:3].min() > PoseSettings().view_mm
    # along the camera's axis, and across it
    assert np.sqrt(np.diag(pose.covariance))[:3].max() < 0.3


def test_a_view_whose_outline_should_show_and_does_not_is_left_out() -> None:
    fit = fit_grasp(part(), [outline_of(0), outline_of(1, is_absent=True), outline_of(2)])
    assert fit is not None
    assert fit.missing == ("v1",)


def test_no_outline_in_any_view_is_no_pose() -> None:
    assert fit_grasp(part(), [outline_of(i, is_hidden=True) for i in range(len(LOOKS))]) is None
