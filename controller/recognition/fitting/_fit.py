"""Sub-pixel pose: move a part until its visible edges lie on those of the picture.

Gauss-Newton over the distances along the edges' normals, under full perspective. The edges are
predicted anew when the part has moved, since what is seen of it changes with where it lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, transform

from ._measure import Gaps, Measure
from ._model import EdgeModel
from ._predict import EdgePoints, predict_edges, predict_outline

HUBER_PX = 1.0
LEAST_POINTS = 12
LEAST_REACH_PX = 2.5
LEAST_SIGMA_PX = 0.02
ON_TABLE = (0, 1, 5, 3, 4)  # freedoms of a part at rest: x, y, turn, tilts about x and y
SETTLED_PX = 0.004  # a step that moves no edge farther is the last one
CORRELATED_MM = 3.0  # errors of edge points nearer than this are one error: blur, pixels, facets
CALIBRATION_MM = 0.02  # what the camera's own calibration leaves, whatever the edges say


@dataclass(frozen=True, slots=True)
class FitOptions:
    """How a fit goes.

    Attributes
    ----------
    reach_px : one round for each: how far from the prediction an edge is looked for
    steps : Gauss-Newton steps in each round
    tilt_rad : standard deviation of the table's tilt about x and y; 0 to hold the part level
    most : edge samples looked at
    """

    reach_px: Sequence[float] = (10.0, 4.0)
    steps: int = 3
    tilt_rad: float = 0.0
    most: int = 900


@dataclass(frozen=True, eq=False, slots=True)
class EdgeFit:
    """A fitted pose.

    Attributes
    ----------
    T_world_part : (4, 4)
    edges : the visible edges predicted at that pose; of a measure that does not see inside the
        outline, that alone
    gaps : what the picture shows beside them
    sigma_px : robust standard deviation of the gaps
    covariance : (3, 3) of x [mm], y [mm] and the turn about z [rad] of the centre of mass
    """

    T_world_part: FloatArray
    edges: EdgePoints
    gaps: Gaps
    sigma_px: float
    covariance: FloatArray


def fit_edges(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    measure: Measure,
    options: FitOptions | None = None,
) -> EdgeFit | None:
    """Fit x, y and the turn about z, and if asked a small tilt, to a picture's edges.

    Parameters
    ----------
    model : edges of the part
    T_world_part : (4, 4) where to begin; within about ``reach_px`` of the truth
    camera : calibrated, in the world's frame
    measure : how edges are found in the picture
    options : how far and how often; None for the defaults

    Returns
    -------
    the fit, or None where the picture shows too few edges
    """
    options = options or FitOptions()
    T = T_world_part
    predict = predict_edges if measure.sees_inside else predict_outline
    for reach in options.reach_px:
        edges = predict(model, T, camera, options.most)
        if len(edges.pixels) < LEAST_POINTS:
            return None
        pivot = transform(T, model.centroid_mm[None])[0]
        jacobian = edge_jacobian(edges.points_mm, edges.normals, pivot, camera)[:, ON_TABLE]
        total = _descend(edges, jacobian, pivot, camera, measure, reach, options)
        if total is None:
            return None
        moved = _moved(total, pivot)
        T = moved @ T
    # the part has hardly moved in the last round: its edges are still the ones predicted
    edges = replace(edges, points_mm=transform(moved, edges.points_mm))
    edges = replace(edges, pixels=camera.project(edges.points_mm))
    gaps = measure.gaps(edges.pixels, edges.normals, edges, options.reach_px[-1])
    found = np.isfinite(gaps.gap_px)
    if found.sum() < LEAST_POINTS:
        return None
    residual = gaps.gap_px[found]
    sigma = max(1.48 * float(np.median(np.abs(residual))), LEAST_SIGMA_PX)
    weight = gaps.weight[found] / np.maximum(1.0, np.abs(residual) / max(HUBER_PX, 2 * sigma))
    covariance = _covariance(jacobian[found], weight, sigma, edges.step_mm)
    return EdgeFit(T, edges, gaps, sigma, covariance)


def _descend(
    edges: EdgePoints,
    jacobian: FloatArray,
    pivot: FloatArray,
    camera: Camera,
    measure: Measure,
    reach_px: float,
    options: FitOptions,
) -> FloatArray | None:
    """Return the motion (5,) that some steps with one set of edges come to, None for too few."""
    total = np.zeros(5)
    columns = 5 if options.tilt_rad > 0 else 3
    pixels = edges.pixels
    for step in range(options.steps):
        reach = max(reach_px / (1 + step), LEAST_REACH_PX)
        gaps = measure.gaps(pixels, edges.normals, edges, reach)
        found = np.isfinite(gaps.gap_px)
        if found.sum() < LEAST_POINTS:
            return None
        gap, slopes = gaps.gap_px[found], jacobian[found, :columns]
        spread = max(HUBER_PX, 1.48 * float(np.median(np.abs(gap))))
        weight = gaps.weight[found] / np.maximum(1.0, np.abs(gap) / spread)
        normal = (slopes * weight[:, None]).T @ slopes
        pull = (slopes * weight[:, None]).T @ gap
        normal[np.diag_indices(3)] += 1e-9 * np.diag(normal)[:3] + 1e-12
        if columns == 5:
            stiff = _per_point(edges.step_mm) ** -1 * spread**2 / options.tilt_rad**2
            normal[[3, 4], [3, 4]] += stiff
            pull[3:] -= stiff * total[3:5]
        change = np.linalg.solve(normal, pull)
        total[:columns] += change
        pixels = camera.project(transform(_moved(total, pivot), edges.points_mm))
        if np.abs(slopes @ change).max() < SETTLED_PX:
            break
    return total


def _moved(step: FloatArray, pivot: FloatArray) -> FloatArray:
    """Return the motion (4, 4) of x, y, the turn about z, and tilts about x and y."""
    R, _ = cv2.Rodrigues(np.array([step[3], step[4], step[2]]))
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = pivot + np.array([step[0], step[1], 0.0]) - R @ pivot
    return T


def edge_jacobian(
    points_mm: FloatArray, normals: FloatArray, pivot: FloatArray, camera: Camera
) -> FloatArray:
    """Return how far edge points move along their normals in the picture as a part moves, (n, 6).

    Columns are d(pixel) / d(shift along x, y, z [mm], rotation about x, y, z [rad]).

    Parameters
    ----------
    points_mm : (n, 3) world
    normals : (n, 2) unit, in the picture
    pivot : (3,) the point rotations leave where it is
    camera : calibrated, in the world's frame
    """
    R_cam_world = camera.T_world_cam[:3, :3].T
    local = (points_mm - camera.position_mm) @ R_cam_world.T
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    z = local[:, 2]
    zero = np.zeros_like(z)
    # distortion changes the local scale by less than a percent: further steps take care of it
    du = np.column_stack([fx / z, zero, -fx * local[:, 0] / z**2]) @ R_cam_world
    dv = np.column_stack([zero, fy / z, -fy * local[:, 1] / z**2]) @ R_cam_world
    along = normals[:, :1] * du + normals[:, 1:] * dv
    return np.hstack([along, np.cross(points_mm - pivot, along)])


def _per_point(step_mm: float) -> float:
    """Return how many independent measurements a sample counts for, at most 1."""
    return min(1.0, step_mm / CORRELATED_MM)


def _covariance(
    jacobian: FloatArray, weight: FloatArray, sigma_px: float, step_mm: float
) -> FloatArray:
    information = (jacobian[:, :3] * weight[:, None]).T @ jacobian[:, :3]
    information *= _per_point(step_mm) / sigma_px**2
    # a round part says nothing of its turn: half a turn is what is known then
    information[2, 2] += 1.0 / np.pi**2
    spread = np.linalg.inv(information + 1e-9 * np.eye(3))
    spread[[0, 1], [0, 1]] += CALIBRATION_MM**2
    return np.asarray(spread, dtype=np.float64)
