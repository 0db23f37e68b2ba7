"""``python -m emulators``: what it prints, what its control port does, what it leaves behind."""

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from emulators.app import main
from emulators.world import (
    Picture,
    PictureDesk,
    board_surface,
    build_scene,
    load_solid,
    read_board,
    read_layout,
)
from emulators.world.shapes import Array

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
READY_S = 600.0


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cad") / "block.stl"
    trimesh.creation.box((60.0, 40.0, 20.0)).export(path)
    return path


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def folder() -> Iterator[Path]:
    """Return a folder with a name so short that sockets can be in it."""
    with tempfile.TemporaryDirectory(prefix="emu-", dir="/tmp") as name:
        yield Path(name)


class Emulator:
    """A running emulator and the one line it printed."""

    def __init__(self, process: asyncio.subprocess.Process, ready: dict[str, Any]) -> None:
        self.process, self.ready = process, ready

    async def end(self, by: signal.Signals = signal.SIGTERM) -> int:
        if self.process.returncode is None:
            self.process.send_signal(by)
        async with asyncio.timeout(600):
            return await self.process.wait()


async def run(*arguments: str, folder: Path) -> Emulator:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "emulators", "--cell", str(CELL), *arguments),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        cwd=ROOT,
        env=os.environ | {"TMPDIR": str(folder)},
    )
    assert process.stdout is not None
    async with asyncio.timeout(READY_S):
        line = await process.stdout.readline()
    return Emulator(process, json.loads(line))


@contextlib.asynccontextmanager
async def running(*arguments: str, folder: Path) -> AsyncIterator[Emulator]:
    emulator = await run(*arguments, folder=folder)
    try:
        yield emulator
    finally:
        assert await emulator.end() == 0


class Control:
    """A client of the control port."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self.writer = reader, writer

    async def do(self, verb: str, **order: Any) -> dict[str, Any]:
        self.writer.write(json.dumps({"do": verb, **order}).encode() + b"\n")
        async with asyncio.timeout(600):
            answer: dict[str, Any] = json.loads(await self._reader.readline())
        return answer


@contextlib.asynccontextmanager
async def control(path: Path) -> AsyncIterator[Control]:
    client = Control(*await asyncio.open_unix_connection(str(path)))
    try:
        yield client
    finally:
        client.writer.close()
        await client.writer.wait_closed()


def text_of(path: str) -> str:
    return Path(path).read_text()


def left_in(folder: Path) -> list[Path]:
    return list(folder.iterdir())


def is_terminal(path: str) -> bool:
    return Path(path).is_char_device()


def is_alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def children_of(pid: int) -> list[int]:
    return [int(word) for word in text_of(f"/proc/{pid}/task/{pid}/children").split()]


def open_sockets(pid: int) -> set[str]:
    """Return the inodes of a process's sockets."""
    inodes = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):
            inodes.add(str(fd.readlink()))
    return {one[8:-1] for one in inodes if one.startswith("socket:")}


async def test_it_says_where_everything_is_and_leaves_nothing_behind(
    part: Path, folder: Path
) -> None:
    arguments = ("--part", str(part), "--seed", "4", "--speed", "10")
    emulator = await run(*arguments, folder=folder)
    ready = emulator.ready
    assert ready["event"] == "ready"
    assert (ready["seed"], ready["speed"]) == (4, 10.0)
    devices = ready["devices"]
    assert set(devices) == {"arm", "gripper", "lights", "io", "overhead", "inspection"}
    assert is_terminal(devices["arm"])
    assert devices["gripper"]["unit"] == 9
    for name in ("gripper", "lights", "io"):
        with socket.create_connection((devices[name]["host"], devices[name]["port"]), 5.0):
            pass
    assert devices["gripper"]["port"] != devices["lights"]["port"]
    assert ready["camera_transport"] in ("fuse", "socket")
    assert (ready["why_not_fuse"] is None) == (ready["camera_transport"] == "fuse")
    children = children_of(ready["pid"])
    assert children
    assert await emulator.end() == 0
    assert left_in(folder) == []
    assert str(folder) not in text_of("/proc/mounts")
    # multiprocessing's own helper notices the end of its parent by itself, a moment later
    deadline = time.monotonic() + 600
    while any(is_alive(pid) for pid in children):
        assert time.monotonic() < deadline
        await asyncio.sleep(0.01)


