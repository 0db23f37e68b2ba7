"""Whole runs on GigE Vision cameras: every picture comes over UDP, and aravis reads it."""

from __future__ import annotations

import re
from collections.abc import Callable
from ctypes.util import find_library
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Ran, Run, once_in

CELL = ROOT / "recipes" / "cells" / "genicam.yaml"
CAMERAS = ("overhead", "inspection")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(find_library("aravis-0.8") is None, reason="libaravis-0.8 is not installed"),
]


def is_sorted_right(ran: Ran) -> None:
    """Check that the perfect part has passed and lies in the tray for it."""
    assert ran.code == 0, ran.stderr
    (part,) = ran.result["parts"]
    assert (part["verdict"], part["tray"]) == ("pass", "accept"), part
    assert part["covered_fraction"] >= 0.5
    (truth,) = ran.seen["truth"]["parts"]
    assert (truth["tray"], truth["custody"]) == ("accept", "free")


def remember_truth(body: dict[str, Any], run: Run) -> None:
    if body.get("state") in ("complete", "completing"):
        run.seen["truth"] = run.control("truth")


def test_a_perfect_part_passes_on_gige_vision_cameras(start: Callable[..., Run]) -> None:
    ran = start("recipes/holder.yaml", "--cell", str(CELL), "--seed", "5").follow(remember_truth)
    is_sorted_right(ran)


def test_a_perfect_part_passes_on_pictures_of_12_bits(
    start: Callable[..., Run], tmp_path: Path
) -> None:
    cell = tmp_path / "deep.yaml"
    text = CELL.read_text(encoding="utf-8")
    assert text.count("formats: [GREY, YUYV]") == 2
    cell.write_text(text.replace("formats: [GREY, YUYV]", "formats: [Y12]"), encoding="utf-8")
    ran = start("recipes/holder.yaml", "--cell", str(cell), "--seed", "6").follow(remember_truth)
    is_sorted_right(ran)


def test_packets_and_frames_that_are_lost_cost_no_part(start: Callable[..., Run]) -> None:
    def harm(run: Run) -> None:
        for camera in CAMERAS:
            run.control("camera", camera=camera, lost_per_thousand=3, short_count=1, lost_count=1)

    harming = once_in("acquiring", harm)

    def watch(body: dict[str, Any], run: Run) -> None:
        harming(body, run)
        remember_truth(body, run)

    ran = start("recipes/holder.yaml", "--cell", str(CELL), "--seed", "7").follow(watch)
    is_sorted_right(ran)


def test_a_network_cable_pulled_out_is_named_by_its_address_and_the_part_stays_held(
    start: Callable[..., Run],
) -> None:
    ran = start("recipes/holder.yaml", "--cell", str(CELL), "--seed", "4").follow(
        once_in("presenting", lambda run: run.control("unplug", camera="inspection"))
    )
    assert ran.code == 1, ran.stderr
    assert re.match(r"camera 127\.0\.\d+\.\d+: .*cable", ran.result["message"]), ran.result
    assert "in the arm gripper" in ran.result["where"]
