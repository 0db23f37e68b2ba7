"""Waveshare analog outputs and relays, and their lamps: modbus_devices.md 6.1, 6.2, 6.4.

Sections (§) are those of modbus_devices.md.
"""

import pytest
from emu_modbus_bench import STEP_S
from hypothesis import given
from hypothesis import strategies as st

from emulators.lighting_modbus import (
    AnalogOutput8Device,
    LampCharacter,
    LampModel,
    LampWiring,
    Relay8Device,
    WaveshareSupply,
)
from emulators.modbus import Bus

STEP_MV = 10000 / 4095  # §6.1: 12-bit DAC


def pdu(text: str) -> bytes:
    return bytes.fromhex(text)


# --- analog outputs -------------------------------------------------------------------------------


@given(channel=st.integers(0, 7), millivolts=st.integers(0, 10000))
def test_a_channel_reads_back_what_was_asked_and_gives_the_nearest_step(
    channel: int, millivolts: int
) -> None:
    device = AnalogOutput8Device()
    request = bytes((6, 0, channel)) + millivolts.to_bytes(2, "big")
    assert device.request(request, 0.0) == request
    read = device.request(bytes((3, 0, channel, 0, 1)), 0.0)
    assert read == b"\x03\x02" + millivolts.to_bytes(2, "big")
    given_mv = device.output_mv(channel)
    assert abs(given_mv - millivolts) <= STEP_MV / 2 + 1e-9
    assert given_mv / STEP_MV == pytest.approx(round(given_mv / STEP_MV), abs=1e-6)
    assert all(device.output_mv(other) == 0.0 for other in range(8) if other != channel)


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("06 0000 2711", "86 03"),
        ("06 0008 0001", "86 02"),
        ("06 8000 0001", "86 02"),
        ("06 4000 0000", "86 03"),
        ("06 4000 0100", "86 03"),
        ("06 2000 0008", "86 03"),
        ("03 0000 0009", "83 02"),
        ("03 2000 0001", "83 02"),
        ("03 0000 0000", "83 03"),
        ("03 0000 007E", "83 03"),
        ("10 0000 0002 04 1388", "90 03"),
        ("10 0000 0002 02 1388 1388", "90 03"),
        ("10 0007 0002 04 1388 1388", "90 02"),
        ("01 0000 0001", "81 01"),
        ("05 0000 FF00", "85 01"),
        ("17", "97 01"),
    ],
)
def test_the_analog_module_refuses(request_: str, code: str) -> None:
    assert AnalogOutput8Device().request(pdu(request_), 0.0) == pdu(code)


def test_a_block_with_one_bad_value_changes_nothing() -> None:
    device = AnalogOutput8Device()
    assert device.request(pdu("10 0000 0002 04 1388 2711"), 0.0) == pdu("90 03")
    assert device.output_mv(0) == 0.0


def test_outputs_keep_their_value_until_power_goes() -> None:
    device = AnalogOutput8Device()
    device.request(pdu("06 0000 2710"), 0.0)
    assert device.output_mv(0) == 10000.0
    device.is_powered = False
    assert device.request(pdu("03 0000 0001"), 0.0) is None
    device.is_powered = True
    assert device.output_mv(0) == 0.0
    assert device.request(pdu("03 0000 0001"), 0.0) == pdu("03 02 0000")


def test_a_module_is_found_and_renumbered_by_broadcast() -> None:
    bus = Bus([AnalogOutput8Device(unit=7)])
    found = bus.request(0, pdu("03 4000 0001"), 0.0)
    assert found is not None
    assert (found.unit, found.pdu) == (7, pdu("03 02 0007"))
    assert bus.request(0, pdu("06 4000 0003"), 0.0) is None
    assert bus.request(7, pdu("03 8000 0001"), 0.0) is None
    renumbered = bus.request(3, pdu("03 8000 0001"), 0.0)
    assert renumbered is not None
    assert renumbered.pdu == pdu("03 02 0064")


def test_two_modules_answering_at_once_cannot_be_read() -> None:
    bus = Bus([AnalogOutput8Device(1), Relay8Device(2)])
    assert bus.request(0, pdu("03 4000 0001"), 0.0) is None
    bus.request(2, pdu("06 4000 0001"), 0.0)
    assert bus.request(1, pdu("03 8000 0001"), 0.0) is None
    bus.detach(bus.devices[1])
    assert bus.request(1, pdu("03 8000 0001"), 0.0) is not None


# --- relays ---------------------------------------------------------------------------------------


def closed(device: Relay8Device) -> set[int]:
    reply = device.request(pdu("01 0000 0008"), 0.0)
    assert reply is not None
    on = {n for n in range(8) if reply[2] >> n & 1}
    assert on == {n for n in range(8) if device.is_closed(n)}
    return on


def wait(device: Relay8Device | LampModel, duration_s: float) -> None:
    for _ in range(round(duration_s / STEP_S)):
        device.advance(STEP_S)


def test_relays_switch_toggle_and_toggle_all() -> None:
    device = Relay8Device()
    device.request(pdu("05 0001 FF00"), 0.0)
    device.request(pdu("05 0004 5500"), 0.0)
    assert closed(device) == {1, 4}
    device.request(pdu("05 0001 5500"), 0.0)
    assert closed(device) == {4}
    device.request(pdu("05 01FF FF00"), 0.0)
    assert closed(device) == {0, 1, 2, 3, 5, 6, 7}
    device.request(pdu("0F 0002 0003 01 02"), 0.0)
    assert closed(device) == {0, 1, 3, 5, 6, 7}


