"""The report as a reader gets it: HTML page and JSON, from journals as a run writes them."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from results_bench import PART_PX, RunWriter, bad_run, good_run, sighting, verdict, view

from controller.cell.journal import rows
from controller.inspection import Unjudged, Verdict
from controller.results.report import report_json
from controller.results.report.html import render
from controller.results.report.ledger import means_of, rounded_to_whole
from controller.results.report.pictures import outline_path, window_round
from controller.results.run import load_run
from controller.results.writing import write_html

VOID = {"col", "meta", "img", "br", "hr", "link", "input"}
NASTY = "<script>alert('x')</script>&\"' {{ 7 * 7 }}"


class Page(HTMLParser):
    """A page taken apart; fails on tags that do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.tables: list[list[list[str]]] = []
        self._open: list[str] = []
        self._cell: list[str] | None = None
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self._open.append(tag)
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in {"td", "th"}:
            self._cell = []

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {k: v or "" for k, v in attrs}))

    def handle_endtag(self, tag: str) -> None:
        if tag in VOID:
            return
        assert self._open.pop() == tag
        if tag in {"td", "th"} and self._cell is not None:
            self.tables[-1][-1].append(" ".join("".join(self._cell).split()))
            self._cell = None

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] not in {"style", "text"}:
            self.words.append(data)
        if self._cell is not None and self._open[-1] != "text":
            self._cell.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def table(self, first_heading: str) -> list[list[str]]:
        (found,) = [t for t in self.tables if t[0][0] == first_heading]
        return found

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]


def page_of(runs_dir: Path, run: str | None = None) -> Page:
    return Page(render(load_run(runs_dir, run)))


def boxes(page: Page) -> list[tuple[float, ...]]:
    """Return x, y, width and height of the finding boxes drawn on pictures."""
    return [
        tuple(float(r[k]) for k in ("x", "y", "width", "height"))
        for r in page.all("rect")
        if r.get("stroke") == "#d55e00"
    ]


def test_the_page_needs_nothing_but_itself(tmp_path: Path) -> None:
    bad_run(tmp_path)
    page = page_of(tmp_path)
    names = {name for name, _ in page.tags}
    assert not names & {"script", "link", "iframe", "object", "img"}
    for _, attributes in page.tags:
        for key in ("src", "href", "xlink:href"):
            assert attributes.get(key, "#").startswith(("#", "data:image/jpeg;base64,"))
        assert not any(key.startswith("on") for key in attributes)
    assert not re.search(r"url\(|@import", render(load_run(tmp_path)))


def test_an_emulated_cell_is_told_before_everything_else(tmp_path: Path) -> None:
    good_run(tmp_path)
    page = page_of(tmp_path)
    banner = "EMULATED CELL - not a production result"
    assert page.text.index(banner) < page.text.index("Inspection report")
    assert "arm, gripper, lights, io, overhead, inspection" in page.text
    good_run(tmp_path, "20260401-120000-000-featuretype", real=True, speed=1.0)
    assert "EMULATED" not in page_of(tmp_path).text


def test_the_verdict_and_why_stand_at_the_top(tmp_path: Path) -> None:
    bad_run(tmp_path)
    text = page_of(tmp_path).text
    top = text[: text.index("On the table")]
    assert "fail" in top
    assert "Missing material at F1 bore 8.0 mm: 9.4 mm across, 41 mm2, view G1-V0, backlit." in top
    assert "20260302-120000-000-featuretype" in top


def test_the_coverage_column_adds_up_to_one_hundred_percent(tmp_path: Path) -> None:
    good_run(tmp_path)
    page = page_of(tmp_path)
    header, *rows, total = page.table("Surface")
    share = header.index("Share of all [%]")
    assert sum(Decimal(row[share]) for row in rows) == Decimal("100.00")
    assert total[share] == "100.00"
    assert total[header.index("Area [mm²]")] == "3000.0"
    # one face of three is seen to 91 %: (100 + 91 + 100) / 3
    assert total[header.index("Compared [%]")] == "97.00"
    assert [row[:1] for row in rows] == [["F0 plane"], ["F1 bore 8.0 mm"], ["F2 plane"]]
    _, row = page.table("Not compared, because")
    assert row == ["in the jaws' shadow", "3.00", "–"]


def test_every_piece_of_surface_is_in_one_class(tmp_path: Path) -> None:
    bad_run(tmp_path)
    text = page_of(tmp_path).text
    # 6000 mm2: F0 5000 all seen, F1 250 seen to 0.9, F2 750 seen to 0.2
    assert "compared, agrees with the CAD: 83.33 %" in text
    assert "compared, on a surface that differs from the CAD: 3.75 %" in text
    assert "compared, too little of the surface to judge it, or unconfirmed: 2.50 %" in text
    assert "not compared: 10.42 %" in text


