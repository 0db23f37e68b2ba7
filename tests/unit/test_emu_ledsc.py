"""The emulated LedSC lamp controller: levels, changes, live mode, settings that wait for a restart.

Requests are bytes of modbus_devices.md 6.3, and of the Modbus standard.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from emulators.lamp_units import make_lamp_unit
from emulators.lighting_ledsc import LedscDevice, LedscSupply
from emulators.lighting_modbus import LampCharacter, LampModel, LampWiring, Relay8Device
from emulators.world import DriverChoice, LayoutError, read_layout

CELL = Path(__file__).resolve().parents[2] / "recipes" / "cells" / "emulated.yaml"


def write(device: LedscDevice, first: int, *words: int) -> bytes | None:
    head = bytes([0x10]) + first.to_bytes(2, "big") + len(words).to_bytes(2, "big")
    return device.request(
        head + bytes([2 * len(words)]) + b"".join(word.to_bytes(2, "big") for word in words), 0.0
    )


def read(device: LedscDevice, at: int) -> int:
    reply = device.request(b"\x03" + at.to_bytes(2, "big") + b"\0\x01", 0.0)
    assert reply is not None
    assert reply[:2] == b"\x03\x02"
    return int.from_bytes(reply[2:], "big")


def duties(device: LedscDevice) -> list[float]:
    return [device.duty(colour) for colour in range(4)]


def test_levels_are_shares_of_the_cycle() -> None:
    device = LedscDevice(1, cycle=200)
    write(device, 0, 200, 100, 0, 50, 0, 1)
    assert duties(device) == [1.0, 0.5, 0.0, 0.25]


def test_channel_a_takes_255_at_most_whatever_the_cycle() -> None:
    device = LedscDevice(1, cycle=1000)
    write(device, 0, 1000, 1000, 0, 0, 0, 1)
    assert duties(device)[:2] == [0.255, 1.0]


def test_what_is_written_shows_once_it_is_live() -> None:
    device = LedscDevice(1)
    write(device, 0, 255, 0, 0, 0)
    assert read(device, 0) == 255
    assert duties(device) == [0.0] * 4
    write(device, 4, 0, 7)  # at once; "0/any"
    assert duties(device)[0] == 1.0
    write(device, 5, 0)
    write(device, 0, 0)
    assert duties(device)[0] == 1.0


def test_a_change_takes_its_time_and_all_channels_arrive_together() -> None:
    device = LedscDevice(1)
    write(device, 0, 255, 51, 0, 0, 400, 1)
    device.advance(0.1)
    assert duties(device) == pytest.approx([0.25, 0.05, 0.0, 0.0])
    device.advance(0.3)
    assert duties(device) == pytest.approx([1.0, 0.2, 0.0, 0.0])
    device.advance(10.0)
    assert duties(device) == pytest.approx([1.0, 0.2, 0.0, 0.0])


def test_a_new_slave_id_holds_from_the_restart_on_which_is_dark() -> None:
    device = LedscDevice(1)
    write(device, 0, 255, 0, 0, 0, 0, 1)
    write(device, 1000, 9)
    assert (device.unit, read(device, 1000)) == (1, 9)
    write(device, 100, 1)
    assert (device.unit, device.restart_count) == (9, 1)
    assert duties(device) == [0.0] * 4


@pytest.mark.parametrize(
    ("at", "word"), [(6, 0), (1000, 0), (1000, 248), (1001, 1200), (1002, 1), (1003, 4)]
)
def test_values_that_make_no_sense_are_refused(at: int, word: int) -> None:
    reply = write(LedscDevice(1), at, word)
    assert reply == b"\x90\x03"


@pytest.mark.parametrize("at", [9, 99, 101, 1007])
def test_other_registers_are_not_there(at: int) -> None:
    assert LedscDevice(1).request(b"\x03" + at.to_bytes(2, "big") + b"\0\x01", 0.0) == b"\x83\x02"


def test_without_supply_it_is_silent_and_dark() -> None:
    device = LedscDevice(1)
    write(device, 0, 255, 0, 0, 0, 0, 1)
    device.is_powered = False
    assert write(device, 0, 255) is None
    assert duties(device) == [0.0] * 4


def test_lamps_get_their_channel_of_their_controller() -> None:
    devices = LedscDevice(1), LedscDevice(2)
    lamp = LampModel(
        LampWiring("ring", 5, 0), LedscSupply(devices), LampCharacter(droop_fraction=0)
    )
    write(devices[1], 0, 0, 102, 0, 0, 0, 1)
    for _ in range(10):
        lamp.advance(0.01)
    assert lamp.level == pytest.approx(0.4)
    lamp.is_dimming_wire_broken = True  # its only wire
    for _ in range(10):
        lamp.advance(0.01)
    assert lamp.level == 0.0


def chosen(folder: Path, lights: str) -> DriverChoice | None:
    own = "{address: emulated, transport: tcp, analog_unit: 1, relay_unit: 2}"
    text = CELL.read_text()
    assert own in text
    path = folder / "cell.yaml"
    path.write_text(text.replace(own, lights))
    return read_layout(path).drivers.get("lights")


def test_the_cell_file_chooses_the_lamp_unit(tmp_path: Path) -> None:
    own = make_lamp_unit(chosen(tmp_path, "{address: emulated}"))
    assert list(own.modules) == ["dimmer", "relays"]
    assert isinstance(own.modules["relays"], Relay8Device)
    words = "{driver: ledsc, address: emulated, settings: {units: [3, 8]}}"
    other = make_lamp_unit(chosen(tmp_path, words))
    assert {name: one.unit for name, one in other.modules.items()} == {"dimmer": 3, "dimmer2": 8}


def test_a_lamp_unit_that_cannot_be_emulated_is_named() -> None:
    with pytest.raises(LayoutError, match=r"`acme` cannot be emulated \(emulated: ledsc, wavesh"):
        make_lamp_unit(DriverChoice("acme"))
    with pytest.raises(LayoutError, match=r"devices\.lights\.settings"):
        make_lamp_unit(DriverChoice("ledsc", {"units": ["one"]}))
