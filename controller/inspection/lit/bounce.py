"""Light that part and gripper reflect on each other, after one bounce.

Light from matt neighbours is predicted: each ray from a surface meets a neighbour, which the lamp
shines on or not. Its strength is the finish's, and is fitted to the picture (ADR 122). Light from
polished neighbours, and mirror images in a polished surface, have a bound (ADR 30).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import (
    BoolArray,
    Float32Array,
    FloatArray,
    Int32Array,
    IntArray,
    inner,
    lengths,
)
from controller.imaging import Camera, RayCaster, inverse_pose, transform

from .._scene import SHADOW_OFFSET_MM
from .surface import Surface

ALBEDO: Final = 0.8  # largest albedo of a machined surface
BOUNCE_STEP: Final = 4  # step in nodes, since bounced light is smooth
BOUNCE_RAYS: Final = 40
LOBE_RAD: Final = 0.2  # width of a polished neighbour's highlight, twice the spacing of rays
POLISH: Final = 3.0  # peak brightness of a narrower highlight, as a factor
UNEVEN_MM: Final = 2.0  # distance from which light changes by half within a defect's width
# Spread of a ray by a polished surface, twice the tilt of its facets: twice the narrowest of
# `HIGHLIGHT_WIDTHS_RAD`.
POLISHED_SPREAD_RAD: Final = 0.17
# Directions about the mirror direction that a polished surface shows, within its lobe.
MIRROR_SPREAD: Final = ((0.0, 0.0), (0.15, 0.0), (-0.15, 0.0), (0.0, 0.15), (0.0, -0.15))
EVEN_NORMALS: Final = 0.999  # length of the mean of unit normals that differ by a few degrees


@dataclass(frozen=True, eq=False, slots=True)
class Met:
    """Hits of one ray from each node of a set.

    Attributes
    ----------
    hit : (k,) mask of the nodes whose rays hit anything
    points, normals : (k, 3) points hit and normals there, world
    distance_mm : (k,) lengths of the rays
    """

    hit: IntArray
    points: FloatArray
    normals: FloatArray
    distance_mm: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Neighbours:
    """Surroundings of a surface, for any lamp.

    Attributes
    ----------
    coarse : (h, w) mask of every fourth node that sees the part
    face : (h, w) faces of all nodes
    points : (n, 3) points of the seen coarse nodes, world
    around : hits of rays over the hemisphere, by cosine
    mirrored : hits of rays about the mirror direction, visible in a polished surface
    """

    coarse: BoolArray
    face: Int32Array
    points: FloatArray
    around: tuple[Met, ...]
    mirrored: tuple[Met, ...]


def find_neighbours(
    surface: Surface,
    caster: RayCaster,
    T_world_part: FloatArray,
    camera: Camera,
    others: RayCaster | None,
) -> Neighbours:
    """Return the surfaces of part and gripper that reflect light onto a surface.

    Parameters
    ----------
    surface : visible surface of the part on a grid of pixels
    caster : ray casting against the part's mesh, CAD frame
    T_world_part : (4, 4) pose of the part
    camera : camera of the picture
    others : other reflecting bodies, world (the gripper)
    """
    number = np.full(surface.seen.shape, -1, dtype=np.int64)
    number[surface.seen] = np.arange(len(surface.points))
    coarse = number[::BOUNCE_STEP, ::BOUNCE_STEP]
    rows = coarse[coarse >= 0]
    normals = surface.normals[rows]
    start = surface.points[rows] + SHADOW_OFFSET_MM * surface.facets[rows]
    helper = np.where(np.abs(normals[:, :1]) < 0.6, [[1.0, 0, 0]], [[0, 1.0, 0]])
    e1 = np.cross(normals, helper)
    e1 /= lengths(e1)[:, None]
    e2 = np.cross(normals, e1)
    back, start_part = T_world_part[:3, :3], transform(inverse_pose(T_world_part), start)

    def meet(direction: FloatArray) -> Met:
        triangle, distance = caster.first_hit(start_part, direction @ back)
        normal = caster.normals[triangle] @ back.T
        if others is not None:
            struck, reach = others.first_hit(start, direction)
            near = (struck >= 0) & (reach < distance)
            normal[near] = others.normals[struck[near]]
            distance = np.where(near, reach, distance)
        hit = np.flatnonzero(np.isfinite(distance))
        at = start[hit] + distance[hit, None] * direction[hit]
        return Met(hit, at, normal[hit], distance[hit])

    around = []
    for i in range(BOUNCE_RAYS if len(rows) else 0):
        radius = np.sqrt((i + 0.5) / BOUNCE_RAYS)
        phi = i * 2.399963
        direction = radius * (np.cos(phi) * e1 + np.sin(phi) * e2)
        around.append(meet(direction + np.sqrt(1 - radius**2) * normals))
    to_camera = camera.position_mm - start
    to_camera /= lengths(to_camera)[:, None]
    mirror = 2 * inner(normals, to_camera)[:, None] * normals - to_camera
    mirrored = []
    for a, b in MIRROR_SPREAD if len(rows) else ():
        direction = mirror + a * e1 + b * e2
        mirrored.append(meet(direction / lengths(direction)[:, None]))
    return Neighbours(coarse >= 0, surface.face, start, tuple(around), tuple(mirrored))


@dataclass(frozen=True, eq=False, slots=True)
class Bounced:
    """Light bounced once, (h, w), in units of a matt surface square to the lamp.

    Attributes
    ----------
    matt : light from matt neighbours of the albedo `ALBEDO`, predicted
    most : its maximum about each node, on its own face
    mirrored : upper bound on light from a polished neighbour that mirrors the lamp, or by a
        polished surface that mirrors its neighbours
    mirrored_uneven : the portion of it that may change within a defect's width
    """

    matt: Float32Array
    most: Float32Array
    mirrored: Float32Array
    mirrored_uneven: Float32Array


def bounced_light(
    about: Neighbours,
    source: FloatArray,
    reference: float,
    is_reached: Callable[[FloatArray, FloatArray], BoolArray],
) -> Bounced:
    """Return the light reflected between part and gripper, after one bounce.

    Parameters
    ----------
    about : surroundings of the surface
    source : (3,) centre of the lamp, world
    reference : distance [mm] at which the lamp's light counts as 1
    is_reached : mask (k,) of the points with some normals (k, 3), world, that the lamp reaches
    """
    count = len(about.points)
    total = np.zeros((3, count))
    every = [
        (met, *_thrown(met, about.points, source, reference), _unevenness(met.distance_mm))
        for met in about.around
    ]
    reached = _reached([met for met, *_ in every], is_reached)
    for (met, matt, glossy, sharp), lit in zip(every, reached, strict=True):
        thrown = np.stack([ALBEDO * matt * lit, glossy, sharp * glossy])
        total[:, met.hit] += thrown / BOUNCE_RAYS
    lights, facing = (np.zeros((len(about.mirrored), count, k)) for k in (1, 3))
    nearest_mm = np.full(count, np.inf)
    for met, light, normal in zip(about.mirrored, lights, facing, strict=True):
        matt, _ = _thrown(met, about.points, source, reference)
        light[met.hit, 0], normal[met.hit] = ALBEDO * matt, met.normals
        nearest_mm[met.hit] = np.minimum(nearest_mm[met.hit], met.distance_mm)
    if count:
        # A mirrored plane is as even as the light on it; other surfaces have borders or glints.
        same = np.linalg.norm(facing.mean(axis=0), axis=1) > EVEN_NORMALS
        most, least = lights.max(axis=0)[:, 0], lights.min(axis=0)[:, 0]
        image = np.where(same, most - least, most)
        total[1:] = np.maximum(total[1:], np.stack([image, _unevenness(nearest_mm) * image]))
    out = np.zeros((3, *about.coarse.shape), dtype=np.float32)
    out[:, about.coarse] = total
    matt, *others = out
    return Bounced(
        _between(matt, about.face),
        _most_about(matt, about.face),
        *(_between(one, about.face) for one in others),
    )


def _reached(
    every: list[Met], is_reached: Callable[[FloatArray, FloatArray], BoolArray]
) -> list[BoolArray]:
    """Return a mask of the points met that the lamp reaches, for each set of rays."""
    if not every:
        return []
    ends = np.cumsum([len(met.hit) for met in every])[:-1]
    points, normals = (
        np.concatenate([getattr(met, name) for met in every]) for name in ("points", "normals")
    )
    return np.split(is_reached(points, normals), ends)


def _unevenness(distance_mm: FloatArray) -> FloatArray:
    """Return the share (k,) of mirrored light from afar that may change within a defect."""
    return 1.0 / (1.0 + (POLISHED_SPREAD_RAD * distance_mm / UNEVEN_MM) ** 2)


def _thrown(
    met: Met, to: FloatArray, source: FloatArray, reference: float
) -> tuple[FloatArray, FloatArray]:
    """Return the light (k,) reflected by the surfaces hit by rays, if matt and if polished."""
    towards = source - met.points
    distance = lengths(towards)
    towards /= distance[:, None]
    fall = (reference / distance) ** 2
    cosine = inner(towards, met.normals)
    half = towards + (to[met.hit] - met.points) / met.distance_mm[:, None]
    half /= np.maximum(lengths(half), 1e-9)[:, None]
    angle = np.arccos(np.clip(inner(half, met.normals), -1.0, 1.0))
    lobe = np.exp(-0.5 * (angle / LOBE_RAD) ** 2) / (8 * LOBE_RAD**2)
    return np.maximum(cosine, 0.0) * fall, POLISH * lobe * fall * (cosine > 0)


def _most_about(coarse: Float32Array, face: Int32Array) -> Float32Array:
    """Return the maximum of coarse nodes' light about each node (h, w), on its own face.

    A wall hit by no ray may still lie between two rays, and between two nodes. Light on the wall of
    a hole does not fall on the face around it. A face too small for a node of its own takes the
    light nearby.
    """
    coarse_face = face[::BOUNCE_STEP, ::BOUNCE_STEP]
    own = np.full(face.shape, -1.0, dtype=np.float32)
    padded = np.pad(coarse, 1), np.pad(coarse_face, 1, constant_values=-1)
    rows, columns = (np.arange(n) // BOUNCE_STEP for n in face.shape)
    for dy in range(3):
        for dx in range(3):
            value, of = (a[dy:, dx:][rows[:, None], columns] for a in padded)
            np.maximum(own, value, out=own, where=of == face)
    wide = cv2.dilate(coarse, np.ones((3, 3), np.uint8))[rows[:, None], columns]
    return np.where(face < 0, 0.0, np.where(own < 0, wide, own)).astype(np.float32)


def _between(coarse: Float32Array, face: Int32Array) -> Float32Array:
    """Return light interpolated between coarse nodes (h, w), within each face.

    Where none of the four nodes around lies on the same face, the maximum nearby is used.
    """
    coarse_face = face[::BOUNCE_STEP, ::BOUNCE_STEP]
    padded = np.pad(coarse, (0, 1)), np.pad(coarse_face, (0, 1), constant_values=-1)
    (rows, v), (columns, u) = (np.divmod(np.arange(n), BOUNCE_STEP) for n in face.shape)
    top, weight = (np.zeros(face.shape, dtype=np.float32) for _ in range(2))
    for dy, across in enumerate((1 - v / BOUNCE_STEP, v / BOUNCE_STEP)):
        for dx, along in enumerate((1 - u / BOUNCE_STEP, u / BOUNCE_STEP)):
            value, of = (a[dy:, dx:][rows[:, None], columns] for a in padded)
            share = np.where(of == face, across[:, None] * along, 0.0).astype(np.float32)
            top += share * value
            weight += share
    inside = top / np.maximum(weight, 1e-6)
    return np.where(weight > 0, inside, _most_about(coarse, face)).astype(np.float32)
