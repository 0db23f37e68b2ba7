"""A wheel, installed into a fresh environment, works in a folder that is no checkout.

It is built from the sdist, and both from a checkout with one commit, as for a release.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
import zipfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import pytest
from git_repository import commit_all

from controller.setup.software import UNKNOWN

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "packaging"))

import release  # noqa: E402  (its folder comes first)

PACKED = ("controller", "drivers", "emulators", "messages", "recipes")
LIMIT_S = 1500.0  # a guard against a hang, no measure


@dataclass(frozen=True)
class Built:
    """sdist and wheel of a checkout, and its commit."""

    sdist: Path
    wheel: Path
    commit: str


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    """Build from a copy, so that the checkout stays as it is."""
    newest = int(version("setuptools").split(".")[0])
    assert newest >= 77, "setuptools 77 or newer is required: pip install -e '.[test]'"
    source = tmp_path_factory.mktemp("source")
    for folder in PACKED:
        shutil.copytree(
            ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__")
        )
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    commit = commit_all(source) if shutil.which("git") else UNKNOWN
    return Built(*release.build(source, tmp_path_factory.mktemp("built")), commit)


@pytest.fixture(scope="module")
def wheel(built: Built) -> Path:
    return built.wheel


class Installed:
    """`cellctl` from the wheel, called in a folder of its own."""

    def __init__(self, wheel: Path, scratch: Path) -> None:
        place = scratch / "environment"
        venv.create(place, with_pip=False, symlinks=True)
        python = place / "bin" / "python"
        (packages,) = (place / "lib").glob("python*/site-packages")
        # what cellctl depends on is what the tests run on; paths alone, so that nothing that is
        # installed there by reference to the checkout comes along
        shared = [path for path in sys.path if path.endswith("site-packages")]
        (packages / "shared.pth").write_text("\n".join(shared) + "\n")
        subprocess.run(
            [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet",
             "--no-deps", "--no-index", "--disable-pip-version-check", str(wheel)],
            check=True,
        )  # fmt: skip
        self.packages = packages
        self.cellctl = place / "bin" / "cellctl"
        self.folder = scratch / "elsewhere"
        self.folder.mkdir()
        self.env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}

    def __call__(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [str(self.cellctl), *arguments],
            cwd=self.folder, env=self.env,
            capture_output=True, text=True, check=False, timeout=LIMIT_S,
        )  # fmt: skip


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    return Installed(wheel, tmp_path_factory.mktemp("installed"))


def test_the_wheel_has_recipes_parts_their_licences_and_the_cell(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if name.startswith("recipes/")}
    there = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "recipes").rglob("*")
        if path.is_file() and path.suffix != ".pyc"
    }
    assert packed == there


def test_wheel_and_sdist_are_named_by_version_and_the_wheel_knows_its_commit(
    built: Built, installed: Installed
) -> None:
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert built.sdist.name == f"cellctl-{stated}.tar.gz"
    assert built.wheel.name == f"cellctl-{stated}-py3-none-any.whl"
    done = installed("--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == f"cellctl {stated}, commit {built.commit}\n"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["arm", "camera", "gripper", "lights"])
def test_a_driver_is_laid_out_installed_and_passes_its_tests(
    installed: Installed, kind: str
) -> None:
    done = installed("init", f"own_{kind}", "--driver", "omega", "--kind", kind)
    assert done.returncode == 0, done.stderr
    folder = installed.folder / f"own_{kind}"
    python = installed.cellctl.with_name("python")
    subprocess.run(
        [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps",
         "--no-index", "--no-build-isolation", "--disable-pip-version-check", str(folder)],
        check=True, env=installed.env,
    )  # fmt: skip
    tried = subprocess.run(
        [str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "ignore"],
        cwd=folder, env=installed.env,
        capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert tried.returncode == 0, tried.stdout
    assert re.search(r"^\d passed", tried.stdout, re.M), tried.stdout


def test_it_runs_from_the_wheel_and_not_from_the_checkout(installed: Installed) -> None:
    done = installed("check", "nobody_knows")
    assert done.returncode == 2, done.stderr
    assert "featuretype, flange_xy" in done.stderr
    python = installed.cellctl.with_name("python")
    where = subprocess.run(
        [str(python), "-c", "import controller, emulators; print(controller.__file__)"],
        cwd=installed.folder, env=installed.env, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(where.stdout).is_relative_to(installed.packages)


def test_doctor_finds_the_emulated_cell_well(installed: Installed) -> None:
    done = installed("doctor", "--json")
    checks = {row["check"]: row for row in map(json.loads, done.stdout.splitlines())}
    assert {"arm", "gripper", "lights", "io", "overhead", "inspection"} <= set(checks)
    bad = [row for row in checks.values() if not row["ok"] and row["check"] != "disk"]
    assert bad == []


def test_a_recipe_that_comes_with_it_is_planned(installed: Installed) -> None:
    done = installed("plan", "--recipe", "holder", "--pose", "0", "--json")
    assert done.returncode == 0, done.stderr
    plan = json.loads(done.stdout)
    assert plan["part"] == "holder"
    assert plan["covered_fraction"] > 0.9


@pytest.mark.slow
def test_the_default_recipe_runs_to_its_end(installed: Installed) -> None:
    done = installed("run", "--speed", "10", "--seed", "1", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["end"] == "complete"
    assert (installed.folder / result["report"]).is_file()


@pytest.mark.slow
def test_a_project_that_was_laid_out_runs_to_its_end(installed: Installed) -> None:
    assert installed("init", "project").returncode == 0
    project = installed.folder / "project"
    done = subprocess.run(
        [str(installed.cellctl), "run", "--speed", "10", "--seed", "5", "--json"],
        cwd=project, env=installed.env,
        capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout.splitlines()[-1])
    assert result["end"] == "complete"
    assert (project / result["report"]).is_file()
