"""Pose at which a view is compared, and the other poses that its outline allows.

The outline of a round part hardly depends on its turn about the axis, and that of a part seen
squarely hardly on its depth. The outline then fits many poses equally well. A difference in a lit
picture that appears at one of these poses and not at another says nothing about the part.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
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
    edge_model,
    fit_edges,
    predict_outline,
    twist,
)

from ._types import ViewTask
from .limits import COMPARED_PX, FARTHEST_PX, OUTLINE_POINTS, OUTLINE_PX, PAIRED_PX, SLIT_PX

AS_PLACED: Final = (0.05, 0.001)  # [mm, rad] largest movement of a tried pose by its fit
# Distance from the picture's outline beyond which a fitted outline point is off it.
OFF_PX: Final = 0.5
OFF_SHARE: Final = 0.03  # largest share of such points; in good fits it is one in a hundred
SMALL: Final = 1e-4  # step of a derivative [mm, rad]
FLOOR: Final = 1e-9  # least variance, so that no rounding error makes one negative
# Number of directions that an outline may leave undetermined: a turn and a tilt.
OPEN_COUNT: Final = 2
TRIED: Final = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)  # in standard deviations
SHOWS_PX: Final = 1.0  # shift in the picture below which two poses are the same
RESIDUAL_PLAY_PX: Final = 0.02  # difference of residuals between fits that are equally good


@dataclass(frozen=True, eq=False)
class PosedPart:
    """The part sought in the gripper: the solid, and the predictor of its pictures."""

    solid: Solid

    @cached_property
    def edges(self) -> EdgeModel:
        """Edges of the part that pictures may show."""
        return edge_model(self.solid)

    @property
    def caster(self) -> RayCaster:
        """Ray casting against the part, CAD frame."""
        return self.edges.caster


@dataclass(frozen=True, eq=False, slots=True)
class PoseFit:
    """A pose with its outline compared with the observed one.

    Attributes
    ----------
    T_world_part : (4, 4)
    residual_px : median distance of predicted outline points from the observed outline
    paired : share of predicted outline points that found the observed outline within 2 px
    maps : the prediction at the pose
    edge_px, edge_normals : (n, 2) predicted outline where it is judged, one point a pixel, and its
        normals, from the part to the ground
    edge_points_mm : (n, 3) points of the part on this outline, world
    gap_px : (n,) distance of the observed outline beyond it; nan where none is near
    step_mm : distance between these points
    covariance : (6, 6) of the centre of mass, world [mm], and of the rotation vector about it [rad]
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
    covariance: FloatArray

    @property
    def is_hidden(self) -> bool:
        """True if no outline shows: other views of the grasp, and the arm, tell the pose."""
        return len(self.edge_px) < OUTLINE_POINTS


def poses_as_good(
    part: PosedPart,
    task: ViewTask,
    fit: PoseFit,
    outline: OutlineMeasure,
) -> Iterator[PoseFit]:
    """Yield other poses that fit the outlines as well as the fitted one, nearest first.

    Parameters
    ----------
    part : the part
    task : the view, with its camera and the pose expected
    fit : measured pose
    outline : observed outline
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
            other = _fit(part, task, T_tried, fit, outline)
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
    T, camera = fit.T_world_part, task.camera
    pivot = transform(T, part.solid.centroid_mm[None])[0]
    points = transform(T, np.asarray(part.solid.mesh.vertices))
    before_px = camera.project(points)
    moves = [
        (camera.project(transform(twist(d[3:], d[:3], pivot), points)) - before_px).ravel() / SMALL
        for d in SMALL * np.eye(6)
    ]
    shows = np.array(moves)
    # Of equally probable steps, those that move the picture most come first.
    root = np.linalg.cholesky(fit.covariance + FLOOR * np.diag(np.diag(fit.covariance)))
    _, directions = np.linalg.eigh(root.T @ shows @ shows.T @ root)
    return np.asarray((root @ directions[:, ::-1]).T)


def point_spread(
    part: PosedPart, task: ViewTask, fit: PoseFit, points_mm: FloatArray
) -> FloatArray:
    """Return the uncertainty (n,) of points (n, 3) of the part, world, in the picture [px].

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
    """Return the displacement of the centre of mass [mm] and the turn [rad] from the expected pose.

    Parameters
    ----------
    part : the part, with its centre of mass
    task : the view, with its expected pose
    fit : measured pose
    """
    T_moved = fit.T_world_part @ inverse_pose(task.T_world_part_expected)
    com = part.solid.centroid_mm[None]
    off = transform(fit.T_world_part, com) - transform(task.T_world_part_expected, com)
    return float(np.linalg.norm(off)), rotation_angle(T_moved[:3, :3])


def _fit(
    part: PosedPart,
    task: ViewTask,
    T_tried: FloatArray,
    fit: PoseFit,
    outline: OutlineMeasure,
) -> PoseFit | None:
    """Return a tried pose refined by a few more fit steps; None where no outline is found."""
    if fit.is_hidden:
        return _placed(part, task, T_tried, fit)
    if len(outline.points) < OUTLINE_POINTS:
        return None
    mm, rad = AS_PLACED
    prior = Prior((mm, mm, mm), (rad, rad, rad), T_tried)
    options = FitOptions((FARTHEST_PX,), steps=1, prior=prior, noise=OUTLINE_PX)
    found = fit_edges(part.edges, T_tried, task.camera, outline, options)
    if found is None:
        return None
    return _compared(part, task, found.T_world_part, outline, fit.covariance)


def _placed(part: PosedPart, task: ViewTask, T: FloatArray, fit: PoseFit) -> PoseFit | None:
    """Return a pose of a view without an outline, None outside the picture."""
    roi = view_roi(part.solid.mesh.vertices, T, task.camera)
    if roi is None:
        return None
    return replace(fit, T_world_part=T, maps=render_maps(part.caster, T, task.camera, roi))


def _compared(
    part: PosedPart,
    task: ViewTask,
    T: FloatArray,
    outline: OutlineMeasure,
    covariance: FloatArray,
) -> PoseFit | None:
    """Return a pose with its outline, one point a pixel, None outside the picture."""
    camera = task.camera
    roi = view_roi(part.solid.mesh.vertices, T, camera)
    if roi is None:
        return None
    pixel_mm = camera.mm_per_px(transform(T, part.solid.centroid_mm[None])[0])
    rim = predict_outline(part.edges, T, camera, np.inf, pixel_mm)
    beside = camera.sight_lines(rim.pixels + SLIT_PX * rim.normals)
    met, _ = meet_part(part.caster, T, camera.position_mm, beside)
    mine = outline.is_judged(rim.pixels) & (met < 0)
    gap = outline.gaps(rim.pixels, rim.normals, rim, COMPARED_PX).gap_px[mine]
    if np.isfinite(gap).sum() < OUTLINE_POINTS:
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
        covariance=covariance,
    )


def _off_share(fit: PoseFit) -> float:
    if fit.is_hidden:
        return 0.0
    off = np.isnan(fit.gap_px) | (np.abs(fit.gap_px) > OFF_PX)
    return float(off.mean())


def _is_as_good(other: PoseFit, fit: PoseFit) -> bool:
    return (
        _off_share(other) <= max(_off_share(fit), OFF_SHARE)
        and other.residual_px <= fit.residual_px + RESIDUAL_PLAY_PX
    )
