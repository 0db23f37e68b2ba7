"""Grey levels of a picture: the table's level at each point, and the two humps of the histogram.

A light table fades towards its rim and a lens darkens the corners. So levels are taken relative
to the ground: a polynomial of low degree over the picture, fitted to what belongs to the table. The
threshold comes from the histogram of the picture divided by it (references.md P3.1).
"""

from dataclasses import dataclass

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey

REDUCED_PX = 320  # side of the reduced picture: 5 mm parts are still 10 px wide there
WHITE_LEVEL = 250  # from this level up, a peak at the top of the histogram is saturation
MIN_PILE = 0.002  # least share of the pixels in such a peak
# With a smaller share of unsaturated pixels the ground's level beyond white cannot be estimated.
MIN_UNSATURATED = 0.01
# largest level, in whites, up to which the level of a saturated ground is estimated
MAX_BEYOND_WHITE = 1.5
FITTED_PX = 2000
NOISE_ROWS = 32
ROUNDS = 5
# With a larger share of the table saturated, only pixels below white are fitted.
MIN_SATURATED = 0.02
# Share of white: where the table's middle saturates, its rim is at least this bright.
RIM_OF_WHITE = 0.7
BINS = 256
GROUND_BIN = 160  # bin of the ground in the histogram of relative levels
MIN_SEPARATION = 4.0  # Ashman's D; the halves of a normal hump have 2.65, of a flat one 3.46
MAX_VALLEY = 0.5  # deepest valley, as a share of the lower hump's height


@dataclass(frozen=True, slots=True)
class Levels:
    """The levels and humps of a histogram; levels are grey values of the given picture.

    Attributes
    ----------
    ground : typical level of the table; above 255 if it is saturated and its rim gives the level
    object : typical level of what lies on it; the ground's if there is nothing
    threshold : level between the two
    separation : Ashman's D of the two classes: distance of means over their rms spread
    valley : height of the valley between the humps over that of the lower hump
    saturated_share : saturated share of the pixels
    step : distance of neighbouring levels, 1 with 8 bits, 4 with 6
    noise : rms from pixel to pixel on the table, at least the noise of rounding to levels
    """

    ground: float
    object: float
    threshold: float
    separation: float
    valley: float
    saturated_share: float
    step: int
    noise: float


@dataclass(frozen=True, eq=False, slots=True)
class Ground:
    """The table's level as a polynomial of the position in the picture.

    Attributes
    ----------
    weights : (6,) weights of 1, x, y, x², xy, y² with x and y from -1 to 1 over the picture
    size_px : (width, height)
    scatter : rms of the table's own texture about it, relative to the level
    """

    weights: FloatArray
    size_px: tuple[int, int]
    scatter: float

    def over(self, box_px: tuple[int, int, int, int], step_px: int = 1) -> Float32Array:
        """Return the level at the pixels, or each block's middle, of a box x0 y0 x1 y1."""
        x0, y0, x1, y1 = box_px
        width, height = self.size_px
        middle = 0.5 * (step_px - 1)
        x = (np.arange(x0, x1, step_px) + middle) * (2.0 / width) - 1.0
        y = (np.arange(y0, y1, step_px) + middle) * (2.0 / height) - 1.0
        a, b, c, d, e, f = self.weights
        rows = np.stack([np.ones_like(y), y, c * y + f * y * y], axis=1).astype(np.float32)
        columns = np.stack([a + b * x + d * x * x, e * x, np.ones_like(x)]).astype(np.float32)
        out: Float32Array = rows @ columns
        return out


def level_step(counts: FloatArray | Float32Array) -> int:
    """Return the distance of the levels in use: a power of two, 1 if they are unevenly spaced."""
    used = np.flatnonzero(counts)
    for step in (16, 8, 4, 2):
        if len(used) > 2 and not np.any((used - used[0]) % step):
            return step
    return 1


def white_level(picture: Grey, counts: FloatArray | Float32Array) -> int:
    """Return the level of saturated pixels, 256 if there are none."""
    used = np.flatnonzero(counts)
    top = int(used[-1]) if len(used) else 0
    piled = top >= WHITE_LEVEL and counts[top] >= MIN_PILE * max(counts.sum(), 1)
    return top if piled else 256


