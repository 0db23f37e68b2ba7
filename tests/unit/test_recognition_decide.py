"""From evidence to an answer: what may never happen, whatever the weights are."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cad_solids import box, solid_of
from fitting_bodies import body, disturbed, model, solid
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from table_pictures import overhead, resting

from controller.recognition import Hypothesis
from controller.recognition.fitting import (
    EdgeFit,
    EdgeModel,
    Evidence,
    Gaps,
    ModelEdgePoints,
    edge_model,
    predict_edges,
    predict_outline,
)
from controller.recognition.identification.decide import decide, is_convincing, looks_same
from controller.recognition.identification.hypotheses import (
    SAME_TURN_RAD,
    distinct,
    without_repeats,
)
from controller.recognition.identification.scores import (
    FRONT,
    SILHOUETTE,
    Weights,
    log_odds,
    log_odds_of_all,
    probability,
)
from controller.recognition.library import Candidate, is_same_turn

Array = NDArray[np.float64]
CAMERA = overhead()
HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])

shares = st.floats(0.0, 1.0)


def evidences() -> st.SearchStrategy[Evidence]:
    return st.builds(
        Evidence,
        outline=shares,
        explained=shares,
        inner=shares,
        inner_mm=st.floats(0, 500),
        inner_explained=shares,
        image_mm=st.floats(0, 500),
        sigma_px=st.floats(0.02, 2.0),
        misfit_px=st.floats(0.0, 2.5),
        outline_mm=st.floats(10, 800),
        shading=shares,
        residual=st.floats(0, 2000),
        area_mm2=st.floats(0, 5000),
        image_px=st.floats(0, 4000),
    )


BETTER = [
    ("outline", 1.0),
    ("explained", 1.0),
    ("inner", 1.0),
    ("inner_explained", 1.0),
    ("shading", 1.0),
    ("sigma_px", 0.0),
    ("misfit_px", 0.0),
    ("residual", 0.0),
]


def improved(evidence: Evidence, field: str, limit: float, share: float) -> Evidence:
    """Evidence with one of its parts nearer to what it is for a perfect hypothesis."""
    now = getattr(evidence, field)
    return replace(evidence, **{field: now + share * (limit - now)})


# --- scores -------------------------------------------------------------------------------------


@pytest.mark.parametrize("weights", [SILHOUETTE, FRONT])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(evidence=evidences(), which=st.sampled_from(BETTER), share=shares)
def test_better_evidence_never_makes_a_reading_less_likely(
    weights: Weights, evidence: Evidence, which: tuple[str, float], share: float
) -> None:
    better = improved(evidence, *which, share)
    assert 0.0 <= probability(evidence, weights) <= 1.0
    assert probability(better, weights) >= probability(evidence, weights) - 1e-12


@pytest.mark.parametrize("is_lit", [True, False])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(evidence=evidences(), which=st.sampled_from(BETTER), share=shares)
def test_better_evidence_never_speaks_against_a_reading_beside_others(
    is_lit: bool, evidence: Evidence, which: tuple[str, float], share: float
) -> None:
    better = improved(evidence, *which, share)
    assert log_odds(better, is_lit=is_lit) >= log_odds(evidence, is_lit=is_lit) - 1e-9


PERFECT = Evidence(
    1.0, 1.0, 1.0, 150.0, 1.0, 150.0, 0.05, 0.05, 220.0, 0.9, 5.0, 2000.0, 0.0, 600.0
)
NOTHING = Evidence(
    0.2, 0.2, 0.1, 150.0, 0.1, 150.0, 1.5, 2.4, 220.0, 0.1, 900.0, 2000.0, 0.0, 600.0
)


@pytest.mark.parametrize("weights", [SILHOUETTE, FRONT])
def test_a_perfect_reading_is_believed_and_a_hopeless_one_is_not(weights: Weights) -> None:
    assert probability(PERFECT, weights) > 0.95
    assert probability(NOTHING, weights) < 0.05


def test_half_an_outline_is_not_enough_whatever_else_is_right() -> None:
    # what is not found counts as 2.5 px off: half of it makes a root mean square of 1.8
    half = replace(PERFECT, outline=0.5, misfit_px=2.5 * np.sqrt(0.5))
    assert probability(half, SILHOUETTE) < 0.5
    assert probability(replace(PERFECT, explained=0.5), SILHOUETTE) < 0.5


def test_edges_that_are_found_by_chance_speak_for_nothing() -> None:
    # two thirds of the edges are there, but so are two thirds of any others; or of hardly any
    found = replace(PERFECT, outline=0.67, inner=0.67, misfit_px=1.0, shading=0.5)
    everywhere = probability(replace(found, chance=0.67), FRONT)
    nothing_found = replace(found, outline=0.0, inner=0.0)
    assert everywhere == pytest.approx(probability(nothing_found, FRONT))
    assert everywhere < probability(replace(found, chance=0.3), FRONT) < probability(found, FRONT)
    # what is found whole is there, whatever else there is
    assert probability(replace(PERFECT, chance=0.6), FRONT) == probability(PERFECT, FRONT)


def test_half_an_outline_is_not_enough_under_lamps_either() -> None:
    # an L-shaped plate taken for its mirror image: one leg and a post on it agree, the other leg
    # is predicted where the table is and seen where nothing is predicted
    half = replace(
        PERFECT,
        outline=0.5,
        explained=0.45,
        inner=1.0,
        inner_mm=40.0,
        inner_explained=0.45,
        misfit_px=1.8,
        sigma_px=0.2,
        shading=0.2,
    )
    assert probability(half, FRONT) < 0.5


def test_an_edge_that_is_absent_means_less_in_the_dark_than_under_lamps() -> None:
    def loss(*, is_lit: bool) -> float:
        absent = replace(PERFECT, inner=0.0, inner_mm=40.0)
        there = replace(PERFECT, inner_mm=40.0)
        return log_odds(there, is_lit=is_lit) - log_odds(absent, is_lit=is_lit)

    assert loss(is_lit=True) > loss(is_lit=False) > 0


def test_what_was_not_looked_into_says_neither_yes_nor_no() -> None:
    blank = replace(PERFECT, inner=0.0, inner_mm=0.0, image_mm=0.0, area_mm2=0.0)
    for inside in (0.0, 1.0):
        told = replace(blank, inner=inside, inner_explained=inside, residual=100 * inside)
        assert log_odds(told, is_lit=True) == pytest.approx(log_odds(blank, is_lit=True))


def leads(*evidences: Evidence) -> list[float]:
    first, *others = log_odds_of_all(evidences, is_lit=True)
    return [first - other for other in others]


def test_edges_that_all_readings_predict_do_not_hide_those_that_one_of_them_lacks() -> None:
    # either has far more edges in their place than are needed to believe it by itself
    right = replace(PERFECT, inner=0.95, inner_mm=400.0)
    wrong = replace(PERFECT, inner=0.6, inner_mm=400.0, misfit_px=0.04)
    assert log_odds(right, is_lit=True) < log_odds(wrong, is_lit=True)
    assert leads(right, wrong)[0] > 6.0


def test_edges_found_no_more_often_than_by_chance_say_nothing() -> None:
    # of a rim with grain and dust on it: whatever is predicted there is found
    more = replace(PERFECT, inner_mm=300.0, chance=0.9)
    fewer = replace(PERFECT, inner_mm=200.0, chance=0.9)
    assert leads(more, fewer) == pytest.approx([0.0], abs=0.5)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(evidence=evidences(), which=st.sampled_from(BETTER), share=shares, chance=st.floats(0, 0.8))
def test_better_evidence_never_speaks_against_a_reading_among_all(
    evidence: Evidence, which: tuple[str, float], share: float, chance: float
) -> None:
    known = replace(evidence, chance=chance)
    (lead,) = leads(improved(known, *which, share), known)
    assert lead >= -1e-9


# --- two drawings -------------------------------------------------------------------------------


def lying_at(name: str, x: float = 8.0, y: float = -6.0, theta: float = 0.5) -> Array:
    return resting(solid(name), np.eye(3), x, y, theta)


def drawing(name: str, T: Array, most: int = 600) -> ModelEdgePoints:
    return predict_edges(model(name), T, CAMERA, most)


def outlined(prepared: EdgeModel, T: Array, most: int = 600) -> ModelEdgePoints:
    return predict_outline(prepared, T, CAMERA, most)


@pytest.mark.parametrize("name", ["elbow", "plate", "pocket", "hand", "nut", "stepped"])
@pytest.mark.parametrize("others", [900, 431])
def test_one_drawing_in_other_samples_is_the_same_drawing(name: str, others: int) -> None:
    T = lying_at(name)
    assert looks_same(drawing(name, T), drawing(name, T, others), outline_only=False)
    assert looks_same(drawing(name, T), drawing(name, T, others), outline_only=True)
    few, many = outlined(model(name), T, others), outlined(model(name), T)
    assert looks_same(few, many, outline_only=True)


@pytest.mark.parametrize("name", ["elbow", "plate", "pocket", "hand"])
@pytest.mark.parametrize("step", [(0.6, 0, 0), (0, -0.6, 0), (0, 0, 0.05), (0, 0, np.pi / 2)])
@pytest.mark.parametrize("outline_only", [True, False])
def test_a_drawing_shifted_or_turned_is_another(
    name: str, step: tuple[float, float, float], outline_only: bool
) -> None:
    T = lying_at(name)
    a, b = drawing(name, T), drawing(name, disturbed(name, T, *step))
    assert not looks_same(a, b, outline_only=outline_only)


def test_what_no_picture_resolves_is_the_same() -> None:
    T = lying_at("elbow")
    b = drawing("elbow", disturbed("elbow", T, 0.05, 0.05, 0.0005))
    assert looks_same(drawing("elbow", T), b, outline_only=False)


@pytest.mark.parametrize("outline_only", [True, False])
def test_a_mirror_image_is_another_drawing_at_every_turn(outline_only: bool) -> None:
    mirrored = solid_of(body("hand").mirror((1, 0, 0)), "other_hand")
    prepared = edge_model(mirrored)
    mine = drawing("hand", lying_at("hand"))
    for theta in np.arange(0, 2 * np.pi, 0.3):
        T = resting(mirrored, np.eye(3), 8.0, -6.0, theta)
        other = predict_edges(prepared, T, CAMERA, 600)
        assert not looks_same(mine, other, outline_only=outline_only)


def test_a_bore_makes_another_outline_and_a_ridge_another_drawing() -> None:
    plain = edge_model(solid_of(box(60, 40, 10), "plain"))
    T = lying_at("plate", theta=0.5)
    whole = resting(solid("plate"), np.eye(3), 8.0, -6.0, 0.5)
    assert not looks_same(outlined(model("plate"), T), outlined(plain, whole), outline_only=True)
    # a roof's ridge shows inside the outline alone: half a turn puts it on the other side
    T = lying_at("roof")
    here, turned = drawing("roof", T), drawing("roof", T @ HALF_TURN)
    assert not looks_same(here, turned, outline_only=False)


def test_a_pocket_elsewhere_makes_another_drawing() -> None:
    T = lying_at("pocket")
    here, turned = drawing("pocket", T), drawing("pocket", T @ HALF_TURN)
    assert looks_same(here, turned, outline_only=True)
    assert not looks_same(here, turned, outline_only=False)


def test_a_part_of_a_drawing_is_not_the_drawing_either_way_round() -> None:
    T = lying_at("elbow")
    whole = outlined(model("elbow"), T)
    half = replace(
        whole,
        **{
            name: getattr(whole, name)[: len(whole.pixels) // 2]
            for name in ("points_mm", "pixels", "normals", "on_outline", "lift", "jump_mm")
        },
    )
    assert not looks_same(whole, half, outline_only=True)
    assert not looks_same(half, whole, outline_only=True)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    step=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.03, 0.03)),
    names=st.tuples(*2 * [st.sampled_from(["elbow", "plate", "pocket"])]),
    outline_only=st.booleans(),
)
def test_looking_the_same_is_mutual(
    step: tuple[float, float, float], names: tuple[str, str], outline_only: bool
) -> None:
    a = drawing(names[0], lying_at(names[0]), 300)
    b = drawing(names[1], disturbed(names[1], lying_at(names[1]), *step), 300)
    assert looks_same(a, b, outline_only=outline_only) == looks_same(
        b, a, outline_only=outline_only
    )


# --- decisions ----------------------------------------------------------------------------------


def hypothesis(edges: ModelEdgePoints, T: Array, **more: Any) -> Hypothesis:
    n = len(edges.pixels)
    fit = EdgeFit(T, edges, Gaps(np.zeros(n), np.ones(n)), 0.05, np.diag([1e-4, 1e-4, 1e-6]))
    told: dict[str, Any] = {
        "part": 0,
        "pose": 0,
        "theta_rad": 0.5,
        "place_mm": np.array([8.0, -6.0]),
        "fit": fit,
        "evidence": PERFECT,
        "probability": 0.98,
        "log_odds": 40.0,
        "overlap": 0.99,
        "source": "outline",
    }
    return Hypothesis(**{**told, **more})


def pocket(turn: bool = False, **more: Any) -> Hypothesis:
    T = lying_at("pocket") @ (HALF_TURN if turn else np.eye(4))
    return hypothesis(drawing("pocket", T), T, **{"theta_rad": 0.5 + np.pi * turn, **more})


def test_nothing_proposed_is_an_unknown_object_for_sure() -> None:
    answer = decide([], is_backlit=True)
    assert (answer.best, answer.score, answer.rivals, answer.nearest) == (None, 1.0, (), None)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(p=shares)
def test_what_is_less_likely_than_two_to_one_is_no_answer(p: float) -> None:
    only = ONLY_POCKET
    told = replace(only, probability=p)
    answer = decide([told], is_backlit=True)
    assert 0.0 <= answer.score <= 1.0
    assert answer.nearest is told
    if p < 0.65:
        assert answer.best is None
        assert answer.score == pytest.approx(max(1.0 - p, 0.5))
    else:
        assert answer.best is told
        assert answer.score == pytest.approx(p)


ONLY_POCKET = pocket()


@pytest.mark.parametrize("gap", [0.0, 0.5, 2.0])
def test_look_alikes_are_each_others_rivals_and_share_the_score(gap: float) -> None:
    a, b = pocket(log_odds=40.0), pocket(turn=True, log_odds=40.0 - gap)
    one = decide([a, b], is_backlit=True)
    assert one.best is a
    assert one.rivals == (b,)
    # even odds share the score evenly; the farther apart they are, the less the second one claims
    assert 0.98 / 2 - 1e-9 <= one.score < 0.98
    assert one.score == pytest.approx(0.98 / 2) or gap > 0
    b_first = replace(b, log_odds=40.0)
    a_second = replace(a, log_odds=40.0 - gap)
    other = decide([b_first, a_second], is_backlit=True)
    assert other.best is b_first
    assert other.rivals == (a_second,)
    assert other.score == pytest.approx(one.score)


def test_lamps_tell_apart_what_an_outline_does_not() -> None:
    a, b = pocket().fit.edges, pocket(turn=True).fit.edges
    assert looks_same(a, b, outline_only=True)
    assert not looks_same(a, b, outline_only=False)


def test_what_the_picture_rules_out_is_no_rival() -> None:
    a, b = pocket(log_odds=40.0), pocket(turn=True, log_odds=30.0)
    answer = decide([a, b], is_backlit=True)
    assert answer.rivals == ()
    assert 0.9 < answer.score < 0.98
    far = decide([a, pocket(turn=True, log_odds=0.0)], is_backlit=True)
    assert far.score == pytest.approx(0.98, abs=1e-5)


def test_what_looks_different_is_a_rival_where_it_would_be_an_answer_and_is_as_likely() -> None:
    T = lying_at("elbow")
    other = hypothesis(drawing("elbow", T), T, part=1, log_odds=40.0)
    assert decide([pocket(), other], is_backlit=True).rivals == (other,)
    unlikely = replace(other, probability=0.3)
    assert decide([pocket(), unlikely], is_backlit=True).rivals == ()
    behind = replace(other, log_odds=30.0)
    assert decide([pocket(), behind], is_backlit=True).rivals == ()


def test_one_reading_that_is_surely_right_convinces() -> None:
    assert not is_convincing([])
    assert not is_convincing([pocket(probability=0.7), pocket(probability=0.85)])
    assert is_convincing([pocket(probability=0.7), pocket(probability=0.95)])


def test_what_lacks_an_edge_that_is_seen_is_no_answer_however_well_the_rest_fits() -> None:
    lacks = replace(PERFECT, unexplained_mm=130.0)
    alone = pocket(evidence=lacks)
    answer = decide([alone], is_backlit=False)
    assert (answer.best, answer.nearest) == (None, alone)
    assert answer.score >= 0.5
    assert not is_convincing([alone])
    # another that has the edge is taken, though by all else it is the less likely one
    has_it = pocket(turn=True, log_odds=30.0, probability=0.9)
    assert decide([alone, has_it], is_backlit=False).best is has_it
    scratched = pocket(evidence=replace(PERFECT, unexplained_mm=10.0))
    assert decide([scratched, has_it], is_backlit=False).best is scratched


# --- the same hypothesis twice -------------------------------------------------------------------


def library_with(turns: dict[tuple[int, int], list[float]]) -> Any:
    """What of a library tells which turns are the same."""

    def entry(part: int) -> SimpleNamespace:
        return SimpleNamespace(turns_of=lambda pose: np.array(turns[part, pose]))

    return SimpleNamespace(entries=[entry(0), entry(1)])


LIBRARY = library_with({(0, 0): [0.0], (0, 1): [0.0, np.pi], (1, 0): []})


@pytest.mark.parametrize(
    ("turns", "a", "b", "expected"),
    [
        ([0.0], 0.1, 0.12, True),
        ([0.0], 0.1, 0.3, False),
        ([0.0], 3.13, -3.13, True),
        ([0.0], 0.0, np.pi, False),
        ([0.0, np.pi], 0.0, np.pi, True),
        ([0.0, np.pi], 0.02, -np.pi, True),
        ([0.0, np.pi], 0.0, np.pi / 2, False),
        ([0.0, np.pi / 2, np.pi, -np.pi / 2], 0.3, 0.3 + 1.5 * np.pi, True),
        ([], 0.0, 1.234, True),
    ],
)
def test_turns_are_the_same_up_to_the_parts_symmetry(
    turns: list[float], a: float, b: float, expected: bool
) -> None:
    assert is_same_turn(a, b, np.array(turns), SAME_TURN_RAD) == expected
    assert is_same_turn(b, a, np.array(turns), SAME_TURN_RAD) == expected


def candidate(part: int, pose: int, theta: float, x: float = 0.0) -> Candidate:
    return Candidate(part, pose, theta, x, 0.0, 0.9, 0.1)


def test_candidates_that_a_symmetry_makes_one_are_tried_once() -> None:
    first = candidate(0, 1, 0.0)
    again = candidate(0, 1, np.pi)
    elsewhere = candidate(0, 1, 0.0, x=30.0)
    turned, over = candidate(0, 1, 1.0), candidate(0, 0, 0.0)
    listed = [first, again, elsewhere, turned, over, candidate(1, 0, 0.0), candidate(1, 0, 2.0)]
    kept = distinct(listed, LIBRARY)
    assert kept == [first, elsewhere, turned, over, listed[5]]


def test_readings_are_kept_once_and_best_first() -> None:
    worse, better = (
        pocket(log_odds=10.0, pose=1),
        pocket(log_odds=20.0, pose=1, theta_rad=0.5 + np.pi),
    )
    other = pocket(log_odds=15.0)
    aside = pocket(log_odds=5.0, pose=1, place_mm=np.array([30.0, 0.0]))
    assert without_repeats([worse, better, other, aside], LIBRARY) == [better, other, aside]
