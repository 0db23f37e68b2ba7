"""Edge positions on short rays of a picture, to a hundredth of a pixel.

Along each ray the grey levels are fitted with ``a + b Phi((t - m) / s)``: a step blurred by lens
and pixel (references.md L18). The picture is sampled by a cubic spline, which adds no blur of its
own. All rays are fitted at once.

Other edge finders: `contours` traces the outline of a backlit part whole, for poses;
`controller.recognition.fitting` searches for predicted edges pixels away, for poses; the
registration of `controller.inspection` compares pictures with predictions. None of them measures.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter
from scipy.special import ndtr

from controller.arrays import BoolArray, FloatArray, Grey, IndexArray

STEP_PX: Final = 0.5  # distance between samples of a ray
SPAN: Final = 2  # steps to either side of the slope over which the search differentiates
FIT_PX: Final = 4.0  # reach of the fit to either side of the step first found
MARGIN_PX: Final = 12  # margin of the spline's region: its filter forgets by 0.27 a pixel
BACK: Final = 0.1  # share of the steepest part above which a profile leads back
BACK_NOISE: Final = 5.0  # the same limit in noises
FLAT_PX: Final = 2.0  # from here on a profile shows the levels beside the step
MIN_SAMPLES: Final = 8
NEAR_SHARE: Final = 0.25  # share of one side's window: the outer part that a step hardly needs
START_WIDTH_PX: Final = 0.8
MIN_WIDTH_PX: Final = 0.2  # narrowest step; a pixel's box alone makes 0.29
MAX_WIDTH_PX: Final = 3.0  # wider steps do not end within the fitted window
FAR: Final = 0.5  # weight of a step at the end of the reach, against one where it is expected
ROUNDS: Final = 14
DONE_PX: Final = 2e-4
ROUNDING: Final = 0.29  # rms of a level that is rounded to a whole number
WHITE: Final = 254.5  # from here on a true level is unknown
SLOPED_PX: Final = 2.5  # reach of a fit with slopes, within which light from a corner is straight
SLOPED_UNKNOWNS: Final = 5
TRIED_PX: Final = 1.2  # distance about a step found with level sides within which it is tried anew
TRIED_STEP_PX: Final = 0.05
SQRT_2PI: Final = float(np.sqrt(2.0 * np.pi))


@dataclass(frozen=True, eq=False, slots=True)
class EdgeFits:
    """Steps found along rays.

    Attributes
    ----------
    offset_px : (n,) offset of the step along the ray from its origin; NaN if there is none
    width_px : (n,) its standard deviation, lens and pixel together
    level, contrast : (n,) grey before it, and how much brighter it is after
    residual : (n,) rms of the fit [grey]
    sigma_px : (n,) standard error of the offset, from the residual or the noise, the larger one.
        Rays nearer to each other than a pixel see the same noise
    burnt : (n,) share of the fitted samples that are white
    back : (n,) sign of the side on which the profile soon leads back, 1 beyond the step and -1
        before it; 0 for neither or both
    """

    offset_px: FloatArray
    width_px: FloatArray
    level: FloatArray
    contrast: FloatArray
    residual: FloatArray
    sigma_px: FloatArray
    burnt: FloatArray
    back: FloatArray

    @property
    def is_found(self) -> BoolArray:
        """Mask (n,) of the rays that crossed a step."""
        return np.isfinite(self.offset_px)


def measure_edges(
    picture: Grey,
    origins_px: FloatArray,
    directions: FloatArray,
    reach_px: float | FloatArray,
    noise: float = 0.5,
    rising: FloatArray | None = None,
) -> EdgeFits:
    """Return the steps that rays of a picture cross.

    Parameters
    ----------
    picture : (height, width)
    origins_px : (n, 2) expected positions of the steps, x before y
    directions : (n, 2) unit, square to the edge
    reach_px : range of the search to both sides; one, or one a ray (n,)
    noise : rms of a pixel [grey], at least that of rounding is taken
    rising : (n,) 1 where it must get brighter along the ray, -1 darker, 0 either; None for either
    """
    count = len(origins_px)
    if count == 0:
        nothing = np.zeros(0)
        return EdgeFits(*(nothing for _ in EdgeFits.__slots__))
    half = round(FIT_PX / STEP_PX)
    reach = np.broadcast_to(np.asarray(reach_px, np.float64), count)
    steps = half + int(np.ceil(reach.max() / STEP_PX))
    offsets = np.arange(-steps, steps + 1, dtype=np.float64) * STEP_PX
    profiles, is_inside = sample_rays(picture, origins_px, directions, offsets)
    start = _strongest(profiles, reach, rising)
    # the fitted window is cut out about the start, so that all rays have equally many samples
    columns = start[:, None] + np.arange(-half, half + 1)
    values = np.take_along_axis(profiles, columns, axis=1)
    belongs = _one_way(values, noise)
    fits = _fit(values, belongs, offsets[steps - half : steps + half + 1], noise)
    offset = offsets[start] + fits.offset_px
    good = np.take_along_axis(is_inside, columns, axis=1).all(axis=1) & fits.is_found
    good &= np.abs(offset) <= reach
    if rising is not None:
        good &= fits.contrast * rising >= 0
    return replace(fits, offset_px=np.where(good, offset, np.nan))


def measure_sloped_edges(
    picture: Grey,
    origins_px: FloatArray,
    directions: FloatArray,
    found: EdgeFits,
    width_px: float,
    noise: float,
    chosen: BoolArray | None = None,
) -> EdgeFits:
    """Return steps fitted anew, with a slope of the light on either side of each.

    In an inner corner both sides light each other, the more the nearer to the corner. A fit with
    level sides takes that for a part of the step, and is off by up to half a pixel. Slopes and
    width hardly separate, so the width is given.

    Parameters
    ----------
    picture, origins_px, directions, noise : see `measure_edges`
    found : steps found along the rays, with level sides
    width_px : width of the blurred step
    chosen : (n,) mask of the steps to fit anew; None for all
    """
    some = np.flatnonzero(found.is_found if chosen is None else found.is_found & chosen)
    if len(some) == 0:
        return found
    half = round(SLOPED_PX / STEP_PX)
    at = np.arange(-half, half + 1, dtype=np.float64) * STEP_PX
    start = origins_px[some] + found.offset_px[some, None] * directions[some]
    values, _ = sample_rays(picture, start, directions[some], at)
    places = np.arange(-TRIED_PX, TRIED_PX + 0.5 * TRIED_STEP_PX, TRIED_STEP_PX)
    cost = np.stack([_sloped_cost(values, at - place, width_px) for place in places], axis=1)
    best = np.clip(np.argmin(cost, axis=1), 1, len(places) - 2)
    rows = np.arange(len(some))
    before, least, after = (cost[rows, best + step] for step in (-1, 0, 1))
    bend = np.maximum(before - 2.0 * least + after, 1e-9)
    place = places[best] + np.clip(0.5 * (before - after) / bend, -1, 1) * TRIED_STEP_PX
    rms = np.sqrt(least / max(len(at) - SLOPED_UNKNOWNS, 1))
    # Neighbouring samples share the noise of a pixel.
    level = np.maximum(rms, max(noise, ROUNDING)) / np.sqrt(STEP_PX)
    fields = {
        "offset_px": found.offset_px[some] + place,
        "sigma_px": level * TRIED_STEP_PX * np.sqrt(2.0 / bend),
        "residual": rms,
        "width_px": np.full(len(some), width_px),
    }
    new = {name: getattr(found, name).copy() for name in fields}
    for name, values_ in fields.items():
        new[name][some] = values_
    return replace(found, **new)


def _sloped_cost(values: FloatArray, at_px: FloatArray, width_px: float) -> FloatArray:
    """Return the squared misfit (n,) of profiles (n, k) to a step at 0 between two slopes."""
    z = at_px / width_px
    share = ndtr(z)
    bell = np.exp(-0.5 * z * z) / SQRT_2PI
    design = np.column_stack([
        np.ones_like(z), share, width_px * (z * share + bell), width_px * (z * (1 - share) - bell)
    ])  # fmt: skip
    basis, _ = np.linalg.qr(design)
    off = values - (values @ basis) @ basis.T
    return np.asarray(np.einsum("nk,nk->n", off, off))


def sample_rays(
    picture: Grey, origins_px: FloatArray, directions: FloatArray, offsets_px: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return a picture's levels (n, k) along rays, and a mask of the samples within it.

    Parameters
    ----------
    picture : (height, width)
    origins_px, directions : (n, 2) x before y
    offsets_px : (k,) along each ray
    """
    at = origins_px[:, None, :] + offsets_px[None, :, None] * directions[:, None, :]
    height, width = picture.shape
    within = (at >= 0) & (at <= [width - 1, height - 1])
    is_inside = within[..., 0] & within[..., 1]
    low = np.clip(np.floor(at.min(axis=(0, 1))).astype(np.intp) - MARGIN_PX, 0, [width, height])
    high = np.clip(np.ceil(at.max(axis=(0, 1))).astype(np.intp) + MARGIN_PX, 0, [width, height])
    region = picture[low[1] : high[1], low[0] : high[0]]
    if min(region.shape) < 2:
        return np.zeros(is_inside.shape), np.zeros_like(is_inside)
    weights = spline_filter(region, order=3, output=np.float32, mode="mirror")
    where = (at - low)[..., ::-1].reshape(-1, 2).T
    values = map_coordinates(weights, where, order=3, prefilter=False, mode="mirror")
    return np.asarray(values, np.float64).reshape(is_inside.shape), is_inside


