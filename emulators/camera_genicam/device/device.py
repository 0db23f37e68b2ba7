"""A GigE Vision camera as a plain object: datagrams in, datagrams out.

Written after the public register layouts and what aravis and its fake camera say on the wire
(docs/protocols/gige_vision.md). Knows no socket; world time and wall time are handed in.
"""

import ipaddress
import random
from collections import deque
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Final

from ..features import DESCRIPTION_ADDRESS, Kind, PixelFormat, Sensor, describe, features_of
from ..protocol import bootstrap as boot
from ..protocol import gvcp, gvsp
from ..protocol.gvcp import Command, Refused, Request, Status
from .control import ControlChannel, Peer
from .faults import Faults
from .registers import WORD_BYTES, Registers
from .sensor import TICKS_PER_S, Acquisition, Clock, Frame, Picture, PictureSource

# The largest that a Gigabit Ethernet with jumbo frames passes, and the least that IP demands.
PACKET_BYTES_RANGE: Final = (576, 9000)
PACKET_BYTES_AT_POWER_UP: Final = 1500
LINK_MBIT_PER_S: Final = 1000
_HEARTBEAT_MS: Final = 3000
_MIN_HEARTBEAT_MS: Final = 500
_KEPT_FRAMES: Final = 4  # whose packets can be requested again
_OTHER_PORT: Final = 50000  # of the host that the fault `held_by` names
_LOCKED_BY_AUTO: Final = {"ExposureTime": "ExposureAuto", "Gain": "GainAuto"}
_PAYLOAD_OF: Final = ("Width", "Height", "PixelFormat")


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraConfig:
    """A camera.

    Attributes
    ----------
    sensor : its size and rate
    model, user_name : how it identifies itself, besides a serial number made of its address
    """

    sensor: Sensor
    model: str = "EG-1"
    user_name: str = ""


@dataclass(frozen=True, slots=True)
class _Kept:
    """A frame that was sent: how many packets it has, and those that can be sent again."""

    block: int
    count: int
    packets: list[bytes]


