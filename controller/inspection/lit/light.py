"""How bright a posed part may look under a lamp: bounds, not a picture.

What is known: where the part is, to a fraction of a millimetre, and about where the lamp's light
comes from. What is not: how large the lamp is, how its light spreads, how the finish throws it
back, what light goes from surface to surface. So each pixel gets the least and the most light that
fit what is known, the angle at which a highlight would fall, and a bound for bounced light.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array
from controller.cad import Solid, surface_normals
from controller.imaging import Camera, PointLamp, RayCaster, ViewMaps, inverse_pose, transform

SHADOW_OFFSET_MM: Final = 0.05  # off the surface, or it would shadow itself
SPOT_RADIUS_MM: Final = 25.0  # a lamp given as one point is taken to be as large as this
RING_SPREAD: Final = 0.12  # a ring's light comes from radii that differ by this share
BLUR_NODES: Final = 3  # window of nodes within which a shadow's border may lie elsewhere
COSINE_PLAY: Final = 0.02  # the pose, and a surface, may be turned by a degree
ALBEDO: Final = 0.8  # nothing machined throws back more
HIGHLIGHT_WIDTHS_RAD: Final = tuple(float(np.radians(d)) for d in (5.0, 9.0, 13.0, 18.0))
BOUNCE_STEP: Final = 4  # bounced light is smooth: every fourth node
BOUNCE_RAYS: Final = 20


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """What the sight lines of a grid of pixels meet; all arrays are of that grid.

    Attributes
    ----------
    seen : (h, w) the part is met
    points, normals : (n, 3) world, of the seen pixels in order; normals of the recognised surface
    face : (h, w) face met, -1 where none
    cosine : (h, w) of the angle at which the surface is seen, 0 where the part is not
    area_mm2 : (h, w) of surface in a pixel of the full picture
    depth_mm : (h, w) along the camera's axis, 0 where the part is not
    node_mm : (h, w) side of a node square to the line of sight
    """

    seen: BoolArray
    points: FloatArray
    normals: FloatArray
    facets: FloatArray
    face: Int32Array
    cosine: Float32Array
    area_mm2: Float32Array
    depth_mm: Float32Array
    node_mm: Float32Array


@dataclass(frozen=True, eq=False, slots=True)
class Light:
    """Light of one lamp on a `Surface`, in units of a matt surface square to it; (h, w) each.

    Attributes
    ----------
    least, most : without highlight and bounce
    open : as if nothing threw a shadow
    bounce : at most, from part and gripper, on top
    glints : by width of the highlight (`HIGHLIGHT_WIDTHS_RAD`), its least and its most
    touched : the gripper keeps light away
    partly : part of the lamp may be hidden
    """

    least: Float32Array
    most: Float32Array
    open: Float32Array
    bounce: Float32Array
    glints: tuple[tuple[Float32Array, Float32Array], ...]
    touched: BoolArray
    partly: BoolArray


def find_surface(
    solid: Solid, maps: ViewMaps, T_world_part: FloatArray, camera: Camera, step_px: int
) -> Surface:
    """Return what a grid of pixels sees of a posed part.

    Parameters
    ----------
    solid : the part
    maps : its `ViewMaps`, of every ``step_px``-th pixel of their region
    T_world_part : (4, 4) [mm], as the maps were made with
    camera : likewise
    step_px : distance of the grid's pixels
    """
    seen = maps.mask
    x0, y0, x1, y1 = maps.roi
    lines = camera.sight_line_table[y0:y1:step_px, x0:x1:step_px][seen].astype(np.float64)
    points = camera.position_mm + lines * maps.depth_mm[seen][:, None]
    triangle = maps.triangle[seen]
    faces = solid.face_of_triangle[triangle]
    facets = np.asarray(solid.mesh.face_normals)[triangle]
    T_part_world = inverse_pose(T_world_part)
    smooth = surface_normals(solid.faces, faces, transform(T_part_world, points), facets)
    R = T_world_part[:3, :3].T
    normals = smooth @ R
    cosine = -(normals * lines).sum(axis=1) / np.linalg.norm(lines, axis=1)
    side_mm = maps.depth_mm[seen] / float(camera.K[0, 0])

    def spread(values: FloatArray) -> Float32Array:
        out = np.zeros(seen.shape, dtype=np.float32)
        out[seen] = values
        return out

    face = np.full(seen.shape, -1, dtype=np.int32)
    face[seen] = faces
    return Surface(
        seen=seen,
        points=points,
        normals=normals,
        facets=facets @ R,
        face=face,
        cosine=spread(np.clip(cosine, 0.0, 1.0)),
        area_mm2=spread(side_mm**2 / np.maximum(cosine, 0.2)),
        depth_mm=spread(maps.depth_mm[seen]),
        node_mm=spread(step_px * side_mm),
    )


def lamp_points(lamp: PointLamp) -> FloatArray:
    """Return points that stand for a lamp of unknown extent, (n, 3) [mm]."""
    points = lamp.points_mm
    if len(points) == 1:
        reach = SPOT_RADIUS_MM * np.vstack([np.eye(3), -np.eye(3)])
        return np.vstack([points, points + reach])
    middle = points.mean(axis=0)
    scale = np.where(np.arange(len(points)) % 2, 1 + RING_SPREAD, 1 - RING_SPREAD)
    return np.asarray(middle + (points - middle) * scale[:, None])


def bound_light(
    surface: Surface,
    caster: RayCaster,
    T_world_part: FloatArray,
    camera: Camera,
    lamp: PointLamp,
    others: RayCaster | None,
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
    to_camera /= np.linalg.norm(to_camera, axis=1)[:, None]
    least, most, bare, reached = (np.zeros(shape, dtype=np.float32) for _ in range(4))
    glints = [
        (np.zeros(shape, np.float32), np.zeros(shape, np.float32)) for _ in HIGHLIGHT_WIDTHS_RAD
    ]
    touched = np.zeros(len(points), dtype=bool)
    kernel = np.ones((BLUR_NODES, BLUR_NODES), np.uint8)
    share = np.float32(1.0 / len(sources))
    for position in sources:
        towards = position - start
        distance = np.linalg.norm(towards, axis=1)
        unit = towards / distance[:, None]
        cosine = (unit * normals).sum(axis=1)
        lit = np.flatnonzero(cosine > -COSINE_PLAY)
        free = np.zeros(len(points), dtype=bool)
        free[lit] = ~caster.blocked(start_part[lit], unit[lit] @ T_world_part[:3, :3])
        # a coarse facet may turn from the lamp where the surface it stands for does not
        free &= (unit * surface.facets).sum(axis=1) > -COSINE_PLAY
        if others is not None:
            # what stands behind the lamp takes none of its light
            touched[lit] |= others.blocked(start[lit], unit[lit], distance[lit])
        fall = (reference / distance) ** 2
        high, low, plain, reach, sure = (np.zeros(shape, dtype=np.float32) for _ in range(5))
        high[seen] = fall * np.clip(cosine + COSINE_PLAY, 0.0, None)
        low[seen] = fall * np.clip(cosine - COSINE_PLAY, 0.0, None)
        plain[seen] = fall * np.clip(cosine, 0.0, None)
        reach[seen], sure[seen] = free, free
        reach = np.asarray(cv2.dilate(reach, kernel), np.float32)
        sure[~seen] = 1.0
        sure = np.asarray(cv2.erode(sure, kernel), np.float32)
        most += share * high * reach
        least += share * low * sure
        bare += share * plain
        reached += share * reach
        half = unit + to_camera
        half /= np.maximum(np.linalg.norm(half, axis=1), 1e-9)[:, None]
        angle = np.arccos(np.clip((half * normals).sum(axis=1), -1.0, 1.0))
        for width, (dim, bright) in zip(HIGHLIGHT_WIDTHS_RAD, glints, strict=True):
            lobe = np.zeros(shape, dtype=np.float32)
            lobe[seen] = fall * np.exp(-0.5 * (angle / width) ** 2) * (cosine > 0)
            dim += share * lobe * sure
            bright += share * lobe * reach
    # how the light is spread over a ring is not known: where part of it shines all of it may
    partly = (reached > 0.01) & (reached < 0.99)
    most = np.where(partly, np.maximum(most, bare), most)
    shaded = np.zeros(shape, dtype=bool)
    shaded[seen] = touched
    bounce = _bounce(surface, caster, T_world_part, sources.mean(axis=0), reference, others)
    return Light(least, most, bare, bounce, tuple(glints), shaded, partly)


def _bounce(
    surface: Surface,
    caster: RayCaster,
    T_world_part: FloatArray,
    source: FloatArray,
    reference: float,
    others: RayCaster | None,
) -> Float32Array:
    """Return an upper bound of the light that part and gripper throw on each other, once.

    Rays over the hemisphere, by cosine: what one of them meets is taken to lie in the open before
    the lamp, and to throw back `ALBEDO` of what falls there.
    """
    seen = surface.seen
    number = np.full(seen.shape, -1, dtype=np.int64)
    number[seen] = np.arange(len(surface.points))
    coarse = number[::BOUNCE_STEP, ::BOUNCE_STEP]
    rows = coarse[coarse >= 0]
    out = np.zeros(coarse.shape, dtype=np.float32)
    if len(rows):
        normals = surface.normals[rows]
        start = surface.points[rows] + SHADOW_OFFSET_MM * surface.facets[rows]
        helper = np.where(np.abs(normals[:, :1]) < 0.6, [[1.0, 0, 0]], [[0, 1.0, 0]])
        e1 = np.cross(normals, helper)
        e1 /= np.linalg.norm(e1, axis=1)[:, None]
        e2 = np.cross(normals, e1)
        T_part_world = inverse_pose(T_world_part)
        back, start_part = T_world_part[:3, :3], transform(T_part_world, start)
        total = np.zeros(len(rows))
        for i in range(BOUNCE_RAYS):
            radius = np.sqrt((i + 0.5) / BOUNCE_RAYS)
            phi = i * 2.399963
            direction = radius * (np.cos(phi) * e1 + np.sin(phi) * e2)
            direction += np.sqrt(1 - radius**2) * normals
            met, distance = caster.first_hit(start_part, direction @ back)
            hit = np.flatnonzero(met >= 0)
            if len(hit):
                at = start[hit] + distance[hit, None] * direction[hit]
                total[hit] += _light_at(at, caster, met[hit], back, source, reference)
            if others is not None:
                struck, reach = others.first_hit(start, direction)
                near = np.flatnonzero((struck >= 0) & (reach < distance))
                at = start[near] + reach[near, None] * direction[near]
                total[near] += _light_at(at, others, struck[near], np.eye(3), source, reference)
        out[coarse >= 0] = ALBEDO * total / BOUNCE_RAYS
    # a wall met by no ray may still stand between two of them, and between two nodes
    wide = cv2.dilate(out, np.ones((3, 3), np.uint8))
    whole = cv2.resize(
        wide, (coarse.shape[1] * BOUNCE_STEP, coarse.shape[0] * BOUNCE_STEP),
        interpolation=cv2.INTER_NEAREST,
    )  # fmt: skip
    return np.asarray(whole[: seen.shape[0], : seen.shape[1]])


def _light_at(
    points: FloatArray,
    caster: RayCaster,
    triangle: Int32Array,
    R_world_part: FloatArray,
    source: FloatArray,
    reference: float,
) -> FloatArray:
    towards = source - points
    distance = np.linalg.norm(towards, axis=1)
    normals = caster.normals[triangle] @ R_world_part.T
    cosine = (towards * normals).sum(axis=1) / distance
    return np.asarray(np.clip(cosine + COSINE_PLAY, 0.0, 1.0) * (reference / distance) ** 2)
