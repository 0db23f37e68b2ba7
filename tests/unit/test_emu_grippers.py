"""Which gripper and I/O block the emulated cell has is what the cell file's drivers speak to."""

from __future__ import annotations

from pathlib import Path

import pytest

from emulators.gripper_modbus import RobotiqDevice
from emulators.gripper_onrobot import RgDevice
from emulators.grippers import make_fixed_gripper
from emulators.io_blocks import make_io_block
from emulators.io_modbus import CellSignals
from emulators.world import DriverChoice, LayoutError, read_layout

CELL = Path(__file__).resolve().parents[2] / "recipes" / "cells" / "emulated.yaml"
OWN = "gripper:     {address: emulated, transport: tcp, unit: 9}"


def choice(folder: Path, gripper: str) -> DriverChoice | None:
    text = CELL.read_text()
    assert OWN in text
    path = folder / "cell.yaml"
    path.write_text(text.replace(OWN, f"gripper: {gripper}"))
    return read_layout(path).drivers.get("gripper")


def test_a_contact_is_on_the_input_that_the_cell_file_names() -> None:
    signals = CellSignals()
    signals.is_door_closed = False
    # the others healthy or empty as they stand: only where the door's is changes
    for door, supply in ((1, 4), (4, 1)):
        inputs = {"emergency_stop": 0, "door": door, "supply": supply, "part_in_fixture": 3}
        block = make_io_block(None, signals, 1, inputs, {})
        read = block.inputs()
        assert (read[0], read[door], read[supply]) == (True, False, True)


def test_without_a_driver_it_is_a_robotiq(tmp_path: Path) -> None:
    fixed = make_fixed_gripper(choice(tmp_path, "{address: emulated}"))
    assert isinstance(fixed.device, RobotiqDevice)
    assert (fixed.device.unit, fixed.jaws.opening_mm) == (9, 85.0)


@pytest.mark.parametrize(("model", "widest_mm"), [("rg2", 110.0), ("rg6", 160.0)])
def test_an_onrobot_comes_with_its_box(tmp_path: Path, model: str, widest_mm: float) -> None:
    words = f"{{driver: onrobot_rg, address: emulated, settings: {{model: {model}}}}}"
    fixed = make_fixed_gripper(choice(tmp_path, words))
    assert isinstance(fixed.device, RgDevice)
    assert sorted(device.unit for device in fixed.on_line) == [63, 65]
    assert fixed.jaws.opening_mm == widest_mm


def test_a_real_gripper_of_any_make_leaves_the_emulated_cell_as_it_is(tmp_path: Path) -> None:
    assert choice(tmp_path, "{driver: acme, address: '10.0.0.1:4001'}") is None
    assert isinstance(make_fixed_gripper(None).device, RobotiqDevice)


def test_a_driver_that_cannot_be_emulated_is_named() -> None:
    with pytest.raises(LayoutError, match=r"`acme` cannot be emulated \(emulated: onrobot_rg, rob"):
        make_fixed_gripper(DriverChoice("acme"))


def test_settings_that_no_gripper_has_are_named() -> None:
    with pytest.raises(LayoutError, match=r"devices\.gripper\.settings"):
        make_fixed_gripper(DriverChoice("onrobot_rg", {"model": "rg9"}))


@pytest.mark.parametrize(("driver", "count"), [("", 6), ("moxa_e1214", 6), ("moxa_e1212", 8)])
def test_the_io_block_has_as_many_channels_as_its_model(driver: str, count: int) -> None:
    block = make_io_block(DriverChoice(driver), CellSignals(), 1, {}, {})
    assert len(block.inputs()) == count
    assert block.inputs()[:2] == (True, True)  # the safety chain and the door
    assert not any(block.inputs()[6:])


def test_an_io_block_that_cannot_be_emulated_is_named() -> None:
    with pytest.raises(LayoutError, match=r"devices\.io\.driver `acme` cannot be emulated"):
        make_io_block(DriverChoice("acme"), CellSignals(), 1, {}, {})
