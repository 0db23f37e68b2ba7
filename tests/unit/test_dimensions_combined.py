"""Looks put together, and offsets fitted: figures that follow on paper."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
import pytest

from controller.arrays import FloatArray
from controller.inspection import Verdict
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    Look,
    Rim,
    RimGeometry,
)
from controller.inspection.dimensions import Estimate, MeasuringSettings, combine, result_of
from controller.inspection.dimensions.solving import solve

SETTINGS = MeasuringSettings()
UP = np.array([0.0, 0, 1])


def asked(
    kind: CharacteristicKind = CharacteristicKind.DIAMETER, *, is_critical: bool = False
) -> Characteristic:
    rim = Rim(np.zeros(3), UP, 5.0, np.array([1.0, 0, 0]), 2 * np.pi, 0, 1, True)
    return Characteristic(
        "hole", 1, kind, "hole", 10.0, 9.8, 10.2, "test", RimGeometry((rim,)), (), is_critical
    )


def seen(
    off: float | tuple[float, float],
    lamp: str = "ring",
    view: str = "v00",
    towards: FloatArray = UP,
    grasp: int = 0,
    reason: str = "",
    *,
    is_part: bool = False,
    **parts: float,
) -> Estimate:
    """A look that is off nominal, with standard uncertainties by name."""
    vector = np.atleast_1d(np.asarray(off, dtype=float))
    named = {name.replace("_", " "): u**2 * np.eye(len(vector)) for name, u in parts.items()}
    u = float(np.sqrt(sum(v**2 for v in parts.values())))
    budget = MappingProxyType(dict(parts))
    look = Look(view, lamp, 10.0 + float(vector[0]), u, reason, budget, np.ones((1, 2)))
    return Estimate(look, vector, MappingProxyType(named), towards, grasp, is_part)


def test_noise_averages_and_temperature_does_not() -> None:
    looks = [
        seen(0.01 * k, view=f"v{k}", grasp=k, edge_noise=0.03, temperature=0.02) for k in (-1, 0, 1)
    ]
    found = combine(asked(), looks, SETTINGS)
    assert found.measured_mm == pytest.approx(10.0)
    assert found.U_mm == pytest.approx(2 * np.hypot(0.03 / np.sqrt(3), 0.02))
    assert found.views == ("v-1", "v0", "v1")


def test_looks_are_weighted_by_their_uncertainty() -> None:
    looks = [seen(0.03, edge_noise=0.01), seen(0.0, view="v01", edge_noise=0.02)]
    found = combine(asked(), looks, SETTINGS)
    assert found.measured_mm == pytest.approx(10.0 + 0.03 * 4 / 5)


@pytest.mark.parametrize(
    ("other", "shared"),
    [
        ({"grasp": 0}, True),
        ({"grasp": 1}, False),
    ],
)
def test_the_pose_is_shared_within_a_grasp(other: dict[str, int], shared: bool) -> None:
    looks = [seen(0.0, pose=0.02), seen(0.0, view="v01", pose=0.02, **other)]  # type: ignore[arg-type]
    found = combine(asked(), looks, SETTINGS)
    assert found.U_mm == pytest.approx(0.04 if shared else 0.04 / np.sqrt(2))


def test_light_errs_alike_under_one_lamp() -> None:
    one = seen(0.0, edge_type_and_light=0.02)
    tilted = np.array([np.sin(0.4), 0, np.cos(0.4)])
    same = seen(0.0, view="v01", towards=tilted, edge_type_and_light=0.02)
    other = seen(0.0, lamp="side", edge_type_and_light=0.02)
    assert combine(asked(), [one, same], SETTINGS).U_mm == pytest.approx(0.04)
    assert combine(asked(), [one, other], SETTINGS).U_mm == pytest.approx(0.04 / np.sqrt(2))


def test_a_look_under_a_lamp_that_nothing_confirms_is_less_certain() -> None:
    alone = combine(asked(), [seen(0.0, edge_type_and_light=0.02)], SETTINGS)
    backlit = combine(asked(), [seen(0.0, lamp="backlit", edge_type_and_light=0.02)], SETTINGS)
    assert alone.U_mm == pytest.approx(0.08)
    assert backlit.U_mm == pytest.approx(0.04)


def test_one_look_that_a_surer_part_of_the_edge_contradicts_decides_nothing() -> None:
    alone = seen(-0.25, edge_noise=0.04)
    tilted = np.array([np.sin(0.4), 0, np.cos(0.4)])
    part = {"reason": "half of its edge", "is_part": True, "towards": tilted, "view": "v01"}
    surer, worse, same = (
        seen(off, edge_noise=u, **part)  # type: ignore[arg-type]
        for off, u in ((0.0, 0.03), (0.0, 0.05), (-0.25, 0.05))
    )
    for looks, measured_mm in (
        ([alone], 9.75),
        ([alone, worse], 9.75),
        ([alone, surer, same], 9.75),
        ([alone, surer], 10.0 - 0.25 * 9 / 25),  # both count, by their uncertainties
    ):
        found = combine(asked(), looks, SETTINGS)
        assert found.measured_mm == pytest.approx(measured_mm)
    assert found.is_open
    assert found.is_disputed


def test_the_same_light_does_not_excuse_a_look_that_a_surer_part_contradicts() -> None:
    part = seen(0.0, edge_noise=0.03, reason="half of its edge", is_part=True, view="v01")
    found = combine(asked(), [seen(-0.25, edge_noise=0.04), part], SETTINGS)
    assert found.is_open
    assert found.is_disputed


def test_one_look_that_two_surer_ones_contradict_is_no_value_whatever_failed_of_them() -> None:
    alone = seen(-0.25, edge_noise=0.04)
    one, other, worse, elsewhere = (
        seen(off, view="v01", edge_noise=u, reason="73 % of its edge lies on the fitted shape")
        for off, u in ((0.0, 0.03), (0.02, 0.03), (0.0, 0.05), (0.3, 0.03))
    )
    for looks in ([alone, one], [alone, one, worse], [alone, one, elsewhere]):
        assert combine(asked(), looks, SETTINGS).measured_mm == pytest.approx(9.75)
    found = combine(asked(), [alone, one, other], SETTINGS)
    assert found.measured_mm is None
    assert "73 % of its edge" in found.reason
    # a look at a part of the edge that happens to agree confirms nothing against two
    tilted = np.array([np.sin(0.4), 0, np.cos(0.4)])
    part = seen(-0.2, edge_noise=0.05, reason="half of its edge", is_part=True, towards=tilted)
    assert combine(asked(), [alone, part], SETTINGS).measured_mm == pytest.approx(9.75)
    found = combine(asked(), [alone, part, one, other], SETTINGS)
    assert found.is_open
    # two that count and are independent, or one before the panel, stand against any that failed
    for lamp in ("side", "backlit"):
        sure = seen(-0.25, lamp=lamp, edge_noise=0.04)
        found = combine(asked(), [alone, sure, one, other], SETTINGS)
        assert found.measured_mm == pytest.approx(9.75)
        assert not found.is_open


def test_a_fail_needs_two_looks_or_one_before_the_panel() -> None:
    tilted = np.array([np.sin(0.4), 0, np.cos(0.4)])
    lit = seen(-0.6, edge_noise=0.02)
    backlit, other_lamp = (seen(-0.6, lamp=lamp, edge_noise=0.02) for lamp in ("backlit", "side"))
    for looks, verdict in (
        ([lit], Verdict.INDETERMINATE),
        ([lit, seen(-0.6, view="v01", edge_noise=0.02)], Verdict.INDETERMINATE),
        ([lit, other_lamp], Verdict.FAIL),
        ([lit, seen(-0.6, view="v01", towards=tilted, edge_noise=0.02)], Verdict.FAIL),
        ([backlit], Verdict.FAIL),
    ):
        found = result_of(asked(), combine(asked(), looks, SETTINGS))
        assert found.verdict is verdict
        assert found.is_disputed is (verdict is not Verdict.FAIL)


@pytest.mark.parametrize(
    ("lamps", "verdict"),
    [
        (("ring", "side"), Verdict.INDETERMINATE),
        (("ring", "backlit"), Verdict.FAIL),
        (("ring", "side", "low"), Verdict.FAIL),
    ],
)
def test_two_lit_looks_do_not_fail_a_part_against_a_third_that_they_leave_out(
    lamps: tuple[str, ...], verdict: Verdict
) -> None:
    looks = [seen(-0.6, lamp=lamp, edge_noise=0.02) for lamp in lamps]
    looks.append(seen(0.0, lamp="above", edge_noise=0.02))
    found = result_of(asked(), combine(asked(), looks, SETTINGS))
    assert found.looks[-1].reason.startswith("disagrees")
    assert found.verdict is verdict
    assert found.is_disputed is (verdict is Verdict.INDETERMINATE)


def test_one_look_that_disagrees_with_many_is_left_out_and_says_so() -> None:
    looks = [seen(0.0, view=f"v{k}", grasp=k, edge_noise=0.01) for k in range(4)]
    looks.append(seen(0.3, lamp="side", edge_noise=0.01))
    found = combine(asked(), looks, SETTINGS)
    assert found.measured_mm == pytest.approx(10.0)
    assert not found.is_open
    assert found.looks[4].reason.startswith("disagrees with the other looks by 0.300 mm")


def test_looks_that_disagree_decide_only_where_the_verdict_is_the_same_whichever_is_right() -> None:
    for off_mm, is_open in ((0.1, False), (0.15, False), (0.25, True), (0.3, True)):
        looks = [seen(0.0, edge_noise=0.01), seen(off_mm, lamp="side", edge_noise=0.01)]
        found = combine(asked(), looks, SETTINGS)  # limits +-0.2
        assert found.is_open is found.is_disputed is is_open, off_mm
        assert found.U_mm == pytest.approx(off_mm / 2 + 0.02)  # reaches either look's own U
        assert (f"looks disagree by {off_mm:.3f} mm" in found.reason) is is_open
        assert combine(asked(is_critical=True), looks, SETTINGS).is_open


def test_parts_of_an_edge_that_disagree_are_no_value() -> None:
    little = {"reason": "70 % of its edge found where it must show", "is_part": True}
    looks = [
        seen(0.0, edge_noise=0.01, **little),  # type: ignore[arg-type]
        seen(0.5, lamp="side", edge_noise=0.01, **little),  # type: ignore[arg-type]
    ]
    found = combine(asked(), looks, SETTINGS)
    assert found.measured_mm is None
    assert not found.is_disputed
    assert "70 % of its edge" in found.reason


def test_a_critical_one_needs_two_independent_looks() -> None:
    tilted = np.array([np.sin(0.3), 0, np.cos(0.3)])
    near = np.array([np.sin(0.1), 0, np.cos(0.1)])
    one = seen(0.0, edge_noise=0.01)
    critical = asked(is_critical=True)
    assert combine(critical, [one], SETTINGS).is_open
    beside = seen(0.0, view="v1", towards=near, edge_noise=0.01)
    assert combine(critical, [one, beside], SETTINGS).is_open
    for other in ({"towards": tilted}, {"lamp": "side"}):
        looks = [one, seen(0.0, view="v1", edge_noise=0.01, **other)]  # type: ignore[arg-type]
        assert not combine(critical, looks, SETTINGS).is_open
    assert not combine(asked(), [one], SETTINGS).is_open


def test_places_are_averaged_as_vectors() -> None:
    looks = [seen((0.04, 0.0), edge_noise=0.03), seen((-0.04, 0.0), view="v1", edge_noise=0.03)]
    found = combine(asked(CharacteristicKind.POSITION), looks, SETTINGS)
    # noise about the nominal place averages out; averaging distances would keep it
    assert found.measured_mm == pytest.approx(0.0, abs=1e-9)
    # a place off in two directions: 95 % lie within 2.45 standard deviations
    assert found.U_mm == pytest.approx(2.45 * 0.03 / np.sqrt(2))


def test_nothing_evaluated_says_why() -> None:
    looks = [
        seen(0.0, view=view, reason=why, edge_noise=0.1)
        for view, why in (("v00", "burnt out"), ("v01", "blurred"))
    ]
    found = combine(asked(), looks, SETTINGS)
    assert found.measured_mm is None
    assert found.reason == "v00 ring: burnt out; v01 ring: blurred"


# --- fits ---------------------------------------------------------------------------------------


def circle_rows(angle: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])


def test_the_covariance_of_a_circle_is_the_textbooks() -> None:
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    rng = np.random.default_rng(4)
    found = [
        solve(circle_rows(angle), rng.normal(0, 0.1, 200), np.full(200, 0.01), np.ones(200))
        for _ in range(200)
    ]
    values = np.array([one.values for one in found if one is not None])
    # s / sqrt(n) for the radius, s sqrt(2 / n) for the place
    expected = 0.1 * np.sqrt(np.array([2.0, 2.0, 1.0]) / 200)
    assert values.std(axis=0) == pytest.approx(expected, rel=0.15)
    noise = np.mean([np.sqrt(np.diagonal(one.noise)) for one in found if one is not None], axis=0)
    assert noise == pytest.approx(expected, rel=0.2)


def test_a_fifth_of_outliers_does_not_move_a_circle() -> None:
    angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
    rng = np.random.default_rng(5)
    offset = circle_rows(angle) @ [0.5, -0.2, 1.0] + rng.normal(0, 0.02, 100)
    offset[30:50] += 3.0
    found = solve(circle_rows(angle), offset, np.full(100, 0.02**2), np.ones(100))
    assert found is not None
    assert found.values == pytest.approx([0.5, -0.2, 1.0], abs=0.02)
    assert not found.used[30:50].any()
    assert found.used.sum() >= 75


def test_what_no_offset_shows_has_no_solution() -> None:
    rows = np.ones((30, 2))
    assert solve(rows, np.zeros(30), np.ones(30), np.ones(30)) is None
    assert solve(rows[:, :1], np.full(30, np.nan), np.ones(30), np.ones(30)) is None


def test_neighbours_that_err_together_count_less() -> None:
    angle = np.linspace(0, 2 * np.pi, 200, endpoint=False)
    rng = np.random.default_rng(6)
    alone = rng.normal(0, 0.1, 200)
    together = np.repeat(rng.normal(0, 0.1, 40), 5)
    one, other = (
        solve(circle_rows(angle), offset, np.full(200, 0.01), np.ones(200))
        for offset in (alone, together)
    )
    assert one is not None
    assert other is not None
    assert other.noise[2, 2] > 3 * one.noise[2, 2]
