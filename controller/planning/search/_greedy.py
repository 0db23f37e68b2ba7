"""Greedy baseline: the grasp that shows most, then the one that adds most; views likewise."""

from __future__ import annotations

import numpy as np

from controller.arrays import BoolArray, FloatArray

from ._problem import MAX_GRASP_COUNT, GraspSequence, Problem, live_grasps, needed_of, solution_of


def greedy(problem: Problem, max_grasps: int = MAX_GRASP_COUNT) -> GraspSequence | None:
    """Return a solution that takes the grasp or view with the largest gain at each turn.

    The first grasp is the one that can be had at the start and shows most; then, from the present
    grasp, the one within a regrasp that shows most of what is left, through another grasp where
    none does; of equal ones the cheapest. Views under these grasps by most new elements for their
    cost, those made needless by later ones left out.

    Returns
    -------
    None where no sequence leads from start to finish; an incomplete solution where it cannot go on
    """
    live = live_grasps(problem, max_grasps)
    if not len(live):
        return None
    needed = needed_of(problem, max_grasps)
    shown = np.array(
        [problem.shows[g][np.isfinite(problem.view_s[g])].any(axis=0) & needed for g in live]
    )
    regrasp = problem.regrasp_s[np.ix_(live, live)].copy()
    np.fill_diagonal(regrasp, np.inf)
    ends = [problem.last_s[live]]  # ends[k]: cheapest finish by k regrasps or fewer
    for _ in range(max_grasps):
        ends.append(np.minimum(ends[-1], (regrasp + ends[-1][None]).min(axis=1)))
    sequence: list[int] = []
    left = needed.copy()
    cost = problem.first_s[live]
    while True:
        room = max_grasps - len(sequence) - 1
        can = np.isfinite(cost) & np.isfinite(ends[room]) if room >= 0 else np.zeros(0, bool)
        if not can.any():
            break
        gain = np.where(can, (shown & left).sum(axis=1), -1)
        if gain.max() <= 0 and sequence:
            beyond = (shown & left).sum(axis=1)
            # nothing new within a regrasp: towards what shows something, if there is room
            step = regrasp + np.where(beyond > 0, 0.0, np.inf)[None]
            detour = np.where(can & (room >= 1), cost + step.min(axis=1), np.inf)
            if not np.isfinite(detour).any():
                break
            k = int(np.argmin(detour))
        else:
            best = np.flatnonzero(gain == gain.max())
            k = int(best[np.argmin((cost + ends[room])[best])])
        sequence.append(k)
        left &= ~shown[k]
        if not left.any():
            break
        cost = regrasp[k]
    if not sequence:
        return None
    _finish(sequence, problem, live, regrasp, ends, max_grasps)
    return _with_views(problem, [int(live[k]) for k in sequence], needed, max_grasps)


def _finish(
    sequence: list[int],
    problem: Problem,
    live: np.ndarray,
    regrasp: FloatArray,
    ends: list[FloatArray],
    max_grasps: int,
) -> None:
    """Go on to a grasp that allows a finish, by the cheapest regrasps."""
    last = problem.last_s[live]
    while True:
        room, here = max_grasps - len(sequence), sequence[-1]
        if last[here] <= ends[room][here]:
            return
        sequence.append(int(np.argmin(regrasp[here] + ends[room - 1])))


def _with_views(
    problem: Problem, grasps: list[int], needed: BoolArray, max_grasps: int
) -> GraspSequence:
    candidates = [
        (k, v)
        for k, g in enumerate(grasps)
        for v in np.flatnonzero(np.isfinite(problem.view_s[g]))
        if g not in grasps[:k]
    ]
    chosen: list[int] = []
    if candidates:
        table = np.stack([problem.shows[grasps[k]][v] & needed for k, v in candidates])
        cost = np.array([problem.view_s[grasps[k]][v] for k, v in candidates])
        bits = table.astype(np.float32)
        left = needed & table.any(axis=0)
        while left.any():
            best = int(np.argmax((bits @ left.astype(np.float32)) / np.maximum(cost, 1e-9)))
            chosen.append(best)
            left &= ~table[best]
        for best in list(chosen):
            others = [c for c in chosen if c != best]
            if not (table[best] & ~table[others].any(axis=0)).any():
                chosen.remove(best)
    views = [
        [int(candidates[c][1]) for c in chosen if candidates[c][0] == k] for k in range(len(grasps))
    ]
    return solution_of(problem, grasps, views, 0.0, max_grasps)
