"""The cell's table as a Mermaid state diagram: `python tests/unit/machine_diagram.py`.

With ``--stages`` only those of one part, as docs/operating.md shows them.
"""

from __future__ import annotations

import re
import sys

from controller.cell.machine import ENTRY, EXECUTE, SEPARATOR, STATES, TABLE

Arrow = tuple[str, str, str]


def mermaid() -> str:
    """Draw every transition; the stages of one part stand in a box of their own."""
    prefix = EXECUTE + SEPARATOR
    lines = ["stateDiagram-v2", "    [*] --> stopped", f"    state {EXECUTE} {{"]
    stages = [s for s in STATES if s.startswith(prefix)]
    lines += [f"        {s} : {s.removeprefix(prefix)} / {ENTRY[s].value}" for s in stages]
    lines.append("    }")
    lines += [f"    {s} : {s} / {ENTRY[s].value}" for s in STATES if s in ENTRY and s not in stages]
    for event, sources, target in TABLE:
        if set(stages) <= set(sources):
            lines.append(f"    {EXECUTE} --> {target} : {event.value}")
            sources = tuple(s for s in sources if s not in stages)
        lines += [f"    {source} --> {target} : {event.value}" for source in sources]
    return "\n".join(lines) + "\n"


def stages_mermaid() -> str:
    """Draw one part's way through the stages, recoveries among them; as the manual shows it."""
    prefix = EXECUTE + SEPARATOR
    lines = ["stateDiagram-v2"]
    for event, sources, target in TABLE:
        if not target.startswith(prefix):
            continue
        for source in sources:
            if source.startswith(prefix):
                way = f"{source.removeprefix(prefix)} --> {target.removeprefix(prefix)}"
                lines.append(f"    {way} : {event.value}")
    return "\n".join(lines) + "\n"


def arrows(diagram: str) -> set[Arrow]:
    """Read the transitions back: (source, event, target)."""
    found: set[Arrow] = set()
    stages = re.findall(r"^ {8}(\S+) : ", diagram, re.MULTILINE)
    for source, target, event in re.findall(r"(\S+) --> (\S+) : (\S+)", diagram):
        found |= {(s, event, target) for s in (stages if source == EXECUTE else [source])}
    return found


if __name__ == "__main__":
    print(stages_mermaid() if "--stages" in sys.argv else mermaid(), end="")  # noqa: T201 - its whole purpose
