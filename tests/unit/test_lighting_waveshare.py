"""The lamp driver against an analog and a relay module written from the vendor's frames."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from modbus_fakes import Bus, Map, golden, rtu_on_pty, rtu_over_tcp, tcp_gateway

from controller.cell.devices import DeviceBuilder, resolve
from controller.config import load_cell
from drivers.clock import CellClock
from drivers.errors import LinkError, ReplyTimeoutError, WrongDeviceError
from drivers.lighting_modbus import LampChannel, Lights, LightsConfig
from drivers.modbus_link import ModbusLink, RtuAddress, RtuOverTcpAddress, TcpAddress

ROOT = Path(__file__).parents[2]
FAST = CellClock(speed=20.0, min_timeout_wall_s=1.0)  # no busy host looks like a silent module
IMPATIENT = CellClock(speed=20.0, min_timeout_wall_s=0.12)  # where a time-out is what is tested
CONFIG = LightsConfig(
    (
        LampChannel("backlight", analog_channel=1, relay_channel=1),
        LampChannel("ring", analog_channel=2, relay_channel=2, min_on_mv=1000),
        LampChannel("bar", analog_channel=3, relay_channel=3, full_scale_mv=8000),
    )
)


def analog_module() -> Map:
    registers = dict.fromkeys(range(8), 0)
    return Map(holding={**registers, 0x4000: 1, 0x8000: 100}, functions=(3, 6, 16))


def relay_module() -> Map:
    return Map(
        holding={0x4000: 2, 0x8000: 201},
        coils=dict.fromkeys(range(8), False),
        functions=(1, 3, 5, 6, 15),
    )


@dataclass
class Rig:
    analog: Map = field(default_factory=analog_module)
    relay: Map = field(default_factory=relay_module)
    bus: Bus = field(default_factory=Bus)

    def __post_init__(self) -> None:
        self.bus.units = {1: self.analog.answer, 2: self.relay.answer}

    @property
    def outputs_mv(self) -> list[int]:
        return [self.analog.holding[i] for i in range(8)]

    @property
    def closed(self) -> list[int]:
        """Channels of the closed relays, as printed on the module."""
        return [i + 1 for i in range(8) if self.relay.coils[i]]

    def writes(self) -> list[tuple[int, int]]:
        """Return (unit, function) of every write on an RTU line."""
        return [(frame[0], frame[1]) for frame in self.bus.requests if frame[1] > 4]


@asynccontextmanager
async def lights_on(
    rig: Rig, transport: str = "rtu", config: LightsConfig = CONFIG, clock: CellClock = FAST
) -> AsyncIterator[Lights]:
    async with AsyncExitStack() as stack:
        address: TcpAddress | RtuAddress | RtuOverTcpAddress
        if transport == "tcp":
            address = TcpAddress("127.0.0.1", await stack.enter_async_context(tcp_gateway(rig.bus)))
        elif transport == "rtu":
            address = RtuAddress(await stack.enter_async_context(rtu_on_pty(rig.bus)), 9600)
        else:
            port = await stack.enter_async_context(rtu_over_tcp(rig.bus))
            address = RtuOverTcpAddress("127.0.0.1", port)
        link = await stack.enter_async_context(ModbusLink(address, clock))
        lights = await stack.enter_async_context(Lights(link, config))
        rig.bus.requests.clear()
        yield lights


@pytest.mark.parametrize("transport", ["tcp", "rtu", "rtu over tcp"])
async def test_one_setting_chooses_the_transport(transport: str) -> None:
    rig = Rig()
    async with lights_on(rig, transport) as lights:
        await lights.set({"backlight": 0.5})
    assert rig.outputs_mv == [5000, 0, 0, 0, 0, 0, 0, 0]
    assert rig.closed == [1]


async def test_all_off_and_relays_1_and_3_are_the_vendors_frames() -> None:
    """Both modules leave the factory as slave 1, as in the frames: here each has its own line."""
    analog, relay = analog_module(), relay_module()
    analog_bus, relay_bus = Bus({1: analog.answer}), Bus({1: relay.answer})
    config = LightsConfig(
        tuple(LampChannel(f"lamp {i}", analog_channel=i, relay_channel=i) for i in range(1, 9)),
        analog_unit=1,
        relay_unit=1,
    )
    async with (
        rtu_on_pty(analog_bus) as analog_tty,
        rtu_on_pty(relay_bus) as relay_tty,
        ModbusLink(RtuAddress(analog_tty, 9600), FAST) as link,
        ModbusLink(RtuAddress(relay_tty, 9600), FAST) as relay_link,
    ):
        lights = Lights(link, config, relay_link)
        await lights.set({"lamp 1": 1.0, "lamp 3": 1.0})
        await lights.set({f"lamp {i}": 0.5 for i in range(1, 9)})
        reading = await lights.read_back()
        await lights.all_off()
    analog_writes = [frame for frame in analog_bus.requests if frame[1] != 3]
    relay_writes = [frame for frame in relay_bus.requests if frame[1] == 15]
    assert analog_writes[1] == golden("waveshare_analog", "all_5000_mv")[0]
    assert analog_writes[2] == golden("waveshare_analog", "all_off")[0]
    assert relay_writes[0] == golden("waveshare_relay", "relays_1_and_3_on")[0]
    assert golden("waveshare_analog", "read_all_5000_mv")[0] in analog_bus.requests
    assert golden("waveshare_relay", "read_relays_1_and_3")[0] in relay_bus.requests
    assert all(state.level == pytest.approx(0.5) for state in reading.lamps.values())


async def test_the_vendors_answers_are_read_as_the_vendor_says() -> None:
    analog_request, analog_reply = golden("waveshare_analog", "read_all_5000_mv")
    relay_request, relay_reply = golden("waveshare_relay", "read_relays_1_and_3")
    version_request, version_reply = golden("waveshare_relay", "version_1_00")
    answers = {
        analog_request[1:-2]: analog_reply[1:-2],
        relay_request[1:-2]: relay_reply[1:-2],
        version_request[1:-2]: version_reply[1:-2],
    }
    bus = Bus({1: answers.__getitem__, 2: answers.__getitem__})
    async with rtu_on_pty(bus) as tty, ModbusLink(RtuAddress(tty, 9600), FAST) as link:
        lights = Lights(link, CONFIG)
        assert await lights.identify() == ("V1.00", "V1.00")
        lamps = (await lights.read_back()).lamps
    assert [lamps[name].is_relay_closed for name in ("backlight", "ring", "bar")] == [
        True,
        False,
        True,
    ]
    assert [lamp.voltage_mv for lamp in lamps.values()] == [5000, 5000, 5000]


async def test_levels_become_millivolts_between_each_lamps_own_ends() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 0.25, "ring": 0.5, "bar": 1.0})
        assert rig.outputs_mv[:3] == [2500, 5500, 8000]
        reading = await lights.read_back()
    assert [lamp.level for lamp in reading.lamps.values()] == pytest.approx([0.25, 0.5, 1.0])


async def test_off_means_zero_millivolts_and_an_open_relay() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 1.0, "ring": 1.0})
        await lights.set({"ring": 0.0})
        reading = await lights.read_back()
    assert rig.outputs_mv[:2] == [10000, 0]
    assert rig.closed == [1]
    assert reading.lamps["ring"].is_off
    assert not reading.lamps["backlight"].is_off


async def test_a_lamp_with_voltage_and_an_open_relay_is_not_off() -> None:
    rig = Rig()
    rig.analog.holding[0] = 5000
    async with lights_on(rig) as lights:
        state = (await lights.read_back()).lamps["backlight"]
    assert state.level == 0.0
    assert not state.is_off


async def test_relays_close_before_the_voltage_rises_and_open_after_it_fell() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 1.0, "ring": 0.3})
        assert rig.writes() == [(2, 15), (1, 16)]  # one request to either module
        rig.bus.requests.clear()
        await lights.set({"backlight": 0.0, "ring": 0.0})
        assert rig.writes() == [(1, 16), (2, 15)]


async def test_switching_from_one_lamp_to_another_takes_one_request_to_either_module() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 1.0})
        rig.bus.requests.clear()
        await lights.set({"backlight": 0.0, "bar": 1.0})
        assert rig.writes() == [(2, 15), (1, 16)]
    assert rig.outputs_mv[:3] == [0, 0, 8000]
    assert rig.closed == [3]


async def test_dimming_leaves_the_relays_alone_and_nothing_changed_sends_nothing() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 1.0})
        rig.bus.requests.clear()
        await lights.set({"backlight": 0.5})
        assert rig.writes() == [(1, 16)]
        rig.bus.requests.clear()
        since_s = await lights.set({"backlight": 0.5})
        assert rig.bus.requests == []
        assert since_s < FAST.now_s()


async def test_forcing_writes_what_is_known_already() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 0.5})
        rig.analog.holding[0] = 0  # the module was switched off and on behind our back
        rig.relay.coils[0] = False
        await lights.set({"backlight": 0.5}, force=True)
    assert rig.outputs_mv[0] == 5000
    assert rig.closed == [1]


async def test_outputs_that_are_not_lamps_keep_their_value() -> None:
    rig = Rig()
    rig.analog.holding[7] = 1234
    rig.relay.coils[7] = True
    async with lights_on(rig) as lights:
        await lights.set({"backlight": 1.0}, force=True)
        assert rig.outputs_mv[7] == 1234
        assert rig.closed == [1, 8]
        await lights.all_off()
    assert rig.outputs_mv == [0] * 8
    assert rig.closed == []


async def test_the_answer_is_the_instant_of_the_last_acknowledge() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        before_s = FAST.now_s()
        written_at_s: list[float] = []
        rig.analog.on_access = lambda: written_at_s.append(FAST.now_s())
        acknowledged_at_s = await lights.set({"backlight": 1.0})
        assert before_s < written_at_s[-1] <= acknowledged_at_s <= FAST.now_s()


async def test_settling_waits_in_cell_time() -> None:
    rig = Rig()
    clock = CellClock(speed=0.5)
    async with lights_on(rig, clock=clock) as lights:
        rig.analog.on_access = lambda: written_at_s.append(clock.now_s())
        written_at_s: list[float] = []
        steady_at_s = await lights.set({"backlight": 1.0}, settle=True)
        assert clock.now_s() >= steady_at_s - 0.005  # the loop's own clock resolution
    assert steady_at_s - written_at_s[-1] >= 0.05


async def test_an_unknown_lamp_or_level_is_refused_before_the_wire() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        with pytest.raises(ValueError, match=r"no lamp 'rign'; there are backlight, ring, bar"):
            await lights.set({"backlight": 1.0, "rign": 1.0})
        for level in (1.01, -0.1, float("nan")):
            with pytest.raises(ValueError, match=r"levels are 0\.\.1"):
                await lights.set({"ring": level})
    assert rig.bus.requests == []


async def test_after_a_write_without_acknowledge_the_modules_are_asked_before_the_next() -> None:
    rig = Rig()
    async with lights_on(rig, clock=IMPATIENT) as lights:
        rig.bus.troubles = ["silent"]  # the relay request: done, but not acknowledged
        with pytest.raises(ReplyTimeoutError, match="relay module"):
            await lights.set({"backlight": 1.0})
        assert rig.closed == [1]
        await lights.set({"backlight": 0.0})  # would send nothing, were the old state believed
    assert rig.closed == []


async def test_a_dimming_without_acknowledge_is_not_taken_for_undone() -> None:
    rig = Rig()
    async with lights_on(rig, clock=IMPATIENT) as lights:
        await lights.set({"backlight": 1.0})
        rig.bus.troubles = ["silent"]
        with pytest.raises(ReplyTimeoutError, match="analog output module"):
            await lights.set({"backlight": 0.5})
        assert rig.outputs_mv[0] == 5000
        await lights.set({"backlight": 1.0})
    assert rig.outputs_mv[0] == 10000


async def test_all_off_opens_the_relays_even_if_the_analog_module_is_silent() -> None:
    rig = Rig()
    async with lights_on(rig, clock=IMPATIENT) as lights:
        await lights.set({"backlight": 1.0})
        rig.bus.silent_units.add(1)
        with pytest.raises(LinkError, match="analog output module"):
            await lights.all_off()
    assert rig.closed == []


async def test_concurrent_changes_do_not_undo_each_other() -> None:
    rig = Rig()
    async with lights_on(rig) as lights:
        await asyncio.gather(
            lights.set({"backlight": 1.0}), lights.set({"ring": 1.0}), lights.set({"bar": 1.0})
        )
    assert rig.outputs_mv[:3] == [10000, 10000, 8000]
    assert rig.closed == [1, 2, 3]


async def test_modules_with_exchanged_addresses_are_wrong_devices() -> None:
    rig = Rig()
    rig.bus.units = {1: rig.relay.answer, 2: rig.analog.answer}
    with pytest.raises(WrongDeviceError, match=r"expected a Waveshare Analog Output 8CH \(B\)"):
        async with lights_on(rig):
            pass
    rig = Rig()
    rig.bus.units[2] = rig.analog.answer
    with pytest.raises(WrongDeviceError, match=r"expected a Waveshare Modbus RTU Relay 8CH"):
        async with lights_on(rig):
            pass


async def test_the_current_module_is_recognised_by_what_no_voltage_module_holds() -> None:
    rig = Rig()
    rig.analog.holding[0] = 20000
    with pytest.raises(WrongDeviceError, match="0-20 mA"):
        async with lights_on(rig):
            pass


@pytest.mark.parametrize("silent", [1, 2])
async def test_a_missing_module_is_named_with_its_unit_and_what_to_check(silent: int) -> None:
    rig = Rig()
    rig.bus.gateway_code = 0x0B
    del rig.bus.units[silent]
    with pytest.raises(ReplyTimeoutError) as caught:
        async with lights_on(rig, "tcp"):
            pass
    assert f"unit {silent}" in str(caught.value)
    assert "9600 8N1" in str(caught.value)


def test_a_configuration_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="as printed"):
        LampChannel("ring", analog_channel=0, relay_channel=1)
    with pytest.raises(ValueError, match="full_scale_mv"):
        LampChannel("ring", 1, 1, full_scale_mv=12000)
    with pytest.raises(ValueError, match="relay channels must differ"):
        LightsConfig((LampChannel("a", 1, 1), LampChannel("b", 2, 1)))


async def test_two_modules_with_one_id_on_one_line_are_refused() -> None:
    link = ModbusLink(TcpAddress("127.0.0.1", 1), FAST)
    with pytest.raises(ValueError, match="both modules have slave id 1"):
        Lights(link, LightsConfig(CONFIG.lamps, analog_unit=1, relay_unit=1))
    await link.aclose()


@pytest.mark.parametrize("lamp", ["table_backlight", "station_side"])
async def test_a_channel_of_the_cell_file_is_one_less_than_the_number_printed(lamp: str) -> None:
    """On the wire: channel 1 to 8, as printed, are registers and coils 0 to 7 (6.1, 6.2)."""
    text = (ROOT / "recipes/cells/emulated.yaml").read_text(encoding="utf-8")
    cell = load_cell(ROOT / "recipes/cells/emulated.yaml")
    assert "one less than the number printed on the module" in text.partition("\nlamps:")[2][:120]
    rig = Rig()
    async with tcp_gateway(rig.bus) as port:
        names = type(cell.devices).model_fields
        offered = {"host": "127.0.0.1", "port": port, "address": "not used", "transport": "tcp"}
        where = resolve(cell, dict.fromkeys(names, offered))
        builder = DeviceBuilder(cell, where, FAST)
        lights = builder.lights()
        try:
            await lights.connect()
            await lights.set({lamp: 1.0})
            outputs_mv, closed = rig.outputs_mv, rig.closed
        finally:
            for link in builder.links:
                await link.aclose()
    number = {"table_backlight": 1, "station_side": 6}[lamp]  # as printed
    assert [i for i, mv in enumerate(outputs_mv, 1) if mv] == [number]
    assert closed == [number]
