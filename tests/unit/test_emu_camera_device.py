"""The emulated camera as an object: what each ioctl answers, by the V4L2 specification."""

import errno
import struct
from collections.abc import Callable

import emu_camera_client as v4l2
import pytest
from emu_camera_bench import Bench
from emu_camera_client import Client

from emulators.camera_v4l2 import CameraConfig, PixelFormat, V4l2Device
from emulators.camera_v4l2.kernel import NotYet, Refused

ERR, IN_RDNORM, PRI, HUP = 0x8, 0x41, 0x2, 0x10  # asm-generic/poll.h


@pytest.fixture
def bench() -> Bench:
    return Bench()


def refusal(act: Callable[[], object]) -> str:
    with pytest.raises(OSError) as caught:  # noqa: PT011 - the caller compares its number
        act()
    return errno.errorcode[caught.value.errno or 0]


def text(data: bytes) -> str:
    return data.split(b"\0")[0].decode()


# -- who it is and what it can do -------------------------------------------------------------


def test_it_is_a_streaming_capture_device(bench: Bench) -> None:
    reply = bench.client.ask(v4l2.QUERYCAP, bytes(104))
    assert text(reply[16:48]) == "Emulated Camera"
    capabilities, device_caps = struct.unpack_from("<II", reply, 84)
    assert device_caps & 0x04000001 == 0x04000001  # STREAMING, VIDEO_CAPTURE
    assert capabilities == device_caps | 0x80000000  # DEVICE_CAPS: the second word is meant


def test_it_lists_its_formats_and_then_ends() -> None:
    bench = Bench(CameraConfig())
    codes = []
    for index in range(4):
        reply = bench.client.ask(v4l2.ENUM_FMT, struct.pack("<II", index, 1).ljust(64, b"\0"))
        codes.append(reply[44:48].decode())
        assert bool(reply[8] & 1) == (codes[-1] == "MJPG")  # flagged as compressed
    assert codes == ["GREY", "YUYV", "MJPG", "Y16 "]
    beyond = struct.pack("<II", 4, 1).ljust(64, b"\0")
    assert refusal(lambda: bench.client.ask(v4l2.ENUM_FMT, beyond)) == "EINVAL"


def test_it_lists_sizes_and_rates_of_each_format(bench: Bench) -> None:
    grey = int.from_bytes(b"GREY", "little")
    ask = struct.pack("<II", 1, grey).ljust(44, b"\0")
    assert struct.unpack_from("<III", bench.client.ask(v4l2.ENUM_FRAMESIZES, ask), 8) == (1, 32, 24)
    ask = struct.pack("<4I", 1, grey, 64, 48).ljust(52, b"\0")
    reply = bench.client.ask(v4l2.ENUM_FRAMEINTERVALS, ask)
    assert struct.unpack_from("<III", reply, 16) == (1, 1, 10)
    ask = struct.pack("<4I", 0, grey, 63, 48).ljust(52, b"\0")
    assert refusal(lambda: bench.client.ask(v4l2.ENUM_FRAMEINTERVALS, ask)) == "EINVAL"


@pytest.mark.parametrize(
    ("fourcc", "line", "size"),
    [("GREY", 64, 3072), ("YUYV", 128, 6144), ("Y16 ", 128, 6144), ("MJPG", 0, 6144)],
)
def test_a_format_that_exists_is_set_as_asked(
    bench: Bench, fourcc: str, line: int, size: int
) -> None:
    assert bench.client.set_format(64, 48, fourcc) == (64, 48, fourcc, line, size)


def test_a_size_and_format_that_do_not_exist_become_the_nearest(bench: Bench) -> None:
    assert bench.client.set_format(40, 30, "NV12") == (32, 24, "GREY", 32, 768)
    reply = bench.client.ask(v4l2.G_FMT, struct.pack("<I", 1).ljust(208, b"\0"))
    assert struct.unpack_from("<II", reply, 8) == (32, 24)


