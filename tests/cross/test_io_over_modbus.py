"""The I/O driver and the emulated Moxa E1214: healthy is 1, and what is not fresh is unknown.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pytest
from cross_bench import nothing_is_left, open_fds, until
from modbus_bench import ModbusBench, modbus_bench
from pymodbus.client import AsyncModbusTcpClient

from controller.cell.batch.outputs import PlcSignals
from controller.cell.journal import Journal
from controller.cell.services.records import BatchRecord, RunProgress
from drivers.errors import LinkError, WatchdogOffError, WrongDeviceError
from drivers.io_modbus import CellIo, Change, IoConfig, OutputChannel, Signal
from emulators.gripper_modbus import RobotiqDevice
from emulators.io_modbus import E1212, CellSignals, E1214Config, E1214Device

# modbus_devices.md 7.4: the channel plan, and what each contact shows of a sound, empty cell
SOUND = {
    "estop_ok": Signal.OK,
    "guard_closed": Signal.OK,
    "part_in_nest": Signal.NOT_OK,
    "part_in_gripper": Signal.NOT_OK,
    "supply_ok": Signal.OK,
    "acknowledge": Signal.NOT_OK,
}
UNKNOWN = dict.fromkeys(SOUND, Signal.UNKNOWN)
NAMES = ("ready", "busy", "result_valid", "accept", "reject", "fault")
SIGNALS = tuple(OutputChannel(name, number) for number, name in enumerate(NAMES))


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@dataclass
class Bench:
    line: ModbusBench
    device: E1214Device
    signals: CellSignals
    io: CellIo
    changes: list[Change]

    def known(self) -> dict[str, Signal]:
        return dict(self.io.snapshot().signals)

    async def shows(self, **signals: Signal) -> None:
        """Wait until some signals are what they should be."""
        await until(lambda: self.known() == SOUND | signals)


@asynccontextmanager
async def io_bench(
    folder: Path,
    *,
    speed: float = 10.0,
    config: E1214Config | None = None,
    watchdog_s: float | None = None,
) -> AsyncIterator[Bench]:
    signals = CellSignals()
    device = E1214Device(signals, 1, config)
    async with modbus_bench("block", [device], [device], folder, speed=speed) as line:
        changes: list[Change] = []
        wired = IoConfig(outputs=SIGNALS)
        if watchdog_s is not None:
            first = "motor_relay" if device.passes_motor_supply is False else "ready"
            outputs = (OutputChannel(first, 0), *SIGNALS[1:])
            wired = IoConfig(outputs=outputs, watchdog_s=watchdog_s)
        io = CellIo(line.link, wired, on_change=changes.append)
        try:
            yield Bench(line, device, signals, io, changes)
        finally:
            await io.aclose()


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    async with io_bench(tmp_path) as bench:
        assert await bench.io.connect() == "E1214"
        await bench.shows()
        yield bench


async def test_nothing_is_ok_before_it_was_read(tmp_path: Path) -> None:
    async with io_bench(tmp_path) as bench:
        assert bench.known() == UNKNOWN
        await bench.io.connect()
        await bench.shows()
        await bench.io.aclose()
        assert bench.known() == UNKNOWN


@pytest.mark.parametrize("speed", [1.0, 10.0])
async def test_an_emergency_stop_is_seen_at_once_and_good_news_twice(
    tmp_path: Path, speed: float
) -> None:
    async with io_bench(tmp_path, speed=speed) as bench:
        await bench.io.connect()
        await bench.shows()
        bench.signals.press_estop()
        await bench.io.wait_for("estop_ok", Signal.NOT_OK)
        bench.signals.release_estop()  # §7.4: released is not reset
        await bench.line.pass_time(0.3)
        assert bench.io.signal("estop_ok") is Signal.NOT_OK
        bench.signals.reset()
        await bench.io.wait_for("estop_ok", Signal.OK)
        await bench.shows()
        order = [c.signal for c in bench.changes if c.name == "estop_ok"]
        assert order == [Signal.OK, Signal.NOT_OK, Signal.OK]


async def test_every_contact_is_on_the_channel_of_the_plan(bench: Bench) -> None:
    bench.signals.is_door_closed = False
    await bench.shows(guard_closed=Signal.NOT_OK)
    bench.signals.is_door_closed = True
    bench.signals.is_part_in_nest = True
    await bench.shows(part_in_nest=Signal.OK)
    bench.signals.is_part_in_nest = False
    bench.signals.is_part_between_jaws = True
    await bench.shows(part_in_gripper=Signal.OK)
    bench.signals.is_part_between_jaws = False
    bench.signals.is_24v_ok = False
    await bench.shows(supply_ok=Signal.NOT_OK)
    bench.signals.is_24v_ok = True
    bench.signals.is_operator_acknowledging = True
    await bench.shows(acknowledge=Signal.OK)


@pytest.mark.parametrize(("channel", "name"), [(0, "estop_ok"), (1, "guard_closed")])
async def test_a_broken_wire_is_not_healthy(bench: Bench, channel: int, name: str) -> None:
    bench.device.broken_wires.add(channel)
    await bench.shows(**{name: Signal.NOT_OK})


async def test_relays_are_switched_by_name_and_the_others_left(bench: Bench) -> None:
    await bench.io.set_outputs({"fault": True, "ready": True})
    assert [bench.device.is_closed(n) for n in range(6)] == [True, *[False] * 4, True]
    await bench.io.set_outputs({"fault": False, "accept": True})
    assert [bench.device.is_closed(n) for n in range(6)] == [True, False, False, True, False, False]
    closed = {name for name, is_closed in (await bench.io.read_outputs()).items() if is_closed}
    assert closed == {"ready", "accept"}


async def test_a_block_that_is_switched_off_is_unknown_within_the_staleness_limit(
    tmp_path: Path,
) -> None:
    async with io_bench(tmp_path) as bench:
        await bench.io.connect()
        await bench.shows()
        await bench.io.set_outputs({"fault": True})
        bench.device.is_powered = False
        clock = bench.line.clock
        began_s = clock.unheld_s()  # a last look at the block, or two, takes nothing of this
        await until(lambda: bench.known() == UNKNOWN)
        # this process may be late by a window when time is up, and when it looks
        assert clock.shared is not None
        limit_s = clock.patience_s(IoConfig().stale_s) + 2 * clock.shared.window_s
        assert clock.unheld_s() - began_s < limit_s
        bench.device.is_powered = True
        await bench.shows()
        await bench.io.set_outputs({"reject": True})  # what is known of relays was forgotten
        assert [n for n in range(6) if bench.device.is_closed(n)] == [4]


async def test_a_server_that_dies_makes_all_unknown_and_is_found_again(bench: Bench) -> None:
    await bench.line.server.aclose()
    await until(lambda: bench.known() == UNKNOWN)
    with pytest.raises(LinkError):
        await bench.io.set_outputs({"accept": True})
    bench.signals.press_estop()
    await bench.line.server.start()
    await bench.shows(estop_ok=Signal.NOT_OK)
    order = [c.signal for c in bench.changes if c.name == "estop_ok"]
    assert order == [Signal.OK, Signal.UNKNOWN, Signal.NOT_OK]


async def test_the_blocks_own_watchdog_is_told_and_cleared(tmp_path: Path) -> None:
    config = E1214Config(watchdog_s=1.0, safe_state=(False, False, False, True, False, False))
    async with io_bench(tmp_path, config=config) as bench:
        await bench.io.connect()
        await bench.io.set_outputs({"fault": True})
        assert not await bench.io.has_watchdog_tripped()
        await bench.io.aclose()
        await bench.line.pass_time(1.5)
        assert [n for n in range(6) if bench.device.is_closed(n)] == [3]
        await bench.io.connect()
        assert await bench.io.has_watchdog_tripped()
        await bench.io.clear_watchdog()
        assert not await bench.io.has_watchdog_tripped()
        await bench.io.set_outputs({"accept": False, "fault": True})
        assert [n for n in range(6) if bench.device.is_closed(n)] == [5]


GUARDED = E1214Config(watchdog_s=1.0, motor_relay=0)


async def test_the_motors_get_their_supply_once_the_watchdog_is_proven(tmp_path: Path) -> None:
    async with io_bench(tmp_path, config=GUARDED, watchdog_s=1.0) as bench:
        await bench.io.connect()
        assert not bench.device.passes_motor_supply  # to connect switches nothing
        await bench.io.prove_watchdog()
        assert bench.device.passes_motor_supply
        await bench.shows()
        await bench.line.pass_time(5.0)  # it polls, which is what the watchdog wants
        assert bench.device.passes_motor_supply
        await bench.io.aclose()
        await bench.line.pass_time(1.5)
        assert not bench.device.passes_motor_supply
        await bench.io.connect()
        await bench.io.prove_watchdog()  # the flag that is up by now is no hindrance, and no proof
        assert bench.device.passes_motor_supply


UNWIRED = E1214Config(watchdog_s=1.0)  # signals alone depend on it


async def test_signals_are_off_once_the_watchdog_is_proven_and_when_nobody_polls(
    tmp_path: Path,
) -> None:
    async with io_bench(tmp_path, config=UNWIRED, watchdog_s=1.0) as bench:
        await bench.io.connect()
        assert bench.io.watchdog_s is None  # the motors do not depend on it
        await bench.io.set_outputs({"accept": True})
        await bench.io.prove_watchdog()
        assert set((await bench.io.read_outputs()).values()) == {False}
        await bench.io.set_outputs({"accept": True, "result_valid": True})
        await bench.line.pass_time(5.0)
        assert [n for n in range(6) if bench.device.is_closed(n)] == [2, 3]
        await bench.io.aclose()  # as a controller that was killed
        await bench.line.pass_time(1.5)
        assert not any(bench.device.is_closed(n) for n in range(6))


async def test_a_strangers_client_reads_what_the_run_tells(tmp_path: Path) -> None:
    async with io_bench(tmp_path, config=UNWIRED, watchdog_s=1.0) as bench:
        await bench.io.connect()
        record = BatchRecord(cast(Journal, None), RunProgress(), lambda: signals.note())
        signals = PlcSignals(bench.io, NAMES, record, bench.line.clock)
        host, port = bench.line.server.address
        async with AsyncModbusTcpClient(host, port=port) as stranger, signals.told():

            async def reads(*on: str) -> None:
                async with asyncio.timeout(60.0):
                    while await outputs_read_by(stranger) != set(on):
                        await bench.line.pass_time(0.1)

            record.show_state("acquiring")
            await reads("ready")
            record.show_state("placing")
            await reads("busy")
            record.part.tray = "reject"
            record._finished.append(record.part)
            record.show_state("completing")
            await reads("busy", "reject", "result_valid")
            record.show_state("aborting")
            await reads("fault")
        assert not any(bench.device.is_closed(n) for n in range(6))


async def outputs_read_by(stranger: AsyncModbusTcpClient) -> set[str]:
    answer = await stranger.read_coils(0, count=6, device_id=1)
    return {name for name, is_on in zip(NAMES, answer.bits[:6], strict=True) if is_on}


async def test_a_watchdog_that_leaves_a_signal_on_is_refused(tmp_path: Path) -> None:
    safe_state = (False, False, True, True, False, False)
    config = E1214Config(watchdog_s=1.0, safe_state=safe_state)
    async with io_bench(tmp_path, config=config, watchdog_s=1.0) as bench:
        await bench.io.connect()
        with pytest.raises(WatchdogOffError, match=r"left result_valid, accept on"):
            await bench.io.prove_watchdog()


async def test_a_watchdog_that_is_off_is_refused_before_the_relay_closes(tmp_path: Path) -> None:
    async with io_bench(tmp_path, config=GUARDED, watchdog_s=1.0) as bench:
        bench.device.is_watchdog_off = True
        await bench.io.connect()
        with pytest.raises(WatchdogOffError, match=r"within 1\.3 s of silence"):
            await bench.io.prove_watchdog()
        assert not bench.device.passes_motor_supply


async def test_a_watchdog_that_tripped_by_itself_is_known(tmp_path: Path) -> None:
    async with io_bench(tmp_path, config=GUARDED, watchdog_s=1.0) as bench:
        await bench.io.connect()
        await bench.io.prove_watchdog()
        tripped = asyncio.create_task(bench.io.wait_tripped())
        await bench.shows()
        assert await bench.io.fall_silent()
        await bench.line.pass_time(0.5)
        assert not tripped.done()  # that was on purpose
        await bench.io.set_outputs({"motor_relay": True}, force=True)
        assert not bench.device.passes_motor_supply  # the safe state is kept until it is cleared
        await bench.io.restore_motor_supply()
        assert bench.device.passes_motor_supply
        await bench.shows()
        await bench.line.server.aclose()
        await bench.line.pass_time(1.5)
        assert not bench.device.passes_motor_supply
        await bench.line.server.start()
        await tripped


async def test_whoever_stops_in_our_place_takes_the_motors_their_supply(tmp_path: Path) -> None:
    async with io_bench(tmp_path, config=GUARDED, watchdog_s=1.0) as bench:
        await bench.io.connect()
        await bench.io.prove_watchdog()
        stop = bench.io.blind_stop()
        assert stop is not None
        (frame,) = stop.frames
        assert frame[6:] == bytes.fromhex("01 05 00 00 00 00")  # FC05: coil 0 off
        host, _, port = stop.place.rpartition(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        writer.write(frame)
        assert await reader.readexactly(len(frame)) == frame
        writer.close()
        await writer.wait_closed()
        assert not bench.device.passes_motor_supply
    async with io_bench(tmp_path) as bench:
        assert bench.io.blind_stop() is None  # no relay of ours is in the supply


async def test_a_gripper_at_the_address_is_no_io_block(tmp_path: Path) -> None:
    device = RobotiqDevice(unit=1)
    async with modbus_bench("block", [device], [device], tmp_path) as line:
        with pytest.raises((WrongDeviceError, LinkError)):
            await CellIo(line.link).connect()


async def test_a_block_with_eight_channels_is_read_and_switched_by_its_own_count(
    tmp_path: Path,
) -> None:
    signals = CellSignals()
    device = E1214Device(signals, 1, E1212)
    outputs = (OutputChannel("first", 0), OutputChannel("last", 7))
    config = IoConfig(model="E1212", channel_count=8, outputs=outputs)
    async with modbus_bench("block", [device], [device], tmp_path) as line:
        async with CellIo(line.link, config) as io:
            await until(lambda: io.signal("estop_ok") is Signal.OK)
            signals.press_estop()
            await until(lambda: io.signal("estop_ok") is Signal.NOT_OK)
            await io.set_outputs({"last": True})
            assert device.is_closed(7)
            assert await io.read_outputs() == {"first": False, "last": True}
        other = CellIo(line.link, IoConfig())
        with pytest.raises(WrongDeviceError, match="expected a Moxa E1214, found 'E1212'"):
            await other.connect()
