"""One part's whole path through the cell, over the wires, and what it leaves on the disk."""

import json
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from conftest import ROOT, SPEED, Run

from controller.cell.journal import first_broken_row, read_rows

WAY = [
    "resetting", "idle", "acquiring", "recognising", "planning", "grasping", "presenting",
    "inspecting", "handing", "placing", "completing", "complete",
]  # fmt: skip


@pytest.mark.slow(always=True)
def test_a_perfect_part_is_shown_whole_and_lies_in_the_accept_tray(
    start: Callable[..., Run],
) -> None:
    def remember_truth(body: dict[str, Any], run: Run) -> None:
        if body.get("state") in ("complete", "completing"):
            run.seen["truth"] = run.control("truth")

    ran = start("recipes/holder.yaml", "--seed", "5").follow(remember_truth)

    assert ran.code == 0, ran.stderr
    assert ran.result["end"] == "complete"
    (part,) = ran.result["parts"]
    assert part["verdict"] == "pass"
    assert part["tray"] == "accept"
    # compared with the CAD, not merely in sight
    assert part["covered_fraction"] >= 0.5
    (truth,) = ran.seen["truth"]["parts"]
    assert truth["tray"] == "accept"
    assert truth["custody"] == "free"
    states = [line["state"] for line in ran.progress]
    assert [s for s in WAY if s in states] == WAY

    speed = ran.result["speed"]
    assert speed["asked"] == SPEED
    assert 0.0 < speed["reached"] < 1.05 * SPEED
    assert ran.stderr.count("machine is slow") <= 1

    rows = list(read_rows(ran.journal, ran.result["run"]))
    assert rows[0].name == "run_began"
    # what was kept of the run is hashed last of all
    assert [row.name for row in rows[-2:]] == ["run_ended", "files_stored"]
    assert first_broken_row(ran.journal) is None
    custody = [row.name for row in rows if row.kind == "custody"]
    assert custody == ["in_arm", "in_both", "in_fixture", "in_both", "in_arm", "placed"]
    intents = [row.name for row in rows if row.kind == "intent" and row.name != "follow_path"]
    assert intents == ["grip", "hand_off", "release", "take_back", "fixture_release", "sort"]
    views = [row.body for row in rows if (row.kind, row.name) == ("observation", "view")]
    compared = [{face: count for face, count, _ in view["faces"]} for view in views]
    assert sum(compared[0].values()) == views[0]["seen_samples"]
    for before, after, view in zip([{}, *compared], compared, views, strict=False):
        assert all(count <= after[face] for face, count in before.items())
        assert sum(after.values()) >= view["seen_samples"]
    assert all(0 < count <= of for view in views for _, count, of in view["faces"])
    verdict = next(row for row in rows if row.name == "verdict").body
    faces = verdict["faces"]
    assert all(f["reason"] or f["verdict"] != "not evaluated" for f in faces)

    page = (ran.folder / "report.html").read_text()
    assert "EMULATED" in page
    told = subprocess.run(
        [sys.executable, "-m", "controller.cli", "report", "--runs", str(ran.runs), "--json"],
        cwd=ROOT, capture_output=True, text=True, check=True, timeout=600,
    )  # fmt: skip
    assert json.loads(told.stdout)["run"] == ran.result["run"]


@pytest.mark.slow
def test_a_part_without_its_block_is_rejected(start: Callable[..., Run], tmp_path: Any) -> None:
    import trimesh

    whole = trimesh.load(ROOT / "recipes/parts/featuretype.stl")
    cutter = trimesh.creation.box(extents=[70.0, 40.0, 20.0])
    cutter.apply_translation([0.0, 0.0, 35.4])
    spoilt = trimesh.boolean.difference([whole, cutter])
    assert spoilt.is_watertight
    path = tmp_path / "blockless.stl"
    spoilt.export(path)
    ran = start("recipes/featuretype.yaml", "--seed", "2", "--lay", str(path)).follow()
    assert ran.code == 1
    (part,) = ran.result["parts"]
    assert part["verdict"] == "fail", part["reasons"]
    assert part["tray"] == "reject"
