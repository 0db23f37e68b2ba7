"""The scripts of docs/python.md, run as they stand there, in an empty folder."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"
SCRIPTS = dict(re.findall(r"^## ([^\n]+)\n+```python\n(.*?)^```", PAGE.read_text(), re.M | re.S))
LIMIT_S = 1500.0  # a guard against a hang, no measure


def run(title: str, folder: Path) -> str:
    script = folder / "script.py"
    script.write_text(SCRIPTS[title])
    done = subprocess.run(
        [sys.executable, "-P", str(script)],
        cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


def test_each_script_is_twenty_lines_at_most() -> None:
    assert len(SCRIPTS) == 4
    for title, script in SCRIPTS.items():
        lines = [line for line in script.splitlines() if line.strip()]
        assert len(lines) <= 20, title
        compile(script, title, "exec")


def test_the_gripper_is_driven(tmp_path: Path) -> None:
    printed = run("Drive the gripper", tmp_path)
    # nothing is between the jaws: they close past the part and meet nothing
    assert re.search(r"^Robotiq 2F: 1\d\.\d mm, part: False$", printed, re.M), printed
    assert re.search(r"^open at 8[45]\.\d mm$", printed, re.M), printed


def test_the_arm_is_driven(tmp_path: Path) -> None:
    printed = run("Drive the arm", tmp_path)
    found = re.fullmatch(r"shoulder at (-?\d+\.\d) degrees\n", printed)
    assert found, printed
    # an arm that was homed is parked with a straight shoulder
    assert abs(abs(float(found[1])) - 10.0) < 0.5


def test_a_picture_is_recognised(tmp_path: Path) -> None:
    (line,) = run("Recognise a picture", tmp_path).splitlines()
    found = re.fullmatch(
        r"holder, stable pose \d+, at ([\d.]+) mm, ([\d.-]+) mm, ([\d.-]+) degrees", line
    )
    assert found, line
    assert float(found[1]) == pytest.approx(360.0, abs=1.0)
    assert float(found[2]) == pytest.approx(20.0, abs=1.0)


def test_a_part_is_planned(tmp_path: Path) -> None:
    lines = run("Plan a part", tmp_path).splitlines()
    steps = [line for line in lines if re.match(r" +\d+\.\d s  ", line)]
    assert len(steps) >= 5
    (total,) = (line for line in lines if re.fullmatch(r"\d+ s, \d+\.\d% of the surface", line))
    forecast_s = float(total.split()[0])
    assert sum(float(line.split()[0]) for line in steps) == pytest.approx(forecast_s, abs=2.0)
