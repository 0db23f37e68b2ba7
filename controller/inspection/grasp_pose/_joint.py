"""Joint pose of all views of a grasp: Gauss-Newton on outlines, with a prior from kinematics.

The part lies near its expected place in the jaws, the same in all views; the arm adds a small error
in each. The faces of the part may deviate slightly too: each has degrees of freedom of its own,
with a prior of a good part's deviations, which releases a face that is plainly out of place. A
wrong dimension thus does not bias the pose, and remains visible.

Two effects that look like a change of distance have degrees of freedom too: the overall size of the
part, within a good part's deviations, and light that erodes a view's whole outline. The normal
equations are small: six unknowns for the grasp, seven for each view, four for each face, three for
size. The effect of light on one edge as a whole is eliminated edge by edge.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.sparse as sp

from controller.arrays import FloatArray, IntArray
from controller.imaging import inverse_pose, transform
from controller.recognition.fitting import sample_information, twist

from .._pose import PosedPart
from ..limits import COMPARED_PX, FARTHEST_PX, OUTLINE_POINTS, OUTLINE_PX, PAIRED_PX
from ._rims import FREEDOMS, Rims, find_rims
from ._types import FaceShift, GraspPose, OutlinedView, PoseSettings, ViewPose

# Largest offset of the outline in each coarse step; the visible faces change as the part tilts.
REACH_PX: Final = (FARTHEST_PX, 18.0, 12.5, 9.0, 7.0, 6.0)
COARSE_COUNT: Final = 400  # number of outline points per view in these steps
# Fine rounds: limit for outliers in shares of `LOOSE`, and whether faces are free.
ROUNDS: Final = ((4.0, False), (2.0, True), (1.0, True))
STEPS: Final = 3  # number of steps in each round
TAIL: Final = 4.0  # degrees of freedom of Student's distribution for faces of good and bad parts
LOOSE: Final = 3.0  # limit for outliers, in standard deviations
# Distance along an edge within which errors from blur and pixels are correlated.
CORRELATED_PX: Final = 3.0
ALONG_MM: Final = 3.0  # distance along an edge within which light and form hardly change
BENT: Final = 0.1  # share of a face's shift that a curved outline hides from straight lines
ALONG_SHARE: Final = 1 / 3  # effect along an edge as a share of the effect on the edge as a whole
MAX_CYCLES: Final = 4
# Largest missing share of the outline; with a wrong part or place, more is missing.
MISSED_SHARE: Final = 0.4
SPLIT_RAD: Final = 0.5  # sector of a curved edge, along which the effect of light changes


def fit_grasp(
    part: PosedPart, views: Sequence[OutlinedView], settings: PoseSettings | None = None
) -> GraspPose | None:
    """Return the pose of a part in the jaws; None if no view shows an outline near it.

    Parameters
    ----------
    part : the part
    views : one or more views of one grasp
    settings : prior knowledge of arm, parts and light; None for the defaults
    """
    settings = settings or PoseSettings()
    usable = [view for view in views if len(view.outline.points) >= OUTLINE_POINTS]
    if not usable:
        return None
    state = np.zeros((1 + len(usable), 6))
    missed = 1.0
    for _ in range(MAX_CYCLES):
        # The part may be farther off than the reach of these steps: continue from there.
        before = missed
        moved, missed = _approach(part, usable, state, settings)
        if missed >= before:
            break
        state = moved
        if missed <= MISSED_SHARE:
            break
    return _fine(part, usable, views, state, settings)


def _approach(
    part: PosedPart, views: Sequence[OutlinedView], state: FloatArray, settings: PoseSettings
) -> tuple[FloatArray, float]:
    """Return the state after some steps, and the share of the outline that is still far off."""
    for reach in REACH_PX:
        rims = [_coarse(part, placed) for placed in _placed(part, views, state)]
        gaps = [
            view.outline.gaps(r.points.pixels, r.points.normals, r.points, reach).gap_px
            for view, r in zip(views, rims, strict=True)
        ]
        state = _coarse_step(views, rims, gaps, state, settings)
    off = np.abs(np.nan_to_num(np.concatenate(gaps), nan=np.inf))
    return state, float(np.mean(off > PAIRED_PX)) if len(off) else 1.0


@dataclass(frozen=True, eq=False, slots=True)
class _Placed:
    """A view with its current pose."""

    view: OutlinedView
    T_world_part: FloatArray


def _placed(part: PosedPart, views: Sequence[OutlinedView], state: FloatArray) -> list[_Placed]:
    """Return the views with their poses: the expected ones, moved by grasp and view."""
    centre = part.solid.centroid_mm
    return [
        _Placed(view, view.task.T_world_part_expected @ twist(x[3:], x[:3], centre))
        for view, x in zip(views, state[0] + state[1:], strict=True)
    ]


def _coarse(part: PosedPart, placed: _Placed) -> Rims:
    camera = placed.view.task.camera
    return find_rims(part, placed.T_world_part, camera, COARSE_COUNT, 0.0)


def _prior(views: Sequence[OutlinedView], settings: PoseSettings) -> FloatArray:
    """Return the prior information (1 + k, 6) of grasp and views."""
    mm = min(one.view.prior_mm for one in views)
    rad = min(one.view.prior_rad for one in views)
    own = [settings.view_mm] * 3 + [settings.view_rad] * 3
    return 1.0 / np.array([[mm] * 3 + [rad] * 3] + [own] * len(views)) ** 2


class _Prior:
    """Prior of all unknowns of the fine rounds."""

    def __init__(
        self, part: PosedPart, views: Sequence[OutlinedView], settings: PoseSettings
    ) -> None:
        self.settings = settings
        self.poses = _prior(views, settings).ravel()
        self.face_count = len(part.solid.faces)
        half_mm = 0.5 * np.ptp(part.solid.mesh.bounds, axis=0)
        size = (half_mm / settings.face_mm) ** 2
        light = np.full(len(views), 1.0 / settings.light_px**2)
        self.rest = np.concatenate([size, light])

    @property
    def first_face(self) -> int:
        """Index of the first unknown of the faces."""
        return len(self.poses)

    @property
    def first_size(self) -> int:
        """Index of the first unknown of the whole part's size."""
        return len(self.poses) + FREEDOMS * self.face_count

    def information(self, x: FloatArray, *, is_free: bool) -> FloatArray:
        """Return the diagonal (m,) at a state; a face clearly out of place is released if free."""
        faces = x[self.first_face : self.first_size].reshape(-1, FREEDOMS)
        variance = self.settings.face_mm**2
        out = is_free * (faces**2).sum(axis=1, keepdims=True) / (TAIL * variance)
        stiffness = np.broadcast_to(1.0 / (variance * (1.0 + out)), faces.shape)
        return np.concatenate([self.poses, stiffness.ravel(), self.rest])

    def beyond_pose(self, x: FloatArray, end: int | None = None) -> FloatArray:
        """Return a state (m,) with zeros for the poses, and from `end` on."""
        out = x.copy()
        out[: self.first_face] = 0.0
        if end is not None:
            out[end:] = 0.0
        return out


