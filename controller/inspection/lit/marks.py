"""Local marks in a face's texture: spots and lines that the texture itself does not make.

Each filter answers to marks of one width, lines of one direction. What it answers on a face without
marks is that face's own texture and the camera's noise, so its scatter there sets the scale, face
by face, direction by direction (so that machining marks raise the scale of their own direction
only), and near by. How far such answers go by chance follows from the tail of their local maxima: a
mark is one that texture would make so many times in a picture at most, as the setting says.
"""

from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array

from .._scene import MAX_INCIDENCE_COS
from .texture import Texture

SPOT_NODES: Final = (1.2, 2.0, 3.3, 5.5, 9.0)  # standard deviation of a spot's middle
SURROUND: Final = 1.6  # times that: of what it is compared with
LINE_NODES: Final = 0.9  # across
LINE_LENGTH_NODES: Final = 4.5  # along
DIRECTIONS: Final = 12
ON_REGION: Final = 0.5  # of a filter's weight that must lie on the region
MAX_OF_REGION: Final = 0.2  # of a region: a larger mark moves what is fitted to the region
MIN_GAIN: Final = 0.5  # of a whole spot's answer: less of it left is no measure of a mark
FLATTEST: Final = MAX_INCIDENCE_COS  # a surface seen flatter is not in sight
NEAR_NODES: Final = 20.0  # texture may differ from one part of a face to another
CLIPPED: Final = 3.0  # standard deviations a node adds to that, at most
WRONG_SHAPE: Final = 0.5  # share of a predicted change that may be wrong, as at a highlight
MIN_MAXIMA: Final = 30  # that show a tail
HEAVIEST: Final = 0.8  # exponent of the tail: 2 is normal noise, 1 exponential
LIGHTEST: Final = 2.0
QUIETEST: Final = 0.002  # contrast below which no face's texture is taken to be
# what a mark is taken to differ from its surroundings by, for the smallest one that is found: a
# dent whose flanks turn by ten degrees, a scratch of bare metal, a film that darkens
CONTRASTS: Final = MappingProxyType({"dent": 0.3, "scratch": 0.2, "stain": 0.15})
MIN_CONTRAST: Final = 0.1  # what differs by less is finish, not a mark
DISC: Final = 1.4  # radius of a spot by the standard deviation of the filter that answers most
FILTER_STEP: Final = 5 / 3  # from one spot filter's width to the next
# share of a spot filter's most answer to a disc larger by so many steps: of one much larger its
# border alone answers
OTHER_STEPS: Final = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
OTHER_SHARES: Final = (0.0, 0.2, 0.55, 1.0, 0.9, 0.4, 0.35)
LINE_WIDTH: Final = 2.5  # width of a line likewise


@dataclass(frozen=True, eq=False, slots=True)
class Answers:
    """What the filters answer to a texture; (filters, h, w).

    Attributes
    ----------
    excess : contrast, less what the shape explains; signed
    limit : what texture exceeds as often as the setting allows, and no less than a mark's
    weak : the same, where one more in a picture is of no account
    gain : what each spot filter answers (spots, h, w) to a disc of contrast 1 and its best size
        about a node, cut by the border of what is compared
    """

    excess: Float32Array
    limit: Float32Array
    weak: Float32Array
    gain: Float32Array


