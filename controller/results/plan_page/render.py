"""Renders bodies of triangles by casting rays: shaded, with shadows and ink lines."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array, IntArray

from ..ray_drawing import FINER, as_uri, cast, jumps, png_bytes
from .bodies import SceneMesh
from .views import Eye

PAPER = (250.0, 250.0, 249.0)
# Edges are drawn with this share of the surface's brightness.
INK_SHARE = 0.38
AMBIENT, KEY, FILL = 0.46, 0.50, 0.16
# A shadow takes away this share of the key light.
SHADE = 0.62
CREASE = float(np.cos(np.radians(24.0)))
# Rays to the light start this far off a surface, so that it does not shadow itself.
LIFT_MM = 0.05
# Levels are rounded to multiples of this: invisible, and the file is smaller.
COLOURS_STEP = 3


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """The hits of a picture's rays.

    Attributes
    ----------
    triangle : (height, width) int, -1 where nothing is
    points_mm : (height, width, 3) in the world
    """

    triangle: Int32Array
    points_mm: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Paint:
    """Colours of the part in place of its own.

    Attributes
    ----------
    sample : (height, width) int, which colour a ray meets, -1 for none
    colours : (n, 3)
    """

    sample: IntArray
    colours: Float32Array


def look(stage: SceneMesh, eye: Eye) -> RayHits:
    """Return the hits of a picture's rays."""
    triangle, distance = cast(stage.caster, eye.origins_mm, eye.directions, eye.size)
    reach = np.where(triangle >= 0, distance, 0.0).reshape(-1, 1)
    points = eye.origins_mm + reach * eye.directions
    return RayHits(triangle, points.reshape(*triangle.shape, 3))


def shade(
    stage: SceneMesh, eye: Eye, hits: RayHits, paint: Paint | None = None, relief: float = 1.0
) -> Float32Array:
    """Return the shaded picture of the hits, (height, width, 3) 0..255.

    Parameters
    ----------
    stage : the cell at the moment of the picture
    eye : its rays
    hits : hits of the rays
    paint : colours in place of the part's own; None for none
    relief : strength of light and shadow, from 0
    """
    triangle = hits.triangle
    key = eye.back * 0.55 - eye.right * 0.45 + eye.up * 0.65
    fill = eye.back * 0.6 + eye.right * 0.7 + eye.up * 0.1
    key, fill = key / np.linalg.norm(key), fill / np.linalg.norm(fill)
    facing = np.where((stage.normals @ eye.back) < 0, -1.0, 1.0)
    keyed = KEY * np.maximum(stage.normals @ key * facing, 0.0)
    level = AMBIENT + FILL * np.maximum(stage.normals @ fill * facing, 0.0) + keyed
    shaded = level - SHADE * keyed
    glows = np.array([body.glows for body in stage.bodies])[stage.body_of_triangle]
    level[glows] = shaded[glows] = 1.0
    dark = _shadowed(stage, hits, key, (keyed > 0.01) & ~glows)
    bright = np.where(dark, shaded[triangle], level[triangle]).astype(np.float32)
    bright = 1 - relief * (1 - bright)
    bright[_edges(stage, hits)] *= INK_SHARE
    bodies = np.array([body.colour for body in stage.bodies], dtype=np.float32)
    image: Float32Array = bodies[stage.body_of_triangle][triangle]
    if paint is not None:
        here = paint.sample >= 0
        image[here] = paint.colours[paint.sample[here]]
    image *= bright[..., None]
    np.minimum(image, 255.0, out=image)
    image[triangle < 0] = PAPER
    return image


def _shadowed(stage: SceneMesh, hits: RayHits, key: FloatArray, is_turned: BoolArray) -> BoolArray:
    """Return a mask of the rays that meet a point in shadow of the key light; found once per pixel.

    Parameters
    ----------
    is_turned : (t,) triangles that look towards the light
    """
    height, width = hits.triangle.shape
    coarse = hits.triangle[::FINER, ::FINER]
    shaded = np.zeros(coarse.shape, dtype=bool)
    asked = (coarse >= 0) & is_turned[coarse]
    start = hits.points_mm[::FINER, ::FINER][asked]
    start = start + LIFT_MM * stage.normals[coarse[asked]] + 4 * LIFT_MM * key
    shaded[asked] = stage.caster.blocked(start, key)
    return np.asarray(shaded.repeat(FINER, axis=0).repeat(FINER, axis=1)[:height, :width])


def _edges(stage: SceneMesh, hits: RayHits) -> BoolArray:
    """Return a mask of the pixels where one body borders another, or a surface bends."""
    triangle = hits.triangle
    ink = np.zeros(triangle.shape, dtype=bool)
    for here, there in jumps(triangle):
        a, b = triangle[here], triangle[there]
        step = (a < 0) != (b < 0)
        both = (a >= 0) & (b >= 0)
        bend = np.einsum("ij,ij->i", stage.normals[a], stage.normals[b]) < CREASE
        other = stage.body_of_triangle[a] != stage.body_of_triangle[b]
        step |= both & (bend | other)
        ink[here] |= step
    return ink


def png_of(image: Float32Array) -> bytes:
    """Return a picture (height, width, 3), red first, as a file (PNG)."""
    levels = np.clip(np.round(image / COLOURS_STEP) * COLOURS_STEP, 0, 255).astype(np.uint8)
    return png_bytes(levels[..., ::-1], compression=6)


def data_uri(image: Float32Array) -> str:
    """Return a picture (height, width, 3), red first, as a data URI (PNG)."""
    return as_uri(png_of(image))
