"""The lamps' driver and the emulated Waveshare modules, LED drivers and all, on one RS-485 line.

Sections (§) are those of modbus_devices.md.
"""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from cross_bench import HANG_WALL_S, nothing_is_left, open_fds
from modbus_bench import ModbusBench, Transport, modbus_bench

from drivers.errors import LinkError, ReplyTimeoutError, WrongDeviceError
from drivers.lighting_modbus import LampChannel, Lights, LightsConfig
from emulators.lighting_modbus import (
    AnalogOutput8Device,
    LampCharacter,
    LampModel,
    LampWiring,
    Relay8Device,
    WaveshareSupply,
)

LINES: tuple[Transport, ...] = ("tcp", "rtu", "rtu-tcp")
NAMES = ("ring", "bar", "back")
# modbus_devices.md 6.1: 12 bits; §6.4: what a lamp loses when it is warm is not lost in a second
DAC_STEP = 1 / 4095
DROOP = 0.03 / 60


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@dataclass
class Bench:
    line: ModbusBench
    analog: AnalogOutput8Device
    relays: Relay8Device
    lamps: dict[str, LampModel]
    lights: Lights

    def levels(self) -> dict[str, float]:
        """Return the light that each lamp truly gives, of the cold lamp's full light."""
        self.line.catch_up()
        return {name: lamp.level for name, lamp in self.lamps.items()}


@asynccontextmanager
async def lights_bench(
    transport: Transport,
    folder: Path,
    *,
    speed: float = 10.0,
    characters: Mapping[str, LampCharacter] | None = None,
    settle_s: Mapping[str, float] | None = None,
    full_scale_mv: int = 10_000,
) -> AsyncIterator[Bench]:
    analog, relays = AnalogOutput8Device(1), Relay8Device(2)
    supply = WaveshareSupply(analog, relays)
    # modules print channels from 1 (driver), terminals count from 0 (emulator)
    lamps = {
        name: LampModel(LampWiring(name, n, 7 - n), supply, (characters or {}).get(name))
        for n, name in enumerate(NAMES)
    }
    config = LightsConfig(
        lamps=tuple(
            LampChannel(name, n + 1, 8 - n, full_scale_mv, settle_s=(settle_s or {}).get(name))
            for n, name in enumerate(NAMES)
        )
    )
    async with modbus_bench(
        transport,
        [analog, relays],
        [relays, *lamps.values()],
        folder,
        baudrate=9600,
        speed=speed,
    ) as line:
        yield Bench(line, analog, relays, lamps, Lights(line.link, config))


@pytest.fixture(params=LINES)
async def bench(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[Bench]:
    async with lights_bench(request.param, tmp_path) as bench:
        await bench.lights.connect()
        yield bench


async def test_both_modules_are_known_and_nothing_is_switched(bench: Bench) -> None:
    bench.line.trace.clear()
    assert await bench.lights.identify() == ("V1.00", "V1.00")  # §6.1, §6.2: 0064
    assert all(state.is_off for state in (await bench.lights.read_back()).lamps.values())
    assert bench.levels() == dict.fromkeys(NAMES, 0.0)


@pytest.mark.parametrize("speed", [1.0, 10.0])
async def test_the_light_is_as_told_when_set_says_so(tmp_path: Path, speed: float) -> None:
    async with lights_bench("tcp", tmp_path, speed=speed) as bench:
        await bench.lights.connect()
        for levels in (
            {"ring": 1.0, "bar": 0.5, "back": 0.0},
            {"ring": 0.25, "bar": 0.0, "back": 0.8},
            {"ring": 1.0, "bar": 1.0, "back": 1.0},
            {"ring": 0.0, "bar": 0.0, "back": 0.0},
        ):
            steady_at_s = await bench.lights.set(levels, settle=True)
            assert steady_at_s <= bench.line.clock.now_s()
            assert bench.levels() == pytest.approx(levels, abs=DAC_STEP + DROOP)
            await bench.line.pass_time(0.2)  # and it stays so
            assert bench.levels() == pytest.approx(levels, abs=DAC_STEP + DROOP)


async def test_a_slow_lamp_gets_its_time_and_the_others_do_not_wait(tmp_path: Path) -> None:
    slow = LampCharacter(ramp_s=0.3)
    async with lights_bench(
        "tcp", tmp_path, characters={"bar": slow}, settle_s={"bar": 0.35}
    ) as bench:
        await bench.lights.connect()
        acknowledged_at_s = await bench.lights.set({"ring": 1.0})
        steady_at_s = await bench.lights.set({"ring": 1.0}, settle=True)
        assert steady_at_s - acknowledged_at_s == pytest.approx(0.05)
        for level in (1.0, 0.0):  # its light lasts as well
            await bench.lights.set({"bar": level}, settle=True)
            assert bench.levels()["bar"] == pytest.approx(level, abs=DAC_STEP + DROOP)


async def test_a_lamp_is_never_brighter_than_its_drive(tmp_path: Path) -> None:
    async with lights_bench("tcp", tmp_path, full_scale_mv=7_000) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 1.0, "bar": 0.5}, settle=True)
        assert bench.levels()["ring"] == pytest.approx(0.7, abs=DAC_STEP + DROOP)
        assert bench.levels()["bar"] == pytest.approx(0.35, abs=DAC_STEP + DROOP)
        states = (await bench.lights.read_back()).lamps
        assert states["bar"].level == pytest.approx(0.5, abs=2 * DAC_STEP)


