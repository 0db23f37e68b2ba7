"""One clock for world and drivers: both readings of docs/shared-clock.md, on a wall that jumps."""

import asyncio
import json
import multiprocessing
import os
import select
import socket
import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.clock import CellClock
from drivers.errors import LinkError
from drivers.supervisor import BlindStop, Orders
from drivers.supervisor.process import Supervisor
from emulators.clock import SharedClock
from emulators.register import register_folder, registered

SPEED = 10.0
WINDOW_S = 0.05
HERE = __name__


class Wall:
    """The wall clock, which passes because the test says so."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000_000

    def pass_s(self, duration_s: float) -> None:
        self.ns += round(duration_s * 1e9)

    @property
    def s(self) -> float:
        return self.ns * 1e-9


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> Wall:
    one = Wall()
    monkeypatch.setattr(time, "monotonic_ns", lambda: one.ns)
    return one


@pytest.fixture
def world(wall: Wall, tmp_path: Path) -> Iterator[SharedClock]:
    clock = SharedClock(SPEED, tmp_path)
    yield clock
    clock.close()


@pytest.fixture
def cell(world: SharedClock) -> Iterator[CellClock]:
    clock = CellClock.of_emulator(world.path)
    yield clock
    clock.close()


def test_both_sides_read_the_same_instant(world: SharedClock, cell: CellClock, wall: Wall) -> None:
    assert cell.speed == SPEED
    for _ in range(10):
        wall.pass_s(0.001)
        assert world.now_s() == cell.now_s()
        world.tick(world.now_s())
    assert cell.now_s() == pytest.approx(0.1)


def test_time_waits_for_a_world_that_is_late(
    world: SharedClock, cell: CellClock, wall: Wall
) -> None:
    wall.pass_s(60.0)
    assert cell.now_s() == pytest.approx(WINDOW_S)
    world.tick(0.0)
    wall.pass_s(60.0)
    assert cell.now_s() == pytest.approx(WINDOW_S)
    world.tick(WINDOW_S)  # the world is there: time goes on from where it stood, not with a jump
    assert cell.now_s() == pytest.approx(WINDOW_S)
    wall.pass_s(0.001)
    assert cell.now_s() == pytest.approx(WINDOW_S + 0.01)


async def test_time_waits_for_a_controller_that_is_late(
    world: SharedClock, cell: CellClock, wall: Wall
) -> None:
    async with cell.attending():
        for _ in range(100):  # ticks of the world alone: the controller's loop gets no turn
            wall.pass_s(1.0)
            world.tick(world.now_s())
        assert cell.now_s() == pytest.approx(WINDOW_S)
    for _ in range(100):  # it has left, so that it holds nobody up
        wall.pass_s(0.001)
        world.tick(world.now_s())
    assert cell.now_s() == pytest.approx(WINDOW_S + 1.0, abs=0.02)  # a tick to notice it


@pytest.fixture
def unwaiting(wall: Wall, tmp_path: Path) -> Iterator[SharedClock]:
    clock = SharedClock(folder=tmp_path, waits=False)
    yield clock
    clock.close()


async def test_a_clock_on_wall_time_runs_on_while_a_controller_is_stopped(
    unwaiting: SharedClock, wall: Wall
) -> None:
    cell = CellClock.of_emulator(unwaiting.path)
    assert not cell.waits
    async with cell.attending():
        for _ in range(600):  # the controller's loop gets no turn, and no picture is ready
            wall.pass_s(0.01)
            unwaiting.tick(unwaiting.now_s(), 0.0)
        assert cell.now_s() == pytest.approx(6.0)
    cell.close()


async def test_a_clock_on_wall_time_cannot_be_held_for_a_last_look(
    unwaiting: SharedClock, wall: Wall
) -> None:
    cell = CellClock.of_emulator(unwaiting.path)
    async with cell.attending():
        with cell.held() as look_wall_s:
            assert look_wall_s == 0.0
            for _ in range(100):
                wall.pass_s(0.01)
                unwaiting.tick(unwaiting.now_s())
        assert cell.now_s() == pytest.approx(1.0)
        assert cell.unheld_s() == pytest.approx(cell.attended_s())
    cell.close()


def test_a_clock_on_wall_time_still_waits_for_the_world_itself(
    unwaiting: SharedClock, wall: Wall
) -> None:
    wall.pass_s(60.0)
    unwaiting.tick(0.0)
    assert unwaiting.now_s() == pytest.approx(WINDOW_S)


async def test_a_controller_on_wall_time_measures_what_it_missed(
    tmp_path: Path,
) -> None:
    world = SharedClock(folder=tmp_path, waits=False)
    cell = CellClock.of_emulator(world.path)
    async with cell.attending():
        await asyncio.sleep(0)  # the beat begins
        time.sleep(0.2)  # noqa: ASYNC251  (a loop that something blocks)
        world.tick(world.now_s() + 1.0)
        assert cell.missed_wall_s > 0.1
    cell.close()
    world.close()


async def test_held_time_creeps_so_that_what_was_long_above_tray_is_still_answered(
    world: SharedClock, cell: CellClock, wall: Wall
) -> None:
    assert cell.shared is not None
    async with cell.attending():
        began_s = cell.now_s()
        cell.shared.hold()
        for _ in range(100):  # a second of the wall clock, ten of the cell if time ran
            wall.pass_s(0.01)
            await asyncio.sleep(0.002)
            world.tick(world.now_s())
        crept_s = cell.now_s() - began_s
        assert 0.1 < crept_s <= 2 * WINDOW_S + 0.2
        cell.shared.release()
        assert cell.shared.held_s() == pytest.approx(crept_s)
        while cell.now_s() < began_s + 1.0:
            wall.pass_s(0.01)
            await asyncio.sleep(0.002)
            world.tick(world.now_s())
        assert cell.shared.held_s() == pytest.approx(crept_s)  # what ran freely does not count
        assert cell.unheld_s() == pytest.approx(cell.now_s() - crept_s)


def test_time_that_is_held_twice_at_once_counts_once(
    world: SharedClock, cell: CellClock, wall: Wall
) -> None:
    assert cell.shared is not None
    wall.pass_s(0.001)
    with cell.held():
        wall.pass_s(0.001)
        with cell.held():
            wall.pass_s(0.001)
            assert cell.shared.held_s() == pytest.approx(0.002 * SPEED)
        wall.pass_s(0.001)
    wall.pass_s(0.001)
    assert cell.shared.held_s() == pytest.approx(0.003 * SPEED)
    assert cell.now_s() == pytest.approx(0.005 * SPEED)


def test_who_only_reads_the_clock_holds_nobody_up(world: SharedClock, wall: Wall) -> None:
    reader = CellClock.of_emulator(world.path)
    for _ in range(100):
        wall.pass_s(0.001)
        world.tick(world.now_s())
    assert reader.now_s() == pytest.approx(1.0)
    assert world.participant_count == 0
    reader.close()


def test_time_stops_at_a_picture_that_is_due(
    world: SharedClock, cell: CellClock, wall: Wall
) -> None:
    for _ in range(100):
        wall.pass_s(0.001)
        world.tick(world.now_s(), 0.3)
    assert cell.now_s() == pytest.approx(0.3)
    world.tick(world.now_s())
    wall.pass_s(0.001)
    assert cell.now_s() == pytest.approx(0.31)


steps = st.lists(
    st.tuples(st.floats(0.0, 0.02), st.booleans(), st.one_of(st.none(), st.floats(0.0, 0.1))),
    min_size=1,
    max_size=60,
)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(steps=steps)
def test_time_never_goes_back_and_frames_are_found_again_in_it(
    steps: list[tuple[float, bool, float | None]], wall: Wall, tmp_path: Path
) -> None:
    world = SharedClock(SPEED, tmp_path)
    cell = CellClock.of_emulator(world.path)
    stamps: list[tuple[float, float]] = []  # wall reading, cell instant then
    last_s = 0.0
    for pause_wall_s, is_tick, hold_s in steps:
        wall.pass_s(pause_wall_s)
        if is_tick:
            now_s = world.now_s()
            world.tick(now_s, None if hold_s is None else now_s + hold_s)
        assert world.now_s() == cell.now_s() >= last_s
        last_s = cell.now_s()
        stamps.append((wall.s, last_s))
    world.tick(world.now_s())
    for wall_s, cell_s in stamps:
        assert cell.from_monotonic_s(wall_s) == pytest.approx(cell_s, abs=1e-6)
        # an instant is stamped with the first moment it was reached at
        stamp_s = world.to_monotonic_s(cell_s)
        assert stamp_s <= wall_s + 1e-6
        assert cell.from_monotonic_s(stamp_s) == pytest.approx(cell_s, abs=1e-6)
    cell.close()
    world.close()


def test_a_clock_whose_emulator_has_ended_is_refused(world: SharedClock, tmp_path: Path) -> None:
    copy = tmp_path / "left behind"
    copy.write_bytes(world.path.read_bytes())  # as it lies there after a kill: nobody holds it
    with pytest.raises(LinkError, match="has ended"):
        CellClock.of_emulator(copy)


@pytest.mark.parametrize("content", [b"", b"x" * 66048, b"cellclk1"])
def test_what_is_no_clock_is_refused(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    with pytest.raises(LinkError, match="no clock"):
        CellClock.of_emulator(path)
    with pytest.raises(LinkError, match="No such file"):
        CellClock.of_emulator(tmp_path / "nothing")


def test_the_file_goes_with_the_emulator(tmp_path: Path) -> None:
    clock = SharedClock(folder=tmp_path)
    assert list(tmp_path.iterdir()) == [clock.path]
    clock.close()
    assert list(tmp_path.iterdir()) == []


async def test_time_goes_on_for_who_waits_when_the_emulator_has_ended(tmp_path: Path) -> None:
    world = SharedClock(100.0, tmp_path)
    cell = CellClock.of_emulator(world.path)
    async with cell.attending():
        world.close()
        with pytest.raises(TimeoutError):
            async with cell.timeout(1.0):
                await asyncio.get_running_loop().create_future()
    cell.close()


def _take_part_until_killed(path: Path, is_there: "multiprocessing.synchronize.Event") -> None:
    async def take_part() -> None:
        async with CellClock.of_emulator(path).attending():
            is_there.set()
            time.sleep(600)  # noqa: ASYNC251  (a process that hangs)

    asyncio.run(take_part())


def test_a_process_that_hangs_holds_time_and_a_dead_one_does_not(tmp_path: Path) -> None:
    spawn = multiprocessing.get_context("spawn")
    world, is_there = SharedClock(SPEED, tmp_path), spawn.Event()
    process = spawn.Process(target=_take_part_until_killed, args=(world.path, is_there))
    process.start()
    is_there.wait()
    held_s = world.now_s()
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < 0.2:
        world.tick(world.now_s())
    assert world.now_s() <= held_s + 2 * WINDOW_S
    process.kill()
    while world.now_s() < held_s + 1.0:  # the guard of a test that hangs is pytest's
        world.tick(world.now_s())
    assert world.participant_count == 0
    process.join()
    process.close()
    world.close()


def test_an_emulator_takes_away_what_a_killed_one_has_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    folder = register_folder()
    folder.mkdir()
    alive = SharedClock(folder=tmp_path)
    stale = tmp_path / "cellctl-clock-1-stale"
    stale.write_bytes(alive.path.read_bytes())
    precious = tmp_path / "thesis.tex"  # what a planted entry may name
    precious.write_text("x")
    for name, clock in (("1", stale), ("2", alive.path), ("3", precious)):
        (folder / f"{name}.json").write_text(json.dumps({"clock": str(clock), "addresses": {}}))
    mine = SharedClock(folder=tmp_path)
    devices = {"arm": "/dev/pts/9", "io": {"transport": "tcp", "host": "127.0.0.1", "port": 502}}
    with registered({"clock": str(mine.path), "devices": devices}):
        assert not stale.exists()
        assert precious.exists()
        entries = {path.name: json.loads(path.read_text()) for path in folder.iterdir()}
        assert set(entries) == {"2.json", f"{os.getpid()}.json"}
        assert entries[f"{os.getpid()}.json"]["addresses"] == {
            "arm": "/dev/pts/9",
            "io": "127.0.0.1:502",
        }
    assert {path.name for path in folder.iterdir()} == {"2.json"}
    assert alive.path.exists()
    alive.close()
    mine.close()


def test_whoever_asks_a_closed_clock_gets_what_it_said_last(world: SharedClock) -> None:
    """A run's status may be asked for while the run lets go of its cell."""
    clock = CellClock.of_emulator(world.path)
    before_s = clock.now_s()
    clock.close()
    assert clock.now_s() == before_s
    assert clock.speed > 0
    clock.close()


def test_a_supervisor_compares_no_heartbeat_with_the_wall_before_it_knows_the_cells_clock(
    world: SharedClock, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    control, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    signals, heard = socket.socketpair()
    stop = BlindStop("arm", str(tmp_path / "arm"), (b"\x24",), 0.01, 1)
    # both are there when the supervisor first looks, as on a busy machine
    control.send(Orders((stop,), clock=str(world.path)).to_bytes())
    control.send(struct.pack("d", world.now_s()))

    class Looks:
        """Two looks at the sockets; at the second one the controller has said goodbye."""

        def __init__(self) -> None:
            self.count = 0

        def register(self, *_: object) -> None:
            pass

        def poll(self, _: float) -> list[object]:
            self.count += 1
            if self.count == 2:
                control.send(b"bye")
            return []

    monkeypatch.setattr(select, "poll", Looks)
    with control, far, signals, heard:
        Supervisor(far, heard).run()
        control.setblocking(False)
        said = []
        with suppress(BlockingIOError):
            while True:
                said.append(json.loads(control.recv(1 << 16)))
    assert {"ready": True} in said
    assert not any("struck" in one for one in said)
