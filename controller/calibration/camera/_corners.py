"""Measure corners of squares to a hundredth of a pixel: fit a model of an X to the grey levels.

Two edges cross at a corner: grey = (mean + contrast e1 e2) light. Here e1 and e2 go from -1 to 1
across two straight lines through the corner, as sharply as the lens's blur and the pixel's own size
allow, and the light falls off evenly. The pattern changes sign across either line, so brightness,
over-exposure and blur do not move the corner. Two details matter. A pixel is a square and not a
point, so an edge along the rows is sharper than a slanting one; without that, corners would be off
by 0.02 px in a sharp picture. And light shows on white only, so adding its slope instead of
multiplying by it would move corners towards the light.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from controller.arrays import BoolArray, FloatArray

REACH_SQUARES: Final = 0.42  # half side of the window, which ends just short of the next edge
REACH_MAX_PX: Final = 14  # a larger window takes more time and has bent edges in it
_STEPS_MAX: Final = 14
_STILL_PX: Final = 2e-4  # a step this short was the last one
_BLUR_MIN_PX: Final = 0.1  # least blur of the lens; the pixel's own blur is known
_UNKNOWNS: Final = 9  # u, v, two directions, mean, light's two slopes, contrast, log blur


def refine_corners(
    grey: NDArray[np.uint8],
    pixels: FloatArray,
    axes_px: FloatArray,
    *,
    marker_gap: float | None = None,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return corners (n, 2), the lens's blur there (n,) [px] and whether each fit is sound (n,).

    Parameters
    ----------
    grey : (height, width)
    pixels : (n, 2) approximate positions of the corners, to about a pixel
    axes_px : (n, 2, 2) the board's X and Y at each corner, one square long [px], as rows
    marker_gap : the white border's share of a square, if markers fill the white squares
    """
    first, _, there = _measure(grey, pixels, axes_px, marker_gap)
    # the window is centred on the corner found and fitted again, so the start has no influence
    again, blur, sound = _measure(
        grey, np.where(there[:, None], first, pixels), axes_px, marker_gap
    )
    far = np.linalg.norm(again - pixels, axis=1)
    side_px = np.linalg.norm(axes_px, axis=2).min(axis=1)
    return again, blur, sound & there & (far < np.maximum(1.5, 0.1 * side_px))


