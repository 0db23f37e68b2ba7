"""The blocking half of a camera: format and controls locked, buffers read, frames chosen."""

from ._capture import Capture
from ._controls import ControlInfo, ControlSetting
from ._decode import BrokenPictureError, decode
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame
from .selection import StampSource

__all__ = [
    "BrokenPictureError",
    "CameraConfig",
    "CameraIdentity",
    "CameraStats",
    "Capture",
    "ControlInfo",
    "ControlSetting",
    "Frame",
    "StampSource",
    "decode",
]
