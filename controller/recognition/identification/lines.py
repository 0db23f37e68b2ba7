"""Proposals from lines, corners and circles of a picture; references.md P3.2."""

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging import Camera

from ..grey import Edgelets, image_features, propose, swept
from ..library import Candidate, Library

PER_VIEW = 3  # turns of one part in one stable pose, before others are tried


def by_lines(
    crop: Grey, corner_px: tuple[int, int], camera: Camera, library: Library, most: int
) -> list[Candidate]:
    """Return the candidates proposed by the grey levels of a crop, the likeliest first.

    Parameters
    ----------
    crop : (h, w) grey
    corner_px : (x0, y0) corner of the crop in the picture
    camera : overhead, calibrated
    library : library of the possible parts
    most : largest number of proposals
    """
    corner = np.array(corner_px, dtype=np.float64)
    features = image_features(crop, lambda p: camera.on_plane(p + corner)[:, :2])
    foot = (float(camera.position_mm[0]), float(camera.position_mm[1]))
    proposed = []
    for h in propose(features, library.grey_index, foot_mm=foot, most=most):
        part, pose = library.grey_views[h.model_index]
        x, y = (float(v) for v in h.shift_mm)
        proposed.append(Candidate(part, pose, h.turn_rad, x, y, h.score, 0.0))
    return proposed


def by_sweep(
    crops: Sequence[Grey],
    corner_px: tuple[int, int],
    thing: BoolArray,
    free: BoolArray,
    camera: Camera,
    library: Library,
    most: int,
) -> list[Candidate]:
    """Return the candidates proposed by edges alone, without an outline, the likeliest first.

    Parameters
    ----------
    crops : (h, w) grey, of several lamps: the brightest of all first, then each lamp's
    corner_px : (x0, y0) corner of the crops in the picture
    thing : (h, w) mask of a region, or of a piece of it
    free : (h, w) mask of the area free of other things
    camera : overhead, calibrated
    library : library of the possible parts
    most : largest number of proposals
    """
    corner = np.array(corner_px, dtype=np.float64)
    clear, *shown = (_edgelets(crop, corner, free, camera) for crop in crops)
    v, u = np.nonzero(thing)
    edge_px = np.array([[u.min(), v.min()], [u.max(), v.max()]], dtype=np.float64)
    box = camera.on_plane(edge_px + corner)[:, :2]
    foot = (float(camera.position_mm[0]), float(camera.position_mm[1]))
    proposed: list[Candidate] = []
    found = swept(
        shown,
        clear,
        library.grey_index,
        library.grey_turns_rad,
        np.sort(box, axis=0),
        foot_mm=foot,
        most=PER_VIEW * most,
    )
    of_view = np.zeros(len(library.grey_views), dtype=np.int64)
    for h in found:
        of_view[h.model_index] += 1
        if of_view[h.model_index] > PER_VIEW or len(proposed) == most:
            continue
        part, pose = library.grey_views[h.model_index]
        x, y = (float(v) for v in h.shift_mm)
        proposed.append(Candidate(part, pose, h.turn_rad, x, y, h.score, 0.0))
    return proposed


def _edgelets(crop: Grey, corner: FloatArray, free: BoolArray, camera: Camera) -> Edgelets:
    """Return the edges of a crop on the table, without those of other things."""
    found = image_features(crop, lambda p: camera.on_plane(p + corner)[:, :2]).edgelets
    count = len(found.points_mm)
    pixels = camera.project(np.column_stack([found.points_mm, np.zeros(count)])) - corner
    height, width = free.shape
    x = np.clip(np.round(pixels[:, 0]).astype(np.int64), 0, width - 1)
    y = np.clip(np.round(pixels[:, 1]).astype(np.int64), 0, height - 1)
    own = free[y, x]
    return Edgelets(
        found.points_mm[own],
        found.directions_rad[own],
        found.lengths_mm[own],
        found.strengths[own],
        found.bends_rad[own],
    )
