"""Synthetic cells for the calibration of arm and cameras: a truth drawn from a seed, and pictures.

The truth has a reading of its own of the arm's kinematics (umi_rtx.md 6), by rotations one after
the other, and projects points by OpenCV. The bounds are those of docs/adr/0041.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import cos, radians
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from controller.calibration.camera import FoundBoard
from controller.calibration.kinematics import (
    BoardPicture,
    CameraPrior,
    CellPrior,
    Placing,
    PlateGrasp,
    PrintedPattern,
    base_std,
    clamped_std,
)
from controller.imaging import Camera
from drivers.umi_scara import ArmGeometry, UmiFigures, kinematics

PAD_X_MM = -12.0  # the middle of the pads, from the TCP
SQUARE_MM, SIDE = 12.0, 6  # of the paddle: 6 x 6 inner corners
THICK_MM = 10.0
# counts per degree and per mm, umi_rtx.md 5.1, in the order of q; a wrist joint has two motors
COUNT_STD = np.array(
    [*np.radians(0.3 / np.array([29.221, 14.611, 9.740])), 0.3 / 3.75]
    + [radians(0.3 / (13.487 * 2**0.5))] * 2
)


def turned(vector: Any) -> np.ndarray:
    return Rotation.from_rotvec(np.asarray(vector, dtype=float)).as_matrix()


def pose(R: Any, t: Any) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def nominal_cameras() -> dict[str, Camera]:
    """The shipped cell's."""
    out = {}
    for name, f, at, x_axis, y_axis, distortion in (
        ("overhead", 3571.0, (360, 0, 1250), (0, -1, 0), (-1, 0, 0), (-0.06, 0.04, 4e-4, -3e-4, 0)),
        (
            "inspection",
            3733.0,
            (430, -700, 450),
            (1, 0, 0),
            (0, 0, -1),
            (-0.05, 0.03, -3e-4, 2e-4, 0),
        ),
    ):
        x, y = np.array(x_axis, float), np.array(y_axis, float)
        R = np.column_stack([x, y, np.cross(x, y)])
        K = np.array([[f, 0, 639.5], [0, f, 511.5], [0, 0, 1]])
        out[name] = Camera((1280, 1024), K, np.array(distortion, float), pose(R, at))
    return out


@dataclass
class TrueArm:
    """Where an arm truly is, by rotations one after the other."""

    upper_mm: float = 253.5
    fore_mm: float = 253.5
    tool_mm: float = 177.0
    tool_off_mm: tuple[float, float] = (0.0, 0.0)
    zero_rad: np.ndarray = field(default_factory=lambda: np.zeros(5))
    zed_zero_mm: float = 0.0
    yaw_per_elbow: float = 0.0
    sag_mm: float = 0.0
    play_rad: np.ndarray = field(default_factory=lambda: np.zeros(5))

    def T_arm_tcp(self, q: np.ndarray, side: np.ndarray | float = -0.5) -> np.ndarray:
        """``side``: where in its play each gear is, from -0.5 (come from below) to 0.5."""
        slack = self.play_rad * side  # shoulder, elbow, yaw, wrist 1, wrist 2
        s, e, y, z, p, r = q
        s = s + self.zero_rad[0] + slack[0]
        e = e + self.zero_rad[1] + slack[1]
        y = y + self.zero_rad[2] + slack[2]
        p = p + self.zero_rad[3] + (slack[3] + slack[4]) / 2
        r = r + self.zero_rad[4] + (slack[3] - slack[4]) / 2
        z = z + self.zed_zero_mm - self.sag_mm * cos(e / 2) ** 2
        about_z = Rotation.from_euler
        upper = about_z("z", s).apply([self.upper_mm, 0, 0])
        fore = about_z("z", s + e).apply([self.fore_mm, 0, 0])
        heading = s + e / 2 + y + self.yaw_per_elbow * e
        R = about_z("z", heading) * about_z("y", -p) * about_z("x", r)
        wrist = upper + fore + [0, 0, 915.0 + z]
        return pose(R.as_matrix(), wrist + R.apply([self.tool_mm, *self.tool_off_mm]))


