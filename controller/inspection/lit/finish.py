"""What all pictures so far tell of a finish: how bright its highlights are, and how wide.

A finish reflects a matt share of the light, and highlights of several widths. One picture tells
little of them where its lamp is mirrored nowhere near the camera, and pictures together tell more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import FloatArray

HIGHLIGHT_WIDTHS_RAD: Final = tuple(float(np.radians(d)) for d in (5.0, 9.0, 13.0, 18.0))
# Light that a highlight of each width sends in all directions, relative to a matt surface of as
# much light in its peak: it is twice as wide as the tilt of the facets that make it.
LOBE_SR: Final = 8.0 * np.array(HIGHLIGHT_WIDTHS_RAD) ** 2
PRIOR_SHARE: Final = 1.0  # usual strength of highlights, in matt shares
ALBEDO: Final = 0.8  # largest albedo of a machined surface
SPREADS: Final = 2.0  # standard deviations that a bound has
WITHIN_ONE: Final = 0.683  # share of normal deviates within one standard deviation
MIN_KNOWN: Final = 0.05  # peaks; a picture that knows fewer says nothing of a finish


@dataclass(frozen=True, eq=False, slots=True)
class Polish:
    """Evidence of a picture on the highlights of a finish, by their width.

    Attributes
    ----------
    peaks : (k,) of highlights, in matt shares
    information : (k, k) inverse of their covariance, from the picture alone
    """

    peaks: FloatArray
    information: FloatArray


@dataclass(frozen=True, slots=True)
class Finish:
    """Highlights of a finish by their width, and how well they are known.

    Attributes
    ----------
    peaks : (k,) in matt shares
    covariance : (k, k) of them
    """

    peaks: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]

    @property
    def albedo(self) -> float:
        """The matt share of the light: what highlights leave of all that is reflected."""
        return float(ALBEDO / (1.0 + np.maximum(self.peaks, 0.0) @ LOBE_SR))

    def brightest(self, lobes: FloatArray) -> FloatArray:
        """Return the upper bound (n,) on light from highlights, in matt shares.

        Parameters
        ----------
        lobes : (k, n) light from each, of peak 1
        """
        peaks = np.maximum(self.peaks, 0.0)
        half = np.linalg.cholesky(np.array(self.covariance)).T
        return np.asarray(peaks @ lobes + SPREADS * np.linalg.norm(half @ lobes, axis=0))


def finish_of(evidence: Sequence[Polish]) -> Finish:
    """Return a finish by all pictures of a part.

    Parameters
    ----------
    evidence : of pictures; with none the finish may be anything usual
    """
    prior = np.eye(len(HIGHLIGHT_WIDTHS_RAD)) / PRIOR_SHARE**2
    told = np.sum([one.information for one in evidence], axis=0) + np.zeros_like(prior)
    heights = np.sum([one.information @ one.peaks for one in evidence], axis=0)
    peaks = np.linalg.solve(prior + told, heights + np.zeros(len(prior)))
    covariance = np.linalg.inv(prior + told / _disagreement(evidence, peaks, prior))
    return Finish(tuple(peaks.tolist()), tuple(map(tuple, covariance.tolist())))


def _disagreement(evidence: Sequence[Polish], peaks: FloatArray, prior: FloatArray) -> float:
    """Return by how much pictures disagree about a finish, as variance over what they claim.

    No highlight is a sum of bells, and no finish is the same everywhere. Of what pictures tell, two
    thirds are off by no more than that; the rest may be of a picture that its fit does not explain.

    Parameters
    ----------
    evidence : of pictures
    peaks : (k,) what all of them together tell
    prior : (k, k) information before any picture
    """
    # how many peaks each picture knows better than before, and how far off it is for one of them
    known = [np.trace(one.information @ np.linalg.inv(one.information + prior)) for one in evidence]
    off = [(one.peaks - peaks) @ one.information @ (one.peaks - peaks) for one in evidence]
    some = np.flatnonzero(np.array(known) > MIN_KNOWN)
    if len(some) < 2:
        return 1.0
    share, ratio = np.array(known)[some], np.array(off)[some] / np.array(known)[some]
    order = np.argsort(ratio)
    below = np.cumsum(share[order]) / share.sum()
    return max(float(ratio[order][np.searchsorted(below, WITHIN_ONE)]), 1.0)
