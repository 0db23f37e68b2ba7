"""Local marks in a face's texture: spots and lines beyond the texture itself.

Each filter answers to marks of one width, lines of one direction. What it answers on a face without
marks is that face's own texture and the camera's noise, so its scatter there sets the scale, face
by face, direction by direction (so that machining marks raise the scale of their own direction
only), and near by. How far such answers go by chance follows from the tail of their local maxima: a
mark is one that texture would make so many times in a picture at most, as the setting says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array, median

from ..limits import FLATTEST_COS
from .learned import Known
from .texture import Texture

SPOT_NODES: Final = (1.2, 2.0, 3.3, 5.5, 9.0)  # standard deviations of a spot filter's middle
SURROUND: Final = 1.6  # width of its surround, in widths of the middle
LINE_NODES: Final = 0.9  # width of a line filter across
LINE_LENGTH_NODES: Final = 4.5  # length of a line filter along
DIRECTIONS: Final = 12
ON_REGION: Final = 0.5  # least share of a filter's weight on the region
MAX_OF_REGION: Final = 0.2  # largest share of a region; a larger mark moves the fit to the region
MIN_GAIN: Final = 0.5  # least share of a whole spot's response that still measures a mark
NEAR_NODES: Final = 20.0  # distance over which a face's texture may differ
CLIPPED: Final = 3.0  # most that a node adds to a face's scatter, in standard deviations
WRONG_SHAPE: Final = 0.5  # share of a predicted change that may be wrong, as at a highlight
MIN_MAXIMA: Final = 30  # least number of maxima that show a tail
HEAVIEST: Final = 0.8  # exponent of the tail: 2 is normal noise, 1 exponential
LIGHTEST: Final = 2.0
QUIETEST: Final = 0.002  # least contrast assumed for a face's texture
# Contrast assumed of a mark when the smallest detectable one is stated: a dent with flanks of ten
# degrees, a scratch of bare metal, a film that darkens.
CONTRASTS: Final = MappingProxyType({"dent": 0.3, "scratch": 0.2, "stain": 0.15})
MIN_CONTRAST: Final = 0.1  # least contrast of a mark; a weaker difference is finish
VEIL_GREY: Final = 1.5  # light that a lens scatters from bright places into dark ones beside them
# Share of `MIN_CONTRAST` from which bounced light counts in what a picture shows of its bound.
BOUNCE_MATTERS: Final = 0.5
DISC: Final = 1.4  # radius of a spot, in standard deviations of the filter that responds most
FILTER_STEP: Final = 5 / 3  # ratio of one spot filter's width to the next
# A spot filter's response to a disc larger by so many steps, as a share of its largest; of a much
# larger disc only the border responds.
OTHER_STEPS: Final = (-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0)
OTHER_SHARES: Final = (0.0, 0.2, 0.55, 1.0, 0.9, 0.4, 0.35)
LINE_WIDTH: Final = 2.5  # width of a line likewise
# A mark answers by so much more than good parts but one do there: of the second largest of eight
# values of a bell, one in two thousand is beyond this factor.
BEYOND_GOOD: Final = 2.5
UNUSUAL_STEP: Final = 7  # nodes to one that counts for a picture's own level
REACH_NODES: Final = (
    *(SURROUND * sigma for sigma in SPOT_NODES),
    *[LINE_LENGTH_NODES] * DIRECTIONS,
)

FILTER_COUNT: Final = len(REACH_NODES)

Weights = Mapping[float, Float32Array]


@dataclass(frozen=True, eq=False, slots=True)
class Answers:
    """Responses of the filters to a texture; (filters, h, w).

    Attributes
    ----------
    excess : contrast, less what the shape explains; signed
    limit : what texture exceeds as often as the setting allows, and no less than a mark's
    weak : the same, where one more in a picture is of no account
    gain : what each spot filter answers (spots, h, w) to a disc of contrast 1 and its best size
        about a node, cut by the border of what is compared
    noisier : than the noisiest of the good parts known, as a factor; 1 where none are
    """

    excess: Float32Array
    limit: Float32Array
    weak: Float32Array
    gain: Float32Array
    noisier: float = 1.0


def answers(
    texture: Texture,
    noise: Float32Array,
    bounced: Float32Array,
    rate: float,
    weak_rate: float,
    known: Known | None = None,
) -> Answers:
    """Return the responses of spot and line filters, and the part of them beyond chance.

    Parameters
    ----------
    texture : of a picture's faces
    noise : (h, w) standard deviation of a node's contrast that the camera makes at least
    bounced : (h, w) contrast that neighbouring surfaces may add by the light they throw back
    rate : how often in a picture texture may be taken for a mark
    weak_rate : likewise, of marks that only confirm others
    known : appearance of good parts, whose scatter sets the scale where it is known
    """
    inside = (texture.region > 0).astype(np.float32)
    weights = _weights(inside)
    excess = _filtered(texture.contrast, inside, weights)
    if texture.shaped.any():
        kernel = np.ones((3, 3), np.uint8)
        for raw, by_shape in zip(excess, _filtered(texture.shape, inside, weights), strict=True):
            explained = WRONG_SHAPE * cv2.dilate(np.abs(by_shape), kernel)
            raw[:] = np.sign(raw) * np.maximum(np.abs(raw) - explained, 0.0)
    quiet = np.maximum(noise, QUIETEST)
    scatter = _scatter(excess, texture.region, inside)
    noisier = 1.0
    if known is not None:
        noisier = max(unusual(excess, known.mask, known.scatter) / known.usual, 1.0)
        scatter[:, known.mask] = np.float32(noisier) * known.scatter[:, known.mask]
    for some, by_noise in zip(scatter, _gains(), strict=True):
        np.maximum(some, by_noise * quiet, out=some, casting="same_kind")
    peaks = [
        _maxima(np.abs(signed) / some, texture.region)
        for signed, some in zip(excess, scatter, strict=True)
    ]
    pooled = np.concatenate(peaks)
    count = len(peaks)
    of_all = Tail(pooled)
    tails = [Tail(p) if len(p) >= MIN_MAXIMA else of_all for p in peaks]
    gain = _cut_gains(inside, weights)
    whole = [*np.maximum(gain, MIN_GAIN * _spot_gain()), *[np.float32(_line_gain())] * DIRECTIONS]
    limit, low = np.empty_like(scatter), np.empty_like(scatter)
    about = _within_reach(bounced * inside)
    dim = np.asarray(VEIL_GREY / np.maximum(texture.smooth, 1.0), np.float32)
    veil = _within_reach(dim * inside)
    shown = _shown_of_bound(excess, whole, about, texture.region, rate)
    for i, (some, one) in enumerate(zip(scatter, tails, strict=True)):
        sure, weak = one.height(rate / count), one.height(weak_rate / count)
        reach = REACH_NODES[i]
        least = whole[i] * (MIN_CONTRAST + veil[reach] + shown * about[reach])
        np.maximum(np.float64(sure) * some, least, out=limit[i], casting="same_kind")
        np.maximum(np.float64(min(weak, sure)) * some, least, out=low[i], casting="same_kind")
    if known is not None:
        least_of = np.float32(BEYOND_GOOD) * scatter[:, known.mask]
        for heights in (limit, low):
            heights[:, known.mask] = np.maximum(heights[:, known.mask], least_of)
    return Answers(excess, limit, low, gain, noisier)


def unusual(excess: Float32Array, mask: BoolArray, scatter: Float32Array) -> float:
    """Return the median size of the filters' answers (filters, h, w) in deviations of good parts.

    Parameters
    ----------
    excess : of a picture
    mask : (h, w) where good parts are known
    scatter : (filters, h, w) of these
    """
    some = np.flatnonzero(mask)[::UNUSUAL_STEP]
    if not len(some):
        return 0.0
    count = len(excess)
    every = np.abs(excess.reshape(count, -1)[:, some])
    return float(median((every / scatter.reshape(count, -1)[:, some]).ravel()))


def filtered(contrast: Float32Array, mask: BoolArray) -> Float32Array:
    """Return the responses of all filters (filters, h, w).

    Parameters
    ----------
    contrast : (h, w), 0 off the mask
    mask : (h, w) what is compared
    """
    inside = mask.astype(np.float32)
    return _filtered(contrast, inside, _weights(inside))


def _within_reach(light: Float32Array) -> dict[float, Float32Array]:
    """Return the most light within each filter's reach of a node (h, w)."""
    by_reach: dict[float, Float32Array] = {}
    for reach in dict.fromkeys(REACH_NODES):
        size = 2 * int(np.ceil(reach)) + 1
        kernel = np.ones((size, size), np.uint8)
        by_reach[reach] = np.asarray(cv2.dilate(light, kernel), np.float32)
    return by_reach


