"""A person's verdict on a part: in the journal, in the store, in reports, by the command."""

from __future__ import annotations

import csv
import json
import shutil
import sqlite3
import threading
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy
from results_bench import RunWriter, bad_run, finding, good_run, verdict, view

from controller.cell.batch import Papers
from controller.cell.journal import (
    JOURNAL_NAME,
    Journal,
    JournalError,
    append_beside,
    first_broken_row,
    first_flaw,
    newest_run,
    read_rows,
    rows,
)
from controller.cli import main
from controller.history import (
    SCHEMA_VERSION,
    Filters,
    HistoryError,
    Store,
    fill,
    list_parts,
    open_store,
)
from controller.history.exporting import export
from controller.history.reviewing import PartDecision, Rate, agreement, decide, one_part
from controller.inspection import Verdict
from controller.results.judged import judged_parts
from controller.results.report import render, report_json
from controller.results.run import load_run, prove_run

OPEN = "20260303-120000-000-featuretype"
FAILED = "20260302-120000-000-featuretype"
PASSED = "20260301-120000-000-featuretype"


def open_run(runs: Path, run: str = OPEN, *serials: str) -> None:
    """Write a run whose parts are indeterminate and in the quarantine tray."""
    names = serials or ("SN7",)
    writer = RunWriter(runs, run, count=len(names), papers=Papers(serials=names))
    for _ in names:
        writer.whole_part(
            (view("G1-V0"), view("G1-V3")), verdict(Verdict.INDETERMINATE), "quarantine"
        )
    writer.end()


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three runs, written once: one part each, passed, failed and indeterminate."""
    folder = tmp_path_factory.mktemp("written")
    good_run(folder)
    bad_run(folder)
    open_run(folder)
    return folder


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have runs name pictures that they do not write."""
    monkeypatch.setattr(RunWriter, "picture", lambda _, name, level=0: f"pictures/{name}.png")


@pytest.fixture
def store(runs: Path, written: Path) -> Any:
    shutil.copytree(written, runs, dirs_exist_ok=True)
    made = open_store(f"sqlite:///{runs}/history.sqlite")
    fill(made, runs)
    yield made
    made.close()


ACCEPT = PartDecision("accept", "Ann", "a reflection")


def test_a_row_from_beside_is_in_the_chain_and_makes_no_writer_wait(runs: Path) -> None:
    writer = Journal(runs / JOURNAL_NAME, "R")
    writer.write(rows.RunBegan())
    writer._db.execute("BEGIN IMMEDIATE")  # the cell is in the middle of a row
    row = rows.PartReviewed(verdict="accept", who="Ann", why="seen")
    done: list[int] = []
    desk = threading.Thread(target=lambda: done.append(append_beside(writer.path, "R", row, 1)))
    desk.start()
    assert done == []
    writer._db.execute("COMMIT")
    desk.join()
    assert done == [2]
    writer.write(rows.RunEnded(end="complete", parts=1))  # and the cell goes on as before
    writer.close()
    assert first_broken_row(writer.path) is None
    assert first_flaw(writer.path) is None
    assert [row.name for row in read_rows(writer.path)][1] == "part_reviewed"


def test_a_row_from_beside_raises_the_head_and_needs_a_journal(runs: Path) -> None:
    good_run(runs)
    path = runs / JOURNAL_NAME
    row = rows.PartReviewed(verdict="reject", who="Ann", why="seen")
    seq = append_beside(path, PASSED, row, 1)
    with sqlite3.connect(path) as db:
        db.execute("DROP TRIGGER journal_loses_none")
        db.execute("DELETE FROM journal WHERE seq = ?", (seq,))
    db.close()
    assert "rows were cut off" in str(first_flaw(path))
    with pytest.raises(JournalError, match="no journal"):
        append_beside(runs / "none.sqlite", PASSED, row, 1)


