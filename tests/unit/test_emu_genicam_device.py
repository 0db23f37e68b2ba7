"""The emulated GigE Vision camera as a plain object: registers, control, exposures, faults.

Time is an input: a clock that the test sets, and wall time handed to each request.
"""

from __future__ import annotations

import struct
from collections.abc import Hashable
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from emulators.camera_genicam import CameraConfig, Faults, GenicamDevice, Peer, PixelFormat, Sensor
from emulators.camera_genicam.features import features_of
from emulators.camera_genicam.features.table import address_of
from emulators.camera_genicam.protocol import bootstrap as boot
from emulators.camera_genicam.protocol.gvcp import Status

SENSOR = Sensor(64, 48, 5.0)
ADDRESSES = {one.name: address_of(k) for k, one in enumerate(features_of(SENSOR))}
CLIENT, OTHER = Peer("127.0.0.1", 40000), Peer("127.0.0.1", 40001)
EXPOSURE_S = 0.010


class HandClock:
    """World time as the test sets it."""

    def __init__(self) -> None:
        self.at_s = 100.0

    def now_s(self) -> float:
        return self.at_s

    def to_monotonic_s(self, world_s: float) -> float:
        return world_s


class Ramp:
    """Orders kept; pictures of columns that grow brighter."""

    def __init__(self) -> None:
        self.orders: list[tuple[float, float, float, float, int]] = []

    def expose(
        self, start_s: float, end_s: float, exposure_s: float, gain: float, bits: int
    ) -> Hashable:
        self.orders.append((start_s, end_s, exposure_s, gain, bits))
        return len(self.orders) - 1

    def picture(self, bits: int) -> Any:
        columns = np.arange(SENSOR.width_px, dtype=np.float64) / (SENSOR.width_px - 1)
        full = 255 if bits == 8 else 65535
        row = np.rint(columns * full).astype(np.uint8 if bits == 8 else np.uint16)
        return np.tile(row, (SENSOR.height_px, 1))


class Bench:
    """A camera, its clock, and a client that speaks GVCP in the test's own words."""

    def __init__(self) -> None:
        self.clock, self.ramp = HandClock(), Ramp()
        config = CameraConfig(sensor=SENSOR, user_name="overhead")
        self.device = GenicamDevice(self.ramp, self.clock, config)
        self.device.connect("127.0.0.9", 50505)
        self.wall_s = 0.0
        self._number = 0

    def ask(self, command: int, body: bytes, peer: Peer = CLIENT) -> tuple[int, bytes]:
        """Return status and body of the acknowledge."""
        self._number += 1
        head = struct.pack(">BBHHH", 0x42, 1, command, len(body), self._number)
        reply, _ = self.device.answer(head + body, peer, self.wall_s)
        assert reply is not None
        status, answer, length, number = struct.unpack_from(">HHHH", reply)
        assert (answer, length, number) == (command + 1, len(reply) - 8, self._number)
        return status, reply[8:]

    def write(self, where: str | int, value: float, peer: Peer = CLIENT) -> int:
        address = ADDRESSES[where] if isinstance(where, str) else where
        word = struct.pack(">f" if isinstance(value, float) else ">I", value)
        return self.ask(0x82, struct.pack(">I", address) + word, peer)[0]

    def read(self, where: str | int, peer: Peer = CLIENT) -> int:
        address = ADDRESSES[where] if isinstance(where, str) else where
        status, body = self.ask(0x80, struct.pack(">I", address), peer)
        assert status == Status.SUCCESS
        return int.from_bytes(body, "big")

    def read_float(self, where: str) -> float:
        return float(struct.unpack(">f", self.read(where).to_bytes(4, "big"))[0])

    def control(self) -> None:
        assert self.write(boot.PRIVILEGE, 2) == Status.SUCCESS

    def ready_for_trigger(self, **settings: float) -> None:
        """Take control, open the stream, switch off what steers by itself, wait for triggers."""
        self.control()
        wanted: dict[str, float] = {
            "ExposureAuto": 0,
            "GainAuto": 0,
            "Gamma": 1.0,
            "TriggerMode": 1,
            "TriggerSource": 1,
        }
        for name, value in (wanted | settings).items():
            assert self.write(name, value) == Status.SUCCESS, name
        assert self.write(boot.STREAM_ADDRESS, CLIENT.word) == Status.SUCCESS
        assert self.write(boot.STREAM_PORT, 41000) == Status.SUCCESS
        assert self.write("AcquisitionStart", 1) == Status.SUCCESS

    def trigger(self) -> int:
        """Trigger; return how many exposures were ordered by it."""
        before = len(self.ramp.orders)
        assert self.write("TriggerSoftware", 1) == Status.SUCCESS
        return len(self.ramp.orders) - before

    def frame(self) -> list[bytes]:
        """Deliver the last picture ordered, let its exposure end, and return its packets."""
        ticket = len(self.ramp.orders) - 1
        self.device.deliver(ticket, self.ramp.picture(self.ramp.orders[ticket][4]))
        self.clock.at_s += EXPOSURE_S
        frame = self.device.take(self.clock.now_s())
        assert frame is not None
        packets = self.device.packets_of(frame)
        self.device.sent(frame)
        return packets

    def again(self, block: int, first: int, last: int) -> list[bytes]:
        """Ask for packets again, from the stream's port."""
        self._number += 1
        body = struct.pack(">HHII", 0, block, first, last)
        head = struct.pack(">BBHHH", 0x42, 0, 0x40, len(body), self._number)
        reply, packets = self.device.answer(head + body, Peer(CLIENT.host, 41000), self.wall_s)
        assert reply is None
        return packets


