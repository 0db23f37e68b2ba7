"""Where the part is in a view: fitted to its outline, and what the outline leaves open.

A round part shows hardly how it is turned about its axis, a part seen squarely not how deep it is.
Such a pose is one of many that the outline allows alike. What a lit picture tells against the one
and not against the other tells nothing of the part.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Contour, inverse_pose, rotation_angle, transform
from controller.recognition import PosedPart, PoseFit, edge_jacobian, fit_pose, twist

from ._types import ViewTask

PLANNED_HOLD: Final = (1.5, 0.03)  # [mm, rad] how far a fresh grip may be from the planned one
SEEN_HOLD: Final = (0.3, 0.005)  # the same once a view has measured it
AS_PLACED: Final = (0.05, 0.001)  # a pose that is tried is fitted on by no more
HELD_BACK_PX: Final = 0.12  # a pose that its prior does not hold back fits better than this
OFF_PX: Final = 0.5  # an outline point that the fit has not brought to the picture's outline
OFF_SHARE: Final = 0.03  # of them; good fits leave one in a hundred
MOST_FITS: Final = 4
OPEN_COUNT: Final = 2  # directions that an outline may leave open: a turn, and a tilt
TRIED: Final = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0)  # standard deviations
SHOWS_PX: Final = 1.0  # a pose nearer than this in the picture is the same one
SIGMA_PX: Final = 0.5  # of an outline point
INDEPENDENT: Final = 0.1  # outline points are many and correlated: one in ten counts
RESIDUAL_PLAY_PX: Final = 0.02  # between fits that are as good


def measure_pose(
    part: PosedPart, task: ViewTask, outline: Contour, judged: BoolArray
) -> PoseFit | None:
    """Return the pose fitted to an outline, begun where the task expects the part; None if none.

    Parameters
    ----------
    part : the solid, with rays against it
    task : the view, with its camera and the pose expected
    outline : observed
    judged : (height, width) pixels whose outline is the part's own
    """
    prior = SEEN_HOLD if task.is_hold_seen else PLANNED_HOLD
    fit = _fit(part, task, task.T_world_part, outline, judged, prior)
    for _ in range(MOST_FITS):
        if fit is None or (fit.residual_px <= HELD_BACK_PX and _off_share(fit) <= OFF_SHARE):
            break
        # the view that measured the hold may have known it badly, and a fresh grip may be further
        # off than three rounds go: on from there, as for a fresh grip, whose prior stays where it
        # is, or what the outline leaves open would drift
        again = _fit(
            part, task, fit.T_world_part, outline, judged, PLANNED_HOLD, expected=task.T_world_part
        )
        if again is None or _badness(again) >= _badness(fit):
            break
        fit = again
    return fit


def poses_as_good(
    part: PosedPart, task: ViewTask, fit: PoseFit, outline: Contour, judged: BoolArray
) -> Iterator[PoseFit]:
    """Yield other poses that the outline allows as well as the fitted one, nearest first.

    Parameters
    ----------
    part : the solid, with rays against it
    task : the view, with its camera and the pose expected
    fit : of `measure_pose`
    outline : observed
    judged : (height, width) pixels whose outline is the part's own
    """
    T, camera = fit.T_world_part, task.camera
    pivot = transform(T, part.solid.centroid_mm[None])[0]
    paired = ~np.isnan(fit.gap_px)
    jacobian = edge_jacobian(fit.edge_points_mm[paired], fit.edge_normals[paired], pivot, camera)
    scale = np.array([PLANNED_HOLD[0]] * 3 + [PLANNED_HOLD[1]] * 3)
    information = INDEPENDENT / SIGMA_PX**2 * jacobian.T @ jacobian
    # in units of the prior, so that lengths and angles compare; the least certain come first
    values, directions = np.linalg.eigh(information * np.outer(scale, scale) + np.eye(6))
    points = transform(T, np.asarray(part.solid.mesh.vertices))
    before_px = camera.project(points)
    for k in range(OPEN_COUNT):
        step = directions[:, k] * scale / np.sqrt(values[k])
        for share in TRIED:
            T_step = twist(share * step[3:], share * step[:3], pivot)
            moved_px = camera.project(transform(T_step, points)) - before_px
            if np.linalg.norm(moved_px, axis=1).max() < SHOWS_PX:
                continue
            other = _fit(part, task, T_step @ T, outline, judged, AS_PLACED, steps_px=(1,))
            if other is not None and _is_as_good(other, fit):
                yield other


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
    outline: Contour,
    judged: BoolArray,
    prior: tuple[float, float],
    steps_px: tuple[int, ...] = (2, 2, 1),
    expected: FloatArray | None = None,
) -> PoseFit | None:
    return fit_pose(
        part,
        T_start,
        task.camera,
        outline,
        ignore=~judged,
        steps_px=steps_px,
        prior_mm=prior[0],
        prior_rad=prior[1],
        T_expected=expected,
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