def step_heights(
    picture: Grey, origins_px: FloatArray, directions: FloatArray, reach_px: float
) -> tuple[FloatArray, FloatArray]:
    """Return the offsets (k,) of possible steps along rays and their heights (n, k), 0 for no step.

    A step is where the picture changes most, along the ray, over two pixels.

    Parameters
    ----------
    picture : (height, width)
    origins_px, directions : (n, 2) as in `measure_edges`
    reach_px : range of the search to both sides
    """
    steps = int(np.ceil(reach_px / STEP_PX)) + 1
    beyond = np.arange(-steps - SPAN, steps + SPAN + 1, dtype=np.float64) * STEP_PX
    profiles, is_inside = sample_rays(picture, origins_px, directions, beyond)
    slope = profiles[:, 2 * SPAN :] - profiles[:, : -2 * SPAN]
    size = np.abs(slope)
    is_top = (size[:, 1:-1] >= size[:, :-2]) & (size[:, 1:-1] >= size[:, 2:])
    is_top &= is_inside.all(axis=1, keepdims=True)
    return beyond[SPAN + 1 : -SPAN - 1], np.where(is_top, slope[:, 1:-1], 0.0)


def blur_shift_px(width_px: FloatArray | float, curvature: FloatArray | float) -> FloatArray:
    """Return the distance by which blur moves a curved edge towards its centre of curvature [px].

    A blurred disc is smaller than the disc, a blurred hole than the hole (references.md L19).

    Parameters
    ----------
    width_px : standard deviation of the blurred step
    curvature : curvature of the edge [1/px]
    """
    return np.asarray(0.5 * np.square(width_px) * curvature, dtype=np.float64)


