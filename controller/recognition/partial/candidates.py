"""Poses proposed by stretches of an outline, weighed by the share of it that is found."""

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray

from ..library import Candidate, Library, is_same_turn
from ..stretches import STRETCHES_MM, like, observed_stretches
from .cluster import Cluster

STEP_MM = 1.0  # distance between the anchors that are tried
NEAR_MM = (0.6, 1.0)  # limits for stretches, by their length
MAX_PAIR_COUNT = 40000  # pairs of stretches of one length
BLOCK = 1000  # poses weighed at a time: their samples stay in the processor's cache
LOOK_SAMPLES, SAMPLES = 24, 96  # of a view's outline: many poses, then few
LOOK_SHARE = 0.25  # share of the first samples that has to be found
MAX_WEIGHED = 1500  # number weighed by the first samples, of which some 70 go on to all of them
SAME_NORMAL = 0.6  # cosine of the largest angle between normals
FOUND_MM = 1.1  # distance from the outline: the view's raster, and the rest of perspective
SLACK_SHARE = 0.6  # share of the position's allowance that an outline's point may be off
MAX_SLACK_MM = 6.0
MIN_FOUND = 0.4  # least share of a view's outline that must be found
MAX_OUTSIDE = 0.15
SAME_MM, SAME_RAD = 6.0, np.radians(8.0)
PER_POSE = 8  # places tried for one pose
MAX_CANDIDATE_COUNT = 70


@dataclass(frozen=True, eq=False, slots=True)
class _Poses:
    """Views turned and moved: which (n,), turn (n,), shift (n, 2)."""

    view: IntArray
    turn_rad: FloatArray
    shift_mm: FloatArray

    def at(self, which: IntArray | BoolArray) -> "_Poses":
        return _Poses(self.view[which], self.turn_rad[which], self.shift_mm[which])


def propose_partial(
    cluster: Cluster,
    library: Library,
    is_open: BoolArray,
    most: int = MAX_CANDIDATE_COUNT,
    per_place: int = PER_POSE,
    most_weighed: int | None = MAX_WEIGHED,
) -> list[Candidate]:
    """Return the candidates for stretches of a cluster's outline, most outline found first.

    Parameters
    ----------
    cluster : several parts, or one that is cut
    library : library of the possible parts
    is_open : (m,) mask of the cluster's outline points without an explanation yet
    most : largest number of proposals
    per_place : of one stable pose turned differently in one place, that come before others
    most_weighed : of poses by all samples; None for all that the first samples leave, where an
        outline is known so badly that others' turns come before the right ones
    """
    poses = _from_stretches(cluster, library, is_open)
    found, outside = _weighed(poses, cluster, library, is_open, LOOK_SAMPLES)
    likely = np.flatnonzero(found > LOOK_SHARE)
    if most_weighed is not None and len(likely) > most_weighed:
        score = (found - outside)[likely]
        likely = likely[np.sort(np.argpartition(-score, most_weighed)[:most_weighed])]
    poses = poses.at(likely)
    found, outside = _weighed(poses, cluster, library, is_open, SAMPLES)
    good = (found > MIN_FOUND) & (outside < MAX_OUTSIDE)
    poses, score = poses.at(good), (found - outside)[good]
    return _best(poses, score, library, most, per_place)


def _from_stretches(cluster: Cluster, library: Library, is_open: BoolArray) -> _Poses:
    index = library.index
    own, named = cluster.by_loop(is_open)
    views, turns, shifts = [], [], []
    for length, near, known in zip(STRETCHES_MM, NEAR_MM, library.stretches, strict=True):
        observed = observed_stretches(cluster.loops_mm, own, named, length, STEP_MM)
        mine, theirs = like(observed, known, near, MAX_PAIR_COUNT)
        stretches = known.stretches
        turn = observed.direction[mine] * stretches.direction[theirs].conj()
        shift = observed.middle[mine] - turn * stretches.middle[theirs]
        views.append(stretches.owner[theirs])
        turns.append(turn)
        shifts.append(shift)
    view = np.concatenate(views)
    turn, shift = np.concatenate(turns), np.concatenate(shifts)
    poses = _Poses(view, np.angle(turn), np.column_stack([shift.real, shift.imag]))
    return poses.at(_apart_mm(poses, library) <= index.ring_mm[view])


