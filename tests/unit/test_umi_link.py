"""The arm's line: opening, pacing, hand-over, and resynchronising after every kind of loss.

Sections (§) are those of umi_rtx.md.
"""

import asyncio
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest
from umi_fakes import FakeArm, FakeClock, as_text, once, only_asks, shows

from drivers.errors import (
    BadReplyError,
    LinkError,
    MotionStoppedError,
    PositionLostError,
    RefusedError,
    ReplyTimeoutError,
    WrongDeviceError,
)
from drivers.terminals import through_the_kernel
from drivers.umi_scara import Ip, LineUncertainError, LinkConfig, WireExchange
from drivers.umi_scara.line import Link
from drivers.umi_scara.protocol.codec import Status, Value

GOLDEN = tomllib.loads(
    (Path(__file__).parents[1] / "golden" / "umi_rtx.toml").read_text(encoding="utf-8")
)
READ_ZED = b"\x4a"
DEAD_STOP = b"\x24"


def session(name: str) -> list[tuple[str, str]]:
    found = next(s for s in GOLDEN["session"] if s["name"] == name)
    return [(x["request"], x["reply"]) for x in found["exchange"]]


class Bench:
    def __init__(self, *, running: bool = True, listening: int | None = None) -> None:
        self.clock = FakeClock()
        # IP1 listens once the line is open; the stops on opening leave it to a running neighbour
        first = int(running) if listening is None else listening
        self.arm = FakeArm(self.clock, running=running, listening=first)
        self.trace: list[WireExchange] = []
        self.link = Link(self.arm, self.clock, LinkConfig(), self.trace.append)

    async def opened(self) -> "Bench":
        await self.link.open()
        self.trace.clear()
        self.arm.heard.clear()
        self.arm.spoken.clear()
        return self

    async def value(self, ip: Ip, *frames: bytes) -> int:
        reply = (await self.link.exchange(ip, *frames, repeats=True))[-1]
        assert isinstance(reply, Value)
        return reply.value


# ---- opening -----------------------------------------------------------------------------------
# both boards get a dead stop before they are met; it hands the line over once (ADR 15)
STOP_BOTH = [("24", "00"), ("29", "00"), ("24", "00")]


async def test_a_cold_open_is_the_references_session() -> None:
    bench = Bench(running=False)
    assert await bench.link.open() == {Ip.WRIST, Ip.ARM}
    assert shows(as_text(bench.trace), [("24", "0F"), *session("cold open")[:9]])
    assert bench.link.listening is Ip.ARM


async def test_a_warm_open_is_the_references_session() -> None:
    bench = Bench(listening=1)
    assert await bench.link.open() == frozenset()
    assert shows(as_text(bench.trace), [*STOP_BOTH, *session("warm open")])


@pytest.mark.parametrize("listening", [0, 1])
async def test_an_arm_that_still_moves_is_stopped_before_its_boards_are_met(listening: int) -> None:
    bench = Bench(listening=listening)
    for ip, ctl in ((0, 2), (1, 0), (1, 1)):
        bench.arm.motor(ip, ctl).powered = True
        bench.arm.motor(ip, ctl).run(8000.0, 600.0)
    await bench.link.open()
    sent = [data for _, data in bench.arm.writes]
    assert sent[:3] == [b"\x24", b"\x29", b"\x24"]
    at_s = [at_s for at_s, _ in bench.arm.writes]
    # silence of 20 ms (§1.6 step 1), then a request every 9 ms (§1.2): one stop, two later the next
    assert at_s[2] - 1000.0 == pytest.approx(0.020 + 2 * 0.009)
    assert stops(bench)[:2] == [listening, 1 - listening]
    assert not any(motor.status & 1 for board in bench.arm.boards for motor in board.motors)
    # nothing was found moving afterwards, which would be answered by a row of stops (§2.7)
    assert stops(bench)[2:] == []


