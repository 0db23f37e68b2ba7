"""Stretches of outlines: short ones stay the same if the rest of the outline changes.

A stretch is so many points at equal steps about an anchor, turned so that it runs along the first
axis. Of views only the stretches that bend most are kept, of a picture all of them are tried;
straight ones fit everywhere and are left out. That is the paper's correlation of strings from
corners of like turn (references.md P3.1), for outlines of which the perimeter is not known.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray, IntArray

STRETCHES_MM = (16.0, 40.0)
POINTS = 13  # points of a stretch
BEND = 0.025  # rms distance of a stretch's points from a straight line, as a share of its length
ANCHORS = 12  # anchors of a view
TRIED_ANCHORS = 48
MIN_PERIMETER = 1.4  # least perimeter of a view, in lengths of the stretch
BLOCK = 2000  # views processed at a time
DIMENSIONS = 4  # dimensions in which leaves have bounds
LEAF = 256  # largest number of stretches in a leaf
LEAVES_AT_ONCE = 512
SAMPLED = 8  # one leaf in this many shows the similarity of the most similar pairs
LIKELY = 8  # pairs kept for each wanted one: of neighbours only the best one counts
MAX_FOR_BASIS = 20000
SLACK = 1.0 + 1e-3  # factor on bounds for the error of single precision

# a leaf, the observed stretches that may have one alike there, their squared distance from it
NearLeaf = tuple[int, IntArray, Float32Array]


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
class Leaves:
    """Stretches of one length, grouped by shape.

    Attributes
    ----------
    stretches : leaf by leaf
    columns : (n, 2 POINTS + 2) each shape, with what makes a product with one observed half their
        squared distance, below 0: 1 and half its own square
    rank : (n,) their places before that
    ends : (k + 1,) begins of the leaves, and end of the last one
    mean, basis : (2 POINTS,), (2 POINTS, DIMENSIONS) the directions in which shapes differ most
    low, high : (k, DIMENSIONS) bounds of each leaf's shapes along these
    """

    stretches: Stretches
    columns: Float32Array
    rank: IntArray
    ends: IntArray
    mean: Float32Array
    basis: Float32Array
    low: Float32Array
    high: Float32Array


@dataclass(frozen=True, eq=False, slots=True)
class StretchIndex:
    """Stretches of all views of a library, by their lengths."""

    by_length: tuple[Leaves, ...]


def stretch_index(outer_mm: NDArray[np.float16]) -> StretchIndex:
    """Return the stretches of views by their outer borders (n, samples, 2), nan for none."""
    return StretchIndex(tuple(leaves_of(_of_views(outer_mm, length)) for length in STRETCHES_MM))


def leaves_of(stretches: Stretches) -> Leaves:
    """Return stretches grouped so that those of similar shape are found together."""
    shape = stretches.shape
    some = shape[:: max(1, len(shape) // MAX_FOR_BASIS)].astype(np.float64)
    mean = some.sum(axis=0) / max(len(some), 1)
    _, directions = np.linalg.eigh((some - mean).T @ (some - mean))
    basis = directions[:, ::-1][:, :DIMENSIONS].astype(np.float32)
    mean = mean.astype(np.float32)
    places = (shape - mean) @ basis
    leaves = [np.arange(len(shape))]
    while len(leaves[0]) > LEAF:
        leaves = [half for leaf in leaves for half in _halves(leaf, places)]
    rank = np.concatenate(leaves)
    own = shape[rank]
    half = -0.5 * (own**2).sum(axis=1)
    columns = np.column_stack([own, np.ones(len(own), np.float32), half])
    bounds = [(places[leaf].min(axis=0), places[leaf].max(axis=0)) for leaf in leaves if len(leaf)]
    return Leaves(
        Stretches(
            columns[:, : shape.shape[1]],
            stretches.middle[rank],
            stretches.direction[rank],
            stretches.owner[rank],
        ),
        columns,
        rank,
        np.cumsum([0, *(len(leaf) for leaf in leaves if len(leaf))]),
        mean,
        basis,
        np.array([low for low, _ in bounds], np.float32).reshape(-1, DIMENSIONS),
        np.array([high for _, high in bounds], np.float32).reshape(-1, DIMENSIONS),
    )


def _halves(leaf: IntArray, places: Float32Array) -> tuple[IntArray, IntArray]:
    """Return a leaf cut in two across the direction in which it is longest."""
    own = places[leaf]
    column = own[:, int(np.ptp(own, axis=0).argmax())]
    middle = len(leaf) // 2
    order = np.argpartition(column, middle)
    return leaf[order[:middle]], leaf[order[middle:]]


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


def like(observed: Stretches, views: Leaves, near_mm: float, most: int) -> tuple[IntArray, ...]:
    """Return the pairs (observed, of a view) of similar stretches, the best of neighbours.

    Leaves whose bounds are farther from an observed stretch than that have none like it.

    Parameters
    ----------
    observed : in the order of their loops
    views : views of a library
    near_mm : root mean square distance of points up to which they are
    most : so many pairs, the most alike
    """
    near = list(_near_leaves(observed, views, near_mm))
    least = -0.5 * near_mm**2
    _, some = _levels(observed, views, near[::SAMPLED], least)
    likely = 2 * LIKELY * most // SAMPLED
    if len(some) > likely:  # what is less alike than so many is among the most only by chance
        level = float(np.partition(some, -likely // 2)[-likely // 2])
        nearer = list(_nearer(near, float(np.sqrt(-2.0 * level))))
        key, found = _best_of_neighbours(*_levels(observed, views, nearer, level))
    if len(some) <= likely or len(found) < most:
        key, found = _best_of_neighbours(*_levels(observed, views, near, least))
    if len(found) > most:
        key = key[np.argpartition(-found, most)[:most]]
    theirs, mine = np.divmod(key, len(observed.shape) + 1)
    order = np.argsort(mine * len(views.rank) + views.rank[theirs])
    return mine[order], theirs[order]


def _levels(
    observed: Stretches, views: Leaves, near: Sequence[NearLeaf], least: float
) -> tuple[IntArray, Float32Array]:
    """Return the pairs of stretches above a level, and their levels: minus half squared distance.

    A pair is a number, of a view before observed; one row more keeps the last one observed from
    being next to the first. They ascend.
    """
    a = observed.shape
    rows = np.column_stack([a, -0.5 * (a**2).sum(axis=1), np.ones(len(a), np.float32)])
    keys: list[NDArray[np.int64]] = [np.zeros(0, np.int64)]
    levels: list[Float32Array] = [np.zeros(0, np.float32)]
    for number, asked, _ in near:
        begin, end = views.ends[number : number + 2]
        level = (views.columns[begin:end] @ rows[asked].T).ravel()
        at = np.flatnonzero(level > least)
        theirs, mine = np.divmod(at, len(asked))
        keys.append((theirs + begin) * (len(a) + 1) + asked[mine])
        levels.append(level[at])
    return np.concatenate(keys), np.concatenate(levels)


def _best_of_neighbours(key: IntArray, level: Float32Array) -> tuple[IntArray, Float32Array]:
    """Return the pairs of `_levels` that no pair of an observed neighbour exceeds."""
    beside = key[1:] == key[:-1] + 1
    best = np.ones(len(key), dtype=np.bool_)
    best[1:] &= ~beside | (level[1:] >= level[:-1])
    best[:-1] &= ~beside | (level[:-1] >= level[1:])
    return key[best], level[best]


def _near_leaves(observed: Stretches, views: Leaves, near_mm: float) -> Iterator[NearLeaf]:
    """Yield leaves in order, each with the observed stretches that may have a similar one there."""
    if len(observed.shape) == 0:
        return
    places = (observed.shape - views.mean) @ views.basis
    for begin in range(0, len(views.low), LEAVES_AT_ONCE):
        low, high = (b[begin : begin + LEAVES_AT_ONCE] for b in (views.low, views.high))
        away2 = np.zeros((len(low), len(places)), np.float32)
        for k in range(DIMENSIONS):
            away = np.maximum(low[:, k, None] - places[:, k], places[:, k] - high[:, k, None])
            away2 += np.maximum(away, 0.0) ** 2
        near = away2 < (SLACK * near_mm) ** 2
        for row in np.flatnonzero(near.any(axis=1)).tolist():
            asked = np.flatnonzero(near[row])
            yield begin + row, asked, away2[row, asked]


def _nearer(near: Sequence[NearLeaf], near_mm: float) -> Iterator[NearLeaf]:
    """Yield those of `_near_leaves` that are nearer, with their stretches."""
    for number, asked, away2 in near:
        is_near = away2 < (SLACK * near_mm) ** 2
        if is_near.any():
            yield number, asked[is_near], away2[is_near]