def _shown_of_bound(
    excess: Float32Array,
    whole: Sequence[Float32Array],
    about: Mapping[float, Float32Array],
    region: Int32Array,
    rate: float,
) -> np.float32:
    """Return the share of the bound on bounced light that a picture shows, at most 1.

    The bound holds for any finish, and most finishes stay far below it. What faces beside their
    neighbours answer tells how far: the share that the tail of their maxima exceeds as often as the
    setting allows. A mark is a few maxima of many, and does not move the tail.

    Parameters
    ----------
    excess : responses of the filters (filters, h, w)
    whole : each filter's response to a whole mark of contrast 1
    about : most bounced light (h, w) within a reach, as a contrast
    region : (h, w) pieces of faces, 0 where nothing is compared
    rate : see `answers`
    """
    shares = []
    for signed, gain, reach in zip(excess, whole, REACH_NODES, strict=True):
        bound = about[reach]
        counts = bound > BOUNCE_MATTERS * MIN_CONTRAST
        share = np.where(counts, np.abs(signed) / np.maximum(gain * bound, 1e-6), 0)
        shares.append(_maxima(share.astype(np.float32), np.where(counts, region, 0)))
    pooled = np.concatenate(shares)
    if len(pooled) < MIN_MAXIMA * FILTER_COUNT:
        return np.float32(1.0)
    return np.float32(min(Tail(pooled).height(rate), 1.0))


