"""Statistics over parts and of the gauge, against published data and against chance itself."""

from __future__ import annotations

import json
import math
import sqlite3
from dataclasses import replace
from pathlib import Path

import lxml.html
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.cell.journal import rows
from controller.cell.services.records import measured_row
from controller.cli import main
from controller.inspection import Verdict
from controller.inspection.characteristics import CharacteristicKind
from controller.results.run import ResultsError
from controller.results.statistics import (
    bias_of,
    capability,
    gauge_study,
    nelson_signals,
    run_chart,
    series_json,
    series_of,
)
from controller.results.statistics.capability import moving_range_freedom
from tests.unit import judged_bench as bench
from tests.unit.results_bench import RunWriter, sighting

# references.md S23: ten parts, three appraisers (rows of three trials)
AIAG = """
 0.29 -0.56  1.34  0.47 -0.80  0.02  0.59 -0.31  2.26 -1.36
 0.41 -0.68  1.17  0.50 -0.92 -0.11  0.75 -0.20  1.99 -1.25
 0.64 -0.58  1.27  0.64 -0.84 -0.21  0.66 -0.17  2.01 -1.31
 0.08 -0.47  1.19  0.01 -0.56 -0.20  0.47 -0.63  1.80 -1.68
 0.25 -1.22  0.94  1.03 -1.20  0.22  0.55  0.08  2.12 -1.62
 0.07 -0.68  1.34  0.20 -1.28  0.06  0.83 -0.34  2.19 -1.50
 0.04 -1.38  0.88  0.14 -1.46 -0.29  0.02 -0.46  1.77 -1.49
-0.11 -1.13  1.09  0.20 -1.07 -0.67  0.01 -0.56  1.45 -1.77
-0.15 -0.96  0.67  0.11 -1.45 -0.49  0.21 -0.49  1.87 -2.16
"""
# references.md S24: flow rate of ten batches
FLOW_RATES = (49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1)


def aiag() -> np.ndarray:
    table = np.array(AIAG.split(), dtype=float).reshape(3, 3, 10)
    return table.transpose(2, 0, 1)  # parts, appraisers, trials


# --- gauge ------------------------------------------------------------------------------------


def test_the_aiag_study_comes_out_as_published() -> None:
    study = gauge_study(aiag())
    assert study.repeatability == pytest.approx(0.039973, abs=5e-7)
    assert study.setup == pytest.approx(0.051455, abs=5e-7)
    assert study.part == pytest.approx(1.086447, abs=5e-7)
    assert study.interaction is None  # p of 0.97: pooled
    assert study.grr_percent == pytest.approx(27.9, abs=0.05)
    assert study.ndc == 4


def test_the_order_of_parts_and_of_set_ups_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    shuffled = aiag()[rng.permutation(10)][:, rng.permutation(3)]
    assert gauge_study(shuffled).grr == pytest.approx(gauge_study(aiag()).grr)


def test_known_variances_are_found_again() -> None:
    rng = np.random.default_rng(7)
    shape = (60, 12, 4)
    part = rng.normal(0, 1.0, (60, 1, 1))
    setup = rng.normal(0, 0.3, (1, 12, 1))
    both = rng.normal(0, 0.2, (60, 12, 1))
    study = gauge_study(part + setup + both + rng.normal(0, 0.1, shape), tolerance=6.0)
    assert study.repeatability == pytest.approx(0.01, rel=0.1)
    assert study.interaction == pytest.approx(0.04, rel=0.15)
    assert study.part == pytest.approx(1.0, rel=0.45)
    assert study.setup == pytest.approx(0.09, rel=0.7)
    assert study.tolerance_percent == pytest.approx(100 * math.sqrt(study.grr), rel=1e-9)


@pytest.mark.parametrize("shape", [(1, 3, 3), (3, 1, 3), (3, 3, 1), (3, 3)])
def test_a_study_of_too_little_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="at least two of each"):
        gauge_study(np.zeros(shape))


def test_a_study_with_a_hole_is_refused() -> None:
    values = aiag()
    values[3, 1, 2] = np.nan
    with pytest.raises(ValueError, match="no value missing"):
        gauge_study(values)


