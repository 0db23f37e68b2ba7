"""`cellctl recover` after a kill: it reports, opens the gripper it is given, moves nothing else."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from kill_world import ROOT, KillWorld, kill_world, let_go_count, lines_of, start

from controller.cell.journal import first_flaw, read_rows
from controller.results.run import load_run
from controller.results.writing import write_html


def recover(world: KillWorld, runs: Path, *more: str) -> tuple[int, dict[str, Any]]:
    done = subprocess.run(
        [
            sys.executable, "-m", "controller.cli", "recover", "--json",
            "--cell", str(world.cell), "--runs", str(runs), *more,
        ],
        cwd=ROOT, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if not done.stdout:
        return done.returncode, {"error": done.stderr}
    return done.returncode, json.loads(done.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_part_left_in_the_arm_gripper_is_taken_by_a_person(tmp_path: Path) -> None:
    recipe, runs = "recipes/holder.yaml", tmp_path / "runs"
    with kill_world(tmp_path, "recipes/parts/holder.stl", seed=8, speed=10.0) as world:
        first = start(world, recipe, runs)
        with first:
            for line in lines_of(first):
                if line.get("state") == "presenting":
                    os.kill(first.pid, signal.SIGKILL)
                    break
        killed = world.when_still()

        code, said = recover(world, runs)
        assert code == 1
        assert [one["gripper"] for one in said["known"]] == ["arm gripper"]
        assert said["known"][0]["custody"] == "in_arm"
        assert said["openings"][0]["finding"] == "may hold something"
        code, said = recover(world, runs, "--open", "arm")  # nobody is there to answer
        assert code == 2
        assert "--yes" in said["error"]
        looked = world.when_still()
        assert looked["last_motion_s"] == killed["last_motion_s"]
        assert let_go_count(looked) == 0

        code, said = recover(world, runs, "--open", "arm", "--yes")
        assert (code, said["custody"]) == (0, "removed")
        opened = world.when_still()
        wider_mm = opened["openings_mm"]["arm"] - killed["openings_mm"]["arm"]
        assert let_go_count(opened) == 1
        assert wider_mm > 3.0  # 20 mm, or as far as the jaws go
        for name in ("arm", "fixed gripper"):
            assert opened["last_motion_s"][name] == killed["last_motion_s"][name]

        world.ask("remove")
        code, said = recover(world, runs)
        assert (code, said["known"]) == (0, [])
        again = start(world, recipe, runs)
        with again:
            states = [line.get("state") for line in lines_of(again)]
    assert "acquiring" in states
    journal = runs / "journal.sqlite"
    assert first_flaw(journal) is None
    names = [row.name for row in read_rows(journal) if "recover" in row.run]
    assert names.index("open_arm_gripper") < names.index("removed")
    visit = next(row.run for row in read_rows(journal) if row.name == "open_arm_gripper")
    assert write_html(load_run(runs, visit), tmp_path / "visit.html").stat().st_size > 0


def in_both_hands(world: KillWorld) -> bool:
    return bool(world.truth()["parts"][0]["custody"] == "both")


@pytest.mark.slow(always=True)
@pytest.mark.timeout(900)
def test_a_hand_off_that_was_killed_is_undone_and_the_part_ends_in_its_tray(
    tmp_path: Path,
) -> None:
    recipe, runs = "recipes/holder.yaml", tmp_path / "runs"
    with kill_world(tmp_path, "recipes/parts/holder.stl", seed=8, speed=10.0) as world:
        first = start(world, recipe, runs)
        with first:
            for line in lines_of(first):
                if line.get("state") == "handing":
                    while not in_both_hands(world):
                        time.sleep(0.005)
                    os.kill(first.pid, signal.SIGKILL)
                    break
        killed = world.when_still()
        assert in_both_hands(world)
        refused = start(world, recipe, runs)  # nobody at the terminal
        with refused:
            *_, result = lines_of(refused)
        assert (result["end"], result["code"]) == ("refused", "part_may_be_held")
        assert "--auto-recover" in result["message"]

        code, said = recover(world, runs)
        assert code == 1
        assert said["proposal"]["is_proven"]
        assert said["proposal"]["run"] == said["known"][0]["run"]
        assert "fixed gripper opens" in " ".join(said["proposal"]["steps"])
        looked = world.when_still()
        assert looked["last_motion_s"] == killed["last_motion_s"]  # it only looked

        code, said = recover(world, runs, "--accept", "--why", "both grippers hold it")
        after = world.when_still()
    part = after["parts"][0]
    assert (code, part["tray"]) == (0, "accept"), said
    assert let_go_count(after) == 1  # over its tray, and nowhere else
    rows = list(read_rows(runs / "journal.sqlite"))
    decided = next(row.body for row in rows if row.name == "recovery_proposed")
    assert (decided["decision"], decided["why"]) == ("accepted", "both grippers hold it")
    assert "--accept" in decided["who"]
    last = next(row.run for row in reversed(rows) if row.name == "part_done")
    views = {row.body["view"] for row in rows if row.run == last and row.name == "view_pictures"}
    before = {row.body["view"] for row in rows if row.run == decided["run"] and row.name == "view"}
    assert before  # what the killed run had seen
    assert before <= views  # stays seen
    assert first_flaw(runs / "journal.sqlite") is None
    assert load_run(runs, last).parts[0].verdict is not None
