"""`cellctl backup`: what a folder of runs has goes in and comes out, or nothing does."""

from __future__ import annotations

import io
import json
import tarfile
from pathlib import Path

import pytest
from results_bench import RunWriter, bad_run, good_run, sighting, verdict

from controller.cell.journal import Journal, rows
from controller.cli import main
from controller.history import HistoryError
from controller.history.keeping import back_up, restore
from controller.results.run import load_run, prove_run


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    folder.mkdir()
    good_run(folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        one.relative_to(folder).as_posix(): one.read_bytes()
        for one in folder.rglob("*")
        if one.is_file() and not one.name.endswith(("-wal", "-shm"))
    }


def test_a_backup_is_restored_as_it_was(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["history", "--runs", str(runs)]) == 0  # makes the store
    file, back = tmp_path / "cell.tar.gz", tmp_path / "back"
    assert main(["backup", str(file), "--runs", str(runs)]) == 0
    assert main(["backup", str(file), "--restore", "--runs", str(back)]) == 0
    before, after = contents(runs), contents(back)
    assert before.keys() == after.keys()
    pictures = [name for name in before if name.endswith(".png")]
    assert len(pictures) == 2 + 2 * 3  # of the table by two lamps, of two views by three
    assert all(before[name] == after[name] for name in pictures)
    capsys.readouterr()
    assert main(["history", "--runs", str(back), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["count"] == 1
    # the next run goes on where the journal ends
    bad_run(back)
    assert prove_run(back).last_seq > prove_run(runs).last_seq


def test_pictures_stay_out_by_choice(runs: Path, tmp_path: Path) -> None:
    file = tmp_path / "cell.tar"
    assert main(["backup", str(file), "--no-pictures", "--runs", str(runs)]) == 0
    with tarfile.open(file) as tar:
        assert set(tar.getnames()) == {"journal.sqlite", "journal.sqlite.head", "manifest.json"}


def test_a_cell_may_run_meanwhile(tmp_path: Path) -> None:
    runs, back = tmp_path / "runs", tmp_path / "back"
    runs.mkdir()
    writer = RunWriter(runs)
    writer.look(sighting())
    back_up(runs, tmp_path / "cell.tar", with_pictures=True)
    writer.judge(verdict())
    writer.end()
    restored = restore(tmp_path / "cell.tar", back)
    assert restored.flaw == ""  # every row that the head names is there
    rows_then, rows_now = prove_run(back).row_count, prove_run(runs).row_count
    assert 0 < rows_then < rows_now


def test_nothing_is_restored_over_something(runs: Path, tmp_path: Path) -> None:
    back_up(runs, tmp_path / "cell.tar", with_pictures=False)
    before = contents(runs)
    with pytest.raises(HistoryError, match="is not empty"):
        restore(tmp_path / "cell.tar", runs)
    assert contents(runs) == before


def repacked(file: Path, changed: dict[str, bytes | None], *, twice: str = "") -> None:
    """Write a backup anew with other bytes in some files; None leaves one out."""
    with tarfile.open(file) as tar:
        files = {one.name: tar.extractfile(one).read() for one in tar}  # type: ignore[union-attr]
    files |= {name: data for name, data in changed.items() if data is not None}
    with tarfile.open(file, "w") as tar:
        for name, data in files.items():
            if changed.get(name, b"") is None:
                continue
            for _ in range(1 + (name == twice)):
                info = tarfile.TarInfo(name)
                info.size = len(data)
                tar.addfile(info, io.BytesIO(data))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"journal.sqlite": b"other"}, "not as it was written: journal.sqlite"),
        ({"journal.sqlite.head": None}, "not as it was written: journal.sqlite.head"),
        ({"more.txt": b""}, "not as it was written: more.txt"),
        ({"../outside.txt": b""}, "no file of a folder of runs"),
        ({"/tmp/outside.txt": b""}, "no file of a folder of runs"),
        ({"manifest.json": None}, "no list of files"),
        ({"manifest.json": b"[]"}, "no list of files"),
        ({"manifest.json": b'{"form": "x", "version": 9, "at": "2026-01-01", "files": {}}'}, "9"),
    ],
)
def test_a_changed_backup_is_not_restored(
    runs: Path, tmp_path: Path, changed: dict[str, bytes | None], says: str
) -> None:
    file, back = tmp_path / "cell.tar", tmp_path / "there" / "back"
    back_up(runs, file, with_pictures=False)
    repacked(file, changed)
    with pytest.raises(HistoryError, match=says):
        restore(file, back)
    assert list(back.parent.iterdir()) == []  # not even a part of it
    assert not (tmp_path / "outside.txt").exists()


