"""The GenICam driver against a fake aravis: what is set, which frame comes, what is raised."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from genicam_fakes import CAMERA, OTHER_HOST, STREAM, FakeCamera, Shot, functions

from drivers.camera_genicam import (
    DRIVER,
    FORMATS,
    Aravis,
    Camera,
    CameraConfig,
    GenICamSettings,
    decode,
    wanted_formats,
)
from drivers.errors import (
    BadReplyError,
    LinkError,
    NoLibraryError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
    WrongDeviceError,
)
from drivers.kinds import TimedFrame

WIDTH, HEIGHT = 8, 4
ADDRESS = "127.0.0.9"
Connect = Callable[..., Awaitable[Camera]]


def config(**changes: Any) -> CameraConfig:
    values: dict[str, Any] = {
        "address": ADDRESS,
        "width": WIDTH,
        "height": HEIGHT,
        "formats": wanted_formats(("GREY",)),
        "exposure_s": 0.002,
        "fps": 200.0,
        "frame_late_s": 30.0,
    }
    return CameraConfig(**{**values, **changes})


@pytest.fixture
def fake() -> FakeCamera:
    return FakeCamera()


@pytest.fixture
async def connect(fake: FakeCamera) -> AsyncIterator[Connect]:
    """Connect cameras, and see that no thread of them is left behind."""
    threads, cameras = set(threading.enumerate()), []
    library = Aravis(functions(fake))

    async def connected(**changes: Any) -> Camera:
        camera = Camera(config(**changes), library=lambda: library)
        cameras.append(camera)
        await camera.connect()
        return camera

    yield connected
    for camera in cameras:
        await camera.close()
    ours = {one for one in threading.enumerate() if not one.name.startswith("asyncio")}
    for thread in ours - threads:
        thread.join(5.0)
        assert not thread.is_alive(), f"{thread.name} is still there"


# --- what is set and read back ----------------------------------------------------------------


async def test_whatever_another_program_left_set_is_set_right(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.trigger_modes["AcquisitionStart"] = "On"
    camera = await connect()
    found = fake.features
    assert found["AcquisitionMode"] == "Continuous"
    assert (found["Width"], found["Height"]) == (WIDTH, HEIGHT)
    assert (found["OffsetX"], found["OffsetY"]) == (0, 0)
    assert (found["ReverseX"], found["GammaEnable"], found["ChunkModeActive"]) == (False,) * 3
    assert (found["ExposureAuto"], found["GainAuto"]) == ("Off", "Off")
    assert found["ExposureTime"] == pytest.approx(2000.0)  # microseconds
    assert (found["Gain"], found["Gamma"], found["BlackLevel"]) == (0.0, 1.0, 0.0)
    assert fake.trigger_modes == {"AcquisitionStart": "Off", "FrameStart": "On"}
    assert found["TriggerSource"] == "Software"
    assert fake.packet_size == 1500
    # an acquisition that somebody left running is ended before anything is set
    assert fake.executed[:2] == ["AcquisitionStop", "AcquisitionStart"]
    was = {one.feature: one.was for one in camera.settings}
    assert (was["ReverseX"], was["Gamma"], was["TriggerSource"]) == ("True", "0.45", "Line1")
    absent = {one.feature for one in camera.settings if one.value == "absent"}
    assert {"BinningHorizontal", "LUTEnable", "TriggerDelay"} <= absent


async def test_gain_black_level_offset_and_packet_size_are_those_of_the_settings(
    connect: Connect, fake: FakeCamera
) -> None:
    await connect(gain=12.5, black_level=4.0, offset_px=(100, 40), packet_size=9000)
    assert (fake.features["Gain"], fake.features["BlackLevel"]) == (12.5, 4.0)
    assert (fake.features["OffsetX"], fake.features["OffsetY"]) == (100, 40)
    assert fake.packet_size == 9000


@pytest.mark.parametrize("feature", ["TriggerMode", "TriggerSource", "GainAuto", "ReverseX"])
async def test_a_setting_that_does_not_read_back_is_refused_by_name(
    connect: Connect, fake: FakeCamera, feature: str
) -> None:
    fake.ignores.add(feature)
    with pytest.raises(RefusedError, match=rf"{feature} is .* was set"):
        await connect()


@pytest.mark.parametrize("feature", ["ExposureTime", "Gain", "Gamma", "Width", "OffsetX"])
async def test_a_number_that_does_not_read_back_is_refused_by_name(
    connect: Connect, fake: FakeCamera, feature: str
) -> None:
    fake.ignores.add(feature)
    with pytest.raises(RefusedError, match=rf"{feature} is .* was set"):
        await connect()


async def test_a_packet_size_that_does_not_read_back_is_refused(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.ignores.add("packet_size")
    with pytest.raises(RefusedError, match="GevSCPSPacketSize is 576 after 9000 was set"):
        await connect(packet_size=9000)


async def test_a_feature_that_cannot_be_written_is_refused_with_the_cameras_words(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.refuses.add("ExposureAuto")
    with pytest.raises(RefusedError, match=r"refuses ExposureAuto Off .*read only"):
        await connect()


async def test_what_is_right_already_is_not_written(connect: Connect, fake: FakeCamera) -> None:
    fake.features["ExposureAuto"] = "Off"
    fake.refuses.add("ExposureAuto")
    await connect()


async def test_an_exposure_out_of_range_is_refused_with_the_range(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.bounds["ExposureTime"] = (10.0, 1500.0)
    with pytest.raises(RefusedError, match=r"ExposureTime 2000 is outside .* 10 to 1500"):
        await connect()


async def test_the_exposure_is_the_one_that_the_camera_took(
    connect: Connect, fake: FakeCamera
) -> None:
    # a camera of GigE Vision 1.x has whole microseconds under another name
    del fake.features["ExposureTime"]
    fake.features["ExposureTimeRaw"] = 1
    fake.bounds["ExposureTimeRaw"] = (1, 100_000)
    camera = await connect(exposure_s=0.0020004)
    assert camera.identity().exposure_s == pytest.approx(0.002)
    assert (await camera.frame_after(0.0)).exposure_s == pytest.approx(0.002)


async def test_a_black_level_of_0_is_raised_to_the_lowest_but_one_asked_for_is_not(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.bounds["BlackLevel"] = (1.0, 32.0)
    await connect()
    assert fake.features["BlackLevel"] == 1.0
    with pytest.raises(RefusedError, match="BlackLevel 0 is outside"):
        await connect(black_level=0.0)


@pytest.mark.parametrize(
    ("feature", "words"),
    [
        ("TriggerSoftware", "no software trigger"),
        ("TriggerSource", "has no TriggerSource"),
        ("Width", "has no Width"),
    ],
)
async def test_a_camera_without_what_a_picture_needs_is_the_wrong_one(
    connect: Connect, fake: FakeCamera, feature: str, words: str
) -> None:
    del fake.features[feature]
    with pytest.raises(WrongDeviceError, match=words):
        await connect()


async def test_a_camera_that_has_no_trigger_of_frames_is_the_wrong_one(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.choices["TriggerSelector"] = ("ExposureActive",)
    with pytest.raises(WrongDeviceError, match="has triggers ExposureActive, and none of"):
        await connect()


async def test_without_a_pixel_format_of_the_cell_file_those_that_it_has_are_named(
    connect: Connect, fake: FakeCamera
) -> None:
    with pytest.raises(WrongDeviceError, match=r"none of .* Mono10; it offers GREY \(Mono8\), Y12"):
        await connect(formats=wanted_formats(("Y10",)))


# --- which camera --------------------------------------------------------------------------------


@pytest.mark.parametrize("address", ["4711", "Acme-Eye 12-4711", "Acme-4711", ADDRESS])
async def test_a_camera_is_found_by_ip_serial_or_name(connect: Connect, address: str) -> None:
    camera = await connect(address=address)
    assert camera.model == "Acme Eye 12 4711"
    assert camera.firmware == "2.5"
    assert camera.shape == (HEIGHT, WIDTH)


async def test_an_unknown_serial_number_names_the_cameras_that_answer(connect: Connect) -> None:
    with pytest.raises(
        LinkError, match=r"no such camera answers; those that do: Acme-Eye 12-4711 at"
    ):
        await connect(address="4712")


async def test_no_camera_at_all_says_what_to_check(connect: Connect, fake: FakeCamera) -> None:
    fake.is_there = False
    with pytest.raises(LinkError, match="no camera answers a search; check cables"):
        await connect(address="4711")
    with pytest.raises(LinkError, match=r"does not answer .* not found.*cable"):
        await connect()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"model": "Eye 5"}, "its model is `Eye 12`, `Eye 5` is expected"),
        ({"serial": "1"}, "its serial number is `4711`, `1` is expected"),
    ],
)
async def test_another_model_or_serial_number_is_the_wrong_device(
    connect: Connect, fake: FakeCamera, wrong: dict[str, str], words: str
) -> None:
    with pytest.raises(WrongDeviceError, match=words):
        await connect(**wrong)
    assert fake.executed == []  # nothing was set
    assert CAMERA in fake.released


async def test_a_camera_that_another_host_controls_is_busy_and_the_host_is_named(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.has_control, fake.refused_controls = False, 99
    fake.registers = {
        0x0A14: int.from_bytes(bytes(map(int, OTHER_HOST.split(".")))),
        0x0A04: 50_123,
        0x0938: 60_000,
    }
    begun_s = time.monotonic()
    with pytest.raises(RefusedError, match=rf"busy, .* {OTHER_HOST}, port 50123 controls it") as no:
        await connect()
    assert no.value.code == 16
    assert time.monotonic() - begun_s < 30.0  # its heartbeat of 60 s is not waited for
    assert fake.executed == []


async def test_a_program_here_that_died_is_outwaited_for_its_heartbeat(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.has_control, fake.refused_controls = False, 2
    fake.registers = {0x0A14: 0x7F000001, 0x0938: 60_000}
    camera = await connect()
    assert camera.is_connected


async def test_an_unknown_program_is_busy_after_one_heartbeat(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.has_control, fake.refused_controls = False, 99
    fake.registers = {0x0938: 300}
    with pytest.raises(RefusedError, match="busy, another program controls it"):
        await connect()
    assert fake.refused_controls < 98  # it was asked for again


def test_a_missing_library_says_what_to_install() -> None:
    with pytest.raises(NoLibraryError, match=r"libnothing.so.9.*apt-get install libaravis-0.8-0"):
        Aravis.load("libnothing.so.9")


def test_a_library_without_a_function_is_too_old() -> None:
    with pytest.raises(NoLibraryError, match="too old"):
        Aravis.load("libc.so.6")


async def test_a_missing_library_is_an_error_of_connecting_alone() -> None:
    camera = Camera(config(), library=lambda: Aravis.load("libnothing.so.9"))
    with pytest.raises(NoLibraryError):
        await camera.connect()
    await camera.close()


# --- which frame ---------------------------------------------------------------------------------


async def test_a_frame_is_triggered_after_the_instant(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    before = fake.triggers
    t_s = time.monotonic() + 0.05
    frame = await camera.frame_after(t_s)
    assert isinstance(frame, TimedFrame)
    assert fake.triggers == before + 1
    assert t_s <= frame.earliest_light_s <= frame.timestamp_s
    assert frame.image.shape == (HEIGHT, WIDTH)
    assert frame.image.dtype == np.uint8
    assert not frame.image.flags.writeable
    assert (frame.white, frame.frame_id, frame.image[0, 0]) == (255, fake.number, fake.number)


async def test_every_buffer_goes_back_to_the_library(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    for _ in range(7):
        await camera.frame_after(0.0)
    assert fake.pushed_count - fake.popped_count == 4  # as many as at first


async def give_up_a_look(camera: Camera, fake: FakeCamera) -> int:
    """Cancel a look whose frame comes right behind the next trigger; return that frame's number."""
    fake.shots.append(Shot(is_late=True))
    fake.triggered.clear()
    waiting = asyncio.ensure_future(camera.frame_after(0.0, 60.0))
    assert await asyncio.to_thread(fake.triggered.wait, 60.0)
    late = fake.number
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
    return late


