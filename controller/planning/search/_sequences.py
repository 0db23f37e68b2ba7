"""Orders in which grasps may follow each other, cheapest first per set of grasps and last grasp."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray

from ._problem import SAME_S, Problem


@dataclass(frozen=True, slots=True, eq=False)
class GraspSequences:
    """Sequences of equally many grasps from the start.

    Attributes
    ----------
    grasps : (k, length) in order
    sets : (k, length) the same grasps ascending, each once, padded with n
    cost_s : (k,) first and regrasps
    left_out_s : the least that sequences dropped for want of room could have cost altogether
    """

    grasps: IndexArray
    sets: IndexArray
    cost_s: FloatArray
    left_out_s: float = np.inf


def tails(problem: Problem, grasps: IndexArray, max_grasps: int) -> FloatArray:
    """Return the least cost of finishing from each grasp (n,) [s], by way of others if needed.

    Parameters
    ----------
    problem : costs of the problem
    grasps : (n,) numbers of the grasps that may be used
    max_grasps : at most so many regrasps
    """
    regrasp = problem.regrasp_s[np.ix_(grasps, grasps)]
    tail = problem.last_s[grasps].copy()
    for _ in range(max_grasps):
        tail = np.minimum(tail, (regrasp + tail[None]).min(axis=1, initial=np.inf))
    return tail


def first_sequences(problem: Problem, grasps: IndexArray) -> GraspSequences:
    """Return the sequences of a single grasp."""
    first = problem.first_s[grasps]
    at = np.flatnonzero(np.isfinite(first))
    return GraspSequences(at[:, None], at[:, None], first[at])


def longer(
    sequences: GraspSequences,
    regrasp_s: FloatArray,
    tail_s: FloatArray,
    room_s: float,
    known: list[GraspSequences],
    most: int,
    covered: BoolArray | None = None,
) -> GraspSequences:
    """Return the sequences with one more grasp that may be part of a better solution.

    Parameters
    ----------
    sequences : all of one length
    regrasp_s : (n, n)
    tail_s : (n,) time to the finish
    room_s : sequences that cost as much with their tail cannot be part of anything better
    known : shorter sequences; a longer one to the same set and last grasp must be cheaper
    most : so many are kept, the cheapest; `left_out_s` is what the others cost at least
    covered : (n, m) coverage of each grasp; where given, the grasps with the largest coverage are
        kept instead
    """
    n, length = len(regrasp_s), sequences.grasps.shape[1]
    last = sequences.grasps[:, -1]
    total = sequences.cost_s[:, None] + regrasp_s[last]
    with_tail = total + tail_s[None]
    fits = with_tail < room_s - SAME_S
    fits[np.arange(len(last)), last] = False
    source, new = np.nonzero(fits)
    cost = total[source, new]
    grasps = np.concatenate([sequences.grasps[source], new[:, None]], axis=1)
    sets = np.sort(
        np.concatenate(
            [
                sequences.sets[source],
                np.where((sequences.sets[source] == new[:, None]).any(axis=1), n, new)[:, None],
            ],
            axis=1,
        ),
        axis=1,
    )
    keys = _keys(sets, new, n)
    order = np.lexsort((np.arange(len(keys)), cost, keys))
    is_first = np.ones(len(order), dtype=bool)
    is_first[1:] = keys[order][1:] != keys[order][:-1]
    kept = np.sort(order[is_first])
    for shorter in known:
        padded = np.full((len(shorter.sets), length + 1), n)
        padded[:, : shorter.sets.shape[1]] = shorter.sets
        theirs = _keys(padded, shorter.grasps[:, -1], n)
        rank = np.argsort(theirs, kind="stable")
        at = np.clip(np.searchsorted(theirs[rank], keys[kept]), 0, max(0, len(rank) - 1))
        if len(rank):
            same = theirs[rank][at] == keys[kept]
            kept = kept[~(same & (shorter.cost_s[rank][at] <= cost[kept] + SAME_S))]
    left_out = np.inf
    if len(kept) > most:
        whole = with_tail[source[kept], new[kept]]
        rank = np.argsort(whole, kind="stable")
        if covered is not None:
            shown = np.zeros((len(kept), covered.shape[1]), dtype=bool)
            for k in range(grasps.shape[1]):
                shown |= covered[grasps[kept, k]]
            rank = np.lexsort((whole, -shown.sum(axis=1)))
        left_out = float(whole[rank[most:]].min())
        kept = kept[np.sort(rank[:most])]
    return GraspSequences(grasps[kept], sets[kept], cost[kept], left_out)


def _keys(sets: IndexArray, last: IndexArray, n: int) -> IndexArray:
    """Return one number for each set with its last grasp."""
    if (sets.shape[1] + 1) * np.log2(n + 1) >= 63:
        raise ValueError(f"{n} grasps in sequences of {sets.shape[1]}: more than can be numbered")
    key: IndexArray = last.astype(np.int64)
    for k in range(sets.shape[1]):
        key = key * (n + 1) + sets[:, k]
    return key


def showing_all(covered: BoolArray, sets: IndexArray) -> BoolArray:
    """Return a mask (k,) of the sets (k, w) of grasps that show every element of covered (n, m)."""
    n, m = covered.shape
    bits = np.packbits(np.concatenate([covered, np.zeros((1, m), dtype=bool)]), axis=1)
    full = np.packbits(np.ones(m, dtype=bool))
    width = -(-bits.shape[1] // 8) * 8
    words = np.zeros((n + 1, width), dtype=np.uint8)
    words[:, : bits.shape[1]] = bits
    goal = np.zeros(width, dtype=np.uint8)
    goal[: len(full)] = full
    words64, goal64 = words.view(np.uint64), goal.view(np.uint64)
    result = np.ones(len(sets), dtype=bool)
    left = np.arange(len(sets))
    for word in range(words64.shape[1]):  # word by word: most sets fail at the first few
        column = words64[:, word]
        shown = np.zeros(len(left), dtype=np.uint64)
        for k in range(sets.shape[1]):
            shown |= column[sets[left, k]]
        good = shown == goal64[word]
        result[left[~good]] = False
        left = left[good]
        if not len(left):
            break
    return result