@pytest.mark.parametrize("listening", [0, 1])
async def test_what_a_stop_may_clear_is_read_right_before_it(listening: int) -> None:
    bench = Bench(listening=listening)
    bench.arm.motor(1, 4).status = 0x0A  # the jaws press (§2.8); this arm's stop clears that
    await bench.link.open(b"\x14")
    assert [data for _, data in bench.arm.writes][:5] == [
        b"\x14", b"\x24", b"\x29", b"\x14", b"\x24"
    ]  # fmt: skip
    arm, wrist = bench.link.found(Ip.ARM), bench.link.found(Ip.WRIST)
    assert arm is not None
    assert arm.bits == 0x0A
    assert wrist is not None
    assert wrist.bits == 0x00
    assert bench.arm.motor(1, 4).status == 0x02


async def test_a_board_behind_a_restarted_one_is_stopped_when_it_is_met() -> None:
    bench = Bench(listening=0)
    bench.arm.boards[0].restarted = True
    elbow = bench.arm.motor(1, 0)
    elbow.powered = True
    elbow.run(8000.0, 600.0)
    assert await bench.link.open() == {Ip.WRIST}
    assert elbow.target is None
    assert 1 in stops(bench)


@pytest.mark.parametrize("lost", [b"\x24", b"\x29"])
async def test_a_lost_answer_to_the_first_stops_has_both_stopped_blindly(lost: bytes) -> None:
    bench = Bench()
    bench.arm.mishap = once(lost, lambda reply: [])
    elbow, wrist = bench.arm.motor(1, 0), bench.arm.motor(0, 2)
    for motor in (elbow, wrist):
        motor.powered = True
        motor.run(8000.0, 600.0)
    await bench.link.open()
    first = [data for _, data in bench.arm.writes].index(lost) + 1
    assert [data for _, data in bench.arm.writes[first : first + 3]] == [
        b"\x24", b"\x29", b"\x24"
    ]  # fmt: skip
    assert {0, 1} <= set(stops(bench))
    assert elbow.target is None
    assert wrist.target is None


async def test_opening_does_not_assume_who_listens() -> None:
    bench = Bench(running=False, listening=1)
    assert await bench.link.open() == {Ip.WRIST, Ip.ARM}
    assert bench.link.listening is Ip.WRIST


async def test_one_restarted_board_is_told_from_the_other() -> None:
    bench = Bench()
    bench.arm.boards[1].restarted = True
    assert await bench.link.open() == {Ip.ARM}


async def test_automatic_toggling_left_behind_is_switched_off() -> None:
    bench = Bench()
    for board in bench.arm.boards:
        board.auto_toggle = True
    await bench.link.open()
    assert not any(board.auto_toggle for board in bench.arm.boards)
    assert bench.link.listening == bench.arm.listening


async def test_silence_says_what_to_check() -> None:
    bench = Bench()
    for board in bench.arm.boards:
        board.mute = True
    with pytest.raises(LinkError, match=r"neither IP.*check power, cable, boards"):
        await bench.link.open()
    asked = [data for _, data in bench.arm.writes]
    # a stop, the same for both blindly, then §1.6 step 2
    assert asked == [b"\x24", b"\x24", b"\x29", b"\x24", b"\x28", b"\x28"]


async def test_one_silent_board_is_told_from_two() -> None:
    bench = Bench(listening=0)
    bench.arm.boards[1].mute = True
    with pytest.raises(
        LinkError, match=r"no IP beside the one that took .* speaks.*check power, cable, boards"
    ):
        await bench.link.open()


class HeldClock(FakeClock):
    """The clock of an emulated cell: it can be held for a last look."""

    @contextmanager
    def held(self) -> Iterator[float]:
        yield 0.3


