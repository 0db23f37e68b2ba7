"""`cellctl recover` where the journal is lost, or a gripper cannot be read."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from test_cell_left_leases import at_rest, cell_at

from controller.cell.custody import GripperName
from controller.cell.custody.known_journals import JournalLostError, note_journal
from controller.cell.devices import Devices, resolve
from controller.cell.journal import JOURNAL_NAME, Journal, read_rows, rows
from controller.cli.running import release
from controller.cli.running.accepting import go_on_with_part
from controller.config import Cell, load_cell
from drivers.kinds import JawReading

__all__ = ["at_rest"]  # the grippers that each visit reads


@pytest.fixture
def cell_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    cell_at(tmp_path, "north", "10.0.0.1")
    monkeypatch.setattr(release, "require_drivers", lambda *_: None)
    return tmp_path / "north.yaml"


@pytest.fixture
def runs(tmp_path: Path, cell_path: Path) -> Path:
    """Return a folder with the journal of a run that was killed with a part in the arm gripper."""
    folder = tmp_path / "runs"
    cell: Cell = load_cell(cell_path)
    journal = Journal(folder / JOURNAL_NAME, "first")
    began = rows.RunBegan(cell={"name": cell.name}, devices=resolve(cell, {}))
    journal.write_synced(began)
    note_journal(journal, began)
    journal.write_synced(rows.CustodyChanged(name="in_arm"))
    journal.leave()
    return folder


def without_power(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the arm answer as one that lost its positions."""
    devices = Devices.build(None, {}, None)  # type: ignore[arg-type]  # the fixture's own
    devices.jaws_found = JawReading(is_pressing=False, opening_mm=0.0)
    devices.arm.identity = SimpleNamespace(was_restarted=True)  # type: ignore[misc]
    monkeypatch.setattr(Devices, "build", lambda *_: devices)


@pytest.mark.parametrize("as_json", [False, True])
def test_a_lost_journal_and_an_arm_without_power_are_unknown_custody(
    cell_path: Path,
    runs: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *,
    as_json: bool,
) -> None:
    without_power(monkeypatch)
    shutil.rmtree(runs)
    for _ in range(2):
        code = release.recover_cell(cell_path, runs, None, is_confirmed=False, as_json=as_json)
        said = capsys.readouterr()
        assert code == 1
        assert not (runs / JOURNAL_NAME).exists()
        if as_json:
            body = json.loads(said.out)
            assert {one["custody"] for one in body["known"]} == {"unknown"}
            assert [one["gripper"] for one in body["known"]] == [one.value for one in GripperName]
            assert "was deleted or moved" in body["notice"]
        else:
            assert "Nothing is held" not in said.out
            assert "no gripper holds" not in said.out
            assert "arm gripper: cannot be read" in said.out
            assert "What the grippers hold is unknown" in said.err


def test_to_open_a_gripper_by_hand_begins_a_journal_that_says_what_is_unknown(
    cell_path: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(runs)
    opened: list[str] = []

    async def open_jaws(*_: object) -> None:
        opened.append("arm")

    devices = Devices.build(None, {}, None)  # type: ignore[arg-type]
    devices.arm.enable_power = devices.arm.drive_jaws = open_jaws  # type: ignore[method-assign,assignment]
    monkeypatch.setattr("controller.cell.custody.releasing.check_interlocks", lambda *_, **__: None)
    code = release.recover_cell(cell_path, runs, GripperName.ARM, is_confirmed=True, as_json=True)
    assert (code, len(opened)) == (0, 2)
    names = [row.name for row in read_rows(runs / JOURNAL_NAME)]
    assert names[:2] == ["journal_not_readable", "run_began"]
    assert names.index("open_arm_gripper") < names.index("in_fixture")
    # the fixed gripper is unknown yet, and stands open
    assert release.recover_cell(cell_path, runs, None, is_confirmed=False, as_json=True) == 1


def test_to_go_on_with_a_part_whose_journal_is_lost_is_refused(
    cell_path: Path, runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.rmtree(runs)
    with pytest.raises(JournalLostError, match="no other journal was begun"):
        go_on_with_part(cell_path, runs, "looked", as_json=True)
    assert not (runs / JOURNAL_NAME).exists()


def test_by_a_whole_journal_a_gripper_that_cannot_be_read_is_not_called_empty(
    cell_path: Path,
    runs: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    without_power(monkeypatch)
    journal = Journal(runs / JOURNAL_NAME, "first")
    journal.write_synced(rows.CustodyChanged(name="placed"))
    journal.close()
    assert release.recover_cell(cell_path, runs, None, is_confirmed=False, as_json=False) == 0
    said = capsys.readouterr().out
    assert "Nothing is held" not in said
    assert "the arm gripper cannot be read. Look at its jaws" in said


@pytest.mark.parametrize("as_json", [False, True])
def test_without_journal_and_note_a_gripper_that_cannot_be_read_is_unknown(
    cell_path: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    *,
    as_json: bool,
) -> None:
    """As after all state of a user is lost, or for another user: a visit records nothing either."""
    without_power(monkeypatch)
    for _ in range(2):
        code = release.recover_cell(
            cell_path, tmp_path / "other", None, is_confirmed=False, as_json=as_json
        )
        said = capsys.readouterr().out
        assert code == 1
        if as_json:
            assert json.loads(said)["unknown"] == ["arm gripper"]
        else:
            assert "Nothing is held" not in said
            assert "no gripper holds" not in said
            assert "what the arm gripper holds is unknown: no run of this cell" in said
            assert "cellctl recover --open arm" in said
