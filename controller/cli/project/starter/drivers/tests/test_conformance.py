"""The driver meets what cellctl requires of its kind, and is a reading of its own."""

import ast
import inspect
from pathlib import Path

from controller.cli.project.starter.drivers.gripper import driver, emulator
from controller.conformance.suite import try_emulated

DEVICE = "gripper"


def test_the_driver_meets_all_requirements(cell_file: Path) -> None:
    """Try on the emulator what `pytest --cell` tries on the real device."""
    results = try_emulated(cell_file, DEVICE)
    assert [f"{one.name}: {one.words}" for one in results if one.verdict != "met"] == []


def test_driver_and_emulator_know_nothing_of_each_other() -> None:
    """Check their imports: shared code cannot disagree, and would hide what was misread."""
    imported = {}
    for module in (driver, emulator):
        tree = ast.parse(inspect.getsource(module))
        froms = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        imported[module] = {f"{'.' * node.level}{node.module or ''}" for node in froms}
    assert not any(name.startswith("emulators") for name in imported[driver])
    assert not any(name.startswith((".", "drivers")) for name in imported[emulator])
