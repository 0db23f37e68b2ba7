"""A journal keeps to its file, and to a disk of this computer."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from controller.cell.journal import Journal, JournalError, open_cell_journal, read_rows
from controller.cell.journal.place import FileSystem, file_system_of, why_not_there
from controller.cell.journal.rows import CustodyChanged, RunBegan


def delete(folder: Path) -> None:
    shutil.rmtree(folder)


def move(folder: Path) -> None:
    folder.rename(folder.with_name("moved"))


def replace(folder: Path) -> None:
    path = folder / "journal.sqlite"
    copy = path.with_name("copy")
    shutil.copy(path, copy)
    copy.replace(path)


def drop_log(folder: Path) -> None:
    (folder / "journal.sqlite-wal").unlink()


def begin_anew(folder: Path) -> None:
    delete(folder)
    Journal(folder / "journal.sqlite", "other").close()


@pytest.mark.parametrize("harm", [delete, move, replace, drop_log, begin_anew])
@pytest.mark.parametrize("is_secured", [False, True])
def test_a_journal_whose_file_is_another_by_now_takes_no_row(
    tmp_path: Path, harm: Callable[[Path], None], *, is_secured: bool
) -> None:
    folder = tmp_path / "runs"
    journal = Journal(folder / "journal.sqlite", "run")
    journal.write(RunBegan())
    journal.write_synced(CustodyChanged(name="in_arm"))
    harm(folder)
    write = journal.write_synced if is_secured else journal.write
    with pytest.raises(JournalError, match=r"was (deleted or moved|replaced by .*) while"):
        write(CustodyChanged(name="placed"))
    journal.close()


def test_a_reader_and_a_second_writer_leave_a_journal_its_files(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    journal = Journal(path, "run")
    for _ in range(3):
        journal.write(RunBegan())
        list(read_rows(path))
        beside = Journal(path, "beside")
        beside.write(RunBegan())
        beside.close()
    journal.close()
    assert len(list(read_rows(path))) == 6


MOUNTED = """\
22 1 259:2 / / rw,relatime shared:1 - ext4 /dev/nvme0n1p2 rw
40 22 0:35 / /net rw - autofs systemd-1 rw
41 40 0:52 / {at} rw,relatime shared:2 - {kind} {source} rw,vers=4.2
"""


def mounted(folder: Path, kind: str, source: str) -> Path:
    at = str(folder / "runs").replace(" ", "\\040")
    listed = folder / "mountinfo"
    listed.write_text(MOUNTED.format(at=at, kind=kind, source=source))
    return listed


@pytest.mark.parametrize(
    ("kind", "source"),
    [
        ("nfs", "plant:/cells"), ("nfs4", "plant:/cells"), ("cifs", "//plant/cells"),
        ("smb3", "//plant/cells"), ("9p", "host"), ("ceph", "10.0.0.2:6789:/"),
        ("lustre", "10.0.0.2@tcp:/l"), ("afs", "none"), ("fuse.sshfs", "ada@plant:/cells"),
        ("fuse.glusterfs", "plant:/vol"), ("fuse.rclone", "remote:cells"), ("virtiofs", "share"),
        ("fuse", "https://plant/dav"), ("fuse.unheard_of", "plant:/cells"),
    ],
)  # fmt: skip
def test_a_network_file_system_keeps_no_journal(tmp_path: Path, kind: str, source: str) -> None:
    folder = tmp_path / "a b"
    folder.mkdir()
    why = why_not_there(folder / "runs" / "north" / "journal.sqlite", mounted(folder, kind, source))
    assert kind in why
    assert source in why
    assert "--runs" in why


@pytest.mark.parametrize(
    ("kind", "source"),
    [
        ("ext4", "/dev/sda1"), ("btrfs", "/dev/mapper/root"), ("zfs", "tank/runs"),
        ("overlay", "overlay"), ("tmpfs", "tmpfs"), ("fuseblk", "/dev/sdb1"),
        ("fuse.gocryptfs", "/home/ada/.crypt"), ("fuse.mergerfs", "/mnt/a:/mnt/b"),
    ],
)  # fmt: skip
def test_a_file_system_of_this_computer_does(tmp_path: Path, kind: str, source: str) -> None:
    assert not why_not_there(tmp_path / "runs" / "j", mounted(tmp_path, kind, source))


def test_of_two_mounts_the_inner_one_counts_and_of_one_place_the_last(tmp_path: Path) -> None:
    listed = mounted(tmp_path, "nfs4", "plant:/cells")
    at = tmp_path / "runs"
    with listed.open("a") as file:
        file.write(f"42 41 8:1 / {at / 'local'} rw - ext4 /dev/sda1 rw\n")
        file.write(f"43 41 8:2 / {at / 'local'} rw - xfs /dev/sdb1 rw\n")
    found = file_system_of(at / "local" / "journal.sqlite", listed)
    assert found == FileSystem("xfs", "/dev/sdb1", str(at / "local"))
    assert why_not_there(at / "journal.sqlite", listed)
    assert not why_not_there(tmp_path / "runs-here" / "journal.sqlite", listed)


def test_a_start_refuses_a_journal_on_a_network_file_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = mounted(tmp_path, "nfs4", "plant:/cells")
    monkeypatch.setattr("controller.cell.journal.place.MOUNTS", listed)
    path = tmp_path / "runs" / "journal.sqlite"
    with pytest.raises(JournalError, match="nfs4"):
        open_cell_journal(path, "run")
    assert not os.path.lexists(path)
