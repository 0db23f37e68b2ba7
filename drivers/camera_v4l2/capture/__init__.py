"""The blocking half of a camera: format and controls locked, buffers read, frames chosen."""

from ._capture import CaptureSession
from ._controls import ControlInfo, ControlSetting
from ._decode import decode
from ._types import CameraConfig, CameraIdentity, CameraStats, Frame
from .selection import StampSource

__all__ = [
    "CameraConfig",
    "CameraIdentity",
    "CameraStats",
    "CaptureSession",
    "ControlInfo",
    "ControlSetting",
    "Frame",
    "StampSource",
    "decode",
]
