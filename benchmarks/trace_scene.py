"""What a camera above the table sees of parts on it, traced with mitsuba: radiance per pixel.

The picture is made of the camera's own rays: each pixel's square is filled with rays, and each ray
goes through the lens distortion backwards, so nothing is resampled afterwards. Pixels near
a part get all rays; the open table, where light changes slowly, gets them on every fourth
pixel and is filled in smoothly between. Units mm; radiance 1 is what a white pixel shows at gain 1.

Only benchmarks use this: mitsuba is no dependency of the project. Knows no recognition.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.imaging import Camera

Array = NDArray[np.float64]
Light = dict[str, Any]
Material = dict[str, Any]
Mitsuba = Any  # its module and objects, made at run time: it may be missing

OLDEST_LLVM = 16
LLVM_FOLDERS = (
    "usr/lib/x86_64-linux-gnu",
    "usr/lib/aarch64-linux-gnu",
    "usr/lib64",
    "usr/local/lib",
)
WHAT_TO_INSTALL = (
    "mitsuba is missing or has no LLVM: pip install 'mitsuba>=3.6' and apt install libllvm19 "
    "(or set DRJIT_LIBLLVM_PATH to a libLLVM.so of version 16 or later)"
)
RAYS_AT_ONCE = 4_000_000
STRIDE_PX = 4  # of the open table
NEAR_PX = 20  # all rays this far round a part: its sharpest shadows are there
FADE_PX = 8  # of these, the outer ones fade into the open table
TABLE_MM = 800.0  # side of the table that is modelled; the picture shows 320 x 260 mm
RING_Z_MM = 525.0  # a ring lamp of strength 1 at this height shows a white sheet as white
SIDE_DISTANCE_MM = 600.0
SIDE_RADIUS_MM = 45.0
MAX_BOUNCES = 5
BAR_DISTANCE_MM = 550.0
BAR_WIDTH_MM = 40.0
SHARES = {
    "glow": 1.0,
    "ring": 1.0,
    "side": 0.5,
    "bars": 1.0,
    "env": 0.35,
}  # of the rays, by what light adds


class NoTracerError(Exception):
    """Mitsuba, or the LLVM it computes with, cannot be loaded."""


@dataclass(frozen=True, eq=False)
class Body:
    """A part where it lies: triangles (n, 3, 3) in the world [mm] and what it is made of."""

    triangles_mm: Array
    material: Material


@lru_cache(maxsize=1)
def tracer() -> Mitsuba:
    """Return mitsuba, one thread only.

    Raises
    ------
    NoTracerError : it is not installed
    """
    if "DRJIT_LIBLLVM_PATH" not in os.environ:
        found = {
            int(version[1]): str(file)
            for folder in LLVM_FOLDERS
            for file in Path("/").glob(f"{folder}/libLLVM*")
            if (version := re.fullmatch(r"libLLVM(?:\.so\.|-)(\d\d)\b[.0-9so]*", file.name))
        }
        # an older one does not refuse: it ends the process in the middle of a picture
        if not found or max(found) < OLDEST_LLVM:
            raise NoTracerError(WHAT_TO_INSTALL)
        os.environ["DRJIT_LIBLLVM_PATH"] = found[max(found)]
    try:
        drjit, mitsuba = import_module("drjit"), import_module("mitsuba")

        mitsuba.set_variant("llvm_ad_mono")
        drjit.set_thread_count(1)
        mitsuba.Float(1.0) + 1.0
    except (ImportError, RuntimeError, AttributeError) as error:
        raise NoTracerError(WHAT_TO_INSTALL) from error
    return mitsuba


def radiance(
    sight: PixelRays, bodies: Sequence[Body], light: Light, spp: int, seed: int
) -> NDArray[np.float32]:
    """Return the picture (height, width) before any sensor.

    Parameters
    ----------
    sight : the camera's rays, made once for many pictures
    light : as in truth.json; ``mode`` "back" or "front"
    spp : rays a pixel for the strongest lamp
    """
    shapes = [_body_shape(body) for body in bodies]
    width, height = sight.size_px
    rng = np.random.default_rng(seed)
    scenes = _scenes(shapes, light, rng)
    covered = _covered(scenes[0][1], sight)
    near = cv2.distanceTransform((~covered).astype(np.uint8), cv2.DIST_L2, 5)
    near_id = np.flatnonzero(near.ravel() <= NEAR_PX)
    grid_v, grid_u = np.mgrid[0:height:STRIDE_PX, 0:width:STRIDE_PX]
    grid_id = (grid_v * width + grid_u).ravel()
    is_open = near.ravel()[grid_id] > 1.5
    close, far = np.zeros(len(near_id)), np.zeros(is_open.sum())
    for name, scene in scenes:
        count = max(4, round(spp * SHARES[name]))
        close += _trace(scene, sight, near_id, count, rng)
        far += _trace(scene, sight, grid_id[is_open], count, rng)
    open_table = _filled_in(far, is_open.reshape(grid_v.shape), (width, height))
    out = open_table.ravel()
    blend = np.clip((NEAR_PX - near.ravel()[near_id]) / FADE_PX, 0.0, 1.0)
    out[near_id] = blend * close + (1 - blend) * out[near_id]
    return out.reshape(height, width).astype(np.float32)


class PixelRays:
    """Where each pixel looks: a direction per pixel and how it turns within the pixel."""

    def __init__(self, camera: Camera) -> None:
        width, height = camera.size_px
        v, u = np.mgrid[0:height, 0:width]
        centres = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
        step = np.array([0.5, 0.0]), np.array([0.0, 0.5])
        look = camera.sight_lines
        self.d = look(centres)
        self.d_u = look(centres + step[0]) - look(centres - step[0])
        self.d_v = look(centres + step[1]) - look(centres - step[1])
        self.camera = camera
        self.origin = camera.position_mm
        self.size_px = camera.size_px

    def through(self, pixels: NDArray[np.int64], shift: Mitsuba, repeats: int = 1) -> Mitsuba:
        """Return mitsuba's rays through pixels (n,) + shift (n * repeats) of mitsuba's, in px."""
        mi, drjit = tracer(), import_module("drjit")
        which = drjit.arange(mi.UInt32, len(pixels) * repeats) // repeats
        parts = [
            [
                drjit.gather(mi.Float, mi.Float(c), which)
                for c in values[pixels].T.astype(np.float32)
            ]
            for values in (self.d, self.d_u, self.d_v)
        ]
        d, d_u, d_v = (mi.Vector3f(*part) for part in parts)
        look = drjit.normalize(d + shift.x * d_u + shift.y * d_v)
        return mi.Ray3f(mi.Point3f(*self.origin.tolist()), look)


def _trace(
    scene: Mitsuba, rays: PixelRays, pixels: NDArray[np.int64], spp: int, rng: np.random.Generator
) -> Array:
    """Return the mean radiance (n,) of pixels (n,) over spp rays each, spread evenly."""
    mi, drjit = tracer(), import_module("drjit")
    across = max(2, round(np.sqrt(spp)))
    spp = across**2
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_BOUNCES, "rr_depth": 99})
    sampler = mi.load_dict({"type": "multijitter", "sample_count": spp})
    sampler.set_samples_per_wavefront(spp)
    out = np.zeros(len(pixels))
    step = RAYS_AT_ONCE // spp
    for start in range(0, len(pixels), step):
        block = pixels[start : start + step]
        n = len(block) * spp
        # opaque: a number that is written into the program would have it compiled again
        sampler.seed(drjit.opaque(mi.UInt32, int(rng.integers(2**31))), n)
        # where in the pixel is left to chance: edges then jitter by some 0.05 px, as with any
        # renderer, and as they do in pictures of real, not quite sharp edges
        chance = mi.load_dict({"type": "independent"})
        chance.seed(drjit.opaque(mi.UInt32, int(rng.integers(2**31))), n)
        shift = chance.next_2d() - 0.5
        value, _, _ = integrator.sample(scene, sampler, rays.through(block, shift, spp))
        out[start : start + step] = np.array(drjit.block_sum(value[0], spp)) / spp
    return out


def _covered(scene: Mitsuba, rays: PixelRays) -> NDArray[np.bool_]:
    """Return which pixels' centres (height, width) look at a part, not at the table."""
    width, height = rays.size_px
    pixels = np.arange(width * height)
    hit = scene.ray_intersect(rays.through(pixels, tracer().Point2f(0.0, 0.0)))
    z = np.array(hit.p.z)
    is_on_table = np.array(hit.is_valid()) & (np.abs(z) < 1e-3) & (np.array(hit.n.z) > 0.99)
    out: NDArray[np.bool_] = ~is_on_table.reshape(height, width)
    return out


