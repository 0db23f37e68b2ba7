"""How well a pose explains the grey levels inside a part, whatever the lamps are.

Every surface that is turned the same way is about as bright: brightness is fitted as a smooth
function of the normal, and what of the picture's variation that explains is the score. It tells
poses apart that have one outline, and mirror images, without knowing where the lamps stand.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera, meet_part

from ._model import EdgeModel

MAX_PIXELS = 1200
FLAT_VARIANCE = 4.0  # grey levels squared: below it a part is one even patch and says nothing
RIDGE = 1e-3


@dataclass(frozen=True, slots=True)
class Shading:
    """What a pose explains of the brightness inside the part.

    Attributes
    ----------
    explained : share of the variance, 0..1; 0 where there is none to explain
    variance : of the grey levels looked at
    residual : variance that is left
    area_px : of the region that was looked at
    """

    explained: float
    variance: float
    residual: float
    area_px: int


def shading_fit(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    crop: Grey,
    corner_px: tuple[int, int],
    inside: BoolArray,
) -> Shading:
    """Return how well a pose explains the grey levels of a region.

    Parameters
    ----------
    model : edges of the part; its mesh gives the surface's normals
    T_world_part : (4, 4) the pose asked about
    camera : calibrated, in the world's frame
    crop : (h, w) grey
    corner_px : (x0, y0) of the crop's first pixel in the picture
    inside : (h, w) the pixels to explain: the part without its blurred rim
    """
    v, u = np.nonzero(inside)
    area_px = len(v)
    if area_px < 30:
        return Shading(0.0, 0.0, 0.0, area_px)
    every = max(1, area_px // MAX_PIXELS)
    v, u = v[::every], u[::every]
    smooth = cv2.GaussianBlur(crop, (0, 0), 1.0)
    level = smooth[v, u].astype(np.float64)
    pixels = np.column_stack([u + corner_px[0], v + corner_px[1]]).astype(np.float64)
    lines = camera.sight_lines(pixels)
    triangle, _ = meet_part(model.caster, T_world_part, camera.position_mm, lines)
    normals = model.normals[triangle] @ T_world_part[:3, :3].T
    missed = triangle < 0
    x, y, z = normals.T
    # harmonics up to the second order carry a matt surface's answer to any lamps
    basis = np.column_stack(
        [np.ones_like(x), x, y, z, x * y, x * z, y * z, x * x - y * y, 3 * z * z - 1, missed]
    )
    basis[missed, :-1] = 0.0
    basis[:, 0] = 1.0
    centred = level - level.mean()
    variance = float(np.mean(centred**2))
    normal = basis.T @ basis + RIDGE * len(level) * np.diag([0.0] + [1.0] * 9)
    fitted = basis @ np.linalg.solve(normal + 1e-9 * np.eye(10), basis.T @ level)
    residual = float(np.mean((level - fitted) ** 2))
    explained = 1.0 - residual / variance if variance > FLAT_VARIANCE else 0.0
    return Shading(max(explained, 0.0), variance, residual, area_px)
