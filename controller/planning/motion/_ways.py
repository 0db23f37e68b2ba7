"""Collision-free ways between configurations, and how long they take.

The arm takes whole joint moves: every axis runs at its own speed and the controller stretches
them so that they end together, roughly. A way is therefore checked as straight lines in joint
space with a tube of 10 mm round everything that moves (planning.md 3.3).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from drivers.umi_scara.kinematics import within_limits

from ..errors import NoMotionError
from ..layout import CellLayout, FloatArray
from ._scene import Scene, tip_pose

TUBE_MM = 10.0
END_TUBE_MM = 2.0  # next to a hold or the fixture: all axes start and end where they were told
END_LENGTH_MM = 60.0
# one step of a checked line moves the tip by less than the tube
STEP = np.array([*np.radians([1.5, 1.5, 3.0]), 8.0, *np.radians([3.0, 3.0])])
RAISED_MM = (-20.0, -120.0, -250.0)  # zed of the ways over the top
RRT_NODES_N = 500
RRT_STEP_S = 0.6


def move_seconds(layout: CellLayout, path: Sequence[FloatArray] | FloatArray) -> float:
    """Return the forecast of driving along waypoints (k, 6), the first being where it starts."""
    q = np.asarray(path)
    if len(q) < 2:
        return 0.0
    speed = np.array(layout.pace.joint_per_s)
    legs = (np.abs(np.diff(q, axis=0)) / speed).max(axis=1)
    return float((legs + layout.pace.start_stop_s * (legs > 1e-6)).sum())


def line(q_from: FloatArray, q_to: FloatArray) -> FloatArray:
    """Return the joint line between two configurations in steps short enough to check (k, 6)."""
    steps = max(1, int(np.ceil((np.abs(q_to - q_from) / STEP).max())))
    share = np.linspace(0.0, 1.0, steps + 1)[:, None]
    out: FloatArray = q_from + share * (q_to - q_from)
    return out


def path_free(scene: Scene, path: Sequence[FloatArray]) -> bool:
    """Tell whether joint lines through waypoints are free, with a thinner tube at both ends."""
    q = np.vstack([line(a, b) for a, b in pairwise(path)])
    if not within_limits(q).all():
        return False
    tip = tip_pose(scene.layout, q)[:, :3, 3]
    near = np.minimum(np.linalg.norm(tip - tip[0], axis=1), np.linalg.norm(tip - tip[-1], axis=1))
    close = near < END_LENGTH_MM
    # the coarse pass finds most contacts at an eighth of the work
    for part in (slice(4, None, 8), slice(None)):
        wide, thin = q[part][~close[part]], q[part][close[part]]
        if not scene.free(wide, TUBE_MM).all() or not scene.free(thin, END_TUBE_MM).all():
            return False
    return True


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
    if path_free(scene, [q_from, q_to]):
        return (q_to,)
    ways = [[q_from, *middle, q_to] for middle in _over_the_top(q_from, q_to)]
    for path in sorted(ways, key=lambda w: move_seconds(scene.layout, w)):
        if path_free(scene, path):
            return tuple(path[1:])
    found = _rrt_connect(q_from, q_to, scene, seed) if search else None
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
    """Return middles of ways that rise, turn and come down.

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
        for elbow in np.radians([-140.0, -90.0, 90.0, 140.0]):
            drawn_a, drawn_b = _drawn_in(up_a, elbow), _drawn_in(up_b, elbow)
            ways.append([up_a, drawn_a, drawn_b, up_b])
            drawn_a, drawn_b = _drawn_in(hang_a, elbow), _drawn_in(hang_b, elbow)
            ways.append([up_a, hang_a, drawn_a, drawn_b, hang_b, up_b])
    return ways


def _drawn_in(q: FloatArray, elbow_rad: float) -> FloatArray:
    """Return `q` with another elbow, the hand keeping its place on the forearm."""
    out = q.copy()
    out[2] += (elbow_rad - q[1]) / 2
    out[1] = elbow_rad
    return out


def _rrt_connect(
    start: FloatArray, goal: FloatArray, scene: Scene, seed: int
) -> list[FloatArray] | None:
    """Grow two trees towards each other; distances are in seconds of the slowest axis."""
    rng = np.random.default_rng(seed)
    speed = np.array(scene.layout.pace.joint_per_s)
    low = np.radians([-90.0, -175.0, -190.0, 0.0, -97.0, -131.0])
    high = np.radians([90.0, 150.0, 185.0, 0.0, 3.0, 180.0])
    low[3], high[3] = -900.0, -10.0
    trees = [([start], [-1]), ([goal], [-1])]
    for turn in range(RRT_NODES_N):
        mine, other = trees[turn % 2], trees[1 - turn % 2]
        target = low + rng.random(6) * (high - low)
        target = start + (target - start) if rng.random() < 0.9 else other[0][-1]
        new = _extend(mine, target, scene, speed)
        if new is None:
            continue
        while True:
            step = _extend(other, new, scene, speed)
            if step is None:
                break
            if np.allclose(step, new):
                path = _trace(mine)[::-1] + _trace(other)[1:]
                path = path if turn % 2 == 0 else path[::-1]
                return _shortcut(path, scene, rng)
    return None


def _extend(
    tree: tuple[list[FloatArray], list[int]], target: FloatArray, scene: Scene, speed: FloatArray
) -> FloatArray | None:
    nodes, parents = tree
    away = (np.abs(np.stack(nodes) - target) / speed).max(axis=1)
    k = int(np.argmin(away))
    if away[k] < 1e-9:
        return None
    new = nodes[k] + (target - nodes[k]) * min(1.0, RRT_STEP_S / away[k])
    q = line(nodes[k], new)
    root = nodes[0]
    tip = tip_pose(scene.layout, q)[:, :3, 3] - tip_pose(scene.layout, root)[:3, 3]
    close = np.linalg.norm(tip, axis=1) < END_LENGTH_MM
    if not within_limits(q).all():
        return None
    if not (scene.free(q[~close], TUBE_MM).all() and scene.free(q[close], END_TUBE_MM).all()):
        return None
    nodes.append(new)
    parents.append(k)
    return np.asarray(new)


def _trace(tree: tuple[list[FloatArray], list[int]]) -> list[FloatArray]:
    nodes, parents = tree
    path, k = [], len(nodes) - 1
    while k >= 0:
        path.append(nodes[k])
        k = parents[k]
    return path


def _shortcut(path: list[FloatArray], scene: Scene, rng: np.random.Generator) -> list[FloatArray]:
    for _ in range(40):
        if len(path) < 3:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and path_free(scene, [path[i], path[j]]):
            path = path[: i + 1] + path[j:]
    return path
