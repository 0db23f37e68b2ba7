"""Correlation of boundary strings: the model view of an observed boundary, and its turn.

The paper (references.md P3.1): from each corner of the object as reference, against each model
corner of like sign and size, corners at about equal distance along the perimeter are compared, and
the count of matches and their error rank the candidates. What that leaves to chance where corners
are few is helped by the same idea at every point of the outline (its samples correlated with the
model's at all starting points at once, by Fourier transform) and by the holes, seen from the
outline's centroid. Every candidate is then placed onto the object and fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, IntArray

from ._laying import Alignments, LaidViews, lay
from ._strings import DEFAULT, BoundaryString
from ._tolerances import BinaryTolerances

STARTS = 128  # starting points of the outline that are tried
PER_SOURCE = 4  # candidates that each of the three methods may name for a model


@dataclass(frozen=True, eq=False, slots=True)
class StringMatch:
    """A model view placed onto an observed object: observed = R(turn) model + shift.

    Attributes
    ----------
    model_index : index of the model
    turn_rad : in (-pi, pi], from the first axis towards the second
    shift_mm : (2,)
    matched_count : corners and holes of the model found in the object
    missed_count : number of features of the model that are not in the object
    spurious_count : number of features of the object that are not in the model
    error_mm : root mean square distance of the model's outline and holes from the object's
    rank_mm : the error, made worse by what is missed and spurious; the order of matches
    turn_is_free : the object is round, no hole says how it is turned
    """

    model_index: int
    turn_rad: float
    shift_mm: FloatArray
    matched_count: int
    missed_count: int
    spurious_count: int
    error_mm: float
    rank_mm: float
    turn_is_free: bool


def correlate(
    observed: BoundaryString,
    models: Sequence[BoundaryString],
    limits: BinaryTolerances = DEFAULT,
) -> tuple[StringMatch, ...]:
    """Return the model views that an object may be, best first, several turns where they are alike.

    Parameters
    ----------
    observed : description of the object
    models : of views made for about the same place on the table; those whose perimeter or area is
        out of tolerance are passed over
    limits : tolerances, for the camera's pixels
    """
    at = np.array([i for i, m in enumerate(models) if _is_of_size(observed, m, limits)], dtype=int)
    if len(at) == 0:
        return ()
    like = [models[i] for i in at]
    found = [_by_outline(observed, like), _by_holes(observed, like, limits)]
    found.append(_by_corners(observed, like, limits))
    candidates = LaidViews(
        model=np.concatenate([c.model for c in found]),
        turn_rad=np.concatenate([c.turn_rad for c in found]),
        shift_mm=np.concatenate([c.shift_mm for c in found]),
    )
    if len(candidates.model) == 0:
        return ()
    aligned = lay(observed, like, candidates, limits)
    return _matches(observed, like, at, aligned, limits)


def _is_of_size(a: BoundaryString, b: BoundaryString, limits: BinaryTolerances) -> bool:
    return (
        abs(a.perimeter_mm - b.perimeter_mm) <= limits.perimeter_share * a.perimeter_mm
        and abs(a.filled_mm2 - b.filled_mm2) <= limits.area_share * a.filled_mm2
    )


def _complex(points: FloatArray) -> NDArray[np.complex128]:
    return points[..., 0] + 1j * points[..., 1]


def _placed(
    model: IntArray, turn: FloatArray, observed_mm: FloatArray, model_mm: FloatArray
) -> LaidViews:
    """Return candidates that take points of models (n, 2) to observed ones (n, 2)."""
    moved = _complex(observed_mm) - np.exp(1j * turn) * _complex(model_mm)
    return LaidViews(model, turn, np.stack([moved.real, moved.imag], axis=1))


def _by_outline(observed: BoundaryString, models: Sequence[BoundaryString]) -> LaidViews:
    """Compare outlines sample by sample from every starting point.

    Of two closed curves as complex numbers about their middles, the correlation's modulus says
    how close they come when begun there, and its angle how one is turned then.
    """
    skip = len(observed.outline_mm) // STARTS
    a = _complex(observed.outline_mm[::skip])
    b = _complex(np.stack([m.outline_mm for m in models])[:, ::skip])
    a, b = a - a.mean(), b - b.mean(axis=1, keepdims=True)
    c = np.fft.ifft(np.fft.fft(a) * np.fft.fft(b, axis=1).conj(), axis=1)
    size = np.abs(c)
    is_peak = (size >= np.roll(size, 1, axis=1)) & (size > np.roll(size, -1, axis=1))
    row, column = _best_of_rows(np.where(is_peak, size, -np.inf), PER_SOURCE)
    turn = np.angle(c[row, column])
    centre = np.broadcast_to(observed.centroid_mm, (len(row), 2))
    return _placed(row, turn, centre, np.stack([m.centroid_mm for m in models])[row])


def _best_of_rows(score: FloatArray, count: int) -> tuple[IntArray, IntArray]:
    """Return rows and columns of the best few finite scores of each row."""
    best = np.argsort(-score, axis=1)[:, :count]
    rows = np.repeat(np.arange(len(score)), best.shape[1])
    columns = best.ravel()
    keep = np.isfinite(score[rows, columns])
    return rows[keep], columns[keep]


def _by_holes(
    observed: BoundaryString, models: Sequence[BoundaryString], limits: BinaryTolerances
) -> LaidViews:
    """Match each hole of a model with each similar one of the object, about its centroid."""
    arm = _complex(observed.hole_mm - observed.centroid_mm)
    model, turn, there, here = [], [], [], []
    for i, m in enumerate(models):
        other = _complex(m.hole_mm - m.centroid_mm)
        if len(arm) == 0 or len(other) == 0:
            continue
        far = np.abs(np.abs(arm)[:, None] - np.abs(other)[None])
        like = np.abs(observed.hole_area_mm2[:, None] - m.hole_area_mm2[None])
        like = like <= limits.hole_area_share * m.hole_area_mm2[None]
        like &= (far <= limits.point_near_mm) & (np.abs(other)[None] > 2 * limits.point_near_mm)
        if not like.any():
            continue
        a, b = np.nonzero(like)
        # the hole farthest out tells the turn best; of its likes in the object all are tried
        first = b[np.abs(other)[b].argmax()]
        a = a[b == first][: 2 * PER_SOURCE]
        model.append(np.full(len(a), i))
        turn.append(np.angle(arm[a] / other[first]))
        there.append(np.broadcast_to(observed.centroid_mm, (len(a), 2)))
        here.append(np.broadcast_to(m.centroid_mm, (len(a), 2)))
    if not model:
        return LaidViews.none()
    return _placed(
        np.concatenate(model), np.concatenate(turn), np.concatenate(there), np.concatenate(here)
    )


def _by_corners(
    observed: BoundaryString, models: Sequence[BoundaryString], limits: BinaryTolerances
) -> LaidViews:
    """Correlate corners from each pair of reference corners, all pairs of all models at once."""
    count = max((len(m.corner_turn_rad) for m in models), default=0)
    if count == 0 or len(observed.corner_turn_rad) == 0:
        return LaidViews.none()
    size, along, point = _padded(models, count, observed.perimeter_mm)
    # (model, its reference, the object's reference): of like sign and size
    mine = observed.corner_turn_rad
    model, i, j = np.nonzero(np.abs(size[:, :, None] - mine) <= limits.turn_near_rad)
    if len(model) == 0:
        return LaidViews.none()
    whole = observed.perimeter_mm
    from_there = _wrapped(along[model] - along[model, i][:, None], whole)
    from_here = _wrapped(observed.corner_along_mm - observed.corner_along_mm[j][:, None], whole)
    apart = np.abs(_wrapped(from_there[:, :, None] - from_here[:, None, :], whole))
    reach = limits.corner_near_mm + limits.corner_near_share * np.abs(from_there)
    alike = np.abs(size[:, :, None] - mine)[model] <= limits.turn_near_rad
    apart = np.where(alike & (apart <= reach[:, :, None]), apart, np.inf)
    # one to one: each the other's nearest; the distances are ordered, so the pairs are
    theirs = apart.min(axis=1, keepdims=True)
    paired = np.isfinite(apart) & (apart <= theirs) & (apart <= apart.min(axis=2, keepdims=True))
    matched = paired.sum(axis=(1, 2))
    error = np.where(paired, apart, 0.0).sum(axis=(1, 2)) / np.maximum(matched, 1)
    score = matched - 0.5 * error / limits.corner_near_mm
    best = _best_of_groups(model, score, PER_SOURCE)
    best = best[matched[best] >= 2]
    weight = paired[best].astype(np.float64)
    turn, shift = _rigid(weight, point[model[best]], _complex(observed.corner_mm))
    return LaidViews(model[best], turn, shift)


def _padded(
    models: Sequence[BoundaryString], count: int, perimeter_mm: float
) -> tuple[FloatArray, FloatArray, NDArray[np.complex128]]:
    """Return turns, distances and places of the models' corners, (m, count), nan where none is.

    Distances are scaled to the object's perimeter: noise and blur lengthen all of it alike.
    """
    size = np.full((len(models), count), np.nan)
    along = np.zeros((len(models), count))
    point = np.zeros((len(models), count), dtype=np.complex128)
    for row, m in enumerate(models):
        n = len(m.corner_turn_rad)
        size[row, :n] = m.corner_turn_rad
        along[row, :n] = m.corner_along_mm * (perimeter_mm / m.perimeter_mm)
        point[row, :n] = _complex(m.corner_mm)
    return size, along, point


def _wrapped(distance: FloatArray, whole: float) -> FloatArray:
    """Return distances round a loop, the shorter way round."""
    return distance - whole * np.round(distance / whole)


def _best_of_groups(group: IntArray, score: FloatArray, count: int) -> IntArray:
    """Return the indices of the best few scores of each group."""
    order = np.lexsort((-score, group))
    sorted_group = group[order]
    is_first = np.concatenate([[True], sorted_group[1:] != sorted_group[:-1]])
    start = np.maximum.accumulate(np.where(is_first, np.arange(len(order)), 0))
    best: IntArray = order[np.arange(len(order)) - start < count]
    return best


def _rigid(
    weight: FloatArray, theirs: NDArray[np.complex128], mine: NDArray[np.complex128]
) -> tuple[FloatArray, FloatArray]:
    """Return the least-squares turn (n,) and shift (n, 2) of paired points, weights (n, m, o)."""
    total = np.maximum(weight.sum(axis=(1, 2)), 1e-9)
    w_theirs, w_mine = weight.sum(axis=2), weight.sum(axis=1)
    p = (w_theirs * theirs).sum(axis=1) / total
    q = (w_mine * mine).sum(axis=1) / total
    cross = np.einsum("nmo,nm,o->n", weight, theirs.conj(), mine)
    turn = np.angle(cross - total * p.conj() * q)
    shift = q - np.exp(1j * turn) * p
    return turn, np.stack([shift.real, shift.imag], axis=1)


def _matches(
    observed: BoundaryString,
    models: Sequence[BoundaryString],
    at: IntArray,
    aligned: Alignments,
    limits: BinaryTolerances,
) -> tuple[StringMatch, ...]:
    free = _turn_is_free(observed, limits)
    moves = (aligned.model, np.exp(1j * aligned.turn_rad), _complex(aligned.shift_mm))
    corners = _matched(
        observed.corner_mm,
        observed.corner_turn_rad,
        [
            (m.corner_mm, m.corner_turn_rad, np.full(len(m.corner_mm), limits.turn_near_rad))
            for m in models
        ],
        moves,
        limits.point_near_mm,
    )
    holes = _matched(
        observed.hole_mm,
        observed.hole_area_mm2,
        [
            (m.hole_mm, m.hole_area_mm2, limits.hole_area_share * m.hole_area_mm2 + 1.0)
            for m in models
        ],
        moves,
        limits.point_near_mm,
    )
    there = np.array([len(m.corner_mm) + len(m.hole_mm) for m in models])[aligned.model]
    here = len(observed.corner_mm) + len(observed.hole_mm)
    matched = corners + holes
    wrong = there + here - 2 * matched
    # the share of features without a partner makes a match up to twice as bad
    rank = aligned.error_mm * (1 + wrong / (wrong + matched + 1))
    return tuple(
        StringMatch(
            model_index=int(at[aligned.model[k]]),
            turn_rad=float(aligned.turn_rad[k]),
            shift_mm=aligned.shift_mm[k],
            matched_count=int(matched[k]),
            missed_count=int(there[k] - matched[k]),
            spurious_count=int(here - matched[k]),
            error_mm=float(aligned.error_mm[k]),
            rank_mm=float(rank[k]),
            turn_is_free=free,
        )
        for k in np.argsort(rank, kind="stable").tolist()
    )


def _matched(
    mine: FloatArray,
    my_size: FloatArray,
    theirs: Sequence[tuple[FloatArray, FloatArray, FloatArray]],
    moves: tuple[IntArray, NDArray[np.complex128], NDArray[np.complex128]],
    reach_mm: float,
) -> IntArray:
    """Return the number of features of moved models that match one of the object, one to one.

    Parameters
    ----------
    mine, my_size : (o, 2), (o,) features of the object
    theirs : of each model the same, and how far sizes can differ
    moves : (n,) index of the model, turn as a complex number, shift
    """
    model, turn, shift = moves
    most = max(len(points) for points, _, _ in theirs)
    if len(mine) == 0 or most == 0:
        return np.zeros(len(model), dtype=np.int64)
    point = np.zeros((len(theirs), most), dtype=np.complex128)
    size = np.zeros((len(theirs), most))
    near = np.full((len(theirs), most), -1.0)
    for row, (p, s, n) in enumerate(theirs):
        point[row, : len(p)], size[row, : len(p)], near[row, : len(p)] = _complex(p), s, n
    like = np.abs(size[:, :, None] - my_size) <= near[:, :, None]
    moved = turn[:, None] * point[model] + shift[:, None]
    apart = np.abs(moved[:, :, None] - _complex(mine))
    apart = np.where(like[model] & (apart <= reach_mm), apart, np.inf)
    nearest = apart <= np.minimum(
        apart.min(axis=1, keepdims=True), apart.min(axis=2, keepdims=True)
    )
    matched: IntArray = (nearest & np.isfinite(apart)).any(axis=2).sum(axis=1)
    return matched


def _turn_is_free(observed: BoundaryString, limits: BinaryTolerances) -> bool:
    """Return True if nothing shows the turn of an object: a circle, holes only at its middle."""
    radius = np.linalg.norm(observed.outline_mm - observed.centroid_mm, axis=1)
    if float(np.ptp(radius)) > 2 * limits.round_mm:
        return False
    if len(observed.hole_mm) == 0:
        return True
    off = np.linalg.norm(observed.hole_mm - observed.centroid_mm, axis=1)
    arm = np.linalg.norm(observed.hole_outline_mm - observed.hole_mm[:, None], axis=2)
    return bool(off.max() <= limits.round_mm and np.ptp(arm, axis=1).max() <= 2 * limits.round_mm)
