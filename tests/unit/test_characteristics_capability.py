"""What a cell may promise, against a published budget; and what it leaves of a PASS."""

from __future__ import annotations

from dataclasses import replace
from math import hypot, radians
from statistics import NormalDist

import pytest
from cad_solids import Body, box, rod, solid_of

from controller.config import load_cell
from controller.config.cell import AccuracySection
from controller.config.shipped import EMULATED_CELL
from controller.inspection import Verdict
from controller.inspection.characteristics import (
    Characteristic,
    Measured,
    RimGeometry,
    Station,
    capability_of,
    derive,
    standing_of,
    verdict_of,
    with_capability,
    worse,
)
from controller.inspection.characteristics.limits import promised_budget_mm, promised_mm
from controller.setup.characteristics import build_accuracy, measuring_settings, station_of

# 5 megapixels, 100 mm wide at 400 mm: the camera of the budget that the promise was set by
FINE = Station(mm_per_px=0.0408, distance_mm=400.0, field_mm=100.0)
DEPTH_MM = 0.05
# the budget's: an edge anywhere within 0.2 px either way
ACCURACY = build_accuracy(AccuracySection(depth_mm=DEPTH_MM, light_px=0.115))
COARSE = Station(mm_per_px=0.1875, distance_mm=700.0, field_mm=240.0)


@pytest.mark.parametrize(
    ("length_mm", "published_um"),
    [(20, (2.0, 4.7, 4.0, 2.5, 1.0, 2.3)), (100, (2.8, 6.7, 5.7, 12.5, 5.0, 11.5))],
)
def test_the_budget_is_the_published_one(length_mm: float, published_um: tuple[float, ...]) -> None:
    """To 5 %: the published figures are rounded, and so are those they follow from."""
    budget = promised_budget_mm(length_mm, FINE, ACCURACY)
    assert [1000 * v for v in budget.values()] == pytest.approx(published_um, rel=0.05)
    total = hypot(*published_um)
    assert 1000 * promised_mm(length_mm, FINE, ACCURACY) == pytest.approx(2 * total, rel=0.03)


def test_what_a_cell_states_of_its_lens_is_what_measuring_reckons_with() -> None:
    stated = AccuracySection(light_px=0.2, lens_px=0.3, scale=1e-4, temperature_k=10)
    settings = measuring_settings(stated)
    assert (settings.lit_edge_px, settings.lens_px) == (0.2, 0.3)
    assert (settings.scale, settings.temperature_k) == (1e-4, 10)


def test_the_emulated_cells_pixel_is_a_fifth_of_a_millimetre() -> None:
    station = station_of(load_cell(EMULATED_CELL))
    assert station.mm_per_px == pytest.approx(0.1875, abs=1e-4)
    assert station.distance_mm == pytest.approx(700)


def part(*diameters_mm: float) -> tuple[Characteristic, ...]:
    body: Body = box(90, 60, 8)
    for i, diameter in enumerate(diameters_mm):
        body = body - rod(diameter / 2, 20, 128).translate((25.0 * i - 25, 0, 0))
    return derive(solid_of(body))


def one(kind: str, *diameters_mm: float) -> Characteristic:
    return next(c for c in part(*diameters_mm) if kind in c.id)


def test_smaller_pixels_make_a_tolerance_capable() -> None:
    diameter = one("hole 5 mm diameter", 5)  # +-0.1
    assert not capability_of(diameter, COARSE, ACCURACY).is_capable
    fine = capability_of(diameter, FINE, ACCURACY)
    assert fine.is_capable
    assert fine.share == pytest.approx(2 * fine.U_mm / 0.2)
    least = replace(
        diameter,
        lower_mm=5 - fine.min_tolerance_mm / 2,
        upper_mm=5 + fine.min_tolerance_mm / 2,
    )
    assert capability_of(least, FINE, ACCURACY).share == pytest.approx(0.3)


def test_a_position_has_a_zone_as_wide_as_its_diameter() -> None:
    position = one("hole 5 mm position", 5)
    U = capability_of(position, FINE, ACCURACY).U_mm
    assert capability_of(position, FINE, ACCURACY).share == pytest.approx(
        2 * U / (2 * position.upper_mm)
    )
    assert pytest.approx(promised_mm(position.length_mm, FINE, ACCURACY)) == U


