"""The tap that records: every byte, call and frame of all wires, with the cell's time."""

import asyncio
import hashlib
import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial
from typing import Any, TypeVar, cast

from controller.cell.batch import Outfit, RunOrder, input_files
from controller.cell.compute import Compute, Job
from controller.cell.devices import Devices
from controller.config import Cell, ConfigError
from controller.setup.drivers import KIND_OF, find_driver
from controller.setup.software import software_versions
from drivers.clock import CellClock
from drivers.wire_file import WireWriter
from drivers.wires import CameraTap, LineTap, Taken

Opened = TypeVar("Opened")
Address = TypeVar("Address")
Result = TypeVar("Result")


def require_recorded(cell: Cell) -> None:
    """Check that a run on a cell can be recorded and played back.

    Raises
    ------
    ConfigError : a device is reached by connections that nobody records
    """
    for name, kind in KIND_OF.items():
        driver = getattr(cell.devices, name).driver
        if not find_driver(kind, driver).is_recorded:
            raise ConfigError(
                f"{name}: what the driver `{driver}` says is not recorded, so that a run with it "
                "cannot be played back (docs/wires.md)"
            )


class Recorder:
    """All wires of one run, recorded; a `drivers.wires.Wires`.

    Parameters
    ----------
    writer : writer of the file

    Attributes
    ----------
    callers : names who wants a line
    """

    def __init__(self, writer: WireWriter) -> None:
        self.writer = writer
        self._clock: CellClock | None = None
        self._last_s = 0.0
        self.callers = LineCallers()

    def begin(self, order: RunOrder) -> None:
        """Write the inputs of the run: options, and the files it reads."""
        for path in dict.fromkeys(path.resolve() for path in input_files(order)):
            data = path.read_bytes()
            digest = hashlib.sha256(data).hexdigest()
            self.writer.write(0.0, "run", "file", {"path": str(path), "sha256": digest}, data)
        info = {
            "run": order.run_id,
            "recipe": str(order.recipe_path.resolve()),
            "cell": str(order.cell_path.resolve()),
            "count": order.count,
            "emulated": json.loads(json.dumps(dict(order.emulated), default=str)),
            "is_part_removed": order.is_part_removed,
            "software": software_versions(),
        }
        self.writer.write(0.0, "run", "begin", info)

    def outfit(self) -> Outfit:
        """Return the compute service, devices and observers for `run_batch`."""
        return Outfit(compute=self._compute, devices=self._devices, on_row=self._on_row)

    def close(self) -> None:
        """Write that the run has ended, and close the file."""
        self.note("run", "end")
        self.writer.close()

    def note(self, wire: str, kind: str, info: Any = None, data: bytes = b"") -> None:  # noqa: ANN401  (JSON)
        """Append a row with the present instant.

        Parameters
        ----------
        wire, kind : wire and kind of the row
        info : plain JSON values
        data : bytes
        """
        self.writer.write(self._now_s(), wire, kind, info, data)

    def cell_s(self, monotonic_s: float) -> float:
        """Return the cell's instant [s] of a reading of the monotonic clock."""
        return 0.0 if self._clock is None else self._clock.from_monotonic_s(monotonic_s)

    def _now_s(self) -> float:
        if self._clock is not None:
            try:
                self._last_s = self._clock.now_s()
            except ValueError:  # closed: the journal's last row comes after the clock
                self._clock = None
        return self._last_s

    def _devices(
        self, cell: Cell, where: Mapping[str, dict[str, Any]], clock: CellClock
    ) -> Devices:
        self._clock = clock
        self.callers.begin()
        late_s = clock.patience_s(0.0) if clock.shared is not None else 0.0
        self.note("run", "devices", {"speed": clock.speed, "late_s": late_s})
        return Devices.build(cell, where, clock, self)

    def _compute(self, job: Job, pool: Executor) -> Compute:
        # called on the loop of the run, whose threads write pictures and secured rows
        threads = ThreadPoolExecutor(thread_name_prefix="run")
        asyncio.get_running_loop().set_default_executor(_NotedThreads(self, threads))
        return Compute(job, _NotedPool(self, pool))

    def _on_row(self, number: int, kind: str, name: str) -> None:
        self.note("journal", "row", [number, kind, name])

    # --- as drivers' wires ----------------------------------------------------------------------

    def line(self, name: str) -> LineTap | None:
        """Return the tap of a serial line."""
        return _LineTap(self, name)

    def modbus(self, address: Address) -> tuple[Address, LineTap | None]:
        """Return the address unchanged, and the line's tap."""
        return address, _LineTap(self, str(address))

    def camera(self, name: str) -> CameraTap | None:
        """Return the tap of a camera."""
        return _CameraTap(self, name)

    def thread(self, name: str) -> Executor:
        """Return a thread."""
        return ThreadPoolExecutor(1, thread_name_prefix=name)