def pixel_noise(picture: Grey, usable: BoolArray | None, step: int) -> float:
    """Return the noise from pixel to pixel [grey levels], free of slow texture and of edges.

    The median of |second difference| is blind to edges, which are few; of white noise with
    deviation s the second difference has s √6, its median magnitude 0.6745 of that.

    Parameters
    ----------
    picture : (height, width)
    usable : (height, width) pixels to use; None for all
    step : `level_step`; the result is at least the noise of rounding to it
    """
    rows = picture[:: max(1, len(picture) // NOISE_ROWS)].astype(np.int16)
    second = np.abs(2 * rows[:, 1:-1] - rows[:, :-2] - rows[:, 2:])
    if usable is not None:
        second = second[usable[:: max(1, len(picture) // NOISE_ROWS), 1:-1]]
    counts = np.bincount(second.ravel(), minlength=2).astype(np.float64)
    if not counts.any():
        return float(step / np.sqrt(12.0))
    median = int(np.searchsorted(np.cumsum(counts), 0.5 * counts.sum()))
    # A median of whole numbers is coarse; the mean of the values below 4 medians is finer.
    typical = counts[: max(4 * median, 2 * step) + 1]
    # mean of |normal| is 0.798 deviations
    mean = float(typical @ np.arange(len(typical)) / typical.sum())
    return float(max(mean / (0.798 * np.sqrt(6.0)), step / np.sqrt(12.0)))


def fit_ground(
    reduced: Grey,
    inside: BoolArray,
    factor: int,
    size_px: tuple[int, int],
    white: int,
    tolerance: float,
) -> Ground:
    """Return the table's level from a reduced picture, leaving out the parts on the table.

    Parameters
    ----------
    reduced : (h, w), each pixel the mean of ``factor`` x ``factor``
    inside : (h, w) the usable area
    factor : reduction factor of the picture
    size_px : (width, height) size of the whole picture
    white : level of saturated pixels, whose true level is higher; 256 for none
    tolerance : share of the level by which the table can differ at first; halved as the fit gets
        better
    """
    stride = max(1, round((reduced.size / FITTED_PX) ** 0.5))
    start = _rim_level(reduced, inside)
    weights = np.array([start, 0, 0, 0, 0, 0], dtype=np.float64)
    v, u = np.nonzero(inside[stride // 2 :: stride, stride // 2 :: stride])
    v, u = v * stride + stride // 2, u * stride + stride // 2
    levels = reduced[v, u].astype(np.float64)
    x = ((u + 0.5) * factor - 0.5) * (2.0 / size_px[0]) - 1.0
    y = ((v + 0.5) * factor - 0.5) * (2.0 / size_px[1]) - 1.0
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    is_clipped = levels >= white - 3
    # if the table is darker than that, the white pixels belong to an object on it
    share = float(np.mean(is_clipped)) if len(levels) and start >= RIM_OF_WHITE * white else 0.0
    if share > 1.0 - MIN_UNSATURATED:
        return Ground(weights, size_px, 0.0)
    is_rim = ~is_clipped
    if share > MIN_SATURATED:
        # a pixel near an object's border does not count as the table's rim
        calm = cv2.erode(reduced, np.ones((7, 7), np.uint8)) >= RIM_OF_WHITE * white
        is_rim &= calm[v, u]
    scatter = 0.0
    fitted = weights @ terms
    for _ in range(ROUNDS):
        near = np.abs(levels - fitted) <= tolerance * np.maximum(fitted, 1.0) + 1.0
        if share > MIN_SATURATED:  # only pixels below white are fitted
            near = is_rim if scatter == 0.0 else is_rim & near
        if np.count_nonzero(near) < 60:
            break
        weights = _solve(terms, levels, near, share > MIN_SATURATED)
        fitted = weights @ terms
        off = (np.abs(levels - fitted) / np.maximum(fitted, 1.0))[near]
        scatter = 1.4826 * float(np.median(off))
        tolerance = max(0.5 * tolerance, min(4.0 * scatter, 0.2), 0.03)
    return Ground(weights, size_px, scatter)


def _rim_level(reduced: Grey, inside: BoolArray) -> float:
    """Return the median level along the picture's rim, or of all of it if little is usable."""
    band = max(2, len(reduced) // 12)
    strips = (np.s_[:band], np.s_[-band:], np.s_[band:-band, :band], np.s_[band:-band, -band:])
    seen = np.concatenate([reduced[strip][inside[strip]] for strip in strips])
    if len(seen) < 50:
        seen = reduced[inside]
    return float(np.median(seen)) if len(seen) else 0.0


def _solve(terms: FloatArray, levels: FloatArray, chosen: BoolArray, is_rim: bool) -> FloatArray:
    """Return the weights; the picture's rim alone determines only slopes and one bow."""
    if is_rim:
        few = np.concatenate([terms[:3], (terms[3] + terms[5])[None]])
        a, b, c, d = _least_squares(few, levels, chosen)
        return np.array([a, b, c, d, 0.0, d])
    return _least_squares(terms, levels, chosen)


def _least_squares(terms: FloatArray, levels: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the weights by normal equations: terms from -1 to 1 are far from dependent.

    Parameters
    ----------
    terms : (k, n)
    levels, chosen : (n,) levels to fit, and the mask of those used
    """
    masked = terms * chosen
    square = masked @ terms.T + 1e-9 * np.count_nonzero(chosen) * np.eye(len(terms))
    return np.asarray(np.linalg.solve(square, masked @ levels), np.float64)


def two_humps(counts: FloatArray) -> tuple[float, float, float, float, bool]:
    """Return (dark level, threshold, separation, valley, is_bimodal) of relative levels.

    Parameters
    ----------
    counts : (256,) histogram of picture over ground, the ground at ``GROUND_BIN``

    Notes
    -----
    Otsu's cut comes first (greatest variance between classes). A few hundred dark pixels against a
    million bright ones do not move it, so if it finds no two humps, half the ground's level is
    tried.
    """
    best = (float(GROUND_BIN), 0.5 * GROUND_BIN, 0.0, 1.0, False)
    for cut in (_otsu(counts), GROUND_BIN // 2):
        low, separation, valley = _judge(counts, cut)
        is_bimodal = separation >= MIN_SEPARATION and valley <= MAX_VALLEY
        if is_bimodal:
            return low, 0.5 * (low + GROUND_BIN), separation, valley, True
        if separation > best[2]:
            best = (low, 0.5 * (low + GROUND_BIN), separation, valley, False)
    return best


def _otsu(counts: FloatArray) -> int:
    weight = np.cumsum(counts)
    moment = np.cumsum(counts * np.arange(BINS))
    total = max(float(weight[-1]), 1.0)
    rest = total - weight
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (moment * total - moment[-1] * weight) ** 2 / (weight * rest)
    between[~np.isfinite(between)] = 0.0
    top = np.flatnonzero(between >= between.max() * (1.0 - 1e-12))
    return int(top[len(top) // 2])


def _judge(counts: FloatArray, cut: int) -> tuple[float, float, float]:
    """Return (level of the lower class, Ashman's D, valley depth) of a histogram cut in two."""
    bins = np.arange(BINS)
    means, spreads, heights, places = [], [], [], []
    smooth = np.convolve(counts, np.ones(9) / 9.0, mode="same")
    for part in (slice(0, cut + 1), slice(cut + 1, BINS)):
        total = counts[part].sum()
        if total < 5:
            return float(GROUND_BIN), 0.0, 1.0
        mean = float(counts[part] @ bins[part] / total)
        means.append(mean)
        spreads.append(float(counts[part] @ (bins[part] - mean) ** 2 / total) + 1.0 / 12.0)
        places.append(int(np.argmax(smooth[part])) + part.start)
        heights.append(float(smooth[part].max()))
    separation = abs(means[1] - means[0]) * np.sqrt(2.0) / np.sqrt(spreads[0] + spreads[1])
    between = smooth[places[0] : places[1] + 1]
    valley = float(between.min()) / max(min(heights), 1e-9) if len(between) else 1.0
    middle = np.searchsorted(np.cumsum(counts[: cut + 1]), 0.5 * counts[: cut + 1].sum())
    return float(middle), float(separation), valley
