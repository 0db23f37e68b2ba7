"""docs/tutorial.md can be followed: its files are taken, and its commands print what it shows."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

TEXT = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
FILES = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
SHOWN = re.findall(r"```console\n\$ cellctl (.*?)\n(.*?)```", TEXT, re.DOTALL)
RUN = re.compile(r"\d{8}-\d{6}-\d{3}|\d+ rows, \d+ files|row \d+|[0-9a-f]{8}\.\.\.|[0-9a-f]{64}")


def printed(folder: Path, command: str) -> str:
    words = [sys.executable, "-m", "controller.cli", *command.split()]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def missing(shown: str, text: str) -> list[str]:
    """Return the lines that the page shows and the command did not print; a run's names aside."""
    known = {RUN.sub("RUN", line).rstrip() for line in text.splitlines()}
    return [
        line
        for line in shown.splitlines()
        if line != "..." and RUN.sub("RUN", line).rstrip() not in known
    ]


@pytest.fixture
def project(tmp_path: Path) -> Path:
    part, _, recipe = FILES
    (tmp_path / "plate.csg.yaml").write_text(part, encoding="utf-8")
    (tmp_path / "recipe.yaml").write_text(recipe, encoding="utf-8")
    return tmp_path


def test_the_part_of_the_tutorial_has_what_it_says(project: Path) -> None:
    command, shown = SHOWN[0]
    assert command == "compile plate.csg.yaml"
    assert missing(shown, printed(project, command)) == []


@pytest.mark.slow
def test_the_tutorial_leads_to_a_pass_and_a_report(project: Path) -> None:
    for command, shown in SHOWN[3:]:
        assert missing(shown, printed(project, command)) == []
    (report,) = project.glob("runs/*/report.pdf")
    assert report.read_bytes().startswith(b"%PDF-")


def test_a_line_that_is_no_longer_printed_is_noticed() -> None:
    shown = "...\nreport: runs/20260101-000000-001-x/report.pdf\n5 holes\n"
    text = "report: runs/20260202-111111-222-x/report.pdf\n6 holes\n"
    assert missing(shown, text) == ["5 holes"]
