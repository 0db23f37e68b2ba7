"""The emulated camera over a unix socket: the same ioctls, a memfd for frames, a pipe for poll."""

import errno
import mmap
import os
import select
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import emu_camera_client as v4l2
import pytest
from emu_camera_bench import Bench
from emu_camera_client import Client, Frame, carry_over_socket, exchange

from emulators.camera_v4l2 import CameraServer, SocketCamera

IOCTL, MMAP, EVENTS = 1, 2, 3
PATIENCE_S = 600.0
PIPE_BYTES = 65536  # what a pipe holds, pipe(7)


class Connection:
    """A client of the socket."""

    def __init__(self, path: Path) -> None:
        self.link = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.link.settimeout(PATIENCE_S)
        try:
            self.link.connect(str(path))
        except OSError:
            self.link.close()
            raise
        self.client = Client(carry_over_socket(self.link))
        self._fds: list[int] = []

    def __enter__(self) -> "Connection":
        return self

    def __exit__(self, *_: object) -> None:
        self.link.close()
        for fd in self._fds:
            os.close(fd)

    def fd_for(self, kind: int, payload: bytes = b"") -> int:
        result, data, fds = exchange(self.link, kind, 0, payload)
        assert (result, data, len(fds)) == (0, b"", 1)
        self._fds += fds
        return fds[0]

    def bytes_of(self, frame: Frame) -> bytes:
        fd = self.fd_for(MMAP, struct.pack("<QQ", frame.length_bytes, frame.offset_bytes))
        with mmap.mmap(
            fd, frame.length_bytes, prot=mmap.PROT_READ, offset=frame.offset_bytes
        ) as mapped:
            return mapped[: frame.used_bytes]

    def hear(self, event_fd: int) -> bytes:
        """Return what the event pipe says next, b"" at its end."""
        ready, _, _ = select.select([event_fd], [], [], PATIENCE_S)
        assert ready
        return os.read(event_fd, 100)


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.device.close(bench.handle)
    return bench


@pytest.fixture
def path(bench: Bench, tmp_path: Path) -> Iterator[Path]:
    """Where the bench's camera listens; no thread and no file descriptor survives."""
    fds, threads = len(os.listdir("/proc/self/fd")), threading.active_count()  # noqa: PTH208 - a count
    camera = SocketCamera(bench.device, tmp_path / "video0.sock")
    camera.open()
    yield camera.path
    camera.close()
    assert threading.active_count() == threads
    assert len(os.listdir("/proc/self/fd")) == fds  # noqa: PTH208 - a count
    assert not camera.path.exists()


def test_a_frame_comes_with_its_bytes_and_one_byte_of_notice(bench: Bench, path: Path) -> None:
    with Connection(path) as file:
        events = file.fd_for(EVENTS)
        file.client.start(2)
        bench.at(0.1)
        bench.deliver(0, level=7)
        assert len(file.hear(events)) == 1
        frame = file.client.dequeue()
        assert file.bytes_of(frame) == bytes([7]) * (64 * 48)
        with pytest.raises(BlockingIOError):
            file.client.dequeue()  # never waits here
        file.client.queue(frame.index)
        bench.at(0.2)
        bench.at(0.3)
        bench.deliver(1)
        bench.deliver(2)
        assert len(file.hear(events)) == 2


def test_each_buffer_has_its_place_in_the_memory(bench: Bench, path: Path) -> None:
    with Connection(path) as file:
        file.client.start(3)
        for number in range(3):
            bench.at(0.1 * (number + 1))
            bench.deliver(number, level=50 + number)
        frames = [file.client.dequeue() for _ in range(3)]
        assert [file.bytes_of(frame)[0] for frame in frames] == [50, 51, 52]


def test_a_client_that_hangs_up_frees_the_camera(bench: Bench, path: Path) -> None:
    with Connection(path) as first, Connection(path) as second:
        first.client.start(2)
        with pytest.raises(OSError, match="busy"):
            second.client.request_buffers(2)
        first.link.close()
        asked = struct.pack("<5I", 2, 1, 1, 0, 0)
        while (answer := second.client.carry(v4l2.REQBUFS, asked))[0] == -errno.EBUSY:
            pass  # the hanging up travels on a thread of its own
        assert answer[0] == 0
        assert not bench.device.is_streaming


