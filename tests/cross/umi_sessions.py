"""The worked sessions of umi_rtx.md 3, run by the driver and compared by bytes.

The referee is tests/golden/umi_rtx.toml. An exchange is *equal* when request, reply and answering
IP are the reference's; *illustrative* when the reference marks the reply as its own choice and ours
has the same kind, length and checksum but other numbers; *extra* when the driver asks something
that the session does not show, for a reason given here. Anything else is *different*.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any, Literal

from umi_bench import ArmBench, arm_bench

from drivers.errors import PositionLostError, RefusedError
from drivers.umi_scara import Axis, AxisStalledError, Ip, Parameter, Stop, WireExchange
from emulators.umi_scara import Axis as EmulatedAxis

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "umi_rtx.toml").read_text())
SESSIONS: dict[str, dict[str, Any]] = {session["name"]: session for session in GOLDEN["session"]}

COLD_OPEN = "cold open"
WARM_OPEN = "warm open"
GO_RUNNING = "GO to a running IP1"
PARAMETERS = "read every parameter of ZED"
HOME_ZED = "home one axis: zed"
LABELS = "end of homing: label the stop positions, go to the start pose"
MOVE = "move one joint and poll: shoulder to +1000 counts"
STOP_ON_ERROR = "stop on error"
LOST_POWER = "IP lost power in mid-session"
LEAVE_TOGGLE = "leave automatic toggle"
LineKind = Literal["terminal", "socket"]
NOT_THE_DRIVERS = {
    "read SPEED of ZED in the iLab and BS dialect": "the driver speaks the other dialect (2.5)",
    "automatic toggle": "the driver runs in non-toggle mode, as 1.4 recommends",
    "broken frame": "the driver sends every request in one call (8.17)",
}

POLLED_AGAIN = "how often one polls is up to the host (3.3)"
READ_LATER = "bit 0 falls within DEAD_BAND of the target (7): read again when the axis has settled"
SURE_OF_THE_STOP = "bit 3 is believed once the axis has not moved for 3 polls (9.17)"
WHO_ANSWERS = (
    "an acknowledged hand-over proves nothing: who answers is asked, and before a go (1.4)"
)
NOBODY_ELSE = (
    "one wrong bit makes a go of a command: that nothing else moves is looked at (2.6, 2.7)"
)
READ_BACK = "the checksum protects the value alone: what was written is read back (2.2)"
CHECKS: Mapping[str, str] = {  # what the driver asks in every session
    "38": WHO_ANSWERS,
    **dict.fromkeys(("17", "10", "11", "12", "13", "14"), NOBODY_ELSE),
    **dict.fromkeys(("60 03 00", "60 04 00", "60 0A 00"), READ_BACK),
    **dict.fromkeys(("48", "49", "4A", "4B", "4C", "68", "69", "6A", "6B", "6C"), READ_BACK),
}
EXTRAS: Mapping[str, Mapping[str, str]] = {  # session: request: why the driver sends it as well
    HOME_ZED: dict.fromkeys(("12", "4A", "42"), SURE_OF_THE_STOP),
    MOVE: dict.fromkeys(("49", "41"), READ_LATER),
    STOP_ON_ERROR: {"49": "the error names the true position, which takes both reads (2.5)"},
    LEAVE_TOGGLE: {"01": "who listens is asked before the line is handed over (1.6 step 3)"},
}


class Verdict(Enum):
    """How one exchange of ours compares."""

    EQUAL = "equal"
    ILLUSTRATIVE = "illustrative"
    EXTRA = "extra"
    DIFFERENT = "different"
    MISSING = "missing"


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a comparison; `expected` is the reference's exchange, where there is one."""

    verdict: Verdict
    request: str
    reply: str
    expected: str = ""
    reason: str = ""