def answers(
    texture: Texture, noise: Float32Array, bounced: Float32Array, rate: float, weak_rate: float
) -> Answers:
    """Return what spot and line filters answer, and what is beyond chance.

    Parameters
    ----------
    texture : of a picture's faces
    noise : (h, w) standard deviation of a node's contrast that the camera makes at least
    bounced : (h, w) contrast that neighbouring surfaces may add by the light they throw back
    rate : how often in a picture texture may be taken for a mark
    weak_rate : likewise, of marks that only confirm others
    """
    inside = (texture.region > 0).astype(np.float32)
    raw = np.concatenate([_spots(texture.contrast, inside), _lines(texture.contrast, inside)])
    shape = np.zeros_like(raw)
    if texture.curved.any():
        shape = np.concatenate([_spots(texture.shape, inside), _lines(texture.shape, inside)])
        kernel = np.ones((3, 3), np.uint8)
        shape = np.stack([cv2.dilate(np.abs(s), kernel) for s in shape])
    quiet = _gains()[:, None, None] * np.maximum(noise, QUIETEST)
    excess = np.sign(raw) * np.maximum(np.abs(raw) - WRONG_SHAPE * shape, 0.0)
    scatter = np.maximum(_scatter(excess, texture.region, inside), quiet).astype(np.float32)
    height = np.abs(excess) / scatter
    peaks = [_maxima(z, texture.region) for z in height]
    pooled = np.concatenate(peaks)
    count = len(peaks)
    sure, weak = (
        np.array([tail(p if len(p) >= MIN_MAXIMA else pooled, r / count) for p in peaks])
        for r in (rate, weak_rate)
    )
    gain = _cut_gains(inside)
    lines = np.full((DIRECTIONS, *inside.shape), _line_gain(), np.float32)
    whole = np.maximum(gain, MIN_GAIN * _spot_gain())
    least = np.concatenate([whole, lines]) * (MIN_CONTRAST + _within_reach(bounced * inside))
    limit = np.maximum(sure[:, None, None] * scatter, least).astype(np.float32)
    low = np.maximum(np.minimum(weak, sure)[:, None, None] * scatter, least)
    return Answers(excess, limit, low.astype(np.float32), gain)


def _within_reach(bounced: Float32Array) -> Float32Array:
    """Return the most bounced light that each filter's answer at a node sees, (filters, h, w)."""
    reaches = [SURROUND * sigma for sigma in SPOT_NODES] + [LINE_LENGTH_NODES] * DIRECTIONS
    by_reach: dict[float, Float32Array] = {}
    for reach in reaches:
        if reach not in by_reach:
            size = 2 * int(np.ceil(reach)) + 1
            kernel = np.ones((size, size), np.uint8)
            by_reach[reach] = np.asarray(cv2.dilate(bounced, kernel), np.float32)
    return np.stack([by_reach[reach] for reach in reaches])


def tail(maxima: FloatArray, expected: float) -> float:
    """Return the height that ``expected`` of the local maxima exceed, by their Weibull tail.

    The tail is taken from the half of them and the tenth of them that are higher: marks are few.

    Parameters
    ----------
    maxima : (n,) heights above 0
    expected : how many, in the mean
    """
    if len(maxima) < MIN_MAXIMA:
        return float("inf") if not len(maxima) else 2.0 * float(maxima.max()) + 6.0
    half, tenth = (max(float(np.quantile(maxima, q)), 1e-6) for q in (0.5, 0.9))
    exponent = np.log(np.log(10) / np.log(2)) / np.log(max(tenth / half, 1.01))
    exponent = float(np.clip(exponent, HEAVIEST, LIGHTEST))
    reach = max(np.log(len(maxima) / expected), np.log(10)) / np.log(10)
    return float(tenth * reach ** (1 / exponent))


def _spots(values: Float32Array, inside: Float32Array) -> Float32Array:
    """Return each spot filter's answer (scales, h, w): mean of a middle less its surround's."""
    out = []
    for sigma in SPOT_NODES:
        middle, weight = _mean(values, inside, sigma)
        around, _ = _mean(values, inside, SURROUND * sigma)
        out.append(np.where((inside > 0) & (weight > ON_REGION), middle - around, 0.0))
    return np.stack(out).astype(np.float32)


def _mean(
    values: Float32Array, inside: Float32Array, sigma: float
) -> tuple[Float32Array, Float32Array]:
    top = cv2.GaussianBlur(values, (0, 0), sigma)
    weight = cv2.GaussianBlur(inside, (0, 0), sigma)
    return (
        np.asarray(top / np.maximum(weight, 1e-3), np.float32),
        np.asarray(weight, np.float32),
    )


def _lines(values: Float32Array, inside: Float32Array) -> Float32Array:
    """Return each line filter's answer (directions, h, w): curvature across, averaged along."""
    soft = cv2.GaussianBlur(values, (0, 0), LINE_NODES)
    xx = cv2.Sobel(soft, cv2.CV_32F, 2, 0, ksize=3) / 4
    yy = cv2.Sobel(soft, cv2.CV_32F, 0, 2, ksize=3) / 4
    xy = cv2.Sobel(soft, cv2.CV_32F, 1, 1, ksize=3) / 4
    # a mask's border bends what is filled with zeros beside it
    good = cv2.erode(inside, np.ones((3, 3), np.uint8))
    out = []
    for angle, kernel in zip(_angles(), _line_kernels(), strict=True):
        c, s = np.cos(angle), np.sin(angle)  # along the line; across is (-s, c)
        across = (s * s * xx - 2 * s * c * xy + c * c * yy) * good
        out.append(cv2.filter2D(across, cv2.CV_32F, kernel))
    return np.stack(out).astype(np.float32) * (good > 0)


