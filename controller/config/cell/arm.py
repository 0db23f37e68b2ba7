"""The arm: dimensions, pose, and its differences from its drawing."""

from typing import Annotated, Any

from pydantic import AliasChoices, Field, model_validator

from ..grippers import ArmJawsSection, FingersSection, Width
from ..yaml_models import Section, WrongKeyError
from .values import MAX_OFF_MM, MAX_ZERO_DEG, Box, Length, Pose


class ParkSection(Section):
    """The position where the arm waits, out of both cameras' sight.

    Attributes
    ----------
    shoulder, elbow, yaw, pitch, roll : joints, in degrees
    """

    shoulder: float
    elbow: float
    yaw: float
    pitch: float
    roll: float


class LinksSection(Section):
    """The boxes that the arm's links take up, each in its own frame.

    Attributes
    ----------
    column : in the world
    carriage : origin on the shoulder's axis at the height of the wrist; does not turn
    upper : the same origin, x along the upper arm
    fore : origin on the elbow's axis at the height of the wrist, x along the forearm
    """

    column: Box
    carriage: Box
    upper: Box
    fore: Box


class UncertaintySection(Section):
    """Standard uncertainty of a pose.

    Attributes
    ----------
    position_mm, angle_deg : standard uncertainties of its position and orientation
    """

    position_mm: float = Field(0.0, ge=0, le=MAX_OFF_MM)
    angle_deg: float = Field(0.0, ge=0, le=MAX_ZERO_DEG)


class ArmSection(Section):
    """The keys of any arm: its pose in the world, and the gripper on it.

    Attributes
    ----------
    jaw_max_mm : widest opening of its gripper
    arm_gripper : boxes of the gripper in the frame of its TCP
    figures : its measured figures, by the names that its model gives them; empty until measured
    uncertainty : standard uncertainty of its TCP
    column_pose : pose in the world of the column's box, or of the base's, once the base was
        measured; None if it is as drawn
    """

    pose: Pose
    jaw_max_mm: Width
    jaws: ArmJawsSection = ArmJawsSection()
    arm_gripper: dict[str, Box] = Field(
        validation_alias=AliasChoices("arm_gripper", "hand"), serialization_alias="hand"
    )
    fingers: FingersSection
    figures: dict[str, float] = Field(default_factory=dict)
    uncertainty: UncertaintySection = UncertaintySection()
    column_pose: Pose | None = None


Zero = Annotated[float, Field(ge=-MAX_ZERO_DEG, le=MAX_ZERO_DEG)]
Small = Annotated[float, Field(ge=-MAX_OFF_MM, le=MAX_OFF_MM)]


class ZerosSection(Section):
    """The true joint positions at which the counters mean 0, in degrees.

    Attributes
    ----------
    shoulder, elbow, yaw, pitch, roll : by joint
    """

    shoulder: Zero = 0.0
    elbow: Zero = 0.0
    yaw: Zero = 0.0
    pitch: Zero = 0.0
    roll: Zero = 0.0


class CorrectionsSection(Section):
    """The differences of one UMI RTX from its counters; `figures` stand above them.

    Attributes
    ----------
    tool_off_mm : offset of the TCP from the approach axis, along the jaws' axis and across
    zed_zero_mm : height of zed where its counter means 0
    yaw_per_elbow : heading that a turn of the elbow adds to the nominal half of it
    sag_mm : sag of the stretched arm
    """

    tool_off_mm: tuple[Small, Small] = (0.0, 0.0)
    zero_deg: ZerosSection = ZerosSection()
    zed_zero_mm: Small = 0.0
    yaw_per_elbow: float = Field(0.0, ge=-0.05, le=0.05)
    sag_mm: Small = 0.0


class UmiSection(ArmSection):
    """A UMI RTX.

    Attributes
    ----------
    upper_mm, fore_mm : lengths from shoulder to elbow, from elbow to wrist
    tool_mm : distance from the wrist's centre to the TCP
    wrist_height_mm : height of the wrist's axis above the table, with zed at the top
    park_zed_mm : zed where the arm waits, below the noisy last counts under its top stop
        (umi_rtx.md 5.2)
    """

    upper_mm: Length
    fore_mm: Length
    tool_mm: Length
    wrist_height_mm: Length
    park_deg: ParkSection
    park_zed_mm: float = Field(-10.0, ge=-850, le=-5.5)
    links: LinksSection
    corrections: CorrectionsSection = CorrectionsSection()


class OtherArmSection(ArmSection):
    """An arm of another make.

    Attributes
    ----------
    column : the box in the world of what does not move
    shape : the dimensions that its driver needs
    """

    column: Box
    shape: dict[str, Any]

    @model_validator(mode="before")
    @classmethod
    def _names_no_umi(cls, given: object) -> object:
        for key in sorted(UmiSection.model_fields.keys() - cls.model_fields.keys()):
            if isinstance(given, dict) and key in given:
                raise WrongKeyError(
                    (key,), "describes a UMI RTX; another arm is described under `shape`"
                )
        return given


def arm_section(given: object) -> ArmSection:
    """Return the section of a UMI, or of the arm whose ``shape`` is given."""
    if isinstance(given, ArmSection):
        return given
    section = OtherArmSection if isinstance(given, dict) and "shape" in given else UmiSection
    return section.model_validate(given)
