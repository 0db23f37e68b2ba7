"""The store of all runs: what goes in from journals, what comes out, what stays out."""

from __future__ import annotations

import csv
import json
import multiprocessing
import sqlite3
import subprocess
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from typing import Any

import postgres_server
import pytest
import sqlalchemy
from results_bench import RunWriter, bad_run, good_run, verdict, view

from controller.cell.batch import Papers
from controller.cell.custody import Custody
from controller.cell.journal import JOURNAL_NAME, Stamps, append_beside, rows
from controller.cli import main
from controller.history import (
    SCHEMA_VERSION,
    Filters,
    HistoryError,
    NoSuchPartError,
    Store,
    figures,
    fill,
    find_parts,
    group_json,
    list_parts,
    open_store,
    store_url,
)
from controller.history.exporting import export
from controller.history.keeping import old_pictures
from controller.history.reviewing import PartDecision, decide
from controller.history.tables import METADATA, OF_PART
from controller.inspection import Verdict
from controller.page.records.work import fill_store


@pytest.fixture(scope="module")
def postgres() -> Iterator[str]:
    why = postgres_server.missing()
    if why:
        pytest.skip(why)
    with postgres_server.server() as url:
        yield url


@pytest.fixture(params=["sqlite", "postgres"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    url = store_url(tmp_path, None, {})
    if request.param == "postgres":
        url = request.getfixturevalue("postgres")
    made = open_store(url)
    yield made
    METADATA.drop_all(made.engine)
    made.close()


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


def on(writer: RunWriter, year: int, month: int, day: int) -> RunWriter:
    """Let a run write as if it were noon of a day."""
    writer.journal._stamps = Stamps(utc=lambda: datetime(year, month, day, 12, tzinfo=UTC))
    return writer


def all_rows(store: Store) -> dict[str, list[tuple[Any, ...]]]:
    with store.reading() as db:
        return {
            name: sorted(map(tuple, db.execute(sqlalchemy.select(table))), key=repr)
            for name, table in METADATA.tables.items()
        }


def bore(measured: float | None, U: float | None = 0.02) -> rows.CharacteristicFields:
    word = "not evaluated" if measured is None else "pass" if measured < 8.1 else "fail"
    return rows.CharacteristicFields(
        id="d1", balloon=1, kind="diameter", label="bore 8", nominal=8.0, lower=7.9, upper=8.1,
        source="recipe", faces=(1,), measured=measured, U=U, verdict=word,
    )  # fmt: skip


def part(
    writer: RunWriter,
    word: Verdict = Verdict.PASS,
    tray: str = "accept",
    *more: rows.Body,
) -> None:
    """Let a part pass through a run; the rows in `more` come before its verdict."""
    writer.look()
    writer.plan()
    writer.grasp()
    for label, one, seconds in zip(
        ("show with grasp G1",) * 2, (view("G1-V0"), view("G1-V3")), (4.0, 4.0), strict=True
    ):
        writer.show(label, one, seconds)
        writer.judge_view(one)
    for row in more:
        writer.write(row)
    writer.judge(verdict(word))
    writer.place(tray)


def test_what_a_run_wrote_is_found(store: Store, runs: Path) -> None:
    good_run(runs, papers=Papers(operator="Ann", lot="L7", serials=("SN1",)))
    bad_run(runs)
    assert fill(store, runs).part_count == 2
    listed = list_parts(store, Filters(), 10)
    assert listed.count == 2
    fail, passed = listed.parts  # newest first
    assert (fail["part"], fail["verdict"], fail["tray"], fail["finding_count"]) == (
        "20260302-120000-000-featuretype/1", "fail", "reject", 2,
    )  # fmt: skip
    assert (passed["serial"], passed["lot"], passed["operator"]) == ("SN1", "L7", "Ann")
    # pick 9, two views of 4 each, tray 11; they took 9.5, 4.2, 6.5 and 12.25
    assert passed["done_forecast_s"] == pytest.approx(9 + 4 + 4 + 11)
    assert passed["done_actual_s"] == pytest.approx(9.5 + 4.2 + 6.5 + 12.25)
    assert passed["forecast_s"] == 32.0
    (full,) = find_parts(store, "SN1")
    assert [s["actual_s"] for s in full["steps"]] == [9.5, 4.2, 6.5, 12.25]
    (full,) = find_parts(store, "20260302/1")
    assert [(f["kind"], f["faces"]) for f in full["findings"]] == [
        ("missing material", ["F1 bore 8.0 mm"]),
        ("surface differs", ["F2 plane", "F1 bore 8.0 mm"]),
    ]
    found = figures(store, Filters())
    assert [(t.names, t.count) for t in found.findings] == [
        (("missing material", "F1 bore 8.0 mm"), 1),
        (("surface differs", "F1 bore 8.0 mm"), 1),
        (("surface differs", "F2 plane"), 1),
    ]


def test_filling_again_changes_nothing(store: Store, runs: Path) -> None:
    good_run(runs)
    bad_run(runs)
    fill(store, runs)
    before = all_rows(store)
    assert fill(store, runs).part_count == 0
    assert all_rows(store) == before
    assert fill(store, runs, anew=True).part_count == 2
    assert all_rows(store) == before


def test_a_run_that_goes_on_is_brought_up_part_by_part(store: Store, runs: Path) -> None:
    writer = RunWriter(runs, count=3)
    part(writer)
    writer.look()
    writer.plan()
    writer.once("grip", is_done=False)
    fill(store, runs)
    second, first = list_parts(store, Filters(), 10).parts
    assert (first["verdict"], first["is_open"]) == ("pass", False)
    assert (second["verdict"], second["custody"], second["is_open"]) == (
        "no verdict", "on_table", True,
    )  # fmt: skip
    writer.write(rows.OnceDone(name="grip"))
    writer.custody(Custody.IN_ARM)
    writer.judge(verdict(Verdict.FAIL))
    writer.place("reject")
    writer.end()
    assert fill(store, runs).part_count == 1  # the first part is not read again
    second, _ = list_parts(store, Filters(), 10).parts
    assert (second["verdict"], second["tray"], second["is_open"]) == ("fail", "reject", False)
    assert find_parts(store, "20260301/2")[0]["outcome"] == "complete"


def test_a_filler_that_was_killed_goes_on(store: Store, runs: Path, tmp_path: Path) -> None:
    for day in range(1, 5):
        good_run(runs, f"2026030{day}-120000-000-featuretype")

    def kill(run: str, parts: int) -> None:
        if run.startswith("20260302"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fill(store, runs, on_run=kill)
    assert 2 <= list_parts(store, Filters(), 10).count < 4
    went: list[str] = []
    fill(store, runs, on_run=lambda run, parts: went.append(run[:8]))
    assert "20260301" not in went
    assert went[-2:] == ["20260303", "20260304"]
    assert list_parts(store, Filters(), 10).count == 4


def test_a_part_is_replaced_whole_or_not_at_all(
    store: Store, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    good_run(runs)

    class Killed:
        def __iter__(self) -> Iterator[object]:
            raise KeyboardInterrupt

    # the part itself is written by then, what hangs on it is not
    monkeypatch.setattr("controller.history.filling.OF_PART", Killed())
    with pytest.raises(KeyboardInterrupt):
        fill(store, runs)
    assert all(not found for name, found in all_rows(store).items() if name in ("parts", "runs"))
    monkeypatch.undo()
    assert fill(store, runs).part_count == 1


def test_first_pass_is_counted_by_serial_number(store: Store, runs: Path) -> None:
    # A fails and passes the next day; B passes; one without a number passes, one fails
    writer = on(RunWriter(runs, "20260301-a", papers=Papers(serials=("A", "B"))), 2026, 3, 1)
    part(writer, Verdict.FAIL, "reject")
    part(writer)
    writer.end()
    writer = on(RunWriter(runs, "20260302-b", papers=Papers(serials=("A",))), 2026, 3, 2)
    part(writer)
    part(writer)
    part(writer, Verdict.FAIL, "reject")
    writer.end()
    fill(store, runs)
    (found,) = figures(store, Filters()).groups
    assert (found.part_count, found.judged_count, found.pass_count) == (5, 5, 3)
    assert (found.first_count, found.first_pass_count) == (4, 2)
    assert found.first_pass_yield == 0.5
    first, second = figures(store, Filters(), "day").groups
    assert (first.name, first.first_count, first.first_pass_count) == ("2026-03-01", 2, 1)
    # A was judged the day before
    assert (second.name, second.first_count, second.first_pass_count) == ("2026-03-02", 2, 1)
    # five parts of 9 + 4 + 4 + 11 s, each of which took 9.5 + 4 + 4 + 12.25
    assert found.against_forecast == pytest.approx(29.75 / 28)
    assert len(find_parts(store, "A")) == 2


def test_filters_choose_parts(store: Store, runs: Path) -> None:
    for day, lot, operator in ((1, "L1", "Ann"), (2, "L2", "Ann"), (3, "L2", "Bob")):
        papers = Papers(lot=lot, operator=operator, serials=(f"S{day}",))
        writer = on(RunWriter(runs, f"2026030{day}-x", papers=papers), 2026, 3, day)
        part(writer, Verdict.FAIL if day == 3 else Verdict.PASS)
        writer.end()
    fill(store, runs)

    def days(**words: Any) -> list[int]:
        found = list_parts(store, Filters(**words), 10)
        assert found.count == len(found.parts)
        return [int(one["run"][7]) for one in found.parts]

    assert days() == [3, 2, 1]
    assert days(lot="L2") == [3, 2]
    assert days(operator="Ann") == [2, 1]
    assert days(verdict="fail") == [3]
    assert days(serial="S2") == [2]
    assert days(run="20260301") == [1]
    assert days(run="2026030_") == []  # no pattern
    assert days(recipe="featuretype", lot="L2", operator="Ann") == [2]
    assert days(recipe="other") == []
    assert days(since=datetime(2026, 3, 2)) == [3, 2]  # noqa: DTZ001 - UTC, as the store has it
    assert days(until=datetime(2026, 3, 2)) == [1]  # noqa: DTZ001
    listed = list_parts(store, Filters(), 2)
    assert (listed.count, len(listed.parts)) == (3, 2)


def test_characteristics_recoveries_and_alarms_are_kept(store: Store, runs: Path) -> None:
    writer = RunWriter(runs)
    recovery = rows.RecoveryBegun(
        fault="grip_missed",
        reason="jaws closed on nothing",
        action="look_again",
        number=1,
        alarm=201,
    )
    part(writer, Verdict.PASS, "accept", recovery, rows.PartMeasured(characteristics=(bore(8.03),)))
    part(writer, Verdict.PASS, "accept", rows.PartMeasured(characteristics=(bore(None, None),)))
    alarm = rows.AlarmFields(number=404, code="emergency_stop", device="io")
    writer.journal.write(
        rows.CellEvent(
            name="fault", answer="handled", source="a", target="b", code="emergency_stop",
            alarm=alarm,
        )
    )  # fmt: skip
    writer.journal.write(rows.AtRest(state="aborted", code="emergency_stop", alarm=alarm))
    writer.close()
    fill(store, runs)
    first, second = (find_parts(store, f"20260301/{n}")[0] for n in (1, 2))
    (value,) = first["characteristics"]
    assert (value["id"], value["lower"], value["upper"]) == ("d1", 7.9, 8.1)
    assert (value["measured"], value["U"], value["verdict"]) == (8.03, 0.02, "pass")
    assert second["characteristics"][0]["measured"] is None
    assert first["recovery_count"] == 1
    assert [(r["fault"], r["action"], r["alarm"]) for r in first["recoveries"]] == [
        ("grip_missed", "look_again", 201)
    ]
    found = figures(store, Filters())
    assert [(t.names, t.count, t.part_count) for t in found.recoveries] == [
        (("grip_missed", "look_again"), 1, 1)
    ]
    # of the event, and not once more of how the run came to rest
    assert [t.count for t in found.alarms if t.names[0] == "404"] == [1]
    assert [t.count for t in found.alarms if t.names[0] == "201"] == [1]


def tamper(journal: Path, run: str, kind: str, body: str) -> None:
    with sqlite3.connect(journal) as db:
        db.execute("DROP TRIGGER journal_keeps_rows")
        db.execute(
            "UPDATE journal SET body = ? WHERE run = ? AND name = ?", (body, run, kind)
        )  # fmt: skip
    db.close()


def test_runs_before_a_changed_row_go_in_and_the_others_are_named(store: Store, runs: Path) -> None:
    for day in (1, 2, 3):
        good_run(runs, f"2026030{day}-120000-000-featuretype")
    tamper(runs / "journal.sqlite", "20260302-120000-000-featuretype", "verdict", "{}")
    filled = fill(store, runs)
    assert filled.part_count == 1
    (problem,) = filled.problems
    assert "run 20260302-120000-000-featuretype was changed" in problem
    assert [one["run"][:8] for one in list_parts(store, Filters(), 9).parts] == ["20260301"]
    assert fill(store, runs).problems == [problem]


def test_a_journal_of_another_version_is_named_and_the_rest_goes_in(
    store: Store, runs: Path
) -> None:
    good_run(runs)
    for name in ("journal.sqlite", "journal.sqlite.head"):
        (runs / name).rename(runs / name.replace("journal", "journal-set-aside-20260301", 1))
    aside = next(runs.glob("journal-set-aside*.sqlite"))
    bad_run(runs)
    assert fill(store, runs).part_count == 2  # one set aside goes in, too
    with sqlite3.connect(aside) as db:
        db.execute("PRAGMA user_version = 99")
    db.close()
    good_run(runs, "20260303-120000-000-featuretype")
    filled = fill(store, runs)
    assert filled.part_count == 1
    assert "is of version 99" in filled.problems[0]
    assert list_parts(store, Filters(), 9).count == 3


def test_a_part_that_cannot_be_read_is_named_each_time(store: Store, runs: Path) -> None:
    writer = RunWriter(runs)
    part(writer)
    writer.look()
    writer.journal.record("decision", "verdict", {"verdict": ["of", "tomorrow"]}, 2)
    part(writer)
    writer.end()
    for _ in range(2):
        (problem,) = fill(store, runs).problems
        assert "part 2 is left out" in problem
        assert "not what this version of cellctl writes" in problem
    assert [one["number"] for one in list_parts(store, Filters(), 9).parts] == [3, 1]


def test_the_journal_is_right_once_somebody_decides_so(store: Store, runs: Path) -> None:
    good_run(runs)
    kept = {name: (runs / name).read_bytes() for name in ("journal.sqlite", "journal.sqlite.head")}
    bad_run(runs)
    fill(store, runs)
    for name, data in kept.items():  # an older journal is put back
        (runs / name).write_bytes(data)
    good_run(runs, "20260305-120000-000-featuretype")
    (problem,) = fill(store, runs).problems
    assert "is not the one that the store was filled by" in problem
    assert list_parts(store, Filters(), 9).count == 2
    assert fill(store, runs, anew=True).problems == []
    assert [one["run"][:8] for one in list_parts(store, Filters(), 9).parts] == [
        "20260305", "20260301",
    ]  # fmt: skip
    with store.reading() as db:
        for table in OF_PART:
            orphans = sqlalchemy.select(table.c.part_id).where(
                table.c.part_id.not_in(sqlalchemy.select(METADATA.tables["parts"].c.part_id))
            )
            assert db.execute(orphans).all() == []


def test_a_store_of_version_1_is_brought_up_and_filled_once_more(store: Store, runs: Path) -> None:
    good_run(runs)
    fill(store, runs)
    with store.engine.begin() as db:
        for name in ("steps", "recoveries", "alarms"):
            db.execute(sqlalchemy.text(f"DROP TABLE {name}"))
        db.execute(sqlalchemy.text("UPDATE store_version SET version = 1"))
    older = open_store(store.engine.url.render_as_string(hide_password=False))
    try:
        assert list_parts(older, Filters(), 9).count == 1  # what is there stays
        assert find_parts(older, "20260301/1")[0]["steps"] == []
        assert fill(older, runs).part_count == 1
        assert len(find_parts(older, "20260301/1")[0]["steps"]) == 4
    finally:
        older.close()


def test_a_later_or_foreign_store_is_refused(store: Store, tmp_path: Path) -> None:
    url = store.engine.url.render_as_string(hide_password=False)
    with store.engine.begin() as db:
        db.execute(sqlalchemy.text(f"UPDATE store_version SET version = {SCHEMA_VERSION + 1}"))
    with pytest.raises(HistoryError, match=f"of version {SCHEMA_VERSION + 1}, this cellctl knows"):
        open_store(url)
    foreign = tmp_path / "foreign.sqlite"
    with sqlite3.connect(foreign) as db:
        db.execute("CREATE TABLE holiday (day TEXT)")
    db.close()
    with pytest.raises(HistoryError, match="tables that are not of cellctl"):
        open_store(f"sqlite:///{foreign}")
    (tmp_path / "text").write_text("no database" * 100)
    with pytest.raises(HistoryError, match="not a database"):
        open_store(f"sqlite:///{tmp_path}/text")
    with pytest.raises(HistoryError, match="URL cannot be read"):
        open_store("secret-password")


def test_filling_only_reads_and_holds_up_no_writer(store: Store, runs: Path) -> None:
    writer = RunWriter(runs)
    part(writer)
    writer.journal._db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    before = (runs / "journal.sqlite").read_bytes()
    fill(store, runs)
    assert (runs / "journal.sqlite").read_bytes() == before
    # no reader is left that would keep the writer's log from being emptied
    busy, *_ = writer.journal._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchone()
    assert not busy
    writer.end()


def test_two_fillers_at_once_write_what_one_does(store: Store, runs: Path) -> None:
    for day in range(1, 4):
        good_run(runs, f"2026030{day}-120000-000-featuretype")
    url = store.engine.url.render_as_string(hide_password=False)
    other = open_store(url)
    try:
        # the second one reads everything while the first is between its runs
        fill(store, runs, on_run=lambda run, parts: fill(other, runs) and None)
    finally:
        other.close()
    assert list_parts(store, Filters(), 9).count == 3
    once = all_rows(store)
    fill(store, runs, anew=True)
    assert all_rows(store) == once


def test_no_such_part_is_said(store: Store, runs: Path) -> None:
    good_run(runs)
    bad_run(runs)
    fill(store, runs)
    for word in ("SN9", "20260301/2", "20260301", "x/1", "/1", "20260301/99999999999999999999"):
        with pytest.raises(NoSuchPartError):
            find_parts(store, word)
    with pytest.raises(HistoryError, match="2 runs begin with `2026030`"):
        find_parts(store, "2026030/1")


def printed(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_history_on_the_command_line(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good_run(runs, papers=Papers(serials=("=SN1",)))
    bad_run(runs)
    where = ["--runs", str(runs)]
    assert main(["history", *where, "--json"]) == 0
    *parts, end = printed(capsys)
    assert [one["verdict"] for one in parts] == ["fail", "pass"]
    assert end == {"event": "listed", "count": 2, "listed": 2}
    assert main(["history", *where, "--verdict", "FAIL", "--since", "2026-01-01"]) == 0
    said = capsys.readouterr().out
    assert "20260302-120000-000-featuretype/1" in said
    assert "20260301-120000-000-featuretype/1" not in said
    assert main(["history", *where, "=SN1"]) == 0
    assert "20260301-120000-000-featuretype/1: PASS" in capsys.readouterr().out
    assert main(["history", *where, "SN9"]) == 2
    assert main(["history", *where, "--until", "2020-01-01"]) == 0
    assert "no part fits" in capsys.readouterr().out
    good_run(runs, "20260303-120000-000-featuretype")
    assert main(["history", *where, "--json"]) == 0
    assert printed(capsys)[-1]["count"] == 3  # a newer journal is read first


def test_exports_hold_each_value_of_each_part(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = RunWriter(runs, papers=Papers(serials=("=SN1",)))
    part(writer, Verdict.PASS, "accept", rows.PartMeasured(characteristics=(bore(8.03),)))
    part(writer, Verdict.FAIL, "reject")
    writer.end()
    where = ["history", "--runs", str(runs), "--export"]
    assert main([*where, str(tmp_path / "all.csv")]) == 0
    with (tmp_path / "all.csv").open(encoding="utf-8-sig", newline="") as file:
        first, second = csv.DictReader(file)
    assert first["serial"] == "'=SN1"  # no formula
    assert (first["id"], first["measured"], first["U_k2"]) == ("d1", "8.03", "0.02")
    assert (second["part_verdict"], second["id"]) == ("fail", "")
    parquet = pytest.importorskip("pyarrow.parquet")
    assert main([*where, str(tmp_path / "all.parquet")]) == 0
    table = parquet.read_table(tmp_path / "all.parquet").to_pylist()
    assert [one["serial"] for one in table] == ["=SN1", ""]
    assert [one["measured"] for one in table] == [8.03, None]
    assert table[0]["start"].tzinfo is not None
    assert main([*where, str(tmp_path / "all.qif"), "--json"]) == 0
    assert b"=SN1" in (tmp_path / "all.qif").read_bytes()
    assert main([*where, str(tmp_path / "none.qif"), "--recipe", "other"]) == 1
    assert not (tmp_path / "none.qif").exists()
    capsys.readouterr()


def test_parquet_without_its_library_is_a_sentence(
    runs: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    good_run(runs)
    monkeypatch.setitem(__import__("sys").modules, "pyarrow", None)
    words = ["history", "--runs", str(runs), "--export", str(tmp_path / "x.parquet")]
    assert main(words) == 1
    assert "pip install 'cellctl[parquet]'" in capsys.readouterr().err
    assert not (tmp_path / "x.parquet").exists()


def test_the_store_is_named_by_option_variable_or_folder() -> None:
    runs = Path("/somewhere/runs")
    assert store_url(runs, None, {}) == "sqlite:////somewhere/runs/history.sqlite"
    assert store_url(runs, None, {"CELLCTL_HISTORY": "sqlite:///a"}) == "sqlite:///a"
    assert store_url(runs, "sqlite:///b", {"CELLCTL_HISTORY": "sqlite:///a"}) == "sqlite:///b"


def test_a_password_is_in_no_message() -> None:
    with pytest.raises(HistoryError) as caught:
        open_store("postgresql+pg8000://cell:secret@127.0.0.1:9/history")
    assert "secret" not in str(caught.value)


def test_seconds_a_part_are_those_of_parts_with_a_verdict(store: Store, runs: Path) -> None:
    writer = RunWriter(runs, "20260301-a", count=2)
    seconds = count()
    noon = datetime(2026, 3, 1, 12, tzinfo=UTC)
    writer.journal._stamps = Stamps(utc=lambda: noon + timedelta(seconds=next(seconds)))
    part(writer)
    writer.look()
    for _ in range(100):  # then it was stopped
        writer.plan()
    writer.end()
    fill(store, runs)
    judged, cut_off = sorted(list_parts(store, Filters(), 10).parts, key=lambda one: one["number"])
    assert [one["verdict"] for one in (judged, cut_off)] == ["pass", "no verdict"]
    (found,) = figures(store, Filters()).groups
    assert (found.part_count, found.judged_count) == (2, 1)
    (full,) = find_parts(store, judged["part"])
    assert 0 < full["wall_s"] < 100
    assert found.part_s == full["wall_s"] == group_json(found)["wall_s"]


def test_yields_on_the_command_line(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = on(RunWriter(runs, "20260301-a", papers=Papers(lot="L1")), 2026, 3, 1)
    part(writer)
    part(writer, Verdict.FAIL, "reject")
    writer.end()
    writer = on(RunWriter(runs, "20260302-b", papers=Papers(lot="L2")), 2026, 3, 2)
    part(writer)
    writer.end()
    where = ["--runs", str(runs)]
    assert main(["stats", *where, "--by", "lot", "--json"]) == 0
    first, second = (one for one in printed(capsys) if one["event"] == "group")
    assert (first["name"], first["parts"], first["first_pass_yield"]) == ("L1", 2, 0.5)
    assert (second["name"], second["parts"], second["first_pass_yield"]) == ("L2", 1, 1.0)
    # each part took 29.75 s where 28 s were forecast: 106 %
    assert main(["stats", "featuretype", *where, "--by", "day", "--until", "2026-03-01"]) == 0
    said = capsys.readouterr().out
    assert "2026-03-01" in said
    assert "2026-03-02" not in said
    assert "50.0 %" in said
    assert "106 %" in said
    assert main(["stats", *where]) == 0
    assert "66.7 %" in capsys.readouterr().out
    assert main(["stats", *where, "--by", "moon"]) == 2
    assert main(["stats", "featuretype", *where]) == 0  # as before: no characteristic here
    assert "no characteristic was measured" in capsys.readouterr().out


def cell_with_a_part(folder: Path, name: str, serial: str, parts: int = 1) -> RunWriter:
    """Let a cell of a name write a run; every cell's has one id."""
    folder.mkdir(parents=True)
    serials = (serial,) if parts == 1 else tuple(f"{serial}-{k}" for k in range(parts))
    writer = RunWriter(folder, count=parts, papers=Papers(serials=serials), cell_name=name)
    for _ in range(parts):
        part(writer)
    writer.end()
    return writer


def test_two_cells_that_start_a_recipe_in_one_millisecond_both_go_in(
    store: Store, tmp_path: Path
) -> None:
    cells = {name: tmp_path / name for name in ("cell-1", "cell-2")}
    for i, (name, folder) in enumerate(cells.items(), 1):
        cell_with_a_part(folder, name, f"SN{i}")
        assert fill(store, folder).part_count == 1
    for folder in cells.values():  # filling again finds each its own
        assert fill(store, folder).problems == []
    run = "20260301-120000-000-featuretype"
    listed = list_parts(store, Filters(), 9).parts
    assert {(one["cell"], one["part"], one["run"]) for one in listed} == {
        (name, f"{name}/{run}/1", run) for name in cells
    }
    assert [one["serial"] for one in list_parts(store, Filters(cell="cell-2"), 9).parts] == ["SN2"]
    (found,) = find_parts(store, "cell-1/20260301/1")
    assert (found["serial"], found["cell"], found["part"]) == ("SN1", "cell-1", f"cell-1/{run}/1")
    with pytest.raises(HistoryError, match=f"name one: cell-1/{run}, cell-2/{run}"):
        find_parts(store, f"{run}/1")
    assert [one.name for one in figures(store, Filters(), "cell").groups] == ["cell-1", "cell-2"]
    by_run = figures(store, Filters(), "run").groups
    assert [(one.name, one.part_count) for one in by_run] == [
        (f"cell-1/{run}", 1), (f"cell-2/{run}", 1),
    ]  # fmt: skip
    # a person's verdict goes into the journal of the part's own cell
    with pytest.raises(HistoryError, match=r"of cell cell-2, whose journal is not in .*cell-1"):
        decide(store, cells["cell-1"], "SN2", PartDecision("reject", "Ann", "a scratch"))
    part_now = decide(store, cells["cell-2"], "SN2", PartDecision("reject", "Ann", "a scratch"))
    assert (part_now["part"], part_now["review"]) == (f"cell-2/{run}/1", "reject")
    assert find_parts(store, "SN1")[0]["review"] == ""
    with pytest.raises(HistoryError, match=r"cell-1 is not in .*cell-2"):
        export(store, Filters(cell="cell-1"), tmp_path / "o.qif", cells["cell-2"])
    assert export(store, Filters(cell="cell-1"), tmp_path / "o.qif", cells["cell-1"]) == 1


def test_two_cells_of_one_name_are_named_and_the_first_stays(store: Store, tmp_path: Path) -> None:
    for i in (1, 2):
        cell_with_a_part(tmp_path / str(i), "cell-1", f"SN{i}")
    assert fill(store, tmp_path / "1").problems == []
    (problem,) = fill(store, tmp_path / "2").problems
    assert "cell cell-1 has it from another journal" in problem
    assert [one["serial"] for one in list_parts(store, Filters(), 9).parts] == ["SN1"]


def test_old_pictures_of_a_cell_are_not_told_by_another_cells_runs(
    store: Store, tmp_path: Path
) -> None:
    mine = cell_with_a_part(tmp_path / "1", "cell-1", "SN1")
    names = [path.relative_to(mine.folder).as_posix() for path in mine.folder.rglob("*.png")]
    stored = rows.FilesStored(dict.fromkeys(names, "0" * 64))
    append_beside(tmp_path / "1" / JOURNAL_NAME, mine.run_id, stored)
    cell_with_a_part(tmp_path / "2", "cell-2", "SN2")
    for folder in ("1", "2"):
        fill(store, tmp_path / folder)
    # the only run of a cell is its newest, whenever another cell ran
    assert list(old_pictures(store, tmp_path / "1", datetime.max)) == []  # noqa: DTZ901
    assert list(old_pictures(store, tmp_path / "nowhere", datetime.max)) == []  # noqa: DTZ901


def test_a_store_of_version_5_takes_runs_of_one_id_from_two_cells(
    store: Store, tmp_path: Path
) -> None:
    cell_with_a_part(tmp_path / "1", "cell-1", "SN1")
    fill(store, tmp_path / "1")
    runs_table = METADATA.tables["runs"]
    with store.engine.begin() as db:
        if store.file:
            apart = sqlalchemy.MetaData()
            METADATA.tables["journals"].to_metadata(apart)
            before = runs_table.to_metadata(apart, name="runs_before")
            before.constraints = {one for one in before.constraints if one.name != "runs_of_cell"}
            before.append_constraint(sqlalchemy.UniqueConstraint("run_id"))
            before.create(db)
            db.execute(sqlalchemy.text("INSERT INTO runs_before SELECT * FROM runs"))
            db.execute(sqlalchemy.text("DROP TABLE runs"))
            db.execute(sqlalchemy.text("ALTER TABLE runs_before RENAME TO runs"))
        else:
            db.execute(sqlalchemy.text("ALTER TABLE runs DROP CONSTRAINT runs_of_cell"))
            db.execute(sqlalchemy.text("ALTER TABLE runs ADD UNIQUE (run_id)"))
        db.execute(sqlalchemy.text("UPDATE store_version SET version = 5"))
    before_rows = all_rows(store)
    newer = open_store(store.engine.url.render_as_string(hide_password=False))
    try:
        after_rows = all_rows(newer)
        read_again = {"store_version": [], "journals": []}
        assert {**after_rows, **read_again} == {**before_rows, **read_again}
        cell_with_a_part(tmp_path / "2", "cell-2", "SN2")
        assert fill(newer, tmp_path / "2").part_count == 1
    finally:
        newer.close()


def test_ten_parts_take_a_server_as_many_round_trips_as_one(postgres: str, tmp_path: Path) -> None:
    trips = {}
    with postgres_server.counted(postgres) as wire:
        for i, count_ in enumerate((1, 10)):
            folder = tmp_path / str(i)
            cell_with_a_part(folder, f"cell-{i}", f"SN{i}", count_)
            store = open_store(wire.url)
            try:
                before = wire.round_trips
                assert fill(store, folder).part_count == count_
                trips[count_] = wire.round_trips - before
            finally:
                METADATA.drop_all(store.engine)
                store.close()
    assert 0 < trips[10] <= trips[1]


@pytest.mark.slow
def test_ten_cells_fill_one_store_at_once_and_psql_reads_them(
    postgres: str, tmp_path: Path
) -> None:
    folders = [tmp_path / f"cell-{i}" for i in range(10)]
    for i, folder in enumerate(folders):
        cell_with_a_part(folder, folder.name, f"SN{i}", 3)
    apart = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(len(folders), mp_context=apart) as pool:  # they make it, too
            ends = list(pool.map(fill_store, [postgres] * len(folders), folders))
        assert [problems for problems, _ in ends] == [()] * len(folders)
        query = (
            "SELECT r.cell, count(*), count(DISTINCT r.run_id), sum(s.n) FROM parts p JOIN runs r "
            "USING (run_no) JOIN (SELECT part_id, count(*) AS n FROM steps GROUP BY 1) s "
            "USING (part_id) GROUP BY 1 ORDER BY 1"
        )
        sock = Path(postgres.rpartition("=")[2])
        psql = ["psql", "-h", str(sock.parent), "-U", "cell", "-At", "-c", query, "postgres"]
        found = subprocess.run(psql, check=True, capture_output=True, text=True, timeout=60).stdout
        steps = 3 * 4  # of each part: the grasp, two views, the tray
        assert found.splitlines() == [f"{folder.name}|3|1|{steps}" for folder in folders]
    finally:
        store = open_store(postgres)
        METADATA.drop_all(store.engine)
        store.close()


def test_cells_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    url = f"sqlite:///{tmp_path}/all.sqlite"
    for i, count_ in ((1, 1), (2, 2)):
        folder = tmp_path / str(i)
        cell_with_a_part(folder, f"cell-{i}", f"SN{i}", count_)
        assert main(["history", "--runs", str(folder), "--store", url]) == 0
    capsys.readouterr()
    at = ["--runs", str(tmp_path / "1"), "--store", url, "--json"]
    for command in (["history", "--by", "cell"], ["stats", "--by", "cell"]):
        assert main([*command, *at]) == 0
        found = [(one["name"], one["parts"]) for one in printed(capsys) if one["event"] == "group"]
        assert found == [("cell-1", 1), ("cell-2", 2)]
    assert main(["history", "--cell-name", "cell-2", *at]) == 0
    *listed, count_line = printed(capsys)
    assert ({one["cell"] for one in listed}, count_line["count"]) == ({"cell-2"}, 2)
    assert main(["stats", "--by", "recipe", "--cell-name", "cell-2", *at]) == 0
    assert [one["parts"] for one in printed(capsys) if one["event"] == "group"] == [2]
    assert main(["history", *at[:-1]]) == 0
    assert "cell-1" in capsys.readouterr().out  # a column, as there are several cells
    assert main(["history", "--by", "colour", *at]) == 2
    assert main(["stats", "--takt", "--cell-name", "cell-2", "--runs", at[1]]) == 2
    assert main(["history", "--cell-name", "cell-1", "--export", f"{tmp_path}/o.csv", *at]) == 0
    with (tmp_path / "o.csv").open(encoding="utf-8-sig", newline="") as file:
        assert {row["cell"] for row in csv.DictReader(file)} == {"cell-1"}