def test_what_a_person_adds_makes_an_old_run_neither_the_newest_nor_longer(
    store: Store, runs: Path
) -> None:
    before = load_run(runs, PASSED)
    decide(store, runs, f"{PASSED}/1", PartDecision("reject", "Ann", "a scratch nobody saw"))
    after = load_run(runs, PASSED)
    assert newest_run(runs / JOURNAL_NAME) == OPEN
    assert load_run(runs).run_id == OPEN
    assert (after.end, after.wall_s, after.outcome, after.stages) == (
        before.end, before.wall_s, before.outcome, before.stages,
    )  # fmt: skip
    assert after.parts[0].end == before.parts[0].end
    assert prove_run(runs, PASSED).tampered == prove_run(runs, FAILED).tampered


def test_a_part_awaits_a_person_until_one_decides(store: Store, runs: Path) -> None:
    (waiting,) = list_parts(store, Filters(review="awaiting"), 9).parts
    assert (waiting["serial"], waiting["tray"], waiting["awaits_review"]) == (
        "SN7", "quarantine", True,
    )  # fmt: skip
    part = decide(store, runs, "SN7", ACCEPT)
    assert (part["verdict"], part["review"], part["awaits_review"]) == (
        "indeterminate", "accept", False,
    )  # fmt: skip
    assert list_parts(store, Filters(review="awaiting"), 9).count == 0
    assert [p["serial"] for p in list_parts(store, Filters(review="reviewed"), 9).parts] == ["SN7"]
    assert list_parts(store, Filters(review="reject"), 9).count == 0


def test_a_later_verdict_stands_in_place_of_an_earlier_one_which_stays(
    store: Store, runs: Path
) -> None:
    first = PartDecision("accept", "Ann", "dust", {1: "false_alarm", 2: "false_alarm"})
    second = PartDecision("reject", "Bob", "a dent", {1: "real"})
    decide(store, runs, f"{FAILED}/1", first)
    part = decide(store, runs, f"{FAILED}/1", second)
    assert [(r["verdict"], r["who"], r["machine"], r["findings"]) for r in part["reviews"]] == [
        ("accept", "Ann", "fail", "1=false_alarm 2=false_alarm"),
        ("reject", "Bob", "fail", "1=real"),
    ]
    # as a whole: what the second person did not name is open again
    assert [f["review"] for f in part["findings"]] == ["real", ""]
    written = [row for row in read_rows(runs / JOURNAL_NAME) if row.name == "part_reviewed"]
    assert [row.body["verdict"] for row in written] == ["accept", "reject"]
    fill(store, runs, anew=True)
    assert one_part(store, f"{FAILED}/1") == part


@pytest.mark.parametrize(
    ("word", "decision", "why"),
    [
        ("SN7", PartDecision("maybe", "Ann", "x"), "one of accept, reject"),
        ("SN7", PartDecision("accept", "Ann", "  "), "the reason needs"),
        ("SN7", PartDecision("accept", "Ann", "x" * 1001), "the reason needs"),
        ("SN7", PartDecision("accept", "", "x"), "the name needs"),
        ("SN7", PartDecision("accept", "Ann", "x", {1: "real"}), "has no finding 1; it has none"),
        (f"{FAILED}/1", PartDecision("accept", "Ann", "x", {3: "real"}), "has no finding 3"),
        (
            f"{FAILED}/1",
            PartDecision("accept", "Ann", "x", {1: "so-so"}),
            "one of real, false_alarm",
        ),
        (f"{OPEN}/9", ACCEPT, "no part"),
    ],
)
def test_a_verdict_that_makes_no_sense_is_refused_and_leaves_no_row(
    store: Store, runs: Path, word: str, decision: PartDecision, why: str
) -> None:
    with pytest.raises(HistoryError, match=why):
        decide(store, runs, word, decision)
    assert not [row for row in read_rows(runs / JOURNAL_NAME) if row.name == "part_reviewed"]


def test_whoever_has_not_seen_the_last_verdict_is_told(store: Store, runs: Path) -> None:
    decide(store, runs, "SN7", ACCEPT, seen=0)
    with pytest.raises(HistoryError, match="somebody decided meanwhile"):
        decide(store, runs, "SN7", PartDecision("reject", "Bob", "x"), seen=0)
    assert one_part(store, "SN7")["review"] == "accept"


