"""A lit picture against the bounds of its light: where it was compared, and where it differs.

The picture's own gain, its highlight's strength and width are not known; every choice of them that
fits the picture about as well as the best one widens the bounds. So does the scatter of the finish,
face by face. What is then known too badly for a defect to stand out is not compared, and says why.
"""

from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, Int32Array
from controller.cad import Face

from .._types import InspectionLimits, Unjudged
from .light import Light, Surface

STRENGTHS: Final = (0.0, 0.1, 0.2, 0.3, 0.45, 0.7, 1.0)  # of a highlight, in lit matt surfaces
AS_GOOD: Final = 1.2  # a model whose residual is this many times the least may be the true one
AS_GOOD_GREY: Final = 0.7  # and this much more: noise alone makes it
WORST_RESIDUAL: Final = 0.12  # of the brightness: the best model explains the picture no better
FITTED_LIGHT: Final = 0.25  # less light than that fixes no gain
FITTED_COUNT: Final = 150
FIT_SAMPLE: Final = 4000
# how much brighter or darker than the picture's model a face may be as a whole: what lamps' beams,
# lens and the direction of a finish are known to make; more is another surface, or another finish
FACE_PLAY: Final = 0.2
FACE_COUNT: Final = 60
MIN_PLAY: Final = 0.16  # of the brightness, that no finish falls below
SCATTERS: Final = 4.0
HALF: Final = 0.5  # what is found: half as bright as predicted, or
TWICE: Final = 2.0
UNLIT_GREY: Final = 25.0
PENUMBRA_SHARE: Final = 0.25
BURNT_GREY: Final = 252


@dataclass(frozen=True, eq=False, slots=True)
class Compared:
    """A lit picture compared on a grid; (h, w) each.

    Attributes
    ----------
    wrong : brighter or darker than anything predicted
    compared : where a defect would stand out
    reason : elsewhere on the part why not, as number of `Unjudged` from 1, else 0
    misfit : see `Check`
    """

    wrong: BoolArray
    compared: BoolArray
    reason: NDArray[np.uint8]
    misfit: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class _Model:
    """One gain and highlight that may be true."""

    gain: float
    strength: float
    width: int


def compare(
    observed: Float32Array,
    surface: Surface,
    light: Light,
    inside: BoolArray,
    valid: BoolArray,
    ground: float,
    faces: tuple[Face, ...],
    limits: InspectionLimits,
    flattest: float,
) -> Compared | str:
    """Return a lit picture compared with its prediction, or why it fails a self-check.

    Parameters
    ----------
    observed : (h, w) grey, hardly smoothed
    surface : what the pixels see of the part
    light : bounds of the lamp's light on it
    inside : within the part's outer outline, its border left out
    valid : not beside the gripper, nor in its shadow
    ground : how bright the wall behind the part is
    faces : of the part, as the surface numbers them
    limits : what has to agree
    flattest : least cosine at which a surface is compared
    """
    seen = surface.seen
    shape_known = np.array([f.kind != "freeform" for f in faces] + [False])[surface.face]
    settled = (light.most - light.least < PENUMBRA_SHARE * light.open) & (light.bounce < 0.15)
    fitting = seen & inside & valid & shape_known & settled & (light.least > FITTED_LIGHT)
    fitting &= surface.cosine > flattest
    if fitting.sum() < FITTED_COUNT:
        # nothing that this lamp is known to light is in sight: nothing is compared, nothing found
        return _nothing(surface, light)
    if float((observed[fitting] >= BURNT_GREY).mean()) > limits.max_burnt_share:
        return "it is burnt out: a shorter exposure or a darker lamp is needed"
    models = _fit(observed, light, fitting)
    best = models[0]
    if best.gain * (1 + best.strength) < limits.min_contrast / 2:
        return "it gives no light: is the lamp on?"
    middle = _predicted(best, light)
    residual = observed[fitting] / np.maximum(middle[fitting], 1.0)
    spread = np.abs(residual - np.median(residual))
    worst, misfit = float(np.median(spread)), float(np.quantile(spread, 0.9))
    if worst > WORST_RESIDUAL:
        return (
            f"brightness scatters by {100 * worst:.0f} % about the prediction, "
            f"{100 * WORST_RESIDUAL:.0f} % is allowed: not this lamp, or not this finish"
        )
    tone, scatter, odd = _faces(observed, middle, surface.face, fitting, len(faces))
    low, high = middle.copy(), middle.copy()
    for model in models:
        bottom, top = _bounds(model, light)
        low, high = np.minimum(low, bottom), np.maximum(high, top)
    bounce = np.float32(best.gain) * light.bounce
    middle, low, high = middle * tone, low * tone, high * tone + bounce
    weighed = _weigh(
        observed, surface, light, inside, valid, ground, limits,
        middle, low, high, bounce, scatter, odd, shape_known, flattest,
    )  # fmt: skip
    return replace(weighed, misfit=misfit)


def _nothing(surface: Surface, light: Light) -> Compared:
    none = np.zeros(surface.seen.shape, dtype=bool)
    reason = np.where(surface.seen, Unjudged.UNLIT.number, 0).astype(np.uint8)
    return Compared(none, none.copy(), reason)


def _predicted(model: _Model, light: Light) -> Float32Array:
    dim, bright = light.glints[model.width]
    matt = 0.5 * (light.least + light.most)
    return np.asarray(model.gain * (matt + model.strength * 0.5 * (dim + bright)), np.float32)


