"""Hypotheses for a picture's features: a view, its turn and its shift, best first.

The method is the paper's (references.md P3.2). The scale is known, so one feature of the model put
on one feature of the picture fixes the whole transformation. A transformation is scored by the
share of the model's features that are then found in the picture. The paper tried all pairs. Here
an index finds pairs of equal size; pairs that give nearly the same transformation are one
hypothesis; and scoring stops as soon as a hypothesis can no longer be among the best.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controller.arrays import FloatArray, IntArray

from .._tolerances import GreyTolerances
from ..features.extract import ImageFeatures
from ._hulls import ROUNDEST, hull_of
from ._score import edge_map, fitted, quick_scores, rated
from .index import FeatureIndex, feature_index, near_keys
from .keys import KINDS, Frames, frames_of
from .model import ModelFeatures

MAX_PAIRS = 20_000  # pairs of features tested, per kind
MAX_COARSE = 240  # hypotheses scored coarsely
MAX_OF_HULL = 200
MAX_FITTED = 28
PLAIN_ENOUGH = 0.5  # share of the edgelets that must be the part's and not its shadow's
BIN_RAD = np.pi / 30  # hypotheses nearer than this are one
BIN_MM = 3.0
ENOUGH = 50  # pairs of other features from which circles alone give no hypotheses
TURNS_OF_A_CIRCLE = 24  # turns tried, since a circle determines none


@dataclass(frozen=True, eq=False, slots=True)
class ViewHypothesis:
    """A view placed on the picture.

    Attributes
    ----------
    model_index : index of the model of the views given
    turn_rad : anticlockwise from above
    shift_mm : (2,) shift of the view's origin, on the table
    score : 0..1, share of the edges on both sides that are found on the other
    model_share, image_share : model share and image share of the view's edges found; of the
        picture's edges explained, the mean of those there and of all
    """

    model_index: int
    turn_rad: float
    shift_mm: FloatArray
    score: float
    model_share: float
    image_share: float


def propose(
    image: ImageFeatures,
    models: Sequence[ModelFeatures] | FeatureIndex,
    *,
    foot_mm: tuple[float, float] = (0.0, 0.0),
    most: int = 10,
    tol: GreyTolerances | None = None,
) -> tuple[ViewHypothesis, ...]:
    """Return the hypotheses for a picture, best first; references.md P3.2.

    Parameters
    ----------
    image : features in the table plane
    models : a library's views; an index of them is worth keeping
    foot_mm : the point of the table plane below the camera, which tall parts lean away from
    most : hypotheses returned
    tol : tolerances on features that match; None for the defaults

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
    coarse = np.concatenate(
        [_clusters(votes)[:MAX_COARSE], _of_hull(image, index, foot, tol)[:MAX_OF_HULL]]
    )
    return _best(image, index, coarse, foot, most, tol)


def rate(
    image: ImageFeatures,
    models: Sequence[ModelFeatures] | FeatureIndex,
    poses: FloatArray,
    *,
    foot_mm: tuple[float, float] = (0.0, 0.0),
    most: int = 10,
    tol: GreyTolerances | None = None,
) -> tuple[ViewHypothesis, ...]:
    """Return hypotheses proposed elsewhere, fitted and scored, best first.

    Parameters
    ----------
    image, models, foot_mm, most, tol : as `propose`
    poses : (n, 4) view, turn [rad] and shift [mm] on the table, as outlines may leave them: of
        mirror images and poses with equal outlines, say
    """
    tol = tol or GreyTolerances()
    index = models if isinstance(models, FeatureIndex) else feature_index(models, tol)
    foot = np.asarray(foot_mm, dtype=np.float64)
    if len(poses) == 0 or len(image.edgelets.points_mm) == 0:
        return ()
    about = np.asarray(poses, dtype=np.float64) - np.r_[0.0, 0.0, foot]
    return _best(image, index, about, foot, most, tol)


def _best(
    image: ImageFeatures,
    index: FeatureIndex,
    coarse: FloatArray,
    foot: FloatArray,
    most: int,
    tol: GreyTolerances,
) -> tuple[ViewHypothesis, ...]:
    if len(coarse) == 0:
        return ()
    seen = edge_map(image.edgelets, foot, tol)
    coarse = coarse[quick_scores(seen, index, coarse, MAX_FITTED)]
    poses = fitted(seen, index, coarse, tol)
    scores = rated(seen, index, poses, tol)
    order = distinct_poses(poses, scores[:, 0], most)
    return tuple(hypothesis_of(poses[i], scores[i], foot) for i in order.tolist())


