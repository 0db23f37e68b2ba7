"""Gauge studies: nested variances against chance itself, and `cellctl gauge` from end to end."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import view_sets
from scipy import stats

from controller.cell.batch import Papers
from controller.cell.journal.rows import CharacteristicFields
from controller.cell.services.records import measured_row
from controller.cli import main
from controller.config.view_set import load_view_set
from controller.inspection import Verdict
from controller.inspection.characteristics import CharacteristicKind
from controller.results.gauge import Reading, Reference, said_of_all, study_readings
from controller.results.statistics import gauge_study, nested_study
from controller.stored import repeated_sets
from tests.unit import judged_bench as bench
from tests.unit.results_bench import RunWriter, sighting

LEVELS = ("part", "start pose", "grasp", "repeat")
BORE = "diameter 1"


def values_of(
    rng: np.random.Generator, shape: tuple[int, int, int, int], sigmas: tuple[float, ...]
) -> tuple[list[float], list[tuple[int, int, int]]]:
    """Values of a balanced study with known standard deviations, level by level."""
    grid = np.zeros(shape)
    for axis, sigma in enumerate(sigmas):
        drawn = rng.normal(0, sigma, shape[: axis + 1])
        grid = grid + drawn.reshape(drawn.shape + (1,) * (3 - axis))
    groups = [(p, s, g) for p, s, g, _ in np.ndindex(*shape)]
    return grid.ravel().tolist(), groups


# --- variances --------------------------------------------------------------------------------


def test_one_level_is_one_way_analysis_of_variance() -> None:
    rng = np.random.default_rng(2)
    rows = [rng.normal(m, 0.3, 4) for m in (1.0, 1.4, 0.7, 1.2)]
    study = nested_study(
        np.concatenate(rows).tolist(), [(k,) for k in range(4) for _ in range(4)], ("grasp", "look")
    )
    assert study is not None
    between, within = study.components
    ms_within = float(np.mean([row.var(ddof=1) for row in rows]))
    ms_between = 4 * float(np.var([row.mean() for row in rows], ddof=1))
    assert within.variance.value == pytest.approx(ms_within)
    assert between.variance.value == pytest.approx((ms_between - ms_within) / 4)
    assert ms_between / ms_within == pytest.approx(stats.f_oneway(*rows).statistic)
    assert within.variance.lower == pytest.approx(12 * ms_within / stats.chi2.ppf(0.975, 12))
    assert within.variance.upper == pytest.approx(12 * ms_within / stats.chi2.ppf(0.025, 12))


def test_known_variances_are_found_again_in_groups_of_different_sizes() -> None:
    rng, sums, count = np.random.default_rng(3), np.zeros(4), 400
    truth = (4.0, 1.0, 0.25, 0.09)
    held = np.zeros(5)
    for _ in range(count):
        values, groups = [], []
        for part in range(5):
            of_part = rng.normal(0, 2.0)
            for start in range(3):
                of_start = of_part + rng.normal(0, 1.0)
                for grasp in range(2 + part % 2):
                    of_grasp = of_start + rng.normal(0, 0.5)
                    for _ in range(2 + start % 2):
                        values.append(of_grasp + rng.normal(0, 0.3))
                        groups.append((part, start, grasp))
        study = nested_study(values, groups, LEVELS)
        assert study is not None
        gauge = study.variance_below("start pose")
        assert gauge is not None
        held[4] += gauge.lower <= sum(truth[1:]) <= gauge.upper
        for k, component in enumerate(study.components):
            sums[k] += component.variance.value
            held[k] += component.variance.lower <= truth[k] <= component.variance.upper
    assert sums / count == pytest.approx(truth, rel=0.12)
    # 95 % of 400: less than 0.92 would be four standard deviations away
    assert (held / count > 0.91).all()


def test_what_cannot_be_told_apart_is_named_together() -> None:
    study = nested_study([1.0, 2.0, 3.0], [("a", "1", g) for g in "xyz"], LEVELS)
    assert study is not None
    assert [c.levels for c in study.components] == [("grasp", "repeat")]
    assert study.hidden == ("part", "start pose")
    assert study.components[0].variance.value == pytest.approx(1.0)
    once_each = nested_study([1.0, 2.0, 4.0], [(p, "1", "1") for p in "abc"], LEVELS)
    assert once_each is not None
    assert [c.levels for c in once_each.components] == [LEVELS]
    assert nested_study([1.0], [("a", "1", "x")], LEVELS) is None


def test_a_balanced_study_agrees_with_the_crossed_one_on_repeats() -> None:
    values, groups = values_of(np.random.default_rng(5), (6, 3, 1, 4), (1.0, 0.2, 0.0, 0.1))
    nested = nested_study(values, groups, LEVELS)
    cells = np.array(values).reshape(6, 3, 4)
    crossed = gauge_study(cells)
    assert nested is not None
    assert nested.components[-1].variance.value == pytest.approx(
        float(cells.var(axis=2, ddof=1).mean())
    )
    # set-ups of a nested study are those and the interaction of a crossed one
    assert nested.components[1].variance.value == pytest.approx(
        crossed.setup + (crossed.interaction or 0.0), rel=0.5
    )


# --- studies ----------------------------------------------------------------------------------


def report(value: float | None, nominal: float = 8.0, half: float = 0.2) -> CharacteristicFields:
    return CharacteristicFields(
        id=BORE,
        balloon=1,
        kind="diameter",
        label="bore",
        nominal=nominal,
        lower=nominal - half,
        upper=nominal + half,
        source="ISO 2768-m",
        faces=(1,),
        measured=value,
        U=None if value is None else 0.02,
        verdict="pass",
    )


def readings(values: list[float], groups: list[tuple[int, int, int]]) -> list[Reading]:
    return [
        Reading(str(p), str(s), str(g), f"run {k}", (report(v),))
        for k, (v, (p, s, g)) in enumerate(zip(values, groups, strict=True))
    ]


def test_a_study_of_parts_start_poses_grasps_and_repeats() -> None:
    sigmas = (0.05, 0.004, 0.003, 0.002)
    off, groups = values_of(np.random.default_rng(8), (40, 4, 4, 3), sigmas)
    truth = [8.0 + 0.010] * len(off)
    (found,) = study_readings(
        readings([t + o for t, o in zip(truth, off, strict=True)], groups),
        [Reference(BORE, 8.0, 0.001)],
    )
    spreads = (found.in_grasp, found.with_regrasps, found.gauge)
    wanted = [6 * math.hypot(*sigmas[k:]) for k in (3, 2, 1)]
    for spread, six_sigma in zip(spreads, wanted, strict=True):
        assert spread is not None
        assert spread.value == pytest.approx(six_sigma, rel=0.1)
        assert spread.lower < six_sigma < spread.upper
    assert found.tolerance_percent is not None
    assert found.tolerance_percent.value == pytest.approx(100 * wanted[2] / 0.4, rel=0.1)
    assert found.ndc == pytest.approx(1.41 * 0.05 / math.hypot(*sigmas[1:]), rel=0.3)
    assert found.cg == pytest.approx(0.2 * 0.4 / wanted[2], rel=0.1)
    assert found.bias is not None
    assert found.U_bias is not None
    assert abs(found.bias - 0.010) < found.U_bias  # the parts differ, their references do not
    said = said_of_all([found])
    assert said[0] == "40 parts, 160 start poses, 640 grasps, 1920 values."


def test_three_grasps_without_repeats_are_called_so() -> None:
    (found,) = study_readings(readings([8.01, 8.02, 8.03], [(0, 0, g) for g in range(3)]))
    assert found.in_grasp is None
    assert found.ndc is None
    assert found.cg is None
    assert found.with_regrasps is not None
    assert found.with_regrasps.value == pytest.approx(6 * 0.01)
    said = " ".join(said_of_all([found]))
    assert "1 part, 1 start pose, 3 grasps, 3 values." in said
    assert "Re-grasp and repeatability are not told apart: no grasp was measured twice." in said
    assert "One part only" in said
    assert "3 values, 25 are required" in said


def test_parts_measured_once_say_nothing_of_the_gauge() -> None:
    (found,) = study_readings(readings([8.0, 8.1, 7.9], [(p, 0, 0) for p in range(3)]))
    assert found.gauge is None
    assert found.tolerance_percent is None
    assert found.ndc is None


def test_repeats_in_one_grasp_are_no_independent_proof_of_a_bias() -> None:
    values = [8.010, 8.011, 8.009, 8.030, 8.031, 8.029]
    groups = [(0, 0, k // 3) for k in range(6)]
    (found,) = study_readings(readings(values, groups), [Reference(BORE, 8.0, 0.004)])
    assert found.bias == pytest.approx(0.020)
    # two grasps: t of one degree of freedom, 12.706, of the means 8.010 and 8.030
    half = 12.706 * (0.020 / math.sqrt(2)) / math.sqrt(2)
    assert found.U_bias == pytest.approx(math.hypot(half, 0.004), rel=1e-3)


def test_a_missing_value_is_counted() -> None:
    made = readings([8.01, 8.02], [(0, 0, 0), (0, 0, 1)])
    made.append(replace(made[0], grasp="9", characteristics=(report(None),)))
    (found,) = study_readings(made)
    assert found.missing == 1
    assert len(found.values) == 2


# --- the command ------------------------------------------------------------------------------


def write_run(runs: Path, begin: str, values: list[float], serials: tuple[str, ...] = ()) -> None:
    papers = Papers(serials=serials)
    writer = RunWriter(runs, f"{begin}-featuretype", count=len(values), papers=papers)
    for k, value in enumerate(values):
        writer.look(sighting(x_mm=360.0 + 20.0 * k))
        one = bench.measured(
            1, CharacteristicKind.DIAMETER, 8.0, 0.2, value, Verdict.PASS, bench.rim(0.0)
        )
        writer.write(measured_row((replace(one, looks=()),)))
    writer.close()


def lines_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def test_runs_make_a_study_that_is_kept_and_found_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, 8.03])
    write_run(tmp_path, "20260302-120000-000", [8.02, 8.04])
    page = tmp_path / "gauge.html"
    words = ["gauge", "A=20260301", "A=20260302", "--runs", str(tmp_path), "--report", str(page)]
    assert main([*words, "--json"]) == 0
    printed = capsys.readouterr()
    study, end = lines_of(printed.out)
    assert study["n"] == 4
    # each run has the part at x = 360 and at 380: two start poses, two grasps each
    means, within = (8.015, 8.035), 0.01**2 / 2
    between = 2 * float(np.var(means, ddof=1))
    [start, grasp] = study["variances"]
    assert start["levels"] == ["start pose"]
    assert grasp["levels"] == ["grasp", "repeat"]
    assert grasp["variance"]["value"] == pytest.approx(within)
    assert start["variance"]["value"] == pytest.approx((between - within) / 2)
    assert "emulated" in printed.err
    kept = Path(end["file"])
    body = json.loads(kept.read_text())
    assert kept.parent == tmp_path / "gauge"
    assert body["characteristics"][0]["variances"] == study["variances"]
    assert [one["start_pose"] for one in body["inputs"]] == ["1", "2", "1", "2"]
    assert all(len(one["sha256"]["values"]) == 64 for one in body["inputs"])
    text = page.read_text()
    assert kept.name in text
    assert "not told apart" in text
    assert main(["gauge", "--list", "--runs", str(tmp_path)]) == 0
    assert str(kept) in capsys.readouterr().out.replace("\n", "")


def test_serial_numbers_tell_parts_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, 8.11], ("S1", "S2"))
    write_run(tmp_path, "20260302-120000-000", [8.02, 8.12], ("S1", "S2"))
    words = ["gauge", "20260301", "20260302", "--runs", str(tmp_path), "--json"]
    assert main(words) == 0
    study, _ = lines_of(capsys.readouterr().out)
    assert study["variances"][0]["levels"] == ["part", "start pose"]
    assert study["variances"][1]["variance"]["value"] == pytest.approx(0.01**2 / 2)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "name what was measured"),
        (["none.json"], "no run `none.json`"),
        (["A/B/C/D=20260301"], "PART/START/GRASP=SOURCE"),
        (["=20260301"], "PART=SOURCE"),
        (["20260301", "--report", "page.pdf"], "ends in .html"),
        (["20260301", "--reference", "none.csv"], "none.csv: No such file"),
        (["20260301", "--reference", "no_column.csv"], "no_column.csv:1: no column `value`"),
        (["20260301", "--reference", "other.csv"], "other.csv:1: unknown column `sigma`"),
        (["20260301", "--reference", "unknown.csv"], "unknown.csv:2: no characteristic 'bore 9'"),
        (["20260301", "--reference", "text.csv"], "text.csv:2: value is '8.0.1'"),
        (["20260301", "--reference", "below.csv"], "below.csv:2: U is -1"),
        (["20260301", "--reference", "part.csv"], "part.csv:2: no part 'Z' was measured"),
        (["20260301", "--reference", "empty.csv"], "empty.csv: has no reference value"),
    ],
)
def test_a_wrong_input_is_a_sentence(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: list[str],
    says: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, 8.03])
    monkeypatch.chdir(tmp_path)
    for name, text in {
        "no_column": "characteristic,U\n",
        "other": "characteristic,value,sigma\n",
        "unknown": "characteristic,value\nbore 9,8.0\n",
        "text": f"characteristic;value\n{BORE};8.0.1\n",
        "below": f"characteristic,value,U\n{BORE},8.0,-1\n",
        "part": f"characteristic,value,part\n{BORE},8.0,Z\n",
        "empty": "characteristic,value\n",
    }.items():
        Path(f"{name}.csv").write_text(text)
    assert main(["gauge", *words, "--runs", "."]) == 2
    printed = capsys.readouterr()
    assert says in printed.err
    assert len(printed.err.splitlines()) == 1
    assert not (tmp_path / "gauge").exists()


def test_references_give_a_bias(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, 8.03])
    table = tmp_path / "true.csv"
    table.write_text(f"\ufeffcharacteristic;value;U\n{BORE};8.005;0.002\n", encoding="utf-8")
    words = ["gauge", "20260301", "--runs", str(tmp_path), "--reference", str(table), "--json"]
    assert main(words) == 0
    study, _ = lines_of(capsys.readouterr().out)
    assert study["bias"] == pytest.approx(0.015)


def test_a_kept_file_that_is_damaged_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "gauge").mkdir()
    (tmp_path / "gauge" / "a.json").write_text('{"schema": "cellctl.gauge/1"}')
    (tmp_path / "gauge" / "b.json").write_text("[]")
    assert main(["gauge", "--list", "--runs", str(tmp_path)]) == 0
    said = capsys.readouterr().err.replace("\n", " ")
    assert "a.json: is damaged" in said
    assert "b.json: is no gauge study" in said


def test_a_set_whose_views_repeat_is_several_readings_in_one_grasp(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = view_sets.tree()
    tree["views"] = tree["views"][:1]
    again = [{**view, "id": f"{view['id']}b"} for view in tree["views"]]
    path = view_sets.write(tmp_path / "set", tree | {"views": tree["views"] + again})
    once, twice = repeated_sets(load_view_set(path))
    assert [view.id for view in once.views] == [view["id"] for view in tree["views"]]
    assert [view.id for view in twice.views] == [view["id"] for view in again]
    assert main(["gauge", str(path), "--runs", str(tmp_path), "--json"]) == 0
    *studies, end = lines_of(capsys.readouterr().out)
    both = [study for study in studies if study["n"] == 2]
    assert both
    # the very same pictures: nothing scatters
    assert all(study["six_sigma"]["in_grasp"]["value"] == 0 for study in both)
    assert "1 grasp, 2 values." in end["data_allow"][0]
    body = json.loads(Path(end["file"]).read_text())
    digest = hashlib.sha256((tmp_path / "set" / "v00_ring.png").read_bytes()).hexdigest()
    assert body["inputs"][0]["sha256"]["v00_ring.png"] == digest


def test_a_set_of_another_part_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = view_sets.write(tmp_path / "one")
    other = view_sets.write(tmp_path / "other")
    cad = tmp_path / "other" / "shown.stl"
    from cad_solids import mesh_of
    from shown_part import blank

    mesh_of(blank()).export(cad)
    assert main(["gauge", str(one), str(other), "--runs", str(tmp_path)]) == 2
    assert "a study takes one product" in capsys.readouterr().err