async def test_a_reply_that_the_kernel_keeps_back_longer_than_a_look_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    bench.clock = bench.arm.clock = HeldClock()
    bench.link = Link(bench.arm, bench.clock, LinkConfig(), bench.trace.append)
    await bench.opened()
    ways: list[float] = []

    async def slow_kernel() -> None:
        bench.clock.advance(2.0)
        ways.append(bench.clock.now_s())

    monkeypatch.setattr("drivers.terminals.through_the_kernel", slow_kernel)
    bench.arm.mishap = once(READ_ZED, lambda reply: [(4.5, reply)])
    asked = len(bench.arm.writes)
    await bench.value(Ip.ARM, READ_ZED)
    assert [data for _, data in bench.arm.writes[asked:]].count(READ_ZED) == 1
    assert len(ways) == 2  # the request's and the reply's


def test_what_is_written_to_a_terminal_comes_through_the_kernel_and_nothing_stays_open() -> None:
    before = set(Path("/proc/self/fd").iterdir())
    asyncio.run(through_the_kernel())
    assert set(Path("/proc/self/fd").iterdir()) == before


async def test_two_boards_of_one_name_are_refused() -> None:
    bench = Bench()
    bench.arm.boards[1].number = 0
    with pytest.raises(WrongDeviceError, match="IP0"):
        await bench.link.open()


@pytest.mark.parametrize("banner", [b"\r\nMSP 01.00 UMI 1987\r\n", b"ERROR\r\n"])
async def test_a_rom_that_answers_in_text_is_refused(banner: bytes) -> None:
    bench = Bench()
    bench.arm.mishap = lambda _request, _reply: [
        (0.003 + number * 0.001, bytes([byte])) for number, byte in enumerate(banner)
    ]
    with pytest.raises(WrongDeviceError, match="unsupported ROM or monitor mode"):
        await bench.link.open()


async def test_what_was_on_the_line_before_is_discarded() -> None:
    bench = Bench(listening=1)
    bench.arm.pending.append((bench.clock.now_s() + 0.015, b"\x0b"))
    await bench.link.open()
    assert shows(as_text(bench.trace), [*STOP_BOTH, *session("warm open")])


# ---- pacing ------------------------------------------------------------------------------------
async def test_requests_start_at_least_8_ms_apart_and_go_out_in_one_piece() -> None:
    bench = await Bench().opened()
    for _ in range(5):
        await bench.link.exchange(Ip.ARM, b"\x70\x04\x00", b"\x7a\x1e\x00")
        await bench.link.exchange(Ip.WRIST, b"\x17")
    starts_s = [at_s for at_s, _ in bench.arm.writes]
    gaps_s = [after - before for before, after in pairwise(starts_s)]
    assert min(gaps_s) >= 0.008
    assert max(gaps_s) < 0.012  # nor is time wasted while replies come at once
    assert {len(data) for _, data in bench.arm.writes} == {1, 3}


def test_less_than_the_arms_spacing_cannot_be_configured() -> None:
    with pytest.raises(ValueError, match=r"1\.2"):
        LinkConfig(spacing_s=0.007)


async def test_one_request_is_in_flight_however_many_ask() -> None:
    bench = await Bench().opened()
    replies = await asyncio.gather(
        *(bench.link.exchange(Ip(number % 2), b"\x17", repeats=True) for number in range(6))
    )
    assert all(isinstance(reply[0], Status) for reply in replies)
    for before, after in pairwise(bench.trace):
        assert after.at_s >= before.at_s + 0.008
        assert before.reply


# ---- handing over ------------------------------------------------------------------------------
async def test_the_line_changes_hands_only_when_it_must() -> None:
    bench = await Bench().opened()  # IP1 listens
    await bench.link.exchange(Ip.ARM, b"\x10")
    await bench.link.exchange(Ip.ARM, b"\x11")
    await bench.link.exchange(Ip.WRIST, b"\x12")
    await bench.link.exchange(Ip.WRIST, b"\x13")
    assert bench.arm.heard == [
        (1, b"\x10"),
        (1, b"\x11"),
        (1, b"\x29"),
        (0, b"\x38"),  # who answers: the hand-over's own answer does not tell
        (0, b"\x12"),
        (0, b"\x13"),
    ]