def test_a_bias_is_seen_only_beyond_its_interval() -> None:
    # mean 6.0067 and s 0.2120 of fifteen values, the AIAG manual's example of a bias (S23)
    values = (5.8, 5.7, 5.9, 5.9, 6.0, 6.1, 6.0, 6.1, 6.4, 6.3, 6.0, 6.1, 6.2, 5.6, 6.0)
    bias = bias_of(values, 6.0)
    assert bias.bias == pytest.approx(0.0067, abs=5e-5)
    assert bias.sigma == pytest.approx(0.2120, abs=5e-5)
    # t of 14 degrees of freedom at 97.5 % is 2.145
    assert bias.upper - bias.bias == pytest.approx(2.145 * 0.2120 / math.sqrt(15), abs=1e-4)
    assert not bias.is_significant
    assert bias_of(values, 5.8).is_significant


# --- charts -----------------------------------------------------------------------------------


def test_limits_of_control_come_out_as_published() -> None:
    chart = run_chart(FLOW_RATES)
    assert chart is not None
    assert chart.mean == pytest.approx(50.81)
    assert chart.mean_range == pytest.approx(1.8778, abs=5e-5)
    # with d2 = 1.128, three digits of 2 / sqrt(pi)
    assert chart.upper == pytest.approx(55.8041, abs=2e-3)
    assert chart.lower == pytest.approx(45.8159, abs=2e-3)
    # D4 of two values is 3.267
    assert chart.upper_range == pytest.approx(3.267 * 1.8778, abs=2e-3)
    assert chart.signals == ()


def test_one_value_has_no_chart() -> None:
    assert run_chart([1.0]) is None


def rules(values: list[float]) -> list[tuple[int, int]]:
    return [(s.rule, s.at) for s in nelson_signals(np.array(values, dtype=float), 0.0, 1.0)]


def test_each_rule_sees_its_own_pattern_and_no_less() -> None:
    assert rules([0.5, -3.1, 0.2]) == [(1, 1)]
    assert rules([0.5, -2.9, 0.2]) == []
    nine = [0.5, 0.4, 0.6, 0.5, 0.7, 0.3, 0.6, 0.4, 0.5]
    assert rules(nine) == [(2, 8)]
    assert rules(nine[:8]) == []
    assert rules([-1.5, -1.0, -0.2, 0.1, 0.8, 1.2]) == [(3, 5)]
    assert rules([1.5, 1.0, 0.2, -0.1, -0.8]) == []
    zigzag = [0.5, -0.4] * 7
    assert rules(zigzag) == [(4, 13)]
    assert rules(zigzag[:13]) == []


@given(st.lists(st.floats(-5, 5), min_size=2, max_size=60))
def test_a_mirrored_process_breaks_the_same_rules(values: list[float]) -> None:
    mirrored = [-v for v in values]
    assert rules(values) == rules(mirrored)


# --- capability -------------------------------------------------------------------------------


def with_moments(n: int, mean: float, sigma: float) -> np.ndarray:
    x = np.random.default_rng(3).normal(size=n)
    return mean + sigma * (x - x.mean()) / x.std(ddof=1)


def test_indices_come_out_as_published() -> None:
    # references.md S24: limits 8 and 20, mean 16, sigma 2
    found = capability(with_moments(50, 16.0, 2.0), 8.0, 20.0)
    assert found.pp is not None
    assert found.ppk is not None
    assert found.pp.value == pytest.approx(1.0)
    assert found.ppk.value == pytest.approx(0.6667, abs=5e-5)
    # chi-square of 49 degrees of freedom at 2.5 and 97.5 %, from tables: 31.555 and 70.222
    assert found.pp.lower == pytest.approx(math.sqrt(31.555 / 49), abs=1e-4)
    assert found.pp.upper == pytest.approx(math.sqrt(70.222 / 49), abs=1e-4)


def test_few_values_have_no_index() -> None:
    found = capability(with_moments(24, 16.0, 2.0), 8.0, 20.0)
    assert (found.cp, found.cpk, found.pp, found.ppk) == (None, None, None, None)
    assert found.note == "24 values, 25 are required"
    assert capability(with_moments(25, 16.0, 2.0), 8.0, 20.0).ppk is not None


