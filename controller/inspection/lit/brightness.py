"""Brightness of a part's surface under a lamp, fitted to the picture, with its error.

A finish reflects a matt share of the light, a highlight modelled as a sum of lobes, and light from
neighbouring surfaces. The shares are fitted to the whole part in one picture, robustly and with no
share below zero. The deviation of the picture from the fit is the prediction's error; it is larger
where highlights or bounced light dominate.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import nnls

from controller.arrays import BoolArray, Float32Array, FloatArray, Int32Array

from .finish import PRIOR_SHARE, Polish
from .light import Light

FIT_SAMPLE: Final = 4000
ROUNDS: Final = 6
OUTLYING: Final = 2.0  # robust standard deviations from which a node has less weight
PIECES: Final = 5  # number of independent pieces of a face, whose finish is alike all over it
STRAY_GREY: Final = 5.0  # largest stray light, in grey levels of eight bits
MIN_ERROR: Final = 0.01  # least error, as a share of the brightness
# Bins for the share of highlight and bounce in the brightness.
SHARE_BINS: Final = (0.0, 0.15, 0.4, 0.7, 1.01)
BIN_COUNT: Final = 60  # least number of nodes for a spread
UNKNOWN_SPREAD: Final = 0.35  # spread assumed where there are too few nodes
# Spread of a face whose tone no node shows, since it faces another direction.
UNSEEN_SPREAD: Final = 0.15
FACE_COUNT: Final = 60  # least number of nodes for the tone of a face
FAINT_GREY: Final = 6.0
# Gain [grey] of a matt surface square to the lamp, which a black picture has too.
MIN_GAIN: Final = 1.0
TINY: Final = 1e-9  # regularisation, so that a lamp without visible light leaves the matrix regular


@dataclass(frozen=True, eq=False, slots=True)
class Brightness:
    """Fitted light of a picture; (h, w) each, grey.

    Attributes
    ----------
    predicted : prediction with shadows and bounced light
    unshaded : prediction without shadows
    spread, spread_open : relative standard deviations of the prediction, and of `unshaded`
    tone : brightness of the node's face as a whole relative to the prediction, from its lit nodes
    misfit : share by which at least a tenth of the fitted nodes is off
    typical : median of the same
    polish : evidence on the polish of the finish
    """

    predicted: Float32Array
    unshaded: Float32Array
    spread: Float32Array
    spread_open: Float32Array
    tone: Float32Array
    misfit: float
    typical: float
    polish: Polish


def fit_brightness(
    observed: Float32Array, light: Light, fitting: BoolArray, face: Int32Array
) -> Brightness:
    """Return the brightness under a lamp, fitted to a picture.

    Parameters
    ----------
    observed : (h, w) grey
    light : bounds on the lamp's light
    fitting : (h, w) mask of nodes with well-known light, some hundred at least
    face : (h, w) face of each node, -1 for none
    """
    matt = 0.5 * (light.least + light.most)
    glints = [0.5 * (dim + bright) for dim, bright in light.glints]
    columns = np.stack([matt, *glints, light.bounced.matt, np.ones_like(matt)], axis=-1)
    index = np.flatnonzero(fitting)
    chosen = index[:: max(1, len(index) // FIT_SAMPLE)]
    count = min(PIECES * len(np.unique(face[fitting])), len(chosen))
    lights = columns.reshape(-1, columns.shape[-1])[chosen].astype(np.float64)
    b = observed.ravel()[chosen].astype(np.float64)
    shares, information, prior = _shares(lights, b, count)
    predicted = (columns @ shares.astype(np.float32)).astype(np.float32)
    half = np.linalg.cholesky(np.linalg.inv(information)).astype(np.float32)
    unsure = np.linalg.norm(columns @ half, axis=-1) / np.maximum(predicted, FAINT_GREY)
    parts = [np.float32(k) * columns[..., i] for i, k in enumerate(shares)]
    # In the open a surface has all of the lamp's light, but its highlight is no better known.
    columns[..., 0] = light.open
    unshaded = (columns @ shares.astype(np.float32)).astype(np.float32)
    unsure_open = np.linalg.norm(columns @ half, axis=-1) / np.maximum(unshaded, FAINT_GREY)
    off = np.asarray(observed / np.maximum(predicted, FAINT_GREY), np.float32)
    tone, tone_spread = _tones(off, face, fitting)
    rest = np.abs(off / tone - 1.0)
    moving = (np.sum(parts[1:-1], axis=0) / np.maximum(predicted, 1e-3)).astype(np.float32)
    known = _spread(rest, moving, fitting)
    spread, spread_open = (
        np.sqrt(known**2 + tone_spread**2 + u**2).astype(np.float32) for u in (unsure, unsure_open)
    )
    whole = np.abs(off[fitting] - np.median(off[fitting]))
    return Brightness(
        predicted, unshaded, spread, spread_open, tone,
        float(np.quantile(whole, 0.9)), float(np.median(whole)),
        _polish(shares, information, prior),
    )  # fmt: skip


def _shares(
    lights: FloatArray, b: FloatArray, count: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the shares (columns,) of light, none negative, their information matrix and prior.

    The prior is a matt surface; highlights, bounced and stray light need evidence.

    Parameters
    ----------
    lights, b : (n, columns) light and (n,) grey level of some nodes
    count : number of nodes with independent errors
    """
    scale = np.maximum(b, FAINT_GREY)
    gain = max(float(np.median(b / np.maximum(lights[:, 0], 1e-3))), MIN_GAIN)
    prior = np.full(lights.shape[1], 1.0 / gain)
    prior[0], prior[-1] = 0.0, 1.0 / STRAY_GREY
    weight = 1.0 / scale
    solution, error = np.zeros(lights.shape[1]), 1.0
    for _ in range(ROUNDS):
        weighed = lights * weight[:, None]
        pull = (PRIOR_SHARE * error * prior) ** 2 * (len(b) / count)
        # The factor of the normal matrix gives the same least squares with as many rows as columns.
        factor = np.linalg.cholesky(weighed.T @ weighed + np.diag(pull + TINY)).T
        solution, _ = nnls(factor, np.linalg.solve(factor.T, weighed.T @ (b * weight)))
        off = np.abs(b - lights @ solution) / scale
        error = max(1.4826 * float(np.median(off)), MIN_ERROR)
        weight = np.minimum(1.0, OUTLYING * error / np.maximum(off, 1e-9)) / scale
    weighed = lights * weight[:, None]
    information = weighed.T @ weighed * (count / len(b)) / error**2 + np.diag(prior**2 + TINY)
    return solution, information, prior


