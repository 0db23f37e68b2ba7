"""Where pybullet is not installed a real cell works, and an emulated one says what to install."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from controller.cell.devices.emulator import emulated_cell, emulator_command
from controller.cli import main
from controller.config import EMULATED_CELL
from emulators.world import EngineError
from emulators.world.matter import engine
from emulators.world.matter.bodies import Bodies

ROOT = Path(__file__).resolve().parents[2]
BLOCK = ROOT / "recipes" / "parts" / "featuretype.stl"
IMPORTS = """
import importlib, pkgutil, sys

def walk(name):
    module = importlib.import_module(name)
    for one in pkgutil.iter_modules(getattr(module, "__path__", ()), name + "."):
        if one.name != "controller.step_kernel" and not one.name.endswith("__main__"):
            walk(one.name)

for name in ("controller", "drivers", "emulators", "messages", "simulation"):
    walk(name)
print("pybullet" in sys.modules)
"""


@pytest.fixture
def missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no process that is started find pybullet, or anything it made."""
    folder = tmp_path / "without"
    folder.mkdir()
    (folder / "pybullet.py").write_text("raise ImportError(\"No module named 'pybullet'\")\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((str(folder), str(ROOT))))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.usefixtures("missing")
def test_no_module_needs_the_engine_to_be_imported() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORTS], capture_output=True, text=True)
    assert done.stdout.split() == ["False"], done.stderr


@pytest.mark.usefixtures("missing")
@pytest.mark.parametrize("parts", [(), ("--part", str(BLOCK))], ids=["empty", "part"])
def test_an_emulated_cell_says_what_to_install(
    parts: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["emulate", "--cell", str(EMULATED_CELL), *parts]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "the emulated cell needs the library pybullet" in said
    assert f"pip install {engine.PACKAGE}" in said
    assert "Traceback" not in said


def test_a_world_without_its_engine_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(EngineError, match=f"pip install {engine.PACKAGE}"):
        Bodies()


def test_real_devices_are_examined_without_the_engine(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    with emulated_cell(emulator_command(EMULATED_CELL, (), speed=1.0, seed=2)) as ready:
        text = EMULATED_CELL.read_text()
        for name, at in ready["devices"].items():
            where = at if isinstance(at, str) else f"{at['host']}:{at['port']}"
            (line,) = (
                one
                for one in text.splitlines()
                if one.startswith(f"  {name}: ") and "address: emulated" in one
            )
            text = text.replace(line, line.replace("address: emulated", f"address: '{where}'"))
        cell = tmp_path / "cell.yaml"
        cell.write_text(text)
        request.getfixturevalue("missing")  # the devices are there, from now on nothing else is
        done = subprocess.run(
            [sys.executable, "-m", "controller.cli", "doctor", "--json", "--cell", str(cell)],
            capture_output=True, text=True, cwd=tmp_path,
        )  # fmt: skip
    checks = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (checks, done.stderr)
    assert {"arm", "gripper", "lights", "io", "overhead", "inspection"} <= {
        one["check"] for one in checks
    }


def engines(python: str) -> list[str]:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    return [
        one.name
        for one in map(Requirement, listed)
        if one.name.startswith("pybullet")
        and one.marker is not None
        and one.marker.evaluate({"python_version": python})
    ]


@pytest.mark.parametrize(
    ("python", "names"),
    [
        ("3.11", ["pybullet"]),
        ("3.12", ["pybullet-arm64"]),
        ("3.13", ["pybullet-arm64"]),
        ("3.14", []),
    ],
)
def test_each_python_gets_the_engine_that_has_wheels_for_it(python: str, names: list[str]) -> None:
    assert engines(python) == names


def test_the_engine_that_is_named_is_the_one_that_is_required_here() -> None:
    assert engines(f"{sys.version_info.major}.{sys.version_info.minor}") in (
        [engine.PACKAGE],
        [],  # none has wheels for it yet
    )
