"""Which model view an observed boundary is, and how it is turned: strings are correlated.

The paper's section 3.1: from each corner of the object as reference, against each model corner of
like sign and size, corners at about equal distance along the perimeter are compared, and the
count of matches and their error rank the candidates. What that leaves to chance where corners are
few is helped by the same idea at every point of the outline (its samples correlated with the
model's at all starting points at once, by Fourier transform) and by the holes, seen from the
outline's centroid. Every candidate is then laid onto the object and fitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._laying import Candidates, Laid, lay
from ._strings import DEFAULT, BoundaryString
from ._tolerances import BinaryTolerances

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STARTS = 128  # starting points of the outline that are tried
PER_SOURCE = 4  # candidates each of the three ways may name for a model


@dataclass(frozen=True, eq=False, slots=True)
class StringMatch:
    """A model view laid onto an observed object: observed = R(turn) model + shift.

    Attributes
    ----------
    model_index : which of the models
    turn_rad : in (-pi, pi], from the first axis towards the second
    shift_mm : (2,)
    matched_count : corners and holes of the model found in the object
    missed_count : those of the model that are not in the object
    spurious_count : those of the object that are not in the model
    error_mm : root mean square distance of the model's outline and holes from the object's
    rank_mm : the error, made worse by what is missed and spurious; the order of matches
    turn_is_free : the object is round, no hole says how it is turned
    """

    model_index: int
    turn_rad: float
    shift_mm: Array
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
    """Return the model views an object may be, best first, several turns of one where alike.

    Parameters
    ----------
    observed : of the object
    models : of views made for about the same place on the table; those whose perimeter or area is
        out of tolerance are passed over
    """
    at = np.array([i for i, m in enumerate(models) if _is_of_size(observed, m, limits)], dtype=int)
    if len(at) == 0:
        return ()
    like = [models[i] for i in at]
    found = [_by_outline(observed, like), _by_holes(observed, like, limits)]
    found.append(_by_corners(observed, like, limits))
    candidates = Candidates(
        model=np.concatenate([c.model for c in found]),
        turn_rad=np.concatenate([c.turn_rad for c in found]),
        shift_mm=np.concatenate([c.shift_mm for c in found]),
    )
    laid = lay(observed, like, candidates, limits)
    return _matches(observed, like, at, laid, limits)


def _is_of_size(a: BoundaryString, b: BoundaryString, limits: BinaryTolerances) -> bool:
    return (
        abs(a.perimeter_mm - b.perimeter_mm) <= limits.perimeter_share * a.perimeter_mm
        and abs(a.filled_mm2 - b.filled_mm2) <= limits.area_share * a.filled_mm2
    )


def _complex(points: Array) -> NDArray[np.complex128]:
    return points[..., 0] + 1j * points[..., 1]


def _placed(model: Integers, turn: Array, observed_mm: Array, model_mm: Array) -> Candidates:
    """Return candidates that take points of models (n, 2) to observed ones (n, 2)."""
    moved = _complex(observed_mm) - np.exp(1j * turn) * _complex(model_mm)
    return Candidates(model, turn, np.stack([moved.real, moved.imag], axis=1))


def _by_outline(observed: BoundaryString, models: Sequence[BoundaryString]) -> Candidates:
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


def _best_of_rows(score: Array, count: int) -> tuple[Integers, Integers]:
    """Return rows and columns of the best few finite scores of each row."""
    best = np.argsort(-score, axis=1)[:, :count]
    rows = np.repeat(np.arange(len(score)), best.shape[1])
    columns = best.ravel()
    keep = np.isfinite(score[rows, columns])
    return rows[keep], columns[keep]


def _by_holes(
    observed: BoundaryString, models: Sequence[BoundaryString], limits: BinaryTolerances
) -> Candidates:
    """Turn each hole of a model onto each like one of the object, about the outline's centroid."""
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
        return Candidates.none()
    return _placed(
        np.concatenate(model), np.concatenate(turn), np.concatenate(there), np.concatenate(here)
    )


def _by_corners(
    observed: BoundaryString, models: Sequence[BoundaryString], limits: BinaryTolerances
) -> Candidates:
    """Correlate corners from each pair of reference corners, all pairs of all models at once."""
    count = max((len(m.corner_turn_rad) for m in models), default=0)
    if count == 0 or len(observed.corner_turn_rad) == 0:
        return Candidates.none()
    size, along, point = _padded(models, count, observed.perimeter_mm)
    # (model, its reference, the object's reference): of like sign and size
    mine = observed.corner_turn_rad
    model, i, j = np.nonzero(np.abs(size[:, :, None] - mine) <= limits.turn_near_rad)
    if len(model) == 0:
        return Candidates.none()
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
    return Candidates(model[best], turn, shift)


