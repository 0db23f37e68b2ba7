"""An emulated camera over a unix socket: the same structs, descriptors that ride along, its end."""

import asyncio
import contextlib
import errno
import os
import socket
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from camera_fakes import FakeCamera, SocketServer, until

from drivers.camera_v4l2 import Camera, CameraConfig, SocketCalls
from drivers.clock import REAL_TIME
from drivers.errors import LinkError, ReplyTimeoutError, UnpluggedError

WIDTH, HEIGHT = 8, 4
VIDIOC_QUERYCAP = 0x80685600  # videodev2.h: _IOR('V', 0, 104 bytes)


def picture(level: int) -> bytes:
    return bytes([level]) * (WIDTH * HEIGHT)


@pytest.fixture(autouse=True)
def no_descriptor_is_left() -> Iterator[None]:
    before = set(os.listdir("/proc/self/fd"))  # noqa: PTH208 -- numbers, not paths
    yield
    assert set(os.listdir("/proc/self/fd")) <= before  # noqa: PTH208 -- numbers, not paths


@pytest.fixture
def server(no_descriptor_is_left: None, tmp_path: Path) -> Iterator[SocketServer]:
    fake = FakeCamera(WIDTH, HEIGHT)
    for control, value in ((0x0098090C, 0), (0x009A0901, 1), (0x009A0902, 100)):
        fake.controls[control].value = value
    server = SocketServer(fake, tmp_path / "camera.sock")
    yield server
    server.close()


def camera_at(server: SocketServer, reply_timeout_wall_s: float = 5.0) -> Camera:
    config = CameraConfig(
        f"unix:{server.path}",
        width=WIDTH,
        height=HEIGHT,
        fps=10,
        exposure_s=0.010,
        frame_margin_s=0.005,
    )
    return Camera(config, REAL_TIME, SocketCalls(reply_timeout_wall_s))


async def test_frames_come_through_the_memory_the_camera_shares(server: SocketServer) -> None:
    fake = server.camera
    async with camera_at(server) as camera:
        assert camera.identity().card == "Scripted Camera"
        t_s = time.monotonic() - 1.0
        for level in (1, 2, 3, 4, 5, 6):  # over the ring of four and round again
            task = asyncio.create_task(camera.frame_after(t_s + 0.1 * level))
            before = fake.seen["DQBUF"]
            await until(lambda before=before: fake.seen["DQBUF"] > before)
            assert fake.finish(picture(level), t_s + 0.1 * level + 0.02)
            frame = await asyncio.wait_for(task, 600)
            assert frame.image.tolist() == [[level] * WIDTH] * HEIGHT
        assert camera.stats.lost_count == 0


async def test_an_event_wakes_the_driver_once(server: SocketServer) -> None:
    fake = server.camera
    async with camera_at(server) as camera:
        t_s = time.monotonic() - 1.0
        task = asyncio.create_task(camera.frame_after(t_s))
        await until(lambda: fake.seen["DQBUF"] == 1)
        fake.finish(picture(1), t_s - 0.5)  # stale: taken, and the wait goes on
        await until(lambda: fake.seen["DQBUF"] == 3)
        done, _ = await asyncio.wait([task], timeout=0.1)
        assert not done
        assert fake.seen["DQBUF"] == 3
        fake.finish(picture(2), t_s + 0.5)
        assert (await asyncio.wait_for(task, 600)).image[0, 0] == 2


async def test_replies_that_come_byte_by_byte_are_put_together(server: SocketServer) -> None:
    server.piece_bytes = 1
    async with camera_at(server) as camera:
        t_s = time.monotonic() - 1.0
        server.camera.finish(picture(8), t_s + 0.5)
        assert (await camera.frame_after(t_s)).image[0, 0] == 8