def _measure(
    grey: NDArray[np.uint8], pixels: FloatArray, axes_px: FloatArray, marker_gap: float | None
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Fit each corner in a window around it; return what `refine_corners` returns."""
    height, width = grey.shape
    step_px = np.abs(axes_px).max(axis=(1, 2))
    wanted = np.ceil(REACH_SQUARES * np.median(step_px) * 1.3)
    reach = int(np.clip(wanted, 3, REACH_MAX_PX))
    v, u = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    at = np.rint(pixels).astype(int)[:, None] + np.column_stack([u.ravel(), v.ravel()])
    inside = ((at >= 0) & (at < (width, height))).all(axis=2)
    values = grey[np.clip(at[..., 1], 0, height - 1), np.clip(at[..., 0], 0, width - 1)]

    squares = np.abs((at - pixels[:, None]) @ np.linalg.inv(axes_px))
    used = inside & (squares.max(axis=2) < REACH_SQUARES)
    if marker_gap is not None:
        # the blur of the marker's edge reaches a pixel and a half into the border
        clear = marker_gap - 1.5 / np.maximum(step_px, 1.0)
        used &= squares.min(axis=2) < clear[:, None]
    return _fit(values.astype(np.float64), used, at.astype(np.float64), pixels, axes_px)


def _fit(
    values: FloatArray,
    used: BoolArray,
    at: FloatArray,
    pixels: FloatArray,
    axes_px: FloatArray,
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Fit all corners at once by Gauss-Newton, each with its own damping."""
    count = np.maximum(used.sum(axis=1), 1)
    x = _first(values, used, at, pixels, axes_px)
    best, cost = x.copy(), np.full(len(x), np.inf)
    damping = np.full(len(x), 1e-3)
    normal = np.zeros((len(x), _UNKNOWNS, _UNKNOWNS))
    g = np.zeros((len(x), _UNKNOWNS))
    for _ in range(_STEPS_MAX):
        model, jac = _model(x, at)
        r = np.where(used, values - model, 0.0)
        now = np.einsum("nm,nm->n", r, r)
        better = now <= cost
        best[better], cost[better] = x[better], now[better]
        jac *= used[..., None]
        transposed = jac.transpose(0, 2, 1)
        normal[better] = (transposed @ jac)[better]
        g[better] = (transposed @ r[..., None])[better, :, 0]
        damping = np.where(better, damping * 0.2, damping * 10.0)
        scale = np.einsum("nii->ni", normal) * damping[:, None] + 1e-9
        step = np.linalg.solve(normal + scale[:, None] * np.eye(_UNKNOWNS), g[..., None])[..., 0]
        x = best + step
        x[:, 8] = np.maximum(x[:, 8], np.log(_BLUR_MIN_PX))
        if np.abs(step[:, :2]).max() < _STILL_PX:
            break
    noise = np.sqrt(cost / count)
    contrast = np.abs(best[:, 7])
    far = np.abs(best[:, :2] - pixels).max(axis=1)
    blur = np.exp(best[:, 8])
    square_px = np.linalg.norm(axes_px, axis=2).min(axis=1)
    sound = (
        (count > 2 * _UNKNOWNS)
        & (far < np.maximum(1.5, 0.15 * square_px))
        & (contrast > 3.0)  # grey levels: anything fainter may be a stain
        & (noise < 0.4 * contrast)
        & (blur < 0.4 * square_px)
    )
    return best[:, :2], blur, sound


def _first(
    values: FloatArray,
    used: BoolArray,
    at: FloatArray,
    pixels: FloatArray,
    axes_px: FloatArray,
) -> FloatArray:
    """Return the unknowns (n, 9) to start from: the edges run along the board's axes."""
    count = np.maximum(used.sum(axis=1), 1)
    x = np.zeros((len(pixels), _UNKNOWNS))
    x[:, :2] = pixels
    # an edge's normal is at right angles to the axis it runs along
    x[:, 2] = np.arctan2(axes_px[:, 0, 0], -axes_px[:, 0, 1])
    x[:, 3] = np.arctan2(axes_px[:, 1, 0], -axes_px[:, 1, 1])
    x[:, 8] = np.log(0.6)
    mean = (values * used).sum(axis=1) / count
    x[:, 7] = 1.0
    wave = _model(x, at)[0] * used
    x[:, 4] = mean
    x[:, 7] = ((values - mean[:, None]) * wave).sum(axis=1) / np.maximum(
        (wave**2).sum(axis=1), 1e-9
    )
    return x


def _model(x: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return grey levels (n, m) and their derivatives (n, m, 9)."""
    du, dv = at[..., 0] - x[:, 0, None], at[..., 1] - x[:, 1, None]
    c1, s1 = np.cos(x[:, 2, None]), np.sin(x[:, 2, None])
    c2, s2 = np.cos(x[:, 3, None]), np.sin(x[:, 3, None])
    blur = np.exp(x[:, 8, None])
    e1, e1_by_d, e1_by_blur = _edge(du * c1 + dv * s1, c1, s1, blur)
    e2, e2_by_d, e2_by_blur = _edge(du * c2 + dv * s2, c2, s2, blur)
    contrast = x[:, 7, None]
    light = 1.0 + x[:, 5, None] * du + x[:, 6, None] * dv
    pattern = x[:, 4, None] + contrast * e1 * e2
    g1, g2 = light * contrast * e2 * e1_by_d, light * contrast * e1 * e2_by_d
    jac = np.empty((*du.shape, _UNKNOWNS))
    jac[..., 0] = -g1 * c1 - g2 * c2 - pattern * x[:, 5, None]
    jac[..., 1] = -g1 * s1 - g2 * s2 - pattern * x[:, 6, None]
    jac[..., 2] = g1 * (dv * c1 - du * s1)
    jac[..., 3] = g2 * (dv * c2 - du * s2)
    jac[..., 4], jac[..., 5], jac[..., 6] = light, pattern * du, pattern * dv
    jac[..., 7] = light * e1 * e2
    jac[..., 8] = light * contrast * (e2 * e1_by_blur + e1 * e2_by_blur)
    return light * pattern, jac


def _edge(
    d: FloatArray, c: FloatArray, s: FloatArray, blur: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return an edge over the distance d of pixels, and its derivatives by d and log blur.

    Along an edge of normal (c, s), a square pixel is a box of width |c| convolved with a box of
    width |s|. The average over the wider box is exact; the narrower one counts as blur of the same
    variance.
    """
    wide, narrow = np.maximum(np.abs(c), np.abs(s)), np.minimum(np.abs(c), np.abs(s))
    a = np.sqrt(2.0 * (blur**2 + narrow**2 / 12.0))
    before, after = (d - wide / 2) / a, (d + wide / 2) / a
    erf_before, erf_after = erf(before), erf(after)
    bell_before, bell_after = np.exp(-(before**2)), np.exp(-(after**2))
    root_pi = np.sqrt(np.pi)
    area = after * erf_after - before * erf_before + (bell_after - bell_before) / root_pi
    e = area * a / wide
    by_blur = (bell_after - bell_before) / (root_pi * wide) * (2.0 * blur**2 / a)
    return e, (erf_after - erf_before) / wide, by_blur
