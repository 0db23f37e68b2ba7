"""Noise in the pictures: of single corners, and of the arm's joints from stop to stop.

The noise of a corner is its own. An error of the joints moves the whole board of one picture;
counted as noise of corners it would make 40 corners of one stop look like 40 measurements. So each
picture's residuals are decorrelated: with joint noise of covariance S and derivatives J they have
the covariance sigma^2 + J S J', whose effect is undone along the singular vectors of J sqrt(S). The
size of the joints' noise follows from restricted maximum likelihood (Patterson and Thompson 1971),
as a common factor on the noise expected from the arm's maker or its counters.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray

from .layout import PictureTerms

_FACTORS: Final[tuple[float, ...]] = (0.0, *(2.0 ** (k / 2.0) for k in range(-10, 9)))
# ratio of the standard deviation to the median absolute deviation, normal noise
_MAD: Final = 1.4826
_POSE_SIZE: Final = 6


@dataclass(frozen=True, slots=True, eq=False)
class Whitening:
    """Whitening of one picture's residuals, to standard deviation 1.

    Attributes
    ----------
    weights : (2 n,) weights of each coordinate, 0 for an outlier
    along : (2 n, 6) directions in which the joints move the corners, orthonormal
    spread : (6,) spread over that of noise, as a ratio of standard deviations
    """

    weights: FloatArray
    along: FloatArray | None = None
    spread: FloatArray | None = None

    def apply(self, values: FloatArray) -> FloatArray:
        """Return residuals (2 n,) or derivatives (2 n, m), decorrelated."""
        weighted = values * (self.weights if values.ndim == 1 else self.weights[:, None])
        if self.along is None or self.spread is None:
            return weighted
        shrunk = 1.0 - 1.0 / np.hypot(1.0, self.spread)
        inside = self.along.T @ weighted
        out: FloatArray = weighted - self.along @ (
            shrunk * inside if values.ndim == 1 else shrunk[:, None] * inside
        )
        return out

    @property
    def log_det(self) -> float:
        """Logarithm of the determinant of the covariance, without that of the weights."""
        return 0.0 if self.spread is None else float(np.log1p(self.spread**2).sum())


def whitening(
    terms: PictureTerms, used: BoolArray, noise_px: float, joint_std: FloatArray
) -> Whitening:
    """Return the whitening matrix of one picture.

    Parameters
    ----------
    terms : terms of the picture
    used : (n,) corners that are no outliers
    noise_px : standard deviation of a corner's u or v
    joint_std : (6,) standard deviations of the joints from stop to stop
    """
    weights = np.repeat(used, 2) / noise_px
    if terms.by_joints is None or not joint_std.any():
        return Whitening(weights)
    by = terms.by_joints.reshape(-1, 6) * joint_std * weights[:, None]
    along, spread, _ = np.linalg.svd(by, full_matrices=False)
    return Whitening(weights, along, spread)


def within_picture(terms: PictureTerms, used: BoolArray) -> FloatArray:
    """Return the part of a picture's residuals (n, 2) that no pose of its board explains."""
    by = terms.by_board.reshape(-1, _POSE_SIZE)
    keep = np.repeat(used, 2)
    step, *_ = np.linalg.lstsq(by[keep], terms.residual_px.ravel()[keep], rcond=None)
    out: FloatArray = terms.residual_px - (by @ step).reshape(-1, 2)
    return out


def corner_noise_px(terms: Sequence[PictureTerms], used: Sequence[BoolArray]) -> float:
    """Return the standard deviation of a corner's u or v, by the boards' own stiffness alone."""
    left = [within_picture(t, u)[u].ravel() for t, u in zip(terms, used, strict=True)]
    total = sum(len(part) for part in left)
    freedom = total - _POSE_SIZE * len(left)
    everything = np.concatenate(left)
    robust = _MAD * float(np.median(np.abs(everything - np.median(everything))))
    return robust * float(np.sqrt(total / max(1, freedom)))


def in_line(terms: PictureTerms, used: BoolArray, noise_px: float, limit_sigma: float) -> BoolArray:
    """Return which corners (n,) agree with their own board.

    Each corner is compared with the pose from all corners of the picture, so that a picture which
    contradicts the cell as a whole keeps its corners.

    Parameters
    ----------
    terms : terms of the picture
    used : (n,) corners that the pose is fitted to
    noise_px : standard deviation of a corner's u or v
    limit_sigma : distance beyond which a point is an outlier
    """
    off = np.linalg.norm(within_picture(terms, used), axis=1)
    return np.asarray(off < limit_sigma * noise_px)


def joint_factor(
    terms: Sequence[PictureTerms],
    used: Sequence[BoolArray],
    noise_px: float,
    joint_std: FloatArray,
    prior_std: FloatArray,
    x: FloatArray,
) -> float:
    """Return the likeliest common factor of the joints' noise.

    Parameters
    ----------
    terms, used : of all pictures, at unknowns x near the solution
    noise_px : noise of a corner
    joint_std : (6,) expected
    prior_std : (m,) prior standard deviation of the unknowns
    x : (m,) the unknowns
    """

    def cost(factor: float) -> float:
        normal, pull = np.diag(prior_std**-2.0), x / prior_std**2
        misfit, log_det = float(np.sum((x / prior_std) ** 2)), 0.0
        for one, keep in zip(terms, used, strict=True):
            white = whitening(one, keep, noise_px, factor * joint_std)
            r = white.apply(one.residual_px.ravel())
            by = white.apply(one.by_unknowns.reshape(len(r), -1))
            normal[np.ix_(one.columns, one.columns)] += by.T @ by
            pull[one.columns] += by.T @ r
            misfit += float(r @ r)
            log_det += white.log_det
        scaled = normal * np.outer(prior_std, prior_std)
        misfit -= float(pull @ (prior_std * np.linalg.solve(scaled, prior_std * pull)))
        return float(misfit + log_det + np.linalg.slogdet(scaled)[1])

    return min(_FACTORS, key=cost)
