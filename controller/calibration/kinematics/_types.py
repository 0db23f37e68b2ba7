"""Inputs of the calibration of a whole cell: pictures of boards, and prior knowledge.

Frames: *world* (table z = 0), *cam* OpenCV's, *arm*, *tcp*, *body* of the plate that is held,
*board* of one printed pattern (Z out of the print). Prior knowledge is Gaussian. For a quantity
that a drawing leaves within a bound, the standard deviation is that of an even distribution there.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians, sqrt
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

from ..camera import FoundBoard
from .arm import KinematicArm


class KinematicsError(Exception):
    """The pictures do not determine the cell; the message says what to do about it."""


@dataclass(frozen=True, slots=True, eq=False)
class BoardPicture:
    """A board found in a picture.

    Attributes
    ----------
    name : name of the picture
    camera : camera of the picture
    face : printed pattern that it shows
    board : its corners
    held_as : the grasp that held it, or the placing on the table it lay in
    q : (6,) joints as the counters had them; None for a board on the table
    taken_s : time of the picture on any clock [s]; orders the pictures
    """

    name: str
    camera: str
    face: str
    board: FoundBoard
    held_as: str
    q: FloatArray | None = None
    taken_s: float = 0.0


@dataclass(frozen=True, slots=True)
class SetupBounds:
    """Bounds on the errors of a cell set up with a tape measure (docs/adr/0041)."""

    camera_mm: float = 5.0
    camera_rad: float = radians(1.0)
    focal: float = 0.01
    aspect: float = 0.0005  # a sensor's pixels are square
    centre_px: float = 8.0
    distortion: tuple[float, ...] = (0.03, 0.03, 0.0005, 0.0005, 0.01)
    base_mm: float = 3.0
    base_rad: float = radians(0.5)
    tilt_rad: float = radians(0.2)  # tilt of the table against all else


def even_std(bound: float) -> float:
    """Return the standard deviation of an even distribution within a bound to either side."""
    return bound / sqrt(3.0)


@dataclass(frozen=True, slots=True, eq=False)
class CameraPrior:
    """A camera from its cell file, with the standard deviations of its errors."""

    nominal: Camera
    pose_mm: float
    pose_rad: float
    focal: float  # relative error of the focal length
    aspect: float  # error of the ratio fy / fx
    centre_px: float
    distortion: tuple[float, ...]

    @classmethod
    def within(cls, nominal: Camera, bounds: SetupBounds = SetupBounds()) -> "CameraPrior":
        """Return the prior of a camera with every quantity within its bound."""
        # the tilt of the table turns the camera about the middle of the table
        high = abs(float(nominal.position_mm[2]))
        return cls(
            nominal,
            # the bound of a vector, not of each coordinate
            pose_mm=float(np.hypot(bounds.camera_mm / sqrt(5.0), high * bounds.tilt_rad / 2.0)),
            pose_rad=float(np.hypot(bounds.camera_rad / sqrt(5.0), bounds.tilt_rad / 2.0)),
            focal=even_std(bounds.focal),
            aspect=even_std(bounds.aspect),
            centre_px=even_std(bounds.centre_px),
            distortion=tuple(even_std(b) for b in bounds.distortion),
        )


# standard deviation of a print measured by a caliper: 0.03 mm in 150 mm
_PRINT_SCALE: Final = even_std(0.0002)


@dataclass(frozen=True, slots=True, eq=False)
class PrintedPattern:
    """One printed pattern.

    Attributes
    ----------
    T_body_board : (4, 4) pose of the board on the plate
    pose_mm, pose_rad : standard deviations of that pose; 0 holds it
    scale : relative standard deviation of its size
    """

    T_body_board: FloatArray = field(default_factory=lambda: np.eye(4))
    pose_mm: float = 0.0
    pose_rad: float = 0.0
    scale: float = _PRINT_SCALE


@dataclass(frozen=True, slots=True)
class Placing:
    """A board that lies on the table: one of them, wholly known, fixes the world.

    Attributes
    ----------
    x_mm, y_mm, angle_rad : position and angle of the board in the world
    height_mm : height of the print over the table
    mm, rad : standard deviations of x and y, and of the angle; 0 holds them
    """

    x_mm: float
    y_mm: float
    angle_rad: float
    height_mm: float
    mm: float = 0.0
    rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class PlateGrasp:
    """The plate between the jaws: the same for all pictures until the jaws open.

    Attributes
    ----------
    T_tcp_body : (4, 4) roughly
    std : (6,) standard deviations of its rotation [rad], then translation [mm], about and along the
        TCP's axes
    """

    T_tcp_body: FloatArray
    std: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class CellPrior:
    """Prior knowledge of a cell, before its pictures.

    Attributes
    ----------
    cameras, faces, placings, grasps : by name
    arm : its kinematics
    T_world_arm : (4, 4) nominal
    base_std : (6,) standard deviations of its rotation [rad], then translation [mm]
    joint_std : (6,) random difference of a joint at rest from its counter, new in each picture; the
        pictures decide on a common factor
    """

    cameras: Mapping[str, CameraPrior]
    faces: Mapping[str, PrintedPattern]
    placings: Mapping[str, Placing]
    grasps: Mapping[str, PlateGrasp]
    arm: KinematicArm
    T_world_arm: FloatArray
    base_std: FloatArray
    joint_std: FloatArray


def base_std(bounds: SetupBounds = SetupBounds(), *, lever_mm: float = 360.0) -> FloatArray:
    """Return the standard deviations (6,) of the base's rotation [rad] and translation [mm].

    Parameters
    ----------
    bounds : bounds of base and table
    lever_mm : from the base to the middle of the table, about which the table is tilted
    """
    turned = np.hypot(bounds.base_rad / sqrt(5.0), [bounds.tilt_rad / 2.0] * 2 + [0.0])
    moved = np.hypot(bounds.base_mm / sqrt(5.0), [0.0, 0.0, lever_mm * bounds.tilt_rad / 2.0])
    return np.concatenate([turned, moved])


def clamped_std(
    normal_rad: float = radians(0.15), centre_mm: float = 0.05, free_mm: float = 8.0
) -> FloatArray:
    """Return the standard deviations (6,) of the pose of a plate in the jaws, before any picture.

    The pads lie on its large faces. So its normal is along the jaws' axis y and its middle is in
    the middle between them, while it may be anywhere along the pads and turned about y.

    Parameters
    ----------
    normal_rad : standard deviation of the angle between plate and pads
    centre_mm : standard deviation of the centring by the jaws
    free_mm : range along the pads in which it may lie
    """
    return np.array(
        [normal_rad, radians(8.0), normal_rad, free_mm, centre_mm, free_mm], dtype=np.float64
    )