async def test_nothing_but_devices_can_be_reached_without_a_control_port(
    part: Path, folder: Path
) -> None:
    """The truth stays inside: what is listened on is three Modbus ports and the cameras."""
    arguments = ("--part", str(part), "--camera-transport", "socket")
    async with running(*arguments, folder=folder) as emulator:
        ready = emulator.ready
        pid = ready["pid"]
        inodes = open_sockets(pid)
        tcp = {
            int(row.split()[1].split(":")[1], 16)
            for row in text_of("/proc/net/tcp").splitlines()[1:]
            if row.split()[3] == "0A" and row.split()[9] in inodes
        }
        devices = ready["devices"]
        assert tcp == {devices[name]["port"] for name in ("gripper", "lights", "io")}
        listening = {
            row.split()[7]
            for row in text_of("/proc/net/unix").splitlines()[1:]
            if row.split()[6] in inodes and len(row.split()) > 7 and row.split()[3] == "00010000"
        }
        cameras = {devices[name].removeprefix("unix:") for name in ("overhead", "inspection")}
        assert listening == cameras
        # and what it says of itself names no part, no pose and no place but of devices
        told = json.dumps({k: v for k, v in ready.items() if k != "devices"})
        assert "block" not in told
        assert set(ready) == {
            *("event", "speed", "seed", "devices", "camera_transport", "why_not_fuse", "pid"),
            *("as_drawn", "wall_clock"),
            *("started_wall_s", "clock"),
        }


async def test_the_control_port_tells_the_truth_and_causes_faults(part: Path, folder: Path) -> None:
    path = folder / "control.sock"
    arguments = ("--part", str(part), "--speed", "10", "--camera-transport", "socket")
    at = ("--pose", "0", "--at", "350,20,30", "--control", str(path))
    async with running(*arguments, *at, folder=folder), control(path) as client:
        truth = await client.do("truth")
        (told,) = truth["parts"]
        assert (told["custody"], told["at_rest"], told["tray"]) == ("free", True, None)
        T = np.array(told["T_world_part"])
        assert T[:2, 3] == pytest.approx((350.0, 20.0), abs=1.0)
        assert truth["collisions"] == []
        before = (await client.do("time"))["world_s"]
        deadline = time.monotonic() + 600
        while (now := await client.do("time"))["world_s"] < before + 2.0:
            assert time.monotonic() < deadline
        assert now["speed"] == 10.0
        assert (await client.do("estop", pressed=True))["ok"]
        assert (await client.do("reset"))["chain_ok"] is False
        await client.do("estop", pressed=False)
        assert (await client.do("reset"))["chain_ok"] is True
        for verb, order in (
            ("door", {"closed": False}),
            ("lamp", {"name": "table_ring", "dead": True}),
            ("gripper", {"jammed": True}),
            ("line", {"device": "gripper", "is_mute": True}),
            ("camera", {"camera": "overhead", "is_frozen": True}),
            ("arm_line", {"drop_reply_byte": 1}),
            ("arm_ip", {"ip": 0, "what": "restart"}),
            ("arm_jam", {"axis": "zed"}),
            ("unplug", {"camera": "inspection"}),
            ("plug", {"camera": "inspection"}),
            ("remove", {}),
        ):
            assert (await client.do(verb, **order))["ok"], verb
        assert (await client.do("truth"))["parts"][0]["custody"] == "away"
        for verb, order in (
            ("fly", {}),
            ("lamp", {"name": "moon"}),
            ("arm_line", {"no_such_fault": 1}),
            ("slip", {"along_mm": 1.0, "gripper": "foot"}),
        ):
            answer = await client.do(verb, **order)
            assert not answer["ok"]
            assert answer["error"]


async def test_it_ends_with_its_parent(part: Path, folder: Path) -> None:
    arguments = ("--part", str(part), "--die-with-parent", "--camera-transport", "socket")
    emulator = await run(*arguments, folder=folder)
    assert emulator.process.stdin is not None
    emulator.process.stdin.close()
    async with asyncio.timeout(600):
        assert await emulator.process.wait() == 0
    assert left_in(folder) == []