def test_a_flash_closes_for_tenths_of_a_second_and_its_opposite_opens() -> None:
    device = Relay8Device()
    device.request(pdu("05 0001 FF00"), 0.0)
    device.request(pdu("05 0200 0007"), 0.0)  # printed: 0.7 s
    device.request(pdu("05 0401 0003"), 0.0)
    assert closed(device) == {0}
    wait(device, 0.2)
    assert closed(device) == {0}
    wait(device, 0.15)
    assert closed(device) == {0, 1}
    wait(device, 0.3)
    assert closed(device) == {0, 1}
    wait(device, 0.1)
    assert closed(device) == {1}


def test_a_command_during_a_flash_is_the_last_word() -> None:
    device = Relay8Device()
    device.request(pdu("05 0200 0002"), 0.0)
    device.request(pdu("05 0000 FF00"), 0.0)
    wait(device, 1.0)
    assert closed(device) == {0}


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("05 0000 1234", "85 03"),
        ("05 0008 FF00", "85 02"),
        ("05 00FF 5500", "85 03"),
        ("01 00FF 0001", "81 02"),
        ("01 0000 0009", "81 02"),
        ("01 0000 07D1", "81 03"),
        ("0F 0000 0009 02 FFFF", "8F 02"),
        ("0F 0000 0008 02 FFFF", "8F 03"),
        ("02 0000 0001", "82 01"),
    ],
)
def test_the_relay_module_refuses_and_switches_nothing(request_: str, code: str) -> None:
    device = Relay8Device()
    assert device.request(pdu(request_), 0.0) == pdu(code)
    assert closed(device) == set()


# --- light ----------------------------------------------------------------------------------------


class Bench:
    def __init__(self, **character: float) -> None:
        self.analog = AnalogOutput8Device(1)
        self.relays = Relay8Device(2)
        wiring = LampWiring("ring", analog_channel=1, relay_channel=4)
        self.lamp = LampModel(
            wiring, WaveshareSupply(self.analog, self.relays), LampCharacter(**character)
        )

    def set(self, millivolts: int, *, is_closed: bool) -> None:
        self.analog.request(b"\x06\x00\x01" + millivolts.to_bytes(2, "big"), 0.0)
        self.relays.request(b"\x05\x00\x04" + (b"\xff\x00" if is_closed else b"\x00\x00"), 0.0)

    def settled(self) -> float:
        wait(self.lamp, 0.1)
        return self.lamp.level


@pytest.fixture
def bench() -> Bench:
    return Bench(droop_fraction=0.0)


def test_zero_millivolts_are_not_dark_but_an_open_relay_is(bench: Bench) -> None:
    bench.set(0, is_closed=True)
    assert 0.05 <= bench.settled() <= 0.10
    bench.set(0, is_closed=False)
    assert bench.settled() == 0.0
    bench.set(10000, is_closed=False)
    assert bench.settled() == 0.0


def test_light_follows_the_voltage_down_to_its_lowest_level(bench: Bench) -> None:
    levels = []
    for millivolts in (10000, 5000, 1000, 570, 300, 0):
        bench.set(millivolts, is_closed=True)
        levels.append(bench.settled())
    assert levels == pytest.approx([1.0, 0.5, 0.1, 0.057, 0.057, 0.057], abs=2e-4)


def test_a_broken_dimming_wire_is_full_light(bench: Bench) -> None:
    bench.set(1000, is_closed=True)
    bench.lamp.is_dimming_wire_broken = True
    assert bench.settled() == pytest.approx(1.0)
    bench.set(1000, is_closed=False)
    assert bench.settled() == 0.0


def test_a_dead_analog_module_dims_and_a_dead_relay_module_darkens(bench: Bench) -> None:
    bench.set(10000, is_closed=True)
    bench.analog.is_powered = False
    assert bench.settled() == pytest.approx(0.057)
    bench.relays.is_powered = False
    assert bench.settled() == 0.0


@pytest.mark.parametrize("fault", ["dead LEDs", "no supply"])
def test_a_lamp_can_fail(bench: Bench, fault: str) -> None:
    bench.set(10000, is_closed=True)
    bench.lamp.is_dead = fault == "dead LEDs"
    bench.lamp.is_supply_on = fault != "no supply"
    assert bench.settled() == 0.0


def test_light_takes_20_to_50_ms_to_come_and_go(bench: Bench) -> None:
    for is_closed, end in ((True, 1.0), (False, 0.0)):
        bench.set(10000, is_closed=is_closed)
        wait(bench.lamp, 0.0167)
        assert 0.0 < bench.lamp.level < 1.0
        wait(bench.lamp, 0.0333)
        assert bench.lamp.level == end


def test_a_warm_lamp_droops_a_few_percent_and_recovers_in_the_dark() -> None:
    bench = Bench(droop_fraction=0.04, warm_up_s=10.0)
    bench.set(10000, is_closed=True)
    assert bench.settled() == pytest.approx(1.0, abs=0.001)
    wait(bench.lamp, 9.9)
    assert bench.lamp.level == pytest.approx(1 - 0.04 * (1 - 2.71828**-1), abs=0.001)
    wait(bench.lamp, 100.0)
    assert bench.lamp.level == pytest.approx(0.96, abs=0.001)
    bench.set(0, is_closed=False)
    wait(bench.lamp, 100.0)
    bench.set(10000, is_closed=True)
    assert bench.settled() == pytest.approx(1.0, abs=0.001)


def test_a_driver_need_not_be_linear() -> None:
    bench = Bench(exponent=2.0, droop_fraction=0.0)
    bench.set(5000, is_closed=True)
    assert bench.settled() == pytest.approx(0.25, abs=2e-4)
