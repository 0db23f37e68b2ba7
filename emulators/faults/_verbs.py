"""All verbs of a cell, and the scripts that give them beforehand."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from ._devices import DevicesAndWires
from ._installation import Wear
from ._people import PeopleAndParts
from ._plant import Plant
from ._script import Script

Answer = dict[str, Any]
_WRONG = (KeyError, TypeError, ValueError, IndexError, AttributeError)


class Verbs:
    """Faults and the truth of one cell.

    `do` carries a verb out now. Scripts come due in `advance`, which whoever steps the world calls.

    Parameters
    ----------
    plant : the cell
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._scripts: list[tuple[int, Script]] = []
        self._given = 0
        self._seen_events = 0
        self._done: list[Answer] = []
        self._verbs: Mapping[str, Callable[..., Answer | None]] = {
            **PeopleAndParts(plant).verbs,
            **DevicesAndWires(plant).verbs,
            **Wear(plant).verbs,
            **plant.arm_unit.verbs,
            "script": self._script,
            "script_log": self._script_log,
        }

    @property
    def names(self) -> tuple[str, ...]:
        """Every verb."""
        return tuple(self._verbs)

    def do(self, verb: str, /, **order: Any) -> Answer:  # noqa: ANN401  (each verb checks its own)
        """Carry out a verb now and return its answer.

        Raises
        ------
        KeyError, TypeError, ValueError, IndexError, AttributeError : the order makes no sense
        """
        return self._verbs[verb](**order) or {}

    def obey(self, line: bytes) -> Answer:
        """Carry out one line of JSON and return its answer, which names any fault in the line."""
        try:
            order = json.loads(line)
            return {"ok": True, **self.do(order.pop("do"), **order)}
        except (*_WRONG, RecursionError) as error:
            return {"ok": False, "error": f"{type(error).__name__}: {error}"}

    def advance(self) -> None:
        """Carry out what scripts have due at the world's present."""
        events = self._plant.world.events
        fresh = [(one.at_s, one.what, one.by) for one in events[self._seen_events :]]
        self._seen_events = len(events)
        now_s = self._plant.world.time_s
        for name, script in self._scripts:
            for number, order in script.advance(now_s, fresh):
                self._carry_out(name, number, order, now_s)

    def _carry_out(self, script: int, number: int, order: Mapping[str, Any], now_s: float) -> None:
        given = dict(order)
        entry = {"script": script, "step": number, "at_s": now_s, "order": dict(order)}
        try:
            self.do(given.pop("do"), **given)
        except _WRONG as error:  # a fault that does not fit the moment is a row of the log
            entry["error"] = f"{type(error).__name__}: {error}"
        self._done.append(entry)

    def _script(self, steps: list[Mapping[str, Any]], seed: int = 0) -> Answer:
        verbs = [name for name in self._verbs if name not in ("script", "script_log")]
        script = Script(steps, seed, self._plant.world.time_s, verbs)
        number, self._given = self._given, self._given + 1
        self._scripts.append((number, script))
        return {"script": number, "due_s": script.due_s}

    def _script_log(self) -> Answer:
        return {"done": list(self._done)}