def test_closing_waits_for_a_client_that_left_a_moment_ago(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leaves, closed, order = threading.Event(), threading.Event(), list[str]()

    def close_slowly(number: int) -> None:
        leaves.set()
        closed.wait(0.2)  # longer than a camera takes that does not wait
        order.append("file closed")

    camera = SocketCamera(bench.device, tmp_path / "video1.sock")
    camera.open()
    monkeypatch.setattr(bench.device, "close", close_slowly)
    with Connection(camera.path) as file:
        assert file.client.get(v4l2.GAIN) == 0
    assert leaves.wait(PATIENCE_S)
    camera.close()
    order.append("camera closed")
    closed.set()
    assert order == ["file closed", "camera closed"]


def test_unplugging_ends_the_events_and_every_ioctl_says_no_device(
    bench: Bench, path: Path
) -> None:
    with Connection(path) as file:
        events = file.fd_for(EVENTS)
        file.client.start(2)
        bench.device.unplug()
        assert file.hear(events) == b""
        for request in (v4l2.DQBUF, v4l2.QUERYCAP, v4l2.STREAMOFF):
            size = request >> 16 & 0x3FFF
            assert exchange(file.link, IOCTL, request, bytes(size))[0] == -errno.ENODEV
        assert exchange(file.link, EVENTS, 0, b"") == (-errno.ENODEV, b"", [])
        assert exchange(file.link, MMAP, 0, struct.pack("<QQ", 1, 0)) == (-errno.ENODEV, b"", [])
        bench.device.plug()
        assert exchange(file.link, IOCTL, v4l2.QUERYCAP, bytes(104))[0] == -errno.ENODEV
        with Connection(path) as again:
            assert again.client.get(v4l2.GAIN) == 0


def test_a_refused_request_is_one_negative_number(bench: Bench, path: Path) -> None:
    with Connection(path) as file:
        file.client.request_buffers(1)
        assert exchange(file.link, IOCTL, v4l2.G_CTRL, bytes(8)) == (-errno.EINVAL, b"", [])
        assert exchange(file.link, IOCTL, v4l2.G_CTRL, bytes(7)) == (-errno.EINVAL, b"", [])
        extended = struct.pack("<5I4xQ", 0, 1, 0, 0, 0, 4096)
        assert exchange(file.link, IOCTL, v4l2.G_EXT_CTRLS, extended)[0] == -errno.ENOTTY
        assert exchange(file.link, 9, 0, b"??") == (-errno.EINVAL, b"", [])
        for wrong in (struct.pack("<QQ", 3072, 4096), struct.pack("<QQ", 3072, 8 << 20), b"short"):
            assert exchange(file.link, MMAP, 0, wrong) == (-errno.EINVAL, b"", [])
        assert file.client.query(0).length_bytes == 3072  # and the line is in step


def test_a_request_may_arrive_in_pieces(path: Path) -> None:
    with Connection(path) as file:
        message = struct.pack("<IIQ", IOCTL, 8, v4l2.G_CTRL) + struct.pack("<Ii", v4l2.GAIN, 0)
        for position in range(len(message)):
            file.link.sendall(message[position : position + 1])
        assert file.link.recv(16, socket.MSG_WAITALL) == struct.pack("<iIIi", 0, 8, v4l2.GAIN, 0)


def test_nonsense_is_hung_up_on_and_the_next_client_is_served(path: Path) -> None:
    with Connection(path) as file:
        file.link.sendall(struct.pack("<IIQ", IOCTL, 1 << 30, 0))
        assert file.link.recv(1) == b""
    with Connection(path) as next_file:
        assert next_file.client.get(v4l2.GAIN) == 0


def test_a_client_that_never_reads_its_events_holds_nobody_up(bench: Bench, path: Path) -> None:
    with Connection(path) as file:
        file.fd_for(EVENTS)
        file.client.start(1)
        (number,) = bench.device._handles
        (_, camera) = bench.device._outlets
        for _ in range(PIPE_BYTES + 10):
            camera.wake(number)  # what each finished frame does
        bench.at(0.1)
        bench.deliver(0)
        assert file.client.dequeue().sequence == 0


# -- the server ------------------------------------------------------------------------------------


async def test_the_server_says_where_its_cameras_are(tmp_path: Path) -> None:
    benches = {"video0": Bench(), "video1": Bench()}
    devices = {name: bench.device for name, bench in benches.items()}
    async with CameraServer(devices, tmp_path, "socket") as server:
        assert (server.transport, server.why_not_fuse) == ("socket", None)
        assert server.addresses == {name: f"unix:{tmp_path / name}.sock" for name in devices}
        with Connection(tmp_path / "video1.sock") as file:
            file.client.set(v4l2.GAIN, 8)
        assert benches["video1"].client.get(v4l2.GAIN) == 8
        assert benches["video0"].client.get(v4l2.GAIN) == 0
    assert os.listdir(tmp_path) == []  # noqa: PTH208 - no more than names


async def test_a_server_that_cannot_mount_says_why_and_takes_sockets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("emulators.camera_v4l2.server.can_mount", lambda: "not permitted")
    devices = {"video0": Bench().device}
    async with CameraServer(devices, tmp_path, "auto") as server:
        assert (server.transport, server.why_not_fuse) == ("socket", "not permitted")
    with pytest.raises(PermissionError, match="not permitted"):
        await CameraServer(devices, tmp_path, "fuse").start()


async def test_a_mount_that_passes_no_ioctls_is_taken_away_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def query(path: str) -> None:
        raise OSError(errno.ENOTTY, "sandbox", path)

    monkeypatch.setattr("emulators.camera_v4l2.server.can_mount", lambda: None)
    monkeypatch.setattr("emulators.camera_v4l2.server.query_node", query)
    async with CameraServer({"video0": Bench().device}, tmp_path / "dev") as server:
        assert server.transport == "socket"
        assert server.why_not_fuse is not None
        assert "does not serve" in server.why_not_fuse
        with Connection(tmp_path / "dev" / "video0.sock") as file:
            assert file.client.get(v4l2.GAIN) == 0


async def test_a_camera_is_replugged_under_another_number(tmp_path: Path) -> None:
    bench = Bench()
    async with CameraServer({"video0": bench.device}, tmp_path, "socket") as server:
        with Connection(tmp_path / "video0.sock") as old:
            assert old.client.get(v4l2.GAIN) == 0  # served, not only connected
            with pytest.raises(ValueError, match="already"):
                server.plug("video0")
            server.unplug("video0")
            assert server.addresses == {}
            with pytest.raises(FileNotFoundError):
                Connection(tmp_path / "video0.sock")
            assert server.plug("video0", "video2") == f"unix:{tmp_path}/video2.sock"
            with pytest.raises(OSError, match="No such device"):
                old.client.get(v4l2.GAIN)
        with Connection(tmp_path / "video2.sock") as new:
            assert new.client.request_buffers(1) == 1
