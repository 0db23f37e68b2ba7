"""Two random trees that grow towards each other, and shortening of the path between them.

RRT-Connect (Kuffner and LaValle, 2000) in joint space, with seconds of the slowest motor for a
distance. Work is counted in nodes, never in time: the same seed gives the same path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from controller.arrays import FloatArray

from ..model import JOINT_COUNT
from .scene import Scene
from .segments import BROAD_PHASE_TUBE_MM, MARGIN_MM, PathEnds, segment_free, segment_seems_free
from .timing import move_seconds, travel_seconds

TURN_COUNT = 400
SHUT_IN_COUNT = 80  # turns after which a tree with nothing but its root counts as enclosed
STEP_S = 0.8  # longest edge of a tree
SHRINK_COUNT = 2  # a third of an edge may be free where the whole is not
TOWARDS_ROOT = 0.1  # share of the turns that aim at the other tree's root
SAMPLE_COUNT = 96  # number drawn at a time; few are within limits and free
SHORTCUT_COUNT = 24


@dataclass(slots=True)
class _Tree:
    nodes: FloatArray
    parents: list[int] = field(default_factory=lambda: [-1])
    forward: bool = True

    def add(self, q: FloatArray, parent: int) -> int:
        self.nodes = np.vstack([self.nodes, q])
        self.parents.append(parent)
        return len(self.parents) - 1

    def trace(self, k: int) -> list[FloatArray]:
        """Return the path from node `k` back to the root."""
        chain = []
        while k >= 0:
            chain.append(self.nodes[k])
            k = self.parents[k]
        return chain


def rrt_connect(
    start: FloatArray, goal: FloatArray, scene: Scene, seed: int
) -> list[FloatArray] | None:
    """Return a path from start to goal, both included, or None where the trees do not meet.

    Parameters
    ----------
    start, goal : (6,) rows of joints
    scene : load on the arm, and the obstacles
    seed : seed of the samples; the same one gives the same path
    """
    rng = np.random.default_rng(seed)
    layout = scene.layout
    ends = PathEnds.of(layout, start, goal)
    trees = (_Tree(start[None]), _Tree(goal[None], forward=False))

    def extend(tree: _Tree, target: FloatArray) -> tuple[int, bool]:
        """Grow an edge towards a target; return the new node, -1 if none, and if it is there."""
        away_s = travel_seconds(layout, tree.nodes, target)
        k = int(np.argmin(away_s))
        arrives = bool(away_s[k] <= STEP_S)
        if away_s[k] < 1e-9:
            return k, True
        here = tree.nodes[k]
        new = target if arrives else here + (target - here) * STEP_S / away_s[k]
        for _ in range(SHRINK_COUNT):
            a, b = (here, new) if tree.forward else (new, here)
            if segment_seems_free(scene, a, b, ends, BROAD_PHASE_TUBE_MM):
                return tree.add(new, k), arrives
            new, arrives = here + (new - here) / 3, False
        return -1, False

    pool: list[FloatArray] = []
    for turn in range(TURN_COUNT):
        mine, other = trees[turn % 2], trees[1 - turn % 2]
        if turn >= SHUT_IN_COUNT and min(len(mine.parents), len(other.parents)) == 1:
            return None
        if not pool:
            pool = _free_samples(scene, rng)
        target = other.nodes[0] if rng.random() < TOWARDS_ROOT or not pool else pool.pop()
        k, _ = extend(mine, target)
        if k < 0:
            continue
        new, arrived, m = mine.nodes[k], False, 0
        while m >= 0 and not arrived:
            m, arrived = extend(other, new)
        if arrived:
            path = mine.trace(k)[::-1] + other.trace(m)[1:]
            path = path if mine.forward else path[::-1]
            if all(segment_free(scene, a, b, ends) for a, b in pairwise(path)):
                return shortened(path, scene, ends, rng)
    return None


def _free_samples(scene: Scene, rng: np.random.Generator) -> list[FloatArray]:
    """Return random configurations that are free themselves."""
    arm = scene.layout.arm
    q = arm.spread(rng.random((SAMPLE_COUNT, JOINT_COUNT)))
    q = q[arm.within_limits(q)]
    return list(q[scene.free(q, MARGIN_MM)])


def shortened(
    path: list[FloatArray], scene: Scene, ends: PathEnds, rng: np.random.Generator
) -> list[FloatArray]:
    """Return a quicker path: waypoints left out, then corners cut where that saves seconds.

    Parameters
    ----------
    path : (6,) each, free all along, both ends included
    scene : load on the arm, and the obstacles
    ends : ends of the whole path
    rng : source of randomness for cutting corners
    """
    layout = scene.layout

    def free(segments: Sequence[tuple[FloatArray, FloatArray]]) -> bool:
        return all(segment_seems_free(scene, a, b, ends) for a, b in segments) and all(
            segment_free(scene, a, b, ends) for a, b in segments
        )

    i = 0
    while i < len(path) - 2:
        for j in range(len(path) - 1, i + 1, -1):
            if free([(path[i], path[j])]):
                path = path[: i + 1] + path[j:]
                break
        i += 1
    for _ in range(SHORTCUT_COUNT):
        if len(path) < 3:
            break
        segments = np.sort(rng.choice(len(path) - 1, 2, replace=False))
        shares = rng.random(2)
        i, j = int(segments[0]), int(segments[1])
        a = path[i] + shares[0] * (path[i + 1] - path[i])
        b = path[j] + shares[1] * (path[j + 1] - path[j])
        if rng.random() < 0.5:
            a = path[i]
        if rng.random() < 0.5:
            b = path[j + 1]
        cut = [*path[: i + 1], *([] if a is path[i] else [a]), *([] if b is path[j + 1] else [b])]
        cut += path[j + 1 :]
        if move_seconds(layout, cut) >= move_seconds(layout, path) - 1e-9:
            continue
        kept = {(id(a), id(b)) for a, b in pairwise(path)}
        if free([(a, b) for a, b in pairwise(cut) if (id(a), id(b)) not in kept]):
            path = cut
    return path
