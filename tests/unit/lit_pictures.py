"""Pictures under lamps by a small renderer of the tests' own: Lambert and shadows.

Sight lines are undistorted here by fixed-point iteration, shading and shadows are written here
too, so that a mistake of the controller's predictor is not made twice. 2 x 2 samples to a pixel
at edges, a little stray light, then blur, noise, eight bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.imaging import Camera, PointLamp
from controller.imaging.rays import RayCaster

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Flags = NDArray[np.bool_]
Ids = NDArray[np.int32]
SAMPLES = 2  # by 2, of a pixel that sees more than one surface
NEIGHBOURS = np.ones((3, 3), np.uint8)
STEP_MM, CREASE_DEG = 0.05, 8.0  # more is another surface; facets of round ones turn by less
PART_GREY = 165.0  # a part's surface square to a lamp
WALL_GREY = 110.0
GLOW_GREY = 205.0
STRAY_GREY = 9.0


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands before a camera.

    Attributes
    ----------
    part, others : the part in the world, and what holds it
    wall_mm : (4, 3) corners of the panel or table behind, in order round it
    """

    part: trimesh.Trimesh
    others: trimesh.Trimesh | None
    wall_mm: Array


def sight_lines(camera: Camera, pixels: Array) -> Array:
    """Unit directions in the world of pixels (n, 2)."""
    K, (k1, k2, p1, p2, k3) = camera.K, camera.distortion
    u = (pixels[:, 0] - K[0, 2]) / K[0, 0]
    v = (pixels[:, 1] - K[1, 2]) / K[1, 1]
    x, y = u.copy(), v.copy()
    for _ in range(12):
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        x, y = (
            (u - 2 * p1 * x * y - p2 * (r2 + 2 * x * x)) / radial,
            (v - p1 * (r2 + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    lines = np.column_stack([x, y, np.ones_like(x)])
    lines /= np.linalg.norm(lines, axis=1)[:, None]
    return lines @ camera.T_world_cam[:3, :3].T


class Renderer:
    """One scene before one camera; the sight lines are cast once for all its lamps.

    The part's surroundings are sampled at each pixel, and finely where neighbours see another
    surface or another shadow; the rest on every eighth pixel. Shadows fall on the scene and on
    what is seen through it. The wall must fill the picture.
    """

    def __init__(self, scene: Scene, camera: Camera, seed: int = 0) -> None:
        self._camera = camera
        self._rng = np.random.default_rng(seed)
        meshes = [scene.part] + ([scene.others] if scene.others is not None else [])
        self._mesh = trimesh.util.concatenate(meshes)
        self._rays = RayCaster(self._mesh)
        self._wall = scene.wall_mm
        width, height = camera.size_px
        u, v = np.arange(0, width + 7, 8.0), np.arange(0, height + 7, 8.0)
        self._coarse_shape = (len(v), len(u))
        self._coarse = self._sampled(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        is_part = (self._coarse.triangle >= 0) & (self._coarse.triangle < len(scene.part.faces))
        rows, columns = np.nonzero(is_part.reshape(self._coarse_shape))
        x0, y0 = max(8 * columns.min() - 24, 0), max(8 * rows.min() - 24, 0)
        x1, y1 = min(8 * columns.max() + 25, width), min(8 * rows.max() + 25, height)
        self._box = (int(x0), int(y0), int(x1), int(y1))
        u, v = np.arange(x0, x1, dtype=float), np.arange(y0, y1, dtype=float)
        self._pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        self._shape = (len(v), len(u))
        self._middles = self._sampled(self._pixels)
        # shadows on the wall matter where it is seen through the part only
        is_mesh = self._middles.is_mesh.reshape(self._shape).astype(np.uint8)
        outlines, _ = cv2.findContours(is_mesh, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = cv2.drawContours(is_mesh.copy(), outlines, -1, 1, thickness=cv2.FILLED)
        self._middles.is_shaded = filled.ravel() > 0
        self._is_within = cv2.erode(filled, NEIGHBOURS).ravel() > 0
        self._fine_at = np.flatnonzero(_beside(self._middles.steps(self._shape)))
        self._fine = self._finely(self._fine_at)

    def _sampled(self, pixels: Array) -> _Samples:
        lines = sight_lines(self._camera, pixels)
        eye = self._camera.T_world_cam[:3, 3]
        triangle, _ = self._rays.first_hit(eye, lines)
        return _Samples(lines, triangle, eye, self._mesh, self._wall)

    def _finely(self, at: NDArray[np.intp]) -> _Samples:
        """Samples of some of the pixels of the part's surroundings, those of a pixel in a row."""
        step = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        steps = np.stack(np.meshgrid(step, step), axis=-1).reshape(1, -1, 2)
        found = self._sampled((self._pixels[at][:, None] + steps).reshape(-1, 2))
        found.is_shaded = found.is_mesh | np.repeat(self._is_within[at], SAMPLES**2)
        return found

    def backlit(self) -> Grey:
        """The wall glows, what stands before it is dark."""
        coarse, middles, fine = (
            np.where(samples.is_mesh, 0.0, GLOW_GREY)
            for samples in (self._coarse, self._middles, self._fine)
        )
        middles[self._fine_at] = _by_pixel(fine)
        return self._expose(coarse, middles)

    def lit(self, lamp: PointLamp) -> Grey:
        """One lamp shines, as bright as `PART_GREY` on a surface square to it amid the scene."""
        middle = self._mesh.bounds.mean(axis=0)
        near, coarse = np.zeros(len(self._pixels)), np.zeros(len(self._coarse.points))
        for position in lamp.points_mm:
            far = float(np.linalg.norm(position - middle))
            light, is_shadow = self._middles.light(position, far, self._rays)
            fine, _ = self._fine.light(position, far, self._rays)
            light[self._fine_at] = _by_pixel(fine)
            # a shadow ends here on one surface
            ends = _beside(_differ(is_shadow.reshape(self._shape)))
            ends[self._fine_at] = False
            at = np.flatnonzero(ends)
            fine, _ = self._finely(at).light(position, far, self._rays)
            light[at] = _by_pixel(fine)
            near += light
            coarse += self._coarse.light(position, far, None)[0]
        return self._expose(coarse / len(lamp.points_mm), near / len(lamp.points_mm))

    def _expose(self, coarse: Array, near: Array) -> Grey:
        width, height = self._camera.size_px
        v, u = np.mgrid[0:height, 0:width].astype(np.float32) / 8
        rough = coarse.reshape(self._coarse_shape).astype(np.float32)
        whole = cv2.remap(rough, u, v, cv2.INTER_LINEAR).astype(np.float64)
        x0, y0, x1, y1 = self._box
        whole[y0:y1, x0:x1] = near.reshape(self._shape)
        whole = cv2.GaussianBlur(whole + STRAY_GREY, (0, 0), 0.7)
        whole += self._rng.normal(0.0, 1.8, whole.shape)
        return np.asarray(np.clip(np.round(whole), 0, 255), dtype=np.uint8)


class _Samples:
    """What sight lines meet: a triangle of the scene, or the wall behind."""

    def __init__(
        self, lines: Array, triangle: Ids, eye: Array, mesh: trimesh.Trimesh, wall_mm: Array
    ) -> None:
        self.triangle = triangle
        self.is_mesh = triangle >= 0
        self.is_shaded = self.is_mesh
        a, b, _, d = wall_mm
        normal = np.cross(b - a, d - a)
        normal /= np.linalg.norm(normal)
        if normal @ (eye - a) < 0:
            normal = -normal
        self.points = eye + ((a - eye) @ normal / (lines @ normal))[:, None] * lines
        for edge in (b - a, d - a):
            share = (self.points - a) @ edge / (edge @ edge)
            assert ((share > 0) & (share < 1)).all(), "the wall must fill the picture"
        self.normals = np.tile(normal, (len(lines), 1))
        at = triangle[self.is_mesh]
        normals, corner = mesh.face_normals[at], mesh.triangles[at, 0]
        seen = lines[self.is_mesh]
        reach = _dot(corner - eye, normals) / _dot(seen, normals)
        self.points[self.is_mesh] = eye + reach[:, None] * seen
        self.normals[self.is_mesh] = normals

    def steps(self, shape: tuple[int, int]) -> tuple[Flags, Flags]:
        """Whether the right, and the lower, neighbour's point is on another surface."""
        points, normals = self.points.reshape(*shape, 3), self.normals.reshape(*shape, 3)

        def differ(p: Array, n: Array, q: Array, m: Array) -> Flags:
            is_step = np.abs(_dot(q - p, n)) > STEP_MM
            return is_step | (_dot(n, m) < np.cos(np.radians(CREASE_DEG)))

        return (
            differ(points[:, :-1], normals[:, :-1], points[:, 1:], normals[:, 1:]),
            differ(points[:-1], normals[:-1], points[1:], normals[1:]),
        )

    def light(self, position: Array, far_mm: float, rays: RayCaster | None) -> tuple[Array, Flags]:
        """The grey levels that one point of light makes, and where a mesh is in its way.

        Cosine, distance squared, and shadow.
        """
        towards = position - self.points
        distance = np.sqrt(_dot(towards, towards))
        light = _dot(towards, self.normals) / distance * (far_mm / distance) ** 2
        light = np.maximum(light, 0.0)
        is_shadow = np.zeros(len(light), bool)
        if rays is not None:
            lit = np.flatnonzero(self.is_shaded & (light > 0))
            start = self.points[lit] + 0.02 * self.normals[lit]
            is_shadow[lit] = rays.blocked(start, towards[lit])  # nothing stands behind a lamp
            light[is_shadow] = 0.0
        return light * np.where(self.is_mesh, PART_GREY, WALL_GREY), is_shadow


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.einsum("...i,...i->...", a, b))


def _by_pixel(fine: Array) -> Array:
    return np.asarray(fine.reshape(-1, SAMPLES**2).mean(axis=1))


def _differ(values: Flags) -> tuple[Flags, Flags]:
    return values[:, 1:] != values[:, :-1], values[1:] != values[:-1]


def _beside(steps: tuple[Flags, Flags]) -> Flags:
    """Pixels on both sides of steps to the right and down, and those next to them."""
    right, down = steps
    found = np.zeros((len(right), down.shape[1]), np.uint8)
    found[:, :-1] |= right
    found[:, 1:] |= right
    found[:-1] |= down
    found[1:] |= down
    return np.asarray(cv2.dilate(found, NEIGHBOURS).ravel() > 0)


def placed(mesh: trimesh.Trimesh, T: Array) -> trimesh.Trimesh:
    """A copy of a mesh in the world."""
    moved = mesh.copy()
    moved.apply_transform(T)
    return moved
