"""General tolerances against cells of the standard's tables; decisions at and about limits."""

from __future__ import annotations

import math
from math import degrees

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from controller.inspection import Verdict
from controller.inspection.characteristics.limits import (
    angle_tolerance_rad,
    decide,
    linear_tolerance_mm,
    open_zones,
    radius_tolerance_mm,
)


@pytest.mark.parametrize(
    ("size_mm", "f", "m", "c", "v"),
    [
        (0.5, 0.05, 0.1, 0.2, None),
        (3, 0.05, 0.1, 0.2, None),
        (3.01, 0.05, 0.1, 0.3, 0.5),
        (6, 0.05, 0.1, 0.3, 0.5),
        (30, 0.1, 0.2, 0.5, 1.0),
        (30.1, 0.15, 0.3, 0.8, 1.5),
        (400, 0.2, 0.5, 1.2, 2.5),
        (2500, None, 2.0, 4.0, 8.0),
    ],
)
def test_lengths(size_mm: float, f: float | None, m: float, c: float, v: float | None) -> None:
    assert linear_tolerance_mm(size_mm, "f") == f
    assert linear_tolerance_mm(size_mm, "m") == m
    assert linear_tolerance_mm(size_mm, "c") == c
    assert linear_tolerance_mm(size_mm, "v") == v


def test_a_size_a_rounding_above_a_row_belongs_to_the_row() -> None:
    assert linear_tolerance_mm(6 + 1e-9, "m") == 0.1


@pytest.mark.parametrize(("radius_mm", "m", "v"), [(2, 0.2, 0.4), (5, 0.5, 1.0), (20, 1.0, 2.0)])
def test_radii(radius_mm: float, m: float, v: float) -> None:
    assert radius_tolerance_mm(radius_mm, "m") == m
    assert radius_tolerance_mm(radius_mm, "v") == v


@pytest.mark.parametrize(
    ("side_mm", "m_deg", "c_deg"),
    [(10, 1, 1.5), (50, 0.5, 1), (120, 20 / 60, 0.5), (500, 5 / 60, 10 / 60)],
)
def test_angles(side_mm: float, m_deg: float, c_deg: float) -> None:
    assert degrees(angle_tolerance_rad(side_mm, "m")) == pytest.approx(m_deg)
    assert degrees(angle_tolerance_rad(side_mm, "c")) == pytest.approx(c_deg)


U_MM = 0.08  # of the examples: u = 0.04, a guard band of 1.645 u = 0.0658
finite = st.floats(-100, 100)
uncertain = st.floats(0, 50)


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (10.0, Verdict.PASS),
        (10.3 - 0.0659, Verdict.PASS),
        (10.3 - 0.0657, Verdict.INDETERMINATE),
        (10.3, Verdict.INDETERMINATE),
        (10.3 + 0.0657, Verdict.INDETERMINATE),
        (10.3 + 0.0659, Verdict.FAIL),
        (9.7 + 0.0659, Verdict.PASS),
        (9.7 - 0.0659, Verdict.FAIL),
    ],
)
def test_guard_bands_of_a_wide_tolerance(value: float, verdict: Verdict) -> None:
    assert decide(value, U_MM, 9.7, 10.3) == verdict


@pytest.mark.parametrize("value", [9.7, 10.3])
def test_a_value_on_its_limit_conforms_when_it_is_certain_and_is_open_otherwise(
    value: float,
) -> None:
    assert decide(value, 0.0, 9.7, 10.3) == Verdict.PASS
    assert decide(value, 1e-6, 9.7, 10.3) == Verdict.INDETERMINATE
    assert decide(np.nextafter(value, value * 2 - 10), 0.0, 9.7, 10.3) == Verdict.FAIL