def test_links_twins_and_cut_files_are_not_restored(runs: Path, tmp_path: Path) -> None:
    file, back = tmp_path / "cell.tar", tmp_path / "back"
    back_up(runs, file, with_pictures=False)
    whole = file.read_bytes()
    repacked(file, {}, twice="journal.sqlite")
    with pytest.raises(HistoryError, match="is there twice"):
        restore(file, back)
    with tarfile.open(file, "w") as tar:
        info = tarfile.TarInfo("journal.sqlite")
        info.type, info.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(info)
    with pytest.raises(HistoryError, match="no file of a folder of runs"):
        restore(file, back)
    for length in (0, 100, len(whole) // 2):
        file.write_bytes(whole[:length])
        with pytest.raises(HistoryError):
            restore(file, back)
    assert not back.exists()


def test_a_backup_that_cannot_be_written_leaves_the_last_one(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "cell.tar"
    back_up(runs, file, with_pictures=False)
    before = file.read_bytes()

    def full(*args: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(tarfile.TarFile, "addfile", full)
    with pytest.raises(OSError, match="No space left"):
        back_up(runs, file, with_pictures=False)
    assert file.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir() if one.suffix == ".part"] == []


def test_a_damaged_journal_that_was_set_aside_is_kept_as_it_is(runs: Path, tmp_path: Path) -> None:
    aside = runs / "journal-set-aside-20260301-120000.sqlite"
    aside.write_bytes(b"damaged" * 1000)
    back_up(runs, tmp_path / "cell.tar", with_pictures=False)
    restore(tmp_path / "cell.tar", tmp_path / "back")
    assert (tmp_path / "back" / aside.name).read_bytes() == aside.read_bytes()


def test_pictures_of_old_runs_go_once_somebody_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    runs.mkdir()
    old = good_run(runs)
    stored = {f"pictures/{one.name}": "0" * 64 for one in (old / "pictures").iterdir()}
    journal = Journal(runs / "journal.sqlite", old.name)
    journal.write(rows.FilesStored(stored))
    journal.close()
    strange = old / "pictures" / "strange.png"
    strange.write_bytes(b"of nobody")
    new = bad_run(runs)
    before = contents(runs)
    words = ["history", "--runs", str(runs), "--drop-pictures-before", "2100-01-01"]
    assert main(words) == 0
    assert "8 pictures" in capsys.readouterr().out
    pictures = {name for name in before if name.endswith(".png")}
    assert pictures <= contents(runs).keys()  # dry unless --yes
    assert main([*words[:-1], "2000-01-01", "--yes"]) == 0
    assert pictures <= contents(runs).keys()  # no run is as old
    assert main([*words, "--yes"]) == 0
    assert [one.name for one in (old / "pictures").iterdir()] == ["strange.png"]
    assert len(list((new / "pictures").iterdir())) == 8  # the newest run keeps its own
    assert load_run(runs, old.name).parts[0].verdict is not None
    said = [one.problem for one in prove_run(runs, old.name).tampered]
    assert said == ["is not in the journal"]  # the strange one alone; what was dropped is known
    capsys.readouterr()
    assert main(["history", "--runs", str(runs), "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["count"] == 2
