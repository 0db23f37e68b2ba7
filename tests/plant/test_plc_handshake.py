"""The handshake with a PLC, without a wire: each step late, doubled, missing."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

import pytest
from fake_plant import AT, idle_state, part_result
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from controller.plant.model import PACKML_NUMBERS, OrderRequest, OrderState
from controller.plant.wires.plc import registers
from controller.plant.wires.plc.handshake import (
    MAX_WAITING,
    STANDS_S,
    Action,
    Handshake,
    StartOrder,
    StopCell,
)
from controller.plant.wires.plc.registers import (
    Command,
    CommandBit,
    FailureReason,
    Status,
    read_command,
)

START, STOP = CommandBit.START, CommandBit.STOP
ACKNOWLEDGED, RESET = CommandBit.RESULT_ACKNOWLEDGED, CommandBit.RESET
IDLE = CommandBit(0)


class Plc:
    """A PLC that writes when it is told to, beside a cell that answers when it is told to."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.handshake = Handshake({1: "holder", 2: "plate"}, self.now_s)
        self.command = Command(recipe=1)
        self.handshake.see(idle_state())

    def write(
        self, bits: CommandBit | None = None, *, beat: bool = True, **changes: object
    ) -> tuple[Action, ...]:
        self.now_s += 0.1
        if bits is not None:
            changes["bits"] = bits
        if beat:
            changes["heartbeat"] = (self.command.heartbeat + 1) % 0x10000
        self.command = replace(self.command, **changes)  # type: ignore[arg-type]
        return self.handshake.write(self.command, self.now_s)

    def alive(self) -> Plc:
        """A PLC that has been there for a while, all bits low."""
        for _ in range(3):
            assert self.write(IDLE) == ()
        return self

    @property
    def status(self) -> Status:
        return Status(self.read(registers.STATUS))

    @property
    def reason(self) -> FailureReason:
        return FailureReason(self.read(registers.REFUSAL))

    def read(self, address: int) -> int:
        return self.handshake.registers(self.now_s)[address]


def order(state: str = "queued") -> OrderState:
    return OrderState.model_validate(
        {"cell": "cell-3", "number": "PLC-1", "state": state, "source": "PLC", "taken": AT,
         "changed": AT, "request": OrderRequest(recipe="holder", quantity=1)}
    )  # fmt: skip


@pytest.fixture
def plc() -> Plc:
    return Plc().alive()


def started(plc: Plc) -> None:
    assert plc.write(START) == (StartOrder("holder", 1, ""),)
    plc.handshake.taken(order())


def test_a_start_is_acknowledged_until_the_plc_drops_it_and_busy_until_the_order_is_over(
    plc: Plc,
) -> None:
    assert plc.status == Status.ONLINE | Status.READY | Status.REMOTE_ALLOWED
    assert plc.write(START, recipe=2, serial="SN-1") == (StartOrder("plate", 1, "SN-1"),)
    assert Status.BUSY in plc.status
    assert Status.START_ACKNOWLEDGED not in plc.status  # not before the cell has taken it
    plc.handshake.taken(order())
    assert Status.BUSY | Status.START_ACKNOWLEDGED in plc.status
    plc.write(IDLE)
    assert Status.START_ACKNOWLEDGED not in plc.status
    assert Status.BUSY in plc.status
    plc.handshake.taken(order("done"))
    assert Status.BUSY not in plc.status
    assert Status.READY in plc.status


def test_a_start_that_stays_high_is_one_order_however_often_it_is_written(plc: Plc) -> None:
    started(plc)
    assert [plc.write(START) for _ in range(50)] == [()] * 50
    plc.handshake.taken(order("done"))
    assert [plc.write(START) for _ in range(50)] == [()] * 50


def test_a_start_that_is_dropped_before_the_answer_is_still_one_order(plc: Plc) -> None:
    assert len(plc.write(START)) == 1
    assert plc.write(IDLE) == ()
    assert plc.write(START) == ()  # doubled
    assert plc.reason is FailureReason.BUSY
    plc.write(IDLE)
    plc.handshake.taken(order())
    assert Status.BUSY in plc.status
    assert Status.START_ACKNOWLEDGED not in plc.status


def test_a_start_that_was_high_when_the_bridge_began_starts_nothing() -> None:
    plc = Plc()
    assert [plc.write(START) for _ in range(30)] == [()] * 30
    assert Status.COMMAND_FAILED not in plc.status
    plc.write(IDLE)
    assert len(plc.write(START)) == 1


def test_a_stop_that_was_high_when_the_bridge_began_stops_once_and_bars_starts() -> None:
    plc = Plc()
    assert plc.write(STOP) == (StopCell(),)
    assert plc.write(STOP) == ()
    assert plc.write(STOP | START) == ()
    plc.write(STOP)
    assert plc.write(STOP | START) == ()
    assert plc.reason is FailureReason.STOP_BIT_IS_SET


def test_a_stop_needs_no_heartbeat(plc: Plc) -> None:
    plc.now_s += 60
    assert plc.write(STOP, beat=False) == (StopCell(),)


