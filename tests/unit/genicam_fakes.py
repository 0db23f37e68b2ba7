"""aravis in Python: the functions of its C interface that the driver calls, with a camera behind.

Written from aravis' headers, as the driver's own list of them is. An error is a GError in the last
argument; a handle is a number; a buffer goes out with `push_buffer` and comes back with a frame.
"""

from __future__ import annotations

import ctypes
import struct
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

CAMERA, DEVICE, STREAM = 101, 102, 103
DEVICE_DOMAIN, FEATURE_DOMAIN = 7, 8  # quarks: any two numbers
WRONG_FEATURE, FEATURE_NOT_FOUND, TIMEOUT, NOT_FOUND, ACCESS_DENIED = 0, 1, 5, 6, 17
READ_ONLY = 10  # of the other domain
WIDTH, HEIGHT = 8, 4
MONO8, MONO12, MONO16 = 0x01080001, 0x01100005, 0x01100007
OTHER_HOST = "10.9.8.7"


class FailedError(Exception):
    """A call of the fake that sets its GError."""

    def __init__(self, message: str, code: int, domain: int = DEVICE_DOMAIN) -> None:
        super().__init__(message)
        self.message, self.code, self.domain = message, code, domain


@dataclass
class Shot:
    """What one trigger makes the camera send; the default is one whole frame."""

    status: int = 0
    skips: int = 0  # numbers left out before it
    width: int = WIDTH
    level: int | None = None
    is_late: bool = False  # comes once the next trigger has been sent
    is_ignored: bool = False  # the camera was not ready
    padding: int = 0


@dataclass
class FakeCamera:
    """The camera: features, a register file, what it does with a trigger."""

    features: dict[str, Any] = field(
        default_factory=lambda: {
            "DeviceVendorName": "Acme",
            "DeviceModelName": "Eye 12",
            "DeviceSerialNumber": "4711",
            "DeviceFirmwareVersion": "2.5",
            "AcquisitionMode": "SingleFrame",
            "PixelFormat": "Mono8",
            "Width": 640,
            "Height": 480,
            "OffsetX": 16,
            "OffsetY": 8,
            "ReverseX": True,
            "TriggerSelector": "AcquisitionStart",
            "TriggerMode": "Off",
            "TriggerSource": "Line1",
            "ExposureAuto": "Continuous",
            "ExposureTime": 5000.0,
            "GainAuto": "Continuous",
            "Gain": 6.0,
            "GammaEnable": True,
            "Gamma": 0.45,
            "BlackLevel": 3.0,
            "ChunkModeActive": True,
            "TriggerSoftware": None,
            "AcquisitionStart": None,
            "AcquisitionStop": None,
        }
    )
    choices: dict[str, tuple[str, ...]] = field(
        default_factory=lambda: {
            "PixelFormat": ("Mono8", "Mono12", "Mono16", "BayerRG8"),
            "TriggerSelector": ("AcquisitionStart", "FrameStart"),
        }
    )
    bounds: dict[str, tuple[float, float]] = field(
        default_factory=lambda: {
            "ExposureTime": (10.0, 1e6),
            "Gain": (0.0, 24.0),
            "Gamma": (0.1, 4.0),
            "BlackLevel": (0.0, 32.0),
        }
    )
    ignores: set[str] = field(default_factory=set)  # features that take no value
    refuses: set[str] = field(default_factory=set)
    registers: dict[int, int] = field(default_factory=dict)
    trigger_modes: dict[str, str] = field(default_factory=dict)  # by selector
    packet_size: int = 576
    is_there: bool = True
    is_gige: bool = True
    has_control: bool = True
    refused_controls: int = 0  # so often control is refused
    shots: deque[Shot] = field(default_factory=deque)
    usual: Shot = field(default_factory=Shot)  # behind those
    executed: list[str] = field(default_factory=list)
    waiting: deque[tuple[Shot, int]] = field(default_factory=deque)
    late: deque[tuple[Shot, int]] = field(default_factory=deque)
    number: int = 0
    triggered: threading.Event = field(default_factory=threading.Event)
    pushed_count: int = 0
    popped_count: int = 0
    released: list[int] = field(default_factory=list)
    statistics: dict[str, int] = field(default_factory=dict)
    properties: dict[str, int] = field(default_factory=dict)  # of the stream

    def execute(self, command: str) -> None:
        """Obey a command."""
        self.executed.append(command)
        if command != "TriggerSoftware":
            return
        self.waiting += self.late
        self.late.clear()
        shot = self.shots.popleft() if self.shots else self.usual
        if shot.is_ignored:
            self.triggered.set()
            return
        self.number += 1 + shot.skips
        if self.number > 0xFFFF:
            self.number -= 0xFFFF
        (self.late if shot.is_late else self.waiting).append((shot, self.number))
        self.triggered.set()

    @property
    def triggers(self) -> int:
        """Number of triggers received."""
        return self.executed.count("TriggerSoftware")

    def picture(self, shot: Shot) -> tuple[int, bytes]:
        """Return pixel format and bytes of a frame; its grey level is its number."""
        name = self.features["PixelFormat"]
        level = self.number if shot.level is None else shot.level
        if name == "Mono8":
            row = bytes([level & 0xFF]) * shot.width
        else:
            row = struct.pack("<H", level) * shot.width
        number = {"Mono8": MONO8, "Mono12": MONO12, "Mono16": MONO16}[name]
        return number, (row + bytes(shot.padding)) * HEIGHT