def test_a_short_arc_is_less_sure_than_a_long_one() -> None:
    diameter = one("hole 20 mm diameter", 20)
    assert isinstance(diameter.geometry, RimGeometry)
    U = {}
    for sweep_deg in (60, 90, 180, 270):
        rim = replace(diameter.geometry.rims[0], sweep_rad=radians(sweep_deg))
        radius = replace(diameter, kind=type(diameter.kind)("radius"), geometry=RimGeometry((rim,)))
        U[sweep_deg] = capability_of(radius, FINE, ACCURACY).U_mm
    assert U[180] == U[270] == pytest.approx(capability_of(diameter, FINE, ACCURACY).U_mm)
    assert U[90] / U[180] == pytest.approx(1 / (1 - 0.5**0.5))  # sagitta of a quarter
    assert U[60] > U[90]


def test_only_general_tolerances_are_marked() -> None:
    diameter = one("hole 5 mm diameter", 5)
    stated = replace(diameter, source="recipe")
    marked, kept = with_capability([diameter, stated], COARSE, ACCURACY)
    assert "above 30%" in marked.exempt
    assert marked.is_measured
    assert kept.exempt == ""


def test_what_the_uncertainty_swallows_whole_is_not_measured() -> None:
    diameter = one("hole 5 mm diameter", 5)
    U = capability_of(diameter, COARSE, ACCURACY).U_mm
    for half_mm, is_measured in ((U * 1.01, True), (U * 0.99, False)):
        tight = replace(diameter, lower_mm=5 - half_mm, upper_mm=5 + half_mm)
        (marked,) = with_capability([tight], COARSE, ACCURACY)
        assert marked.exempt
        assert marked.is_measured is is_measured


def measured(
    asked: Characteristic, value: float | None, U: float | None = 0.06, reason: str = ""
) -> Measured:
    if value is None:
        return Measured(asked, None, None, Verdict.NOT_EVALUATED, (), reason)
    assert U is not None
    return Measured(asked, value, U, verdict_of(asked, value, U), ("v0",), reason)


def test_what_a_pass_needs() -> None:
    """5 mm +-0.1 with U = 0.06: proven within 0.05, wrong beyond 0.15, plainly so beyond 0.2."""
    derived = one("hole 5 mm diameter", 5)
    stated = replace(derived, source="recipe")
    weak = replace(derived, exempt="the cell promises U = 61 um")
    hidden = replace(derived, exempt="no picture shows it", is_measured=False)
    for asked, value, verdict, says in (
        (stated, 5.04, Verdict.PASS, 0),
        (stated, 5.08, Verdict.INDETERMINATE, 0),
        (stated, 5.16, Verdict.FAIL, 0),
        (stated, None, Verdict.INDETERMINATE, 0),
        (derived, 5.04, Verdict.PASS, 0),  # proven all the same
        (derived, 5.08, Verdict.PASS, 1),  # within its limits, and not proven
        (derived, 5.12, Verdict.INDETERMINATE, 0),  # more likely wrong than right
        (derived, 5.16, Verdict.FAIL, 0),
        (derived, None, Verdict.INDETERMINATE, 0),  # a filled hole has no rim
        (weak, 5.08, Verdict.PASS, 1),
        (weak, 5.12, Verdict.INDETERMINATE, 0),
        (hidden, None, Verdict.PASS, 1),
        (replace(derived, is_critical=True), 5.08, Verdict.INDETERMINATE, 0),
    ):
        standing = standing_of([measured(asked, value)])
        assert (standing.verdict, len(standing.unproven)) == (verdict, says), (asked, value)
        assert bool(standing.reasons) == (verdict is not Verdict.PASS)


def test_looks_that_contradict_each_other_stop_a_pass() -> None:
    found = measured(one("hole 5 mm diameter", 5), 5.0, 0.12, "looks disagree by 0.300 mm")
    assert standing_of([found]).verdict is Verdict.PASS
    standing = standing_of([replace(found, is_disputed=True)])
    assert standing.verdict is Verdict.INDETERMINATE
    assert "looks disagree" in standing.reasons[0]


