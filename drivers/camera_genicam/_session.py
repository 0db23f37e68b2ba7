"""One open camera: found, controlled, set, triggered. Blocking; called on one thread.

A frame is one that this driver triggered: the queue is empty when the trigger goes out, frames of
earlier triggers are passed over by their count, and the frame that comes back has the next number.
"""

import ipaddress
import logging
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from drivers.clock import CellClock
from drivers.errors import BadReplyError, LinkError, UnpluggedError, WrongDeviceError
from messages import key, say

from ._aravis import (
    GONE,
    PAYLOAD_IMAGES,
    STATUS_SUCCESS,
    STATUS_WORDS,
    AravisError,
    Handle,
    Listed,
    Received,
    Stream,
)
from ._features import Features
from ._formats import Image, PixelFormat, decode
from ._types import CameraConfig, CameraIdentity, CameraStats, Setting

log = logging.getLogger(__name__)

# GigE Vision 2.x, bootstrap registers
HEARTBEAT_TIMEOUT_REGISTER: Final = 0x0938  # [ms]
PRIMARY_PORT_REGISTER: Final = 0x0A04  # of the program that has control
PRIMARY_ADDRESS_REGISTER: Final = 0x0A14
GVCP_PORT: Final = 3956
DEFAULT_HEARTBEAT_S: Final = 3.0  # GigE Vision 2.x, of a camera that does not state its own

BUFFER_COUNT: Final = 4
# one look at the queue [wall s]: a wait that is cancelled ends as soon
SLICE_WALL_S: Final = 0.02
# aravis gives an incomplete frame up so long after its last packet (arvgvstream.c) [wall s]
RETENTION_WALL_S: Final = 0.2
# aravis repeats a command that nobody acknowledges for so long (arvgvdeviceprivate.h) [wall s]
REPEATED_WALL_S: Final = 0.5
LAST_SHORT_ID: Final = 0xFFFF  # block ids of GigE Vision 1.x have 16 bits, and 0 is none of them


class HeldError(Exception):
    """Another program controls the camera.

    Attributes
    ----------
    holder : its address and port, empty if the camera does not say
    is_ours : it runs on this computer, or nobody knows where
    heartbeat_s : a program that ended without a word loses control after this [s]
    """

    def __init__(self, holder: str, is_ours: bool, heartbeat_s: float) -> None:
        super().__init__(holder)
        self.holder, self.is_ours, self.heartbeat_s = holder, is_ours, heartbeat_s


