"""Sections of the cell file about grippers: fingers and their pads, force and times of the jaws.

Times are medians of the verbs of the shipped drivers on the cell's clock.
"""

from typing import Annotated

from pydantic import Field

from .yaml_models import Section

Width = Annotated[float, Field(ge=0.5, le=1000)]  # of a gripper [mm]
JawSeconds = Annotated[float, Field(ge=0, le=60)]  # how long jaws take [cell s]
JawForce = Annotated[float, Field(ge=1, le=2000)]  # [N]
Friction = Annotated[float, Field(ge=0.05, le=2)]


class FingersSection(Section):
    """The two fingers of a jaw.

    Attributes
    ----------
    length_mm : length along the approach
    width_mm : width across the approach, in the plane of the pad
    thickness_mm : thickness along the direction in which the pads open
    pad_length_mm : length of the pad, from the end of the finger
    friction : friction of the pads against the parts; a recipe may name that of its part
    compliance_mm : compliance of the pads
    """

    length_mm: Width
    width_mm: Width
    thickness_mm: Width
    pad_length_mm: Width
    friction: Friction = 0.6  # rubber on machined aluminium, dry
    compliance_mm: float = Field(0.4, ge=0.05, le=3)


class ArmJawsSection(Section):
    """Force and times of the arm gripper.

    Attributes
    ----------
    force_n : plans count on no more, whatever a recipe allows; the UMI RTX has no unit of force
        (umi_rtx.md 5.6)
    setting_per_n : slope of the driver's force setting for each N that a recipe allows
    open_s, release_s : the jaws open, before a grasp and out of one
    grasp_s, press_s : they close until they stall, width read back; they press on what they hold
    """

    force_n: JawForce = 40.0
    setting_per_n: float = Field(1.0, ge=0.05, le=20)
    open_s: JawSeconds = 0.7
    release_s: JawSeconds = 0.6
    grasp_s: JawSeconds = 0.75
    press_s: JawSeconds = 0.3


class FixedJawsSection(Section):
    """Force and times of the fixed gripper.

    Attributes
    ----------
    force_n : most that it may press with, where its driver allows as much
    open_s, grasp_s, release_s : the jaws open, close on a part, and let go of it
    """

    force_n: JawForce = 200.0
    open_s: JawSeconds = 0.35
    grasp_s: JawSeconds = 0.15
    release_s: JawSeconds = 0.2
