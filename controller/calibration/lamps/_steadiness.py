"""From when on a lamp is steady, by pictures taken at different times after it was switched."""

from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import say

# share of the final light; a smaller change is lost among the LEDs' losses as they warm up
STEADY_SHARE: Final = 0.02
MIN_SAMPLES: Final = 6
FINAL_SHARE: Final = 0.25  # share of the last samples that gives the final light


class TooFewSamplesError(ValueError):
    """Too few pictures to find when the light was steady."""


def seconds_to_steady(delay_s: FloatArray, light: FloatArray) -> float:
    """Return the delay after which all samples are within 2 % of the final light [s].

    Parameters
    ----------
    delay_s : (n,) from the order to the beginning of each exposure [s]
    light : (n,) mean grey level over the dark one

    Raises
    ------
    TooFewSamplesError : there are too few, or the last of them still changes
    """
    if len(delay_s) < MIN_SAMPLES:
        raise TooFewSamplesError(
            say(
                "{delay_s_count} pictures are too few to find a settling time",
                delay_s_count=len(delay_s),
            )
        )
    order = np.argsort(delay_s, kind="stable")
    delay_s, light = delay_s[order], light[order]
    last = light[-max(2, int(FINAL_SHARE * len(light))) :]
    final = float(np.median(last))
    off = np.abs(light - final) > STEADY_SHARE * abs(final)
    if off[-len(last) :].any():
        raise TooFewSamplesError(
            say(
                "the light still changes {delay_s:.2f} s after it was switched", delay_s=delay_s[-1]
            )
        )
    unsteady = np.flatnonzero(off)
    # it became steady somewhere between the last sample that was off and the next one
    return float(delay_s[unsteady[-1] + 1]) if len(unsteady) else float(delay_s[0])
