"""Whether the tracer shows things where they are: outlines against the camera model, sub-pixel.

    python benchmarks/trace_held_check.py

A ball and a thin plate before the panel, by a camera with strong distortion. Where the picture
is half bright across the outline is compared with where the camera's formulas (OpenCV's, not the
tracer's) project the ball's circle of tangency and the plate's straight edges.
"""

from __future__ import annotations

import sys

import cv2
import numpy as np
import trimesh
from bench import Arguments, leave_out, show
from numpy.typing import NDArray
from trace_held_light import Sight, Thing, trace_view
from trace_held_parts import rod, triangles_of
from trace_scene import NoTracerError

from controller.imaging import Camera

Array = NDArray[np.float64]

MAX_BIAS_PX = 0.01  # of the mean over an outline
MAX_SPREAD_PX = 0.08  # of one crossing, 49 rays a pixel
STATION = {"uneven": 0.0, "tilt": 0.0, "panel_mm": [460.0, 380.0], "panel_albedo": 0.3}


def a_sight() -> Sight:
    K = np.array([[3600.0, 0, 650], [0, 3590.0, 500], [0, 0, 1]])
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, :3] = cv2.Rodrigues(np.array([0.02, -0.015, 0.1]))[0] @ T[:3, :3]
    T[:3, 3] = [3.0, -2.0, 900.0]
    return Sight((1280, 1024), K, np.array([-0.09, 0.1, 2e-4, -3e-4, 0.02]), T)


def crossings_px(picture: Array, outline_px: Array) -> Array:
    """Return by how much (n,) the half-bright place lies outside a closed outline (n, 2)."""
    ahead = np.roll(outline_px, -1, axis=0) - np.roll(outline_px, 1, axis=0)
    out = ahead[:, ::-1] * [1.0, -1.0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    if ((outline_px - outline_px.mean(axis=0)) * out).sum() < 0:
        out = -out
    reach = np.arange(-4.0, 4.01, 0.05)
    where = outline_px[:, None] + reach[:, None] * out[:, None]
    u, v = np.moveaxis(where.astype(np.float32), 2, 0)
    soft = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), 0.7)
    grey = cv2.remap(soft, u, v, cv2.INTER_CUBIC)
    return np.array([np.interp(0.5 * (g[:8].mean() + g[-8:].mean()), g, reach) for g in grey])


def ball_outline_mm(eye: Array, centre: Array, radius: float, count: int = 400) -> Array:
    """Return the circle (n, 3) in which sight lines touch a ball."""
    axis = eye - centre
    away = float(np.linalg.norm(axis))
    axis /= away
    middle = centre + radius**2 / away * axis
    round_mm = radius * np.sqrt(1 - (radius / away) ** 2)
    x = np.cross(axis, [1.0, 0, 0])
    x /= np.linalg.norm(x)
    a = np.linspace(0, 2 * np.pi, count, endpoint=False)
    out: Array = middle + round_mm * (
        np.cos(a)[:, None] * x + np.sin(a)[:, None] * np.cross(axis, x)
    )
    return out


def check() -> dict[str, tuple[float, float]]:
    """Return mean and spread of the crossings, by body [px]."""
    from trace_held import plain_look

    sight = a_sight()
    camera = Camera(sight.size_px, sight.K, sight.distortion, sight.T_world_cam)
    black = plain_look(metal=0.0, alpha=0.3, specular=0.0, diffuse=0.0)
    out = {}
    for name in ("ball", "plate", "disk"):
        T = np.eye(4)
        T[:3, 3] = {"ball": [45.0, -30.0, 210.0], "plate": [-30.0, 25.0, 190.0],
                    "disk": [10.0, 40.0, 220.0]}[name]  # fmt: skip
        T[:3, :3] = cv2.Rodrigues(np.array([0.3, -0.2, 0.5]))[0]
        if name == "ball":
            triangles = trimesh.creation.icosphere(6, 22.0).triangles
            outline = ball_outline_mm(camera.position_mm, T[:3, 3], 22.0)
        elif name == "plate":
            triangles = trimesh.creation.box((50.0, 36.0, 2e-3)).triangles
            s = np.linspace(0.04, 0.96, 60)[:, None]
            corners = np.array([[-25, -18, 0], [25, -18, 0], [25, 18, 0], [-25, 18, 0.0]])
            sides = [a + s * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
            outline = np.vstack(sides) @ T[:3, :3].T + T[:3, 3]
        else:
            ends = np.array([0, 0, -1e-3]), np.array([0, 0, 1e-3])
            triangles = triangles_of(rod(*ends, 30.0, 0.0005))
            a = np.linspace(0, 2 * np.pi, 300, endpoint=False)
            circle = 15.0 * np.column_stack([np.cos(a), np.sin(a), 0 * a])
            outline = circle @ T[:3, :3].T + T[:3, 3]
        seen = trace_view(sight, [Thing(triangles, T, black)], STATION, ["backlight"], 7)
        off = crossings_px(seen.radiance["backlight"].astype(float), camera.project(outline))
        if name == "plate":  # at a side's end the neighbours are of another side
            off = np.delete(off, [i for k in range(4) for i in (60 * k, 60 * k + 59)])
        out[name] = float(off.mean()), float(off.std())
    return out


def main() -> int:
    args = Arguments(__doc__).parse_args()
    try:
        found = check()
    except NoTracerError as error:
        leave_out(str(error))
    rows = [
        {"outline": name, "off px": mean, "spread px": spread}
        for name, (mean, spread) in found.items()
    ]
    show(args, rows, {"asked": {"off px": MAX_BIAS_PX, "spread px": MAX_SPREAD_PX}})
    good = [abs(off) <= MAX_BIAS_PX and spread <= MAX_SPREAD_PX for off, spread in found.values()]
    return int(not all(good))


if __name__ == "__main__":
    sys.exit(main())
