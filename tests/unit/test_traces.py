"""The traces in ARCHITECTURE.md can be followed: each name is there, each row leads to the next."""

from __future__ import annotations

import ast
import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROW = re.compile(r"^\| `([^`]+\.py)` \| `([\w.]+)` \| (.+) \|$", re.M)
MAX_HOPS_OF_A_COMMAND = 5


class Stop(NamedTuple):
    """One row of a trace."""

    file: str
    name: str
    what: str

    @property
    def last(self) -> str:
        return self.name.rpartition(".")[2]

    @property
    def text(self) -> str:
        return (ROOT / self.file).read_text(encoding="utf-8")


def traces() -> dict[str, list[Stop]]:
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.partition("## Three traces\n")[2].partition("\n## ")[0]
    parts = re.split(r"^### (.+)$", section, flags=re.M)[1:]
    return {
        title: [Stop(*row) for row in ROW.findall(body)]
        for title, body in zip(parts[::2], parts[1::2], strict=True)
    }


def names_defined(text: str) -> set[str]:
    """Return functions and methods of a module, as ``function`` and ``Class.method``.

    A method may also be assigned: `Compute` names the function that answers.
    """
    found = set()
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            found.add(node.name)
        elif isinstance(node, ast.ClassDef):
            found |= {
                f"{node.name}.{inner.name}"
                for inner in node.body
                if isinstance(inner, ast.FunctionDef | ast.AsyncFunctionDef)
            }
            found |= {
                f"{node.name}.{target.id}"
                for inner in node.body
                if isinstance(inner, ast.Assign)
                for target in inner.targets
                if isinstance(target, ast.Name)
            }
    return found


def names_used(text: str) -> set[str]:
    """Return what a module calls or reads: bare names, and what stands behind a dot."""
    nodes = list(ast.walk(ast.parse(text)))
    return {n.attr for n in nodes if isinstance(n, ast.Attribute)} | {
        n.id for n in nodes if isinstance(n, ast.Name)
    }


def test_there_are_three_traces_and_each_row_is_read() -> None:
    found = traces()
    assert len(found) == 3
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    section = text.partition("## Three traces\n")[2].partition("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| `")]
    assert sum(map(len, found.values())) == len(rows) > 20


@pytest.mark.parametrize("title", traces())
def test_each_name_is_in_its_file(title: str) -> None:
    for stop in traces()[title]:
        assert stop.name in names_defined(stop.text), stop


@pytest.mark.parametrize("title", traces())
def test_each_row_leads_to_the_next(title: str) -> None:
    """A row calls the next, is called by it, or leaves behind what it quotes and the next reads.

    What was called returns: an earlier row may go on.
    """
    stops = traces()[title]
    for number, (here, there) in enumerate(pairwise(stops)):
        read = names_used(there.text)
        calls = any(there.last in names_used(before.text) for before in stops[: number + 1])
        left = set(re.findall(r"`(\w+)`", here.what)) & names_used(here.text) & read
        assert calls or here.last in read or left, (here, there)


def test_a_gripper_command_takes_few_hops() -> None:
    (trace,) = (stops for title, stops in traces().items() if "gripper command" in title)
    assert trace[0].file.startswith("controller/cell/actions/")
    assert "pymodbus" in trace[-1].text
    assert len({stop.file for stop in trace}) == len(trace) <= MAX_HOPS_OF_A_COMMAND