@pytest.fixture
def bench() -> Bench:
    return Bench()


def pixels_of(packets: list[bytes]) -> bytes:
    return b"".join(packet[8:] for packet in packets[1:-1])


def block_of(packet: bytes) -> int:
    return int.from_bytes(packet[2:4], "big")


# --- registers ------------------------------------------------------------------------------------


def test_every_feature_of_the_description_can_be_read_where_it_says(bench: Bench) -> None:
    status, body = bench.ask(0x84, struct.pack(">IHH", boot.FIRST_URL, 0, 512))
    assert status == Status.SUCCESS
    url = body[4:].split(b"\0")[0].decode()
    place, size = (int(number, 16) for number in url.split(";")[1:])
    text = b""
    while len(text) < size:
        count = min(512, size - len(text))
        text += bench.ask(0x84, struct.pack(">IHH", place + len(text), 0, count))[1][4:]
    root = ElementTree.fromstring(text)
    space = {"g": root.tag.partition("}")[0].strip("{")}
    registers = {
        one.get("Name"): int(one.findtext("g:Address", "", space), 16)
        for kind in ("IntReg", "FloatReg", "MaskedIntReg", "StringReg")
        for one in root.findall(f"g:{kind}", space)
    }
    linked = [one.text for one in root.findall(".//g:pValue", space)]
    assert set(linked) <= set(registers)
    listed = {one.text for one in root.findall("g:Category/g:pFeature", space)}
    named = {one.get("Name") for one in root}
    assert listed <= named
    assert {"ExposureTime", "TriggerSoftware", "PixelFormat", "TimestampLatch"} <= listed
    for name, address in registers.items():
        assert bench.ask(0x84, struct.pack(">IHH", address, 0, 4))[0] == Status.SUCCESS, name


