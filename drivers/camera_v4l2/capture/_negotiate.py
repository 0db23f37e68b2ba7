"""The agreement with an opened camera: its identity, its picture format, its frame rate."""

import errno
import logging

from drivers.errors import BadReplyError, WrongDeviceError
from messages import key, say

from ..kernel import GONE, Device, abi, explain, explained
from ..kernel.abi import Cap
from ._decode import line_bytes, pixel_kind
from ._types import CameraConfig

log = logging.getLogger(__name__)


def check_kind(device: Device) -> abi.Capability:
    """Return the node's capabilities.

    Raises
    ------
    WrongDeviceError : not a V4L2 node, or not one that captures with streaming
    """
    try:
        caps = device.query_capability()
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):
            raise WrongDeviceError(
                say("camera {path}: not a V4L2 node", path=device.path)
            ) from error
        raise explain(error, device.path, key("capability query")) from error
    has = caps.node_caps
    if not (has & Cap.VIDEO_CAPTURE and has & Cap.STREAMING):
        can = ", ".join(cap.name for cap in Cap if cap & has and cap.name) or "nothing"
        raise WrongDeviceError(
            say(
                "camera {path}: {card} ({driver}) is no capture node with streaming: it can {can}",
                path=device.path,
                card=repr(caps.card),
                driver=caps.driver,
                can=can,
            )
        )
    return caps


def agree_on_format(device: Device, config: CameraConfig) -> abi.PixFormat:
    """Set the first wanted format that the camera offers; return the camera's answer.

    Raises
    ------
    WrongDeviceError : it offers or answers none that can be read here, or is interlaced
    BadReplyError : an answer that contradicts itself
    RefusedError : another program is streaming from it (code EBUSY)
    """
    with explained(device.path, "format"):
        offered = [abi.fourcc_name(code) for code in device.pixel_formats()]
        wanted = [name for name in config.pixel_formats if name in offered]
        if not wanted:
            raise WrongDeviceError(
                say(
                    "camera {path}: offers {offered}; wanted is one of {pixel_formats}",
                    path=device.path,
                    offered=", ".join(offered) or key("no format"),
                    pixel_formats=", ".join(config.pixel_formats),
                )
            )
        asked = abi.PixFormat(config.width, config.height, abi.fourcc(wanted[0]))
        got = device.set_format(asked)
    _check_format(device, got)
    if (got.width, got.height) != (config.width, config.height):
        log.warning(
            "camera %s: %d x %d px required, it sends %d x %d px",
            device.path,
            config.width,
            config.height,
            got.width,
            got.height,
        )
    return got


def _check_format(device: Device, got: abi.PixFormat) -> None:
    kind, name = pixel_kind(got), abi.fourcc_name(got.pixelformat)
    if kind is None:
        raise WrongDeviceError(
            say("camera {path}: answers with {name}, unreadable here", path=device.path, name=name)
        )
    if got.field not in (abi.FIELD_ANY, abi.FIELD_NONE):
        raise WrongDeviceError(
            say(
                "camera {path}: interlaced (field order {field})", path=device.path, field=got.field
            )
        )
    packed = got.width * kind.bytes_per_px
    is_line_short = packed > 0 and line_bytes(got) < packed
    is_image_short = packed > 0 and got.sizeimage < line_bytes(got) * got.height
    if not (got.width and got.height) or is_line_short or is_image_short:
        raise BadReplyError(
            say(
                "camera {path}: {name} {width} x {height} px in {sizeimage} bytes, "
                "{bytesperline} a row",
                path=device.path,
                name=name,
                width=got.width,
                height=got.height,
                sizeimage=got.sizeimage,
                bytesperline=got.bytesperline,
            )
        )


def agree_on_period(device: Device, wanted_s: float) -> float:
    """Set a frame period [cell s] and return the camera's; the wish, if it names none."""
    try:
        granted_s = device.set_period(wanted_s)
    except OSError as error:
        if error.errno in GONE:
            raise explain(error, device.path, key("frame rate")) from error
        log.info("camera %s: the frame rate cannot be set: %s", device.path, error)
        granted_s = None
    period_s = granted_s or wanted_s
    if abs(period_s - wanted_s) > 0.01 * wanted_s:
        log.warning(
            "camera %s: %.4g fps required, it sends %.4g", device.path, 1 / wanted_s, 1 / period_s
        )
    return period_s
