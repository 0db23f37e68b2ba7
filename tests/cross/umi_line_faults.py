"""A whole session of the arm on a line where exactly one byte goes wrong; judged by the motors.

Driver, wire and model share one thread and a clock that jumps, so that a session takes a fraction
of a second. A *place* is a byte that the session without a fault put on the line; a fault strikes
at one place, once. What moved is read from the emulated motors, never from the driver.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import random
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Literal

from umi_bench import EMULATED

from drivers.clock import CellClock
from drivers.errors import DeviceError, LinkError
from drivers.umi_scara import ArmConfig, Axis, HomingConfig, LinkConfig, Stop, UmiScara
from drivers.umi_scara.motion import Axes
from emulators.umi_scara import ArmModel, ArmWire

Way = Literal["to the arm", "from the arm"]
Kind = Literal["flipped", "lost", "doubled", "late"]
SessionName = Literal["moves", "homing"]

STILL_COUNTS = 4.0  # DEAD_BAND and the driver's slack of 2: less is no motion
NEAR_COUNTS = 4.5  # of a target; half a count more, since counters are whole
HOMED_COUNTS = 6.5  # of a label: one count of rounding at the elbow's stop (§4.2), and a dither
WIDTH_MM = 0.5  # of a jaw width; 5 counts are 0.4 mm
MAX_BURST = 5  # bytes; the longest command has 3, and the gap before a request room for 8
BYTE_S = 10 / 9600  # umi_rtx.md 1.1: 9600 baud, 10 bits a byte
PATIENCE_S = 400.0  # a session that takes longer hangs
PARK = {axis: -18 if axis is Axis.ZED else 0 for axis in Axis}
# umi_rtx.md 1.3, 2.6, 2.7: which motor a bit of a go means
MOTORS = {
    0: {2: Axis.WRIST1, 3: Axis.WRIST2},
    1: {0: Axis.ELBOW, 1: Axis.SHOULDER, 2: Axis.ZED, 3: Axis.YAW, 4: Axis.GRIPPER},
}
# near the stops that homing drives against, so that homing is short
BEFORE_HOMING = {
    Axis.ZED: -40.0, Axis.SHOULDER: 2560.0, Axis.ELBOW: -2500.0, Axis.YAW: -1800.0,
    Axis.WRIST1: -2900.0, Axis.WRIST2: 400.0, Axis.GRIPPER: 60.0,
}  # fmt: skip
NEAR_PARK = {
    Axis.ZED: -18, Axis.SHOULDER: 2500, Axis.ELBOW: -2400, Axis.YAW: -1750,
    Axis.WRIST1: -2900, Axis.WRIST2: 400, Axis.GRIPPER: 20,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class LineFault:
    """One byte that goes wrong.

    Attributes
    ----------
    place : number of the byte, counted from 0 in its direction
    bit : which bit is flipped
    late_s : how much later the byte comes, and all bytes behind it [cell s]
    """

    way: Way
    place: int
    kind: Kind
    bit: int = 0
    late_s: float = 0.0


@dataclass(slots=True)
class Noise:
    """Bursts of random bytes on the idle line, between two exchanges.

    Attributes
    ----------
    seed : draws when a burst comes, which way, and its bytes
    rate : share of the gaps between exchanges that have a burst
    ways : in which direction bursts go
    burst_count : how many there were
    """

    seed: int
    rate: float
    ways: tuple[Way, ...] = ("to the arm", "from the arm")
    burst_count: int = 0
    _rng: random.Random = field(init=False)

    def __post_init__(self) -> None:
        self._rng = random.Random(self.seed)

    def burst(self, now_s: float) -> tuple[Way, list[tuple[float, bytes]]] | None:
        """Return what a gap that begins now gets: a way, and bytes with their instants."""
        if self._rng.random() >= self.rate:
            return None
        self.burst_count += 1
        at_s = now_s + self._rng.uniform(0.0005, 0.003)
        data = [self._rng.randrange(256) for _ in range(self._rng.randint(1, MAX_BURST))]
        timed = [(at_s + BYTE_S * i, bytes([byte])) for i, byte in enumerate(data)]
        return self._rng.choice(self.ways), timed


class LineClock(CellClock):
    """A clock that advances only by what somebody waits, and takes the line along."""

    def __init__(self) -> None:
        super().__init__()
        vars(self)["instant_s"] = 1000.0

    def now_s(self) -> float:
        return float(vars(self)["instant_s"])

    def set_s(self, instant_s: float) -> None:
        vars(self)["instant_s"] = max(self.now_s(), instant_s)

    def attach(self, line: "JumpingLine") -> None:
        vars(self)["line"] = line

    def advance(self, duration_s: float) -> None:
        vars(self)["line"].pass_time(duration_s)

    async def sleep(self, duration_s: float) -> None:
        self.advance(max(0.0, duration_s))
        await asyncio.sleep(0)


@dataclass
class JumpingLine:
    """Both directions of the line, and the arm behind it, as one transport.

    Attributes
    ----------
    asked : axes that may move at present
    moved : largest way of an axis that was not asked to move [counts], by name
    """

    clock: LineClock
    model: ArmModel
    wire: ArmWire
    fault: LineFault | None = None
    noise: Noise | None = None
    asked: set[Axis] = field(default_factory=set)
    moved: dict[Axis, float] = field(default_factory=dict)
    counts: dict[Way, int] = field(default_factory=lambda: {"to the arm": 0, "from the arm": 0})
    has_struck: bool = False
    is_mute: bool = False
    on_write: Callable[[bytes], None] | None = None
    exchange_count: int = 0
    _rest: dict[Axis, float] = field(default_factory=dict)
    _to_arm: list[tuple[float, bytes]] = field(default_factory=list)
    _from_arm: list[tuple[float, bytes]] = field(default_factory=list)

    # ---- judging -------------------------------------------------------------------------------
    def true(self, axis: Axis) -> float:
        return self.model.axes[EMULATED[axis]].position

    def allow(self, axes: set[Axis]) -> None:
        """From now on these axes may move, and all others stay where they are."""
        self.asked = axes
        self._rest = {axis: self.true(axis) for axis in Axis if axis not in axes}

    def _judge(self) -> None:
        for axis, rest in self._rest.items():
            way = abs(self.true(axis) - rest)
            if way > self.moved.get(axis, 0.0):
                self.moved[axis] = way

    # ---- time ----------------------------------------------------------------------------------
    def pass_time(self, duration_s: float) -> None:
        until_s = self.clock.now_s() + max(0.0, duration_s)
        while True:
            now_s = self.clock.now_s()
            next_s = min(until_s, self._next_s(until_s))
            self.model.advance(next_s - now_s)
            self.clock.set_s(next_s)
            self._judge()
            self._carry()
            if next_s >= until_s:
                return

    def _next_s(self, otherwise_s: float) -> float:
        due = [at_s for at_s, _ in self._to_arm]
        reply_s = self.wire.next_due_s()
        if reply_s is not None:
            due.append(reply_s)
        return max(min(due, default=otherwise_s), self.clock.now_s())

    def _carry(self) -> None:
        now_s = self.clock.now_s()
        while self._to_arm and self._to_arm[0][0] <= now_s + 1e-9:
            self.wire.feed(self._to_arm.pop(0)[1], now_s)
        if data := self.wire.due(now_s):
            self._queue("from the arm", data, self._from_arm)

    def _queue(self, way: Way, data: bytes, queue: list[tuple[float, bytes]]) -> None:
        for byte in data:
            late_s, sent = self._strike(way, byte)
            at_s = self.clock.now_s() + late_s
            if queue:  # a line keeps the order of its bytes
                at_s = max(at_s, queue[-1][0])
            queue.append((at_s, sent))

    def _strike(self, way: Way, byte: int) -> tuple[float, bytes]:
        place = self.counts[way]
        self.counts[way] += 1
        fault = self.fault
        if self.is_mute:
            return 0.0, b""
        if fault is None or self.has_struck or (fault.way, fault.place) != (way, place):
            return 0.0, bytes([byte])
        self.has_struck = True
        match fault.kind:
            case "flipped":
                return 0.0, bytes([byte ^ 1 << fault.bit])
            case "lost":
                return 0.0, b""
            case "doubled":
                return 0.0, bytes([byte, byte])
            case "late":
                return fault.late_s, bytes([byte])

    # ---- the three methods of a transport ------------------------------------------------------
    def write(self, data: bytes) -> None:
        self.exchange_count += 1
        if self.on_write is not None:
            self.on_write(data)
        self._queue("to the arm", data, self._to_arm)
        self._carry()

    async def read(self, timeout_wall_s: float) -> bytes:
        await asyncio.sleep(0)
        until_s = self.clock.now_s() + timeout_wall_s
        while True:
            now_s = self.clock.now_s() + 1e-9
            data = b"".join(sent for at_s, sent in self._from_arm if at_s <= now_s)
            self._from_arm = [one for one in self._from_arm if one[0] > now_s]
            left_s = until_s - self.clock.now_s()
            if data or left_s <= 0:
                self._disturb(data)
                return data
            next_s = min([self._next_s(until_s), *(at_s for at_s, _ in self._from_arm), until_s])
            self.pass_time(max(next_s - self.clock.now_s(), 1e-6))

    def _disturb(self, reply: bytes) -> None:
        """Put noise on the line once a reply is through, and nothing else is on its way."""
        if self.noise is None or not reply or self._to_arm or self._from_arm:
            return
        if (burst := self.noise.burst(self.clock.now_s())) is not None:
            self.has_struck = True
            way, timed = burst
            (self._to_arm if way == "to the arm" else self._from_arm).extend(timed)

    async def aclose(self) -> None:
        pass


@dataclass
class Result:
    """What one session came to.

    Attributes
    ----------
    end : the session went through without an error; went on after one, with all verbs done in the
        end; or ended with one: a verb was not done, or the arm does not know where it is
    moved : ways of axes that were not asked to move, above STILL_COUNTS [counts]
    largest_counts : the largest such way, however small
    false_done : what the driver said was done and is not
    runs_on : axes that still move after the last verb
    """

    end: Literal["clean", "recovered", "went on after a fault", "fault", "bug", "hangs"]
    errors: list[str]
    moved: dict[str, float]
    largest_counts: float
    false_done: list[str]
    runs_on: list[str]
    place_counts: dict[Way, int]
    exchange_count: int
    cell_s: float
    burst_count: int = 0

    @property
    def is_bad(self) -> bool:
        return bool(self.moved or self.false_done or self.runs_on) or self.end in ("bug", "hangs")


def axes_of(arm: UmiScara) -> Axes | None:
    try:
        return arm.axes
    except LinkError:
        return None


class Session:
    """The verbs of a session, each judged by the motors when it says that it is done."""

    def __init__(
        self,
        fault: LineFault | None = None,
        silence_s: float = 0.5,
        noise: Noise | None = None,
    ) -> None:
        self.clock = LineClock()
        self.model = ArmModel(seed=3)
        self.wire = ArmWire(self.model)
        self.line = JumpingLine(self.clock, self.model, self.wire, fault, noise)
        self.clock.attach(self.line)
        self.wire._line_free_s = self.wire._reply_free_s = self.clock.now_s()
        self.line.on_write = self._hear
        self.noise = noise
        self.errors: list[str] = []
        self.false_done: list[str] = []
        self.undone: set[str] = set()
        self.is_homing = self.was_homed = False
        self.stop_after = 0
        self.stop_kind = Stop.DEAD
        self.stopping: asyncio.Task[None] | None = None
        config = ArmConfig(
            homing=HomingConfig(park_counts=NEAR_PARK), link=LinkConfig(silence_s=silence_s)
        )
        self.arm = UmiScara(lambda: self.line, config=config, clock=self.clock)

    # ---- what is asked -------------------------------------------------------------------------
    def _hear(self, data: bytes) -> None:
        """While the arm homes, a go says which axes may move; a fault comes only later."""
        if self.stop_after and data[0] in range(0x10, 0x18):
            self.stop_after -= 1
            if not self.stop_after:
                self.stopping = asyncio.get_running_loop().create_task(
                    self.arm.stop(self.stop_kind)
                )
        axes = axes_of(self.arm)
        if not self.is_homing or axes is None or axes.link.listening is None:
            return
        motors = MOTORS[int(axes.link.listening)]
        if data[0] & 0xE0 == 0xA0:
            asked = {axis for ctl, axis in motors.items() if data[0] >> ctl & 1}
        elif data[0] == 0x80:
            word = data[1] | data[2] << 8
            asked = {axis for ctl, axis in motors.items() if word >> 2 * ctl & 3}
        else:
            return
        if not asked:
            return
        if Axis.ELBOW in asked:
            asked |= {Axis.YAW}  # the forearm drags the hand along (§5.4)
        if data[0] & 0xE0 == 0xA0 and self.line.asked:
            asked |= self.line.asked  # the boards start one after the other
        self.line.allow(asked)

    async def _do(
        self,
        what: str,
        asked: set[Axis],
        verb: Callable[[], Awaitable[object]],
        goal: dict[Axis, int] | None = None,
        near: float = NEAR_COUNTS,
        opening_mm: float | None = None,
    ) -> bool:
        self.line.allow(asked)
        try:
            said = await verb()
        except DeviceError as error:
            self.errors.append(f"{what}: {type(error).__name__}: {error}")
            self.undone.add(what)
            if axes_of(self.arm) is not None and "connect" not in what:
                try:
                    await self.arm.stop()
                except DeviceError as second:
                    self.errors.append(f"stop: {type(second).__name__}: {second}")
                self.clock.advance(0.3)
            return False
        self.undone.discard(what)
        for axis, counts in (goal or {}).items():
            if abs(self.line.true(axis) - counts) > near:
                self.false_done.append(
                    f"{what}: {axis.name.lower()} at {self.line.true(axis):.1f} of {counts}"
                )
        if opening_mm is not None and abs(float(str(said)) - opening_mm) > WIDTH_MM:
            self.false_done.append(f"{what}: {said} mm of {opening_mm}")
        return True

    async def _move(self, targets: dict[Axis, int]) -> bool:
        names = " and ".join(axis.name.lower() for axis in targets)
        return await self._do(
            f"move {names}", set(targets), lambda: self.arm.move_counts(targets), targets
        )

    async def _stopped(self, targets: dict[Axis, int], kind: Stop, after: int) -> None:
        """Stop in mid-move; the stop and the move end, and the metal rests."""

        async def both() -> None:
            self.stop_after, self.stop_kind, self.stopping = after, kind, None
            move: asyncio.Task[object] = asyncio.create_task(self.arm.move_counts(targets))
            results = await asyncio.gather(move, return_exceptions=True)
            self.stop_after = 0
            if self.stopping is not None:
                await self.stopping
                self.clock.advance(0.6)  # the ramp
                if running := self.running():
                    self.false_done.append(f"stop: {', '.join(running)} still moves")
            for one in results:
                if isinstance(one, BaseException) and "on request" not in str(one):
                    raise one

        await self._do(f"stop {kind.name}", set(targets), both)

    def running(self) -> list[str]:
        before = {axis: self.line.true(axis) for axis in Axis}
        self.clock.advance(0.1)
        return [a.name.lower() for a in Axis if abs(self.line.true(a) - before[a]) > 1.0]

    # ---- sessions ------------------------------------------------------------------------------
    async def _opened(self) -> bool:
        for _ in range(2):
            if await self._do("connect", set(), self.arm.connect) and await self._do(
                "power", set(), self.arm.enable_power
            ):
                return True
        return False

    async def _again(self, verb: Callable[[], Awaitable[bool]]) -> None:
        """Do a verb, and once more if it failed and the arm still knows where it is."""
        if self.arm.is_homed and not await verb() and self.arm.is_homed:
            await verb()

    async def moves(self) -> None:
        """Cold open, then moves of each axis, gripper, stops, park."""
        self.model.place({EMULATED[axis]: float(counts) for axis, counts in PARK.items()})
        if not await self._opened():
            return
        self.model.reference()
        self.arm.positions.is_homed = True
        self.arm.positions.dead_bands = dict.fromkeys(Axis, 2)
        for axis, counts in PARK.items():
            self.arm.positions.note_range(axis, counts, counts)
        for targets in (
            {Axis.SHOULDER: 150, Axis.ELBOW: -120},
            {Axis.ZED: -120},
            {Axis.YAW: 130},
            {Axis.WRIST1: -160, Axis.WRIST2: -60},
            {Axis.SHOULDER: 60, Axis.ZED: -60, Axis.WRIST1: -100, Axis.WRIST2: -100},
        ):
            await self._again(lambda t=targets: self._move(t))  # type: ignore[misc]
        gripper = {Axis.GRIPPER}
        for opening_mm, limit_mm in ((16.0, None), (8.0, 12.0)):
            self.model.grasp_limit_mm = limit_mm
            if limit_mm is None:
                await self._again(
                    lambda w=opening_mm: self._do(  # type: ignore[misc]
                        "open", gripper, lambda: self.arm.move_gripper_mm(w), opening_mm=w
                    )
                )
            elif self.arm.is_homed and self.arm.is_powered:
                is_held = await self._do(
                    "grip", gripper, lambda: self.arm.grasp(force=30), opening_mm=limit_mm
                )
                await self._again(lambda: self._move({Axis.SHOULDER: 0, Axis.YAW: 30}))
                if is_held and self.arm.is_homed:
                    await self._do("width", set(), self.arm.read_opening_mm, opening_mm=limit_mm)
        self.model.grasp_limit_mm = None
        if self.arm.is_homed:
            await self._stopped({Axis.SHOULDER: 900, Axis.WRIST1: -700}, Stop.DEAD, 5)
        if self.arm.is_homed:
            await self._stopped({Axis.SHOULDER: 0, Axis.ZED: -300}, Stop.RAMP, 4)
        await self._again(lambda: self._move({axis: n for axis, n in PARK.items() if n >= 0}))
        await self._tail()

    async def homing(self) -> None:
        """Warm open, home, a move of each board, park."""
        self.model.place({EMULATED[axis]: counts for axis, counts in BEFORE_HOMING.items()})
        self.wire.run_warm()
        if not await self._opened():
            return
        self.is_homing = True
        is_home = await self._do("home", set(), self.arm.home, NEAR_PARK, HOMED_COUNTS)
        self.is_homing = False
        if is_home:
            targets = {Axis.SHOULDER: 2450, Axis.WRIST1: -2850, Axis.GRIPPER: 60, Axis.ZED: -60}
            await self._again(
                lambda: self._do(
                    "move",
                    set(targets),
                    lambda: self.arm.move_counts(targets),
                    targets,
                    HOMED_COUNTS,
                )
            )

    async def _tail(self) -> None:
        """Read everything; what is reported must be true."""

        async def read() -> None:
            for axis, counts in (await self.arm.read_counts()).items():
                if abs(self.line.true(axis) - counts) > NEAR_COUNTS:
                    self.false_done.append(f"read: {axis.name.lower()} is not at {counts}")

        if self.arm.is_homed:
            await self._do("read", set(), read)

    async def run(self, name: SessionName) -> Result:
        """Run a session to its end and judge it."""
        began_s = self.clock.now_s()
        end = ""
        try:
            await (self.moves() if name == "moves" else self.homing())
            self.line.allow(set(Axis))
            self.was_homed = self.arm.is_homed
            self.line.noise = None  # what noise starts after the last stop, no driver sees
            await self.arm.aclose()
            if self.arm.is_homed:
                raise AssertionError("closed, and homed")
        except DeviceError as error:
            self.errors.append(f"close: {type(error).__name__}: {error}")
        except Exception as error:  # noqa: BLE001 - a bug is a finding here, not the end
            end = "bug"
            self.errors.append(f"bug: {error!r}")
        self.line.allow(set(Axis))
        runs_on = self.running()
        cell_s = self.clock.now_s() - began_s
        if not end:
            end = self._end(cell_s)
        moved = {a.name.lower(): round(far, 1) for a, far in self.line.moved.items()}
        return Result(
            end,  # type: ignore[arg-type]  # one of the words above
            self.errors,
            {name: far for name, far in moved.items() if far > STILL_COUNTS},
            max(moved.values(), default=0.0),
            self.false_done,
            runs_on,
            dict(self.line.counts),
            self.line.exchange_count,
            cell_s,
            0 if self.noise is None else self.noise.burst_count,
        )

    def _end(self, cell_s: float) -> str:
        if cell_s > PATIENCE_S:
            return "hangs"
        if not self.line.has_struck:
            return "clean"
        if not self.errors:
            return "recovered"
        return "fault" if self.undone or not self.was_homed else "went on after a fault"


def run_session(
    name: SessionName, fault: LineFault | None = None, noise: Noise | None = None
) -> Result:
    """Run one session on a loop of its own."""
    return asyncio.run(Session(fault, noise=noise).run(name))


def faults_at(way: Way, place: int, bits: Iterator[int] | list[int]) -> list[LineFault]:
    """Return the faults tried at one place: flips of these bits, lost, doubled, late twice."""
    flips = [LineFault(way, place, "flipped", bit=bit) for bit in bits]
    lates = (0.012, 0.060) if way == "to the arm" else (0.060, 0.300)
    return [
        *flips,
        LineFault(way, place, "lost"),
        LineFault(way, place, "doubled"),
        *(LineFault(way, place, "late", late_s=late_s) for late_s in lates),
    ]


@contextmanager
def quiet() -> Iterator[None]:
    """Keep the drivers' warnings, which faults are bound to raise, from the screen."""
    import logging

    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)