@pytest.mark.parametrize("delay_s", [None, 0.3])
async def test_a_hand_over_whose_reply_is_lost_or_late_is_not_done_twice(
    delay_s: float | None,
) -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(b"\x29", lambda reply: [] if delay_s is None else [(delay_s, reply)])
    await bench.link.exchange(Ip.WRIST, b"\x12", repeats=True)
    assert bench.arm.heard[-1] == (0, b"\x12")
    assert bench.link.listening == bench.arm.listening == 0
    # before the line is handed over again, somebody has asked who listens
    requests = [data for _, data in bench.arm.heard]
    assert b"\x38" in requests[: [*requests[1:], b"\x29"].index(b"\x29") + 1]
    assert requests.count(b"\x29") == 1


@pytest.mark.parametrize("busy", [0x01, 0x02, 0x04])
async def test_a_hand_over_whose_answer_reads_as_busy_is_not_sent_again(busy: int) -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(b"\x29", lambda _: [(0.003, bytes([busy]))])
    await bench.link.exchange(Ip.WRIST, b"\xa4")
    assert [data for _, data in bench.arm.heard].count(b"\x29") == 1
    assert bench.arm.heard[-1] == (0, b"\xa4")


@pytest.mark.parametrize("became", [b"\x28", b"\x21", b"\xa9"])
async def test_an_acknowledged_hand_over_that_was_none_stops_both_boards_before_any_motion(
    became: bytes,
) -> None:
    """One bit makes toggle off, define home or a go of `29`; all are acknowledged alike."""
    bench = await Bench().opened()
    mangled: list[bytes] = []

    def mangle(request: bytes) -> bytes:
        if request == b"\x29" and not mangled:
            mangled.append(request)
            return became
        return request

    bench.arm.mangle = mangle
    with pytest.raises(LineUncertainError, match="both boards were stopped") as doubt:
        await bench.link.exchange(Ip.WRIST, b"\xa4")
    assert doubt.value.may_have_zeroed
    does = [(ip, data) for ip, data in bench.arm.heard if not only_asks(data.hex())]
    assert does[:2] == [(1, became), (1, DEAD_STOP)]
    assert set(stops(bench)) == {0, 1}
    assert (0, b"\xa4") not in bench.arm.heard
    assert (1, b"\xa4") not in bench.arm.heard


async def test_a_motion_command_is_proven_to_reach_its_board() -> None:
    """A command that was acknowledged may have handed the line over: `21` and `29`."""
    bench = await Bench().opened()
    bench.arm.listening = 0  # behind the driver's back
    with pytest.raises(LineUncertainError):
        await bench.link.exchange(Ip.ARM, b"\xa2", proves=True)
    assert not [data for _, data in bench.arm.heard if data == b"\xa2"]
    await bench.link.exchange(Ip.ARM, b"\xa2", proves=True)
    assert bench.arm.heard[-1] == (1, b"\xa2")


# ---- back in step ------------------------------------------------------------------------------
LOSSES = {
    "a lost byte": lambda reply: [(0.003, reply[:-1])],
    "all bytes lost": lambda reply: [],
    "an extra byte": lambda reply: [(0.003, reply + b"\x55")],
    "the reply 300 ms late": lambda reply: [(0.300, reply)],
    "a reply in pieces, one late": lambda reply: [(0.003, reply[:1]), (0.300, reply[1:])],
    "a bit flipped": lambda reply: [(0.003, reply[:1] + bytes([reply[1] ^ 0x10]) + reply[2:])],
    "another kind of reply": lambda reply: [(0.003, b"\xf0")],
    "no such class": lambda reply: [(0.003, b"\x9a")],
    "frame timeout": lambda reply: [(0.011, b"\x0b")],
    "frame overrun": lambda reply: [(0.003, b"\x0c")],
}


