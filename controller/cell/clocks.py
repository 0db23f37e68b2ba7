"""Which clock a cell's devices keep, and how fast it runs on this machine."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.clock import CellClock

SLOW_SHARE = 0.8  # of the speed asked for; a machine below it is called slow
SETTLED_S = 30.0  # of cell time; before that the speed reached says little
MISSED_WALL_S = 0.5  # that a process which waits for real devices may be late in all


def clock_of(emulated: Mapping[str, Any]) -> CellClock:
    """Return the clock of a cell; `CellClock.close` it afterwards.

    Parameters
    ----------
    emulated : what the emulator said of itself, empty on a real cell

    Raises
    ------
    LinkError : the emulator keeps no clock where it said
    """
    return CellClock.of_emulator(Path(emulated["clock"])) if emulated else CellClock()


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
    _is_told: bool = False

    def look(self, clock: CellClock) -> str | None:
        """Take in how fast the clock runs; return the news that the machine is slow, once."""
        if self._begun_s is None:
            self._begun_s = clock.now_s()
        self.reached, self.missed_s = clock.speed_reached, clock.missed_wall_s
        if self._is_told or clock.now_s() - self._begun_s < SETTLED_S:
            return None
        if self.reached < SLOW_SHARE * self.asked:
            self._is_told = True
            return (
                f"this machine is slow: {self}; the cell's time runs slower, so that nothing "
                "times out and nothing is lost"
            )
        if self.missed_s > MISSED_WALL_S:
            self._is_told = True
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