def test_a_limit_on_one_side_has_no_width() -> None:
    found = capability(with_moments(40, 0.05, 0.01), None, 0.1)
    assert found.cp is found.pp is None
    assert found.ppk is not None
    assert found.ppk.value == pytest.approx(0.05 / 0.03)
    with pytest.raises(ValueError, match="a limit"):
        capability([1.0], None, None)


def test_equal_values_are_no_perfect_process() -> None:
    found = capability([5.0] * 30, 4.0, 6.0)
    assert found.ppk is None
    assert "no spread" in found.note


def test_values_that_are_not_normal_are_called_so() -> None:
    skewed = np.random.default_rng(5).exponential(size=100)
    assert "not normal" in capability(skewed, -1.0, 9.0).note
    assert capability(with_moments(100, 0.0, 1.0), -4.0, 4.0).note == ""


def test_a_drift_shows_between_both_indices() -> None:
    drifting = np.linspace(-3, 3, 60) + with_moments(60, 0.0, 0.2)
    found = capability(drifting, -4.0, 4.0)
    assert found.cpk is not None
    assert found.ppk is not None
    assert found.cpk.value > 3 * found.ppk.value


def test_moving_ranges_have_the_freedom_that_chance_gives_them() -> None:
    n, rng = 40, np.random.default_rng(11)
    ranges = np.abs(np.diff(rng.normal(size=(20_000, n)), axis=1)).mean(axis=1)
    relative = ranges.std() / ranges.mean()
    # a standard deviation with v degrees of freedom has a relative one of its own of 1 / sqrt(2 v)
    assert moving_range_freedom(n) == pytest.approx(1 / (2 * relative**2), rel=0.03)


def test_intervals_hold_the_true_index_as_often_as_they_say() -> None:
    rng, hits, count = np.random.default_rng(13), np.zeros(4), 600
    truth = 4.0 / 3.0
    for _ in range(count):
        found = capability(rng.normal(size=50), -4.0, 4.0)
        for i, index in enumerate((found.cp, found.cpk, found.pp, found.ppk)):
            assert index is not None
            hits[i] += index.lower <= truth <= index.upper
    # two-sided 95 %; the nearer side is chosen, which costs a little on Cpk and Ppk
    assert (hits / count > 0.91).all()
    assert (hits / count < 0.985).all()


# --- history ----------------------------------------------------------------------------------


def write_run(runs: Path, begin: str, values: list[float | None], **changes: object) -> None:
    writer = RunWriter(runs, f"{begin}-featuretype", count=len(values), **changes)  # type: ignore[arg-type]
    for value in values:
        writer.look(sighting())
        one = bench.measured(
            1, CharacteristicKind.DIAMETER, 8.0, 0.2, value,
            Verdict.NOT_EVALUATED if value is None else Verdict.PASS, bench.rim(0.0),
        )  # fmt: skip
        writer.write(measured_row((replace(one, looks=()),)))
    writer.close()


def test_values_are_collected_over_runs_in_the_order_measured(tmp_path: Path) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, None, 8.03])
    write_run(tmp_path, "20260302-120000-000", [7.99])
    write_run(tmp_path, "20260303-120000-000", [9.9], name="other")
    (series,) = series_of(tmp_path, "featuretype")
    assert [v.measured for v in series.values] == [8.01, 8.03, 7.99]
    assert [v.part for v in series.values] == [1, 3, 1]
    assert series.missing == 1
    body = series_json(series)
    assert body["n"] == 3
    assert body["cpk"] is None
    assert body["note"] == "3 values, 25 are required"
    assert body["chart"]["mean_range"] == pytest.approx(0.03)


def test_how_arm_and_camera_agree_is_a_series_of_its_own(tmp_path: Path) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01])
    writer = RunWriter(tmp_path, "20260302-120000-000-featuretype", count=1)
    writer.look(sighting())
    views = [rows.ViewOffFields(view=f"v{i}", grasp=0, off_mm=0.4, off_deg=0.0) for i in range(3)]
    writer.write(rows.ViewsPosed(views=tuple(views)))
    writer.close()
    *_, series = series_of(tmp_path, "featuretype")
    assert series.id == "arm against station camera"
    assert [v.measured for v in series.values] == pytest.approx([0.4])
    assert series.upper == 0.3  # beyond which calibrations are stale, docs/commissioning.md


