"""A fixed gripper whose openings were measured: all above its driver reads true ones."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import Any, cast

import pytest

from controller.cell.devices import DeviceBuilder, resolve
from controller.cell.devices.measured_gripper import MeasuredGripper, OpeningScale
from controller.config import EMULATED_CELL, load_cell
from drivers.clock import CellClock
from drivers.kinds import FixedGripper, Hold

OPENINGS = OpeningScale(zero_mm=0.6, scale=1.01)


@dataclass
class Reading:
    opening_mm: float
    object_detected: bool = True
    has_contact: bool = True


@dataclass
class Device:
    """A driver that goes where it is sent, by its own reading."""

    max_opening_mm: float = 85.0
    model: str = "paper"
    at_mm: float = 85.0
    forces_n: list[float] = field(default_factory=list)

    async def status(self) -> Reading:
        return Reading(self.at_mm)

    async def connect(self) -> Reading:
        return Reading(self.at_mm)

    async def open_to(self, opening_mm: float) -> Reading:
        assert 0.0 <= opening_mm <= self.max_opening_mm
        self.at_mm = opening_mm
        return Reading(self.at_mm)

    async def close_on(self, opening_mm: float, *, force_n: float) -> Reading:
        self.forces_n.append(force_n)
        self.at_mm = opening_mm
        return Reading(self.at_mm)

    async def hold(self) -> Hold:
        return Hold.HELD


def measured(device: Device, openings: OpeningScale = OPENINGS) -> MeasuredGripper:
    return MeasuredGripper(cast(FixedGripper, device), openings)


def run(verb: Any) -> Any:
    return asyncio.run(verb)


def test_it_reads_true_openings() -> None:
    device = Device(at_mm=40.0)
    gripper = measured(device)
    # 0.6 mm more than the reading, and 1 % of it
    assert run(gripper.status()).opening_mm == pytest.approx(41.0)
    assert run(gripper.connect()).opening_mm == pytest.approx(41.0)
    assert run(gripper.status()).has_contact
    assert gripper.max_opening_mm == pytest.approx(86.45)


def test_it_is_sent_to_true_openings() -> None:
    device = Device()
    gripper = measured(device)
    run(gripper.open_to(41.0))
    assert device.at_mm == pytest.approx(40.0)
    found = run(gripper.close_on(21.0 - 0.2, force_n=33.0))
    assert device.at_mm == pytest.approx(20.0)
    assert found.opening_mm == pytest.approx(20.8)
    assert found.object_detected
    assert device.forces_n == [33.0]


def test_both_ends_of_the_stroke_are_within_it() -> None:
    for openings in (OPENINGS, OpeningScale(-0.6, 0.99)):
        device = Device()
        gripper = measured(device, openings)
        run(gripper.open_to(gripper.max_opening_mm))
        assert device.at_mm == pytest.approx(85.0)
        run(gripper.open_to(85.0))  # as wide as the cell file has it
        run(gripper.open_to(0.0))
        assert device.at_mm == pytest.approx(max(0.0, -openings.zero_mm / openings.scale))
        with pytest.raises(ValueError, match="the jaws open 0"):
            run(gripper.open_to(90.0))


def test_a_cell_without_measured_openings_has_its_driver_as_it_is() -> None:
    async def built(**found: float) -> object:
        cell = load_cell(EMULATED_CELL)
        section = cell.fixed_gripper.model_copy(update=found)
        cell = cell.model_copy(update={"fixed_gripper": section})
        where = resolve(cell, dict.fromkeys(type(cell.devices).model_fields, "127.0.0.1:1"))
        return DeviceBuilder(cell, where, CellClock()).gripper()

    assert not isinstance(run(built()), MeasuredGripper)
    gripper = run(built(opening_zero_mm=0.6, opening_scale=1.01))
    assert isinstance(gripper, MeasuredGripper)
    assert gripper.max_opening_mm == pytest.approx(0.6 + 1.01 * 85.0)