def _filled_in(values: Array, is_open: NDArray[np.bool_], size_px: tuple[int, int]) -> Array:
    """Return the open table (height, width) from values at every fourth pixel outside the parts."""
    sums = np.zeros(is_open.shape)
    sums[is_open] = values
    weights = is_open.astype(np.float64)
    filled, sigma = np.zeros_like(sums), 1.0
    missing = np.ones(is_open.shape, bool)
    while missing.any():  # under a part nothing is known; the nearest of the table goes in
        total = cv2.GaussianBlur(weights, (0, 0), sigma)
        here = missing & (total > 0.05)
        filled[here] = cv2.GaussianBlur(sums, (0, 0), sigma)[here] / total[here]
        missing &= ~here
        sigma *= 2.0
    width, height = size_px
    u = (np.arange(width) / STRIDE_PX).astype(np.float32)
    v = (np.arange(height) / STRIDE_PX).astype(np.float32)
    at = np.meshgrid(u, v)
    border = cv2.BORDER_REPLICATE
    out = cv2.remap(filled.astype(np.float32), *at, cv2.INTER_LINEAR, borderMode=border)
    return np.asarray(out, np.float64)


def _scenes(
    shapes: list[Mitsuba], light: Light, rng: np.random.Generator
) -> list[tuple[str, Mitsuba]]:
    """Return one scene a lamp, so that every ray knows which lamp to look for."""
    lamps: dict[str, Any] = {}
    if light["mode"] == "back":
        lamps["glow"] = {}
    if light["ring"] > 0:
        lamps["ring"] = {"lamp": _ring(light)}
    if light["side"] > 0:
        lamps["side"] = {"lamp": _side(light)}
    if light.get("bars"):
        lamps["bars"] = {f"lamp_{i}": _bar(bar) for i, bar in enumerate(light["bars"])}
    if light["env"] > 0:
        lamps["env"] = {"lamp": {"type": "constant", "radiance": _uniform(light["env"])}}
    parts = {f"part_{i}": shape for i, shape in enumerate(shapes)}
    return [
        (
            name,
            tracer().load_dict(
                {"type": "scene", "table": _table(light, name == "glow")} | parts | lamp
            ),
        )
        for name, lamp in lamps.items()
    ]


