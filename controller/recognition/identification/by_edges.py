"""Proposals from the edges of pictures under lamps, where no outline has them; P3.2."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import BoolArray, Grey
from controller.imaging import Camera

from ..grey import Edgelets, picture_edgelets, swept
from ..library import Candidate
from .scene import TableScene

PER_VIEW: Final = 3  # turns of one part in one stable pose, before others are tried
MAX_BY_EDGES: Final = 12


def by_edges(
    edges: Sequence[Edgelets], corner_px: tuple[int, int], thing: BoolArray, scene: TableScene
) -> list[Candidate]:
    """Return up to `MAX_BY_EDGES` candidates, the likeliest first, already fitted to edges.

    Parameters
    ----------
    edges : `edges_on_table` of the crops about the thing
    corner_px : (x0, y0) corner of these crops in the picture
    thing : (h, w) mask of a region, or of a piece of it
    scene : its camera, and the parts that it may be
    """
    camera, library = scene.camera, scene.library
    v, u = np.nonzero(thing)
    if len(v) == 0:
        return []
    ends_px = np.array([[u.min(), v.min()], [u.max(), v.max()]], dtype=np.float64)
    box_mm = camera.on_plane(ends_px + corner_px)[:, :2]
    found = swept(
        edges[1:] or edges,
        edges[0],
        library.edgelets,
        library.edgelet_turns_rad,
        np.sort(box_mm, axis=0),
        foot_mm=(float(camera.position_mm[0]), float(camera.position_mm[1])),
        most=PER_VIEW * MAX_BY_EDGES,
    )
    proposed: list[Candidate] = []
    of_view = np.zeros(len(library.edgelet_views), dtype=np.int64)
    for placed in found:
        of_view[placed.view] += 1
        if of_view[placed.view] > PER_VIEW or len(proposed) == MAX_BY_EDGES:
            continue
        part, pose = library.edgelet_views[placed.view]
        x, y = (float(v) for v in placed.shift_mm)
        proposed.append(
            Candidate(part, pose, placed.turn_rad, x, y, placed.score, 0.0, source="edges")
        )
    return proposed


def edges_on_table(
    crops: Sequence[Grey],
    corner_px: tuple[int, int],
    camera: Camera,
    free: BoolArray | None = None,
) -> list[Edgelets]:
    """Return the edgelets of each crop on the table, without those of other things.

    Parameters
    ----------
    crops : (h, w) grey; of several lamps the brightest of all first, then each lamp's
    corner_px : (x0, y0) corner of the crops in the picture
    camera : overhead, calibrated
    free : (h, w) mask of the area free of other things; None for all of it
    """
    every = [picture_edgelets(crop, lambda p: camera.on_plane(p + corner_px)) for crop in crops]
    return every if free is None else [_within(free, one, corner_px, camera) for one in every]


def _within(
    free: BoolArray, edges: Edgelets, corner_px: tuple[int, int], camera: Camera
) -> Edgelets:
    """Return the edgelets in a mask (h, w) of their crop."""
    on_table = np.column_stack([edges.points_mm, np.zeros(len(edges.points_mm))])
    x, y = np.round(camera.project(on_table) - corner_px).astype(np.int64).T
    height, width = free.shape
    return edges.at(free[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)])
