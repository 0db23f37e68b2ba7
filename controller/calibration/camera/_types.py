"""The inputs and results of a camera calibration.

Frames: *board* as the target defines it (mm, Z out of the print, origin in an inner corner),
*world* with the table at z = 0, *cam* OpenCV's. Pixels (n, 2), x before y.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera

PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


class CalibrationError(Exception):
    """The views do not determine the camera; the message says what to do about it."""


class PlacedBoard(StrEnum):
    """Placement of a board in a picture."""

    FLAT = "flat"  # on the table
    TILTED = "tilted"  # in any other pose


@dataclass(frozen=True, slots=True)
class Chessboard:
    """A chessboard: inner corners along X and along Y, and the side of a square.

    The axis with the odd count runs from the side with two black corner squares to the side with
    two white ones. If both counts are odd or both are even, half a turn makes no difference.
    """

    inner_corners: tuple[int, int]
    square_mm: float

    @property
    def has_one_way_up(self) -> bool:
        """Whether the pattern looks different after half a turn."""
        columns, rows = self.inner_corners
        return columns % 2 != rows % 2


@dataclass(frozen=True, slots=True)
class Charuco:
    """A ChArUco board: squares along X and along Y, and the dictionary of its markers.

    X runs to the right and Y up in the board as OpenCV draws it; the origin is the inner corner
    at the lower left.
    """

    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    dictionary: str  # OpenCV's name, such as DICT_5X5_100
    legacy_pattern: bool = False  # as drawn by OpenCV before 4.6
    first_marker: int = 0  # id at the upper left; the others follow row by row

    @property
    def has_one_way_up(self) -> bool:
        """Whether the pattern looks different after half a turn."""
        return True


Target = Chessboard | Charuco


@dataclass(frozen=True, slots=True, eq=False)
class FoundBoard:
    """The corners of a board in a picture.

    Attributes
    ----------
    board_mm : (n, 2) in the board's plane
    pixels : (n, 2)
    square_px : side of its smallest square in the picture, along the shorter direction
    blur_px : standard deviation of the blur across its edges, median
    """

    board_mm: FloatArray
    pixels: FloatArray
    square_px: float
    blur_px: float


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A picture's board and its placement."""

    name: str
    placed: PlacedBoard
    board: FoundBoard


@dataclass(frozen=True, slots=True)
class WorldFrame:
    """The world frame, fixed by the pose of one flat board in it.

    The z of ``origin_mm`` is the height over the table of the print of every flat board.
    """

    name: str  # name of its view
    origin_mm: tuple[float, float, float]
    x_axis_angle_rad: float


@dataclass(frozen=True, slots=True)
class CalibrationLimits:
    """When a calibration is refused, each with its reason."""

    boards_min: int = 4  # fewer cannot contradict each other
    tilted_min: int = 2  # one tilted board determines f, a second one, tilted elsewise, checks it
    tilt_min_rad: float = np.radians(6.0)  # with less, f and height cannot be separated
    flat_max_rad: float = np.radians(4.0)  # one board's own tilt is known to about 1 deg
    # least corners of one picture; four fix a pose, fewer than eight hardly check it
    corners_min: int = 8
    coverage_min: float = 0.3  # share of the picture; beyond the boards, distortion is a guess
    rms_max_px: float = 0.6  # sharp pictures have 0.02 to 0.1 px
    rms_max_squares: float = 0.02  # as much, where squares are small
    picture_rms_ratio_max: float = 6.0  # one picture against the median of all
    outlier_sigma: float = 5.0  # a corner further off than this is dirt, not noise
    outliers_max: float = 0.05  # share of all corners
    focal_std_max: float = 0.01  # relative
    table_std_max_mm: float = 0.25  # at z = 0, within the area covered by boards
    table_std_max_px: float = 0.25  # or this, where pixels are coarser than parts are gauged
    # Beyond the boards, the uncertainty on the table may be this many times as large; it is
    # reported.
    beyond_ratio_max: float = 20.0
    condition_max: float = 1e6  # condition number of the scaled Jacobian


@dataclass(frozen=True, slots=True, eq=False)
class ViewResidual:
    """The residuals of one picture after the fit."""

    name: str
    placed: PlacedBoard
    corner_count: int
    outlier_count: int
    rms_px: float  # rms of the distance
    worst_px: float
    tilt_rad: float  # tilt of the board against the table


@dataclass(frozen=True, slots=True, eq=False)
class TableUncertainty:
    """The uncertainty of positions on a plane over the table, over a grid of pixels.

    Each figure is the standard deviation [mm] of the point where a pixel's sight line meets the
    plane, in the worst direction.

    Attributes
    ----------
    worst_mm : anywhere in the picture, at ``worst_at_px``
    covered_worst_mm : within the hull of all corners
    median_mm : median of the whole picture
    """

    height_mm: float
    worst_mm: float
    worst_at_px: tuple[float, float]
    covered_worst_mm: float
    median_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedCamera:
    """A camera, its agreement with the pictures, and its uncertainty.

    Attributes
    ----------
    free : names of the intrinsics that the views determine; the others of PARAMETERS are held at 0
    std : standard deviation of each free one
    held_std : standard deviation of each held one about 0
    parameters_cov : covariance (15, 15) of PARAMETERS, then of the rotation (3) [rad, about the
        camera's axes] and translation (3) [mm] of the world in the camera
    noise_cov : the share of it that comes from the corners' noise; held terms cause the rest
    rms_px : rms distance of all corners but outliers
    noise_px : standard deviation of a corner's u or v
    coverage : share of the picture within the hull of all corners
    condition : condition number of the scaled Jacobian
    focal_height_correlation : correlation of fx and the distance along the optical axis
    """

    camera: Camera
    free: tuple[str, ...]
    std: dict[str, float]
    held_std: dict[str, float]
    parameters_cov: FloatArray
    noise_cov: FloatArray
    position_std_mm: FloatArray
    tilt_rad: float
    tilt_std_rad: float
    table: tuple[TableUncertainty, ...]
    views: tuple[ViewResidual, ...]
    rms_px: float
    noise_px: float
    coverage: float
    condition: float
    focal_height_correlation: float
    world: WorldFrame
