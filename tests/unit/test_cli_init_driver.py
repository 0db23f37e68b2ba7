"""`cellctl init --driver`: the package that it lays out is a driver, and works as it stands."""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path

import pytest
from installed_here import register

from controller.cli import main
from controller.cli.project.starter_driver import ADDRESS, DEVICES, MODULE, TEMPLATES, cell_text
from controller.config import EMULATED_CELL, load_cell
from controller.conformance.suite import try_emulated
from controller.setup.drivers import find_driver, require_drivers

ROOT = Path(__file__).resolve().parents[2]
KINDS = sorted(DEVICES)


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install this checkout as it is now."""
    monkeypatch.syspath_prepend(str(register(tmp_path_factory.mktemp("installed"))))


def laid_out(folder: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Lay out a driver `zeta`, and install it as far as Python sees."""
    assert main(["init", str(folder), "--driver", "zeta", "--kind", kind]) == 0
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name']}-{project['version']}.dist-info"
    info.mkdir()
    name = f"Name: {project['name']}\nVersion: {project['version']}\n"
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\n{name}")
    ((entry, value),) = project["entry-points"]["cellctl.drivers"].items()
    (info / "entry_points.txt").write_text(f"[cellctl.drivers]\n{entry} = {value}\n")
    monkeypatch.syspath_prepend(str(folder))
    return folder


@pytest.fixture
def package(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    return laid_out(tmp_path / "new", request.param, monkeypatch)


@pytest.fixture
def address(package: Path) -> Iterator[str]:
    """Run the emulator that was laid out."""
    (module,) = (path.parent.name for path in package.glob("*/emulator.py"))
    words = [sys.executable, "-m", f"{module}.emulator", "--port", "0"]
    with subprocess.Popen(words, cwd=package, stdout=subprocess.PIPE, text=True) as emulator:
        try:
            assert emulator.stdout is not None
            yield emulator.stdout.readline().strip()
        finally:
            emulator.terminate()


@pytest.mark.parametrize("package", KINDS, indirect=True)
def test_the_driver_meets_all_requirements_on_its_emulator(package: Path, address: str) -> None:
    path = package / "cell.yaml"
    path.write_text(path.read_text().replace(ADDRESS, address))
    (device,) = (
        name for name in DEVICES.values() if getattr(load_cell(path).devices, name).driver == "zeta"
    )
    results = try_emulated(path, device)
    assert len(results) >= 8
    assert [f"{one.name}: {one.words}" for one in results if one.verdict != "met"] == []


@pytest.mark.parametrize("package", KINDS, indirect=True)
def test_nothing_in_the_package_is_of_the_template_any_more(package: Path) -> None:
    for path in package.rglob("*"):
        if path.is_file() and path.parent.suffix != ".dist-info":
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"acme|controller\.cli", text, re.IGNORECASE), path
            assert "zeta" in text.lower() or path.name in ("model.py", "test_conformance.py"), path
            if path.suffix == ".py":
                compile(text, str(path), "exec")
    require_drivers(package / "cell.yaml", load_cell(package / "cell.yaml"))


def test_a_cell_file_has_one_device_of_another_make_and_is_the_emulated_one_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for kind, device in DEVICES.items():
        laid_out(tmp_path / kind, kind, monkeypatch)
        path = tmp_path / "cell.yaml"
        path.write_text(cell_text("zeta", kind))
        found, own = (load_cell(p).model_dump() for p in (path, EMULATED_CELL))
        assert found["devices"].pop(device) != own["devices"].pop(device)
        if kind == "arm":
            assert found["arm"].pop("shape")
            assert found.pop("arm")["arm_gripper"] == own.pop("arm")["arm_gripper"]
        assert found == own


@pytest.mark.parametrize("name", ["Acme", "2f", "a-b", "", "über", "a" * 32])
def test_a_name_that_is_no_name_of_a_module_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", str(tmp_path / "new"), "--driver", name]) == 2
    assert "small letters, digits and _" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_the_name_of_an_installed_driver_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["init", str(tmp_path / "new"), "--driver", "v4l2", "--kind"]
    assert main([*words, "camera"]) == 2
    assert "there is a camera driver of this name (drivers.camera_v4l2" in capsys.readouterr().err
    assert main([*words, "gripper", "--json"]) == 0  # of another kind it is free
    assert "v4l2_gripper/driver.py" in json.loads(capsys.readouterr().out)["files"]


def test_no_setting_leaves_the_templates_out_of_linter_and_types() -> None:
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    mypy, ruff = tools["mypy"], tools["ruff"]
    assert "controller" in mypy["packages"]
    assert not {"exclude", "namespace_packages", "disable_error_code"} & mypy.keys()
    assert not any(word.endswith("exclude") for word in ruff)
    names = [path.relative_to(ROOT).as_posix() for path in TEMPLATES.rglob("*.py")]
    assert names
    ignored = {
        code
        for pattern, codes in ruff["lint"]["per-file-ignores"].items()
        for code in codes
        if any(fnmatch(name, pattern) for name in names)
    }
    assert ignored == set()


def test_templates_are_drivers_of_their_kind() -> None:
    for kind in KINDS:
        module = importlib.import_module(f"{MODULE}{kind}")
        assert type(module.DRIVER) is type(find_driver(kind, _own(kind)))


def _own(kind: str) -> str:
    return {"arm": "ur", "camera": "v4l2", "gripper": "robotiq_2f", "lights": "waveshare"}[kind]
