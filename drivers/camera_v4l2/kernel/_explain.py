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
from messages import say

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
    told = say(
        "camera {device}: {doing}: {get} ({strerror})",
        device=device,
        doing=doing,
        get=errno.errorcode.get(code, code),
        strerror=error.strerror,
    )
    if code in GONE:
        return UnpluggedError(
            say("{told}: the camera is gone; plug it in and connect again", told=told)
        )
    match code:
        case errno.ETIMEDOUT:
            return ReplyTimeoutError(told)
        case errno.EIO:
            return FaultError(say("{told}: the camera or its cable failed", told=told), code)
        case errno.EBUSY:
            return RefusedError(say("{told}: another program is using the camera", told=told), code)
        case errno.ENOTTY:
            return WrongDeviceError(say("{told}: not a V4L2 capture node", told=told))
        case errno.EPROTO:
            return BadReplyError(told)
    return RefusedError(told, code)


def explain_open(error: OSError, device: str) -> DeviceError:
    """Return the driver's error for a node that cannot be opened."""
    code = error.errno or 0
    told = say("camera {device}: {strerror}", device=device, strerror=os.strerror(code))
    match code:
        case errno.ENOENT | errno.ENOTDIR:
            return LinkError(say("{told}: no camera is plugged in under this name", told=told))
        case errno.ECONNREFUSED:
            return LinkError(say("{told}: no emulated camera listens there", told=told))
        case errno.EACCES | errno.EPERM:
            return RefusedError(
                say("{told}: this user may not open it (is the user in group 'video'?)", told=told),
                code,
            )
        case errno.EISDIR:
            return WrongDeviceError(say("{told}: not a V4L2 node", told=told))
    return explain(error, device, "open")


@contextmanager
def explained(device: str, doing: str) -> Iterator[None]:
    """Turn an ``OSError`` inside into the driver's own error."""
    try:
        yield
    except OSError as error:
        raise explain(error, device, doing) from error