@dataclass
class TrueCell:
    """A cell as it stands, and a rng for what is drawn of each picture."""

    cameras: dict[str, Camera]
    arm: TrueArm
    T_world_arm: np.ndarray
    T_tcp_body: dict[str, np.ndarray]
    faces: dict[str, np.ndarray]
    scales: dict[str, float]
    rng: np.random.Generator
    noise_px: float = 0.04
    joint_std: np.ndarray = field(default_factory=lambda: np.zeros(6))

    def T_world_tcp(self, q: np.ndarray) -> np.ndarray:
        return self.T_world_arm @ self.arm.T_arm_tcp(q)

    def held(
        self,
        name: str,
        camera: str,
        face: str,
        grasp: str,
        q: np.ndarray,
        taken_s: float = 0.0,
        side: np.ndarray | float = -0.5,
        cam: Camera | None = None,
    ) -> BoardPicture | None:
        at = q + self.joint_std * self.rng.standard_normal(6)
        T = self.T_world_arm @ self.arm.T_arm_tcp(at, side)
        T = T @ self.T_tcp_body[grasp] @ self.faces[face]
        board = self._seen(cam or self.cameras[camera], grid(SIDE, SIDE, SQUARE_MM), T, face)
        if board is None:
            return None
        return BoardPicture(name, camera, face, board, grasp, q, taken_s)

    def lying(
        self, name: str, x: float, y: float, angle: float, taken_s: float = 0.0
    ) -> BoardPicture:
        T = pose(turned([0, 0, angle]), [x, y, 5.0])
        board = self._seen(self.cameras["overhead"], grid(11, 8, 15.0), T, "flat")
        assert board is not None
        return BoardPicture(name, "overhead", "flat", board, name, None, taken_s)

    def _seen(self, camera: Camera, mm: np.ndarray, T: np.ndarray, face: str) -> FoundBoard | None:
        solid = np.column_stack([mm * (1 + self.scales.get(face, 0.0)), np.zeros(len(mm))])
        world = solid @ T[:3, :3].T + T[:3, 3]
        to_eye = camera.position_mm - T[:3, 3]
        if T[:3, 2] @ to_eye < 0.6 * np.linalg.norm(to_eye):
            return None
        R, t = camera.T_world_cam[:3, :3], camera.T_world_cam[:3, 3]
        eye = (world - t) @ R
        pixels = cv2.projectPoints(eye, np.zeros(3), np.zeros(3), camera.K, camera.distortion)[0]
        pixels = pixels.reshape(-1, 2)
        inside = np.all((pixels > 15) & (pixels < np.array(camera.size_px) - 16), axis=1)
        if inside.sum() < 0.6 * len(mm) or eye[:, 2].min() < 300:
            return None
        pixels = pixels[inside] + self.noise_px * self.rng.standard_normal((int(inside.sum()), 2))
        return FoundBoard(mm[inside], pixels, 30.0, 0.8)


def grid(columns: int, rows: int, square_mm: float) -> np.ndarray:
    x, y = np.meshgrid(np.arange(columns), np.arange(rows))
    return square_mm * np.column_stack([x.ravel(), y.ravel()]).astype(float)


def paddle_faces() -> dict[str, PrintedPattern]:
    front, back = np.eye(4), np.eye(4)
    front[:3, :3], front[:3, 3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]], [30, THICK_MM / 2, -30]
    back[:3, :3], back[:3, 3] = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], [30, -THICK_MM / 2, 30]
    return {
        "front": PrintedPattern(front),
        "back": PrintedPattern(back, pose_mm=0.1, pose_rad=0.001),
        "flat": PrintedPattern(),
    }


