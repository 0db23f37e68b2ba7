"""Turns an errno of V4L2 into one of the drivers' errors, with advice."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from drivers.errors import (
    BadReplyError,
    DeviceError,
    FaultError,
    LinkError,
    RefusedError,
    ReplyTimeoutError,
    UnpluggedError,
    WrongDeviceError,
)

# ENODEV is the error of every call on an unplugged camera; the rest means a node whose server died
# (ENOTCONN, ECONNABORTED: a FUSE mount without its process) or that is being removed.
GONE: Final = frozenset(
    {errno.ENODEV, errno.ENXIO, errno.ESHUTDOWN, errno.ENOTCONN, errno.ECONNABORTED}
)


def explain(error: OSError, device: str, doing: str) -> DeviceError:
    """Return the driver's error for a failed system call while ``doing``.

    Parameters
    ----------
    error : error of the system call; its errno decides the class
    device : the node or socket, for the message
    doing : action attempted, for the message, such as "frame rate"
    """
    code = error.errno or 0
    told = f"camera {device}: {doing}: {errno.errorcode.get(code, code)} ({error.strerror})"
    if code in GONE:
        return UnpluggedError(f"{told}: the camera is gone; plug it in and connect again")
    match code:
        case errno.ETIMEDOUT:
            return ReplyTimeoutError(told)
        case errno.EIO:
            return FaultError(f"{told}: the camera or its cable failed", code)
        case errno.EBUSY:
            return RefusedError(f"{told}: another program is using the camera", code)
        case errno.ENOTTY:
            return WrongDeviceError(f"{told}: not a V4L2 capture node")
        case errno.EPROTO:
            return BadReplyError(told)
    return RefusedError(told, code)


def explain_open(error: OSError, device: str) -> DeviceError:
    """Return the driver's error for a node that cannot be opened."""
    code = error.errno or 0
    told = f"camera {device}: {os.strerror(code)}"
    match code:
        case errno.ENOENT | errno.ENOTDIR:
            return LinkError(f"{told}: no camera is plugged in under this name")
        case errno.ECONNREFUSED:
            return LinkError(f"{told}: no emulated camera listens there")
        case errno.EACCES | errno.EPERM:
            return RefusedError(
                f"{told}: this user may not open it (is the user in group 'video'?)", code
            )
        case errno.EISDIR:
            return WrongDeviceError(f"{told}: not a V4L2 node")
    return explain(error, device, "open")


@contextmanager
def explained(device: str, doing: str) -> Iterator[None]:
    """Turn an ``OSError`` inside into the driver's own error."""
    try:
        yield
    except OSError as error:
        raise explain(error, device, doing) from error
