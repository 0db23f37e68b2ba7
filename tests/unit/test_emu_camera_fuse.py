"""The emulated camera as a file: what the kernel makes of the FUSE node for a client."""

import contextlib
import errno
import fcntl
import mmap
import os
import select
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import emu_camera_client as v4l2
import numpy as np
import pytest
from emu_camera_client import Client, Frame, carry_over_file
from emu_camera_process import CameraProcess, cameras, is_mounted

from emulators.camera_v4l2 import can_mount, read_clock_pattern

WHY_NOT = can_mount()
pytestmark = pytest.mark.skipif(WHY_NOT is not None, reason=f"no FUSE: {WHY_NOT}")

PATIENCE_MS = 10_000
SPEED = 4.0
DYING = """
import os, signal, sys
from test_emu_camera_fuse import OpenCamera

file = OpenCamera(sys.argv[1])
file.client.request_buffers(4)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraProcess]:
    """One camera at 10 Hz of a world four times as fast, whose pictures take 30 ms to make."""
    directory = tmp_path_factory.mktemp("cameras") / "dev"
    with cameras(directory, "--rate=10", f"--speed={SPEED}", "--delay=0.03") as running:
        yield running


@pytest.fixture
def camera(process: CameraProcess) -> CameraProcess:
    """The same, as it comes out of its box: plugged in anew, nothing wrong with it."""
    if "video0" in process.state["addresses"]:
        process.tell(unplug="video0")
    process.tell(plug="video0")
    process.tell(faults="video0")
    return process


class OpenCamera:
    """A file of the camera with its buffers mapped."""

    def __init__(self, path: str, flags: int = os.O_NONBLOCK) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_CLOEXEC | flags)
        self.client = Client(carry_over_file(self.fd))
        self.maps: list[mmap.mmap] = []

    def __enter__(self) -> "OpenCamera":
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ConnectionError, OSError):  # the mount may be gone
            os.close(self.fd)
        for mapped in self.maps:
            mapped.close()

    def start(self, buffer_count: int = 4) -> None:
        for index in range(self.client.request_buffers(buffer_count)):
            place = self.client.query(index)
            self.maps.append(mmap.mmap(self.fd, place.length_bytes, offset=place.offset_bytes))
            self.client.queue(index)
        self.client.stream_on()

    def poll(self, timeout_ms: int = PATIENCE_MS) -> int:
        watch = select.poll()
        watch.register(self.fd, select.POLLIN | select.POLLPRI)
        return sum(bits for _, bits in watch.poll(timeout_ms))

    def next(self) -> tuple[Frame, bytes]:
        """Return the next frame and its bytes, its buffer queued again."""
        assert self.poll() & select.POLLIN
        frame = self.client.dequeue()
        data = self.maps[frame.index][: frame.used_bytes]
        self.client.queue(frame.index)
        return frame, data


def test_the_mount_lists_its_cameras_and_nothing_else(tmp_path: Path) -> None:
    with cameras(tmp_path / "dev", "--cameras=3") as several:
        assert several.state["transport"] == "fuse"
        assert several.state["why_not_fuse"] is None
        names = sorted(path.name for path in (tmp_path / "dev").iterdir())
        assert names == ["video0", "video1", "video2"]
        with pytest.raises(FileNotFoundError):
            os.open(tmp_path / "dev" / "video3", os.O_RDWR)
        with OpenCamera(several["video1"]) as one, OpenCamera(several["video2"]) as two:
            one.client.set(v4l2.GAIN, 5)
            assert two.client.get(v4l2.GAIN) == 0


def test_a_frames_picture_is_of_the_exposure_that_its_stamp_tells(camera: CameraProcess) -> None:
    started_s = camera.state["started_wall_s"]
    with OpenCamera(camera["video0"]) as file:
        file.client.set(v4l2.EXPOSURE_AUTO, 1)
        file.client.set(v4l2.EXPOSURE, 400)
        file.start()
        ends_s, numbers = [], []
        for _ in range(8):
            before_s = time.monotonic()
            frame, data = file.next()
            grey = np.frombuffer(data, np.uint8).reshape(1024, 1280)
            start_s, end_s = read_clock_pattern(grey)
            assert end_s - start_s == pytest.approx(0.04, abs=2e-6)
            assert frame.stamp_us * 1e-6 == pytest.approx(started_s + end_s / SPEED, abs=3e-6)
            assert frame.stamp_us * 1e-6 <= time.monotonic()
            assert before_s - frame.stamp_us * 1e-6 < 600.0
            ends_s.append(end_s)
            numbers.append(frame.sequence)
        # a number's distance is the time between exposures, whatever was lost between
        steps_s = np.diff(ends_s)
        assert steps_s == pytest.approx(0.1 * np.diff(numbers), abs=1e-5)


def test_exposure_and_gain_show_in_the_picture(camera: CameraProcess) -> None:
    with OpenCamera(camera["video0"]) as file:
        file.client.set(v4l2.EXPOSURE_AUTO, 1)
        levels = []
        for units, gain in ((20, 0), (40, 0), (20, 100)):
            file.client.set(v4l2.EXPOSURE, units)
            file.client.set(v4l2.GAIN, gain)
            file.start(1)
            levels.append(file.next()[1][700 * 1280])
            file.client.stream_off()
            file.client.request_buffers(0)
    assert levels[1] == pytest.approx(2 * levels[0], abs=1)
    assert levels[2] == pytest.approx(10 * levels[0], abs=5)


def test_poll_and_epoll_wait_for_a_frame_and_time_out_without(camera: CameraProcess) -> None:
    with OpenCamera(camera["video0"]) as file, select.epoll() as epoll:
        epoll.register(file.fd, select.EPOLLIN)
        assert file.poll(0) & select.POLLERR
        camera.tell(faults="video0", is_stalled=True)
        file.start()
        assert file.poll(150) == 0
        camera.tell(faults="video0")
        assert epoll.poll(PATIENCE_MS / 1000) == [(file.fd, select.EPOLLIN)]
        assert file.client.dequeue().sequence > 0


def test_nonblocking_dequeue_says_try_again(camera: CameraProcess) -> None:
    camera.tell(faults="video0", is_stalled=True)
    with OpenCamera(camera["video0"]) as file:
        file.start()
        with pytest.raises(BlockingIOError):
            file.client.dequeue()


def test_blocking_dequeue_waits_for_its_frame(camera: CameraProcess) -> None:
    with OpenCamera(camera["video0"], flags=0) as file:
        file.start()
        for _ in range(3):
            file.client.queue(file.client.dequeue().index)


def test_a_signal_ends_a_blocking_dequeue(camera: CameraProcess) -> None:
    camera.tell(faults="video0", is_stalled=True)
    heard = []
    old = signal.signal(signal.SIGUSR1, lambda *_: heard.append(True))
    try:
        with OpenCamera(camera["video0"], flags=0) as file:
            file.start()
            main = threading.main_thread().ident or 0
            alarm = threading.Timer(0.2, signal.pthread_kill, (main, signal.SIGUSR1))
            alarm.start()
            with pytest.raises(InterruptedError):
                file.client.dequeue()
            alarm.join()
            assert heard == [True]
            assert file.client.get(v4l2.GAIN) == 0  # the file lives on
    finally:
        signal.signal(signal.SIGUSR1, old)


def test_unplugging_ends_a_blocking_dequeue_and_everything_else(camera: CameraProcess) -> None:
    camera.tell(faults="video0", is_stalled=True)
    path = Path(camera["video0"])
    with OpenCamera(str(path), flags=0) as file:
        file.start()
        pull = threading.Timer(0.2, camera.tell, kwargs={"unplug": "video0"})
        pull.start()
        with pytest.raises(OSError) as caught:  # noqa: PT011 - its number is looked at
            file.client.dequeue()
        pull.join()
        assert caught.value.errno == errno.ENODEV
        assert file.poll() == 0x1A  # POLLERR, POLLHUP, POLLPRI, as the kernel's own uvcvideo
        assert not path.exists()


def test_a_camera_comes_back_under_another_number(camera: CameraProcess) -> None:
    with OpenCamera(camera["video0"]) as old:
        old.start()
        camera.tell(unplug="video0")
        camera.tell(plug="video0", **{"as": "video3"})
        assert camera["video0"].endswith("/video3")
        with OpenCamera(camera["video0"]) as new:
            new.start()
            assert new.next()[0].used_bytes == 1280 * 1024
        with pytest.raises(OSError, match="No such device"):
            old.client.dequeue()


def test_a_camera_comes_back_under_its_name_while_the_old_file_is_open(
    camera: CameraProcess,
) -> None:
    with OpenCamera(camera["video0"]) as old:
        old.start()
        camera.tell(unplug="video0")
        camera.tell(plug="video0")
        with OpenCamera(camera["video0"]) as new:
            new.start()
            assert new.next()[0].used_bytes == 1280 * 1024
        assert old.poll() == 0x1A


def test_a_client_that_dies_frees_the_camera(camera: CameraProcess) -> None:
    dying = (sys.executable, "-c", DYING, camera["video0"])
    path = os.pathsep.join(sys.path)
    died = subprocess.run(dying, env=os.environ | {"PYTHONPATH": path}, check=False)
    assert died.returncode == -signal.SIGKILL
    with OpenCamera(camera["video0"]) as file:
        file.start()
        assert file.next()[0].used_bytes == 1280 * 1024


def test_extended_controls_reach_into_the_clients_memory(camera: CameraProcess) -> None:
    array = bytearray(struct.pack("<IIIq", v4l2.GAIN, 0, 0, 33))
    address = np.frombuffer(array, np.uint8).ctypes.data
    with OpenCamera(camera["video0"]) as file:
        data = bytearray(struct.pack("<5I4xQ", 0, 1, 0, 0, 0, address))
        fcntl.ioctl(file.fd, v4l2.S_EXT_CTRLS, data)
        assert file.client.get(v4l2.GAIN) == 33
        bad = bytearray(struct.pack("<5I4xQ", 0, 1, 0, 0, 0, 16))
        with pytest.raises(OSError, match="Bad address"):
            fcntl.ioctl(file.fd, v4l2.G_EXT_CTRLS, bad)


def test_an_event_is_exceptional_data_to_poll(camera: CameraProcess) -> None:
    with OpenCamera(camera["video0"]) as file, OpenCamera(camera["video0"]) as other:
        file.client.ask(v4l2.SUBSCRIBE_EVENT, struct.pack("<III20x", 3, v4l2.GAIN, 0))
        watch = select.poll()
        watch.register(file.fd, select.POLLPRI)
        other.client.set(v4l2.GAIN, 9)
        assert watch.poll(PATIENCE_MS)[0][1] & select.POLLPRI
        reply = file.client.ask(v4l2.DQEVENT, bytes(136))
        assert struct.unpack_from("<q", reply, 16) == (9,)


def test_a_killed_emulator_hangs_nobody_and_its_successor_takes_over(tmp_path: Path) -> None:
    directory = tmp_path / "dev"
    with cameras(directory) as killed, OpenCamera(killed["video0"]) as file:
        file.start()
        killed.is_killed = True
        os.kill(killed.pid, signal.SIGKILL)
        assert file.poll() & select.POLLERR
        with pytest.raises(OSError, match=r"not connected|abort"):
            file.client.get(v4l2.GAIN)
        with cameras(directory) as successor, OpenCamera(successor["video0"]) as again:
            again.start()
            assert again.next()[0].used_bytes == 1280 * 1024


def test_a_terminated_emulator_takes_its_mount_with_it(tmp_path: Path) -> None:
    with cameras(tmp_path / "dev") as process:
        os.kill(process.pid, signal.SIGTERM)
    assert not is_mounted(tmp_path / "dev")


@pytest.mark.parametrize(("fourcc", "size"), [("YUYV", 2621440), ("Y16 ", 2621440)])
def test_the_two_byte_formats_arrive_whole(camera: CameraProcess, fourcc: str, size: int) -> None:
    with OpenCamera(camera["video0"]) as file:
        assert file.client.set_format(1280, 1024, fourcc)[4] == size
        file.start(2)
        frame, data = file.next()
        grey = np.frombuffer(data, np.uint8).reshape(1024, 1280, 2)[..., 0]
        start_s, end_s = read_clock_pattern(grey)
        assert frame.used_bytes == size
        assert 0 < end_s - start_s <= 0.1
