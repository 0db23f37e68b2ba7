"""The I/O driver against an E1214 written from the manual's map; no reading counts as not OK."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from modbus_fakes import Bus, Map, golden, tcp_gateway, until

from drivers.clock import CellClock
from drivers.errors import DeviceError, LinkError, ReplyTimeoutError, WrongDeviceError
from drivers.io_modbus import (
    DRIVER,
    CellIo,
    Change,
    Debounce,
    InputChannel,
    IoConfig,
    MoxaSettings,
    OutputChannel,
    Signal,
)
from drivers.io_modbus.signals import Believer
from drivers.kinds import Polling, Site
from drivers.modbus_link import ModbusLink, TcpAddress

FAST = CellClock(speed=10.0, min_timeout_wall_s=1.0)  # no busy host looks like a silent block
IMPATIENT = CellClock(speed=10.0, min_timeout_wall_s=0.12)  # where a time-out is what is tested
NAMES = ("ready", "busy", "result_valid", "accept", "reject", "fault")
SIGNALS = tuple(OutputChannel(name, number) for number, name in enumerate(NAMES))
# nothing gets stale while a test looks elsewhere
LAZY = IoConfig(outputs=SIGNALS, poll_s=0.1, stale_s=50.0)
# half a second of a wall clock, where that is what is waited for
SOON_STALE = replace(LAZY, stale_s=5.0)


def e1214(model: str = "E1214") -> Map:
    text = model.encode().ljust(20, b"\0")
    name = {5000 + i: int.from_bytes(text[2 * i : 2 * i + 2], "big") for i in range(10)}
    return Map(
        discrete={**dict.fromkeys(range(6), True), 2: False, 3: False, 5: False},
        coils={**dict.fromkeys(range(6), False), 4144: False},
        inputs=name,
    )


@asynccontextmanager
async def io_on(
    bus: Bus, config: IoConfig = LAZY, clock: CellClock = FAST
) -> AsyncIterator[tuple[CellIo, list[Change]]]:
    changes: list[Change] = []
    async with (
        tcp_gateway(bus) as port,
        ModbusLink(TcpAddress("127.0.0.1", port), clock) as link,
        CellIo(link, config, changes.append) as io,
    ):
        yield io, changes


def built(
    link: ModbusLink,
    settings: MoxaSettings,
    polling: Polling,
    inputs: Mapping[str, int] | None = None,
    outputs: Mapping[str, int] | None = None,
) -> CellIo:
    """Return the block as a cell builds it; ``inputs`` as in its file, None for the usual ones."""
    site = Site(
        name="io",
        address="",
        section={"unit": 1},
        clock=FAST,
        open_link=lambda: link,
        polling=polling,
        inputs=inputs or {},
        outputs=outputs or {},
    )
    io = DRIVER.build(site, settings)
    assert isinstance(io, CellIo)
    return io


# --- on the wire ---


async def test_a_signal_is_read_where_the_cell_has_it() -> None:
    block = e1214()
    # 1 is healthy: of all inputs the second alone is not
    block.discrete.update(dict.fromkeys(range(6), True) | {1: False})
    async with (
        tcp_gateway(Bus({1: block.answer})) as port,
        ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link,
    ):
        inputs = {"guard_closed": 4, "supply_ok": 1}
        io = built(link, MoxaSettings(), Polling(poll_s=0.1, stale_s=50.0), inputs)
        await io.connect()
        try:
            await io.wait_for("supply_ok", Signal.NOT_OK)
            await io.wait_for("guard_closed", Signal.OK)
        finally:
            await io.aclose()


async def test_polling_reads_the_six_inputs_with_the_manuals_own_request() -> None:
    request, _ = golden("moxa_e1214", "read_inputs")
    bus = Bus({1: e1214().answer})
    async with io_on(bus) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
    polls = [frame for frame in bus.requests if frame[7] == 2]
    assert len(polls) >= 2
    assert {frame[2:] for frame in polls} == {request[2:]}  # all but the transaction number


async def test_the_manuals_reply_switches_the_first_three_inputs_on() -> None:
    _, reply = golden("moxa_e1214", "read_inputs")
    block = e1214()
    bus = Bus({1: lambda pdu: reply[7:] if pdu[0] == 2 else block.answer(pdu)})
    async with io_on(bus) as (io, _):
        await io.wait_for("guard_closed", Signal.OK)
        await io.wait_for("acknowledge", Signal.NOT_OK)
        signals = io.snapshot().signals
    assert list(signals.values()) == [Signal.OK] * 3 + [Signal.NOT_OK] * 3


async def test_an_output_is_switched_with_the_manuals_own_request() -> None:
    request, _ = golden("moxa_e1214", "output_0_on")
    bus = Bus({1: e1214().answer})
    async with io_on(bus) as (io, _):
        await io.set_outputs({"ready": True})
    (write,) = [frame for frame in bus.requests if frame[7] == 5]
    assert write[2:] == request[2:]


async def test_outputs_are_switched_in_the_order_given() -> None:
    bus = Bus({1: e1214().answer})
    async with io_on(bus) as (io, _):
        await io.set_outputs({"reject": True, "ready": True, "accept": False, "busy": True})
    assert [frame[9] for frame in bus.requests if frame[7] == 5] == [4, 0, 1]


async def test_an_output_that_a_supervisor_has_opened_stays_open_beside_others() -> None:
    block = e1214()
    bus = Bus({1: block.answer})
    async with io_on(bus) as (io, _):
        await io.set_outputs({"fault": True})
        block.coils[5] = False  # by another connection
        await io.set_outputs({"ready": True})
    assert (block.coils[0], block.coils[5]) == (True, False)


async def test_relays_that_are_not_named_stay_and_nothing_new_sends_nothing() -> None:
    block = e1214()
    block.coils[4] = True
    bus = Bus({1: block.answer})
    async with io_on(bus) as (io, _):
        await io.set_outputs({"fault": True})
        await io.set_outputs({"fault": True})
        await io.set_outputs({"fault": True}, force=True)
        outputs = await io.read_outputs()
    assert len([frame for frame in bus.requests if frame[7] == 5]) == 2
    assert [name for name, is_closed in outputs.items() if is_closed] == [
        "reject",
        "fault",
    ]


async def test_after_a_switching_without_acknowledge_the_relays_are_asked_for() -> None:
    block = e1214()
    bus = Bus({1: block.answer})
    lost = 0

    def answer(pdu: bytes) -> bytes | None:
        nonlocal lost
        reply = block.answer(pdu)
        if pdu[0] == 5 and not lost:
            lost += 1
            return None  # done, but the acknowledge is lost
        return reply

    bus.units[1] = answer
    async with io_on(bus, clock=IMPATIENT) as (io, _):
        with pytest.raises(ReplyTimeoutError):
            await io.set_outputs({"accept": True})
        await io.set_outputs({"accept": False})
    assert not block.coils[3]


async def test_an_unknown_name_lists_the_known_ones() -> None:
    async with io_on(Bus({1: e1214().answer})) as (io, _):
        with pytest.raises(ValueError, match=r"no output 'pass'; there are ready, busy"):
            await io.set_outputs({"pass": True})
        with pytest.raises(ValueError, match=r"no input 'estop'; there are estop_ok"):
            io.signal("estop")


async def test_the_watchdog_flag_is_read_and_cleared() -> None:
    block = e1214()
    block.coils[4144] = True
    async with io_on(Bus({1: block.answer})) as (io, _):
        assert await io.has_watchdog_tripped()
        await io.clear_watchdog()
    assert block.coils[4144]  # a 1 was written: that is what clears it on the real block


async def test_the_watchdogs_flag_is_asked_for_and_cleared_with_the_pages_own_requests() -> None:
    bus = Bus({1: e1214().answer})
    async with io_on(bus) as (io, _):
        await io.has_watchdog_tripped()
        await io.clear_watchdog()
    for name, function in (("read_watchdog", 1), ("clear_watchdog", 5)):
        request, _ = golden("moxa_e1214", name)
        (sent,) = [frame for frame in bus.requests if frame[7] == function]
        assert sent[2:] == request[2:]


@pytest.mark.parametrize(
    ("settings", "outputs"),
    [(MoxaSettings(motor_relay=2), {}), (MoxaSettings(), {"ready": 2})],
)
def test_a_watchdog_that_an_output_depends_on_is_fed_often_enough(
    settings: MoxaSettings, outputs: Mapping[str, int]
) -> None:
    config = configured(settings, Polling(2.0, 10.0), outputs)
    assert [one.channel for one in config.outputs] == [2]
    assert config.watchdog_s == settings.watchdog_s
    assert config.poll_s <= config.watchdog_s / 5
    assert configured(MoxaSettings(), Polling(0.04, 0.2)).watchdog_s is None


def test_a_signal_on_the_motors_relay_is_refused() -> None:
    with pytest.raises(ValueError, match="two names are on the same channel"):
        configured(MoxaSettings(motor_relay=2), Polling(0.04, 0.2), {"ready": 2})


@pytest.mark.parametrize(
    ("settings", "told"), [({"watchdog_s": 0.1}, "0.5 to 60 s"), ({"motor_relay": 6}, "0..5")]
)
def test_a_watchdog_that_makes_no_sense_is_refused(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        configured(MoxaSettings(**{"motor_relay": 0, **settings}), Polling(0.04, 0.2))


def configured(
    settings: MoxaSettings, polling: Polling, outputs: Mapping[str, int] | None = None
) -> IoConfig:
    link = ModbusLink(TcpAddress("127.0.0.1", 1), FAST)
    return built(link, settings, polling, outputs=outputs).config


# --- who is there ---


async def test_the_model_name_is_checked() -> None:
    async with io_on(Bus({1: e1214("ioLogik E1214").answer})) as (io, _):
        assert await io.identify() == "ioLogik E1214"


async def test_another_model_is_the_wrong_device() -> None:
    with pytest.raises(WrongDeviceError, match=r"expected a Moxa E1214, found 'E1212'"):
        async with io_on(Bus({1: e1214("E1212").answer})):
            pass


async def test_something_without_a_model_name_is_the_wrong_device() -> None:
    with pytest.raises(WrongDeviceError, match=r"expected a Moxa E1214, found .* exception 02"):
        async with io_on(Bus({1: Map(holding={0: 1}).answer})):
            pass


async def test_nobody_there_names_transport_address_and_what_to_check(
    unused_tcp_port: int,
) -> None:
    link = ModbusLink(TcpAddress("127.0.0.1", unused_tcp_port), FAST)
    with pytest.raises(LinkError, match=rf"127\.0\.0\.1:{unused_tcp_port}.*check"):
        await CellIo(link).connect()
    await link.aclose()


# --- believing ---


async def test_everything_is_unknown_before_the_first_reading_and_after_the_end() -> None:
    bus = Bus({1: e1214().answer})
    async with tcp_gateway(bus) as port, ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link:
        io = CellIo(link, LAZY)
        assert io.signal("estop_ok") is Signal.UNKNOWN
        await io.connect()
        await io.wait_for("estop_ok", Signal.OK)
        await io.aclose()
        assert set(io.snapshot().signals.values()) == {Signal.UNKNOWN}
        assert not io.signal("estop_ok").is_ok


async def test_an_emergency_stop_is_believed_at_the_first_poll() -> None:
    block = e1214()
    bus = Bus({1: block.answer})
    async with io_on(bus) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
        with io.watch() as changes:
            # Good again right after one poll: two equal polls would never see it.
            block.discrete[0] = False
            polls = len(bus.requests)
            await until(lambda: len(bus.requests) > polls)
            block.discrete[0] = True
            change = await anext(changes)
    assert (change.name, change.signal) == ("estop_ok", Signal.NOT_OK)
    assert change.previous is Signal.OK


async def test_watching_shows_changes_in_order_and_ends_with_the_driver() -> None:
    block = e1214()
    async with io_on(Bus({1: block.answer})) as (io, _):
        await io.wait_for("part_in_nest", Signal.NOT_OK)
        seen: list[tuple[str, Signal]] = []

        async def collect() -> None:
            async for change in io.watch():
                seen.append((change.name, change.signal))

        collector = asyncio.create_task(collect())
        await asyncio.sleep(0)
        block.discrete[2] = True
        await io.wait_for("part_in_nest", Signal.OK)
        block.discrete[1] = False
        await io.wait_for("guard_closed", Signal.NOT_OK)
    await asyncio.wait_for(collector, 600)
    assert seen[:2] == [("part_in_nest", Signal.OK), ("guard_closed", Signal.NOT_OK)]
    assert ("guard_closed", Signal.UNKNOWN) in seen  # closed: nothing is known any more


async def test_a_silent_block_makes_all_signals_unknown_before_its_time_out_is_over() -> None:
    bus = Bus({1: e1214().answer})
    clock = CellClock(speed=0.2)  # the reply time-out is 1.5 s here, the staleness limit 0.4 s
    config = IoConfig(poll_s=0.01, stale_s=0.08)
    async with clock.attending(), io_on(bus, config, clock) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
        begin_s = clock.attended_s()
        bus.silent_units.add(1)
        with io.watch() as changes:
            change = await anext(changes)
        assert change.signal is Signal.UNKNOWN
        assert clock.attended_s() - begin_s < 1.4 * clock.speed
        assert io.signal("estop_ok") is Signal.UNKNOWN


async def test_a_cut_connection_makes_all_unknown_and_polling_recovers() -> None:
    bus = Bus({1: e1214().answer})
    async with io_on(bus, SOON_STALE, clock=IMPATIENT) as (io, changes):
        await io.wait_for("estop_ok", Signal.OK)
        changes.clear()
        bus.silent_units.add(1)
        bus.cut()
        await io.wait_for("estop_ok", Signal.UNKNOWN)
        assert {change.signal for change in changes} == {Signal.UNKNOWN}
        assert len(changes) == 6
        bus.silent_units.clear()
        await io.wait_for("estop_ok", Signal.OK)


async def test_an_exception_makes_all_unknown() -> None:
    block = e1214()
    bus = Bus({1: block.answer})
    async with io_on(bus, SOON_STALE) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
        del block.discrete[5]
        await io.wait_for("estop_ok", Signal.UNKNOWN)


@pytest.mark.parametrize("code", [5, 6, 4])
async def test_one_answer_that_is_none_leaves_known_what_is_fresh(code: int) -> None:
    bus = Bus({1: e1214().answer})
    async with io_on(bus, IoConfig(poll_s=0.1, stale_s=5.0)) as (io, changes):
        await io.wait_for("estop_ok", Signal.OK)
        changes.clear()
        bus.troubles = [code]
        count = len(bus.requests)
        await until(lambda: len(bus.requests) >= count + 4)
        assert io.signal("estop_ok") is Signal.OK
    assert Signal.UNKNOWN not in {change.signal for change in changes[:-6]}  # those of the end


@pytest.mark.parametrize("code", [6, 4])
async def test_answers_that_are_none_for_too_long_make_the_inputs_unknown(code: int) -> None:
    bus = Bus({1: e1214().answer})
    async with io_on(bus, IoConfig(poll_s=0.1, stale_s=2.0)) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
        bus.troubles = [code] * 100_000
        await io.wait_for("estop_ok", Signal.UNKNOWN)
        bus.troubles.clear()
        await io.wait_for("estop_ok", Signal.OK)


async def test_a_reading_that_got_old_is_unknown_even_if_the_poller_hangs() -> None:
    bus = Bus({1: e1214().answer})
    now_s = 1000.0

    class Clock(CellClock):
        __slots__ = ()

        def now_s(self) -> float:
            return now_s

    async with io_on(bus, IoConfig(poll_s=0.05, stale_s=0.2), Clock(speed=10.0)) as (io, _):
        await io.wait_for("estop_ok", Signal.OK)
        assert io.signal("estop_ok") is Signal.OK
        now_s += 0.25  # no turn of the event loop in between: nobody could poll
        assert io.signal("estop_ok") is Signal.UNKNOWN
        assert set(io.snapshot().signals.values()) == {Signal.UNKNOWN}


async def test_after_the_block_was_away_its_relays_are_asked_for_before_switching() -> None:
    block = e1214()
    bus = Bus({1: block.answer})
    async with io_on(bus, SOON_STALE, clock=IMPATIENT) as (io, _):
        await io.set_outputs({"fault": True})
        await io.wait_for("estop_ok", Signal.OK)
        bus.silent_units.add(1)
        await io.wait_for("estop_ok", Signal.UNKNOWN)
        block.coils[5] = False  # it restarted, all relays open
        bus.silent_units.clear()
        await io.wait_for("estop_ok", Signal.OK)
        await io.set_outputs({"fault": True})
    assert block.coils[5]


async def test_an_observer_that_fails_does_not_stop_the_polling() -> None:
    def fail(change: Change) -> None:
        raise RuntimeError("observer")

    bus = Bus({1: e1214().answer})
    async with (
        tcp_gateway(bus) as port,
        ModbusLink(TcpAddress("127.0.0.1", port), FAST) as link,
        CellIo(link, LAZY, fail) as io,
    ):
        await io.wait_for("estop_ok", Signal.OK)


async def test_waiting_ends_with_an_error_when_the_driver_is_closed() -> None:
    async with io_on(Bus({1: e1214().answer})) as (io, _):
        waiting = asyncio.create_task(io.wait_for("acknowledge", Signal.OK))
        await asyncio.sleep(0)
        await io.aclose()
        with pytest.raises(DeviceError, match="closed while waiting"):
            await waiting


# --- debouncing, without a wire ---

OK, NO = Signal.OK, Signal.NOT_OK


@pytest.mark.parametrize(
    ("debounce", "bits", "believed"),
    [
        (Debounce.NONE, [1, 0, 1], [OK, NO, OK]),
        (Debounce.RISING, [1, 1, 0, 1, 1], [Signal.UNKNOWN, OK, NO, NO, OK]),
        (Debounce.BOTH, [1, 1, 0, 1, 0, 0], [Signal.UNKNOWN, OK, OK, OK, OK, NO]),
    ],
)
def test_two_equal_polls_are_needed_where_the_channel_says_so(
    debounce: Debounce, bits: list[int], believed: list[Signal]
) -> None:
    believer = Believer((InputChannel("it", 0, debounce),))
    seen = []
    for at_s, bit in enumerate(bits):
        believer.take((bool(bit),), float(at_s))
        seen.append(believer.signals["it"])
    assert seen == believed


def test_after_forgetting_one_good_poll_is_not_enough_again() -> None:
    believer = Believer((InputChannel("estop_ok", 0),))
    believer.take((True,), 0.0)
    believer.take((True,), 0.1)
    assert [change.signal for change in believer.forget(0.2)] == [Signal.UNKNOWN]
    believer.take((True,), 0.3)
    assert believer.signals["estop_ok"] is Signal.UNKNOWN


@given(
    readings=st.lists(st.tuples(st.booleans(), st.booleans()) | st.none(), max_size=30),
)
def test_a_safety_copy_is_ok_only_while_the_last_two_readings_were(
    readings: list[tuple[bool, bool] | None],
) -> None:
    believer = Believer((InputChannel("safe", 0), InputChannel("part", 1, Debounce.BOTH)))
    changes: list[Change] = []
    for i, reading in enumerate(readings):
        changes += believer.forget(i) if reading is None else believer.take(reading, i)
        last_two = readings[max(0, i - 1) : i + 1]
        is_ok = len(last_two) == 2 and all(bits is not None and bits[0] for bits in last_two)
        assert believer.signals["safe"].is_ok == is_ok
    replayed = {"safe": Signal.UNKNOWN, "part": Signal.UNKNOWN}
    for change in changes:
        assert change.previous is replayed[change.name]
        replayed[change.name] = change.signal
    assert replayed == believer.signals


def test_a_configuration_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match=r"0\.\.5"):
        IoConfig(inputs=(InputChannel("estop_ok", 6),))
    with pytest.raises(ValueError, match=r"0\.\.7"):
        IoConfig(channel_count=8, outputs=(OutputChannel("lamp", 8),))
    with pytest.raises(ValueError, match="same channel"):
        IoConfig(outputs=(OutputChannel("a", 0), OutputChannel("b", 0)))
    with pytest.raises(ValueError, match="same name"):
        IoConfig(inputs=(InputChannel("a", 0), InputChannel("a", 1)))
    with pytest.raises(ValueError, match="below stale_s"):
        IoConfig(poll_s=0.3, stale_s=0.2)