async def test_a_frame_of_an_earlier_trigger_is_never_handed_over(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    late = await give_up_a_look(camera, fake)
    frame = await camera.frame_after(0.0)
    assert frame.frame_id > late
    assert camera.stats.stale_count >= 1
    assert (await camera.frame_after(0.0)).frame_id > frame.frame_id
    assert camera.stats.out_of_step_count == 0


async def test_a_frame_left_in_the_queue_is_passed_over_and_counted(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.number += 1
    fake.waiting.append((Shot(), fake.number))  # sent twice, the trigger was obeyed twice
    frame = await camera.frame_after(0.0)
    assert frame.frame_id == fake.number
    assert camera.stats.stale_count == 1
    assert camera.stats.out_of_step_count == 0


async def test_incomplete_frames_are_dropped_counted_and_taken_again(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.shots += [Shot(status=2), Shot(status=3)]
    fake.statistics = {"n_missing_packets": 5, "n_resend_requests": 4, "n_resent_packets": 3}
    frame = await camera.frame_after(0.0)
    assert frame.frame_id == fake.number
    stats = camera.stats
    assert (stats.incomplete_count, stats.delivered_count) == (2, 1)
    assert (stats.missing_packet_count, stats.resend_request_count) == (5, 4)
    assert stats.resent_packet_count == 3


async def test_a_late_double_of_a_frame_counts_as_no_answer(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    frame = await camera.frame_after(0.0)
    late = await give_up_a_look(camera, fake)
    fake.waiting.appendleft((Shot(status=2), frame.frame_id))
    # the frame that is late is still to be passed over
    assert (await camera.frame_after(0.0)).frame_id > late
    assert camera.stats.out_of_step_count == 0


async def test_a_trigger_that_the_camera_ignores_is_sent_again(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.shots.append(Shot(is_ignored=True))
    frame = await camera.frame_after(0.0, 5.0)
    assert frame.frame_id == fake.number
    # the next look cannot know that it was ignored, and passes over a frame in its place
    assert (await camera.frame_after(0.0, 5.0)).frame_id == frame.frame_id + 2
    assert (await camera.frame_after(0.0, 5.0)).frame_id == frame.frame_id + 3
    assert camera.stats.unanswered_count == 1


async def test_a_number_left_out_is_taken_again_and_a_second_one_is_an_error(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.shots.append(Shot(skips=1))
    frame = await camera.frame_after(0.0)
    assert (frame.frame_id, camera.stats.out_of_step_count) == (fake.number, 1)
    fake.shots += [Shot(skips=2), Shot(skips=1)]
    with pytest.raises(BadReplyError, match=r"not triggered: after number .* is another trigger"):
        await camera.frame_after(0.0)


async def test_numbers_of_16_bits_go_on_at_1(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    await camera.frame_after(0.0)
    fake.number = 0xFFFE
    camera._session._last_id = 0xFFFE  # type: ignore[union-attr]
    ids = [(await camera.frame_after(0.0)).frame_id for _ in range(3)]
    assert ids == [0xFFFF, 1, 2]
    assert camera.stats.out_of_step_count == 0


async def test_a_frame_of_another_size_is_an_error(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    fake.shots.append(Shot(width=WIDTH - 1))
    with pytest.raises(BadReplyError, match=r"7 x 4 px .* 8 x 4 px"):
        await camera.frame_after(0.0)


async def test_padding_behind_rows_is_left_out(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    fake.shots.append(Shot(padding=3, level=9))
    assert ((await camera.frame_after(0.0)).image == 9).all()


async def test_the_first_frames_are_thrown_away(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect(settle_frame_count=3)
    assert (fake.triggers, camera.stats.settling_count) == (3, 3)


async def test_a_camera_whose_frames_do_not_arrive_is_known_at_once(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.usual = Shot(is_ignored=True)
    with pytest.raises(ReplyTimeoutError, match=r"within .* s: \d+ trigger; a firewall must"):
        await connect(frame_late_s=0.3)
    assert STREAM in fake.released


async def test_packets_larger_than_usual_are_named_where_no_frame_is_whole(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.usual = Shot(status=2)  # leader and trailer, which are small, arrive
    fake.statistics["n_missing_packets"] = 1000  # more than two frames have
    with pytest.raises(ReplyTimeoutError, match=r"missing packet; if packets of 9000 .* to 1500"):
        await connect(packet_size=9000, frame_late_s=0.3)


async def test_a_computer_that_is_too_slow_for_its_packets_is_named(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.usual = Shot(status=2)
    fake.statistics["n_missing_packets"] = 1  # of the 8 that one frame has
    with pytest.raises(ReplyTimeoutError, match=r"incomplete, 1 missing .*rmem_max"):
        await connect(packet_size=40, frame_late_s=0.3)


async def test_a_socket_takes_two_frames(connect: Connect, fake: FakeCamera) -> None:
    await connect()
    # a frame of the fake has a payload of twice its pixels
    assert fake.properties == {"socket-buffer": 0, "socket-buffer-size": 4 * WIDTH * HEIGHT}


# --- depth ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "white"), [("GREY", 255), ("Y10", 1023), ("Y12", 4095), ("Y16", 65535)]
)
def test_white_is_that_of_the_depth(name: str, white: int) -> None:
    assert FORMATS[name].white == white


async def test_twelve_bits_keep_their_values_and_their_white(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect(formats=wanted_formats(("Y12", "GREY")))
    fake.shots.append(Shot(level=4095))
    frame = await camera.frame_after(0.0)
    assert (frame.image.dtype, frame.white) == (np.uint16, 4095)
    assert (frame.image == 4095).all()


async def test_twelve_bits_in_mono16_have_the_cameras_own_white(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.features["PixelDynamicRangeMax"] = 4095
    camera = await connect(formats=wanted_formats(("Y16",)))
    assert (await camera.frame_after(0.0)).white == 4095
    fake.shots.append(Shot(level=65520))  # left-aligned after all
    with pytest.raises(BadReplyError, match="a pixel of 65520, its PixelDynamicRangeMax is 4095"):
        await camera.frame_after(0.0)


def test_the_low_byte_comes_first() -> None:
    image = decode(b"\x01\x02\x03\x04\xff\xff\x05\x06\x07\x08", 2, 2, 2, 2)
    assert image.tolist() == [[0x0201, 0x0403], [0x0605, 0x0807]]


def test_a_picture_that_is_too_short_is_an_error() -> None:
    with pytest.raises(BadReplyError, match=r"2 x 2 px in 7 bytes, 8 expected"):
        decode(bytes(7), 2, 2, 0, 2)


def test_colour_and_jpeg_are_passed_over_but_not_alone() -> None:
    assert [one.name for one in wanted_formats(("MJPG", "Y12", "GREY"))] == ["Mono12", "Mono8"]
    with pytest.raises(ValueError, match=r"MJPG, YUYV: a GenICam camera sends GREY, Y10, Y12, Y16"):
        wanted_formats(("MJPG", "YUYV"))


# --- pauses, ends, losses ----------------------------------------------------------------------


async def test_paused_it_sends_no_trigger(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    await camera.pause()
    before = fake.triggers
    with pytest.raises(ValueError, match="paused"):
        await camera.frame_after(0.0)
    assert (camera.is_paused, fake.triggers) == (True, before)
    await camera.resume()
    assert (await camera.frame_after(0.0)).frame_id == fake.number


async def test_unplugged_it_is_closed_and_the_same_driver_opens_it_again(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.is_there = False
    with pytest.raises(UnpluggedError, match="does not answer any more"):
        await camera.frame_after(0.0)
    assert not camera.is_connected
    with pytest.raises(LinkError, match="not connected"):
        await camera.frame_after(0.0)
    with pytest.raises(LinkError, match="does not answer"):
        await camera.connect()
    fake.is_there = True
    await camera.connect()
    assert (await camera.frame_after(0.0)).frame_id == fake.number


async def test_control_that_is_lost_during_a_wait_is_an_unplugged_camera(
    connect: Connect, fake: FakeCamera
) -> None:
    camera = await connect()
    fake.usual = Shot(is_ignored=True)
    fake.triggered.clear()
    waiting = asyncio.ensure_future(camera.frame_after(0.0, 30.0))
    assert await asyncio.to_thread(fake.triggered.wait, 60.0)
    fake.has_control = False
    with pytest.raises(UnpluggedError, match=r"another program has taken control|does not answer"):
        await waiting
    assert not camera.is_connected


async def test_closing_ends_a_wait(connect: Connect, fake: FakeCamera) -> None:
    camera = await connect()
    fake.usual = Shot(is_ignored=True)
    fake.triggered.clear()
    waiting = asyncio.ensure_future(camera.frame_after(0.0, 30.0))
    assert await asyncio.to_thread(fake.triggered.wait, 60.0)
    await camera.close()
    with pytest.raises(LinkError):
        await waiting
    await camera.close()  # twice does no harm
    assert {CAMERA, STREAM} <= set(fake.released)
    assert fake.executed[-1] == "AcquisitionStop"


async def test_a_usb_camera_has_no_packets_and_no_controller(
    connect: Connect, fake: FakeCamera
) -> None:
    fake.is_gige, fake.packet_size = False, 0
    camera = await connect()
    assert camera.identity().packet_size == 0
    assert (await camera.frame_after(0.0)).frame_id == fake.number


class Tape:
    """The wires of one camera: notes each call, then answers in the camera's place."""

    def __init__(self) -> None:
        self.rows: list[tuple[str, bytes]] = []
        self.is_playing = False

    def camera(self, name: str) -> Tape:
        return self

    def thread(self, name: str) -> ThreadPoolExecutor:
        return ThreadPoolExecutor(1)

    def call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        if not self.is_playing:
            self.rows.append((what, do()))
            return self.rows[-1][1]
        name, answer = self.rows.pop(0)
        assert name == what
        return answer


async def test_a_recording_answers_without_library_and_camera(fake: FakeCamera) -> None:
    tape: Any = Tape()
    library = Aravis(functions(fake))

    def no_library() -> Aravis:
        raise AssertionError("a playback loads no library")

    async def session(load: Callable[[], Aravis], unplug: Callable[[], None]) -> list[Any]:
        camera = Camera(config(formats=wanted_formats(("Y12",))), library=load, wires=tape)
        identity = await camera.connect()
        begun_s = time.monotonic()
        frame = await camera.frame_after(0.0)
        took_s = time.monotonic() - begun_s
        unplug()
        with pytest.raises(UnpluggedError) as gone:
            await camera.frame_after(0.0)
        with pytest.raises(LinkError) as absent:
            await camera.connect()
        await camera.close()
        assert took_s >= frame.timestamp_s - frame.earliest_light_s  # it comes no earlier than then
        return [
            identity, frame.image.tolist(), frame.white, frame.frame_id,
            str(gone.value), str(absent.value),
        ]  # fmt: skip

    recorded = await session(lambda: library, lambda: setattr(fake, "is_there", False))
    assert [what for what, _ in tape.rows] == (
        ["find", "control", "start", "frame", "frame", "frame", "find"]
    )
    tape.is_playing = True
    assert await session(no_library, lambda: None) == recorded
    assert tape.rows == []


# --- the cell file -------------------------------------------------------------------------------


def test_settings_out_of_range_are_refused_before_anything_is_sent() -> None:
    with pytest.raises(ValueError, match="packet_size must be 576 to 16384 bytes, not 500"):
        GenICamSettings(packet_size=500)
    with pytest.raises(ValueError, match=r"offset_px must not be negative"):
        GenICamSettings(offset_px=(0, -1))
    assert DRIVER.settings is GenICamSettings
