"""Shares of outline that parts can have in common with the picture, many at once.

Outlines are moved in the table plane until they lie on the visible one. That ignores the change of
perspective between places, but takes a fraction of a fit's time, and hopeless candidates need no
fit.
"""

from collections.abc import Sequence

import numpy as np

from controller.arrays import FloatArray

from ..fitting import predict_outline
from ..library import Candidate, Library, pose_on_table
from .cluster import BEYOND, INSIDE, OUTSIDE, Cluster

SAMPLES = 120  # samples of a predicted outline
STEPS = 4
MIN_REACH_MM = 1.5  # reach of the last steps
SAME_NORMAL = 0.5  # cosine; as a fit to an outline has it
HUBER_MM = 0.3
NEAR_MM = 0.5  # offset at which an outline point counts 0.6
# Largest error of a predicted outline that is moved, and this share of the allowance for its place.
MOVED_MM, MOVED_SHARE = 0.1, 0.05
SURE_MM = 3.0  # offset up to which a part looks nearly the same
HOPEFUL = 0.2  # share met at first below which it is another part, or lies elsewhere
# distance outside an outline at which the cluster goes on where something covers it
COVERED_MM = 0.5
HELD_MM2 = 1e-6  # least information, so that a motion without any is zero


class _Outlines:
    """Outlines in the table plane: points, normals away from the part (n, k), weights.

    Parameters
    ----------
    points, normals : (n, k, 2)
    weights : (n, k)
    pivots_mm : (n, 2) fixed points of a turn
    """

    def __init__(
        self, points: FloatArray, normals: FloatArray, weights: FloatArray, pivots_mm: FloatArray
    ) -> None:
        arm = points - pivots_mm[:, None]
        self.x, self.y = np.ascontiguousarray(np.moveaxis(arm, 2, 0), dtype=np.float64)
        self.nx, self.ny = np.ascontiguousarray(np.moveaxis(normals, 2, 0), dtype=np.float64)
        self.weights = weights
        self.pivots_mm = pivots_mm


def predicted_shares(
    candidates: Sequence[Candidate], cluster: Cluster, library: Library, reach_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Return the shares of parts' outlines that can be matched to the observed one.

    If a part's position is uncertain, its outline is predicted once more at the position of the
    first fit, since a tall part looks different there.

    Parameters
    ----------
    candidates : parts, each about where it may lie
    cluster : cluster as seen
    library : library of these parts
    reach_mm : largest distance between them, plus the uncertainty of their positions

    Returns
    -------
    the share (n,) of each outline that lies on the one seen, and the share that is covered
    """
    poses = np.array([[c.x_mm, c.y_mm, c.theta_rad] for c in candidates])
    slack = np.array([c.slack_mm for c in candidates])
    found, covered = np.zeros((2, len(poses)))
    which = np.arange(len(poses))
    for is_last in (False, True):
        own = [candidates[k] for k in which.tolist()]
        outlines = _predicted(own, poses[which], cluster, library)
        loose = MOVED_MM + MOVED_SHARE * slack[which]
        met, hidden, moved = _met(outlines, cluster, reach_mm + slack[which], loose)
        is_better = met >= found[which]
        found[which] = np.where(is_better, met, found[which])
        covered[which] = np.where(is_better, hidden, covered[which])
        poses[which] = poses[which] + moved
        which = np.flatnonzero((slack > SURE_MM) & (found > HOPEFUL))
        if is_last or len(which) == 0:
            break
    return found, covered


def _predicted(
    candidates: Sequence[Candidate], poses: FloatArray, cluster: Cluster, library: Library
) -> _Outlines:
    """Return the outlines of parts in poses (n, 3): x, y [mm] and turn, as shadows on the table."""
    camera = cluster.camera
    eye = camera.position_mm
    found = []
    for c, (x_mm, y_mm, theta_rad) in zip(candidates, poses.tolist(), strict=True):
        model, pose = library.model(c.part), library.entries[c.part].pose(c.pose)
        T = pose_on_table(model, pose, x_mm, y_mm, theta_rad)
        edges = predict_outline(model, T, camera, SAMPLES)
        away = edges.points_mm - eye
        shadow = eye[:2] - away[:, :2] * (eye[2] / away[:, 2:])
        found.append((shadow, edges.normals @ camera.T_world_cam[:2, :2].T))
    most = max(1, *(len(shadow) for shadow, _ in found))
    points, normals = np.zeros((2, len(found), most, 2))
    points += poses[:, None, :2]
    weights = np.zeros((len(found), most))
    for k, (shadow, outward) in enumerate(found):
        points[k, : len(shadow)], normals[k, : len(shadow)] = shadow, outward
        weights[k, : len(shadow)] = 1.0
    return _Outlines(points, normals, weights, poses[:, :2])


def _met(
    outlines: _Outlines, cluster: Cluster, reach_mm: FloatArray, loose_mm: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the shares (n,) of outlines that lie on the one seen or are covered, and the motion.

    Parameters
    ----------
    outlines : outlines to search in
    cluster : cluster as seen
    reach_mm : (n,) largest distance between them
    loose_mm : (n,) largest difference of an outline from another one
    """
    seen = cluster.map
    seen_x, seen_y = seen.points.T
    seen_nx, seen_ny = seen.normals.T
    weights = outlines.weights
    whole = np.maximum(weights.sum(axis=1), 1e-9)
    moved = np.zeros((len(weights), 3))
    for step in range(STEPS + 1):
        cos, sin = np.cos(moved[:, 2:]), np.sin(moved[:, 2:])
        arm_x = cos * outlines.x - sin * outlines.y
        arm_y = sin * outlines.x + cos * outlines.y
        x = arm_x + (outlines.pivots_mm[:, 0] + moved[:, 0])[:, None]
        y = arm_y + (outlines.pivots_mm[:, 1] + moved[:, 1])[:, None]
        _, nearest, here = seen.look(x, y)
        nx, ny = seen_nx[nearest], seen_ny[nearest]
        gap = (seen_x[nearest] - x) * nx + (seen_y[nearest] - y) * ny
        size = np.abs(gap)
        out_x = cos * outlines.nx - sin * outlines.ny
        out_y = sin * outlines.nx + cos * outlines.ny
        counts = weights * (out_x * nx + out_y * ny > SAME_NORMAL)
        if step == STEPS:
            break
        reach = np.maximum(reach_mm / (1 + step), MIN_REACH_MM)[:, None]
        pull = counts * (size < reach) / np.maximum(1.0, size / HUBER_MM)
        slopes = np.stack([nx, ny, arm_x * ny - arm_y * nx], axis=1)
        weighted = slopes * pull[:, None]
        known = weighted @ slopes.transpose(0, 2, 1) + HELD_MM2 * np.eye(3)
        moved = moved + np.linalg.solve(known, weighted @ gap[..., None])[..., 0]
    off = np.maximum(size - loose_mm[:, None], 0.0)
    near = np.exp(-0.5 * (off / NEAR_MM) ** 2)
    far_out = COVERED_MM + loose_mm[:, None]
    _, _, beside = seen.look(x + far_out * out_x, y + far_out * out_y)
    is_covered = (here == BEYOND) | ((here != OUTSIDE) & (beside == INSIDE))
    covered = weights * (is_covered & (counts * near < 0.5 * weights))
    return (counts * near).sum(axis=1) / whole, covered.sum(axis=1) / whole, moved