async def test_the_end_of_the_events_wakes_a_wait_and_is_an_unplug(server: SocketServer) -> None:
    async with camera_at(server) as camera:
        task = asyncio.create_task(camera.frame_after(time.monotonic()))
        await until(lambda: server.camera.seen["DQBUF"] > 0)
        server.camera.unplug()
        with pytest.raises(UnpluggedError):
            await asyncio.wait_for(task, 600)
        assert not camera.is_connected


async def test_a_camera_plugged_in_again_answers_at_the_same_socket(server: SocketServer) -> None:
    async with camera_at(server) as camera:
        server.camera.unplug()
        with pytest.raises(UnpluggedError):
            await camera.frame_after(time.monotonic())
        server.camera.is_gone = False
        await camera.reconnect(5.0)
        t_s = time.monotonic() - 1.0
        server.camera.finish(picture(4), t_s + 0.5)
        assert (await camera.frame_after(t_s)).image[0, 0] == 4


async def test_a_server_that_hangs_up_is_an_unplug(server: SocketServer) -> None:
    async with camera_at(server) as camera:
        task = asyncio.create_task(camera.frame_after(time.monotonic()))
        await until(lambda: server.camera.seen["DQBUF"] > 0)
        server.hang_up()
        with pytest.raises(UnpluggedError):
            await asyncio.wait_for(task, 600)


async def test_a_server_that_falls_silent_is_a_time_out_and_then_gone(
    server: SocketServer,
) -> None:
    async with camera_at(server, reply_timeout_wall_s=0.1) as camera:
        server.is_mute = True
        with pytest.raises(ReplyTimeoutError, match="ETIMEDOUT"):
            await camera.controls()
        with pytest.raises(UnpluggedError):  # a late answer would be taken for the next one's
            await camera.controls()
        assert not camera.is_connected


async def test_the_event_loop_goes_on_while_the_camera_thinks(server: SocketServer) -> None:
    fake = server.camera
    async with camera_at(server) as camera:
        fake.log.clear()
        fake.hold = threading.Event()
        task = asyncio.create_task(camera.controls())
        await until(lambda: "QUERYCTRL" in fake.log)
        for _ in range(100):
            await asyncio.sleep(0)
        assert not task.done()
        fake.hold.set()
        assert await task


async def test_no_server_and_no_socket_are_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "camera.sock"
    with pytest.raises(LinkError, match="no camera is plugged in"):
        await Camera(CameraConfig(f"unix:{path}")).connect()
    with socket.socket(socket.AF_UNIX) as deaf:
        deaf.bind(str(path))
    with pytest.raises(LinkError, match="no emulated camera listens"):
        await Camera(CameraConfig(f"unix:{path}")).connect()


# -- the wire itself ------------------------------------------------------------------------------


class Peer:
    """A hand-written other end, for the bytes themselves."""

    def __init__(self, path: Path) -> None:
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(str(path))
        self.listener.listen(1)
        self.received: list[bytes] = []
        self.replies: list[tuple[bytes, int | None]] = []
        self.thread = threading.Thread(target=self.run)

    def run(self) -> None:
        connection, _ = self.listener.accept()
        with connection:
            for reply, fd in self.replies:
                self.received.append(connection.recv(1 << 12))
                if fd is None:
                    connection.sendall(reply)
                else:
                    socket.send_fds(connection, [reply], [fd])
            connection.settimeout(600)
            while connection.recv(1 << 12):
                pass

    def close(self) -> None:
        self.thread.join(10)
        assert not self.thread.is_alive()
        self.listener.close()


@pytest.fixture
def peer(tmp_path: Path) -> Iterator[Peer]:
    peer = Peer(tmp_path / "wire.sock")
    yield peer
    peer.close()


