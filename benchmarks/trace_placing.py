"""Where parts lie in a made-up picture: catalogue, camera, stable poses drawn, room kept between.

Words are what truth.json says of an object or the camera: millimetres, degrees, rotations.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.cad import Solid, StablePose, load_solid, stable_poses
from controller.imaging import Camera

Array = NDArray[np.float64]
Truth = dict[str, Any]

MIN_ODDS = 0.01  # of a stable pose to be drawn at all
UNKNOWN_SHARE = 0.15
GAP_MM = 4.0
RIM_PX = 3.0
MAX_TRIES = 300
DEFAULT_CAMERA: Truth = {
    "width": 1280,
    "height": 1024,
    "K": [[3475.2, 0.0, 636.8], [0.0, 3474.7, 513.9], [0.0, 0.0, 1.0]],
    "dist": [-0.075, 0.1, 3e-5, -5e-5, 0.0],
    "tilt_deg": [0.15, -0.13],  # about x, about y
    "position": [-2.1, 3.4, 859.0],
}


class NoRoomError(Exception):
    """A part fits nowhere into the picture."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part and the ways it may lie, with the odds they are drawn by."""

    solid: Solid
    poses: tuple[StablePose, ...]
    odds: Array


@dataclass(frozen=True, eq=False)
class Placed:
    """A part where it lies: truth.json's words for it, its triangles and its outline's hull."""

    words: Truth
    triangles_mm: Array
    hull_px: NDArray[np.float32]


def read_part(path: Path) -> Part:
    """Return a part with its stable poses."""
    solid = load_solid(path)
    poses = tuple(p for p in stable_poses(solid) if p.probability >= MIN_ODDS)
    odds = np.sqrt([pose.probability for pose in poses])
    return Part(solid, poses, odds / odds.sum())


def camera_words(path: Path | None) -> Truth:
    """Return the camera as truth.json has it, of another truth.json or our own."""
    if path is not None:
        words: Truth = json.loads(path.read_text())["camera"]
        return words
    words = dict(DEFAULT_CAMERA)
    a, b = np.radians(words.pop("tilt_deg"))
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    R_wc = about_x @ about_y @ np.diag([1.0, -1.0, -1.0])
    words["R_wc"] = R_wc.tolist()
    words["t_wc"] = (-R_wc @ words["position"]).tolist()
    return words


def camera_of(words: Truth) -> Camera:
    """Return the camera that truth.json describes."""
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.array(words["R_wc"]).T
    T_world_cam[:3, 3] = -T_world_cam[:3, :3] @ np.array(words["t_wc"])
    size = (words["width"], words["height"])
    return Camera(size, np.array(words["K"]), np.array(words["dist"]), T_world_cam)


def turn(words: Truth) -> Array:
    """Return the rotation (3, 3) CAD -> world of an object as truth.json has it."""
    c, s = np.cos(np.radians(words["theta_deg"])), np.sin(np.radians(words["theta_deg"]))
    R: Array = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(words["stable_pose_R"])
    return R


def drop(part: Part, is_known: bool, camera: Camera, rng: np.random.Generator) -> Placed:
    """Return the part lying anywhere on the table so that the picture shows all of it.

    Raises
    ------
    NoRoomError : it is larger than the picture
    """
    width, height = camera.size_px
    corners = camera.on_plane(np.array([[0, 0], [width, 0], [0, height], [width, height]], float))
    for _ in range(MAX_TRIES):
        pose = part.poses[rng.choice(len(part.poses), p=part.odds)]
        x, y = rng.uniform(corners[:, :2].min(axis=0), corners[:, :2].max(axis=0))
        words: Truth = {
            "part": part.solid.name,
            "known": is_known,
            "pose_id": pose.index,
            "stable_pose_R": np.round(pose.R, 9).tolist(),
            "x_mm": round(float(x), 4),
            "y_mm": round(float(y), 4),
            "theta_deg": round(float(rng.uniform(0.0, 360.0)), 4),
        }
        points = (np.asarray(part.solid.mesh.vertices) - part.solid.centroid_mm) @ turn(words).T
        words["centroid_height_mm"] = round(float(-points[:, 2].min()), 4)
        points += [words["x_mm"], words["y_mm"], -points[:, 2].min()]
        pixels = camera.project(points)
        last = np.array(camera.size_px) - 1 - RIM_PX
        if (pixels >= RIM_PX).all() and (pixels <= last).all():
            hull = cv2.convexHull(pixels.astype(np.float32))[:, 0]
            return Placed(words, points[np.asarray(part.solid.mesh.faces)], hull)
    raise NoRoomError(f"{part.solid.name}: no place found where the picture shows all of it")


def are_apart(placed: Sequence[Placed], other: Placed, camera: Camera) -> bool:
    """Whether another part keeps the gap, hull from hull, to those that lie there."""
    width, height = camera.size_px
    quarter = 4
    free = np.ones((height // quarter, width // quarter), np.uint8)
    for one in placed:
        cv2.fillConvexPoly(free, np.round(one.hull_px / quarter).astype(np.int32), 0)
    here = np.zeros_like(free)
    cv2.fillConvexPoly(here, np.round(other.hull_px / quarter).astype(np.int32), 1)
    gap_px = GAP_MM / camera.mm_per_px(np.zeros(3)) / quarter + 2  # 2: the hulls are rounded
    distance = cv2.distanceTransform(free, cv2.DIST_L2, 5)
    return bool(distance[here > 0].min() >= gap_px)


def put_down(
    known: Sequence[Part],
    unknown: Sequence[Part],
    multi: float,
    camera: Camera,
    rng: np.random.Generator,
) -> tuple[str, list[Placed]]:
    """Return the picture's kind (single, multi, unknown) and what lies on the table."""
    draw = rng.random()
    if unknown and draw < UNKNOWN_SHARE:
        return "unknown", [drop(unknown[int(rng.integers(len(unknown)))], False, camera, rng)]
    placed = [drop(known[int(rng.integers(len(known)))], True, camera, rng)]
    if draw < 1.0 - multi:
        return "single", placed
    count = int(rng.integers(2, 6))
    for _ in range(MAX_TRIES):
        if len(placed) == count:
            break
        one = drop(known[int(rng.integers(len(known)))], True, camera, rng)
        if are_apart(placed, one, camera):
            placed.append(one)
    return ("multi" if len(placed) > 1 else "single"), placed
