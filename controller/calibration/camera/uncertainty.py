"""The uncertainty of the fit: of each parameter, the camera's pose, and positions on the table.

The effect of the pictures' noise is the inverse of the normal matrix. A distortion term that the
views do not determine is held at 0, but it is not known to be 0. Its standard deviation is taken as
a fifth of the term before it in the lens's series, or as the value that the views would not notice,
if that is less. Its effect on everything else is added ("consider parameters", Schmidt 1966).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

from ._types import PARAMETERS, TableUncertainty
from .solve import CalibrationFit, by_turn, project

# Each term of the lens's series is taken as this share of the term before, at the picture's
# corners, since the series converges.
_NEXT_TERM: Final = 0.2
_GRID: Final = (33, 27)
_POSE: Final = slice(len(PARAMETERS), len(PARAMETERS) + 6)


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Uncertainty of a fit: PARAMETERS, then rotation [rad] and translation [mm] of the world.

    Attributes
    ----------
    cov : covariance (15, 15), the effect of held parameters included
    noise_cov : covariance (15, 15) from the corners' noise alone; 0 for held parameters
    noise : standard deviation of a weighted residual; 1 where the weights are right
    condition : condition number of the Jacobian with its columns scaled to length 1
    focal_height : correlation of fx with the distance along the optical axis
    """

    cov: FloatArray
    noise_cov: FloatArray
    noise: float
    condition: float
    focal_height: float


def free_columns(fit: CalibrationFit) -> FloatArray:
    """Return the Jacobian's columns of the free unknowns."""
    held = [i for i, name in enumerate(PARAMETERS) if name not in fit.free]
    return np.delete(fit.jac, held, axis=1)


def spread(fit: CalibrationFit, held_std: Mapping[str, float]) -> Spread:
    """Return the covariance of a fit.

    Parameters
    ----------
    fit : fit of the camera and the views
    held_std : standard deviation of each held parameter

    Raises
    ------
    numpy.linalg.LinAlgError : the views leave an unknown wholly open
    """
    count = len(PARAMETERS)
    jac = free_columns(fit)
    used = int((np.abs(fit.jac).max(axis=1) > 0).sum())  # rows of weight 0 do not count
    noise = float(np.sqrt(fit.cost / max(1, used - jac.shape[1])))
    scale = np.linalg.norm(jac, axis=0)
    _, singular, right = np.linalg.svd(jac / scale, full_matrices=False)
    if singular[-1] <= 1e-12 * singular[0]:
        raise np.linalg.LinAlgError("singular")
    inverse = (right.T / singular**2) @ right / np.outer(scale, scale)
    m = len(fit.free) + 6
    free = [i for i, name in enumerate(PARAMETERS) if name in fit.free]
    kept = [*free, *range(count, count + 6)]
    noise_cov = np.zeros((count + 6, count + 6))
    noise_cov[np.ix_(kept, kept)] = noise**2 * inverse[:m, :m]
    cov = noise_cov.copy()
    for name, std in held_std.items():
        if name in fit.free:
            continue
        i = PARAMETERS.index(name)
        # had it been 1, everything else would have come out different by this much
        moved = np.zeros(count + 6)
        moved[kept] = -(inverse @ (jac.T @ fit.jac[:, i]))[:m]
        moved[i] = 1.0
        cov += std**2 * np.outer(moved, moved)
    z = count + 5
    focal_height = cov[0, z] / np.sqrt(cov[0, 0] * cov[z, z])
    return Spread(cov, noise_cov, noise, float(singular[0] / singular[-1]), float(focal_height))


