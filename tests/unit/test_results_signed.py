"""The pages that a person signs: what stands on them, and that it stands in the right place."""

from __future__ import annotations

import base64
import hashlib
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import stored_run

from controller.cad import Solid
from controller.cad.compiled import load_part
from controller.cell.batch import Papers
from controller.cell.journal.rows import CharacteristicFields, FaceJudged
from controller.cell.services.records import measured_row
from controller.cli import main
from controller.inspection import Detection, Verdict
from controller.inspection.characteristics import CharacteristicKind
from controller.results.judged import judged_parts, result_json
from controller.results.report import report_json
from controller.results.report.html import PART_BYTES, render_parts
from controller.results.report.signed import MAX_LOOKS
from controller.results.report.signed.covering import COLOURS, coverage_sides
from controller.results.report.signed.table import briefly, rows_of
from controller.results.run import PartFold, load_run
from tests.data_files import part_file
from tests.unit import judged_bench as bench
from tests.unit.results_bench import RunWriter, sighting
from tests.unit.test_results_report import Page


@pytest.fixture(scope="module")
def solid() -> Solid:
    return load_part(part_file("flange_xy.stl")).solid


def reports(tmp_path: Path) -> tuple[CharacteristicFields, ...]:
    return bench.judged(tmp_path).part.characteristics


def test_verdict_and_why_come_first_and_details_last(tmp_path: Path) -> None:
    made = bench.inspection(verdict=Verdict.FAIL, reasons=("length 4 is too long", "a chip"))
    text = Page(render_parts([bench.judged(tmp_path, made)])).text
    order = ["Inspection report", "Length 4 is too long", "SN-0042", "Characteristics:",
             "Reviewed by", "Coverage", "Characteristics, look by look", "Ledger"]  # fmt: skip
    places = [text.index(words) for words in order]
    assert places == sorted(places)


def test_who_what_and_with_what_stand_in_the_header(tmp_path: Path) -> None:
    text = Page(render_parts([bench.judged(tmp_path)])).text
    for words in ("Serial number SN-0042", "Lot L7", "Operator R. Meyer", "bracket.step (cccccc",
                  "bracket.yaml (aaaaaa", "inspection 2026-02-20", "cellctl 0.1.0"):  # fmt: skip
        assert words in text
    assert "Part temperature not measured" in text  # never a made-up number
    known = bench.judged(tmp_path, part_temperature_c=21.46)
    assert "Part temperature 21.5 °C" in Page(render_parts([known])).text


def test_every_characteristic_has_its_row(tmp_path: Path) -> None:
    page = Page(render_parts([bench.judged(tmp_path)]))
    header, *rows = page.table("Balloon")
    cells = [dict(zip(header, row, strict=True)) for row in rows]
    assert [c["Balloon"] for c in cells] == [str(i) for i in range(1, 10)]
    assert cells[0]["Requirement"] == "⌀ 8.000 ± 0.2 mm"
    assert (cells[0]["Limits"], cells[0]["Actual"]) == ("7.800 … 8.200", "8.031")
    assert (cells[0]["Deviation"], cells[0]["U (k = 2)"]) == ("+0.031", "0.020")
    assert cells[1]["Requirement"] == "pos. ≤ 0.150 mm"
    assert cells[6]["Actual"] == "90.100"
    assert [c["Status"] for c in cells] == [
        "pass", "pass", "indeterminate", "fail", "pass", "pass", "pass", "pass", "not evaluated",
    ]  # fmt: skip
    assert cells[8]["Actual"] == "–"
    # the reason is in the row itself, which no engine breaks over two pages
    assert "0.410 mm beyond the upper limit" in cells[3]["Characteristic"]
    assert "no view shows the rim at less than 30 deg" in page.text


def test_a_bar_has_the_value_where_it_is_between_the_limits(tmp_path: Path) -> None:
    rows = rows_of(reports(tmp_path))
    # 7.8 at 20, 8.2 at 80: 8.031 at 20 + 60 * 0.231 / 0.4
    assert rows[0].bar.at == pytest.approx(54.65)
    assert rows[0].bar.high - rows[0].bar.low == pytest.approx(60 * 0.04 / 0.4)
    assert rows[0].bar.nominal == pytest.approx(50.0)
    (left, width), (right, _) = rows[0].bar.zones
    # one standard deviation is 1.5 wide; 95 % of a normal distribution lie below 1.645 of them
    assert (left, left + width) == pytest.approx((20 - 2.47, 20 + 2.47), abs=0.01)
    assert right == pytest.approx(80 - 2.47, abs=0.01)
    assert not rows[2].bar.is_off
    assert rows[3].bar.is_off  # 0.41 beyond a tolerance of 0.6
    assert rows[3].bar.at == 98.0
    assert len(rows[1].bar.zones) == 1  # no position is below 0
    assert rows[8].bar.at is None


