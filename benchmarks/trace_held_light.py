"""What the station's camera sees of a part in a gripper, path-traced lamp by lamp: radiance.

Only pixels that look at metal are traced: rays go through the lens distortion backwards, edges
and what is finer than a pixel get more of them. The panel behind is smooth: it is traced on
every eighth pixel by rays that begin just above it, and mixed in where an edge covers part of
a pixel. Units mm; the world is the station's: panel in z = 0, camera above it.

Only benchmarks use this: mitsuba is no dependency of the project. Knows no inspection.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from trace_scene import tracer

Array = NDArray[np.float64]
Words = dict[str, Any]
Mitsuba = Any

LAMPS = ("backlight", "ring", "side")
RAYS_AT_ONCE = 3_000_000
STRIDE_PX = 8  # of the panel
TILE_MM = 48.0  # the marks of a surface come again after this
TILE_CELLS = 512
DIRECT, MAX_BOUNCES = 2, 5  # as mitsuba counts: lamp and surface are two
INSIDE, AT_EDGE = 9, 36  # rays a pixel under a lamp
INSIDE_DARK, AT_EDGE_DARK = 4, 49  # before the panel
NOISY = 100  # rays a pixel where fewer leave grain, as at the border of a shadow
MIN_SPREAD = 0.2  # of a pixel's rays over their mean: less leaves no grain
MORE_SPREAD = 1.5  # than most pixels have, where the lamp is seen in part
COARSE, COARSE_DARK = (6, 12), (1, 16)  # for golden views
FAR = 2  # far from the part
BRIGHTEST = 8.0  # of one ray: rare ones brighter still would be white dots
EVEN_PX = 3.0
CREASE_RAD = np.radians(32.0)  # flatter than this, facets are of one round surface


@dataclass(frozen=True, eq=False)
class Sight:
    """A camera: as truth.json has it, T_world_cam its pose in the station."""

    size_px: tuple[int, int]
    K: Array
    distortion: Array
    T_world_cam: Array


@dataclass(frozen=True, eq=False)
class Look:
    """What a surface is made of, and the marks on it.

    Attributes
    ----------
    material : metal, alpha, specular, diffuse as of a mixed metal and paint
    albedo, height : (cells, cells) over a tile: factor about 1, and bumps [mm]
    """

    material: Mapping[str, float]
    albedo: NDArray[np.float32]
    height: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Stain:
    """A spot that reflects less or more: patches of spheres in the part's frame."""

    centres_mm: Array
    radii_mm: Array
    factor: float


@dataclass(frozen=True, eq=False)
class Thing:
    """Something in sight.

    Attributes
    ----------
    triangles_mm : (n, 3, 3) in its own frame
    T : its pose in the station
    look : what it is made of
    is_smooth : round surfaces are shaded as round
    stain : on it
    """

    triangles_mm: Array
    T: Array
    look: Look
    is_smooth: bool = True
    stain: Stain | None = None


@dataclass(frozen=True, eq=False)
class Seen:
    """Traced pictures of one view.

    Attributes
    ----------
    radiance : (height, width) by lamp
    label : (height, width) number of the thing seen at the pixel's centre, -1 the panel
    """

    radiance: dict[str, NDArray[np.float32]] = field(default_factory=dict)
    label: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), np.int8))


