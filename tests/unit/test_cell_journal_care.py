"""A journal that was tampered with, cut, emptied or written by another version is never trusted."""

from __future__ import annotations

import asyncio
import json
import os
import random
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from controller.cell.journal import (
    Journal,
    JournalError,
    first_broken_row,
    first_flaw,
    open_cell_journal,
    read_rows,
    rows,
)
from controller.cell.lock import CellBusyError, hold_cell, require_free_cell
from controller.config import load_cell

ROOT = Path(__file__).resolve().parents[2]
EMULATED_CELL = ROOT / "recipes" / "cells" / "emulated.yaml"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A journal of one ended run: 12 rows, of which 10 and 11 are secured."""
    place = tmp_path / "runs" / "journal.sqlite"
    journal = Journal(place, "run-1")
    for i in range(9):
        journal.record("event", f"step {i}", {"i": i, "note": "marmalade" * 40})
    asyncio.run(journal.secure("intent", "sort", {"tray": "accept"}, 1))
    asyncio.run(journal.secure("custody", "placed", {"detail": "accept"}, 1))
    journal.record("event", "run_ended")
    journal.close()
    return place


def sql(path: Path, *statements: str) -> None:
    db = sqlite3.connect(path, isolation_level=None)
    for trigger in ("journal_keeps_rows", "journal_loses_none"):
        db.execute(f"DROP TRIGGER IF EXISTS {trigger}")
    for statement in statements:
        db.execute(statement)
    db.close()


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[data.index(b'"i":4') + 4] ^= 1
    path.write_bytes(data)


DAMAGE: dict[str, tuple[Callable[[Path], None], str]] = {
    "row edited": (lambda p: sql(p, "UPDATE journal SET name = 'x' WHERE seq = 4"), "row 4 was"),
    "row deleted": (lambda p: sql(p, "DELETE FROM journal WHERE seq = 4"), "row 5 was"),
    "first rows deleted": (lambda p: sql(p, "DELETE FROM journal WHERE seq < 4"), "row 4 was"),
    "tail cut": (lambda p: sql(p, "DELETE FROM journal WHERE seq > 10"), "were cut off"),
    "all rows cut": (lambda p: sql(p, "DELETE FROM journal"), "no row"),
    "last row cut": (lambda p: sql(p, "DELETE FROM journal WHERE seq > 11"), "were cut off"),
    "table dropped": (lambda p: sql(p, "DROP TABLE journal"), "no table"),
    "bit flipped": (flip, "row 5 was"),
    "triggers dropped": (lambda p: sql(p), "triggers that keep its rows"),
    "zero bytes": (lambda p: p.write_bytes(b""), "empty"),
    "text": (lambda p: p.write_text("Dear operator, " * 500), "not a database"),
    "cut in half": (lambda p: os.truncate(p, p.stat().st_size // 2), "malformed"),
    "cut by a page": (lambda p: os.truncate(p, p.stat().st_size - 4096), "malformed"),
    "gone": (lambda p: p.unlink(), "gone"),
    "head gone": (lambda p: head(p).unlink(), "head is missing"),
    "head empty": (lambda p: head(p).write_bytes(b""), "no head"),
    "head of another": (
        lambda p: head(p).write_text('{"seq":11,"hash":"00"}'.ljust(127) + "\n"),
        "not the one its head names",
    ),
}  # fmt: skip


def head(path: Path) -> Path:
    return path.with_name(path.name + ".head")


def test_a_whole_journal_is_continued(path: Path) -> None:
    assert first_flaw(path) is None
    opened = open_cell_journal(path, "run-2")
    assert opened.notice == ""
    assert opened.journal.record("event", "run_began") == 13
    opened.journal.close()
    assert first_flaw(path) is None
    assert first_broken_row(path) is None


def test_a_journal_that_has_not_begun_is_whole(tmp_path: Path) -> None:
    assert first_flaw(tmp_path / "journal.sqlite") is None


@pytest.mark.parametrize("content", ["no byte", "no row"])
def test_a_journal_that_was_cut_off_before_its_first_row_is_whole(
    tmp_path: Path, content: str
) -> None:
    path = tmp_path / "journal.sqlite"
    if content == "no byte":
        path.touch()
    else:
        Journal(path, "killed").close()
    assert first_flaw(path) is None
    opened = open_cell_journal(path, "run-2")
    assert opened.notice == ""
    assert opened.journal.record("event", "run_began") == 1
    opened.journal.close()


async def test_the_head_may_be_missing_until_a_row_is_secured(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    journal = Journal(path, "killed")
    journal.write(rows.PathBegun(effect_class=rows.EffectClass.ABSOLUTE, waypoints=()))
    assert first_flaw(path) is None
    await journal.write_secured(rows.CustodyChanged(name="in_arm"))
    assert first_flaw(path) is None
    head(path).unlink()
    assert first_flaw(path) == "its head is missing"
    journal.close()


def test_that_a_journal_was_set_aside_is_on_the_disk(path: Path) -> None:
    path.write_bytes(b"")
    opened = open_cell_journal(path, "run-2")
    assert json.loads(head(path).read_text())["seq"] == 1
    opened.journal.close()


@pytest.mark.parametrize("what", DAMAGE)
def test_damage_is_named_and_a_new_journal_begins_beside_it(path: Path, what: str) -> None:
    damage, words = DAMAGE[what]
    damage(path)
    before = path.read_bytes() if path.exists() else None

    opened = open_cell_journal(path, "run-2")
    opened.journal.close()

    assert words in opened.notice
    (row,) = read_rows(path)
    assert (row.name, row.run) == ("journal_set_aside", "run-2")
    assert words in row.body["why"]
    assert first_flaw(path) is None
    kept = path.with_name(row.body["file"])
    assert kept.name in opened.notice
    if before is None:
        assert head(kept).exists()
    else:
        assert kept.read_bytes() == before  # not a byte of it is changed


def test_a_second_damage_keeps_both(path: Path) -> None:
    for run in ("run-2", "run-3"):
        path.write_bytes(b"")
        open_cell_journal(path, run).journal.close()
    assert len(list(path.parent.glob("journal-set-aside-*.sqlite"))) == 2


def test_what_is_no_damage_is_refused_and_left_as_it_is(path: Path, tmp_path: Path) -> None:
    newer = path.with_name("newer.sqlite")
    shutil.copy(path, newer)
    sql(newer, "PRAGMA user_version = 999")
    other = path.with_name("other.sqlite")
    db = sqlite3.connect(other)
    db.execute("CREATE TABLE recipes (name TEXT)")
    db.close()
    folder = path.with_name("folder.sqlite")
    folder.mkdir()
    before = newer.read_bytes(), other.read_bytes()
    for place, words in (
        (newer, "version 999"),
        (other, "not a journal of"),
        (folder, "not a file"),
    ):
        with pytest.raises(JournalError, match=words) as caught:
            open_cell_journal(place, "run-2")
        assert str(place) in str(caught.value)
    assert (newer.read_bytes(), other.read_bytes()) == before
    assert not list(tmp_path.rglob("*set-aside*"))


def test_a_journal_of_the_days_before_versions_and_heads_is_continued(path: Path) -> None:
    sql(path, "PRAGMA user_version = 0")
    head(path).unlink()
    opened = open_cell_journal(path, "run-2")
    opened.journal.record("event", "run_began")
    opened.journal.close()
    assert opened.notice == ""
    assert first_flaw(path) is None
    assert head(path).exists()


# The file as version 1 made it (cellctl of November 2026).
VERSION_1 = """
CREATE TABLE journal (
    seq       INTEGER PRIMARY KEY,
    t_utc     TEXT NOT NULL,
    t_mono    REAL NOT NULL,
    run       TEXT NOT NULL,
    part      INTEGER,
    kind      TEXT NOT NULL,
    name      TEXT NOT NULL,
    body      TEXT NOT NULL,
    prev_hash TEXT NOT NULL,
    hash      TEXT NOT NULL
) STRICT;
CREATE INDEX journal_run ON journal (run, seq);
CREATE TRIGGER journal_keeps_rows BEFORE UPDATE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
CREATE TRIGGER journal_loses_none BEFORE DELETE ON journal
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
-- REPLACE takes rows away without asking the trigger on DELETE
CREATE TRIGGER journal_only_grows BEFORE INSERT ON journal
WHEN NEW.seq <= (SELECT coalesce(max(seq), 0) FROM journal)
BEGIN SELECT RAISE(ABORT, 'the journal is append-only'); END;
PRAGMA user_version = 1;
"""


def of_version_1(path: Path) -> Path:
    """Return a copy of a journal in the file that version 1 made, with its head."""
    old = path.with_name("old.sqlite")
    db = sqlite3.connect(old, isolation_level=None)
    db.executescript(VERSION_1)
    db.execute("ATTACH ? AS new", (str(path),))
    db.execute("INSERT INTO journal SELECT * FROM new.journal ORDER BY seq")
    db.close()
    shutil.copy(head(path), head(old))
    return old


def test_a_journal_of_version_1_is_brought_up_to_date_and_its_rows_stay(path: Path) -> None:
    old = of_version_1(path)
    before = list(read_rows(old))
    assert before
    assert first_flaw(old) is None
    opened = open_cell_journal(old, "run-2")
    opened.journal.record("event", "run_began")
    opened.journal.close()
    assert opened.notice == ""
    assert list(read_rows(old))[:-1] == before
    assert first_flaw(old) is None
    db = sqlite3.connect(old)
    asked = "EXPLAIN QUERY PLAN SELECT seq FROM journal WHERE kind = 'custody' ORDER BY seq"
    (plan,) = (row[3] for row in db.execute(asked))
    db.close()
    assert "journal_kind" in plan


def test_a_journal_of_version_1_that_lost_a_trigger_is_not_trusted(path: Path) -> None:
    old = of_version_1(path)
    db = sqlite3.connect(old)
    db.execute("DROP TRIGGER journal_loses_none")
    db.close()
    assert "triggers" in str(first_flaw(old))


def test_a_migration_that_fails_leaves_the_file_as_it_was(path: Path) -> None:
    old = of_version_1(path)
    sql(old, "CREATE TABLE journal_kind (in_the_way)")
    with pytest.raises(JournalError, match="nothing moves without it"):
        Journal(old, "run-2")
    sql(old, "DROP TABLE journal_kind")
    db = sqlite3.connect(old)
    assert db.execute("PRAGMA user_version").fetchone() == (1,)
    db.close()


KILLED = """
import asyncio, os, sys
from pathlib import Path
from controller.cell.journal import Journal

