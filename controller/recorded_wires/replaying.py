"""A batch run again on the wires of a recording, until the first byte that differs."""

import asyncio
import contextlib
import os
import tempfile
from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, TypeVar

from controller.cell.batch import Outfit, RunOrder, new_run_id, run_batch
from controller.cell.compute import Compute, Job
from controller.cell.devices import Devices
from controller.cell.devices.clocks import FoundClock
from controller.config import Cell, load_cell, load_recipe
from controller.config.files import read_sha256
from controller.virtual_time import NothingLeftError
from drivers.clock import CellClock
from drivers.errors import DeviceError
from drivers.modbus_link import RtuAddress, RtuOverTcpAddress
from drivers.wire_file import WireFileError, WireReader
from drivers.wires import CameraTap, LineTap

from .cameras import AtOnce, PlayedCamera
from .lines import Difference, PlayedLine, Tape
from .loop import WireLoop
from .recording import question_of, require_recorded

Result = TypeVar("Result")

BEAT_S: Final = 2.0  # this loop is never late: every timer is run at its instant
STATE_HOME: Final = "XDG_STATE_HOME"  # variable of the folder in which a run notes its journal
FIRST_FD: Final = 1_000_000  # no file has this number


@dataclass(frozen=True, slots=True)
class Replayed:
    """The result of a replay.

    Attributes
    ----------
    difference : the first one; None if every request was the recorded one
    request_count : requests and camera calls that were the same
    end : end of the replayed run
    is_whole : whether the recording reaches to the end of its run
    """

    difference: Difference | None
    request_count: int
    end: str
    is_whole: bool


@dataclass(frozen=True, slots=True)
class ReplayFiles:
    """The readable files of the recorded run.

    Attributes
    ----------
    recipe, cell : paths
    restored : files that are gone or have changed, and were written anew from the recording
    """

    recipe: Path
    cell: Path
    restored: tuple[Path, ...]


@contextlib.contextmanager
def inputs_of(reader: WireReader) -> Iterator[ReplayFiles]:
    """Yield the files that the recorded run was started with.

    They are read in place if none has changed since; else all are written to a temporary folder,
    with the same relative paths.

    Raises
    ------
    WireFileError : the recording has no beginning
    """
    begin = _row(reader, "begin").info
    files = [row for row in reader.rows if (row.wire, row.kind) == ("run", "file")]
    changed = [row for row in files if _digest(Path(row.info["path"])) != row.info["sha256"]]
    if not changed:
        yield ReplayFiles(Path(begin["recipe"]), Path(begin["cell"]), ())
        return
    root = Path(os.path.commonpath([row.info["path"] for row in files]))
    root = root if len(files) > 1 else root.parent
    with tempfile.TemporaryDirectory(prefix="cellctl-wires-") as folder:
        for row in files:
            place = Path(folder) / Path(row.info["path"]).relative_to(root)
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(reader.data(row))
        recipe, cell = (
            Path(folder) / Path(begin[name]).relative_to(root) for name in ("recipe", "cell")
        )
        yield ReplayFiles(recipe, cell, tuple(Path(row.info["path"]) for row in changed))


def _digest(path: Path) -> str:
    try:
        return read_sha256(path)
    except OSError:
        return ""


def _row(reader: WireReader, kind: str) -> Any:  # noqa: ANN401
    found = next((row for row in reader.rows if (row.wire, row.kind) == ("run", kind)), None)
    if found is None:
        raise WireFileError(f"{reader.path}: the recording ends before its run began")
    return found


def replay_wires(
    reader: WireReader, recipe_path: Path, cell_path: Path, pool: Executor
) -> Replayed:
    """Run the recorded batch again, its drivers on the recording; return the result.

    Parameters
    ----------
    reader : reader of the recording
    recipe_path, cell_path : recipe and cell file of the run
    pool : the worker process

    Raises
    ------
    WireFileError : the recording ends before any device was opened
    ConfigError : a file is wrong, or a device is not recorded
    """
    began, devices = _row(reader, "begin").info, _row(reader, "devices")
    speed = float(devices.info["speed"])
    loop = WireLoop(devices.at_s / speed)
    tape = Tape(reader, loop, speed)
    wires = _PlayedWires(tape)
    recipe, cell = load_recipe(recipe_path), load_cell(cell_path)
    require_recorded(cell)
    with _folder_of_its_own() as folder:
        clock = _PlayedClock(
            speed=speed,
            monotonic=loop.time,
            beat_wall_s=BEAT_S,
            late_s=float(devices.info["late_s"]),
        )
        order = RunOrder(
            recipe_path=recipe_path,
            cell_path=cell_path,
            recipe=recipe,
            cell=cell,
            count=int(began["count"]),
            speed=speed,
            emulated=began["emulated"],
            clock=clock,
            runs_dir=folder,
            run_id=new_run_id(recipe),
            is_part_removed=bool(began["is_part_removed"]),
        )
        answers = _Answers(tape, pool, "compute")
        threads = _Answers(tape, AtOnce(), "threads")

        def compute(job: Job, _: Executor) -> Compute:
            loop.threads = threads  # recorded from here on
            return Compute(job, answers)

        outfit = Outfit(compute=compute, devices=partial(_devices, wires))
        end = _run(loop, order, pool, outfit)
    if tape.difference is None:
        wires.find_what_is_left()
    return Replayed(tape.difference, tape.request_count, end, reader.is_whole)