async def test_serial_lines_are_terminals(part: Path, folder: Path) -> None:
    arguments = ("--part", str(part), "--lines", "rtu-pty", "--camera-transport", "socket")
    async with running(*arguments, folder=folder) as emulator:
        for name in ("gripper", "lights"):
            told = emulator.ready["devices"][name]
            assert told["transport"] == "rtu-pty"
            assert is_terminal(told["path"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--part", "no.stl"], "no.stl"),
        (["--speed", "0"], "--speed"),
        (["--at", "1,2"], "--at"),
        (["--cell", "no.yaml"], "no.yaml"),
    ],
)
def test_what_cannot_be_emulated_is_told_in_one_line(
    arguments: list[str],
    words: str,
    caplog: pytest.LogCaptureFixture,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--cell", str(CELL), *arguments]) == 2
    assert words in caplog.text
    assert capsys.readouterr().out == ""


class StillWorld:
    """A world that stands still."""

    def __init__(self) -> None:
        self.light = {0: 1.0}

    def poses(self) -> dict[str, Array]:
        T = np.eye(4)
        T[:3, 3] = 360.0, 0.0, 10.0
        return {"part 0": T}

    def levels(self) -> dict[int, float]:
        return self.light


def test_pictures_come_from_another_process_when_their_time_has_come(part: Path) -> None:
    layout = read_layout(CELL)
    world = StillWorld()
    desk = PictureDesk(build_scene(layout, [load_solid(part)]), world, seed=1)
    try:
        desk.start()
        assert desk.worker_pid not in (None, os.getpid())
        arrived: dict[Any, Picture] = {}
        is_there = threading.Event()

        def deliver(ticket: Any, picture: Picture) -> None:
            arrived[ticket] = picture
            is_there.set()

        early = desk.order(0, 1.0, 0.010, 1.0, 8, deliver)
        desk.note(0.999)  # the exposure's middle has not been reached: nothing is sent
        late = desk.order(0, 2.0, 0.010, 1.0, 16, deliver)
        desk.note(1.5)
        assert is_there.wait(30.0)
        assert set(arrived) == {early}
        picture = arrived[early]
        assert picture.shape == (1024, 1280)
        assert picture.dtype == np.uint8
        assert picture[100, 640] > 190
        assert picture[511, 640] < 12
        is_there.clear()
        world.light = {0: 0.5}
        desk.note(2.0)
        assert is_there.wait(30.0)
        assert arrived[late].dtype == np.uint16
        half = (picture[50:150, 600:700].mean() - 4.0) / 2.0 + 4.0
        assert arrived[late][50:150, 600:700].mean() / 257.0 == pytest.approx(half, rel=0.01)
        tickets = [desk.order(0, 9.0, 0.010, 1.0, 8, deliver) for _ in range(7)]
        assert tickets[-1] is None  # too many in the making: the frame is lost, the world goes on
    finally:
        desk.close()
    with pytest.raises(RuntimeError, match="died"):
        desk.note(10.0)


def test_a_board_that_is_brought_later_is_in_the_pictures_from_then_on() -> None:
    world = StillWorld()
    world.light = {1: 1.0}  # the ring
    desk = PictureDesk(build_scene(read_layout(CELL), []), world, seed=1)
    board = read_board(ROOT / "recipes" / "boards" / "chessboard.json")
    arrived: list[Picture] = []
    is_there = threading.Event()

    def deliver(_: Any, picture: Picture) -> None:
        arrived.append(picture)
        is_there.set()

    def take(at_s: float) -> Picture:
        is_there.clear()
        desk.order(0, at_s, 0.010, 1.0, 8, deliver)
        desk.note(at_s)
        assert is_there.wait(30.0)
        return arrived[-1]

    try:
        desk.start()
        before = take(1.0)
        desk.add(board_surface("part 0", board))  # the world already has its pose
        after = take(2.0)
    finally:
        desk.close()
    # the board's origin is at (360, 0), its squares up and to the right of it: white and black
    assert before.max() < 70
    assert (after > 120).sum() > 10_000
    assert (after < 25).sum() > 10_000


def test_a_seed_draws_the_same_noise_however_many_pictures_were_taken_before() -> None:
    def shots(seed: int, places_mm: tuple[float, ...]) -> list[Picture]:
        world = StillWorld()
        world.light = {1: 1.0}  # the ring
        desk = PictureDesk(build_scene(read_layout(CELL), []), world, seed)
        arrived: list[Picture] = []
        is_there = threading.Event()

        def deliver(_: Any, picture: Picture) -> None:
            arrived.append(picture)
            is_there.set()

        try:
            desk.start()
            for number, place_mm in enumerate(places_mm):
                is_there.clear()
                T = np.eye(4)
                T[0, 3] = place_mm
                world.poses = lambda T=T: {"part 0": T}  # type: ignore[method-assign]
                desk.order(0, float(number), 0.010, 1.0, 8, deliver)
                desk.note(float(number))
                assert is_there.wait(30.0)
        finally:
            desk.close()
        return arrived

    first, again, moved = shots(7, (300.0, 300.0, 320.0))
    *_, late = shots(7, (310.0, 320.0, 310.0, 300.0 + 1e-6))
    (other,) = shots(8, (300.0,))
    assert np.array_equal(late, first)
    # each frame of one scene has its own noise, as has each scene, and each seed
    for picture in (again, moved, other):
        assert np.mean(picture != first) > 0.2
