"""A missing file among many is named before the first of them is worked on."""

from __future__ import annotations

from pathlib import Path

import pytest

from controller.cad import load_solid
from controller.cli.app import main
from controller.cli.inputs.checks import require_files
from controller.config import ConfigError


@pytest.fixture
def block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "block.csg.yaml"
    path.write_text("unit: mm\npart:\n  block: {size: [60, 40, 20]}\n")
    return path


@pytest.mark.parametrize(
    "words",
    [
        ["compile", "block.csg.yaml", "gone.stl"],
        ["plan", "block.csg.yaml", "gone.stl"],
        ["recognise", "gone.png", "--parts", "block.csg.yaml", "--calibration", "gone.json"],
        ["emulate", "--part", "block.csg.yaml", "--part", "gone.step#bolt"],
    ],
)
def test_nothing_is_worked_on_where_a_file_is_missing(
    block: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "gone." in said.err
    assert "No such file or directory; check the path" in said.err
    assert "block" not in said.err


def test_each_missing_file_has_a_line() -> None:
    with pytest.raises(ConfigError) as caught:
        require_files([Path(f"gone{k}.stl") for k in range(20)])
    lines = str(caught.value).splitlines()
    assert lines[0].startswith("gone0.stl: No such file")
    assert lines[-1] == "and 8 more"


def test_a_file_whose_name_is_no_utf8_has_a_name_in_text(
    block: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    odd = tmp_path / "Geh\udce4use.csg.yaml"  # what Python makes of the byte 0xe4
    odd.write_bytes(block.read_bytes())
    assert load_solid(odd).name == r"Geh\xe4use"
    report = tmp_path / "report.html"
    assert main(["compile", str(odd), "--json", "--report", str(report)]) == 0
    assert r'"part":"Geh\\xe4use"' in capsys.readouterr().out
    assert r"Geh\xe4use" in report.read_text(encoding="utf-8")
