"""The kernel's rules: requests and structs, formats, controls, buffers; each ioctl's answer."""

from .buffers import BUFFERS_MAX, SLOT_BYTES, Buffer, BufferQueue
from .control_specs import DEFAULT_CONTROLS, ControlSpec, Kind
from .controls import ControlBank
from .formats import Picture, PixelFormat
from .handle import ClientMemory, Handle, NotYet, Refused
from .settings import CameraConfig, CaptureSettings

__all__ = [
    "BUFFERS_MAX",
    "DEFAULT_CONTROLS",
    "SLOT_BYTES",
    "Buffer",
    "BufferQueue",
    "CameraConfig",
    "CaptureSettings",
    "ClientMemory",
    "ControlBank",
    "ControlSpec",
    "Handle",
    "Kind",
    "NotYet",
    "Picture",
    "PixelFormat",
    "Refused",
]
