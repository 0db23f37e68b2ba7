"""Segmentation of a picture: the lighting, the levels, then each thing."""

from typing import Literal

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey
from controller.imaging.levels import (
    GROUND_BIN,
    REDUCED_PX,
    Ground,
    Levels,
    fit_ground,
    level_step,
    pixel_noise,
    two_humps,
    white_level,
)

from ._backlit import find_backlit
from ._front import find_front
from ._types import Lighting, Segmentation

LEVEL_ROWS = 64  # number of rows sampled to find the levels in use
MIN_AREA = 2e-4  # share of the picture: 16 x 16 px of 1280 x 1024, a part of 3.5 mm at 860
DARK_TABLE = 8  # grey level of the table below which things show only where they are brighter
BRIGHT_TABLE = 128  # grey level from which an empty table is a light table
MAX_FADE = 0.4  # loss of the table's level from its brightest to its darkest place, as a share
# Share of the ground's level; things before a backlight, and deep holes, are darker.
DARK_THING = 0.35
BRIGHT_THING = 1.3
MIN_SHARE = 3e-4  # share of the picture from which things decide the lighting
FAR_OFF = 0.35  # deviation, as a share of the level, that the ground's first fit takes for a part


def segment(
    picture: Grey,
    lighting: Literal["backlit", "front", "auto"] = "auto",
    usable: BoolArray | None = None,
    min_area_px: float | None = None,
) -> Segmentation:
    """Return the things on the table with their outlines (references.md P3.1).

    Parameters
    ----------
    picture : (height, width) grey, 8 bits or fewer stored in 8
    lighting : "auto" tells dark things before a bright ground from lit things on a table
    usable : (height, width), mask of the table; things that reach beyond are flagged
    min_area_px : smaller things are dirt; by default a part of the picture's area

    Raises
    ------
    ValueError : the picture is not two-dimensional and 8 bits deep, or the area has another shape
    """
    if picture.ndim != 2 or picture.dtype != np.uint8:
        raise ValueError(f"a grey 8-bit picture is needed, not {picture.dtype} {picture.shape}")
    if usable is not None and usable.shape != picture.shape:
        raise ValueError(f"usable area {usable.shape} of a picture {picture.shape}")
    height, width = picture.shape
    if min_area_px is None:
        min_area_px = MIN_AREA * height * width
    factor = max(1, round(max(width, height) / REDUCED_PX))
    reduced = _reduced(picture, factor)
    if usable is None:
        inside = np.ones(reduced.shape, dtype=np.bool_)
    else:
        inside = _reduced(usable.astype(np.uint8) * 255, factor) > 250
    rows = picture[:: max(1, height // LEVEL_ROWS)]
    counts = np.asarray(cv2.calcHist([rows], [0], None, [256], [0, 256]).ravel(), np.float32)
    white = white_level(picture, counts)
    step = level_step(counts)
    noise = pixel_noise(picture, usable, step)
    ground = fit_ground(reduced, inside, factor, (width, height), white, FAR_OFF)
    level = ground.over((0, 0, reduced.shape[1] * factor, reduced.shape[0] * factor), factor)
    np.clip(level, 1.0, white, out=level)
    relative = np.asarray(
        cv2.divide(reduced, level, scale=float(GROUND_BIN), dtype=cv2.CV_8U), np.uint8
    )
    if usable is not None:
        relative[~inside] = GROUND_BIN
    within = None if usable is None else inside.astype(np.uint8)
    shares = cv2.calcHist([relative], [0], within, [256], [0, 256]).ravel().astype(np.float64)

    typical = float(np.median(level[::4, ::4]))
    found = _lighting(shares, typical) if lighting == "auto" else lighting
    remarks: list[str] = []
    humps = two_humps(shares)
    low, cut, separation, valley, is_bimodal = humps
    saturated = float(counts[white:].sum() / counts.sum()) if white < 256 else 0.0
    levels = Levels(
        ground=float(np.median(ground.over((0, 0, width, height), 8 * factor))),
        object=low / GROUND_BIN * typical,
        threshold=cut / GROUND_BIN * typical,
        separation=separation,
        valley=valley,
        saturated_share=saturated,
        step=step,
        noise=noise,
    )
    too_dark = f"the table's level is {typical:.0f} of 255: too dark to see anything on it"
    if typical < DARK_TABLE and found == "backlit":
        return Segmentation((), found, False, levels, (too_dark,))
    if found == "backlit":
        if not is_bimodal:
            cut = 0.5 * GROUND_BIN
        regions, specks = find_backlit(
            picture, relative, factor, ground, white, cut, usable, min_area_px
        )
    else:
        regions, specks = find_front(
            picture, reduced, relative, factor, ground, noise, step, usable, min_area_px
        )
    if typical < DARK_TABLE and not regions:
        return Segmentation((), found, False, levels, (too_dark,))
    remarks += _remarks(found, levels, ground, level, inside, is_bimodal, bool(regions), specks)
    regions.sort(key=lambda region: -region.area_px)
    cut_off = sum(region.touches_edge for region in regions)
    if cut_off:
        remarks.append(f"{cut_off} of {len(regions)} things are cut by the edge of the picture")
    return Segmentation(tuple(regions), found, is_bimodal, levels, tuple(remarks))


def _reduced(picture: Grey, factor: int) -> Grey:
    if factor == 1:
        return picture
    height, width = (-(-n // factor) for n in picture.shape)
    pad_y, pad_x = height * factor - picture.shape[0], width * factor - picture.shape[1]
    if pad_x or pad_y:
        padded = cv2.copyMakeBorder(picture, 0, pad_y, 0, pad_x, cv2.BORDER_REPLICATE)
        picture = np.asarray(padded, np.uint8)
    while factor % 2 == 0:  # halving twice takes a quarter of the time of a step of four
        size = (picture.shape[1] // 2, picture.shape[0] // 2)
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        factor //= 2
    if factor > 1:
        size = (width, height)
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    return picture


def _lighting(shares: FloatArray, typical: float) -> Lighting:
    """Return the lighting of a picture: backlit for darker things, front for brighter ones."""
    total = max(float(shares.sum()), 1.0)
    dark = float(shares[: int(DARK_THING * GROUND_BIN)].sum()) / total
    bright = float(shares[int(BRIGHT_THING * GROUND_BIN) + 1 :].sum()) / total
    if max(dark, bright) >= MIN_SHARE:
        return "backlit" if dark > bright else "front"
    return "backlit" if typical >= BRIGHT_TABLE else "front"


def _remarks(
    lighting: Lighting,
    levels: Levels,
    ground: Ground,
    level: Float32Array,
    inside: BoolArray,
    is_bimodal: bool,
    is_something: bool,
    specks: int,
) -> list[str]:
    """Return remarks on the picture for the operator."""
    out = []
    if levels.saturated_share > 0.01:
        out.append(
            f"{100 * levels.saturated_share:.0f} % of the picture is saturated"
            + (": edges are less sure, shorten the exposure" if lighting == "backlit" else "")
        )
    seen = level[::4, ::4][inside[::4, ::4]]
    if len(seen) and levels.saturated_share < 0.5:
        low, high = np.percentile(seen, (1, 99))
        fade = 1.0 - float(low / max(high, 1.0))
        if fade > MAX_FADE:
            out.append(f"the light is uneven: the table fades by {100 * fade:.0f} %")
    if lighting == "backlit" and levels.ground < 60:
        out.append(f"under-exposed: the table's level is {levels.ground:.0f} of 255")
    if not is_bimodal:
        out.append(
            "the histogram has one hump, not two"
            + ("" if is_something else ": nothing is on the table")
        )
    if levels.step > 1:
        out.append(f"{256 // levels.step} grey levels only")
    if specks:
        out.append(f"{specks} specks ignored")
    return out
