"""Through the real kernel: open, ioctl, poll, epoll and mmap of a node that FUSE serves."""

import asyncio
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from camera_fuse_node import MAY_NOT_MOUNT

from drivers.camera_v4l2 import Camera, CameraConfig
from drivers.errors import LinkError, UnpluggedError

WIDTH, HEIGHT = 120, 80  # more than two pages
SERVER = Path(__file__).parent / "camera_fuse_node.py"


class Node:
    def __init__(self, mountpoint: Path) -> None:
        self.path = mountpoint / "video0"
        command = [sys.executable, SERVER, mountpoint, str(WIDTH), str(HEIGHT)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.told = self.readline()

    def readline(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def ask(self, command: str) -> str:
        assert self.process.stdin is not None
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        return self.readline()

    def close(self) -> int:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        code = self.process.wait(10)
        self.process.stdout.close()
        return code


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Node]:
    if not Path("/dev/fuse").exists():
        pytest.skip("no /dev/fuse here: KernelCalls not tried on a kernel's node")
    node = Node(tmp_path)
    if node.told != "ready":
        assert node.close() == MAY_NOT_MOUNT, node.told
        pytest.skip(f"FUSE cannot be mounted here ({node.told}): KernelCalls not tried")
    try:
        yield node
    finally:
        node.close()
        if f" {tmp_path} fuse" in Path("/proc/mounts").read_text():  # its server died
            subprocess.run(["umount", "-l", tmp_path], check=True, timeout=600)


def camera_at(node: Node) -> Camera:
    config = CameraConfig(
        str(node.path), WIDTH, HEIGHT, fps=10, exposure_s=0.010, frame_margin_s=0.005
    )
    return Camera(config)


async def waiting(node: Node, camera: Camera, t_s: float) -> "asyncio.Task[object]":
    """Start a wait; return once the driver has seen the queue empty."""
    before = int(node.ask("seen DQBUF"))
    task: asyncio.Task[object] = asyncio.create_task(camera.frame_after(t_s, 10.0))
    deadline = time.monotonic() + 600
    while int(node.ask("seen DQBUF")) == before:
        assert time.monotonic() < deadline
        await asyncio.sleep(0.001)
    return task


async def test_frames_wake_the_driver_and_come_through_the_page_cache(node: Node) -> None:
    async with camera_at(node) as camera:
        assert camera.identity().card == "Scripted Camera"
        for level in range(1, 10):  # twice round the ring
            t_s = time.monotonic() - 0.1
            task = asyncio.create_task(camera.frame_after(t_s, 10.0))
            assert node.ask(f"frame {level} {t_s + 0.05:.6f}") == "True"
            frame = await task
            assert frame.image.shape == (HEIGHT, WIDTH)
            assert (frame.image == level).all()
            assert frame.timestamp_s == pytest.approx(t_s + 0.05, abs=2e-6)
        assert camera.stats.lost_count == 0


async def test_a_wait_on_a_node_sleeps_until_poll_says_ready(node: Node) -> None:
    async with camera_at(node) as camera:
        t_s = time.monotonic()
        task = await waiting(node, camera, t_s)
        looks = int(node.ask("seen DQBUF"))
        done, _ = await asyncio.wait([task], timeout=0.3)
        assert not done
        assert int(node.ask("seen DQBUF")) == looks
        node.ask(f"frame 7 {t_s + 0.02:.6f}")
        await task


async def test_an_unplug_during_a_wait_reaches_it_through_the_kernel(node: Node) -> None:
    async with camera_at(node) as camera:
        task = await waiting(node, camera, time.monotonic())
        node.ask("unplug")
        with pytest.raises(UnpluggedError, match="ENODEV"):
            await asyncio.wait_for(task, 600)
        assert not [link for link in open_files() if link.startswith(str(node.path.parent))]


async def test_a_node_whose_server_dies_is_an_unplug_too(node: Node) -> None:
    async with camera_at(node) as camera:
        task = await waiting(node, camera, time.monotonic())
        node.process.kill()
        with pytest.raises(UnpluggedError):
            await asyncio.wait_for(task, 600)
        assert not [link for link in open_files() if link.startswith(str(node.path.parent))]


async def test_a_paused_node_polls_an_error_and_resumes(node: Node) -> None:
    async with camera_at(node) as camera:
        await camera.pause()
        await camera.resume()
        t_s = time.monotonic() - 0.1
        node.ask(f"frame 3 {t_s + 0.05:.6f}")
        assert (await camera.frame_after(t_s)).sequence == 0


async def test_a_name_that_is_not_there_is_said_to_be_missing(node: Node) -> None:
    with pytest.raises(LinkError, match="plugged in"):
        await Camera(CameraConfig(str(node.path.with_name("video1")))).connect()


def open_files() -> list[str]:
    """Where this process's descriptors and maps lead."""
    fds = Path("/proc/self/fd")
    links = []
    for entry in fds.iterdir():
        try:
            links.append(os.readlink(entry))  # noqa: PTH115 -- a string, not a path
        except OSError:
            continue
    maps = [line.split(maxsplit=5)[-1] for line in Path("/proc/self/maps").read_text().splitlines()]
    return links + maps