def test_an_unknown_recipe_is_answered_with_those_there_are(tmp_path: Path) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01])
    with pytest.raises(ResultsError, match=r"no run of the recipe `bracket`.*featuretype"):
        series_of(tmp_path, "bracket")
    with pytest.raises(ResultsError, match="no journal"):
        series_of(tmp_path / "nowhere", "bracket")


def test_a_journal_that_was_changed_makes_no_statistics(tmp_path: Path) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01, 8.02])
    db = sqlite3.connect(tmp_path / "journal.sqlite")
    db.execute("DROP TRIGGER journal_keeps_rows")
    db.execute("UPDATE journal SET body = replace(body, '8.01', '8.00') WHERE body LIKE '%8.01%'")
    db.commit()
    db.close()
    with pytest.raises(ResultsError, match="chain of hashes breaks"):
        series_of(tmp_path, "featuretype")


def test_the_command_prints_a_line_for_each_characteristic(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = [round(8.0 + 0.01 * math.sin(2.1 * i), 4) for i in range(26)]
    write_run(tmp_path, "20260301-120000-000", list(values))
    assert main(["stats", "featuretype", "--runs", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    found = capability(values, 7.8, 8.2)
    assert found.ppk is not None
    assert f"{found.ppk.value:.2f} ({found.ppk.lower:.2f} to {found.ppk.upper:.2f})" in out
    assert main(["stats", "featuretype", "--runs", str(tmp_path), "--json"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    body = json.loads(line)
    assert (body["event"], body["n"]) == ("characteristic", 26)
    assert body["ppk"]["value"] == pytest.approx(found.ppk.value)
    assert main(["stats", "bracket", "--runs", str(tmp_path)]) == 1
    assert "no run of the recipe `bracket`" in capsys.readouterr().err


def test_the_page_draws_every_value_with_its_limits_and_marks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    values = [8.0 + 0.01 * (-1) ** i for i in range(30)]
    values[20] = 8.15  # beyond three standard deviations, within the limits
    write_run(tmp_path, "20260301-120000-000", list(values))
    page = tmp_path / "out" / "series.html"
    assert main(["stats", "featuretype", "--runs", str(tmp_path), "--report", str(page)]) == 0
    assert f"report: {page}" in capsys.readouterr().out.replace("\n", "")
    root = lxml.html.fromstring(page.read_text())
    of_values, of_ranges = root.findall(".//svg")
    dots = of_values.findall("circle") + of_values.findall("path[@class='mark']")
    assert len(dots) == 30
    marks = [t.text for t in of_values.findall("text[@class='mark']")]
    assert any("1" in mark.split(", ") for mark in marks)
    names = [t.text for t in of_values.findall("text")]
    assert {"upper limit", "lower limit", "control"} <= set(names)
    assert len(of_ranges.findall("circle") + of_ranges.findall("path[@class='mark']")) == 29
    # a value stands between the limits in proportion: limits 7.8 and 8.2
    level = {
        round(float(t.text), 3): float(t.get("y")) - 4
        for t in of_values.findall("text[@class='n']")
    }
    first = float(of_values.findall("circle")[0].get("cy"))
    share = (first - level[8.2]) / (level[7.8] - level[8.2])
    assert share == pytest.approx((8.2 - values[0]) / 0.4, abs=0.01)
    found = capability(values, 7.8, 8.2)
    assert found.cpk is not None
    assert f"{found.cpk.value:.2f} ({found.cpk.lower:.2f}" in root.text_content()


def test_a_page_of_one_value_or_none_is_drawn_all_the_same(tmp_path: Path) -> None:
    write_run(tmp_path, "20260301-120000-000", [8.01])
    write_run(tmp_path, "20260302-120000-000", [None], name="other")
    for name, says in (("featuretype", "1 values, 25 are required"), ("other", "No part has")):
        page = tmp_path / f"{name}.html"
        assert main(["stats", name, "--runs", str(tmp_path), "--report", str(page)]) == 0
        assert says in page.read_text()
    assert main(["stats", "other", "--runs", str(tmp_path), "--report", "page.pdf"]) == 2
