"""The camera's abilities and settings: name, formats, sizes, frame rates, inputs."""

import errno
from dataclasses import dataclass
from typing import Final

from . import abi
from .buffers import SLOT_BYTES
from .control_specs import DEFAULT_CONTROLS, ControlSpec
from .formats import PixelFormat
from .handle import Refused

_CAPABILITIES: Final = abi.CAP_VIDEO_CAPTURE | abi.CAP_EXT_PIX_FORMAT | abi.CAP_STREAMING
_KERNEL_VERSION: Final = 0x060100  # Linux 6.1, whose uvcvideo this camera was compared with


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """The camera as built: names, sizes, formats, rates, controls.

    Attributes
    ----------
    sizes_px : (width, height) each; the first is the sensor's and the default
    formats : the first is the default
    rates_hz : frames in a world second
    stamps_exposure_start : timestamps tell when exposure began, not ended, and are flagged so
    in_flight_max : pictures that may be in the making at one time; further frames are lost
    """

    card: str = "Emulated Camera"
    driver: str = "uvcvideo"
    bus_info: str = "usb-0000:00:14.0-1"
    sizes_px: tuple[tuple[int, int], ...] = ((1280, 1024), (640, 512))
    formats: tuple[PixelFormat, ...] = tuple(PixelFormat)
    rates_hz: tuple[int, ...] = (30, 20, 10, 5)
    default_rate_hz: int = 10
    controls: tuple[ControlSpec, ...] = DEFAULT_CONTROLS
    stamps_exposure_start: bool = False
    in_flight_max: int = 2

    def __post_init__(self) -> None:
        for size_px in self.sizes_px:
            for pixel_format in self.formats:
                if pixel_format.frame_bytes(size_px) > SLOT_BYTES:
                    raise ValueError(f"a frame of {size_px} px exceeds {SLOT_BYTES} bytes")
        if self.default_rate_hz not in self.rates_hz:
            raise ValueError(f"{self.default_rate_hz} Hz is none of {self.rates_hz}")
        if self.in_flight_max < 1:
            raise ValueError("without a picture in flight no frame is ever taken")


