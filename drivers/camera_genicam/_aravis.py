"""The system library aravis, by ctypes: cameras, their features, their frames.

Names and types are those of aravis 0.8's headers (``arvcamera.h``, ``arvstream.h``,
``arvbuffer.h``, ``arvgvdevice.h``). Every call that takes a ``GError **`` has it checked. Knows
neither what a feature is for nor any clock. All calls block.
"""

import ctypes
import threading
from collections.abc import Sequence
from ctypes import (
    POINTER,
    byref,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_size_t,
    c_uint,
    c_uint32,
    c_uint64,
    c_void_p,
)
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

from drivers.errors import NoLibraryError
from messages import key, say

LIBRARY: Final = "libaravis-0.8.so.0"
_GLIB: Final = "libglib-2.0.so.0"
_GOBJECT: Final = "libgobject-2.0.so.0"
HOW_TO_INSTALL: Final = key(
    "install it with `apt-get install libaravis-0.8-0` (Debian, Ubuntu) or `dnf install aravis` "
    "(Fedora)"
)

STATUS_SUCCESS: Final = 0  # arvbuffer.h, ArvBufferStatus
# arvbuffer.h, ArvBufferStatus, by number
STATUS_WORDS: Final = {
    -1: "unknown",
    1: "cleared",
    2: "packets still missing after the frame's retention",
    3: "missing packets",
    4: "wrong packet number",
    5: "larger than the buffer",
    6: "still filling",
    7: "aborted",
}
PAYLOAD_IMAGES: Final = (1, 5)  # arvbuffer.h, ArvBufferPayloadType: image, extended chunk data
_NEVER_ADJUST: Final = 0  # arvgvdevice.h, ArvGvPacketSizeAdjustment
_NO_PACKET_SOCKET: Final = 1  # arvgvstream.h, ArvGvStreamOption
_SOCKET_BUFFER_FIXED: Final = 0  # arvgvstream.h, ArvGvStreamSocketBuffer
_INT_TYPE: Final = 6 << 2  # gtype.h, G_TYPE_INT
# a socket's buffer, in sizes of a frame: the kernel counts a packet with the memory it lies in, and
# aravis' own choice, one frame, held 155 of 164 packets (genicam.md 4)
SOCKET_FRAMES: Final = 2

# arvuvstream.c and arvgvstream.c, names of arv_stream_get_info_uint64_by_name: of every stream, and
# of one over a network alone
_STATISTICS: Final = ("n_completed_buffers", "n_failures", "n_underruns")
_NETWORK_STATISTICS: Final = ("n_missing_packets", "n_resend_requests", "n_resent_packets")


class DeviceFault(IntEnum):
    """Errors of aravis' own domain: arvdevice.h, ArvDeviceError."""

    WRONG_FEATURE = 0
    FEATURE_NOT_FOUND = 1
    NOT_CONNECTED = 2
    PROTOCOL = 3
    TRANSFER = 4
    TIMEOUT = 5
    NOT_FOUND = 6
    INVALID_PARAMETER = 7
    NO_DESCRIPTION = 8
    NO_STREAM_CHANNEL = 9
    NOT_CONTROLLER = 10
    UNKNOWN = 11
    ACCESS_DENIED = 17
    BUSY = 18


# the camera does not answer, or no longer to this program
GONE: Final = frozenset(
    {
        DeviceFault.NOT_CONNECTED,
        DeviceFault.TRANSFER,
        DeviceFault.TIMEOUT,
        DeviceFault.NOT_CONTROLLER,
        DeviceFault.ACCESS_DENIED,
    }
)


class AravisError(Exception):
    """A call to the library failed.

    Attributes
    ----------
    code : number within the error's domain
    fault : the same as `DeviceFault`; None for an error of another domain or an unlisted one
    """

    def __init__(self, message: str, code: int, fault: DeviceFault | None) -> None:
        super().__init__(message)
        self.code = code
        self.fault = fault

    @property
    def is_gone(self) -> bool:
        """Whether the camera does not answer any more, or not to this program."""
        return self.fault in GONE