@dataclass(slots=True)
class Comparison:
    """One worked session as the driver ran it."""

    name: str
    section: str
    lines: list[Line] = field(default_factory=list)
    skipped: str = ""

    def count(self, *verdicts: Verdict) -> int:
        return sum(line.verdict in verdicts for line in self.lines)

    @property
    def compared_count(self) -> int:
        """Exchanges of the reference that were looked for."""
        return len(self.lines) - self.count(Verdict.EXTRA)

    @property
    def reasons(self) -> Counter[str]:
        return Counter(line.reason for line in self.lines if line.reason)

    @property
    def is_explained(self) -> bool:
        return not self.count(Verdict.DIFFERENT, Verdict.MISSING)


def _text(data: bytes) -> str:
    return data.hex(" ").upper()


def _is_status(data: bytes) -> bool:
    return len(data) == 3 and data[0] >> 4 == 1


def _decisive(status: bytes) -> int:
    return status[1] & 0x0D  # §2.8: moving, following error, stall; bit 1 carries no decision


def _is_same_kind(ours: bytes, theirs: bytes) -> bool:
    """Tell whether an illustrative reply differs in its numbers only."""
    if len(ours) != len(theirs) or ours[0] >> 4 != theirs[0] >> 4:
        return False
    if _is_status(theirs):
        return ours[0] == theirs[0] and _decisive(ours) == _decisive(theirs)
    if ours[0] >> 4 in (0x8, 0xD):
        low, high = ours[1:]
        return ours[0] & 0xF == low >> 4 ^ low & 0xF ^ high >> 4 ^ high & 0xF  # §2.2
    return ours[0] == theirs[0]


def compare(name: str, trace: Sequence[WireExchange]) -> Comparison:
    """Compare what the driver exchanged with a session, in order, to the session's end."""
    session = SESSIONS[name]
    result = Comparison(name, session["section"])
    expected = list(session["exchange"])
    polled = b""  # the status that the session showed last
    for ours in trace:
        if not expected:
            break
        due = expected[0]
        request, reply = bytes.fromhex(due["request"]), bytes.fromhex(due["reply"])
        shown = f"{due['request']} -> {due['reply']}"
        note = due.get("note", "")
        sent, got = _text(ours.request), _text(ours.reply)
        is_asked = ours.request == request and ours.ip in (None, due["ip"])
        if is_asked and ours.reply == reply:
            line = Line(Verdict.EQUAL, sent, got, shown)
        elif is_asked and not due["exact"] and _is_same_kind(ours.reply, reply):
            line = Line(Verdict.ILLUSTRATIVE, sent, got, shown, f"marked as a choice: {note}")
        elif polled and ours.request == polled[:1] and _is_same_kind(ours.reply, polled):
            result.lines.append(Line(Verdict.EXTRA, sent, got, "", POLLED_AGAIN))
            continue
        elif reason := EXTRAS.get(name, {}).get(sent) or CHECKS.get(sent):
            result.lines.append(Line(Verdict.EXTRA, sent, got, "", reason))
            continue
        else:
            line = Line(Verdict.DIFFERENT, sent, got, shown)
        result.lines.append(line)
        expected.pop(0)
        polled = reply if _is_status(reply) else polled
    for due in expected:
        result.lines.append(Line(Verdict.MISSING, "", "", f"{due['request']} -> {due['reply']}"))
    return result


def _from(trace: Sequence[WireExchange], request: str) -> list[WireExchange]:
    """Return a trace from the first time that a request was sent."""
    start = next((n for n, x in enumerate(trace) if _text(x.request) == request), len(trace))
    return list(trace[start:])


# ---- the sessions as the driver runs them --------------------------------------------------------
async def _open_and_home(bench: ArmBench) -> list[Comparison]:
    found = []
    await bench.arm.connect()
    await bench.arm.enable_power()
    found.append(compare(COLD_OPEN, bench.trace))
    bench.trace.clear()
    await bench.arm.home()
    found.append(compare(HOME_ZED, _from(bench.trace, "70 04 00")))
    found.append(compare(LABELS, _from(bench.trace, "5A E3 F3")))
    return found


async def _let_ip1_listen(bench: ArmBench) -> None:
    await bench.arm.status(Axis.SHOULDER)
    bench.trace.clear()


