"""Stretches of outlines: short ones stay the same if the rest of the outline changes.

A stretch is so many points at equal steps about an anchor, turned so that it runs along the first
axis. Of views only the stretches that bend most are kept, of a picture all of them are tried;
straight ones fit everywhere and are left out. That is the paper's correlation of strings from
corners of like turn (references.md P3.1), for outlines of which the perimeter is not known.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, Float32Array, FloatArray, IntArray

STRETCHES_MM = (16.0, 40.0)
POINTS = 13  # points of a stretch
BEND = 0.025  # rms distance of a stretch's points from a straight line, as a share of its length
ANCHORS = 12  # anchors of a view
TRIED_ANCHORS = 48
MIN_PERIMETER = 1.4  # least perimeter of a view, in lengths of the stretch
BLOCK = 2000  # views processed at a time
# Stretches of views compared with one of a picture, the most alike: a right angle is in every view.
MAX_ALIKE = 100


@dataclass(frozen=True, eq=False, slots=True)
class Stretches:
    """Stretches of one length.

    Attributes
    ----------
    shape : (n, 2 POINTS) coordinates about the middle along and across, so that the distance of
        two rows is the root mean square distance of their points [mm]
    middle : (n,) mean of the points as complex numbers
    direction : (n,) unit complex numbers, along
    owner : (n,) view, or loop, it is of
    """

    shape: Float32Array
    middle: NDArray[np.complex128]
    direction: NDArray[np.complex128]
    owner: IntArray


@dataclass(frozen=True, eq=False, slots=True)
class ViewStretches:
    """Stretches of one length of all views of a library, searchable by shape."""

    stretches: Stretches
    tree: cKDTree


def view_stretches(outer_mm: NDArray[np.float16]) -> tuple[ViewStretches, ...]:
    """Return the stretches of views by their lengths, as `STRETCHES_MM`.

    Parameters
    ----------
    outer_mm : (n, samples, 2) outer borders of the views, nan for none
    """
    every = [_of_views(outer_mm, length) for length in STRETCHES_MM]
    return tuple(ViewStretches(one, cKDTree(one.shape, balanced_tree=False)) for one in every)


def _of_views(outer_mm: NDArray[np.float16], length_mm: float) -> Stretches:
    found = []
    for begin in range(0, len(outer_mm), BLOCK):
        block = outer_mm[begin : begin + BLOCK].astype(np.float64)
        z = block[..., 0] + 1j * block[..., 1]
        perimeter = np.abs(np.roll(z, -1, axis=1) - z).sum(axis=1)
        rows = np.flatnonzero(perimeter > MIN_PERIMETER * length_mm)  # false for nan
        if len(rows) == 0:
            continue
        z, step = z[rows], perimeter[rows] / z.shape[1]
        anchor = np.arange(TRIED_ANCHORS) * (z.shape[1] / TRIED_ANCHORS)
        offset = np.linspace(-0.5, 0.5, POINTS) * length_mm
        at = anchor[None, :, None] + offset[None, None] / step[:, None, None]
        whole = np.floor(at).astype(np.int64)
        part = at - whole
        row = np.arange(len(rows))[:, None, None]
        count = z.shape[1]
        points = (1 - part) * z[row, whole % count] + part * z[row, (whole + 1) % count]
        shape, middle, direction, bend = _described(points)
        view, which = _most_bent(bend, BEND * length_mm)
        found.append(
            Stretches(
                shape[view, which],
                middle[view, which],
                direction[view, which],
                begin + rows[view],
            )
        )
    if not found:
        return Stretches(
            np.zeros((0, 2 * POINTS), np.float32),
            np.zeros(0, np.complex128),
            np.zeros(0, np.complex128),
            np.zeros(0, np.int64),
        )
    return Stretches(
        np.concatenate([s.shape for s in found]),
        np.concatenate([s.middle for s in found]),
        np.concatenate([s.direction for s in found]),
        np.concatenate([s.owner for s in found]),
    )


def _described(
    points: NDArray[np.complex128],
) -> tuple[Float32Array, NDArray[np.complex128], NDArray[np.complex128], FloatArray]:
    """Return shape, middle, direction and bend [mm] of stretches (..., POINTS)."""
    middle = points.mean(axis=-1)
    centred = points - middle[..., None]
    along = (centred * np.linspace(-1.0, 1.0, POINTS)).sum(axis=-1)
    direction = along / np.maximum(np.abs(along), 1e-9)
    turned = centred * direction.conj()[..., None]
    shape = np.concatenate([turned.real, turned.imag], axis=-1) / np.sqrt(POINTS)
    bend = np.sqrt((turned.imag**2).mean(axis=-1))
    return shape.astype(np.float32), middle, direction, bend


def _most_bent(bend: FloatArray, least: float) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the most bent stretches of each view, not next to each other."""
    left = bend.copy()
    rows, columns = [], []
    every = np.arange(len(bend))
    for _ in range(ANCHORS):
        best = left.argmax(axis=1)
        good = left[every, best] > least
        rows.append(every[good])
        columns.append(best[good])
        for aside in (-1, 0, 1):
            left[every, (best + aside) % TRIED_ANCHORS] = -1.0
    return np.concatenate(rows), np.concatenate(columns)