def test_a_tolerance_that_the_uncertainty_swallows_proves_nothing_in_its_middle() -> None:
    # +-1.645 u would leave a point in the middle; both tails together leave 90 %
    assert decide(10.0, 2.0, 10 - 1.645, 10 + 1.645) == Verdict.INDETERMINATE
    assert decide(10.0, 2.0, 10 - 1.97, 10 + 1.97) == Verdict.PASS  # 95 % lie within 1.96 u
    assert decide(10.0, math.inf, 9, 11) == Verdict.INDETERMINATE
    assert decide(10.0, 1.0, 9.99, 10.01) == Verdict.INDETERMINATE


def test_one_limit_alone() -> None:
    assert decide(0.0, U_MM, None, 0.2) == Verdict.PASS
    assert decide(-5.0, U_MM, None, 0.2) == Verdict.PASS
    assert decide(0.3, U_MM, None, 0.2) == Verdict.FAIL
    assert decide(0.3, U_MM, 0.2, None) == Verdict.PASS


def test_more_certainty_widens_the_guard_band_to_u() -> None:
    assert decide(10.3 - 0.079, U_MM, 9.7, 10.3, probability=0.9772) == Verdict.INDETERMINATE
    assert decide(10.3 - 0.081, U_MM, 9.7, 10.3, probability=0.9772) == Verdict.PASS


@pytest.mark.parametrize(
    "wrong",
    [
        {"value": math.nan, "U": 0.1, "lower": 0, "upper": 1},
        {"value": 0.5, "U": -0.1, "lower": 0, "upper": 1},
        {"value": 0.5, "U": 0.1, "lower": 1, "upper": 0},
        {"value": 0.5, "U": 0.1, "lower": 0, "upper": 1, "probability": 0.5},
    ],
)
def test_nonsense_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"cannot be decided|above the upper|no probability"):
        decide(**wrong)


RANK = {Verdict.PASS: 0, Verdict.INDETERMINATE: 1, Verdict.FAIL: 2}


@given(value=finite, further=st.floats(0, 100), U=uncertain, half=st.floats(0, 50))
def test_further_from_the_middle_is_never_better(
    value: float, further: float, U: float, half: float
) -> None:
    near, far = abs(value), abs(value) + further
    for sign in (1, -1):
        assert RANK[decide(sign * near, U, -half, half)] <= RANK[decide(sign * far, U, -half, half)]


@given(value=finite, less=uncertain, more=st.floats(0, 50), half=st.floats(0, 50))
def test_more_uncertainty_never_proves_more(
    value: float, less: float, more: float, half: float
) -> None:
    sharp, blunt = decide(value, less, -half, half), decide(value, less + more, -half, half)
    assert blunt in (sharp, Verdict.INDETERMINATE)


@given(value=finite, U=uncertain, shift=st.floats(-50, 50), half=st.floats(0.01, 50))
def test_a_verdict_is_the_mirror_image_of_its_mirror_image(
    value: float, U: float, shift: float, half: float
) -> None:
    assert decide(value, U, -half, half + shift if shift > 0 else half) == decide(
        -value, U, -half - max(shift, 0.0), half
    )


@given(
    U=st.floats(0.01, 3.0),
    lower=st.one_of(st.none(), st.floats(-1.0, 0.0)),
    upper=st.one_of(st.none(), st.floats(0.05, 1.0)),
    probability=st.sampled_from((0.95, 0.9772)),
)
def test_the_zones_left_open_are_those_of_the_decision(
    U: float, lower: float | None, upper: float | None, probability: float
) -> None:
    zones = open_zones(U, lower, upper, probability)
    for value in np.linspace(-8.0, 8.0, 161):
        if any(abs(value - edge) < 1e-6 for zone in zones for edge in zone):
            continue
        is_open = any(low < value < high for low, high in zones)
        assert is_open == (decide(value, U, lower, upper, probability) is Verdict.INDETERMINATE)


def test_without_uncertainty_nothing_is_left_open() -> None:
    assert open_zones(0.0, 1.0, 2.0) == ()
