"""Sub-pixel pose: move a part until its visible edges lie on those of the picture.

Gauss-Newton over the distances along the edges' normals, under full perspective. The edges are
predicted anew when the part has moved, since the visible edges depend on its pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import StablePose
from controller.imaging import Camera, transform

from ._measure import Gaps, Measure
from ._model import EdgeModel
from ._predict import ModelEdgePoints, cross, predict_edges, predict_outline

HUBER_PX = 1.0
MIN_POINTS = 12
MIN_REACH_PX = 2.5
MIN_SIGMA_PX = 0.02
ON_TABLE = np.array([0, 1, 5])  # freedoms of a part at rest: x, y, turn about z
DAMPED = 1e-9  # share of a freedom's information, so that a freedom without any stays in place
SETTLED_PX = 0.004  # a step that moves no edge farther is the last one
CORRELATED_MM = 3.0  # edge points nearer than this share their errors: blur, pixels, facets
# error of the camera's calibration, which remains however many edges there are
CALIBRATION_MM = 0.02
FINE_REACH_MM = (1.5, 0.8)  # rounds of a full fit: offsets that a coarse one leaves
UNSEEN_PX = 99.0  # distance of an edge that is not seen: farther than any that counts
CLOSE_PX = 2.0  # offset of an edge that counts 0.6 in a coarse score
TILT_RAD = 0.0015  # standard deviation of the table's tilt, and of what a chip under a part makes
# The same of a part that rests on a curve, which friction holds beside its lowest place; under
# lamps a wall's dark foot is easily lost, and a tilt would make up for it.
ROCKING_RAD, ROCKING_LIT_RAD = 0.02, 0.006


@dataclass(frozen=True, eq=False, slots=True)
class Prior:
    """Knowledge of a pose before the picture.

    Attributes
    ----------
    shift_mm, rotation_rad : (3,) standard deviations along and about the world's axes; 0 holds a
        freedom where it is, inf leaves it to the picture
    T_world_part : (4, 4) the pose expected; None for where each round of a fit begins
    """

    shift_mm: tuple[float, float, float]
    rotation_rad: tuple[float, float, float]
    T_world_part: FloatArray | None = None


def at_rest(tilt_rad: float = 0.0) -> Prior:
    """Return the prior of a part on the table: x, y and turn are free.

    Parameters
    ----------
    tilt_rad : standard deviation of the table's tilt about x and y; 0 to hold the part level
    """
    return Prior((np.inf, np.inf, 0.0), (tilt_rad, tilt_rad, np.inf))


def at_rest_in(pose: StablePose, *, is_lit: bool) -> Prior:
    """Return the prior of a part in a stable pose on the table.

    Parameters
    ----------
    pose : it may rest on a face or on a curve
    is_lit : True under lamps, where edges tell less of a tilt
    """
    if not (pose.rocking or pose.rolling):
        return at_rest(TILT_RAD)
    return at_rest(ROCKING_LIT_RAD if is_lit else ROCKING_RAD)


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit.

    Attributes
    ----------
    reach_px : one round for each: how far from the prediction an edge is looked for
    steps : Gauss-Newton steps in each round
    prior : free parameters, and their prior standard deviations
    noise : error of an edge when it is weighed against the prior, as a share of the scale of
        Huber's weights. On a table edges err by whole pixels together, through the dark foot of a
        wall or stray light; before a backlight panel they do not
    most : edge samples looked at
    """

    reach_px: Sequence[float] = (10.0, 4.0)
    steps: int = 3
    prior: Prior = field(default_factory=at_rest)
    noise: float = 1.0
    most: int = 900


