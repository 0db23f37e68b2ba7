"""The surroundings of a part for planning: triangles of known parts, columns of others.

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
from controller.cell.custody import Around, next_nest
from controller.cell.journal.rows import SightingFields, StoredFields
from controller.imaging import Camera
from controller.planning.geometry import PartShape, PlacedShape
from controller.planning.model import CellLayout, Tray

from .job import Context

UNKNOWN_HEIGHT_MM: Final = 120.0


def layout_among(known: Context, around: Around) -> CellLayout:
    """Return the cell with other objects in it, and the next part's nests.

    Parameters
    ----------
    known : recipe, cell and parts
    around : other objects in the cell
    """
    layout = known.layout
    if around.neighbours:
        placed = [shape for one in around.neighbours for shape in _placed(known, one)]
        layout = replace(layout, neighbours=tuple(placed))
    if around.stored:
        trays = {name: _next(tray, name, around.stored) for name, tray in layout.trays.items()}
        in_trays = tuple(_in_nest(known, layout, one) for one in around.stored)
        layout = replace(layout, trays=trays, stored=in_trays)
    return layout


def _next(tray: Tray, name: str, stored: Sequence[StoredFields]) -> Tray:
    """Return a tray with its first free nest next; a full one with its last, as the run does."""
    free = next_nest(stored, name, len(tray.nests))
    return replace(tray, next_nest=len(tray.nests) - 1 if free is None else free)


def _in_nest(known: Context, layout: CellLayout, one: StoredFields) -> PlacedShape:
    """Return a part in its nest; one that this recipe does not know fills the nest."""
    shape = _shape(known, one.part)
    if shape is not None:
        return PlacedShape(shape, np.array(one.T_world_part))
    tray = layout.trays[one.tray]
    nest = tray.nests[min(one.nest, len(tray.nests) - 1)]
    half = (nest.size_mm[0] / 2, nest.size_mm[1] / 2, UNKNOWN_HEIGHT_MM / 2)
    T = np.eye(4)
    T[:3, 3] = *nest.centre_mm, UNKNOWN_HEIGHT_MM / 2
    return PlacedShape(_block(half), T)


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
    """Return the triangles of a part of the recipe; None if the recipe has no part of that name."""
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
