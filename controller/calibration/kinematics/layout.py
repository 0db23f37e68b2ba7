"""The unknowns of a cell in one vector x, and the residuals of a board's corners.

x holds differences from the prior, 0 at first. A pose is turned from the left about its own origin
by a rotation vector, then moved: six numbers, rotation [rad] first. The chain of a corner is
board -> body -> tcp -> arm -> world -> cam -> pixel; its derivatives are analytic but for the
arm's, which are central differences of the arm's own function.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray, IndexArray
from controller.imaging import Camera, inverse_pose

from ..camera.solve import by_turn, project
from ._types import BoardPicture, CellPrior

LENS: Final = ("focal", "aspect", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3")
POSE: Final = ("rx_rad", "ry_rad", "rz_rad", "x_mm", "y_mm", "z_mm")
_PLACED: Final = ("x_mm", "y_mm", "rz_rad")
_STEP: Final = 1e-3  # step of central differences, as a share of a figure's bound
_JOINT_STEP: Final = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class PictureTerms:
    """One picture at given unknowns.

    Attributes
    ----------
    residual_px : (n, 2) predicted less observed
    columns : (m,) int, which unknowns it depends on
    by_unknowns : (n, 2, m) derivatives
    by_joints : (n, 2, 6), or None for a board on the table
    by_board : (n, 2, 6) by the board's pose in the camera, about the board's middle
    """

    residual_px: FloatArray
    columns: IndexArray
    by_unknowns: FloatArray
    by_joints: FloatArray | None
    by_board: FloatArray


class UnknownsLayout:
    """Names, prior spread and meaning of the unknowns of one cell.

    Parameters
    ----------
    prior : prior of the cell
    bumped : cameras that stood otherwise from a time on: name -> (time [s], std (6,) of the move)
    """

    def __init__(
        self, prior: CellPrior, bumped: Mapping[str, tuple[float, FloatArray]] | None = None
    ) -> None:
        self.prior = prior
        self.bumped = dict(bumped or {})
        self.names: list[str] = []
        std: list[float] = []
        self._at: dict[str, slice] = {}

        def block(key: str, names: Sequence[str], spread: Sequence[float] | FloatArray) -> None:
            self._at[key] = slice(len(self.names), len(self.names) + len(names))
            self.names += [f"{key}.{name}" for name in names]
            std.extend(float(s) for s in spread)

        for name, camera in prior.cameras.items():
            lens = (camera.focal, camera.aspect, camera.centre_px, camera.centre_px)
            block(f"{name}.lens", LENS, (*lens, *camera.distortion))
            block(name, POSE, [camera.pose_rad] * 3 + [camera.pose_mm] * 3)
        for name, (_, moved) in self.bumped.items():
            block(f"{name}.bump", POSE, moved)
        block("base", POSE, prior.base_std)
        figures = prior.arm.unknowns
        block("arm", [u.name for u in figures], [u.bound / np.sqrt(3.0) for u in figures])
        for name, face in prior.faces.items():
            block(f"{name}.print", ("scale",), (face.scale,))
            if face.pose_mm > 0 or face.pose_rad > 0:
                block(f"{name}.print.pose", POSE, [face.pose_rad] * 3 + [face.pose_mm] * 3)
        for name, placing in prior.placings.items():
            if placing.mm > 0:
                block(f"{name}.placed", _PLACED, (placing.mm, placing.mm, placing.rad))
        for name, grasp in prior.grasps.items():
            block(f"{name}.grasp", POSE, grasp.std)
        self.std: FloatArray = np.array(std)
        self.size = len(std)
        self._nominal: FloatArray = np.array([u.nominal for u in figures])
        self._steps: FloatArray = np.array([u.bound * _STEP for u in figures])

    def where(self, key: str) -> slice:
        """Return which part of x a block has; KeyError where the block is held."""
        return self._at[key]

    def index(self, name: str) -> int:
        """Return the place in x of one unknown by its full name."""
        return self.names.index(name)

    # -- what x means ---------------------------------------------------------------------------

    def lens(self, x: FloatArray, camera: str) -> FloatArray:
        """Return fx, fy, cx, cy, k1, k2, p1, p2, k3 of a camera."""
        nominal, d = self.prior.cameras[camera].nominal, x[self._at[f"{camera}.lens"]]
        f = nominal.K[0, 0] * (1.0 + d[0])
        aspect = nominal.K[1, 1] / nominal.K[0, 0] + d[1]
        centre = nominal.K[:2, 2] + d[2:4]
        return np.concatenate([[f, f * aspect], centre, np.ravel(nominal.distortion) + d[4:]])

    def camera(self, x: FloatArray, camera: str, taken_s: float = -np.inf) -> Camera:
        """Return a camera.

        Parameters
        ----------
        x : (m,) unknowns
        camera : its name
        taken_s : time; before any bump by default
        """
        fx, fy, cx, cy, *distortion = self.lens(x, camera)
        K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        nominal = self.prior.cameras[camera].nominal
        T = moved(nominal.T_world_cam, x[self._at[camera]])
        if self.is_bumped(camera, taken_s):
            T = moved(T, x[self._at[f"{camera}.bump"]])
        return Camera(nominal.size_px, K, np.array(distortion), T)

    def is_bumped(self, camera: str, taken_s: float) -> bool:
        """Return whether a picture is from after its camera moved."""
        return camera in self.bumped and taken_s >= self.bumped[camera][0]

    def T_world_arm(self, x: FloatArray) -> FloatArray:
        """Return the arm's base in the world (4, 4)."""
        return moved(self.prior.T_world_arm, x[self._at["base"]])

    def arm_values(self, x: FloatArray) -> FloatArray:
        """Return the arm's figures (k,)."""
        out: FloatArray = self._nominal + x[self._at["arm"]]
        return out

    def T_tcp_body(self, x: FloatArray, grasp: str) -> FloatArray:
        """Return the plate in the jaws (4, 4)."""
        return moved(self.prior.grasps[grasp].T_tcp_body, x[self._at[f"{grasp}.grasp"]])

    def T_world_board(self, x: FloatArray, placing: str) -> FloatArray:
        """Return a board on the table in the world (4, 4)."""
        at = self.prior.placings[placing]
        d = x[self._at[f"{placing}.placed"]] if f"{placing}.placed" in self._at else np.zeros(3)
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("z", at.angle_rad + d[2]).as_matrix()
        T[:3, 3] = at.x_mm + d[0], at.y_mm + d[1], at.height_mm
        return T

    def arm_derivatives(self, x: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return T_arm_tcp (n, 4, 4) at joints (n, 6), and its derivatives (k + 6, n, 4, 4).

        The first k are by the arm's figures, the last six by the joints.
        """
        arm, values = self.prior.arm, self.arm_values(x)
        by = []
        for i, step in enumerate(self._steps):
            d = np.zeros(len(values))
            d[i] = step
            by.append((arm.tcp(q, values + d) - arm.tcp(q, values - d)) / (2.0 * step))
        for i in range(6):
            d = np.zeros(6)
            d[i] = _JOINT_STEP
            by.append((arm.tcp(q + d, values) - arm.tcp(q - d, values)) / (2.0 * _JOINT_STEP))
        return arm.tcp(q, values), np.array(by)

    # -- what the corners say ---------------------------------------------------------------------

    def evaluate(self, x: FloatArray, pictures: Sequence[BoardPicture]) -> list[PictureTerms]:
        """Return residuals and derivatives of all pictures."""
        held = [i for i, p in enumerate(pictures) if p.q is not None]
        T_arm_tcp, by_arm = np.zeros((0, 4, 4)), np.zeros((0, 0, 4, 4))
        if held:
            q = np.array([pictures[i].q for i in held], dtype=np.float64)
            T_arm_tcp, by_arm = self.arm_derivatives(x, q)
        T_world_arm = self.T_world_arm(x)
        order = {i: n for n, i in enumerate(held)}
        out = []
        for i, picture in enumerate(pictures):
            if i in order:
                n = order[i]
                chain = _Chain(self, x, picture)
                chain.held(T_arm_tcp[n], by_arm[:, n], T_world_arm)
            else:
                chain = _Chain(self, x, picture)
                chain.lying()
            out.append(chain.terms())
        return out


class _Chain:
    """One picture's points on their path from the board to the pixels."""

    def __init__(self, layout: UnknownsLayout, x: FloatArray, picture: BoardPicture) -> None:
        self._layout, self._x, self._picture = layout, x, picture
        self._columns: list[IndexArray] = []
        self._by_world: list[FloatArray] = []  # (n, 3, m) derivatives of the points in the world
        self._joints: FloatArray | None = None
        face = layout.prior.faces[picture.face]
        board = np.column_stack([picture.board.board_mm, np.zeros(len(picture.board.board_mm))])
        scale = x[layout.where(f"{picture.face}.print")][0]
        self._board = board * (1.0 + scale)
        self._unscaled = board
        self._face = face

    def _add(self, key: str, by: FloatArray) -> None:
        at = self._layout.where(key)
        self._columns.append(np.arange(at.start, at.stop))
        self._by_world.append(by)

    def lying(self) -> None:
        """Take the points of a board on the table to the world."""
        layout, picture = self._layout, self._picture
        T = layout.T_world_board(self._x, picture.held_as)
        self._world = self._board @ T[:3, :3].T + T[:3, 3]
        self._add(f"{picture.face}.print", (self._unscaled @ T[:3, :3].T)[:, :, None])
        if layout.prior.placings[picture.held_as].mm > 0:
            by = np.zeros((len(self._world), 3, 3))
            by[:, 0, 0] = by[:, 1, 1] = 1.0
            about = self._world - T[:3, 3]
            by[:, 0, 2], by[:, 1, 2] = -about[:, 1], about[:, 0]
            self._add(f"{picture.held_as}.placed", by)

    def held(self, T_arm_tcp: FloatArray, by_arm: FloatArray, T_world_arm: FloatArray) -> None:
        """Take the points of a board in the gripper to the world.

        Parameters
        ----------
        T_arm_tcp : (4, 4) pose of the picture
        by_arm : (k, 4, 4) its derivatives by the arm's figures, then by the joints
        T_world_arm : (4, 4)
        """
        layout, x, picture = self._layout, self._x, self._picture
        grasp = f"{picture.held_as}.grasp"
        T_tcp_body = layout.T_tcp_body(x, picture.held_as)
        T_world_tcp = T_world_arm @ T_arm_tcp
        T_body_board = self._face.T_body_board
        pose_key = f"{picture.face}.print.pose"
        is_posed = self._face.pose_mm > 0 or self._face.pose_rad > 0
        turn = x[layout.where(pose_key)] if is_posed else np.zeros(6)
        T_body_board = moved(T_body_board, turn)
        body = self._board @ T_body_board[:3, :3].T + T_body_board[:3, 3]
        tcp = body @ T_tcp_body[:3, :3].T + T_tcp_body[:3, 3]
        arm = tcp @ T_arm_tcp[:3, :3].T + T_arm_tcp[:3, 3]
        self._world = arm @ T_world_arm[:3, :3].T + T_world_arm[:3, 3]

        R_world_body = T_world_tcp[:3, :3] @ T_tcp_body[:3, :3]
        R_world_board = R_world_body @ T_body_board[:3, :3]
        self._add(f"{picture.face}.print", (self._unscaled @ R_world_board.T)[:, :, None])
        if is_posed:
            by_face = _by_pose(body - T_body_board[:3, 3], turn)
            self._add(pose_key, R_world_body @ by_face)
        by_grasp = _by_pose(tcp - T_tcp_body[:3, 3], x[layout.where(grasp)])
        self._add(grasp, T_world_tcp[:3, :3] @ by_grasp)
        figures = T_world_arm[:3, :3] @ (
            np.einsum("kij,nj->nik", by_arm[:, :3, :3], tcp) + by_arm[:, :3, 3].T
        )
        count = len(layout.prior.arm.unknowns)
        self._add("arm", figures[:, :, :count])
        self._joints = figures[:, :, count:]
        self._add("base", _by_pose(self._world - T_world_arm[:3, 3], x[layout.where("base")]))

    def terms(self) -> PictureTerms:
        """Take the points to the pixels."""
        layout, x, picture = self._layout, self._x, self._picture
        camera = layout.camera(x, picture.camera, picture.taken_s)
        T_cam_world = inverse_pose(camera.T_world_cam)
        R = T_cam_world[:3, :3]
        cam = self._world @ R.T + T_cam_world[:3, 3]
        pixels, by_point, by_lens = project(cam, layout.lens(x, picture.camera))
        by_world = by_point @ R
        columns = list(self._columns)
        by = [by_world @ part for part in self._by_world]

        nominal = layout.prior.cameras[picture.camera].nominal
        fx, aspect = camera.K[0, 0], camera.K[1, 1] / camera.K[0, 0]
        lens = by_lens.copy()
        lens[:, :, 0] = nominal.K[0, 0] * (by_lens[:, :, 0] + aspect * by_lens[:, :, 1])
        lens[:, :, 1] = fx * by_lens[:, :, 1]
        keys = [(f"{picture.camera}.lens", lens)]
        # a camera moved one way has the points moved the other way; a turn is about its own origin
        own = layout.where(picture.camera)
        about = self._world - camera.T_world_cam[:3, 3]
        steady = _by_pose(about, x[own])
        if layout.is_bumped(picture.camera, picture.taken_s):
            bump = x[layout.where(f"{picture.camera}.bump")]
            keys.append((f"{picture.camera}.bump", -(by_world @ _by_pose(about, bump))))
            turned = Rotation.from_rotvec(bump[:3]).as_matrix()
            steady = np.concatenate(
                [turned @ _by_pose(about @ turned, x[own])[:, :, :3], steady[:, :, 3:]], axis=2
            )
        keys.append((picture.camera, -(by_world @ steady)))
        for key, part in keys:
            at = layout.where(key)
            columns.append(np.arange(at.start, at.stop))
            by.append(part)
        middle = cam.mean(axis=0)
        board = _by_pose(cam - middle, np.zeros(6))
        return PictureTerms(
            pixels - picture.board.pixels,
            np.concatenate(columns),
            np.concatenate(by, axis=2),
            None if self._joints is None else by_world @ self._joints,
            by_point @ board,
        )


def moved(T: FloatArray, x: FloatArray) -> FloatArray:
    """Return a pose turned by x[:3] [rad] from the left about its origin, and moved by x[3:]."""
    out = T.copy()
    out[:3, :3] = Rotation.from_rotvec(x[:3]).as_matrix() @ T[:3, :3]
    out[:3, 3] += x[3:]
    return out


def _by_pose(about: FloatArray, turn: FloatArray) -> FloatArray:
    """Return derivatives (n, 3, 6) of points by the rotation vector and the move of their frame.

    Parameters
    ----------
    about : (n, 3) the points as seen from the frame's origin, in the outer frame
    turn : at least (3,) the rotation vector at which the derivative is taken
    """
    eye = np.broadcast_to(np.eye(3), (len(about), 3, 3))
    return np.concatenate([by_turn(eye, about, turn[:3]), eye], axis=2)