class Library(Protocol):
    """What of `Aravis` a session needs."""

    @property
    def version(self) -> str: ...

    def search(self) -> tuple[Listed, ...]:
        """Return the cameras that answer a search."""
        ...

    def open(self, name: str) -> Handle:
        """Return an open camera."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """A picture that was triggered.

    Attributes
    ----------
    image : (height, width), read-only
    white : the largest value of a pixel
    frame_id, stamp_ns : the camera's number and time stamp [ns]
    """

    image: Image
    white: int
    frame_id: int
    stamp_ns: int


class Session:
    """A camera from its opening to its end.

    Parameters
    ----------
    config : address and settings
    clock : the cell's clock
    library : the library
    stats : tallies, which outlive it
    """

    def __init__(
        self, config: CameraConfig, clock: CellClock, library: Library, stats: CameraStats
    ) -> None:
        self._config, self._clock, self._library = config, clock, library
        self._stats = stats
        self._name = say("camera {address}", address=config.address)
        self._ip = config.address if _is_ip(config.address) else ""
        self._camera: Handle | None = None
        self._stream: Stream | None = None
        self._format: PixelFormat | None = None
        self._white = 0
        self._last_id: int | None = None  # None: the next frame may have any number
        self._outstanding = 0  # triggers whose frame has not been seen
        self._lost = ""  # why the camera is gone
        self._noted: dict[str, int] = {}
        self.settings: tuple[Setting, ...] = ()

    # --- opening --------------------------------------------------------------------------------

    def find(self) -> None:
        """Find the camera and open it, without control as yet.

        Raises
        ------
        LinkError : it does not answer
        WrongDeviceError : another model or serial number than the configuration has
        """
        config = self._config
        name = self._ip or self._search()
        try:
            self._camera = self._library.open(name)
        except AravisError as error:
            raise LinkError(
                say(
                    "{name}: does not answer ({error}); check its cable and power, and "
                    "that this computer has an address in its network",
                    name=self._name,
                    error=error,
                )
            ) from error
        model, serial = self._text_of("DeviceModelName"), self._serial()
        if config.model and config.model != model:
            raise WrongDeviceError(
                say(
                    "{name}: its model is `{model}`, `{expected}` is expected; "
                    "correct the cell file",
                    name=self._name,
                    model=model,
                    expected=config.model,
                )
            )
        if config.serial and config.serial != serial:
            raise WrongDeviceError(
                say(
                    "{name}: its serial number is `{serial}`, `{expected}` is expected; "
                    "correct the cell file",
                    name=self._name,
                    serial=serial,
                    expected=config.serial,
                )
            )

    def _search(self) -> str:
        address = self._config.address
        found = self._library.search()
        fitting = [
            one for one in found if address in (one.name, one.serial, f"{one.vendor}-{one.serial}")
        ]
        if len(fitting) == 1:
            self._ip = fitting[0].address
            return fitting[0].name
        names = ", ".join(f"{one.name} at {one.address}" for one in (fitting or found))
        if fitting:
            raise WrongDeviceError(
                say(
                    "{name}: {fitting_count} cameras have this serial number: {names}; "
                    "give the whole name",
                    name=self._name,
                    fitting_count=len(fitting),
                    names=names,
                )
            )
        if names:
            raise LinkError(
                say(
                    "{name}: no such camera answers; those that do: {names}",
                    name=self._name,
                    names=names,
                )
            )
        raise LinkError(
            say("{name}: no camera answers a search; check cables and power", name=self._name)
        )

    def take_control(self) -> None:
        """Take control of the camera.

        Raises
        ------
        HeldError : another program has it
        """
        camera = self._opened()
        if camera.is_controller() or camera.take_control():
            return
        holder, is_ours = "", True
        address = self._register(PRIMARY_ADDRESS_REGISTER)
        if address:
            host = str(ipaddress.IPv4Address(address))
            holder = f"{host}, port {self._register(PRIMARY_PORT_REGISTER)}"
            is_ours = host == _own_address(self._ip)
        heartbeat_s = self._register(HEARTBEAT_TIMEOUT_REGISTER) / 1e3 or DEFAULT_HEARTBEAT_S
        raise HeldError(holder, is_ours, heartbeat_s)

    def start(self) -> CameraIdentity:
        """Set everything, start the acquisition; return what the camera is.

        Raises
        ------
        RefusedError, WrongDeviceError : a setting cannot be had
        UnpluggedError : it left meanwhile
        """
        camera = self._opened()
        with self._watched():
            camera.execute("AcquisitionStop")  # whoever had it before may have left it running
            features = Features(camera, self._name)
            pixel_format, exposure_s = features.apply(self._config)
            self.settings = tuple(features.settings)
            for setting in self.settings:
                if setting.was:
                    log.info(
                        "%s: %s set to %s, was %s",
                        self._name,
                        setting.feature,
                        setting.value,
                        setting.was,
                    )
            self._format, self._white = pixel_format, self._white_of(pixel_format)
            self._stream = camera.stream(BUFFER_COUNT)
            camera.execute("AcquisitionStart")
            return CameraIdentity(
                self._text_of("DeviceVendorName"),
                self._text_of("DeviceModelName"),
                self._serial(),
                self._text_of("DeviceFirmwareVersion") or self._text_of("DeviceVersion"),
                pixel_format.name,
                self._white,
                self._config.width,
                self._config.height,
                exposure_s,
                camera.packet_size() if camera.is_gige else 0,
                self._library.version,
            )

    def _white_of(self, pixel_format: PixelFormat) -> int:
        """Return the largest value of a pixel: of a 12 bit sensor in Mono16 it may be 4095."""
        camera = self._opened()
        if pixel_format.bits < 16 or not camera.has("PixelDynamicRangeMax"):
            return pixel_format.white
        largest = round(camera.number("PixelDynamicRangeMax"))
        return largest if 0 < largest < pixel_format.white else pixel_format.white

    # --- frames ---------------------------------------------------------------------------------

    def take(self, is_over: Callable[[], bool]) -> Taken | None:
        """Trigger a frame and return it; None once ``is_over``.

        An incomplete frame is dropped and counted, and another one is triggered; likewise where
        none comes at all, since a camera ignores a trigger while it is not ready. Whichever trigger
        a frame is of, it was sent after this call began.

        Raises
        ------
        UnpluggedError : the camera does not answer any more, or not to this program
        BadReplyError : frames come that were not triggered, or with another format
        """
        with self._watched():
            to_pass_over = self._empty(is_over)
            if is_over():
                return None
            was_out_of_step = False
            late_s = self._trigger()
            while not is_over():
                last_id = self._last_id
                got = self._next(SLICE_WALL_S)
                if got is None:
                    if self._clock.now_s() > late_s:
                        late_s = self._trigger()
                    continue
                if to_pass_over:
                    to_pass_over -= 1
                    self._stats.stale_count += 1
                elif got.status == STATUS_SUCCESS:
                    if _is_next(got.frame_id, last_id):
                        return self._taken(got)
                    self._stats.out_of_step_count += 1
                    if was_out_of_step:
                        raise BadReplyError(
                            say(
                                "{name}: frames come that were not triggered: after number "
                                "{last_id} comes {frame_id}; is another trigger on?",
                                name=self._name,
                                last_id=last_id,
                                frame_id=got.frame_id,
                            )
                        )
                    was_out_of_step = True
                late_s = self._trigger()
            return None

    def _trigger(self) -> float:
        """Trigger a frame; return the instant by which it is here, whole or not [cell s]."""
        begun_wall_s = time.monotonic()
        self._opened().execute("TriggerSoftware")
        self._stats.trigger_count += 1
        # sent a second time, it may have been obeyed twice
        was_repeated = time.monotonic() - begun_wall_s > REPEATED_WALL_S
        self._outstanding += 2 if was_repeated else 1
        return self._late_s()

    def _late_s(self) -> float:
        return self._clock.now_s() + self._config.frame_s + RETENTION_WALL_S * self._clock.speed

    def _empty(self, is_over: Callable[[], bool]) -> int:
        """Empty the queue; return how many earlier triggers may still bring a frame.

        A camera sends frames in the order of their triggers, so it is as many frames that are to
        be passed over, whether those of the earlier triggers come or not.
        """
        while self._next() is not None:
            self._stats.stale_count += 1
        late_s = self._late_s()
        while self._outstanding and self._clock.now_s() < late_s and not is_over():
            if self._next(SLICE_WALL_S) is not None:
                self._stats.stale_count += 1
        if is_over():
            return 0
        unanswered, self._outstanding = self._outstanding, 0
        self._stats.unanswered_count += unanswered
        return unanswered

    def _next(self, timeout_wall_s: float = 0.0) -> Received | None:
        """Return the next buffer, for which one trigger less is outstanding."""
        assert self._stream is not None, "a started session has a stream"
        got = self._stream.pop(timeout_wall_s)
        if got is None:
            if not self._opened().is_controller():
                self._lost = key("another program has taken control, or the camera restarted")
                raise UnpluggedError(say("{name}: {lost}", name=self._name, lost=self._lost))
            return None
        # packets that come twice may make an incomplete frame of one that was whole already
        if got.status == STATUS_SUCCESS or got.frame_id != self._last_id:
            self._outstanding = max(0, self._outstanding - 1)
            # of a frame that is not whole, even the number may be missing
            self._last_id = got.frame_id or (0 if got.status == STATUS_SUCCESS else None)
        if got.status != STATUS_SUCCESS:
            self._stats.incomplete_count += 1
            log.info(
                "%s: frame %d dropped: %s",
                self._name,
                got.frame_id,
                STATUS_WORDS.get(got.status, f"status {got.status}"),
            )
        self._note_packets()
        return got

    def _taken(self, got: Received) -> Taken:
        config, wanted = self._config, self._format
        assert wanted is not None, "a started session has a pixel format"
        found = (got.payload in PAYLOAD_IMAGES, got.width, got.height, got.pixel_format)
        if found != (True, config.width, config.height, wanted.number):
            raise BadReplyError(
                say(
                    "{name}: a frame of {width} x {height} px with pixel format "
                    "0x{pixel_format:08X}, {expected_width} x {expected_height} px "
                    "with 0x{expected_format:08X} expected; has another program set it?",
                    name=self._name,
                    width=got.width,
                    height=got.height,
                    pixel_format=got.pixel_format,
                    expected_width=config.width,
                    expected_height=config.height,
                    expected_format=wanted.number,
                )
            )
        image = decode(got.data, got.height, got.width, got.padding, wanted.item_bytes)
        if self._white < wanted.white and int(image.max()) > self._white:
            raise BadReplyError(
                say(
                    "{name}: a pixel of {max}, its PixelDynamicRangeMax is {white}",
                    name=self._name,
                    max=int(image.max()),
                    white=self._white,
                )
            )
        return Taken(image, self._white, got.frame_id, got.stamp_ns)

    def _note_packets(self) -> None:
        """Add what the stream has counted since it was asked last."""
        assert self._stream is not None, "a started session has a stream"
        found = self._stream.statistics()
        for name, counted in (
            ("n_missing_packets", "missing_packet_count"),
            ("n_resend_requests", "resend_request_count"),
            ("n_resent_packets", "resent_packet_count"),
        ):
            more = found.get(name, 0) - self._noted.get(name, 0)
            setattr(self._stats, counted, getattr(self._stats, counted) + more)
        self._noted = found

    # --- ending ---------------------------------------------------------------------------------

    def close(self) -> None:
        """Stop the acquisition and release the camera; of one that is gone, in the background.

        To say good-bye to a camera that does not answer takes the library several seconds.
        """
        camera, stream = self._camera, self._stream
        self._camera = self._stream = None
        if camera is None:
            return
        if stream is not None and not self._lost:
            try:
                camera.execute("AcquisitionStop")
            except AravisError as error:
                self._lost = str(error)

        def release() -> None:
            if stream is not None:
                stream.close()
            camera.close()

        if self._lost:
            threading.Thread(target=release, name=f"{self._name} released", daemon=True).start()
        else:
            release()

    # --- inside ---------------------------------------------------------------------------------

    def _opened(self) -> Handle:
        if self._lost:
            raise UnpluggedError(say("{name}: {lost}", name=self._name, lost=self._lost))
        if self._camera is None:
            raise LinkError(say("{name}: not connected", name=self._name))
        return self._camera

    def _watched(self) -> "_Watch":
        return _Watch(self)

    def note_lost(self, error: AravisError) -> UnpluggedError:
        """Note that the camera is gone; return the error to raise."""
        self._lost = say(
            "does not answer any more ({error}); check its cable and power", error=error
        )
        return UnpluggedError(say("{name}: {lost}", name=self._name, lost=self._lost))

    @property
    def name(self) -> str:
        """Name of the camera in messages."""
        return self._name

    def _text_of(self, feature: str) -> str:
        camera = self._opened()
        try:
            return camera.text(feature).strip() if camera.has(feature) else ""
        except AravisError as error:
            if error.is_gone:
                raise self.note_lost(error) from error
            return ""

    def _serial(self) -> str:
        return self._text_of("DeviceSerialNumber") or self._text_of("DeviceID")

    def _register(self, address: int) -> int:
        try:
            return self._opened().register(address)
        except AravisError:
            return 0  # it is optional, or nobody answers


class _Watch:
    """A block in which the library's errors become those of all drivers."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if not isinstance(error, AravisError):
            return
        if error.fault in GONE:
            raise self._session.note_lost(error) from error
        raise BadReplyError(say("{name}: {error}", name=self._session.name, error=error)) from error


def _is_next(frame_id: int, last_id: int | None) -> bool:
    """Return whether a frame's number follows the last one; after None any does."""
    if last_id is None or frame_id == last_id + 1:
        return True
    return last_id == LAST_SHORT_ID and frame_id == 1


def _is_ip(address: str) -> bool:
    try:
        ipaddress.IPv4Address(address)
    except ValueError:
        return False
    return True


def _own_address(address: str) -> str:
    """Return the address from which this computer talks to a camera's; empty if it has none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, GVCP_PORT))  # of a datagram socket: nothing is sent
        except OSError:
            return ""
        return str(probe.getsockname()[0])