class CaptureSettings:
    """Format, size and rate, and the ioctls that read and change them."""

    def __init__(self, config: CameraConfig) -> None:
        self._config = config
        self.size_px = config.sizes_px[0]
        self.pixel_format = config.formats[0]
        self.rate_hz = config.default_rate_hz

    @property
    def frame_bytes(self) -> int:
        """The room one frame needs (sizeimage)."""
        return self.pixel_format.frame_bytes(self.size_px)

    def querycap(self, data: bytearray) -> None:
        """Answer VIDIOC_QUERYCAP."""
        config = self._config
        data[:] = abi.CAPABILITY.pack(
            config.driver.encode()[:15],
            config.card.encode()[:31],
            config.bus_info.encode()[:31],
            _KERNEL_VERSION,
            _CAPABILITIES | abi.CAP_DEVICE_CAPS,
            _CAPABILITIES,
        )

    def enum_fmt(self, data: bytearray) -> None:
        """Answer VIDIOC_ENUM_FMT.

        Raises
        ------
        Refused : EINVAL, the list of formats has ended, or not a capture
        """
        index, kind = abi.FMTDESC.unpack(data)[:2]
        if kind != abi.BUF_TYPE_VIDEO_CAPTURE or index >= len(self._config.formats):
            raise Refused(errno.EINVAL)
        listed = self._config.formats[index]
        data[:] = abi.FMTDESC.pack(
            index,
            kind,
            abi.FMT_FLAG_COMPRESSED if listed.is_compressed else 0,
            listed.description.encode(),
            listed.code,
            0,
        )

    def g_fmt(self, data: bytearray) -> None:
        """Answer VIDIOC_G_FMT."""
        self._demand_capture(data)
        self._describe(data, self.size_px, self.pixel_format)

    def try_fmt(self, data: bytearray) -> tuple[tuple[int, int], PixelFormat]:
        """Answer VIDIOC_TRY_FMT with the nearest thing there is; return it."""
        self._demand_capture(data)
        _, width, height, code = abi.FORMAT.unpack(data)[:4]
        size_px = min(self._config.sizes_px, key=lambda s: abs(s[0] * s[1] - width * height))
        known = self._config.formats
        pixel_format = next((listed for listed in known if listed.code == code), known[0])
        self._describe(data, size_px, pixel_format)
        return size_px, pixel_format

    def s_fmt(self, data: bytearray, *, is_busy: bool) -> None:
        """Answer VIDIOC_S_FMT, refused while buffers exist.

        Raises
        ------
        Refused : EBUSY, buffers exist; EINVAL, not a capture
        """
        size_px, pixel_format = self.try_fmt(data)
        if is_busy:
            raise Refused(errno.EBUSY)
        self.size_px, self.pixel_format = size_px, pixel_format

    def g_parm(self, data: bytearray) -> None:
        """Answer VIDIOC_G_PARM."""
        self._demand_capture(data)
        data[:] = abi.STREAMPARM.pack(
            abi.BUF_TYPE_VIDEO_CAPTURE, abi.CAP_TIMEPERFRAME, 0, 1, self.rate_hz, 0, 0
        )

    def s_parm(self, data: bytearray, *, is_busy: bool) -> None:
        """Answer VIDIOC_S_PARM with the nearest rate; refused while frames flow.

        Raises
        ------
        Refused : EBUSY, frames flow; EINVAL, not a capture
        """
        self._demand_capture(data)
        _, _, _, numerator, denominator, _, _ = abi.STREAMPARM.unpack(data)
        if is_busy:
            raise Refused(errno.EBUSY)
        if numerator and denominator:
            wish_hz = denominator / numerator
            self.rate_hz = min(self._config.rates_hz, key=lambda rate: abs(rate - wish_hz))
        else:
            self.rate_hz = self._config.default_rate_hz
        self.g_parm(data)

    def enuminput(self, data: bytearray) -> None:
        """Answer VIDIOC_ENUMINPUT: there is one.

        Raises
        ------
        Refused : EINVAL, an input after the first
        """
        if abi.U32.unpack_from(data)[0]:
            raise Refused(errno.EINVAL)
        data[:] = abi.INPUT.pack(0, b"Camera 1", abi.INPUT_TYPE_CAMERA, 0, 0, 0, 0, 0)

    def g_input(self, data: bytearray) -> None:
        """Answer VIDIOC_G_INPUT."""
        data[:] = abi.U32.pack(0)

    def s_input(self, data: bytearray) -> None:
        """Answer VIDIOC_S_INPUT.

        Raises
        ------
        Refused : EINVAL, an input other than the first
        """
        if any(data):
            raise Refused(errno.EINVAL)

    def enum_framesizes(self, data: bytearray) -> None:
        """Answer VIDIOC_ENUM_FRAMESIZES.

        Raises
        ------
        Refused : EINVAL, the list of sizes has ended, or no such format
        """
        index, code = abi.FRMSIZEENUM.unpack(data)[:2]
        self._demand_format(code)
        if index >= len(self._config.sizes_px):
            raise Refused(errno.EINVAL)
        data[:] = abi.FRMSIZEENUM.pack(
            index, code, abi.FRMSIZE_TYPE_DISCRETE, *self._config.sizes_px[index]
        )

    def enum_frameintervals(self, data: bytearray) -> None:
        """Answer VIDIOC_ENUM_FRAMEINTERVALS.

        Raises
        ------
        Refused : EINVAL, the list of rates has ended, or no such format or size
        """
        index, code, width, height = abi.FRMIVALENUM.unpack(data)[:4]
        self._demand_format(code)
        if (width, height) not in self._config.sizes_px or index >= len(self._config.rates_hz):
            raise Refused(errno.EINVAL)
        rate_hz = self._config.rates_hz[index]
        data[:] = abi.FRMIVALENUM.pack(
            index, code, width, height, abi.FRMIVAL_TYPE_DISCRETE, 1, rate_hz
        )

    def _demand_capture(self, data: bytearray) -> None:
        if abi.U32.unpack_from(data)[0] != abi.BUF_TYPE_VIDEO_CAPTURE:
            raise Refused(errno.EINVAL)

    def _demand_format(self, code: int) -> None:
        if code not in {listed.code for listed in self._config.formats}:
            raise Refused(errno.EINVAL)

    def _describe(
        self, data: bytearray, size_px: tuple[int, int], pixel_format: PixelFormat
    ) -> None:
        width, height = size_px
        data[:] = abi.FORMAT.pack(
            abi.BUF_TYPE_VIDEO_CAPTURE,
            width,
            height,
            pixel_format.code,
            abi.FIELD_NONE,
            pixel_format.bytes_per_line(width),
            pixel_format.frame_bytes(size_px),
            abi.COLORSPACE_JPEG if pixel_format.is_compressed else abi.COLORSPACE_SRGB,
            abi.PIX_FMT_PRIV_MAGIC,
            0,
            0,
            0,
            0,
        )
