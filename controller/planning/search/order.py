"""Order of views, and the configuration of each.

Exact for a dozen stops (Held and Karp's recursion over what has been visited and in which
configuration one stands), beyond that the best of several starts improved by turning stretches
round and moving stretches elsewhere. What a segment takes is the caller's: any time model will do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from controller.arrays import FloatArray, IndexArray

SegmentSeconds = Callable[[FloatArray, FloatArray], FloatArray]
EXACT_STOPS = 12
EXACT_WORK = 16_000_000  # additions; about 40 ms
_START_WORK = 4000  # starts times stops squared: the work of some 40 ms
_ROUNDS = 200


def best_order(
    start: FloatArray,
    options: Sequence[FloatArray],
    end: FloatArray | None,
    segment_seconds: SegmentSeconds | FloatArray,
) -> list[tuple[int, int]]:
    """Return the order of stops with the least arm time, with one configuration of each.

    Parameters
    ----------
    start : (d,) first joints of the arm
    options : per stop (k, d), k >= 1, the configurations that serve
    end : (d,) final joints of the arm, None for any
    segment_seconds : (..., d) from, (..., d) to -> (...) seconds, broadcasting; or (d,) speeds, of
        which the slowest joint decides

    Returns
    -------
    (stop, configuration) in the order to drive them

    Raises
    ------
    ValueError : a stop has no configuration
    """
    if not options:
        return []
    if any(len(o) == 0 for o in options):
        raise ValueError("a stop without a configuration")
    if not callable(segment_seconds):
        speed = segment_seconds

        def segment_seconds(a: FloatArray, b: FloatArray) -> FloatArray:
            return np.asarray((np.abs(a - b) / speed).max(axis=-1))

    every = np.concatenate([np.asarray(o, dtype=float) for o in options])
    stop_of = np.repeat(np.arange(len(options)), [len(o) for o in options])
    segments = np.asarray(segment_seconds(every[:, None], every[None]), dtype=float)
    first = np.asarray(segment_seconds(start[None], every), dtype=float)
    last = np.zeros(len(every))
    if end is not None:
        last = np.asarray(segment_seconds(every, end[None]), dtype=float)
    n = len(options)
    if n <= EXACT_STOPS and 2**n * len(every) ** 2 // 2 <= EXACT_WORK:
        chosen = exact_order(first, segments, last, stop_of)
    else:
        chosen = improved_order(first, segments, last, stop_of)
    begin = np.searchsorted(stop_of, np.arange(n))
    return [(int(stop_of[c]), int(c - begin[stop_of[c]])) for c in chosen]


def exact_order(
    first: FloatArray, segments: FloatArray, last: FloatArray, stop_of: IndexArray
) -> list[int]:
    """Return configurations in order, one of each stop, of the least sum of segments.

    Parameters
    ----------
    first, last : (c,) segment from the start to each configuration, and to the end
    segments : (c, c)
    stop_of : (c,) ascending, whose configuration it is
    """
    n, c = int(stop_of[-1]) + 1, len(stop_of)
    masks = np.arange(1 << n)
    size = np.bitwise_count(masks)
    own = [np.flatnonzero(stop_of == j) for j in range(n)]
    cost = np.full((1 << n, c), np.inf)
    cost[1 << stop_of, np.arange(c)] = first
    for count in range(1, n):
        layer = masks[size == count]
        for j in range(n):
            without = layer[(layer >> j) & 1 == 0]
            target = without | (1 << j)
            # with few configurations a stop, one at a time is what the cache likes best
            for k in own[j]:
                cost[target, k] = (cost[without] + segments[:, k]).min(axis=1)
    mask = (1 << n) - 1
    at = int(np.argmin(cost[mask] + last))
    path = [at]
    while len(path) < n:
        mask ^= 1 << int(stop_of[at])
        at = int(np.argmin(cost[mask] + segments[:, at]))
        path.append(at)
    return path[::-1]


def improved_order(
    first: FloatArray, segments: FloatArray, last: FloatArray, stop_of: IndexArray
) -> list[int]:
    """Return configurations in order, one of each stop, by improving several starts.

    Good, not optimal; `exact_order` is, for few stops.

    Parameters
    ----------
    first : (c,) seconds from where the arm stands to each configuration
    segments : (c, c) from row to column
    last : (c,) cost from each to the arm's final joints; 0 without any
    stop_of : (c,) stop of each configuration, ascending from 0
    """
    n = int(stop_of[-1]) + 1
    moves = _moves(n)
    starts = np.argsort(
        [first[stop_of == j].min() for j in range(n)], kind="stable"
    )  # the first stop: the nearest ones in turn
    best: tuple[float, list[int]] | None = None
    for begin in starts[: max(2, min(8, _START_WORK // n**2))]:
        path = _nearest(int(begin), first, segments, stop_of)
        seconds = np.inf
        for _ in range(_ROUNDS):
            path = _with_configurations(path, first, segments, last, stop_of)
            path, now = _moved(np.array(path), first, segments, last, moves)
            if now >= seconds - 1e-9:
                break
            seconds = now
        if best is None or seconds < best[0] - 1e-9:
            best = seconds, list(map(int, path))
    assert best is not None
    return best[1]


def _nearest(begin: int, first: FloatArray, segments: FloatArray, stop_of: IndexArray) -> list[int]:
    mine = np.flatnonzero(stop_of == begin)
    path = [int(mine[np.argmin(first[mine])])]
    open_ = stop_of != begin
    while open_.any():
        path.append(int(np.argmin(np.where(open_, segments[path[-1]], np.inf))))
        open_ &= stop_of != stop_of[path[-1]]
    return path


def _with_configurations(
    path: Sequence[int],
    first: FloatArray,
    segments: FloatArray,
    last: FloatArray,
    stop_of: IndexArray,
) -> list[int]:
    """Keep the order of stops, choose the best configurations along it (Viterbi)."""
    own = [np.flatnonzero(stop_of == stop_of[k]) for k in path]
    cost = first[own[0]]
    back: list[IndexArray] = []
    for a, b in pairwise(own):
        total = cost[:, None] + segments[np.ix_(a, b)]
        back.append(total.argmin(axis=0))
        cost = total.min(axis=0)
    k = int((cost + last[own[-1]]).argmin())
    chosen = [int(own[-1][k])]
    for pointers, mine in zip(back[::-1], own[-2::-1], strict=True):
        k = int(pointers[k])
        chosen.append(int(mine[k]))
    return chosen[::-1]


def _moves(n: int) -> IndexArray:
    """Return (k, n) the orders one move away: a stretch reversed, or up to three moved."""
    plain = list(range(n))
    orders = [plain]
    for a in range(n):
        for b in range(a + 2, n + 1):
            orders.append(plain[:a] + plain[a:b][::-1] + plain[b:])
    for length in (1, 2, 3):
        for a in range(n - length + 1):
            piece, rest = plain[a : a + length], plain[:a] + plain[a + length :]
            for at in range(len(rest) + 1):
                if at != a:
                    orders.append(rest[:at] + piece + rest[at:])
    return np.unique(np.array(orders, dtype=np.intp), axis=0)


def _moved(
    path: IndexArray, first: FloatArray, segments: FloatArray, last: FloatArray, moves: IndexArray
) -> tuple[list[int], float]:
    """Make the best move repeatedly until none helps."""
    seconds = np.inf
    while True:
        paths = path[moves]
        total = (
            first[paths[:, 0]]
            + segments[paths[:, :-1], paths[:, 1:]].sum(axis=1)
            + last[paths[:, -1]]
        )
        k = int(np.argmin(total))
        if total[k] >= seconds - 1e-9:
            return [int(x) for x in path], float(seconds)
        path, seconds = paths[k], float(total[k])
