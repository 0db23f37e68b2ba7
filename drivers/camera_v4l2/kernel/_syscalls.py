"""The few system calls behind one small interface, and the kernel's own answer to them.

Everything above talks to ``SysCalls``; so a test can be the camera, and an emulated camera can
be reached where no device node can be made (`_socket_calls`). Calls block for as long as the
device takes, which is why the camera makes them on a thread of its own.
"""

import fcntl
import mmap
import os
from typing import Protocol


class BufferMap(Protocol):
    """One mapped buffer."""

    def __getitem__(self, part: slice) -> bytes:
        """Return a copy of some bytes."""
        ...

    def close(self) -> None:
        """Give the map back."""
        ...


class SysCalls(Protocol):
    """The system calls that a capture driver needs; every method may raise ``OSError``."""

    def open(self, path: str) -> int:
        """Open a camera, non-blocking, and return its descriptor."""
        ...

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        """Make one ioctl; ``buffer`` holds the struct and is changed in place.

        Parameters
        ----------
        fd : the open camera
        request : the ioctl's request number, see `_abi`
        buffer : the struct, of the size that the request number contains
        """
        ...

    def mmap(self, fd: int, length: int, offset: int) -> BufferMap:
        """Return a map of one buffer, for reading.

        Parameters
        ----------
        fd : the open camera
        length : size of the buffer [bytes], from QUERYBUF
        offset : the buffer's offset [bytes], from QUERYBUF
        """
        ...

    def readiness_fd(self, fd: int) -> int:
        """Return a descriptor that polls readable once a frame is done or the camera is gone."""
        ...

    def acknowledge(self, fd: int) -> None:
        """Forget any readiness so far; called before the buffers are read."""
        ...

    def close(self, fd: int) -> None:
        """Close the camera."""
        ...


class KernelCalls:
    """A node of the kernel's: /dev/video*, or a file that a FUSE server gives that behaviour."""

    def open(self, path: str) -> int:
        """Open the node for reading and writing, non-blocking; return its descriptor."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, fd: int, request: int, buffer: bytearray) -> None:
        """Make the ioctl.

        Parameters
        ----------
        fd : file descriptor of the node
        request : the ioctl's request number, see `_abi`
        buffer : the struct; the kernel changes it in place
        """
        fcntl.ioctl(fd, request, buffer, True)

    def mmap(self, fd: int, length: int, offset: int) -> mmap.mmap:
        """Return a map of a buffer; it holds a duplicate of ``fd`` until it is closed.

        Parameters
        ----------
        fd : file descriptor of the node
        length : size of the buffer [bytes], from QUERYBUF
        offset : the buffer's offset [bytes], from QUERYBUF
        """
        return mmap.mmap(fd, length, flags=mmap.MAP_SHARED, prot=mmap.PROT_READ, offset=offset)

    def readiness_fd(self, fd: int) -> int:
        """Return the node itself: V4L2 polls readable while a buffer is done."""
        return fd

    def acknowledge(self, fd: int) -> None:
        """Do nothing: the node's readiness is a level, not a count."""

    def close(self, fd: int) -> None:
        """Close the node."""
        os.close(fd)
