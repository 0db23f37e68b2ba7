"""What would have been found: sizes with 90 % probability, and what a recipe may ask for."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import view_sets
from cad_solids import box, rod, solid_of
from numpy.typing import NDArray

from controller.cad import Solid, SurfaceSamples, sample_surface
from controller.cell.compute.checks import check_defects
from controller.cli import main
from controller.config import ConfigError, load_cell, load_recipe
from controller.config.shipped import EMULATED_CELL
from controller.inspection import (
    OUTLINE,
    Check,
    Detection,
    InspectionLimits,
    PartSettings,
    PosedPart,
    Verdict,
    ViewResult,
    ViewSet,
    judge,
    least_mm,
)
from controller.inspection.detection import detections, in_words, stops
from controller.inspection.part import with_detections

LIMITS = InspectionLimits(smallest_defect_mm=8.0)
METROLOGY_CELL = EMULATED_CELL.with_name("metrology.yaml")


@cache
def plate() -> Solid:
    return solid_of(box(60, 40, 10) - rod(4, 30, 48).translate((15, 5, 0)), "plate")


@cache
def samples() -> SurfaceSamples:
    return sample_surface(plate(), 2.0)


def top() -> NDArray[np.bool_]:
    normals = np.asarray(samples().normals)
    return (normals[:, 2] > 0.99) & (samples().points_mm[:, 2] > 4.9)


def lit(width_mm: float, where: NDArray[np.bool_], name: str = "ring", reason: str = "") -> Check:
    widths = np.where(where, width_mm, np.inf).astype(np.float32)
    smallest = {"dent": widths, "scratch": widths / 2, "stain": widths}
    return Check(name, reason, where, 8.0, smallest_mm=smallest)


def view(*checks: Check, name: str = "v1", evaluated: bool = True) -> ViewResult:
    compared = np.logical_or.reduce([c.compared for c in checks])
    return ViewResult(
        name, evaluated, "" if evaluated else "blurred", np.eye(4), np.eye(4), 0.0, 0.0, 0.1,
        (), compared, np.zeros((0, 2)), checks=checks,
    )  # fmt: skip


def found(*views: ViewResult, asked: dict[str, float] | None = None) -> dict[str, Detection]:
    every = detections(plate(), samples(), views, LIMITS, asked or {})
    return {one.kind: one for one in every}


def area_share(mask: NDArray[np.bool_]) -> float:
    return float(samples().areas_mm2[mask].sum() / samples().areas_mm2.sum())


def test_one_look_finds_the_next_width_in_nine_of_ten_cases() -> None:
    got = found(view(lit(1.2, top())))
    assert got["dent"].share == pytest.approx(area_share(top()))
    assert got["dent"].half_mm == pytest.approx(1.2 * 5 / 3)
    assert got["scratch"].half_mm == pytest.approx(0.6 * 5 / 3)
    assert found(view(lit(1.2, top())), asked={"dent": 1.9})["dent"].share == 0.0


def test_four_looks_at_even_chances_find_what_one_does_not() -> None:
    # 1 - 0.5 ** 4 is above 0.9, 1 - 0.5 ** 3 is not
    three = [view(lit(1.2, top()), name=f"v{k}") for k in range(3)]
    assert found(*three)["dent"].half_mm == pytest.approx(2.0)
    assert found(*three, view(lit(1.5, top()), name="v4"))["dent"].half_mm == pytest.approx(1.5)


def test_dust_is_no_dent_however_sharp_the_look() -> None:
    many = [view(lit(0.1, top()), name=f"v{k}") for k in range(5)]
    assert found(*many)["dent"].half_mm == LIMITS.dust_mm
    assert found(*many)["scratch"].half_mm == pytest.approx(0.05)


def test_what_failed_its_self_check_finds_nothing() -> None:
    assert found(view(lit(1.0, top()), evaluated=False)) == {}
    dark = lit(1.0, top(), "side", reason="lamp dead")
    got = found(view(dark, lit(2.0, top())))
    assert got["dent"].half_mm == pytest.approx(2.0 * 5 / 3)


def test_chips_and_burrs_are_found_at_compared_edges_only() -> None:
    x = samples().points_mm[:, 0]
    outline = Check(OUTLINE, "", x > 0, 0.4, 1.1)  # 0.4 mm off over 1.1 mm passes unnoticed
    got = found(view(outline))
    # six pixels long, and deeper than the outline's limit with 1.28 of its five sigmas more
    assert got["chip"].half_mm == pytest.approx(max(1.1, 2 * 1.25 * 0.4))
    assert got["burr"].half_mm == pytest.approx(max(1.1 / 2, 1.25 * 0.4))
    # half of the outer edges is at x > 0, and all of the bore's; both count
    assert 0.5 < got["chip"].share < 0.65
    assert got["dent"].share == 0.0
    assert got["dent"].half_mm is None


def test_what_the_recipe_asks_and_would_not_be_found_is_named_face_by_face() -> None:
    views = view(lit(1.2, top()))
    got = found(views, asked={"dent": 2.5})
    open_faces = {i for i, _ in got["dent"].open_faces}
    assert open_faces == set(np.unique(samples().face_ids).tolist()) - set(
        np.unique(samples().face_ids[top()]).tolist()
    )
    (sentence,) = stops(tuple(got.values()), plate())
    assert sentence.startswith("dents and pits of 2.5 mm, which the recipe asks for")
    assert all(plate().faces[i].label in sentence for i in sorted(open_faces))
    left_out = dict.fromkeys(open_faces, "gauged elsewhere")
    every = detections(plate(), samples(), [views], LIMITS, {"dent": 2.5}, left_out)
    assert stops(every, plate()) == ()
    assert stops(tuple(found(views).values()), plate()) == ()  # nobody asked


def test_it_is_said_in_words() -> None:
    words = in_words((Detection("dent", 2.5, 0.724, 1.93), Detection("chip", 3.0, 0.0, None)))
    assert words == (
        "found with 90 % probability: dents and pits of 2.5 mm on 72 % of the surface "
        "(half of that: 1.9 mm); chips of 3 mm on 0 % of the edges"
    )
    assert in_words(()) == ""


def test_a_view_says_nothing_of_samples_it_does_not_count_for() -> None:
    half = samples().points_mm[:, 0] > 0
    narrowed = view(lit(1.2, top())).within(half)
    assert found(narrowed)["dent"].share == pytest.approx(area_share(top() & half))


# --- recipes ----------------------------------------------------------------------------------


def recipe(folder: Path, find: str) -> Path:
    (folder / "block.stl").write_bytes(b"solid")
    path = folder / "block.yaml"
    path.write_text(f"name: block\npart: block.stl\ninspection:\n  find: {find}\n")
    return path


def test_a_cell_refuses_what_it_cannot_find_and_names_what_it_can(tmp_path: Path) -> None:
    asked = load_recipe(recipe(tmp_path, "{dent: 0.6, scratch: 3.0, chip: 0.5}"))
    problems = check_defects(asked, load_cell(EMULATED_CELL))
    # 955 mm before a lens of 3733 px: no chip below six pixels
    pixel = 950 / 3733
    assert len(problems) == 2
    assert "`inspection.find`: dent of 0.6 mm is smaller than this cell can find" in problems[0]
    assert "chip of 0.5 mm" in problems[1]
    assert least_mm("chip", pixel) == pytest.approx(6 * pixel)
    assert check_defects(asked, load_cell(METROLOGY_CELL)) == ()


def test_the_number_that_a_refusal_names_is_accepted(tmp_path: Path) -> None:
    cell = load_cell(EMULATED_CELL)
    for kind in ("dent", "scratch", "stain", "chip", "burr"):
        (problem,) = check_defects(load_recipe(recipe(tmp_path, f"{{{kind}: 0.01}}")), cell)
        number = problem.split("it finds ")[1].split(" mm")[0]
        assert check_defects(load_recipe(recipe(tmp_path, f"{{{kind}: {number}}}")), cell) == ()


@pytest.mark.parametrize(
    ("find", "says"), [("{rust: 1.0}", "find.rust"), ("{dent: 0}", "find.dent"), ("2.0", "find")]
)
def test_a_wrong_wish_is_refused_by_its_line(tmp_path: Path, find: str, says: str) -> None:
    with pytest.raises(ConfigError, match=f"block.yaml:4: `inspection.{says}"):
        load_recipe(recipe(tmp_path, find))


def test_a_set_that_would_not_show_what_is_asked_never_passes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = view_sets.write(tmp_path / "set")
    wish = path.with_name("shown.yaml")
    wish.write_text("name: shown\npart: shown.stl\ninspection: {find: {stain: 0.2}}\n")
    assert main(["inspect", str(path), "--recipe", str(wish), "--json"]) == 1
    end = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert end["verdict"] != "pass"
    stain = next(one for one in end["found"] if one["kind"] == "stain")
    assert stain["asked"] is True
    assert stain["share"] == 0.0
    assert stain["open_faces"]
    assert any("stains of 0.2 mm, which the recipe asks for" in r for r in end["reasons"])


def test_a_kind_that_is_asked_stops_a_pass_and_a_stated_one_does_not() -> None:

    limits = replace(LIMITS, smallest_defect_mm=8.0)
    views = (view(lit(1.2, np.ones(len(samples().points_mm), dtype=bool))),)
    ledger = judge(plate(), samples(), views, {}, 0.9, limits)
    assert ledger.verdict is Verdict.PASS
    held = ViewSet(PosedPart(plate()), samples(), ())
    stated = with_detections(held, views, ledger, PartSettings(limits))
    assert stated.verdict is Verdict.PASS
    assert [one.kind for one in stated.detections][:3] == ["chip", "burr", "dent"]
    assert any("dents and pits of 8 mm on 100 %" in reason for reason in stated.reasons)
    asked = with_detections(held, views, ledger, PartSettings(limits, find_mm={"dent": 1.5}))
    assert asked.verdict is Verdict.INDETERMINATE
    assert asked.reasons[0].startswith("dents and pits of 1.5 mm")
