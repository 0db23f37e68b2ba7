"""The scatter of measuring: a crossed study by analysis of variance (references.md S23).

Several parts, each measured several times under several set-ups. For a robot cell a set-up is a new
grasp, a new start pose or another day, never the same pictures again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import special

from controller.arrays import FloatArray

# Significance level above which an interaction of parts and set-ups is pooled with scatter (S23).
POOL_P: Final = 0.25
# categories: sqrt(2), cut to two digits as the manual has it
NDC_FACTOR: Final = 1.41
SIGMAS: Final = 6.0
CONFIDENCE: Final = 0.95


@dataclass(frozen=True, slots=True)
class GaugeStudy:
    """Variances of a study, and the figures derived from them.

    Attributes
    ----------
    repeatability, setup, interaction, part : variances; the interaction is None if it is not
        more than scatter
    grr_percent : percentage of the whole spread of the study
    tolerance_percent : six standard deviations of the gauge, of the tolerance; None without one
    ndc : categories of parts that the gauge tells apart
    """

    repeatability: float
    setup: float
    interaction: float | None
    part: float
    grr_percent: float
    tolerance_percent: float | None
    ndc: int

    @property
    def grr(self) -> float:
        """Variance of the gauge: all components except that of the parts."""
        return self.repeatability + self.setup + (self.interaction or 0.0)


@dataclass(frozen=True, slots=True)
class Bias:
    """Mean of repeated values less the reference, with the interval that holds it with 95 %."""

    n: int
    bias: float
    lower: float
    upper: float
    sigma: float

    @property
    def is_significant(self) -> bool:
        """True if there is a significant bias."""
        return not self.lower <= 0 <= self.upper


def gauge_study(values: FloatArray, tolerance: float | None = None) -> GaugeStudy:
    """Return the study of values (parts, set-ups, repeats).

    Raises
    ------
    ValueError : fewer than two of each, or a value missing
    """
    x = np.asarray(values, dtype=float)
    if x.ndim != 3 or min(x.shape) < 2 or not np.isfinite(x).all():
        raise ValueError(
            f"a gauge study of shape {x.shape}: parts, set-ups and repeats, at least two of each, "
            "and no value missing"
        )
    parts, setups, repeats = x.shape
    mean, of_part, of_setup, of_cell = x.mean(), x.mean((1, 2)), x.mean((0, 2)), x.mean(2)
    ss_part = setups * repeats * float(((of_part - mean) ** 2).sum())
    ss_setup = parts * repeats * float(((of_setup - mean) ** 2).sum())
    both = of_cell - of_part[:, None] - of_setup[None] + mean
    ss_both = repeats * float((both**2).sum())
    ss_repeat = float(((x - of_cell[..., None]) ** 2).sum())
    df_part, df_setup, df_both = parts - 1, setups - 1, (parts - 1) * (setups - 1)
    df_repeat = parts * setups * (repeats - 1)
    ms_part, ms_setup, ms_both = ss_part / df_part, ss_setup / df_setup, ss_both / df_both
    ms_repeat = ss_repeat / df_repeat
    is_sure = ms_repeat == 0 or special.fdtrc(df_both, df_repeat, ms_both / ms_repeat) < POOL_P
    if is_sure and ms_both > ms_repeat:
        repeatability, error = ms_repeat, ms_both
        interaction: float | None = (ms_both - ms_repeat) / repeats
    else:
        repeatability = (ss_both + ss_repeat) / (df_both + df_repeat)
        error, interaction = repeatability, None
    setup = max(0.0, (ms_setup - error) / (parts * repeats))
    part = max(0.0, (ms_part - error) / (setups * repeats))
    grr = repeatability + setup + (interaction or 0.0)
    total = grr + part
    return GaugeStudy(
        repeatability=repeatability,
        setup=setup,
        interaction=interaction,
        part=part,
        grr_percent=100 * float(np.sqrt(grr / total)) if total else 0.0,
        tolerance_percent=100 * SIGMAS * float(np.sqrt(grr)) / tolerance if tolerance else None,
        ndc=int(NDC_FACTOR * np.sqrt(part / grr)) if grr else 0,
    )


def bias_of(values: Sequence[float], reference: float) -> Bias:
    """Return the bias of repeated values of one part with a known true value.

    Raises
    ------
    ValueError : fewer than two values
    """
    x = np.asarray(values, dtype=float)
    n = len(x)
    if n < 2:
        raise ValueError("a bias needs two values or more")
    bias, sigma = float(x.mean() - reference), float(x.std(ddof=1))
    half = float(special.stdtrit(n - 1, (1 + CONFIDENCE) / 2)) * sigma / float(np.sqrt(n))
    return Bias(n, bias, bias - half, bias + half, sigma)
