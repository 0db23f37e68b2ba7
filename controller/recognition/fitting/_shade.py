"""Fit of a pose to the grey levels inside a part, without knowledge of the lamps.

Surfaces with the same normal are about equally bright: brightness is fitted as a smooth function of
the normal, and the score is the share of the picture's variation that it explains. It separates
poses with one outline, and mirror images, without knowing the lamps' positions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera, meet_part

from ._model import EdgeModel

MAX_PIXELS = 1200
FLAT_VARIANCE = 4.0  # grey levels squared: below it a part is one even patch without information
RIDGE = 1e-3


@dataclass(frozen=True, slots=True)
class Shading:
    """Share of the brightness inside the part that a pose explains.

    Attributes
    ----------
    explained : share of the variance, 0..1; 0 where there is none to explain
    variance : variance of the grey levels looked at
    residual : variance that is left
    area_px : area of the region that was looked at
    """

    explained: float
    variance: float
    residual: float
    area_px: int

    @staticmethod
    def of_all(shadings: Sequence["Shading"]) -> "Shading":
        """Return one pose's shading of a region under several lamps, with equal weights."""
        # a bright picture must not outvote a dark one: what counts is by what ratio a pose is worse
        residual = np.exp(np.mean(np.log([max(one.residual, 1e-6) for one in shadings])))
        return Shading(
            explained=float(np.mean([one.explained for one in shadings])),
            variance=float(np.mean([one.variance for one in shadings])),
            residual=float(residual),
            area_px=sum(one.area_px for one in shadings),
        )


def shading_fits(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    crops: Sequence[Grey],
    corner_px: tuple[int, int],
    inside: BoolArray,
) -> tuple[Shading, ...]:
    """Return the fit of a pose to the grey levels of a region, picture by picture.

    Parameters
    ----------
    model : edges of the part; its mesh gives the surface's normals
    T_world_part : (4, 4) the pose asked about
    camera : calibrated, in the world's frame
    crops : (h, w) grey, each under other lamps
    corner_px : (x0, y0) corner of the crops' first pixel in the picture
    inside : (h, w) the pixels to explain: the part without its blurred rim
    """
    v, u = np.nonzero(inside)
    area_px = len(v)
    if area_px < 30:
        return (Shading(0.0, 0.0, 0.0, area_px),) * len(crops)
    every = max(1, area_px // MAX_PIXELS)
    v, u = v[::every], u[::every]
    pixels = np.column_stack([u + corner_px[0], v + corner_px[1]]).astype(np.float64)
    lines = camera.sight_lines(pixels)
    triangle, _ = meet_part(model.caster, T_world_part, camera.position_mm, lines)
    normals = model.normals[triangle] @ T_world_part[:3, :3].T
    missed = triangle < 0
    x, y, z = normals.T
    # harmonics up to the second order carry a matt surface's answer to any lamps; those lamps are
    # near, and their light falls off across a wide part
    right, down = (pixels - pixels.mean(axis=0)).T / max(float(np.ptp(pixels)), 1.0)
    basis = np.column_stack(
        [np.ones_like(x), x, y, z, x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1, missed]
    )
    basis[missed, :-1] = 0.0
    basis[:, 0] = 1.0
    basis = np.column_stack([basis, right, down])
    smooth = [cv2.GaussianBlur(crop, (0, 0), 1.0) for crop in crops]
    levels = np.column_stack([one[v, u].astype(np.float64) for one in smooth])
    normal = basis.T @ basis + RIDGE * len(v) * np.diag([0.0] + [1.0] * 11)
    fitted = basis @ np.linalg.solve(normal + 1e-9 * np.eye(12), basis.T @ levels)
    residuals = np.mean((levels - fitted) ** 2, axis=0)
    found = []
    for variance, residual in zip(levels.var(axis=0), residuals, strict=True):
        explained = 1.0 - residual / variance if variance > FLAT_VARIANCE else 0.0
        found.append(Shading(max(explained, 0.0), float(variance), float(residual), area_px))
    return tuple(found)