def test_a_serial_number_that_came_twice_needs_the_run(store: Store, runs: Path) -> None:
    open_run(runs, "20260304-120000-000-featuretype", "SN7")
    fill(store, runs)
    with pytest.raises(HistoryError, match=r"came 2 times; name one: .*0303.*/1, .*0304.*/1"):
        decide(store, runs, "SN7", ACCEPT)


def test_a_broken_journal_and_one_set_aside_get_no_row(store: Store, runs: Path) -> None:
    path = runs / JOURNAL_NAME
    with sqlite3.connect(path) as db:
        db.execute("DROP TRIGGER journal_keeps_rows")
        db.execute(
            "INSERT INTO journal VALUES ((SELECT max(seq) + 1 FROM journal), '2026-03-03', 0, ?, "
            "NULL, 'event', 'forged', '{}', 'x', 'y')",
            (OPEN,),
        )
    db.close()
    with pytest.raises(HistoryError, match="so nothing is added to it"):
        decide(store, runs, "SN7", ACCEPT)
    for file in runs.glob(f"{JOURNAL_NAME}*"):
        file.rename(file.with_name(file.name.replace("journal", "journal-set-aside-1", 1)))
    fill(store, runs)
    with pytest.raises(HistoryError, match="was set aside: nothing is added"):
        decide(store, runs, "SN7", ACCEPT)


def test_a_part_that_was_never_judged_is_not_reviewed(store: Store, runs: Path) -> None:
    writer = RunWriter(runs, "20260305-120000-000-featuretype")
    writer.look()
    writer.end("stopped", "stopped by the operator", custody="ON_TABLE")
    fill(store, runs)
    with pytest.raises(HistoryError, match="neither judged nor sorted"):
        decide(store, runs, "20260305/1", ACCEPT)


def test_reports_and_exports_have_the_verdict_beside_the_machines(
    store: Store, runs: Path, tmp_path: Path
) -> None:
    decide(store, runs, f"{FAILED}/1", PartDecision("accept", "Ann", "=a dust", {1: "false_alarm"}))
    record = load_run(runs, FAILED)
    (part,) = report_json(record)["parts"]
    assert (part["verdict"], part["awaits_review"]) == ("fail", False)
    assert [(r["verdict"], r["findings"]) for r in part["reviews"]] == [
        ("accept", {"1": "false_alarm"})
    ]
    text = render(record)
    assert "accept by Ann" in text
    assert "#1 false alarm" in text
    assert "awaits a person" in render(load_run(runs, OPEN))
    (judged,) = judged_parts(record)
    assert (judged.verdict, judged.part.awaits_review) == ("fail", False)
    export(store, Filters(), tmp_path / "all.csv", runs)
    with (tmp_path / "all.csv").open(encoding="utf-8-sig") as file:
        found = {row["run"]: row for row in csv.DictReader(file)}
    assert (found[FAILED]["review"], found[FAILED]["review_who"]) == ("accept", "Ann")
    assert found[FAILED]["review_why"] == "'=a dust"  # no formula
    assert found[FAILED]["review_at"].endswith("Z")
    assert found[OPEN]["review"] == found[OPEN]["review_at"] == ""


def test_a_store_of_version_2_is_brought_up_and_filled_once_more(store: Store, runs: Path) -> None:
    assert SCHEMA_VERSION == 9
    with store.engine.begin() as db:
        for index in ("parts_awaiting", "parts_review", "parts_order"):
            db.execute(sqlalchemy.text(f"DROP INDEX {index}"))
        for table, column in (
            ("parts", "nest"), ("parts", "awaits_review"), ("parts", "review"),
            ("parts", "is_counted"), ("parts", "followed_by"), ("parts", "order_number"),
            ("findings", "review"),
        ):  # fmt: skip
            db.execute(sqlalchemy.text(f"ALTER TABLE {table} DROP COLUMN {column}"))
        db.execute(sqlalchemy.text("DROP TABLE reviews"))
        db.execute(sqlalchemy.text("UPDATE store_version SET version = 2"))
    older = open_store(str(store.engine.url))
    try:
        assert list_parts(older, Filters(), 9).count == 3  # what is there stays
        assert list_parts(older, Filters(review="awaiting"), 9).count == 0
        fill(older, runs)
        assert list_parts(older, Filters(review="awaiting"), 9).count == 1
    finally:
        older.close()


