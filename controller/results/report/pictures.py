"""Pictures of a run, cropped, reduced and embedded in the page as data.

The page must be small enough to mail: a `Quality` limits the pictures, and a page that is too large
is rendered again with the next lower one.
"""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import Grey
from drivers.pictures import BrokenPictureError, decode

from ..run import Box, Points, RunPictures

# Ratio of width to height of every cut-out, the same as the cameras'.
ASPECT: Final = 1.25
# Distance above which consecutive points are on two loops; on one they are at most 3 * sqrt(2) px
# apart.
OUTLINE_GAP_PX: Final = 6.0
# Largest distance of a simplified outline from its points: invisible, and the path is much shorter.
OUTLINE_OFF_PX: Final = 0.4


@dataclass(frozen=True, slots=True)
class Quality:
    """Size limits of pictures.

    Attributes
    ----------
    view_px, crop_px : longer side of views and of crops; 0 leaves pictures out
    jpeg : JPEG quality, 0..100
    map_px : width of drawings of the part; 0 leaves them out
    typical_bytes : approximate size that one picture adds to the page, measured on a run of
        featuretype; a quality that cannot fit is skipped
    """

    view_px: int
    crop_px: int
    jpeg: int
    map_px: int
    typical_bytes: int


QUALITIES: Final = (
    Quality(640, 320, 82, 330, 9_000),
    Quality(420, 240, 72, 330, 4_500),
    Quality(280, 180, 60, 220, 2_700),
    Quality(160, 120, 45, 160, 1_600),
    Quality(0, 0, 0, 0, 0),
)
# Size of the cache of decoded pictures, in pixels; views, findings and looks share pictures.
KEPT_PX = 60_000_000
# Brightening of dark pictures, since one lamp lights a dull part poorly; the page states the gain.
BRIGHT_PERCENTILE: Final = 99.5
BRIGHT_LEVEL: Final = 215.0
MIN_GAIN, MAX_GAIN = 1.2, 4.0


@dataclass(frozen=True, slots=True)
class Shot:
    """A picture ready for the page.

    Attributes
    ----------
    uri : data URI; empty if the picture is missing
    why_missing : reason why it is missing
    window : x0, y0, x1, y1 of the cut-out in the original picture [px]
    gain : factor by which it was brightened
    """

    uri: str
    why_missing: str
    window: Box
    gain: float = 1.0

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the cut-out [px]."""
        return self.window[2] - self.window[0], self.window[3] - self.window[1]


class Pictures:
    """Reader of a run's pictures; a missing or broken file is reported on the page, not raised."""

    def __init__(self, pictures: RunPictures, quality: Quality) -> None:
        self._pictures = pictures
        self._quality = quality
        self._decoded: dict[str, Grey | None] = {}
        self._why: dict[str, str] = {}
        self._held_px = 0

    @property
    def quality(self) -> Quality:
        """Size limits of the pictures."""
        return self._quality

    def view(self, name: str, window: Box | None = None) -> Shot:
        """Return a picture, or a cut-out of it."""
        return self._shot(name, window, self._quality.view_px)

    def crop(self, name: str, window: Box) -> Shot:
        """Return a small cut-out."""
        return self._shot(name, window, self._quality.crop_px)

    def size_px(self, name: str) -> tuple[int, int] | None:
        """Return the width and height of a picture; None if it is unreadable."""
        image = self._read(name)
        return None if image is None else (image.shape[1], image.shape[0])

    def _shot(self, name: str, window: Box | None, longest_px: int) -> Shot:
        fallback = window or (0, 0, 5, 4)
        if longest_px == 0:
            return Shot("", f"{name}: left out to keep this page small", fallback)
        image = self._read(name)
        if image is None:
            return Shot("", self._why.get(name, f"picture {name} cannot be read"), fallback)
        height, width = image.shape[:2]
        x0, y0, x1, y1 = window or (0, 0, width, height)
        x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, width), min(y1, height)
        if x1 <= x0 or y1 <= y0:
            return Shot("", f"picture {name} does not reach to this place", fallback)
        part = image[y0:y1, x0:x1]
        scale = longest_px / max(part.shape[:2])
        if scale < 1:
            smaller = cv2.resize(part, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            part = np.asarray(smaller, dtype=np.uint8)
        gain = _gain(part)
        if gain > 1:
            part = np.clip(part.astype(np.float32) * gain, 0, 255).astype(np.uint8)
        return Shot(data_uri(part, self._quality.jpeg), "", (x0, y0, x1, y1), gain)

    def _read(self, name: str) -> Grey | None:
        if name not in self._decoded:
            while self._held_px > KEPT_PX:
                gone = self._decoded.pop(next(iter(self._decoded)))
                self._held_px -= 0 if gone is None else gone.size
            found = grey_picture(self._pictures, name)
            if isinstance(found, str):
                self._why[name] = found
            image = None if isinstance(found, str) else found
            self._decoded[name] = image
            self._held_px += 0 if image is None else image.size
        return self._decoded[name]


def grey_picture(pictures: RunPictures, name: str) -> Grey | str:
    """Return a picture of a run, or the reason why there is none.

    Parameters
    ----------
    pictures : pictures of the run
    name : name of the file, relative to the folder
    """
    data = pictures.read(name)
    if isinstance(data, str):
        return data
    try:
        return np.asarray(decode(data, "grey"), dtype=np.uint8)
    except BrokenPictureError:
        return f"picture {name} cannot be read"


def _gain(image: Grey) -> float:
    """Return the factor for brightening a dark picture, from 1 to `MAX_GAIN`."""
    bright = float(np.percentile(image, BRIGHT_PERCENTILE))
    gain = round(float(np.clip(BRIGHT_LEVEL / max(bright, 1.0), 1.0, MAX_GAIN)), 1)
    return gain if gain >= MIN_GAIN else 1.0


def data_uri(image: NDArray[np.uint8], jpeg: int) -> str:
    """Return a grey or BGR picture as a data URI.

    Parameters
    ----------
    image : (height, width) or (height, width, 3)
    jpeg : quality, 0..100
    """
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, jpeg])
    return "data:image/jpeg;base64," + base64.b64encode(data.tobytes()).decode("ascii")