def _apart_mm(poses: _Poses, library: Library) -> FloatArray:
    """Return the distances (n,) of poses from the place for which their views were made [mm]."""
    index = library.index
    c, s = np.cos(poses.turn_rad), np.sin(poses.turn_rad)
    x, y = index.place_mm[poses.view].T
    made = np.column_stack([c * x - s * y, s * x + c * y])
    return np.asarray(np.linalg.norm(poses.shift_mm - library.eye_mm[:2] - made, axis=1))


def _weighed(
    poses: _Poses, cluster: Cluster, library: Library, is_open: BoolArray, count: int
) -> tuple[FloatArray, FloatArray]:
    """Return the shares (n,) of views' outlines that are found, and that lie where nothing is."""
    found, outside = np.zeros(len(poses.view)), np.zeros(len(poses.view))
    if len(found) == 0:
        return found, outside
    slack = _apart_mm(poses, library) * library.index.lean[poses.view]
    near = (FOUND_MM + SLACK_SHARE * np.minimum(slack, MAX_SLACK_MM)).astype(np.float32)
    turn = np.exp(1j * poses.turn_rad).astype(np.complex64)[:, None]
    shift = (poses.shift_mm @ np.array([1.0, 1.0j])).astype(np.complex64)[:, None]
    own = cluster.map.own(is_open)
    for begin in range(0, len(poses.view), BLOCK):
        some = slice(begin, begin + BLOCK)
        views, of = np.unique(poses.view[some], return_inverse=True)
        samples = library.index.outline_samples(views, count)
        points, normals = (kept.view(np.complex64)[..., 0][of] for kept in samples[:2])
        weights = samples[2] / np.maximum(samples[2].sum(axis=1, keepdims=True), np.float32(1e-9))
        weight = weights[of]
        points *= turn[some]
        points += shift[some]
        normals *= turn[some]
        away, agree, is_outside = cluster.map.look_along(points, normals, own)
        close = away < near[some, None]
        found[some] = np.einsum("ij,ij->i", close & (agree > SAME_NORMAL), weight)
        outside[some] = np.einsum("ij,ij->i", is_outside & ~close, weight)
    return found, outside


def _best(
    poses: _Poses, score: FloatArray, library: Library, most: int, per_place: int
) -> list[Candidate]:
    """Return the best poses as candidates, without repeats of a stable pose's places."""
    index = library.index
    kept: list[int] = []
    more: list[int] = []
    named: dict[tuple[int, int], list[int]] = {}
    apart = _apart_mm(poses, library)
    for k in np.argsort(-score, kind="stable").tolist():
        view = poses.view[k]
        name = (int(index.part[view]), int(index.pose[view]))
        turns = library.entries[name[0]].turns_of(name[1])
        alike = named.setdefault(name, [])
        if len(alike) == PER_POSE:
            continue
        in_place = [other for other in alike if _is_in_place(poses, k, other)]
        turned = poses.turn_rad
        if any(is_same_turn(turned[k], turned[other], turns, SAME_RAD) for other in in_place):
            continue
        alike.append(k)
        (kept if len(in_place) < per_place else more).append(k)
        if len(kept) == most:
            break
    kept += more[: most - len(kept)]
    return [
        Candidate(
            int(index.part[poses.view[k]]),
            int(index.pose[poses.view[k]]),
            float(poses.turn_rad[k]),
            float(poses.shift_mm[k, 0]),
            float(poses.shift_mm[k, 1]),
            float(score[k]),
            0.0,
            float(apart[k] * index.lean[poses.view[k]]),
            source="stretches",
        )
        for k in kept
    ]


def _is_in_place(poses: _Poses, a: int, b: int) -> bool:
    return float(np.linalg.norm(poses.shift_mm[a] - poses.shift_mm[b])) <= SAME_MM