def _strongest(profiles: FloatArray, reach_px: FloatArray, rising: FloatArray | None) -> IndexArray:
    """Return the steepest sample (n,) of each ray, near ones preferred."""
    slope = profiles[:, 2 * SPAN :] - profiles[:, : -2 * SPAN]
    steps = profiles.shape[1] // 2
    place = STEP_PX * np.abs(np.arange(-steps + SPAN, steps - SPAN + 1))
    worth = 1.0 - FAR * place / np.maximum(reach_px, 1.0)[:, None]
    # a step is looked for within the reach; what lies beyond is there to be fitted
    worth = np.where(place <= reach_px[:, None], worth, 0.0)
    size = np.abs(slope)
    if rising is not None:
        size = np.where(rising[:, None] * slope < 0, 0.0, size)
    half = round(FIT_PX / STEP_PX)
    best = np.argmax(size * worth, axis=1) + SPAN
    return np.asarray(np.clip(best, half, profiles.shape[1] - 1 - half), dtype=np.intp)


def _one_way(values: FloatArray, noise: float) -> FloatArray:
    """Return 1 for the samples (n, k) that belong to the step in the middle of profiles, else 0.

    Beside a narrow shadow or a bright rim the next step leads back: anything beyond it does not
    belong to this edge.
    """
    count = values.shape[1]
    middle = count // 2
    slope = np.zeros_like(values)
    slope[:, SPAN:-SPAN] = values[:, 2 * SPAN :] - values[:, : -2 * SPAN]
    peak = slope[:, middle : middle + 1]
    back = -np.sign(peak) * slope
    turned = back > np.maximum(BACK * np.abs(peak), BACK_NOISE * max(noise, ROUNDING))
    ahead = np.logical_or.accumulate(turned[:, middle:], axis=1)
    behind = np.logical_or.accumulate(turned[:, middle::-1], axis=1)[:, ::-1]
    return np.asarray(~np.concatenate([behind[:, :-1], ahead], axis=1), dtype=np.float64)