def true_cell(seed: int, **changes: Any) -> TrueCell:
    """Return a cell that differs from its drawing as docs/adr/0041 has it."""
    rng = np.random.default_rng([seed, 44])

    def ball(radius: float, size: int = 3) -> np.ndarray:
        v = rng.standard_normal(size)
        return v / np.linalg.norm(v) * radius * rng.uniform() ** (1 / size)

    tilt = turned([*ball(radians(0.2), 2), 0.0])
    middle = np.array([360.0, 0, 0])
    T_tilt = pose(tilt, middle - tilt @ middle)

    def stood(T: np.ndarray, mm: float, deg: float) -> np.ndarray:
        return T_tilt @ pose(turned(ball(radians(deg))) @ T[:3, :3], T[:3, 3] + ball(mm))

    cameras = {}
    for name, one in nominal_cameras().items():
        K = one.K.copy()
        K[[0, 1], [0, 1]] *= 1 + rng.uniform(-0.01, 0.01)
        K[:2, 2] += rng.uniform(-8, 8, 2)
        off = rng.uniform(-1, 1, 5) * (0.03, 0.03, 0.0005, 0.0005, 0.01)
        cameras[name] = Camera(one.size_px, K, one.distortion + off, stood(one.T_world_cam, 5, 1))
    arm = TrueArm(
        253.5 + rng.uniform(-0.3, 0.3),
        253.5 + rng.uniform(-0.3, 0.3),
        177.0 + rng.uniform(-0.5, 0.5),
        (rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5)),
        np.radians(rng.uniform(-0.5, 0.5, 5)),
        rng.uniform(-0.5, 0.5),
        0.5 * rng.uniform(-0.01, 0.01),
        rng.uniform(0.2, 0.8),
        np.radians(rng.uniform(0.1, 0.3, 5)),
    )
    grasps = {}
    for i in range(3):
        # between flat pads: the normal along y, somewhere along them
        std = clamped_std()
        T = pose(turned([0, radians(rng.uniform(-4, 4)), 0]), [PAD_X_MM, 0, 0])
        T[[0, 2], 3] += rng.uniform(-4, 4, 2)
        slip = std * rng.standard_normal(6) * [1, 0, 1, 0, 1, 0]
        grasps[f"grasp{i}"] = pose(turned(slip[:3]) @ T[:3, :3], T[:3, 3] + slip[3:])
    faces = {}
    for name, face in paddle_faces().items():
        T = face.T_body_board.copy()
        T[:3, :3] = turned(face.pose_rad * rng.standard_normal(3)) @ T[:3, :3]
        T[:3, 3] += face.pose_mm * rng.standard_normal(3)
        faces[name] = T
    scales = {name: rng.uniform(-2e-4, 2e-4) for name in faces}
    cell = TrueCell(
        cameras,
        arm,
        stood(np.eye(4), 3, 0.5),
        grasps,
        faces,
        scales,
        rng,
        joint_std=COUNT_STD.copy(),
    )
    return replace(cell, **changes)


def prior(grasp_count: int = 1, placing_count: int = 4) -> CellPrior:
    """What a cell file, its bounds and rough looks give before the pictures."""
    placings = {"flat0": Placing(*PLACED[0], 5.0)}
    for i in range(1, placing_count):
        placings[f"flat{i}"] = Placing(*PLACED[i], 5.0, mm=15.0, rad=radians(5))
    return CellPrior(
        {name: CameraPrior.within(one) for name, one in nominal_cameras().items()},
        paddle_faces(),
        placings,
        {
            f"grasp{i}": PlateGrasp(pose(np.eye(3), [PAD_X_MM, 0, 0]), clamped_std())
            for i in range(grasp_count)
        },
        UmiFigures(ArmGeometry()),
        np.eye(4),
        base_std(),
        COUNT_STD,
    )


# where the flat board lies: its first inner corner and angle, all of it in the overhead picture
PLACED = ((290.0, 70.0, -1.5708), (330.0, 90.0, -1.2), (440.0, -10.0, 2.6), (300.0, -60.0, 0.4))


