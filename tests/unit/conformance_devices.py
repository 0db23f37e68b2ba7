"""Devices in memory that meet every requirement of their kind, to be broken one by one."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from controller.conformance.requirement import Stopwatch, TestBench, TimeLimits
from drivers.clock import CellClock
from drivers.errors import (
    LinkError,
    MotionStoppedError,
    PositionLostError,
    ReplyTimeoutError,
    StalledError,
    UnpluggedError,
)
from drivers.kinds import Capture, Change, Hold, JawReading, Lamp, Signal, Stop

REPLY_S = 0.005
SILENT_S = 0.4
BOUNDS = TimeLimits(stop_s=1.0, arm_silent_s=0.5, stale_s=0.2, poll_s=0.04, frame_late_s=0.5)
CAPTURE = Capture(64, 48, ("GREY",), 5.0, 0.01, 0, 0.0, 0.5)
LAMPS = (Lamp("ring", 0, 0), Lamp("bar", 1, 1))
INPUTS = ("estop_ok", "guard_closed")
PARK_Q = np.zeros(6)
SLIDES = np.array([False, False, False, False, False, True])
RANGE = np.where(SLIDES, 200.0, 3.0)


class MemoryLine:
    """A line that is disturbed by a flag, and counts what is said to have been sent."""

    counts_bytes = True

    def __init__(self) -> None:
        self.sent_count = 0
        self.is_silent = self.is_cut = False

    async def silence(self) -> None:
        self.is_silent = True

    async def cut(self) -> None:
        self.is_cut = True

    async def mend(self) -> None:
        self.is_silent = self.is_cut = False

    async def aclose(self) -> None:
        await self.mend()


class Device:
    """What the devices share: a line, a clock, an exchange of 8 bytes."""

    model = "device in memory"

    def __init__(self, line: MemoryLine, clock: CellClock, body: Any) -> None:
        self.line, self.clock, self.body = line, clock, body
        self.is_open = False
        self.turn = asyncio.Lock()

    async def exchange(self) -> None:
        if not self.is_open:
            raise LinkError("not connected")
        async with self.turn:
            self.line.sent_count += 8
            if self.line.is_cut:
                self.is_open = False
                raise UnpluggedError("cut")
            if self.line.is_silent:
                await self.clock.sleep(SILENT_S)
                raise ReplyTimeoutError("silent")
            await self.clock.sleep(REPLY_S)

    async def open(self) -> None:
        if self.line.is_cut:
            raise LinkError("cut")
        self.is_open = True
        await self.exchange()

    async def aclose(self) -> None:
        self.is_open = False


class Jaws:
    """The metal of the gripper, on the clock."""

    speed_mm_s = 60.0

    def __init__(self, clock: CellClock) -> None:
        self.clock = clock
        self.is_activated = False
        self.from_mm = self.target_mm = 30.0
        self.since_s = 0.0

    @property
    def opening_mm(self) -> float:
        way_mm = self.target_mm - self.from_mm
        done_mm = (self.clock.now_s() - self.since_s) * self.speed_mm_s
        return self.from_mm + float(np.clip(way_mm, -done_mm, done_mm))

    @property
    def is_moving(self) -> bool:
        return abs(self.opening_mm - self.target_mm) > 0.01

    def send(self, target_mm: float) -> None:
        self.from_mm, self.since_s = self.opening_mm, self.clock.now_s()
        self.target_mm = target_mm


class MemoryGripper(Device):
    max_opening_mm = 80.0
    body: Jaws

    async def connect(self) -> Any:
        await self.open()
        return await self.status()

    async def status(self) -> Any:
        await self.exchange()
        jaws = self.body
        return SimpleNamespace(
            opening_mm=jaws.opening_mm,
            is_activated=jaws.is_activated,
            has_fault=False,
            is_moving=jaws.is_moving,
            has_contact=False,
            has_arrived=not jaws.is_moving,
        )

    async def hold(self) -> Hold:
        await self.exchange()
        return Hold.NOTHING

    async def activate(self) -> None:
        await self.exchange()
        self.body.is_activated = True

    def check(self, opening_mm: float, force_n: float = 1.0) -> None:
        if not 0.0 <= opening_mm <= self.max_opening_mm or not 0.0 < force_n < 200.0:
            raise ValueError(f"{opening_mm} mm, {force_n} N")

    async def move(self, target_mm: float) -> None:
        await self.exchange()
        self.body.send(target_mm)
        try:
            while self.body.is_moving:
                await self.exchange()
        except asyncio.CancelledError:
            await asyncio.shield(self.stop())
            raise

    async def open_to(self, opening_mm: float) -> None:
        self.check(opening_mm)
        await self.move(opening_mm)
        if abs(self.body.opening_mm - opening_mm) > 0.1:
            raise StalledError("stopped")

    async def close_on(self, opening_mm: float, *, force_n: float) -> Any:
        self.check(opening_mm, force_n)
        await self.move(max(0.0, opening_mm - 5.0))
        return SimpleNamespace(object_detected=False, opening_mm=self.body.opening_mm)

    async def stop(self) -> None:
        self.body.send(self.body.opening_mm)
        await self.exchange()


class MemoryLights(Device):
    names = ("ring", "bar")

    async def connect(self) -> None:
        await self.open()

    async def set(self, levels: dict[str, float], *, settle: bool = False) -> float:
        for name, level in levels.items():
            if name not in self.names or not 0.0 <= level <= 1.0:
                raise ValueError(f"{name} {level}")
        await self.exchange()
        if settle:
            await self.clock.sleep(0.05)
        return self.clock.now_s()

    async def all_off(self) -> float:
        return await self.set(dict.fromkeys(self.names, 0.0))


class MemoryIo(Device):
    def __init__(self, line: MemoryLine, clock: CellClock, body: Any) -> None:
        super().__init__(line, clock, body)
        self.signals = dict.fromkeys(INPUTS, Signal.UNKNOWN)
        self.watches: list[MemoryWatch] = []
        self.poller: asyncio.Task[None] | None = None

    async def connect(self) -> None:
        await self.open()
        self.poller = asyncio.create_task(self.poll())

    async def poll(self) -> None:
        while True:
            try:
                if not self.is_open:
                    await self.open()
                async with self.clock.timeout(BOUNDS.stale_s):
                    await self.exchange()
            except (LinkError, TimeoutError):
                self.publish(Signal.UNKNOWN)
            else:
                self.publish(Signal.OK)
            await self.clock.sleep(BOUNDS.poll_s)

    def publish(self, signal: Signal) -> None:
        for name, before in self.signals.items():
            if before is not signal:
                self.signals[name] = signal
                for watch in self.watches:
                    watch.queue.put_nowait(Change(name, signal, before, self.clock.now_s()))

    def signal(self, name: str) -> Signal:
        if name not in self.signals:
            raise ValueError(name)
        return self.signals[name]

    def watch(self) -> MemoryWatch:
        self.watches.append(MemoryWatch())
        return self.watches[-1]

    async def wait_for(self, name: str, signal: Signal) -> None:
        if self.signal(name) is signal:
            return
        with self.watch() as changes:
            async for change in changes:
                if (change.name, change.signal) == (name, signal):
                    return

    async def clear_watchdog(self) -> None:
        await self.exchange()

    async def aclose(self) -> None:
        if self.poller is not None:
            self.poller.cancel()
            self.poller = None
            self.publish(Signal.UNKNOWN)
            for watch in self.watches:
                watch.queue.put_nowait(None)
        await super().aclose()


class MemoryWatch:
    def __init__(self) -> None:
        self.queue: asyncio.Queue[Change | None] = asyncio.Queue()

    def __enter__(self) -> MemoryWatch:
        return self

    def __exit__(self, *_: object) -> None:
        return

    def __aiter__(self) -> MemoryWatch:
        return self

    async def __anext__(self) -> Change:
        change = await self.queue.get()
        if change is None:
            raise StopAsyncIteration
        return change


class MemoryCamera(Device):
    shape = (CAPTURE.height, CAPTURE.width)
    is_paused = False
    white = 255

    async def connect(self) -> None:
        if self.is_open:
            raise ValueError("connected already")
        await self.open()
        self.is_paused = False

    async def close(self) -> None:
        self.is_open = False

    async def pause(self) -> None:
        self.is_paused = True

    async def resume(self) -> None:
        self.is_paused = False

    def picture(self) -> NDArray[Any]:
        return np.full(self.shape, 100, dtype=np.uint8)

    def frame_end_s(self, t_s: float) -> float:
        """Frames end at whole periods; the first whose exposure began after t is wanted."""
        begins = np.ceil((t_s + CAPTURE.exposure_s) * CAPTURE.fps)
        return float(begins / CAPTURE.fps)

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> Any:
        if self.is_paused:
            raise ValueError("paused")
        end_s = self.frame_end_s(t_s)
        if timeout_s is not None and end_s > self.clock.now_s() + timeout_s:
            await self.clock.sleep(timeout_s)
            raise ReplyTimeoutError("no frame")
        if self.line.is_cut:
            self.is_open = False
            raise UnpluggedError("unplugged")
        await self.clock.sleep(end_s - self.clock.now_s())
        return SimpleNamespace(image=self.picture(), white=self.white)


class Body:
    """The metal of the arm, on the clock."""

    speed = RANGE / 5.0

    def __init__(self, clock: CellClock) -> None:
        self.clock = clock
        self.from_q = self.target_q = PARK_Q.copy()
        self.since_s = 0.0
        self.jaws_mm = 40.0

    @property
    def q(self) -> NDArray[np.float64]:
        done = (self.clock.now_s() - self.since_s) * self.speed
        return np.asarray(self.from_q + np.clip(self.target_q - self.from_q, -done, done))

    def send(self, q: NDArray[np.float64]) -> None:
        self.from_q, self.since_s = self.q, self.clock.now_s()
        self.target_q = q


class MemoryArm(Device):
    max_opening_mm = 85.0
    body: Body
    is_homed = False
    identity: Any = None
    stop_count = 0

    async def connect(self) -> Any:
        await self.open()
        self.identity = SimpleNamespace(was_restarted=True)
        return self.identity

    async def enable_power(self) -> None:
        await self.exchange()

    async def home(self) -> None:
        await self.exchange()
        self.is_homed = True

    def require_homed(self) -> None:
        if not self.is_homed:
            raise PositionLostError("not homed")

    async def read_q(self) -> NDArray[np.float64]:
        self.require_homed()
        await self.exchange()
        return self.body.q

    def check(self, q: NDArray[np.float64], speed_share: float) -> None:
        if q.shape != (6,) or not (np.abs(q) <= RANGE).all() or not 0.0 < speed_share <= 1.0:
            raise ValueError(f"{q}, {speed_share}")

    async def move_joints(self, q: NDArray[np.float64], *, speed_share: float = 1.0) -> None:
        self.check(q, speed_share)
        self.require_homed()
        await self.exchange()
        self.body.send(q)
        stop_count = self.stop_count
        try:
            while not np.allclose(self.body.q, self.body.target_q, atol=1e-9):
                await self.exchange()
        except asyncio.CancelledError:
            await asyncio.shield(self.stop(Stop.DEAD))
            raise
        if self.stop_count != stop_count:
            raise MotionStoppedError("stopped")

    async def stop(self, kind: Stop) -> None:
        del kind
        self.stop_count += 1
        self.body.send(self.body.q)
        await self.exchange()

    async def grasp(self, force: int, *, speed_share: float = 1.0) -> float:
        del speed_share
        if not 1 <= force <= 100:
            raise ValueError(f"{force}")
        return 0.0

    async def move_gripper_mm(self, opening_mm: float) -> float:
        if not 0.0 <= opening_mm <= self.max_opening_mm:
            raise ValueError(f"{opening_mm}")
        await self.exchange()
        self.body.jaws_mm = opening_mm
        return opening_mm

    async def read_opening_mm(self) -> float:
        await self.exchange()
        return self.body.jaws_mm

    async def read_jaws(self) -> JawReading:
        await self.exchange()
        return JawReading(is_pressing=False, opening_mm=self.body.jaws_mm)


SOUND: dict[str, type[Device]] = {
    "arm": MemoryArm,
    "gripper": MemoryGripper,
    "lights": MemoryLights,
    "io": MemoryIo,
    "camera": MemoryCamera,
}
BODIES: dict[str, type[Any]] = {"arm": Body, "gripper": Jaws}


def bench_of(kind: str, make: type[Device], clock: CellClock) -> TestBench:
    line = MemoryLine()
    body = BODIES[kind](clock) if kind in BODIES else None
    facts = {
        "lamps": LAMPS,
        "inputs": INPUTS,
        "capture": CAPTURE,
        "park_q": PARK_Q,
        "slides": SLIDES,
        "within_limits": lambda q: bool((np.abs(q) <= RANGE).all()),
    }
    return TestBench(
        kind, kind, lambda: make(line, clock, body), clock, Stopwatch(clock), BOUNDS, line, facts
    )