@pytest.mark.parametrize("loss", LOSSES)
async def test_a_read_comes_through_every_mishap_with_the_right_value(loss: str) -> None:
    bench = await Bench().opened()
    bench.arm.motor(1, 2).counts = -1000
    bench.arm.mishap = once(READ_ZED, LOSSES[loss])
    assert await bench.value(Ip.ARM, READ_ZED) == -1000
    assert await bench.value(Ip.ARM, b"\x41") == 0
    assert bench.link.listening == bench.arm.listening
    assert not bench.arm.pending


async def test_a_reply_50_ms_late_is_no_mishap() -> None:
    bench = await Bench().opened()
    bench.arm.mishap = lambda _request, reply: [(0.050, reply)]
    assert await bench.value(Ip.ARM, READ_ZED) == 0
    assert [data for _, data in bench.arm.heard] == [READ_ZED]


async def test_only_reads_are_repeated_unasked() -> None:
    bench = await Bench().opened()
    write = (b"\x70\x03\x00", b"\x7a\xe8\x03")
    bench.arm.mishap = once(write[1], lambda _: [])
    with pytest.raises(ReplyTimeoutError):
        await bench.link.exchange(Ip.ARM, *write)
    assert [data for _, data in bench.arm.heard].count(write[1]) == 1
    assert await bench.value(Ip.ARM, b"\x60\x03\x00", b"\x6a") == 1000  # the line is in step


@pytest.mark.parametrize("odd", [b"\x55", b"\x00", b"\x01\x00", b"\x4a\x18\xfc"])
async def test_bytes_that_came_unasked_stop_both_boards_before_the_next_command(
    odd: bytes,
) -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(READ_ZED, lambda reply: [(0.003, reply), (0.006, odd)])
    await bench.link.exchange(Ip.ARM, READ_ZED, repeats=True)
    with pytest.raises(LineUncertainError, match="both boards were stopped"):
        await bench.link.exchange(Ip.ARM, b"\x70\x03\x00", b"\x7a\xe8\x03")
    assert b"\x7a\xe8\x03" not in [data for _, data in bench.arm.heard]
    assert await bench.value(Ip.ARM, READ_ZED) == 0  # and the line is back in step


async def test_both_frames_of_a_deferred_read_are_repeated() -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(b"\x6a", lambda _: [(0.003, b"\x0b")])
    assert await bench.value(Ip.ARM, b"\x60\x04\x00", b"\x6a") == 100
    requests = [data for _, data in bench.arm.heard]
    assert requests.count(b"\x60\x04\x00") == requests.count(b"\x6a") == 2


async def test_a_line_that_dies_says_what_to_check() -> None:
    bench = await Bench().opened()
    bench.arm.boards[0].mute = bench.arm.boards[1].mute = True
    with pytest.raises(LinkError, match="check power, cable, boards"):
        await bench.link.exchange(Ip.ARM, READ_ZED, repeats=True)


async def test_a_line_that_only_babbles_is_given_up() -> None:
    bench = await Bench().opened()
    bench.arm.mishap = lambda _request, _reply: [(0.003, b"\x9a")]
    with pytest.raises(BadReplyError):
        await bench.link.exchange(Ip.ARM, READ_ZED, repeats=True)


@pytest.mark.parametrize("code", [0x01, 0x02, 0x04])
async def test_a_busy_board_is_asked_again_after_10_ms(code: int) -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(READ_ZED, lambda _: [(0.003, bytes([code]))])
    assert await bench.value(Ip.ARM, READ_ZED) == 0
    assert bench.trace[1].at_s - bench.trace[0].at_s >= 0.010


REFUSALS = [0x03, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A]


@pytest.mark.parametrize("code", REFUSALS)
async def test_a_refusal_of_what_no_arm_refuses_is_a_spoilt_request_and_read_again(
    code: int,
) -> None:
    bench = await Bench().opened()
    bench.arm.motor(1, 2).counts = -1000
    bench.arm.mishap = once(READ_ZED, lambda _: [(0.003, bytes([code]))])
    assert await bench.value(Ip.ARM, READ_ZED) == -1000


