"""Boards found -> camera: choose the distortion terms, find the uncertainty, check both."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, inverse_pose
from messages import key

from ._lens import PINHOLE, likeliest
from ._types import (
    PARAMETERS,
    CalibratedCamera,
    CalibrationError,
    CalibrationLimits,
    View,
    ViewResidual,
    WorldFrame,
)
from .refusals import area_px, check_fit, check_placed, check_uncertainty, check_views, hull_of
from .solve import CalibrationFit, solve, start
from .uncertainty import Spread, held_sizes, on_table, position_std_mm, spread, tilt_rad

_TABLE_HEIGHTS_MM: Final = (0.0, 40.0)  # the table, and the top of a tall part
# Share of the pictures' median noise that every picture has at least, so that none counts more than
# four times.
_NOISE_FLOOR: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class _Weights:
    """Weights of corners (n,) per view: one over the standard deviation; 0 for an outlier."""

    of_views: tuple[FloatArray, ...]
    noise_px: float  # median noise of the pictures


def calibrate(
    views: Sequence[View],
    size_px: tuple[int, int],
    world: WorldFrame,
    limits: CalibrationLimits = CalibrationLimits(),  # noqa: B008 - frozen
) -> CalibratedCamera:
    """Return the camera that agrees best with the boards of all views.

    The Bayesian information criterion decides which distortion terms are free: a term stays if it
    explains more than fitting noise would. The other terms are 0.

    Parameters
    ----------
    views : views of one camera, all with the same focus and aperture
    size_px : (width, height) size of the pictures
    world : the frame that one of the flat views fixes
    limits : limits on the content of the views, and of plausible results

    Raises
    ------
    CalibrationError : the views do not determine the camera
    """
    check_views(views, size_px, world, limits)
    first, T_cam_boards = start(views, size_px, world)
    check_placed(views, T_cam_boards, limits)
    plain = solve(views, first, (*PINHOLE, "k1"), world, _even(views))
    weights = _weigh(plain, limits)
    try:
        everything = solve(views, plain.solution, PARAMETERS, world, weights.of_views)
        loose = spread(everything, {})
        fit = likeliest(views, everything, loose, size_px, world, weights.of_views)
        weights = _weigh(fit, limits)
        fit = solve(views, fit.solution, fit.free, world, weights.of_views)
        residuals = _residuals(views, fit, weights)
        check_fit(views, residuals, limits)
        held = held_sizes(fit, size_px, loose)
        found = spread(fit, held)
    except np.linalg.LinAlgError as error:
        raise CalibrationError(
            key(
                "the boards do not determine the camera; add pictures of the board "
                "tilted by 15 to 30 deg in different directions, all over the picture"
            )
        ) from error
    hull_px = hull_of(views)
    calibration = _described(size_px, world, fit, found, held, weights, residuals, hull_px)
    check_uncertainty(calibration, limits)
    return calibration


def _even(views: Sequence[View]) -> tuple[FloatArray, ...]:
    return tuple(np.ones(len(view.board.pixels)) for view in views)


def _weigh(fit: CalibrationFit, limits: CalibrationLimits) -> _Weights:
    """Return weights by each picture's own noise; outliers have weight 0."""
    # of a two-dimensional normal distribution the median distance is 1.177 standard deviations
    distances = [np.linalg.norm(r, axis=1) for r in fit.residuals_px]
    noise = np.array([np.median(d) / 1.1774 for d in distances])
    usual = float(np.median(noise))
    noise = np.maximum(noise, max(_NOISE_FLOOR * usual, 1e-4))
    return _Weights(
        tuple(
            np.where(d <= limits.outlier_sigma * s, 1.0 / s, 0.0)
            for d, s in zip(distances, noise, strict=True)
        ),
        usual,
    )


def _residuals(
    views: Sequence[View], fit: CalibrationFit, weights: _Weights
) -> tuple[ViewResidual, ...]:
    R_cam_world = fit.solution.T_cam_world[:3, :3]
    out = []
    for view, r, w, T in zip(
        views, fit.residuals_px, weights.of_views, fit.solution.T_ref_board, strict=True
    ):
        distance = np.linalg.norm(r[w > 0], axis=1)
        normal = T[:3, 2] if fit.is_on_table(view) else R_cam_world.T @ T[:3, 2]
        out.append(
            ViewResidual(
                view.name,
                view.placed,
                len(r),
                int((w == 0).sum()),
                float(np.sqrt(np.mean(distance**2))),
                float(np.linalg.norm(r, axis=1).max()),
                float(np.arccos(np.clip(normal[2], -1, 1))),
            )
        )
    return tuple(out)


def _described(
    size_px: tuple[int, int],
    world: WorldFrame,
    fit: CalibrationFit,
    found: Spread,
    held: dict[str, float],
    weights: _Weights,
    residuals: tuple[ViewResidual, ...],
    hull_px: FloatArray,
) -> CalibratedCamera:
    x = fit.solution.intrinsics
    K = np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1.0]])
    camera = Camera(size_px, K, x[4:].copy(), inverse_pose(fit.solution.T_cam_world))
    std = np.sqrt(np.diag(found.cov))
    tilt, tilt_std = tilt_rad(fit, found)
    used = np.concatenate(
        [r[w > 0] for r, w in zip(fit.residuals_px, weights.of_views, strict=True)]
    )
    return CalibratedCamera(
        camera=camera,
        free=fit.free,
        std={name: float(s) for name, s in zip(PARAMETERS, std, strict=False) if name in fit.free},
        held_std=held,
        parameters_cov=found.cov,
        noise_cov=found.noise_cov,
        position_std_mm=position_std_mm(fit, found),
        tilt_rad=tilt,
        tilt_std_rad=tilt_std,
        table=tuple(on_table(camera, fit, found, hull_px, z) for z in _TABLE_HEIGHTS_MM),
        views=residuals,
        rms_px=float(np.sqrt(np.mean(np.sum(used**2, axis=1)))),
        noise_px=weights.noise_px * found.noise,
        coverage=area_px(hull_px) / (size_px[0] * size_px[1]),
        condition=found.condition,
        focal_height_correlation=found.focal_height,
        world=world,
    )
