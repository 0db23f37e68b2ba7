"""Where boards are to begin with: from one picture each, by the cell file's own figures."""

from collections.abc import Mapping

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from controller.arrays import FloatArray
from controller.imaging import Camera, inverse_pose
from messages import key

from ..camera import FoundBoard
from ..target import BoardSection
from ._types import (
    BoardPicture,
    CellPrior,
    KinematicsError,
    Placing,
    PlateGrasp,
    PrintedPattern,
    clamped_std,
)


def board_pose(camera: Camera, board: FoundBoard) -> FloatArray:
    """Return T_cam_board (4, 4) of a board in a picture.

    Raises
    ------
    KinematicsError : no pose fits its corners
    """
    solid = np.column_stack([board.board_mm, np.zeros(len(board.board_mm))])
    found, rvec, tvec = cv2.solvePnP(
        solid, board.pixels, camera.K, camera.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not found:
        raise KinematicsError(key("no pose of the board fits the corners found in the picture"))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.ravel(rvec)).as_matrix()
    T[:3, 3] = np.ravel(tvec)
    return T


def placed_roughly(camera: Camera, board: FoundBoard, height_mm: float) -> Placing:
    """Return the rough pose of a board on the table, to a centimetre and some degrees.

    Parameters
    ----------
    camera : as the cell file has it
    board : as its picture shows it
    height_mm : height of the print over the table
    """
    T_world_board = camera.T_world_cam @ board_pose(camera, board)
    x_axis = T_world_board[:3, 0]
    return Placing(
        float(T_world_board[0, 3]),
        float(T_world_board[1, 3]),
        float(np.arctan2(x_axis[1], x_axis[0])),
        height_mm,
        mm=15.0,
        rad=np.radians(5.0),
    )


def held_roughly(
    camera: Camera,
    face: PrintedPattern,
    picture: BoardPicture,
    T_world_tcp: FloatArray,
    std: FloatArray | None = None,
) -> PlateGrasp:
    """Return the rough pose of a plate in the jaws: the pads lie on its large faces.

    Parameters
    ----------
    camera : as the cell file has it
    face : the printed pattern in the picture
    picture : picture of the plate in the jaws
    T_world_tcp : (4, 4) pose of that moment, by the cell file
    std : (6,) as `clamped_std`, its default
    """
    T_world_board = camera.T_world_cam @ board_pose(camera, picture.board)
    T_tcp_body = inverse_pose(T_world_tcp) @ T_world_board @ inverse_pose(face.T_body_board)
    y = np.array([0.0, np.sign(T_tcp_body[1, 1]) or 1.0, 0.0])  # the plate's normal, in the jaws
    x = T_tcp_body[:3, 0] - y * (y @ T_tcp_body[:3, 0])
    x = x / np.linalg.norm(x)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    T[:3, 3] = T_tcp_body[0, 3], 0.0, T_tcp_body[2, 3]
    return PlateGrasp(T, clamped_std() if std is None else std)


def grasps_of(prior: CellPrior, pictures: Mapping[str, BoardPicture]) -> dict[str, PlateGrasp]:
    """Return a start for each grasp from one picture of it: name -> picture.

    Raises
    ------
    ValueError : a picture shows a board that lies on the table
    """
    nominal = np.array([u.nominal for u in prior.arm.unknowns])
    out = {}
    for name, picture in pictures.items():
        if picture.q is None:
            raise ValueError(f"{picture.name} shows no board in the gripper")
        T_arm_tcp = prior.arm.tcp(np.asarray(picture.q, dtype=np.float64)[None], nominal)[0]
        camera = prior.cameras[picture.camera].nominal
        T_world_tcp = prior.T_world_arm @ T_arm_tcp
        out[name] = held_roughly(camera, prior.faces[picture.face], picture, T_world_tcp)
    return out


def plate_faces(
    board: BoardSection, *, back_mm: float = 0.15, back_rad: float = 0.002
) -> tuple[PrintedPattern, PrintedPattern]:
    """Return both faces of a plate that is held by its bare side.

    The body's origin is in the middle of the bare side and of the thickness; x points to the print,
    y out of the front.

    Parameters
    ----------
    board : board of the plate
    back_mm, back_rad : standard deviations of the back's print against the front's
    """
    width_mm, _, thickness_mm = board.plate_mm
    first_mm = board.margin_mm + board.square_mm  # the first inner corner, from the plate's side
    x, side = board.bare_mm / 2.0 + first_mm, width_mm / 2.0 - first_mm
    front, back = np.eye(4), np.eye(4)
    front[:3, :3] = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    front[:3, 3] = x, thickness_mm / 2.0, -side
    back[:3, :3] = [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    back[:3, 3] = x, -thickness_mm / 2.0, side
    return PrintedPattern(front), PrintedPattern(back, pose_mm=back_mm, pose_rad=back_rad)
