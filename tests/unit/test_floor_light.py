"""How deep a blind bore is, from pictures that a ray tracer of the tests' own makes of the body."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from shown_part import photograph, shown, task

from controller.cad import Solid, find_recesses
from controller.imaging import PointLamp
from controller.inspection import PosedPart, ViewPictures
from controller.inspection.dimensions import MeasuringSettings, PosedView
from controller.inspection.edge_evidence import (
    EdgeLooks,
    FloorLook,
    blind_bore,
    find_edges,
    find_floor,
    rise_by_light,
)
from controller.inspection.integrity import Allowances

DEPTH_MM = 8.0
MIDDLE, AXIS, RADIUS_MM = np.array([0.0, -690, 0]), np.array([0.0, 1, 0]), 110.0


def ring(count: int) -> PointLamp:
    """A ring of lamps that lights the floor from nine degrees off the axis."""
    return PointLamp.ring("ring", MIDDLE, AXIS, RADIUS_MM, count)


def bored(depth_mm: float, *more: Body) -> Body:
    body = box(46, 34, 24) - rod(4, 2 * depth_mm, 64).translate((-8, 2, 12))
    for one in more:
        body = body - one
    return body


@cache
def nominal() -> PosedPart:
    return PosedPart(solid_of(bored(DEPTH_MM), "blind"))


@cache
def seen(depth_mm: float, tilt_deg: float, *, is_dark: bool = False) -> PosedView:
    T = shown(4.0, tilt_deg)
    pictures = photograph(bored(depth_mm), T, (), (ring(36),))
    if is_dark:
        noise = np.random.default_rng(2).normal(20, 1.5, pictures.backlit.shape)
        pictures = ViewPictures(pictures.backlit, {"ring": noise.round().astype(np.uint8)})
    known = np.diag([0.02] * 3 + [0.0003] * 3) ** 2
    return PosedView(replace(task(T, ()), lamps=(ring(6),)), pictures, T, known)


def rise(view: PosedView) -> FloorLook | None:
    solid = nominal().solid
    (bore,) = [b for r in find_recesses(solid) if (b := blind_bore(solid, r)) is not None]
    return rise_by_light(nominal(), bore, view, "ring", 3.0)


def by_light(*told: tuple[float, float]) -> list[FloorLook]:
    """How much higher light shows a floor in pictures, and how surely [mm]."""
    return [FloorLook(f"v{i}", "ring", *one, is_by_light=True) for i, one in enumerate(told)]


@pytest.mark.parametrize(("depth_mm", "tilt_deg"), [(8.0, 0.0), (8.0, 9.0), (6.5, 0.0), (4.8, 9.0)])
def test_a_floor_is_found_at_its_depth(depth_mm: float, tilt_deg: float) -> None:
    found = rise(seen(depth_mm, tilt_deg))
    assert found is not None
    assert found.off_mm == pytest.approx(DEPTH_MM - depth_mm, abs=2 * found.u_mm)
    assert found.u_mm < 0.1 * DEPTH_MM


def of_no_look() -> EdgeLooks:
    edges = find_edges(nominal().solid, 0.19)
    assert edges is not None
    return EdgeLooks(edges, (), {}, 0.19, 3.0, Allowances(), MeasuringSettings())


@pytest.mark.parametrize(("depth_mm", "is_shown"), [(8.0, True), (4.8, False)])
def test_a_floor_half_as_deep_is_not_in_place(depth_mm: float, *, is_shown: bool) -> None:
    solid = nominal().solid
    (recess,) = find_recesses(solid)
    told = [one for tilt in (9.0,) if (one := rise(seen(depth_mm, tilt))) is not None]
    bound_mm = find_floor(of_no_look(), recess, told).bound_mm
    assert np.isfinite(bound_mm) == is_shown


def test_one_picture_that_shows_a_floor_elsewhere_outweighs_others() -> None:
    solid = nominal().solid
    (recess,) = find_recesses(solid)
    for second, is_shown in ((0.4, True), (4.0, False)):
        told = by_light((0.0, 0.5), (second, 0.5))
        bound_mm = find_floor(of_no_look(), recess, told).bound_mm
        assert np.isfinite(bound_mm) == is_shown


def test_a_floor_surely_out_of_place_by_more_than_a_tenth_is_not_in_place() -> None:
    solid = nominal().solid  # 8 mm deep: 0.8 mm is a tenth, 2.4 mm are what light has to exclude
    (recess,) = find_recesses(solid)
    for told, bound_mm, count in (
        ([(1.3, 0.1)], np.inf, 1),  # 1.0 mm at least
        ([(-1.3, 0.1), (0.0, 0.3)], np.inf, 0),  # one picture against one
        ([(-1.3, 0.1), (-1.2, 0.1), (0.0, 0.3)], np.inf, 2),
        ([(1.3, 0.3)], 2.2, 0),  # may be 0.4 mm
        ([(0.1, 0.1), (1.3, 0.3)], 0.4, 0),
        ([(0.1, 0.1), (40.0, 12.0)], 0.4, 0),  # says nothing
        ([(0.1, 0.1), (7.9, 0.1)], 0.4, 0),  # the mouth's own edge
        ([(5.0, 0.1)], np.inf, 0),  # one in the upper half may be the border of a shadow
        ([(5.0, 0.1), (5.1, 0.1)], np.inf, 2),
    ):
        found = find_floor(of_no_look(), recess, by_light(*told))
        assert found.bound_mm == pytest.approx(bound_mm)
        assert len(found.elsewhere) == count


def test_what_is_dark_or_seen_flat_shows_no_depth() -> None:
    assert rise(seen(8.0, 0.0, is_dark=True)) is None
    assert rise(seen(8.0, 32.0)) is None


@pytest.mark.parametrize(
    "solid",
    [
        solid_of(box(46, 34, 24) - rod(4, 60, 64)),  # through
        solid_of(bored(8.0, rod(2, 60, 48).translate((-8, 2, 0)))),  # a smaller one goes on
        solid_of(box(46, 34, 24) - box(10, 8, 12).translate((0, 0, 12))),  # a pocket
    ],
    ids=["through", "stepped", "pocket"],
)
def test_other_hollows_are_no_blind_bores(solid: Solid) -> None:
    assert [b for r in find_recesses(solid) if (b := blind_bore(solid, r)) is not None] == []