def test_a_list_is_sorted_and_paged(store: Store) -> None:
    def names(**order: Any) -> list[str]:
        return [p["run"][:8] for p in list_parts(store, Filters(), 2, **order).parts]

    assert names() == ["20260303", "20260302"]
    assert names(skipped=2) == ["20260301"]
    assert names(is_rising=True) == ["20260301", "20260302"]
    assert names(sort="verdict", is_rising=True) == ["20260302", "20260303"]
    assert names(sort="findings") == ["20260302", "20260303"]


# --- agreement -----------------------------------------------------------------------------------


def test_agreement_counts_by_kind_and_face_and_names_what_is_likely_false(
    store: Store, runs: Path, blind: None
) -> None:
    for i in range(8):
        bad_run(runs, f"202604{10 + i}-120000-000-featuretype")
    fill(store, runs)
    words = {1: "false_alarm", 2: "real"}
    for i in range(7):
        decide(store, runs, f"202604{10 + i}/1", PartDecision("accept", "Ann", "dust", words))
    decide(store, runs, f"{FAILED}/1", PartDecision("reject", "Bob", "seen"))
    decide(store, runs, f"{PASSED}/1", PartDecision("reject", "Bob", "a scratch nobody saw"))
    found = agreement(store, Filters())
    by = {(one.kind, one.face): one for one in found.findings}
    missing = by["missing material", "F1 bore 8.0 mm"]
    assert (missing.false_alarms, missing.unnamed) == (Rate(7, 7), 1)
    # exact: the lower end of 7 of 7 is the seventh root of 0.025
    assert missing.false_alarms.interval == pytest.approx((0.025 ** (1 / 7), 1.0))
    assert missing.is_likely_false
    differs = by["surface differs", "F2 plane"]
    assert (differs.false_alarms, differs.is_likely_false) == (Rate(0, 7), False)
    assert found.verdicts == {
        ("featuretype", "fail", "accept"): 7,
        ("featuretype", "fail", "reject"): 1,
        ("featuretype", "pass", "reject"): 1,
    }
    assert found.missed == Rate(1, 1)
    assert agreement(store, Filters(recipe="holder")).findings == ()
    # only parts that await a person are told what is likely false
    assert found.likely == ()
    assert found.awaiting == 1


def test_findings_that_wait_are_named_where_their_kind_is_mostly_false(
    store: Store, runs: Path, blind: None
) -> None:
    def part(run: str) -> None:
        writer = RunWriter(runs, run)
        writer.whole_part(
            (view("G1-V0", finding()), view("G1-V3")),
            verdict(Verdict.INDETERMINATE), "quarantine",
        )  # fmt: skip
        writer.end()

    for i in range(7):
        part(f"202605{10 + i}-120000-000-featuretype")
    fill(store, runs)
    assert agreement(store, Filters()).likely == ()  # nobody has said anything yet
    for i in range(6):
        word = {1: "false_alarm"}
        decide(store, runs, f"202605{10 + i}/1", PartDecision("accept", "Ann", "dust", word))
    (likely,) = agreement(store, Filters()).likely
    assert (likely.part, likely.number) == ("20260516-120000-000-featuretype/1", 1)
    assert likely.reviewed.false_alarms == Rate(6, 6)


@pytest.mark.parametrize(("count", "total"), [(0, 1), (1, 4), (5, 5), (3, 40)])
def test_the_interval_holds_95_percent_of_what_chance_makes(count: int, total: int) -> None:
    from scipy.stats import binom

    lower, upper = Rate(count, total).interval
    assert lower <= count / total <= upper
    if count:
        assert binom.sf(count - 1, total, lower) == pytest.approx(0.025)
    if count < total:
        assert binom.cdf(count, total, upper) == pytest.approx(0.025)
    assert Rate(0, 0).interval == (0.0, 1.0)


# --- the command ---------------------------------------------------------------------------------


