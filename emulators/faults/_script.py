"""Faults given beforehand: a list of steps, each with its instant or its occasion, and a seed.

A step is an order of the control port with one of

    at_s       instant, or [earliest, latest] to draw it from, after the script was given [world s]
    every_s    again and again, so far apart [world s]
    when       an event of the world: gripped, missed, released, fell_out, torn, lies, taken

and, if need be, ``probability`` (1: each time), ``by`` (of an event: the gripper), ``after_s`` (how
long after the event, or [least, most]), ``times`` (how often at most). Every step draws from a
generator of its own, so a step that is added moves no other one.
"""

import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

_WORLD_EVENTS: Final = frozenset(
    {"gripped", "missed", "released", "fell_out", "torn", "lies", "taken", "emptied"}
)
_OCCASIONS: Final = ("at_s", "every_s", "when")
_OPTIONS: Final = ("probability", "by", "after_s", "times")
_STEPS_MAX: Final = 10_000


class ScriptError(ValueError):
    """A script that cannot be carried out: which step, and why."""


@dataclass(slots=True)
class _Step:
    number: int
    order: Mapping[str, Any]
    rng: random.Random
    probability: float
    when: str | None
    by: str | None
    every_s: float | None
    after_s: tuple[float, float]
    times_left: int | None
    due_s: list[float] = field(default_factory=list)


class Script:
    """Steps that come due as world time passes and things happen; `advance` returns them.

    Parameters
    ----------
    steps : as described above
    seed : seed of all that is drawn
    begun_s : time at which the script was given [world s]
    verbs : verbs allowed in steps

    Raises
    ------
    ScriptError : a step has no occasion or several, an unknown verb, or a value out of range
    """

    def __init__(
        self, steps: Sequence[Mapping[str, Any]], seed: int, begun_s: float, verbs: Sequence[str]
    ) -> None:
        if len(steps) > _STEPS_MAX:
            raise ScriptError(f"{len(steps)} steps: {_STEPS_MAX} are allowed")
        self._steps = [
            _read(number, step, random.Random(f"{seed}/{number}"), begun_s, verbs)
            for number, step in enumerate(steps)
        ]

    @property
    def due_s(self) -> list[float]:
        """Instants already drawn at which a step comes due [world s], the earliest first."""
        return sorted(instant for step in self._steps for instant in step.due_s)

    def advance(
        self, now_s: float, events: Sequence[tuple[float, str, str]]
    ) -> list[tuple[int, Mapping[str, Any]]]:
        """Return the orders now due: number of the step and the order, in order of time.

        Parameters
        ----------
        now_s : the present [world s]
        events : events since the last call: instant [world s], event, gripper
        """
        due: list[tuple[float, int, Mapping[str, Any]]] = []
        for step in self._steps:
            for at_s, what, by in events:
                if step.when == what and step.by in (None, by) and _is_drawn(step):
                    step.due_s.append(at_s + step.rng.uniform(*step.after_s))
            ripe = [instant for instant in step.due_s if instant <= now_s]
            step.due_s = [instant for instant in step.due_s if instant > now_s]
            while step.every_s is not None and ripe and step.due_s == []:
                following_s = ripe[-1] + step.every_s
                (ripe if following_s <= now_s else step.due_s).append(following_s)
            for instant in ripe:
                if step.every_s is None or _is_drawn(step):
                    due.append((instant, step.number, step.order))
        due.sort(key=lambda one: one[:2])
        return [(number, order) for _, number, order in due]


def _is_drawn(step: _Step) -> bool:
    """Return whether a step, by a random draw, is carried out this time; count it."""
    if step.times_left == 0:
        return False
    if step.rng.random() >= step.probability:
        return False
    if step.times_left is not None:
        step.times_left -= 1
    return True


def _read(
    number: int,
    raw: Mapping[str, Any],
    rng: random.Random,
    begun_s: float,
    verbs: Sequence[str],
) -> _Step:
    where = f"step {number}"
    if not isinstance(raw, Mapping):
        raise ScriptError(f"{where}: a step is an object, not {type(raw).__name__}")
    occasions = [name for name in _OCCASIONS if name in raw]
    if len(occasions) != 1:
        raise ScriptError(f"{where}: one of {', '.join(_OCCASIONS)} is required, not {occasions}")
    if raw.get("do") not in verbs:
        raise ScriptError(f"{where}: `do` is {raw.get('do')!r}, none of {', '.join(verbs)}")
    when, probability = raw.get("when"), raw.get("probability", 1.0)
    if when is not None and when not in _WORLD_EVENTS:
        raise ScriptError(f"{where}: {when!r} is none of {', '.join(sorted(_WORLD_EVENTS))}")
    if not isinstance(probability, int | float) or not 0.0 <= probability <= 1.0:
        raise ScriptError(f"{where}: a probability of {probability!r}")
    every_s = raw.get("every_s")
    if every_s is not None and not _range(where, "every_s", every_s)[0] > 0.0:
        raise ScriptError(f"{where}: every {every_s} s")
    step = _Step(
        number,
        {k: v for k, v in raw.items() if k not in (*_OCCASIONS, *_OPTIONS)},
        rng,
        float(probability),
        when,
        raw.get("by"),
        None if every_s is None else float(every_s),
        _range(where, "after_s", raw.get("after_s", 0.0)),
        _times(where, raw.get("times")),
    )
    if "at_s" in raw:
        low_s, high_s = _range(where, "at_s", raw["at_s"])
        if _is_drawn(step):
            step.due_s.append(begun_s + rng.uniform(low_s, high_s))
    elif step.every_s is not None:
        step.due_s.append(begun_s + step.every_s)
    return step


def _times(where: str, raw: Any) -> int | None:  # noqa: ANN401  (of a file)
    if raw is not None and (not isinstance(raw, int) or raw < 0):
        raise ScriptError(f"{where}: {raw!r} times")
    return raw


def _range(where: str, name: str, raw: Any) -> tuple[float, float]:  # noqa: ANN401  (of a file)
    values = raw if isinstance(raw, list) else [raw, raw]
    if len(values) != 2 or not all(isinstance(one, int | float) for one in values):
        raise ScriptError(f"{where}: {name} is seconds, or [least, most], not {raw!r}")
    low, high = float(values[0]), float(values[1])
    if not 0.0 <= low <= high:
        raise ScriptError(f"{where}: {name} of {raw!r}")
    return low, high
