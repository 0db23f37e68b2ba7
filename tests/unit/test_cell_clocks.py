"""Which clock a cell's devices keep, and the one sentence about a slow machine."""

import json
import os
import tempfile
from pathlib import Path

import pytest
from installed_here import register

from controller.cell.batch import RunOrder, who_and_what
from controller.cell.devices import resolve
from controller.cell.devices.clocks import FoundClock, Speed, find_clock
from controller.config import Cell, ConfigError, load_cell, load_recipe
from drivers.clock import CellClock

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"


def cell_with(folder: Path, *changes: tuple[str, str]) -> Cell:
    text = CELL.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "cell.yaml"
    path.write_text(text)
    return load_cell(path)


REAL = (
    ("arm:         {address: emulated}", "arm:         {address: /dev/ttyUSB0}"),
    ("{address: emulated, transport: tcp, unit: 9}", "{address: '10.0.0.1:502'}"),
    (
        "{address: emulated, transport: tcp, analog_unit: 1, relay_unit: 2}",
        "{address: '10.0.0.2:1'}",
    ),
    ("{address: emulated, transport: tcp, unit: 1}", "{address: '10.0.0.3:502'}"),
    ("overhead:    {address: emulated}", "overhead:    {address: /dev/video0}"),
    ("inspection:  {address: emulated}", "inspection:  {address: /dev/video1}"),
)


@pytest.fixture(autouse=True)
def nobody_else_runs(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    # this checkout's drivers as they are now
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)


def test_real_devices_keep_the_wall_clock(tmp_path: Path) -> None:
    assert find_clock(cell_with(tmp_path, *REAL), {}) == FoundClock()


def test_a_mix_keeps_real_time(tmp_path: Path) -> None:
    found = find_clock(cell_with(tmp_path, REAL[0]), {"clock": "/dev/shm/some", "speed": 1.0})
    assert found == FoundClock(is_mixed=True)
    assert found.open().patience_s(0.3) > 0.3


def test_pictures_from_a_file_have_no_time_of_their_own(tmp_path: Path) -> None:
    film = ("overhead:    {address: emulated}", "overhead: {driver: video, address: film.mkv}")
    clock = tmp_path / "clock"
    found = find_clock(cell_with(tmp_path, film), {"clock": str(clock), "speed": 15.0})
    assert found == FoundClock(clock, 15.0)  # as if all six were emulated
    assert find_clock(cell_with(tmp_path, *REAL[:4], film, REAL[5]), {}) == FoundClock()
    found = find_clock(cell_with(tmp_path, REAL[0], film), {"clock": str(clock), "speed": 1.0})
    assert found.is_mixed


def test_what_a_dead_emulator_left_in_the_register_counts_for_nothing(tmp_path: Path) -> None:
    folder = tmp_path / f"cellctl-emulators-{os.getuid()}"
    folder.mkdir()
    addresses = {"arm": "/dev/ttyUSB0"}
    (folder / "1.json").write_text(json.dumps({"clock": "/gone", "addresses": addresses}))
    (folder / "2.json").write_text("{half")
    (folder / "3.json").write_text("[1, 2]")
    assert find_clock(cell_with(tmp_path, *REAL), {}) == FoundClock()


def test_a_clock_in_the_cell_file_that_is_none_is_a_mistake_in_the_file(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, *REAL, ("name: emulated", "name: x\nclock: /nowhere/clock"))
    with pytest.raises(ConfigError, match=r"/nowhere/clock: No such file .* cell file"):
        find_clock(cell, {})


@pytest.mark.parametrize(
    ("timing", "told"),
    [
        ("{io_stale_s: 0.05}", "at least twice io_poll_s"),
        ("{io_stale_s: 60}", "less than or equal to 5"),
        ("{io_poll_s: 0.001}", "greater than or equal to 0.02"),
        ("{modbus_reply_s: .inf}", "modbus_reply_s"),
        ("{stale_s: 0.2}", "stale_s"),
    ],
)
def test_patience_that_makes_no_sense_is_refused(timing: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=told):
        cell_with(tmp_path, ("name: emulated", f"name: x\ntiming: {timing}"))


class PaperClock(CellClock):
    instant_s, reached, missed_s = 0.0, 10.0, 0.0

    def now_s(self) -> float:
        return self.instant_s

    @property
    def speed_reached(self) -> float:
        return self.reached

    @property
    def missed_wall_s(self) -> float:
        return self.missed_s


def test_a_run_says_once_that_the_machine_is_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, speed = PaperClock(10.0), Speed(10.0)
    assert speed.look(clock) is None
    monkeypatch.setattr(PaperClock, "reached", 6.34)
    monkeypatch.setattr(PaperClock, "instant_s", 5.0)
    assert speed.look(clock) is None  # too early to say
    monkeypatch.setattr(PaperClock, "instant_s", 60.0)
    notice = speed.look(clock)
    assert notice is not None
    assert "10x asked, 6.3x reached" in notice
    assert speed.look(clock) is None
    assert speed.as_json() == {"asked": 10.0, "reached": 6.34, "missed_s": 0.0}


def test_a_machine_that_keeps_up_is_not_called_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, speed = PaperClock(10.0), Speed(10.0)
    speed.look(clock)
    monkeypatch.setattr(PaperClock, "instant_s", 60.0)
    assert [speed.look(clock), speed.look(clock)] == [None, None]


def test_lateness_towards_real_devices_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, speed = PaperClock(), Speed()
    monkeypatch.setattr(PaperClock, "reached", 1.0)
    speed.look(clock)
    monkeypatch.setattr(PaperClock, "missed_s", 0.8)
    monkeypatch.setattr(PaperClock, "instant_s", 60.0)
    assert "late by 0.8 s" in (speed.look(clock) or "")


def test_what_keeps_an_emulators_clock_is_reported_as_emulated(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, *REAL)
    film = ("overhead:    {address: emulated}", "overhead: {driver: video, address: film.mkv}")
    filmed = cell_with(tmp_path, *REAL[:4], film, REAL[5])
    recipe = CELL.parents[1] / "featuretype.yaml"

    def emulated_devices(clock: FoundClock, cell: Cell = cell) -> list[str]:
        order = RunOrder(
            recipe_path=recipe, cell_path=CELL, recipe=load_recipe(recipe), cell=cell, count=1,
            speed=1.0, emulated={}, clock=clock, runs_dir=tmp_path, run_id="run",
        )  # fmt: skip
        began = who_and_what(order, resolve(cell, {}))
        flagged = [name for name, device in began.devices.items() if device["emulated"]]
        assert flagged == list(began.emulated_devices)
        return flagged

    assert emulated_devices(FoundClock()) == []
    assert emulated_devices(FoundClock(), filmed) == ["overhead"]
    assert len(emulated_devices(FoundClock(tmp_path / "clock"))) == 6
