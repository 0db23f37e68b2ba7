"""Estimate what a site costs in seconds, for ranking: the views that show all, and one regrasp.

The estimate is of a greedy plan without obstacles: moves are straight lines of the joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.planning.model import CellLayout, HandOff, lit_count
from controller.planning.motion import move_seconds

from .._family import FamilyMember

MIN_GAIN = 0.002  # share of the surface that one more view must add
PAIR_COUNT = 24  # pairs of grasps that show all and are timed
SET_DOWN_S = 16.0  # time for going down to the table and up twice; zed is the slowest axis


def forecast(
    layout: CellLayout,
    member: FamilyMember,
    views: BoolArray,
    q: FloatArray,
    by_pose: BoolArray,
    met: BoolArray,
    tables: Sequence[dict[int, HandOff]],
) -> tuple[float, float]:
    """Return seconds of the views in two grasps and of the regrasp between; NaN if there is none.

    Parameters
    ----------
    layout : with camera and fixed gripper at the site
    member : a part of the family
    views, q : (g, v), (g, v, 6) of the site
    by_pose : (p, g) grasps that pick the part up from each stable pose
    met : (f, g) pairs of grasps that meet
    tables : for each grasp of the fixed gripper, the hand-off from each arm grasp that meets it
    """
    nan = float("nan")
    if not len(by_pose) or not by_pose.any():
        return nan, nan
    start = by_pose[int(np.argmax(member.probabilities))]
    if not start.any():
        start = by_pose.any(axis=0)
    weights = member.weights
    seen_by = np.stack([_sees(member, views, k) for k in range(len(views))])
    passed = (met.T.astype(int) @ met.astype(int)) > 0
    # The other kind of regrasp: set the part down, look at it again, and grasp it otherwise.
    pairs = passed | (start[:, None] & start[None])
    np.fill_diagonal(pairs, True)
    together = (seen_by[:, None] | seen_by[None]) @ weights * (pairs & start[:, None])
    enough = together >= together.max() - MIN_GAIN
    enough &= together > 0.0
    if np.diagonal(enough).any():
        first = second = int(np.argmax(np.diagonal(enough)))
        regrasp_s, at = nan, layout.park_q
    else:
        quickest = (np.inf, 0, 0, layout.park_q)
        by_hand_off = (
            np.argwhere(enough & passed) if (enough & passed).any() else np.argwhere(enough)
        )
        for one, other in by_hand_off[:PAIR_COUNT].tolist():
            seconds, end = _regrasp(
                layout, tables, one, other, member.base_count, layout.park_q, bool(start[other])
            )
            if seconds < quickest[0]:
                quickest = (seconds, one, other, end)
        regrasp_s, first, second, at = quickest
    seen = np.zeros(len(weights), dtype=bool)
    chosen = _greedy(member, views[first], first, seen)
    if not chosen:
        return nan, nan
    view_s, _ = _tour(layout, q[first], chosen, layout.park_q)
    if first == second:
        return view_s, nan
    chosen = _greedy(member, views[second], second, seen)
    tour_s, _ = _tour(layout, q[second], chosen, at)
    return view_s + tour_s, regrasp_s


def _sees(member: FamilyMember, views: BoolArray, grasp: int) -> BoolArray:
    return np.asarray(member.shown[grasp, views[grasp]].any(axis=0))


def _greedy(member: FamilyMember, views: BoolArray, grasp: int, seen: BoolArray) -> list[int]:
    """Return directions, most new surface first; adds what they show to `seen`."""
    chosen: list[int] = []
    rows = np.flatnonzero(views)
    while len(rows):
        gain = (member.shown[grasp, rows] & ~seen) @ member.weights
        k = int(np.argmax(gain))
        if gain[k] < MIN_GAIN:
            break
        chosen.append(int(rows[k]))
        seen |= member.shown[grasp, rows[k]]
    return chosen


def _tour(
    layout: CellLayout, q: FloatArray, chosen: Sequence[int], start: FloatArray
) -> tuple[float, FloatArray]:
    """Return the seconds to visit all chosen views, each time the nearest next, and the last q."""
    at, left, seconds = start, list(chosen), 0.0
    while left:
        steps = [move_seconds(layout, np.stack([at, q[v]])) for v in left]
        k = int(np.argmin(steps))
        seconds += steps[k] + layout.cell_times.look_s(lit_count(is_square=False))
        at = q[left.pop(k)]
    return seconds, at


def _regrasp(
    layout: CellLayout,
    tables: Sequence[dict[int, HandOff]],
    first: int,
    second: int,
    half: int,
    start: FloatArray,
    by_table: bool,
) -> tuple[float, FloatArray]:
    """Return the seconds of the quickest regrasp from one base grasp to another, and the last q."""
    best, end = np.inf, start
    for table in tables:
        for a in (first, first + half):
            for b in (second, second + half):
                if a not in table or b not in table:
                    continue
                give, take = table[a], table[b]
                segments = move_seconds(layout, np.stack([start, give.entry[0]]))
                segments += move_seconds(layout, np.stack([give.entry[0], give.entry[-1]]))
                segments += move_seconds(layout, np.stack([give.retreat[0], give.retreat[-1]]))
                segments += move_seconds(layout, np.stack([give.retreat[-1], take.retreat[-1]]))
                segments += move_seconds(layout, np.stack([take.retreat[-1], take.retreat[0]]))
                segments += move_seconds(layout, np.stack([take.entry[-1], take.entry[0]]))
                if segments < best:
                    best, end = segments, take.entry[0]
    cell_times = layout.cell_times
    best += cell_times.hand_off_s
    if by_table:
        # Down, away, a picture from overhead, and up again: the arm moves to park and back.
        set_down = 2 * move_seconds(layout, np.stack([start, layout.park_q])) + SET_DOWN_S
        set_down += cell_times.put_s + cell_times.pick_s + cell_times.relook_s
        if set_down < best:
            return set_down, layout.park_q
    return (float(best) if np.isfinite(best) else float("nan")), end
