"""A whole run, recorded and run again on its wires; and one byte of another recipe."""

import json
import shutil
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LIMIT_S = 1500.0  # a guard against a hang, no measure


def cellctl(*arguments: object) -> tuple[int, dict[str, object]]:
    done = subprocess.run(
        [sys.executable, "-m", "controller.cli", *map(str, arguments), "--json"],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        cwd=ROOT,
        check=False,
    )
    assert done.stdout, done.stderr
    return done.returncode, json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.timeout(2 * LIMIT_S)
def test_a_recorded_run_replays_byte_by_byte_and_another_force_is_found(tmp_path: Path) -> None:
    wires = tmp_path / "run.wires"
    recipe = ROOT / "recipes" / "holder.yaml"
    ran, _ = cellctl(
        "run", recipe, "--speed", 20, "--seed", 11, "--runs", tmp_path / "runs", "--record", wires
    )
    assert ran == 0
    code, same = cellctl("replay", "--wires", wires)
    assert (code, same["difference"]) == (0, None)

    # a recipe names files of its own folder alone
    shutil.copytree(recipe.parent, tmp_path / "recipes")
    changed = tmp_path / "recipes" / recipe.name
    text = recipe.read_text(encoding="utf-8")
    assert "grasp:" not in text  # 60 N by default
    changed.write_text(text + "grasp: {force_n: 55}\n", encoding="utf-8")
    code, other = cellctl("replay", "--wires", wires, "--recipe", changed)
    assert code == 1
    found = other["difference"]
    assert isinstance(found, dict)
    # MAX_FORCE is written as `7x`, low byte, high byte (umi_rtx.md 2.5)
    assert found["wire"] == "arm"
    assert found["byte"] == 1
    assert bytes.fromhex(found["recorded"])[1] == 60
    assert bytes.fromhex(found["sent"])[1] == 55


@pytest.mark.slow
@pytest.mark.timeout(2 * LIMIT_S)
@pytest.mark.skipif(find_library("aravis-0.8") is None, reason="libaravis-0.8 is not installed")
def test_a_run_on_gige_vision_cameras_replays_byte_by_byte(tmp_path: Path) -> None:
    wires = tmp_path / "run.wires"
    ran, _ = cellctl(
        "run", ROOT / "recipes" / "holder.yaml", "--speed", 10, "--seed", 5,
        "--cell", ROOT / "recipes" / "cells" / "genicam.yaml",
        "--runs", tmp_path / "runs", "--record", wires,
    )  # fmt: skip
    assert ran == 0
    code, same = cellctl("replay", "--wires", wires)
    assert (code, same["difference"]) == (0, None)
