"""Where the part is in a view: fitted to its outline, and what the outline leaves open.

A round part shows hardly how it is turned about its axis, a part seen squarely not how deep it is.
Such a pose is one of many that the outline allows alike. What a lit picture tells against the one
and not against the other tells nothing of the part.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.imaging import (
    RayCaster,
    ViewMaps,
    inverse_pose,
    meet_part,
    render_maps,
    rotation_angle,
    transform,
    view_roi,
)
from controller.recognition.fitting import (
    EdgeModel,
    FitOptions,
    OutlineMeasure,
    Prior,
    edge_jacobian,
    edge_model,
    fit_edges,
    predict_outline,
    sample_information,
    twist,
)

from ._types import ViewTask

PLANNED_HOLD: Final = (1.5, 0.03)  # [mm, rad] how far a fresh grip may be from the planned one
MEASURED_HOLD: Final = (0.3, 0.005)  # the same once a view has measured it
AS_PLACED: Final = (0.05, 0.001)  # a pose that is tried is fitted on by no more
# how far off the outline may be; one step each, as what shows changes while a held part tilts
REACH_PX: Final = (25.0, 12.5, 8.0, 6.0, 5.0)
COMPARED_PX: Final = 6.25  # the observed outline is looked for so far from the fitted one
CLEAR_PX: Final = 1.0  # light through a slit narrower than this is not compared
PAIRED_PX: Final = 2.0  # nearer than this a point of the outline is found
SIGMA_PX: Final = 0.4  # of an outline point: before a panel nothing moves a whole outline
MIN_POINTS: Final = 20  # of an outline, observed or predicted
HELD_BACK_PX: Final = 0.12  # a pose that its prior does not hold back fits better than this
OFF_PX: Final = 0.5  # an outline point that the fit has not brought to the picture's outline
OFF_SHARE: Final = 0.03  # of them; good fits leave one in a hundred
MAX_FITS: Final = 4
OPEN_COUNT: Final = 2  # directions that an outline may leave open: a turn, and a tilt
TRIED: Final = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)  # standard deviations
SHOWS_PX: Final = 1.0  # a pose nearer than this in the picture is the same one
RESIDUAL_PLAY_PX: Final = 0.02  # between fits that are as good


@dataclass(frozen=True, eq=False)
class PosedPart:
    """A part that is looked for in the gripper: the solid, and what predicts its pictures."""

    solid: Solid

    @cached_property
    def edges(self) -> EdgeModel:
        """What of it shows as an edge."""
        return edge_model(self.solid)

    @property
    def caster(self) -> RayCaster:
        """Rays against it, CAD frame."""
        return self.edges.caster


@dataclass(frozen=True, eq=False, slots=True)
class PoseFit:
    """A pose, and the outline there against the observed one.

    Attributes
    ----------
    T_world_part : (4, 4)
    residual_px : median distance of predicted outline points from the observed outline
    paired : share of predicted outline points that found the observed outline within 2 px
    maps : the prediction at the pose
    edge_px, edge_normals : (n, 2) the predicted outline where it is judged, one point a pixel, and
        its normals, from part to ground
    edge_points_mm : (n, 3) the part's points there, world
    gap_px : (n,) how far beyond it the observed outline is; nan where there is none near
    step_mm : between these points
    """

    T_world_part: FloatArray
    residual_px: float
    paired: float
    maps: ViewMaps
    edge_px: FloatArray
    edge_normals: FloatArray
    edge_points_mm: FloatArray
    gap_px: FloatArray
    step_mm: float


def measure_pose(part: PosedPart, task: ViewTask, outline: OutlineMeasure) -> PoseFit | None:
    """Return the pose fitted to an outline, begun where the task expects the part; None if none.

    Parameters
    ----------
    part : the part
    task : the view, with its camera and the pose expected
    outline : observed
    """
    expected = task.T_world_part
    prior = MEASURED_HOLD if task.is_hold_measured else PLANNED_HOLD
    fit = _fit(part, task, expected, outline, expected, prior)
    for _ in range(MAX_FITS):
        if fit is None or (fit.residual_px <= HELD_BACK_PX and _off_share(fit) <= OFF_SHARE):
            break
        # the view that measured the hold may have known it badly, and a fresh grip may be further
        # off than these steps go: on from there, as for a fresh grip, whose prior stays where it
        # is, or what the outline leaves open would drift
        again = _fit(part, task, fit.T_world_part, outline, expected, PLANNED_HOLD)
        if again is None or _badness(again) >= _badness(fit):
            break
        fit = again
    return fit


def poses_as_good(
    part: PosedPart, task: ViewTask, fit: PoseFit, outline: OutlineMeasure
) -> Iterator[PoseFit]:
    """Yield other poses that the outline allows as well as the fitted one, nearest first.

    Parameters
    ----------
    part : the part
    task : the view, with its camera and the pose expected
    fit : of `measure_pose`
    outline : observed
    """
    T, camera = fit.T_world_part, task.camera
    pivot = transform(T, part.solid.centroid_mm[None])[0]
    steps = pose_steps(part, task, fit)
    points = transform(T, np.asarray(part.solid.mesh.vertices))
    before_px = camera.project(points)
    for k in range(OPEN_COUNT):
        step = steps[k]
        for share in TRIED:
            T_step = twist(share * step[3:], share * step[:3], pivot)
            moved_px = camera.project(transform(T_step, points)) - before_px
            if np.linalg.norm(moved_px, axis=1).max() < SHOWS_PX:
                continue
            T_tried = T_step @ T
            other = _fit(part, task, T_tried, outline, T_tried, AS_PLACED, REACH_PX[:1])
            if other is not None and _is_as_good(other, fit):
                yield other


def pose_steps(part: PosedPart, task: ViewTask, fit: PoseFit) -> FloatArray:
    """Return six independent steps of one standard deviation each, (6, 6), the least certain first.

    Each is a displacement [mm] and a turn [rad] about the centre of mass, in the world.

    Parameters
    ----------
    part : the part
    task : the view, with its camera
    fit : the pose measured
    """
    pivot = transform(fit.T_world_part, part.solid.centroid_mm[None])[0]
    found = ~np.isnan(fit.gap_px)
    jacobian = edge_jacobian(fit.edge_points_mm[found], fit.edge_normals[found], pivot, task.camera)
    scale = np.array([PLANNED_HOLD[0]] * 3 + [PLANNED_HOLD[1]] * 3)
    information = sample_information(fit.step_mm, SIGMA_PX) * jacobian.T @ jacobian
    # in units of the prior, so that lengths and angles compare; the least certain come first
    values, directions = np.linalg.eigh(information * np.outer(scale, scale) + np.eye(6))
    return np.asarray((directions * scale[:, None] / np.sqrt(values)).T)


def point_spread(
    part: PosedPart, task: ViewTask, fit: PoseFit, points_mm: FloatArray
) -> FloatArray:
    """Return how far points (n, 3) of the part, world, may be off in the picture (n,) [px].

    One standard deviation, from what the outline leaves open of the pose.

    Parameters
    ----------
    part : the part
    task : the view, with its camera
    fit : the pose measured
    points_mm : in the world
    """
    pivot = transform(fit.T_world_part, part.solid.centroid_mm[None])[0]
    here = task.camera.project(points_mm)
    total = np.zeros(len(points_mm))
    for step in pose_steps(part, task, fit):
        away = task.camera.project(transform(twist(step[3:], step[:3], pivot), points_mm)) - here
        total += (away**2).sum(axis=1)
    return np.asarray(np.sqrt(total))


def moved(part: PosedPart, task: ViewTask, fit: PoseFit) -> tuple[float, float]:
    """Return how far the centre of mass is from where it was expected [mm], and the turn [rad].

    Parameters
    ----------
    part : knows its centre of mass, CAD frame
    task : the view, with the pose that was expected
    fit : the pose that was measured
    """
    T_moved = fit.T_world_part @ inverse_pose(task.T_world_part)
    com = part.solid.centroid_mm[None]
    off = transform(fit.T_world_part, com) - transform(task.T_world_part, com)
    return float(np.linalg.norm(off)), rotation_angle(T_moved[:3, :3])


def _fit(
    part: PosedPart,
    task: ViewTask,
    T_start: FloatArray,
    outline: OutlineMeasure,
    T_expected: FloatArray,
    prior: tuple[float, float],
    reach_px: tuple[float, ...] = REACH_PX,
) -> PoseFit | None:
    """Return all six freedoms fitted to an outline, None where it is not found.

    The prior draws them towards the pose expected: depth and tilt hardly show in one view.

    Parameters
    ----------
    part, task : the part, and the view with its camera
    T_start : (4, 4) where to begin
    outline : observed
    T_expected : (4, 4) what the prior draws towards
    prior : standard deviations of that pose [mm, rad]
    reach_px : see `REACH_PX`
    """
    if len(outline.points) < MIN_POINTS:
        return None
    mm, rad = prior
    expected = Prior((mm, mm, mm), (rad, rad, rad), T_expected)
    options = FitOptions(reach_px, steps=1, prior=expected, noise=SIGMA_PX)
    found = fit_edges(part.edges, T_start, task.camera, outline, options)
    return None if found is None else _compared(part, task, found.T_world_part, outline)


def _compared(
    part: PosedPart, task: ViewTask, T: FloatArray, outline: OutlineMeasure
) -> PoseFit | None:
    """Return a pose with its outline, one point a pixel, None where it is out of the picture."""
    camera = task.camera
    roi = view_roi(part.solid.mesh.vertices, T, camera)
    if roi is None:
        return None
    pixel_mm = camera.mm_per_px(transform(T, part.solid.centroid_mm[None])[0])
    rim = predict_outline(part.edges, T, camera, np.inf, pixel_mm)
    beside = camera.sight_lines(rim.pixels + CLEAR_PX * rim.normals)
    met, _ = meet_part(part.caster, T, camera.position_mm, beside)
    mine = outline.is_judged(rim.pixels) & (met < 0)
    gap = outline.gaps(rim.pixels, rim.normals, rim, COMPARED_PX).gap_px[mine]
    if np.isfinite(gap).sum() < MIN_POINTS:
        return None
    return PoseFit(
        T_world_part=T,
        residual_px=float(np.nanmedian(np.abs(gap))),
        paired=float(np.mean(np.abs(gap) < PAIRED_PX)),
        maps=render_maps(part.caster, T, camera, roi),
        edge_px=rim.pixels[mine],
        edge_normals=rim.normals[mine],
        edge_points_mm=rim.points_mm[mine],
        gap_px=gap,
        step_mm=rim.step_mm,
    )


def _off_share(fit: PoseFit) -> float:
    off = np.isnan(fit.gap_px) | (np.abs(fit.gap_px) > OFF_PX)
    return float(off.mean())


def _badness(fit: PoseFit) -> float:
    """Return the mean distance of the outlines [px], where each point counts to a few pixels."""
    far_px = 6 * OFF_PX
    return float(np.nan_to_num(np.minimum(np.abs(fit.gap_px), far_px), nan=far_px).mean())


def _is_as_good(other: PoseFit, fit: PoseFit) -> bool:
    return (
        _off_share(other) <= max(_off_share(fit), OFF_SHARE)
        and other.residual_px <= fit.residual_px + RESIDUAL_PLAY_PX
    )
