"""The layout of Form 3 of AS9102: its fields, what fills them, and what it does not claim."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from controller.cad import Solid
from controller.cad.compiled import load_part
from controller.cli import main
from controller.results.report import render_form3, render_form3_parts
from controller.results.report.form3 import make_form
from controller.results.run import ResultsError, load_run
from tests.data_files import part_file
from tests.unit import judged_bench as bench
from tests.unit.results_bench import RunWriter, good_run
from tests.unit.test_results_pdf import page_count
from tests.unit.test_results_report import Page

PAPERS = {"part_number": "A-77 <b>", "drawing_number": "D-12", "revision": "C", "gauge_id": "G9"}


@pytest.fixture(scope="module")
def solid() -> Solid:
    return load_part(part_file("flange_xy.stl")).solid


def test_the_form_has_the_fields_of_as9102_in_their_order(tmp_path: Path) -> None:
    text = Page(render_form3_parts([bench.judged(tmp_path, papers=PAPERS)])).text
    text = text[text.index("1. Part number") :]
    places = [text.index(f"{number}. ") for number in range(1, 13)]
    assert places == sorted(places)
    for words in ("1. Part number A-77 <b>", "2. Part name bracket", "3. Serial number SN-0042",
                  "Drawing: D-12", "Revision: C", "Gauge: G9"):  # fmt: skip
        assert words in " ".join(text.split())


def test_each_characteristic_is_accounted_for_by_its_balloon(tmp_path: Path, solid: Solid) -> None:
    judged = bench.judged(tmp_path)
    form = make_form(judged, solid)
    assert [row.number for row in form.rows] == [c.balloon for c in judged.part.characteristics]
    assert form.drawing is not None
    drawn = {b.number for side in form.drawing.sides for c in side.callouts for b in c.balloons}
    for row in form.rows:  # where to look: the view with the balloon, else the faces
        assert row.reference.startswith("view from" if row.number in drawn else "F")


def test_results_are_values_and_what_was_not_measured_is_said(tmp_path: Path) -> None:
    rows = make_form(bench.judged(tmp_path), "no CAD file").rows
    by_number = {row.number: row for row in rows}
    assert by_number[1].requirement == "⌀ 8.000 ± 0.2 mm"
    assert (by_number[1].results, by_number[1].verdict) == ("8.031 mm", "pass")
    assert "U 0.020 (k = 2)" in by_number[1].comments
    assert by_number[9].results == "not measured"
    assert "no view shows the rim" in by_number[9].comments
    assert by_number[4].verdict == "fail"


def test_critical_is_a_designator(tmp_path: Path) -> None:
    judged = bench.judged(tmp_path)
    first, *rest = judged.part.characteristics
    part = replace(
        judged.part, characteristics=(first.model_copy(update={"is_critical": True}), *rest)
    )
    rows = make_form(replace(judged, part=part), "").rows
    assert [row.designator for row in rows[:2]] == ["critical", ""]


def test_a_layout_claims_no_conformity_and_an_emulated_cell_says_so(tmp_path: Path) -> None:
    good_run(tmp_path)
    record = load_run(tmp_path)
    text = " ".join(Page(render_form3(record)).text.split())
    assert "does not claim that the inspection conforms to AS9102" in text
    assert "EMULATED CELL - not a production result" in text
    assert f"4. FAI report identifier {record.run_id}/1" in text


def test_the_command_writes_the_form_beside_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = good_run(tmp_path)
    for form in ("html", "pdf"):
        words = ["report", "--runs", str(tmp_path), "--layout", "as9102", "--format", form]
        assert main(words) == 0
    assert "8. Requirement" in (folder / "report-as9102.html").read_text(encoding="utf-8")
    assert page_count((folder / "report-as9102.pdf").read_bytes()) == 1
    assert not (folder / "report.html").exists()
    capsys.readouterr()
    main(["verify", "--runs", str(tmp_path)])
    assert "report-as9102" not in capsys.readouterr().out  # its hash is in the journal
    assert main(["report", "--runs", str(tmp_path), "--layout", "as9102", "--format", "csv"]) == 2
    assert "use --format html or pdf" in capsys.readouterr().err


def test_a_run_without_a_part_has_no_form(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.end(custody="NONE")
    with pytest.raises(ResultsError, match="has no part"):
        render_form3(load_run(tmp_path))