@dataclass(frozen=True, slots=True)
class Listed:
    """A camera that answered a search.

    Attributes
    ----------
    name : the name that aravis gives it, vendor-model-serial
    vendor, model, serial : as it states them
    address : IP address, or place on the USB
    """

    name: str
    vendor: str
    model: str
    serial: str
    address: str


@dataclass(frozen=True, slots=True)
class Received:
    """A buffer that came back from the library.

    Attributes
    ----------
    status : `STATUS_SUCCESS`, or what is wrong with it (`STATUS_WORDS`)
    frame_id : the camera's number of the frame
    stamp_ns : the camera's time stamp [ns]
    payload : kind of content (`PAYLOAD_IMAGES`)
    pixel_format : its number in the Pixel Format Naming Convention
    width, height : of the picture [px]
    padding : bytes behind each row
    data : the picture; empty unless the status is success
    """

    status: int
    frame_id: int
    stamp_ns: int = 0
    payload: int = 1
    pixel_format: int = 0
    width: int = 0
    height: int = 0
    padding: int = 0
    data: bytes = b""


class _GError(ctypes.Structure):
    _fields_ = (("domain", c_uint32), ("code", c_int), ("message", c_char_p))


class _GValue(ctypes.Structure):
    _fields_ = (("g_type", c_size_t), ("data", c_uint64 * 2))


_GErrorPointer = POINTER(_GError)
_ERROR: Final = POINTER(_GErrorPointer)
_STRINGS: Final = POINTER(c_char_p)

