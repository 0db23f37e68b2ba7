"""Moxa ioLogik E1214 and the contacts behind it: modbus_devices.md 7.1 and 7.4."""

import struct

import pytest
from emu_modbus_bench import STEP_S

from emulators.io_modbus import CellSignals, E1214Config, E1214Device


def pdu(text: str) -> bytes:
    return bytes.fromhex(text)


def ask(device: E1214Device, text: str) -> str:
    reply = device.request(pdu(text), 0.0)
    assert reply is not None
    return reply.hex(" ").upper()


def wait(device: E1214Device, duration_s: float) -> None:
    for _ in range(round(duration_s / STEP_S)):
        device.advance(STEP_S)


def words(device: E1214Device, address: int, count: int, function: int = 4) -> list[int]:
    reply = device.request(struct.pack(">BHH", function, address, count), 0.0)
    assert reply is not None
    assert reply[:2] == bytes((function, 2 * count))
    return list(struct.unpack(f">{count}H", reply[2:]))


@pytest.fixture
def device() -> E1214Device:
    return E1214Device()


def closed(device: E1214Device) -> list[int]:
    """Return the numbers of the relays that are closed."""
    return [number for number in range(6) if device.is_closed(number)]


# --- inputs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("signal", "channel"),
    [
        ("is_door_closed", 1),
        ("is_part_in_nest", 2),
        ("is_part_between_jaws", 3),
        ("is_24v_ok", 4),
        ("is_operator_acknowledging", 5),
    ],
)
def test_each_contact_is_its_own_input_in_bits_and_word(
    device: E1214Device, signal: str, channel: int
) -> None:
    for is_on in (True, False):
        setattr(device.signals, signal, is_on)
        bit = int(is_on)
        assert ask(device, f"02 {channel:04X} 0001") == f"02 01 {bit:02X}"
        assert words(device, 48, 1)[0] >> channel & 1 == bit
        bits = device.request(pdu("02 0000 0006"), 0.0)
        assert bits is not None
        assert bits[2] == words(device, 48, 1)[0]


def test_an_emergency_stop_stays_until_it_is_released_and_reset() -> None:
    signals = CellSignals()
    device = E1214Device(signals)

    def chain() -> str:
        return ask(device, "02 0000 0001")

    assert chain() == "02 01 01"
    signals.press_estop()
    assert chain() == "02 01 00"
    signals.reset()
    assert chain() == "02 01 00"
    signals.release_estop()
    assert chain() == "02 01 00"
    signals.reset()
    assert chain() == "02 01 01"


def test_a_broken_wire_reads_not_healthy(device: E1214Device) -> None:
    device.broken_wires = {0, 1}
    assert words(device, 48, 1) == [0b010000]


def test_a_running_counter_counts_closing_edges_high_word_first(device: E1214Device) -> None:
    def pulse(times: int) -> None:
        for _ in range(times):
            device.signals.is_part_in_nest = True
            wait(device, 2 * STEP_S)
            device.signals.is_part_in_nest = False
            wait(device, 2 * STEP_S)

    pulse(2)
    assert words(device, 20, 2) == [0, 0]  # stopped as delivered
    ask(device, "05 0102 FF00")
    pulse(3)
    assert words(device, 20, 2) == [0, 3]
    assert ask(device, "01 0102 0001") == "01 01 01"
    ask(device, "05 0112 FF00")
    assert words(device, 20, 2) == [0, 0]


def test_an_input_that_stays_on_is_one_edge_whatever_its_neighbours_do(
    device: E1214Device,
) -> None:
    device.advance(STEP_S)
    ask(device, "0F 0100 0006 01 3F")
    device.signals.is_part_in_nest = True
    for is_on in (True, False, True):
        device.signals.is_operator_acknowledging = is_on
        device.advance(STEP_S)
    assert words(device, 16, 12) == [0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 2]


def test_a_counter_overflows_into_its_flag(device: E1214Device) -> None:
    device.advance(STEP_S)
    counter = device._state.counters[0]
    counter.count, counter.is_running = 0xFFFF_FFFF, True
    assert words(device, 16, 2) == [0xFFFF, 0xFFFF]
    device.signals.press_estop()
    device.advance(STEP_S)
    device.signals.release_estop()
    device.signals.reset()
    device.advance(STEP_S)
    assert words(device, 16, 2) == [0, 0]
    assert ask(device, "02 03E8 0006") == "02 01 01"
    ask(device, "05 0120 FF00")
    assert ask(device, "02 03E8 0006") == "02 01 00"


# --- relays ---------------------------------------------------------------------------------------


def test_relays_are_coils_and_a_word(device: E1214Device) -> None:
    ask(device, "05 0003 FF00")
    assert closed(device) == [3]
    assert words(device, 32, 1, function=3) == [0b001000]
    ask(device, "06 0020 0030")
    assert closed(device) == [4, 5]
    assert ask(device, "01 0000 0006") == "01 01 30"
    ask(device, "0F 0004 0002 01 00")
    assert closed(device) == []


def test_switching_is_counted_in_total_and_since_the_last_reset(device: E1214Device) -> None:
    for value in ("FF00", "FF00", "0000", "FF00"):
        ask(device, f"05 0001 {value}")
    assert words(device, 66, 2) == [0, 2]
    assert words(device, 98, 2) == [0, 2]
    ask(device, "05 0031 FF00")
    assert words(device, 66, 2) == [0, 2]
    assert words(device, 98, 2) == [0, 0]