@dataclass(frozen=True, eq=False, slots=True)
class EdgeFit:
    """A fitted pose.

    Attributes
    ----------
    T_world_part : (4, 4)
    edges : the visible edges predicted at that pose; of a measure that does not see inside the
        outline, that alone
    gaps : further edges of the picture beside them
    sigma_px : robust standard deviation of the gaps
    covariance : (3, 3) covariance of x [mm], y [mm] and the turn about z [rad] of the centre of
        mass, if nothing else is unknown
    """

    T_world_part: FloatArray
    edges: ModelEdgePoints
    gaps: Gaps
    sigma_px: float
    covariance: FloatArray

    @property
    def off_px(self) -> FloatArray:
        """Distance of each predicted edge (n,) from the one seen; `UNSEEN_PX` for none."""
        return np.abs(np.nan_to_num(self.gaps.gap_px, nan=UNSEEN_PX))

    @property
    def closeness(self) -> FloatArray:
        """Nearness of each predicted edge (n,) to one seen, 0..1."""
        return np.asarray(np.exp(-0.5 * (self.off_px / CLOSE_PX) ** 2))

    @property
    def score(self) -> float:
        """Share of predicted edges that are about where they should be, by their weight."""
        weight = self.gaps.weight
        return float((self.closeness * weight).sum() / max(weight.sum(), 1e-9))

    def at(self, which: BoolArray) -> "EdgeFit":
        """Return the fit with only the edges of a mask (n,)."""
        gaps = Gaps(self.gaps.gap_px[which], self.gaps.weight[which])
        return replace(self, edges=self.edges.at(which), gaps=gaps)


def fit_edges(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    measure: Measure,
    options: FitOptions | None = None,
    first: ModelEdgePoints | None = None,
) -> EdgeFit | None:
    """Fit a pose to a picture's edges, within the freedom of the prior.

    Parameters
    ----------
    model : edges of the part
    T_world_part : (4, 4) pose to start from; within about ``reach_px`` of the truth
    camera : calibrated, in the world's frame
    measure : edge finder
    options : range and number of steps, and the free parameters; None for a part that lies level
    first : the edges predicted at the start, if they are known

    Returns
    -------
    the fit, or None where the picture shows too few edges
    """
    options = options or FitOptions()
    T = T_world_part
    for reach in options.reach_px:
        edges = first or _first_edges(model, T, camera, measure, options)
        first = None
        if len(edges.pixels) < MIN_POINTS:
            return None
        pivot = transform(T, model.centroid_mm[None])[0]
        jacobian = edge_jacobian(edges.points_mm, edges.normals, pivot, camera)
        done = _away(T, options.prior, model.centroid_mm)
        step = _descend(edges, jacobian, pivot, done, camera, measure, reach, options)
        if step is None:
            return None
        moved = twist(step[3:], step[:3], pivot)
        T = moved @ T
    # the part has hardly moved in the last round: its edges are still the ones predicted
    edges = replace(edges, points_mm=transform(moved, edges.points_mm))
    edges = replace(edges, pixels=camera.project(edges.points_mm))
    gaps = measure.gaps(edges.pixels, edges.normals, edges, options.reach_px[-1])
    found = np.isfinite(gaps.gap_px)
    if found.sum() < MIN_POINTS:
        return None
    residual = gaps.gap_px[found]
    sigma = max(1.48 * float(np.median(np.abs(residual))), MIN_SIGMA_PX)
    weight = gaps.weight[found] / np.maximum(1.0, np.abs(residual) / max(HUBER_PX, 2 * sigma))
    covariance = _covariance(jacobian[found][:, ON_TABLE], weight, sigma, edges.step_mm)
    return EdgeFit(T, edges, gaps, sigma, covariance)


def coarse_fit(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    measure: Measure,
    reaches_px: Sequence[float],
    most: int,
    sure: float,
) -> EdgeFit | None:
    """Return the first fit of several reaches that scores enough, or the best of them.

    A longer reach is a further try, since it also finds more edges of other objects.

    Parameters
    ----------
    model, T_world_part, camera, measure : of `fit_edges`
    reaches_px : how far from the prediction an edge is looked for, try by try
    most : edge samples looked at
    sure : score from which no other reach is tried
    """
    best: EdgeFit | None = None
    first: ModelEdgePoints | None = None
    for reach_px in reaches_px:
        options = FitOptions((reach_px,), steps=3, most=most)
        first = first or _first_edges(model, T_world_part, camera, measure, options)
        fit = fit_edges(model, T_world_part, camera, measure, options, first)
        if fit is not None and (best is None or fit.score > best.score):
            best = fit
        if best is not None and best.score >= sure:
            break
    return best


def _first_edges(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    measure: Measure,
    options: FitOptions,
) -> ModelEdgePoints:
    predict = predict_edges if measure.sees_inside else predict_outline
    return predict(model, T_world_part, camera, options.most)


