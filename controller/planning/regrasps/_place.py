"""Putting the part into a tray: set down flat if the last grasp allows, else let go leaning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import StablePose
from controller.imaging import inverse_pose

from ..model import CellLayout, Grasp, PreparedPart, Tray
from ..motion import Scene, fewest_waypoints, inverse_rows, same_branch

RELEASE_MM = 3.0  # height of release above the tray's floor
UP_MM = 100.0
STEP_MM = 10.0
MARGIN_MM = 3.0
TRIED_COUNT = 60
RISEN_COUNT = 20
BATCH_SIZE = 8
FLAT_RAD = 1e-6
STEADY_RAD = np.radians(20.0)  # a part that tips sooner may fall over when the jaws release it
# least angle below the horizontal at which the arm gripper comes down
FROM_ABOVE_RAD = np.radians(30.0)


def is_steady(pose: StablePose) -> bool:
    """Return True if a part released in a stable pose stays there."""
    return bool(not pose.rolling and pose.topple_rad >= STEADY_RAD)


def stands_steadily(part: PreparedPart, grasp: Grasp) -> bool:
    """Return True if a grasp can put the part down from above in a pose in which it stays."""
    fingers = grasp.T_part_tcp[:3, 0]
    lowest = -np.sin(FROM_ABOVE_RAD)
    return any(bool(p.R[2] @ fingers <= lowest) for p in part.poses if is_steady(p))


@dataclass(frozen=True, slots=True, eq=False)
class PlacePath:
    """Joints down (k, 6) to where the part is let go, up (k, 6) from there."""

    down: FloatArray
    up: FloatArray
    T_world_part: FloatArray
    tilt_rad: float


def place_paths(
    part: PreparedPart, layout: CellLayout, grasp: Grasp, tray: Tray, count: int = 4
) -> list[PlacePath]:
    """Return the paths on which one grasp releases the part in a tray, the flattest first.

    Of those that put it down flat, the ones in a pose that is hard to tip come first.

    In a nest the part is set down flat, with its outline within the nest, and turned as the nest
    has it. Paths from which the arm can rise come before those in which it may be trapped; none is
    a result.

    Parameters
    ----------
    part : prepared
    layout : the cell
    grasp : as the arm holds it
    tray : target tray
    count : at most so many
    """
    nest = tray.nest
    if nest is not None and nest.turn_rad is not None:
        R_part = np.stack([_turned(nest.turn_rad) @ pose.R for pose in part.poses])
    else:
        R_part = _gripper_orientations() @ grasp.T_part_tcp[:3, :3].T
    hull = part.solid.hull_mm
    T_part = np.tile(np.eye(4), (len(R_part), 1, 1))
    T_part[:, :3, :3] = R_part
    leans = np.arccos(
        np.clip(np.stack([T_part[:, 2, :3] @ p.R[2] for p in part.poses], axis=1), -1, 1)
    )
    tilts = leans.min(axis=1)
    is_unsteady = ~np.array([is_steady(pose) for pose in part.poses])[leans.argmin(axis=1)]
    # part axes to world axes of a resting pose exactly, where the arm gripper comes nearly like
    # that
    for leaning in np.flatnonzero((tilts > 1e-6) & (tilts < np.radians(3.0))):
        T_part[leaning, :3, :3] = _flattened(T_part[leaning, :3, :3], part)
        tilts[leaning] = 0.0
    points = np.einsum("nij,kj->nki", T_part[:, :3, :3], hull)
    low, high = points.min(axis=1), points.max(axis=1)
    centre = T_part[:, :3, :3] @ part.solid.centroid_mm if nest is None else (low + high) / 2
    T_part[:, :2, 3] = np.array(tray.target_mm) - centre[:, :2]
    T_part[:, 2, 3] = RELEASE_MM - low[:, 2]
    if nest is not None:
        fits = (high - low)[:, :2] <= np.array(nest.size_mm)
        within = fits.all(axis=1) & (tilts < FLAT_RAD)
        T_part, tilts, is_unsteady = T_part[within], tilts[within], is_unsteady[within]
        if len(T_part) == 0:
            return []
    T_hold = T_part @ grasp.T_part_tcp
    index, branch, q = inverse_rows(layout, T_hold)
    if len(index) == 0:
        return []
    order = np.lexsort((is_unsteady[index], np.round(tilts[index], 2)))
    shut = Scene(layout, grasp.opening_mm, layout.fixed_open_mm, carried_mesh=part.carried(grasp))
    open_ = Scene(layout, grasp.pre_open_mm, layout.fixed_open_mm)
    good = shut.free(q[order], MARGIN_MM, table_margin_mm=1.0)
    good &= open_.free(q[order], MARGIN_MM)
    order = order[good][:TRIED_COUNT]
    if len(order) == 0:
        return []
    k = np.arange(1, round(UP_MM / STEP_MM) + 1) * STEP_MM
    T_down = np.repeat(T_hold[index[order]][:, None], len(k), axis=1)
    T_down[..., 2, 3] += k
    T_up = np.repeat(T_hold[index[order]][:, None], len(k), axis=1)
    T_up[..., :3, 3] -= k[None, :, None] * T_hold[index[order]][:, None, :3, 0]
    down, up = same_branch(layout, T_down, branch[order]), same_branch(layout, T_up, branch[order])
    rising: list[PlacePath] = []
    trapped: list[PlacePath] = []
    whole = np.isfinite(down).all(axis=(1, 2)) & np.isfinite(up).all(axis=(1, 2))
    rows = np.flatnonzero(whole)
    for begin in range(0, len(rows), BATCH_SIZE):
        batch = rows[begin : begin + BATCH_SIZE]
        clear = _all_free(shut, down[batch], table_margin_mm=1.0) & _all_free(open_, up[batch])
        batch = batch[clear]
        # an elbow under the station's panel can come down here, but hardly get there
        risen = _all_free(shut, layout.arm.retreats(down[batch, -1], RISEN_COUNT), margin_mm=10.0)
        risen &= _all_free(open_, layout.arm.retreats(up[batch, -1], RISEN_COUNT), margin_mm=10.0)
        for place, is_rising in zip(batch, risen, strict=True):
            row = order[place]
            path = PlacePath(
                fewest_waypoints(layout, np.vstack([down[place][::-1], q[row]])),
                fewest_waypoints(layout, np.vstack([q[row], up[place]])),
                T_hold[index[row]] @ inverse_pose(grasp.T_part_tcp),
                float(tilts[index[row]]),
            )
            (rising if is_rising else trapped).append(path)
            if len(rising) == count:
                return rising
    return (rising + trapped)[:count]


def _turned(turn_rad: float) -> FloatArray:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _all_free(
    scene: Scene,
    paths: FloatArray,
    margin_mm: float = MARGIN_MM,
    table_margin_mm: float | None = None,
) -> BoolArray:
    """Return a mask (n,) of the paths (n, k, 6) that are free all along."""
    n, k = paths.shape[:2]
    free = scene.free(paths.reshape(-1, 6), margin_mm, table_margin_mm)
    return np.asarray(free.reshape(n, k).all(axis=1))


@cache
def _gripper_orientations() -> FloatArray:
    """Return gripper rotations (n, 3, 3) over pitch, heading and roll, straight down first."""
    found = []
    for pitch in np.radians([-90.0, -75.0, -60.0, -45.0, -30.0, -15.0, 0.0]):
        headings = [0.0] if pitch < np.radians(-89) else np.radians(np.arange(-180, 180, 20.0))
        for heading in headings:
            for roll in np.radians(np.arange(-180, 180, 15.0)):
                ch, sh = np.cos(heading), np.sin(heading)
                cp, sp = np.cos(pitch), np.sin(pitch)
                cr, sr = np.cos(roll), np.sin(roll)
                x = np.array([ch * cp, sh * cp, sp])
                y0, z0 = np.array([-sh, ch, 0.0]), np.array([-ch * sp, -sh * sp, cp])
                found.append(np.column_stack([x, cr * y0 + sr * z0, cr * z0 - sr * y0]))
    return np.stack(found)


def _flattened(R: FloatArray, part: PreparedPart) -> FloatArray:
    """Turn a nearly resting orientation by the little it takes to rest exactly."""
    ups = np.stack([p.R[2] for p in part.poses])
    up = ups[int(np.argmax(ups @ R[2]))]
    now = R @ up  # nearly +z
    axis = np.cross(now, [0.0, 0.0, 1.0])
    s, c = float(np.linalg.norm(axis)), float(now[2])
    if s < 1e-12:
        return R
    k = axis / s
    K = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    out: FloatArray = (np.eye(3) + s * K + (1 - c) * (K @ K)) @ R
    return out
