"""Board pictures -> the camera: its lens and its pose over the table, with their uncertainty.

Arrays in, dataclasses out: `find_board` for each picture, then `calibrate` for all of them.
"""

from ._boards import NoBoardError, charuco_board, find_board
from ._calibrate import calibrate
from ._corners import refine_corners
from ._types import (
    PARAMETERS,
    CalibratedCamera,
    CalibrationError,
    CalibrationLimits,
    Charuco,
    Chessboard,
    FoundBoard,
    PlacedBoard,
    TableUncertainty,
    Target,
    View,
    ViewResidual,
    WorldFrame,
)

__all__ = [
    "PARAMETERS",
    "CalibratedCamera",
    "CalibrationError",
    "CalibrationLimits",
    "Charuco",
    "Chessboard",
    "FoundBoard",
    "NoBoardError",
    "PlacedBoard",
    "TableUncertainty",
    "Target",
    "View",
    "ViewResidual",
    "WorldFrame",
    "calibrate",
    "charuco_board",
    "find_board",
    "refine_corners",
]
