"""The other end of the arm's line for unit tests: a clock that jumps, a small arm, and faults.

Written from umi_rtx.md with bytes as literals, so that it shares nothing with the driver. Motors
run at a constant rate towards an end; the wrist's two share their stops (§5.3); there is no yaw
coupling, no servo and no gravity here.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from drivers.clock import CellClock
from drivers.umi_scara import WireExchange

Mishap = Callable[[bytes, bytes], list[tuple[float, bytes]] | None]


class FakeClock(CellClock):
    """A clock that advances only by what somebody waits."""

    def __init__(self) -> None:
        super().__init__()
        object.__setattr__(self, "instant_s", 1000.0)

    def now_s(self) -> float:
        return float(vars(self)["instant_s"])

    def advance(self, duration_s: float) -> None:
        object.__setattr__(self, "instant_s", self.now_s() + duration_s)

    async def sleep(self, duration_s: float) -> None:
        self.advance(max(0.0, duration_s))
        await asyncio.sleep(0)


@dataclass
class Motor:
    low: int
    high: int
    counts: float = 0.0
    target: float | None = None
    rate: float = 0.0  # signed, counts per second
    status: int = 0
    powered: bool = False
    parameters: dict[int, int] = field(default_factory=dict)

    def run(self, target: float, speed: float) -> None:
        self.status = 0x01 if self.powered else 0x02
        self.target = target if self.powered else None
        self.rate = speed if target >= self.counts else -speed

    def halt(self) -> None:
        self.target = None
        self.status = 0x02

    def advance(self, dt_s: float) -> None:
        if self.target is None:
            return
        step = self.rate * dt_s
        if abs(self.target - self.counts) <= abs(step):
            self.counts, self.target, self.status = self.target, None, 0x00
        else:
            self.counts += step
        if not self.low <= self.counts <= self.high:
            self.counts = float(min(max(self.counts, self.low), self.high))
            self.target, self.status = None, 0x0A


DEFAULTS = {2: 1000, 3: 0, 4: 100, 5: 1200, 6: 20, 7: 600, 8: 2, 9: 0, 10: 40, 11: 0, 12: 20, 13: 0}


def checked(head: int, value: int) -> bytes:
    word = value & 0xFFFF
    nibbles = (word & 15) ^ (word >> 4 & 15) ^ (word >> 8 & 15) ^ (word >> 12)
    return bytes([head | nibbles, word & 0xFF, word >> 8])


class Board:
    """One IP with its five motors."""

    def __init__(self, number: int) -> None:
        self.number = number
        self.restarted = True
        self.auto_toggle = False
        self.mute = False
        self.selected: int | None = None
        self.busy_count = 0
        reach = {(1, 0): (-300, 9000), (1, 1): (-9000, 300), (1, 2): (-9000, 200)}
        self.motors = [Motor(*reach.get((number, ctl), (-300, 9000))) for ctl in range(5)]
        if number == 0:
            self.motors = [Motor(-(10**6), 10**6) for _ in range(5)]
        # stops of W1 + W2 and of W1 - W2 (§5.2), before anybody has labelled anything
        self.wrist_low, self.wrist_high = [-200, -300], [2550, 8142]
        self.load_defaults()

    def load_defaults(self) -> None:
        for motor in self.motors:
            motor.parameters |= {k: v for k, v in DEFAULTS.items() if k not in (3, 11, 13)}

    def advance(self, dt_s: float) -> None:
        before = [motor.counts for motor in self.motors]
        for motor in self.motors:
            motor.advance(dt_s)
        if self.number == 0:
            one, two = self.motors[2], self.motors[3]
            pair = one.counts + two.counts, one.counts - two.counts
            if any(
                not low <= now <= high
                for low, now, high in zip(self.wrist_low, pair, self.wrist_high, strict=True)
            ):
                for motor, counts in ((one, before[2]), (two, before[3])):
                    if motor.counts != counts:
                        motor.counts, motor.target, motor.status = counts, None, 0x0A

    def relabel(self, ctl: int, counts: int) -> None:
        motor = self.motors[ctl]
        shift = counts - round(motor.counts)
        motor.low, motor.high, motor.counts = motor.low + shift, motor.high + shift, float(counts)
        if self.number == 0 and ctl in (2, 3):
            shifts = (shift, shift if ctl == 2 else -shift)
            self.wrist_low = [end + by for end, by in zip(self.wrist_low, shifts, strict=True)]
            self.wrist_high = [end + by for end, by in zip(self.wrist_high, shifts, strict=True)]

    def restart(self) -> None:
        self.restarted, self.auto_toggle = True, False
        for motor in self.motors:
            motor.powered = False
            motor.halt()

    def answer(self, request: bytes) -> bytes:
        op = request[0]
        if self.restarted:
            if op == 0x00:
                self.restarted = False
                return b"\x00"
            return b"\x0f"
        if op in (0x00, 0x01):
            return bytes([0x20 | self.number])
        if op == 0x38:
            return bytes([0x20 | self.number, 2, 3])
        if op == 0x17:
            status = 0
            for motor in self.motors:
                status |= motor.status & 0x0F
            return bytes([0x17, status, 0])
        if 0x10 <= op <= 0x14:
            return bytes([op, self.motors[op - 0x10].status, 0])
        if op >= 0x40 and op != 0x80 and op < 0xA0:
            return self.parameter(op, request)
        return self.command(op, request)

    def parameter(self, op: int, request: bytes) -> bytes:
        motor = self.motors[op & 7] if op & 7 < 5 else self.motors[0]
        value = int.from_bytes(request[1:], "little", signed=True)
        match op & 0xF8:
            case 0x40:
                return checked(0x80, 0)
            case 0x48:
                return checked(0x80, round(motor.counts))
            case 0x58:
                self.relabel(op & 7, value)
                return checked(0xA0, value)[:1]
            case 0x60:
                self.selected = request[1]
                return b"\xc0"
            case 0x70:
                self.selected = request[1]
                return b"\xe0"
            case 0x68:
                assert self.selected is not None
                return checked(0xD0, motor.parameters.get(self.selected, 0))
            case _:
                assert self.selected is not None
                motor.parameters[self.selected] = value
                return checked(0xF0, value)[:1]

    def command(self, op: int, request: bytes) -> bytes:
        if op in (0x24, 0x25, 0x26):
            for motor in self.motors:
                motor.halt()
                motor.powered = motor.powered and op != 0x26
        elif op == 0x27:
            for motor in self.motors:
                motor.powered = True
        elif op == 0x28:
            self.auto_toggle = False
        elif op == 0x2A:
            self.auto_toggle = True
        elif op == 0x22:
            self.load_defaults()
        elif op == 0x21:
            for ctl in range(5):
                self.relabel(ctl, 0)
        elif op == 0x80:
            word = request[1] | request[2] << 8
            for ctl, motor in enumerate(self.motors):
                drive = word >> 2 * ctl & 3
                if drive in (1, 2):
                    motor.run(1e9 if drive == 1 else -1e9, self.rate(motor))
                elif motor.status & 1:
                    motor.halt()
        elif op & 0xE0 == 0xA0:
            chosen = [motor for ctl, motor in enumerate(self.motors) if op >> ctl & 1]
            if self.busy_count or any(motor.status & 1 for motor in chosen):
                self.busy_count = max(0, self.busy_count - 1)
                return b"\x03"
            for motor in chosen:
                motor.run(motor.parameters.get(3, 0), self.rate(motor))
        return b"\x00"

    def rate(self, motor: Motor) -> float:
        # counts per second; brisk, so that tests are short, and IP1 rests later, as in §3.4
        return motor.parameters[4] * (30.0 if self.number == 0 else 20.0)


class FakeArm:
    """Both boards behind a transport. A mishap may replace the reply to any request.

    A mishap gets request and reply and returns None for "no mishap", or the pieces that arrive
    instead, each with its delay [s].
    """

    def __init__(self, clock: FakeClock, *, running: bool = False, listening: int = 0) -> None:
        self.clock = clock
        self.boards = [Board(0), Board(1)]
        self.listening = listening
        self.mishap: Mishap | None = None
        self.mangle: Callable[[bytes], bytes] = lambda request: request  # on its way to the arm
        self.writes: list[tuple[float, bytes]] = []
        self.heard: list[tuple[int, bytes]] = []  # what each IP heard
        self.spoken = asyncio.Event()  # set by every request
        self.on_request: Callable[[bytes], None] | None = None
        self.pending: list[tuple[float, bytes]] = []
        self.is_open = True
        self._advanced_s = clock.now_s()
        for board in self.boards:
            board.restarted = not running

    def motor(self, ip: int, ctl: int) -> Motor:
        return self.boards[ip].motors[ctl]

    def advance(self) -> None:
        now_s = self.clock.now_s()
        for board in self.boards:
            board.advance(now_s - self._advanced_s)
        self._advanced_s = now_s

    # the three methods of a transport
    def write(self, data: bytes) -> None:
        self.advance()
        self.writes.append((self.clock.now_s(), data))
        data = self.mangle(data)
        board = self.boards[self.listening]
        self.heard.append((self.listening, data))
        self.spoken.set()
        if board.mute:
            return
        was_restarted = board.restarted
        reply = board.answer(data)
        hands_over = data == b"\x29" or (board.auto_toggle and data != b"\x28")
        if hands_over and not was_restarted:
            self.listening = 1 - self.listening
        pieces = self.mishap(data, reply) if self.mishap else None
        for delay_s, piece in [(0.003, reply)] if pieces is None else pieces:
            at_s = self.clock.now_s() + delay_s
            if self.pending:  # a line keeps the order of its bytes
                at_s = max(at_s, self.pending[-1][0])
            self.pending.append((at_s, piece))
        if self.on_request:
            self.on_request(data)

    async def read(self, timeout_wall_s: float) -> bytes:
        await asyncio.sleep(0)
        until_s = self.clock.now_s() + timeout_wall_s
        due = [at_s for at_s, _ in self.pending if at_s <= until_s]
        if not due:
            self.clock.advance(timeout_wall_s)
            return b""
        self.clock.advance(max(0.0, min(due) - self.clock.now_s()))
        now_s = self.clock.now_s() + 1e-9
        arrived = [piece for at_s, piece in self.pending if at_s <= now_s]
        self.pending = [(at_s, piece) for at_s, piece in self.pending if at_s > now_s]
        return b"".join(arrived)

    async def aclose(self) -> None:
        self.is_open = False


def once(target: bytes, pieces: Callable[[bytes], list[tuple[float, bytes]]]) -> Mishap:
    """Make the first reply to one request go wrong."""
    has_happened = False

    def mishap(request: bytes, reply: bytes) -> list[tuple[float, bytes]] | None:
        nonlocal has_happened
        if request != target or has_happened:
            return None
        has_happened = True
        return pieces(reply)

    return mishap


def as_text(trace: list[WireExchange]) -> list[tuple[str, str]]:
    return [(x.request.hex(" ").upper(), x.reply.hex(" ").upper()) for x in trace]


def only_asks(request: str) -> bool:
    """Whether a request [hex] changes nothing: who listens, status, reads (§2.3, §2.5)."""
    opcode = int(request[:2], 16)
    return opcode in (0x38, 0x60) or 0x10 <= opcode <= 0x17 or 0x40 <= opcode < 0x50 or (
        0x68 <= opcode < 0x70
    )  # fmt: skip


def shows(trace: list[tuple[str, str]], session: list[tuple[str, str]]) -> bool:
    """Whether a trace is a session, with nothing more in between than questions."""
    due = list(session)
    for exchange in trace:
        if due and exchange == due[0]:
            due.pop(0)
        elif not only_asks(exchange[0]):
            return False
    return not due


def contains(trace: list[tuple[str, str]], session: list[tuple[str, str]]) -> bool:
    """Whether a part of a trace shows a session."""
    starts = [n for n, exchange in enumerate(trace) if exchange == session[0]]
    for start in starts:
        due = list(session)
        for exchange in trace[start:]:
            if exchange == due[0]:
                due.pop(0)
            elif not only_asks(exchange[0]):
                break
            if not due:
                return True
    return False