def _angles() -> FloatArray:
    return np.asarray(np.arange(DIRECTIONS) * np.pi / DIRECTIONS)


@cache
def _line_kernels() -> tuple[Float32Array, ...]:
    reach = int(np.ceil(2 * LINE_LENGTH_NODES))
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float64)
    kernels = []
    for angle in _angles():
        along, across = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        kernel = np.exp(-0.5 * (along / LINE_LENGTH_NODES) ** 2 - 0.5 * (across / 0.6) ** 2)
        kernels.append((kernel / kernel.sum()).astype(np.float32))
    return tuple(kernels)


@cache
def _gains() -> FloatArray:
    """Return each filter's standard deviation on white noise of 1 a node (filters,)."""
    rng = np.random.default_rng(1)
    white = rng.normal(size=(160, 160)).astype(np.float32)
    whole = np.ones_like(white)
    both = np.concatenate([_spots(white, whole), _lines(white, whole)])
    return np.asarray(both[:, 40:-40, 40:-40].std(axis=(1, 2)))


def _scatter(raw: Float32Array, region: Int32Array, inside: Float32Array) -> Float32Array:
    """Return the standard deviation of each filter's answers (filters, h, w), by face, near by."""
    order = np.argsort(region.ravel(), kind="stable")
    ids, begins = np.unique(region.ravel()[order], return_index=True)
    groups = np.split(order, begins[1:])
    out = np.empty_like(raw)
    small = cv2.resize(inside, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    weight = np.maximum(cv2.GaussianBlur(small, (0, 0), NEAR_NODES / 4), 1e-3)
    for filtered, target in zip(raw, out, strict=True):
        level = np.zeros(int(region.max()) + 1, dtype=np.float32)
        flat = np.abs(filtered.ravel())
        for i, group in zip(ids.tolist(), groups, strict=True):
            if i:
                some = flat[group[:: max(1, len(group) // 2000)]]
                level[i] = 1.4826 * float(np.median(some))
        face = level[region]
        bounded = np.minimum(filtered**2, (CLIPPED * face) ** 2)
        coarse = cv2.resize(bounded, small.shape[::-1], interpolation=cv2.INTER_AREA)
        near = cv2.GaussianBlur(coarse, (0, 0), NEAR_NODES / 4) / weight
        wide = cv2.resize(near, filtered.shape[::-1], interpolation=cv2.INTER_LINEAR)
        target[:] = np.maximum(face, np.sqrt(np.maximum(wide, 0.0)))
    return out


def _maxima(z: Float32Array, region: Int32Array) -> FloatArray:
    """Return the heights of the local maxima of an answer, either sign, on regions."""
    height = np.abs(z)
    top = cv2.dilate(height, np.ones((3, 3), np.uint8))
    return np.asarray(height[(height >= top) & (region > 0) & (height > 0)], np.float64)


def smallest_nodes(
    answer: Answers, texture: Texture, cosine: Float32Array
) -> dict[str, Float32Array]:
    """Return per kind of mark the smallest width found at each node (h, w), inf where none is.

    It counts where the filters' next width is found as well: between the two lie all that a mark of
    about that width may be.

    Parameters
    ----------
    answer : of the filters
    texture : what they answered to
    cosine : (h, w) of the angle at which the surface is seen
    """
    inside = texture.region > 0
    need = answer.limit
    count = len(SPOT_NODES)
    slant = np.clip(cosine, FLATTEST, 1.0).astype(np.float32)
    out = {}
    for kind in ("dent", "stain"):
        widths = np.full(inside.shape, np.inf, dtype=np.float32)
        own = [np.asarray(2 * DISC * s / np.sqrt(slant), np.float32) for s in SPOT_NODES]
        found = [finds(answer, texture, cosine, kind, width) for width in own]
        for size in reversed(range(count)):
            shows = found[size] & found[min(size + 1, count - 1)]
            widths[shows] = own[size][shows]
        out[kind] = widths
    line = _line_gain()
    worst = need[count:].max(axis=0)
    found = inside & (CONTRASTS["scratch"] * line >= worst)
    out["scratch"] = np.where(found, LINE_WIDTH * LINE_NODES / slant, np.inf).astype(np.float32)
    return out


def finds(
    answer: Answers, texture: Texture, cosine: Float32Array, kind: str, width_nodes: Float32Array
) -> BoolArray:
    """Return where (h, w) a round mark would be found by any filter.

    A round mark on a surface seen aslant is an ellipse in the picture, and answered less.

    Parameters
    ----------
    answer : of the filters
    texture : what they answered to
    cosine : (h, w) of the angle at which the surface is seen
    kind : dent or stain, which have different contrasts
    width_nodes : (h, w) of the mark, along the surface
    """
    slant = np.clip(cosine, FLATTEST, 1.0)
    # what is a large part of all there is to compare it with is taken for the face's own brightness
    area = np.bincount(texture.region.ravel())[texture.region]
    small = np.pi / 4 * width_nodes**2 * slant <= MAX_OF_REGION * area
    contrast = (CONTRASTS[kind] * np.interp(slant, *_aslant())).astype(np.float32)
    out = np.zeros(texture.region.shape, dtype=bool)
    for sigma, gain, need in zip(SPOT_NODES, answer.gain, answer.limit, strict=False):
        steps = np.log(width_nodes * np.sqrt(slant) / (2 * DISC * sigma)) / np.log(FILTER_STEP)
        share = np.interp(steps, OTHER_STEPS, OTHER_SHARES).astype(np.float32)
        out |= contrast * gain * share >= need
    return out & small & (texture.region > 0)


def _cut_gains(inside: Float32Array) -> Float32Array:
    """Return each spot filter's answer (spots, h, w) to a disc of its best size about a node."""
    out = np.zeros((len(SPOT_NODES), *inside.shape), dtype=np.float32)
    for sigma, target in zip(SPOT_NODES, out, strict=True):
        reach = int(np.ceil(DISC * sigma))
        v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
        disc = np.clip(DISC * sigma + 0.5 - np.hypot(u, v), 0.0, 1.0)
        for sign, width in ((1, sigma), (-1, SURROUND * sigma)):
            bell = np.exp(-0.5 * (u**2 + v**2) / width**2) / (2 * np.pi * width**2)
            in_disc = cv2.filter2D(inside, cv2.CV_32F, (bell * disc).astype(np.float32))
            weight = cv2.GaussianBlur(inside, (0, 0), width)
            target += sign * in_disc / np.maximum(weight, 1e-3)
    return out * (inside > 0)


@cache
def _aslant() -> tuple[FloatArray, FloatArray]:
    """Return cosines, and a spot's answer to a disc seen at them, of that to one seen squarely.

    The disc is as large in the picture as one seen squarely, and longer than wide.
    """
    v, u = np.mgrid[-6:6.01:0.05, -6:6.01:0.05]
    bells = [np.exp(-0.5 * (u**2 + v**2) / s**2) / s**2 for s in (1.0, SURROUND)]
    cosines = np.linspace(FLATTEST, 1.0, 12)
    gains = []
    for c in cosines:
        disc = (u**2 * c + v**2 / c) <= DISC**2
        gains.append(float(bells[0][disc].sum() - bells[1][disc].sum()))
    return cosines, np.array(gains) / gains[-1]


def _spot_gain() -> float:
    """Return a spot filter's answer in the middle of a disc of contrast 1 and its best size."""
    return float(np.exp(-0.5 * (DISC / SURROUND) ** 2) - np.exp(-0.5 * DISC**2))


@cache
def _line_gain() -> float:
    """Return a line filter's answer to a long line of contrast 1, `LINE_WIDTH` of its sigma."""
    v, u = np.mgrid[-40:41, -40:41].astype(np.float32)
    width = LINE_WIDTH * LINE_NODES
    line = np.clip(0.5 * width + 0.5 - np.abs(v), 0, 1).astype(np.float32)
    return float(np.abs(_lines(line, np.ones_like(u))[0, 40, 40]))
