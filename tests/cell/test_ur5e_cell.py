"""The emulated cell with a UR5e: a part's whole way, and how it goes on after a kill."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from kill_world import ROOT, kill_world, let_go_count, lines_of
from kill_world import start as start_on

from controller.cell.journal import first_flaw, read_rows

CELL = ROOT / "recipes" / "cells" / "ur5e.yaml"


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_ur5e_shows_a_perfect_part_whole_and_puts_it_into_the_accept_tray(
    start: Callable[..., Run],
) -> None:
    def remember_truth(body: dict[str, Any], run: Run) -> None:
        if body.get("state") in ("complete", "completing"):
            run.seen["truth"] = run.control("truth")

    ran = start("recipes/holder.yaml", "--cell", str(CELL), "--seed", "5").follow(remember_truth)

    assert ran.code == 0, ran.stderr
    (part,) = ran.result["parts"]
    assert (part["verdict"], part["tray"]) == ("pass", "accept")
    (truth,) = ran.seen["truth"]["parts"]
    assert (truth["tray"], truth["custody"]) == ("accept", "free")
    assert ran.seen["truth"]["collisions"] == []
    rows = list(read_rows(ran.journal, ran.result["run"]))
    custody = [row.name for row in rows if row.kind == "custody"]
    # handed over to the fixed gripper and back, once or more often, and put down
    assert custody[:3] == ["in_arm", "in_both", "in_fixture"]
    assert custody[-1] == "placed"
    shown = [line["label"] for line in ran.progress]
    assert not any("sweeps" in text for text in shown)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_after_a_kill_the_part_goes_on_without_homing(tmp_path: Path) -> None:
    recipe, runs = "recipes/holder.yaml", tmp_path / "runs"
    with kill_world(
        tmp_path, "recipes/parts/holder.stl", seed=8, speed=10.0, drawing=CELL
    ) as world:
        first = start_on(world, recipe, runs)
        with first:
            for line in lines_of(first):
                if line.get("state") == "inspecting":
                    os.kill(first.pid, signal.SIGKILL)
                    break
        killed = world.when_still()
        assert killed["parts"][0]["custody"] == "arm"
        done = subprocess.run(
            [
                sys.executable, "-m", "controller.cli", "recover", "--json",
                "--cell", str(world.cell), "--runs", str(runs), "--accept", "--why", "as proposed",
            ],
            cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
        )  # fmt: skip
        after = world.when_still()
    said = json.loads(done.stdout.splitlines()[-1]) if done.stdout else done.stderr
    assert (done.returncode, after["parts"][0]["tray"]) == (0, "accept"), said
    assert let_go_count(after) == 1  # over its tray, and nowhere else
    assert after["collisions"] == []
    names = [row.name for row in read_rows(runs / "journal.sqlite")]
    assert "positions_taken_over" in names
    assert "homed_with_part" not in names
    assert first_flaw(runs / "journal.sqlite") is None