@pytest.mark.parametrize("code", REFUSALS)
async def test_a_refusal_is_not_argued_with_for_ever(code: int) -> None:
    bench = await Bench().opened()
    bench.arm.mishap = lambda _request, _reply: [(0.003, bytes([code]))]
    with pytest.raises((RefusedError, BadReplyError)):
        await bench.link.exchange(Ip.ARM, READ_ZED, repeats=True)
    assert len(bench.trace) <= 6


async def test_a_go_that_is_busy_is_refused_at_once() -> None:
    bench = await Bench().opened()
    bench.arm.boards[1].busy_count = 1
    with pytest.raises(RefusedError) as refusal:
        await bench.link.exchange(Ip.ARM, b"\xa2")
    assert refusal.value.code == 0x03
    assert len(bench.trace) == 1


# ---- restarts ----------------------------------------------------------------------------------
async def test_a_restarted_board_is_not_given_go_on_the_way() -> None:
    bench = await Bench().opened()
    bench.arm.boards[1].restart()
    for _ in range(2):  # now, and for as long as nobody opens again
        with pytest.raises(PositionLostError):
            await bench.link.exchange(Ip.ARM, b"\x11", repeats=True)
    assert (1, b"\x00") not in bench.arm.heard
    assert await bench.link.open() == {Ip.ARM}


async def test_a_restart_behind_a_lost_byte_is_still_a_restart() -> None:
    bench = await Bench().opened()
    bench.arm.mishap = once(READ_ZED, lambda reply: [(0.003, reply[:1])])
    bench.arm.boards[0].restart()  # the resync meets it on the other side of the line
    with pytest.raises(PositionLostError):
        await bench.link.exchange(Ip.ARM, READ_ZED, repeats=True)


# ---- stops -------------------------------------------------------------------------------------
def stops(bench: Bench) -> list[int]:
    return [ip for ip, data in bench.arm.heard if data == DEAD_STOP]


async def test_a_stop_goes_to_both_boards() -> None:
    bench = await Bench().opened()
    await bench.link.halt(DEAD_STOP)
    does = [(ip, data) for ip, data in bench.arm.heard if not only_asks(data.hex())]
    assert does[:3] == [(1, DEAD_STOP), (1, b"\x29"), (0, DEAD_STOP)]
    looks = [ip for ip, data in bench.arm.heard if data == b"\x17"]
    assert looks == [0, 1]  # a stop is believed once the board says that nothing moves


async def test_a_stop_overtakes_everything_that_waits() -> None:
    bench = await Bench().opened()
    waiting = [asyncio.create_task(bench.link.exchange(Ip.ARM, b"\x11")) for _ in range(4)]
    await bench.arm.spoken.wait()
    await bench.link.halt(DEAD_STOP)
    assert stops(bench) == [1, 0]
    assert [data for _, data in bench.arm.heard].index(DEAD_STOP) == 1
    await asyncio.gather(*waiting)


async def test_the_second_board_has_its_stop_two_requests_after_the_first() -> None:
    bench = await Bench().opened()
    await bench.link.halt(DEAD_STOP)
    asked = [data for _, data in bench.arm.heard]
    assert asked[:4] == [DEAD_STOP, b"\x29", DEAD_STOP, b"\x38"]
    first, last = (
        [at_s for at_s, data in bench.arm.writes if data == DEAD_STOP][i] for i in (0, 1)
    )
    # 1.2: requests start 8 ms apart; nothing but the hand-over lies between the stops
    assert last - first == pytest.approx(2 * LinkConfig().spacing_s)


@pytest.mark.parametrize("requests", [1, 2, 3])
async def test_a_stop_does_not_wait_for_the_frames_that_a_reading_has_left(requests: int) -> None:
    bench = await Bench().opened()
    # a reading of the other board: hand-over, who has it, two frames
    reading = asyncio.create_task(
        bench.link.exchange(Ip.WRIST, b"\x62\x00\x00", b"\x6a", repeats=True)
    )
    for _ in range(requests):
        await bench.arm.spoken.wait()
        bench.arm.spoken.clear()
    before = len(bench.arm.heard)
    await bench.link.halt(DEAD_STOP)
    asked = [data for _, data in bench.arm.heard[before:]]
    assert asked.index(DEAD_STOP) <= 1  # a hand-over is proven first
    assert stops(bench) in ([0, 1], [1, 0])
    await reading
    assert bench.arm.heard[-2:] == [(0, b"\x62\x00\x00"), (0, b"\x6a")]


