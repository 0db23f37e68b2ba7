"""The lamps' driver and two emulated LedSC controllers on one line; modbus_devices.md 6.3."""

import tomllib
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from cross_bench import nothing_is_left, open_fds
from modbus_bench import ModbusBench, Transport, modbus_bench

from drivers.errors import LinkError, WrongDeviceError
from drivers.lighting_ledsc import LedscLights, LedscSettings, PwmLamp
from emulators.lighting_ledsc import LedscDevice, LedscSupply
from emulators.lighting_modbus import AnalogOutput8Device, LampModel, LampWiring

GOLDEN = Path(__file__).parents[1] / "golden" / "modbus_devices.toml"
PLACES = {"ring": 0, "bar": 3, "back": 5}
STEP = 1 / 255
DROOP = 0.03 / 60  # of a lamp that warms up for a second


@pytest.fixture(autouse=True)
async def nothing_left_behind() -> AsyncIterator[None]:
    fds = open_fds()
    yield
    await nothing_is_left(fds)


@dataclass
class Bench:
    line: ModbusBench
    devices: tuple[LedscDevice, LedscDevice]
    lamps: dict[str, LampModel]
    lights: LedscLights

    def levels(self) -> dict[str, float]:
        self.line.catch_up()
        return {name: lamp.level for name, lamp in self.lamps.items()}


@asynccontextmanager
async def ledsc_bench(
    folder: Path, transport: Transport = "tcp", *, cycle: int = 255, drive: float = 1.0
) -> AsyncIterator[Bench]:
    devices = LedscDevice(1, cycle), LedscDevice(2, cycle)
    supply = LedscSupply(devices)
    lamps = {name: LampModel(LampWiring(name, at, 0), supply) for name, at in PLACES.items()}
    wired = tuple(PwmLamp(name, *divmod(at, 4), drive, 0.05) for name, at in PLACES.items())
    async with modbus_bench(
        transport, devices, [*devices, *lamps.values()], folder, baudrate=9600, speed=10.0
    ) as line:
        yield Bench(line, devices, lamps, LedscLights(line.link, wired, (1, 2)))


@pytest.mark.parametrize("transport", ["tcp", "rtu", "rtu-tcp"])
async def test_the_light_is_as_required_when_set_returns(
    transport: Transport, tmp_path: Path
) -> None:
    async with ledsc_bench(tmp_path, transport) as bench:
        await bench.lights.connect()
        assert bench.levels() == dict.fromkeys(PLACES, 0.0)
        for levels in (
            {"ring": 1.0, "bar": 0.5, "back": 0.0},
            {"ring": 0.25, "bar": 0.0, "back": 0.8},
            {"ring": 0.0, "bar": 0.0, "back": 0.0},
        ):
            steady_at_s = await bench.lights.set(levels, settle=True)
            assert steady_at_s <= bench.line.clock.now_s()
            assert bench.levels() == pytest.approx(levels, abs=STEP + DROOP)


async def test_the_driver_sends_the_bytes_of_the_page(tmp_path: Path) -> None:
    frames = {
        one["name"]: bytes.fromhex(one["request"])
        for one in tomllib.loads(GOLDEN.read_text())["frame"]
        if one["device"] == "ledsc"
    }
    async with ledsc_bench(tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 128 / 255, "bar": 1.0})
        sent = [frame[2:] for frame in bench.line.sent()]  # the transaction's number aside
    for name in ("read_state", "red_128_white_255"):
        assert frames[name][2:] in sent


async def test_lamps_that_are_not_named_stay_and_what_is_so_is_not_sent_again(
    tmp_path: Path,
) -> None:
    async with ledsc_bench(tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 1.0, "back": 0.4}, settle=True)
        count = len(bench.line.sent())
        before_s = await bench.lights.set({"ring": 1.0})
        assert len(bench.line.sent()) == count
        assert await bench.lights.set({"bar": 0.5}, settle=True) > before_s
        assert bench.levels() == pytest.approx(
            {"ring": 1.0, "bar": 0.5, "back": 0.4}, abs=STEP + DROOP
        )


async def test_level_1_is_the_drive_whatever_the_cycle(tmp_path: Path) -> None:
    async with ledsc_bench(tmp_path, cycle=100, drive=0.7) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 1.0, "bar": 0.5}, settle=True)
        assert bench.levels() == pytest.approx(
            {"ring": 0.7, "bar": 0.35, "back": 0.0}, abs=0.5 / 100 + DROOP
        )


async def test_all_off_darkens_every_channel_also_those_without_a_lamp(tmp_path: Path) -> None:
    async with ledsc_bench(tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 1.0, "back": 1.0})
        # somebody else lights a channel that no lamp of ours has
        bench.devices[1].request(bytes.fromhex("10 0000 0006 0C") + b"\0\xff" * 4 + b"\0\0\0\1", 0)
        await bench.lights.all_off()
        for device in bench.devices:
            assert [device.duty(colour) for colour in range(4)] == [0.0] * 4


@pytest.mark.parametrize("levels", [{"ring": 1.01}, {"ring": -0.1}, {"ring": float("nan")}])
async def test_levels_out_of_range_are_refused_before_a_byte(
    levels: dict[str, float], tmp_path: Path
) -> None:
    async with ledsc_bench(tmp_path) as bench:
        await bench.lights.connect()
        count = len(bench.line.sent())
        with pytest.raises(ValueError, match=r"levels are 0\.\.1"):
            await bench.lights.set({"bar": 0.5, **levels})
        with pytest.raises(ValueError, match="no lamp 'rnig'"):
            await bench.lights.set({"rnig": 0.5})
        assert len(bench.line.sent()) == count


async def test_a_cycle_that_channel_a_cannot_do_is_refused_with_the_remedy(tmp_path: Path) -> None:
    async with ledsc_bench(tmp_path, cycle=1000) as bench:
        with pytest.raises(WrongDeviceError, match=r"PWM cycle is 1000.*Write 255 to register 6"):
            await bench.lights.connect()


async def test_another_device_at_the_address_is_named(tmp_path: Path) -> None:
    lamps = (PwmLamp("ring", 0, 0, 1.0, 0.05),)
    async with modbus_bench("tcp", [AnalogOutput8Device(1)], [], tmp_path) as line:
        with pytest.raises(WrongDeviceError, match="expected an LedSC controller"):
            await LedscLights(line.link, lamps, (1,)).connect()


async def test_a_silent_controller_does_not_keep_the_other_one_lit(tmp_path: Path) -> None:
    async with ledsc_bench(tmp_path) as bench:
        await bench.lights.connect()
        await bench.lights.set({"ring": 1.0, "back": 1.0})
        bench.devices[0].is_powered = False
        with pytest.raises(LinkError, match="unit 1"):
            await bench.lights.all_off()
        assert bench.devices[1].duty(1) == 0.0
        bench.devices[0].is_powered = True  # what it was set to is gone: it is read again
        await bench.lights.set({"ring": 0.6}, settle=True)
        assert bench.levels()["ring"] == pytest.approx(0.6, abs=STEP + DROOP)


def test_a_lamp_on_a_controller_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match="lamp 'back' is on `analog` 5, and 1 LedSC controllers"):
        LedscLights(_NoLink(), (PwmLamp("back", 1, 1, 1.0, 0.05),), (1,))  # type: ignore[arg-type]


class _NoLink:
    """Never reached."""


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"units": ()}, "at least one"),
        ({"units": (1, 1)}, "all different"),
        ({"units": (0,)}, "1 to 247"),
        ({"settle_s": 61.0}, "0 to 60 s"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        LedscSettings(**settings)  # type: ignore[arg-type]