def test_trying_a_format_changes_nothing(bench: Bench) -> None:
    code = int.from_bytes(b"MJPG", "little")
    asked = struct.pack("<I4xIII", 1, 32, 24, code).ljust(208, b"\0")
    assert struct.unpack_from("<II", bench.client.ask(v4l2.TRY_FMT, asked), 8) == (32, 24)
    assert bench.device.size_px == (64, 48)


def test_the_format_is_fixed_while_buffers_exist(bench: Bench) -> None:
    bench.client.request_buffers(2)
    assert refusal(lambda: bench.client.set_format(32, 24, "GREY")) == "EBUSY"
    bench.client.request_buffers(0)
    assert bench.client.set_format(32, 24, "GREY")[:2] == (32, 24)


def test_the_rate_becomes_the_nearest_and_is_fixed_while_frames_flow(bench: Bench) -> None:
    asked = struct.pack("<5I", 1, 0, 0, 1, 18).ljust(204, b"\0")
    reply = bench.client.ask(v4l2.S_PARM, asked)
    assert struct.unpack_from("<II", reply, 12) == (1, 20)
    bench.client.start(2)
    assert refusal(lambda: bench.client.ask(v4l2.S_PARM, asked)) == "EBUSY"


def test_there_is_one_input(bench: Bench) -> None:
    assert struct.unpack_from("<I", bench.client.ask(v4l2.ENUMINPUT, bytes(80)), 36) == (2,)
    second = struct.pack("<I", 1).ljust(80, b"\0")
    assert refusal(lambda: bench.client.ask(v4l2.ENUMINPUT, second)) == "EINVAL"
    assert bench.client.ask(v4l2.G_INPUT, bytes(4)) == bytes(4)
    assert refusal(lambda: bench.client.ask(v4l2.S_INPUT, b"\1\0\0\0")) == "EINVAL"


@pytest.mark.parametrize("request_", [v4l2.CREATE_BUFS, 0x5401, 0xC0405610])
def test_what_the_camera_does_not_know_is_no_typewriter(bench: Bench, request_: int) -> None:
    size = request_ >> 16 & 0x3FFF
    assert refusal(lambda: bench.client.ask(request_, bytes(size))) == "ENOTTY"


def test_another_buffer_type_than_capture_is_refused(bench: Bench) -> None:
    output = struct.pack("<I", 2)
    for request in (v4l2.G_FMT, v4l2.S_FMT, v4l2.G_PARM, v4l2.STREAMON, v4l2.STREAMOFF):
        data = output.ljust(request >> 16 & 0x3FFF, b"\0")
        assert bench.client.carry(request, data)[0] == -errno.EINVAL


def test_a_frame_that_no_buffer_could_hold_is_a_mistake_of_the_config() -> None:
    with pytest.raises(ValueError, match="exceeds"):
        CameraConfig(sizes_px=((8000, 6000),), formats=(PixelFormat.Y16,))


# -- controls ---------------------------------------------------------------------------------


def control_ids(client: Client) -> list[int]:
    found: list[int] = []
    cid = 0
    while True:
        try:
            reply = client.ask(v4l2.QUERYCTRL, struct.pack("<I", cid | 0x80000000).ljust(68, b"\0"))
        except OSError:
            return found
        cid = struct.unpack_from("<I", reply)[0]
        found.append(cid)


def flags_of(client: Client, cid: int) -> int:
    reply = client.ask(v4l2.QUERYCTRL, struct.pack("<I", cid).ljust(68, b"\0"))
    return int.from_bytes(reply[56:60], "little")


def test_the_controls_can_be_walked_in_order(bench: Bench) -> None:
    found = control_ids(bench.client)
    assert found == sorted(found)
    assert {v4l2.EXPOSURE_AUTO, v4l2.EXPOSURE, v4l2.GAIN, v4l2.BRIGHTNESS} <= set(found)