def _polish(shares: FloatArray, information: FloatArray, prior: FloatArray) -> Polish:
    """Return the evidence on highlights; the other shares may be anything that fits."""
    glint = np.arange(1, len(shares) - 2)
    other = np.array([0, len(shares) - 2, len(shares) - 1])
    data = information - np.diag(prior**2 + TINY)
    across = data[np.ix_(glint, other)]
    alone = data[np.ix_(glint, glint)] - across @ np.linalg.solve(
        information[np.ix_(other, other)], across.T
    )
    matt = max(float(shares[0]), TINY)
    return Polish(shares[glint] / matt, alone * matt**2)


def _tones(
    off: Float32Array, face: Int32Array, fitting: BoolArray
) -> tuple[Float32Array, Float32Array]:
    """Return the tone of each node's face, and its uncertainty (share)."""
    count = int(face.max()) + 1
    tone = np.ones(count + 1, dtype=np.float32)
    known = np.zeros(count + 1, dtype=bool)
    mine, values = face[fitting], off[fitting]
    order = np.argsort(mine, kind="stable")
    ids, begins = np.unique(mine[order], return_index=True)
    for i, some in zip(ids.tolist(), np.split(values[order], begins[1:]), strict=True):
        if len(some) >= FACE_COUNT:
            tone[i], known[i] = max(float(np.median(some)), 0.05), True
    common = float(np.median(tone[known])) if known.any() else 1.0
    between = np.abs(tone[known] / common - 1.0)
    # Of two or three faces the farthest off counts, of more the majority.
    play = float(np.quantile(between, 0.75) / 0.8) if len(between) > 1 else UNKNOWN_SPREAD
    tone[~known] = common
    spread = np.where(known, 0.0, max(play, UNSEEN_SPREAD)).astype(np.float32)
    return tone[face], spread[face]


def _spread(rest: Float32Array, moving: Float32Array, fitting: BoolArray) -> Float32Array:
    """Return the scatter of the prediction (h, w) by the share of highlight and bounce."""
    where = np.digitize(moving, SHARE_BINS[1:-1])
    by_bin = np.full(len(SHARE_BINS) - 1, UNKNOWN_SPREAD, dtype=np.float32)
    known, seen = rest[fitting], where[fitting]
    for i in range(len(by_bin)):
        some = known[seen == i]
        if len(some) >= BIN_COUNT:
            # The median ignores half of the nodes, so the wider of both measures counts.
            by_bin[i] = max(1.4826 * float(np.median(some)), float(np.quantile(some, 0.9)) / 1.645)
    return by_bin[where]