def window_round(boxes: Iterable[Box], size: tuple[int, int], margin: float, min_px: int) -> Box:
    """Return the cut-out around boxes, in the picture's proportions.

    Parameters
    ----------
    boxes : x0, y0, x1, y1 of each [px]; none for the whole picture
    size : width and height of the picture [px]
    margin : border on every side, as a share of the boxes' extent
    min_px : smallest width of the cut-out
    """
    width, height = size
    corners = np.array(list(boxes), dtype=float).reshape(-1, 4)
    if len(corners) == 0:
        return 0, 0, width, height
    x0, y0 = corners[:, 0].min(), corners[:, 1].min()
    x1, y1 = corners[:, 2].max(), corners[:, 3].max()
    wide = max((x1 - x0) * (1 + 2 * margin), (y1 - y0) * (1 + 2 * margin) * ASPECT, min_px)
    wide = min(wide, width, height * ASPECT)
    tall = wide / ASPECT
    left = np.clip((x0 + x1 - wide) / 2, 0, width - wide)
    top = np.clip((y0 + y1 - tall) / 2, 0, height - tall)
    return round(left), round(top), round(left + wide), round(top + tall)


def bounds(points: Points) -> Box | None:
    """Return the box around points; None without points."""
    if not points:
        return None
    xs, ys = zip(*points, strict=True)
    return round(min(xs)), round(min(ys)), round(max(xs)) + 1, round(max(ys)) + 1


def outline_path(points: Points) -> str:
    """Return an outline as the ``d`` attribute of an SVG path, in picture coordinates.

    The points of all loops, outer and inner, follow one another; a jump is the start of the next
    loop. The centre of a pixel lies half a pixel from its corner.
    """
    parts: list[list[tuple[float, float]]] = []
    for point in points:
        if not parts or np.hypot(*np.subtract(point, parts[-1][-1])) > OUTLINE_GAP_PX:
            parts.append([])
        parts[-1].append(point)
    path = []
    for loop in parts:
        is_closed = len(loop) > 2 and np.hypot(*np.subtract(loop[0], loop[-1])) <= OUTLINE_GAP_PX
        line = cv2.approxPolyDP(np.array(loop, dtype=np.float32), OUTLINE_OFF_PX, is_closed)
        part = line.reshape(-1, 2).tolist()
        path.append("M" + "L".join(f"{x + 0.5:g} {y + 0.5:g}" for x, y in part))
        if is_closed:
            path.append("Z")
    return "".join(path)
