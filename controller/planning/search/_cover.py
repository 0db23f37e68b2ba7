"""In which order to take views."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..layout import FloatArray

EXACT_ORDER_N = 9


def best_order(
    start: FloatArray, options: Sequence[FloatArray], end: FloatArray | None, speed: FloatArray
) -> list[tuple[int, int]]:
    """Order stops for short motion and pick one of the configurations (k, 6) of each.

    Returns
    -------
    (stop, configuration) in the order to drive them
    """
    n = len(options)
    if n == 0:
        return []

    def seconds(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.asarray((np.abs(a[:, None] - b[None]) / speed).max(axis=2))

    first = [float(seconds(start[None], o).min()) for o in options]
    last = [0.0 if end is None else float(seconds(o, end[None]).min()) for o in options]
    between = np.array([[float(seconds(a, b).min()) for b in options] for a in options])
    order = _held_karp(first, between, last) if n <= EXACT_ORDER_N else _nearest(first, between)

    # the order fixed, the cheapest configurations along it (Viterbi)
    cost = seconds(start[None], options[order[0]])[0]
    back: list[FloatArray] = []
    for a, b in pairwise(order):
        total = cost[:, None] + seconds(options[a], options[b])
        back.append(total.argmin(axis=0))
        cost = total.min(axis=0)
    if end is not None:
        cost = cost + seconds(options[order[-1]], end[None])[:, 0]
    k = int(cost.argmin())
    picks = [k]
    for pointers in reversed(back):
        k = int(pointers[k])
        picks.append(k)
    return list(zip(order, picks[::-1], strict=True))


def _held_karp(first: list[float], between: FloatArray, last: list[float]) -> list[int]:
    n = len(first)
    cost = {(1 << i, i): (first[i], -1) for i in range(n)}
    for mask in range(1, 1 << n):
        for i in range(n):
            if (mask, i) not in cost or not mask & (1 << i):
                continue
            base = cost[mask, i][0]
            for j in range(n):
                if mask & (1 << j):
                    continue
                key = (mask | (1 << j), j)
                value = base + between[i, j]
                if key not in cost or value < cost[key][0]:
                    cost[key] = (value, i)
    full = (1 << n) - 1
    i = min(range(n), key=lambda i: cost[full, i][0] + last[i])
    order, mask = [], full
    while i >= 0:
        order.append(i)
        previous = cost[mask, i][1]
        mask ^= 1 << i
        i = previous
    return order[::-1]


def _nearest(first: list[float], between: FloatArray) -> list[int]:
    order = [int(np.argmin(first))]
    while len(order) < len(first):
        left = [j for j in range(len(first)) if j not in order]
        order.append(min(left, key=lambda j: between[order[-1], j]))
    return order