@pytest.mark.parametrize(
    ("state", "changes", "reason"),
    [
        (idle_state(is_ready=False), {}, FailureReason.NOT_READY),
        (idle_state(online=False), {}, FailureReason.NOT_READY),
        (idle_state(may_start="never", is_ready=False), {}, FailureReason.REMOTE_NOT_ALLOWED),
        (idle_state(), {"recipe": 7}, FailureReason.UNKNOWN_RECIPE),
        (idle_state(), {"recipe": 0}, FailureReason.UNKNOWN_RECIPE),
        (idle_state(), {"serial": None}, FailureReason.BAD_SERIAL),
        (idle_state(), {"serial": "SN-1", "quantity": 2}, FailureReason.BAD_SERIAL),
    ],
)
def test_a_start_that_is_not_taken_has_a_reason_until_it_is_dropped(
    plc: Plc, state: object, changes: dict[str, object], reason: FailureReason
) -> None:
    plc.handshake.see(state)  # type: ignore[arg-type]
    assert plc.write(START, **changes) == ()
    assert Status.COMMAND_FAILED in plc.status
    assert plc.reason is reason
    assert not plc.status & (Status.BUSY | Status.START_ACKNOWLEDGED)
    plc.write(IDLE)
    assert Status.COMMAND_FAILED not in plc.status
    assert plc.reason is reason  # stands until the next command
    plc.handshake.see(idle_state())
    assert len(plc.write(START, recipe=1, serial="", quantity=0)) == 1
    assert plc.reason is FailureReason.NONE


def test_an_order_that_the_cell_refuses_fails_the_start_also_when_it_comes_late(plc: Plc) -> None:
    plc.write(START)
    plc.handshake.taken(order("refused"))
    assert plc.reason is FailureReason.ORDER_REFUSED
    assert Status.COMMAND_FAILED in plc.status
    plc.write(IDLE)
    started(plc)
    plc.write(IDLE)
    plc.handshake.taken(order("refused"))  # a person did not release it
    assert Status.COMMAND_FAILED in plc.status
    assert Status.BUSY not in plc.status
    plc.write(RESET)
    assert (Status.COMMAND_FAILED in plc.status, plc.reason) == (False, FailureReason.NONE)


def test_a_heartbeat_that_stands_bars_starts_and_nothing_else(plc: Plc) -> None:
    started(plc)
    plc.write(IDLE)
    plc.now_s += STANDS_S
    assert Status.BUSY in plc.status
    plc.handshake.taken(order("done"))
    assert Status.READY not in plc.status
    assert plc.write(START, beat=False) == ()
    assert plc.reason is FailureReason.HEARTBEAT_STANDS
    plc.write(IDLE)
    assert len(plc.write(START)) == 1


def test_a_plc_without_a_heartbeat_starts_nothing() -> None:
    plc = Plc()
    plc.write(IDLE, beat=False)
    assert plc.write(START, beat=False) == ()
    assert plc.reason is FailureReason.HEARTBEAT_STANDS


def test_the_heartbeat_of_the_cell_is_one_more_each_tenth_of_a_second(plc: Plc) -> None:
    first = plc.read(registers.HEARTBEAT)
    plc.now_s += 1.0
    assert plc.read(registers.HEARTBEAT) - first in (9, 10, 11)
    plc.now_s += 6553.6
    assert 0 <= plc.read(registers.HEARTBEAT) < 0x10000


def test_a_result_stands_until_it_is_acknowledged_and_the_next_comes_after_the_bit_has_dropped(
    plc: Plc,
) -> None:
    plc.handshake.show(part_result(1), ())
    plc.now_s += 3600  # late
    assert Status.RESULT_VALID in plc.status
    plc.write(ACKNOWLEDGED)
    assert Status.RESULT_VALID not in plc.status
    assert not plc.handshake.is_shown
    plc.handshake.show(part_result(2), ())
    assert Status.RESULT_VALID not in plc.status
    assert [plc.write(ACKNOWLEDGED) for _ in range(5)] == [()] * 5  # doubled: same edge
    assert plc.handshake.is_shown
    plc.write(IDLE)
    assert Status.RESULT_VALID in plc.status
    assert plc.read(registers.INSPECTION + 1) == part_result(2).seq


def test_an_acknowledgement_of_nothing_is_forgotten(plc: Plc) -> None:
    plc.write(ACKNOWLEDGED)
    plc.write(IDLE)
    plc.write(ACKNOWLEDGED)
    plc.handshake.show(part_result(1), ())
    assert plc.handshake.is_shown
    plc.write(IDLE)
    assert Status.RESULT_VALID in plc.status


def test_no_start_is_taken_while_eight_results_wait(plc: Plc) -> None:
    plc.handshake.show(part_result(1), ())
    plc.handshake.count_waiting(MAX_WAITING)
    assert Status.READY not in plc.status
    assert plc.write(START) == ()
    assert plc.reason is FailureReason.RESULTS_WAIT
    plc.write(ACKNOWLEDGED)
    assert len(plc.write(START)) == 1


def test_an_interrupted_wire_tells_that_the_start_was_not_taken(plc: Plc) -> None:
    plc.write(START)
    plc.handshake.abandon()
    assert plc.reason is FailureReason.NOT_READY
    assert Status.BUSY not in plc.status