async def _read_position(bench: ArmBench) -> None:
    await bench.arm.read_parameter(Axis.SHOULDER, Parameter.CURRENT_POSITION)
    await bench.arm.read_parameter(Axis.SHOULDER, Parameter.CP_ERROR)


async def _move(bench: ArmBench) -> Comparison:
    await _let_ip1_listen(bench)
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: 1000}))
    await bench.moving()
    try:  # below the driver's verbs, which never say go twice
        await bench.arm.axes.link.exchange(Ip.ARM, b"\xa2")
    except RefusedError as refusal:
        assert refusal.code == 3  # noqa: PT017  (its code is what matters, and it may be refused)
    await _read_position(bench)
    await move
    await bench.pass_time(1.0)
    await _read_position(bench)
    return compare(MOVE, bench.trace)


async def _parameters(bench: ArmBench) -> Comparison:
    await bench.arm.move_counts({Axis.ZED: -1000})
    await _let_ip1_listen(bench)
    for parameter in Parameter:
        await bench.arm.read_parameter(Axis.ZED, parameter)
    return compare(PARAMETERS, bench.trace)


async def _stop_on_error(bench: ArmBench) -> Comparison:
    await _let_ip1_listen(bench)
    move = asyncio.create_task(bench.arm.move_counts({Axis.SHOULDER: -2500}))
    await bench.moving()
    shoulder = bench.model.axes[EmulatedAxis.SHOULDER]
    bench.model.jam(EmulatedAxis.SHOULDER)
    # held up while the set-point went on: what §3.6 takes for granted, to the count
    counts = round(shoulder.position - shoulder.origin)
    shoulder.set_point, shoulder.velocity = shoulder.origin + counts + 1005, 0.0
    bench.trace.clear()
    try:
        await move
    except AxisStalledError:
        await bench.arm.stop(Stop.FREE)
    bench.model.jam(EmulatedAxis.SHOULDER, False)
    tripped = [x for x in bench.trace if not (_is_status(x.reply) and x.reply[1] & 1)]
    return compare(STOP_ON_ERROR, tripped)


async def _lost_power(bench: ArmBench) -> Comparison:
    await _let_ip1_listen(bench)
    bench.wire.restart(1)
    try:
        await bench.arm.status(Axis.SHOULDER)
    except PositionLostError:
        assert not bench.arm.is_homed
    return compare(LOST_POWER, bench.trace)


async def _warm(name: str, line: LineKind, *, auto_toggle: bool) -> Comparison:
    # the stops on opening leave the line to the other board (ADR 15): IP0 is met first
    async with arm_bench(line=line, listening=1) as bench:
        bench.wire.run_warm(auto_toggle=auto_toggle)
        await bench.arm.connect()
        sent = [_text(x.request) for x in bench.trace[:5]]
        assert sent == ["14", "24", "29", "14", "24"], sent
        del bench.trace[:5]
        if name == GO_RUNNING:
            await _let_ip1_listen(bench)
            await bench.arm.axes.link.exchange(Ip.ARM, b"\x00")
        return compare(name, bench.trace)


async def run_sessions(
    speed: float = 30.0, seed: int = 3, line: LineKind = "terminal"
) -> list[Comparison]:
    """Run every worked session that is the driver's to run; return them in the page's order.

    A busy kernel holds bytes back on a terminal while the cell's time goes on, and a driver that
    waits in vain asks again: who wants the same exchanges every time takes a socket.
    """
    async with arm_bench(speed=speed, seed=seed, line=line) as bench:
        found = await _open_and_home(bench)
        for session in (_move, _parameters, _stop_on_error, _lost_power):
            found.append(await session(bench))
    found.append(await _warm(WARM_OPEN, line, auto_toggle=False))
    found.append(await _warm(GO_RUNNING, line, auto_toggle=False))
    found.append(await _warm(LEAVE_TOGGLE, line, auto_toggle=True))
    for name, why in NOT_THE_DRIVERS.items():
        found.append(Comparison(name, SESSIONS[name]["section"], skipped=why))
    order = list(SESSIONS)
    return sorted(found, key=lambda one: order.index(one.name))