@pytest.mark.parametrize("reason", list(Unjudged))
def test_each_reason_for_no_comparison_says_what_would_compare_more(reason: Unjudged) -> None:
    assert means_of(reason.value)


@given(st.lists(st.floats(0.001, 1e6), min_size=1, max_size=300))
def test_rounded_shares_add_up_and_stay_near(areas: list[float]) -> None:
    shares = [100 * area / sum(areas) for area in areas]
    rounded = rounded_to_whole(shares)
    assert sum(round(100 * r) for r in rounded) == 10_000
    assert all(abs(r - s) <= 0.01 + 1e-9 for r, s in zip(rounded, shares, strict=True))


def test_findings_have_their_row_and_their_box_in_the_right_picture(tmp_path: Path) -> None:
    bad_run(tmp_path)
    page = page_of(tmp_path)
    header, first, second = page.table("No.")
    cells = dict(zip(header, first, strict=True))
    assert cells["Kind"] == "missing material"
    assert cells["Surface"] == "F1 bore 8.0 mm"
    assert cells["Size [mm]"] == "9.4"
    assert cells["View"] == "G1-V0"
    assert cells["Light"] == "backlight"
    assert cells["Place on the part, CAD x, y, z [mm]"] == "12.5, -3.2, 30.0"
    assert dict(zip(header, second, strict=True))["Surface"] == "F2 plane, F1 bore 8.0 mm"
    drawn = boxes(page)
    # each once in its crop and once in its view, drawn one pixel outside the finding's own box
    assert drawn.count((699.0, 399.0, 42.0, 32.0)) == 2
    assert drawn.count((599.0, 499.0, 42.0, 62.0)) == 2
    # the sighting's box, on both table pictures
    assert drawn.count((559.0, 429.0, 162.0, 162.0)) == 2


def test_a_views_pictures_show_the_predicted_outline_and_a_scale(tmp_path: Path) -> None:
    good_run(tmp_path)
    page = page_of(tmp_path)
    outlines = [p for p in page.all("path") if p.get("class") == "outline"]
    assert len(outlines) == 2
    assert len(page.all("use")) == 2 * 2  # drawn again over the two lit pictures of each view
    numbers = [float(v) for v in re.findall(r"[\d.]+", outlines[0]["d"])]
    x0, y0, x1, y1 = PART_PX
    assert (min(numbers[::2]), max(numbers[::2])) == pytest.approx((x0 + 0.5, x1 + 0.5), abs=3)
    assert (min(numbers[1::2]), max(numbers[1::2])) == pytest.approx((y0 + 0.5, y1 + 0.5), abs=3)
    bars = [
        float(line["x2"]) - float(line["x1"])
        for line in page.all("line")
        if line["stroke"] == "#111"
    ]
    # cell file: 3733 px, 700 mm before the camera; over the table 3571 px, 1250 mm
    assert bars[0] == pytest.approx(10 * 3733 / 700, abs=0.02)
    assert bars[-1] == pytest.approx(10 * 3571 / 1250, abs=0.02)
    assert "pose shift 0.73 mm, turn 0.41 deg, outline residual 0.19 px" in page.text


def test_the_picture_on_the_page_is_the_picture_that_was_taken(tmp_path: Path) -> None:
    good_run(tmp_path)
    page = page_of(tmp_path)
    # four of the part, a thumbnail of each view, then views with all lamps, then the table
    taken = page.all("image")
    assert len(taken) == 4 + 2 + 2 * 3 + 2
    taken = taken[4 + 2 :]
    data = base64.b64decode(taken[0]["href"].removeprefix("data:image/jpeg;base64,"))
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    height, width = image.shape
    # the cut-out's place and size are those of the full picture: look where the part must be
    scale = width / float(taken[0]["width"])
    column = round((PART_PX[0] - float(taken[0]["x"])) * scale)
    row = round((PART_PX[1] - float(taken[0]["y"])) * scale)
    assert image[row + 6 : row + 30, column + 6 : column + 30].max() < 60
    assert image[: row - 6, :].min() > 150
    assert image[:, : column - 6].min() > 150
    assert width / height == pytest.approx(1.25, abs=0.01)


def test_a_view_that_was_not_evaluated_says_why(tmp_path: Path) -> None:
    bad_run(tmp_path)
    text = page_of(tmp_path).text
    assert "not evaluated outline off by 3.10 px, 1.20 px is allowed" in text