async def test_a_command_of_two_frames_is_not_cut_in_half_by_a_stop() -> None:
    bench = await Bench().opened()
    writing = asyncio.create_task(bench.link.exchange(Ip.ARM, b"\x72\x10\x00", b"\x7a\x00\x00"))
    await bench.arm.spoken.wait()
    await bench.link.halt(DEAD_STOP)
    await writing
    asked = [data for _, data in bench.arm.heard]
    assert asked[:3] == [b"\x72\x10\x00", b"\x7a\x00\x00", DEAD_STOP]


async def test_a_motion_that_gave_way_to_a_stop_does_not_begin_after_it() -> None:
    bench = await Bench().opened()
    stopped: list[bool] = []

    def guard() -> None:
        if stopped:
            raise MotionStoppedError("stopped")

    going = asyncio.create_task(bench.link.exchange(Ip.WRIST, b"\xac", guard=guard))
    await bench.arm.spoken.wait()
    stopped.append(True)
    await bench.link.halt(DEAD_STOP)
    with pytest.raises(MotionStoppedError):
        await going
    assert b"\xac" not in [data for _, data in bench.arm.heard]


async def test_a_hand_over_that_does_not_take_place_is_found_after_the_stops() -> None:
    bench = await Bench().opened()
    lost = []

    def mangle(request: bytes) -> bytes:
        if request == b"\x29" and not lost:
            lost.append(request)
            return b"\x28"  # one bit off: acknowledged, and nobody else listens
        return request

    bench.arm.mangle = mangle
    await bench.link.halt(DEAD_STOP)
    assert set(stops(bench)) == {0, 1}


@pytest.mark.parametrize("restarted", [0, 1])
async def test_a_restarted_board_does_not_keep_the_other_from_stopping(restarted: int) -> None:
    bench = await Bench().opened()
    bench.arm.boards[restarted].restart()
    with pytest.raises(PositionLostError):
        await bench.link.halt(DEAD_STOP)
    assert {0, 1} <= set(stops(bench))
    assert bench.arm.heard[-1][1] == DEAD_STOP
    assert not bench.arm.motor(restarted, 2).powered


@pytest.mark.parametrize("loss", LOSSES)
async def test_a_stop_gets_through_every_mishap(loss: str) -> None:
    bench = await Bench().opened()
    pieces = LOSSES[loss]
    bench.arm.mishap = once(DEAD_STOP, lambda reply: pieces(reply + b"\x00\x00"))
    await bench.link.halt(DEAD_STOP)
    assert set(stops(bench)) == {0, 1}


async def test_an_exchange_that_is_cancelled_ends_in_step() -> None:
    bench = await Bench().opened()
    task = asyncio.create_task(bench.link.exchange(Ip.ARM, b"\x60\x04\x00", b"\x6a"))
    await bench.arm.spoken.wait()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert [data for _, data in bench.arm.heard] == [b"\x60\x04\x00", b"\x6a"]
    assert await bench.value(Ip.ARM, READ_ZED) == 0
    assert len(bench.trace) == 3


async def test_who_is_cancelled_while_waiting_for_the_line_says_nothing() -> None:
    bench = await Bench().opened()
    first = asyncio.create_task(bench.link.exchange(Ip.ARM, b"\x11"))
    second = asyncio.create_task(bench.link.exchange(Ip.ARM, b"\xa2"))
    await bench.arm.spoken.wait()
    second.cancel()
    with pytest.raises(asyncio.CancelledError):
        await second
    await first
    assert [data for _, data in bench.arm.heard] == [b"\x11"]
