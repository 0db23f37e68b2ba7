"""The models of calibration files: mm, degrees, poses as 4 x 4 matrices; `docs/commissioning.md`.

Uncertainties ``u_...`` are standard uncertainties where parts are.
"""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from controller.arrays import FloatArray

from ..calibration_reference import CalibrationName
from ..yaml_models import Section, WrongKeyError
from ._old_forms import figures_of_one_make

Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Positive = Annotated[float, Field(gt=0, le=1e6)]
Uncertainty = Annotated[float, Field(ge=0, le=1e3)]
Row3 = tuple[Number, Number, Number]
Row4 = tuple[Number, Number, Number, Number]
Matrix3 = tuple[Row3, Row3, Row3]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
SQUARE = 1e-6  # a rotation that was written in full is square to its own digits


def _pose(name: str, rows: Matrix4) -> FloatArray:
    """Return a pose (4, 4); raise WrongKeyError if the numbers are none."""
    T = np.array(rows, dtype=float)
    R = T[:3, :3]
    is_square = np.allclose(R @ R.T, np.eye(3), atol=SQUARE) and np.linalg.det(R) > 0
    if not is_square or not np.array_equal(T[3], [0, 0, 0, 1]):
        raise WrongKeyError((name,), "is not a pose: its axes are not square")
    return T


class Residual(Section):
    """The residual of the fit, and its limit."""

    value: Uncertainty
    unit: Literal["px", "mm", "deg", "level"]
    limit: Positive


class Calibration(Section):
    """The header of every calibration file.

    Attributes
    ----------
    measured : date and time with its offset from UTC
    by : name of the person
    software : software that measured it
    cell : name of the cell
    evidence : folder with pictures and figures, from the folder of the cell file
    valid_days, valid_runs : limits after which it is stale; None for never
    residual : residual of the fit
    based_on : calibrations that went into this one, by the hash of their file
    """

    schema_: Literal[1] = Field(1, alias="schema")
    kind: str
    measured: datetime
    by: str = ""
    software: str = ""
    cell: str = ""
    evidence: str = ""
    valid_days: int | None = Field(None, ge=1, le=10_000)
    valid_runs: int | None = Field(None, ge=1, le=10_000_000)
    residual: Residual | None = None
    based_on: Mapping[CalibrationName, Sha256] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _has_an_offset(self) -> "Calibration":
        if self.measured.tzinfo is None:
            raise WrongKeyError(("measured",), "lacks its offset from UTC, as in ...T08:30:00Z")
        return self

    def as_json(self) -> dict[str, Any]:
        """Return the content of its file."""
        return self.model_dump(mode="json", by_alias=True)


class CameraCalibration(Calibration):
    """A camera: its lens and its pose.

    Attributes
    ----------
    K : pixels
    distortion : OpenCV's k1 k2 p1 p2 k3
    blur_px : standard deviation of an edge's blur
    gain : gain in the driver's own steps; None if the camera has no such control
    """

    kind: Literal["camera"] = "camera"
    size_px: tuple[Annotated[int, Field(ge=16)], Annotated[int, Field(ge=16)]]
    K: Matrix3
    distortion: tuple[Number, Number, Number, Number, Number]
    T_world_cam: Matrix4
    u_pose_mm: Uncertainty
    u_pose_deg: Uncertainty
    blur_px: Uncertainty = 0.0
    exposure_s: Annotated[float, Field(gt=0, le=1)] | None = None
    gain: Number | None = None

    @model_validator(mode="after")
    def _is_a_camera(self) -> "CameraCalibration":
        K = self.K
        if min(K[0][0], K[1][1]) <= 0 or K[0][1] != 0 or K[1][0] != 0 or K[2] != (0, 0, 1):
            raise WrongKeyError(
                ("K",), "is [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], fx and fy more than 0"
            )
        _pose("T_world_cam", self.T_world_cam)
        return self


