"""Surfaces with a print: every dark or bright rectangle is a pair of triangles of its own.

So a print is as sharp in a picture as the edge of a part, and needs no special code.
"""

from typing import Final

import numpy as np

from ...boards import Board, Print
from ...poses import transform
from ...shapes import Array
from .scene import INK, MATERIALS, PAPER, Faces, Surface, corner_normals

_PAPER: Final = MATERIALS.index(PAPER)
_INK: Final = MATERIALS.index(INK)


def board_surface(name: str, board: Board) -> Surface:
    """Return the visible surface of a board.

    Parameters
    ----------
    name : name of the pose that moves it
    board : its plate and its prints
    """
    front_mm, front_faces, front_ink = _grid(board.front)
    back_mm, back_faces, back_ink = _grid(board.back)
    sides_mm, sides_faces = _sides(board.low_mm, board.high_mm)
    vertices = np.vstack((front_mm, transform(board.T_board_back, back_mm), sides_mm))
    starts = (0, len(front_mm), len(front_mm) + len(back_mm))
    pieces = (front_faces, back_faces, sides_faces)
    faces = np.vstack([piece + start for piece, start in zip(pieces, starts, strict=True)])
    is_ink = np.concatenate((front_ink, back_ink, np.zeros(len(sides_faces), dtype=bool)))
    return Surface(
        name,
        vertices,
        faces.astype(np.int32),
        corner_normals(vertices, faces, smooth=False),
        np.where(is_ink, _INK, _PAPER).astype(np.int16),
        np.full(len(faces), -1, np.int16),
    )


def _grid(face: Print) -> tuple[Array, Faces, Array]:
    """Return corners (n, 3), triangles (m, 3) and which of them are dark, (m,)."""
    y, x = np.meshgrid(face.y_mm, face.x_mm, indexing="ij")
    corners = np.column_stack((x.ravel(), y.ravel(), np.zeros(x.size)))
    number = np.arange(x.size).reshape(x.shape)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    faces = np.stack((a, b, c, a, c, d), axis=1).reshape(-1, 3).astype(np.int32)
    return corners, faces, np.repeat(face.is_dark.ravel(), 2)


def _sides(low: Array, high: Array) -> tuple[Array, Faces]:
    """Return the plate's four narrow sides, outwards."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    around = np.array(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
    lower = np.column_stack((around, np.full(4, z0)))
    upper = np.column_stack((around, np.full(4, z1)))
    faces = []
    for i in range(4):
        j = (i + 1) % 4
        faces += [(i, j, 4 + j), (i, 4 + j, 4 + i)]
    return np.vstack((lower, upper)), np.array(faces, dtype=np.int32)
