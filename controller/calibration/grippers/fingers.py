"""The TCP from the fingers themselves: their outline before a backlight, at many rolls and pitches.

The results are the TCP in the wrist's frame (along the fingers, along the jaws' axis, across), the
roll of the jaws, and their opening at counter 0. A finger is a box in the TCP's frame: its tip ends
at x = 0, its pad faces the other finger.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, FloatArray, Grey
from controller.imaging.edges import measure_edges
from messages import key, say

from ..kinematics import CellFit, KinematicsFault
from ..kinematics.noise import Whitening

_SPACING_PX: Final = 3.0  # spacing of rays along an edge: neighbours see the same noise
_TIP_SHARE: Final = 0.5  # share of a finger's length used, from its tip: beyond are palm and screws
_CORNER_SHARE: Final = 0.12  # share of an edge left out at its ends: corners are rounded
_EDGE_MIN_PX: Final = 12.0
_CLEAR_PX: Final = 6.0  # least distance from the other finger's outline
_REACH_PX: Final = 25.0  # a finger may be 4 mm from where the drawing has it
_LIGHT_PX: Final = 0.3  # light that creeps round an edge, and rounding, shift all edges alike
_SHAPE_MM: Final = 0.02  # accuracy of fingers to their drawing
_NOISE_MIN_PX: Final = 0.05  # edges are a little rounded, whatever the picture's noise
_OUTLIER_SIGMA: Final = 6.0
_ROUNDS: Final = 5
_L1_ROUNDS: Final = 12
_RAYS_MIN: Final = 60  # least number of rays of all looks
_LOOKS_MIN: Final = 4
_STEP: Final = 1e-4

# corners of a box by the signs of x, y and z; its edges by pairs of them
_SIGNS: Final = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


@dataclass(frozen=True, slots=True)
class FingerShape:
    """Both fingers of a gripper, as its drawing has them."""

    length_mm: float
    width_mm: float
    thickness_mm: float

    def corners(self, opening_mm: float, side: int) -> FloatArray:
        """Return the corners (8, 3) of the finger on one side (-1 or 1), in the TCP's frame."""
        middle = np.array([-self.length_mm, side * (opening_mm + self.thickness_mm), 0.0]) / 2.0
        half = np.array([self.length_mm, self.thickness_mm, self.width_mm]) / 2.0
        out: FloatArray = middle + _SIGNS * half
        return out


@dataclass(frozen=True, slots=True, eq=False)
class FingerRays:
    """Where edges of the fingers are expected in a picture.

    Attributes
    ----------
    points_mm : (n, 3) on the edges, in the TCP's frame
    side : (n,) finger, -1 or 1
    origins_px, directions : (n, 2) origins and directions of rays across the edges, out of the
        finger
    """

    points_mm: FloatArray
    side: FloatArray
    origins_px: FloatArray
    directions: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FingerLook:
    """A picture of the fingers before the backlight.

    Attributes
    ----------
    q : (6,) joints, as the counters had them
    opening_mm : as the counter had it
    rays : rays across the expected edges
    offset_px, sigma_px : (n,) positions of the edges along the rays, NaN where there is none
    """

    q: FloatArray
    opening_mm: float
    rays: FingerRays
    offset_px: FloatArray
    sigma_px: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class TcpFit:
    """The TCP measured from the fingers.

    Attributes
    ----------
    fit : the cell with what the fingers add to it: tool, roll, and all that hangs on them
    jaw_zero_mm, u_mm : opening where the counter means 0, and its standard uncertainty
    ray_count : number of rays of the edges used
    rms_px : rms of their distance from the prediction
    """

    fit: CellFit
    jaw_zero_mm: float
    u_mm: float
    ray_count: int
    rms_px: float

    def faults(self, limit_mm: float = 1.5) -> tuple[KinematicsFault, ...]:
        """Return whether pads are missing, by an opening larger than the counter means."""
        if self.jaw_zero_mm - 2.0 * self.u_mm < limit_mm:
            return ()
        return (
            KinematicsFault(
                "pads_missing",
                key("arm gripper"),
                say(
                    "the jaws are {jaw_zero_mm:.1f} mm wider open than their counter "
                    "means, {limit_mm:g} mm are allowed; pads are missing or worn, fit "
                    "them and repeat",
                    jaw_zero_mm=self.jaw_zero_mm,
                    limit_mm=limit_mm,
                ),
            ),
        )


class FingersError(Exception):
    """The pictures show too little of the fingers; the message says what to do about it."""