class ArmCalibration(Calibration):
    """An arm: its pose, and its figures.

    Attributes
    ----------
    T_world_arm : pose of its base
    figures : its figures by the names that its model gives them; a name ends in the unit. Joints
        are approached with every motor from below
    jaw_zero_mm : opening of the jaws where their counter means 0; None for a driver that takes none
    play_deg : play of the gears of each motor, from one flank to the other
    repeatability_mm : repeatability of the TCP, from homing to homing
    observable, held : parameters that the pictures decided, and those that priors did
    """

    kind: Literal["arm"] = "arm"
    T_world_arm: Matrix4
    figures: Mapping[str, Number] = Field(default_factory=dict)
    jaw_zero_mm: Number | None = None
    play_deg: Mapping[str, Uncertainty] = Field(default_factory=dict)
    repeatability_mm: Uncertainty = 0.0
    u_mm: Uncertainty
    u_deg: Uncertainty
    observable: tuple[str, ...] = ()
    held: tuple[str, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _of_one_make(cls, given: object) -> object:
        return figures_of_one_make(given) if isinstance(given, dict) else given

    @model_validator(mode="after")
    def _stands_somewhere(self) -> "ArmCalibration":
        _pose("T_world_arm", self.T_world_arm)
        return self


class FixedGripperCalibration(Calibration):
    """The fixed gripper: its pose, and the scale of its opening.

    Attributes
    ----------
    opening_zero_mm, opening_scale : the jaws are ``zero + scale * reported`` apart
    u_mm, u_deg : uncertainty of the plane between its jaws: along its normal, and of its tilt
    observed, held : freedoms that touches decided, about and along its own axes, and the others
    held_mm, held_deg : largest errors of its pose along and about the other axes; alone, the limits
        within which the first touches of the step `grippers` are safe
    """

    kind: Literal["fixed_gripper"] = "fixed_gripper"
    T_world_tcp: Matrix4
    opening_zero_mm: Annotated[float, Field(ge=-10, le=10)] = 0.0
    opening_scale: Annotated[float, Field(ge=0.8, le=1.25)] = 1.0
    u_mm: Uncertainty
    u_deg: Uncertainty
    observed: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    held_mm: Uncertainty = 4.0
    held_deg: Uncertainty = 1.0

    @model_validator(mode="after")
    def _stands_somewhere(self) -> "FixedGripperCalibration":
        _pose("T_world_tcp", self.T_world_tcp)
        return self


class TraysCalibration(Calibration):
    """The middles of the trays."""

    kind: Literal["trays"] = "trays"
    centres: Mapping[Literal["accept", "reject", "quarantine"], tuple[Number, Number]]
    u_mm: Uncertainty


class LampCalibration(Section):
    """One lamp.

    Attributes
    ----------
    analog, relay : its channels, as found by switching them
    level : its light as a share of the nominal one, at full drive
    drive : share of its full dimming that it is used with, so that no picture saturates
    settle_s : time from the order until its light is steady
    uniformity : least light as a share of the most, over what it lights
    """

    analog: Annotated[int, Field(ge=0, le=7)]
    relay: Annotated[int, Field(ge=0, le=7)]
    level: Positive
    drive: Annotated[float, Field(ge=0.05, le=1)] = 1.0
    settle_s: Annotated[float, Field(ge=0, le=60)]
    uniformity: Annotated[float, Field(ge=0, le=1)] | None = None


class LampsCalibration(Calibration):
    """All lamps, by name."""

    kind: Literal["lamps"] = "lamps"
    lamps: Mapping[str, LampCalibration]


class VerifiedFigure(Section):
    """One figure of a verification.

    Attributes
    ----------
    value : value that 95 % of the looks stay below
    count : number of looks
    """

    value: Uncertainty
    limit: Positive
    unit: Literal["mm", "deg"]
    count: Annotated[int, Field(ge=1)]

    @property
    def passes(self) -> bool:
        """Whether it is within its limit."""
        return self.value <= self.limit


class VerificationRecord(Calibration):
    """A reference part measured over the table and in the grippers, against limits.

    Attributes
    ----------
    figures : by what was measured, such as ``pick position``
    """

    kind: Literal["verification"] = "verification"
    figures: Mapping[str, VerifiedFigure] = Field(min_length=1)

    @property
    def passed(self) -> bool:
        """Whether every figure is within its limit."""
        return all(one.passes for one in self.figures.values())


def pose_of(rows: Matrix4) -> FloatArray:
    """Return a pose (4, 4) [mm], square to the last digit."""
    T = np.array(rows, dtype=float)
    left, _, right = np.linalg.svd(T[:3, :3])
    T[:3, :3] = left @ right
    return T