class Tail:
    """The Weibull tail of local maxima, from their upper half and upper tenth.

    Marks are few, and do not move it.

    Parameters
    ----------
    maxima : (n,) heights above 0
    """

    def __init__(self, maxima: FloatArray) -> None:
        self._count = len(maxima)
        self._highest = float(maxima.max()) if len(maxima) else float("inf")
        if self._count >= MIN_MAXIMA:
            half, self._tenth = (max(float(q), 1e-6) for q in np.quantile(maxima, [0.5, 0.9]))
            exponent = np.log(np.log(10) / np.log(2)) / np.log(max(self._tenth / half, 1.01))
            self._exponent = float(np.clip(exponent, HEAVIEST, LIGHTEST))

    def height(self, expected: float) -> float:
        """Return the height that ``expected`` of the maxima exceed on average."""
        if self._count < MIN_MAXIMA:
            return 2.0 * self._highest + 6.0
        reach = max(np.log(self._count / expected), np.log(10)) / np.log(10)
        return float(self._tenth * reach ** (1 / self._exponent))


def _filtered(values: Float32Array, inside: Float32Array, weights: Weights) -> Float32Array:
    """Return the responses of the filters (filters, h, w).

    Parameters
    ----------
    values : (h, w), 0 beside regions
    inside : (h, w) 1 on regions, else 0
    weights : of it, by `_weights`
    """
    return np.concatenate([_spots(values, inside, weights), _lines(values, inside)])


def _weights(inside: Float32Array) -> Weights:
    """Return the weight on regions of each spot filter's middle, or of its surround, by width."""
    widths = (width for sigma in SPOT_NODES for width in (sigma, SURROUND * sigma))
    return {
        width: np.asarray(cv2.GaussianBlur(inside, (0, 0), width), np.float32) for width in widths
    }


def _spots(values: Float32Array, inside: Float32Array, weights: Weights) -> Float32Array:
    """Return each spot filter's response (scales, h, w): mean of its middle less its surround's."""
    out = []
    for sigma in SPOT_NODES:
        middle, around = (
            cv2.GaussianBlur(values, (0, 0), width) / np.maximum(weights[width], 1e-3)
            for width in (sigma, SURROUND * sigma)
        )
        is_on = (inside > 0) & (weights[sigma] > ON_REGION)
        out.append(np.where(is_on, middle - around, np.float32(0)))
    return np.stack(out)


def _lines(values: Float32Array, inside: Float32Array) -> Float32Array:
    """Return each line filter's response (directions, h, w): curvature across, averaged along."""
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
    both = _filtered(white, whole, _weights(whole))
    return np.asarray(both[:, 40:-40, 40:-40].std(axis=(1, 2)))


