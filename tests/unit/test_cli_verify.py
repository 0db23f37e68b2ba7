"""`cellctl verify` and `replay`: what a run left is proven, and judged once more."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import stored_run

from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.cli import main


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of runs with one run; tests copy it."""
    runs = tmp_path_factory.mktemp("stored") / "runs"
    stored_run.write(runs)
    return runs


@pytest.fixture
def runs(stored: Path, tmp_path: Path) -> Path:
    shutil.copytree(stored, tmp_path / "runs")
    return tmp_path / "runs"


def lines_of(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def run(runs: Path, *words: str) -> int:
    return main([*words, "--runs", str(runs), "--json"])


def subjects(printed: str) -> list[str]:
    return [line["subject"] for line in lines_of(printed) if line["event"] == "tampered"]


def test_a_run_as_it_was_written_is_proven(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(runs, "verify", stored_run.RUN) == 0
    [end] = lines_of(capsys.readouterr().out)
    assert end["untampered"] is True
    assert end["files"] == 10  # three views, three lamps, and the file of the views
    assert run(runs, "verify", "--head", end["last_hash"]) == 0
    assert main(["verify", str(runs / stored_run.RUN)]) == 0
    assert "as it was written" in capsys.readouterr().out


def brighten(folder: Path) -> None:
    path = str(folder / "pictures" / "v01_ring.png")
    picture = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    assert picture is not None
    picture[100, 100] ^= 1
    cv2.imwrite(path, picture)


def turn_views(folder: Path) -> None:
    path = folder / "part001.views.json"
    path.write_text(path.read_text().replace('"min_coverage": 0.1', '"min_coverage": 0.05'))


FILES: dict[str, tuple[Callable[[Path], Any], str, str]] = {
    "one grey level of a picture": (brighten, "pictures/v01_ring.png", "was changed"),
    "a picture taken away": (
        lambda f: (f / "pictures/v00_side.png").unlink(), "pictures/v00_side.png", "is missing",
    ),
    "a picture added": (
        lambda f: shutil.copy(f / "pictures/v00_side.png", f / "pictures/v99_side.png"),
        "pictures/v99_side.png", "is not in the journal",
    ),
    "the views": (turn_views, "part001.views.json", "was changed"),
    "a report from elsewhere": (
        lambda f: (f / "report.html").write_text("PASS"), "report.html", "is not in the journal",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_is_another_is_named(
    runs: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, subject, problem = FILES[name]
    spoil(runs / stored_run.RUN)
    assert run(runs, "verify") == 1
    lines = lines_of(capsys.readouterr().out)
    assert [line["subject"] for line in lines[:-1]] == [subject]
    assert problem in lines[0]["problem"]
    assert lines[-1]["untampered"] is False


def forge(runs: Path, change: Callable[[sqlite3.Connection], object]) -> None:
    """Change the journal as one who knows SQLite would: without the triggers that forbid it."""
    db = sqlite3.connect(runs / JOURNAL_NAME, isolation_level=None)
    triggers = db.execute("SELECT name, sql FROM sqlite_schema WHERE type = 'trigger'").fetchall()
    for name, _ in triggers:
        db.execute(f"DROP TRIGGER {name}")
    change(db)
    for _, sql in triggers:
        db.execute(sql)
    db.close()


VERDICT = "SELECT seq FROM journal WHERE name = 'verdict'"


def to_pass(db: sqlite3.Connection) -> None:
    db.execute("UPDATE journal SET body = replace(body, 'indeterminate', 'pass') "
               f"WHERE seq = ({VERDICT})")  # fmt: skip


def with_a_hash_made_to_fit(db: sqlite3.Connection) -> None:
    to_pass(db)
    *fields, prev, _ = db.execute(f"SELECT * FROM journal WHERE seq = ({VERDICT})").fetchone()
    text = json.dumps([prev, *fields], separators=(",", ":"), ensure_ascii=False)
    digest = hashlib.sha256(text.encode()).hexdigest()
    db.execute("UPDATE journal SET hash = ? WHERE seq = ?", (digest, fields[0]))


def test_a_row_that_is_another_is_named(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forge(runs, to_pass)
    assert run(runs, "verify") == 1
    assert subjects(capsys.readouterr().out) == [f"row 14 (verdict, run {stored_run.RUN})"]


def test_a_row_whose_hash_was_made_to_fit_leaves_the_next_one_alone(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forge(runs, with_a_hash_made_to_fit)
    assert run(runs, "verify") == 1
    [line, _] = lines_of(capsys.readouterr().out)
    assert line["subject"].startswith("row 15 (part_inspected")
    assert "row 14, which was replaced" in line["problem"]


def test_a_row_that_was_removed_is_missed(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forge(runs, lambda db: db.execute(f"DELETE FROM journal WHERE seq = ({VERDICT})"))
    assert run(runs, "verify") == 1
    assert "row 14 was removed" in lines_of(capsys.readouterr().out)[0]["problem"]


def test_rows_cut_off_the_end_are_missed(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forge(runs, lambda db: db.execute("DELETE FROM journal WHERE seq > 14"))
    assert run(runs, "verify") == 1
    assert subjects(capsys.readouterr().out) == ["journal"]


def test_what_was_written_anew_as_a_whole_shows_by_a_hash_kept_elsewhere_only(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(runs, "verify")
    noted = lines_of(capsys.readouterr().out)[-1]["last_hash"]
    folder = runs / stored_run.RUN
    brighten(folder)
    digest = hashlib.sha256((folder / "pictures/v01_ring.png").read_bytes()).hexdigest()
    with closing(sqlite3.connect(runs / JOURNAL_NAME)) as db:
        found = db.execute("SELECT kind, name, body, part FROM journal ORDER BY seq").fetchall()
    for path in runs.glob(f"{JOURNAL_NAME}*"):
        path.unlink()
    journal = Journal(runs / JOURNAL_NAME, stored_run.RUN)
    for kind, name, body, part in found:
        fields = json.loads(body)
        if "pictures/v01_ring.png" in fields:
            fields = {"pictures/v01_ring.png": digest}
        journal.record(kind, name, fields, part)
    journal.close()
    assert run(runs, "verify") == 0  # as docs/inspect.md admits
    capsys.readouterr()
    assert run(runs, "verify", "--head", noted) == 1
    assert subjects(capsys.readouterr().out) == ["journal"]


def test_a_report_is_noted_when_it_is_written(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "--runs", str(runs)]) == 0
    assert run(runs, "verify") == 0
    (runs / stored_run.RUN / "report.html").write_text("PASS", encoding="utf-8")
    capsys.readouterr()
    assert run(runs, "verify") == 1
    assert subjects(capsys.readouterr().out) == ["report.html"]
    assert main(["report", "--runs", str(runs)]) == 0  # written again, and noted again
    assert run(runs, "verify") == 0


@pytest.mark.parametrize("form", ["html", "pdf", "json", "csv", "qif", "dfq"])
def test_a_full_disk_costs_no_earlier_report_and_no_proof(
    runs: Path, form: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = runs / stored_run.RUN
    report = folder / f"report.{form}"
    words = ["report", "--runs", str(runs), "--format", form, "--output", str(report)]
    assert main(words) == 0
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    fill_the_disk(monkeypatch)
    capsys.readouterr()
    assert main(words) == 1
    said = capsys.readouterr().err
    assert f"{report}: No space left on device" in said
    assert len(said.splitlines()) == 1
    monkeypatch.undo()
    after = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert after == before
    assert run(runs, "verify") == 0


def fill_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let files be made, as checks before work do, and take no more than 4 KiB each."""
    make = tempfile.NamedTemporaryFile

    def full(*words: Any, **options: Any) -> Any:
        file = make(*words, **options)

        def write(data: bytes) -> int:
            file.file.write(data[:4096])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        file.write = write
        return file

    monkeypatch.setattr(tempfile, "NamedTemporaryFile", full)


def test_a_replay_by_a_recipe_that_names_what_the_part_lacks_is_refused(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = runs / stored_run.RUN / "inputs" / "other.yaml"
    recipe.write_text(
        "name: shown\npart: shown.stl\ninspection:\n  characteristics:\n"
        "    - {id: hole 99 mm diameter, plus: 0.1, minus: 0.1}\n"
    )
    assert run(runs, "replay", "--recipe", str(recipe)) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert f"{recipe}:5: `inspection.characteristics`" in printed.err


def test_a_picture_of_another_size_ends_a_replay(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = runs / stored_run.RUN / "pictures" / "v01_ring.png"
    cv2.imwrite(str(path), np.zeros((100, 120), np.uint8))
    assert run(runs, "replay") == 2
    assert "120 x 100 px, the calibration is for 640 x 512 px" in capsys.readouterr().err


def test_a_run_of_an_earlier_version_cannot_be_proven(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = Journal(tmp_path / JOURNAL_NAME, "old")
    journal.write(rows.RunBegan())
    journal.write(rows.RunEnded(end="complete"))
    journal.close()
    assert run(tmp_path, "verify") == 1
    assert "an earlier cellctl" in capsys.readouterr().out
    assert run(tmp_path, "replay") == 2


@pytest.mark.parametrize("command", ["verify", "replay"])
def test_no_such_run(runs: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(runs, command, "no_such") == 2
    assert stored_run.RUN in capsys.readouterr().err


def test_judged_again_every_number_is_the_same(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(runs, "replay") == 0
    [end] = lines_of(capsys.readouterr().out)
    assert end["bit_equal"] is True
    assert (end["was"], end["now"]) == ("indeterminate", "indeterminate")


def test_another_recipe_lists_what_turns(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = runs / stored_run.RUN / "inputs"
    recipe = folder / "stricter.yaml"
    recipe.write_text(
        "name: shown\npart: shown.stl\ninspection:\n  not_inspected: {F0: behind the jaws}\n"
    )
    assert run(runs, "replay", "--recipe", str(recipe)) in (0, 1)
    *changes, end = lines_of(capsys.readouterr().out)
    assert end["bit_equal"] is False
    assert any("the recipe leaves out 1 of" in reason for reason in end["reasons"])
    assert all(change["was"] != change["now"] for change in changes)


def test_a_picture_that_was_changed_is_reported_before_it_is_judged_again(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(runs / stored_run.RUN / "pictures" / "v01_backlight.png")
    cv2.imwrite(path, np.full((512, 640), 12, np.uint8))
    assert run(runs, "replay") == 1
    printed = capsys.readouterr()
    assert "pictures/v01_backlight.png: was changed" in printed.err
    assert lines_of(printed.out)[-1]["bit_equal"] is False


def test_a_picture_that_is_gone_ends_a_replay(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (runs / stored_run.RUN / "pictures" / "v01_backlight.png").unlink()
    assert run(runs, "replay") == 2
    assert "pictures/v01_backlight.png: No such file" in capsys.readouterr().err
