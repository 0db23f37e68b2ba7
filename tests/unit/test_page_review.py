"""The screens Review and History without a browser: what they show, what they refuse."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the page's packages are not installed (extra `page`)")
pytest.importorskip("httpx2", reason="starlette's client for tests needs it")

from page_bench import Bench, bench
from results_bench import RunWriter, bad_run, finding, good_run, verdict, view

from controller.cell.batch import Papers
from controller.cell.journal import JOURNAL_NAME, read_rows, rows
from controller.history import folded
from controller.inspection import Verdict
from controller.page.history.answers import counted_alarms
from controller.page.records import records as records_module
from controller.page.security import Role
from messages import say

NEWEST = "20260304-120000-000-featuretype"
OPEN = "20260303-120000-000-featuretype"
FAILED = "20260302-120000-000-featuretype"
PASSED = "20260301-120000-000-featuretype"
NASTY = "<script>alert(1)</script>"
BORE = rows.CharacteristicFields(
    id="d1", balloon=1, kind="diameter", label="bore <8>", nominal=8.0, lower=7.9, upper=8.1,
    source="recipe", measured=8.01, U=0.02, verdict="pass",
)  # fmt: skip


def measured_run(runs: Path, run: str, *values: float, serial: str = "") -> None:
    writer = RunWriter(runs, run, count=len(values), papers=Papers(serials=(serial,)))
    for value in values:
        writer.look()
        writer.plan()
        one = BORE.model_copy(update={"measured": value})
        writer.write(rows.PartMeasured(characteristics=(one,)))
        writer.judge(verdict())
        writer.place("accept")
    writer.end()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("written")
    good_run(folder)
    bad_run(folder)
    writer = RunWriter(folder, OPEN, papers=Papers(serials=(NASTY,), lot="L&7"))
    writer.whole_part(
        (view("G1-V0", finding()), view("G1-V3")), verdict(Verdict.INDETERMINATE), "quarantine"
    )
    writer.end()
    return folder


@pytest.fixture
def at(tmp_path: Path, written: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    # what the page's own process does is done in a thread here
    monkeypatch.setattr(records_module, "make_pool", lambda: ThreadPoolExecutor(1))
    monkeypatch.setattr(records_module, "WAIT_S", 60.0)
    monkeypatch.setattr(records_module, "NEWER_S", 0.0)
    shutil.copytree(written, tmp_path / "runs")
    found = bench(tmp_path)
    with found.client:
        yield found


def page(at: Bench, path: str, status: int = 200) -> str:
    reply = at.client.get(path)
    assert reply.status_code == status, reply.text[:300]
    return str(reply.text)


def decide(at: Bench, csrf: str, **changes: Any) -> tuple[int, dict[str, Any]]:
    body = {"run": OPEN, "number": 1, "verdict": "accept", "why": "dust", "seen": 0, **changes}
    status, text = at.post("/review/decide", body, csrf)
    return status, json.loads(text)


def reviews(at: Bench, tmp_path: Path) -> list[dict[str, Any]]:
    found = read_rows(tmp_path / "runs" / JOURNAL_NAME)
    return [row.body for row in found if row.name == "part_reviewed"]


def test_a_verdict_is_in_the_journal_in_the_persons_name(at: Bench, tmp_path: Path) -> None:
    csrf = at.log_in(Role.OPERATOR, "ada")
    text = page(at, "/review")
    assert "Parts that await a person: 1" in text
    assert decide(at, csrf, findings={"1": "false_alarm"}) == (
        200, {"review": "accept", "part": f"{OPEN}/1"},
    )  # fmt: skip
    (body,) = reviews(at, tmp_path)
    assert (body["who"], body["why"], body["machine"]) == ("ada, page", "dust", "indeterminate")
    assert body["findings"] == [{"number": 1, "word": "false_alarm"}]
    assert "No part awaits a person." in page(at, "/review")
    text = page(at, f"/review/part/{OPEN}/1")
    assert 'data-seen="1"' in text
    assert re.search(r'value="false_alarm" checked', text)


def test_while_parts_are_still_being_read_nobody_hears_that_none_awaits_them(
    at: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def is_filling(_: records_module.Records) -> bool:
        return True

    csrf = at.log_in(Role.OPERATOR, "ada")
    decide(at, csrf, findings={"1": "false_alarm"})
    assert "No part awaits a person." in page(at, "/review")
    monkeypatch.setattr(records_module.Records, "freshen", is_filling)
    text = page(at, "/review")
    assert "still being read" in text
    assert "No part awaits" not in text


def test_a_part_that_waits_for_a_dimension_shows_it_the_decisive_one_first(
    at: Bench, tmp_path: Path
) -> None:
    writer = RunWriter(tmp_path / "runs", NEWEST)
    writer.look()
    writer.plan()
    lesser, decisive = (
        BORE.model_copy(update={"id": key, "label": key, "verdict": "indeterminate", "reason": why})
        for key, why in (("width 5 mm", "no edge is in sight"), ("width 7 mm", "too near"))
    )
    writer.write(rows.PartMeasured(characteristics=(lesser, BORE, decisive)))
    writer.judge(verdict(Verdict.INDETERMINATE, ["width 7 mm: 7.1 mm with U = 0.3 mm, too near"]))
    writer.place("quarantine")
    writer.end()
    at.log_in()
    text = page(at, f"/review/part/{NEWEST}/1")
    assert "Characteristics that are not proven</" in text.replace(": 2", "")
    shown = text[text.index('id="unproven"') : text.index('id="coverage-words"')]
    assert re.findall(r"width \d mm(?=</td>)", shown) == ["width 7 mm", "width 5 mm"]
    assert shown.count('class="decisive"') == 1
    assert "bore" not in shown
    assert "Predicted: before the backlight" not in text  # there is no picture that it explains


def test_a_german_page_has_reasons_names_and_trays_in_german_and_the_journal_english(
    at: Bench, tmp_path: Path
) -> None:
    writer = RunWriter(tmp_path / "runs", NEWEST)
    writer.look()
    writer.plan()
    name = say("width {size} F{face} to F{other}", size=say("{n:g} mm", n=7.46), face=44, other=66)
    why = say(
        "{value:.3f} is {word} the {side} limit {limit:.3f}, U {u:.3f}",
        value=7.096, word="too near to", side="lower", limit=7.264, u=0.304,
    )  # fmt: skip
    width = BORE.model_copy(
        update={"id": name, "label": name, "verdict": "indeterminate", "reason": why}
    )
    writer.write(rows.PartMeasured(characteristics=(width,)))
    value = say("{measured_mm:.3f} mm with U = {u_mm:.3f} mm", measured_mm=7.096, u_mm=0.304)
    limits = say("too near the limits {limits} to decide", limits="LOW to HIGH")
    reason = say("{label}: {value}, {why_open}", label=name, value=value, why_open=limits)
    writer.judge(verdict(Verdict.INDETERMINATE, [reason]))
    writer.place("quarantine")
    writer.end()
    at.log_in()
    listed = page(at, "/review?lang=de")
    assert "Breite 7,46 mm F44 bis F66: 7,096 mm mit U = 0,304 mm, zu nah an den Grenzen" in listed
    assert "Ablage Prüfablage" in listed
    for path in (f"/review/part/{NEWEST}/1", f"/history/part/{NEWEST}/1"):
        text = page(at, path)
        assert ">Breite 7,46 mm F44 bis F66<" in text
        assert "7,096 liegt zu nah an der unteren Grenze 7,264, U 0,304" in text
        assert "<dd>Prüfablage" in text
        shown = re.sub(r"<[^>]*>", "", text.split("<main", 1)[1])
        assert not re.search(r"\b(width|too near|quarantine)\b", shown)
    assert "Breite 7,46 mm" in page(at, f"/history/compare?part={OPEN}/1&part={NEWEST}/1")
    assert "Breite 7,46 mm" in page(at, "/history/charts?recipe=featuretype")
    assert reason in page(at, "/review?lang=en")
    judged = [row.body for row in read_rows(tmp_path / "runs" / JOURNAL_NAME) if row.run == NEWEST]
    assert reason in json.dumps(judged)


def test_who_has_not_seen_the_last_verdict_is_refused(at: Bench, tmp_path: Path) -> None:
    csrf = at.log_in()
    assert decide(at, csrf)[0] == 200
    status, answer = decide(at, csrf, verdict="reject", why="a dent")
    assert (status, "somebody decided meanwhile" in answer["error"]) == (409, True)
    assert decide(at, csrf, verdict="reject", why="a dent", seen=1)[0] == 200
    assert [body["verdict"] for body in reviews(at, tmp_path)] == ["accept", "reject"]


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"verdict": "maybe"}, 422),
        ({"why": ""}, 422),
        ({"why": "x" * 1001}, 422),
        ({"run": "../../etc"}, 422),
        ({"who": "somebody else"}, 422),
        ({"findings": {"1": "so-so"}}, 422),
        ({"findings": {"one": "real"}}, 422),
        ({"findings": {"7": "real"}}, 409),
        ({"why": "   "}, 409),
        ({"number": 9}, 404),
        ({"run": "nobody"}, 404),
    ],
)
def test_a_verdict_that_makes_no_sense_leaves_no_row(
    at: Bench, tmp_path: Path, changes: dict[str, Any], status: int
) -> None:
    assert decide(at, at.log_in(), **changes)[0] == status
    assert reviews(at, tmp_path) == []


def test_a_viewer_sees_all_and_decides_nothing(at: Bench, tmp_path: Path) -> None:
    csrf = at.log_in(Role.VIEWER)
    text = page(at, f"/review/part/{OPEN}/1")
    assert "An operator may decide" in text
    assert 'type="submit"' not in text
    assert re.search("<fieldset[^>]* disabled>", text)
    assert decide(at, csrf)[0] == 403
    assert reviews(at, tmp_path) == []


@pytest.mark.parametrize(
    "path",
    ["/review", f"/review/part/{OPEN}/1", "/history", f"/history/part/{OPEN}/1",
     f"/history/compare?part={OPEN}/1&part={FAILED}/1", f"/history?serial={NASTY}"],
)  # fmt: skip
def test_names_that_are_scripts_are_text(at: Bench, path: str) -> None:
    at.log_in()
    text = page(at, path)
    assert NASTY not in text
    assert "&lt;script&gt;" in text


def test_a_finding_is_shown_and_what_is_missing_is_said(at: Bench, tmp_path: Path) -> None:
    at.log_in()
    reply = at.client.get(f"/review/crop/{OPEN}/1/1/picture")
    assert (reply.status_code, reply.headers["content-type"]) == (200, "image/jpeg")
    assert reply.content[:2] == b"\xff\xd8"
    for path, why in (
        (f"/review/crop/{OPEN}/1/9/picture", "no such finding"),
        (f"/review/crop/{OPEN}/1/1/secret", "no such crop"),
        (f"/review/crop/{OPEN}/4/1/picture", "no such part"),
        ("/review/crop/..%2f..%2fetc/1/1/picture", ""),
    ):
        reply = at.client.get(path)
        assert reply.status_code == 404
        assert why in reply.text
    shutil.rmtree(tmp_path / "runs" / FAILED / "pictures")
    assert "is missing" in at.client.get(f"/review/crop/{FAILED}/1/1/picture").text


def test_a_part_has_its_pictures_and_what_was_compared_of_each_face_beside_the_verdict(
    at: Bench, tmp_path: Path
) -> None:
    at.log_in(Role.VIEWER)
    text = page(at, f"/review/part/{OPEN}/1")
    assert text.count('src="/history/picture/') >= 2
    found = at.client.get(f"/review/coverage/{OPEN}/1").json()
    record = folded(tmp_path / "runs" / JOURNAL_NAME, OPEN, [1])
    verdict_ = record.parts[0].verdict
    assert verdict_ is not None
    assert found["coverage"]["faces"] == [
        [face.face, round(1000 * face.compared_fraction), 1000] for face in verdict_.faces
    ]
    known = {one["face"] for one in found["mesh"]["faces"]}
    assert {face.face for face in verdict_.faces} <= known
    assert at.client.get(f"/review/coverage/{OPEN}/9").status_code == 404


def test_findings_that_are_likely_false_are_marked(
    at: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RunWriter, "picture", lambda _, name, level=0: f"pictures/{name}.png")
    for i in range(6):
        writer = RunWriter(tmp_path / "runs", f"202605{10 + i}-120000-000-featuretype")
        writer.whole_part(
            (view("G1-V0", finding()), view("G1-V3")),
            verdict(Verdict.INDETERMINATE), "quarantine",
        )  # fmt: skip
        writer.end()
    csrf = at.log_in()
    assert "likely false alarms: 1" not in page(at, "/review")
    for i in range(6):
        word = {"1": "false_alarm"}
        assert (
            decide(at, csrf, run=f"202605{10 + i}-120000-000-featuretype", findings=word)[0] == 200
        )
    assert "likely false alarms: 1" in page(at, "/review")
    text = page(at, f"/review/part/{OPEN}/1")
    assert "of those of this kind on this face, 6 of 6 were" in text


def test_the_list_is_filtered_sorted_and_paged(
    at: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at.log_in()

    def listed(query: str = "") -> list[str]:
        return re.findall(r'name="part" value="(\d{8})', page(at, f"/history{query}"))

    assert listed() == ["20260303", "20260302", "20260301"]
    assert listed("?order=rising") == ["20260301", "20260302", "20260303"]
    assert listed("?verdict=fail") == ["20260302"]
    assert listed("?review=awaiting") == ["20260303"]
    assert listed("?sort=findings&order=falling")[0] == "20260302"
    assert listed("?since=2099-01-01") == []
    assert listed("?run=20260302&lot=") == ["20260302"]
    text = page(at, "/history?since=yesterday&verdict=perhaps&sort=password&page=-3")
    assert "Left out, as it makes no sense: verdict, since" in text
    monkeypatch.setattr("controller.page.history.answers.LISTED", 2)
    text = page(at, "/history?recipe=featuretype")
    assert "1 / 2" in text
    following = re.search(r'href="/history(\?[^"]+)" rel="next"', text)
    assert following is not None
    assert listed(following[1].replace("&amp;", "&")) == ["20260301"]


def test_one_parts_record_has_its_pictures(at: Bench) -> None:
    at.log_in()
    text = page(at, f"/history/part/{FAILED}/1")
    assert "missing material" in text
    pictures = re.findall(r'src="(/history/picture/[^"]+)"', text)
    assert len(pictures) == 2 + 2 * 3  # of the table, and of two views under three lamps
    reply = at.client.get(pictures[-1])
    assert (reply.status_code, reply.headers["content-type"]) == (200, "image/jpeg")
    assert at.client.get(f"/history/picture/{FAILED}/1/8").status_code == 404


BEGINS = {
    "html": b"<!doctype html>",
    "pdf": b"%PDF-",
    "csv": b"\xef\xbb\xbfrun,",
    "qif": b"<?xml",
    "as9102": b"%PDF-",
}


def test_a_part_and_its_run_are_fetched_by_buttons_in_each_form(at: Bench) -> None:
    at.log_in(Role.VIEWER)
    text = page(at, f"/history/part/{OPEN}/1")
    links = re.findall(r'href="(/history/file/[^"]+)"', text)
    assert links == [f"/history/file/{of}/{form}" for of in (f"{OPEN}/1", OPEN) for form in BEGINS]
    for link in links:
        reply = at.client.get(link)
        form = link.rpartition("/")[2]
        assert reply.status_code == 200, reply.text
        assert reply.content.lower().startswith(BEGINS[form].lower())
        # a report is kept by the browser, not shown as a page of this site
        assert reply.headers["content-disposition"].startswith("attachment")
        assert reply.headers["content-disposition"].endswith(
            "-as9102.pdf" if form == "as9102" else f".{form}"
        )
    assert "<svg" in at.client.get(f"/history/file/{OPEN}/1/html").text


def test_what_the_filter_of_the_history_lets_through_is_fetched_and_nothing_else(
    at: Bench,
) -> None:
    at.log_in(Role.VIEWER)
    text = page(at, "/history?verdict=indeterminate&sort=serial")
    (link,) = re.findall(r'href="(/history/file/csv[^"]*)"', text)
    rows_ = at.client.get(link.replace("&amp;", "&")).text.splitlines()[1:]
    assert {line.split(",")[0] for line in rows_} == {OPEN}
    every = at.client.get("/history/file/csv").text.splitlines()[1:]
    assert {OPEN, FAILED} < {line.split(",")[0] for line in every}


@pytest.mark.parametrize(
    ("path", "status", "said"),
    [
        ("parquet", 404, "no such form"),
        ("pdf", 404, "no such form"),  # a report is of one run
        (f"{FAILED}/exe", 404, "no such form"),
        (f"{FAILED}/9/pdf", 404, "no such part"),
        ("20200101-000000-000-none/pdf", 404, "no such part"),
        ("..%2F..%2Fetc/pdf", 404, ""),
        ("qif?run=none", 409, "QIF"),
    ],
)
def test_a_file_that_cannot_be_made_is_answered_with_the_reason(
    at: Bench, path: str, status: int, said: str
) -> None:
    at.log_in()
    assert said in page(at, f"/history/file/{path}", status)


def test_run_charts_have_limits_of_control_and_name_broken_rules(at: Bench, tmp_path: Path) -> None:
    values = [8.0, 8.01] * 6 + [8.09]  # the last one is beyond three standard deviations
    measured_run(tmp_path / "runs", "20260401-120000-000-featuretype", *values)
    at.log_in()
    text = page(at, "/history/charts?recipe=featuretype&characteristic=d1")
    # mean range 0.1 / 12 of neighbours... by hand: eleven steps of 0.01, one of 0.08
    mean, sigma = sum(values) / 13, (11 * 0.01 + 0.08) / 12 * 3.141592653589793**0.5 / 2
    assert f"limits of control {mean - 3 * sigma:.4f} – {mean + 3 * sigma:.4f} mm" in text
    assert "rule 1, value 13" in text
    assert "bore &lt;8&gt;" in text
    assert text.count('class="dot"') + text.count('class="mark" d=') == 13
    assert "style=" not in text  # the page's own policy would refuse it
    assert "No value was measured" in page(at, "/history/charts?recipe=featuretype&lot=none")
    assert "No characteristic" in page(at, "/history/charts?recipe=nothing")


def test_two_parts_are_compared_value_by_value(at: Bench, tmp_path: Path) -> None:
    run = "20260401-120000-000-featuretype"
    measured_run(tmp_path / "runs", run, 8.0, 8.025)
    at.log_in()
    text = page(at, "/history")  # which fills the store
    text = page(at, f"/history/compare?part={run}/1&part={run}/2")
    assert "+0.025" in text
    assert "Choose two parts" in page(at, f"/history/compare?part={run}/1")
    page(at, f"/history/compare?part={run}/1&part=nobody/1", 404)


def test_two_parts_are_shown_side_by_side_view_by_view(at: Bench) -> None:
    at.log_in()
    text = page(at, f"/history/compare?part={FAILED}/1&part={OPEN}/1")
    pairs = text.partition('class="pairs"')[2].split("<li>")[1:]
    shown = [re.findall(r'src="/history/picture/([^/"]+)/1/', pair) for pair in pairs]
    assert [FAILED, OPEN] in shown
    for pair, names in zip(pairs, shown, strict=True):
        assert len(names) == len(set(names)) >= 1
        assert pair.count("not shown in this view") == 2 - len(names)
    for address in re.findall(r'src="(/history/picture/[^"]+)"', text):
        assert at.client.get(address).status_code == 200


def test_an_alarm_that_came_again_stands_there_once_with_its_words() -> None:
    one = {"alarm": 910, "code": "loop_late", "device": "controller"}
    other = {"alarm": 910, "code": "loop_late", "device": "arm"}
    assert counted_alarms([one, other, one, one]) == [(one, 3), (other, 1)]


def test_a_part_that_is_not_there_is_answered_with_a_page(at: Bench) -> None:
    at.log_in()
    for screen in ("history", "review"):
        text = page(at, f"/{screen}/part/nobody/1", 404)
        assert "there is no such part" in text
        assert f'href="/{screen}"' in text


def test_a_folder_without_runs_says_so(tmp_path: Path) -> None:
    found = bench(tmp_path)
    with found.client:
        found.log_in()
        for path in ("/review", "/history", "/history/charts"):
            assert "nothing ran here yet" in page(found, path)


def test_both_screens_are_german_where_asked(at: Bench) -> None:
    at.log_in()
    assert "Teile, die auf einen Menschen warten" in page(at, "/review?lang=de")
    assert "Seriennummer" in page(at, "/history")


@pytest.mark.slow
def test_the_pages_own_process_fills_the_store_and_ends_with_the_page(
    tmp_path: Path, written: Path
) -> None:
    shutil.copytree(written, tmp_path / "runs")
    found = bench(tmp_path)
    with found.client:
        found.log_in()
        for _ in range(600):
            if "Parts that await a person: 1" in page(found, "/review"):
                break
        else:
            raise AssertionError("the store was not filled")