def test_the_requests_are_the_wires_text_byte_by_byte(peer: Peer, tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    memory = os.memfd_create("frames")
    os.ftruncate(memory, 1 << 20)
    os.pwrite(memory, b"frame", 4096)
    done = struct.pack("<iI", 0, 0)
    peer.replies = [
        (done, read_end),
        (struct.pack("<iI", 0, 104) + b"x" * 104, None),
        (done, memory),
    ]
    peer.thread.start()
    calls = SocketCalls()
    fd = calls.open(f"unix:{tmp_path / 'wire.sock'}")
    buffer = bytearray(104)
    calls.ioctl(fd, VIDIOC_QUERYCAP, buffer)
    assert buffer == b"x" * 104
    view = calls.mmap(fd, 8192, 4096)
    assert view[:5] == b"frame"
    view.close()
    calls.close(fd)
    for each in (read_end, write_end, memory):
        os.close(each)
    # '<IIQ' kind, size, arg: events; the ioctl with its struct; the map with length and offset
    assert peer.received == [
        bytes.fromhex("03000000 00000000 0000000000000000"),
        bytes.fromhex("01000000 68000000 0056688000000000") + bytes(104),
        bytes.fromhex("02000000 10000000 0000000000000000 0020000000000000 0010000000000000"),
    ]


def test_an_ioctl_that_fails_carries_its_errno(peer: Peer, tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    busy = struct.pack("<iI", -errno.EBUSY, 4) + b"same"
    peer.replies = [(struct.pack("<iI", 0, 0), read_end), (busy, None)]
    peer.thread.start()
    calls = SocketCalls()
    fd = calls.open(f"unix:{tmp_path / 'wire.sock'}")
    buffer = bytearray(b"same")
    with pytest.raises(OSError, match="busy") as caught:
        calls.ioctl(fd, 0x40045612, buffer)
    assert caught.value.errno == errno.EBUSY
    calls.close(fd)
    os.close(read_end)
    os.close(write_end)


@pytest.mark.parametrize(
    "reply",
    [
        struct.pack("<iI", 0, 3) + b"abc",  # another length than was sent
        struct.pack("<iI", 0, 1 << 30),  # longer than any struct
        struct.pack("<iI", -(1 << 31), 0),  # no error has such a number
        struct.pack("<iI", 5, 0),
    ],
)
def test_a_reply_the_wire_forbids_is_not_taken(peer: Peer, tmp_path: Path, reply: bytes) -> None:
    read_end, write_end = os.pipe()
    peer.replies = [(struct.pack("<iI", 0, 0), read_end), (reply, None)]
    peer.thread.start()
    calls = SocketCalls()
    fd = calls.open(f"unix:{tmp_path / 'wire.sock'}")
    with pytest.raises(OSError, match=r"bytes|neither 0 nor an error") as caught:
        calls.ioctl(fd, 0x40045612, bytearray(4))
    assert caught.value.errno == errno.EPROTO
    calls.close(fd)
    os.close(read_end)
    os.close(write_end)


def test_events_without_a_descriptor_leave_nothing_open(peer: Peer, tmp_path: Path) -> None:
    peer.replies = [(struct.pack("<iI", 0, 0), None)]
    peer.thread.start()
    with pytest.raises(OSError, match="descriptors"):
        SocketCalls().open(f"unix:{tmp_path / 'wire.sock'}")


def test_events_are_counted_off_and_their_end_is_enodev(peer: Peer, tmp_path: Path) -> None:
    read_end, write_end = os.pipe()
    peer.replies = [(struct.pack("<iI", 0, 0), read_end)]
    peer.thread.start()
    calls = SocketCalls()
    fd = calls.open(f"unix:{tmp_path / 'wire.sock'}")
    calls.acknowledge(fd)  # nothing announced: no wait either
    os.write(write_end, b"f" * 5000)
    calls.acknowledge(fd)
    with pytest.raises(BlockingIOError):
        os.read(calls.readiness_fd(fd), 1)
    os.close(write_end)
    with pytest.raises(OSError, match="ended") as caught:
        calls.acknowledge(fd)
    assert caught.value.errno == errno.ENODEV
    calls.close(fd)
    with pytest.raises(OSError, match="descriptor"):
        calls.ioctl(fd, VIDIOC_QUERYCAP, bytearray(104))
    with contextlib.suppress(OSError):
        os.close(read_end)
