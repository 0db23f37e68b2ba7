"""What opening a camera decides: its identity, format, rate and controls."""

import errno
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path

import numpy as np
import pytest
from camera_fakes import FakeCalls, FakeCamera, FakeControl

from drivers.camera_v4l2 import (
    Camera,
    CameraConfig,
    ControlSetting,
    KernelCalls,
    SocketCalls,
    find_node,
    list_nodes,
    system_calls_for,
)
from drivers.clock import REAL_TIME
from drivers.errors import BadReplyError, LinkError, RefusedError, WrongDeviceError

EXPOSURE, AUTO_EXPOSURE, GAIN = 0x009A0902, 0x009A0901, 0x00980913
WB_AUTO, WB_KELVIN = 0x0098090C, 0x0098091A


@pytest.fixture
def fake() -> FakeCamera:
    return FakeCamera(8, 4)


Connect = Callable[..., Awaitable[Camera]]


@pytest.fixture
async def connect(fake: FakeCamera) -> AsyncIterator[Connect]:
    cameras: list[Camera] = []
    calls = FakeCalls(fake)

    async def connected(**changes: object) -> Camera:
        values: dict[str, object] = {"device": "/dev/video0", "width": 8, "height": 4}
        config = CameraConfig(**{**values, **changes})  # type: ignore[arg-type]  # a shorthand
        camera = Camera(config, REAL_TIME, calls)
        await camera.connect()
        cameras.append(camera)
        return camera

    yield connected
    for camera in cameras:
        await camera.close()
    assert calls.is_all_released


def setting(camera: Camera, control: int) -> ControlSetting:
    (found,) = (s for s in camera.settings if s.control == control)
    return found


# -- what it is -----------------------------------------------------------------------------------


async def test_the_camera_says_who_it_is(connect: Connect) -> None:
    who = (await connect()).identity()
    assert (who.driver, who.card, who.bus) == ("fake", "Scripted Camera", "usb-0000:00:14.0-1")
    assert who.version == "6.1.2"  # 0x060102
    assert who.node == "/dev/video0"


async def test_a_metadata_node_is_refused_and_named(fake: FakeCamera, connect: Connect) -> None:
    fake.device_caps = 0x04800000  # META_CAPTURE and STREAMING, as uvcvideo's second node
    with pytest.raises(WrongDeviceError, match=r"Scripted Camera.*META_CAPTURE"):
        await connect()


async def test_a_node_without_streaming_is_refused(fake: FakeCamera, connect: Connect) -> None:
    fake.device_caps = 0x01000001  # VIDEO_CAPTURE and READWRITE
    with pytest.raises(WrongDeviceError, match=r"VIDEO_CAPTURE, READWRITE"):
        await connect()