async def test_dark_is_relay_open_and_zero_millivolts(bench: Bench) -> None:
    await bench.lights.set({"ring": 0.6, "back": 0.3}, settle=True)
    assert [bench.relays.is_closed(n) for n in (7, 6, 5)] == [True, False, True]
    assert bench.analog.output_mv(0) == pytest.approx(6000, abs=10_000 * DAC_STEP)
    await bench.lights.set({"ring": 0.0}, settle=True)
    assert not bench.relays.is_closed(7)
    assert bench.analog.output_mv(0) == 0.0
    assert bench.levels()["ring"] == 0.0
    assert bench.levels()["back"] == pytest.approx(0.3, abs=DAC_STEP + DROOP)  # untouched
    states = (await bench.lights.read_back()).lamps
    assert states["ring"].is_off
    assert states["back"].level == pytest.approx(0.3)


async def test_all_off_takes_what_others_have_lit_too(bench: Bench) -> None:
    await bench.lights.set(dict.fromkeys(NAMES, 1.0), settle=True)
    bench.relays.request(bytes.fromhex("05 0000 FF00"), 0.0)  # §6.2: relay 1, which has no lamp
    await bench.lights.all_off(settle=True)
    assert not any(bench.relays.is_closed(n) for n in range(8))
    assert [bench.analog.output_mv(n) for n in range(8)] == [0.0] * 8
    assert bench.levels() == dict.fromkeys(NAMES, 0.0)


async def test_nothing_is_sent_that_is_so_already(bench: Bench) -> None:
    await bench.lights.set({"ring": 0.5})
    bench.line.trace.clear()
    await bench.lights.set({"ring": 0.5})
    assert bench.line.sent() == []
    await bench.lights.set({"ring": 0.6})  # the relay is closed already
    assert len(bench.line.sent()) == 1
    await bench.lights.set({"ring": 0.6}, force=True)
    assert len(bench.line.sent()) == 3


async def test_a_module_that_lost_its_power_is_asked_before_it_is_believed(tmp_path: Path) -> None:
    async with lights_bench("tcp", tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 0.5, "bar": 0.5}, settle=True)
        bench.relays.is_powered = False
        with pytest.raises(ReplyTimeoutError, match="relay module"):
            await bench.lights.set({"back": 1.0})
        bench.relays.is_powered = True  # all relays have opened meanwhile
        await bench.lights.set({"ring": 0.5, "bar": 0.5, "back": 1.0}, settle=True)
        expected = {"ring": 0.5, "bar": 0.5, "back": 1.0}
        assert bench.levels() == pytest.approx(expected, abs=DAC_STEP + DROOP)


async def test_all_off_reaches_one_module_though_the_other_is_silent(tmp_path: Path) -> None:
    async with lights_bench("rtu-tcp", tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set(dict.fromkeys(NAMES, 1.0), settle=True)
        bench.line.bus.faults(1).is_deaf = True
        with pytest.raises(ReplyTimeoutError, match="analog output module"):
            await bench.lights.all_off()
        await bench.line.pass_time(0.2)
        assert bench.levels() == dict.fromkeys(NAMES, 0.0)  # the relays have opened


@pytest.mark.parametrize("fault", ["is_mute", "is_crc_bad", "is_deaf"])
async def test_a_write_that_may_not_have_arrived_is_looked_for_by_the_next(
    tmp_path: Path, fault: str
) -> None:
    async with lights_bench("rtu-tcp", tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 0.5}, settle=True)
        faults = bench.line.bus.faults(1)
        setattr(faults, fault, True)
        faults.requests_left = 1
        with pytest.raises(ReplyTimeoutError):
            await bench.lights.set({"ring": 0.9})
        bench.line.bus.clear_faults()
        await bench.lights.set({"ring": 0.9}, settle=True)
        assert bench.levels()["ring"] == pytest.approx(0.9, abs=DAC_STEP + DROOP)


async def test_swapped_modules_are_told(tmp_path: Path) -> None:
    async with lights_bench("tcp", tmp_path) as bench:
        lamps = (LampChannel("ring", 1, 8),)
        lights = Lights(bench.line.link, LightsConfig(lamps, analog_unit=2, relay_unit=1))
        with pytest.raises(WrongDeviceError, match="Analog Output"):
            await lights.connect()


@pytest.mark.parametrize("transport", LINES)
async def test_a_line_that_comes_back_finds_lamps_as_they_were_left(
    tmp_path: Path, transport: Transport
) -> None:
    """§6.1: outputs keep their value when the master disappears."""
    async with lights_bench(transport, tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 0.7}, settle=True)
        await bench.line.server.aclose()
        with pytest.raises(LinkError):
            await bench.lights.read_back()
        await bench.line.server.start()
        async with asyncio.timeout(HANG_WALL_S):
            while True:
                try:
                    reading = await bench.lights.read_back()
                    break
                except LinkError:  # its back-off is not over
                    await bench.line.clock.sleep(0.1)
        assert reading.lamps["ring"].level == pytest.approx(0.7)
        assert bench.levels()["ring"] == pytest.approx(0.7, abs=0.01)  # warm by now
