"""Pictures of calibration boards seen by a known camera, drawn without the calibration's own code.

Each pixel is the mean of 4 x 4 points, each taken through lens and board plane to the print. Only
`Camera` is shared, whose lens is OpenCV's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from controller.calibration.camera import (
    Charuco,
    FoundBoard,
    PlacedBoard,
    Target,
    View,
    WorldFrame,
    charuco_board,
)
from controller.imaging import Camera, inverse_pose

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
_FINE = 4


@dataclass(frozen=True)
class Scene:
    """A camera over a table, and boards: (name, placed, T_world_board)."""

    camera: Camera
    boards: tuple[tuple[str, PlacedBoard, Array], ...]
    world: WorldFrame


def pose(
    x: float, y: float, z: float, turn_deg: float, lean_deg: Sequence[float] = (0, 0)
) -> Array:
    """A board turned about z, then leaned about the world's x and y."""
    T = np.eye(4)
    lean = Rotation.from_euler("xy", lean_deg, degrees=True)
    T[:3, :3] = (lean * Rotation.from_euler("z", turn_deg, degrees=True)).as_matrix()
    T[:3, 3] = x, y, z
    return T


def camera_over_table(
    size_px: tuple[int, int],
    focal_px: tuple[float, float],
    distortion: Sequence[float],
    *,
    height_mm: float = 500.0,
    lean_deg: Sequence[float] = (0.4, -0.7),
    centre_px: tuple[float, float] | None = None,
) -> Camera:
    """A camera that looks down, its x along the world's and a little askew."""
    cx, cy = centre_px or ((size_px[0] - 1) / 2 + 3.0, (size_px[1] - 1) / 2 - 2.0)
    K = np.array([[focal_px[0], 0, cx], [0, focal_px[1], cy], [0, 0, 1.0]])
    T = np.eye(4)
    down = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    T[:3, :3] = (Rotation.from_euler("xy", lean_deg, degrees=True) * down).as_matrix()
    T[:3, 3] = 4.0, -3.0, height_mm
    return Camera(size_px, K, np.array(distortion, dtype=float), T)


def chess_print(board_mm: Array, inner_corners: tuple[int, int], square_mm: float) -> Array:
    """Grey (n,) of a print at points (n, 2): first square black, white paper half a square more."""
    columns, rows = inner_corners
    s = board_mm / square_mm + 1.0  # 0 is the outer corner of the first square
    dark = (np.floor(s).astype(int).sum(axis=1) % 2) == 0
    squares = (s > 0).all(axis=1) & (s[:, 0] < columns + 1) & (s[:, 1] < rows + 1)
    paper = (s > -0.5).all(axis=1) & (s[:, 0] < columns + 1.5) & (s[:, 1] < rows + 1.5)
    return np.where(squares & dark, 18.0, np.where(paper, 215.0, 40.0))


def charuco_print(board_mm: Array, target: Charuco) -> Array:
    """Grey (n,) of OpenCV's drawing of the board, half a square of white round it."""
    fine = 40
    columns, rows = target.squares
    drawn = charuco_board(target).generateImage((columns * fine, rows * fine))
    drawn = cv2.copyMakeBorder(
        drawn, *[fine // 2] * 4, borderType=cv2.BORDER_CONSTANT, value=(255.0,)
    )
    # the drawing's first pixel row is the print's upper edge, Y runs up from the lowest inner row
    u = (board_mm[:, 0] / target.square_mm + 1.5) * fine - 0.5
    v = (rows - 0.5 - board_mm[:, 1] / target.square_mm) * fine - 0.5
    column, row = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (u > -0.5) & (v > -0.5) & (u < drawn.shape[1] - 0.5) & (v < drawn.shape[0] - 0.5)
    sampled = drawn[
        np.clip(row, 0, drawn.shape[0] - 1), np.clip(column, 0, drawn.shape[1] - 1)
    ].astype(np.float64)
    return np.where(inside, 18.0 + (215.0 - 18.0) / 255.0 * sampled, 40.0)


def picture_of(
    camera: Camera,
    T_world_board: Array,
    target: Target,
    *,
    noise: float = 1.0,
    blur_px: float = 0.5,
    seed: int = 0,
) -> Grey:
    """A picture of the board, brighter on the left."""
    width, height = camera.size_px
    in_board = Camera(
        camera.size_px,
        camera.K,
        camera.distortion,
        inverse_pose(T_world_board) @ camera.T_world_cam,
    )
    # the map from pixels to the print is smooth: it is computed on a grid and drawn fine
    u = np.arange(-8, width + 8, 4.0)
    v = np.arange(-8, height + 8, 4.0)
    grid = np.stack(np.meshgrid(u, v), axis=-1)
    on_print = in_board.on_plane(grid.reshape(-1, 2))[:, :2].reshape(*grid.shape)
    offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    fine_u = (np.arange(width)[:, None] + offsets).ravel()
    fine_v = (np.arange(height)[:, None] + offsets).ravel()
    columns, rows = np.arange(len(u)), np.arange(len(v))
    fine = np.stack(
        [
            RectBivariateSpline(rows, columns, on_print[..., k])((fine_v + 8) / 4, (fine_u + 8) / 4)
            for k in range(2)
        ],
        axis=-1,
    ).reshape(-1, 2)
    if isinstance(target, Charuco):
        grey = charuco_print(fine, target)
    else:
        grey = chess_print(fine, target.inner_corners, target.square_mm)
    picture = grey.reshape(height, _FINE, width, _FINE).mean(axis=(1, 3))
    picture *= np.linspace(1.0, 0.75, width)  # a lamp on the left
    if blur_px:
        picture = cv2.GaussianBlur(picture, (0, 0), blur_px)
    picture += np.random.default_rng(seed).normal(0.0, noise, picture.shape) if noise else 0.0
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def corners_of(target: Target) -> Array:
    """Inner corners (n, 2) [mm], row by row."""
    if isinstance(target, Charuco):
        columns, rows = target.squares[0] - 1, target.squares[1] - 1
    else:
        columns, rows = target.inner_corners
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return target.square_mm * np.column_stack([x.ravel(), y.ravel()]).astype(float)


def true_pixels(camera: Camera, T_world_board: Array, board_mm: Array) -> Array:
    """Where corners are in the picture, (n, 2)."""
    flat = np.column_stack([board_mm, np.zeros(len(board_mm))])
    return camera.project(flat @ T_world_board[:3, :3].T + T_world_board[:3, 3])


def noisy_views(
    scene: Scene, target: Target, noise_px: float, rng: np.random.Generator
) -> list[View]:
    """What a corner finder with white noise would find; corners out of the picture are not."""
    views = []
    for name, placed, T in scene.boards:
        board_mm = corners_of(target)
        pixels = true_pixels(scene.camera, T, board_mm)
        inside = ((pixels > 2) & (pixels < np.array(scene.camera.size_px) - 3)).all(axis=1)
        noisy = pixels + rng.normal(0.0, noise_px, pixels.shape)
        found = FoundBoard(board_mm[inside], noisy[inside], 20.0, 0.5)
        views.append(View(name, placed, found))
    return views
