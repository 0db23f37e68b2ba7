"""The features by their SFNC names: kinds, ranges, values at power-up, registers.

At power-up the automatic functions are on and gamma bends, as many makers' cameras come: a client
that relies on a setting has to make it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import Final, Literal

FEATURES_ADDRESS: Final = 0x0001_0000
DESCRIPTION_ADDRESS: Final = 0x0010_0000
_WORD_BYTES: Final = 4
WIDTH_STEP_PX: Final = 4
SIDE_MIN_PX: Final = 16

# The pedestal that the world's pictures have, in steps of 8 bits: black level at power-up.
PEDESTAL_GREY: Final = 4.0
MAX_GAIN_DB: Final = 24.0
MIN_EXPOSURE_US: Final = 20.0
MAX_EXPOSURE_US: Final = 1e6


class PixelFormat(IntEnum):
    """Numbers of PFNC; above 8 bits a pixel has two bytes, the lower one first."""

    Mono8 = 0x0108_0001
    Mono10 = 0x0110_0003
    Mono12 = 0x0110_0005
    Mono16 = 0x0110_0007

    @property
    def bytes_per_pixel(self) -> int:
        """Bytes of a pixel."""
        return (self >> 16 & 0xFF) // 8

    @property
    def depth_bits(self) -> int:
        """Bits of a pixel that mean something."""
        return int(self.name.removeprefix("Mono"))


class Kind(Enum):
    """Kinds of features."""

    INTEGER = "Integer"
    FLOAT = "Float"
    BOOLEAN = "Boolean"
    ENUMERATION = "Enumeration"
    COMMAND = "Command"


@dataclass(frozen=True, slots=True)
class Sensor:
    """The sensor: its size and its rate at power-up.

    Attributes
    ----------
    width_px, height_px : size
    rate_hz : frames in a second, unless another rate is set
    """

    width_px: int
    height_px: int
    rate_hz: float


@dataclass(frozen=True, slots=True)
class Feature:
    """A feature and its register of one word.

    Attributes
    ----------
    name : of SFNC
    category : where a client lists it
    kind : of node
    start : value at power-up; None of a command
    low, high, step : range of a number
    unit : of a number
    entries : values of an enumeration by their names
    access : RW, RO or WO
    is_locked : cannot be written while pictures are taken
    """

    name: str
    category: str
    kind: Kind
    start: float | None = None
    low: float = 0.0
    high: float = 0.0
    step: int = 1
    unit: str = ""
    entries: Mapping[str, int] = field(default_factory=dict)
    access: Literal["RW", "RO", "WO"] = "RW"
    is_locked: bool = False


_IMAGE: Final = "ImageFormatControl"
_ACQUISITION: Final = "AcquisitionControl"
_ANALOG: Final = "AnalogControl"
_USER_SETS: Final = "UserSetControl"
_TRANSPORT: Final = "TransportLayerControl"
_AUTO: Final = {"Off": 0, "Once": 1, "Continuous": 2}


def _fixed(name: str, category: str, value: float) -> Feature:
    return Feature(name, category, Kind.INTEGER, value, 0, 2**31 - 1, access="RO")


def _choice(name: str, category: str, entries: Mapping[str, int], start: str) -> Feature:
    return Feature(name, category, Kind.ENUMERATION, entries[start], entries=entries)


def _command(name: str, category: str) -> Feature:
    return Feature(name, category, Kind.COMMAND, access="WO")


def features_of(sensor: Sensor) -> tuple[Feature, ...]:
    """Return all features of a camera, in the order of their registers."""
    width, height = sensor.width_px, sensor.height_px
    return (
        _fixed("SensorWidth", _IMAGE, width),
        _fixed("SensorHeight", _IMAGE, height),
        _fixed("WidthMax", _IMAGE, width),
        _fixed("HeightMax", _IMAGE, height),
        Feature(
            *("Width", _IMAGE, Kind.INTEGER, width, SIDE_MIN_PX, width, WIDTH_STEP_PX),
            is_locked=True,
        ),
        Feature(*("Height", _IMAGE, Kind.INTEGER, height, SIDE_MIN_PX, height, 2), is_locked=True),
        Feature("OffsetX", _IMAGE, Kind.INTEGER, 0, 0, width - SIDE_MIN_PX, WIDTH_STEP_PX),
        Feature("OffsetY", _IMAGE, Kind.INTEGER, 0, 0, height - SIDE_MIN_PX, 2),
        Feature(
            *("PixelFormat", _IMAGE, Kind.ENUMERATION, PixelFormat.Mono8),
            entries={one.name: int(one) for one in PixelFormat},
            is_locked=True,
        ),
        _choice(
            "AcquisitionMode",
            _ACQUISITION,
            {"Continuous": 0, "SingleFrame": 1, "MultiFrame": 2},
            "Continuous",
        ),
        Feature("AcquisitionFrameCount", _ACQUISITION, Kind.INTEGER, 1, 1, 65535),
        _command("AcquisitionStart", _ACQUISITION),
        _command("AcquisitionStop", _ACQUISITION),
        _command("AcquisitionAbort", _ACQUISITION),
        Feature("AcquisitionFrameRateEnable", _ACQUISITION, Kind.BOOLEAN, 1, 0, 1),
        Feature(
            *("AcquisitionFrameRate", _ACQUISITION, Kind.FLOAT, sensor.rate_hz, 0.1, 60.0),
            unit="Hz",
        ),
        _choice("TriggerSelector", _ACQUISITION, {"FrameStart": 0}, "FrameStart"),
        _choice("TriggerMode", _ACQUISITION, {"Off": 0, "On": 1}, "Off"),
        _choice("TriggerSource", _ACQUISITION, {"Line1": 0, "Software": 1}, "Line1"),
        _choice(
            "TriggerActivation", _ACQUISITION, {"RisingEdge": 0, "FallingEdge": 1}, "RisingEdge"
        ),
        _command("TriggerSoftware", _ACQUISITION),
        _choice("ExposureMode", _ACQUISITION, {"Timed": 0}, "Timed"),
        _choice("ExposureAuto", _ACQUISITION, _AUTO, "Continuous"),
        Feature(
            *("ExposureTime", _ACQUISITION, Kind.FLOAT, 10_000.0, MIN_EXPOSURE_US),
            high=MAX_EXPOSURE_US,
            unit="us",
        ),
        _choice("GainAuto", _ANALOG, _AUTO, "Continuous"),
        _choice("GainSelector", _ANALOG, {"All": 0}, "All"),
        Feature("Gain", _ANALOG, Kind.FLOAT, 0.0, 0.0, MAX_GAIN_DB, unit="dB"),
        _choice("BlackLevelSelector", _ANALOG, {"All": 0}, "All"),
        Feature("BlackLevel", _ANALOG, Kind.FLOAT, PEDESTAL_GREY, 0.0, 32.0),
        Feature("Gamma", _ANALOG, Kind.FLOAT, 0.8, 0.25, 4.0),
        _choice("UserSetSelector", _USER_SETS, {"Default": 0}, "Default"),
        _command("UserSetLoad", _USER_SETS),
        Feature(
            *("PayloadSize", _TRANSPORT, Kind.INTEGER, width * height, 0, 2**31 - 1),
            access="RO",
            unit="B",
        ),
        Feature("TLParamsLocked", _TRANSPORT, Kind.INTEGER, 0, 0, 1),
    )


def address_of(index: int) -> int:
    """Return the register's address of a feature by its place in the table."""
    return FEATURES_ADDRESS + _WORD_BYTES * index
