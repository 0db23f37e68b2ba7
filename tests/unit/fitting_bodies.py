"""Bodies, poses and outlines that the tests of fitting, library and decision share."""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely
from cad_solids import Body, box, prism, rod, solid_of
from numpy.typing import NDArray

from controller.cad import LineView, Solid, outline
from controller.imaging import Camera, transform
from controller.recognition.fitting import EdgeModel, edge_model

Array = NDArray[np.float64]
ELBOW = [(0.0, 0.0), (60.0, 0.0), (60.0, 18.0), (22.0, 18.0), (22.0, 42.0), (0.0, 42.0)]


def body(name: str) -> Body:
    made = {
        "block": lambda: box(50, 30, 20),
        "elbow": lambda: prism(ELBOW, 8) - rod(4, 40, 48).translate((45, 9, 0)),
        "plate": lambda: box(60, 40, 10) - rod(6, 40, 48).translate((18, 8, 0)),
        "pocket": lambda: box(60, 40, 12) - box(24, 16, 16).translate((12, 5, 6)),
        "nut": lambda: rod(18, 12, 6) - rod(6, 40, 48),
        "stepped": lambda: rod(22, 8, 64) + rod(12, 40, 64).translate((0, 0, 15)),
        "hand": lambda: (
            prism([(0, 0), (50, 0), (50, 12), (20, 20), (20, 36), (0, 36)], 6)
            + box(8, 8, 40).translate((10, 18, 20))
        ),
        "disc": lambda: rod(20, 10, 128),
        "square_bar": lambda: box(20, 20, 70),
        "roof": lambda: (
            prism([(0, 0), (50, 0), (14, 14)], 36).rotate((90, 0, 0)).translate((-25, 18, 0))
        ),
        "wedge": lambda: prism([(0, 0), (56, 0), (56, 6), (0, 30)], 34),
    }
    return made[name]()


@cache
def solid(name: str) -> Solid:
    return solid_of(body(name), name)


@cache
def model(name: str) -> EdgeModel:
    return edge_model(solid(name))


def about_z(angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def anywhere(seed: int) -> Array:
    """A rotation drawn evenly from all."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return np.asarray(q * np.sign(np.linalg.det(q)))


def dense(points: Array, step_px: float) -> Array:
    """A closed polygon in about even steps, its own corners left out."""
    ring = shapely.LinearRing(points)
    count = max(8, int(ring.length / step_px))
    at = (np.arange(count) + 0.5) * ring.length / count
    return np.asarray(shapely.get_coordinates(shapely.line_interpolate_point(ring, at)))


def seen_loops(
    name: str, T_world_part: Array, camera: Camera, step_px: float = 0.7
) -> tuple[Array, ...]:
    """A posed part's outline as a picture would give it: dense loops [px]."""
    return tuple(dense(loop.points, step_px) for loop in outline_of(name, T_world_part, camera))


def outline_of(name: str, T_world_part: Array, camera: Camera) -> tuple:  # type: ignore[type-arg]
    return outline(solid(name), T_world_part, camera).loops


def area_of(view: LineView) -> shapely.Geometry:
    """What a drawing covers, holes left out."""
    outer = [shapely.Polygon(loop.points) for loop in view.loops if not loop.is_hole]
    holes = [shapely.Polygon(loop.points) for loop in view.loops if loop.is_hole]
    return shapely.difference(shapely.union_all(outer), shapely.union_all(holes))


def motion(name: str, T_found: Array, T_true: Array) -> Array:
    """x, y [mm] and turn about z [rad] from the true pose's centre of mass to the found one's."""
    centre = solid(name).centroid_mm[None]
    away = transform(T_found, centre)[0] - transform(T_true, centre)[0]
    turn = T_found[:3, :3] @ T_true[:3, :3].T
    angle = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    return np.array([away[0], away[1], angle])


def disturbed(name: str, T: Array, x_mm: float, y_mm: float, turn_rad: float) -> Array:
    """A pose moved, and turned about the vertical through its centre of mass."""
    centre = transform(T, solid(name).centroid_mm[None])[0]
    step = np.eye(4)
    step[:3, :3] = about_z(turn_rad)
    step[:3, 3] = centre + np.array([x_mm, y_mm, 0.0]) - step[:3, :3] @ centre
    return np.asarray(step @ T)
