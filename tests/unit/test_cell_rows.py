"""What the rows of the journal say: one model for writer and readers, bytes as before."""

from __future__ import annotations

import json
import re
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from controller.cell.journal import Journal, JournalError, read_row, read_rows, rows
from controller.cell.journal.rows import Body, NamedBody, Once
from controller.cell.services.records import view_row
from controller.inspection import ViewResult

ROOT = Path(__file__).parents[2]
RECORDED = [
    json.loads(line)
    for line in (ROOT / "tests/data/journal/rows.jsonl").read_text(encoding="utf-8").splitlines()
]


def text_of(row: Body) -> str:
    return json.dumps(row.as_json(), separators=(",", ":"), ensure_ascii=False)


@pytest.mark.parametrize(("kind", "name", "text"), RECORDED)
def test_a_recorded_row_is_read_and_would_be_written_byte_for_byte(
    kind: str, name: str, text: str
) -> None:
    row = read_row(kind, name, json.loads(text))
    assert row is not None
    assert (row.kind, rows.name_of(row)) == (kind, name)
    assert text_of(row) == text


# by hand: what stands in journals since their first version
@pytest.mark.parametrize(
    ("row", "kind", "name", "text"),
    [
        (
            rows.CellEvent(
                name="fault", answer="handled", source="idle", target="aborting",
                message="door", code="guard_closed",
            ),
            "event", "fault",
            '{"answer":"handled","from":"idle","to":"aborting","message":"door",'
            '"code":"guard_closed"}',
        ),
        (rows.Intent(name=Once.SORT, tray="accept"), "intent", "sort", '{"tray":"accept"}'),
        (rows.OnceDone(name=Once.SORT), "outcome", "sort", "{}"),
        (rows.CustodyChanged(name="lost", detail=""), "custody", "lost", '{"detail":""}'),
        (
            rows.StepDone(label="pick", forecast_s=1.0, seconds=1.25, jaw_mm=3.0, expected_mm=3.5),
            "outcome", "step",
            '{"label":"pick","forecast_s":1.0,"seconds":1.25,"jaw_mm":3.0,"expected_mm":3.5}',
        ),
        (
            rows.RecoveryBegun(fault="part_lost", reason="r", action="a", number=1, custody="lost"),
            "decision", "recovery",
            '{"trouble":"part_lost","reason":"r","remedy":"a","number":1,"custody":"lost"}',
        ),
        (rows.TablePictures({"ring": "a.png"}), "observation", "table_pictures",
         '{"ring":"a.png"}'),
        (rows.RunEnded(end="stopped"), "event", "run_ended", '{"end":"stopped"}'),
    ],
)  # fmt: skip
def test_a_row_is_written_with_the_keys_of_the_first_version(
    row: Body, kind: str, name: str, text: str
) -> None:
    assert (row.kind, rows.name_of(row), text_of(row)) == (kind, name, text)
    assert read_row(kind, name, json.loads(text)) == row


def test_each_row_has_one_model() -> None:
    def every(model: type[Body]) -> set[type[Body]]:
        return {model, *(m for child in model.__subclasses__() for m in every(child))}

    abstract = {Body, NamedBody, rows.TextByName}
    own = every(Body) - every(NamedBody) - abstract
    assert set(rows.ROWS.values()) == own
    assert len(rows.ROWS) == len(own), "two models have one kind and name"
    assert set(rows.GROUPS.values()) == every(NamedBody) - abstract


def test_what_is_never_repeated_blindly_is_no_other_outcome() -> None:
    # its rows stand for every name that no other model has
    assert not {("outcome", one.value) for one in Once} & set(rows.ROWS)


def test_fields_that_came_later_are_passed_over_and_missing_ones_are_named() -> None:
    row = read_row("outcome", "grip_missed", {"message": "on nothing", "new": 1})
    assert row == rows.GraspMissed(message="on nothing")
    with pytest.raises(ValueError, match="message"):
        read_row("outcome", "grip_missed", {})
    assert read_row("observation", "nobody knows", {}) is None
    assert read_row("gossip", "grip", {}) is None


def test_a_journal_of_another_version_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    journal = Journal(path, "run")
    journal.write(rows.Homed())
    journal.close()
    assert [row.name for row in read_rows(path)] == ["homed"]
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version = 999")
    db.close()
    with pytest.raises(JournalError, match="version 999"):
        list(read_rows(path))


def test_whatever_the_controller_writes_is_a_row_with_a_model() -> None:
    bare = re.compile(r"journal\.(record|secure)\(")
    found = [
        f"{file.relative_to(ROOT)}: {match.group()}"
        for file in sorted((ROOT / "controller").rglob("*.py"))
        for match in bare.finditer(file.read_text(encoding="utf-8"))
    ]
    assert found == []


@pytest.mark.parametrize("model", sorted(rows.ROWS.values(), key=lambda m: m.__name__))
def test_a_row_cannot_be_changed_once_it_is_made(model: type[Body]) -> None:
    assert model.model_config["frozen"] is True


def viewed(compared: str, faces: str = "") -> ViewResult:
    """Return a view's result: one letter a sample, x for a compared one, and its face."""
    return ViewResult(
        "V", True, "", np.eye(4), np.eye(4), 0.0, 0.0, 0.0, (),
        np.array([sign == "x" for sign in compared]), np.zeros((0, 2)),
        face_ids=np.array([int(sign) for sign in faces], dtype=np.int32),
    )  # fmt: skip


def test_the_row_of_a_view_counts_what_it_and_the_earlier_ones_compared_of_each_face() -> None:
    first, second = viewed("x--x---", "0022255"), viewed("xx-----", "0022255")
    assert view_row(first).faces == ((0, 1, 2), (2, 1, 3))
    assert view_row(second, [first]).faces == ((0, 2, 2), (2, 1, 3))
    # a part that was taken for another one before: its samples are others
    assert view_row(second, [viewed("xxx", "000")]).faces == ((0, 2, 2),)


@pytest.mark.parametrize("result", [viewed("x-x"), viewed(""), viewed("---", "012")])
def test_the_row_of_a_view_without_faces_has_no_word_of_them(result: ViewResult) -> None:
    assert "faces" not in view_row(result).as_json()


def test_numbers_of_a_row_keep_every_digit() -> None:
    value: Any = 33.3999981880188
    text = text_of(rows.Intent(name=Once.RELEASE_ARM, open_mm=value))
    assert text == '{"open_mm":33.3999981880188}'
