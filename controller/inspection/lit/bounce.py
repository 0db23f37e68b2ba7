"""Light that part and gripper reflect on each other, after one bounce.

Light from matt neighbours is predicted: each ray from a surface meets a neighbour, which the lamp
shines on or not. Its strength is the finish's, and is fitted to the picture. Light from polished
neighbours, and mirror images in a polished surface, have a bound, which depends on how bright and
wide the finish's highlights are (ADR 122).
"""

from collections.abc import Callable, Sequence
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
from .finish import ALBEDO, HIGHLIGHT_WIDTHS_RAD, LOBE_SR, Finish
from .surface import Surface

BOUNCE_STEP: Final = 4  # step in nodes, since bounced light is smooth
BOUNCE_RAYS: Final = 40
# Least width of a neighbour's highlight, twice the spacing of rays: a narrower one counts as that
# wide, and less bright by as much.
LOBE_RAD: Final = 0.2
UNEVEN_MM: Final = 2.0  # distance from which light changes by half within a defect's width
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
class Mirrored:
    """Light that mirrors leave at the coarse nodes (n,), before a finish is known.

    For each width of highlights (`HIGHLIGHT_WIDTHS_RAD`), of peak 1.

    Attributes
    ----------
    thrown : (k, n) from neighbours that mirror the lamp, on a matt surface
    thrown_uneven : (k, n) the portion of it that may change within a defect's width
    matt : (n,) of lit neighbours in a mirror, or how uneven it is there
    glints, glints_uneven : (k, n) highlights on neighbours in a mirror, likewise
    kept : (k, n) share of an image that may change within a defect's width
    """

    thrown: FloatArray
    thrown_uneven: FloatArray
    matt: FloatArray
    glints: FloatArray
    glints_uneven: FloatArray
    kept: FloatArray

    def most(self, finish: Finish) -> tuple[FloatArray, FloatArray]:
        """Return upper bounds (n,) on the light that a finish mirrors, and on what is uneven."""
        glints, uneven = (finish.brightest(lobes) for lobes in (self.glints, self.glints_uneven))
        lobes = LOBE_SR[:, None]
        return (
            np.maximum(
                finish.albedo * finish.brightest(self.thrown),
                finish.albedo * finish.brightest(lobes * (self.matt + glints)),
            ),
            np.maximum(
                finish.albedo * finish.brightest(self.thrown_uneven),
                finish.albedo * finish.brightest(lobes * self.kept * (self.matt + uneven)),
            ),
        )


@dataclass(frozen=True, eq=False, slots=True)
class Bounced:
    """Light bounced once, (h, w), in units of a matt surface square to the lamp.

    Attributes
    ----------
    matt : light from matt neighbours of the albedo `ALBEDO`, predicted
    most : its maximum about each node, on its own face
    mirrored : light from a neighbour that mirrors the lamp, or by a surface that mirrors its
        neighbours, of which a finish has a share
    about : surroundings of the surface
    """

    matt: Float32Array
    most: Float32Array
    mirrored: Mirrored
    about: Neighbours

    def most_mirrored(self, finish: Finish) -> tuple[Float32Array, Float32Array]:
        """Return upper bounds (h, w) on the light that a finish mirrors, and on what is uneven."""
        coarse = self.about.coarse
        both = []
        for most in self.mirrored.most(finish):
            out = np.zeros(coarse.shape, dtype=np.float32)
            out[coarse] = most
            both.append(_between(out, self.about.face))
        return both[0], both[1]


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
    count, widths = len(about.points), len(HIGHLIGHT_WIDTHS_RAD)
    matt_light = np.zeros(count)
    thrown, uneven = np.zeros((2, widths, count))
    reached = _reached(about.around, is_reached)
    for met, lit in zip(about.around, reached, strict=True):
        matt, glossy = _thrown(met, about.points, source, reference)
        matt_light[met.hit] += ALBEDO * matt * lit / BOUNCE_RAYS
        glossy /= BOUNCE_RAYS
        thrown[:, met.hit] += glossy
        uneven[:, met.hit] += _unevenness(met.distance_mm) * glossy
    mirrored = Mirrored(thrown, uneven, *_images(about, source, reference))
    out = np.zeros(about.coarse.shape, dtype=np.float32)
    out[about.coarse] = matt_light
    return Bounced(_between(out, about.face), _most_about(out, about.face), mirrored, about)


def _images(
    about: Neighbours, source: FloatArray, reference: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return what mirrors show of neighbours, as `Mirrored` has it from `matt` on."""
    count, widths = len(about.points), len(HIGHLIGHT_WIDTHS_RAD)
    lights = np.zeros((len(about.mirrored), 1 + widths, count))
    facing = np.zeros((len(about.mirrored), count, 3))
    nearest_mm = np.full(count, np.inf)
    for met, light, normal in zip(about.mirrored, lights, facing, strict=True):
        matt, glossy = _thrown(met, about.points, source, reference)
        light[0, met.hit], light[1:, met.hit] = ALBEDO * matt, glossy
        normal[met.hit] = met.normals
        nearest_mm[met.hit] = np.minimum(nearest_mm[met.hit], met.distance_mm)
    if not count:
        return np.zeros(0), lights.sum(axis=0)[1:], lights.sum(axis=0)[1:], np.zeros((widths, 0))
    # A mirrored plane is as even as the light on it; other surfaces have borders or glints.
    same = np.linalg.norm(facing.mean(axis=0), axis=1) > EVEN_NORMALS
    most = lights.max(axis=0)
    range_ = np.where(same, most - lights.min(axis=0), most)
    return range_[0], most[1:], range_[1:], _unevenness(nearest_mm)


def _reached(
    every: Sequence[Met], is_reached: Callable[[FloatArray, FloatArray], BoolArray]
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
    """Return the share (k, n) of mirrored light from afar that may change within a defect.

    A surface spreads a ray by twice the tilt of its facets, so by twice a highlight's width.
    """
    spread = 2.0 * np.array(HIGHLIGHT_WIDTHS_RAD)[:, None]
    return np.asarray(1.0 / (1.0 + (spread * distance_mm / UNEVEN_MM) ** 2))


def _thrown(
    met: Met, to: FloatArray, source: FloatArray, reference: float
) -> tuple[FloatArray, FloatArray]:
    """Return the light that the surfaces hit by rays (n,) reflect: matt (n,), highlights (k, n)."""
    towards = source - met.points
    distance = lengths(towards)
    towards /= distance[:, None]
    fall = (reference / distance) ** 2
    cosine = inner(towards, met.normals)
    half = towards + (to[met.hit] - met.points) / met.distance_mm[:, None]
    half /= np.maximum(lengths(half), 1e-9)[:, None]
    angle = np.arccos(np.clip(inner(half, met.normals), -1.0, 1.0))
    shines = fall * (cosine > 0)
    wide = np.maximum(HIGHLIGHT_WIDTHS_RAD, LOBE_RAD)
    bells = {width: np.exp(-0.5 * (angle / width) ** 2) * shines for width in set(wide.tolist())}
    lobes = [
        (width / as_wide) ** 2 * bells[as_wide]
        for width, as_wide in zip(HIGHLIGHT_WIDTHS_RAD, wide.tolist(), strict=True)
    ]
    return np.maximum(cosine, 0.0) * fall, np.stack(lobes)


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