def _padded(
    models: Sequence[BoundaryString], count: int, perimeter_mm: float
) -> tuple[Array, Array, NDArray[np.complex128]]:
    """Return turns, distances and places of the models' corners, (m, count), nan where none is.

    Distances are scaled to the object's perimeter: noise and blur make all of it longer alike.
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


def _wrapped(distance: Array, whole: float) -> Array:
    """Return distances round a loop, the shorter way round."""
    return distance - whole * np.round(distance / whole)


def _best_of_groups(group: Integers, score: Array, count: int) -> Integers:
    """Return the indices of the best few scores of each group."""
    order = np.lexsort((-score, group))
    sorted_group = group[order]
    is_first = np.concatenate([[True], sorted_group[1:] != sorted_group[:-1]])
    start = np.maximum.accumulate(np.where(is_first, np.arange(len(order)), 0))
    best: Integers = order[np.arange(len(order)) - start < count]
    return best


def _rigid(
    weight: Array, theirs: NDArray[np.complex128], mine: NDArray[np.complex128]
) -> tuple[Array, Array]:
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
    at: Integers,
    laid: Laid,
    limits: BinaryTolerances,
) -> tuple[StringMatch, ...]:
    free = _turn_is_free(observed, limits)
    found = []
    for i, turn, shift, error in zip(
        laid.model.tolist(), laid.turn_rad, laid.shift_mm, laid.error_mm, strict=True
    ):
        matched, missed, spurious = _tally(observed, models[i], float(turn), shift, limits)
        wrong = (missed + spurious) / (matched + missed + spurious + 1)
        found.append(
            StringMatch(
                model_index=int(at[i]),
                turn_rad=float(turn),
                shift_mm=shift,
                matched_count=matched,
                missed_count=missed,
                spurious_count=spurious,
                error_mm=float(error),
                rank_mm=float(error) * (1 + wrong),
                turn_is_free=free,
            )
        )
    return tuple(sorted(found, key=lambda match: match.rank_mm))


def _tally(
    observed: BoundaryString,
    model: BoundaryString,
    turn: float,
    shift: Array,
    limits: BinaryTolerances,
) -> tuple[int, int, int]:
    """Return how many corners and holes are matched, missed and spurious, once it lies there."""
    place = complex(*shift)
    matched = 0
    for mine, theirs, my_size, their_size, near in (
        (
            observed.corner_mm,
            model.corner_mm,
            observed.corner_turn_rad,
            model.corner_turn_rad,
            np.full(len(model.corner_mm), limits.turn_near_rad),
        ),
        (
            observed.hole_mm,
            model.hole_mm,
            observed.hole_area_mm2,
            model.hole_area_mm2,
            limits.hole_area_share * model.hole_area_mm2 + 1.0,
        ),
    ):
        if len(mine) == 0 or len(theirs) == 0:
            continue
        moved = np.exp(1j * turn) * _complex(theirs) + place
        apart = np.abs(moved[:, None] - _complex(mine)[None])
        like = np.abs(their_size[:, None] - my_size[None]) <= near[:, None]
        apart = np.where(like & (apart <= limits.point_near_mm), apart, np.inf)
        best = (
            np.isfinite(apart)
            & (apart <= apart.min(axis=0))
            & (apart <= apart.min(axis=1, keepdims=True))
        )
        matched += int(best.any(axis=1).sum())
    there = len(model.corner_mm) + len(model.hole_mm)
    here = len(observed.corner_mm) + len(observed.hole_mm)
    return matched, there - matched, max(here - matched, 0)


def _turn_is_free(observed: BoundaryString, limits: BinaryTolerances) -> bool:
    """Tell whether nothing says how an object is turned: a circle, and holes only at its middle."""
    radius = np.linalg.norm(observed.outline_mm - observed.centroid_mm, axis=1)
    if float(np.ptp(radius)) > 2 * limits.round_mm:
        return False
    if len(observed.hole_mm) == 0:
        return True
    off = np.linalg.norm(observed.hole_mm - observed.centroid_mm, axis=1)
    arm = np.linalg.norm(observed.hole_outline_mm - observed.hole_mm[:, None], axis=2)
    return bool(off.max() <= limits.round_mm and np.ptp(arm, axis=1).max() <= 2 * limits.round_mm)
