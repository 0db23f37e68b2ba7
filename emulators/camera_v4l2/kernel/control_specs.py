"""The controls of the camera: ids, ranges, defaults, and the automatic that drives each.

Ids are those of `linux/v4l2-controls.h`, names those of the kernel's table for UVC cameras.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

BRIGHTNESS: Final = 0x00980900
WHITE_BALANCE_AUTO: Final = 0x0098090C
GAIN: Final = 0x00980913
WHITE_BALANCE_TEMPERATURE: Final = 0x0098091A
EXPOSURE_AUTO: Final = 0x009A0901
EXPOSURE_TIME_ABSOLUTE: Final = 0x009A0902
EXPOSURE_AUTO_PRIORITY: Final = 0x009A0903
EXPOSURE_MANUAL, EXPOSURE_APERTURE_PRIORITY = 1, 3
EXPOSURE_UNIT_S: Final = 1e-4  # unit of EXPOSURE_TIME_ABSOLUTE


class Kind(IntEnum):
    """Types of a control (v4l2_ctrl_type)."""

    INTEGER = 1
    BOOLEAN = 2
    MENU = 3
    CLASS = 6


class ControlFlag(IntEnum):
    """Flags of a control."""

    READ_ONLY = 0x04
    INACTIVE = 0x10
    WRITE_ONLY = 0x40


@dataclass(frozen=True, slots=True)
class ControlSpec:
    """The maker's definition of one control.

    Attributes
    ----------
    cid : control id, as `linux/v4l2-controls.h` numbers it
    needs : the control and its value without which this one is driven by an automatic
    """

    cid: int
    name: str
    kind: Kind
    minimum: int = 0
    maximum: int = 0
    step: int = 0
    default: int = 0
    menu: Mapping[int, str] = field(default_factory=dict)
    needs: tuple[int, int] | None = None


DEFAULT_CONTROLS: Final = (
    ControlSpec(0x00980001, "User Controls", Kind.CLASS),
    ControlSpec(BRIGHTNESS, "Brightness", Kind.INTEGER, -64, 64, 1, 0),
    ControlSpec(WHITE_BALANCE_AUTO, "White Balance, Automatic", Kind.BOOLEAN, 0, 1, 1, 1),
    ControlSpec(GAIN, "Gain", Kind.INTEGER, 0, 100, 1, 0),
    ControlSpec(
        WHITE_BALANCE_TEMPERATURE,
        "White Balance Temperature",
        Kind.INTEGER,
        2800,
        6500,
        10,
        4600,
        needs=(WHITE_BALANCE_AUTO, 0),
    ),
    ControlSpec(0x009A0001, "Camera Controls", Kind.CLASS),
    ControlSpec(
        EXPOSURE_AUTO,
        "Auto Exposure",
        Kind.MENU,
        0,
        3,
        1,
        EXPOSURE_APERTURE_PRIORITY,
        menu={EXPOSURE_MANUAL: "Manual Mode", EXPOSURE_APERTURE_PRIORITY: "Aperture Priority Mode"},
    ),
    ControlSpec(
        EXPOSURE_TIME_ABSOLUTE,
        "Exposure Time, Absolute",
        Kind.INTEGER,
        1,
        5000,
        1,
        157,
        needs=(EXPOSURE_AUTO, EXPOSURE_MANUAL),
    ),
    ControlSpec(EXPOSURE_AUTO_PRIORITY, "Exposure, Dynamic Framerate", Kind.BOOLEAN, 0, 1, 1, 1),
)
