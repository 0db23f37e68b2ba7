"""Writes a backup: a tar file with journals, store, pictures by choice, and the hash of each.

A run may write meanwhile. The journal goes in as SQLite copies a database that is in use, and its
head is read first, so that the copy has every row that its head names. Files that a run is still
writing are in the next backup. The last member, ``manifest.json``, has size and SHA-256 of all.
"""

import hashlib
import io
import json
import sqlite3
import tarfile
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Final

from controller.cell.journal import is_set_aside, journals_in
from controller.results.pages import whole_file

from ..errors import HistoryError
from ..store import STORE_NAME

FORM: Final = "cellctl.backup"
FORM_VERSION: Final = 1
MANIFEST: Final = "manifest.json"
HEAD_SUFFIX: Final = ".head"
PICTURES: Final = "pictures"
CHUNK_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Backup:
    """The content of a backup.

    Attributes
    ----------
    file_count, size : number of files in it, and their size [bytes]
    left_out : files that could not be read, or were changed while they were read
    """

    file_count: int
    size: int
    left_out: tuple[str, ...] = ()


def back_up(runs_dir: Path, path: Path, *, with_pictures: bool) -> Backup:
    """Write a backup of a folder of runs, read it again, and return its content.

    Parameters
    ----------
    runs_dir : folder of all runs
    path : path of the file; ``.gz`` at its end compresses it
    with_pictures : pictures of the runs, too

    Raises
    ------
    HistoryError : there is no journal, one cannot be copied, or the file does not hold what was
        written
    OSError : the file cannot be written; what was there before is still there
    """
    journals = journals_in(runs_dir)
    if not journals:
        raise HistoryError(f"no journal at {runs_dir}: name the folder of runs with --runs")
    listed: dict[str, dict[str, Any]] = {}
    left_out: list[str] = []
    with (
        tempfile.TemporaryDirectory() as scratch,
        whole_file(path) as file,
        _tar(file, path) as tar,
    ):
        for journal in journals:
            head = journal.with_name(journal.name + HEAD_SUFFIX)
            kept_head = head.read_bytes() if head.is_file() else None
            copy = _copied(journal, Path(scratch) / journal.name)
            _add(tar, journal.name, copy, listed)
            copy.unlink()
            if kept_head is not None:
                kept = Path(scratch) / head.name
                kept.write_bytes(kept_head)
                _add(tar, head.name, kept, listed)
        store = runs_dir / STORE_NAME
        if store.is_file():
            _add(tar, store.name, _copied(store, Path(scratch) / store.name), listed)
        for one in _files(runs_dir, with_pictures=with_pictures, but=path):
            name = one.relative_to(runs_dir).as_posix()
            try:
                _add(tar, name, one, listed)
            except OSError:
                left_out.append(name)
        manifest = {
            "form": FORM,
            "version": FORM_VERSION,
            "at": datetime.now(UTC).isoformat(),
            "pictures": with_pictures,
            "left_out": left_out,
            "files": listed,
        }
        data = json.dumps(manifest, indent=1, ensure_ascii=False).encode(
            "utf-8", "backslashreplace"
        )
        tar.addfile(_info(MANIFEST, len(data)), io.BytesIO(data))
    _require_same(path, listed)
    size = sum(int(one["size"]) for one in listed.values())
    return Backup(len(listed), size, tuple(left_out))


def _tar(file: IO[bytes], path: Path) -> tarfile.TarFile:
    mode = "w:gz" if path.suffix.lower() in (".gz", ".tgz") else "w"
    return tarfile.open(fileobj=file, mode=mode)  # type: ignore[call-overload,no-any-return]  # mode


def _copied(database: Path, copy: Path) -> Path:
    """Return a copy of a database that may be in use."""
    try:
        with (
            closing(sqlite3.connect(f"{database.absolute().as_uri()}?mode=ro", uri=True)) as db,
            closing(sqlite3.connect(copy)) as new,
        ):
            db.backup(new)
    except sqlite3.Error as error:
        if copy.exists():
            copy.unlink()
        if is_set_aside(database):  # damaged: as it is
            copy.write_bytes(database.read_bytes())
            return copy
        raise HistoryError(f"{database}: cannot be copied: {error}") from error
    return copy


def _files(runs_dir: Path, *, with_pictures: bool, but: Path) -> Iterator[Path]:
    """Yield the files in the folders of runs and studies; links are left out."""
    for folder in sorted(
        one for one in runs_dir.iterdir() if one.is_dir() and not one.is_symlink()
    ):
        for one in sorted(folder.rglob("*")):
            inside = one.relative_to(folder).parts
            if one.is_symlink() or not one.is_file() or one.resolve() == but.resolve():
                continue
            if with_pictures or inside[0] != PICTURES:
                yield one


def _info(name: str, size: int) -> tarfile.TarInfo:
    info = tarfile.TarInfo(name)
    info.size, info.mode = size, 0o644
    return info


def _add(tar: tarfile.TarFile, name: str, path: Path, listed: dict[str, dict[str, Any]]) -> None:
    size = path.stat().st_size
    with path.open("rb") as file:
        hashed = Hashed(file)
        info = _info(name, size)
        info.mtime = path.stat().st_mtime
        tar.addfile(info, hashed)
    listed[name] = {"size": size, "sha256": hashed.digest.hexdigest()}


class Hashed:
    """A file whose hash is made while it is read."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.digest = hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes."""
        data = self._file.read(size)
        self.digest.update(data)
        return data


def _require_same(path: Path, listed: Mapping[str, Mapping[str, Any]]) -> None:
    """Read a backup again and require that it holds the content written."""
    found = dict(hashes_in(path))
    found.pop(MANIFEST, None)
    wrong = [name for name, one in listed.items() if found.get(name) != one["sha256"]]
    if wrong or len(found) != len(listed):
        raise HistoryError(f"{path}: does not hold what was written ({', '.join(wrong[:5])})")


def hashes_in(path: Path) -> Iterator[tuple[str, str]]:
    """Yield name and SHA-256 of each file in a backup.

    Raises
    ------
    HistoryError : it is no backup, or damaged
    """
    try:
        with tarfile.open(path) as tar:
            for member in tar:
                file = tar.extractfile(member) if member.isreg() else None
                if file is None:
                    raise HistoryError(f"{path}: holds {member.name!r}, which is no file")
                hashed = Hashed(file)
                while hashed.read(CHUNK_BYTES):
                    pass
                yield member.name, hashed.digest.hexdigest()
    except (tarfile.TarError, EOFError, ValueError, OSError) as error:
        if isinstance(error, FileNotFoundError | PermissionError | IsADirectoryError):
            raise
        raise HistoryError(f"{path}: is no backup, or damaged: {error}") from error
