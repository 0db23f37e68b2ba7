"""A number by which modules of the inspection decide stands once."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import controller.inspection

ROOM = Path(controller.inspection.__file__).parent
NAME = re.compile(r"[A-Z][A-Z0-9_]*")


def numbers(source: str) -> Iterator[tuple[str, str]]:
    """Names of a module that are bound to numbers, and how."""
    for node in ast.parse(source).body:
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        if node.value is None or not NAME.fullmatch(node.target.id):
            continue
        parts = (one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant))
        if any(isinstance(part, int | float) for part in parts):
            yield node.target.id, ast.unparse(node.value)


def copies(modules: dict[str, str]) -> dict[tuple[str, str], list[str]]:
    """Modules that bind the same name to the same number, by name and number."""
    where: dict[tuple[str, str], list[str]] = defaultdict(list)
    for module, source in modules.items():
        for named in numbers(source):
            where[named].append(module)
    return {named: modules for named, modules in where.items() if len(modules) > 1}


def test_no_two_modules_of_the_room_have_a_copy_of_a_number() -> None:
    room = {str(path.relative_to(ROOM)): path.read_text("utf-8") for path in ROOM.rglob("*.py")}
    assert sum(len(list(numbers(source))) for source in room.values()) > 100
    assert copies(room) == {}


def test_a_copy_is_found_and_a_namesake_with_another_value_is_none() -> None:
    one, other = "NEAR_PX: Final = 1.3  # of them\n", "NEAR_PX: Final = 1.30\nFAR_PX: Final = 9\n"
    assert copies({"a.py": one, "b.py": other}) == {("NEAR_PX", "1.3"): ["a.py", "b.py"]}
    assert copies({"a.py": one, "b.py": "NEAR_PX: Final = 2.0\n"}) == {}


def test_each_number_that_several_modules_decide_by_says_what_it_limits() -> None:
    lines = (ROOM / "limits.py").read_text("utf-8").splitlines()
    for i, line in enumerate(lines):
        if re.match(r"[A-Z][A-Z_]*: ", line):
            assert "  # " in line or lines[i - 1].startswith("# "), line
