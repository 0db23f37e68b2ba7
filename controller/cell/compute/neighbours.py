"""What else is on the table, as planning needs it: the triangles of known parts, columns of others.

Of an unknown object only its outline in the picture is known. It is taken for a column that holds
all it can be: over the box round its outline, seen on the table and at the column's top, and as
high as any part the cell handles (ADR 66).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.cell.journal.rows import SightingFields
from controller.imaging import Camera
from controller.planning.geometry import PartShape, PlacedShape
from controller.planning.model import CellLayout

from .job import Context

UNKNOWN_HEIGHT_MM: Final = 120.0


def layout_among(known: Context, others: Sequence[SightingFields]) -> CellLayout:
    """Return the cell with other objects on the table.

    Parameters
    ----------
    known : recipe, cell and parts
    others : what was seen beside the part; each is there as everything that it may be
    """
    if not others:
        return known.layout
    placed = [shape for one in others for shape in _placed(known, one)]
    return replace(known.layout, neighbours=tuple(placed))


def _placed(known: Context, seen: SightingFields) -> list[PlacedShape]:
    readings = [(seen.part, seen.T_world_part)]
    readings += [(other.part, other.T_world_part) for other in seen.ambiguous_with]
    found = []
    for name, T_world_part in readings:
        shape = None if name is None else _shape(known, name)
        if shape is None or T_world_part is None:
            return [_column(known.overhead, seen.box_px)]
        found.append(PlacedShape(shape, np.array(T_world_part)))
    return found


@lru_cache(maxsize=32)
def _shape(known: Context, name: str) -> PartShape | None:
    """Return the triangles of a part of the recipe, None where it has no such part."""
    for number, entry in enumerate(known.library.entries):
        if entry.name == name:
            return PartShape.of(known.library.solid(number))
    return None


def _column(camera: Camera, box_px: tuple[int, int, int, int]) -> PlacedShape:
    x0, y0, x1, y1 = box_px
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64)
    heights = (0.0, UNKNOWN_HEIGHT_MM)
    points = np.vstack([camera.on_plane(corners, height)[:, :2] for height in heights])
    low, high = points.min(axis=0), points.max(axis=0)
    half: FloatArray = np.append((high - low) / 2, UNKNOWN_HEIGHT_MM / 2)
    T = np.eye(4)
    T[:3, 3] = np.append((low + high) / 2, UNKNOWN_HEIGHT_MM / 2)
    return PlacedShape(_block(tuple(half.tolist())), T)


@lru_cache(maxsize=32)
def _block(half_mm: tuple[float, float, float]) -> PartShape:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [side for a, b, c, d in quads for side in ((a, b, c), (a, c, d))]
    return PartShape(signs * half_mm, np.array(faces))
