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

from controller.imaging import Camera, PointLamp

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

    Only the part's surroundings are sampled finely, the rest on every eighth pixel; shadows fall on
    the scene and on what is seen through it. The wall must fill the picture.
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
        triangle = self._mesh.ray.intersects_first(np.broadcast_to(eye, lines.shape), lines)
        self._coarse = _Samples(lines, triangle, eye, self._mesh, self._wall)
        self._coarse_shape = (len(v), len(u))
        is_part = (triangle >= 0) & (triangle < len(scene.part.faces))
        rows, columns = np.nonzero(is_part.reshape(self._coarse_shape))
        x0, y0 = max(8 * columns.min() - 24, 0), max(8 * rows.min() - 24, 0)
        x1, y1 = min(8 * columns.max() + 25, width), min(8 * rows.max() + 25, height)
        self._box = (int(x0), int(y0), int(x1), int(y1))
        step = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
        u = (np.arange(x0, x1)[:, None] + step).ravel()
        v = (np.arange(y0, y1)[:, None] + step).ravel()
        lines = sight_lines(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        triangle = self._mesh.ray.intersects_first(np.broadcast_to(eye, lines.shape), lines)
        self._fine = _Samples(lines, triangle, eye, self._mesh, self._wall)
        # shadows on the wall matter where it is seen through the part only
        is_mesh = self._fine.is_mesh.reshape(len(v), len(u)).astype(np.uint8)
        outlines, _ = cv2.findContours(is_mesh, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = cv2.drawContours(is_mesh.copy(), outlines, -1, 1, thickness=cv2.FILLED)
        self._fine.is_shaded = filled.ravel() > 0

    def backlit(self) -> Grey:
        """The wall glows, what stands before it is dark."""
        coarse, fine = (
            np.where(samples.is_mesh, 0.0, GLOW_GREY) for samples in (self._coarse, self._fine)
        )
        return self._expose(coarse, fine)

    def lit(self, lamp: PointLamp) -> Grey:
        """One lamp shines, as bright as `PART_GREY` on a surface square to it amid the scene."""
        middle = self._mesh.bounds.mean(axis=0)
        fine, coarse = np.zeros(len(self._fine.points)), np.zeros(len(self._coarse.points))
        for position in lamp.points_mm:
            far = float(np.linalg.norm(position - middle))
            fine += self._fine.light(position, far, self._mesh)
            coarse += self._coarse.light(position, far, None)
        each = 1 / len(lamp.points_mm)
        fine *= each * np.where(self._fine.is_mesh, PART_GREY, WALL_GREY)
        coarse *= each * np.where(self._coarse.is_mesh, PART_GREY, WALL_GREY)
        return self._expose(coarse, fine)

    def _expose(self, coarse: Array, fine: Array) -> Grey:
        width, height = self._camera.size_px
        v, u = np.mgrid[0:height, 0:width].astype(np.float32) / 8
        rough = coarse.reshape(self._coarse_shape).astype(np.float32)
        whole = cv2.remap(rough, u, v, cv2.INTER_LINEAR).astype(np.float64)
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
            lit = np.flatnonzero(self.is_shaded & (light > 0))
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
