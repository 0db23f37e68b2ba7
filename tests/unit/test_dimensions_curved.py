"""Holes whose rims lie in no plane are measured: diameter and place, with their uncertainty.

Pictures are cast by the tests' own renderer of parts as built, each at a known pose.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from curved_rims import PARTS, views

from controller.inspection import PosedPart, Verdict
from controller.inspection.characteristics import (
    Characteristic,
    Measured,
    RimGeometry,
    derive,
    standing_of,
)
from controller.inspection.characteristics.edges import round_walls
from controller.inspection.dimensions import measure

COLLAR = "cross hole of a collar"
PLACES = [(6.0, 20.0), (22.0, 100.0), (18.0, 230.0)]


@cache
def part(name: str) -> tuple[PosedPart, tuple[Characteristic, Characteristic]]:
    solid = solid_of(PARTS[name].built(), name)
    hole = f"hole {PARTS[name].diameter_mm:g} mm"
    rows = {row.id: row for row in derive(solid)}
    return PosedPart(solid), (rows[f"{hole} diameter"], rows[f"{hole} position"])


def measured(
    name: str, wider_mm: float = 0.0, off_mm: tuple[float, float] = (0.0, 0.0)
) -> tuple[Measured, ...]:
    posed, asked = part(name)
    built = PARTS[name].built(wider_mm, off_mm)
    return measure(posed, asked, views(PARTS[name], posed.solid, built, PLACES))


@pytest.mark.parametrize("name", PARTS)
def test_a_rim_in_space_is_a_curve_on_its_cylinder(name: str) -> None:
    diameter, position = part(name)[1]
    assert isinstance(diameter.geometry, RimGeometry)
    rim = diameter.geometry.rims[0]
    assert rim.course is not None
    axis = np.array(PARTS[name].axis)
    assert float(rim.axis @ axis) == pytest.approx(1.0, abs=1e-4)
    off = rim.centre_mm - PARTS[name].mouth_mm
    assert np.linalg.norm(off - (off @ axis) * axis) < 0.01
    assert diameter.nominal_mm == pytest.approx(PARTS[name].diameter_mm, abs=0.01)
    # its mesh points are on the circle, or inside it where a facet beyond begins
    depth = rim.radius_mm - rim.course.radii_mm
    assert (depth > -0.005).all()
    assert (depth < 0.02).all()
    assert diameter.is_measured
    assert position.is_measured


def test_a_good_cross_hole_is_measured_within_its_uncertainty() -> None:
    diameter, position = measured(COLLAR)
    assert (diameter.verdict, position.verdict) == (Verdict.PASS, Verdict.PASS)
    assert diameter.measured_mm is not None
    assert diameter.U_mm is not None
    assert abs(diameter.measured_mm - 6.0) < diameter.U_mm < 0.1
    assert position.measured_mm is not None
    assert position.measured_mm < (position.U_mm or 0.0) < 0.1


@pytest.mark.parametrize("off_mm", [(0.8, 0.0), (0.0, 0.8), (-0.57, 0.57)])
def test_a_cross_hole_out_of_place_stops_a_pass(off_mm: tuple[float, float]) -> None:
    found = measured(COLLAR, off_mm=off_mm)
    position = found[1]
    assert position.verdict is Verdict.FAIL
    assert position.measured_mm == pytest.approx(np.hypot(*off_mm), abs=position.U_mm)
    assert standing_of(found).verdict is Verdict.FAIL


@pytest.mark.slow
def test_19_of_20_values_are_within_their_uncertainty() -> None:
    rng = np.random.default_rng(20)
    ratios = []
    for name, drilled in PARTS.items():
        for _ in range(4):
            wider, off = float(rng.uniform(-0.3, 0.3)), rng.uniform(-0.5, 0.5, 2)
            diameter, position = measured(name, wider, (float(off[0]), float(off[1])))
            truths = drilled.diameter_mm + wider, float(np.hypot(*off))
            for one, truth in zip((diameter, position), truths, strict=True):
                if one.measured_mm is not None and one.U_mm is not None:
                    ratios.append(abs(one.measured_mm - truth) / one.U_mm)
    assert len(ratios) >= 40
    assert np.mean(np.array(ratios) <= 1.0) >= 0.95
    assert max(ratios) < 2.0


def rims_of_bore(body: Body, diameter_mm: float) -> list[bool]:
    """For each rim of a bore that goes all the way round, whether it lies in no plane."""
    walls = [w for w in round_walls(solid_of(body)) if abs(2 * w.radius_mm - diameter_mm) < 0.05]
    return [r.course is not None for w in walls for r in w.rims if r.sweep_rad > 6.0]


def test_where_a_circle_goes_round_it_alone_is_measured() -> None:
    # square to one side of the wedge, and through its slope on the other
    wedge = box(40, 30, 20) - box(80, 60, 20).rotate((0, 20, 0)).translate((0, 0, 16))
    assert rims_of_bore(wedge - rod(4, 80, 96), 8.0) == [False]


def test_a_rim_with_a_notch_is_no_curve_to_measure() -> None:
    pin = rod(9, 40, 128) - rod(3, 30, 96).rotate((90, 0, 0)).translate((0, -9, 0))
    notched = pin - box(2, 8, 12).translate((0, -9, 0))
    assert rims_of_bore(pin, 6.0) == [True]
    assert rims_of_bore(notched, 6.0) == []


def test_a_rim_that_runs_along_its_wall_shows_no_radius() -> None:
    # as wide as the shaft but for a little: both rims come within some degrees of its outline
    shaft = rod(6, 60, 192) - rod(5.95, 40, 192).rotate((90, 0, 0))
    assert rims_of_bore(shaft, 11.9) == []
