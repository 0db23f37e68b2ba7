"""Rays across predicted edges of a part in a picture, with the surfaces on either side.

Before a backlight panel an edge is visible where the panel lies on one side of it and the part on
the other. For a hole seen obliquely, this is the near rim on one side and the far rim on the other.
Each ray is therefore compared with the edge that blocks the light there.

A wall at a grazing angle reflects the panel's light like a mirror. Where it is only a few pixels
wide in the picture, the visible edge may be either of its two ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray, Int32Array, inner, lengths
from controller.imaging import Camera, inverse_pose, transform

from .._pose import PosedPart
from .._scene import ViewScene
from ._curves import Curve

# Distances from an edge at which its sides are probed.
BESIDE_PX: Final = np.array([0.12, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0])
# Distances from an edge at which the next one is sought.
FARTHER_PX: Final = np.array([6.0, 8.0, 11.0, 14.0, 18.0, 24.0, 32.0])
CLOSE_PX: Final = 0.25  # distance from which one side must show only the panel
PLAIN_PX: Final = 1.0  # distance from which the other side must show only the part
NEAR_PX: Final = 3.0  # least distance of another edge under a lamp
FLAT_COS: Final = 0.5  # cosine of incidence below which a wall reflects the panel
FREE_PX: Final = 0.5  # distance outside the edge at which the line of sight must be free
# Distances from an edge at which the border of the light is sought; beyond them it belongs to
# another edge.
OUTSIDE_PX: Final = np.arange(1, 6) * 0.05
NONE: Final = -1


@dataclass(frozen=True, eq=False, slots=True)
class Rays:
    """Rays across the edges of a view.

    Attributes
    ----------
    curve : (n,) number of the curve
    points_mm : (n, 3) points of the edge, CAD frame
    pixels, normals : (n, 2) origins, and unit directions in which offsets are positive
    design : (n, p) derivatives of the edge's offset by the unknowns of its feature [px/mm]
    pose : (n, 6) derivatives by the part's position and rotation [px/mm, px/rad]
    spacing_px : (n,) distance to the next ray
    curvature : (n,) curvature of the edge in the picture [1/px], positive where it bends away from
        the normal
    rising : (n,) before the panel: 1 where it gets brighter along the ray, -1 where darker, 0 where
        the edge is not visible
    shows_lit : (n,) True where it may be visible under a lamp
    wall_px : (n,) width of a wall at a grazing angle on the dark side; 0 for none or a wide one
    px_per_mm : (n,) scale along the offset
    facet_px : (n,) distance of the mesh's chords from the edge
    chord_px : (n, k) offsets of the mesh's own edge along the ray, also with the mesh turned about
        the edge's axis, see `Curve`
    outline_px : (n,) outward distance from the edge at which the CAD model blocks the panel's
        light; infinite where that is another edge's outline
    outward : (n,) 1 where the ray leads out of the material, else -1
    reach_px : (n, 2) half the distance to the next edge, before the panel and under a lamp
    """

    curve: IndexArray
    points_mm: FloatArray
    pixels: FloatArray
    normals: FloatArray
    design: FloatArray
    pose: FloatArray
    spacing_px: FloatArray
    curvature: FloatArray
    rising: FloatArray
    shows_lit: BoolArray
    wall_px: FloatArray
    px_per_mm: FloatArray
    facet_px: FloatArray
    chord_px: FloatArray
    outline_px: FloatArray
    outward: FloatArray
    reach_px: FloatArray

    def chosen(self, which: BoolArray | IndexArray) -> "Rays":
        """Return the rays with the given numbers, or in a mask."""
        return Rays(*(getattr(self, name)[which] for name in self.__slots__))


def place_rays(curves: Sequence[Curve], T_world_part: FloatArray, camera: Camera) -> Rays:
    """Return the rays across curves, before their visibility is known.

    Parameters
    ----------
    curves : CAD frame, one at least
    T_world_part : (4, 4)
    camera : of the view
    """
    counts = [len(curve.points_mm) for curve in curves]
    points = np.concatenate([curve.points_mm for curve in curves])
    shift = np.concatenate([curve.shift for curve in curves])
    parameters = max(curve.design.shape[1] for curve in curves)
    moves = np.concatenate(
        [
            np.pad(curve.design, ((0, 0), (0, parameters - curve.design.shape[1]), (0, 0)))
            for curve in curves
        ]
    )
    world = transform(T_world_part, points)
    pixels = camera.project(world)
    before = camera.project(
        transform(T_world_part, np.concatenate([curve.before_mm for curve in curves]))
    )
    after = camera.project(
        transform(T_world_part, np.concatenate([curve.after_mm for curve in curves]))
    )
    tangent = 0.5 * (after - before)
    length = np.maximum(lengths(tangent)[:, None], 1e-9)
    jacobian = _projection(world, camera)
    R = T_world_part[:3, :3]
    normals = np.column_stack([-tangent[:, 1], tangent[:, 0]]) / length
    along = np.einsum("nij,nj->ni", jacobian, shift @ R.T)
    sign = np.where(inner(along, normals) < 0, -1.0, 1.0)
    normals *= sign[:, None]
    bend = after - 2 * pixels + before
    across = np.einsum("nij,ni->nj", jacobian, normals)
    step = np.concatenate([_spacing(pixels[i : i + n]) for i, n in _runs(counts)])
    return Rays(
        curve=np.repeat(np.arange(len(curves)), counts),
        points_mm=points,
        pixels=pixels,
        normals=normals,
        design=np.einsum("nj,npj->np", across, moves @ R.T),
        pose=np.concatenate([across, np.zeros_like(across)], axis=1),
        spacing_px=step,
        curvature=-inner(bend, normals) / length[:, 0] ** 2,
        rising=np.zeros(len(points)),
        shows_lit=np.zeros(len(points), dtype=np.bool_),
        wall_px=np.zeros(len(points)),
        px_per_mm=(px_per_mm := np.abs(inner(along, normals))),
        facet_px=px_per_mm * np.repeat([curve.facet_mm for curve in curves], counts),
        chord_px=np.einsum(
            "nj,nkj->nk", across, np.concatenate([curve.chord_mm for curve in curves]) @ R.T
        ),
        outline_px=np.zeros(len(points)),
        outward=np.repeat([curve.outward for curve in curves], counts),
        reach_px=np.full((len(points), 2), NEAR_PX),
    )


def with_rotation(rays: Rays, T_world_part: FloatArray, pivot_world_mm: FloatArray) -> Rays:
    """Return the rays with the motion of their edges by rotations about a point.

    Parameters
    ----------
    rays : rays to complete
    T_world_part : (4, 4)
    pivot_world_mm : (3,) centre of the part's uncertain rotation
    """
    arm = transform(T_world_part, rays.points_mm) - pivot_world_mm
    # A rotation w moves a point by w x arm, and so along a by w . (arm x a).
    across = rays.pose[:, :3]
    pose = np.concatenate([across, np.cross(arm, across)], axis=1)
    values = {name: getattr(rays, name) for name in rays.__slots__}
    return Rays(**{**values, "pose": pose})


def with_visibility(
    rays: Rays,
    curves: Sequence[Curve],
    part: PosedPart,
    T_world_part: FloatArray,
    camera: Camera,
    scene: ViewScene,
) -> Rays:
    """Return the rays with the visibility of their edges.

    Parameters
    ----------
    rays : rays from `place_rays` for these curves
    curves : curves, CAD frame
    part : the part, which may hide them
    T_world_part, camera : pose and camera of the view
    scene : scene without the part
    """
    clear = _is_clear(rays, curves, part, T_world_part, camera, scene)
    index = np.flatnonzero(clear)
    if len(index) == 0:
        return rays
    beside = np.concatenate([-BESIDE_PX[::-1], BESIDE_PX])
    at = rays.pixels[index, None] + beside[None, :, None] * rays.normals[index, None]
    face, cosine = _seen(part, T_world_part, camera, at.reshape(-1, 2))
    face, cosine = face.reshape(at.shape[:2]), cosine.reshape(at.shape[:2])
    half = len(BESIDE_PX)
    # Probe near the edge first, on both sides.
    inner, outer = face[:, half - 1 :: -1], face[:, half:]
    # Closer to the edge than the error of the mesh, no side is certain.
    known = np.maximum(CLOSE_PX, 2.0 * rays.facet_px[index])[:, None] <= BESIDE_PX
    plain = BESIDE_PX >= PLAIN_PX
    inner_panel, outer_panel = (((side == NONE) | ~known).all(axis=1) for side in (inner, outer))
    inner_part, outer_part = ((side[:, plain] != NONE).all(axis=1) for side in (inner, outer))
    rising = np.where(outer_panel & inner_part, 1.0, 0.0)
    rising -= np.where(inner_panel & outer_part, 1.0, 0.0)
    flat = np.where(
        (rising > 0)[:, None], _flat_px(inner, cosine[:, half - 1 :: -1]),
        _flat_px(outer, cosine[:, half:]),
    ).max(axis=1)  # fmt: skip
    is_panel = _on(scene.panel, at).all(axis=1)
    # a gripper behind an outline may shine like the part, and have its own outline there
    is_plain = ~(_on(scene.holder_mask, rays.pixels[index]) & (face == NONE).any(axis=1))
    last = int(np.flatnonzero(BESIDE_PX <= NEAR_PX)[-1])
    ignored = ~known | (BESIDE_PX > NEAR_PX)
    alike = [((side == side[:, last : last + 1]) | ignored).all(axis=1) for side in (inner, outer)]
    lit = is_plain & alike[0] & alike[1] & (inner[:, last] != outer[:, last])
    values = {name: getattr(rays, name).copy() for name in rays.__slots__}
    values["rising"][index] = np.where(is_panel & is_plain, rising, 0.0)
    values["shows_lit"][index] = lit
    values["wall_px"][index] = np.where(rising != 0, flat, 0.0)
    shows = np.flatnonzero((rising != 0) | lit)
    values["reach_px"][index[shows]] = _reach(
        rays.chosen(index[shows]),
        inner[shows, last],
        outer[shows, last],
        part,
        T_world_part,
        camera,
    )
    return Rays(**values)


def with_outline(rays: Rays, part: PosedPart, T_world_part: FloatArray, camera: Camera) -> Rays:
    """Return the rays with the distance from their edge to the border of the panel's light.

    Where a wall is seen along its surface, its outline or its other rim leaves a rim at a tangent:
    over many pixels the light ends a fraction of a pixel beside the rim.

    Parameters
    ----------
    rays : rays with the visibility of their edges
    part, T_world_part, camera : as `with_visibility`
    """
    index = np.flatnonzero(rays.rising)
    if len(index) == 0:
        return rays
    way = rays.rising[index]
    off = rays.chord_px[index, :1] + way[:, None] * OUTSIDE_PX
    at = rays.pixels[index, None] + off[..., None] * rays.normals[index, None]
    face, _ = _seen(part, T_world_part, camera, at.reshape(-1, 2))
    is_part = (face != NONE).reshape(at.shape[:2])
    # It ends between the last place that shows the part and the next one.
    step = float(OUTSIDE_PX[0])
    ends = np.where(is_part, OUTSIDE_PX + 0.5 * step, 0.0).max(axis=1)
    outline_px = rays.outline_px.copy()
    outline_px[index] = np.where(is_part[:, -1], np.inf, ends)
    return replace(rays, outline_px=outline_px)


def _reach(
    rays: Rays,
    inner: Int32Array,
    outer: Int32Array,
    part: PosedPart,
    T_world_part: FloatArray,
    camera: Camera,
) -> FloatArray:
    """Return the range (n, 2) of each ray's own edge, before the panel and under a lamp.

    Parameters
    ----------
    rays : rays that show their edge
    inner, outer : (n,) face beside the edge, on the side of the ray's origin and on the other
    part, T_world_part, camera : see `with_visibility`
    """
    if len(rays.pixels) == 0:
        return np.zeros((0, 2))
    far = np.concatenate([-FARTHER_PX, FARTHER_PX])
    at = rays.pixels[:, None] + far[None, :, None] * rays.normals[:, None]
    face = _seen(part, T_world_part, camera, at.reshape(-1, 2))[0].reshape(at.shape[:2])
    count = len(FARTHER_PX)
    first = np.full((len(face), 2), FARTHER_PX[-1])
    edges = np.concatenate([[NEAR_PX], FARTHER_PX])
    for side, beside in ((face[:, :count], inner), (face[:, count:], outer)):
        as_panel = (side == NONE) != (beside == NONE)[:, None]
        as_face = side != beside[:, None]
        for k, other in enumerate((as_panel, as_face)):
            met = np.where(other.any(axis=1), edges[np.argmax(other, axis=1)], FARTHER_PX[-1])
            first[:, k] = np.minimum(first[:, k], met)
    return np.asarray(np.maximum(0.5 * first, NEAR_PX))


def _flat_px(face: Int32Array, cosine: FloatArray) -> FloatArray:
    """Return the width (n, 1) of walls at a grazing angle beside edges; 0 for none or too wide."""
    flat = (face != NONE) & (cosine < FLAT_COS)
    run = np.cumprod(flat, axis=1)
    ends = run.sum(axis=1)
    edges = np.concatenate([[0.0], BESIDE_PX])
    # It ends between the last place that shows it and the next one.
    width = 0.5 * (edges[ends] + edges[np.minimum(ends + 1, len(BESIDE_PX))])
    return np.asarray(np.where((ends == 0) | (ends == len(BESIDE_PX)), 0.0, width)[:, None])


def _is_clear(
    rays: Rays,
    curves: Sequence[Curve],
    part: PosedPart,
    T_world_part: FloatArray,
    camera: Camera,
    scene: ViewScene,
) -> BoolArray:
    """Return a mask (n,) of edge points with a free line of sight to the camera."""
    width, height = camera.size_px
    reach = BESIDE_PX[-1]
    inside = ((rays.pixels > reach) & (rays.pixels < [width - 1 - reach, height - 1 - reach])).all(
        axis=1
    )
    eye = transform(inverse_pose(T_world_part), camera.position_mm[None])[0]
    pixel_mm = camera.mm_per_px(transform(T_world_part, rays.points_mm[:1])[0])
    facet = np.array([curve.facet_mm for curve in curves])[rays.curve]
    off = np.maximum(FREE_PX * pixel_mm, 2.0 * facet)
    out = np.concatenate([curve.out for curve in curves])
    towards = rays.points_mm + off[:, None] * out - eye
    _, met = part.caster.first_hit(eye, towards)
    clear: BoolArray = inside & (met >= 1.0)
    if scene.wide is not None:
        points = transform(T_world_part, rays.points_mm[clear])
        clear[clear] = ~scene.wide.blocked(points, camera.position_mm - points, 1.0)
    return clear


def _seen(
    part: PosedPart, T_world_part: FloatArray, camera: Camera, pixels: FloatArray
) -> tuple[Int32Array, FloatArray]:
    """Return the faces (n,) in pixels, `NONE` beside the part, and the cosines of incidence."""
    T_part_world = inverse_pose(T_world_part)
    eye = transform(T_part_world, camera.position_mm[None])[0]
    lines = camera.sight_lines(pixels) @ T_part_world[:3, :3].T
    triangle, _ = part.caster.first_hit(eye, lines)
    met = triangle >= 0
    face = np.where(met, part.solid.face_of_triangle[triangle], NONE).astype(np.int32)
    normals = part.caster.normals[triangle]
    cosine = np.abs(inner(normals, lines)) / lengths(lines)
    return face, np.where(met, cosine, 1.0)


def _on(mask: BoolArray, pixels: FloatArray) -> BoolArray:
    """Return which pixels (..., 2) of a picture are in a mask (height, width)."""
    height, width = mask.shape
    at = np.clip(np.round(pixels).astype(np.intp), 0, [width - 1, height - 1])
    return np.asarray(mask[at[..., 1], at[..., 0]])


def _projection(world_mm: FloatArray, camera: Camera) -> FloatArray:
    """Return derivatives of pixels by world points (n, 2, 3) [px/mm], by central differences."""
    step = 0.01
    moved = np.concatenate(
        [world_mm + sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    )
    pixels = camera.project(moved).reshape(3, 2, -1, 2)
    return np.asarray(np.moveaxis(pixels[:, 0] - pixels[:, 1], 0, 2) / (2 * step))


def _spacing(pixels: FloatArray) -> FloatArray:
    way = lengths(np.diff(pixels, axis=0))
    return np.append(way, way[-1:])


def _runs(counts: Sequence[int]) -> list[tuple[int, int]]:
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    return list(zip(starts.tolist(), counts, strict=True))