def trace_view(
    sight: Sight,
    things: Sequence[Thing],
    station: Words,
    lamps: Sequence[str],
    seed: int,
    *,
    is_coarse: bool = False,
    near_px: int | None = None,
) -> Seen:
    """Return the radiance under each lamp, panel = 1 where it glows.

    Parameters
    ----------
    sight : the camera
    things : the part first
    station : lamps and panel as in truth.json
    lamps : which to light, one at a time
    seed : of the rays
    is_coarse : with fewer of them
    near_px : what is farther from the part gets two rays a pixel, and no light from other
        surfaces; None: all is traced alike
    """
    mi = tracer()
    rng = np.random.default_rng(seed)
    shapes = [_shape(f"thing_{i}", thing) for i, thing in enumerate(things)]
    eye = _Eye(sight)
    plain = mi.load_dict({"type": "scene"} | {f"t{i}": s for i, s in enumerate(shapes)})
    label, normal, depth, points = _first_hits(plain, shapes, eye, _boxes(sight, things))
    edges = _edges(label, normal, depth)
    far = np.zeros(label.shape, bool)
    if near_px is not None:
        reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * near_px + 1, 2 * near_px + 1))
        near = cv2.dilate((label == 0).astype(np.uint8), reach) > 0
        far, edges = ((label >= 0) | edges) & ~near, edges & near
    seen = Seen(label=label)
    stain = things[0].stain
    factor = None
    if stain is not None:
        factor = stained(stain, (points - things[0].T[:3, 3]) @ things[0].T[:3, :3])
        factor[label != 0] = 1.0
    for lamp in lamps:
        scene = mi.load_dict(
            {"type": "scene", "panel": _panel(station, lamp == "backlight")}
            | {f"t{i}": s for i, s in enumerate(shapes)}
            | _lamp(station, lamp)
        )
        dark = lamp == "backlight"
        behind = _behind(scene, eye, station, rng, glows=dark)
        picture = behind.copy()
        body = ~edges & ~far & (label >= 0)
        inside, at_edge = np.flatnonzero(body.ravel()), np.flatnonzero(edges.ravel())
        beyond = np.flatnonzero(far.ravel())
        flat = picture.ravel()
        if len(beyond):
            light, _, cover, _ = _trace(scene, eye, beyond, FAR, rng, depth=DIRECT)
            flat[beyond] = light + (1 - cover) * behind.ravel()[beyond]
        grainy = np.zeros(label.shape, bool)
        if is_coarse:
            rays = COARSE_DARK if dark else COARSE
        else:
            rays = (INSIDE_DARK, AT_EDGE_DARK) if dark else (INSIDE, AT_EDGE)
        for pixels, spp in zip((inside, at_edge), rays, strict=True):
            is_parted = pixels is inside and not is_coarse
            direct, bounced, cover, spread = _trace(
                scene, eye, pixels, spp, rng, is_parted=is_parted
            )
            if not is_coarse and not dark:
                if is_parted:
                    grainy = _grainy(direct, spread, pixels, label.shape)
                again = np.flatnonzero(grainy.ravel()[pixels])
                depth = DIRECT if is_parted else MAX_BOUNCES
                direct[again] = _trace(scene, eye, pixels[again], NOISY, rng, depth=depth)[0]
            if is_parted:
                bounced = _evened(bounced, inside, body)
            light = direct + bounced
            if factor is not None:
                light *= factor.ravel()[pixels]
            flat[pixels] = light + (1 - cover) * behind.ravel()[pixels]
        seen.radiance[lamp] = picture.astype(np.float32)
    return seen


def changed_px(
    sight: Sight, things: Sequence[Thing], others: Sequence[Thing]
) -> tuple[int, tuple[float, float]]:
    """Return how many pixels look different with other things, and the middle of these.

    Pixel centres only: depth, direction of the surface, which thing, or how much it reflects.

    Parameters
    ----------
    sight : the camera
    things, others : as they are, and as they might be
    """
    mi = tracer()
    eye = _Eye(sight)
    pixels = np.union1d(_boxes(sight, things), _boxes(sight, others))
    seen = []
    for these in (things, others):
        shapes = [_shape(f"thing_{i}", thing) for i, thing in enumerate(these)]
        scene = mi.load_dict({"type": "scene"} | {f"t{i}": s for i, s in enumerate(shapes)})
        label, normal, depth, points = _first_hits(scene, shapes, eye, pixels)
        factor = np.ones(label.shape)
        if these[0].stain is not None:
            T = these[0].T
            factor = stained(these[0].stain, (points - T[:3, 3]) @ T[:3, :3])
            factor[label != 0] = 1.0
        seen.append((label, normal, depth, factor))
    (l0, n0, d0, f0), (l1, n1, d1, f1) = seen
    is_other = (l0 != l1) | (np.abs(d0 - d1) > 0.04) | (np.abs(f0 - f1) > 0.05)
    is_other |= ((n0 * n1).sum(axis=2) < 0.995) & (l0 >= 0)
    v, u = np.nonzero(is_other)
    return len(u), (float(u.mean()), float(v.mean())) if len(u) else (0.0, 0.0)


