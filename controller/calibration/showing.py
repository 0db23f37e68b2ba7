"""Configurations in which the arm shows a held board to a camera, free of contact.

Poses of the board are drawn over the camera's view of a region, facing it within a tilt; each is
tried with all configurations of the arm.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, inverse_pose
from controller.planning.model import CellLayout
from controller.planning.motion import Scene, inverse_rows

TILT_RAD: Final = float(np.radians(40.0))
PER_POSE: Final = 2  # configurations of one pose: both elbows, where there are two
_CHUNK: Final = 512


@dataclass(frozen=True, slots=True)
class ShowingRegion:
    """Where a board is to be shown: distances from the camera along its axis [mm]."""

    near_mm: float
    far_mm: float


def showing(
    layout: CellLayout,
    scene: Scene,
    camera: Camera,
    T_tcp_board: FloatArray,
    middle_mm: FloatArray,
    region: ShowingRegion,
    count: int,
    rng: np.random.Generator,
    *,
    margin_mm: float,
) -> FloatArray:
    """Return configurations (n, 6) that show a board to a camera, n up to ``count``.

    Parameters
    ----------
    layout : the cell
    scene : with the board in the gripper
    camera : camera that must see it
    T_tcp_board : (4, 4) pose of the printed pattern in the gripper, its z out of the print
    middle_mm : (2,) middle of the pattern in its own frame
    region : distance range from the camera
    count : enough of them
    rng : draws the poses
    margin_mm : distance to keep from everything
    """
    found: list[FloatArray] = []
    total = 0
    T_board_tcp = inverse_pose(T_tcp_board)
    for _ in range(40):
        T_world_board = _facing(camera, middle_mm, region, _CHUNK, rng)
        index, _, q = inverse_rows(layout, T_world_board @ T_board_tcp)
        if not len(q):
            continue
        order = rng.permutation(len(q))
        taken: dict[int, int] = {}
        rows = []
        for k in order:
            of = int(index[k])
            if taken.get(of, 0) < PER_POSE:
                taken[of] = taken.get(of, 0) + 1
                rows.append(k)
        q = q[rows]
        q = q[scene.free(q, margin_mm)]
        found.append(q)
        total += len(q)
        if total >= count:
            break
    return np.concatenate(found)[:count] if found else np.zeros((0, 6))


def _facing(
    camera: Camera,
    middle_mm: FloatArray,
    region: ShowingRegion,
    count: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Return poses (count, 4, 4) of a board in the world, its middle in the camera's picture."""
    width, height = camera.size_px
    # somewhat inside the border, since the board is no point
    u = rng.uniform(0.2, 0.8, count) * width
    v = rng.uniform(0.2, 0.8, count) * height
    depth = rng.uniform(region.near_mm, region.far_mm, count)
    K = camera.K
    p_cam = np.stack([(u - K[0, 2]) / K[0, 0] * depth, (v - K[1, 2]) / K[1, 1] * depth, depth], 1)
    p_world = p_cam @ camera.T_world_cam[:3, :3].T + camera.T_world_cam[:3, 3]
    to_eye = camera.position_mm - p_world
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    away = rng.standard_normal((count, 3))
    away -= to_eye * np.sum(away * to_eye, axis=1, keepdims=True)
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    tilt = TILT_RAD * np.sqrt(rng.uniform(0.0, 1.0, (count, 1)))
    z = np.cos(tilt) * to_eye + np.sin(tilt) * away
    x = rng.standard_normal((count, 3))
    x -= z * np.sum(x * z, axis=1, keepdims=True)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    T = np.zeros((count, 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, :3] = np.stack([x, np.cross(z, x), z], axis=2)
    T[:, :3, 3] = p_world - T[:, :3, 0] * middle_mm[0] - T[:, :3, 1] * middle_mm[1]
    return T
