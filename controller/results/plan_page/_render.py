"""Pictures of bodies of triangles by casting a ray a pixel: shaded, with shadows and ink lines."""

import base64
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ._bodies import Stage
from ._views import Eye

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Picture = NDArray[np.uint8]

FINER = 2  # rays a pixel, each way
PAPER = (250.0, 250.0, 249.0)
INK_SHARE = 0.38  # of a surface's brightness, along its edges
AMBIENT, KEY, FILL = 0.46, 0.50, 0.16
SHADE = 0.62  # of the key light's share is gone in a shadow
CREASE = float(np.cos(np.radians(24.0)))
LIFT_MM = 0.05  # off a surface, so that it does not shadow itself
COLOURS_STEP = 3  # levels between two colours of the file: neither seen nor stored


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What each ray of a picture meets.

    Attributes
    ----------
    triangle : (height, width) int, -1 where nothing is
    points_mm : (height, width, 3) where, in the world
    """

    triangle: NDArray[np.int32]
    points_mm: Array


def look(stage: Stage, eye: Eye) -> Sight:
    """Cast a picture's rays."""
    width, height = eye.size
    origins = np.broadcast_to(eye.origins_mm, eye.directions.shape)
    triangle, distance = stage.caster.first_hit(origins, eye.directions)
    reach = np.where(triangle >= 0, distance, 0.0)
    points = origins + reach[:, None] * eye.directions
    return Sight(triangle.reshape(height, width), points.reshape(height, width, 3))


def shade(
    stage: Stage, eye: Eye, sight: Sight, paint: Floats | None = None, relief: float = 1.0
) -> Floats:
    """Return a picture as it was cast, (height, width, 3) 0..255.

    Parameters
    ----------
    paint : (height, width, 3) colours that stand for the bodies' own, NaN where they do not
    relief : how much light and shadow change the colours, 0 for not at all
    """
    triangle = sight.triangle
    seen = triangle >= 0
    bodies = np.array([body.colour for body in stage.bodies], dtype=np.float32)
    colour = bodies[stage.body_of_triangle[triangle]]
    if paint is not None:
        colour = np.where(np.isnan(paint), colour, paint)
    key = eye.back * 0.55 - eye.right * 0.45 + eye.up * 0.65
    fill = eye.back * 0.6 + eye.right * 0.7 + eye.up * 0.1
    key, fill = key / np.linalg.norm(key), fill / np.linalg.norm(fill)
    facing = np.where((stage.normals @ eye.back) < 0, -1.0, 1.0)
    keyed = np.maximum(stage.normals @ key * facing, 0.0)
    filled = np.maximum(stage.normals @ fill * facing, 0.0)
    level = (AMBIENT + FILL * filled[triangle]).astype(np.float32)
    lit = KEY * keyed[triangle]
    lit[_shadowed(stage, sight, key, keyed)] *= 1 - SHADE
    level += lit
    glowing = np.array([body.glows for body in stage.bodies])
    level[glowing[stage.body_of_triangle[triangle]]] = 1.0
    level = 1 - relief * (1 - level)
    level[_edges(stage, sight)] *= INK_SHARE
    image: Floats = np.minimum(colour * level[..., None], 255.0).astype(np.float32)
    image[~seen] = PAPER
    return image


def _shadowed(stage: Stage, sight: Sight, key: Array, keyed: Array) -> NDArray[np.bool_]:
    """Return which rays meet what the key light does not reach."""
    shaded = np.zeros(sight.triangle.shape, dtype=bool)
    asked = (sight.triangle >= 0) & (keyed[sight.triangle] > 0.02)
    start = sight.points_mm[asked] + LIFT_MM * stage.normals[sight.triangle[asked]]
    start += 4 * LIFT_MM * key
    shaded[asked] = stage.caster.blocked(start, np.broadcast_to(key, start.shape))
    return shaded


def _edges(stage: Stage, sight: Sight) -> NDArray[np.bool_]:
    """Return where the picture steps from one body to another, or bends."""
    triangle = sight.triangle
    body = np.where(triangle >= 0, stage.body_of_triangle[triangle], -1)
    normals = stage.normals[triangle].astype(np.float32)
    ink = np.zeros(triangle.shape, dtype=bool)
    for axis in (0, 1):
        here, there = [slice(None)] * 2, [slice(None)] * 2
        here[axis], there[axis] = slice(None, -1), slice(1, None)
        a, b = tuple(here), tuple(there)
        bend = (normals[a] * normals[b]).sum(axis=-1) < CREASE
        ink[a] |= (body[a] != body[b]) | (bend & (triangle[a] >= 0) & (triangle[b] >= 0))
    return ink


def smaller(image: Floats) -> Floats:
    """Return a picture at the size it is shown."""
    height, width = image.shape[:2]
    size = (width // FINER, height // FINER)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def data_uri(image: Floats) -> str:
    """Return a picture (height, width, 3), red first, as a data URI (PNG)."""
    levels = np.clip(np.round(image / COLOURS_STEP) * COLOURS_STEP, 0, 255).astype(np.uint8)
    _, data = cv2.imencode(".png", levels[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(data.tobytes()).decode("ascii")