def test_both_ways_of_asking_for_a_controls_range_agree(bench: Bench) -> None:
    for cid in control_ids(bench.client):
        short = bench.client.ask(v4l2.QUERYCTRL, struct.pack("<I", cid).ljust(68, b"\0"))
        long = bench.client.ask(v4l2.QUERY_EXT_CTRL, struct.pack("<I", cid).ljust(232, b"\0"))
        assert struct.unpack_from("<iiiiI", short, 40) == struct.unpack_from("<qqqqI", long, 40)
        assert short[:40] == long[:40]


def test_exposure_is_refused_until_the_automatic_is_off(bench: Bench) -> None:
    assert flags_of(bench.client, v4l2.EXPOSURE) & 0x10
    assert refusal(lambda: bench.client.set(v4l2.EXPOSURE, 100)) == "EACCES"
    bench.client.set(v4l2.EXPOSURE_AUTO, 1)
    assert not flags_of(bench.client, v4l2.EXPOSURE) & 0x10
    assert bench.client.set(v4l2.EXPOSURE, 100) == bench.client.get(v4l2.EXPOSURE) == 100


@pytest.mark.parametrize(("wish", "becomes"), [(-7, 0), (101, 100), (55, 55)])
def test_a_value_out_of_range_is_clamped_silently(bench: Bench, wish: int, becomes: int) -> None:
    assert bench.client.set(v4l2.GAIN, wish) == bench.client.get(v4l2.GAIN) == becomes


def test_a_value_between_two_steps_goes_to_the_nearer(bench: Bench) -> None:
    bench.client.set(0x0098090C, 0)
    assert bench.client.set(0x0098091A, 4604) == 4600
    assert bench.client.set(0x0098091A, 4607) == 4610


def test_a_menu_has_only_the_items_it_lists(bench: Bench) -> None:
    ask = struct.pack("<II", v4l2.EXPOSURE_AUTO, 1).ljust(44, b"\0")
    assert text(bench.client.ask(v4l2.QUERYMENU, ask)[8:40]) == "Manual Mode"
    gap = struct.pack("<II", v4l2.EXPOSURE_AUTO, 2).ljust(44, b"\0")
    assert refusal(lambda: bench.client.ask(v4l2.QUERYMENU, gap)) == "EINVAL"
    assert refusal(lambda: bench.client.set(v4l2.EXPOSURE_AUTO, 2)) == "EINVAL"
    assert refusal(lambda: bench.client.set(v4l2.EXPOSURE_AUTO, 9)) == "ERANGE"


def test_a_control_that_does_not_exist_is_refused(bench: Bench) -> None:
    assert refusal(lambda: bench.client.get(0x009A090C)) == "EINVAL"  # it has no autofocus


class Array:
    """A client's memory with one array of v4l2_ext_control at address 4096."""

    def __init__(self, *items: tuple[int, int]) -> None:
        self.data = b"".join(struct.pack("<IIIq", cid, 0, 0, value) for cid, value in items)

    def fetch(self, address: int, size_bytes: int) -> bytes:
        if address != 4096:
            raise Refused(errno.EFAULT)
        return self.data[:size_bytes]

    def store(self, address: int, data: bytes) -> None:
        assert address == 4096
        self.data = data

    def values(self) -> list[int]:
        return [item[3] for item in struct.iter_unpack("<IIIq", self.data)]


