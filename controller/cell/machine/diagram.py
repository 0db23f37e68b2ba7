"""Draws docs/state-machine.md from the machine: ``python -m controller.cell.machine.diagram``.

With ``--stages`` it prints the stages of one part alone, as docs/operating/recovery.md shows
them. A test fails when either is out of date.
"""

import sys
from collections.abc import Iterable, Sequence

from .machine import CellMachine, Transition
from .table import (
    COMMANDS,
    ENTRY,
    EXECUTE,
    IGNORED,
    MODE_EFFECTS,
    REFUSED,
    SEPARATOR,
    STATES,
    WORK,
    Event,
    Mode,
    mode_of,
    state_of,
    work_of,
)

PREFIX = EXECUTE + SEPARATOR
# A row of more events than this names the outcomes that it leaves out instead.
LONG_COUNT = 8
HEAD = f"""# The states of the cell

Drawn from the machine by `python -m controller.cell.machine.diagram > docs/state-machine.md`; a
test fails when this page is out of date. A state that sets an action going has it behind the slash.
An arrow from `{EXECUTE}` holds for every stage.

"""
PAUSES_HEAD = """
## Pauses

Each stage, `resetting` and `completing` have a state in every mode: `suspended_grasping` is a grasp
that is paused. `*` stands for any of them. An action begins when its stage is entered. It is not
ended by a pause: it waits. Where a stage ends while the cell pauses, the next one is entered in the
same mode, and waits before it moves anything. Homing pauses for an open door alone, and begins
anew. Stop and fault lead out of every mode.

"""
IGNORED_HEAD = """
## What is ignored on purpose

| events | states | why |
|---|---|---|
"""
REFUSED_HEAD = """
## What is refused

An event that is neither drawn nor listed on this page is refused, with the events that are
possible. These are refused for a reason of their own:

| events | states | why |
|---|---|---|
"""


def page() -> str:
    """Return docs/state-machine.md."""
    return (
        f"{HEAD}```mermaid\n{mermaid()}```\n{PAUSES_HEAD}```mermaid\n{pauses_mermaid()}```\n"
        f"{IGNORED_HEAD}{_rows(IGNORED)}{REFUSED_HEAD}{_rows(REFUSED)}"
    )


def _rows(listed: Sequence[tuple[tuple[Event, ...], tuple[str, ...], str]]) -> str:
    return "".join(
        f"| {_events_words(events)} | {_states_words(states)} | {reason} |\n"
        for events, states, reason in listed
    )


def _events_words(events: Sequence[Event]) -> str:
    if len(events) <= LONG_COUNT:
        return ", ".join(f"`{event.value}`" for event in events)
    missing = [e for e in Event if e not in COMMANDS and e not in events]
    but = f" but {', '.join(f'`{event.value}`' for event in missing)}" if missing else ""
    return f"every outcome of an action{but}"


def _states_words(states: Sequence[str]) -> str:
    """Return states by name; those of one mode as one, if all of the mode are among them."""
    words = []
    for mode in Mode:
        every = [state_of(work, mode) for work in WORK]
        if set(every) <= set(states):
            words.append(f"`{mode}{SEPARATOR}*`" if mode is not Mode.EXECUTE else "any work")
            states = [state for state in states if state not in every]
    return ", ".join([*(f"`{state}`" for state in states), *words])


def mermaid() -> str:
    """Return every transition as mermaid, without pauses; stages are in a box of their own."""
    stages = [state for state in STATES if state.startswith(PREFIX)]
    lines = ["stateDiagram-v2", f"    [*] --> {CellMachine().state}", f"    state {EXECUTE} {{"]
    lines += [f"        {s} : {s.removeprefix(PREFIX)} / {_effect(s)}" for s in stages]
    lines.append("    }")
    others = [s for s in STATES if mode_of(s) in (None, Mode.EXECUTE) and s not in stages]
    lines += [f"    {s} : {s} / {_effect(s)}" for s in others if _effect(s)]
    drawn = {None, Mode.EXECUTE}
    arrows = [
        arrow for arrow in _arrows() if {mode_of(arrow.source), mode_of(str(arrow.target))} <= drawn
    ]
    for arrow in arrows:
        everywhere = {Transition(arrow.event, stage, arrow.target) for stage in stages}
        if not everywhere <= set(arrows):
            lines.append(f"    {arrow.source} --> {arrow.target} : {arrow.event.value}")
        elif arrow.source == stages[0]:
            lines.append(f"    {EXECUTE} --> {arrow.target} : {arrow.event.value}")
        elif arrow.source not in stages:
            lines.append(f"    {arrow.source} --> {arrow.target} : {arrow.event.value}")
    return _text(lines)


def pauses_mermaid() -> str:
    """Return a diagram of the transitions between modes that leave the work unchanged."""
    lines = ["stateDiagram-v2"]
    lines += [f"    {mode} : {mode} / {effect.value}" for mode, effect in MODE_EFFECTS.items()]
    found: dict[tuple[Mode, Mode, Event], set[str | None]] = {}
    for arrow in _arrows():
        source, target = mode_of(arrow.source), mode_of(str(arrow.target))
        if source and target and work_of(arrow.source) == work_of(str(arrow.target)):
            found.setdefault((source, target, arrow.event), set()).add(work_of(arrow.source))
    for (source, target, event), works in found.items():
        without = [work for work in WORK if work not in works]
        named = [work for work in WORK if work in works]
        few = f"all but {', '.join(without)}" if len(without) < len(named) else ", ".join(named)
        which = f" ({few})" if without else ""
        lines.append(f"    {source} --> {target} : {event.value}{which}")
    return _text(lines)


def stages_mermaid() -> str:
    """Return the transitions between the stages of one part (docs/operating/recovery.md)."""
    lines = ["stateDiagram-v2"]
    for arrow in _arrows():
        source, target = arrow.source, str(arrow.target)
        if source.startswith(PREFIX) and target.startswith(PREFIX):
            short = f"{source.removeprefix(PREFIX)} --> {target.removeprefix(PREFIX)}"
            lines.append(f"    {short} : {arrow.event.value}")
    return _text(lines)


def _effect(state: str) -> str:
    work = work_of(state)
    effect = ENTRY.get(state) if work is None else WORK[work]
    return "" if effect is None else effect.value


def _arrows() -> list[Transition]:
    return [one for one in CellMachine().transitions() if one.target is not None]


def _text(lines: Iterable[str]) -> str:
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(stages_mermaid() if "--stages" in sys.argv else page())
