"""Logistic curves over evidence, fitted to hypotheses known to be right or wrong.

Knows the weights and the evidence of controller/recognition, and no pictures.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from controller.recognition.fitting import Evidence  # noqa: E402
from controller.recognition.identification.scores import (  # noqa: E402  (path set above)
    INNER_HALF_MM,
    Weights,
    beyond_chance,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

WORSE_PX = 0.25  # misfit by which a wrong one is clearly worse; nearer ones may look the same
NEXT = 3  # hypotheses after the best among which the right one may have been
RIDGE = 0.005  # on the summed loss: keeps weights finite where right and wrong do not mix

# what may count, and which way: more of it makes a hypothesis likelier, or less likely
SIGNS = {
    "outline": 1,
    "explained": 1,
    "inner": 1,
    "misfit": -1,
    "sigma": -1,
    "shading": 1,
    "length": 1,
}
# an outline that is known whole is judged without what lies inside it
COUNTS = {"back": ("outline", "explained", "misfit", "sigma"), "front": tuple(SIGNS)}


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """A hypothesis of an object, compared with what truly lay there.

    Attributes
    ----------
    is_turned : right but for its turn about the vertical
    """

    evidence: Evidence
    is_right: bool
    is_turned: bool


@dataclass(frozen=True, eq=False, slots=True)
class Seen:
    """An object that was found, and its hypotheses.

    Attributes
    ----------
    what : for people
    mode : "back" or "front"
    is_known : it is one of the library's; neither a stranger nor nothing at all
    compared : best first
    rivals : those of them that the picture cannot tell from the best; they share its score
    """

    what: str
    mode: str
    is_known: bool
    compared: tuple[Compared, ...]
    rivals: tuple[Compared, ...]

    @property
    def is_misordered(self) -> bool:
        """Say whether the best hypothesis is wrong and one of the next ones right."""
        rest = self.compared[1 : 1 + NEXT]
        return not self.compared[0].is_right and any(r.is_right for r in rest)


def terms(evidence: Evidence) -> Array:
    """Return what the weights after the bias multiply, in the order of `SIGNS`, (7,)."""
    share = evidence.inner_mm / (evidence.inner_mm + INNER_HALF_MM)
    outline = beyond_chance(evidence.outline, evidence.chance)
    inner = share * beyond_chance(evidence.inner, evidence.chance) + (1 - share) * outline
    values = (outline, evidence.explained, inner, evidence.misfit_px, evidence.sigma_px)
    return np.array([*values, evidence.shading, np.log1p(evidence.image_px)])


def fit_curve(evidence: Array, is_right: Bools, signs: Array, ridge: float = RIDGE) -> Array:
    """Return bias and weights (1 + k,) of the logistic curve likeliest to have given these.

    Parameters
    ----------
    evidence : (n, k) of k kinds
    is_right : (n,)
    signs : (k,) 1 for weights that are not negative, -1 for those not positive
    ridge : weight of the squared weights, each over the spread of its evidence

    Raises
    ------
    ValueError : all are right, or none is
    """
    if is_right.all() or not is_right.any():
        raise ValueError(f"a curve takes both: {is_right.sum()} of {len(is_right)} are right")
    middle, spread = evidence.mean(axis=0), np.maximum(evidence.std(axis=0), 1e-6)
    scaled = np.column_stack([np.ones(len(evidence)), (evidence - middle) / spread])
    y = is_right.astype(np.float64)

    def loss(w: Array) -> tuple[float, Array]:
        z, shrunk = scaled @ w, np.concatenate([[0.0], w[1:]])
        value = (np.logaddexp(0, z) - y * z).sum() + ridge * (shrunk**2).sum()
        slope = scaled.T @ (expit(z) - y) + 2 * ridge * shrunk
        return float(value) / len(y), slope / len(y)

    bounds = [(None, None), *((0, None) if s > 0 else (None, 0) for s in signs)]
    exact = {"maxiter": 5000, "ftol": 1e-13, "gtol": 1e-8}
    start = np.zeros(scaled.shape[1])
    found = minimize(loss, start, jac=True, bounds=bounds, method="L-BFGS-B", options=exact)
    weights = found.x[1:] / spread
    return np.concatenate([[found.x[0] - weights @ middle], weights])


def rescaled(curve: Array, evidence: Array, is_right: Bools) -> Array:
    """Return a curve with the offset and slope that fit these best (Platt's scaling)."""
    logits = curve[0] + evidence @ curve[1:]
    offset, slope = fit_curve(logits[:, None], is_right, np.ones(1))
    return np.concatenate([[slope * curve[0] + offset], slope * curve[1:]])


def examples(seen: Sequence[Seen]) -> tuple[Array, Bools, Bools]:
    """Return evidence (n, 7), whether it is right (n,) and whether it is a best one (n,)."""
    chosen: list[tuple[Compared, bool]] = []
    for one in seen:
        best = one.compared[0]
        if not one.is_misordered:
            chosen.append((best, True))
        for other in one.compared[1:]:
            is_worse = other.evidence.misfit_px >= best.evidence.misfit_px + WORSE_PX
            if not one.is_known or (is_worse and not other.is_right):
                chosen.append((other, False))
    evidence = np.array([terms(one.evidence) for one, _ in chosen]).reshape(-1, len(SIGNS))
    is_right = np.array([one.is_right for one, _ in chosen], dtype=np.bool_)
    return evidence, is_right, np.array([is_best for _, is_best in chosen], dtype=np.bool_)


def fitted(seen: Sequence[Seen], mode: str) -> Weights:
    """Return the weights that objects in one kind of light ask for.

    Raises
    ------
    ValueError : none of them is right, or none wrong
    """
    evidence, is_right, is_best = examples(seen)
    counts = COUNTS[mode]
    columns = [list(SIGNS).index(name) for name in counts]
    evidence = evidence[:, columns]
    curve = fit_curve(evidence, is_right, np.array([SIGNS[name] for name in counts]))
    curve = rescaled(curve, evidence[is_best], is_right[is_best])
    given = dict(zip(counts, curve[1:].tolist(), strict=True))
    return Weights(bias=float(curve[0]), **{name: given.get(name, 0.0) for name in SIGNS})


def pasted(weights: Weights) -> str:
    """Return weights as they stand in the source."""
    values = (round(getattr(weights, f.name), 2) + 0.0 for f in fields(weights))
    return f"Weights({', '.join(map(str, values))})"
