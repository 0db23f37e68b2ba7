"""Process capability: Cp, Cpk, Pp, Ppk, with intervals and the count (references.md S24).

Cp and Cpk take the spread from moving ranges, Pp and Ppk from all values. An index of few parts is
a guess, and a number without its interval hides that: below `MIN_COUNT` there is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from controller.arrays import FloatArray

from .charts import D2

MIN_COUNT: Final = 25
CONFIDENCE: Final = 0.95
# A p-value below this speaks against a normal distribution.
NORMALITY_P: Final = 0.05
MAX_SHAPIRO: Final = 5000


@dataclass(frozen=True, slots=True)
class Interval:
    """A value, and the interval that holds the true one with 95 %."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True, slots=True)
class ProcessCapability:
    """Process capability; indices are None if `note` says why.

    Attributes
    ----------
    n : number of values
    cp, cpk : capability from the spread between neighbours; cp is None for a limit on one side
    pp, ppk : capability from the spread of all values
    normality_p : probability of values so far from normal, if they are (Shapiro, Wilk)
    note : caution to be read with the indices
    """

    n: int
    mean: float | None
    sigma: float | None
    cp: Interval | None = None
    cpk: Interval | None = None
    pp: Interval | None = None
    ppk: Interval | None = None
    normality_p: float | None = None
    note: str = ""


def capability(
    values: Sequence[float], lower: float | None, upper: float | None
) -> ProcessCapability:
    """Return the capability of a process by values in the order measured.

    Parameters
    ----------
    values : n of them
    lower, upper : limits; None for one that there is not, as below the form of an edge

    Raises
    ------
    ValueError : there is no limit
    """
    if lower is None and upper is None:
        raise ValueError("a capability needs a limit")
    x = np.asarray(values, dtype=float)
    n = len(x)
    mean = float(x.mean()) if n else None
    sigma = float(x.std(ddof=1)) if n > 1 else None
    if mean is None or sigma is None or n < MIN_COUNT:
        return ProcessCapability(n, mean, sigma, note=f"{n} values, {MIN_COUNT} are required")
    if sigma == 0:
        return ProcessCapability(
            n, mean, sigma, note="all values are the same: no spread to compare"
        )
    within = float(np.abs(np.diff(x)).mean()) / D2
    p = _normality_p(x[:MAX_SHAPIRO])
    is_doubtful = p < NORMALITY_P
    return ProcessCapability(
        n,
        mean,
        sigma,
        cp=_width(lower, upper, within, moving_range_freedom(n)),
        cpk=_nearest(mean, lower, upper, within, n, moving_range_freedom(n)),
        pp=_width(lower, upper, sigma, n - 1),
        ppk=_nearest(mean, lower, upper, sigma, n, n - 1),
        normality_p=p,
        note=(
            f"not normal (p = {p:.3f}): the indices do not tell the share beyond the limits"
            if is_doubtful
            else ""
        ),
    )


def _normality_p(x: FloatArray) -> float:
    """Return the probability of values this far from normal, if they are (Shapiro, Wilk)."""
    # a quarter of a second, which no other command has to pay
    from scipy.stats import shapiro

    return float(shapiro(x).pvalue)


def chi_square_quantile(p: float, freedom: float | FloatArray) -> FloatArray:
    """Return the ``p`` quantile of the chi-square distribution."""
    return np.asarray(2 * special.gammaincinv(np.asarray(freedom) / 2, p))


def moving_range_freedom(n: int) -> float:
    """Return the degrees of freedom of a standard deviation taken from n - 1 moving ranges.

    Neighbouring ranges share a value. For normal x of variance 1 their variance is 2 - 4 / pi, and
    their covariance that of |X| and |Y| with variances 2 and correlation -1/2.
    """
    root = np.sqrt(1 - 0.25)
    both = 4 / np.pi * (root + 0.5 * np.arcsin(0.5)) - 4 / np.pi
    ranges = n - 1
    variance = ((2 - 4 / np.pi) * ranges + 2 * both * (ranges - 1)) / ranges**2
    return float(D2**2 / (2 * variance))


def _width(
    lower: float | None, upper: float | None, sigma: float, freedom: float
) -> Interval | None:
    if lower is None or upper is None or sigma == 0:
        return None
    index = (upper - lower) / (6 * sigma)
    tail = (1 - CONFIDENCE) / 2
    low, high = (np.sqrt(chi_square_quantile(q, freedom) / freedom) for q in (tail, 1 - tail))
    return Interval(index, float(index * low), float(index * high))


def _nearest(
    mean: float, lower: float | None, upper: float | None, sigma: float, n: int, freedom: float
) -> Interval | None:
    if sigma == 0:
        return None
    rooms = [upper - mean] if upper is not None else []
    rooms += [mean - lower] if lower is not None else []
    index = min(rooms) / (3 * sigma)
    half = float(special.ndtri((1 + CONFIDENCE) / 2)) * float(
        np.sqrt(1 / (9 * n) + index**2 / (2 * freedom))
    )
    return Interval(index, index - half, index + half)
