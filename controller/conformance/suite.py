"""The devices of a cell file, each with the means to try the requirements on it."""

from __future__ import annotations

import asyncio
import tempfile
import threading
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AsyncExitStack, ExitStack
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, TypeVar

from controller.cell.devices import DeviceBuilder, polling_of, resolve
from controller.cell.devices.clocks import FoundClock, find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_args, emulator_command
from controller.config import EMULATED, Cell, ConfigError, load_cell
from controller.config.files import file_sha256
from controller.config.interlock_rules import SIGNALS
from controller.planning.motion import slides
from controller.setup.drivers import KIND_OF, require_drivers
from controller.setup.layout import build_layout
from drivers.clock import CellClock
from drivers.kinds import Capture, Lamp

from .families import FAMILIES
from .lines import HOST_PORT, DeviceLine, EmulatedLine, PersonsLine, PortRelay
from .requirement import (
    MeasuredFigure,
    NotMetError,
    NotTriedError,
    Requirement,
    Stopwatch,
    TestBench,
    TimeLimits,
)

MET: Final = "met"
NOT_MET: Final = "not met"
NOT_TRIED: Final = "not tried"
WITHOUT_MOTION: Final = "it moves metal; allow it with --allow-motion"
WITHOUT_CONSENT: Final = (
    "it commands the device; allow it with --allow-motion, and agree at a terminal"
)
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class RequirementResult:
    """Result of a requirement tried on a device.

    Attributes
    ----------
    name, text : name and text of the requirement
    verdict : `MET`, `NOT_MET` or `NOT_TRIED`
    figure : measured value; None unless the bound was met
    message : reason
    """

    name: str
    text: str
    verdict: str
    figure: MeasuredFigure | None = None
    message: str = ""

    @property
    def words(self) -> str:
        """The result in a line."""
        return self.message if self.figure is None else str(self.figure)


@dataclass(slots=True)
class TriedDevice:
    """A device and its result.

    Attributes
    ----------
    name, kind, driver, address : identity of the device, as in the cell file
    is_emulated : whether the emulated cell has it
    model, firmware : as the device names itself, empty before it has answered
    outcomes : one for each requirement tried so far
    """

    name: str
    kind: str
    driver: str
    address: str
    is_emulated: bool
    model: str = ""
    firmware: str = ""
    outcomes: list[RequirementResult] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Findings:
    """Content of the report.

    Attributes
    ----------
    cell, path, sha256 : name, file and content of the cell file
    begun : start time [UTC]
    devices : each with its outcomes
    """

    cell: str
    path: Path
    sha256: str
    begun: datetime
    devices: tuple[TriedDevice, ...]


async def try_requirement(
    bench: TestBench, requirement: Requirement, *, may_move: bool
) -> RequirementResult:
    """Try a requirement on a device and return the outcome; never raises for a device.

    Parameters
    ----------
    bench : with the device
    requirement : requirement of its kind
    may_move : whether metal may move
    """

    def outcome(verdict: str, message: str) -> RequirementResult:
        return RequirementResult(requirement.name, requirement.text, verdict, None, message)

    if requirement.moves and not may_move:
        return outcome(NOT_TRIED, WITHOUT_MOTION)
    if requirement.acts and not bench.may_act:
        return outcome(NOT_TRIED, WITHOUT_CONSENT)
    try:
        figure = await requirement.trial(bench)
    except (NotTriedError, InterruptedError) as why:
        return outcome(NOT_TRIED, str(why))
    except NotMetError as why:
        await bench.close()
        return outcome(NOT_MET, str(why))
    except Exception as error:  # noqa: BLE001  (a driver under test may raise anything)
        await bench.close()
        return outcome(NOT_MET, f"{type(error).__name__}: {error}")
    return RequirementResult(requirement.name, requirement.text, MET, figure)