class GenicamDevice:
    """One emulated camera; every method is called from one thread.

    Parameters
    ----------
    source : source of pictures
    clock : the world's time
    config : the camera
    seed : decides which packets are lost by chance
    """

    def __init__(
        self, source: PictureSource, clock: Clock, config: CameraConfig, seed: int = 0
    ) -> None:
        self.config = config
        self._source, self._clock = source, clock
        self._faults = Faults()
        self._rng = random.Random(seed)  # nosec B311: losses of a test, no secret
        self._host = 0  # the address as a number; none yet
        self._stream_port = 0
        self.is_plugged = True
        self.rouse: Callable[[], None] = lambda: None  # whoever sleeps until something is due
        self._power_up()

    def _power_up(self) -> None:
        config = self.config
        features = features_of(config.sensor)
        description = describe(features, PACKET_BYTES_RANGE, config.model)
        url = f"Local:emulated.xml;{DESCRIPTION_ADDRESS:X};{len(description):X}"
        words = {
            boot.VERSION: boot.VERSION_1_2,
            boot.DEVICE_MODE: boot.MODE_BIG_ENDIAN_UTF8,
            boot.MAC_HIGH: 0x0200,  # locally administered, the rest is the address
            boot.MAC_LOW: self._host,
            boot.IP_SUPPORTED: boot.IP_PERSISTENT,
            boot.IP_CURRENT: boot.IP_PERSISTENT,
            boot.IP_ADDRESS: self._host,
            boot.SUBNET_MASK: 0xFF00_0000,
            boot.GATEWAY: 0,
            boot.INTERFACE_COUNT: 1,
            boot.LINK_SPEED: LINK_MBIT_PER_S,
            boot.MESSAGE_CHANNEL_COUNT: 0,
            boot.STREAM_CHANNEL_COUNT: 1,
            boot.CAPABILITY: boot.CAN_CONCATENATE
            | boot.CAN_WRITE_MEMORY
            | boot.CAN_RESEND
            | boot.CAN_TELL_APPLICATION
            | boot.CAN_TELL_LINK_SPEED
            | boot.HAS_SERIAL_NUMBER
            | boot.HAS_USER_NAME,
            boot.HEARTBEAT_TIMEOUT: _HEARTBEAT_MS,
            boot.TICK_FREQUENCY_HIGH: TICKS_PER_S >> 32,
            boot.TICK_FREQUENCY_LOW: TICKS_PER_S & 0xFFFF_FFFF,
            boot.TIMESTAMP_CONTROL: 0,
            boot.TIMESTAMP_HIGH: 0,
            boot.TIMESTAMP_LOW: 0,
            boot.PRIVILEGE: 0,
            boot.APPLICATION_PORT: 0,
            boot.APPLICATION_ADDRESS: 0,
            boot.STREAM_PORT: 0,
            boot.STREAM_PACKET_SIZE: PACKET_BYTES_AT_POWER_UP,
            boot.STREAM_PACKET_DELAY: 0,
            boot.STREAM_ADDRESS: 0,
            boot.STREAM_SOURCE_PORT: self._stream_port,
        }
        texts = {
            boot.MANUFACTURER_NAME: "Emulated",
            boot.MODEL_NAME: config.model,
            boot.DEVICE_VERSION: "1",
            boot.MANUFACTURER_INFO: "GigE Vision camera of an emulated cell",
            # no two cameras have one number, those of other emulators on the machine included
            boot.SERIAL_NUMBER: f"E{self._host & 0xFF_FFFF:06}",
            boot.USER_NAME: config.user_name,
            boot.FIRST_URL: url,
        }
        self._registers = Registers(features, words, texts, description)
        self._control = ControlChannel()
        self._acquisition = Acquisition(
            config.sensor,
            self._source,
            self._registers,
            lambda: self._faults,
            self._set_faults,
        )
        self._acquisition.powered_s = self._clock.now_s()
        self._kept: deque[_Kept] = deque(maxlen=_KEPT_FRAMES)
        self._test_packets: list[bytes] = []

    def _set_faults(self, faults: Faults) -> None:
        self._faults = faults

    # --- the emulator's side ----------------------------------------------------------------------

    @property
    def faults(self) -> Faults:
        """The faults in force; assign to change them."""
        return self._faults

    @faults.setter
    def faults(self, faults: Faults) -> None:
        if faults.held_by:
            other = Peer(str(ipaddress.IPv4Address(faults.held_by)), _OTHER_PORT)
            self._control = ControlChannel(other, boot.PRIVILEGE_CONTROL)
            self._close_stream()
            self._note_application()
        elif self._faults.held_by:
            self._control.drop()
            self._note_application()
        self._faults = faults
        self.rouse()

    @property
    def lost_count(self) -> int:
        """Exposures since the acquisition began that brought no frame."""
        return self._acquisition.lost_count

    @property
    def oldest_due_s(self) -> float | None:
        """The end of the oldest exposure whose frame has not left the camera; None without one."""
        return self._acquisition.oldest_due_s

    def connect(self, address: str, stream_port: int) -> None:
        """Give the camera its address, and the port that its pictures come from."""
        self._host, self._stream_port = int(ipaddress.IPv4Address(address)), stream_port
        self._power_up()

    def unplug(self) -> None:
        """Pull the cable, which is its supply too: no answer, no picture."""
        self.is_plugged = False
        self._acquisition.abort()
        self.rouse()

    def plug(self) -> None:
        """Put the cable back: the camera has the settings of power-up."""
        if not self.is_plugged:
            self.is_plugged = True
            self._power_up()

    def deliver(self, ticket: Hashable, picture: Picture) -> None:
        """Bring the picture of a ticket, (height, width) of the whole sensor.

        Raises
        ------
        ValueError : the picture has another shape or depth
        """
        sensor = self.config.sensor
        if picture.shape != (sensor.height_px, sensor.width_px):
            raise ValueError(f"a picture of {picture.shape} on {sensor}")
        if picture.dtype.name not in ("uint8", "uint16"):
            raise ValueError(f"a picture is uint8 or uint16, not {picture.dtype}")
        self._acquisition.deliver(ticket, picture)
        self.rouse()

    def advance(self, now_s: float, wall_s: float) -> tuple[float | None, float | None]:
        """Do what is due; return when to call again, in world and in wall time, None for never.

        Parameters
        ----------
        now_s : the world's instant [world s]
        wall_s : CLOCK_MONOTONIC [wall s]
        """
        if not self.is_plugged:
            return None, None
        ends_wall_s = None
        if not self._faults.held_by:
            ends_wall_s = self._control.ends_wall_s(self._heartbeat_s)
        if ends_wall_s is not None and wall_s >= ends_wall_s:
            self._control.drop()
            self._note_application()
            ends_wall_s = None
        return self._acquisition.advance(now_s), ends_wall_s

    # --- pictures ---------------------------------------------------------------------------------

    @property
    def destination(self) -> tuple[str, int] | None:
        """Where pictures go; None while the stream is closed."""
        port = self._registers.word(boot.STREAM_PORT) & 0xFFFF
        if not port or not self.is_plugged:
            return None
        host = self._registers.word(boot.STREAM_ADDRESS)
        return str(ipaddress.IPv4Address(host)), port

    @property
    def packet_delay_s(self) -> float:
        """The pause between two packets that the client asked for [wall s]."""
        return self._registers.word(boot.STREAM_PACKET_DELAY) / TICKS_PER_S

    def take(self, now_s: float) -> Frame | None:
        """Return the next frame to send; `packets_of` makes its packets, `sent` ends it."""
        return self._acquisition.take(now_s) if self.is_plugged else None

    def packets_of(self, frame: Frame) -> list[bytes]:
        """Return the packets of a frame, without those that its faults keep back."""
        size = self._registers.word(boot.STREAM_PACKET_SIZE) & boot.PACKET_SIZE_MASK
        packets = gvsp.packets_of(frame.block, frame.image, frame.pixels, size)
        faults, count = self._faults, len(packets)
        if faults.short_count > 0:
            self._faults = replace(faults, short_count=faults.short_count - 1)
            packets = packets[: count // 2]
        self._kept.append(_Kept(frame.block, count, packets))
        odd = range(1, len(packets) - 1, 2)
        lost = set(list(odd)[: self._faults.lost_packet_count])
        if lost:
            left = self._faults.lost_packet_count - len(lost)
            self._faults = replace(self._faults, lost_packet_count=left)
        return [one for number, one in enumerate(packets) if number not in lost]

    def passes(self, packet: bytes) -> bool:
        """Return whether a stream packet arrives, by the faults of the cable."""
        faults = self._faults
        if 0 < faults.mtu_bytes < len(packet) + gvsp.IP_UDP_BYTES:
            return False
        return self._rng.random() * 1000.0 >= faults.lost_per_thousand

    def sent(self, frame: Frame) -> None:
        """Note that a frame's last packet has left."""
        self._acquisition.sent(frame)

    def take_test_packets(self) -> list[bytes]:
        """Return the test packets to send."""
        packets, self._test_packets = self._test_packets, []
        return packets

    # --- requests ---------------------------------------------------------------------------------

    def discovered(self, request: Request) -> bytes | None:
        """Return the acknowledge of a discovery; None while the camera cannot be seen."""
        if not self.is_plugged or self._faults.is_mute:
            return None
        return gvcp.acknowledge(request, self._registers.read(0, boot.DISCOVERY_BYTES))

    def answer(
        self, datagram: bytes, peer: Peer, wall_s: float
    ) -> tuple[bytes | None, list[bytes]]:
        """Return the acknowledge of a datagram, if it gets one, and stream packets to send again.

        Parameters
        ----------
        datagram : as it came
        peer : its sender
        wall_s : CLOCK_MONOTONIC [wall s]
        """
        request = gvcp.read_request(datagram)
        if request is None or not self.is_plugged or self._faults.is_mute:
            return None, []
        if request.command == Command.DISCOVERY:
            return self.discovered(request), []
        try:
            if request.command == Command.PACKETRESEND:
                return None, self._resend(request.body, peer)
            body = self._carry_out(request, peer, wall_s)
        except Refused as refusal:
            reply = gvcp.acknowledge(
                request, self._body_of_refusal(request, refusal), refusal.status
            )
            return (reply if request.wants_answer else None), []
        self._control.hear(peer, wall_s)
        self.rouse()
        return (gvcp.acknowledge(request, body) if request.wants_answer else None), []

    def _body_of_refusal(self, request: Request, refusal: Refused) -> bytes:
        is_write = request.command in (Command.WRITEREG, Command.WRITEMEM)
        return gvcp.written(refusal.done_count) if is_write else b""

    def _carry_out(self, request: Request, peer: Peer, wall_s: float) -> bytes:
        is_write = request.command in (Command.WRITEREG, Command.WRITEMEM)
        if not is_write and not self._control.may_read(peer):
            raise Refused(Status.ACCESS_DENIED)
        match request.command:
            case Command.READREG:
                addresses = gvcp.addresses_of(request.body)
                return b"".join(self._registers.read(at, WORD_BYTES) for at in addresses)
            case Command.READMEM:
                address, count = gvcp.range_of(request.body)
                return gvcp.memory(address, self._registers.read(address, count))
            case Command.WRITEREG:
                writes = gvcp.writes_of(request.body)
                for done, (address, word) in enumerate(writes):
                    self._write(address, word, peer, wall_s, done)
                return gvcp.written(len(writes))
            case Command.WRITEMEM:
                address, data = gvcp.memory_of(request.body)
                self._write_memory(address, data, peer, wall_s)
                return gvcp.written(len(data))
            case _:
                raise Refused(Status.NOT_IMPLEMENTED)

    def _write_memory(self, address: int, data: bytes, peer: Peer, wall_s: float) -> None:
        if address % WORD_BYTES or len(data) % WORD_BYTES:
            raise Refused(Status.BAD_ALIGNMENT)
        if address < boot.STREAM_PORT and address != boot.PRIVILEGE:
            self._require_control(peer)
            if self._registers.write_text(address, data):
                return
        for at in range(0, len(data), WORD_BYTES):
            word = int.from_bytes(data[at : at + WORD_BYTES], "big")
            self._write(address + at, word, peer, wall_s, at)

    def _require_control(self, peer: Peer) -> None:
        if not self._control.may_write(peer):
            raise Refused(Status.ACCESS_DENIED)

    def _write(self, address: int, word: int, peer: Peer, wall_s: float, done: int) -> None:
        """Carry out one write.

        Raises
        ------
        Refused : it cannot be done; with the writes done before it
        """
        try:
            if address == boot.PRIVILEGE:
                self._control.take(peer, word, wall_s)
                self._note_application()
                return
            self._require_control(peer)
            feature = self._registers.feature_at(address)
            if feature is None:
                self._write_bootstrap(address, word)
                return
            self._registers.check(feature, word, lambda: self._acquisition.is_running)
            if feature.kind is Kind.COMMAND:
                self._command(feature.name)
                return
            auto = _LOCKED_BY_AUTO.get(feature.name)
            if auto is not None and self._registers.number(auto):
                raise Refused(Status.WRITE_PROTECT)
            before = self._registers.word(address)
            self._registers.put_word(address, word)
            if not self._is_region_on_sensor():
                self._registers.put_word(address, before)
                raise Refused(Status.INVALID_PARAMETER)
            if feature.name in _PAYLOAD_OF:
                self._note_payload()
        except Refused as refusal:
            raise Refused(refusal.status, done) from refusal

    def _is_region_on_sensor(self) -> bool:
        registers, sensor = self._registers, self.config.sensor
        return (
            registers.number("OffsetX") + registers.number("Width") <= sensor.width_px
            and registers.number("OffsetY") + registers.number("Height") <= sensor.height_px
        )

    def _note_payload(self) -> None:
        registers = self._registers
        size = PixelFormat(registers.number("PixelFormat")).bytes_per_pixel
        pixels = registers.number("Width") * registers.number("Height")
        registers.put("PayloadSize", pixels * size)

    def _note_application(self) -> None:
        """Let the registers tell who controls the camera; without control there is no stream."""
        holder = self._control.holder
        self._registers.put_word(boot.PRIVILEGE, self._control.privilege)
        self._registers.put_word(boot.APPLICATION_PORT, holder.port if holder else 0)
        self._registers.put_word(boot.APPLICATION_ADDRESS, holder.word if holder else 0)
        if holder is None:
            self._close_stream()

    def _close_stream(self) -> None:
        self._acquisition.abort()
        for address in (boot.STREAM_PORT, boot.STREAM_ADDRESS):
            self._registers.put_word(address, 0)

    def _write_bootstrap(self, address: int, word: int) -> None:
        registers = self._registers
        match address:
            case boot.STREAM_PORT:
                if word & 0xFFFF and not registers.word(address) & 0xFFFF:
                    self._acquisition.open_stream()
            case boot.STREAM_PACKET_SIZE:
                low, high = PACKET_BYTES_RANGE
                size = word & boot.PACKET_SIZE_MASK
                if not low <= size <= high or size % WORD_BYTES:
                    raise Refused(Status.INVALID_PARAMETER)
                if word & boot.FIRE_TEST_PACKET:
                    self._test_packets.append(gvsp.fired_for_test(size))
                word &= ~boot.FIRE_TEST_PACKET
            case boot.HEARTBEAT_TIMEOUT:
                word = max(word, _MIN_HEARTBEAT_MS)
            case boot.TIMESTAMP_CONTROL:
                self._control_timestamp(word)
                return
            case boot.STREAM_ADDRESS | boot.STREAM_PACKET_DELAY:
                pass
            case _:
                registers.read(address, WORD_BYTES)  # refuses an address where nothing is
                raise Refused(Status.WRITE_PROTECT)
        registers.put_word(address, word)

    def _control_timestamp(self, bits: int) -> None:
        now_s = self._clock.now_s()
        if bits & boot.TIMESTAMP_RESET:
            self._acquisition.powered_s = now_s
        if bits & boot.TIMESTAMP_LATCH:
            ticks = round((now_s - self._acquisition.powered_s) * TICKS_PER_S)
            self._registers.put_word(boot.TIMESTAMP_HIGH, ticks >> 32)
            self._registers.put_word(boot.TIMESTAMP_LOW, ticks & 0xFFFF_FFFF)

    def _command(self, name: str) -> None:
        acquisition, now_s = self._acquisition, self._clock.now_s()
        match name:
            case "AcquisitionStart":
                acquisition.start(now_s)
            case "AcquisitionStop":
                acquisition.stop()
            case "AcquisitionAbort":
                acquisition.abort()
            case "TriggerSoftware":
                acquisition.trigger(now_s)
            case "UserSetLoad":
                if acquisition.is_running:
                    raise Refused(Status.WRITE_PROTECT)
                self._registers.load_defaults()

    def _resend(self, body: bytes, peer: Peer) -> list[bytes]:
        """Return the packets that a client asks for again; from its stream's own port."""
        holder = self._control.holder
        if holder is None or peer.host != holder.host:
            return []
        block, first, last = gvcp.resend_of(body)
        for kept in self._kept:
            if kept.block == block:
                return [
                    kept.packets[n] if n < len(kept.packets) else gvsp.unavailable(block, n)
                    for n in range(first, min(last + 1, kept.count))
                ]
        return [gvsp.unavailable(block, first)]

    @property
    def _heartbeat_s(self) -> float:
        return self._registers.word(boot.HEARTBEAT_TIMEOUT) / 1000.0