def ext(bench: Bench, request: int, memory: Array, which: int = 0) -> tuple[int, int]:
    """Return the result and error_idx of an extended control ioctl over the whole array."""
    data = struct.pack("<5I4xQ", which, len(memory.data) // 20, 77, 0, 0, 4096)
    result, reply = bench.device.ioctl(bench.handle, request, data, memory=memory)
    return result, struct.unpack_from("<I", reply, 8)[0]


def test_extended_controls_are_set_and_read_together(bench: Bench) -> None:
    wishes = Array((v4l2.GAIN, 20), (v4l2.BRIGHTNESS, -99))
    assert ext(bench, v4l2.S_EXT_CTRLS, wishes) == (0, 2)
    assert [value & 0xFFFFFFFF for value in wishes.values()] == [20, -64 & 0xFFFFFFFF]
    assert bench.client.get(v4l2.BRIGHTNESS) == -64
    asked = Array((v4l2.GAIN, 0), (v4l2.EXPOSURE, 0))
    assert ext(bench, v4l2.G_EXT_CTRLS, asked) == (0, 2)
    assert asked.values() == [20, 157]


def test_one_bad_extended_control_leaves_all_as_they_were(bench: Bench) -> None:
    wishes = Array((v4l2.GAIN, 20), (v4l2.EXPOSURE, 5))  # inactive: the automatic is on
    assert ext(bench, v4l2.S_EXT_CTRLS, wishes) == (-errno.EACCES, 2)
    assert ext(bench, v4l2.TRY_EXT_CTRLS, wishes) == (-errno.EACCES, 1)
    assert bench.client.get(v4l2.GAIN) == 0


@pytest.mark.parametrize("is_mode_first", [True, False])
def test_a_control_may_be_set_in_the_call_that_switches_its_automatic_off(
    bench: Bench, is_mode_first: bool
) -> None:
    """As uvcvideo has it: the last value of the automatic in the call decides."""
    pairs = [(v4l2.EXPOSURE_AUTO, 1), (v4l2.EXPOSURE, 50)]
    wishes = Array(*(pairs if is_mode_first else pairs[::-1]))
    assert ext(bench, v4l2.S_EXT_CTRLS, wishes) == (0, 2)
    assert bench.client.get(v4l2.EXPOSURE) == 50
    pairs = [(v4l2.EXPOSURE_AUTO, 3), (v4l2.EXPOSURE, 60)]
    wishes = Array(*(pairs if is_mode_first else pairs[::-1]))
    assert ext(bench, v4l2.S_EXT_CTRLS, wishes) == (-errno.EACCES, 2)
    assert bench.client.get(v4l2.EXPOSURE) == 50


def test_extended_controls_of_a_class_refuse_another_classs(bench: Bench) -> None:
    mixed = Array((v4l2.GAIN, 20), (v4l2.EXPOSURE_AUTO, 1))
    assert ext(bench, v4l2.S_EXT_CTRLS, mixed, which=0x00980000) == (-errno.EINVAL, 2)
    only = Array((v4l2.GAIN, 20))
    assert ext(bench, v4l2.S_EXT_CTRLS, only, which=0x00980000) == (0, 1)


def test_defaults_can_be_asked_for_and_not_set(bench: Bench) -> None:
    bench.client.set(v4l2.GAIN, 30)
    asked = Array((v4l2.GAIN, 99))
    assert ext(bench, v4l2.G_EXT_CTRLS, asked, which=0x0F000000) == (0, 1)
    assert asked.values() == [0]
    assert ext(bench, v4l2.S_EXT_CTRLS, asked, which=0x0F000000)[0] == -errno.EINVAL


def test_pointers_that_cannot_be_followed_make_extended_controls_unknown(bench: Bench) -> None:
    data = struct.pack("<5I4xQ", 0, 1, 0, 0, 0, 4096)
    assert refusal(lambda: bench.client.ask(v4l2.G_EXT_CTRLS, data)) == "ENOTTY"


# -- events and priorities --------------------------------------------------------------------


def subscribe(client: Client, cid: int, flags: int = 0) -> None:
    client.ask(v4l2.SUBSCRIBE_EVENT, struct.pack("<III20x", 3, cid, flags))


def test_a_change_by_another_is_an_event(bench: Bench) -> None:
    other_handle, other = bench.open()
    subscribe(other, v4l2.GAIN)
    subscribe(bench.client, v4l2.GAIN)
    bench.client.set(v4l2.GAIN, 42)
    assert bench.device.poll(other_handle) & PRI
    assert not bench.bits & PRI  # who changed it knows
    reply = other.ask(v4l2.DQEVENT, bytes(136))
    assert struct.unpack_from("<I", reply) == (3,)
    assert struct.unpack_from("<IIq", reply, 8) == (1, 1, 42)  # value changed, an integer, to 42
    assert struct.unpack_from("<I", reply, 96) == (v4l2.GAIN,)
    assert refusal(lambda: other.ask(v4l2.DQEVENT, bytes(136))) == "ENOENT"
    assert not bench.device.poll(other_handle) & PRI


def test_events_of_one_control_are_merged_and_the_first_may_be_asked_for(bench: Bench) -> None:
    subscribe(bench.client, v4l2.EXPOSURE, flags=1 | 4)  # SEND_INITIAL, ALLOW_FEEDBACK
    bench.client.set(v4l2.EXPOSURE_AUTO, 1)  # exposure becomes active: its flags change
    bench.client.set(v4l2.EXPOSURE, 33)
    reply = bench.client.ask(v4l2.DQEVENT, bytes(136))
    changes, _, value, flags = struct.unpack_from("<IIqI", reply, 8)
    assert (changes, value, flags) == (1 | 2, 33, 0)
    assert struct.unpack_from("<I", reply, 72) == (0,)  # nothing more is pending


def test_who_unsubscribes_hears_no_more(bench: Bench) -> None:
    subscribe(bench.client, v4l2.GAIN, flags=1)
    bench.client.ask(v4l2.UNSUBSCRIBE_EVENT, bytes(32))  # all
    assert not bench.bits & PRI
    nonsense = struct.pack("<III20x", 2, v4l2.GAIN, 0)
    assert refusal(lambda: bench.client.ask(v4l2.SUBSCRIBE_EVENT, nonsense)) == "EINVAL"


def test_a_recorder_keeps_others_from_changing_anything(bench: Bench) -> None:
    _, other = bench.open()
    bench.client.ask(v4l2.S_PRIORITY, struct.pack("<I", 3))
    assert struct.unpack("<I", other.ask(v4l2.G_PRIORITY, bytes(4))) == (3,)
    assert refusal(lambda: other.set(v4l2.GAIN, 3)) == "EBUSY"
    assert refusal(lambda: other.ask(v4l2.S_PRIORITY, struct.pack("<I", 1))) == "EBUSY"
    assert refusal(lambda: bench.client.ask(v4l2.S_PRIORITY, struct.pack("<I", 7))) == "EINVAL"
    bench.device.close(bench.handle)
    assert other.set(v4l2.GAIN, 3) == 3


# -- buffers ----------------------------------------------------------------------------------


def test_buffers_have_places_of_their_own(bench: Bench) -> None:
    assert bench.client.request_buffers(99) == 8  # as many as it has
    frames = [bench.client.query(index) for index in range(8)]
    assert len({frame.offset_bytes for frame in frames}) == 8
    assert {frame.length_bytes for frame in frames} == {64 * 48}
    assert refusal(lambda: bench.client.query(8)) == "EINVAL"


def test_buffers_are_their_owners(bench: Bench) -> None:
    bench.client.request_buffers(2)
    _, other = bench.open()
    for act in (
        lambda: other.request_buffers(1),
        lambda: other.queue(0),
        other.dequeue,
        other.stream_on,
        other.stream_off,
        lambda: other.set_format(32, 24, "GREY"),
    ):
        assert refusal(act) == "EBUSY"
    assert other.query(0).index == 0  # looking is free
    bench.device.close(bench.handle)
    assert other.request_buffers(1) == 1


def test_a_buffer_is_queued_once(bench: Bench) -> None:
    bench.client.request_buffers(1)
    assert bench.client.queue(0).flags & 0x2
    assert refusal(lambda: bench.client.queue(0)) == "EINVAL"


def test_streaming_needs_buffers_and_dequeuing_needs_streaming(bench: Bench) -> None:
    assert refusal(bench.client.stream_on) == "EINVAL"
    bench.client.request_buffers(1)
    assert refusal(bench.client.dequeue) == "EINVAL"
    bench.client.stream_on()
    assert refusal(bench.client.dequeue) == "EAGAIN"
    assert refusal(lambda: bench.client.request_buffers(2)) == "EBUSY"


def test_user_pointers_are_not_supported(bench: Bench) -> None:
    asked = struct.pack("<5I", 4, 1, 2, 0, 0)  # V4L2_MEMORY_USERPTR
    assert refusal(lambda: bench.client.ask(v4l2.REQBUFS, asked)) == "EINVAL"


def test_poll_tells_streaming_from_waiting_from_ready(bench: Bench) -> None:
    assert bench.bits == ERR  # not streaming
    bench.client.request_buffers(1)
    bench.client.stream_on()
    assert bench.bits == ERR  # nothing was ever queued
    bench.client.queue(0)
    assert bench.bits == 0
    bench.at(0.2)
    assert bench.bits == 0  # the picture is being made
    bench.deliver(0)
    assert bench.bits == IN_RDNORM
    bench.client.dequeue()
    assert bench.bits == 0  # nothing queued, but there was: a reader may wait (videobuf2)
    bench.client.stream_off()
    assert bench.bits == ERR


def test_a_blocking_dequeue_waits_and_a_stopped_stream_ends_it(bench: Bench) -> None:
    bench.device.close(bench.handle)
    _, client = bench.open(is_blocking=True)
    client.start(1)
    with pytest.raises(NotYet):
        client.dequeue()
    bench.memory.woken.clear()
    client.stream_off()
    assert bench.memory.woken == [None]  # who waits shall look again
    assert refusal(client.dequeue) == "EINVAL"


def test_stopping_gives_all_buffers_back(bench: Bench) -> None:
    bench.client.start(3)
    bench.at(0.1)
    bench.client.stream_off()
    bench.deliver(0)  # too late
    assert [bench.client.query(index).flags & 0x6 for index in range(3)] == [0, 0, 0]
    bench.client.queue(1)
    bench.client.stream_on()
    assert bench.bits == 0


# -- unplugging -------------------------------------------------------------------------------


def test_after_unplugging_everything_is_no_device_for_good(bench: Bench) -> None:
    bench.client.start(2)
    bench.device.unplug()
    assert bench.memory.woken[-1] is None
    assert bench.bits == ERR | HUP | PRI  # 0x1a, as uvcvideo answers
    for act in (bench.client.dequeue, bench.client.stream_off, lambda: bench.client.get(v4l2.GAIN)):
        assert refusal(act) == "ENODEV"
    with pytest.raises(Refused):
        bench.device.open()
    bench.device.plug()
    assert refusal(lambda: bench.client.get(v4l2.GAIN)) == "ENODEV"  # the old file stays dead


def test_a_camera_that_was_replugged_has_lost_its_settings(bench: Bench) -> None:
    bench.client.set(v4l2.GAIN, 70)
    bench.client.set_format(32, 24, "MJPG")
    bench.device.unplug()
    bench.device.plug()
    _, client = bench.open()
    assert client.get(v4l2.GAIN) == 0
    assert bench.device.size_px == (64, 48)
    client.start(1)
    assert bench.device.is_streaming


def test_a_picture_of_before_the_unplugging_goes_nowhere(bench: Bench) -> None:
    bench.client.start(2)
    bench.at(0.1)
    bench.device.unplug()
    bench.device.plug()
    handle, client = bench.open()
    client.start(2)
    bench.deliver(0)
    assert bench.device.poll(handle) == 0


def test_a_closed_file_frees_the_camera(bench: Bench) -> None:
    bench.client.start(2)
    bench.device.close(bench.handle)
    assert not bench.device.is_streaming
    device: V4l2Device = bench.device
    assert device.advance(10.0) is None
    assert bench.source.asked == []
