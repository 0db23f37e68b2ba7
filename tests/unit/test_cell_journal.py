"""The journal: append-only, chained, and whole whatever happens to the process that writes it."""

from __future__ import annotations

import asyncio
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from controller.cell.journal import Journal, JournalError, first_broken_row, read_rows

ROOT = Path(__file__).resolve().parents[2]

# writes rows until it is killed; a line on stdout says which rows were promised to be there
WRITER = """
import asyncio, sys
from pathlib import Path
from controller.cell.journal import Journal

async def main(path, run, count):
    journal = Journal(Path(path), run)
    for i in range(count):
        done = journal.record("event", "step", {"i": i, "text": "x" * 300})
        print("record", done, flush=True)
        done = await journal.secure("intent", "grip", {"i": i}, 1)
        print("secure", done, flush=True)

asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3])))
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "runs" / "journal.sqlite"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    journal = Journal(path, "run-1")
    yield journal
    journal.close()


def writer(path: Path, run: str, count: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path), run, str(count)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


def fill(journal: Journal, count: int) -> None:
    for i in range(count):
        journal.record("event", f"step {i}", {"i": i, "note": "marmalade"}, part=i % 3)


async def test_what_is_written_is_read_back_in_order(journal: Journal, path: Path) -> None:
    body = {"wide mm": 12.5, "list": [1, "zwei", None, True], "Ä": {"°": "µm"}}
    assert journal.record("event", "began", body) == 1
    assert await journal.secure("custody", "in_arm", {"detail": "jaws"}, part=7) == 2

    first, second = read_rows(path)

    assert (first.seq, first.run, first.part, first.kind, first.name) == (
        1, "run-1", None, "event", "began",
    )  # fmt: skip
    assert first.body == body
    assert (second.seq, second.part, second.kind, second.body) == (
        2, 7, "custody", {"detail": "jaws"},
    )  # fmt: skip
    assert first.t_utc <= second.t_utc
    assert first.t_mono_s <= second.t_mono_s <= time.monotonic()
    assert first_broken_row(path) is None


def test_a_row_without_a_body_has_an_empty_one(journal: Journal, path: Path) -> None:
    journal.record("event", "ping")
    assert [row.body for row in read_rows(path)] == [{}]


def test_rows_are_read_by_run(path: Path) -> None:
    for run, count in (("morning", 2), ("noon", 3), ("morning", 1)):
        journal = Journal(path, run)
        fill(journal, count)
        journal.close()
    assert [row.seq for row in read_rows(path, "morning")] == [1, 2, 6]
    assert [row.seq for row in read_rows(path, "noon")] == [3, 4, 5]
    assert [row.seq for row in read_rows(path)] == [1, 2, 3, 4, 5, 6]
    assert list(read_rows(path, "evening")) == []
    assert first_broken_row(path) is None


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE journal SET name = 'nothing happened' WHERE seq = 2",
        "UPDATE journal SET seq = 9 WHERE seq = 2",
        "DELETE FROM journal WHERE seq = 3",
        "DELETE FROM journal",
        "REPLACE INTO journal SELECT 2, t_utc, t_mono, run, part, kind, 'other', body, prev_hash, "
        "hash FROM journal WHERE seq = 2",
        "INSERT INTO journal SELECT 0, t_utc, t_mono, run, part, kind, 'early', body, prev_hash, "
        "hash FROM journal WHERE seq = 1",
    ],
)
def test_rows_can_only_be_appended(journal: Journal, path: Path, statement: str) -> None:
    fill(journal, 3)
    journal.close()
    before = list(read_rows(path))
    db = sqlite3.connect(path)
    with pytest.raises(sqlite3.IntegrityError, match="append-only"):
        db.execute(statement)
    db.commit()
    db.close()
    assert list(read_rows(path)) == before


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("t_utc", "'2020-01-01T00:00:00+00:00'"),
        ("t_mono", "1.5"),
        ("run", "'other'"),
        ("part", "8"),
        ("part", "NULL"),
        ("kind", "'decision'"),
        ("name", "'pass'"),
        ("body", "'{}'"),
        ("prev_hash", "'00'"),
        ("hash", "'00'"),
    ],
)
def test_a_row_changed_behind_the_triggers_back_is_found(
    journal: Journal, path: Path, column: str, value: str
) -> None:
    fill(journal, 6)
    journal.close()
    db = sqlite3.connect(path)
    db.execute("DROP TRIGGER journal_keeps_rows")
    db.execute(f"UPDATE journal SET {column} = {value} WHERE seq = 4")
    db.commit()
    db.close()
    assert first_broken_row(path) == 4


def test_a_row_taken_out_of_the_middle_is_found(journal: Journal, path: Path) -> None:
    fill(journal, 6)
    journal.close()
    db = sqlite3.connect(path)
    db.execute("DROP TRIGGER journal_loses_none")
    db.execute("DELETE FROM journal WHERE seq = 3")
    db.commit()
    db.close()
    assert first_broken_row(path) == 4


@pytest.mark.parametrize("bit", range(8))
@pytest.mark.parametrize("row", [1, 5, 9])
def test_a_flipped_bit_in_the_file_is_found(
    journal: Journal, path: Path, row: int, bit: int
) -> None:
    fill(journal, 9)
    journal.close()
    data = bytearray(path.read_bytes())
    at = data.index(f'{{"i":{row - 1},"note":"marmalade"}}'.encode()) + 14
    data[at] ^= 1 << bit
    path.write_bytes(data)
    assert first_broken_row(path) == row


def test_a_process_killed_while_writing_loses_nothing_it_had_reported(path: Path) -> None:
    process = writer(path, "killed", 100_000)
    assert process.stdout is not None
    reported: list[tuple[str, int]] = []
    try:
        while len(reported) < 60:
            word, number = process.stdout.readline().split()
            reported.append((word, int(number)))
        process.send_signal(signal.SIGKILL)
        rest = process.stdout.read()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()
    lines = [line.split() for line in rest.splitlines(keepends=True) if line.endswith("\n")]
    reported += [(word, int(number)) for word, number in lines]

    rows = {row.seq: row for row in read_rows(path)}

    assert process.returncode == -signal.SIGKILL
    assert first_broken_row(path) is None
    assert sorted(rows) == list(range(1, len(rows) + 1))
    for word, number in reported:
        assert rows[number].kind == ("intent" if word == "secure" else "event")
    assert len(rows) <= len(reported) + 2, "no more than the row under way was not reported"
    # and the next process goes on where it ended
    journal = Journal(path, "next")
    assert journal.record("event", "began") == len(rows) + 1
    journal.close()
    assert first_broken_row(path) is None


def test_two_processes_share_one_chain(path: Path) -> None:
    processes = [writer(path, run, 60) for run in ("left", "right")]
    outputs = [process.communicate(timeout=600)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    rows = list(read_rows(path))
    assert [row.seq for row in rows] == list(range(1, 241))
    assert first_broken_row(path) is None
    for run, output in zip(("left", "right"), outputs, strict=True):
        mine = [int(line.split()[1]) for line in output.splitlines()]
        assert [row.seq for row in read_rows(path, run)] == mine
    # numbered in the order they were written in, whoever wrote
    assert all(a.t_mono_s <= b.t_mono_s for a, b in pairwise(rows))


def test_threads_of_one_process_share_the_writer(journal: Journal, path: Path) -> None:
    threads = [threading.Thread(target=fill, args=(journal, 25)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(list(read_rows(path))) == 100
    assert first_broken_row(path) is None


async def test_a_secured_row_is_synchronised_and_the_others_are_not(journal: Journal) -> None:
    # SQLite's manual: in WAL mode FULL syncs the log after each commit, NORMAL does not
    said: list[str] = []
    journal._db.set_trace_callback(said.append)
    journal.record("event", "a")
    await journal.secure("intent", "b")
    journal.record("event", "c")
    journal._db.set_trace_callback(None)
    now = "NORMAL"
    grades = []
    for statement in said:
        if statement.startswith("PRAGMA synchronous = "):
            now = statement.split(" = ")[1]
        elif statement == "COMMIT":
            grades.append(now)
    assert grades == ["NORMAL", "FULL", "NORMAL"]
    (mode,) = journal._db.execute("PRAGMA journal_mode").fetchone()
    assert mode == "wal"


async def test_securing_does_not_hold_the_event_loop(journal: Journal, path: Path) -> None:
    blocker = sqlite3.connect(path, isolation_level=None)
    blocker.execute("BEGIN IMMEDIATE")  # another run writes just now
    task = asyncio.create_task(journal.secure("intent", "grip"))
    for _ in range(20):
        await asyncio.sleep(0)
    assert not task.done()
    blocker.execute("COMMIT")
    blocker.close()
    assert await asyncio.wait_for(task, 600) == 1


def test_a_place_that_cannot_be_written_is_told_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    (tmp_path / "letter.sqlite").write_text("Dear operator, " * 100)
    (tmp_path / "folder.sqlite").mkdir()
    for place in (
        tmp_path / "file" / "journal.sqlite",
        tmp_path / "letter.sqlite",
        tmp_path / "folder.sqlite",
    ):
        with pytest.raises(JournalError) as caught:
            Journal(place, "run")
        assert str(place) in str(caught.value)
        assert "nothing moves without it" in str(caught.value)
    assert (tmp_path / "letter.sqlite").read_text().startswith("Dear operator")


def test_a_journal_that_cannot_be_begun_is_not_left_open(tmp_path: Path) -> None:
    (tmp_path / "letter.sqlite").write_text("Dear operator, " * 100)
    newer = sqlite3.connect(tmp_path / "newer.sqlite")
    newer.execute("PRAGMA user_version = 9999")
    newer.close()
    for name in ("letter.sqlite", "newer.sqlite"):
        with pytest.raises(JournalError) as caught:  # it keeps what the journal had
            Journal(tmp_path / name, "run")
        opened = [str(fd.readlink()) for fd in Path("/proc/self/fd").iterdir() if fd.exists()]
        assert str(tmp_path / name) not in opened, caught.value


async def test_a_full_disk_is_a_journal_error_and_what_was_there_stays(
    journal: Journal, path: Path
) -> None:
    fill(journal, 3)
    journal._db.execute("PRAGMA max_page_count = 14")
    with pytest.raises(JournalError, match="full"):
        fill(journal, 1000)
    with pytest.raises(JournalError, match="full"):
        await journal.secure("intent", "grip", {"much": "y" * 9000})
    journal._db.execute("PRAGMA max_page_count = 100000")
    count = len(list(read_rows(path)))
    assert journal.record("event", "room again") == count + 1
    assert first_broken_row(path) is None


def test_a_closed_journal_says_so(journal: Journal) -> None:
    journal.close()
    with pytest.raises(JournalError, match="closed"):
        journal.record("event", "late")


def test_a_name_that_is_no_text_does_not_lock_the_journal(journal: Journal, path: Path) -> None:
    # what Python makes of a file name with a byte that is no UTF-8
    journal.record("config", "recipe", {"path": "Kl\udcf6tzchen.yaml"})
    assert journal.record("event", "next") == 2
    assert "tzchen.yaml" in next(read_rows(path)).body["path"]
    assert first_broken_row(path) is None


def test_a_body_that_cannot_be_written_leaves_the_journal_usable(journal: Journal) -> None:
    with pytest.raises(TypeError):
        journal.record("event", "bug", {"object": object()})
    with pytest.raises(JournalError):
        journal.record("event", None)  # type: ignore[arg-type]  # on purpose: a bug of ours
    assert journal.record("event", "next") == 1


@pytest.mark.parametrize("name", ["lot #7", "50% done", "what?", "Grüße & mehr"])
def test_a_folder_may_have_any_name(tmp_path: Path, name: str) -> None:
    place = tmp_path / name / "journal.sqlite"
    journal = Journal(place, "run")
    fill(journal, 2)
    assert len(list(read_rows(place))) == 2  # while it is being written
    journal.close()
    assert len(list(read_rows(place))) == 2
    assert first_broken_row(place) is None


@pytest.mark.parametrize("content", [None, b"", b"no database at all " * 99])
def test_reading_what_is_no_journal_is_a_journal_error(
    tmp_path: Path, content: bytes | None
) -> None:
    place = tmp_path / "journal.sqlite"
    if content is not None:
        place.write_bytes(content)
    with pytest.raises(JournalError, match=str(place)):
        list(read_rows(place))
    with pytest.raises(JournalError, match=str(place)):
        first_broken_row(place)


def test_reading_changes_nothing(journal: Journal, path: Path) -> None:
    fill(journal, 2)
    journal.close()
    before = path.read_bytes()
    list(read_rows(path))
    first_broken_row(path)
    assert path.read_bytes() == before
