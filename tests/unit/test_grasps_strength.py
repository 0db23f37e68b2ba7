"""Slip, twist and tipping against sums on paper, and against every attitude tried one by one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cad_solids import box, solid_of
from grasp_bench import HAND, RULES, stood
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controller.cad import Solid
from controller.imaging import RayCaster
from controller.planning.grasps.contact import Contacts, PadGrid, close_pads, loads

GRID = PadGrid.of(HAND, 0.5)
OUTER = np.array([False])


def touched(solid: Solid, T: np.ndarray, gap: float, grid: PadGrid = GRID) -> Contacts:
    normals = np.asarray(solid.mesh.face_normals, dtype=np.float32)
    return close_pads(RayCaster(solid.mesh), normals, T[None], np.array([gap]), OUTER, grid, RULES)


def load_at(solid: Solid, T: np.ndarray, gap: float, weight_n: float, gravity: object) -> float:
    found = touched(solid, T, gap)
    gravities = None if gravity is None else [np.array(gravity, float)]
    value = loads(found, GRID, solid.centroid_mm, weight_n, HAND.force_n, OUTER, RULES, gravities)
    return float(value[0])


BAR = solid_of(box(160, 30, 20))
# tips 12 mm past the middle of the pads, which stand 40 mm from the bar's centre of mass
HELD = stood((40.0, 0.0, -12.0 + 2.0), (0, 0, -1), (0, 1, 0))


def test_a_pad_that_lies_flat_is_touched_all_over() -> None:
    found = touched(solid_of(box(160, 30, 60)), stood((0, 0, 0), (0, 0, -1), (0, 1, 0)), 30.0)
    assert found.area[0] == pytest.approx(12 * 24, rel=1e-9)
    assert found.opening[0] == pytest.approx(30.0, abs=1e-3)
    # mean distance from its middle of a 12 x 24 mm rectangle, by the closed form
    a, b = 6.0, 12.0
    d = np.hypot(a, b)
    mean = d / 3 + b**2 / (6 * a) * np.arcsinh(a / b) + a**2 / (6 * b) * np.arcsinh(b / a)
    assert found.radius[0] == pytest.approx(mean, rel=2e-3)


def test_contact_on_a_thin_bar_is_the_bars_height_times_the_pads_width() -> None:
    # the pad reaches from 12 mm below the bar's middle to 12 mm above, the bar 10 mm each way
    found = touched(BAR, stood((40.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0)), 30.0)
    assert found.area[0] == pytest.approx(12 * 20, rel=1e-6)


def test_weight_below_the_pads_slips_by_itself() -> None:
    T = stood((0.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    # no lever: W / (2 mu N) with gravity along the pads
    expected = 5.0 / (2 * RULES.friction * HAND.force_n)
    assert load_at(BAR, T, 30.0, 5.0, (1, 0, 0)) == pytest.approx(expected, rel=1e-3)


def test_weight_beside_the_pads_slips_and_twists_on_an_ellipse() -> None:
    T = stood((40.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    weight_n, mu, force_n = 3.0, RULES.friction, HAND.force_n
    r = touched(BAR, T, 30.0).radius[0]
    slip = weight_n / (2 * mu * force_n)
    twist = slip * 40.0 / r
    # gravity along the approach: square to the lever, which is along the bar
    assert load_at(BAR, T, 30.0, weight_n, (1, 0, 0)) == pytest.approx(
        np.hypot(slip, twist), rel=1e-3
    )
    # gravity along the lever does not twist
    assert load_at(BAR, T, 30.0, weight_n, (0, 0, 1)) == pytest.approx(slip, rel=1e-2)


def test_weight_along_the_jaws_axis_tips_the_part_about_the_pads_edges() -> None:
    T = stood((40.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    weight_n, force_n = 3.0, HAND.force_n
    # both centres of pressure together move at most 6 + 6 mm along the bar: N x 12 against W x 40
    assert load_at(BAR, T, 30.0, weight_n, (0, 1, 0)) == pytest.approx(
        weight_n * 40 / (force_n * 12), rel=1e-2
    )


def test_slanted_walls_use_their_slope_of_the_friction() -> None:
    T = stood((0.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    tilt = np.radians(1.5)  # of both walls against the pads, one each way: the part is turned
    turned = T.copy()
    c, s = np.cos(tilt), np.sin(tilt)
    turned[:3, :3] = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ T[:3, :3]
    found = touched(BAR, turned, 30.0)
    assert found.slope[0] == pytest.approx(np.tan(tilt), rel=1e-3)


@pytest.mark.parametrize("at", [(40.0, 0.0, -12.0), (-55.0, 0.0, -8.0), (10.0, 0.0, -14.0)])
@pytest.mark.parametrize("weight_n", [1.0, 6.0])
def test_the_worst_attitude_is_the_worst_of_all_tried_one_by_one(
    at: tuple[float, float, float], weight_n: float
) -> None:
    # an L, so that the centre of mass is off the jaws' plane as well
    solid = solid_of(box(160, 30, 20) + box(20, 60, 20).translate((70, 45, 0)))
    found = touched(solid, stood(at, (0, 0, -1), (0, 1, 0)), 30.0)
    assert found.touched[0]
    directions = np.random.default_rng(3).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # what pitch -98..+4 deg, any roll and any heading make of gravity in the tip frame
    allowed = directions[directions[:, 0] >= -np.sin(np.radians(4.0))]
    args = (found, GRID, solid.centroid_mm, weight_n, HAND.force_n, OUTER, RULES)
    tried = loads(*args, list(allowed))[0]
    worst = loads(*args, None)[0]
    assert tried <= worst + 1e-9
    assert worst == pytest.approx(tried, rel=0.02)


def test_half_the_force_or_twice_the_weight_is_twice_the_load() -> None:
    found = touched(BAR, HELD, 30.0)
    base = loads(found, GRID, BAR.centroid_mm, 2.0, 40.0, OUTER, RULES)[0]
    assert loads(found, GRID, BAR.centroid_mm, 4.0, 40.0, OUTER, RULES)[0] == pytest.approx(
        2 * base
    )
    assert loads(found, GRID, BAR.centroid_mm, 2.0, 20.0, OUTER, RULES)[0] == pytest.approx(
        2 * base
    )


def test_oil_leaves_a_third_of_the_friction() -> None:
    found = touched(BAR, HELD, 30.0)
    dry = loads(found, GRID, BAR.centroid_mm, 2.0, 40.0, OUTER, RULES)[0]
    oily = loads(found, GRID, BAR.centroid_mm, 2.0, 40.0, OUTER, replace(RULES, friction=0.2))[0]
    assert oily == pytest.approx(3 * dry, rel=1e-6)


@settings(max_examples=15, deadline=None)
@given(
    st.tuples(*[st.floats(-3.0, 3.0) for _ in range(3)]),
    st.tuples(*[st.floats(-200.0, 200.0) for _ in range(3)]),
)
def test_where_the_part_stands_in_its_drawing_changes_nothing(
    turn: tuple[float, ...], shift_mm: tuple[float, ...]
) -> None:
    move = np.eye(4)
    move[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    move[:3, 3] = shift_mm
    moved = solid_of(box(160, 30, 60).transform(move[:3]))
    T = stood((40.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    here = load_at(solid_of(box(160, 30, 60)), T, 30.0, 3.0, None)
    assert load_at(moved, move @ T, 30.0, 3.0, None) == pytest.approx(here, rel=2e-3)