def told(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_the_command_lists_shows_and_decides(
    store: Store, runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--runs", str(runs), "--json"]
    assert main(["review", *at]) == 0
    part, listed = told(capsys)
    assert (part["serial"], listed["awaiting"]) == ("SN7", 1)
    assert main(["review", f"{FAILED}/1", *at]) == 0
    (shown,) = told(capsys)
    assert [Path(f["picture"]).name for f in shown["findings"]] == [
        "part001_G1-V0_station_backlight.png", "part001_G1-V0_station_ring.png",
    ]  # fmt: skip
    assert all(Path(f["picture"]).is_file() for f in shown["findings"])
    page = Path(shown["page"]).read_text(encoding="utf-8")
    assert "Finding 1: missing material" in page
    assert main(
        ["review", f"{FAILED}/1", "--verdict", "accept", "--why", "dust", "--who", "Ann",
         "--finding", "1=false_alarm", "--finding", "2=real", *at]
    ) == 0  # fmt: skip
    (done,) = told(capsys)
    assert done["review"] == "accept"
    assert done["reviews"][0]["who"].startswith("Ann (")
    assert main(["history", "--reviewed", *at]) == 0
    assert [one.get("part") for one in told(capsys)] == [f"{FAILED}/1", None]
    assert main(["history", "--awaiting-review", *at]) == 0
    assert [one.get("serial") for one in told(capsys)] == ["SN7", None]
    assert main(["review", "--all", *at]) == 0
    assert len(told(capsys)) == 3


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--verdict", "accept", "--why", "x"], "need PART"),
        (["SN7", "--verdict", "accept"], "needs --why"),
        (["SN7", "--verdict", "ok", "--why", "x"], "one of accept, reject"),
        (["SN7", "--why", "x"], "require --verdict"),
        (["SN7", "--lot", "L1"], "cannot be combined with filters"),
        (["SN7", "--verdict", "accept", "--why", "x", "--finding", "one=real"], "must be N=real"),
        (["SN7", "--verdict", "accept", "--why", "x", "--finding", "1"], "must be N=real"),
        (["--since", "yesterday"], "must be a date"),
    ],
)
def test_wrong_words_are_refused_in_a_sentence(
    store: Store, runs: Path, capsys: pytest.CaptureFixture[str], words: list[str], why: str
) -> None:
    assert main(["review", *words, "--runs", str(runs)]) == 2
    assert why in capsys.readouterr().err


def test_the_tables_for_people_say_who_decided(
    store: Store, runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--runs", str(runs)]
    assert main(["review", "SN7", *at]) == 0
    assert "awaits a person" in capsys.readouterr().out
    assert main(["review", "SN7", "--verdict", "reject", "--why", "a [dent]", *at]) == 0
    assert "reject by" in capsys.readouterr().out
    assert main(["history", "SN7", *at]) == 0
    assert "a [dent]" in capsys.readouterr().out
    for i in range(6):
        words = ["--verdict", "accept", "--why", f"reason {i}"]
        assert main(["review", "SN7", *words, *at]) == 0
    capsys.readouterr()
    assert main(["history", "SN7", *at]) == 0
    out = capsys.readouterr().out
    assert [f"reason {i}" in out for i in range(6)] == [False, *[True] * 5]
    assert "and 2 earlier ones" in out
    assert main(["review", *at]) == 0
    assert capsys.readouterr().out == "no part awaits a person\n"


def test_the_statistics_print_agreement_and_its_interval(
    store: Store, runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    at = ["--runs", str(runs)]
    assert main(["stats", "--review", *at]) == 0
    assert "no person has decided" in capsys.readouterr().out
    words = {1: "false_alarm", 2: "real"}
    decide(store, runs, f"{FAILED}/1", PartDecision("accept", "Ann", "dust", words))
    assert main(["stats", "--review", *at]) == 0
    out = capsys.readouterr().out
    assert "3 to 100 %" in out  # 1 of 1: the lower end is 0.025
    assert "parts that await a person: 1" in out
    assert main(["stats", "--review", "--json", *at]) == 0
    lines = told(capsys)
    assert {line["event"] for line in lines} == {"reviewed_verdict", "reviewed_finding", "missed"}
    assert main(["stats", "--review", "--takt", *at]) == 2
