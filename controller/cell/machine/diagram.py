"""Draws docs/state-machine.md from the machine: ``python -m controller.cell.machine.diagram``.

With ``--stages`` it prints the stages of one part alone, as docs/operating.md shows them. A test
fails when either is out of date.
"""

import sys
from collections.abc import Iterable, Sequence

from .machine import CellMachine, Transition
from .table import COMMANDS, ENTRY, EXECUTE, IGNORED, SEPARATOR, STATES, Event

PREFIX = EXECUTE + SEPARATOR
# A row of more events than this names the outcomes that it leaves out instead.
LONG_COUNT = 8
HEAD = """# The states of the cell

Drawn from the machine by `python -m controller.cell.machine.diagram > docs/state-machine.md`; a
test fails when this page is out of date. A state that sets an action going has it behind the slash.
An arrow from `execute` holds for every stage.

"""
IGNORED_HEAD = """
## What is ignored on purpose

An event that is neither drawn nor listed here is refused, with the events that are possible.

| events | states | why |
|---|---|---|
"""


def page() -> str:
    """Return docs/state-machine.md."""
    rows = [
        f"| {_events_words(events)} | {', '.join(f'`{s}`' for s in states)} | {reason} |\n"
        for events, states, reason in IGNORED
    ]
    return f"{HEAD}```mermaid\n{mermaid()}```\n{IGNORED_HEAD}{''.join(rows)}"


def _events_words(events: Sequence[Event]) -> str:
    if len(events) <= LONG_COUNT:
        return ", ".join(f"`{event.value}`" for event in events)
    missing = [e for e in Event if e not in COMMANDS and e not in events]
    but = f" but {', '.join(f'`{event.value}`' for event in missing)}" if missing else ""
    return f"every outcome of an action{but}"


def mermaid() -> str:
    """Return every transition as mermaid; the stages of one part stand in a box of their own."""
    stages = [state for state in STATES if state.startswith(PREFIX)]
    lines = ["stateDiagram-v2", f"    [*] --> {CellMachine().state}", f"    state {EXECUTE} {{"]
    lines += [f"        {s} : {s.removeprefix(PREFIX)} / {ENTRY[s].value}" for s in stages]
    lines.append("    }")
    lines += [f"    {s} : {s} / {ENTRY[s].value}" for s in STATES if s in ENTRY and s not in stages]
    arrows = _arrows()
    for arrow in arrows:
        everywhere = {Transition(arrow.event, stage, arrow.target) for stage in stages}
        if not everywhere <= set(arrows):
            lines.append(f"    {arrow.source} --> {arrow.target} : {arrow.event.value}")
        elif arrow.source == stages[0]:
            lines.append(f"    {EXECUTE} --> {arrow.target} : {arrow.event.value}")
        elif arrow.source not in stages:
            lines.append(f"    {arrow.source} --> {arrow.target} : {arrow.event.value}")
    return _text(lines)


def stages_mermaid() -> str:
    """Return the transitions between the stages of one part, as docs/operating.md shows them."""
    lines = ["stateDiagram-v2"]
    for arrow in _arrows():
        source, target = arrow.source, str(arrow.target)
        if source.startswith(PREFIX) and target.startswith(PREFIX):
            short = f"{source.removeprefix(PREFIX)} --> {target.removeprefix(PREFIX)}"
            lines.append(f"    {short} : {arrow.event.value}")
    return _text(lines)


def _arrows() -> list[Transition]:
    return [one for one in CellMachine().transitions() if one.target is not None]


def _text(lines: Iterable[str]) -> str:
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(stages_mermaid() if "--stages" in sys.argv else page())