def _uniform(value: float) -> dict[str, Any]:
    return {"type": "uniform", "value": float(value)}


def _texture(values: Array) -> dict[str, Any]:
    mi = tracer()
    return {
        "type": "bitmap",
        "bitmap": mi.Bitmap(values.astype(np.float32)[..., None]),
        "raw": True,
    }


def _table(light: Light, is_glowing: bool) -> dict[str, Any]:
    mi = tracer()
    rng = np.random.default_rng(light["table_seed"])
    cells = 1024
    blotches = np.zeros((cells, cells))
    for sigma_mm, weight in ((1.6, 0.5), (4.0, 0.7), (10.0, 1.0), (30.0, 1.0)):
        coarse = round(TABLE_MM / sigma_mm * 2)  # noise drawn at half its own width, then enlarged
        layer = cv2.GaussianBlur(rng.normal(size=(coarse, coarse)), (0, 0), 2.0)
        layer = cv2.resize(layer, (cells, cells), interpolation=cv2.INTER_CUBIC)
        blotches += weight * layer / layer.std()
    albedo = light["table"] * (
        1 + light["table_var"] * np.clip(blotches / blotches.std(), -2.5, 2.5) / 1.6
    )
    if light.get("grain", 0.0) > 0:
        albedo *= 1 + light["grain"] * _grain(cells, light["grain_deg"], rng)
    out = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().scale([TABLE_MM / 2, TABLE_MM / 2, 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": _texture(np.clip(albedo, 0.0, 1.0))},
    }
    if is_glowing:
        y, x = (np.mgrid[0:cells, 0:cells] + 0.5) / cells * TABLE_MM - TABLE_MM / 2
        middle = rng.uniform(-40.0, 40.0, 2)
        bowl = ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / 200.0**2
        glow = (
            light["glow"] * (1 - light["uneven"] * np.minimum(bowl, 3.0))
            + light["tilt_x"] * x / 158.0
        )
        out["emitter"] = {"type": "area", "radiance": _texture(np.maximum(glow, 0.05))}
    return out


def _grain(cells: int, turn_deg: float, rng: np.random.Generator) -> Array:
    """Return marks of a plane along one direction (cells, cells), of deviation 1."""
    marks = cv2.GaussianBlur(rng.normal(size=(cells, cells)), (0, 0), 40.0, sigmaY=1.0)
    turn = cv2.getRotationMatrix2D((cells / 2, cells / 2), turn_deg, 1.5)
    turned = cv2.warpAffine(marks, turn, (cells, cells), borderMode=cv2.BORDER_REFLECT)
    return np.asarray(np.clip(turned / turned.std(), -2.5, 2.5), np.float64)


def _bar(bar: dict[str, float]) -> dict[str, Any]:
    """A bar that looks at the table's middle; strength 1 from above shows white as white."""
    mi = tracer()
    az, el = np.radians(bar["az"]), np.radians(bar["el"])
    at = BAR_DISTANCE_MM * np.array([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)])
    seen = bar["long_mm"] * BAR_WIDTH_MM / (np.pi * BAR_DISTANCE_MM**2)
    T = mi.ScalarTransform4f().look_at(origin=at.tolist(), target=[0, 0, 0], up=[0, 0, 1])
    half = [bar["long_mm"] / 2, BAR_WIDTH_MM / 2, 1.0]
    return {
        "type": "rectangle",
        "to_world": T @ mi.ScalarTransform4f().scale(half),
        "bsdf": {"type": "diffuse", "reflectance": _uniform(0.0)},
        "emitter": {"type": "area", "radiance": _uniform(bar["strength"] / seen)},
    }