class _LineTap:
    def __init__(self, recorder: Recorder, wire: str) -> None:
        self._note = partial(recorder.note, wire)
        self._callers = recorder.callers

    async def turn(self, what: str) -> None:
        """Let every caller pass: the recording holds their order."""

    def taken(self, what: str) -> None:
        self._note("turn", [what, self._callers.name()])

    def opening(self, make: Callable[[], Opened]) -> Opened:
        return cast(Opened, _SerialTap(self._note, make()))

    def unanswered(self) -> None:
        self._note("unanswered")

    def opened(self, problem: str | None) -> None:
        self._note("opened", problem)

    def carried(self, data: bytes, *, sending: bool, in_time: bool) -> None:
        self._note("sent" if sending else "got" if in_time else "late", None, data)

    def lost(self) -> None:
        self._note("lost")


class _SerialTap:
    """A transport of three methods, as the arm's driver has it."""

    def __init__(self, note: Callable[..., None], inner: Any) -> None:  # noqa: ANN401  (write, read, aclose)
        self._note = note
        self._inner = inner

    def write(self, data: bytes) -> None:
        self._note("sent", None, data)
        try:
            self._inner.write(data)
        except Exception as error:
            self._note("failed", str(error))
            raise

    async def read(self, timeout_wall_s: float) -> bytes:
        try:
            data: bytes = await self._inner.read(timeout_wall_s)
        except Exception as error:
            self._note("failed", str(error))
            raise
        if data:
            self._note("got", None, data)
        return data

    async def aclose(self) -> None:
        await self._inner.aclose()


class _CameraTap:
    def __init__(self, recorder: Recorder, wire: str) -> None:
        self._recorder = recorder
        self._note = partial(recorder.note, wire)

    def call(self, what: str, sent: bytes, do: Callable[[], bytes]) -> bytes:
        try:
            answer = do()
        except OSError as error:
            self._note("call", [what, len(sent), error.errno], sent)
            raise
        self._note("call", [what, len(sent), 0], sent + answer)
        return answer

    def dequeue(self, do: Callable[[], bytes], stamp_us: Callable[[bytes], int]) -> Taken:
        try:
            raw = do()
        except BlockingIOError:
            raise
        except OSError as error:
            self._note("frame", [None, error.errno])
            raise
        self._note("frame", [self._recorder.cell_s(stamp_us(raw) * 1e-6), 0], raw)
        return Taken(raw)

    def picture(self, do: Callable[[], bytes]) -> bytes:
        data = do()
        self._note("picture", None, data)
        return data

    def readiness_fd(self, do: Callable[[], int]) -> int:
        return do()

    def other(self, do: Callable[[], Any]) -> Any:  # noqa: ANN401
        return do()


class _NotedPool(Executor):
    """An executor; notes when each of its answers was there."""

    wire = "compute"

    def __init__(self, recorder: Recorder, pool: Executor) -> None:
        self._recorder = recorder
        self._pool = pool
        self._count = 0

    def submit(self, fn: Callable[..., Result], /, *args: Any, **kwargs: Any) -> "Future[Result]":  # noqa: ANN401
        number, self._count = self._count, self._count + 1
        self._recorder.note(self.wire, "begun", [number, question_of(fn)])
        future = self._pool.submit(fn, *args, **kwargs)
        future.add_done_callback(
            lambda _: self._recorder.note(self.wire, "done", [number, question_of(fn)])
        )
        return future


class _NotedThreads(_NotedPool, ThreadPoolExecutor):
    """The threads of the run, in the class that asyncio requires."""

    wire = "threads"

    def __init__(self, recorder: Recorder, threads: ThreadPoolExecutor) -> None:
        _NotedPool.__init__(self, recorder, threads)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._pool.shutdown(wait, cancel_futures=cancel_futures)


class LineCallers:
    """Names the caller of a line, since two tasks may send the same request.

    The task that makes the devices is the batch, however it was started; any other goes by the name
    of its coroutine.
    """

    def __init__(self) -> None:
        self._batch: asyncio.Task[Any] | None = None

    def begin(self) -> None:
        """Register the running task as the batch's."""
        self._batch = asyncio.current_task()

    def name(self) -> str:
        """Return the name of the running task."""
        task = asyncio.current_task()
        if task is None or task is self._batch:
            return "batch"
        return str(getattr(task.get_coro(), "__qualname__", ""))


def question_of(fn: Callable[..., Any]) -> str:
    """Return the name of a function called elsewhere, without its wrappers."""
    inner = getattr(fn, "func", fn)
    if getattr(inner, "__name__", "") == "run" and getattr(fn, "args", ()):
        inner = fn.args[0]  # type: ignore[attr-defined]  # `asyncio.to_thread` runs it in a context
        inner = getattr(inner, "func", inner)
    return str(getattr(inner, "__name__", "?"))
