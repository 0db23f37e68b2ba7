"""Find the clock of a cell's devices, and measure its speed on this machine.

Emulated devices share their emulator's clock, even if their addresses were given by hand: each
emulator of this user is listed in a register (docs/shared-clock.md 5). Real devices, and any mix of
real and emulated ones, keep the wall clock.
"""

import json
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.config import EMULATED, Cell, ConfigError
from controller.setup.drivers import KIND_OF, find_driver
from drivers.attendance import BEAT_WALL_S
from drivers.clock import CellClock
from drivers.errors import LinkError
from messages import say

SLOW_SHARE = 0.8  # share of the requested speed below which a machine is called slow
SETTLED_S = 30.0  # least cell time over which the speed reached is meaningful
MISSED_WALL_S = 0.5  # a process that waits for real devices may be late by this much in all
# Next to real devices the clock does not wait for an emulated one, which shares the host.
MIXED_TIMEOUT_WALL_S = 2.0


@dataclass(frozen=True, slots=True)
class FoundClock:
    """The clock of a cell.

    Attributes
    ----------
    path : path of an emulator's clock, None for the wall clock
    speed : cell seconds per second, as requested
    is_mixed : some devices are emulated and some are not
    monotonic : reads the wall clock [s], as the event loop's timers do
    beat_wall_s : interval at which the loop is checked for lateness
    """

    path: Path | None = None
    speed: float = 1.0
    is_mixed: bool = False
    monotonic: Callable[[], float] = time.monotonic
    beat_wall_s: float = BEAT_WALL_S

    @property
    def is_virtual(self) -> bool:
        """Whether the event loop has its own time, which then nothing else may decide by."""
        return self.monotonic is not time.monotonic

    def open(self) -> CellClock:
        """Return the clock; `CellClock.close` it afterwards.

        Raises
        ------
        LinkError : the emulator is gone
        """
        if self.path is not None:
            return CellClock.of_emulator(self.path)
        return CellClock(
            min_timeout_wall_s=MIXED_TIMEOUT_WALL_S if self.is_mixed else 0.0,
            monotonic=self.monotonic,
            beat_wall_s=self.beat_wall_s,
        )


def devices_with_time(cell: Cell) -> tuple[str, ...]:
    """Return the names of the devices that have a time of their own, or that of an emulator.

    Pictures and wires from files have none.

    Raises
    ------
    ConfigError : a driver is not installed
    """
    devices = cell.devices
    return tuple(
        name
        for name in type(devices).model_fields
        if (section := getattr(devices, name)).address == EMULATED
        or not find_driver(KIND_OF[name], section.driver).keeps_cell_time
    )


def find_clock(cell: Cell, emulated: Mapping[str, Any]) -> FoundClock:
    """Return the clock that a cell's devices keep.

    Parameters
    ----------
    cell : the cell file
    emulated : output of the emulator that the command started; empty without one

    Raises
    ------
    ConfigError : the cell file's ``clock`` is not a clock, or a driver is not installed
    """
    names = set(devices_with_time(cell))
    begun = set(cell.emulated_devices)
    if begun:
        is_mixed = begun != names
        path = None if is_mixed or not emulated else Path(emulated["clock"])
        return FoundClock(path, float(emulated.get("speed", 1.0)), is_mixed)
    if cell.clock is not None:
        try:
            return FoundClock(cell.clock, _speed_of(cell.clock))
        except LinkError as error:
            raise ConfigError(f"{error} (`clock` in the cell file)") from error
    wanted = {_plain(getattr(cell.devices, name).address) for name in names}
    is_mixed = False
    for entry in _emulators():
        offered = {_plain(str(one)) for one in entry["addresses"].values()}
        if not wanted & offered:
            continue
        try:
            speed = _speed_of(Path(entry["clock"]))
        except LinkError:
            continue  # left behind by a killed emulator; its addresses belong to others now
        if wanted <= offered:
            return FoundClock(Path(entry["clock"]), speed)
        is_mixed = True
    return FoundClock(is_mixed=is_mixed)


def _speed_of(path: Path) -> float:
    clock = CellClock.of_emulator(path)
    clock.close()
    return clock.speed


def _plain(address: str) -> str:
    return address.replace("localhost:", "127.0.0.1:")


def _emulators() -> list[dict[str, Any]]:
    """Return the entries of this user's emulators in the register."""
    folders = [Path(tempfile.gettempdir()) / f"cellctl-emulators-{os.getuid()}"]
    if runtime := os.environ.get("XDG_RUNTIME_DIR"):
        folders.insert(0, Path(runtime) / "cellctl-emulators")
    found = []
    for folder in folders:
        if not folder.is_dir() or folder.stat().st_uid != os.getuid():
            continue
        for path in sorted(folder.glob("*.json")):
            try:
                entry = json.loads(path.read_text(encoding="utf-8"))
                if isinstance(entry["addresses"], dict) and isinstance(entry["clock"], str):
                    found.append(entry)
            except (OSError, ValueError, KeyError, TypeError):
                continue  # it is just ending, or is not one of ours
    return found


@dataclass(slots=True)
class Speed:
    """The speed of the cell's time: requested, and reached so far.

    Attributes
    ----------
    asked, reached : cell seconds per second
    missed_s : total time that this process was late for real devices [cell s]
    """

    asked: float = 1.0
    reached: float = 1.0
    missed_s: float = 0.0
    _begun_s: float | None = None
    _is_reported: bool = False

    def look(self, clock: CellClock) -> str | None:
        """Measure the clock's speed; return a message if the machine is slow, once."""
        if self._begun_s is None:
            self._begun_s = clock.now_s()
        self.reached, self.missed_s = clock.speed_reached, clock.missed_wall_s
        if self._is_reported or clock.now_s() - self._begun_s < SETTLED_S:
            return None
        if self.reached < SLOW_SHARE * self.asked:
            self._is_reported = True
            return say(
                "this machine is slow: {what}; the cell's time runs slower, so "
                "that nothing times out and nothing is lost",
                what=self,
            )
        if self.missed_s > MISSED_WALL_S:
            self._is_reported = True
            return say(
                "this machine is slow: the controller was late by {missed_s:.1f} s "
                "in all; time-outs wait that much longer",
                missed_s=self.missed_s,
            )
        return None

    def as_json(self) -> dict[str, float]:
        """Return the figures as the journal and ``--json`` show them."""
        return {
            "asked": self.asked,
            "reached": round(self.reached, 2),
            "missed_s": round(self.missed_s, 3),
        }

    def __str__(self) -> str:
        return say(
            "{asked:g}x asked, {reached:.1f}x reached", asked=self.asked, reached=self.reached
        )
