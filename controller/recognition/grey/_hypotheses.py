"""Which view, turned and shifted how, explains a picture's features: best first.

Paper, section 3.2: a feature of the model on one of the picture fixes the transformation, scale
being known; its worth is how much of the one is then found in the other. The paper tried all
pairs. Here an index finds the pairs whose sizes agree, pairs that agree with each other are one
hypothesis, and a hypothesis is dropped when what it has not yet been asked about cannot bring it
among the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._features import ImageFeatures
from ._index import KINDS, FeatureIndex, Frames, feature_index, frames_of, near_keys
from ._model import ModelFeatures
from ._score import EdgeMap, edge_map, fitted, quick_scores, rated
from ._tolerances import GreyTolerances

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

MOST_PAIRS = 60_000  # of features looked at, per kind
MOST_COARSE = 320  # hypotheses scored coarsely
MOST_FITTED = 40
BIN_RAD = np.pi / 30  # hypotheses nearer than this are one
BIN_MM = 3.0
TURNS_OF_A_CIRCLE = 24  # tried where nothing says which way


@dataclass(frozen=True, eq=False, slots=True)
class Hypothesis:
    """A view laid on the picture.

    Attributes
    ----------
    model_index : of the views given
    turn_rad : anticlockwise from above
    shift_mm : (2,) of the view's origin, on the table
    score : 0..1, share of the edges on both sides that are found on the other
    model_share, image_share : of the view's edges found, of the picture's edges there explained
    matched_lines, matched_corners, matched_circles : (n, 2) numbers in picture and model,
        one to one
    """

    model_index: int
    turn_rad: float
    shift_mm: Array
    score: float
    model_share: float
    image_share: float
    matched_lines: Ints
    matched_corners: Ints
    matched_circles: Ints


def propose(
    image: ImageFeatures,
    models: Sequence[ModelFeatures] | FeatureIndex,
    *,
    foot_mm: tuple[float, float] = (0.0, 0.0),
    most: int = 10,
    tol: GreyTolerances | None = None,
) -> tuple[Hypothesis, ...]:
    """Return what a picture may show, best first; paper, section 3.2.

    Parameters
    ----------
    image : features in the table plane
    models : a library's views; an index of them is worth keeping
    foot_mm : the point of the table plane below the camera, which tall parts lean away from
    most : hypotheses returned

    Returns
    -------
    hypotheses : none where the picture has no feature of any view's size
    """
    tol = tol or GreyTolerances()
    index = models if isinstance(models, FeatureIndex) else feature_index(models, tol)
    foot = np.asarray(foot_mm, dtype=np.float64)
    if not index.models or len(image.edgelets.points_mm) == 0:
        return ()
    votes = _votes(image, index, foot, tol)
    if len(votes) == 0:
        return ()
    coarse = _clusters(votes)[:MOST_COARSE]
    seen = edge_map(image.edgelets, foot, tol)
    coarse = coarse[quick_scores(seen, index, coarse, MOST_FITTED)]
    poses = fitted(seen, index, coarse, tol)
    scores = rated(seen, index, poses, tol)
    order = _distinct(poses, scores[:, 0])[:most]
    return tuple(_hypothesis(image, index, poses[i], scores[i], foot, tol) for i in order.tolist())


def _votes(image: ImageFeatures, index: FeatureIndex, foot: Array, tol: GreyTolerances) -> Array:
    """Return (n, 5) view, turn, shift and weight of every pair of features of one size."""
    lines = image.lines_mm - np.r_[foot, foot]
    corners = image.corners
    circles = np.column_stack([image.circles.centres - foot, image.circles.radii])
    shifted = type(corners)(
        corners.positions - foot, corners.lines, corners.ends, corners.angles_rad
    )
    seen = frames_of(
        lines,
        np.ones((len(lines), 2)),
        np.ones(len(lines)),
        shifted,
        circles,
        np.ones(len(circles)),
        image.circles.cover,
        tol,
        both_ways=True,
    )
    rows = []
    for kind in KINDS:
        if kind == "circle" and sum(map(len, rows)) > 50:
            continue
        rows.append(_of_kind(seen[kind], index.tables[kind], all_round=kind == "circle"))
    return np.concatenate(rows)


def _of_kind(seen: Frames, table: Frames, *, all_round: bool) -> Array:
    order = np.argsort(-seen.weights, kind="stable")
    row, at = near_keys(table, seen.keys[order], MOST_PAIRS)
    row = order[row]
    if all_round:
        row, at = np.repeat(row, TURNS_OF_A_CIRCLE), np.repeat(at, TURNS_OF_A_CIRCLE)
        turn = np.arange(len(row)) % TURNS_OF_A_CIRCLE * (2 * np.pi / TURNS_OF_A_CIRCLE)
    else:
        turn = seen.turns_rad[row] - table.turns_rad[at]
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = table.points[at].T
    k = table.spread[at]
    shift_x = (seen.points[row, 0] - (cos * x - sin * y)) / k
    shift_y = (seen.points[row, 1] - (sin * x + cos * y)) / k
    weight = np.minimum(seen.weights[row], table.weights[at])
    return np.stack(
        [table.model[at].astype(np.float64), turn % (2 * np.pi), shift_x, shift_y, weight], axis=1
    )


def _clusters(votes: Array) -> Array:
    """Return (n, 4) view, turn and shift that votes agree on, best supported first."""
    model, turn, x, y, weight = votes.T
    turns = round(2 * np.pi / BIN_RAD)
    cells = np.stack(
        [
            model.astype(np.int64),
            np.round(turn / BIN_RAD).astype(np.int64) % turns,
            np.round(x / BIN_MM).astype(np.int64),
            np.round(y / BIN_MM).astype(np.int64),
        ]
    )
    low = cells.min(axis=1)
    span = cells.max(axis=1) - low + 1
    key = np.ravel_multi_index(tuple(cells - low[:, None]), tuple(span))
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    inverse = inverse.ravel()
    total = np.bincount(inverse, weights=weight)
    away = (turn - turn[first][inverse] + np.pi) % (2 * np.pi) - np.pi
    turn_mean = turn[first] + np.bincount(inverse, weights=weight * away) / total
    mean = [np.bincount(inverse, weights=weight * c) / total for c in (x, y)]
    order = np.argsort(-total, kind="stable")
    return np.stack([model[first], turn_mean, *mean], axis=1)[order]


def _distinct(poses: Array, scores: Array) -> Ints:
    """Return the hypotheses in order of score, without those a better one all but equals."""
    order = np.argsort(-scores, kind="stable")
    kept: list[int] = []
    for i in order.tolist():
        same = [
            k
            for k in kept
            if poses[k, 0] == poses[i, 0]
            and np.abs(poses[k, 2:] - poses[i, 2:]).max() < BIN_MM / 2
            and abs((poses[k, 1] - poses[i, 1] + np.pi) % (2 * np.pi) - np.pi) < BIN_RAD / 2
        ]
        if not same:
            kept.append(i)
    return np.array(kept, dtype=np.int64)


def _hypothesis(
    image: ImageFeatures,
    index: FeatureIndex,
    pose: Array,
    score: Array,
    foot: Array,
    tol: GreyTolerances,
) -> Hypothesis:
    model = index.models[int(pose[0])]
    cos, sin = np.cos(pose[1]), np.sin(pose[1])
    R = np.array([[cos, -sin], [sin, cos]])

    def laid(points: Array, spread: Array) -> Array:
        return points @ R.T + spread[:, None] * pose[2:] + foot

    ends = laid(model.lines_mm.reshape(-1, 2), model.line_spread.ravel()).reshape(-1, 4)
    at = model.corners
    n = np.arange(len(at.lines))
    k = model.line_spread[at.lines[n, 0], at.ends[n, 0]] if len(n) else np.zeros(0)
    circles = laid(model.circles_mm[:, :2], model.circle_spread)
    reach = 2 * tol.match_mm
    return Hypothesis(
        int(pose[0]),
        float((pose[1] + np.pi) % (2 * np.pi) - np.pi),
        pose[2:] + foot,
        float(score[0]),
        float(score[1]),
        float(score[2]),
        _one_to_one(_line_gaps(image.lines_mm, ends, tol), reach),
        _one_to_one(_gaps(image.corners.positions, laid(at.positions, k)), 2 * reach),
        _one_to_one(
            _gaps(image.circles.centres, circles)
            + np.abs(image.circles.radii[:, None] - model.circles_mm[None, :, 2]),
            reach,
        ),
    )


def _gaps(a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=2))


def _line_gaps(seen: Array, model: Array, tol: GreyTolerances) -> Array:
    """Return how far (n, m) lines of the picture are beside those of the model, inf if apart."""
    way = model[:, 2:] - model[:, :2]
    length = np.maximum(np.hypot(way[:, 0], way[:, 1]), 1e-9)
    way = way / length[:, None]
    ends = seen.reshape(-1, 2, 2)[:, None] - model[None, :, None, :2]
    t = np.einsum("nmei,mi->nme", ends, way)
    beside = np.abs(ends[..., 0] * way[None, :, None, 1] - ends[..., 1] * way[None, :, None, 0])
    gap = beside.max(axis=2)
    covered = np.minimum(t.max(axis=2), length) - np.maximum(t.min(axis=2), 0.0)
    own = np.hypot(seen[:, 2] - seen[:, 0], seen[:, 3] - seen[:, 1])
    gap[covered < 0.5 * np.minimum(own[:, None], length[None])] = np.inf
    return gap


def _one_to_one(cost: Array, most: float) -> Ints:
    """Return pairs (row, column), each once, the nearest first."""
    row, column = np.nonzero(cost < most)
    order = np.argsort(cost[row, column], kind="stable")
    rows: set[int] = set()
    columns: set[int] = set()
    pairs = []
    for i, j in zip(row[order].tolist(), column[order].tolist(), strict=True):
        if i not in rows and j not in columns:
            rows.add(i)
            columns.add(j)
            pairs.append((i, j))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


__all__ = ["EdgeMap", "Hypothesis", "propose"]
