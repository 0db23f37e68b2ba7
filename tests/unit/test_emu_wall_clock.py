"""The option of the emulated cell that lets its time run on, and what clients learn of it."""

import pytest

from controller.cell.devices.emulator import emulator_args
from emulators.app import build_parser, options_of
from emulators.world import LayoutError


def test_the_cells_option_reaches_the_emulator() -> None:
    words = ("--cell", "cell.yaml", *emulator_args(None, None, None, is_on_wall_clock=True))
    assert options_of(build_parser().parse_args(words)).is_on_wall_clock
    assert not options_of(build_parser().parse_args(words[:2])).is_on_wall_clock


def test_the_wall_clock_has_one_speed() -> None:
    words = ("--cell", "cell.yaml", "--wall-clock", "--speed", "10")
    with pytest.raises(LayoutError, match="--speed 10: --wall-clock keeps real time"):
        options_of(build_parser().parse_args(words))
