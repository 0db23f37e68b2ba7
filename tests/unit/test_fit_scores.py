"""Fitting the curves that turn evidence into probability: known curves come back."""

from __future__ import annotations

import sys
from dataclasses import astuple, fields
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import expit

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from recognition_curves import Compared, Seen, examples, fit_curve, fitted, pasted, rescaled, terms

from controller.recognition.fitting import Evidence
from controller.recognition.identification.scores import Weights, probability

Array = NDArray[np.float64]
LOW = Evidence(0.2, 0.2, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 50.0, 0.0, 1.0, 100.0, 0.0, 40.0)
HIGH = Evidence(1.0, 1.0, 1.0, 90.0, 1.0, 90.0, 0.8, 1.5, 300.0, 1.0, 60.0, 900.0, 0.5, 900.0)


def some_evidence(rng: np.random.Generator) -> Evidence:
    """Return evidence of any kind between a poor reading's and a rich one's."""
    low, high = np.array(astuple(LOW)), np.array(astuple(HIGH))
    return Evidence(*rng.uniform(low, high).tolist())


def seen(rng: np.random.Generator, weights: Weights, mode: str, count: int) -> list[Seen]:
    """Return objects with one hypothesis each, right as often as the weights say."""
    objects = []
    for _ in range(count):
        evidence = some_evidence(rng)
        is_right = bool(rng.random() < probability(evidence, weights))
        hypothesis = Compared(evidence, is_right, is_turned=False)
        objects.append(Seen("", mode, is_known=True, compared=(hypothesis,), rivals=()))
    return objects


def hypothesis(misfit_px: float, *, is_right: bool) -> Compared:
    values = dict(zip((f.name for f in fields(Evidence)), astuple(LOW), strict=True))
    return Compared(Evidence(**(values | {"misfit_px": misfit_px})), is_right, is_turned=False)


def test_terms_and_weights_make_the_probability_that_recognition_uses() -> None:
    rng = np.random.default_rng(1)
    weights = Weights(-1.0, 0.7, 1.1, -0.6, -0.9, 0.4, 1.3, 0.8)
    for _ in range(50):
        evidence = some_evidence(rng)
        z = weights.bias + terms(evidence) @ np.array(astuple(weights))[1:]
        assert probability(evidence, weights) == pytest.approx(expit(z), abs=1e-12)


def test_a_known_curve_comes_back_from_readings_drawn_from_it() -> None:
    rng = np.random.default_rng(2)
    true = np.array([-1.0, 3.0, -2.0])
    evidence = rng.uniform(0.0, [1.0, 2.0], (40_000, 2))
    is_right = rng.random(len(evidence)) < expit(true[0] + evidence @ true[1:])
    found = fit_curve(evidence, is_right, np.array([1, -1]))
    # three standard deviations by the curve's own Fisher information
    design = np.column_stack([np.ones(len(evidence)), evidence])
    p = expit(design @ true)
    sigma = np.sqrt(np.diag(np.linalg.inv((design * (p * (1 - p))[:, None]).T @ design)))
    assert np.all(np.abs(found - true) < 3 * sigma)


@pytest.mark.parametrize(
    ("mode", "true"),
    [
        ("back", Weights(-4.0, 1.0, 7.0, 0.0, -1.5, -1.0, 0.0)),
        ("front", Weights(-10.0, 2.0, 4.0, 3.0, -1.0, -1.0, 2.0, 0.9)),
    ],
)
def test_weights_fitted_to_objects_give_the_probabilities_they_were_drawn_by(
    mode: str, true: Weights
) -> None:
    rng = np.random.default_rng(3)
    found = fitted(seen(rng, true, mode, 6000), mode)
    others = [some_evidence(rng) for _ in range(300)]
    off = [probability(e, found) - probability(e, true) for e in others]
    # of some 6000 hypotheses a probability is known to sqrt(8 weights / 6000) / 2 = 0.018
    assert np.sqrt(np.mean(np.square(off))) < 0.03


def test_backlit_readings_are_judged_without_what_lies_inside() -> None:
    rng = np.random.default_rng(4)
    inside = Weights(-3.0, 0.0, 1.0, 3.0, 0.0, 0.0, 3.0)
    found = fitted(seen(rng, inside, "back", 500), "back")
    assert (found.inner, found.shading) == (0.0, 0.0)


def test_evidence_that_speaks_the_wrong_way_counts_nothing() -> None:
    rng = np.random.default_rng(5)
    evidence = rng.uniform(0.0, 1.0, (2000, 2))
    is_right = rng.random(len(evidence)) < expit(4.0 * evidence[:, 0] - 3.0 * evidence[:, 1])
    found = fit_curve(evidence, is_right, np.array([1, 1]))
    assert found[1] > 1.0
    assert found[2] == 0.0


def test_rescaling_takes_the_doubt_out_of_a_curve_that_is_too_sure() -> None:
    rng = np.random.default_rng(6)
    evidence = rng.uniform(-1.0, 1.0, (20_000, 1))
    is_right = rng.random(len(evidence)) < expit(0.5 + 2.0 * evidence[:, 0])
    found = rescaled(np.array([3.0, 10.0]), evidence, is_right)
    assert found == pytest.approx([0.5, 2.0], abs=0.1)


def test_weights_stay_finite_where_right_and_wrong_do_not_mix() -> None:
    evidence = np.array([[0.1], [0.2], [0.8], [0.9]])
    is_right = np.array([False, False, True, True])
    found = fit_curve(evidence, is_right, np.array([1]))
    assert np.all(np.isfinite(found))
    assert expit(found[0] + evidence @ found[1:]).round().astype(bool).tolist() == is_right.tolist()


def test_nothing_is_fitted_to_readings_that_are_all_right() -> None:
    with pytest.raises(ValueError, match="3 of 3"):
        fit_curve(np.ones((3, 1)), np.ones(3, dtype=np.bool_), np.ones(1))


def test_only_wrong_readings_that_fit_clearly_worse_teach_beside_the_best() -> None:
    best, near = hypothesis(0.3, is_right=True), hypothesis(0.4, is_right=False)
    far, twin = hypothesis(0.9, is_right=False), hypothesis(0.9, is_right=True)
    known = Seen("", "back", is_known=True, compared=(best, near, far, twin), rivals=())
    evidence, is_right, is_best = examples([known])
    assert evidence[:, 3].tolist() == [0.3, 0.9]
    assert is_right.tolist() == [True, False]
    assert is_best.tolist() == [True, False]


def test_every_reading_of_a_stranger_teaches() -> None:
    compared = tuple(hypothesis(m, is_right=False) for m in (0.3, 0.4, 0.9))
    stranger = Seen("", "back", is_known=False, compared=compared, rivals=())
    _, is_right, is_best = examples([stranger])
    assert not is_right.any()
    assert is_best.tolist() == [True, False, False]


def test_a_best_reading_that_should_have_come_later_teaches_nothing() -> None:
    wrong, right = hypothesis(0.3, is_right=False), hypothesis(0.4, is_right=True)
    misordered = Seen("", "back", is_known=True, compared=(wrong, right), rivals=())
    assert len(examples([misordered])[1]) == 0


def test_weights_are_printed_as_they_stand_in_the_source() -> None:
    weights = Weights(-6.404, 0.0, 12.218, -0.0, -3.66, -1.451, 0.001, 0.5)
    assert pasted(weights) == "Weights(-6.4, 0.0, 12.22, 0.0, -3.66, -1.45, 0.0, 0.5)"
    assert eval(pasted(weights)) == Weights(-6.4, 0.0, 12.22, 0.0, -3.66, -1.45, 0.0, 0.5)