class Suite:
    """A cell whose devices are tried; `open`, then `attempt` one by one, then `close`.

    Drivers live on an event loop in a thread of its own, so that the cell's clock keeps running
    while pytest does something else.

    Parameters
    ----------
    path : cell file
    only : names of the devices to try, empty for all
    speed : speed of the emulated cell, times real time
    allow_motion : whether metal may move at all
    prompt : shows a request, returns whether a person agrees or has done it

    Raises
    ------
    ConfigError : the cell file cannot be used, or has no such device
    """

    def __init__(
        self,
        path: Path,
        only: Sequence[str],
        *,
        speed: float,
        allow_motion: bool,
        prompt: Callable[[str], bool],
    ) -> None:
        self._path = path
        self._cell = load_cell(path)
        require_drivers(path, self._cell)
        for name in only:
            if name not in KIND_OF:
                raise ConfigError(f"no device `{name}`; there are {', '.join(KIND_OF)}")
        self._speed = speed
        self._allow_motion = allow_motion
        self._prompt = prompt
        self._stack = ExitStack()
        self._loop = asyncio.new_event_loop()
        self._control: Path | None = None
        self._agreed: dict[str, bool] = {}
        self._benches: dict[str, TestBench] = {}
        self.tried = {
            name: TriedDevice(
                name,
                kind,
                getattr(self._cell.devices, name).driver,
                getattr(self._cell.devices, name).address,
                getattr(self._cell.devices, name).address == EMULATED,
            )
            for name, kind in KIND_OF.items()
            if not only or name in only
        }
        self._begun = datetime.now(UTC)

    def open(self) -> None:
        """Start the emulated cell, if a device to be tried is in it, and the event loop.

        Raises
        ------
        ConfigError, EmulatorError, LinkError : cell file, emulated cell or its clock is unusable
        """
        emulated = [tried for tried in self.tried.values() if tried.is_emulated]
        ready: Mapping[str, Any] = {}
        if emulated:
            folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="cellctl-")))
            self._control = folder / "control"
            is_mixed = len(emulated) < len(self.tried)
            command = emulator_command(
                self._path,
                (),
                speed=1.0 if is_mixed else self._speed,
                seed=1,
                more=emulator_args(None, None, self._control),
            )
            ready = self._stack.enter_context(emulated_cell(command))
        self._where = resolve(
            self._cell,
            {
                **dict.fromkeys(self._cell.emulated_devices, "not started"),
                **ready.get("devices", {}),
            },
        )
        self._clock = self._find_clock(emulated, ready).open()
        self._stack.callback(self._clock.close)
        thread = threading.Thread(target=self._loop.run_forever, name="devices", daemon=True)
        thread.start()
        self._stack.callback(self._end_loop, thread)
        self._stopwatch = Stopwatch(self._clock)
        attending = AsyncExitStack()
        self._stack.callback(lambda: self._run(attending.aclose()))
        for attends in (self._clock.attending(), self._stopwatch.attending()):
            self._run(attending.enter_async_context(attends))

    def _find_clock(self, emulated: Sequence[TriedDevice], ready: Mapping[str, Any]) -> FoundClock:
        if not emulated:
            is_plain = bool(self._cell.emulated_devices)
            return FoundClock() if is_plain else find_clock(self._cell, {})
        if len(emulated) < len(self.tried):
            return FoundClock(is_mixed=True)
        return FoundClock(Path(ready["clock"]), float(ready["speed"]))

    def _end_loop(self, thread: threading.Thread) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        thread.join()
        self._loop.close()

    def _run(self, doing: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine on the devices' loop; an interrupt cancels it, and waits for its end."""
        future: Future[_T] = asyncio.run_coroutine_threadsafe(doing, self._loop)
        try:
            return future.result()
        except BaseException:
            if not future.done():
                future.cancel()
                asyncio.run_coroutine_threadsafe(asyncio.sleep(0.2), self._loop).result()
            raise

    def requirements(self, name: str) -> tuple[Requirement, ...]:
        """Return the requirements of a device."""
        return FAMILIES[self.tried[name].kind]

    def attempt(self, name: str, requirement: Requirement) -> RequirementResult:
        """Try a requirement on a device, note the outcome, return it."""
        tried = self.tried[name]
        needs_consent = requirement.moves or requirement.acts
        may_move = self._allow_motion and needs_consent and self._agrees(tried)
        outcome = self._run(self._attempt(name, requirement, may_move=may_move))
        tried.outcomes.append(outcome)
        return outcome

    def _may_command(self, name: str) -> bool:
        """Return whether the device is emulated, or a person has agreed already."""
        return self.tried[name].is_emulated or self._agreed.get(name, False)

    def _agrees(self, tried: TriedDevice) -> bool:
        """Return whether a person agrees that a real device moves; asked for once a device."""
        if tried.is_emulated:
            return True
        if tried.name not in self._agreed:
            self._agreed[tried.name] = self._prompt(
                f"`{tried.name}` is about to be commanded, and what can move will. Take every "
                "part out of it, clear its reach, stand by the emergency stop"
            )
        return self._agreed[tried.name]

    async def _attempt(
        self, name: str, requirement: Requirement, *, may_move: bool
    ) -> RequirementResult:
        bench = self._benches.get(name)
        if bench is None:
            bench = self._benches[name] = await self._bench(name)
        tried = self.tried[name]
        # set anew for each requirement: one that needs nobody's consent gets no verb either
        bench.may_act = tried.is_emulated or may_move
        outcome = await try_requirement(bench, requirement, may_move=may_move)
        if bench.device is not None:
            tried.model = str(bench.device.model)
            tried.firmware = str(getattr(bench.device, "firmware", "") or "")
        return outcome

    async def _bench(self, name: str) -> TestBench:
        kind = KIND_OF[name]
        where = dict(self._where)
        line = await self._line(name)
        if isinstance(line, PortRelay):
            where[name] = where[name] | {"address": await line.start()}
        cell, builders = self._cell, list[DeviceBuilder]()

        def build() -> Any:  # noqa: ANN401  (a device of any kind)
            builders.append(DeviceBuilder(cell, where, self._clock))
            return builders[-1].device(name)

        async def release() -> None:
            while builders:
                for link in builders.pop().links:
                    await link.aclose()

        return TestBench(
            name,
            kind,
            build,
            self._clock,
            self._stopwatch,
            _bounds(cell, self._clock),
            line,
            _facts(cell, name, kind),
            release,
        )

    async def _line(self, name: str) -> DeviceLine:
        section = self._where[name]
        if HOST_PORT.fullmatch(section["address"]):
            return PortRelay(section["address"])
        if section["emulated"] and self._control is not None:
            if KIND_OF[name] == "arm":
                return EmulatedLine.of_arm(self._control)
            if KIND_OF[name] == "camera":
                return EmulatedLine.of_camera(self._control, name)
        return PersonsLine(name, self._prompt)

    def findings(self) -> Findings:
        """Return the content of the report."""
        return Findings(
            self._cell.name,
            self._path,
            file_sha256(self._path),
            self._begun,
            tuple(self.tried.values()),
        )

    def close(self) -> None:
        """Release all devices and end the emulated cell."""
        if not self._benches and not self._loop.is_running():
            self._stack.close()
            return
        self._run(self._close_all())
        self._stack.close()

    async def _close_all(self) -> None:
        for name, bench in self._benches.items():
            if bench.kind == "lights" and bench.device is not None and self._may_command(name):
                bench.may_act = True
                await try_requirement(bench, _LIGHTS_OFF, may_move=True)
            await bench.close()
            await bench.line.aclose()


async def _lights_off(bench: TestBench) -> MeasuredFigure:
    await bench.device.all_off()
    return MeasuredFigure()


_LIGHTS_OFF: Final = Requirement("off", "Lamps are off in the end.", _lights_off)


def _bounds(cell: Cell, clock: CellClock) -> TimeLimits:
    polling = polling_of(cell, clock)
    return TimeLimits(
        stop_s=cell.detection.stop_confirm_s,
        arm_silent_s=cell.detection.arm_silent_s,
        stale_s=polling.stale_s,
        poll_s=polling.poll_s,
        frame_late_s=cell.timing.frame_late_s,
    )


def _facts(cell: Cell, name: str, kind: str) -> dict[str, Any]:
    """Return the cell file's values for a device."""
    if kind == "lights":
        return {"lamps": tuple(Lamp(n, s.analog, s.relay) for n, s in cell.lamps.items())}
    if kind == "io":
        return {"inputs": SIGNALS}
    if kind == "camera":
        camera = getattr(cell.cameras, name)
        width, height = camera.size_px
        return {
            "capture": Capture(
                width,
                height,
                camera.formats,
                camera.fps,
                camera.exposure_s,
                camera.settle_frames,
                camera.margin_s,
                cell.timing.frame_late_s,
            )
        }
    if kind == "arm":
        layout = build_layout(cell)
        return {
            "park_q": layout.park_q,
            "slides": slides(layout.arm),
            "within_limits": layout.arm.within_limits,
        }
    return {}


def try_emulated(path: Path, name: str) -> tuple[RequirementResult, ...]:
    """Return what came of each requirement on one device of a cell file, known to be emulated.

    For the tests of a driver (docs/drivers.md). Nobody is asked: whoever calls this vouches that no
    metal is behind the device's address. A real device is tried by `pytest --cell`.

    Parameters
    ----------
    path : cell file
    name : name of the device in it

    Raises
    ------
    ConfigError : the cell file cannot be used, or has no such device
    """
    suite = Suite(path, (name,), speed=1.0, allow_motion=True, prompt=lambda _: True)
    try:
        suite.open()
        return tuple(suite.attempt(name, one) for one in suite.requirements(name))
    finally:
        suite.close()