def test_the_time_line_names_the_worst_step(tmp_path: Path) -> None:
    good_run(tmp_path)
    page = page_of(tmp_path)
    assert (
        "Worst against its forecast: step 3, show with grasp G1, square to F0 plane: "
        "6.5 s, forecast 4.0 s (+2.5 s)." in page.text
    )
    _, *rows, total = page.table("Step")
    assert [row[2:5] for row in rows] == [
        ["9.0", "9.5", "+0.5"],
        ["4.0", "4.2", "+0.2"],
        ["4.0", "6.5", "+2.5"],
        ["11.0", "12.2", "+1.2"],
    ]
    assert total[1:5] == ["4 steps done", "28.0", "32.5", "+4.5"]


def test_what_a_recipe_leaves_open_is_reported_as_such(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, unit=None)
    writer.end("aborted", "nothing was there", "fault")
    assert "not said" in page_of(tmp_path).text


def test_names_from_a_recipe_stay_text(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, name=NASTY)
    writer.whole_part((view("G1-V0"), view(NASTY.replace("/", "|"))), verdict(), "accept")
    writer.end("aborted", NASTY, "fault")
    page = page_of(tmp_path)
    assert "script" not in {name for name, _ in page.tags}
    assert page.text.count("<script>alert('x')</script>&\"' {{ 7 * 7 }}") >= 2
    assert "49" not in page.text.split("Inspection report")[1][:80]


def test_a_missing_or_broken_picture_is_told_in_its_place(tmp_path: Path) -> None:
    folder = bad_run(tmp_path)
    (folder / "pictures" / "part001_G1-V0_station_backlight.png").unlink()
    (folder / "pictures" / "part001_G1-V0_station_ring.png").write_bytes(b"\x89PNG and no more")
    page = page_of(tmp_path)
    gone = "picture pictures/part001_G1-V0_station_backlight.png is missing"
    assert page.text.count(gone) == 2  # in the view and in the findings table
    assert "part001_G1-V0_station_ring.png cannot be read" in page.text
    # the third picture of the view still carries the outline
    assert len([p for p in page.all("path") if p.get("class") == "outline"]) == 1


def test_a_picture_outside_the_runs_folder_is_not_put_on_the_page(tmp_path: Path) -> None:
    (tmp_path / "secret.png").write_bytes(b"x")
    writer = RunWriter(tmp_path)
    writer.number = 1
    writer.write(rows.TablePictures({"table_backlight": "../secret.png"}))
    writer.close()
    assert page_of(tmp_path).all("image") == []
    pictures = report_json(load_run(tmp_path))["parts"][0]["table_pictures"]
    assert pictures["table_backlight"]["sha256"] is None


def test_a_sighting_is_told_with_how_exact_it_is(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting(), sighting(None))
    writer.close()
    heads, known, unknown = page_of(tmp_path).table("Object")
    place, turn = heads.index("± [mm]"), heads.index("± [deg]")
    # the bench's standard deviations; a stranger has none
    assert (known[place], known[turn], known[heads.index("Score [%]")]) == (
        "0.040", "0.100", "98.7",
    )  # fmt: skip
    assert unknown[place] == unknown[turn] == "–"


def test_a_run_that_was_cut_off_still_gets_its_page(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.look(sighting())
    writer.plan()
    writer.once("grip", is_done=False)
    writer.close()
    page = page_of(tmp_path)
    assert "no verdict" in page.text
    assert "the run has no end in the journal: it was cut off after" in page.text
    assert "Where the part was The position of the part is unknown" in page.text
    assert page.text.count("not done") == 4
    assert "nothing can be said of its surfaces" in page.text


def test_a_run_without_a_part_still_gets_its_page(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.journal.write(rows.RunBrokeOff(error="arm: no answer on /dev/pts/7"))
    writer.close()
    text = page_of(tmp_path).text
    assert "Arm: no answer on /dev/pts/7." in text
    assert "The run ended before a part was looked at." in text


def test_a_batch_is_summed_up_and_its_worst_verdict_leads(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, count=3)
    writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), "accept")
    writer.whole_part(
        (view("G1-V0"), view("G1-V3")), verdict(Verdict.FAIL, ("extra material",)), "reject"
    )
    writer.end("stopped", "stopped by the operator", "stop")
    page = page_of(tmp_path)
    assert "2 parts of 3 ordered: 1 pass, 1 fail; 1 not begun." in page.text
    assert report_json(load_run(tmp_path))["verdict"] == "fail"
    assert [row[0] for row in page.table("Part")[1:]] == ["1", "2"]


def test_a_batch_that_was_not_finished_is_no_pass(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path, count=2)
    writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), "accept")
    writer.end("stopped", "stopped by the operator", "stop")
    body = report_json(load_run(tmp_path))
    assert body["verdict"] == "incomplete"
    assert body["parts"][0]["verdict"] == "pass"