def finger_rays(
    fit: CellFit, camera: str, q: FloatArray, opening_mm: float, shape: FingerShape
) -> FingerRays:
    """Return rays across the edges of the fingers' outline.

    Parameters
    ----------
    fit : fit of the cell, which has the camera and the arm
    camera : by name
    q : (6,) joints
    opening_mm : opening of the jaws, as their counter has it
    shape : shape of the fingers
    """
    project = _projector(fit, camera, q)
    hulls: dict[int, FloatArray] = {}
    found: list[tuple[int, FloatArray, FloatArray, FloatArray]] = []
    for side in (-1, 1):
        corners = shape.corners(opening_mm, side)
        pixels = project(fit.x, corners)
        order = cv2.convexHull(pixels.astype(np.float32), returnPoints=False)
        hull = np.asarray(order, dtype=np.intp).ravel()
        hulls[side] = pixels[hull]
        for i, j in zip(hull, np.roll(hull, -1), strict=True):
            found.append((side, corners[i], corners[j], pixels[hull].mean(axis=0)))
    parts: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
    size = np.array(fit.camera(camera).size_px)
    for side, a, b, middle in found:
        length = float(np.linalg.norm(np.diff(project(fit.x, np.array([a, b])), axis=0)))
        if length < _EDGE_MIN_PX:
            continue
        count = int(length * (1 - 2 * _CORNER_SHARE) / _SPACING_PX) + 1
        share = np.linspace(_CORNER_SHARE, 1 - _CORNER_SHARE, count)
        points = a + share[:, None] * (b - a)
        ahead, behind = points + 1e-3 * (b - a), points - 1e-3 * (b - a)
        at, along = project(fit.x, points), project(fit.x, ahead) - project(fit.x, behind)
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal * np.sign(np.einsum("ni,ni->n", normal, at - middle))[:, None]
        other = hulls[-side].astype(np.float32)
        clear = [
            cv2.pointPolygonTest(other, (float(u), float(v)), measureDist=True) < -_CLEAR_PX
            for u, v in at
        ]
        keep = np.array(clear) & (points[:, 0] > -_TIP_SHARE * shape.length_mm)
        keep &= np.all((at > _REACH_PX) & (at < size - 1 - _REACH_PX), axis=1)
        parts.append((points[keep], np.full(int(keep.sum()), float(side)), at[keep], normal[keep]))
    none = (np.zeros((0, 3)), np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2)))
    return FingerRays(*(np.concatenate(one) for one in zip(none, *parts, strict=True)))


def look_at_fingers(
    picture: Grey, fit: CellFit, camera: str, q: FloatArray, opening_mm: float, shape: FingerShape
) -> FingerLook:
    """Return where a backlit picture (height, width) has the fingers' edges.

    Parameters
    ----------
    picture : fingers dark before the bright panel
    fit : fit of the cell
    camera : by name
    q : (6,) joints
    opening_mm : opening of the jaws, as their counter has it
    shape : shape of the fingers
    """
    rays = finger_rays(fit, camera, q, opening_mm, shape)
    rising = np.ones(len(rays.side))
    found = measure_edges(picture, rays.origins_px, rays.directions, _REACH_PX, rising=rising)
    sigma_px = np.hypot(found.sigma_px, _NOISE_MIN_PX)
    return FingerLook(np.asarray(q, float), opening_mm, rays, found.offset_px, sigma_px)


def locate_tcp(
    fit: CellFit,
    camera: str,
    looks: Sequence[FingerLook],
    *,
    jaw_zero_std_mm: float = 1.5,
) -> TcpFit:
    """Return the cell with its TCP between the finger tips, from all looks.

    The covariance of the cell is the prior; each stop has the joints' own noise besides.

    Parameters
    ----------
    fit : fit of the cell
    camera : by name
    looks : at several rolls and pitches
    jaw_zero_std_mm : standard deviation of the opening about its counter

    Raises
    ------
    FingersError : too few looks, or too few edges in them
    """
    if len(looks) < _LOOKS_MIN:
        raise FingersError(
            say(
                "{looks_count} looks at the fingers, {looks_min} are required",
                looks_count=len(looks),
                looks_min=_LOOKS_MIN,
            )
        )
    size = fit.layout.size
    cov = np.zeros((size + 2, size + 2))
    cov[:size, :size] = fit.cov
    cov[size, size], cov[size + 1, size + 1] = jaw_zero_std_mm**2, _LIGHT_PX**2
    first = np.append(fit.x, [0.0, 0.0])
    y = first.copy()
    used = [np.isfinite(look.offset_px) for look in looks]
    after, rms_px = cov, 0.0
    for _ in range(_ROUNDS):
        rows, off, errors = [], [], []
        for k, look in enumerate(looks):
            r, by, by_joints = _predicted(fit, camera, look, y)
            used[k] = _in_line(r, by_joints, look, used[k])
            keep = used[k]
            white = _white(by_joints[keep], look.sigma_px[keep], fit.joint_std)
            rows.append(white.apply(by[keep]))
            # observed less predicted, at the prior's mean to first order
            off.append(white.apply(r[keep] + by[keep] @ (y - first)))
            errors.append(r[keep])
        count = sum(len(e) for e in errors)
        if count < _RAYS_MIN:
            raise FingersError(
                say(
                    "{count} points of the fingers' edges were found, {rays_min} are "
                    "required; light the panel behind them evenly and keep both "
                    "fingers in the picture",
                    count=count,
                    rays_min=_RAYS_MIN,
                )
            )
        jac, seen = np.vstack(rows), np.concatenate(off)
        across = jac @ cov
        gain = np.linalg.solve(across @ jac.T + np.eye(len(seen)), across).T
        y = first + gain @ seen
        after = cov - gain @ across
        rms_px = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    after = (after + after.T) / 2.0
    found = replace(fit, x=y[:size], cov=after[:size, :size])
    u_mm = float(np.hypot(np.sqrt(after[size, size]), _SHAPE_MM))
    return TcpFit(found, float(y[size]), u_mm, count, rms_px)