def _run(loop: WireLoop, order: RunOrder, pool: Executor, outfit: Outfit) -> str:
    asyncio.set_event_loop(loop)
    try:
        work = run_batch(order, pool, lambda _: None, lambda _: None, lambda _: None, outfit)
        result = loop.run_until_complete(work)
    except (DeviceError, NothingLeftError) as error:
        return str(error)
    finally:
        _bury(loop)
        asyncio.set_event_loop(None)
    return f"{result.outcome.end} {result.outcome.message}".strip()


def _bury(loop: WireLoop) -> None:
    """Cancel all tasks that wait at the end of a recording, and close the loop."""
    left = asyncio.all_tasks(loop)
    for task in left:
        task.cancel()
    with contextlib.suppress(NothingLeftError):
        loop.run_until_complete(asyncio.gather(*left, return_exceptions=True))
    loop.close()


@contextlib.contextmanager
def _folder_of_its_own() -> Iterator[Path]:
    """Yield a folder for journal and pictures that no real start knows."""
    before = os.environ.get(STATE_HOME)
    with tempfile.TemporaryDirectory(prefix="cellctl-replay-") as folder:
        os.environ[STATE_HOME] = str(Path(folder) / "state")
        try:
            yield Path(folder) / "runs"
        finally:
            if before is None:
                del os.environ[STATE_HOME]
            else:
                os.environ[STATE_HOME] = before


@dataclass(frozen=True, slots=True)
class _PlayedClock(FoundClock):
    """The clock of a recording.

    Attributes
    ----------
    late_s : largest excess of its time-outs [cell s]
    """

    late_s: float = 0.0

    def open(self) -> CellClock:
        return _LateClock(
            speed=self.speed,
            monotonic=self.monotonic,
            beat_wall_s=self.beat_wall_s,
            late_s=self.late_s,
        )


@dataclass(frozen=True)
class _LateClock(CellClock):
    late_s: float = 0.0

    def patience_s(self, duration_s: float) -> float:
        return duration_s + self.late_s


def _devices(
    wires: "_PlayedWires", cell: Cell, where: Mapping[str, dict[str, Any]], clock: CellClock
) -> Devices:
    wires.tape.callers.begin()
    # an address that names a plugged-in camera would be searched on this computer
    played = {name: dict(settings) for name, settings in where.items()}
    for name in type(cell.cameras).model_fields:
        played[name]["address"] = f"unix:{name}"
    return Devices.build(cell, played, clock, wires)


class _PlayedWires:
    """All wires of a recording; a `drivers.wires.Wires`."""

    def __init__(self, tape: Tape) -> None:
        self.tape = tape
        self._lines: list[PlayedLine] = []
        self._camera_count = 0

    def line(self, name: str) -> LineTap | None:
        return self._played(name)

    def modbus(self, address: Any) -> tuple[Any, LineTap | None]:  # noqa: ANN401
        line = self._played(str(address))
        number = len(self._lines)
        self.tape.loop.ports["wires", number] = line.connect
        if isinstance(address, RtuAddress | RtuOverTcpAddress):  # the tape has no echo
            return RtuOverTcpAddress("wires", number), line
        return replace(address, host="wires", port=number), line

    def _played(self, name: str) -> PlayedLine:
        line = PlayedLine(self.tape, name)
        self._lines.append(line)
        return line

    def camera(self, name: str) -> CameraTap | None:
        self._camera_count += 1
        return PlayedCamera(self.tape, name, FIRST_FD + self._camera_count)

    def thread(self, name: str) -> Executor:
        return AtOnce()

    def find_what_is_left(self) -> None:
        """Note as the difference a request that the recorded run made, and this one did not."""
        if not self.tape.reader.is_whole:
            return
        for line in self._lines:
            if line.left_count:
                line.left_difference()
                return


class _Answers(Executor):
    """The worker process, or threads: they compute again, and are done when they were.

    Parameters
    ----------
    tape : tape of the recording
    pool : works
    wire : name of the wire in the recording
    """

    def __init__(self, tape: Tape, pool: Executor, wire: str) -> None:
        self._tape = tape
        self._pool = pool
        self._done_s: dict[str, deque[float]] = defaultdict(deque)
        rows = [row for row in tape.reader.rows if row.wire == wire]
        ends = {row.info[0]: row.at_s for row in rows if row.kind == "done"}
        for row in rows:
            if row.kind == "begun":
                number, question = row.info
                self._done_s[question].append(ends.get(number, float("inf")))

    def answer(self, fn: Callable[[], Result]) -> tuple[Callable[[], Result], float]:
        """Compute; return a callable with the answer, and the recorded instant of the answer."""
        future = self._pool.submit(fn)
        with contextlib.suppress(Exception):  # handed over below
            future.result()
        recorded = self._done_s[question_of(fn)]
        at_s = recorded.popleft() if recorded else self._tape.now_s
        return future.result, self._tape.loop_s(at_s)