def test_a_crop_shows_rays_points_and_the_fitted_shape_where_they_were(tmp_path: Path) -> None:
    one = bench.all_kinds()[0]
    page = Page(render_parts([bench.judged(tmp_path, bench.inspection((one,)))]))
    paths = {p.get("class"): p for p in page.all("path")}
    fitted = np.array(re.findall(r"[\d.]+", paths["fitted"]["d"]), dtype=float).reshape(-1, 2)
    assert fitted.mean(axis=0) == pytest.approx((320.5, 240.5), abs=0.1)
    assert np.linalg.norm(fitted - 320.5 * np.eye(2)[0] - 240.5 * np.eye(2)[1], axis=1) == (
        pytest.approx(60, abs=0.1)
    )
    assert paths["used"]["d"].count("M") == 23
    assert paths["refused"]["d"].count("M") == 1
    assert paths["rays"]["d"].count("M") == 24
    assert "23 of 24 edge points used" in page.text
    # the rim is 4 mm and 60 px in radius
    bars = [float(b["x2"]) - float(b["x1"]) for b in page.all("line") if b["stroke"] == "#111"]
    assert bars[0] == pytest.approx(15.0, abs=0.02)


def test_a_finding_has_its_border_and_its_verdict(tmp_path: Path) -> None:
    made = bench.inspection(findings=(bench.chip(),), verdict=Verdict.FAIL, reasons=("a chip",))
    page = Page(render_parts([bench.judged(tmp_path, made)]))
    header, row = page.table("No.")
    cells = dict(zip(header, row, strict=True))
    assert (cells["Kind"], cells["Verdict"], cells["Light"]) == ("chip", "fail", "ring")
    borders = [p["d"] for p in page.all("path") if p.get("class") == "border"]
    assert borders == ["M400.5 200.5L430.5 200.5L430.5 225.5L400.5 225.5Z"]