def _away(T_world_part: FloatArray, prior: Prior, centroid_mm: FloatArray) -> FloatArray:
    """Return a pose's deviation from the expected one, (6,): centre of mass, rotation vector."""
    if prior.T_world_part is None:
        return np.zeros(6)
    before = transform(prior.T_world_part, centroid_mm[None])[0]
    shift = transform(T_world_part, centroid_mm[None])[0] - before
    turn, _ = cv2.Rodrigues(T_world_part[:3, :3] @ prior.T_world_part[:3, :3].T)
    return np.concatenate([shift, turn.ravel()])


def _descend(
    edges: ModelEdgePoints,
    jacobian: FloatArray,
    pivot: FloatArray,
    done: FloatArray,
    camera: Camera,
    measure: Measure,
    reach_px: float,
    options: FitOptions,
) -> FloatArray | None:
    """Return the motion (6,) after some steps with one set of edges, None for too few edges.

    Parameters
    ----------
    edges, jacobian : predicted, and how they move with the part (n, 6)
    pivot : (3,) fixed point of the rotations
    done : (6,) offset of the part from its prior
    camera, measure : camera and measure for finding edges
    reach_px : range of the search in the first step
    options : number of steps, and the free parameters
    """
    total = np.zeros(6)
    prior = np.array([*options.prior.shift_mm, *options.prior.rotation_rad])
    free = np.flatnonzero(prior > 0)
    stiffness = 1.0 / prior[free] ** 2
    pixels, moves = edges.pixels, jacobian[:, free]
    for step in range(options.steps):
        reach = max(reach_px / (1 + step), MIN_REACH_PX)
        gaps = measure.gaps(pixels, edges.normals, edges, reach)
        found = np.isfinite(gaps.gap_px)
        if found.sum() < MIN_POINTS:
            return None
        gap, slopes = gaps.gap_px[found], moves[found]
        spread = max(HUBER_PX, 1.48 * float(np.median(np.abs(gap))))
        weight = gaps.weight[found] / np.maximum(1.0, np.abs(gap) / spread)
        weight *= sample_information(edges.step_mm, options.noise * spread)
        weighted = slopes * weight[:, None]
        information, pull = weighted.T @ slopes, weighted.T @ gap
        at = np.diag_indices(len(free))
        information[at] += DAMPED * information[at] + 1e-12 + stiffness
        change = np.linalg.solve(information, pull - stiffness * (done + total)[free])
        total[free] += change
        pixels = camera.project(transform(twist(total[3:], total[:3], pivot), edges.points_mm))
        if np.abs(slopes @ change).max() < SETTLED_PX:
            break
    return total


def twist(rotation: FloatArray, shift: FloatArray, pivot: FloatArray) -> FloatArray:
    """Return the motion (4, 4) of a rotation vector about a point, then a shift.

    Parameters
    ----------
    rotation : (3,) rotation vector along the axis [rad]
    shift : (3,) [mm]
    pivot : (3,) point that only the shift moves [mm]; all three in one frame
    """
    R, _ = cv2.Rodrigues(rotation.reshape(3, 1))
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = pivot + shift - R @ pivot
    return T


def edge_jacobian(
    points_mm: FloatArray, normals: FloatArray, pivot: FloatArray, camera: Camera
) -> FloatArray:
    """Return the derivatives (n, 6) of edge points along their normals by the part's motion.

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
    return np.hstack([along, cross(points_mm - pivot, along)])


def sample_information(step_mm: float, sigma_px: float) -> float:
    """Return the information of one edge sample on the place of its edge [1 / px²].

    Parameters
    ----------
    step_mm : distance between samples; samples nearer than the correlation of errors count for less
    sigma_px : standard deviation of an edge
    """
    return min(1.0, step_mm / CORRELATED_MM) / sigma_px**2


def _covariance(
    jacobian: FloatArray, weight: FloatArray, sigma_px: float, step_mm: float
) -> FloatArray:
    information = (jacobian * weight[:, None]).T @ jacobian
    information *= sample_information(step_mm, sigma_px)
    # a round part says nothing of its turn: half a turn is what is known then
    information[2, 2] += 1.0 / np.pi**2
    spread = np.linalg.inv(information + 1e-9 * np.eye(3))
    spread[[0, 1], [0, 1]] += CALIBRATION_MM**2
    return np.asarray(spread, dtype=np.float64)
