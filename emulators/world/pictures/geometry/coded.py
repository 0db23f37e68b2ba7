"""A code on a part: dark squares on the plane of it that has most room, as a laser marks them."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from ...shapes import Array
from .scene import INK, MATERIALS, Surface, corner_normals, join_surfaces

_INK: Final = MATERIALS.index(INK)
LARGEST_MODULE_MM: Final = 1.5
_ROOM: Final = 0.9  # share of the largest circle on the plane that the code and its border take
_QUIET: Final = 2  # modules of border, on each side
_LIFT_MM: Final = 0.03  # of the marks above the face: a ray meets them first
_STEP_MM: Final = 0.5  # grid on which room is sought
_FLAT: Final = 1e-3  # normals and heights of one plane agree to this


def coded(surface: Surface, cells: NDArray[np.bool_]) -> Surface:
    """Return a part's surface with a code on it; without one where no plane has room.

    Parameters
    ----------
    surface : of the part
    cells : (n, n) dark modules, row by row from the top
    """
    found = _roomiest(surface)
    if found is None:
        return surface
    T, radius_mm = found
    count = len(cells)
    module_mm = min(LARGEST_MODULE_MM, np.sqrt(2.0) * _ROOM * radius_mm / (count + 2 * _QUIET))
    lines = (np.arange(count + 1) - count / 2.0) * module_mm
    x, y = np.meshgrid(lines, -lines)
    flat = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, _LIFT_MM)))
    vertices = flat @ T[:3, :3].T + T[:3, 3]
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (
        one[cells] for one in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:])
    )
    faces = np.concatenate((np.stack((a, b, c), axis=1), np.stack((a, c, d), axis=1)))
    marks = Surface(
        surface.name,
        vertices,
        faces.astype(np.int32),
        corner_normals(vertices, faces, smooth=False),
        np.full(len(faces), _INK, np.int16),
        np.full(len(faces), -1, np.int16),
    )
    return join_surfaces((surface, marks), surface.name)


def _roomiest(surface: Surface) -> tuple[Array, float] | None:
    """Return the frame of the largest circle on any plane, z outwards, and its radius [mm]."""
    corners = surface.vertices_mm[surface.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_mm2 = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(double_mm2, 1e-12)[:, None]
    heights = np.einsum("ij,ij->i", normals, corners[:, 0])
    keys = np.round(np.column_stack((normals, heights / 100.0)) / _FLAT).astype(np.int64)
    _, plane = np.unique(keys, axis=0, return_inverse=True)
    areas = np.bincount(plane.ravel(), weights=double_mm2 / 2.0)
    best: tuple[Array, float] | None = None
    for one in np.argsort(-areas):
        if best is not None and areas[one] < np.pi * best[1] ** 2:
            break  # no circle on it is as large
        mine = plane.ravel() == one
        found = _circle(corners[mine], normals[mine][0])
        if best is None or found[1] > best[1]:
            best = found
    return best if best is not None and best[1] > 2.0 * _STEP_MM else None


def _circle(corners: Array, normal: Array) -> tuple[Array, float]:
    """Return the frame of the largest circle in triangles (n, 3, 3) of one plane, its radius."""
    away = np.eye(3)[int(np.argmin(np.abs(normal)))]
    across = np.cross(away, normal)
    across /= np.linalg.norm(across)
    R = np.column_stack((across, np.cross(normal, across), normal))
    flat = corners @ R
    low = flat[..., :2].min(axis=(0, 1)) - 2 * _STEP_MM
    size = np.ceil((flat[..., :2].max(axis=(0, 1)) - low) / _STEP_MM).astype(int) + 3
    mask = np.zeros((size[1], size[0]), np.uint8)
    cells = np.round((flat[..., :2] - low) / _STEP_MM).astype(np.int32)
    for triangle in cells:
        cv2.fillConvexPoly(mask, triangle, 1)
    far = cv2.distanceTransform(mask, cv2.DIST_L2, 5)
    row, column = np.unravel_index(int(np.argmax(far)), far.shape)
    T = np.eye(4)
    T[:3, :3] = R
    middle = low + np.array((column, row)) * _STEP_MM
    T[:3, 3] = R @ np.array((*middle, flat[0, 0, 2]))
    return T, float(far[row, column]) * _STEP_MM
