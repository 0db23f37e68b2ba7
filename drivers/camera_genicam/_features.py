"""Features of a camera that its pictures depend on: set, and read back.

A camera keeps the settings of whoever had it before. What is not there cannot be wrong, so an
absent feature is noted and passed over unless no picture comes without it. Names are those of the
Standard Features Naming Convention (EMVA, SFNC 2.x), with the older ones of GigE Vision 1.x.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, TypeVar

from drivers.errors import RefusedError, WrongDeviceError
from messages import say

from ._aravis import AravisError, Handle
from ._formats import FORMATS, PixelFormat
from ._types import CameraConfig, Setting

_Value = TypeVar("_Value", str, bool, int)

# Largest difference between an exposure or a gain that was set and the one read back, as a share:
# a sensor takes whole lines of 10 to 40 us, which is 2 % of an exposure of 2 ms, the shortest that
# a lamp of a cell lights well.
STEP_SHARE: Final = 0.02
ABSENT: Final = "absent"

EXPOSURES: Final = ("ExposureTime", "ExposureTimeAbs", "ExposureTimeRaw")
GAINS: Final = ("Gain", "GainAbs", "GainRaw")
BLACK_LEVELS: Final = ("BlackLevel", "BlackLevelAbs", "BlackLevelRaw")
# what would change grey levels or geometry from picture to picture, or from user to user
_FIXED_TEXTS: Final = (
    ("ExposureMode", "Timed"),
    ("ExposureAuto", "Off"),
    ("GainAuto", "Off"),
    ("BlackLevelAuto", "Off"),
)
_FIXED_FLAGS: Final = (
    ("ReverseX", False),
    ("ReverseY", False),
    ("GammaEnable", False),
    ("LUTEnable", False),
    ("ChunkModeActive", False),
    ("AcquisitionFrameRateEnable", False),
)
_FIXED_NUMBERS: Final = (
    ("BinningHorizontal", 1),
    ("BinningVertical", 1),
    ("DecimationHorizontal", 1),
    ("DecimationVertical", 1),
)
# the first that a camera has starts one frame
_FRAME_TRIGGERS: Final = ("FrameStart", "FrameBurstStart", "AcquisitionStart")


class Features:
    """Sets what the driver relies on.

    Parameters
    ----------
    camera : the open camera
    name : name of the camera in messages
    """

    def __init__(self, camera: Handle, name: str) -> None:
        self._camera, self._name = camera, name
        self.settings: list[Setting] = []

    def apply(self, config: CameraConfig) -> tuple[PixelFormat, float]:
        """Set everything but the stream; return pixel format and exposure [s] as read back.

        Raises
        ------
        RefusedError : the camera refused a value, or has another one afterwards
        WrongDeviceError : it lacks a feature or a pixel format without which no picture comes
        AravisError : it does not answer
        """
        self._text("AcquisitionMode", "Continuous")
        for feature, number in _FIXED_NUMBERS:
            self._integer(feature, number)
        for feature, flag in _FIXED_FLAGS:
            self._flag(feature, flag)
        pixel_format = self._pixel_format(config.formats)
        self._region(config)
        self._trigger()
        for feature, text in _FIXED_TEXTS:
            self._text(feature, text)
        exposure_s = self._number(EXPOSURES, config.exposure_s * 1e6) * 1e-6
        self._select("GainSelector", "All")
        self._number(GAINS, config.gain, is_needed=False)
        self._number(("Gamma",), 1.0, is_needed=False)
        self._select("BlackLevelSelector", "All")
        black = 0.0 if config.black_level is None else config.black_level
        self._number(BLACK_LEVELS, black, is_needed=False, clips=config.black_level is None)
        if self._camera.is_gige:
            self._camera.set_packet_size(config.packet_size)
            self._note("GevSCPSPacketSize", config.packet_size, self._camera.packet_size(), config)
        return pixel_format, exposure_s

    # --- groups ---------------------------------------------------------------------------------

    def _pixel_format(self, wanted: Sequence[PixelFormat]) -> PixelFormat:
        offered = self._camera.choices("PixelFormat")
        for one in wanted:
            if one.name in offered:
                self._text("PixelFormat", one.name, is_needed=True)
                return one
        ours = {one.name: name for name, one in FORMATS.items()}
        known = [f"{ours[name]} ({name})" for name in offered if name in ours]
        raise WrongDeviceError(
            say(
                "{name}: sends none of the pixel formats {wanted}; it offers "
                "{known}: correct `formats` of the camera in the cell file",
                name=self._name,
                wanted=", ".join(w.name for w in wanted),
                known=", ".join(known) or "no grey one that this driver reads",
            )
        )

    def _region(self, config: CameraConfig) -> None:
        # a large region at an offset would not fit, whichever is set first
        for feature in ("OffsetX", "OffsetY"):
            if self._camera.has(feature):
                self._guarded(feature, 0, partial(self._camera.set_number, feature, 0))
        self._integer("Width", config.width, is_needed=True)
        self._integer("Height", config.height, is_needed=True)
        for feature, offset in zip(("OffsetX", "OffsetY"), config.offset_px, strict=True):
            self._integer(feature, offset, is_needed=offset != 0)

    def _trigger(self) -> None:
        """Have one software trigger start one frame, and nothing else start any."""
        if self._camera.has("TriggerSelector"):
            entries = self._camera.choices("TriggerSelector")
            chosen = next((one for one in _FRAME_TRIGGERS if one in entries), None)
            if chosen is None:
                raise WrongDeviceError(
                    say(
                        "{name}: has triggers {entries}, and none of {frame_triggers}: it "
                        "cannot take one frame when asked to",
                        name=self._name,
                        entries=", ".join(entries) or "of no kind",
                        frame_triggers=", ".join(_FRAME_TRIGGERS),
                    )
                )
            for entry in entries:
                if entry != chosen:
                    self._camera.set_text("TriggerSelector", entry)
                    self._text("TriggerMode", "Off")
            self._text("TriggerSelector", chosen, is_needed=True)
        self._text("TriggerSource", "Software", is_needed=True)
        self._text("TriggerMode", "On", is_needed=True)
        self._number(("TriggerDelay", "TriggerDelayAbs"), 0.0, is_needed=False)
        if not self._camera.has("TriggerSoftware"):
            raise WrongDeviceError(
                say(
                    "{name}: has no software trigger, without which the instant of an "
                    "exposure is not known",
                    name=self._name,
                )
            )

    def _select(self, selector: str, entry: str) -> None:
        if self._camera.has(selector) and entry in self._camera.choices(selector):
            self._text(selector, entry)

    # --- single features ------------------------------------------------------------------------

    def _text(self, feature: str, value: str, *, is_needed: bool = False) -> None:
        self._ensure(feature, value, self._camera.text, self._camera.set_text, is_needed)

    def _flag(self, feature: str, value: bool) -> None:
        self._ensure(feature, value, self._camera.flag, self._camera.set_flag, False)

    def _integer(self, feature: str, value: int, *, is_needed: bool = False) -> None:
        self._ensure(
            feature,
            value,
            lambda name: round(self._camera.number(name)),
            self._camera.set_number,
            is_needed,
        )

    def _ensure(
        self,
        feature: str,
        value: _Value,
        read: Callable[[str], _Value],
        write: Callable[[str, _Value], None],
        is_needed: bool,
    ) -> None:
        """Set a feature unless it has the value already; note what it has then."""
        if not self._is_there(feature, is_needed):
            return
        was = read(feature)
        if was != value:
            self._guarded(feature, value, lambda: write(feature, value))
        now = read(feature)
        if now != value:
            raise RefusedError(
                say(
                    "{name}: {feature} is {now} after {value} was set; correct the "
                    "cell file, or the camera with its maker's program",
                    name=self._name,
                    feature=feature,
                    now=now,
                    value=value,
                ),
                0,
            )
        self.settings.append(Setting(feature, f"{now}", "" if was == value else f"{was}"))

    def _number(
        self,
        names: Sequence[str],
        value: float | None,
        *,
        is_needed: bool = True,
        clips: bool = False,
    ) -> float:
        """Set a number under the first of its names that the camera has; return the one it took.

        Parameters
        ----------
        names : names of the feature, the newest first
        value : value to set; None for the lowest
        is_needed : no picture comes without it
        clips : take the lowest value where the camera has none so low
        """
        feature = next((name for name in names if self._camera.has(name)), names[0])
        if not self._is_there(feature, is_needed):
            return 0.0
        low, high = self._camera.bounds(feature)
        if value is None:
            value = low
        elif clips:
            value = max(value, low)
        if not low <= value <= high:
            raise RefusedError(
                say(
                    "{name}: {feature} {value:g} is outside of its range, {low:g} to "
                    "{high:g}; correct the cell file",
                    name=self._name,
                    feature=feature,
                    value=value,
                    low=low,
                    high=high,
                ),
                0,
            )
        was = self._camera.number(feature)
        if was != value:
            self._guarded(feature, value, lambda: self._camera.set_number(feature, value))
        now = self._camera.number(feature)
        # an integer is rounded, whatever its size
        if abs(now - value) > max(STEP_SHARE * abs(value), 0.5 if now == round(now) else 0.0):
            raise RefusedError(
                say(
                    "{name}: {feature} is {now:g} after {value:g} was set; correct the "
                    "cell file, or the camera with its maker's program",
                    name=self._name,
                    feature=feature,
                    now=now,
                    value=value,
                ),
                0,
            )
        self.settings.append(Setting(feature, f"{now:g}", "" if was == now else f"{was:g}"))
        return now

    def _note(self, feature: str, asked: int, found: int, config: CameraConfig) -> None:
        if found != asked:
            raise RefusedError(
                say(
                    "{name}: {feature} is {found} after {asked} was set; set "
                    "`packet_size` of its settings to one that the camera takes",
                    name=self._name,
                    feature=feature,
                    found=found,
                    asked=asked,
                ),
                0,
            )
        self.settings.append(Setting(feature, f"{found}"))

    def _is_there(self, feature: str, is_needed: bool) -> bool:
        if self._camera.has(feature):
            return True
        if is_needed:
            raise WrongDeviceError(
                say(
                    "{name}: has no {feature}, without which no picture can be taken",
                    name=self._name,
                    feature=feature,
                )
            )
        self.settings.append(Setting(feature, ABSENT))
        return False

    def _guarded(self, feature: str, value: object, write: Callable[[], None]) -> None:
        try:
            write()
        except AravisError as error:
            if error.is_gone:
                raise
            raise RefusedError(
                say(
                    "{name}: refuses {feature} {value} ({error}); correct the cell file",
                    name=self._name,
                    feature=feature,
                    value=value,
                    error=error,
                ),
                error.code,
            ) from error
