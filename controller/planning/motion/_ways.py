"""Collision-free ways between configurations, as few whole joint moves as will do.

Tried in turn: one joint line, over the top, two random trees. Whatever is answered has been
checked leg by leg against the tube of where the arm will really be (planning-facts.md 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from controller.arrays import BoolArray, FloatArray
from drivers.umi_scara.kinematics import within_limits

from ..model import NoMotionError
from ._kinematics import tip_pose
from ._legs import END_MARGIN_MM, MARGIN_MM, Ends, leg_free, leg_seems_free
from ._pace import leg_seconds
from ._scene import Scene
from ._trees import rrt_connect

RAISED_MM = (-20.0, -120.0, -250.0, -350.0)  # zed of the ways over the top
VIA_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the line, where its one point above it is
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
    ends = Ends.of(scene.layout, q_from, q_to)
    if leg_free(scene, q_from, q_to, ends):
        return (q_to,)
    known: dict[bytes, bool] = {}

    def free(a: FloatArray, b: FloatArray) -> bool:
        key = _key(a, b)
        if key not in known:
            known[key] = leg_seems_free(scene, a, b, ends) and leg_free(scene, a, b, ends)
        return known[key]

    for ways in (_over_one_point, _over_the_top):
        for path in _promising(scene, ways(q_from, q_to), ends):
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


def _over_one_point(a: FloatArray, b: FloatArray) -> list[list[FloatArray]]:
    """Return ways through one point above the line, and straight up and straight down."""
    ways: list[list[FloatArray]] = []
    for zed in RAISED_MM:
        up_a, up_b = _raised(a, zed), _raised(b, zed)
        vias = [up_a + share * (up_b - up_a) for share in VIA_SHARES]
        ways += [[via] for via in vias]
        ways += [[_hanging(via)] for via in vias[1:-1]]
        ways.append([up_a, up_b])
    return [_without_stops([a, *middle, b]) for middle in ways]


def _over_the_top(a: FloatArray, b: FloatArray) -> list[list[FloatArray]]:
    """Return ways that rise, turn and come down.

    With the hand hanging down, which at the top is above everything that stands in the cell, and
    with the arm drawn in.
    """
    ways: list[list[FloatArray]] = []
    for zed in RAISED_MM[:3]:
        up_a, up_b = _raised(a, zed), _raised(b, zed)
        hang_a, hang_b = _hanging(up_a), _hanging(up_b)
        ways.append([up_a, hang_a, hang_b, up_b])
        for elbow in ELBOWS_RAD:
            drawn_a, drawn_b = _drawn_in(up_a, elbow), _drawn_in(up_b, elbow)
            ways.append([up_a, drawn_a, drawn_b, up_b])
            drawn_a, drawn_b = _drawn_in(hang_a, elbow), _drawn_in(hang_b, elbow)
            ways.append([up_a, hang_a, drawn_a, drawn_b, hang_b, up_b])
    return [_without_stops([a, *middle, b]) for middle in ways]


def _raised(q: FloatArray, zed_mm: float) -> FloatArray:
    out = q.copy()
    out[3] = max(zed_mm, q[3])
    return out


def _hanging(q: FloatArray) -> FloatArray:
    out = q.copy()
    out[4] = -np.pi / 2
    return out


def _key(a: FloatArray, b: FloatArray) -> bytes:
    return a.tobytes() + b.tobytes()


def _promising(
    scene: Scene, paths: Sequence[list[FloatArray]], ends: Ends
) -> list[list[FloatArray]]:
    """Return those paths that a look at a few states of each leg leaves over, quickest first.

    Most ways over the top are closed, and many share their legs: one question about all of them
    costs little more than one about one.
    """
    legs: dict[bytes, int] = {}
    rows: list[FloatArray] = []
    for path in paths:
        for a, b in pairwise(path):
            if legs.setdefault(_key(a, b), len(rows)) == len(rows):
                rows.append(np.stack([a, b]))
    if not rows:
        return []
    pairs = np.stack(rows)
    seconds = leg_seconds(scene.layout, pairs[:, 0], pairs[:, 1])
    shut: BoolArray = np.asarray(~within_limits(pairs).all(axis=1))
    for shares in (1.0, 0.5, (0.25, 0.75), (0.12, 0.38, 0.62, 0.88)):
        left = np.flatnonzero(~shut)
        at = np.atleast_1d(shares)[:, None]
        q = pairs[left, None, 0] + at * (pairs[left, None, 1] - pairs[left, None, 0])
        q = q.reshape(-1, 6)
        near = ends.near(tip_pose(scene.layout, q)[:, :3, 3])
        free = scene.free(q, np.where(near, END_MARGIN_MM, MARGIN_MM))
        shut[left] |= ~free.reshape(len(left), -1).all(axis=1)
    found = []
    for k, path in enumerate(paths):
        its = [legs[_key(a, b)] for a, b in pairwise(path)]
        if its and not shut[its].any():
            found.append((float(seconds[its].sum()), k))
    return [paths[k] for _, k in sorted(found)]


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
