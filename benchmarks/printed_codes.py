"""Pictures of marked surfaces: QR codes and Data Matrices as a camera over a part sees them.

The symbols come from encoders that have nothing to do with the decoders tried (segno,
ppf.datamatrix). A picture is worked out at eight times its resolution: modules as squares or as
the dots of a laser or a pin, a ground with the grain of brushed metal, light that falls off to one
side, perspective, the blur of a lens, the noise of a sensor.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Literal

import cv2
import numpy as np
import segno
from ppf.datamatrix import DataMatrix

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey

Kind = Literal["data_matrix", "qr"]

BORDER_PX: Final = 20  # of ground round a code that is turned by 45 degrees
FINE: Final = 8  # resolution of the drawing, in that of the picture
WHITE_GREY: Final = 255.0
NOISE_GREY: Final = 0.8  # of a sensor at the grey levels of a dim picture


@dataclass(frozen=True, slots=True)
class Marking:
    """How a code is marked and seen.

    Attributes
    ----------
    kind, text : symbology and content
    module_px : width of a module in the picture, where it is seen straight on
    tilt_rad, turn_rad : between surface normal and line of sight; of the code in its plane
    ground_grey, mark_grey : mean grey levels of the surface and of a dark module
    blur_px : standard deviation of the lens' blur
    grain : standard deviation of the ground's brushed texture, in its own grey level
    slope : how much of its light the ground loses from one side of the code to the other
    dot : diameter of a round mark in modules; 0 for squares
    """

    kind: Kind
    text: str
    module_px: float
    tilt_rad: float
    turn_rad: float
    ground_grey: float
    mark_grey: float
    blur_px: float
    grain: float
    slope: float
    dot: float


@dataclass(frozen=True, slots=True, eq=False)
class Printed:
    """A picture with a code.

    Attributes
    ----------
    image : (height, width)
    corners_px : (4, 2) outer corners of the symbol: top left, top right, bottom right, bottom left
    """

    marking: Marking
    image: Grey
    corners_px: FloatArray


def modules(kind: Kind, text: str) -> BoolArray:
    """Return the dark modules (n, n) of a symbol, without its quiet zone."""
    if kind == "qr":
        return np.array([[bool(v) for v in row] for row in segno.make_qr(text, error="m").matrix])
    return np.array(DataMatrix(text).matrix, dtype=bool)


def markings(
    rng: np.random.Generator, count: int, module_px: float, kind: Kind, *, dots: bool
) -> Iterator[Marking]:
    """Yield markings as they occur on parts lit by the lamps of a cell.

    Parameters
    ----------
    rng : draws them
    count : how many
    module_px : width of a module
    kind : symbology
    dots : round marks that leave a gap, on brushed metal; otherwise squares, as a label has
    """
    letters = np.array(list("ABCDEFGHJKLMNPRSTUVWXYZ0123456789"))
    for _ in range(count):
        ground = rng.uniform(15.0, 140.0)
        contrast = rng.uniform(0.35, 0.85)
        dark, bright = ground * (1.0 - contrast), ground
        if dots and rng.random() < 0.4:  # a laser's mark is brighter than an anodised ground
            dark, bright = bright, dark
        yield Marking(
            kind,
            "SN-" + "".join(rng.choice(letters, 6)),
            module_px,
            tilt_rad=rng.uniform(0.0, np.radians(35.0)),
            turn_rad=rng.uniform(-np.pi, np.pi),
            ground_grey=bright,
            mark_grey=dark,
            blur_px=rng.uniform(0.6, 1.0),
            grain=rng.uniform(0.03, 0.10) if dots else 0.01,
            slope=rng.uniform(0.0, 0.4),
            dot=rng.uniform(0.7, 0.95) if dots else 0.0,
        )


def printed(rng: np.random.Generator, marking: Marking, behind: Grey | None = None) -> Printed:
    """Return the picture of a code.

    Parameters
    ----------
    rng : draws grain, noise and place
    marking : how it is marked and seen
    behind : (height, width) picture to mark; None for a brushed plate
    """
    cells = modules(marking.kind, marking.text)
    size = len(cells)
    across = int(1.5 * size * marking.module_px) + 2 * BORDER_PX
    height, width = (across, across) if behind is None else behind.shape
    at = np.array((width, height)) / 2.0 + rng.uniform(-0.5, 0.5, 2)
    side = size * marking.module_px
    square = (np.array(((0, 0), (1, 0), (1, 1), (0, 1)), float) - 0.5) * side
    corners = _seen(square, marking, at)
    # a fine drawing of the symbol, 16 pixels a module, is warped into a fine picture
    step = 16
    cover = _cover(cells, step, marking.dot, rng)
    drawn = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32) * size * step - 0.5
    fine_corners = ((corners + 0.5) * FINE - 0.5).astype(np.float32)
    warp = cv2.getPerspectiveTransform(drawn.astype(np.float32), fine_corners)
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 2, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 3, (width, height))
    shift = np.eye(3)
    shift[:2, 2] = -low * FINE
    fine_size = tuple(int(v) for v in (high - low) * FINE)
    fine = cv2.warpPerspective(cover, shift @ warp, fine_size, flags=cv2.INTER_LINEAR)
    share = np.zeros((height, width), np.float32)
    w, h = high - low
    share[low[1] : high[1], low[0] : high[0]] = fine.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
    if behind is None:
        ground = _brushed(rng, (height, width), marking)
        light = ground * marking.ground_grey
        ratio = marking.mark_grey / marking.ground_grey
    else:
        light = behind.astype(np.float32)
        ratio = marking.mark_grey / marking.ground_grey
    image = light * (1.0 + (ratio - 1.0) * share)
    image = cv2.GaussianBlur(image, (0, 0), marking.blur_px)
    image = (
        image
        + rng.normal(0.0, NOISE_GREY, image.shape)
        + rng.normal(0.0, 1.0, image.shape) * (np.sqrt(np.maximum(image, 0.0)) * 0.08)
    )
    return Printed(marking, np.clip(np.round(image), 0, WHITE_GREY).astype(np.uint8), corners)


def _seen(square: FloatArray, marking: Marking, at: FloatArray) -> FloatArray:
    """Return points of the code's plane as a camera sees them at ten times the code's width."""
    c, s = np.cos(marking.turn_rad), np.sin(marking.turn_rad)
    turned = square @ np.array(((c, s), (-s, c)))
    far = 10.0 * np.ptp(square[:, 0])
    depth = far + turned[:, 0] * np.sin(marking.tilt_rad)
    x = turned[:, 0] * np.cos(marking.tilt_rad)
    seen: FloatArray = np.column_stack((x, turned[:, 1])) * (far / depth)[:, None] + at
    return seen


def _cover(cells: BoolArray, step: int, dot: float, rng: np.random.Generator) -> Float32Array:
    size = len(cells)
    cover = np.zeros((size * step, size * step), np.float32)
    for row, column in np.argwhere(cells):
        if dot == 0.0:
            cover[row * step : (row + 1) * step, column * step : (column + 1) * step] = 1.0
        else:
            jitter = rng.normal(0.0, 0.04, 2)
            y, x = (np.array((row, column)) + 0.5 + jitter) * step
            cv2.circle(cover, (int(x), int(y)), round(dot * step / 2), 1.0, -1, cv2.LINE_AA)
    return cover


def _brushed(rng: np.random.Generator, shape: tuple[int, int], marking: Marking) -> Float32Array:
    noise = rng.normal(0.0, 1.0, shape).astype(np.float32)
    streaks = cv2.blur(noise, (31, 1)) * np.sqrt(31.0)
    angle = np.degrees(rng.uniform(0.0, np.pi))
    centre = (shape[1] / 2.0, shape[0] / 2.0)
    turn = cv2.getRotationMatrix2D(centre, angle, 1.0)
    streaks = cv2.warpAffine(streaks, turn, shape[::-1], borderMode=cv2.BORDER_REFLECT)
    across = np.linspace(0.5, -0.5, shape[1], dtype=np.float32)[None, :] * marking.slope
    return np.asarray((1.0 + marking.grain * streaks) * (1.0 + across), np.float32)
