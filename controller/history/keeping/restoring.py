"""Reads a backup into a folder that has no runs yet: all of it, verified by hash, or nothing."""

import json
import os
import shutil
import tarfile
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PurePosixPath
from typing import IO, Any, Final

from controller.cell.journal import JOURNAL_NAME, JournalError, first_flaw

from ..errors import HistoryError
from .backup import CHUNK_BYTES, FORM, FORM_VERSION, MANIFEST, Hashed

MANIFEST_BYTES_MAX: Final = 256 << 20
FILES_MAX: Final = 10_000_000


@dataclass(frozen=True, slots=True)
class Restored:
    """The result of restoring.

    Attributes
    ----------
    at : date of the backup
    flaw : fault in the journal as it was then; empty if there is none
    """

    file_count: int
    at: datetime
    flaw: str = ""


def restore(path: Path, runs_dir: Path) -> Restored:
    """Restore a backup and return its content; a folder that holds anything is left alone.

    Parameters
    ----------
    path : path of the backup
    runs_dir : folder of runs; made if there is none

    Raises
    ------
    HistoryError : the folder is not empty, or the file is no backup, damaged or changed
    OSError : a file cannot be read or written
    """
    if runs_dir.exists() and (not runs_dir.is_dir() or any(runs_dir.iterdir())):
        raise HistoryError(f"{runs_dir}: is not empty; name a new folder with --runs")
    runs_dir.parent.mkdir(parents=True, exist_ok=True)
    scratch = Path(tempfile.mkdtemp(dir=runs_dir.parent, prefix=f".{runs_dir.name}-"))
    try:
        found, data = _unpacked(path, scratch)
        manifest = _manifest(path, data)
        _require_listed(path, found, manifest["files"])
        at = datetime.fromisoformat(str(manifest["at"]))
        flaw = first_flaw(scratch / JOURNAL_NAME) or ""
        umask = os.umask(0)
        os.umask(umask)
        scratch.chmod(0o777 & ~umask)
        if runs_dir.exists():
            runs_dir.rmdir()
        scratch.replace(runs_dir)
    except JournalError as error:
        raise HistoryError(f"{path}: {error}") from error
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return Restored(len(found), at, flaw)


def _unpacked(path: Path, folder: Path) -> tuple[dict[str, tuple[int, str]], bytes]:
    """Write the files of a backup; return size and hash of each, and the manifest's bytes."""
    found: dict[str, tuple[int, str]] = {}
    manifest = b""
    try:
        with tarfile.open(path) as tar:
            for member in tar:
                name = _safe(path, member)
                file = tar.extractfile(member)
                if file is None or name in found or len(found) >= FILES_MAX:
                    raise HistoryError(f"{path}: {name!r} is there twice, or is no file")
                if name == MANIFEST:
                    manifest = file.read(MANIFEST_BYTES_MAX)
                    continue
                found[name] = _written(file, folder / name)
    except (tarfile.TarError, EOFError, ValueError) as error:
        raise HistoryError(f"{path}: is no backup, or damaged: {error}") from error
    return found, manifest


def _safe(path: Path, member: tarfile.TarInfo) -> str:
    """Return the name of a file in a backup, which must be inside the folder it is unpacked to."""
    name = PurePosixPath(member.name)
    if not member.isreg() or name.is_absolute() or ".." in name.parts or "\0" in member.name:
        raise HistoryError(f"{path}: holds {member.name!r}, which is no file of a folder of runs")
    return name.as_posix()


def _written(file: IO[bytes], path: Path) -> tuple[int, str]:
    path.parent.mkdir(parents=True, exist_ok=True)
    hashed, size = Hashed(file), 0
    with path.open("xb") as out:
        while chunk := hashed.read(CHUNK_BYTES):
            out.write(chunk)
            size += len(chunk)
        out.flush()
        os.fsync(out.fileno())
    return size, hashed.digest.hexdigest()


def _manifest(path: Path, data: bytes) -> Mapping[str, Any]:
    try:
        manifest = json.loads(data)
        form, version = manifest["form"], manifest["version"]
        datetime.fromisoformat(str(manifest["at"]))
        files = {str(n): (int(o["size"]), str(o["sha256"])) for n, o in manifest["files"].items()}
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise HistoryError(f"{path}: is no backup of cellctl: it has no list of files") from error
    if form != FORM or version != FORM_VERSION:
        raise HistoryError(f"{path}: is a backup of version {version}, which is not known here")
    return {**manifest, "files": files}


def _require_listed(
    path: Path, found: Mapping[str, tuple[int, str]], listed: Mapping[str, tuple[int, str]]
) -> None:
    changed = sorted(n for n in found.keys() | listed.keys() if found.get(n) != listed.get(n))
    if changed:
        more = f" and {len(changed) - 5} more" if len(changed) > 5 else ""
        raise HistoryError(
            f"{path}: not as it was written: {', '.join(changed[:5])}{more}; nothing was restored"
        )