def _ring(light: Light) -> Mitsuba:
    """A flat ring that shines downwards; strength 1 at 525 mm shows white as white."""
    r0, r1, z = light["ring_r0"], light["ring_r1"], light["ring_z"]
    seen = r1**2 / (r1**2 + RING_Z_MM**2) - r0**2 / (r0**2 + RING_Z_MM**2)
    a = np.linspace(0.0, 2 * np.pi, 96, endpoint=False)
    rim = np.column_stack([np.cos(a), np.sin(a), np.zeros(len(a))])
    middle = np.array([light["ring_x"], light["ring_y"], z])
    points = np.concatenate([r0 * rim, r1 * rim]) + middle
    i, n = np.arange(len(a)), len(a)
    j = (i + 1) % n
    faces = np.concatenate([np.column_stack([i, j, n + j]), np.column_stack([i, n + j, n + i])])
    emitter = {"type": "area", "radiance": _uniform(light["ring"] / seen)}
    return _mesh("ring", points[faces], {"type": "diffuse", "reflectance": _uniform(0.0)}, emitter)


def _side(light: Light) -> dict[str, Any]:
    mi = tracer()
    az, el = np.radians(light["side_az"]), np.radians(light.get("side_el", 35.0))
    at = SIDE_DISTANCE_MM * np.array([np.cos(az) * np.cos(el), np.sin(az) * np.cos(el), np.sin(el)])
    strength = light["side"] * SIDE_DISTANCE_MM**2 / SIDE_RADIUS_MM**2
    T = mi.ScalarTransform4f().look_at(origin=at.tolist(), target=[0, 0, 0], up=[0, 0, 1])
    return {
        "type": "disk",
        "to_world": T @ mi.ScalarTransform4f().scale([SIDE_RADIUS_MM, SIDE_RADIUS_MM, 1.0]),
        "bsdf": {"type": "diffuse", "reflectance": _uniform(0.0)},
        "emitter": {"type": "area", "radiance": _uniform(strength)},
    }


def _body_shape(body: Body) -> Mitsuba:
    material = body.material
    across = material.get("across", 1.0)
    bsdf = {
        "type": "blendbsdf",
        "weight": material["metal"],
        "paint": {"type": "diffuse", "reflectance": _uniform(material["diffuse"])},
        "metal": {
            "type": "roughconductor",
            "distribution": "ggx",
            "alpha_u": material["alpha"],
            "alpha_v": min(material["alpha"] * across, 0.8),
            "specular_reflectance": _uniform(material["specular"]),
        },
    }
    marks = None if across == 1.0 else _along_marks(body.triangles_mm, material["marks_deg"])
    return _mesh("part", body.triangles_mm, bsdf, None, marks)


def _along_marks(triangles: Array, turn_deg: float) -> Array:
    """Return texture coordinates (3 n, 2) of triangles (n, 3, 3), by which a tool's marks run.

    Marks run along u; on every face they are the same direction of space, laid into the face.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    along = np.array([np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg)), 0.3])
    u = along - (normals @ along)[:, None] * normals
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-9)
    v = np.cross(normals, u)
    out: Array = np.stack(
        [np.einsum("nij,nj->ni", triangles, u), np.einsum("nij,nj->ni", triangles, v)], axis=2
    ).reshape(-1, 2)
    return out


def _mesh(
    name: str,
    triangles: Array,
    bsdf: dict[str, Any],
    emitter: dict[str, Any] | None,
    texture: Array | None = None,
) -> Mitsuba:
    """Return a mesh of flat triangles (n, 3, 3), with texture coordinates (3 n, 2) if given."""
    mi = tracer()
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(bsdf)
    if emitter:
        properties["emitter"] = mi.load_dict(emitter)
    properties["face_normals"] = True
    count = len(triangles)
    has_texture = texture is not None
    mesh = mi.Mesh(name, 3 * count, count, props=properties, has_vertex_texcoords=has_texture)
    values = mi.traverse(mesh)
    values["vertex_positions"] = np.ascontiguousarray(triangles, np.float32).ravel()
    if texture is not None:
        values["vertex_texcoords"] = np.ascontiguousarray(texture, np.float32).ravel()
    values["faces"] = np.arange(3 * count, dtype=np.uint32)
    values.update()
    return mesh


def write_atomically(path: Path, text: str) -> None:
    """Write so that a reader sees the old or the new file, never half of one."""
    partial = path.with_suffix(".partial")
    partial.write_text(text)
    partial.replace(path)