def test_a_part_in_the_wrong_tray_is_told(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path)
    writer.whole_part((view("G1-V0"), view("G1-V3")), verdict(), "reject")
    writer.end()
    wrong = "the verdict requires the tray accept, the part was put into reject"
    assert wrong in page_of(tmp_path).text


def test_pictures_shrink_until_the_page_is_small_enough(tmp_path: Path) -> None:
    bad_run(tmp_path)
    record = load_run(tmp_path)
    full = render(record)
    assert len(full.encode()) < 10_000_000
    small = render(record, max_bytes=120_000)
    assert len(small.encode()) <= 120_000
    assert "made smaller" in small
    assert len(Page(small).all("image")) == len(Page(full).all("image"))
    none = render(record, max_bytes=1)  # cannot be met: the words stay all the same
    assert Page(none).all("image") == []
    assert "left out to keep this page small" in Page(none).text


def test_the_file_appears_whole_and_alone(tmp_path: Path) -> None:
    folder = good_run(tmp_path)
    path = write_html(load_run(tmp_path), folder / "deep" / "report.html")
    assert path == folder / "deep" / "report.html"
    assert [p.name for p in path.parent.iterdir()] == ["report.html"]
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")


def test_the_json_says_the_same_in_numbers(tmp_path: Path) -> None:
    folder = bad_run(tmp_path)
    body = json.loads(json.dumps(report_json(load_run(tmp_path)), allow_nan=False))
    assert (body["schema"], body["schema_version"]) == ("cellctl.report", 1)
    assert (body["run"], body["verdict"]) == (folder.name, "fail")
    assert body["emulated"] is True
    assert {d["name"]: d["emulated"] for d in body["devices"]}["io"] is True
    assert body["outcome"]["end"] == "complete"
    (part,) = body["parts"]
    assert (part["tray"], part["custody"], part["in_doubt"]) == ("reject", "placed", None)
    assert sum(f["area_fraction"] for f in part["faces"]) == pytest.approx(1.0)
    assert [f["verdict"] for f in part["faces"]] == ["pass", "fail", "not evaluated"]
    assert [(f["number"], f["size_mm"], f["faces"]) for f in part["findings"]] == [
        (1, 9.4, [1]),
        (2, 9.4, [2, 1]),
    ]
    assert [v["evaluated"] for v in part["views"]] == [True, False]
    assert part["views"][1]["residual_px"] is None
    assert part["views"][0]["findings"] == [1, 2]
    assert part["steps"][2] == {
        "label": "show with grasp G1, square to F0 plane",
        "forecast_s": 4.0,
        "seconds": 6.5,
        "view": "G1-V3",
        "tray": None,
        "jaw_mm": None,
        "expected_mm": None,
    }
    (seen,) = part["sightings"]
    # the larger of the two standard deviations of the place the bench writes
    assert (seen["sigma_mm"], seen["sigma_deg"]) == (pytest.approx(0.04), pytest.approx(0.1))
    picture = part["views"][0]["pictures"]["station_ring"]
    expected = hashlib.sha256((folder / picture["file"]).read_bytes()).hexdigest()
    assert picture["sha256"] == expected


def test_an_outline_is_cut_where_it_jumps_to_the_next_border() -> None:
    outer = tuple((float(x), 0.0) for x in range(0, 30, 3))
    inner = ((100.0, 50.0), (103.0, 50.0), (103.0, 53.0), (100.0, 53.0))
    path = outline_path(outer + inner)
    assert path.count("M") == 2
    assert path.count("Z") == 1  # the inner one comes back to where it began, the outer does not
    assert "M100.5 50.5L103.5 50.5" in path


@given(
    st.integers(0, 1200), st.integers(0, 1000), st.integers(1, 400), st.integers(1, 400),
)  # fmt: skip
def test_a_cut_out_holds_its_box_and_stays_in_the_picture(x: int, y: int, w: int, h: int) -> None:
    box = (x, y, min(x + w, 1280), min(y + h, 1024))
    x0, y0, x1, y1 = window_round([box], (1280, 1024), 0.2, 100)
    assert 0 <= x0 <= box[0]
    assert 0 <= y0 <= box[1]
    assert box[2] <= x1 <= 1280
    assert box[3] <= y1 <= 1024
    assert (x1 - x0) / (y1 - y0) == pytest.approx(1.25, abs=0.03)


def test_the_speed_reached_stands_beside_the_one_asked_for(tmp_path: Path) -> None:
    good_run(tmp_path)
    assert "10x real time asked, 6.3x reached" in page_of(tmp_path).text
