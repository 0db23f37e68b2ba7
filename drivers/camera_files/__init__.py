"""A camera that is a folder of pictures, or a video: recorded elsewhere, fed to the cell.

The pictures are old: neither lamps nor exposure had any effect on them. The time that the driver
promises for a frame is that of its display, by the cell's clock. Knows no V4L2.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from .. import kinds
from ..kinds import Capture, Driver, Site
from ._camera import FileCamera
from ._errors import NoPictureError
from ._sources import Folder, Size, Source, Video

__all__ = [
    "FOLDER_DRIVER",
    "VIDEO_DRIVER",
    "FileCamera",
    "FileSettings",
    "Folder",
    "NoPictureError",
    "Size",
    "Source",
    "Video",
]


@dataclass(frozen=True, slots=True)
class FileSettings:
    """The timing of the pictures.

    Attributes
    ----------
    at_end : behind the last picture, ``stop`` as if the camera were unplugged, or ``loop``
    next_by : ``look``: each look takes the next picture, however long after the last one;
        ``time``: they pass at the cell file's ``fps``, looked at or not
    """

    at_end: Literal["stop", "loop"] = "stop"
    next_by: Literal["look", "time"] = "look"


def _build(source: type[Source], site: Site, settings: FileSettings) -> FileCamera:
    capture = site.capture
    if capture is None:
        raise ValueError(f"{site.name}: no settings for this camera")
    # an absolute path stays what it is
    path = Path(site.folder, site.address).absolute()
    return FileCamera(
        source(site.name, path, _size(capture)),
        name=site.name,
        period_s=1.0 / capture.fps,
        exposure_s=capture.exposure_s,
        late_s=capture.frame_late_s,
        loops=settings.at_end == "loop",
        passes=settings.next_by == "time",
        clock=site.clock,
        wires=site.wires,
    )


def _size(capture: Capture) -> Size:
    return Size(
        capture.width,
        capture.height,
        allows_8_bits=any(one in ("GREY", "YUYV", "MJPG") for one in capture.formats),
        allows_16_bits="Y16" in capture.formats,
    )


FOLDER_DRIVER: Driver[kinds.Camera, FileSettings] = Driver(
    FileSettings, partial(_build, Folder), keeps_cell_time=True
)
VIDEO_DRIVER: Driver[kinds.Camera, FileSettings] = Driver(
    FileSettings, partial(_build, Video), keeps_cell_time=True
)
