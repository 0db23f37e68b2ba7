"""Fit all boards of all pictures at once: camera, lens, and the pose of every board.

The unknowns are the free intrinsics, the pose of the world in the camera, the pose in the camera of
each tilted board, and position and angle on the table of each flat one. The board that fixes the
world has no unknowns. So all flat boards together determine how the camera stands over the table:
they share the plane z = 0. The fit is least squares with an analytic Jacobian: the derivatives by
lens and by point are OpenCV's (`projectPoints`), the chain from there to the poses is ours.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.imaging import inverse_pose
from messages import key

from ._types import PARAMETERS, CalibrationError, PlacedBoard, View, WorldFrame

# In weighted residuals: the start is near the solution, so full Gauss-Newton steps are allowed.
_FIRST_STEP: Final = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationSolution:
    """Values of all unknowns.

    Attributes
    ----------
    intrinsics : (9,) in the order of PARAMETERS
    T_cam_world : (4, 4)
    T_ref_board : per view (4, 4): T_cam_board of a tilted one, T_world_board of a flat one
    """

    intrinsics: FloatArray
    T_cam_world: FloatArray
    T_ref_board: tuple[FloatArray, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationFit:
    """A solution, its residuals and their Jacobian.

    Attributes
    ----------
    residuals_px : per view (n, 2), observed less predicted
    jac : (2 n, 9 + 6 + m) weighted Jacobian; columns: all of PARAMETERS, free or held, then the
        rotation [rad] and translation [mm] of the world in the camera, then the boards
    cost : weighted sum of squares
    """

    solution: CalibrationSolution
    free: tuple[str, ...]
    residuals_px: tuple[FloatArray, ...]
    jac: FloatArray
    cost: float

    def is_on_table(self, view: View) -> bool:
        """Return whether a view's board is posed in the world and not in the camera."""
        return view.placed is PlacedBoard.FLAT


