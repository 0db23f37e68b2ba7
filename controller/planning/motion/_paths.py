"""Collision-free paths between configurations, with as few whole joint moves as possible.

Tried in turn: one joint line, the arm's own detours, two random trees. Every answer has been
checked segment by segment, with the space the arm may stray into (planning-facts.md 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from controller.arrays import BoolArray, FloatArray
from messages import say

from ..model import NoMotionError
from ._kinematics import tcp_pose
from .scene import Scene
from .segments import END_MARGIN_MM, MARGIN_MM, PathEnds, segment_free, segment_seems_free
from .timing import segment_seconds
from .trees import rrt_connect


def path_free(scene: Scene, path: Sequence[FloatArray]) -> bool:
    """Return True if joint moves through waypoints are free, with thinner margins at both ends."""
    ends = PathEnds.of(scene.layout, path[0], path[-1])
    return all(segment_free(scene, a, b, ends) for a, b in pairwise(path))


def connect(
    q_from: FloatArray,
    q_to: FloatArray,
    scene: Scene,
    what: str,
    seed: int = 0,
    search: bool = True,
) -> tuple[FloatArray, ...]:
    """Return waypoints from `q_from` (left out) to `q_to` (the last) without contact.

    Tried in turn: the joint line; the arm's detours, group by group, the quickest first; two random
    trees, unless `search` is False because the caller has another goal to try.

    Parameters
    ----------
    q_from, q_to : (6,) rows of joints
    scene : load on the arm, and the obstacles
    what : the path is for, as a message begins
    seed : seed of the random trees
    search : False: no trees, because the caller has another goal to try

    Raises
    ------
    NoMotionError : no path was found; the message begins with `what`
    """
    ends = PathEnds.of(scene.layout, q_from, q_to)
    if segment_free(scene, q_from, q_to, ends):
        return (q_to,)
    known: dict[bytes, bool] = {}

    def free(a: FloatArray, b: FloatArray) -> bool:
        key = _key(a, b)
        if key not in known:
            known[key] = segment_seems_free(scene, a, b, ends) and segment_free(scene, a, b, ends)
        return known[key]

    arm = scene.layout.arm
    for paths in arm.detours(q_from, q_to):
        for path in _promising(scene, paths, ends):
            if all(free(a, b) for a, b in pairwise(path)):
                return tuple(path[1:])
    found = rrt_connect(q_from, q_to, scene, seed) if search else None
    if found is None:
        raise NoMotionError(
            say(
                "{what}: no path free of contact found from {begin} to "
                "{end}; clear the space between or move the part",
                what=what,
                begin=arm.describe(q_from),
                end=arm.describe(q_to),
            )
        )
    return tuple(found[1:])


def _key(a: FloatArray, b: FloatArray) -> bytes:
    return a.tobytes() + b.tobytes()


def _promising(
    scene: Scene, paths: Sequence[Sequence[FloatArray]], ends: PathEnds
) -> list[Sequence[FloatArray]]:
    """Return the paths that pass a check of a few states of each segment, quickest first.

    Most detours are closed, and many share their segments: one check of all of them costs little
    more than one of a single one.
    """
    segments: dict[bytes, int] = {}
    rows: list[FloatArray] = []
    for path in paths:
        for a, b in pairwise(path):
            if segments.setdefault(_key(a, b), len(rows)) == len(rows):
                rows.append(np.stack([a, b]))
    if not rows:
        return []
    pairs = np.stack(rows)
    seconds = segment_seconds(scene.layout, pairs[:, 0], pairs[:, 1])
    shut: BoolArray = np.asarray(~scene.layout.arm.within_limits(pairs).all(axis=1))
    for shares in (1.0, 0.5, (0.25, 0.75), (0.12, 0.38, 0.62, 0.88)):
        left = np.flatnonzero(~shut)
        at = np.atleast_1d(shares)[:, None]
        q = pairs[left, None, 0] + at * (pairs[left, None, 1] - pairs[left, None, 0])
        q = q.reshape(-1, 6)
        near = ends.near(tcp_pose(scene.layout, q)[:, :3, 3])
        free = scene.free(q, np.where(near, END_MARGIN_MM, MARGIN_MM))
        shut[left] |= ~free.reshape(len(left), len(at)).all(axis=1)
    found = []
    for k, path in enumerate(paths):
        its = [segments[_key(a, b)] for a, b in pairwise(path)]
        if its and not shut[its].any():
            found.append((float(seconds[its].sum()), k))
    return [paths[k] for _, k in sorted(found)]