def _coarse_step(
    views: Sequence[OutlinedView],
    rims: Sequence[Rims],
    gaps: Sequence[FloatArray],
    state: FloatArray,
    settings: PoseSettings,
) -> FloatArray:
    """Return the state after one more step, from all views together."""
    prior = _prior(views, settings)
    size = state.size
    information, pull = np.diag(prior.ravel()), -(prior * state).ravel()
    every = np.concatenate([np.abs(g[np.isfinite(g)]) for g in gaps])
    spread = max(1.0, 1.48 * float(np.median(every))) if len(every) else 1.0
    for i, (r, gap) in enumerate(zip(rims, gaps, strict=True)):
        on = np.isfinite(gap)
        weight = 1.0 / np.maximum(1.0, np.abs(gap[on]) / spread)
        weight *= sample_information(r.points.step_mm, OUTLINE_PX * spread)
        slopes = r.jacobian[on]
        weighted = (slopes * weight[:, None]).T
        own, drawn = weighted @ slopes, weighted @ gap[on]
        at = [slice(0, 6), slice(6 + 6 * i, 12 + 6 * i)]
        for rows in at:
            pull[rows] += drawn
            for columns in at:
                information[rows, columns] += own
    return np.asarray(state + np.linalg.solve(information, pull).reshape(size // 6, 6))


@dataclass(frozen=True, eq=False, slots=True)
class _Predicted:
    """Outline of a view in the fine rounds: derivatives of its points, and their common errors."""

    rims: Rims
    design: sp.csr_matrix  # (n, m): grasp, views, faces, size, light in each view
    edges: sp.csr_matrix  # (n, e) edge of each point
    by_edge: "_ByEdge"
    correlated: float  # number of points with correlated noise of the picture
    along: float  # number of points with a common error along an edge
    noise_px: FloatArray
    pixel_mm: float


@dataclass(frozen=True, eq=False, slots=True)
class _ByEdge:
    """Design of a view edge by edge: the points of one depend on the same few unknowns."""

    order: IntArray  # (n,) points, those of each edge one after the other
    begins: IntArray  # (e,) first of each edge among them
    values: FloatArray  # (n, c) their derivatives
    at: IntArray  # (e, c, c) places of an edge's normal equations among all, flat

    def add(
        self, information: FloatArray, weight: FloatArray, known: FloatArray
    ) -> tuple[FloatArray, IntArray]:
        """Add the normal equations of all points, less what an edge has in common.

        Return the sum of each edge's weighted derivatives (e, c), and the unknowns (e, c).

        Parameters
        ----------
        information : (m, m) gets them
        weight : (n,) of each point, in their original order
        known : (e,) information on the common offset of each edge
        """
        size = len(information)
        weighted = self.values * weight[self.order, None]
        ends = [*self.begins[1:].tolist(), len(self.order)]
        together = np.add.reduceat(weighted, self.begins, axis=0)
        blocks = together[:, :, None] * (-together / known[:, None])[:, None, :]
        for block, begin, end in zip(blocks, self.begins.tolist(), ends, strict=True):
            block += weighted[begin:end].T @ self.values[begin:end]
        added = np.bincount(self.at.ravel(), blocks.ravel(), minlength=size * size)
        information += added.reshape(size, size)
        return together, self.at[:, 0, :] % size


@dataclass(frozen=True, eq=False, slots=True)
class _Solved:
    """Normal equations and their solution."""

    information: FloatArray
    step: FloatArray


def _fine(
    part: PosedPart,
    usable: list[OutlinedView],
    views: Sequence[OutlinedView],
    state: FloatArray,
    settings: PoseSettings,
) -> GraspPose | None:
    x = np.concatenate(
        [state.ravel(), np.zeros(FREEDOMS * len(part.solid.faces) + 3 + len(usable))]
    )
    prior = _Prior(part, usable, settings)
    solved: _Solved | None = None
    for share, is_free in ROUNDS:
        placed = _placed(part, usable, x[: state.size].reshape(state.shape))
        predicted = [_predict(part, p, i, len(usable)) for i, p in enumerate(placed)]
        start = x.copy()
        for _ in range(STEPS):
            left = _left(part, usable, predicted, x, start, state.shape)
            solved = _solve(predicted, left, x, prior, (share, is_free))
            x = x + solved.step
    assert solved is not None
    left = _left(part, usable, predicted, x, start, state.shape)
    covariance = np.asarray(np.linalg.inv(solved.information), dtype=np.float64)
    poses = _placed(part, usable, x[: state.size].reshape(state.shape))
    every = [
        _view_pose(p, s, gap, x, covariance, i, prior)
        for i, (p, s, gap) in enumerate(zip(poses, predicted, left, strict=True))
    ]
    shown = [v for v in every if np.isfinite(v.gap_px).sum() >= OUTLINE_POINTS]
    if not shown:
        return None
    known = {v.view_id: v for v in shown}
    if max(v.paired for v in shown) >= 1.0 - MISSED_SHARE:
        # of the others, those whose outline stands before nothing are known by these
        known |= {v.view_id: v for v in _hidden(part, views, known, x, covariance, prior)}
    ids = [view.task.view_id for view in views]
    return GraspPose(
        views=tuple(known[view_id] for view_id in ids if view_id in known),
        missing=tuple(view_id for view_id in ids if view_id not in known),
        shift_mm=x[:3],
        rotation_rad=x[3:6],
        covariance=covariance[:6, :6],
        faces=_face_shifts(predicted, left, x, covariance, prior),
    )


def _hidden(
    part: PosedPart,
    views: Sequence[OutlinedView],
    known: Collection[str],
    x: FloatArray,
    covariance: FloatArray,
    prior: _Prior,
) -> list[ViewPose]:
    """Return the poses of further views of the grasp whose outline no picture can show.

    Parameters
    ----------
    part : the part
    views : all views of the grasp
    known : ids of those whose outline was found
    x, covariance : solution for these
    prior : of its unknowns
    """
    settings = prior.settings
    own = np.diag([settings.view_mm] * 3 + [settings.view_rad] * 3) ** 2
    out = []
    for view in views:
        if view.task.view_id in known:
            continue
        T = view.task.T_world_part_expected @ twist(x[3:6], x[:3], part.solid.centroid_mm)
        placed = _Placed(view, T)
        one = _predict(part, placed, 0, 1)
        points = one.rims.points
        judged = view.outline.is_judged(points.pixels)
        if judged.sum() >= OUTLINE_POINTS:
            continue  # it would show, and is not there
        nothing = np.full(len(points.pixels), np.nan)
        out.append(
            ViewPose(
                view_id=view.task.view_id,
                T_world_part_measured=T,
                covariance=_in_world(T, covariance[:6, :6] + own),
                deviation_mm=0.0,
                deviation_rad=0.0,
                rims=one.rims,
                gap_px=nothing,
                left_px=nothing,
                edge_px=np.zeros(len(points.pixels)),
                judged=np.zeros(len(points.pixels), dtype=bool),
                step_px=points.step_mm / one.pixel_mm,
                px_per_mm=1.0 / one.pixel_mm,
                noise_px=float(np.median(one.noise_px)) if len(one.noise_px) else 0.0,
                residual_px=0.0,
                paired=1.0,
                is_hidden=True,
            )
        )
    return out


def _in_world(T: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return a covariance (6, 6) of the part's frame in the world."""
    turn = np.kron(np.eye(2), T[:3, :3])
    spread = turn @ covariance @ turn.T
    return np.asarray(0.5 * (spread + spread.T))


def _predict(part: PosedPart, placed: _Placed, number: int, count: int) -> _Predicted:
    camera = placed.view.task.camera
    centre = transform(placed.T_world_part, part.solid.centroid_mm[None])[0]
    pixel_mm = camera.mm_per_px(centre)
    rims = find_rims(part, placed.T_world_part, camera, np.inf, pixel_mm)
    n = len(rims.points.pixels)
    first = 6 + 6 * count
    last = first + FREEDOMS * len(part.solid.faces)
    # an edge's two faces in one order, whichever is in front
    turned = rims.faces[:, 0] > rims.faces[:, 1]
    faces = np.where(turned[:, None], rims.faces[:, ::-1], rims.faces)
    per_face = np.where(turned[:, None, None], rims.per_face[:, ::-1], rims.per_face)
    rows = np.repeat(np.arange(n), 16 + 2 * FREEDOMS)
    columns = np.hstack(
        [
            np.tile(np.arange(6), (n, 1)),
            np.tile(np.arange(6 + 6 * number, 12 + 6 * number), (n, 1)),
            *(first + FREEDOMS * faces[:, [k]] + np.arange(FREEDOMS) for k in (0, 1)),
            np.tile(last + np.arange(3), (n, 1)),
            np.full((n, 1), last + 3 + number),
        ]
    )
    from_centre = transform(inverse_pose(placed.T_world_part), rims.points.points_mm)
    from_centre -= part.solid.centroid_mm
    values = np.hstack(
        [
            rims.jacobian,
            rims.jacobian,
            *(per_face[:, k] for k in (0, 1)),
            rims.jacobian[:, :3] * from_centre,
            np.ones((n, 1)),
        ]
    )
    shape = (n, last + 3 + count)
    design = sp.csr_matrix((values.ravel(), (rows, columns.ravel())), shape=shape)
    edge = _edges(rims)
    order = np.argsort(edge, kind="stable")
    begins = np.flatnonzero(np.diff(edge[order], prepend=-1))
    unknowns = columns[order[begins]]
    return _Predicted(
        rims=rims,
        design=design,
        by_edge=_ByEdge(
            order, begins, values[order], unknowns[:, :, None] * shape[1] + unknowns[:, None, :]
        ),
        edges=sp.csr_matrix((np.ones(n), (np.arange(n), edge)), shape=(n, edge.max(initial=0) + 1)),
        correlated=max(1.0, CORRELATED_PX * pixel_mm / rims.points.step_mm),
        along=max(1.0, ALONG_MM / rims.points.step_mm),
        noise_px=np.hypot(placed.view.backlit.noise_px, rims.facet_px / np.sqrt(3.0)),
        pixel_mm=pixel_mm,
    )


def _edges(rims: Rims) -> IntArray:
    """Return the number (n,) of each outline point's edge, given by two faces and a direction."""
    normals = rims.points.normals
    sector = np.round(np.arctan2(normals[:, 1], normals[:, 0]) / SPLIT_RAD).astype(np.int64)
    key = np.column_stack([np.sort(rims.faces, axis=1), sector])
    _, number = np.unique(key, axis=0, return_inverse=True)
    return np.asarray(number.reshape(-1), dtype=np.int64)


def _left(
    part: PosedPart,
    views: Sequence[OutlinedView],
    predicted: Sequence[_Predicted],
    x: FloatArray,
    start: FloatArray,
    shape: tuple[int, ...],
) -> list[FloatArray]:
    """Return the offsets of observed outlines from the moved prediction, without faces moved."""
    out = []
    size = int(np.prod(shape))
    now = _placed(part, views, x[:size].reshape(shape))
    then = _placed(part, views, start[:size].reshape(shape))
    for view, one, new, old in zip(views, predicted, now, then, strict=True):
        points = one.rims.points
        T_moved = new.T_world_part @ inverse_pose(old.T_world_part)
        pixels = view.task.camera.project(transform(T_moved, points.points_mm))
        out.append(view.outline.gaps(pixels, points.normals, points, COMPARED_PX).gap_px)
    return out


def _weights(
    one: _Predicted,
    left: FloatArray,
    shape: FloatArray,
    settings: PoseSettings,
    share: float,
) -> FloatArray:
    """Return the information of each point, little for outliers.

    Parameters
    ----------
    one : outline of the view
    left : (n,) offsets of the observed outline, with faces moved
    shape : (n,) displacement by faces out of place
    settings : prior knowledge of light
    share : limit for outliers, as a share of `LOOSE`
    """
    scale = share * LOOSE * np.hypot(one.noise_px, settings.light_px)
    trust = 1.0 / (1.0 + (left / scale) ** 2) ** 2
    variance = one.correlated * one.noise_px**2
    variance = variance + one.along * (ALONG_SHARE * settings.light_px) ** 2
    variance = variance + one.along * (BENT * shape) ** 2
    return np.asarray(np.where(np.isfinite(left), trust / variance, 0.0))


def _common(
    one: _Predicted, left: FloatArray, weight: FloatArray, settings: PoseSettings
) -> tuple[FloatArray, FloatArray]:
    """Return the common offset of each edge's points (e,), and its information."""
    information = one.edges.T @ weight + 1.0 / settings.light_px**2
    return (one.edges.T @ (weight * np.nan_to_num(left))) / information, information


def _solve(
    predicted: Sequence[_Predicted],
    gaps: Sequence[FloatArray],
    x: FloatArray,
    prior: _Prior,
    how: tuple[float, bool],
) -> _Solved:
    """Return the normal equations at a state and their solution.

    Parameters
    ----------
    predicted : outlines of the views
    gaps : (n,) each, measured at the poses of the state
    x : state
    prior : prior of the unknowns
    how : limit for outliers, and whether faces are free, as in `ROUNDS`
    """
    share, is_free = how
    diagonal = prior.information(x, is_free=is_free)
    information, pull = np.diag(diagonal), -diagonal * x
    moved = prior.beyond_pose(x)
    for one, gap in zip(predicted, gaps, strict=True):
        shape = one.design @ moved
        left = gap - shape
        weight = _weights(one, left, shape, prior.settings, share)
        common, known = _common(one, left, weight, prior.settings)
        together, unknowns = one.by_edge.add(information, weight, known)
        pull += one.design.T @ (weight * np.nan_to_num(left))
        pull -= np.bincount(
            unknowns.ravel(), (together * common[:, None]).ravel(), minlength=len(x)
        )
    step = np.linalg.solve(information, pull)
    return _Solved(information, np.asarray(step, dtype=np.float64))


def _view_pose(
    placed: _Placed,
    one: _Predicted,
    gap: FloatArray,
    x: FloatArray,
    covariance: FloatArray,
    number: int,
    prior: _Prior,
) -> ViewPose:
    T = placed.T_world_part
    at = slice(6 + 6 * number, 12 + 6 * number)
    light = prior.first_size + 3
    shape = one.design @ prior.beyond_pose(x, light)
    left = gap - shape
    beside = left - x[light + number]
    weight = _weights(one, beside, shape, prior.settings, ROUNDS[-1][0])
    common, _ = _common(one, beside, weight, prior.settings)
    edge_px = x[light + number] + one.edges @ common
    rest = left - edge_px
    on = np.isfinite(rest)
    judged = placed.view.outline.is_judged(one.rims.points.pixels)
    near = np.abs(np.nan_to_num(left[judged], nan=np.inf)) < PAIRED_PX
    both = np.zeros((6, len(x)))
    both[:, :6] = np.eye(6)
    both[:, at] += np.eye(6)
    return ViewPose(
        view_id=placed.view.task.view_id,
        T_world_part_measured=T,
        covariance=_in_world(T, both @ covariance @ both.T),
        deviation_mm=float(np.linalg.norm(x[at][:3])),
        deviation_rad=float(np.linalg.norm(x[at][3:])),
        rims=one.rims,
        gap_px=gap,
        left_px=left,
        edge_px=edge_px,
        judged=judged,
        step_px=one.rims.points.step_mm / one.pixel_mm,
        px_per_mm=1.0 / one.pixel_mm,
        noise_px=float(np.median(one.noise_px)),
        residual_px=1.48 * float(np.median(np.abs(rest[on]))) if on.any() else float("inf"),
        paired=float(near.mean()) if len(near) else 0.0,
    )


def _face_shifts(
    predicted: Sequence[_Predicted],
    gaps: Sequence[FloatArray],
    x: FloatArray,
    covariance: FloatArray,
    prior: _Prior,
) -> tuple[FaceShift, ...]:
    counts = np.zeros(prior.face_count, dtype=np.int64)
    for one, gap in zip(predicted, gaps, strict=True):
        for k in range(2):
            moves = np.abs(one.rims.per_face[:, k, 0]) > 0
            np.add.at(counts, one.rims.faces[np.isfinite(gap) & moves, k], 1)
    out = []
    for face in np.flatnonzero(counts):
        at = prior.first_face + FREEDOMS * int(face)
        out.append(
            FaceShift(
                face_id=int(face),
                grown_mm=float(x[at]),
                u_grown_mm=float(np.sqrt(covariance[at, at])),
                moved_mm=x[at + 1 : at + FREEDOMS].copy(),
                covariance=covariance[at + 1 : at + FREEDOMS, at + 1 : at + FREEDOMS].copy(),
                point_count=int(counts[face]),
            )
        )
    return tuple(out)
