"""The place of a journal: its file system, and whether its files are still at its path.

Writes to a file that was deleted, moved or replaced while it is open still succeed, but the rows
are lost. SQLite's log (WAL) needs memory that all its processes share, which no file system of
another computer provides (sqlite.org/wal.html, 1).
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from messages import key, say

from ._form import JournalError

LOG_SUFFIX: Final = "-wal"
INDEX_SUFFIX: Final = "-shm"
MOUNTS: Final = Path("/proc/self/mountinfo")
# Types of file systems whose files are on another computer or on the host of a virtual machine
# (Linux, Documentation/filesystems; proc_pid_mountinfo(5), field 9).
NETWORK_TYPES: Final = frozenset(
    {
        "9p", "acfs", "afs", "beegfs", "ceph", "cifs", "coda", "cvfs", "davfs", "gfs", "gfs2",
        "glusterfs", "gpfs", "lustre", "mfs", "ncpfs", "nfs", "nfs4", "ocfs2", "orangefs",
        "panfs", "prl_fs", "pvfs2", "smb2", "smb3", "smbfs", "vboxsf", "virtiofs", "vmhgfs",
        "wekafs",
    }
)  # fmt: skip
# FUSE runs file systems of both kinds. Those of another computer name it in their source, as in
# user@host:/folder, //host/share or https://host, or have a known name.
NETWORK_FUSE: Final = frozenset(
    {
        "afpfs", "ceph", "curlftpfs", "davfs", "davfs2", "gcsfuse", "glusterfs", "goofys",
        "juicefs", "moosefs", "mfs", "rclone", "s3fs", "smbnetfs", "sshfs", "vmhgfs-fuse",
    }
)  # fmt: skip
_ELSEWHERE: Final = re.compile(r"//|^[^/]+:")


@dataclass(frozen=True, slots=True)
class FileSystem:
    """The file system mounted at a path.

    Attributes
    ----------
    kind : its type, as the kernel names it
    source : source of the mount
    at : mount point
    """

    kind: str
    source: str
    at: str

    @property
    def is_network(self) -> bool:
        """Whether its files are another computer's."""
        family, _, name = self.kind.partition(".")
        if family not in ("fuse", "fuseblk"):
            return self.kind in NETWORK_TYPES
        return name in NETWORK_FUSE or _ELSEWHERE.search(self.source) is not None


def file_system_of(path: Path, mounts: Path = MOUNTS) -> FileSystem | None:
    """Return the file system of a path, which need not exist yet; None if the kernel has none.

    Parameters
    ----------
    path : path of a file or folder
    mounts : the kernel's list
    """
    try:
        lines = mounts.read_text(encoding="utf-8", errors="surrogateescape").splitlines()
    except OSError:
        return None
    resolved = path.resolve()
    found: FileSystem | None = None
    for line in lines:
        before, _, after = line.partition(" - ")
        at = _unescaped(before.split()[4])
        # of several at one place the last hides the others
        if resolved.is_relative_to(at) and (found is None or len(at) >= len(found.at)):
            kind, source, *_ = after.split(" ")
            found = FileSystem(kind, _unescaped(source), at)
    return found


def _unescaped(text: str) -> str:
    r"""Return a field with its escapes resolved: blanks are written as \040 there."""
    return re.sub(r"\\([0-7]{3})", lambda found: chr(int(found[1], 8)), text)


def why_not_there(path: Path, mounts: Path | None = None) -> str:
    """Return the reason why a journal must not be at a path; empty if it may be.

    Parameters
    ----------
    path : path of its file, or its folder
    mounts : the kernel's list; None for this computer's
    """
    found = file_system_of(path, mounts or MOUNTS)
    if found is None or not found.is_network:
        return ""
    return say(
        "{parent} is on a network file system ({kind}, {source} at {at}), "
        "which cannot keep a journal whole. Give a folder on a disk of "
        "this computer by --runs",
        parent=path.parent,
        kind=found.kind,
        source=found.source,
        at=found.at,
    )


class OpenFiles:
    """The files of an open journal, which have to stay at their paths.

    Parameters
    ----------
    path : path of the journal
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._were = self._are()

    def _are(self) -> dict[Path, tuple[int, int]]:
        """Return the device and inode of the file at each path, without opening it.

        To close a file that SQLite has open would drop SQLite's locks (sqlite.org/howtocorrupt,
        2.2).
        """
        found = {}
        for suffix in ("", LOG_SUFFIX, INDEX_SUFFIX):
            one = self._path.with_name(self._path.name + suffix)
            try:
                stat = one.stat()
            except (FileNotFoundError, NotADirectoryError):
                continue
            found[one] = (stat.st_dev, stat.st_ino)
        return found

    def require_same(self) -> None:
        """Check that rows still go to the files that others find.

        Raises
        ------
        JournalError : one of them was deleted, moved or replaced
        OSError : their folder cannot be looked into
        """
        now = self._are()
        if now == self._were:
            return
        lost = [one for one in self._were if now.get(one) != self._were[one]] or [self._path]
        how = key("replaced by another file") if lost[0] in now else key("deleted or moved")
        raise JournalError(
            say(
                "journal {path}: {name} was {how} while the cell was working",
                path=self._path,
                name=lost[0].name,
                how=how,
            )
        )