@pytest.mark.parametrize(
    ("where", "value", "status"),
    [
        ("Width", 66, Status.INVALID_PARAMETER),  # no multiple of 4
        ("Width", 68, Status.INVALID_PARAMETER),  # wider than the sensor
        ("OffsetX", 4, Status.INVALID_PARAMETER),  # the region would leave the sensor
        ("PixelFormat", 0x0108_0009, Status.INVALID_PARAMETER),  # a Bayer format
        ("PayloadSize", 1, Status.WRITE_PROTECT),
        ("ExposureTime", 5000.0, Status.WRITE_PROTECT),  # ExposureAuto is on at power-up
        ("Gain", 3.0, Status.WRITE_PROTECT),
        ("Gamma", 9.0, Status.INVALID_PARAMETER),
        (boot.SERIAL_NUMBER, 1, Status.WRITE_PROTECT),
        (boot.STREAM_PACKET_SIZE, 9004, Status.INVALID_PARAMETER),
        (0x0005_0000, 1, Status.INVALID_ADDRESS),
    ],
)
def test_a_wrong_write_is_refused_and_changes_nothing(
    bench: Bench, where: str | int, value: float, status: Status
) -> None:
    bench.control()
    address = ADDRESSES[where] if isinstance(where, str) else where
    before = None if status is Status.INVALID_ADDRESS else bench.read(address)
    assert bench.write(where, value) == status
    assert before is None or bench.read(address) == before


def test_several_registers_are_written_until_the_first_refusal(bench: Bench) -> None:
    bench.control()
    writes = [(ADDRESSES["Height"], 24), (ADDRESSES["PayloadSize"], 1), (ADDRESSES["Width"], 32)]
    body = b"".join(struct.pack(">II", *one) for one in writes)
    status, answer = bench.ask(0x82, body)
    assert (status, struct.unpack(">HH", answer)) == (Status.WRITE_PROTECT, (0, 1))
    assert (bench.read("Height"), bench.read("Width")) == (24, 64)
    assert bench.read("PayloadSize") == 24 * 64


def test_a_datagram_that_is_no_request_is_passed_over(bench: Bench) -> None:
    for datagram in (b"", b"\x42\x01", bytes.fromhex("4101000200000001"), bytes(8)):
        assert bench.device.answer(datagram, CLIENT, 0.0) == (None, [])


def test_the_users_name_can_be_written_and_is_told_in_a_discovery(bench: Bench) -> None:
    bench.control()
    name = b"left".ljust(16, b"\0")
    assert bench.ask(0x86, struct.pack(">I", boot.USER_NAME) + name)[0] == Status.SUCCESS
    status, registers = bench.ask(0x02, b"")
    assert status == Status.SUCCESS
    assert registers[boot.USER_NAME : boot.USER_NAME + 16] == name
    assert registers[boot.IP_ADDRESS : boot.IP_ADDRESS + 4] == bytes((127, 0, 0, 9))


# --- control --------------------------------------------------------------------------------------


def test_without_control_nothing_can_be_written(bench: Bench) -> None:
    assert bench.write("Height", 24) == Status.ACCESS_DENIED
    bench.control()
    assert bench.write("Height", 24, OTHER) == Status.ACCESS_DENIED
    assert bench.write(boot.PRIVILEGE, 2, OTHER) == Status.ACCESS_DENIED
    assert bench.read("Height", OTHER) == 48
    assert bench.read(boot.APPLICATION_PORT, OTHER) == CLIENT.port
    assert bench.read(boot.APPLICATION_ADDRESS, OTHER) == CLIENT.word


def test_exclusive_access_shuts_others_out_of_reading_too(bench: Bench) -> None:
    assert bench.write(boot.PRIVILEGE, 1) == Status.SUCCESS
    assert bench.ask(0x80, struct.pack(">I", ADDRESSES["Width"]), OTHER)[0] == Status.ACCESS_DENIED
    assert bench.read("Width") == 64


def test_a_silent_client_loses_control_and_its_settings_stay(bench: Bench) -> None:
    bench.ready_for_trigger(ExposureTime=2500.0)
    bench.wall_s = 2.9
    assert bench.read(boot.PRIVILEGE) == 2  # a heartbeat
    bench.device.advance(bench.clock.now_s(), 5.8)
    assert bench.read(boot.PRIVILEGE, OTHER) == 2
    bench.device.advance(bench.clock.now_s(), 5.95)
    assert bench.read(boot.PRIVILEGE, OTHER) == 0
    assert bench.device.destination is None
    assert bench.write(boot.PRIVILEGE, 2, OTHER) == Status.SUCCESS
    assert bench.read("TriggerMode", OTHER) == 1
    assert bench.read_float("ExposureTime") == 2500.0


