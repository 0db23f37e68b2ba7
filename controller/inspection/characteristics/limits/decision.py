"""Verdict on a measured value by its uncertainty (references.md S8, S16).

Both conformity and non-conformity must be proven; otherwise the value remains open. Noise therefore
neither accepts nor rejects parts near a limit.
"""

from collections.abc import Callable
from math import erf, inf, isnan, sqrt
from typing import Final

from controller.config.characteristics import CONFORMANCE_PROBABILITY

from ..._types import Verdict

COVERAGE_FACTOR: Final = 2.0  # of the expanded uncertainty U


def decide(
    value: float,
    U: float,
    lower: float | None,
    upper: float | None,
    probability: float = CONFORMANCE_PROBABILITY,
) -> Verdict:
    """Return PASS or FAIL if one is proven, else INDETERMINATE.

    PASS: the true value lies within both limits with the required probability. FAIL: it lies beyond
    one of them with that probability. For a tolerance much wider than U, this is a guard band of
    1.645 u = 0.82 U on either side of each limit; a probability of 97.7 % makes it U. A value on
    its limit with no uncertainty conforms.

    Parameters
    ----------
    value, U : measured value and its expanded uncertainty (k = 2), in one unit
    lower, upper : limits, which belong to the tolerance; None where there is none
    probability : required probability of PASS and FAIL, above 0.5 and below 1

    Raises
    ------
    ValueError : U is negative, a value is not a number, the limits are reversed, or the probability
        is out of range
    """
    low = -inf if lower is None else lower
    high = inf if upper is None else upper
    if any(map(isnan, (value, U, low, high))) or U < 0:
        raise ValueError(f"{value} with U = {U} between {lower} and {upper} cannot be decided upon")
    if low > high:
        raise ValueError(f"the lower limit {lower} is above the upper one {upper}")
    if not 0.5 < probability < 1:
        raise ValueError(f"{probability} is no probability that proves anything")
    below = _probability_below(low, value, U)
    above = 1.0 - _probability_below(high, value, U) if U > 0 else float(value > high)
    if max(below, above) >= probability:
        return Verdict.FAIL
    if 1.0 - below - above >= probability:
        return Verdict.PASS
    return Verdict.INDETERMINATE


def open_zones(
    U: float,
    lower: float | None,
    upper: float | None,
    probability: float = CONFORMANCE_PROBABILITY,
) -> tuple[tuple[float, float], ...]:
    """Return the ranges of measured values that `decide` leaves open, in ascending order.

    There is one range about each limit. Where the tolerance is narrow against U, no value can pass,
    and both ranges merge.

    Parameters
    ----------
    U, lower, upper, probability : as for `decide`
    """
    low = -inf if lower is None else lower
    high = inf if upper is None else upper
    if U == 0 or (lower is None and upper is None):
        return ()
    reach = 6 * U  # no value farther beyond a limit is open: 12 standard deviations

    def verdict(value: float) -> Verdict:
        return decide(value, U, lower, upper, probability)

    middle = (
        0.5 * (low + high)
        if lower is not None and upper is not None
        else (low + reach if upper is None else high - reach)
    )
    passes = verdict(middle) is Verdict.PASS  # the middle is the value most likely to pass
    found = []
    for limit, away in ((lower, -1.0), (upper, 1.0)):
        if limit is None:
            continue
        outer = _edge(verdict, Verdict.FAIL, limit + away * reach, limit)
        found.append((outer, _edge(verdict, Verdict.PASS, middle, limit) if passes else middle))
    zones = [(min(zone), max(zone)) for zone in found]
    return tuple(zones) if passes else ((zones[0][0], zones[-1][1]),)


def _edge(
    verdict: Callable[[float], Verdict], wanted: Verdict, inside: float, outside: float
) -> float:
    """Return the border of a verdict between a value that has it and one that has not."""
    for _ in range(60):
        middle = 0.5 * (inside + outside)
        if verdict(middle) is wanted:
            inside = middle
        else:
            outside = middle
    return inside


def _probability_below(limit: float, value: float, U: float) -> float:
    """Return the probability that the true value is below a limit."""
    if U == 0 or limit in (-inf, inf):
        return float(value < limit)
    return 0.5 * (1.0 + erf((limit - value) / (U / COVERAGE_FACTOR) / sqrt(2.0)))
