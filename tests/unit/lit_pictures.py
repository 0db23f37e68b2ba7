"""Pictures under lamps by a small renderer of the tests' own: trimesh's rays, Lambert, shadows.

Sight lines are undistorted here by fixed-point iteration, shading and shadows are written here
too, so that a mistake of the controller's predictor is not made twice. 2 x 2 samples to a pixel,
a little stray light, then blur, noise, eight bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.cad import Camera, PointLamp

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
SAMPLES = 2
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

    Only the rectangle round the scene is sampled finely; beside it the wall is smooth, and must
    fill the picture.
    """

    def __init__(self, scene: Scene, camera: Camera, seed: int = 0) -> None:
        self._camera = camera
        self._rng = np.random.default_rng(seed)
        meshes = [scene.part] + ([scene.others] if scene.others is not None else [])
        self._mesh = trimesh.util.concatenate(meshes)
        self._wall = scene.wall_mm
        width, height = camera.size_px
        u, v = np.arange(0, width + 7, 8.0), np.arange(0, height + 7, 8.0)
        lines = sight_lines(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        eye = camera.T_world_cam[:3, 3]
        hit = self._mesh.ray.intersects_first(np.broadcast_to(eye, lines.shape), lines) >= 0
        rows, columns = np.nonzero(hit.reshape(len(v), len(u)))
        self._coarse = _Samples(lines, np.full(len(lines), -1), eye, self._mesh, self._wall)
        self._coarse_shape = (len(v), len(u))
        x0, y0 = max(8 * columns.min() - 16, 0), max(8 * rows.min() - 16, 0)
        x1, y1 = min(8 * columns.max() + 17, width), min(8 * rows.max() + 17, height)
        self._box = (int(x0), int(y0), int(x1), int(y1))
        step = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        u = (np.arange(x0, x1)[:, None] + step).ravel()
        v = (np.arange(y0, y1)[:, None] + step).ravel()
        lines = sight_lines(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        triangle = self._mesh.ray.intersects_first(np.broadcast_to(eye, lines.shape), lines)
        self._fine = _Samples(lines, triangle, eye, self._mesh, self._wall)

    def backlit(self, level: float = 1.0) -> Grey:
        """The wall glows, what stands before it is dark."""
        glow = level * GLOW_GREY
        return self._expose(
            np.full(self._coarse_shape, glow), np.where(self._fine.is_mesh, 0.0, glow)
        )

    def lit(self, lamp: PointLamp, level: float = 1.0) -> Grey:
        """One lamp shines, as bright as `PART_GREY` on a surface square to it amid the scene."""
        middle = self._mesh.bounds.mean(axis=0)
        fine, coarse = np.zeros(len(self._fine.points)), np.zeros(len(self._coarse.points))
        for position in lamp.points_mm:
            far = float(np.linalg.norm(position - middle))
            fine += self._fine.light(position, far, self._mesh)
            coarse += self._coarse.light(position, far, None)
        fine *= level / len(lamp.points_mm) * np.where(self._fine.is_mesh, PART_GREY, WALL_GREY)
        coarse *= level / len(lamp.points_mm) * WALL_GREY
        return self._expose(coarse.reshape(self._coarse_shape), fine)

    def _expose(self, coarse: Array, fine: Array) -> Grey:
        width, height = self._camera.size_px
        v, u = np.mgrid[0:height, 0:width].astype(np.float32) / 8
        whole = cv2.remap(coarse.astype(np.float32), u, v, cv2.INTER_LINEAR).astype(np.float64)
        x0, y0, x1, y1 = self._box
        block = fine.reshape(y1 - y0, SAMPLES, x1 - x0, SAMPLES).mean(axis=(1, 3))
        whole[y0:y1, x0:x1] = block
        whole = cv2.GaussianBlur(whole + STRAY_GREY, (0, 0), 0.7)
        whole += self._rng.normal(0.0, 1.8, whole.shape)
        return np.asarray(np.clip(np.round(whole), 0, 255), dtype=np.uint8)


class _Samples:
    """What sight lines meet: a triangle of the scene, or the wall behind."""

    def __init__(
        self, lines: Array, triangle: Array, eye: Array, mesh: trimesh.Trimesh, wall_mm: Array
    ) -> None:
        self.is_mesh = triangle >= 0
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
        reach = ((corner - eye) * normals).sum(axis=1) / (seen * normals).sum(axis=1)
        self.points[self.is_mesh] = eye + reach[:, None] * seen
        self.normals[self.is_mesh] = normals

    def light(self, position: Array, far_mm: float, mesh: trimesh.Trimesh | None) -> Array:
        """Cosine, distance squared, and shadow of a mesh: of one point of light."""
        towards = position - self.points
        distance = np.sqrt((towards * towards).sum(axis=1))
        light = (towards * self.normals).sum(axis=1) / distance * (far_mm / distance) ** 2
        light = np.maximum(light, 0.0)
        if mesh is not None:
            lit = np.flatnonzero(light)
            start = self.points[lit] + 0.02 * self.normals[lit]
            hit = mesh.ray.intersects_first(start, towards[lit])
            struck = hit >= 0
            normals, corner = mesh.face_normals[hit[struck]], mesh.triangles[hit[struck], 0]
            reach = ((corner - start[struck]) * normals).sum(axis=1)
            reach /= (towards[lit][struck] * normals).sum(axis=1)
            light[lit[struck][reach < 1.0]] = 0.0  # before the lamp, not behind it
        return light


def placed(mesh: trimesh.Trimesh, T: Array) -> trimesh.Trimesh:
    """A copy of a mesh in the world."""
    moved = mesh.copy()
    moved.apply_transform(T)
    return moved