def _scatter(raw: Float32Array, region: Int32Array, inside: Float32Array) -> Float32Array:
    """Return the local standard deviation of each filter's responses (filters, h, w), by face."""
    order = np.argsort(region.ravel(), kind="stable")
    ids, begins = np.unique(region.ravel()[order], return_index=True)
    some_of = {
        i: group[:: max(1, len(group) // 2000)]
        for i, group in zip(ids.tolist(), np.split(order, begins[1:]), strict=True)
        if i
    }
    out = np.empty_like(raw)
    small = cv2.resize(inside, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    weight = np.maximum(cv2.GaussianBlur(small, (0, 0), NEAR_NODES / 4), 1e-3)
    for filtered, target in zip(raw, out, strict=True):
        level = np.zeros(int(region.max()) + 1, dtype=np.float32)
        for i, some in some_of.items():
            level[i] = 1.4826 * median(np.abs(filtered.ravel()[some]))
        face = level[region]
        bounded = np.minimum(filtered**2, (CLIPPED * face) ** 2)
        coarse = cv2.resize(bounded, small.shape[::-1], interpolation=cv2.INTER_AREA)
        near = cv2.GaussianBlur(coarse, (0, 0), NEAR_NODES / 4) / weight
        wide = cv2.resize(near, filtered.shape[::-1], interpolation=cv2.INTER_LINEAR)
        target[:] = np.maximum(face, np.sqrt(np.maximum(wide, 0.0)))
    return out


def _maxima(height: Float32Array, region: Int32Array) -> FloatArray:
    """Return the heights of the local maxima of a response (h, w) on regions."""
    top = cv2.dilate(height, np.ones((3, 3), np.uint8))
    return np.asarray(height[(height >= top) & (region > 0) & (height > 0)], np.float64)


def smallest_nodes(
    answer: Answers, texture: Texture, cosine: Float32Array
) -> dict[str, Float32Array]:
    """Return the smallest width found at each node (h, w) by kind of mark, inf where none is.

    It counts where the filters' next width is found as well: between the two lie all that a mark of
    about that width may be.

    Parameters
    ----------
    answer : of the filters
    texture : what they answered to
    cosine : (h, w) of the angle at which the surface is seen
    """
    nodes = _Nodes(answer, texture, cosine)
    count = len(SPOT_NODES)
    out = {
        kind: np.full(texture.region.shape, np.inf, np.float32)
        for kind in ("dent", "stain", "scratch")
    }
    own = [np.asarray(2 * DISC * s / np.sqrt(nodes.slant), np.float32) for s in SPOT_NODES]
    shares = [nodes.shares(width) for width in own]
    for kind in ("dent", "stain"):
        widths = np.full(len(nodes.slant), np.inf, dtype=np.float32)
        found = [nodes.found(kind, *of) for of in zip(own, shares, strict=True)]
        for size in reversed(range(count)):
            shows = found[size] & found[min(size + 1, count - 1)]
            widths[shows] = own[size][shows]
        out[kind][nodes.inside] = widths
    worst = answer.limit[count:, nodes.inside].max(axis=0)
    is_found = CONTRASTS["scratch"] * _line_gain() >= worst
    widths = np.where(is_found, LINE_WIDTH * LINE_NODES / nodes.slant, np.inf).astype(np.float32)
    out["scratch"][nodes.inside] = widths
    return out


def finds(
    answer: Answers, texture: Texture, cosine: Float32Array, kind: str, width_nodes: Float32Array
) -> BoolArray:
    """Return a mask (h, w) of where a round mark would be found by any filter.

    A round mark on a surface seen aslant is an ellipse in the picture, and answered less.

    Parameters
    ----------
    answer : of the filters
    texture : what they answered to
    cosine : (h, w) of the angle at which the surface is seen
    kind : dent or stain, which have different contrasts
    width_nodes : (h, w) of the mark, along the surface
    """
    nodes = _Nodes(answer, texture, cosine)
    widths = width_nodes[nodes.inside]
    out = np.zeros(texture.region.shape, dtype=bool)
    out[nodes.inside] = nodes.found(kind, widths, nodes.shares(widths))
    return out


class _Nodes:
    """The nodes of regions, in order (n,), with the data for round marks on them.

    Parameters
    ----------
    answer, texture, cosine : as `finds` has them
    """

    def __init__(self, answer: Answers, texture: Texture, cosine: Float32Array) -> None:
        self.inside: BoolArray = texture.region > 0
        region = texture.region[self.inside]
        self.slant = np.clip(cosine[self.inside], FLATTEST_COS, 1.0)
        self._area = np.bincount(region)[region]
        self._aslant = np.interp(self.slant, *_aslant())
        self._gain = answer.gain[:, self.inside]
        self._need = answer.limit[: len(SPOT_NODES), self.inside]

    def shares(self, width_nodes: Float32Array) -> list[Float32Array]:
        """Return each spot filter's share of its largest response to marks of some widths (n,)."""
        out = []
        for sigma in SPOT_NODES:
            steps = np.log(width_nodes * np.sqrt(self.slant) / (2 * DISC * sigma))
            steps = steps / np.log(FILTER_STEP)
            out.append(np.interp(steps, OTHER_STEPS, OTHER_SHARES).astype(np.float32))
        return out

    def found(
        self, kind: str, width_nodes: Float32Array, shares: Sequence[Float32Array]
    ) -> BoolArray:
        """Return a mask (n,) of where a round mark would be found by any filter.

        Parameters
        ----------
        kind, width_nodes : as `finds` has them, (n,)
        shares : of these widths
        """
        # what is a large part of all there is to compare it with is taken for the face's own
        # brightness
        small = np.pi / 4 * width_nodes**2 * self.slant <= MAX_OF_REGION * self._area
        contrast = (CONTRASTS[kind] * self._aslant).astype(np.float32)
        out = np.zeros(len(contrast), dtype=bool)
        for gain, need, share in zip(self._gain, self._need, shares, strict=True):
            out |= contrast * gain * share >= need
        return out & small


def _cut_gains(inside: Float32Array, weights: Weights) -> Float32Array:
    """Return each spot filter's response (spots, h, w) to a disc of its best size about a node."""
    out = np.zeros((len(SPOT_NODES), *inside.shape), dtype=np.float32)
    for sigma, target in zip(SPOT_NODES, out, strict=True):
        reach = int(np.ceil(DISC * sigma))
        v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1].astype(np.float32)
        disc = np.clip(DISC * sigma + 0.5 - np.hypot(u, v), 0.0, 1.0)
        for sign, width in ((1, sigma), (-1, SURROUND * sigma)):
            bell = np.exp(-0.5 * (u**2 + v**2) / width**2) / (2 * np.pi * width**2)
            in_disc = cv2.filter2D(inside, cv2.CV_32F, (bell * disc).astype(np.float32))
            target += sign * in_disc / np.maximum(weights[width], 1e-3)
    return out * (inside > 0)


@cache
def _aslant() -> tuple[FloatArray, FloatArray]:
    """Return cosines, and a spot's response to a disc seen at them, relative to a square view.

    The disc is as large in the picture as one seen squarely, and longer than wide.
    """
    v, u = np.mgrid[-6:6.01:0.05, -6:6.01:0.05]
    bells = [np.exp(-0.5 * (u**2 + v**2) / s**2) / s**2 for s in (1.0, SURROUND)]
    cosines = np.linspace(FLATTEST_COS, 1.0, 12)
    gains = []
    for c in cosines:
        disc = (u**2 * c + v**2 / c) <= DISC**2
        gains.append(float(bells[0][disc].sum() - bells[1][disc].sum()))
    return cosines, np.array(gains) / gains[-1]


def _spot_gain() -> float:
    """Return a spot filter's response in the middle of a disc of contrast 1 and its best size."""
    return float(np.exp(-0.5 * (DISC / SURROUND) ** 2) - np.exp(-0.5 * DISC**2))


@cache
def _line_gain() -> float:
    """Return a line filter's response to a line of contrast 1, `LINE_WIDTH` of its sigma."""
    v, u = np.mgrid[-40:41, -40:41].astype(np.float32)
    width = LINE_WIDTH * LINE_NODES
    line = np.clip(0.5 * width + 0.5 - np.abs(v), 0, 1).astype(np.float32)
    return float(np.abs(_lines(line, np.ones_like(u))[0, 40, 40]))