def _bounds(model: _Model, light: Light) -> tuple[Float32Array, Float32Array]:
    dim, bright = light.glints[model.width]
    low = model.gain * (light.least + model.strength * dim)
    high = model.gain * (light.most + model.strength * bright)
    return np.asarray(low, np.float32), np.asarray(high, np.float32)


def _fit(observed: Float32Array, light: Light, fitting: BoolArray) -> list[_Model]:
    """Return the models that may be true, best first: the scatter about them is about the least."""
    index = np.flatnonzero(fitting)
    index = index[:: max(1, len(index) // FIT_SAMPLE)]
    values = observed.ravel()[index]
    matt = 0.5 * (light.least + light.most).ravel()[index]
    tried: list[tuple[float, _Model]] = []
    for width, (dim, bright) in enumerate(light.glints):
        glint = 0.5 * (dim.ravel()[index] + bright.ravel()[index])
        for strength in STRENGTHS:
            if width and not strength:
                continue
            unit = matt + np.float32(strength) * glint
            gain = float(np.median(values / unit))
            off = np.abs(values - gain * unit)
            # half of all is explained by any model: what the rest says tells them apart
            residual = float(np.quantile(off, 0.75))
            tried.append((residual, _Model(gain, strength, width)))
    tried.sort(key=lambda item: item[0])
    limit = AS_GOOD * tried[0][0] + AS_GOOD_GREY
    return [model for residual, model in tried if residual <= limit]


def _faces(
    observed: Float32Array,
    middle: Float32Array,
    face: Int32Array,
    fitting: BoolArray,
    count: int,
) -> tuple[Float32Array, Float32Array, BoolArray]:
    """Return per pixel its face's own tone, its scatter, and whether the tone is out of bounds."""
    tone = np.ones(count + 1, dtype=np.float32)
    scatter = np.full(count + 1, MIN_PLAY / SCATTERS, dtype=np.float32)
    odd = np.zeros(count + 1, dtype=bool)
    ratio = observed / np.maximum(middle, 1.0)
    mine_all = face[fitting]
    ratios = ratio[fitting]
    order = np.argsort(mine_all, kind="stable")
    ids, begins = np.unique(mine_all[order], return_index=True)
    for i, values in zip(ids.tolist(), np.split(ratios[order], begins[1:]), strict=True):
        if len(values) < FACE_COUNT:
            scatter[i] = max(scatter[i], FACE_PLAY / 2)
            continue
        here = float(np.median(values))
        odd[i] = not 1 / (1 + FACE_PLAY) <= here <= 1 + FACE_PLAY
        tone[i] = np.clip(here, 1 / (1 + FACE_PLAY), 1 + FACE_PLAY)
        scatter[i] = max(scatter[i], 1.4826 * float(np.median(np.abs(values - here))) / here)
    # a face too little of which fixes its tone may have any that a face may have
    known = np.zeros(count + 1, dtype=bool)
    known[ids] = True
    scatter[~known] = np.maximum(scatter[~known], FACE_PLAY / 2)
    return tone[face], scatter[face], odd[face]


def _weigh(
    observed: Float32Array,
    surface: Surface,
    light: Light,
    inside: BoolArray,
    valid: BoolArray,
    ground: float,
    limits: InspectionLimits,
    middle: Float32Array,
    low: Float32Array,
    high: Float32Array,
    bounce: Float32Array,
    scatter: Float32Array,
    odd: BoolArray,
    shape_known: BoolArray,
    flattest: float,
) -> Compared:
    seen = surface.seen
    kernel = np.ones((3, 3), np.uint8)
    # the pose may be off by a node: what lies beside a pixel may lie in it
    brightest = cv2.dilate(np.where(seen, high, np.float32(ground)).astype(np.float32), kernel)
    darkest = cv2.erode(np.where(seen, low, np.float32(0)).astype(np.float32), kernel)
    share = np.maximum(np.float32(SCATTERS) * scatter, np.float32(MIN_PLAY))
    floor = np.float32(limits.grey_levels / 2)
    top = brightest + np.maximum(share * brightest, floor)
    bottom = darkest - np.maximum(share * darkest, floor)
    # through a hole the wall behind is seen, lit or in the part's shadow
    judged = inside & valid & (shape_known | ~seen) & ~odd
    wrong = judged & ((observed > top) | (observed < bottom))
    stands_out = (bottom >= HALF * middle) & (top <= TWICE * middle)
    lit = (middle >= UNLIT_GREY) & (light.most >= 0.5 * FITTED_LIGHT)
    compared = seen & judged & lit & stands_out & (surface.cosine > flattest)
    reason = np.where(seen & ~compared, Unjudged.EDGE.number, 0).astype(np.uint8)
    pure = high - bounce
    for which, why in (
        (odd | (SCATTERS * scatter > HALF), Unjudged.ROUGH),
        (pure - low > 0.5 * middle, Unjudged.HIGHLIGHT),
        (bounce > 0.4 * middle, Unjudged.BOUNCE),
        (light.most - light.least > PENUMBRA_SHARE * light.open, Unjudged.PENUMBRA),
        (~lit, Unjudged.UNLIT),
        (surface.cosine <= flattest, Unjudged.FLAT),
        (~shape_known, Unjudged.SHAPE),
        (~valid, Unjudged.HOLDER),
    ):
        reason[seen & ~compared & which] = why.number
    return Compared(wrong, compared, reason)