def _fit(values: FloatArray, belongs: FloatArray, at_px: FloatArray, noise: float) -> EdgeFits:
    """Return steps fitted to profiles (n, k), by Levenberg and Marquardt.

    Parameters
    ----------
    values : (n, k)
    belongs : (n, k) 1 for the samples to be fitted, 0 for the others
    at_px : (k,) their places
    noise : as in `measure_edges`
    """
    count = len(values)
    near = belongs * (np.abs(at_px) >= FLAT_PX)
    before, after = (
        _mean(values, near * side, values[:, end])
        for side, end in ((at_px < 0, 0), (at_px > 0, -1))
    )
    p = np.column_stack(
        [before, after - before, np.zeros(count), np.full(count, np.log(START_WIDTH_PX))]
    )
    damping = np.full(count, 1e-3)
    open_ = np.arange(count)
    cost = _cost(values, belongs, at_px, p)
    identity = np.eye(4)
    for _ in range(ROUNDS):
        normal, gradient = _normal(values[open_], belongs[open_], at_px, p[open_])
        scale = np.einsum("nii->ni", normal)
        damped = normal + (damping[open_, None] * scale + 1e-9)[:, :, None] * identity
        step = np.linalg.solve(damped, gradient[..., None])[..., 0]
        step[:, 2] = np.clip(step[:, 2], -1.0, 1.0)
        step[:, 3] = np.clip(step[:, 3], -0.5, 0.5)
        tried = p[open_] + step
        tried[:, 3] = np.clip(tried[:, 3], np.log(0.5 * MIN_WIDTH_PX), np.log(2 * MAX_WIDTH_PX))
        new = _cost(values[open_], belongs[open_], at_px, tried)
        is_better = new <= cost[open_]
        taken = open_[is_better]
        p[taken], cost[taken] = tried[is_better], new[is_better]
        damping[open_] = np.clip(damping[open_] * np.where(is_better, 0.2, 8.0), 1e-7, 1e7)
        moves = np.abs(step[:, 2]) + np.abs(step[:, 3])
        open_ = open_[(moves > DONE_PX) | ~is_better]
        if len(open_) == 0:
            break
    width = np.exp(p[:, 3])
    samples = belongs.sum(axis=1)
    residual = np.sqrt(cost / np.maximum(samples - 4.0, 1.0))
    normal, _ = _normal(values, belongs, at_px, p)
    # neighbouring samples share the noise of a pixel: of those within one, one counts
    spread = _third_variance(normal) / STEP_PX
    sigma = np.maximum(residual, max(noise, ROUNDING)) * np.sqrt(spread)
    good = (np.abs(p[:, 2]) < at_px[-1] - 1.0) & (np.abs(p[:, 1]) > 3.0 * residual)
    good &= samples >= MIN_SAMPLES
    good &= (width > MIN_WIDTH_PX) & (width < MAX_WIDTH_PX) & np.isfinite(sigma)
    return EdgeFits(
        offset_px=np.where(good, p[:, 2], np.nan),
        width_px=width,
        level=p[:, 0],
        contrast=p[:, 1],
        residual=residual,
        sigma_px=sigma,
        burnt=(values > WHITE).mean(axis=1),
        back=_back(belongs),
    )


def _back(belongs: FloatArray) -> FloatArray:
    """Return the side (n,) on which a step has fewer of its samples: -1, 1, 0 for neither.

    The fit lacks the level there: it finds the step too narrow, and too far to the other side.
    """
    middle = belongs.shape[1] // 2
    before, after = belongs[:, :middle].sum(axis=1), belongs[:, middle + 1 :].sum(axis=1)
    short = 1.0 - NEAR_SHARE
    return np.asarray(
        (after < short * middle) * 1.0 - (before < short * middle) * 1.0, dtype=np.float64
    )


def _mean(values: FloatArray, weight: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return weighted means (n,) of rows (n, k), ``otherwise`` where no value has weight."""
    total = weight.sum(axis=1)
    mean = (values * weight).sum(axis=1) / np.maximum(total, 1.0)
    return np.asarray(np.where(total > 0, mean, otherwise))


def _cost(values: FloatArray, belongs: FloatArray, at_px: FloatArray, p: FloatArray) -> FloatArray:
    z = (at_px - p[:, 2:3]) / np.exp(p[:, 3:4])
    off = belongs * (values - p[:, :1] - p[:, 1:2] * ndtr(z))
    return np.asarray(np.einsum("nk,nk->n", off, off), dtype=np.float64)


def _normal(
    values: FloatArray, belongs: FloatArray, at_px: FloatArray, p: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (n, 4, 4), (n, 4) of a, b, m and log s."""
    width = np.exp(p[:, 3:4])
    z = (at_px - p[:, 2:3]) / width
    share = ndtr(z)
    bell = -p[:, 1:2] / SQRT_2PI * np.exp(-0.5 * z * z)
    design = np.stack([np.ones_like(z), share, bell / width, bell * z], axis=2)
    off = values - p[:, :1] - p[:, 1:2] * share
    turned = (design * belongs[:, :, None]).transpose(0, 2, 1)
    return np.asarray(turned @ design), np.asarray((turned @ off[..., None])[..., 0])


def _third_variance(normal: FloatArray) -> FloatArray:
    """Return the variance (n,) of the third unknown for unit noise, inf where it is not known."""
    scale = np.sqrt(np.maximum(np.einsum("nii->ni", normal), 1e-12))
    unit = normal / (scale[:, :, None] * scale[:, None, :]) + 1e-9 * np.eye(4)
    return np.asarray(np.linalg.inv(unit)[:, 2, 2] / scale[:, 2] ** 2)
