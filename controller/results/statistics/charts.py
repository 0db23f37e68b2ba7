"""Charts of single values and moving ranges, and Nelson's rules (references.md S24, L30).

Parts come one at a time, so that there are no subgroups: the spread of the process is taken from
the moving range of neighbours, which a slow drift does not widen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray

# mean range of two values of a normal distribution, in standard deviations: 2 / sqrt(pi)
D2: Final = float(2 / np.sqrt(np.pi))
# standard deviation of that range over its mean: sqrt(2 - 4 / pi) / d2
RANGE_SPREAD: Final = float(np.sqrt(2 - 4 / np.pi) / D2)
SIGMAS: Final = 3.0
ONE_SIDE, TREND, ZIGZAG = 9, 6, 14  # values in a row, of Nelson's rules 2, 3 and 4


@dataclass(frozen=True, slots=True)
class NelsonSignal:
    """A rule that values break: its number, and the index of the last value of the pattern."""

    rule: int
    at: int


@dataclass(frozen=True, slots=True)
class RunChart:
    """A chart of single values and of their moving ranges.

    Attributes
    ----------
    mean, lower, upper : mean of the values, and their control limits
    sigma : standard deviation of the process, from the moving ranges
    mean_range, upper_range : mean of the moving ranges, and its limit
    signals : rules that are broken
    """

    mean: float
    lower: float
    upper: float
    sigma: float
    mean_range: float
    upper_range: float
    signals: tuple[NelsonSignal, ...]


def run_chart(values: Sequence[float]) -> RunChart | None:
    """Return the chart of values in the order measured, None for fewer than two."""
    if len(values) < 2:
        return None
    x = np.asarray(values, dtype=float)
    mean = float(x.mean())
    mean_range = float(np.abs(np.diff(x)).mean())
    sigma = mean_range / D2
    return RunChart(
        mean=mean,
        lower=mean - SIGMAS * sigma,
        upper=mean + SIGMAS * sigma,
        sigma=sigma,
        mean_range=mean_range,
        upper_range=mean_range * (1 + SIGMAS * RANGE_SPREAD),
        signals=nelson_signals(x, mean, sigma),
    )


def nelson_signals(values: FloatArray, mean: float, sigma: float) -> tuple[NelsonSignal, ...]:
    """Return the violations of Nelson's rules 1 to 4, each by its last value.

    1: beyond three standard deviations; 2: nine in a row on one side of the mean; 3: six in a row
    that rise, or fall; 4: fourteen in a row that go up and down in turn.

    Parameters
    ----------
    values : (n,) in the order measured
    mean, sigma : mean and standard deviation of the process
    """
    steps = np.sign(np.diff(values))
    side = np.sign(values - mean)
    found = [
        NelsonSignal(1, int(i)) for i in np.flatnonzero(np.abs(values - mean) > SIGMAS * sigma)
    ]
    for i in range(len(values)):
        if i + 1 >= ONE_SIDE and abs(side[i + 1 - ONE_SIDE : i + 1].sum()) == ONE_SIDE:
            found.append(NelsonSignal(2, i))
        if i + 1 >= TREND and abs(steps[i + 1 - TREND : i].sum()) == TREND - 1:
            found.append(NelsonSignal(3, i))
        if i + 1 >= ZIGZAG:
            turns = steps[i + 1 - ZIGZAG : i]
            if np.all(turns[1:] * turns[:-1] < 0):
                found.append(NelsonSignal(4, i))
    return tuple(sorted(found, key=lambda signal: (signal.at, signal.rule)))
