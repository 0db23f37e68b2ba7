"""What tests of a file share is prepared once, and what keeps time runs one after the other."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from scheduling import GROUPS, is_drawn, is_quick, typical_seconds, unit_of

ROOT = Path(__file__).parents[2]
TEST_COUNT = 8
SHARING = f"""
import os, time
from pathlib import Path
import pytest

def note(what):
    with open("noted", "a") as file:
        file.write(f"{{what}} {{Path(__file__).stem}} {{os.getpid()}}\\n")

@pytest.fixture(scope="module")
def shared():
    note("made")
    time.sleep(0.2)

@pytest.mark.parametrize("number", range({TEST_COUNT}))
def test_it(shared, number):
    note("began")
    time.sleep(0.01)
    note("ended")
"""
FILES = (
    "cell/test_one.py", "cross/test_examples.py", "cross/test_line.py",
    "unit/test_emu_camera_a.py", "unit/test_long.py", "unit/test_middle.py", "unit/test_new.py",
)  # fmt: skip
SECONDS = {"unit/test_middle.py": 20.0, "unit/test_long.py": 30.0}


def noted(folder: Path, *options: str) -> list[list[str]]:
    """Return what the tests of a small project note, which is configured as this one."""
    for name in ("pyproject.toml", "tests/conftest.py", "tests/scheduling.py"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    for name in FILES:
        (folder / "tests" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "tests" / name).write_text(SHARING)
    (folder / "tests" / "data").mkdir()
    (folder / "tests" / "data" / "typical_seconds.json").write_text(json.dumps(SECONDS))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return [line.split() for line in (folder / "noted").read_text().splitlines()]


def test_what_a_file_shares_is_made_once_and_the_longest_begins_first(tmp_path: Path) -> None:
    rows = noted(tmp_path)
    made = [(file, process) for what, file, process in rows if what == "made"]
    assert sorted(file for file, _ in made) == sorted(Path(name).stem for name in FILES)
    assert {process for _, process in made} == {process for *_, process in rows}
    assert len({process for _, process in made}) == 2
    # of each process, since one that starts late has its own first file all the same
    first = {process: file for file, process in reversed(made)}
    assert set(first.values()) == {"test_long", "test_middle"}
    assert Counter(what for what, *_ in rows)["ended"] == TEST_COUNT * len(FILES)

    in_group = {name: {p for _, file, p in rows if file == Path(name).stem} for name in FILES}
    for group in (FILES[:2], FILES[2:4]):
        (process,) = set.union(*(in_group[name] for name in group))
        assert process


def test_tests_that_are_handed_out_one_by_one_prepare_more_than_once(tmp_path: Path) -> None:
    # what the test above would see if a release of pytest or xdist no longer heeds us
    made = [file for what, file, _ in noted(tmp_path, "--dist", "load") if what == "made"]
    assert len(made) > len(FILES)


@pytest.mark.parametrize(
    ("nodeid", "unit"),
    [
        ("tests/unit/test_cache.py::test_a[x::y]", "unit/test_cache.py"),
        ("tests/cell/test_ends.py::test_a", "whole cells"),
        ("tests/cross/test_examples.py::test_a", "whole cells"),
        ("tests/cross/test_chute.py::test_a", "wires"),
        ("tests/unit/test_emu_camera_fuse.py::test_a", "wires"),
        ("tests/unit/test_emu_surfaces.py::test_a", "unit/test_emu_surfaces.py"),
    ],
)
def test_a_test_belongs_to_its_file_or_to_what_keeps_time(nodeid: str, unit: str) -> None:
    assert unit_of(nodeid) == unit


def test_every_unit_with_kept_seconds_is_still_there() -> None:
    files = {path.relative_to(ROOT / "tests").as_posix() for path in ROOT.glob("tests/*/test_*.py")}
    assert set(typical_seconds()) <= files | set(GROUPS)
    for starts in GROUPS.values():
        for start in starts:
            assert any(file.startswith(start) for file in files), start


def test_quick_tests_are_of_short_files_and_ask_for_nothing_special() -> None:
    assert is_quick("tests/unit/test_new.py::test_it", ["parametrize"], SECONDS)
    for nodeid, marks in (
        ("tests/unit/test_long.py::test_it", []),
        ("tests/unit/test_new.py::test_it", ["slow"]),
        ("tests/cross/test_line.py::test_it", []),
    ):
        assert not is_quick(nodeid, marks, SECONDS), nodeid


SLOW = """
import pytest

@pytest.mark.slow
@pytest.mark.parametrize("number", range(200))
def test_drawn(number):
    pass

@pytest.mark.slow(always=True)
@pytest.mark.parametrize("number", range(10))
def test_in_each_gate(number):
    pass

@pytest.mark.parametrize("number", range(20))
def test_unmarked(number):
    pass
"""


def chosen(folder: Path, *options: str) -> set[str]:
    """Return the tests that pytest chooses of some slow ones and others."""
    for name in ("pyproject.toml", "tests/conftest.py", "tests/scheduling.py"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / name)
    (folder / "tests" / "data").mkdir(exist_ok=True)
    (folder / "tests" / "data" / "typical_seconds.json").write_text("{}")
    (folder / "tests" / "test_slow.py").write_text(SLOW)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "0", "--collect-only", *options],
        cwd=folder, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return {line for line in done.stdout.splitlines() if "::" in line}


def test_a_gate_draws_a_quarter_of_the_slow_tests_and_runs_some_always(tmp_path: Path) -> None:
    share = ("-m", "slow", "--slow-share", "0.25", "--slow-seed")
    gates = [chosen(tmp_path, *share, seed) for seed in ("one", "two", "one")]
    assert gates[0] == gates[2]
    drawn = [{name for name in gate if "test_drawn" in name} for gate in gates]
    # of 200 with a share of 0.25: within four standard deviations of the mean
    assert all(25 < len(names) < 75 for names in drawn)
    assert drawn[0] != drawn[1]
    for gate, names in zip(gates, drawn, strict=True):
        assert {name.partition("::")[2].partition("[")[0] for name in gate - names} == {
            "test_in_each_gate"
        }
        assert len(gate - names) == 10
    assert len(chosen(tmp_path, "-m", "slow")) == 210
    assert len(chosen(tmp_path, *share[2:], "one")) == 20


def test_each_slow_test_is_drawn_in_a_quarter_of_all_gates() -> None:
    for nodeid in ("tests/cell/test_ends.py::test_a", "tests/unit/test_cad_step.py::test_b[x]"):
        gates = sum(is_drawn(nodeid, str(seed), 0.25) for seed in range(1600))
        assert 330 < gates < 470  # four standard deviations of 17 about 400
    assert all(is_drawn("tests/unit/test_a.py::test", str(seed), 1.0) for seed in range(100))