def stained(stain: Stain, p_part_mm: Array) -> Array:
    """Return the factor of reflectance (height, width) at points (height, width, 3)."""
    low = (stain.centres_mm - stain.radii_mm[:, None]).min(axis=0)
    high = (stain.centres_mm + stain.radii_mm[:, None]).max(axis=0)
    out = np.ones(p_part_mm.shape[:2])
    near = ((p_part_mm > low) & (p_part_mm < high)).all(axis=2)
    if near.any():
        d = np.linalg.norm(p_part_mm[near][:, None] - stain.centres_mm, axis=2) / stain.radii_mm
        inside = np.clip((1.0 - d.min(axis=1)) / 0.12, 0.0, 1.0)  # a soft rim
        out[near] = 1.0 + (stain.factor - 1.0) * inside
    return out


class _Eye:
    """The camera's rays, made by mitsuba's own numbers."""

    def __init__(self, sight: Sight) -> None:
        mi, dr = tracer(), import_module("drjit")
        self.size_px = sight.size_px
        k1, k2, p1, p2, k3 = (dr.opaque(mi.Float, float(v)) for v in sight.distortion)
        self._d = (k1, k2, p1, p2, k3)
        K = sight.K
        self._k = [dr.opaque(mi.Float, float(v)) for v in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]
        R, t = sight.T_world_cam[:3, :3], sight.T_world_cam[:3, 3]
        self._columns = [
            mi.Vector3f(*[dr.opaque(mi.Float, float(v)) for v in R[:, i]]) for i in range(3)
        ]
        self._at = mi.Point3f(*[dr.opaque(mi.Float, float(v)) for v in t])

    def rays(self, pixels: NDArray[np.int64], shift: Mitsuba, repeats: int) -> Mitsuba:
        """Return rays through pixels (n,) + shift (n * repeats) [px]."""
        mi, dr = tracer(), import_module("drjit")
        width = self.size_px[0]
        which = dr.arange(mi.UInt32, len(pixels) * repeats) // dr.opaque(mi.UInt32, repeats)
        u0 = dr.gather(mi.Float, mi.Float((pixels % width).astype(np.float32)), which)
        v0 = dr.gather(mi.Float, mi.Float((pixels // width).astype(np.float32)), which)
        fx, fy, cx, cy = self._k
        k1, k2, p1, p2, k3 = self._d
        u, v = (u0 + shift.x - cx) / fx, (v0 + shift.y - cy) / fy
        x, y = u, v
        for _ in range(6):  # the lens bends little: each step gains two digits
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
            dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
            x, y = (u - dx) / radial, (v - dy) / radial
        a, b, c = self._columns
        return mi.Ray3f(self._at, dr.normalize(x * a + y * b + c))


def _boxes(sight: Sight, things: Sequence[Thing]) -> NDArray[np.int64]:
    """Return the pixels of the rectangle round all things, some wider."""
    width, height = sight.size_px
    R, t = sight.T_world_cam[:3, :3], sight.T_world_cam[:3, 3]
    inside = np.zeros((height, width), bool)
    for thing in things:
        points = thing.triangles_mm.reshape(-1, 3) @ thing.T[:3, :3].T + thing.T[:3, 3]
        p = (points - t) @ R
        uv = p[:, :2] / p[:, 2:] * [sight.K[0, 0], sight.K[1, 1]] + sight.K[:2, 2]
        low = np.clip(np.floor(uv.min(axis=0)).astype(int) - 12, 0, [width, height])
        high = np.clip(np.ceil(uv.max(axis=0)).astype(int) + 12, 0, [width, height])
        inside[low[1] : high[1], low[0] : high[0]] = True
    out: NDArray[np.int64] = np.flatnonzero(inside.ravel())
    return out


def _first_hits(
    scene: Mitsuba, shapes: Sequence[Mitsuba], eye: _Eye, pixels: NDArray[np.int64]
) -> tuple[NDArray[np.int8], Array, Array, Array]:
    """Return thing, normal, depth and point at each pixel's centre."""
    mi, dr = tracer(), import_module("drjit")
    width, height = eye.size_px
    zero = mi.Point2f(dr.zeros(mi.Float, len(pixels)), 0.0)
    ray = eye.rays(pixels, zero, 1)
    hit = scene.ray_intersect(ray)
    label = np.full(height * width, -1, np.int8)
    normal, depth = np.zeros((height * width, 3)), np.full(height * width, 1e4)
    points = np.zeros((height * width, 3))
    found = np.full(len(pixels), -1, np.int8)
    for i, shape in enumerate(shapes):
        found[np.array(hit.shape == mi.ShapePtr(shape))] = i
    label[pixels] = found
    ok = found >= 0
    normal[pixels[ok]] = np.array(hit.sh_frame.n).T[ok]
    depth[pixels[ok]] = np.array(hit.t)[ok]
    points[pixels[ok]] = np.array(hit.p).T[ok]
    shape3 = (height, width, 3)
    return (
        label.reshape(height, width),
        normal.reshape(shape3),
        depth.reshape(height, width),
        points.reshape(shape3),
    )


def _edges(label: NDArray[np.int8], normal: Array, depth: Array) -> NDArray[np.bool_]:
    """Return the pixels (height, width) at which what is seen changes from one to the next."""
    out = np.zeros(label.shape, bool)
    for axis in (0, 1):
        a = [slice(None), slice(None)]
        b = [slice(None), slice(None)]
        a[axis], b[axis] = slice(1, None), slice(None, -1)
        one, other = tuple(a), tuple(b)
        change = (label[one] != label[other]) | ((normal[one] * normal[other]).sum(axis=2) < 0.978)
        change &= (label[one] >= 0) | (label[other] >= 0)
        change |= (np.abs(depth[one] - depth[other]) > 1.2) & (label[one] >= 0)
        out[one] |= change
        out[other] |= change
    wide = cv2.dilate(out.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return np.asarray(wide, bool)


def _trace(
    scene: Mitsuba,
    eye: _Eye,
    pixels: NDArray[np.int64],
    spp: int,
    rng: np.random.Generator,
    *,
    is_parted: bool = False,
    depth: int = MAX_BOUNCES,
) -> tuple[Array, Array, Array, Array]:
    """Return the mean radiance (n,) of metal in pixels (n,), how much it covers, and its spread.

    Of the radiance first what is lit by the lamp itself, then what comes by way of other
    surfaces; all in the first where they are not parted. The spread is the first's over its rays.
    """
    mi, dr = tracer(), import_module("drjit")
    paths = [
        mi.load_dict({"type": "path", "max_depth": deep, "rr_depth": 99})
        for deep in ((DIRECT, MAX_BOUNCES) if is_parted else (depth,))
    ]
    sampler, place = (mi.load_dict({"type": "multijitter", "sample_count": spp}) for _ in range(2))
    sampler.set_samples_per_wavefront(spp)
    place.set_samples_per_wavefront(spp)
    out = np.zeros((4, len(pixels)))
    step = RAYS_AT_ONCE // spp
    for start in range(0, len(pixels), step):
        block = pixels[start : start + step]
        n = len(block) * spp
        # opaque: a number that is written into the program would have it compiled again
        seed = dr.opaque(mi.UInt32, int(rng.integers(2**31)))
        place.seed(dr.opaque(mi.UInt32, int(rng.integers(2**31))), n)
        ray = eye.rays(block, place.next_2d() - 0.5, spp)
        dr.eval(ray)
        hit = scene.ray_intersect_preliminary(ray, False)
        on_metal = hit.is_valid() & (ray(hit.t).z > 0.5)
        dr.eval(on_metal)
        values = []
        for path in paths:  # the same draws: the difference is what bounced
            sampler.seed(seed, n)
            value, _, _ = path.sample(scene, sampler, ray, active=on_metal)
            values.append(dr.select(on_metal, dr.minimum(value[0], BRIGHTEST), 0.0))
            dr.eval(values[-1])
        covered = dr.select(on_metal, mi.Float(1), mi.Float(0))
        bounced = values[1] - values[0] if is_parted else 0.0 * covered
        for row, value in enumerate((values[0], bounced, covered, values[0] * values[0])):
            out[row, start : start + step] = np.array(dr.block_sum(value, spp)) / spp
    return out[0], out[1], out[2], np.sqrt(np.maximum(out[3] - out[0] ** 2, 0.0))


def _grainy(
    light: Array, spread: Array, pixels: NDArray[np.int64], shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Return where few rays leave grain (height, width), and what is next to that."""
    picture = np.zeros(shape, np.float32)
    relative = spread / np.maximum(light, 0.02)
    usual = float(np.median(relative[light > 0.02])) if (light > 0.02).any() else 0.0
    picture.ravel()[pixels] = relative > max(MIN_SPREAD, MORE_SPREAD * usual)
    # by chance single pixels may be so, and others not that are as grainy
    many = (cv2.blur(picture, (5, 5)) > 0.15).astype(np.uint8)
    return np.asarray(cv2.dilate(many, np.ones((5, 5), np.uint8)) > 0, bool)


def _evened(values: Array, pixels: NDArray[np.int64], inside: NDArray[np.bool_]) -> Array:
    """Return light that came by way of other surfaces (n,), evened out within each surface."""
    picture = np.zeros(inside.shape, np.float32)
    picture.ravel()[pixels] = values
    count, number, boxes, _ = cv2.connectedComponentsWithStats(
        inside.astype(np.uint8), connectivity=4
    )
    out = np.zeros(inside.shape, np.float32)
    for i in range(1, count):
        x, y, w, h = boxes[i, :4]
        here = np.s_[y : y + h, x : x + w]
        mask = (number[here] == i).astype(np.float32)
        total = cv2.GaussianBlur(picture[here] * mask, (0, 0), EVEN_PX, borderType=0)
        weight = cv2.GaussianBlur(mask, (0, 0), EVEN_PX, borderType=0)
        out[here] += mask * total / np.maximum(weight, 1e-6)
    return np.asarray(out.ravel()[pixels], np.float64)


def _behind(
    scene: Mitsuba, eye: _Eye, station: Words, rng: np.random.Generator, *, glows: bool
) -> Array:
    """Return the panel as if nothing stood before it, but in its shadow (height, width)."""
    mi, dr = tracer(), import_module("drjit")
    width, height = eye.size_px
    v, u = np.mgrid[0:height, 0:width]
    x, y = (u - width / 2) / width, (v - height / 2) / width
    uneven = 1.0 - station["uneven"] * 4.0 * ((x - 0.1) ** 2 + (y + 0.05) ** 2)
    uneven += station["tilt"] * x
    if glows:
        return np.asarray(uneven)
    rows, columns = -(-height // STRIDE_PX) + 1, -(-width // STRIDE_PX) + 1
    r, c = np.mgrid[0:rows, 0:columns]
    at = np.minimum(r * STRIDE_PX, height - 1) * width + np.minimum(c * STRIDE_PX, width - 1)
    pixels = at.ravel()
    spp = 36
    integrator = mi.load_dict({"type": "path", "max_depth": 3, "rr_depth": 99})
    sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
    sampler.set_samples_per_wavefront(spp)
    n = len(pixels) * spp
    sampler.seed(dr.opaque(mi.UInt32, int(rng.integers(2**31))), n)
    ray = eye.rays(pixels, (sampler.next_2d() - 0.5) * STRIDE_PX, spp)
    near = ray(-(ray.o.z - 2.0) / ray.d.z)
    value, _, _ = integrator.sample(scene, sampler, mi.Ray3f(near, ray.d))
    grid = (np.array(dr.block_sum(value[0], spp)) / spp).reshape(rows, columns)
    grid = cv2.GaussianBlur(grid.astype(np.float32), (0, 0), 2.0)
    map_u = (u / STRIDE_PX).astype(np.float32)
    map_v = (v / STRIDE_PX).astype(np.float32)
    out = cv2.remap(grid, map_u, map_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(out, np.float64)


def _uniform(value: float) -> Words:
    return {"type": "uniform", "value": float(value)}


def _texture(values: NDArray[np.float32]) -> Words:
    mi = tracer()
    bitmap = mi.Bitmap(np.ascontiguousarray(values, np.float32)[..., None])
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "wrap_mode": "repeat"}


def _bsdf(look: Look) -> Words:
    m = look.material
    metal = {
        "type": "roughconductor",
        "distribution": "ggx",
        "alpha": float(m["alpha"]),
        "specular_reflectance": _texture(m["specular"] * look.albedo),
    }
    paint = {"type": "diffuse", "reflectance": _texture(m["diffuse"] * look.albedo)}
    mixed = {"type": "blendbsdf", "weight": float(m["metal"]), "paint": paint, "metal": metal}
    return {
        "type": "bumpmap",
        "arbitrary": _texture(look.height / TILE_MM),
        "scale": TILE_MM,
        "bsdf": mixed,
    }


def _shape(name: str, thing: Thing) -> Mitsuba:
    """Return a mesh whose marks lie on it as seen along its nearest axis."""
    mi = tracer()
    triangles = np.asarray(thing.triangles_mm)
    count = len(triangles)
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(flat, axis=1, keepdims=True)
    flat = flat / np.maximum(area, 1e-12)
    normals = smooth_normals(triangles) if thing.is_smooth else np.repeat(flat[:, None], 3, 1)
    axis = np.abs(flat).argmax(axis=1)
    across = np.array([[1, 2], [2, 0], [0, 1]])[axis]
    uv = np.take_along_axis(triangles, across[:, None, :], axis=2) / TILE_MM
    uv = uv + 0.37 * axis[:, None, None]
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_bsdf(thing.look))
    mesh = mi.Mesh(
        name,
        3 * count,
        count,
        props=properties,
        has_vertex_normals=True,
        has_vertex_texcoords=True,
    )
    values = mi.traverse(mesh)
    R, t = thing.T[:3, :3], thing.T[:3, 3]
    values["vertex_positions"] = (triangles @ R.T + t).astype(np.float32).ravel()
    values["vertex_normals"] = (normals @ R.T).astype(np.float32).ravel()
    values["vertex_texcoords"] = uv.astype(np.float32).ravel()
    values["faces"] = np.arange(3 * count, dtype=np.uint32)
    values.update()
    return mesh


def smooth_normals(triangles: Array) -> Array:
    """Return normals (n, 3, 3) at corners: those of facets that meet there at flat angles, mixed.

    What meets at more than the crease's angle keeps its own.
    """
    count = len(triangles)
    flat = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    area = np.linalg.norm(flat, axis=1)
    unit = flat / np.maximum(area, 1e-12)[:, None]
    # by the angle at the corner, so that long thin triangles count as what they show
    out = np.zeros((count, 3, 3))
    _, corner = np.unique(np.round(triangles.reshape(-1, 3), 5), axis=0, return_inverse=True)
    corner = corner.ravel().reshape(count, 3)
    a = triangles
    e1, e2 = np.roll(a, -1, axis=1) - a, np.roll(a, 1, axis=1) - a
    length = np.linalg.norm(e1, axis=2) * np.linalg.norm(e2, axis=2)
    angle = np.arccos(np.clip((e1 * e2).sum(axis=2) / np.maximum(length, 1e-12), -1, 1))
    order = np.argsort(corner.ravel(), kind="stable")
    starts = np.searchsorted(corner.ravel()[order], np.arange(corner.max() + 2))
    limit = np.cos(CREASE_RAD)
    triangle_of = order // 3
    weight = angle.ravel()[order]
    group = np.diff(starts)
    # corners with equally many facets are done at once
    for size in np.unique(group[group > 0]):
        which = np.flatnonzero(group == size)
        rows = starts[which][:, None] + np.arange(size)
        n = unit[triangle_of[rows]]
        w = weight[rows]
        alike = (np.einsum("kic,kjc->kij", n, n) > limit) * w[:, None, :]
        mixed = np.einsum("kij,kjc->kic", alike, n)
        norm = np.linalg.norm(mixed, axis=2, keepdims=True)
        mixed = np.where(norm > 1e-9, mixed / np.maximum(norm, 1e-9), n)
        out.reshape(-1, 3)[order[rows].ravel()] = mixed.reshape(-1, 3)
    return out


def _panel(station: Words, glows: bool) -> Words:
    mi = tracer()
    half = np.array(station["panel_mm"]) / 2
    out: Words = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().scale([*half.tolist(), 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": _uniform(station["panel_albedo"])},
    }
    if glows:
        out["emitter"] = {"type": "area", "radiance": _uniform(1.0)}
    return out


def _lamp(station: Words, lamp: str) -> Words:
    if lamp == "ring":
        return {"lamp": _ring(station)}
    if lamp == "side":
        return {"lamp": _side(station)}
    return {}


def _ring(station: Words) -> Mitsuba:
    """Return a flat ring that shines down; unit irradiance about where the part is held."""
    mi = tracer()
    ring = station["ring"]
    r0, r1 = ring["inner_mm"], ring["outer_mm"]
    a = np.linspace(0.0, 2 * np.pi, 96, endpoint=False)
    rim = np.column_stack([np.cos(a), np.sin(a), np.zeros(len(a))])
    points = np.concatenate([r0 * rim, r1 * rim]) + np.array(ring["centre"])
    i, n = np.arange(len(a)), len(a)
    j = (i + 1) % n
    faces = np.concatenate([np.column_stack([i, j, n + j]), np.column_stack([i, n + j, n + i])])
    away = ring["centre"][2] - station["held_mm"]
    strength = away**2 / (r1**2 - r0**2)
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": _uniform(0.0)})
    properties["emitter"] = mi.load_dict({"type": "area", "radiance": _uniform(strength)})
    properties["face_normals"] = True
    mesh = mi.Mesh("ring", len(points), len(faces), props=properties)
    values = mi.traverse(mesh)
    values["vertex_positions"] = points.astype(np.float32).ravel()
    values["faces"] = faces.astype(np.uint32).ravel()
    values.update()
    return mesh


def _side(station: Words) -> Words:
    mi = tracer()
    side = station["side"]
    at, target = np.array(side["centre"]), np.array([0.0, 0.0, station["held_mm"]])
    strength = float(((at - target) ** 2).sum()) / side["half_mm"][0] / side["half_mm"][1]
    T = mi.ScalarTransform4f().look_at(origin=at.tolist(), target=target.tolist(), up=[0, 0, 1])
    return {
        "type": "rectangle",
        "to_world": T @ mi.ScalarTransform4f().scale([*side["half_mm"], 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": _uniform(0.0)},
        "emitter": {"type": "area", "radiance": _uniform(strength)},
    }