journal = Journal(Path(sys.argv[1]), "killed")
journal.record("event", "run_began")
asyncio.run(journal.secure("intent", "grip"))
journal.record("event", "after")
os.kill(os.getpid(), 9)
"""


def killed(path: Path) -> None:
    subprocess.run(
        [sys.executable, "-c", KILLED, str(path)], cwd=ROOT, check=False, capture_output=True
    )


def test_a_killed_run_leaves_a_whole_journal_with_its_head(path: Path) -> None:
    killed(path)
    assert first_flaw(path) is None
    assert list(read_rows(path))[-1].name == "after"


def test_a_log_that_is_taken_away_from_a_killed_run_is_missed(path: Path) -> None:
    killed(path)
    wal = path.with_name(path.name + "-wal")
    assert wal.stat().st_size > 0
    wal.unlink()
    assert "cut off" in str(first_flaw(path))


# ---- one controller at a time --------------------------------------------------------------------

HOLDER = """
import sys, time
from pathlib import Path
from controller.cell.lock import hold_cell
from controller.config import load_cell

with hold_cell(Path(sys.argv[1]), load_cell(Path(sys.argv[2])), "the-first"):
    print("held", flush=True)
    sys.stdin.read()
"""


def cell_at(folder: Path, arm: str) -> Path:
    """Write a cell file whose arm stands at an address."""
    text = EMULATED_CELL.read_text().replace("{address: emulated}", f"{{address: {arm}}}", 1)
    assert arm in text
    path = folder / "cell.yaml"
    path.write_text(text)
    return path


# the second run writes beside the first, or to a folder of its own
@pytest.mark.parametrize("second", ["runs", "elsewhere"])
def test_a_busy_cell_names_who_has_it_until_that_process_is_gone(
    tmp_path: Path, second: str
) -> None:
    file = cell_at(tmp_path, "/dev/arm")
    cell, runs = load_cell(file), tmp_path / second
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path / "runs"), str(file)],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.raises(CellBusyError) as caught, hold_cell(runs, cell, "the-second"):
            pass
        with pytest.raises(CellBusyError, match="the-first"):
            require_free_cell(runs, cell)
        assert "the-first" in str(caught.value)
        assert str(process.pid) in str(caught.value)
        process.kill()
    # the lock of a dead process is no lock, whatever the file still says
    require_free_cell(runs, cell)
    with hold_cell(runs, cell, "the-third"):
        pass


def test_another_cell_is_not_kept_out(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    one = load_cell(cell_at(tmp_path / "a", "/dev/arm"))
    other = load_cell(cell_at(tmp_path / "b", "/dev/other"))
    with (
        hold_cell(tmp_path / "runs-1", one, "first"),
        hold_cell(tmp_path / "runs-2", other, "next"),
    ):
        pass


# 1264 and others: damage to what SQLite itself says of the table
@pytest.mark.parametrize("seed", [*range(40), 1264, 1295, 1345, 1361, 2153])
def test_whatever_happens_to_the_file_is_found_or_harmless(path: Path, seed: int) -> None:
    before = list(read_rows(path))
    rng = random.Random(seed)
    data = bytearray(path.read_bytes())
    if seed % 3 == 0:
        del data[rng.randrange(1, len(data)) :]
    elif seed % 3 == 1:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    else:
        at = rng.randrange(len(data))
        data[at : at + 64] = rng.randbytes(len(data[at : at + 64]))
    path.write_bytes(data)
    opened, refusal = None, ""
    try:
        opened = open_cell_journal(path, "run-2")
    except JournalError as error:
        refusal = str(error)
    if opened is None:  # the byte that says the version, or the name of the table
        assert "version" in refusal or "no journal" in refusal
        return
    opened.journal.record("event", "run_began")
    opened.journal.close()
    assert first_flaw(path) is None
    if not opened.notice:
        assert list(read_rows(path))[:-1] == before
