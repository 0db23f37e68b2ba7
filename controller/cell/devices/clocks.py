"""Which clock a cell's devices keep, and how fast it runs on this machine.

Emulated devices share their emulator's clock, also where their addresses were given by hand: the
emulators of this user stand in a register (docs/shared-clock.md 5). Real devices, and any
mix of real and emulated ones, keep the wall clock.
"""

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from controller.config import Cell, ConfigError
from drivers.clock import CellClock
from drivers.errors import LinkError

SLOW_SHARE = 0.8  # of the speed asked for; a machine below it is called slow
SETTLED_S = 30.0  # of cell time; before that the speed reached says little
MISSED_WALL_S = 0.5  # that a process which waits for real devices may be late in all
# beside real devices an emulated one is not waited for, and shares the host
MIXED_TIMEOUT_WALL_S = 2.0


@dataclass(frozen=True, slots=True)
class FoundClock:
    """The clock of a cell.

    Attributes
    ----------
    path : of an emulator's clock, None for the wall clock
    speed : cell seconds asked for in a second
    is_mixed : some devices are emulated and some are not
    """

    path: Path | None = None
    speed: float = 1.0
    is_mixed: bool = False

    def open(self) -> CellClock:
        """Return the clock; `CellClock.close` it afterwards.

        Raises
        ------
        LinkError : the emulator is gone
        """
        if self.path is not None:
            return CellClock.of_emulator(self.path)
        return CellClock(min_timeout_wall_s=MIXED_TIMEOUT_WALL_S if self.is_mixed else 0.0)


def find_clock(cell: Cell, emulated: Mapping[str, Any]) -> FoundClock:
    """Return the clock that a cell's devices keep.

    Parameters
    ----------
    emulated : what the emulator started beside the command said of itself, empty without one

    Raises
    ------
    ConfigError : the cell file's ``clock`` is none
    """
    names = set(type(cell.devices).model_fields)
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
            continue  # left behind by one that was killed; its addresses are somebody else's now
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
    """Return what this user's emulators have written down of themselves."""
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
                continue  # it is just going, or none of ours
    return found


@dataclass(slots=True)
class Speed:
    """How fast the cell's time runs: asked for, and reached so far.

    Attributes
    ----------
    asked, reached : cell seconds in a second
    missed_s : how long this process was late for real devices, in all [s]
    """

    asked: float = 1.0
    reached: float = 1.0
    missed_s: float = 0.0
    _begun_s: float | None = None
    _is_reported: bool = False

    def look(self, clock: CellClock) -> str | None:
        """Take in how fast the clock runs; return the news that the machine is slow, once."""
        if self._begun_s is None:
            self._begun_s = clock.now_s()
        self.reached, self.missed_s = clock.speed_reached, clock.missed_wall_s
        if self._is_reported or clock.now_s() - self._begun_s < SETTLED_S:
            return None
        if self.reached < SLOW_SHARE * self.asked:
            self._is_reported = True
            return (
                f"this machine is slow: {self}; the cell's time runs slower, so that nothing "
                "times out and nothing is lost"
            )
        if self.missed_s > MISSED_WALL_S:
            self._is_reported = True
            return (
                f"this machine is slow: the controller was late by {self.missed_s:.1f} s in all; "
                "time-outs wait that much longer"
            )
        return None

    def as_json(self) -> dict[str, float]:
        """Return it as the journal and ``--json`` show it."""
        return {
            "asked": self.asked,
            "reached": round(self.reached, 2),
            "missed_s": round(self.missed_s, 3),
        }

    def __str__(self) -> str:
        return f"{self.asked:g}x asked, {self.reached:.1f}x reached"