def held_sizes(fit: CalibrationFit, size_px: tuple[int, int], loose: Spread) -> dict[str, float]:
    """Return the standard deviation of each held distortion term.

    Parameters
    ----------
    fit : with some terms held at 0
    size_px : (width, height) size of the pictures
    loose : of the fit that holds nothing
    """
    views_pass = dict(zip(PARAMETERS, np.sqrt(np.diag(loose.noise_cov)), strict=False))
    value = dict(zip(PARAMETERS, fit.solution.intrinsics, strict=True))
    fx, fy, cx, cy = fit.solution.intrinsics[:4]
    width, height = size_px
    corners = np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=float)
    r = float(np.linalg.norm((corners - (cx, cy)) / (fx, fy), axis=1).max())

    def size(name: str, limit: float) -> float:
        known = min(float(views_pass[name]), limit)
        return max(abs(value[name]), known) if name in fit.free else known

    k1 = size("k1", np.inf)
    k2 = size("k2", _NEXT_TERM * k1 / r**2)
    sizes = {"k1": k1, "k2": k2, "k3": size("k3", _NEXT_TERM * k2 / r**2)}
    # tangential terms move a point at r by about 3 p r^2, the first radial one by k1 r^3
    sizes |= {name: size(name, _NEXT_TERM * k1 * r / 3) for name in ("p1", "p2")}
    return {name: s for name, s in sizes.items() if name not in fit.free}


def position_std_mm(fit: CalibrationFit, found: Spread) -> FloatArray:
    """Return the standard deviation (3,) of the camera's position in the world."""
    T = fit.solution.T_cam_world
    R, t = T[:3, :3], T[:3, 3]
    t_cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    jac = -R.T @ np.hstack([t_cross, np.eye(3)])  # of -R^T t, R turned from the left
    std: FloatArray = np.sqrt(np.diag(jac @ found.cov[_POSE, _POSE] @ jac.T))
    return std


def tilt_rad(fit: CalibrationFit, found: Spread) -> tuple[float, float]:
    """Return the angle between the optical axis and the vertical, and its standard deviation."""
    R = fit.solution.T_cam_world[:3, :3]
    lean = R[2, :2]  # the optical axis's horizontal part, in the world
    tilt = float(np.arctan2(np.linalg.norm(lean), abs(R[2, 2])))
    turn = found.cov[_POSE, _POSE][:3, :3]
    jac = np.column_stack([R[1, :2], -R[0, :2], np.zeros(2)])  # (w x R)[2] = w0 R[1] - w1 R[0]
    cov = jac @ turn @ jac.T
    across = lean / max(float(np.linalg.norm(lean)), 1e-12)
    std = float(np.sqrt(across @ cov @ across))
    worst = float(np.sqrt(np.linalg.eigvalsh(cov)[-1]))
    return tilt, std if tilt > 2 * worst else worst


def on_table(
    camera: Camera, fit: CalibrationFit, found: Spread, hull_px: FloatArray, height_mm: float
) -> TableUncertainty:
    """Return the uncertainty of pixels projected to the plane z = height, over the whole picture.

    Parameters
    ----------
    camera : camera of the fit
    fit : the one chosen
    found : its spread
    hull_px : (n, 2) round all corners seen
    height_mm : height of the plane over the table
    """
    width, height = camera.size_px
    u, v = np.meshgrid(np.linspace(0, width - 1, _GRID[0]), np.linspace(0, height - 1, _GRID[1]))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    p_world = camera.on_plane(pixels, height_mm)
    T = fit.solution.T_cam_world
    p_cam = p_world @ T[:3, :3].T + T[:3, 3]
    _, by_point, by_lens = project(p_cam, fit.solution.intrinsics)
    by_turning = by_turn(by_point, p_cam - T[:3, 3], np.zeros(3))
    by_all = np.concatenate([by_lens, by_turning, by_point], axis=2)
    # the pixel is fixed, so the point on the plane moves against the effect of the parameters
    moved = -np.linalg.solve((by_point @ T[:3, :3])[:, :, :2], by_all)
    cov = moved @ found.cov @ moved.transpose(0, 2, 1)
    std = np.sqrt(np.linalg.eigvalsh(cov)[:, -1])
    worst = int(std.argmax())
    outline = hull_px.astype(np.float32)
    covered = [
        cv2.pointPolygonTest(outline, (float(a), float(b)), measureDist=False) >= 0
        for a, b in pixels
    ]
    return TableUncertainty(
        height_mm,
        float(std[worst]),
        (float(pixels[worst, 0]), float(pixels[worst, 1])),
        float(std[covered].max(initial=0.0)),
        float(np.median(std)),
    )