def test_names_from_a_drawing_stay_text(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>\"'><svg onload=x>"
    one = bench.measured(
        1, CharacteristicKind.DIAMETER, 8.0, 0.2, 8.0, Verdict.INDETERMINATE, bench.rim(0.0),
        label=evil, reason=evil,
    )  # fmt: skip
    made = bench.inspection((one,), reasons=(evil,))
    page = Page(render_parts([bench.judged(tmp_path, made, serial=evil, operator=evil, lot=evil)]))
    assert evil in page.text
    assert "script" not in {name for name, _ in page.tags}
    assert not any(key.startswith("on") for _, attributes in page.tags for key in attributes)


def test_paper_leaves_out_what_opens_on_demand(tmp_path: Path) -> None:
    judged = bench.judged(tmp_path)
    assert "look by look" in Page(render_parts([judged])).text
    paper = Page(render_parts([judged], on_paper=True))
    assert "look by look" not in paper.text
    assert "Reviewed by" in paper.text


def test_of_many_parts_only_those_that_did_not_pass_are_shown_look_by_look(tmp_path: Path) -> None:
    passed = bench.judged(tmp_path)
    failed = bench.judged(tmp_path, bench.inspection(verdict=Verdict.FAIL, reasons=("a chip",)))
    few = render_parts([*[passed] * 9, failed])
    many = render_parts([*[passed] * 10, failed])
    assert Page(few).text.count("Characteristics, look by look") == 10
    assert Page(many).text.count("Characteristics, look by look") == 1
    assert "are not shown look by look here, since there are many parts" in Page(many).text
    assert Page(many).text.count("Ledger of all surfaces") == 11
    assert len(many) < 0.75 * len(few)


def decoded(uri: str) -> np.ndarray:
    data = base64.b64decode(uri.split(",", 1)[1])
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return np.asarray(image, dtype=float)


def faces_of(solid: Solid, verdict: str, share: float) -> list[FaceJudged]:
    return [
        FaceJudged(
            face=i,
            label=f"F{i}",
            area_mm2=1.0,
            compared_fraction=share,
            verdict=verdict,
            views=(),
            reason="",
        )
        for i in range(len(solid.faces))
    ]


@pytest.mark.parametrize("verdict", ["pass", "fail"])
def test_the_part_has_the_colour_of_its_ledger(solid: Solid, verdict: str) -> None:
    for side in coverage_sides(solid, faces_of(solid, verdict, 1.0), 200, 95):
        image = decoded(side.uri)
        tone = np.array(COLOURS[verdict]) / np.linalg.norm(COLOURS[verdict])
        length = np.linalg.norm(image, axis=2)
        near = (image @ tone > 0.97 * length) & (length > 60)
        assert near.mean() > (0.25 if verdict == "pass" else 0.1)


def test_a_part_compared_by_half_is_half_white(solid: Solid) -> None:
    whole, half, none = (
        decoded(coverage_sides(solid, faces_of(solid, "pass", share), 200, 95)[0].uri)
        for share in (1.0, 0.5, 0.0)
    )

    def green(image: np.ndarray) -> float:
        return float((image[..., 1] - image[..., 2]).clip(0).sum())

    assert green(half) / green(whole) == pytest.approx(0.5, abs=0.08)
    assert green(none) / green(whole) < 0.05


def test_of_many_reasons_the_first_are_printed_and_all_are_kept(tmp_path: Path) -> None:
    reasons = tuple(f"F{i} plane: too little compared" for i in range(60))
    judged = bench.judged(tmp_path, bench.inspection((), (), Verdict.INDETERMINATE, reasons))
    paper = Page(render_parts([judged], on_paper=True)).text
    assert "F5 plane" in paper
    assert "F6 plane" not in paper
    assert "and 54 more reasons, on the screen and in the ledger" in paper
    assert "F59 plane" in Page(render_parts([judged])).text


def test_what_the_operator_gave_with_the_order_is_on_each_part(tmp_path: Path) -> None:
    papers = Papers("R. Meyer", "L7", ("SN-1", "SN-2"), 22.5)
    writer = RunWriter(tmp_path, count=3, papers=papers)
    for _ in range(3):
        writer.look(sighting())
    writer.close()
    record = load_run(tmp_path)
    headers = [judged.header for judged in judged_parts(record)]
    assert [h.serial for h in headers] == ["SN-1", "SN-2", ""]
    listed = report_json(record)["parts"]
    assert [(one["serial"], one["lot"]) for one in listed] == [
        ("SN-1", "L7"),
        ("SN-2", "L7"),
        (None, "L7"),
    ]
    assert {(h.operator, h.lot, h.part_temperature_c) for h in headers} == {
        ("R. Meyer", "L7", 22.5)
    }
    assert all(len(h.cad_sha256) == len(h.recipe_sha256) == 64 for h in headers)


def test_the_numbers_of_the_recipes_papers_stand_in_the_header(tmp_path: Path) -> None:
    named = {"part_number": "A-77 <b>", "drawing_number": "D-12", "revision": "C", "gauge_id": "G9"}
    page = Page(render_parts([bench.judged(tmp_path, papers=named)]))
    assert "Part number A-77 <b> Drawing D-12 Revision C" in " ".join(page.text.split())
    assert "Gauge G9" in " ".join(page.text.split())
    assert "Order" not in Page(render_parts([bench.judged(tmp_path)])).text


def test_the_page_of_a_part_has_less_than_two_megabytes(tmp_path: Path) -> None:
    made = [
        bench.measured(
            i, CharacteristicKind.DIAMETER, 8.0, 0.2, 8.01, Verdict.INDETERMINATE, bench.rim(0.0)
        )
        for i in range(1, 160)
    ]
    judged = bench.judged(tmp_path, bench.inspection(tuple(made)))
    rng = np.random.default_rng(1)
    for path in tmp_path.glob("*.png"):  # noise packs worst
        assert cv2.imwrite(str(path), rng.integers(0, 255, (480, 640), dtype=np.uint8))
    assert len(render_parts([judged]).encode()) < PART_BYTES


def test_each_printed_page_names_document_and_number(tmp_path: Path) -> None:
    evil = 'A"; } </style><script>'
    page = render_parts([bench.judged(tmp_path, serial=evil)])
    (named,) = re.findall(r'@bottom-left \{ content: "([^"]*)"', page)
    told = re.sub(r"\\([0-9a-f]+) ", lambda m: chr(int(m.group(1), 16)), named)
    assert told.startswith("Inspection report ")
    assert evil in told
    assert 'counter(page) " of " counter(pages)' in page


def test_a_calibration_without_a_date_is_called_so(tmp_path: Path) -> None:
    judged = bench.judged(tmp_path, calibrated={"inspection": "", "overhead": ""})
    assert "no date in the cell file" in Page(render_parts([judged])).text


def many(count: int, source: str = "ISO 2768-m") -> tuple[CharacteristicFields, ...]:
    """Return bores: the seventh failed, every tenth was not measured."""
    kind = CharacteristicKind.DIAMETER
    made = []
    for i in range(1, count + 1):
        value, verdict, reason = 8.01, Verdict.FAIL if i == 7 else Verdict.PASS, ""
        if i % 10 == 0:
            value, verdict, reason = None, Verdict.NOT_EVALUATED, "no picture shows it"
        made.append(
            bench.measured(i, kind, 8.0, 0.2, value, verdict, bench.rim(float(i)), reason=reason)
        )
    fold = PartFold(1)
    fold.take(measured_row(made))
    return tuple(c.model_copy(update={"source": source}) for c in fold.characteristics)


def test_the_journal_keeps_the_points_of_those_looks_that_a_report_draws() -> None:
    kind, rim = CharacteristicKind.DIAMETER, bench.rim(1.0)
    made = bench.measured(1, kind, 8.0, 0.2, 8.01, Verdict.PASS, rim)
    pattern = made.looks[0]
    points = np.array([[1.0, 2.0], [3.0, 4.0]])
    looks = tuple(
        replace(pattern, view_id=f"V{n}", reason="dark" if n < 4 else "", points_px=points)
        for n in range(12)
    )
    (kept,) = measured_row([replace(made, looks=looks)]).characteristics
    assert [look.view for look in kept.looks] == [look.view_id for look in looks]
    assert all(look.measured is not None for look in kept.looks)
    with_points = [look.view for look in kept.looks if look.points_px]
    # the ones that count, from the first; the report draws no more than three
    assert with_points == [f"V{n}" for n in range(4, 4 + len(with_points))]
    assert len(with_points) >= MAX_LOOKS


def test_a_long_table_keeps_what_matters_whole_and_every_value() -> None:
    rows = rows_of(many(91))
    brief = briefly(rows)
    assert [row.c.balloon for row in brief.rows] == [7]  # it failed
    assert brief.open_ == (("no picture shows it", tuple(range(10, 91, 10))),)
    named = {row.c.balloon for row in (*brief.rows, *brief.passed)}
    assert named | set(brief.open_[0][1]) == set(range(1, 92))
    assert briefly(rows[:30]).rows == rows[:30]  # a short one is printed whole


def test_what_somebody_asked_for_is_never_put_in_short() -> None:
    rows = rows_of(many(91, source="recipe"))
    assert briefly(rows).rows == rows


def test_two_fitted_lines_are_not_joined(tmp_path: Path) -> None:
    one = bench.all_kinds()[2]
    ends = np.array([[100.0, 100], [200, 100], [100, 300], [200, 300]])
    look = replace(one.looks[0], shape_px=ends, points_px=ends, accepted=np.ones(4))
    made = bench.inspection((replace(one, looks=(look,)),))
    page = Page(render_parts([bench.judged(tmp_path, made)]))
    fitted = [p["d"] for p in page.all("path") if p.get("class") == "fitted"]
    assert fitted[0] == "M100.50 100.50L200.50 100.50M100.50 300.50L200.50 300.50"


def test_what_would_have_been_found_stands_beside_the_coverage(tmp_path: Path) -> None:
    made = bench.inspection()
    found = (
        Detection("dent", 2.5, 0.724, 1.93, is_asked=True, open_faces=((3, 0.1),)),
        Detection("chip", 3.0, 0.5, None),
    )
    made = replace(made, ledger=replace(made.ledger, detections=found))
    judged = bench.judged(tmp_path, made)
    header, *rows = Page(render_parts([judged])).table("Found with 90 % probability")
    assert header[1:] == ["dents and pits", "chips"]
    assert [row[1:] for row in rows] == [["2.5 ◆", "3.0"], ["72 %", "50 %"], ["1.9", "–"]]
    assert result_json(judged)["found"][0] == {
        "kind": "dent", "size_mm": 2.5, "share": 0.724, "half_mm": 1.93, "is_asked": True,
        "open_faces": (3,),
    }  # fmt: skip
    silent = bench.judged(tmp_path, bench.inspection())
    assert "Found with 90" not in render_parts([silent])


def test_the_report_of_a_run_names_its_qif_file_by_hash(tmp_path: Path) -> None:
    stored_run.write(tmp_path)
    assert main(["report", "--runs", str(tmp_path), "--format", "qif"]) == 0
    assert main(["report", "--runs", str(tmp_path)]) == 0
    folder = tmp_path / stored_run.RUN
    digest = hashlib.sha256((folder / "report.qif").read_bytes()).hexdigest()
    assert digest in (folder / "report.html").read_text(encoding="utf-8")
