"""FUSE without libfuse: the bytes of `linux/fuse.h` and the system calls around them.

Knows requests and replies, not the files served.
"""

import ctypes
import errno
import os
from enum import IntEnum
from pathlib import Path
from struct import Struct
from typing import Final

from ..kernel import Refused

_LIBC: Final = ctypes.CDLL(None, use_errno=True)
_MS_NOSUID_NODEV: Final = 2 | 4
_MNT_FORCE, _MNT_DETACH = 1, 2

REQUEST: Final = Struct("<IIQQIII4x")  # length opcode unique node uid gid pid
REPLY: Final = Struct("<IiQ")  # length, error or notification, unique
INIT_IN: Final = Struct("<IIII")  # major minor max_readahead flags
INIT_OUT: Final = Struct("<IIIIHHIIHHI28x")
ATTR: Final = Struct("<6Q10I")
ENTRY_OUT: Final = Struct("<4Q2I")  # node generation entry_valid attr_valid, nanoseconds of both
ATTR_OUT: Final = Struct("<QII")
OPEN_IN: Final = Struct("<II")
OPEN_OUT: Final = Struct("<QII")
READ_IN: Final = Struct("<QQII16x")  # handle offset size flags
WRITE_OUT: Final = Struct("<II")
DIRENT: Final = Struct("<QQII")
IOCTL_IN: Final = Struct("<QIIQII")  # handle flags request argument in_size out_size
IOCTL_OUT: Final = Struct("<iIII")
POLL_IN: Final = Struct("<QQII")  # handle, poll handle, flags, events
POLL_OUT: Final = Struct("<II")
RELEASE_IN: Final = Struct("<QII8x")
INTERRUPT_IN: Final = Struct("<Q")
STORE: Final = Struct("<QQII")  # node offset size
INVAL_ENTRY: Final = Struct("<QII")
POLL_WAKEUP: Final = Struct("<Q")

MAX_WRITE_BYTES: Final = 1 << 20
READ_BYTES: Final = MAX_WRITE_BYTES + 8192  # a shorter read buffer is refused with EINVAL
INIT_FLAGS: Final = 1 << 0 | 1 << 22  # ASYNC_READ, MAX_PAGES
OPEN_KEEP_CACHE: Final = 1 << 1
POLL_SCHEDULE_NOTIFY: Final = 1 << 0


class Opcode(IntEnum):
    """Requests that this server answers otherwise than with ENOSYS."""

    LOOKUP = 1
    FORGET = 2
    GETATTR = 3
    SETATTR = 4
    OPEN = 14
    READ = 15
    WRITE = 16
    RELEASE = 18
    FSYNC = 20
    FLUSH = 25
    INIT = 26
    OPENDIR = 27
    READDIR = 28
    RELEASEDIR = 29
    INTERRUPT = 36
    DESTROY = 38
    IOCTL = 39
    POLL = 40
    BATCH_FORGET = 42


class Notice(IntEnum):
    """A server's unasked message to the kernel."""

    POLL = 1
    INVAL_ENTRY = 3
    STORE = 4


def mount(device_fd: int, directory: Path) -> None:
    """Mount an open `/dev/fuse` on a directory, for this user alone.

    Raises
    ------
    OSError : the kernel refused, with EPERM without the right to mount
    """
    owner = f"user_id={os.getuid()},group_id={os.getgid()}"
    options = f"fd={device_fd},rootmode=40700,{owner}".encode()
    target = os.fsencode(directory)
    if _LIBC.mount(b"v4l2cam", target, b"fuse.v4l2cam", _MS_NOSUID_NODEV, options):
        number = ctypes.get_errno()
        raise OSError(number, f"cannot mount FUSE: {os.strerror(number)}", str(directory))


def unmount(directory: Path) -> None:
    """Remove a mount that may be in use, and fail its waiting requests; no mount is fine.

    Raises
    ------
    OSError : the kernel refused for another reason than that nothing is mounted there
    """
    if _LIBC.umount2(os.fsencode(directory), _MNT_FORCE | _MNT_DETACH):
        number = ctypes.get_errno()
        if number not in (errno.EINVAL, errno.ENOENT):
            raise OSError(number, f"cannot unmount: {os.strerror(number)}", str(directory))


class _Iovec(ctypes.Structure):
    _fields_ = (("base", ctypes.c_void_p), ("length", ctypes.c_size_t))


class ProcessMemory:
    """Another process's memory, for structs that hold pointers."""

    def __init__(self, pid: int) -> None:
        self._pid = pid

    def fetch(self, address: int, size_bytes: int) -> bytes:
        """Return the bytes at an address."""
        buffer = ctypes.create_string_buffer(size_bytes)
        self._move(_LIBC.process_vm_readv, address, buffer, size_bytes)
        return buffer.raw

    def store(self, address: int, data: bytes) -> None:
        """Write bytes to an address."""
        buffer = ctypes.create_string_buffer(data, len(data))
        self._move(_LIBC.process_vm_writev, address, buffer, len(data))

    def _move(
        self,
        system_call: "ctypes._NamedFuncPointer",
        address: int,
        buffer: "ctypes.Array[ctypes.c_char]",
        size_bytes: int,
    ) -> None:
        here = _Iovec(ctypes.addressof(buffer), size_bytes)
        there = _Iovec(address, size_bytes)
        moved = system_call(self._pid, ctypes.byref(here), 1, ctypes.byref(there), 1, 0)
        if moved != size_bytes:
            raise Refused(errno.EFAULT)
