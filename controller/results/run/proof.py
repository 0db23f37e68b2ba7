"""Proves that a run is unchanged: rows by their chain, files by their hashes in rows.

Not provable: anyone with write access to the folder can rewrite all of it, chain included. Only a
hash that was noted elsewhere reveals that (`head`).
"""

import sqlite3
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from controller.cell.journal import (
    JOURNAL_NAME,
    JournalError,
    append_beside,
    broken_rows,
    first_broken_row,
    first_flaw,
    is_of,
    read_rows,
    rows,
)
from controller.config.files import read_sha256
from messages import say

from ._stored import copies_in, stored_files
from .copies import RunPictures
from .load import find_run
from .model import ResultsError

PICTURES: Final = "pictures"
RESULTS: Final = ("report.*", "*.views.json")  # files of a run that must be in its journal


@dataclass(frozen=True, slots=True)
class Tampering:
    """A row or file of a run that has changed since it was written.

    Attributes
    ----------
    subject : ``row 17 (view)``, or a file in the run's folder
    problem : description of the fault
    """

    subject: str
    problem: str


@dataclass(frozen=True, slots=True)
class RunProof:
    """The checks made of a run, and everything that has changed since it was written.

    Attributes
    ----------
    row_count, file_count : numbers of rows and files of the run
    last_seq, last_hash : number and hash of the journal's last row; noted elsewhere, they prove
        later that nothing up to here was rewritten
    """

    run_id: str
    row_count: int
    file_count: int
    tampered: tuple[Tampering, ...]
    last_seq: int
    last_hash: str


def prove_run(runs_dir: Path, run: str | None = None, head: str | None = None) -> RunProof:
    """Return the rows and files of a run that have changed since they were written.

    Parameters
    ----------
    runs_dir : folder with the journal and the runs' own folders
    run : a run's id, an unambiguous beginning of it, or the path of its folder; None for the newest
    head : hash of a row, noted when the run was done

    Raises
    ------
    UnknownRunError : no such run
    ResultsError : the journal cannot be read
    """
    runs_dir, run_id = find_run(runs_dir, run)
    path, folder = runs_dir / JOURNAL_NAME, runs_dir / run_id
    try:
        found = list(read_rows(path, run_id))
        tampered = list(_broken(path))
        hashes = _hashes(path)
    except (JournalError, sqlite3.Error, ValueError) as error:
        raise ResultsError(say("journal {path}: {error}", path=path, error=error)) from error
    if head is not None and head not in (digest for _, digest in hashes):
        tampered.append(Tampering("journal", f"has no row with the hash {head:.80}"))
    stored = stored_files(found)
    dropped = {
        file for row in found if is_of(row, rows.PicturesDropped) for file in row.body["files"]
    }
    tampered += _changed(RunPictures(folder, copies_in(found)), stored, dropped)
    tampered += _strange(folder, stored)
    if not stored:
        tampered.append(
            Tampering("journal", "has no hash of any file: an earlier cellctl wrote this run")
        )
    last_seq, last_hash = hashes[-1]
    return RunProof(run_id, len(found), len(stored), tuple(tampered), last_seq, last_hash)


def note_results(runs_dir: Path, run_id: str, files: Sequence[Path]) -> None:
    """Append the hashes of files in a run's folder to the journal; files elsewhere are left out.

    Parameters
    ----------
    runs_dir : folder with the journal
    run_id : id of the run
    files : reports and exports, just written

    Raises
    ------
    JournalError : the journal cannot be written, or is broken and so must not be
    OSError : a file cannot be read again
    """
    path, folder = runs_dir / JOURNAL_NAME, (runs_dir / run_id).resolve()
    inside = [file.resolve() for file in files if file.resolve().is_relative_to(folder)]
    if not inside:
        return
    broken = first_broken_row(path)
    if broken is not None:
        raise JournalError(f"journal {path}: row {broken} is broken, so nothing is added to it")
    digests = {file.relative_to(folder).as_posix(): read_sha256(file) for file in inside}
    append_beside(path, run_id, rows.FilesStored(digests))


def _broken(path: Path) -> Iterator[Tampering]:
    found = broken_rows(path)
    for row in found:
        yield Tampering(f"row {row.seq} ({row.name}, run {row.run})", row.why)
    if not found and (flaw := first_flaw(path)) is not None:  # at its end, or in its table
        yield Tampering("journal", flaw)


def _hashes(path: Path) -> list[tuple[int, str]]:
    db = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
    try:
        return [(int(seq), str(h)) for seq, h in db.execute("SELECT seq, hash FROM journal")]
    finally:
        db.close()


def _changed(
    pictures: RunPictures, stored: dict[str, tuple[str, int]], dropped: Collection[str]
) -> Iterator[Tampering]:
    """Yield the files that are missing without having been deleted, or that have changed.

    Of a deleted picture with a copy, the copy is read and checked.
    """
    folder, root = pictures.folder, pictures.folder.resolve()
    for file, (digest, seq) in stored.items():
        path = (folder / file).resolve()
        if not path.is_relative_to(root):
            yield Tampering(file, f"row {seq} names a file outside of the run's folder")
        elif file in dropped and not path.exists():
            if file in pictures.copies and isinstance(why := pictures.read(file), str):
                yield Tampering(file, why.removeprefix(f"picture {file} "))
        elif not path.is_file():
            yield Tampering(file, f"is missing; row {seq} has its hash")
        else:
            try:
                is_same = read_sha256(path) == digest
            except OSError as error:
                yield Tampering(file, f"cannot be read: {error.strerror}")
                continue
            if not is_same:
                yield Tampering(file, f"was changed; its hash is not that of row {seq}")


def _strange(folder: Path, stored: dict[str, tuple[str, int]]) -> Iterator[Tampering]:
    """Yield pictures and results that no row knows."""
    there = [path for path in (folder / PICTURES).rglob("*") if not path.is_dir()]
    there += [path for pattern in RESULTS for path in folder.glob(pattern)]
    for path in sorted(there):
        file = path.relative_to(folder).as_posix()
        if file not in stored:
            yield Tampering(file, "is not in the journal")
