"""What `cellctl` does before any work: help, version, completion; and how little it loads."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest

from controller import loading as loading_module
from controller.cli import app as app_module
from controller.cli import main
from controller.loading import loading
from controller.setup.software import commit

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("numpy", "scipy", "cv2", "trimesh", "pybullet")
PROBE = """
import json, sys
from controller.cli import main
report = []
for line in json.load(sys.stdin):
    code = main(line)
    report.append([line, code, [name for name in sys.argv[1:] if name in sys.modules]])
print(json.dumps(report), file=sys.stderr)
"""

THREADS = """
import json, os
import controller.cli
import cv2, numpy, scipy.linalg
own = [name for name in os.environ if "_NUM_THREADS" in name]
busy = len(os.listdir("/proc/self/task"))
print(json.dumps([{name: os.environ[name] for name in own}, busy, cv2.getNumThreads()]))
"""


def command_names() -> list[list[str]]:
    commands = [[str(command.name)] for command in app_module.app.registered_commands]
    for group in app_module.app.registered_groups:
        assert group.typer_instance is not None
        commands += [
            [str(group.name), str(command.name)]
            for command in group.typer_instance.registered_commands
        ]
    return commands


def test_no_help_and_no_version_loads_a_library_that_computes() -> None:
    lines = [["--help"], ["--version"], *([*name, "--help"] for name in command_names())]
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *HEAVY],
        input=json.dumps(lines), capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    report = json.loads(done.stderr)
    assert report == [[line, 0, []] for line in lines]


def test_the_probe_would_notice(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *HEAVY],
        input=json.dumps([["check", "nowhere.yaml"]]),
        capture_output=True, text=True, check=True, cwd=ROOT,
    )  # fmt: skip
    ((_, code, heavy),) = json.loads(done.stderr.splitlines()[-1])
    assert code == 2
    assert "numpy" in heavy


def test_no_module_imports_scipys_statistics_for_all_who_import_it() -> None:
    # a quarter of a second in each process; `scipy.special` has the same functions
    slow = re.compile(r"^(from|import) scipy\.stats|^from scipy import .*\bstats\b", re.MULTILINE)
    assert slow.search("from scipy.stats import norm\n")
    found = [
        str(path.relative_to(ROOT))
        for package in ("controller", "drivers", "emulators")
        for path in (ROOT / package).rglob("*.py")
        if slow.search(path.read_text())
    ]
    assert found == []


@pytest.mark.parametrize("before", [0, 7])
@pytest.mark.parametrize("was_enabled", [True, False])
def test_loading_leaves_the_collector_as_it_was(
    was_enabled: bool, before: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = {"enabled": was_enabled, "frozen": before, "counted": 0}

    def count() -> int:
        state["counted"] += 1
        return state["frozen"]

    stand_in = SimpleNamespace(
        isenabled=lambda: state["enabled"],
        disable=lambda: state.update(enabled=False),
        enable=lambda: state.update(enabled=True),
        get_freeze_count=count,
        freeze=lambda: state.update(frozen=state["frozen"] + 1),
    )
    monkeypatch.setattr(loading_module, "gc", stand_in)
    monkeypatch.setattr(loading_module, "_is_frozen", False)
    for _ in range(3):
        with loading():
            assert not state["enabled"]
    # Python counts by visiting each frozen object: once is enough
    assert state == {"enabled": was_enabled, "frozen": before or 1, "counted": 1}


def threads_of(**chosen: str) -> tuple[dict[str, str], int, int]:
    """Return the variables of a process of `cellctl`, its threads, and those of OpenCV."""
    ours = {k: v for k, v in os.environ.items() if "THREADS" not in k}
    done = subprocess.run(
        [sys.executable, "-c", THREADS],
        env=ours | {"PYTHONPATH": str(ROOT)} | chosen, capture_output=True, text=True, check=True,
    )  # fmt: skip
    names, busy, of_opencv = json.loads(done.stdout)
    return names, busy, of_opencv


def test_a_process_computes_with_one_thread() -> None:
    _, busy, of_opencv = threads_of()
    assert (busy, of_opencv) == (1, 1)


def test_threads_that_the_user_has_chosen_stay() -> None:
    names, _, of_opencv = threads_of(OMP_NUM_THREADS="2", OPENCV_FOR_THREADS_NUM="3")
    assert names == {"OMP_NUM_THREADS": "2"}  # a library's own variable would come before it
    assert of_opencv == 3


@pytest.mark.parametrize("name", ["", *(" ".join(name) for name in command_names())])
def test_help_shows_no_types_of_python(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*name.split(), "--help"]) == 0
    shown = capsys.readouterr().out
    assert not re.search(r"<(list|path|str|int|float)|\{", shown), shown
    assert "Show this" not in shown
    assert "Install completion" not in shown


def test_the_version_is_the_one_installed_with_its_commit(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"cellctl {version('cellctl')}, commit {commit()}\n"


def complete(shell: str, **more: str) -> str:
    """Return what the shell gets that asks `cellctl` for completions of ``cellctl re``."""
    done = subprocess.run(
        [sys.executable, "-m", "controller.cli"],
        env=os.environ | {"PYTHONPATH": str(ROOT), "_CELLCTL_COMPLETE": f"complete_{shell}"} | more,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.stdout


@pytest.mark.parametrize(
    ("shell", "more"),
    [
        ("bash", {"COMP_WORDS": "cellctl re", "COMP_CWORD": "1"}),
        ("zsh", {"_TYPER_COMPLETE_ARGS": "cellctl re"}),
        (
            "fish",
            {
                "_TYPER_COMPLETE_ARGS": "cellctl re",
                "_TYPER_COMPLETE_FISH_ACTION": "get-args",
            },
        ),
    ],
)
def test_shells_complete_commands(shell: str, more: dict[str, str]) -> None:
    offered = complete(shell, **more)
    for command in ("recognise", "recover", "report"):
        assert command in offered
    assert "doctor" not in offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_completion_script_of_each_shell_can_be_printed(shell: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "controller.cli"],
        env=os.environ | {"PYTHONPATH": str(ROOT), "_CELLCTL_COMPLETE": f"source_{shell}"},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "_CELLCTL_COMPLETE" in done.stdout
    assert "cellctl" in done.stdout
