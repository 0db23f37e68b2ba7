"""Choose the distortion terms supported by the views (Bayesian information criterion)."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray
from messages import key

from ._types import PARAMETERS, CalibrationError, View, WorldFrame
from .solve import CalibrationFit, solve
from .uncertainty import Spread

PINHOLE: Final = ("fx", "fy", "cx", "cy")
# From the simplest lens up: radial terms in their order, with or without tangential terms.
_LENSES: Final = tuple(
    tuple(name for name in PARAMETERS if name in (*PINHOLE, *radial, *tangential))
    for radial in ((), ("k1",), ("k1", "k2"), ("k1", "k2", "k3"))
    for tangential in ((), ("p1", "p2"))
)
# The least slope of the radius in the picture by the ray's; a smaller one folds the picture over.
_SLOPE_MIN: Final = 0.2


def likeliest(
    views: Sequence[View],
    everything: CalibrationFit,
    loose: Spread,
    size_px: tuple[int, int],
    world: WorldFrame,
    weights: Sequence[FloatArray],
) -> CalibrationFit:
    """Return the fit of the lens with the least Bayesian information criterion.

    The cost of holding terms at 0 follows from the fit with all of them free: it is the squared
    length of their values in their own covariance. A lens that folds the picture over towards its
    corners is excluded, however well it fits near the boards.

    Parameters
    ----------
    views : boards found, one for each picture
    everything, loose : the fit with all PARAMETERS free, and its spread
    size_px : (width, height) size of the pictures
    world : flat view that fixes the world's frame
    weights : (n,) weight of each view, one over the standard deviation of a corner; 0 leaves it out

    Raises
    ------
    CalibrationError : every lens folds
    """
    count = int((np.abs(everything.jac).max(axis=1) > 0).sum())
    values = everything.solution.intrinsics

    def criterion(lens: tuple[str, ...]) -> float:
        held = [i for i, name in enumerate(PARAMETERS) if name not in lens]
        cov = loose.noise_cov[np.ix_(held, held)] / loose.noise**2
        cost = everything.cost + float(values[held] @ np.linalg.solve(cov, values[held]))
        return count * float(np.log(cost / count)) + len(lens) * float(np.log(count))

    for lens in sorted(_LENSES, key=criterion):
        fit = solve(views, everything.solution, lens, world, weights)
        if _reaches_the_corners(fit.solution.intrinsics, size_px):
            return fit
    raise CalibrationError(
        key(
            "no lens agrees with these boards; check `inner_corners` or `squares`, and that "
            "focus and zoom were left alone"
        )
    )


def _reaches_the_corners(intrinsics: FloatArray, size_px: tuple[int, int]) -> bool:
    """Return whether radii keep their order, out to the picture's furthest corner."""
    fx, fy, cx, cy, k1, k2, _, _, k3 = intrinsics
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)]) * size_px
    furthest = np.linalg.norm((corners - (cx, cy)) / (fx, fy), axis=1).max()
    r = np.linspace(0, 3 * furthest, 600)
    bent = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)
    turns = np.flatnonzero(np.diff(bent) < _SLOPE_MIN * (r[1] - r[0]))
    return bool(bent[turns[0] if len(turns) else -1] > furthest)