def project(
    p_cam_mm: FloatArray, intrinsics: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return pixels (n, 2), their derivatives by p_cam (n, 2, 3) and by intrinsics (n, 2, 9)."""
    fx, fy, cx, cy = intrinsics[:4]
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    pixels, jacobian = cv2.projectPoints(
        np.ascontiguousarray(p_cam_mm).reshape(-1, 1, 3),
        np.zeros(3),
        np.zeros(3),
        K,
        intrinsics[4:],
    )
    by = np.asarray(jacobian, dtype=np.float64).reshape(len(p_cam_mm), 2, -1)
    return np.asarray(pixels, np.float64).reshape(-1, 2), by[:, :, 3:6], by[:, :, 6:15]


def start(
    views: Sequence[View], size_px: tuple[int, int], world: WorldFrame
) -> tuple[CalibrationSolution, list[FloatArray]]:
    """Return a first solution, and the pose T_cam_board of each board fitted by itself.

    The solution is OpenCV's calibration with one distortion term. It does not use the common table.

    Parameters
    ----------
    views : boards found, the one that fixes the world among them
    size_px : (width, height) size of the pictures
    world : flat view that fixes the world's frame, and the pose of its board there

    Raises
    ------
    CalibrationError : OpenCV finds none
    """
    solid = [np.column_stack([v.board.board_mm, np.zeros(len(v.board.board_mm))]) for v in views]
    flags = cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
    try:
        _, K, distortion, rvecs, tvecs = cv2.calibrateCamera(
            [s.astype(np.float32) for s in solid],
            [v.board.pixels.astype(np.float32).reshape(-1, 1, 2) for v in views],
            size_px,
            None,
            None,
            flags=flags,
        )
    except cv2.error as error:
        raise CalibrationError(
            key(
                "no camera fits these boards; check inner_corners and that the pictures are of one "
                "camera at one focus"
            )
        ) from error
    intrinsics = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(distortion)[:5]])
    T_cam_boards = [
        _pose(Rotation.from_rotvec(np.ravel(r)), np.ravel(t))
        for r, t in zip(rvecs, tvecs, strict=True)
    ]
    anchor = next(i for i, v in enumerate(views) if v.name == world.name)
    T_world_anchor = _on_table(world.x_axis_angle_rad, *world.origin_mm)
    T_cam_world = T_cam_boards[anchor] @ inverse_pose(T_world_anchor)
    placed = []
    for i, (view, T_cam_board) in enumerate(zip(views, T_cam_boards, strict=True)):
        if i == anchor:
            placed.append(T_world_anchor)
        elif view.placed is PlacedBoard.FLAT:
            T = inverse_pose(T_cam_world) @ T_cam_board
            angle = np.arctan2(T[1, 0] - T[0, 1], T[0, 0] + T[1, 1])
            placed.append(_on_table(angle, T[0, 3], T[1, 3], world.origin_mm[2]))
        else:
            placed.append(T_cam_board)
    return CalibrationSolution(intrinsics, T_cam_world, tuple(placed)), T_cam_boards


def solve(
    views: Sequence[View],
    first: CalibrationSolution,
    free: tuple[str, ...],
    world: WorldFrame,
    weights: Sequence[FloatArray],
) -> CalibrationFit:
    """Return the least-squares fit from a first solution.

    Parameters
    ----------
    views : boards found, one for each picture
    first : parameters of `start`, or of another fit
    free : the intrinsics to be found; the others are 0
    world : flat view that fixes the world's frame
    weights : per view (n,), one over the standard deviation of a corner; 0 leaves it out
    """
    held = np.array([name not in free for name in PARAMETERS])
    first = replace(first, intrinsics=np.where(held, 0.0, first.intrinsics))
    layout = _Layout(views, free, world)

    at_x: dict[bytes, tuple[FloatArray, FloatArray]] = {}

    def evaluated(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        key = x.tobytes()
        if key not in at_x:  # the solver calls for residuals and Jacobian one after the other
            at_x.clear()
            at_x[key] = layout.evaluate(x, first, weights)
        return at_x[key]

    def residuals(x: FloatArray) -> FloatArray:
        return evaluated(x)[0]

    def slopes(x: FloatArray) -> FloatArray:
        return evaluated(x)[1]

    origin = np.zeros(layout.size)
    steep = np.maximum(np.linalg.norm(evaluated(origin)[1], axis=0), 1e-12)
    found = least_squares(
        residuals,
        origin,
        jac=slopes,
        method="trf",
        x_scale=_FIRST_STEP / steep,  # this limits the length of the first step
        xtol=1e-8,
        ftol=1e-9,  # with 2000 residuals, stopping here leaves 0.002 standard deviations
        gtol=None,
        max_nfev=100,
    )
    at = layout.apply(found.x, first)
    whole = _Layout(views, PARAMETERS, world)
    still = np.zeros(whole.size)
    r, jac = whole.evaluate(still, at, weights)
    raw, _ = whole.evaluate(still, at, [np.ones(len(v.board.pixels)) for v in views])
    ends = np.cumsum([len(v.board.pixels) for v in views])[:-1]
    parts = tuple(-p for p in np.split(raw.reshape(-1, 2), ends))
    return CalibrationFit(at, free, parts, jac, float(r @ r))


class _Layout:
    """The order of the unknowns, and the residuals for given unknowns."""

    def __init__(self, views: Sequence[View], free: tuple[str, ...], world: WorldFrame) -> None:
        self._views = views
        self._free = [i for i, name in enumerate(PARAMETERS) if name in free]
        self._camera = len(free)
        self._first: list[int] = []
        at = self._camera + 6
        self._kinds: list[str] = []
        for view in views:
            kind = "anchor" if view.name == world.name else str(view.placed)
            self._kinds.append(kind)
            self._first.append(at)
            at += {"anchor": 0, PlacedBoard.FLAT.value: 3}.get(kind, 6)
        self.size = at

    def apply(self, x: FloatArray, origin: CalibrationSolution) -> CalibrationSolution:
        """Return the solution at the step x from another solution."""
        intrinsics = origin.intrinsics.copy()
        intrinsics[self._free] += x[: self._camera]
        placed = []
        for kind, at, T in zip(self._kinds, self._first, origin.T_ref_board, strict=True):
            if kind == "anchor":
                placed.append(T)
            elif kind == PlacedBoard.FLAT.value:
                angle = np.arctan2(T[1, 0], T[0, 0]) + x[at + 2]
                placed.append(_on_table(angle, T[0, 3] + x[at], T[1, 3] + x[at + 1], T[2, 3]))
            else:
                placed.append(_moved(T, x[at : at + 6]))
        c = self._camera
        return CalibrationSolution(
            intrinsics, _moved(origin.T_cam_world, x[c : c + 6]), tuple(placed)
        )

    def evaluate(
        self, x: FloatArray, origin: CalibrationSolution, weights: Sequence[FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """Return weighted residuals (2 n,), predicted less observed, and Jacobian (2 n, m)."""
        at_x = self.apply(x, origin)
        total = sum(len(v.board.pixels) for v in self._views)
        r = np.empty((total, 2))
        jac = np.zeros((total, 2, self.size))
        row, c = 0, self._camera
        R_cam_world = at_x.T_cam_world[:3, :3]
        for i, view in enumerate(self._views):
            n = len(view.board.pixels)
            rows = slice(row, row + n)
            row += n
            board = np.column_stack([view.board.board_mm, np.zeros(n)])
            T, at = at_x.T_ref_board[i], self._first[i]
            p_ref = board @ T[:3, :3].T + T[:3, 3]
            tilted = self._kinds[i] == PlacedBoard.TILTED.value
            p_cam = p_ref if tilted else p_ref @ R_cam_world.T + at_x.T_cam_world[:3, 3]
            pixels, by_point, by_lens = project(p_cam, at_x.intrinsics)
            w = weights[i][:, None]
            r[rows] = (pixels - view.board.pixels) * w
            w = w[:, :, None]
            jac[rows, :, :c] = by_lens[:, :, self._free] * w
            by_pose = np.concatenate([np.zeros_like(by_point), by_point], axis=2)
            if tilted:
                by_pose[:, :, :3] = by_turn(by_point, p_ref - T[:3, 3], x[at : at + 3])
                jac[rows, :, at : at + 6] = by_pose * w
                continue
            about = p_cam - at_x.T_cam_world[:3, 3]
            by_pose[:, :, :3] = by_turn(by_point, about, x[c : c + 3])
            jac[rows, :, c : c + 6] = by_pose * w
            if self._kinds[i] == PlacedBoard.FLAT.value:
                by_world = by_point @ R_cam_world
                arm = p_ref - T[:3, 3]
                jac[rows, :, at : at + 2] = by_world[:, :, :2] * w
                turned = np.column_stack([-arm[:, 1], arm[:, 0]])
                jac[rows, :, at + 2] = np.einsum("nij,nj->ni", by_world[:, :, :2], turned) * w[:, 0]
        return r.ravel(), jac.reshape(2 * total, self.size)


def by_turn(by_point: FloatArray, arm: FloatArray, w: FloatArray) -> FloatArray:
    """Return derivatives (n, 2, 3) of pixels by a rotation vector w.

    Parameters
    ----------
    by_point : (n, 2, 3) derivatives of the pixels by the points exp(w) q
    arm : (n, 3) exp(w) q, from the centre of rotation
    w : (3,) [rad]
    """
    # d(exp(w) q) = -[exp(w) q]x Jl(w) dw, and v @ -[a]x = a x v for a row v
    # (numpy.cross takes most of its time for its axes)
    a, b, c = arm.T[:, :, None]
    x, y, z = np.moveaxis(by_point, 2, 0)
    turn = np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=2)
    out: FloatArray = turn @ _left_jacobian(w)
    return out


def _left_jacobian(w: FloatArray) -> FloatArray:
    """Return the left Jacobian (3, 3) of the rotation group at a rotation vector."""
    angle = float(np.linalg.norm(w))
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    if angle < 1e-5:
        a, b = 0.5, 1.0 / 6.0
    else:
        a = (1 - np.cos(angle)) / angle**2
        b = (angle - np.sin(angle)) / angle**3
    out: FloatArray = np.eye(3) + a * cross + b * cross @ cross
    return out


def _moved(T: FloatArray, x: FloatArray) -> FloatArray:
    """Return the pose rotated by x[:3] from the left about its origin, and moved by x[3:]."""
    out = T.copy()
    out[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ T[:3, :3]
    out[:3, 3] += x[3:]
    return out


def _pose(rotation: Rotation, t: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), t
    return T


def _on_table(angle_rad: float, x_mm: float, y_mm: float, z_mm: float) -> FloatArray:
    return _pose(Rotation.from_euler("z", angle_rad), np.array([x_mm, y_mm, z_mm]))
