"""Separation of each pair of hypotheses by each reachable view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, RayCaster, Roi

from ..model import LIGHTS, CellLayout, HeldHypothesis, Light
from ..motion import Scene, tcp_pose
from ._difference import difference
from ._pictures import (
    EdgePicture,
    Stance,
    outer_points,
    predict,
    region_of,
    see_boxes,
    stance_of,
)
from ._rules import DisambiguationRules

HOPEFUL = 0.5  # share of the margin needed that a thinned picture must show
DOUBTED = 2.0  # factor by which the finer grid may reduce a thinned picture's margin
# Rate at which a view fails to decide, over its margin. With just enough pixels it fails about
# every other time, with twice as many every fourth; then another view must follow.
FAILS = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Separations:
    """Separation of each pair by each view, which is an arm configuration and a light.

    Attributes
    ----------
    pairs : (i, j) hypotheses, i < j
    margins : (k, 2, p) pixels that differ at least, however the part sits in the arm gripper, over
        the pixels it takes; 1 and more tells them apart. Per configuration, light (`LIGHTS`), pair
    is_fine : (k,) looked at on the finer grid; what is not decides nothing and counts 0
    """

    pairs: tuple[tuple[int, int], ...]
    margins: FloatArray
    is_fine: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class PredictedPictures:
    """Predicted pictures of all hypotheses in one view, on one grid, and the possible offset."""

    roi: Roi
    pictures: tuple[EdgePicture, ...]
    stance: Stance


@dataclass(frozen=True, slots=True, eq=False)
class HypothesisModel:
    """Model that predicts pictures of a hypothesis: a caster of its mesh, its outer points."""

    caster: RayCaster
    outer_mm: FloatArray


def model_of(hypothesis: HeldHypothesis) -> HypothesisModel:
    """Return the model by which pictures of a hypothesis are predicted."""
    return HypothesisModel(RayCaster(hypothesis.solid.mesh), outer_points(hypothesis.solid))


def predict_view(
    hypotheses: Sequence[HeldHypothesis],
    models: Sequence[HypothesisModel],
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
    step_px: int,
    rules: DisambiguationRules,
    camera: Camera | None = None,
) -> PredictedPictures | None:
    """Return the pictures of all hypotheses in one configuration (6,), None if out of sight.

    Parameters
    ----------
    hypotheses : hypotheses of the part in the gripper
    models : of `model_of`, one per hypothesis
    layout : the cell
    q : (6,) row of joints
    opening_mm : opening of the arm gripper that holds it
    step_px : distance of the grid's pixels
    rules : uncertainty of the grasp, and which edges are visible
    camera : the inspection camera unless given
    """
    camera = camera or layout.inspection
    T_tcp = tcp_pose(layout, q)
    T_parts = [T_tcp @ c.T_tcp_part for c in hypotheses]
    outer = [m.outer_mm for m in models]
    # how far one picture may be moved over the other, and some more
    coarse = stance_of(outer, T_parts, T_tcp, camera, (0, 0, 1, 1), rules)
    roi = region_of(outer, T_parts, camera, int(coarse.shift_px + 3 * coarse.tolerance_px) + 8)
    if roi is None:
        return None
    stance = stance_of(outer, T_parts, T_tcp, camera, roi, rules)
    arm_gripper = see_boxes(Scene(layout, opening_mm, 0.0).arm_boxes(q), camera, roi, step_px)
    pictures = tuple(
        predict(c.solid, m.caster, T, camera, roi, step_px, arm_gripper, rules)
        for c, m, T in zip(hypotheses, models, T_parts, strict=True)
    )
    return PredictedPictures(roi, pictures, stance)


def separations(
    hypotheses: Sequence[HeldHypothesis],
    layout: CellLayout,
    q: FloatArray,
    seconds: FloatArray,
    opening_mm: float,
    rules: DisambiguationRules | None = None,
) -> Separations:
    """Return the separation of the hypotheses in each of some configurations (k, 6).

    The gripper holds whichever it is. They are looked at in thinned pictures, the cheapest ones
    first, until a dearer one cannot begin a cheaper tree; the cheapest and the clearest of each
    pair again on a finer grid.

    Parameters
    ----------
    hypotheses : hypotheses of the part in the gripper
    layout : the cell
    q : reachable and free of contact for every hypothesis
    seconds : (k,) cost of each
    opening_mm : distance between the inner sides of the fingers, the same for all
    rules : uncertainty of the grasp, and the minimum difference; None for the defaults
    """
    rules = rules or DisambiguationRules()
    pairs = tuple(combinations(range(len(hypotheses)), 2))
    models = [model_of(c) for c in hypotheses]
    margins = np.zeros((len(q), len(LIGHTS), len(pairs)))
    is_fine = np.zeros(len(q), dtype=bool)
    looked = np.arange(len(q))
    if len(q) > rules.max_view_count:
        looked = np.unique(np.linspace(0, len(q) - 1, rules.max_view_count).round().astype(int))
    enough_s = np.inf  # what one view that separates all of them costs
    for k in looked[np.argsort(seconds[looked], kind="stable")]:
        if seconds[k] >= enough_s:
            break  # no dearer view can begin a cheaper tree
        margins[k] = _margins(
            hypotheses, models, layout, q[k], opening_mm, pairs, rules.coarse_px, rules
        )
        weakest = np.array([margins[k].min(axis=1).max(initial=0.0) / DOUBTED])
        if weakest[0] >= 1.0:
            enough_s = min(enough_s, float(cost_s(seconds[k : k + 1], weakest)[0]))
    again: list[int] = []
    for pair in range(len(pairs)):
        for light in range(len(LIGHTS)):
            column = margins[:, light, pair]
            (hopeful,) = np.nonzero(column > HOPEFUL)
            cost = cost_s(seconds[hopeful], column[hopeful])
            again += hopeful[np.argsort(cost, kind="stable")[: rules.fine_count]].tolist()
            again += hopeful[
                np.argsort(-column[hopeful], kind="stable")[: rules.fine_count]
            ].tolist()
    for k in looked[np.isin(looked, again)]:
        margins[k] = _margins(
            hypotheses, models, layout, q[k], opening_mm, pairs, rules.fine_px, rules
        )
        is_fine[k] = True
    margins[~is_fine] = np.minimum(margins[~is_fine], 0.0)  # thinned pictures decide nothing
    return Separations(pairs, margins, is_fine)


def _margins(
    hypotheses: Sequence[HeldHypothesis],
    models: Sequence[HypothesisModel],
    layout: CellLayout,
    q: FloatArray,
    opening_mm: float,
    pairs: Sequence[tuple[int, int]],
    step_px: int,
    rules: DisambiguationRules,
) -> FloatArray:
    """Return the margins of one configuration (lights, pairs)."""
    found = np.zeros((len(LIGHTS), len(pairs)))
    view = predict_view(hypotheses, models, layout, q, opening_mm, step_px, rules)
    if view is None:
        return found
    for p, (i, j) in enumerate(pairs):
        for row, light in enumerate(LIGHTS):
            pixels = difference(view.pictures[i], view.pictures[j], view.stance, light)
            found[row, p] = pixels / needed_px(light, rules)
    return found


def cost_s(seconds: FloatArray, margin: FloatArray) -> FloatArray:
    """Return the expected cost of views (n,) [s], with the chance that one more must follow."""
    return np.asarray(seconds * (1.0 + FAILS / margin))


def needed_px(light: Light, rules: DisambiguationRules) -> float:
    """Return the difference between two hypotheses under a light [px]."""
    return rules.min_area_px if light == "backlight" else rules.min_edge_px
