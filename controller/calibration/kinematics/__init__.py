"""Pictures of boards on the table and in the gripper -> cameras, arm and base, with uncertainty.

Arrays in, dataclasses out: a `CellPrior` of prior knowledge, a `BoardPicture` for each picture,
then `calibrate_cell`.
"""

from ._types import (
    BoardPicture,
    CameraPrior,
    CellPrior,
    KinematicsError,
    Placing,
    PlateGrasp,
    PrintedPattern,
    SetupBounds,
    base_std,
    clamped_std,
    even_std,
)
from .arm import ArmUnknown, ExactArm, KinematicArm
from .choosing import ConfigurationChoice, PoseCandidate, choose, predicted_picture
from .faults import BoardAgain, FaultLimits, KinematicsFault, board_again, find_faults
from .layout import UnknownsLayout
from .play import HomingScatter, Play, StopPicture, measure_homing, measure_play
from .proven import ProvenFit, calibrate_and_prove
from .solve import CellFit, PictureFit, calibrate_cell
from .starts import board_pose, grasps_of, held_roughly, placed_roughly, plate_faces
from .uncertainty import (
    PoseUncertainty,
    aim_uncertainty_mm,
    camera_uncertainty,
    repeatability_mm,
    tcp_poses,
    tcp_uncertainty,
)

__all__ = [
    "ArmUnknown",
    "BoardAgain",
    "BoardPicture",
    "CameraPrior",
    "CellFit",
    "CellPrior",
    "ConfigurationChoice",
    "ExactArm",
    "FaultLimits",
    "HomingScatter",
    "KinematicArm",
    "KinematicsError",
    "KinematicsFault",
    "PictureFit",
    "Placing",
    "PlateGrasp",
    "Play",
    "PoseCandidate",
    "PoseUncertainty",
    "PrintedPattern",
    "ProvenFit",
    "SetupBounds",
    "StopPicture",
    "UnknownsLayout",
    "aim_uncertainty_mm",
    "base_std",
    "board_again",
    "board_pose",
    "calibrate_and_prove",
    "calibrate_cell",
    "camera_uncertainty",
    "choose",
    "clamped_std",
    "even_std",
    "find_faults",
    "grasps_of",
    "held_roughly",
    "measure_homing",
    "measure_play",
    "placed_roughly",
    "plate_faces",
    "predicted_picture",
    "repeatability_mm",
    "tcp_poses",
    "tcp_uncertainty",
]
