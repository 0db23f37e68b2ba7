"""Robust least squares for edge offsets, with the uncertainty of the results."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, median

ROUNDS: Final = 25
TRIMS: Final = 3  # number of rounds in which outliers are excluded or readmitted
OUTLIER: Final = 4.0  # limit for outliers, in robust standard deviations
MAD_TO_SIGMA: Final = 1.4826
SETTLED_PX: Final = 0.002
# Least eigenvalue of the scaled normal matrix; below it an unknown is not determined.
SINGULAR: Final = 1e-9
MAX_CORRELATION: Final = 0.9  # largest correlation assumed between neighbouring rays


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """Unknowns fitted to offsets.

    Attributes
    ----------
    values : (p,) unknowns
    gain : (p, n) derivatives of the unknowns by the offsets; 0 for unused offsets
    noise : (p, p) covariance from the scatter of the offsets
    residuals : (n,) residuals of all offsets; NaN where there is none
    used : (n,) mask of the offsets that belong to the shape
    scatter : robust standard deviation of the used offsets
    """

    values: FloatArray
    gain: FloatArray
    noise: FloatArray
    residuals: FloatArray
    used: BoolArray
    scatter: float


def solve(
    design: FloatArray, offsets: FloatArray, variance: FloatArray, spacing_px: FloatArray
) -> Solution | None:
    """Return the least-squares solution of offsets without outliers; None where none fits.

    Parameters
    ----------
    design : (n, p) derivatives of the offsets by the unknowns
    offsets : (n,) offsets; NaN where none was found
    variance : (n,) their variances
    spacing_px : (n,) distance between neighbours, which share the noise of a pixel
    """
    count, unknowns = design.shape
    found = np.isfinite(offsets)
    if found.sum() < 2 * unknowns:
        return None
    y = np.where(found, offsets, 0.0)
    weight = np.where(found, 1.0 / variance, 0.0)
    trust = np.ones(count)
    values = np.zeros(unknowns)
    floor = math.sqrt(median(variance[found]))
    scale = np.inf
    for _ in range(ROUNDS):
        before = values
        step = _least_squares(design, y, weight * trust)
        if step is None:
            return None
        values = step
        off = np.abs(y - design @ values)
        scale = max(MAD_TO_SIGMA * median(off[found]), floor)
        trust = 1.0 / (1.0 + np.square(off / scale))
        if np.abs(design @ (values - before)).max() < SETTLED_PX:
            break
    last, used = values, found
    for _ in range(TRIMS):
        off = np.abs(y - design @ last)
        used = found & (off <= OUTLIER * np.maximum(scale, np.sqrt(variance)))
        if used.sum() < 2 * unknowns:
            return None
        step = _least_squares(design, y, weight * used)
        if step is None:
            return None
        last = step
        scale = max(MAD_TO_SIGMA * median(np.abs(y - design @ last)[used]), floor)
    kept = weight * used
    normal = (design * kept[:, None]).T @ design
    inverse = np.linalg.inv(normal)
    gain = inverse @ (design * kept[:, None]).T
    residuals = y - design @ last
    scatter = MAD_TO_SIGMA * median(np.abs(residuals[used]))
    freedom = max(int(used.sum()) - unknowns, 1)
    misfit = float((kept * residuals**2).sum()) / freedom
    sharing = max(1.0 / min(median(spacing_px), 1.0), _sharing(residuals, used))
    noise = inverse * max(misfit, 1.0) * sharing
    return Solution(last, gain, noise, np.where(found, residuals, np.nan), used, scatter)


def _least_squares(design: FloatArray, y: FloatArray, weight: FloatArray) -> FloatArray | None:
    weighted = design * weight[:, None]
    normal = weighted.T @ design
    scale = np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
    unit = normal / np.outer(scale, scale)
    if np.linalg.eigvalsh(unit)[0] < SINGULAR:
        return None
    return np.asarray(np.linalg.solve(unit, (weighted.T @ y) / scale) / scale)


def _sharing(residuals: FloatArray, used: BoolArray) -> float:
    """Return the number of neighbours that share one error, by the correlation of residuals."""
    both = used[1:] & used[:-1]
    if both.sum() < 8:
        return 1.0
    ahead, behind = residuals[1:][both], residuals[:-1][both]
    total = float(np.sqrt((ahead @ ahead) * (behind @ behind)))
    alike = float(ahead @ behind) / total if total > 0 else 0.0
    alike = float(np.clip(alike, 0.0, MAX_CORRELATION))
    return (1.0 + alike) / (1.0 - alike)
