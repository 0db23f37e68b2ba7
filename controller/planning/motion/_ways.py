"""Collision-free ways between configurations, as few whole joint moves as will do.

Tried in turn: one joint line, over the top, two random trees. Whatever is answered has been
checked leg by leg against the tube of where the arm will really be (planning.md 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ..errors import NoMotionError
from ..layout import FloatArray
from ._legs import Ends, leg_free
from ._pace import move_seconds
from ._scene import Scene
from ._trees import rrt_connect

RAISED_MM = (-20.0, -120.0, -250.0)  # zed of the ways over the top
ELBOWS_RAD = tuple(np.radians([-140.0, -90.0, 90.0, 140.0]).tolist())


def path_free(scene: Scene, path: Sequence[FloatArray]) -> bool:
    """Tell whether joint moves through waypoints are free, with thinner margins at both ends."""
    ends = Ends.of(scene.layout, path[0], path[-1])
    return all(leg_free(scene, a, b, ends) for a, b in pairwise(path))


def connect(
    q_from: FloatArray,
    q_to: FloatArray,
    scene: Scene,
    what: str,
    seed: int = 0,
    search: bool = True,
) -> tuple[FloatArray, ...]:
    """Return waypoints from `q_from` (left out) to `q_to` (the last) without contact.

    Tried in turn: the joint line; over the top, the quickest first; two random trees, unless
    `search` is False because the caller has another goal to try.

    Raises
    ------
    NoMotionError : no way found; `what` says what for
    """
    layout = scene.layout
    ends = Ends.of(layout, q_from, q_to)
    if leg_free(scene, q_from, q_to, ends):
        return (q_to,)
    known: dict[bytes, bool] = {}  # the ways over the top have most of their legs in common

    def free(a: FloatArray, b: FloatArray) -> bool:
        key = a.tobytes() + b.tobytes()
        if key not in known:
            known[key] = leg_free(scene, a, b, ends)
        return known[key]

    rising = _over_the_top(q_from, q_to)
    for path in sorted(rising, key=lambda w: move_seconds(layout, w)):
        if all(free(a, b) for a, b in pairwise(path)):
            return tuple(path[1:])
    found = rrt_connect(q_from, q_to, scene, seed) if search else None
    if found is None:
        raise NoMotionError(
            f"{what}: no way free of contact found from {_degrees(q_from)} to {_degrees(q_to)}; "
            "clear the space between or move the part"
        )
    return tuple(found[1:])


def _degrees(q: FloatArray) -> str:
    shown = [*np.degrees(q[:3]), q[3], *np.degrees(q[4:])]
    return "(" + ", ".join(f"{v:.0f}" for v in shown) + ")"


def _over_the_top(a: FloatArray, b: FloatArray) -> list[list[FloatArray]]:
    """Return ways that rise, turn and come down.

    Plain, with the arm drawn in, and with the hand hanging down, which at the top is above
    everything that stands in the cell.
    """
    ways = []
    for zed in RAISED_MM:
        up_a, up_b = a.copy(), b.copy()
        up_a[3], up_b[3] = max(zed, a[3]), max(zed, b[3])
        ways.append([up_a, up_b])
        hang_a, hang_b = up_a.copy(), up_b.copy()
        hang_a[4] = hang_b[4] = -np.pi / 2
        ways.append([up_a, hang_a, hang_b, up_b])
        for elbow in ELBOWS_RAD:
            drawn_a, drawn_b = _drawn_in(up_a, elbow), _drawn_in(up_b, elbow)
            ways.append([up_a, drawn_a, drawn_b, up_b])
            drawn_a, drawn_b = _drawn_in(hang_a, elbow), _drawn_in(hang_b, elbow)
            ways.append([up_a, hang_a, drawn_a, drawn_b, hang_b, up_b])
    return [_without_stops([a, *middle, b]) for middle in ways]


def _without_stops(path: list[FloatArray]) -> list[FloatArray]:
    kept = [path[0]]
    for q in path[1:]:
        if np.abs(q - kept[-1]).max() > 1e-9:
            kept.append(q)
    return kept


def _drawn_in(q: FloatArray, elbow_rad: float) -> FloatArray:
    """Return `q` with another elbow, the hand keeping its place on the forearm."""
    out = q.copy()
    out[2] += (elbow_rad - q[1]) / 2
    out[1] = elbow_rad
    return out