def test_a_pulse_train_has_its_count_and_widths_of_one_and_a_half_seconds(
    device: E1214Device,
) -> None:
    ask(device, "10 0024 0002 04 0000 0002")  # relay 0: two pulses
    ask(device, "06 0034 0002")  # on for 3.0 s
    ask(device, "06 0044 0001")  # off for 1.5 s
    ask(device, "05 0010 FF00")
    seen = []
    for _ in range(20):
        wait(device, 0.25)
        seen.append(device.is_closed(0))
        wait(device, 0.25)
    expected = [True] * 6 + [False] * 3 + [True] * 6 + [False] * 5
    assert seen == expected
    assert ask(device, "01 0010 0001") == "01 01 00"


def test_the_watchdog_is_off_as_delivered(device: E1214Device) -> None:
    ask(device, "06 0020 003F")
    wait(device, 60.0)
    assert words(device, 32, 1, function=3) == [0x3F]
    assert ask(device, "01 1030 0001") == "01 01 00"


def test_the_watchdog_brings_relays_to_their_safe_state_and_raises_its_flag() -> None:
    safe_state = (False, False, False, True, False, False)
    device = E1214Device(config=E1214Config(watchdog_s=2.0, safe_state=safe_state))
    ask(device, "06 0020 0021")
    for _ in range(4):
        wait(device, 1.0)
        assert words(device, 32, 1, function=3) == [0x21]
    wait(device, 2.1)
    assert words(device, 32, 1, function=3) == [0x08]
    assert ask(device, "01 1030 0001") == "01 01 01"
    ask(device, "05 1030 FF00")
    assert ask(device, "01 1030 0001") == "01 01 00"


def test_after_the_watchdog_relays_obey_once_its_flag_is_cleared() -> None:
    device = E1214Device(config=E1214Config(watchdog_s=1.0, motor_relay=0))
    ask(device, "05 0000 FF00")
    assert device.passes_motor_supply
    wait(device, 1.1)
    assert not device.passes_motor_supply
    for order in ("05 0000 FF00", "06 0020 003F", "05 0010 FF00"):  # coil, word, pulses
        ask(device, order)
        assert words(device, 32, 1, function=3) == [0]
    ask(device, "05 1030 FF00")
    assert not device.passes_motor_supply  # clearing closes nothing
    ask(device, "05 0000 FF00")
    assert device.passes_motor_supply


def test_what_an_installer_has_wrong_leaves_the_supply_on() -> None:
    device = E1214Device(config=E1214Config(watchdog_s=1.0, motor_relay=0))
    ask(device, "05 0000 FF00")
    device.is_watchdog_off = True
    wait(device, 5.0)
    assert device.passes_motor_supply
    device.is_watchdog_off, device.is_motor_relay_bridged = False, True
    wait(device, 0.1)
    assert not device.is_closed(0)
    assert device.passes_motor_supply


def test_without_power_it_is_silent_with_open_relays_and_forgets(device: E1214Device) -> None:
    ask(device, "06 0020 003F")
    device.is_powered = False
    assert device.request(pdu("02 0000 0006"), 0.0) is None
    assert closed(device) == []
    device.is_powered = True
    assert words(device, 32, 1, function=3) == [0]


# --- identity and refusals ------------------------------------------------------------------------


def test_it_says_what_it_is(device: E1214Device) -> None:
    model = b"".join(word.to_bytes(2, "big") for word in words(device, 5000, 10))
    assert model == b"E1214".ljust(20, b"\0")
    wait(device, 3.5)
    assert words(device, 5020, 2) == [0, 3]
    assert words(device, 5027, 2) == [0xC0A8, 0x7FFE]  # 192.168.127.254, the factory's
    assert words(device, 5024, 3)[0] == 0x0090  # 00:90:E8 is Moxa's
    assert len(words(device, 5029, 4)) == 4
    assert len(words(device, 5040, 30)) == 30


@pytest.mark.parametrize(
    ("request_", "reply"),
    [
        ("02 0000 0008", "82 02"),
        ("01 0000 0007", "81 02"),
        ("04 0030 0002", "84 02"),
        ("04 1388 000B", "84 02"),
        ("04 0000 0001", "84 02"),
        ("05 0006 FF00", "85 02"),
        ("05 0000 0001", "85 03"),
        ("05 0110 0000", "85 03"),
        ("05 0120 0000", "85 03"),
        ("05 0030 0000", "85 03"),
        ("02 0000 0000", "82 03"),
        ("0F 0000 0006 02 0303", "8F 03"),
        ("0F 0000 0008 01 FF", "8F 02"),
        ("16 0020 FFFF 0000", "96 01"),
        ("2B 0E 01 00", "AB 01"),
    ],
)
def test_the_io_block_refuses(device: E1214Device, request_: str, reply: str) -> None:
    assert ask(device, request_) == reply
    assert words(device, 32, 1, function=3) == [0]


@pytest.mark.parametrize("address", [0x0110, 0x0120, 0x0030, 0x1020])
def test_clearing_coils_read_as_zero(device: E1214Device, address: int) -> None:
    assert ask(device, f"01 {address:04X} 0006") == "01 01 00"
