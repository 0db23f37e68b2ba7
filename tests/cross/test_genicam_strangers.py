"""Clients that nobody here wrote drive the emulated GigE Vision camera: aravis and its programs."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "unit"))  # the helper that starts the cameras

from aravis_client import SOFTWARE, SUCCESS, AravisError, library, opened
from emu_camera_process import CameraProcess
from emu_genicam_process import genicam_cameras

from emulators.clock_pattern import NORMAL_EXPOSURE_S, NORMAL_LEVEL, read_clock_pattern

PATIENCE_S = 300.0
# A frame of 16 bits is 70 packets, of which a client's socket holds some 90: none is lost because
# a busy machine lets the client wait.
SMALL = ("--width=320", "--height=160", "--rate=10")
LIBRARY = library()
needs_aravis = pytest.mark.skipif(LIBRARY is None, reason="libaravis-0.8 is not installed")


def program(name: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(shutil.which(name) is None, reason=f"{name} is not installed")


@pytest.fixture(scope="module")
def cameras() -> Iterator[CameraProcess]:
    with genicam_cameras("overhead", "inspection", *SMALL) as process:
        yield process


@pytest.fixture
def overhead(cameras: CameraProcess) -> str:
    return cameras["overhead"]


@pytest.fixture
def lib() -> ctypes.CDLL:
    assert LIBRARY is not None
    return LIBRARY


def said(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=True)
    return done.stdout


def counts(text: str) -> dict[str, int]:
    """Return the counts that `arv-camera-test` prints at its end."""
    return {name: int(number) for name, number in re.findall(r"^(n_\w+) *= (\d+)$", text, re.M)}


# --- aravis' own programs -------------------------------------------------------------------------


@program("arv-tool-0.8")
def test_arv_tool_reads_and_sets_features(overhead: str) -> None:
    out = said(
        *("arv-tool-0.8", "-a", overhead, "control", "DeviceUserID", "Width=128", "PixelFormat"),
        *("GevCCP", "TimestampLatch=", "TimestampLatchValue", "Width=320"),
    )
    assert "DeviceUserID = overhead" in out
    assert "Width = 128" in out
    assert "PixelFormat = Mono8" in out
    assert "GevCCP = ControlAccess" in out
    latched = re.search(r"TimestampLatchValue = (\d+)", out)
    assert latched is not None
    assert int(latched[1]) > 0


@program("arv-tool-0.8")
def test_arv_tool_finds_every_camera_that_is_plugged_in(cameras: CameraProcess) -> None:
    out = said("arv-tool-0.8")
    for name in ("overhead", "inspection"):
        last = int(cameras[name].rpartition(".")[2])
        assert f"Emulated-EG-1-E{last:06} ({cameras[name]})" in out
    cameras.tell(unplug="inspection")
    out = said("arv-tool-0.8")
    cameras.tell(plug="inspection")
    assert cameras["overhead"] in out
    assert cameras["inspection"] not in out


FREE_RUN = ("--features", "TriggerMode=Off")  # a camera keeps what the client before has set


@program("arv-camera-test-0.8")
@pytest.mark.parametrize("options", [FREE_RUN, ("-i", "8000", *FREE_RUN), ("-o", "10")])
def test_arv_camera_test_gets_every_frame_whole(overhead: str, options: tuple[str, ...]) -> None:
    size = ("-w", "320", "-h", "160", "--duration", "2")
    count = counts(said("arv-camera-test-0.8", "-n", overhead, *size, *options))
    assert count["n_completed_buffers"] >= 5
    losses = ("n_failures", "n_error_packets", "n_size_mismatch_errors")
    assert {name: count[name] for name in losses} == dict.fromkeys(losses, 0)


@program("arv-camera-test-0.8")
def test_packets_that_a_cable_loses_are_asked_for_again(
    cameras: CameraProcess, overhead: str
) -> None:
    cameras.tell(faults="overhead", lost_per_thousand=50)
    try:
        size = ("-w", "320", "-h", "160", "--duration", "3")
        count = counts(said("arv-camera-test-0.8", "-n", overhead, *size, *FREE_RUN))
    finally:
        cameras.tell(faults="overhead", lost_per_thousand=0)
    assert count["n_resent_packets"] >= 10
    assert count["n_completed_buffers"] >= 10 * max(1, count["n_failures"])


# --- a client of the test's own -------------------------------------------------------------------


@needs_aravis
@pytest.mark.parametrize(
    ("pixel_format", "full"), [("Mono8", 255), ("Mono12", 4095), ("Mono16", 65535)]
)
def test_each_trigger_brings_one_frame_exposed_after_it(
    lib: ctypes.CDLL, overhead: str, pixel_format: str, full: int
) -> None:
    with opened(lib, overhead) as camera:
        camera.steady(PixelFormat=pixel_format, ExposureTime=NORMAL_EXPOSURE_S * 1e6)
        camera.set(**SOFTWARE)
        camera.start()
        ends_s, numbers = [0.0], []
        for _ in range(5):
            shot = camera.triggered()
            assert shot.status == SUCCESS
            grey = np.rint(shot.picture * (255.0 / full)).astype(np.uint8)
            start_s, end_s = read_clock_pattern(grey)
            assert start_s >= ends_s[-1]  # no light from before the trigger
            assert end_s - start_s == pytest.approx(NORMAL_EXPOSURE_S, abs=2e-6)
            assert grey[150, 160] == pytest.approx(NORMAL_LEVEL, abs=1)
            ends_s.append(end_s)
            numbers.append(shot.number)
        assert numbers == list(range(numbers[0], numbers[0] + 5))
        assert camera.shot(patience_us=200_000) is None  # and no other one


@needs_aravis
def test_lost_packets_are_resent_into_a_whole_frame(
    cameras: CameraProcess, lib: ctypes.CDLL, overhead: str
) -> None:
    with opened(lib, overhead) as camera:
        camera.steady(GevSCPSPacketSize=1500, **SOFTWARE)
        camera.start()
        whole = camera.triggered()
        cameras.tell(faults="overhead", lost_packet_count=7)
        again = camera.triggered()
        assert (whole.status, again.status) == (SUCCESS, SUCCESS)
        assert np.array_equal(whole.picture[10:], again.picture[10:])
        assert camera.resends() >= 7


@needs_aravis
def test_a_frame_that_stays_incomplete_is_no_success(
    cameras: CameraProcess, lib: ctypes.CDLL, overhead: str
) -> None:
    with opened(lib, overhead) as camera:
        camera.steady(**SOFTWARE)
        camera.start()
        cameras.tell(faults="overhead", short_count=1)
        assert camera.triggered().status != SUCCESS
        assert camera.triggered().status == SUCCESS


@needs_aravis
def test_a_frame_lost_in_the_camera_leaves_a_gap_in_the_numbers(
    cameras: CameraProcess, lib: ctypes.CDLL, overhead: str
) -> None:
    with opened(lib, overhead) as camera:
        camera.steady(**SOFTWARE)
        camera.start()
        first = camera.triggered()
        cameras.tell(faults="overhead", lost_count=1)
        camera.do("TriggerSoftware")
        assert camera.shot(patience_us=200_000) is None
        assert camera.triggered().number == first.number + 2


@needs_aravis
def test_a_camera_that_another_client_controls_takes_no_settings(
    lib: ctypes.CDLL, overhead: str
) -> None:
    with opened(lib, overhead) as first, opened(lib, overhead) as second:
        first.set(Height=96)
        with pytest.raises(AravisError, match="access-denied"):
            second.set(Height=128)
        assert second.number("Height") == 96
        assert second.number("GevPrimaryApplicationIPAddress") == 0x7F000001


@needs_aravis
def test_a_camera_held_by_another_host_tells_which(
    cameras: CameraProcess, lib: ctypes.CDLL, overhead: str
) -> None:
    cameras.tell(faults="overhead", held_by="192.0.2.7")
    try:
        with opened(lib, overhead) as camera:
            assert camera.number("GevPrimaryApplicationIPAddress") == 0xC0000207
            with pytest.raises(AravisError):
                camera.start()
    finally:
        cameras.tell(faults="overhead", held_by="")


@needs_aravis
def test_a_camera_keeps_its_settings_between_clients(lib: ctypes.CDLL, overhead: str) -> None:
    with opened(lib, overhead) as camera:
        camera.steady(ExposureTime=4321.0, **SOFTWARE)
    with opened(lib, overhead) as camera:
        assert camera.value("ExposureTime") == 4321.0
        assert camera.text("TriggerMode") == "On"


@needs_aravis
def test_an_unplugged_camera_is_not_found_and_returns_as_at_power_up(
    cameras: CameraProcess, lib: ctypes.CDLL
) -> None:
    address = cameras["inspection"]
    with opened(lib, address) as camera:
        camera.steady(**SOFTWARE)
    cameras.tell(unplug="inspection")
    with pytest.raises(AravisError):
        opened(lib, address).__enter__()
    cameras.tell(plug="inspection")
    assert cameras["inspection"] == address
    with opened(lib, address) as camera:
        assert (camera.text("TriggerMode"), camera.text("ExposureAuto")) == ("Off", "Continuous")


@needs_aravis
def test_a_client_on_the_wall_clock_keeps_control_of_a_cell_at_ten_times_the_speed(
    lib: ctypes.CDLL,
) -> None:
    # ten frames of 0.5 s of exposure at ten times the speed: more of the cell's time than a
    # heartbeat time-out, less of the wall clock's
    with (
        genicam_cameras("overhead", "--speed=10", *SMALL) as fast,
        opened(lib, fast["overhead"]) as camera,
    ):
        camera.steady(ExposureTime=500_000.0, **SOFTWARE)
        camera.start()
        stamps = [camera.triggered().timestamp_ns for _ in range(10)]
        assert stamps[-1] - stamps[0] > 3 * 10**9
        assert camera.text("GevCCP") == "ControlAccess"