@pytest.mark.parametrize("U", [0.02, 0.08, 0.12, 0.16, 0.2, 0.3, 0.5])
@pytest.mark.parametrize(
    ("half_mm", "wrong_mm", "most"),
    [
        (0.1, 0.2, 0.011),  # half the tolerance beyond its limit
        (0.2, 0.35, 0.011),  # 0.15 mm beyond
        (0.3, 0.5, 0.005),  # a face 0.5 mm off
        (0.2, 0.5, 0.0),
    ],
)
def test_what_is_plainly_wrong_passes_by_a_rare_error_alone(
    U: float, half_mm: float, wrong_mm: float, most: float
) -> None:
    """Errors are drawn as U states them: normal, with half of it for a standard deviation."""
    asked = one("hole 5 mm diameter", 5)
    asked = replace(asked, lower_mm=5 - half_mm, upper_mm=5 + half_mm)
    error = NormalDist(0.0, U / 2)
    draws = [error.inv_cdf((k + 0.5) / 500) for k in range(500)]
    passed = [standing_of([measured(asked, 5 + wrong_mm + e, U)]).verdict for e in draws]
    assert passed.count(Verdict.PASS) <= most * len(draws)


def test_what_is_not_required_may_stay_open_but_not_be_wrong() -> None:
    asked = replace(one("diameter", 5.0), is_required=False)
    middle, beyond = asked.nominal_mm, asked.upper_mm + 1.0
    missed = Measured(asked, None, None, Verdict.NOT_EVALUATED, (), "")
    for found, verdict in (
        (missed, Verdict.PASS),
        (replace(missed, measured_mm=middle, verdict=Verdict.INDETERMINATE), Verdict.PASS),
        (
            replace(missed, measured_mm=beyond, verdict=Verdict.INDETERMINATE),
            Verdict.INDETERMINATE,
        ),
        (replace(missed, measured_mm=beyond, verdict=Verdict.FAIL), Verdict.FAIL),
    ):
        standing = standing_of([found])
        assert standing.verdict is verdict
        assert len(standing.unproven) == (verdict is Verdict.PASS)


def test_what_is_not_required_and_hardly_measured_does_not_stop_a_pass() -> None:
    """5 mm +-0.1: the whole tolerance is 0.2 mm, plainly beyond is 0.1 mm more than a limit."""
    asked = replace(one("diameter", 5.0), is_required=False)
    for value, U, verdict in (
        (5.17, 0.11, Verdict.PASS),  # 2 U is more than the tolerance
        (5.17, 0.09, Verdict.INDETERMINATE),  # it is not
        (5.23, 0.25, Verdict.INDETERMINATE),
        (5.23, 0.3, Verdict.PASS),  # beyond by less than its standard uncertainty
        (4.83, 0.3, Verdict.PASS),
        (4.7, 0.3, Verdict.INDETERMINATE),
    ):
        found = Measured(asked, value, U, Verdict.INDETERMINATE, ("v0",), "")
        assert standing_of([found]).verdict is verdict
        stated = replace(found, characteristic=replace(asked, source="recipe"))
        assert standing_of([stated]).verdict is Verdict.INDETERMINATE


def test_the_worst_of_all_counts() -> None:
    asked = one("hole 5 mm diameter", 5)
    all_of_them = [measured(asked, value) for value in (5.0, 5.12, 5.2)]
    assert standing_of(all_of_them).verdict is Verdict.FAIL
    assert "5.200 mm" in standing_of(all_of_them).reasons[0]
    assert standing_of(all_of_them[:2]).verdict is Verdict.INDETERMINATE
    assert standing_of(all_of_them[:1]).verdict is Verdict.PASS
    assert standing_of([]).verdict is Verdict.PASS


def test_what_is_left_out_for_one_reason_is_one_sentence() -> None:
    hidden = replace(one("hole 5 mm diameter", 5), exempt="no picture shows it", is_measured=False)
    labels = ["hole 5 mm (1) depth", "hole 5 mm (2) depth", "chamfer 1 mm F7, width"]
    labels += ["thickness 8.7 mm F0 to F12", "thickness 8.7 mm F0 to F13", "hole 6 mm depth"]
    all_six = [measured(replace(hidden, label=label), None) for label in labels]
    other = measured(replace(hidden, label="the other", exempt="as cast"), None)
    # none is left unnamed; those alike are counted
    assert standing_of([*all_six, other]).unproven == (
        "hole 5 mm depth (2 of these); chamfer 1 mm F7, width; thickness 8.7 mm (2 of these); "
        "hole 6 mm depth: not measured, no picture shows it",
        "the other: not measured, as cast",
    )


@pytest.mark.parametrize("other", [Verdict.PASS, Verdict.INDETERMINATE, Verdict.FAIL])
def test_a_part_is_as_bad_as_the_worst_known_of_it(other: Verdict) -> None:
    assert worse(Verdict.FAIL, other) is Verdict.FAIL
    assert worse(other, Verdict.PASS) is other
    assert worse(Verdict.INDETERMINATE, other) is not Verdict.PASS