def test_states_of_the_cell_have_their_bits_and_packml_numbers(plc: Plc) -> None:
    plc.handshake.see(idle_state(packml="Held", is_ready=False))
    assert (Status.HELD in plc.status, plc.read(registers.PACKML)) == (True, 11)
    plc.handshake.see(idle_state(packml="Aborted", is_ready=False, alarms=("estop",)))
    plc.handshake.alarm(201)
    assert (Status.FAULT in plc.status, plc.read(registers.ALARM)) == (True, 201)
    plc.handshake.see(idle_state(state="unknown", is_ready=False))
    assert (Status.ONLINE in plc.status, plc.read(registers.ALARM)) == (False, 0)
    assert len(set(PACKML_NUMBERS.values())) == len(PACKML_NUMBERS) == 17


def test_a_result_is_packed_as_the_map_says() -> None:
    result = part_result(3, seq=0x12345678, serial="SN-Ä1", disposition="reject", tray="quarantine")
    found = registers.result_registers(result, ("d2", "d1"))
    assert [found[registers.RESULT], found[registers.TRAY]] == [2, 3]
    assert [found[registers.INSPECTION], found[registers.INSPECTION + 1]] == [0x1234, 0x5678]
    text = b"".join(found[registers.RESULT_SERIAL + n].to_bytes(2, "big") for n in range(16))
    assert text == b"SN-?1" + b"\0" * 27
    values = [
        struct.unpack(">f", struct.pack(">HH", found[at], found[at + 1]))[0]
        for at in range(registers.VALUES, registers.VALUES + 40, 2)
    ]
    assert values[1] == pytest.approx(8.03)
    assert all(math.isnan(value) for value in (values[0], *values[2:]))
    assert max(found) < registers.COMMAND


def test_a_command_is_read_as_the_map_says() -> None:
    words = [0] * registers.COUNT
    words[100:104] = [0xFFF5, 3, 4, 5]
    words[104:106] = [0x534E, 0x2D31]
    found = read_command(words)
    assert found == Command(START | ACKNOWLEDGED, 3, 4, 5, "SN-1")
    words[106] = 0x0007
    assert read_command(words).serial is None


class AnyPlc(RuleBasedStateMachine):
    """Whatever a PLC writes and whenever the cell answers."""

    def __init__(self) -> None:
        super().__init__()
        self.plc = Plc()
        self.edges = 0
        self.orders = 0
        self.results = 0
        self.acknowledged = 0
        self.was_shown = False

    @rule(bits=st.sets(st.sampled_from(CommandBit)), beat=st.booleans(), later=st.booleans(),
          recipe=st.integers(0, 3), quantity=st.integers(0, 3))  # fmt: skip
    def write(
        self, bits: set[CommandBit], beat: bool, later: bool, recipe: int, quantity: int
    ) -> None:
        before, wanted = self.plc.command.bits, CommandBit(0)
        for bit in bits:
            wanted |= bit
        was_valid = Status.RESULT_VALID in self.plc.status
        self.plc.now_s += 5.0 if later else 0.0
        actions = self.plc.write(wanted, beat=beat, recipe=recipe, quantity=quantity)
        self.edges += bool(wanted & START and not before & START)
        starts = [one for one in actions if isinstance(one, StartOrder)]
        self.orders += len(starts)
        assert len(actions) - len(starts) == bool(wanted & STOP and not before & STOP)
        assert not starts or (wanted & START and not wanted & STOP and recipe in (1, 2))
        assert not (starts and later and not beat)
        if was_valid and not self.plc.handshake.is_shown:
            assert wanted & ACKNOWLEDGED
            assert not before & ACKNOWLEDGED
            self.acknowledged += 1

    @rule(state=st.sampled_from(["queued", "asked", "running", "done", "stopped", "refused"]))
    def answer(self, state: str) -> None:
        status = self.plc.status
        if Status.BUSY in status:
            self.plc.handshake.taken(order(state))

    @rule(ready=st.booleans(), packml=st.sampled_from(sorted(PACKML_NUMBERS)))
    def change(self, ready: bool, packml: str) -> None:
        self.plc.handshake.see(idle_state(is_ready=ready, packml=packml))

    @precondition(lambda self: not self.plc.handshake.is_shown)
    @rule()
    def finish(self) -> None:
        self.results += 1
        self.plc.handshake.show(part_result(self.results), ("d1",))

    @invariant()
    def no_order_without_an_edge(self) -> None:
        assert self.orders <= self.edges

    @invariant()
    def each_result_is_shown_until_it_is_acknowledged(self) -> None:
        assert self.results - self.acknowledged == self.plc.handshake.is_shown

    @invariant()
    def bits_agree(self) -> None:
        status, bits = self.plc.status, self.plc.command.bits
        assert not (Status.READY in status and Status.BUSY in status)
        assert Status.START_ACKNOWLEDGED not in status or bits & START
        assert Status.RESULT_VALID not in status or self.plc.handshake.is_shown


TestAnyPlc = AnyPlc.TestCase
