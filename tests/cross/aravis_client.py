"""A client of aravis by ctypes, the tests' own: enough to take pictures and to count losses.

Aravis reads the emulated camera as it would any maker's. Every call that can fail is checked.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int, c_uint32, c_uint64
from ctypes.util import find_library
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FRAME_PATIENCE_US = 60_000_000  # on a busy machine; a frame takes hundredths of a second
SUCCESS = 0
NO_PACKET_SOCKET = 1
SOFTWARE = {"TriggerSelector": "FrameStart", "TriggerSource": "Software", "TriggerMode": "On"}
STEADY: dict[str, float | str] = {"ExposureAuto": "Off", "GainAuto": "Off", "Gamma": 1.0}


class _Error(Structure):
    _fields_ = (("domain", c_uint32), ("code", c_int), ("message", c_char_p))


class AravisError(Exception):
    """What aravis says."""


def library() -> ctypes.CDLL | None:
    """Return aravis, or None where it is not installed."""
    name = find_library("aravis-0.8")
    if name is None:
        return None
    lib = ctypes.CDLL(name)
    pointer = ctypes.c_void_p
    for call in ("camera_new", "camera_get_device", "camera_create_stream", "buffer_new_allocate"):
        getattr(lib, f"arv_{call}").restype = pointer
    lib.arv_stream_timeout_pop_buffer.restype = pointer
    lib.arv_stream_try_pop_buffer.restype = pointer
    lib.arv_buffer_get_data.restype = pointer
    lib.arv_buffer_get_timestamp.restype = c_uint64
    lib.arv_buffer_get_frame_id.restype = c_uint64
    lib.arv_device_get_float_feature_value.restype = c_double
    lib.arv_device_get_string_feature_value.restype = c_char_p
    lib.arv_device_get_integer_feature_value.restype = ctypes.c_int64
    return lib


@dataclass(frozen=True)
class Shot:
    """A buffer as aravis gave it.

    Attributes
    ----------
    status : 0 if it is whole
    number : of the block
    timestamp_ns : by the camera's clock
    picture : (height, width); empty if it is not whole
    """

    status: int
    number: int
    timestamp_ns: int
    picture: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class AravisCamera:
    """One camera, opened by its address or name."""

    def __init__(self, lib: ctypes.CDLL, address: str) -> None:
        self._lib = lib
        self._camera = self._call("camera_new", address.encode(), on=None)
        self._device = ctypes.c_void_p(lib.arv_camera_get_device(self._camera))
        self._stream: ctypes.c_void_p | None = None

    def _call(self, name: str, *args: Any, on: Any = ...) -> Any:
        """Call a function that takes a GError last."""
        error = POINTER(_Error)()
        first = () if on is None else (self._device if on is ... else on,)
        result = getattr(self._lib, f"arv_{name}")(*first, *args, byref(error))
        if error:
            raise AravisError(error.contents.message.decode())
        restype = getattr(self._lib, f"arv_{name}").restype
        return ctypes.c_void_p(result) if restype is ctypes.c_void_p else result

    def set(self, **features: float | str) -> None:
        """Set features in their order."""
        for name, value in features.items():
            if isinstance(value, str):
                self._call("device_set_string_feature_value", name.encode(), value.encode())
            elif isinstance(value, float):
                self._call("device_set_float_feature_value", name.encode(), c_double(value))
            else:
                self._call("device_set_integer_feature_value", name.encode(), ctypes.c_int64(value))

    def text(self, name: str) -> str:
        """Return a feature as text."""
        return str(self._call("device_get_string_feature_value", name.encode()).decode())

    def number(self, name: str) -> int:
        """Return a whole number."""
        return int(self._call("device_get_integer_feature_value", name.encode()))

    def value(self, name: str) -> float:
        """Return a number."""
        return float(self._call("device_get_float_feature_value", name.encode()))

    def do(self, name: str) -> None:
        """Execute a command."""
        self._call("device_execute_command", name.encode())

    def steady(self, **features: float | str) -> None:
        """Set the features of power-up, nothing automatic, then others."""
        self.do("UserSetLoad")
        self.set(**STEADY, **features)

    def start(self, buffer_count: int = 3) -> None:
        """Open the stream, give it buffers, and start the acquisition."""
        # Its packet socket is opened by its thread, on a busy machine after the first frame's
        # leader; a UDP socket is there when the stream is.
        self._lib.arv_camera_gv_set_stream_options(self._camera, NO_PACKET_SOCKET)
        self._stream = self._call("camera_create_stream", None, None, on=self._camera)
        for _ in range(buffer_count):
            size = ctypes.c_size_t(self.number("PayloadSize"))
            buffer = ctypes.c_void_p(self._lib.arv_buffer_new_allocate(size))
            self._lib.arv_stream_push_buffer(self._stream, buffer)
        self._call("camera_start_acquisition", on=self._camera)

    def shot(self, patience_us: int = FRAME_PATIENCE_US) -> Shot | None:
        """Return the next buffer; None if none comes."""
        lib, stream = self._lib, self._stream
        got = lib.arv_stream_timeout_pop_buffer(stream, c_uint64(patience_us))
        if got is None:
            return None
        buffer = ctypes.c_void_p(got)
        size = ctypes.c_size_t()
        data = lib.arv_buffer_get_data(buffer, byref(size))
        width, height = self.number("Width"), self.number("Height")
        kind = np.uint8 if self.text("PixelFormat") == "Mono8" else np.dtype("<u2")
        status = lib.arv_buffer_get_status(buffer)
        pixels = ctypes.string_at(data, size.value) if status == SUCCESS else b""
        picture = np.frombuffer(pixels, kind)
        shot = Shot(
            status,
            lib.arv_buffer_get_frame_id(buffer),
            lib.arv_buffer_get_timestamp(buffer),
            picture.reshape(height, width) if status == SUCCESS else picture,
        )
        lib.arv_stream_push_buffer(stream, buffer)
        return shot

    def triggered(self) -> Shot:
        """Trigger by software; return the frame that comes."""
        self.do("TriggerSoftware")
        shot = self.shot()
        assert shot is not None, "no frame after a trigger"
        return shot

    def resends(self) -> int:
        """Return how many packets came because they were asked for again."""
        resent, missing = c_uint64(), c_uint64()
        self._lib.arv_gv_stream_get_statistics(self._stream, byref(resent), byref(missing))
        return int(resent.value)

    def close(self) -> None:
        """Stop, and give back control."""
        if self._stream is not None:
            self._lib.arv_camera_stop_acquisition(self._camera, None)
            self._lib.g_object_unref(self._stream)
            self._stream = None
        self._lib.g_object_unref(self._camera)


@contextmanager
def opened(lib: ctypes.CDLL, address: str) -> Iterator[AravisCamera]:
    """Open a camera while the block runs."""
    camera = AravisCamera(lib, address)
    try:
        yield camera
    finally:
        camera.close()
