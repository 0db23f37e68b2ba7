"""Docstrings as the house writes them, for Sphinx: `name : what it is` is no type.

NumPy's form has a name with its type, and the description below it. Here types stand in signatures,
and a description stands beside its name; `napoleon` would print it as a type.
"""

import re
from typing import Any

from sphinx.application import Sphinx

SECTIONS = ("Parameters", "Attributes", "Raises")
ENTRY = re.compile(r"(\S[^:]*?) : (.+)")


def spread(lines: list[str]) -> list[str]:
    """Return a docstring with each description below its name, and its result in prose."""
    out: list[str] = []
    section = heading = ""
    for number, line in enumerate(lines):
        below = lines[number + 1] if number + 1 < len(lines) else ""
        if line and re.fullmatch(r"-{3,}", below):
            section = line
        entry = ENTRY.fullmatch(line) if section in SECTIONS else None
        if entry:
            out += [entry[1], f"    {entry[2]}"]
        elif line == "Returns":
            heading = "Returns "
        elif section == "Returns" and line.startswith("---"):
            continue
        elif heading and line:
            out.append(heading + line)
            heading = ""
        else:
            out.append(line)
    return out


def on_docstring(
    app: Sphinx, what: str, name: str, documented: object, options: object, lines: list[str]
) -> None:
    """Spread a docstring before `napoleon` reads it."""
    lines[:] = spread(lines)


def setup(app: Sphinx) -> dict[str, Any]:
    """Read docstrings before `napoleon` does."""
    app.connect("autodoc-process-docstring", on_docstring, priority=400)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