async def test_an_old_driver_without_device_caps_is_judged_by_its_capabilities(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.capabilities, fake.device_caps = 0x04000001, 0
    assert (await connect()).is_connected


async def test_a_file_that_is_no_device_is_refused(tmp_path: Path) -> None:
    (tmp_path / "video0").write_text("no camera")
    camera = Camera(CameraConfig(str(tmp_path / "video0")))
    with pytest.raises(WrongDeviceError, match="not a V4L2 node"):
        await camera.connect()
    with pytest.raises(LinkError, match="no camera is plugged in"):
        await Camera(CameraConfig(str(tmp_path / "video1"))).connect()
    with pytest.raises(WrongDeviceError, match="not a V4L2 node"):
        await Camera(CameraConfig(str(tmp_path))).connect()


def test_the_address_chooses_the_system_calls() -> None:
    assert isinstance(system_calls_for("unix:/run/camera.sock"), SocketCalls)
    assert isinstance(system_calls_for("/dev/video0"), KernelCalls)
    assert isinstance(system_calls_for("serial:A1"), KernelCalls)


# -- format and rate ------------------------------------------------------------------------------


async def test_the_first_wanted_format_on_offer_is_taken(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.formats = ("MJPG", "YUYV", "Y16")
    await connect()
    assert fake.format[0] == "Y16"


async def test_the_order_of_preference_is_the_callers(fake: FakeCamera, connect: Connect) -> None:
    fake.formats = ("MJPG", "YUYV", "Y16")
    await connect(pixel_formats=("GREY", "YUYV", "Y16"))
    assert fake.format[0] == "YUYV"


async def test_a_camera_without_a_readable_format_is_refused(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.formats = ("H264", "NV12")
    with pytest.raises(WrongDeviceError, match="offers H264, NV12"):
        await connect()


async def test_the_cameras_answer_counts_not_the_wish(
    fake: FakeCamera, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    fake.formats, fake.row_padding = ("YUYV",), 6
    camera = await connect(width=640, height=480, settle_frame_count=0)
    assert camera.shape == (4, 8)
    assert "640 x 480 px required, it sends 8 x 4 px" in caplog.text
    luma = np.arange(32, dtype=np.uint8).reshape(4, 8)
    rows = [bytes(b for value in row for b in (value, 128)) + b"\xee" * 6 for row in luma.tolist()]
    now_s = REAL_TIME.now_s()
    fake.finish(b"".join(rows), now_s + 0.1)
    frame = await camera.frame_after(now_s)
    np.testing.assert_array_equal(frame.image, luma)


async def test_a_format_that_came_back_unreadable_is_refused(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.forced_format = "NV12"
    with pytest.raises(WrongDeviceError, match="NV12"):
        await connect()


async def test_interlaced_pictures_are_refused(fake: FakeCamera, connect: Connect) -> None:
    fake.field_order = 4  # V4L2_FIELD_INTERLACED
    with pytest.raises(WrongDeviceError, match="interlaced"):
        await connect()


async def test_rows_shorter_than_the_picture_are_a_bad_reply(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.row_padding = -1
    with pytest.raises(BadReplyError, match="7 a row"):
        await connect()


async def test_the_rate_granted_is_used(
    fake: FakeCamera, connect: Connect, caplog: pytest.LogCaptureFixture
) -> None:
    fake.granted_period = (1, 15)
    camera = await connect(fps=30)
    assert camera.frame_period_s == pytest.approx(1 / 15)
    assert "30 fps required, it sends 15" in caplog.text


@pytest.mark.parametrize("code", [errno.ENOTTY, errno.EINVAL])
async def test_a_camera_without_a_settable_rate_is_taken_at_the_wish(
    fake: FakeCamera, connect: Connect, code: int
) -> None:
    fake.fail("S_PARM", code)
    assert (await connect(fps=25)).frame_period_s == pytest.approx(0.04)


async def test_fewer_than_two_buffers_do_not_do(fake: FakeCamera, connect: Connect) -> None:
    fake.granted_buffers = 1
    with pytest.raises(RefusedError, match="1 buffers granted of 4"):
        await connect()


async def test_fewer_buffers_than_asked_for_are_used(fake: FakeCamera, connect: Connect) -> None:
    fake.granted_buffers = 2
    await connect()
    assert fake.queued == [0, 1]


@pytest.mark.parametrize(
    "changes",
    [
        {"pixel_formats": ()},
        {"pixel_formats": ("RGB3",)},
        {"width": 0},
        {"fps": 0.0},
        {"exposure_s": 0.0},
        {"buffer_count": 1},
    ],
)
def test_a_configuration_that_cannot_work_is_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        CameraConfig("/dev/video0", **changes)  # type: ignore[arg-type]  # wrong on purpose


# -- controls -------------------------------------------------------------------------------------


async def test_the_automatics_are_off_before_the_values_are_set(
    fake: FakeCamera, connect: Connect
) -> None:
    # the scripted camera refuses a value (EACCES) while its automatic is on
    camera = await connect(exposure_s=0.008, gain=33, white_balance_k=5000)
    values = {cid: control.value for cid, control in fake.controls.items()}
    assert values == {AUTO_EXPOSURE: 1, EXPOSURE: 80, GAIN: 33, WB_AUTO: 0, WB_KELVIN: 5000}
    assert not [s.problem for s in camera.settings if s.problem]
    assert camera.exposure_s == pytest.approx(0.008)


async def test_no_wish_keeps_the_exposure_and_still_locks_it(
    fake: FakeCamera, connect: Connect
) -> None:
    camera = await connect()
    assert fake.controls[AUTO_EXPOSURE].value == 1
    assert camera.exposure_s == pytest.approx(0.0157)


async def test_a_clamped_value_is_noticed(fake: FakeCamera, connect: Connect) -> None:
    camera = await connect(exposure_s=0.9)  # uvcvideo clamps without a word, v4l2.md 6
    assert "9000 required, the camera took 5000 (range 1..5000" in setting(camera, EXPOSURE).problem
    assert camera.exposure_s == pytest.approx(0.5)


async def test_a_value_between_two_steps_is_no_problem(fake: FakeCamera, connect: Connect) -> None:
    fake.controls[WB_KELVIN].is_deaf = True  # stays at 4600, the raster's nearest
    camera = await connect(white_balance_k=4604)
    assert setting(camera, WB_KELVIN).problem == ""


async def test_one_control_that_fails_hides_no_other(fake: FakeCamera, connect: Connect) -> None:
    fake.controls[GAIN].read_error = errno.EPIPE
    camera = await connect(exposure_s=0.008, gain=5)
    assert "EPIPE" in setting(camera, GAIN).problem
    assert setting(camera, EXPOSURE).problem == ""
    assert setting(camera, WB_AUTO).got == 0


async def test_a_wish_the_camera_has_no_control_for_is_told(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.controls.clear()
    camera = await connect(exposure_s=0.008)
    assert "no such control" in setting(camera, EXPOSURE).problem
    assert setting(camera, AUTO_EXPOSURE).problem == ""  # nothing there to switch off
    assert camera.exposure_s is None


async def test_an_automatic_that_stays_on_leaves_the_exposure_unknown(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.controls[AUTO_EXPOSURE].is_deaf = True
    camera = await connect(exposure_s=0.008)
    assert "EACCES" in setting(camera, EXPOSURE).problem
    assert "automatic" in setting(camera, EXPOSURE).problem
    assert camera.exposure_s is None


async def test_setting_an_exposure_that_is_refused_raises_with_the_cause(
    fake: FakeCamera, connect: Connect
) -> None:
    camera = await connect()
    with pytest.raises(RefusedError, match=r"range 1\.\.5000") as caught:
        await camera.set_exposure(3.0)
    assert caught.value.code == errno.ERANGE
    fake.controls[AUTO_EXPOSURE].value = 3
    with pytest.raises(RefusedError, match="automatic") as caught:
        await camera.set_exposure(0.01)
    assert caught.value.code == errno.EACCES
    with pytest.raises(ValueError, match="exposure of 0"):
        await camera.set_exposure(0)


async def test_the_list_of_controls_has_ranges_menus_and_what_failed(
    fake: FakeCamera, connect: Connect
) -> None:
    fake.controls[0x00980001] = FakeControl("User Controls", 0, type=6)  # a heading
    fake.controls[0x00980900] = FakeControl("Disabled", 0, flags=1)
    fake.controls[0x0098F000] = FakeControl("Button", 0, type=4)
    fake.controls[0x0098F001] = FakeControl("Odd", 0, type=0x106)
    fake.controls[GAIN].read_error = errno.EIO
    camera = await connect()
    listed = {info.name: info for info in await camera.controls()}
    assert "User Controls" not in listed
    assert "Disabled" not in listed
    exposure = listed["Exposure Time, Absolute"]
    assert (exposure.minimum, exposure.maximum, exposure.value) == (1, 5000, 157)
    assert exposure.kind == "integer"
    assert dict(listed["Auto Exposure"].menu) == {1: "Manual Mode", 3: "Aperture Priority Mode"}
    assert "EIO" in listed["Gain"].problem
    assert listed["Button"].value is None
    assert listed["Odd"].kind == str(0x106)
    fake.controls[AUTO_EXPOSURE].value = 3
    assert {i.name: i for i in await camera.controls()}["Exposure Time, Absolute"].is_inactive


# -- discovery ------------------------------------------------------------------------------------


def plug(
    sysfs: Path, port: str, serial: str, first: int, nodes: int = 2, name: str = "Cam"
) -> None:
    """Make a UVC camera's corner of sysfs as the kernel lays it out."""
    usb = sysfs / "devices/pci0000:00/0000:00:14.0/usb1" / port
    interface = usb / f"{port}:1.0"
    interface.mkdir(parents=True)
    (usb / "idVendor").write_text("046d\n")
    if serial:
        (usb / "serial").write_text(serial + "\n")
    classes = sysfs / "class" / "video4linux"
    classes.mkdir(parents=True, exist_ok=True)
    for index in range(nodes):
        node = interface / "video4linux" / f"video{first + index}"
        node.mkdir(parents=True)
        (node / "name").write_text(name + "\n")
        (node / "index").write_text(f"{index}\n")
        (node / "device").symlink_to(interface)
        (classes / node.name).symlink_to(node)


@pytest.fixture
def sysfs(tmp_path: Path) -> Path:
    plug(tmp_path, "1-2.3", "A1", 10)
    plug(tmp_path, "1-4", "B2", 2)
    return tmp_path


DEV = Path("/dev")


def test_a_camera_is_found_by_serial_and_by_port_at_its_capture_node(sysfs: Path) -> None:
    assert find_node("serial:A1", DEV, sysfs) == "/dev/video10"
    assert find_node("usb:1-2.3", DEV, sysfs) == "/dev/video10"
    assert find_node("serial:B2", Path("/other"), sysfs) == "/other/video2"


def test_nodes_are_listed_in_the_order_of_their_numbers(sysfs: Path) -> None:
    nodes = list_nodes(DEV, sysfs)
    assert [(n.path, n.index, n.serial, n.port) for n in nodes] == [
        ("/dev/video2", 0, "B2", "1-4"),
        ("/dev/video3", 1, "B2", "1-4"),
        ("/dev/video10", 0, "A1", "1-2.3"),
        ("/dev/video11", 1, "A1", "1-2.3"),
    ]


def test_a_path_and_a_socket_are_taken_as_they_are(sysfs: Path) -> None:
    assert find_node("/dev/video7", DEV, sysfs) == "/dev/video7"
    assert find_node("unix:/run/c.sock", DEV, sysfs) == "unix:/run/c.sock"


def test_a_camera_that_is_not_there_is_told_with_those_that_are(sysfs: Path) -> None:
    with pytest.raises(LinkError, match=r"video2 'Cam' serial B2.*video10 'Cam' serial A1"):
        find_node("serial:C3", DEV, sysfs)
    with pytest.raises(LinkError, match="cameras there: none"):
        find_node("serial:C3", DEV, sysfs / "nowhere")


def test_two_cameras_of_one_serial_are_not_guessed_between(sysfs: Path) -> None:
    plug(sysfs, "1-5", "A1", 20)
    with pytest.raises(WrongDeviceError, match="2 cameras answer"):
        find_node("serial:A1", DEV, sysfs)


@pytest.mark.parametrize("address", ["", "video0", "serial:", "usb:"])
def test_an_address_that_names_nothing_is_refused(sysfs: Path, address: str) -> None:
    with pytest.raises(ValueError, match="camera address"):
        find_node(address, DEV, sysfs)


async def test_a_camera_replugged_under_another_number_is_found_by_its_serial(
    tmp_path: Path,
) -> None:
    plug(tmp_path, "1-2", "S9", 1)
    fake = FakeCamera(8, 4)
    calls = FakeCalls(fake, "/dev/video1")
    camera = Camera(CameraConfig("serial:S9", sysfs_root=tmp_path), REAL_TIME, calls)
    await camera.connect()
    assert camera.identity().node == "/dev/video1"
    fake.unplug()
    with pytest.raises(LinkError):
        await camera.frame_after(0.0)
    for link in (tmp_path / "class/video4linux").iterdir():
        link.unlink()
    plug(tmp_path, "1-3", "S9", 5)
    calls.nodes = {"/dev/video5": FakeCamera(8, 4)}
    await camera.reconnect(1.0)
    assert camera.identity().node == "/dev/video5"
    await camera.close()
    assert calls.is_all_released
