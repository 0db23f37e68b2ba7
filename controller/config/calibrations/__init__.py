"""Calibrations of a cell: files of measured values that take the place of the drawing's.

A cell file names each by ``calibration:``; `load_cell` replaces the nominal values by theirs, so
that every reader of a `Cell` gets the cell as measured.
"""

from ._apply import load_cell
from ._files import MODELS, digest_of, read_calibration, read_calibrations, write_calibration
from ._models import (
    ArmCalibration,
    Calibration,
    CameraCalibration,
    FixedGripperCalibration,
    LampCalibration,
    LampsCalibration,
    Residual,
    TraysCalibration,
    VerificationRecord,
    VerifiedFigure,
)
from ._standing import MAX_OFF_MM, CalibrationsStanding, CalibrationStanding, Usage, standing_of

__all__ = [
    "MAX_OFF_MM",
    "MODELS",
    "ArmCalibration",
    "Calibration",
    "CalibrationStanding",
    "CalibrationsStanding",
    "CameraCalibration",
    "FixedGripperCalibration",
    "LampCalibration",
    "LampsCalibration",
    "Residual",
    "TraysCalibration",
    "Usage",
    "VerificationRecord",
    "VerifiedFigure",
    "digest_of",
    "load_cell",
    "read_calibration",
    "read_calibrations",
    "standing_of",
    "write_calibration",
]
