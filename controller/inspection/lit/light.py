"""Bounds on the brightness of a posed part under a lamp, not a rendered picture.

The place of the part is known to a fraction of a millimetre, and the place of the lamp roughly. The
size of the lamp, the spread of its light, the reflectance of the finish and the light between
surfaces are unknown. Each pixel therefore has the least and the most light consistent with the
known data, the angle at which a highlight would fall, and a bound on bounced light.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, inner, lengths
from controller.imaging import Camera, PointLamp, RayCaster, inverse_pose, transform

from .._scene import SHADOW_OFFSET_MM, lamp_points, lamp_reaches
from .bounce import Bounced, Neighbours, bounced_light
from .finish import HIGHLIGHT_WIDTHS_RAD
from .surface import Surface

COSINE_PLAY: Final = 0.02  # error of a cosine, for pose and surface turned by a degree
BLUR_NODES: Final = 3  # window of nodes within which a shadow's border may lie elsewhere


@dataclass(frozen=True, eq=False, slots=True)
class Light:
    """Light of one lamp on a `Surface`, in units of a matt surface square to it; (h, w) each.

    Attributes
    ----------
    least, most : bounds without highlight and bounce
    open : light without shadows
    bounced : additional light from bounces
    glints : bounds on the highlight, by its width (`HIGHLIGHT_WIDTHS_RAD`)
    touched : mask of nodes where the gripper blocks light
    partly : mask of nodes from which a portion of the lamp may be hidden
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
    """Return the bounds on a lamp's light on a surface.

    Parameters
    ----------
    surface : visible surface of the part on a grid of pixels
    caster : ray casting against the part's mesh, CAD frame
    T_world_part : (4, 4) pose of the part
    camera : camera of the picture
    lamp : the lamp, world
    others : other bodies that cast shadows, world (the gripper that holds the part)
    about : surroundings of the surface
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
    # For the nodes that see the part, in order.
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
        # A coarse facet may face away from the lamp where the true surface does not.
        free &= inner(unit, surface.facets) > -COSINE_PLAY
        if others is not None:
            # Objects behind the lamp block none of its light.
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
    centre = sources.mean(axis=0)

    def is_reached(points: FloatArray, normals: FloatArray) -> BoolArray:
        off = points + SHADOW_OFFSET_MM * normals
        return lamp_reaches(caster, T_world_part, others, off, centre - points, normals)

    # The distribution of light over a ring is unknown: a visible portion may have all of it.
    partly = (reached > 0.01) & (reached < 0.99)
    most = np.where(partly[seen], np.maximum(most, bare), most)
    return Light(
        spread(least), spread(most), spread(bare),
        bounced_light(about, centre, reference, is_reached),
        tuple((spread(a), spread(b)) for a, b in zip(dims, brights, strict=True)), shaded, partly,
    )  # fmt: skip


def _as_float32(values: FloatArray) -> Float32Array:
    return values.astype(np.float32)
