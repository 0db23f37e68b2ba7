"""Removal of slits and slivers of a model's outline that are too narrow for a picture."""

from collections.abc import Sequence

import shapely
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray


def without_slits(
    loops: Sequence[FloatArray], is_hole: Sequence[bool], width_mm: float
) -> tuple[list[FloatArray], list[bool]]:
    """Return loops (n, 2) without slits and slivers narrower than a width, and which are holes.

    Closed and opened again by half the width, sharp corners kept.

    Parameters
    ----------
    loops : each (n, 2), either way round, the first point not repeated; of fewer than three points
        are left out
    is_hole : mask of the loops that are holes
    width_mm : width of the widest slit to go, in the unit of the loops
    """
    body: BaseGeometry = shapely.Polygon()
    for points, hole in sorted(zip(loops, is_hole, strict=True), key=lambda pair: pair[1]):
        if len(points) < 3:
            continue
        piece = shapely.make_valid(shapely.Polygon(points))
        body = body.difference(piece) if hole else body.union(piece)
    half = 0.5 * width_mm
    for reach in (half, -2 * half, half):
        body = shapely.buffer(body, reach, join_style="mitre", mitre_limit=2.0)
    out: list[FloatArray] = []
    holes: list[bool] = []
    for polygon in shapely.get_parts(body):
        if polygon.is_empty:
            continue
        for ring, hole in [(polygon.exterior, False), *((r, True) for r in polygon.interiors)]:
            out.append(shapely.get_coordinates(ring)[:-1])
            holes.append(hole)
    return out, holes
