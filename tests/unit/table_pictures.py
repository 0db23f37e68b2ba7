"""Backlit pictures of the table by exact area coverage: no ray caster, nothing of the controller.

Every triangle of a part is projected with the formula of OpenCV's manual, the union of the
projections is the silhouette, and each pixel is as dark as the share of it the silhouette covers:
exact along a scan line, eight scan lines to a pixel. Then blur, noise, eight bits.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
import shapely
import trimesh
from numpy.typing import NDArray

from controller.cad import Solid
from controller.imaging import Camera

Array = NDArray[np.float64]
SIZE = (800, 640)
LINES = 8  # scan lines to a pixel


def overhead(distortion: tuple[float, ...] = (-0.08, 0.11, 2e-4, -1e-4, 0.0)) -> Camera:
    """A camera 700 mm over the table, tilted a little; 0.28 mm to a pixel."""
    K = np.array([[2500.0, 0, 401.3], [0, 2502.0, 317.8], [0, 0, 1]])
    T = np.eye(4)
    # straight down, then a quarter of a degree off
    T[:3, :3] = cv2.Rodrigues(np.array([0.004, -0.003, 0.02]))[0] @ np.diag([1.0, -1, -1])
    T[:3, 3] = 2.0, -1.5, 700.0
    return Camera(SIZE, K, np.array(distortion, float), T)


def project(camera: Camera, points: Array) -> Array:
    """Pixels (n, 2) of world points (n, 3), after the formula of OpenCV's manual."""
    R, t = camera.T_world_cam[:3, :3], camera.T_world_cam[:3, 3]
    local = (points - t) @ R
    x, y = (local[:, :2] / local[:, 2:]).T
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    K = camera.K
    return np.column_stack([K[0, 0] * u + K[0, 2], K[1, 1] * v + K[1, 2]])


def silhouette(mesh: trimesh.Trimesh, T_world_part: Array, camera: Camera) -> shapely.Geometry:
    """What a part covers in the picture plane, holes left out [px]."""
    world = mesh.vertices @ T_world_part[:3, :3].T + T_world_part[:3, 3]
    corners = project(camera, world)[mesh.faces]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    wide = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 1e-6
    # on a grid of 1e-5 px, so that neighbours share their edges exactly
    return shapely.union_all(shapely.polygons(corners[wide]), grid_size=1e-5)


def coverage(shape: shapely.Geometry, size: tuple[int, int] = SIZE) -> Array:
    """The share of every pixel that a shape covers, (height, width)."""
    width, height = size
    polygons = [shape] if shape.geom_type == "Polygon" else list(getattr(shape, "geoms", []))
    rings = [r for p in polygons if p.geom_type == "Polygon" for r in (p.exterior, *p.interiors)]
    out = np.zeros((height * LINES, width + 1))
    for ring in rings:
        points = np.asarray(ring.coords)[:, :2] + 0.5  # pixel (0, 0) spans 0..1 from here on
        for (x0, y0), (x1, y1) in pairwise(points):
            low, high, sign = (y0, y1, 1.0) if y0 < y1 else (y1, y0, -1.0)
            first = max(int(np.ceil(low * LINES - 0.5)), 0)
            last = min(int(np.ceil(high * LINES - 0.5)), height * LINES)
            if first >= last:
                continue
            rows = np.arange(first, last)
            x = x0 + ((rows + 0.5) / LINES - y0) * (x1 - x0) / (y1 - y0)
            x = np.clip(x, 0, width - 1e-9)
            column = x.astype(int)
            # right of the crossing everything counts, in its own pixel what is left of it
            share = column + 1 - x
            np.add.at(out, (rows, column), sign * share)
            np.add.at(out, (rows, column + 1), sign * (1 - share))
    filled = np.abs(np.cumsum(out, axis=1)[:, :width])
    return filled.reshape(height, LINES, width).mean(axis=1)


def picture(
    shapes: list[shapely.Geometry],
    seed: int = 0,
    blur_px: float = 0.7,
    noise: float = 1.5,
    ground: float = 210.0,
    dark: float = 18.0,
    size: tuple[int, int] = SIZE,
) -> NDArray[np.uint8]:
    """Dark objects before a light table."""
    cover = coverage(shapely.union_all(shapes), size) if shapes else np.zeros(size[::-1])
    grey = cv2.GaussianBlur(ground + (dark - ground) * cover, (0, 0), blur_px)
    grey += np.random.default_rng(seed).normal(0.0, noise, grey.shape)
    return np.asarray(np.clip(np.round(grey), 0, 255), dtype=np.uint8)


def resting(solid: Solid, R: Array, x_mm: float, y_mm: float, theta_rad: float) -> Array:
    """T_world_part of a part turned upright by R, then by theta, its centroid over (x, y)."""
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ R
    placed = (solid.mesh.vertices - solid.centroid_mm) @ turn.T
    T = np.eye(4)
    T[:3, :3] = turn
    T[:3, 3] = np.array([x_mm, y_mm, -placed[:, 2].min()]) - turn @ solid.centroid_mm
    return T