def _projector(
    fit: CellFit, camera: str, q: FloatArray
) -> Callable[[FloatArray, FloatArray], FloatArray]:
    """Return the projection of unknowns (m,) and points (n, 3), TCP frame, to pixels (n, 2)."""
    layout = fit.layout

    def project(x: FloatArray, points_mm: FloatArray) -> FloatArray:
        T_arm_tcp = layout.prior.arm.tcp(np.asarray(q, float)[None], layout.arm_values(x))[0]
        T = layout.T_world_arm(x) @ T_arm_tcp
        return layout.camera(x, camera, np.inf).project(points_mm @ T[:3, :3].T + T[:3, 3])

    return project


def _predicted(
    fit: CellFit, camera: str, look: FingerLook, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return observed less predicted offsets (n,), their derivatives by y (n, m), by joints (n, 6).

    y is the cell's unknowns, then how much wider the jaws are open, then how far light makes every
    edge look further out.
    """
    layout, rays = fit.layout, look.rays
    x, half = y[:-2], rays.side[:, None] * [0.0, 0.5, 0.0]
    points = rays.points_mm + y[-2] * half
    project = _projector(fit, camera, look.q)

    def offset(pixels: FloatArray) -> FloatArray:
        out: FloatArray = np.einsum("ni,ni->n", pixels - rays.origins_px, rays.directions)
        return out

    by = np.zeros((len(points), layout.size + 2))
    by[:, -1] = 1.0
    for name in (f"{camera}.lens", camera, "base", "arm"):
        at = layout.where(name)
        for i in range(at.start, at.stop):
            d = np.zeros(layout.size)
            d[i] = _STEP * layout.std[i]
            by[:, i] = offset(project(x + d, points)) - offset(project(x - d, points))
            by[:, i] /= 2.0 * d[i]
    by[:, -2] = (
        offset(project(x, points + _STEP * half)) - offset(project(x, points - _STEP * half))
    ) / (2.0 * _STEP)
    by_joints = np.zeros((len(points), 6))
    for j in range(6):
        d = np.zeros(6)
        d[j] = 1e-5
        ahead, behind = (_projector(fit, camera, look.q + s * d) for s in (1, -1))
        by_joints[:, j] = (offset(ahead(x, points)) - offset(behind(x, points))) / 2e-5
    return look.offset_px - offset(project(x, points)) - y[-1], by, by_joints


def _white(by_joints: FloatArray, sigma_px: FloatArray, joint_std: FloatArray) -> Whitening:
    weights = 1.0 / sigma_px
    if not joint_std.any() or not len(weights):
        return Whitening(weights)
    along, spread, _ = np.linalg.svd(by_joints * joint_std * weights[:, None], full_matrices=False)
    return Whitening(weights, along, spread)


def _in_line(r: FloatArray, by_joints: FloatArray, look: FingerLook, used: BoolArray) -> BoolArray:
    """Return which edges (n,) agree with the others of their picture, wherever its joints are."""
    if not used.any():
        return used
    by, seen = by_joints[used], r[used]
    step: FloatArray = np.zeros(by.shape[1])
    for _ in range(_L1_ROUNDS):  # least absolute deviations: an edge of something else drags less
        weight = 1.0 / np.sqrt(np.maximum(np.abs(seen - by @ step), _NOISE_MIN_PX))
        step = np.asarray(np.linalg.lstsq(by * weight[:, None], seen * weight, rcond=None)[0])
    off = np.abs(r - by_joints @ step)
    usual = 1.4826 * float(np.median(off[used]))
    limit = _OUTLIER_SIGMA * np.maximum(look.sigma_px, usual)
    return np.asarray(np.isfinite(look.offset_px) & (off < limit))