def observed_stretches(
    loops_mm: Sequence[FloatArray],
    own: Sequence[BoolArray],
    wanted: Sequence[BoolArray],
    length_mm: float,
    step_mm: float,
) -> Stretches:
    """Return the stretches of dense closed loops, an anchor each step, that lie on known outline.

    Parameters
    ----------
    loops_mm : (n, 2) each, the part to the left
    own : (n,) masks of the part's own points of each loop
    wanted : (n,) masks of each loop; a stretch must have half its points in it
    length_mm : length of a stretch
    step_mm : step between anchors
    """
    shapes = [np.zeros((0, 2 * POINTS), np.float32)]
    middles, directions = [np.zeros(0, np.complex128)], [np.zeros(0, np.complex128)]
    owners = [np.zeros(0, np.int64)]
    for number, (loop, known, sought) in enumerate(zip(loops_mm, own, wanted, strict=True)):
        closed = np.concatenate([loop, loop[:1]])
        way = np.linalg.norm(np.diff(closed, axis=0), axis=1)
        along = np.concatenate([[0.0], np.cumsum(way)])
        if along[-1] < length_mm:
            continue
        anchor = np.arange(0.0, along[-1], step_mm)
        at = (anchor[:, None] + np.linspace(-0.5, 0.5, POINTS) * length_mm) % along[-1]
        points = np.interp(at, along, closed[:, 0]) + 1j * np.interp(at, along, closed[:, 1])
        side = np.clip(np.searchsorted(along, at, side="right") - 1, 0, len(loop) - 1)
        shape, middle, direction, bend = _described(points)
        good = known[side].all(axis=1) & (sought[side].mean(axis=1) >= 0.5)
        good &= bend > 0.8 * BEND * length_mm
        shapes.append(shape[good])
        middles.append(middle[good])
        directions.append(direction[good])
        owners.append(np.full(int(good.sum()), number))
    return Stretches(
        np.concatenate(shapes),
        np.concatenate(middles),
        np.concatenate(directions),
        np.concatenate(owners),
    )


def like(
    observed: Stretches, views: ViewStretches, near_mm: float, most: int
) -> tuple[IntArray, IntArray]:
    """Return the pairs (observed, of a view) of similar stretches, the best of neighbours.

    Parameters
    ----------
    observed : in the order of their loops
    views : views of a library
    near_mm : root mean square distance of points up to which they are
    most : so many pairs, the most alike
    """
    count = len(views.stretches.owner)
    if count == 0 or len(observed.owner) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    asked = np.arange(1, min(MAX_ALIKE, count) + 1)
    found = views.tree.query(observed.shape, k=asked, distance_upper_bound=near_mm)
    far, nearest = (np.asarray(one) for one in found)
    mine, which = np.nonzero(np.isfinite(far))
    theirs, far = nearest[mine, which], far[mine, which]
    # of a view's stretch and neighbours in the picture, the nearest alone
    order = np.lexsort((mine, theirs))
    mine, theirs, far = mine[order], theirs[order], far[order]
    beside = (theirs[1:] == theirs[:-1]) & (mine[1:] == mine[:-1] + 1)
    best = np.ones(len(far), dtype=np.bool_)
    best[1:] &= ~beside | (far[1:] <= far[:-1])
    best[:-1] &= ~beside | (far[:-1] <= far[1:])
    kept = np.flatnonzero(best)
    kept = kept[np.argsort(far[kept], kind="stable")[:most]]
    return mine[kept], theirs[kept]
