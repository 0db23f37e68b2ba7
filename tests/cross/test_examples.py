"""The scripts of `examples`, run as they are, in an empty folder."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
LIMIT_S = 1500.0  # a guard against a hang, no measure
LONGEST = 60  # lines: a story fits a screen


def run(script: str, *words: str, folder: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-P", str(FOLDER / script), *words],
        cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("script", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.stem)
def test_a_story_is_short_and_is_told_in_the_documents(script: Path) -> None:
    lines = [line for line in script.read_text().splitlines() if line.strip()]
    assert len(lines) <= LONGEST
    page = (FOLDER.parent / "docs" / "python.md").read_text()
    assert f"`examples/{script.name}`" in page


def test_the_gripper_is_driven(tmp_path: Path) -> None:
    printed = run("drive_gripper.py", folder=tmp_path)
    # nothing is between the jaws: they close past the part and meet nothing
    assert re.search(r"^Robotiq 2F: 1\d\.\d mm, part: False$", printed, re.M), printed
    assert re.search(r"^open at 8[45]\.\d mm$", printed, re.M), printed


def test_the_arm_is_driven(tmp_path: Path) -> None:
    printed = run("drive_arm.py", folder=tmp_path)
    found = re.fullmatch(r"shoulder at (-?\d+\.\d) degrees\n", printed)
    assert found, printed
    # an arm that was homed is parked with a straight shoulder
    assert abs(abs(float(found[1])) - 10.0) < 0.5


def test_a_picture_is_recognised(tmp_path: Path) -> None:
    (line,) = run("recognise_picture.py", folder=tmp_path).splitlines()
    found = re.fullmatch(
        r"holder, stable pose \d+, at ([\d.]+) mm, ([\d.-]+) mm, ([\d.-]+) degrees", line
    )
    assert found, line
    assert float(found[1]) == pytest.approx(360.0, abs=1.0)
    assert float(found[2]) == pytest.approx(20.0, abs=1.0)


def test_a_part_is_planned(tmp_path: Path) -> None:
    lines = run("plan_part.py", folder=tmp_path).splitlines()
    steps = [line for line in lines if re.match(r" +\d+\.\d s  ", line)]
    assert len(steps) >= 5
    (total,) = (line for line in lines if re.fullmatch(r"\d+ s, \d+\.\d% of the surface", line))
    forecast_s = float(total.split()[0])
    assert sum(float(line.split()[0]) for line in steps) == pytest.approx(forecast_s, abs=2.0)


@pytest.mark.slow
def test_a_new_part_is_run_judged_again_and_found_in_the_history(tmp_path: Path) -> None:
    run("new_part.py", folder=tmp_path)
    (pictures,) = (tmp_path / "plate" / "runs").glob("*/part001.views.json")
    judged = run("judge_pictures.py", str(pictures), "plate/recipe.yaml", folder=tmp_path)
    assert judged.startswith("PASS\n")
    told = r"^hole 12 mm, diameter: ([\d.]+) mm \(U = ([\d.]+) mm\)"
    (diameter,) = re.findall(told, judged, re.M)
    assert float(diameter[0]) == pytest.approx(12.0, abs=float(diameter[1]))
    (line,) = run("history_sql.py", "plate/runs", folder=tmp_path).splitlines()
    assert "part 1" in line
    assert ": pass, accept, " in line


@pytest.mark.slow
def test_a_run_is_followed_over_its_socket(tmp_path: Path) -> None:
    states = run("follow_run.py", folder=tmp_path).splitlines()
    told = [line.rsplit(": ", 1)[-1] for line in states[:-1]]
    assert "execute_presenting" in told
    assert states[-1] == "the run ended with exit code 0"