def in_sight(camera: str, rng: np.random.Generator, count: int) -> list[tuple[np.ndarray, str]]:
    """Return joints at which a camera sees a face of the paddle, by the drawing, and which face."""
    eye = nominal_cameras()[camera]
    faces = paddle_faces()
    T_body = pose(np.eye(3), [PAD_X_MM, 0, 0])
    out: list[tuple[np.ndarray, str]] = []
    for _ in range(400 * count):
        if camera == "overhead":
            middle = np.array(
                [rng.uniform(270, 450), rng.uniform(-120, 120), rng.uniform(120, 420)]
            )
        else:
            middle = np.array(
                [rng.uniform(375, 485), rng.uniform(-130, 110), rng.uniform(405, 495)]
            )
        face = "front" if rng.uniform() < 0.5 else "back"
        to_eye = eye.position_mm - middle
        normal = to_eye / np.linalg.norm(to_eye) + rng.uniform(-0.6, 0.6, 3)
        y = normal / np.linalg.norm(normal)
        x = np.cross(rng.standard_normal(3), y)
        x /= np.linalg.norm(x)
        if face == "back":
            y = -y
        R = np.column_stack([x, y, np.cross(x, y)])
        T = pose(R, middle - R @ [PAD_X_MM + 60, 0, 0])
        rows, legal = kinematics.inverse(T)
        rows = rows[legal]
        rows = rows[(np.abs(rows[:, 1]) > radians(15)) & (np.abs(rows[:, 0]) < radians(80))]
        if not len(rows):
            continue
        q = rows[rng.integers(len(rows))]
        T_world = kinematics.forward(q) @ T_body @ faces[face].T_body_board
        pixels = eye.project(
            np.column_stack([grid(2, 2, 60.0), np.zeros(4)]) @ T_world[:3, :3].T + T_world[:3, 3]
        )
        if np.all((pixels > 20) & (pixels < np.array(eye.size_px) - 20)):
            out.append((q, face))
            if len(out) == count:
                return out
    raise AssertionError(f"{len(out)} of {count} configurations for {camera}")


def bumped(camera: Camera, mm: float, deg: float, rng: np.random.Generator) -> Camera:
    """Return a camera that was moved by so much, in any direction."""
    w, v = (u / np.linalg.norm(u) for u in rng.standard_normal((2, 3)))
    T = camera.T_world_cam
    T = pose(turned(radians(deg) * w) @ T[:3, :3], T[:3, 3] + mm * v)
    return replace(camera, T_world_cam=T)


def pictures(
    cell: TrueCell,
    per_camera: int = 18,
    seed: int = 0,
    *,
    bump: tuple[str, Camera] | None = None,
    slip: tuple[str, np.ndarray] | None = None,
) -> list[BoardPicture]:
    """Return pictures of the flat board, of the plate, and of the flat board again, one a second.

    Half-way through its pictures of the plate a camera may be replaced by another one, or the plate
    slip before it.
    """
    rng = np.random.default_rng([seed, 7])
    out = [cell.lying(f"flat{i}", *PLACED[i], taken_s=float(i)) for i in range(4)]
    after = cell
    for camera in ("overhead", "inspection"):
        for n, (q, face) in enumerate(in_sight(camera, rng, per_camera)):
            if 2 * n >= per_camera and bump is not None and bump[0] == camera:
                after = replace(cell, cameras={**cell.cameras, camera: bump[1]})
            if 2 * n >= per_camera and slip is not None and slip[0] == camera:
                after = replace(cell, T_tcp_body={**cell.T_tcp_body, "grasp0": slip[1]})
            q = kinematics.counts_to_q(kinematics.q_to_counts(q))
            t = float(len(out))
            one = after.held(f"{camera}{len(out)}", camera, face, "grasp0", q, t)
            if one is not None:
                out.append(one)
    last = after.lying("flat0", *PLACED[0], taken_s=float(len(out)))
    return [*out, replace(last, name="flat0 again")]
