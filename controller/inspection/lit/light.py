"""Bounds on the brightness of a posed part under a lamp: not a picture.

What is known: where the part is, to a fraction of a millimetre, and about where the lamp's light
comes from. What is not: how large the lamp is, how its light spreads, how the finish throws it
back, what light goes from surface to surface. So each pixel gets the least and the most light that
fit what is known, the angle at which a highlight would fall, and a bound for bounced light.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, inner, lengths
from controller.imaging import Camera, PointLamp, RayCaster, inverse_pose, transform

from .._scene import SHADOW_OFFSET_MM, lamp_points
from .bounce import COSINE_PLAY, Bounced, Neighbours, bounced_light
from .surface import Surface

BLUR_NODES: Final = 3  # window of nodes within which a shadow's border may lie elsewhere
HIGHLIGHT_WIDTHS_RAD: Final = tuple(float(np.radians(d)) for d in (5.0, 9.0, 13.0, 18.0))


@dataclass(frozen=True, eq=False, slots=True)
class Light:
    """Light of one lamp on a `Surface`, in units of a matt surface square to it; (h, w) each.

    Attributes
    ----------
    least, most : without highlight and bounce
    open : as if nothing threw a shadow
    bounced : at most, on top
    glints : by width of the highlight (`HIGHLIGHT_WIDTHS_RAD`), its least and its most
    touched : the gripper keeps light away
    partly : part of the lamp may be hidden
    """

    least: Float32Array
    most: Float32Array
    open: Float32Array
    bounced: Bounced
    glints: tuple[tuple[Float32Array, Float32Array], ...]
    touched: BoolArray
    partly: BoolArray


def bound_light(
    surface: Surface,
    caster: RayCaster,
    T_world_part: FloatArray,
    camera: Camera,
    lamp: PointLamp,
    others: RayCaster | None,
    about: Neighbours,
) -> Light:
    """Return the bounds of a lamp's light on a surface.

    Parameters
    ----------
    surface : what a grid of pixels sees of the part
    caster : of the part's mesh, in the CAD frame
    T_world_part : (4, 4) the pose it was seen in
    camera : that saw it
    lamp : in the world
    others : what else throws shadows, in the world (the gripper that holds the part)
    about : what stands about the surface
    """
    seen, points, normals = surface.seen, surface.points, surface.normals
    shape = seen.shape
    sources = lamp_points(lamp)
    T_part_world = inverse_pose(T_world_part)
    middle = T_world_part[:3, 3]
    reference = float(np.mean(np.linalg.norm(sources - middle, axis=1)))
    start = points + SHADOW_OFFSET_MM * surface.facets
    start_part = transform(T_part_world, start)
    to_camera = camera.position_mm - points
    to_camera /= lengths(to_camera)[:, None]
    # of the nodes that see the part, in order
    least, most, bare = (np.zeros(len(points), dtype=np.float32) for _ in range(3))
    dims, brights = (
        np.zeros((len(HIGHLIGHT_WIDTHS_RAD), len(points)), dtype=np.float32) for _ in range(2)
    )
    touched = np.zeros(len(points), dtype=bool)
    reached = np.zeros(shape, dtype=np.float32)
    kernel = np.ones((BLUR_NODES, BLUR_NODES), np.uint8)
    share = np.float32(1.0 / len(sources))
    for position in sources:
        towards = position - start
        distance = lengths(towards)
        unit = towards / distance[:, None]
        cosine = inner(unit, normals)
        lit = np.flatnonzero(cosine > -COSINE_PLAY)
        free = np.zeros(len(points), dtype=bool)
        free[lit] = ~caster.blocked(start_part[lit], unit[lit] @ T_world_part[:3, :3])
        # a coarse facet may turn from the lamp where the surface it stands for does not
        free &= inner(unit, surface.facets) > -COSINE_PLAY
        if others is not None:
            # what stands behind the lamp takes none of its light
            touched[lit] |= others.blocked(start[lit], unit[lit], distance[lit])
        fall = (reference / distance) ** 2
        wide, near = np.zeros(shape, dtype=np.uint8), np.ones(shape, dtype=np.uint8)
        wide[seen] = near[seen] = free
        around = np.asarray(cv2.dilate(wide, kernel), np.uint8)
        reached += share * around
        reach, sure = around[seen], np.asarray(cv2.erode(near, kernel), np.uint8)[seen]
        most += share * _as_float32(fall * np.clip(cosine + COSINE_PLAY, 0.0, None)) * reach
        least += share * _as_float32(fall * np.clip(cosine - COSINE_PLAY, 0.0, None)) * sure
        bare += share * _as_float32(fall * np.clip(cosine, 0.0, None))
        glossy = np.flatnonzero((cosine > 0) & (reach > 0))
        half = unit[glossy] + to_camera[glossy]
        half /= np.maximum(lengths(half), 1e-9)[:, None]
        angle = np.arccos(np.clip(inner(half, normals[glossy]), -1.0, 1.0))
        for width, dim, bright in zip(HIGHLIGHT_WIDTHS_RAD, dims, brights, strict=True):
            lobe = share * _as_float32(fall[glossy] * np.exp(-0.5 * (angle / width) ** 2))
            dim[glossy] += lobe * sure[glossy]
            bright[glossy] += lobe

    def spread(values: Float32Array) -> Float32Array:
        out = np.zeros(shape, dtype=np.float32)
        out[seen] = values
        return out

    shaded = np.zeros(shape, dtype=bool)
    shaded[seen] = touched

    # how the light is spread over a ring is not known: where part of it shines all of it may
    partly = (reached > 0.01) & (reached < 0.99)
    most = np.where(partly[seen], np.maximum(most, bare), most)
    return Light(
        spread(least), spread(most), spread(bare),
        bounced_light(about, sources.mean(axis=0), reference),
        tuple((spread(a), spread(b)) for a, b in zip(dims, brights, strict=True)), shaded, partly,
    )  # fmt: skip


def _as_float32(values: FloatArray) -> Float32Array:
    return values.astype(np.float32)