# function: result, arguments; a call with _ERROR in last place is checked
_PROTOTYPES: Final[dict[str, tuple[Any, tuple[Any, ...]]]] = {
    "arv_get_major_version": (c_uint, ()),
    "arv_get_minor_version": (c_uint, ()),
    "arv_get_micro_version": (c_uint, ()),
    "arv_device_error_quark": (c_uint32, ()),
    "arv_update_device_list": (None, ()),
    "arv_get_n_devices": (c_uint, ()),
    "arv_get_device_id": (c_char_p, (c_uint,)),
    "arv_get_device_vendor": (c_char_p, (c_uint,)),
    "arv_get_device_model": (c_char_p, (c_uint,)),
    "arv_get_device_serial_nbr": (c_char_p, (c_uint,)),
    "arv_get_device_address": (c_char_p, (c_uint,)),
    "arv_camera_new": (c_void_p, (c_char_p, _ERROR)),
    "arv_camera_get_device": (c_void_p, (c_void_p,)),
    "arv_camera_is_gv_device": (c_int, (c_void_p,)),
    "arv_camera_is_feature_available": (c_int, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_get_string": (c_char_p, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_set_string": (None, (c_void_p, c_char_p, c_char_p, _ERROR)),
    "arv_camera_get_integer": (c_int64, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_set_integer": (None, (c_void_p, c_char_p, c_int64, _ERROR)),
    "arv_camera_get_integer_bounds": (
        None,
        (c_void_p, c_char_p, POINTER(c_int64), POINTER(c_int64), _ERROR),
    ),
    "arv_camera_get_float": (c_double, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_set_float": (None, (c_void_p, c_char_p, c_double, _ERROR)),
    "arv_camera_get_float_bounds": (
        None,
        (c_void_p, c_char_p, POINTER(c_double), POINTER(c_double), _ERROR),
    ),
    "arv_camera_get_boolean": (c_int, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_set_boolean": (None, (c_void_p, c_char_p, c_int, _ERROR)),
    "arv_camera_execute_command": (None, (c_void_p, c_char_p, _ERROR)),
    "arv_camera_dup_available_enumerations_as_strings": (
        c_void_p,
        (c_void_p, c_char_p, POINTER(c_uint), _ERROR),
    ),
    "arv_camera_get_payload": (c_uint, (c_void_p, _ERROR)),
    "arv_camera_gv_set_packet_size": (None, (c_void_p, c_int, _ERROR)),
    "arv_camera_gv_get_packet_size": (c_uint, (c_void_p, _ERROR)),
    "arv_camera_gv_set_packet_size_adjustment": (None, (c_void_p, c_int)),
    "arv_camera_gv_set_stream_options": (None, (c_void_p, c_int)),
    "arv_camera_create_stream": (c_void_p, (c_void_p, c_void_p, c_void_p, _ERROR)),
    "arv_device_read_register": (c_int, (c_void_p, c_uint64, POINTER(c_uint32), _ERROR)),
    "arv_gv_device_is_controller": (c_int, (c_void_p,)),
    "arv_gv_device_take_control": (c_int, (c_void_p, _ERROR)),
    "arv_gv_stream_socket_buffer_get_type": (c_size_t, ()),
    "arv_stream_push_buffer": (None, (c_void_p, c_void_p)),
    "arv_stream_timeout_pop_buffer": (c_void_p, (c_void_p, c_uint64)),
    "arv_stream_try_pop_buffer": (c_void_p, (c_void_p,)),
    "arv_stream_get_info_uint64_by_name": (c_uint64, (c_void_p, c_char_p)),
    "arv_buffer_new_allocate": (c_void_p, (c_size_t,)),
    "arv_buffer_get_status": (c_int, (c_void_p,)),
    "arv_buffer_get_payload_type": (c_int, (c_void_p,)),
    "arv_buffer_get_frame_id": (c_uint64, (c_void_p,)),
    "arv_buffer_get_timestamp": (c_uint64, (c_void_p,)),
    "arv_buffer_get_image_pixel_format": (c_uint32, (c_void_p,)),
    "arv_buffer_get_image_width": (c_int, (c_void_p,)),
    "arv_buffer_get_image_height": (c_int, (c_void_p,)),
    "arv_buffer_get_image_padding": (None, (c_void_p, POINTER(c_int), POINTER(c_int))),
    "arv_buffer_get_image_data": (c_void_p, (c_void_p, POINTER(c_size_t))),
}
_GLIB_PROTOTYPES: Final[dict[str, tuple[Any, tuple[Any, ...]]]] = {
    "g_error_free": (None, (_GErrorPointer,)),
    "g_free": (None, (c_void_p,)),
}
_GOBJECT_PROTOTYPES: Final[dict[str, tuple[Any, tuple[Any, ...]]]] = {
    "g_object_unref": (None, (c_void_p,)),
    "g_object_set_property": (None, (c_void_p, c_char_p, POINTER(_GValue))),
    "g_value_init": (c_void_p, (POINTER(_GValue), c_size_t)),
    "g_value_set_enum": (None, (POINTER(_GValue), c_int)),
    "g_value_set_int": (None, (POINTER(_GValue), c_int)),
}

# the list of devices is one for the process, and is made anew by each search
_search_lock = threading.Lock()


class Aravis:
    """The library, loaded.

    Parameters
    ----------
    calls : its functions by name, as `load` finds them
    """

    def __init__(self, calls: dict[str, Any]) -> None:
        self._calls = calls
        self._device_domain: int = calls["arv_device_error_quark"]()

    @classmethod
    def load(cls, library: str = LIBRARY) -> "Aravis":
        """Load the library; return it with its functions.

        Raises
        ------
        NoLibraryError : it is not installed, or lacks a function
        """
        calls: dict[str, Any] = {}
        try:
            for name, prototypes in (
                (library, _PROTOTYPES),
                (_GLIB, _GLIB_PROTOTYPES),
                (_GOBJECT, _GOBJECT_PROTOTYPES),
            ):
                loaded = ctypes.CDLL(name)
                for function, (result, arguments) in prototypes.items():
                    call = getattr(loaded, function)
                    call.restype, call.argtypes = result, arguments
                    calls[function] = call
        except OSError as error:
            raise NoLibraryError(
                say(
                    "the library aravis ({library}), which drives GenICam cameras, "
                    "cannot be loaded ({error}); {how_to_install}",
                    library=library,
                    error=error,
                    how_to_install=HOW_TO_INSTALL,
                )
            ) from error
        except AttributeError as error:
            raise NoLibraryError(
                say(
                    "the library aravis ({library}) is too old ({error}); {how_to_install}",
                    library=library,
                    error=error,
                    how_to_install=HOW_TO_INSTALL,
                )
            ) from error
        return cls(calls)

    @property
    def version(self) -> str:
        """Its version."""
        numbers = (self._calls[f"arv_get_{part}_version"]() for part in ("major", "minor", "micro"))
        return ".".join(str(number) for number in numbers)

    def call(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401  (as the function has it)
        """Call a function that cannot fail; return its result."""
        return self._calls[name](*arguments)

    def checked(self, name: str, *arguments: Any) -> Any:  # noqa: ANN401  (as the function has it)
        """Call a function whose last argument is a ``GError **``; return its result.

        Raises
        ------
        AravisError : it set the error
        """
        error = _GErrorPointer()
        result = self._calls[name](*arguments, byref(error))
        if not error:
            return result
        found = error.contents
        code, message = int(found.code), (found.message or b"").decode(errors="replace")
        is_own = found.domain == self._device_domain
        self._calls["g_error_free"](error)
        fault = DeviceFault(code) if is_own and code in set(DeviceFault) else None
        raise AravisError(message or say("{name}: error {code}", name=name, code=code), code, fault)

    def search(self) -> tuple[Listed, ...]:
        """Return the cameras that answer a search; takes about a second."""
        with _search_lock:
            self._calls["arv_update_device_list"]()
            return tuple(
                Listed(
                    *(
                        (self._calls[f"arv_get_device_{part}"](index) or b"").decode(
                            errors="replace"
                        )
                        for part in ("id", "vendor", "model", "serial_nbr", "address")
                    )
                )
                for index in range(self._calls["arv_get_n_devices"]())
            )

    def open(self, name: str) -> "Handle":
        """Return an open camera, by IP address or by the name that `search` gives it.

        Raises
        ------
        AravisError : it does not answer, or its description cannot be read
        """
        camera = self.checked("arv_camera_new", name.encode())
        if not camera:
            raise AravisError(name, DeviceFault.NOT_FOUND, DeviceFault.NOT_FOUND)
        return Handle(self, camera)


class Handle:
    """One open camera.

    Parameters
    ----------
    library : the library
    camera : its ``ArvCamera *``
    """

    def __init__(self, library: Aravis, camera: int) -> None:
        self._library, self._camera = library, camera
        self._device = library.call("arv_camera_get_device", camera)
        self.is_gige = bool(library.call("arv_camera_is_gv_device", camera))

    # --- features -------------------------------------------------------------------------------

    def has(self, feature: str) -> bool:
        """Return whether a feature is there and can be used now."""
        found = self._library.checked(
            "arv_camera_is_feature_available", self._camera, feature.encode()
        )
        return bool(found)

    def text(self, feature: str) -> str:
        """Return a string or the entry of an enumeration."""
        found = self._library.checked("arv_camera_get_string", self._camera, feature.encode())
        return (found or b"").decode(errors="replace")

    def set_text(self, feature: str, value: str) -> None:
        """Set a string or the entry of an enumeration."""
        self._library.checked(
            "arv_camera_set_string", self._camera, feature.encode(), value.encode()
        )

    def choices(self, feature: str) -> tuple[str, ...]:
        """Return the entries of an enumeration that can be chosen now."""
        count = c_uint()
        found = self._library.checked(
            "arv_camera_dup_available_enumerations_as_strings",
            self._camera,
            feature.encode(),
            byref(count),
        )
        if not found:
            return ()
        strings = ctypes.cast(found, _STRINGS)
        entries = tuple((strings[i] or b"").decode(errors="replace") for i in range(count.value))
        self._library.call("g_free", found)
        return entries

    def flag(self, feature: str) -> bool:
        """Return a boolean."""
        found = self._library.checked("arv_camera_get_boolean", self._camera, feature.encode())
        return bool(found)

    def set_flag(self, feature: str, value: bool) -> None:
        """Set a boolean."""
        self._library.checked("arv_camera_set_boolean", self._camera, feature.encode(), int(value))

    def number(self, feature: str) -> float:
        """Return a number, whether the camera has it as a float or as an integer."""
        return float(self._of_either_type("get", feature))

    def set_number(self, feature: str, value: float) -> None:
        """Set a number, whether the camera has it as a float or as an integer."""
        try:
            self._library.checked(
                "arv_camera_set_float", self._camera, feature.encode(), float(value)
            )
        except AravisError as error:
            if error.fault is not DeviceFault.WRONG_FEATURE:
                raise
            self._library.checked(
                "arv_camera_set_integer", self._camera, feature.encode(), round(value)
            )

    def bounds(self, feature: str) -> tuple[float, float]:
        """Return the smallest and the largest value of a number."""
        low, high = c_double(), c_double()
        name = feature.encode()
        try:
            self._library.checked(
                "arv_camera_get_float_bounds", self._camera, name, byref(low), byref(high)
            )
        except AravisError as error:
            if error.fault is not DeviceFault.WRONG_FEATURE:
                raise
            least, most = c_int64(), c_int64()
            self._library.checked(
                "arv_camera_get_integer_bounds", self._camera, name, byref(least), byref(most)
            )
            return float(least.value), float(most.value)
        return low.value, high.value

    def execute(self, feature: str) -> None:
        """Execute a command."""
        self._library.checked("arv_camera_execute_command", self._camera, feature.encode())

    def payload_bytes(self) -> int:
        """Return the size of a frame [bytes]."""
        return int(self._library.checked("arv_camera_get_payload", self._camera))

    def _of_either_type(self, verb: str, feature: str) -> float:
        try:
            found = self._library.checked(
                f"arv_camera_{verb}_float", self._camera, feature.encode()
            )
        except AravisError as error:
            if error.fault is not DeviceFault.WRONG_FEATURE:
                raise
            found = self._library.checked(
                f"arv_camera_{verb}_integer", self._camera, feature.encode()
            )
        return float(found)

    # --- GigE Vision ----------------------------------------------------------------------------

    def is_controller(self) -> bool:
        """Return whether this program controls the camera; of a USB camera always true."""
        if not self.is_gige:
            return True
        return bool(self._library.call("arv_gv_device_is_controller", self._device))

    def take_control(self) -> bool:
        """Ask for control; return whether it was given."""
        try:
            return bool(self._library.checked("arv_gv_device_take_control", self._device))
        except AravisError:
            return False

    def register(self, address: int) -> int:
        """Return a bootstrap register."""
        value = c_uint32()
        self._library.checked(
            "arv_device_read_register", self._device, c_uint64(address), byref(value)
        )
        return int(value.value)

    def packet_size(self) -> int:
        """Return the size of a packet of the stream [bytes], IP header and all."""
        return int(self._library.checked("arv_camera_gv_get_packet_size", self._camera))

    def set_packet_size(self, size: int) -> None:
        """Set the size of a packet of the stream [bytes], IP header and all."""
        self._library.call("arv_camera_gv_set_packet_size_adjustment", self._camera, _NEVER_ADJUST)
        self._library.checked("arv_camera_gv_set_packet_size", self._camera, size)

    # --- frames ---------------------------------------------------------------------------------

    def stream(self, buffer_count: int) -> "Stream":
        """Return the open stream, with buffers for frames of the present size."""
        size = self.payload_bytes()
        if self.is_gige:
            # as root, aravis would read packets below the sockets, and those of loopback twice
            self._library.call("arv_camera_gv_set_stream_options", self._camera, _NO_PACKET_SOCKET)
        stream = self._library.checked("arv_camera_create_stream", self._camera, None, None)
        return Stream(self._library, stream, self.is_gige, [size] * buffer_count)

    def close(self) -> None:
        """Release the camera, and with it its control."""
        self._library.call("g_object_unref", self._camera)


class Stream:
    """The frames of one camera.

    Parameters
    ----------
    library : the library
    stream : its ``ArvStream *``
    is_gige : whether they come over a socket
    sizes : size of each buffer [bytes]
    """

    def __init__(self, library: Aravis, stream: int, is_gige: bool, sizes: Sequence[int]) -> None:
        self._library, self._stream = library, stream
        self._statistics = _STATISTICS + (_NETWORK_STATISTICS if is_gige else ())
        if is_gige:
            self._widen_socket(SOCKET_FRAMES * max(sizes))
        for size in sizes:
            buffer = library.call("arv_buffer_new_allocate", size)
            library.call("arv_stream_push_buffer", stream, buffer)

    def _widen_socket(self, size: int) -> None:
        """Have the socket take a whole frame, so that a late reader loses no packet.

        The kernel grants no more than its ``net.core.rmem_max``.
        """
        call = self._library.call
        kind = call("arv_gv_stream_socket_buffer_get_type")
        for name, of_type, assign, wanted in (
            (b"socket-buffer", kind, "g_value_set_enum", _SOCKET_BUFFER_FIXED),
            (b"socket-buffer-size", _INT_TYPE, "g_value_set_int", size),
        ):
            value = _GValue()
            call("g_value_init", byref(value), of_type)
            call(assign, byref(value), wanted)
            call("g_object_set_property", self._stream, name, byref(value))

    def pop(self, timeout_s: float = 0.0) -> Received | None:
        """Return the next buffer within a time [s of the wall]; None if there is none."""
        if timeout_s > 0:
            buffer = self._library.call(
                "arv_stream_timeout_pop_buffer", self._stream, round(timeout_s * 1e6)
            )
        else:
            buffer = self._library.call("arv_stream_try_pop_buffer", self._stream)
        if not buffer:
            return None
        try:
            return self._received(buffer)
        finally:
            self._library.call("arv_stream_push_buffer", self._stream, buffer)

    def _received(self, buffer: int) -> Received:
        call = self._library.call
        status = int(call("arv_buffer_get_status", buffer))
        frame_id = int(call("arv_buffer_get_frame_id", buffer))
        payload = int(call("arv_buffer_get_payload_type", buffer))
        if status != STATUS_SUCCESS or payload not in PAYLOAD_IMAGES:
            return Received(status, frame_id, payload=payload)
        size, row, column = c_size_t(), c_int(), c_int()
        data = call("arv_buffer_get_image_data", buffer, byref(size))
        call("arv_buffer_get_image_padding", buffer, byref(row), byref(column))
        return Received(
            status,
            frame_id,
            int(call("arv_buffer_get_timestamp", buffer)),
            payload,
            int(call("arv_buffer_get_image_pixel_format", buffer)),
            int(call("arv_buffer_get_image_width", buffer)),
            int(call("arv_buffer_get_image_height", buffer)),
            int(row.value),
            ctypes.string_at(data, size.value) if data else b"",
        )

    def statistics(self) -> dict[str, int]:
        """Return the library's tallies of this stream; a USB stream has fewer."""
        read = "arv_stream_get_info_uint64_by_name"
        return {
            name: int(self._library.call(read, self._stream, name.encode()))
            for name in self._statistics
        }

    def close(self) -> None:
        """End the stream and release its buffers."""
        self._library.call("g_object_unref", self._stream)