def functions(camera: FakeCamera) -> dict[str, Callable[..., Any]]:
    """Return the C functions by name, as `Aravis` takes them."""
    fake = _Functions(camera)
    return {
        name: fake.failing(getattr(fake, name)) if name in fake.FAILING else getattr(fake, name)
        for name in dir(fake)
        if name.startswith(("arv_", "g_"))
    }


class _Functions:
    FAILING = frozenset(
        {
            "arv_camera_new",
            "arv_camera_is_feature_available",
            "arv_camera_dup_available_enumerations_as_strings",
            "arv_camera_execute_command",
            "arv_camera_get_payload",
            "arv_camera_create_stream",
            "arv_camera_gv_set_packet_size",
            "arv_camera_gv_get_packet_size",
            "arv_device_read_register",
            "arv_gv_device_take_control",
        }
        | {
            f"arv_camera_{verb}_{kind}"
            for verb in ("get", "set")
            for kind in ("string", "integer", "float", "boolean")
        }
        | {"arv_camera_get_integer_bounds", "arv_camera_get_float_bounds"}
    )

    def __init__(self, camera: FakeCamera) -> None:
        self.camera = camera
        self.kept: list[Any] = []  # what C would have allocated
        self.out: dict[int, tuple[Shot, int]] = {}

    def failing(self, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a call with a GError in last place."""

        def checked(*arguments: Any) -> Any:
            try:
                if arguments[0] == CAMERA and not self.camera.is_there:
                    raise FailedError("GigEVision read_register timeout", TIMEOUT)
                return call(*arguments[:-1])
            except FailedError as failed:
                pointer = arguments[-1]._obj
                error = pointer._type_(failed.domain, failed.code, failed.message.encode())
                self.kept.append(error)
                pointer.contents = error
                return 0

        return checked

    # --- the process ------------------------------------------------------------------------

    def arv_device_error_quark(self) -> int:
        return DEVICE_DOMAIN

    def arv_get_major_version(self) -> int:
        return 0

    def arv_get_minor_version(self) -> int:
        return 8

    def arv_get_micro_version(self) -> int:
        return 99

    def arv_update_device_list(self) -> None: ...

    def arv_get_n_devices(self) -> int:
        return 1 if self.camera.is_there else 0

    def arv_get_device_id(self, index: int) -> bytes:
        return b"Acme-Eye 12-4711"

    def arv_get_device_vendor(self, index: int) -> bytes:
        return b"Acme"

    def arv_get_device_model(self, index: int) -> bytes:
        return b"Eye 12"

    def arv_get_device_serial_nbr(self, index: int) -> bytes:
        return b"4711"

    def arv_get_device_address(self, index: int) -> bytes:
        return b"127.0.0.9"

    def g_error_free(self, error: Any) -> None: ...

    def g_free(self, pointer: Any) -> None: ...

    def g_object_unref(self, handle: int) -> None:
        self.camera.released.append(handle)

    def g_value_init(self, value: Any, kind: int) -> None: ...

    def g_value_set_enum(self, value: Any, entry: int) -> None:
        value._obj.data[0] = entry

    def g_value_set_int(self, value: Any, number: int) -> None:
        value._obj.data[0] = number

    def g_object_set_property(self, handle: int, name: bytes, value: Any) -> None:
        assert handle == STREAM
        self.camera.properties[name.decode()] = value._obj.data[0]

    # --- the camera ---------------------------------------------------------------------------

    def arv_camera_new(self, name: bytes) -> int:
        if not self.camera.is_there:
            raise FailedError(f"Device '{name.decode()}' not found", NOT_FOUND)
        return CAMERA

    def arv_camera_get_device(self, camera: int) -> int:
        return DEVICE

    def arv_camera_is_gv_device(self, camera: int) -> int:
        return int(self.camera.is_gige)

    def arv_camera_is_feature_available(self, camera: int, feature: bytes) -> int:
        return int(feature.decode() in self.camera.features)

    def _get(self, feature: bytes, kind: type) -> Any:
        name = feature.decode()
        if name not in self.camera.features:
            raise FailedError(f"[{name}] Not found", FEATURE_NOT_FOUND)
        value = self.camera.features[name]
        if name == "TriggerMode":
            selector = self.camera.features.get("TriggerSelector", "")
            value = self.camera.trigger_modes.get(selector, value)
        if type(value) is not kind:
            raise FailedError(f"[{name}] Not a {kind.__name__}", WRONG_FEATURE)
        return value

    def _set(self, feature: bytes, value: Any, kind: type) -> None:
        name = feature.decode()
        self._get(feature, kind)
        if name in self.camera.refuses:
            raise FailedError(f"[{name}] is read only", READ_ONLY, FEATURE_DOMAIN)
        if name in self.camera.ignores:
            return
        if name == "TriggerMode":
            selector = self.camera.features.get("TriggerSelector", "")
            self.camera.trigger_modes[selector] = value
        self.camera.features[name] = value

    def arv_camera_get_string(self, camera: int, feature: bytes) -> bytes:
        return str(self._get(feature, str)).encode()

    def arv_camera_set_string(self, camera: int, feature: bytes, value: bytes) -> None:
        self._set(feature, value.decode(), str)

    def arv_camera_get_integer(self, camera: int, feature: bytes) -> int:
        return int(self._get(feature, int))

    def arv_camera_set_integer(self, camera: int, feature: bytes, value: int) -> None:
        self._set(feature, value, int)

    def arv_camera_get_float(self, camera: int, feature: bytes) -> float:
        return float(self._get(feature, float))

    def arv_camera_set_float(self, camera: int, feature: bytes, value: float) -> None:
        self._set(feature, value, float)

    def arv_camera_get_boolean(self, camera: int, feature: bytes) -> int:
        return int(self._get(feature, bool))

    def arv_camera_set_boolean(self, camera: int, feature: bytes, value: int) -> None:
        self._set(feature, bool(value), bool)

    def _bounds(self, feature: bytes, kind: type, low: Any, high: Any) -> None:
        self._get(feature, kind)
        low._obj.value, high._obj.value = self.camera.bounds[feature.decode()]

    def arv_camera_get_float_bounds(self, camera: int, feature: bytes, low: Any, high: Any) -> None:
        self._bounds(feature, float, low, high)

    def arv_camera_get_integer_bounds(
        self, camera: int, feature: bytes, low: Any, high: Any
    ) -> None:
        self._bounds(feature, int, low, high)

    def arv_camera_dup_available_enumerations_as_strings(
        self, camera: int, feature: bytes, count: Any
    ) -> int:
        entries = self.camera.choices[feature.decode()]
        strings = (ctypes.c_char_p * len(entries))(*(entry.encode() for entry in entries))
        self.kept.append(strings)
        count._obj.value = len(entries)
        return ctypes.addressof(strings)

    def arv_camera_execute_command(self, camera: int, feature: bytes) -> None:
        if not self.camera.has_control:
            raise FailedError("GigEVision write_register error (access denied)", ACCESS_DENIED)
        self.camera.execute(feature.decode())

    def arv_camera_get_payload(self, camera: int) -> int:
        return WIDTH * HEIGHT * 2

    def arv_camera_gv_set_packet_size(self, camera: int, size: int) -> None:
        if "packet_size" not in self.camera.ignores:
            self.camera.packet_size = size

    def arv_camera_gv_get_packet_size(self, camera: int) -> int:
        return self.camera.packet_size

    def arv_camera_gv_set_packet_size_adjustment(self, camera: int, adjustment: int) -> None: ...

    def arv_device_read_register(self, device: int, address: Any, value: Any) -> int:
        value._obj.value = self.camera.registers.get(address.value, 0)
        return 1

    def arv_gv_device_is_controller(self, device: int) -> int:
        return int(self.camera.has_control)

    def arv_gv_device_take_control(self, device: int) -> int:
        if self.camera.refused_controls > 0:
            self.camera.refused_controls -= 1
            raise FailedError("GigEVision write_register error (access denied)", ACCESS_DENIED)
        self.camera.has_control = True
        return 1

    def arv_camera_gv_set_stream_options(self, camera: int, options: int) -> None: ...

    # --- the stream ---------------------------------------------------------------------------

    def arv_camera_create_stream(self, camera: int, callback: None, data: None) -> int:
        return STREAM

    def arv_gv_stream_socket_buffer_get_type(self) -> int:
        return 1

    def arv_stream_push_buffer(self, stream: int, buffer: int) -> None:
        self.camera.pushed_count += 1
        self.out.pop(buffer, None)

    def arv_stream_try_pop_buffer(self, stream: int) -> int:
        if not self.camera.waiting:
            return 0
        self.camera.popped_count += 1
        buffer = 1000 + self.camera.popped_count
        self.out[buffer] = self.camera.waiting.popleft()
        return buffer

    def arv_stream_timeout_pop_buffer(self, stream: int, timeout_us: int) -> int:
        return self.arv_stream_try_pop_buffer(stream)

    def arv_stream_get_info_uint64_by_name(self, stream: int, name: bytes) -> int:
        return self.camera.statistics.get(name.decode(), 0)

    def arv_buffer_new_allocate(self, size: int) -> int:
        return 1000

    def arv_buffer_get_status(self, buffer: int) -> int:
        return self.out[buffer][0].status

    def arv_buffer_get_payload_type(self, buffer: int) -> int:
        return 1

    def arv_buffer_get_frame_id(self, buffer: int) -> int:
        return self.out[buffer][1]

    def arv_buffer_get_timestamp(self, buffer: int) -> int:
        return 10**9 * self.out[buffer][1]

    def arv_buffer_get_image_pixel_format(self, buffer: int) -> int:
        return self.camera.picture(self.out[buffer][0])[0]

    def arv_buffer_get_image_width(self, buffer: int) -> int:
        return self.out[buffer][0].width

    def arv_buffer_get_image_height(self, buffer: int) -> int:
        return HEIGHT

    def arv_buffer_get_image_padding(self, buffer: int, row: Any, column: Any) -> None:
        row._obj.value, column._obj.value = self.out[buffer][0].padding, 0

    def arv_buffer_get_image_data(self, buffer: int, size: Any) -> int:
        _, data = self.camera.picture(self.out[buffer][0])
        kept = ctypes.create_string_buffer(data, len(data))
        self.kept.append(kept)
        size._obj.value = len(data)
        return ctypes.addressof(kept)