def test_world_time_alone_costs_nobody_control(bench: Bench) -> None:
    bench.control()
    bench.clock.at_s += 1000.0  # at a speed far above the wall clock's
    bench.device.advance(bench.clock.now_s(), 1.0)
    assert bench.read(boot.PRIVILEGE) == 2


def test_a_camera_held_elsewhere_tells_by_whom(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.device.faults = Faults(held_by="192.0.2.7")
    assert bench.write(boot.PRIVILEGE, 2) == Status.ACCESS_DENIED
    assert bench.read(boot.APPLICATION_ADDRESS) == 0xC0000207
    assert bench.device.destination is None
    bench.device.faults = Faults()
    bench.control()


# --- exposures ------------------------------------------------------------------------------------


def test_a_trigger_exposes_from_then_on_and_the_picture_waits_for_the_end(bench: Bench) -> None:
    bench.ready_for_trigger(ExposureTime=EXPOSURE_S * 1e6, Gain=6.0)
    assert bench.trigger() == 1
    start_s, end_s, exposure_s, gain, bits = bench.ramp.orders[0]
    assert (start_s, bits) == (100.0, 8)
    assert end_s - start_s == pytest.approx(exposure_s) == pytest.approx(EXPOSURE_S)
    assert gain == pytest.approx(10 ** (6 / 20))
    bench.device.deliver(0, bench.ramp.picture(8))
    assert bench.device.take(bench.clock.now_s() + 0.9 * EXPOSURE_S) is None
    assert bench.device.oldest_due_s == pytest.approx(end_s)
    packets = bench.frame()
    assert bench.device.oldest_due_s is None
    assert pixels_of(packets) == bench.ramp.picture(8).tobytes()


def test_a_trigger_during_an_exposure_has_no_effect(bench: Bench) -> None:
    bench.ready_for_trigger()
    assert [bench.trigger(), bench.trigger()] == [1, 0]
    bench.clock.at_s += EXPOSURE_S
    assert bench.trigger() == 1
    assert bench.device.lost_count == 1


def test_without_trigger_mode_frames_come_at_the_rate_and_lost_ones_are_counted(
    bench: Bench,
) -> None:
    bench.ready_for_trigger(TriggerMode=0)
    starts = []
    for _ in range(3):
        due_s, _ = bench.device.advance(bench.clock.now_s(), 0.0)
        starts.append(bench.ramp.orders[-1][0])
        bench.frame()
        assert due_s is not None
        bench.clock.at_s = due_s
    assert np.diff(starts) == pytest.approx([0.2, 0.2])
    bench.clock.at_s += 0.4  # two frames that nobody was there for
    bench.device.advance(bench.clock.now_s(), 0.0)
    assert bench.device.lost_count == 2


@pytest.mark.parametrize(
    ("pixel_format", "bits", "shift"),
    [
        (PixelFormat.Mono8, 8, 0),
        (PixelFormat.Mono10, 16, 6),
        (PixelFormat.Mono12, 16, 4),
        (PixelFormat.Mono16, 16, 0),
    ],
)
def test_depth_is_that_of_the_pixel_format(
    bench: Bench, pixel_format: PixelFormat, bits: int, shift: int
) -> None:
    bench.ready_for_trigger(PixelFormat=int(pixel_format))
    bench.trigger()
    assert bench.ramp.orders[0][4] == bits
    data = pixels_of(bench.frame())
    seen = np.frombuffer(data, np.uint8 if bits == 8 else "<u2").reshape(48, 64)
    assert np.array_equal(seen, bench.ramp.picture(bits) >> shift)
    assert bench.read("PayloadSize") == len(data)


def test_region_black_level_and_gamma_shape_the_picture(bench: Bench) -> None:
    bench.ready_for_trigger(Width=16, Height=24, OffsetX=32, OffsetY=10, BlackLevel=14.0, Gamma=0.5)
    bench.trigger()
    packets = bench.frame()
    assert struct.unpack_from(">IIII", packets[0], 8 + 16) == (16, 24, 32, 10)
    seen = np.frombuffer(pixels_of(packets), np.uint8).reshape(24, 16)
    sensor = bench.ramp.picture(8)[10:34, 32:48] / 255.0
    expected = np.clip(sensor + 10.0 / 255.0, 0.0, 1.0) ** 0.5 * 255.0
    assert np.abs(seen - expected).max() <= 0.5


def test_automatic_exposure_steers_towards_the_middle_and_once_ends_by_itself(
    bench: Bench,
) -> None:
    bench.ready_for_trigger(ExposureAuto=1, GainAuto=0)
    before = bench.read_float("ExposureTime")
    for _ in range(3):
        bench.trigger()
        dark = np.full((48, 64), 59, np.uint8)  # half of what it steers to
        bench.device.deliver(len(bench.ramp.orders) - 1, dark)
        bench.clock.at_s += 1.0
        frame = bench.device.take(bench.clock.now_s())
        assert frame is not None
        bench.device.sent(frame)
    assert bench.read_float("ExposureTime") == pytest.approx(8 * before)
    bench.trigger()
    bench.device.deliver(len(bench.ramp.orders) - 1, np.full((48, 64), 118, np.uint8))
    assert bench.read("ExposureAuto") == 0


def test_time_stamps_are_the_cells_time_since_power_up(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.clock.at_s += 2.5
    bench.trigger()
    (ticks,) = struct.unpack_from(">Q", bench.frame()[0], 8 + 4)
    assert ticks == pytest.approx(2.5e9, abs=1e3)
    assert bench.write(boot.TIMESTAMP_CONTROL, 2) == Status.SUCCESS
    latched = bench.read(boot.TIMESTAMP_HIGH) << 32 | bench.read(boot.TIMESTAMP_LOW)
    assert latched == pytest.approx(ticks + EXPOSURE_S * 1e9, abs=1e3)


def test_blocks_count_from_one_when_the_stream_opens_and_skip_nought(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.device._acquisition._next_block = 65535
    blocks = []
    for _ in range(2):
        bench.trigger()
        blocks.append(block_of(bench.frame()[0]))
    assert blocks == [65535, 1]
    bench.write(boot.STREAM_PORT, 0)
    bench.write(boot.STREAM_PORT, 41001)
    bench.trigger()
    assert block_of(bench.frame()[0]) == 1


def test_size_and_format_are_locked_while_pictures_are_taken(bench: Bench) -> None:
    bench.ready_for_trigger()
    assert bench.write("Width", 32) == Status.WRITE_PROTECT
    assert bench.write("PixelFormat", int(PixelFormat.Mono16)) == Status.WRITE_PROTECT
    bench.write("AcquisitionStop", 1)
    assert bench.write("Width", 32) == Status.SUCCESS


def test_a_test_packet_has_the_size_that_is_set(bench: Bench) -> None:
    bench.control()
    bench.write(boot.STREAM_PACKET_SIZE, 8000 | 1 << 31)
    assert [len(one) + 28 for one in bench.device.take_test_packets()] == [8000]
    assert bench.read(boot.STREAM_PACKET_SIZE) == 8000


# --- faults ---------------------------------------------------------------------------------------


def test_lost_packets_come_when_they_are_asked_for_again(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.write(boot.STREAM_PACKET_SIZE, 576)
    bench.device.faults = Faults(lost_packet_count=2)
    bench.trigger()
    packets = bench.frame()
    numbers = [int.from_bytes(packet[5:8], "big") for packet in packets]
    assert numbers == [0, 2, 4, 5, 6, 7]
    missing = bench.again(1, 1, 1) + bench.again(1, 3, 3)
    whole = sorted([*packets, *missing], key=lambda one: one[5:8])
    assert pixels_of(whole) == bench.ramp.picture(8).tobytes()
    assert bench.device.faults.lost_packet_count == 0


def test_a_short_frame_cannot_be_completed(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.write(boot.STREAM_PACKET_SIZE, 576)
    bench.device.faults = Faults(short_count=1)
    bench.trigger()
    assert len(bench.frame()) == 4  # of 8
    rest = bench.again(1, 4, 0xFFFFFF)
    assert [packet[:2].hex() for packet in rest] == ["800c"] * 4
    assert bench.again(77, 0, 5)[0][:2].hex() == "800c"


def test_a_frame_lost_in_the_camera_uses_up_its_number(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.device.faults = Faults(lost_count=1, missed_trigger_count=1)
    assert [bench.trigger(), bench.trigger(), bench.trigger()] == [0, 0, 1]
    assert block_of(bench.frame()[0]) == 2


def test_a_late_frame_is_sent_late_and_holds_nothing_up(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.device.faults = Faults(late_count=1, late_s=0.5)
    bench.trigger()
    bench.device.deliver(0, bench.ramp.picture(8))
    assert bench.device.oldest_due_s is None
    bench.clock.at_s += EXPOSURE_S
    assert bench.device.take(bench.clock.now_s()) is None
    due_s, _ = bench.device.advance(bench.clock.now_s(), 0.0)
    assert due_s == pytest.approx(100.0 + EXPOSURE_S + 0.5)
    assert bench.device.take(due_s) is not None


def test_a_frozen_and_a_dark_camera_send_what_they_say(bench: Bench) -> None:
    bench.ready_for_trigger()
    bench.trigger()
    bench.frame()
    bench.device.faults = Faults(is_frozen=True)
    bench.trigger()
    bench.device.deliver(1, np.zeros((48, 64), np.uint8))
    bench.clock.at_s += EXPOSURE_S
    frame = bench.device.take(bench.clock.now_s())
    assert frame is not None
    assert frame.pixels == bench.ramp.picture(8).tobytes()
    bench.device.faults = Faults(is_dark=True)
    bench.device.sent(frame)
    bench.trigger()
    assert not any(pixels_of(bench.frame()))


def test_a_switch_without_jumbo_frames_passes_small_packets_alone(bench: Bench) -> None:
    bench.device.faults = Faults(mtu_bytes=1500)
    assert bench.device.passes(bytes(1472))
    assert not bench.device.passes(bytes(1473))


def test_packets_lost_by_chance_are_as_many_as_said(bench: Bench) -> None:
    bench.device.faults = Faults(lost_per_thousand=100)
    lost = sum(not bench.device.passes(b"packet") for _ in range(10_000))
    assert lost == pytest.approx(1000, abs=150)  # five standard deviations


def test_an_unplugged_camera_is_silent_and_comes_back_with_the_settings_of_power_up(
    bench: Bench,
) -> None:
    bench.ready_for_trigger()
    bench.trigger()
    bench.device.unplug()
    head = struct.pack(">BBHHHI", 0x42, 1, 0x80, 4, 7, boot.PRIVILEGE)
    assert bench.device.answer(head, CLIENT, 0.0) == (None, [])
    bench.device.deliver(0, bench.ramp.picture(8))
    assert bench.device.take(bench.clock.now_s() + 1.0) is None
    bench.device.plug()
    assert bench.read(boot.PRIVILEGE) == 0
    assert (bench.read("TriggerMode"), bench.read("ExposureAuto")) == (0, 2)
    assert bench.read(boot.STREAM_SOURCE_PORT) == 50505


def test_a_mute_camera_answers_nothing(bench: Bench) -> None:
    bench.device.faults = Faults(is_mute=True)
    head = struct.pack(">BBHHH", 0x42, 1, 0x02, 0, 7)
    assert bench.device.answer(head, CLIENT, 0.0) == (None, [])