def _of_hull(
    image: ImageFeatures, index: FeatureIndex, foot: FloatArray, tol: GreyTolerances
) -> FloatArray:
    """Return (n, 4) hypotheses from the hull of all plain edges, most similar hulls first."""
    plain = image.edgelets.strengths > PLAIN_ENOUGH
    hull = hull_of(image.edgelets.points_mm[plain] - foot)
    if hull is None or len(index.hulls) == 0:
        return np.zeros((0, 4))
    own = index.hulls
    off = np.abs(own[:, 2] - hull[2]) / (tol.length_mm + tol.hull_ratio * hull[2])
    off = np.maximum(off, np.abs(own[:, 4] - hull[4]) / tol.hull_roundness)
    near = np.flatnonzero(off < 1.0)
    near = near[np.argsort(off[near], kind="stable")]
    rows = []
    for m in near.tolist():
        if own[m, 4] < ROUNDEST:
            turns = hull[3] - own[m, 3] + np.array([0.0, np.pi])
        else:
            turns = np.arange(TURNS_OF_A_CIRCLE) * (2 * np.pi / TURNS_OF_A_CIRCLE)
        cos, sin = np.cos(turns), np.sin(turns)
        x = hull[0] - cos * own[m, 0] + sin * own[m, 1]
        y = hull[1] - sin * own[m, 0] - cos * own[m, 1]
        k = own[m, 6]
        rows.append(np.stack([np.full(len(turns), float(m)), turns, x / k, y / k], axis=1))
    return np.concatenate(rows) if rows else np.zeros((0, 4))


def _votes(
    image: ImageFeatures, index: FeatureIndex, foot: FloatArray, tol: GreyTolerances
) -> FloatArray:
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
        both_directions=True,
    )
    rows: list[FloatArray] = []
    for kind in KINDS:
        if kind == "circle" and sum(len(r) for r in rows) > ENOUGH:
            continue
        rows.append(_of_kind(seen[kind], index.tables[kind], all_round=kind == "circle"))
    return np.concatenate(rows)


def _of_kind(seen: Frames, table: Frames, *, all_round: bool) -> FloatArray:
    order = np.argsort(-seen.weights, kind="stable")
    row, at = near_keys(table, seen.keys[order], MAX_PAIRS)
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


def _clusters(votes: FloatArray) -> FloatArray:
    """Return (n, 4) view, turn and shift of agreeing votes, best supported first."""
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
    if len(votes) == 0:
        return np.zeros((0, 4))
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


def distinct_poses(poses: FloatArray, scores: FloatArray, most: int) -> IntArray:
    """Return the ``most`` best poses, without near duplicates of better ones.

    Parameters
    ----------
    poses : (n, 4) view, turn [rad] and shift [mm]
    scores : (n,)
    most : returned at most, best first
    """
    order = np.argsort(-scores, kind="stable")
    p = poses[order]
    turn = np.abs((p[:, None, 1] - p[None, :, 1] + np.pi) % (2 * np.pi) - np.pi)
    same = (p[:, None, 0] == p[None, :, 0]) & (turn < BIN_RAD / 2)
    for axis in (2, 3):
        same &= np.abs(p[:, None, axis] - p[None, :, axis]) < BIN_MM / 2
    kept: list[int] = []
    is_taken = np.zeros(len(p), dtype=np.bool_)
    for i in range(len(p)):
        if not is_taken[i]:
            kept.append(i)
            is_taken |= same[i]
        if len(kept) == most:
            break
    return order[kept]


def hypothesis_of(pose: FloatArray, score: FloatArray, foot: FloatArray) -> ViewHypothesis:
    """Return a placed view with its scores.

    Parameters
    ----------
    pose : (4,) view, turn [rad] and shift [mm] about the camera's foot
    score : (3,) score of `rated`
    foot : (2,) point of the table below the camera
    """
    return ViewHypothesis(
        int(pose[0]),
        float((pose[1] + np.pi) % (2 * np.pi) - np.pi),
        pose[2:] + foot,
        float(score[0]),
        float(score[1]),
        float(score[2]),
    )
