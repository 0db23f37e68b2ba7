"""Ambiguity about the held part: which views decide it, and which hypotheses a picture leaves."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, rod, solid_of
from data_files import part_file
from hypothesis import given, settings
from hypothesis import strategies as st
from lit_pictures import Renderer, placed
from lit_pictures import Scene as Pictured
from planning_cell import emulated_layout

from controller.cad import Solid, load_solid
from controller.imaging import PointLamp, inverse_pose
from controller.planning import Box
from controller.planning.disambiguation import (
    DecidingView,
    DisambiguationRules,
    PredictedPictures,
    Separations,
    apart,
    cheapest_tree,
    compare,
    difference,
    discriminate,
    edges_shown,
    measured_picture,
    model_of,
    offered_views,
    predict_view,
    separating_views,
)
from controller.planning.model import LIGHTS, HeldHypothesis, Light
from controller.planning.motion import Scene, tcp_pose

LAYOUT = emulated_layout()
RULES = DisambiguationRules()
PX_PER_MM = 3733.0 / 700.0
OPENING_MM = 12.0


def plate(*holes: tuple[float, float, float]) -> Body:
    """A plate with blind holes from below: x, y and which side, +1 up, -1 down."""
    body = box(60, 40, 12)
    for x, y, side in holes:
        body -= rod(4, 8).translate((x, y, 6 * side))
    return body


@cache
def solid(name: str) -> Solid:
    made = {
        "plain": lambda: plate(),
        "holed": lambda: plate((15, 8, -1)),
        "other": lambda: plate((15, -8, -1)),
        "longer": lambda: box(66, 40, 12),
        "through": lambda: box(60, 40, 12) - rod(6, 40).translate((12, 6, 0)),
        "block": lambda: box(40, 30, 50),
    }
    return solid_of(made[name](), name)


def in_hand() -> np.ndarray:
    """T_part_hand: across the plate's thickness, near one end."""
    T = np.eye(4)
    T[:3, :3] = np.column_stack([[1, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
    T[:3, 3] = [-18, 0, 0]
    return T


def held(name: str, turn: np.ndarray | None = None, called: str = "") -> HeldHypothesis:
    T = inverse_pose(in_hand())
    return HeldHypothesis(called or name, solid(name), T if turn is None else T @ turn)


@cache
def plate_views() -> dict:
    """Return one configuration per direction to the camera, seen from the plate."""
    q, _ = offered_views([held("plain")], LAYOUT, OPENING_MM, LAYOUT.park_q, 14)
    eye = LAYOUT.inspection.position_mm
    found = {}
    for row in q:
        T = tcp_pose(LAYOUT, row) @ held("plain").T_tcp_part
        away = inverse_pose(T)[:3] @ [*eye, 1.0]
        found[tuple(away / np.linalg.norm(away))] = row
    return found


def towards(direction: tuple[float, float, float]) -> np.ndarray:
    """The configuration that shows the plate from nearest to a direction."""
    return max(plate_views().items(), key=lambda item: float(np.dot(item[0], direction)))[1]


def look(hypotheses: list[HeldHypothesis], q: np.ndarray, step_px: int = 2) -> PredictedPictures:
    models = [model_of(c) for c in hypotheses]
    seen = predict_view(hypotheses, models, LAYOUT, q, OPENING_MM, step_px, RULES)
    assert seen is not None
    return seen


def settle(hypotheses: list[HeldHypothesis], q: np.ndarray | None = None):  # noqa: ANN201
    offered = np.stack(list(plate_views().values())) if q is None else q
    return separating_views(hypotheses, LAYOUT, offered, np.full(len(offered), 5.0), OPENING_MM)


def moved(hypothesis: HeldHypothesis, seed: int, share: float = 0.95) -> HeldHypothesis:
    """The same part, as far off in the hand as it may be, any which way."""
    rng = np.random.default_rng(seed)
    axis, shift = rng.normal(size=3), rng.normal(size=3)
    axis, shift = axis / np.linalg.norm(axis), shift / np.linalg.norm(shift)
    angle = share * RULES.turn_rad
    K = np.cross(np.eye(3), axis)
    T = np.eye(4)
    T[:3, :3] = np.eye(3) - np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    T[:3, 3] = share * RULES.shift_mm * shift
    return HeldHypothesis(hypothesis.name, hypothesis.solid, T @ hypothesis.T_tcp_part)


@settings(max_examples=6, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    name=st.sampled_from(["holed", "through", "block"]),
    view=st.integers(0, 1000),
)
def test_a_part_held_a_little_otherwise_is_no_other_part(seed: int, name: str, view: int) -> None:
    one = held(name)
    offered = list(plate_views().values())
    seen = look([one, moved(one, seed)], offered[view % len(offered)])
    for light in LIGHTS:
        pixels = difference(seen.pictures[0], seen.pictures[1], seen.stance, light)
        assert pixels < (100.0 if light == "backlight" else 40.0)


def test_against_the_light_a_longer_plate_differs_by_its_ends_less_what_the_hold_may_hide() -> None:
    # seen face on from above, with a hand of no size; 3 mm more at either end, 40 mm wide
    offered = [held("plain"), held("longer")]
    seen = look(offered, towards((0, 0, 1)), 1)
    bare = [
        type(p)(p.step_px, p.mask, p.edges, np.zeros_like(p.mask), np.zeros_like(p.mask))
        for p in seen.pictures
    ]
    pixels = difference(bare[0], bare[1], seen.stance, "backlight")
    px_per_mm = 3733.0 / (700.0 - 6.0)
    strip = 3.0 * px_per_mm - seen.stance.tolerance_px
    assert strip > 3.0
    # however it is shifted, what one end loses the other gains; a turn makes it more
    assert pixels == pytest.approx(2 * strip * 40.0 * px_per_mm, rel=0.2)
    assert difference(bare[1], bare[0], seen.stance, "backlight") == pytest.approx(pixels, rel=0.1)


def test_a_blind_hole_underneath_is_told_by_its_rim_from_below_and_not_by_the_outline() -> None:
    pair = [held("plain"), held("holed")]
    found = settle(pair)
    assert isinstance(found.first, DecidingView)
    assert found.first.light == "front"
    assert found.first.groups == ((0,), (1,))
    assert found.indistinguishable == ()
    direction = list(plate_views())[found.first.view]
    assert direction[2] < -0.3  # from below
    margins = found.separations.margins[:, :, 0]
    assert margins[:, LIGHTS.index("backlight")].max() == 0.0
    # the rim is 8 mm across: 25.1 mm of edge; inside it the hole's floor has another such edge
    rim_px = np.pi * 8.0 * PX_PER_MM
    from_below = look(pair, towards((0, 0, -1)), 1)
    below = difference(*from_below.pictures, from_below.stance, "front")
    assert 0.8 * rim_px < below < 2.2 * rim_px
    above = look(pair, towards((0, 0, 1)), 1)
    assert difference(*above.pictures, above.stance, "front") == 0.0


def test_views_from_above_alone_leave_it_in_doubt_and_say_that_the_hole_is_hidden() -> None:
    from_above = np.stack([q for d, q in plate_views().items() if d[2] > 0.3])
    found = settle([held("plain"), held("holed")], from_above)
    assert found.first is None
    (pair,) = found.indistinguishable
    assert pair.pair == (0, 1)
    assert pair.best_margin == 0.0
    assert "hides" in pair.reason
    assert "8.0 mm" in pair.reason  # which bore


def test_a_part_turned_into_itself_is_never_told_from_itself_and_that_is_said() -> None:
    found = settle([held("plain"), held("plain", np.diag([-1.0, -1.0, 1.0, 1.0]), "turned")])
    assert found.first is None
    assert found.worst_s == 0.0
    (pair,) = found.indistinguishable
    assert "same shape in the same pose" in pair.reason
    assert found.separations.margins.max() < 1.0


def test_a_difference_too_small_for_the_hold_is_said_to_be_in_sight_but_too_small() -> None:
    slightly = HeldHypothesis(
        "slightly longer", solid_of(box(61.2, 40, 12), "slightly"), inverse_pose(in_hand())
    )
    found = settle([held("plain"), slightly])
    assert found.first is None
    assert "in sight" in found.indistinguishable[0].reason


def test_the_other_end_down_is_told_where_the_hole_then_is() -> None:
    half_turn = np.diag([1.0, -1.0, -1.0, 1.0])  # the hole is above then, and on the other side
    found = settle([held("holed"), held("holed", half_turn, "upside down")])
    assert found.first is not None
    assert found.indistinguishable == ()


def test_among_three_every_pair_is_parted_and_the_dearest_way_is_priced() -> None:
    trio = [held("plain"), held("holed"), held("other")]
    found = settle(trio)
    assert found.indistinguishable == ()
    assert found.first is not None
    for truth in range(3):
        left, ask, spent = (0, 1, 2), found.first, 0.0
        while ask is not None:
            spent += 5.0
            row = LIGHTS.index(ask.light)
            margins = found.separations.margins[ask.view, row]
            pairs = found.separations.pairs
            left = tuple(
                c
                for c in left
                if c == truth or margins[pairs.index((min(c, truth), max(c, truth)))] < 1.0
            )
            step = ask.after(left)
            assert step is not None
            assert step[0] == left
            ask = step[1]
        assert left == (truth,)
        assert spent <= found.worst_s + 1e-9


@pytest.mark.parametrize(("truth", "seed"), [(0, 1), (1, 2), (2, 3)])
def test_pictures_of_a_part_held_a_little_off_leave_only_what_it_is(truth: int, seed: int) -> None:
    trio = [held("plain"), held("holed"), held("other")]
    below = towards((0, 0, -1))
    light: Light = "front"
    seen = look([*trio, moved(trio[truth], seed)], below)
    predicted = PredictedPictures(seen.roi, seen.pictures[:3], seen.stance)
    differs = compare(seen.pictures[3], predicted, light, (0, 1, 2))
    identify = discriminate(differs, apart(predicted, light), light, (0, 1, 2))
    assert identify.left == (truth,)


def test_a_picture_that_fits_nothing_leaves_nothing_and_one_from_above_leaves_both() -> None:
    pair = [held("plain"), held("holed")]
    seen = look([*pair, held("through")], towards((0, 0, -1)))
    predicted = PredictedPictures(seen.roi, seen.pictures[:2], seen.stance)
    differs = compare(seen.pictures[2], predicted, "backlight", (0, 1))
    assert discriminate(differs, apart(predicted, "backlight"), "backlight", (0, 1)).left == ()
    seen = look([*pair, moved(pair[1], 3)], towards((0, 0, 1)))
    predicted = PredictedPictures(seen.roi, seen.pictures[:2], seen.stance)
    differs = compare(seen.pictures[2], predicted, "front", (0, 1))
    identify = discriminate(differs, apart(predicted, "front"), "front", (0, 1))
    assert sorted(identify.left) == [0, 1]


@pytest.mark.slow
@pytest.mark.parametrize(("truth", "seed"), [(0, 5), (1, 6), (2, 7)])
def test_photographs_under_lamps_say_which_one_is_in_the_hand(truth: int, seed: int) -> None:
    # by the tests' own renderer: Lambert, shadows, blur, noise; the part a little off in the hand
    trio = [held("plain"), held("holed"), held("other")]
    q = towards((0, 0, -1))
    predicted = predict_view(trio, [model_of(c) for c in trio], LAYOUT, q, OPENING_MM, 1, RULES)
    assert predicted is not None
    real = moved(trio[truth], seed)
    body = placed(real.solid.mesh, tcp_pose(LAYOUT, q) @ real.T_tcp_part)
    boxes = Scene(LAYOUT, OPENING_MM, 0.0).arm_boxes(q)
    others = [trimesh.creation.box(extents=2 * b.half_mm, transform=b.T) for b in boxes]
    panel = np.array([[50.0, 250, 180], [650, 250, 180], [650, 250, 720], [50, 250, 720]])
    shots = Renderer(
        Pictured(body, trimesh.util.concatenate(others), panel), LAYOUT.inspection, seed
    )
    ring = PointLamp.ring("ring", np.array([350.0, -690, 450]), np.array([0, 1.0, 0]), 60.0, 3)
    side = PointLamp("side", np.array([[-120.0, -620, 820]]))
    measured = measured_picture(predicted, shots.backlit(), [shots.lit(ring), shots.lit(side)])
    identify = discriminate(
        compare(measured, predicted, "front", (0, 1, 2)),
        apart(predicted, "front"),
        "front",
        (0, 1, 2),
        edges_shown(predicted),
    )
    assert identify.left == (truth,)
    dark = compare(measured, predicted, "backlight", (0, 1, 2))
    assert (dark[[0, 1, 2]] < RULES.min_area_px).all()  # the outline fits all three


def made_up(*rows: tuple[float, float, float]) -> Separations:
    """Margins of the pairs 01, 02, 12 against the backlight, per view."""
    margins = np.zeros((len(rows), 2, 3))
    margins[:, 0] = rows
    return Separations(((0, 1), (0, 2), (1, 2)), margins, np.ones(len(rows), bool))


def test_views_offered_hold_every_candidate_free_of_contact_before_the_camera() -> None:
    pair = [held("plain"), held("longer")]
    q, seconds = offered_views(pair, LAYOUT, OPENING_MM, LAYOUT.park_q, 24)
    assert len(q) > 10
    assert (seconds >= LAYOUT.cell_times.look_s(lit_count=1)).all()
    for c in pair:
        half = np.ptp(c.solid.mesh.vertices, axis=0) / 2
        carried = Box(np.eye(4), half).placed(c.T_tcp_part)
        assert Scene(LAYOUT, OPENING_MM, LAYOUT.fixed_open_mm, carried).free(q).all()
    for row in q:
        com = tcp_pose(LAYOUT, row) @ pair[0].T_tcp_part
        np.testing.assert_allclose(com[:3, 3], LAYOUT.station_mm, atol=1.0)


def test_one_dear_view_beats_two_cheap_ones_only_when_it_is_cheaper_than_both() -> None:
    # view 0 parts 0 from the others, view 1 parts 1 from 2, view 2 parts all
    table = made_up((9, 9, 0), (0, 0, 9), (9, 9, 9))
    one, worst_s = cheapest_tree(3, table, np.array([5.0, 5.0, 9.0]))
    assert one is not None
    assert (one.view, one.view_count, worst_s) == (2, 1, 9.0)
    two, worst_s = cheapest_tree(3, table, np.array([5.0, 5.0, 12.0]))
    assert two is not None
    assert (two.view, two.view_count, worst_s) == (0, 2, 10.0)
    assert two.groups == ((0,), (1, 2))
    assert two.then[0] is None


def test_where_no_view_parts_the_middle_one_from_one_side_the_chain_is_still_walked() -> None:
    # 0 and 2 are parted by view 0, which cannot tell 1 from either; view 1 parts 0 from 1
    found, worst_s = cheapest_tree(3, made_up((0, 9, 0), (9, 0, 0)), np.array([4.0, 6.0]))
    assert found is not None
    assert worst_s == 10.0
    assert found.view_count == 2
    nothing, worst_s = cheapest_tree(3, made_up((0.9, 0.5, 0.0)), np.array([4.0]))
    assert nothing is None
    assert worst_s == 0.0


@pytest.mark.slow
def test_dear_views_are_left_unlooked_at_only_where_none_of_them_can_be_the_choice() -> None:
    trio = [held("plain"), held("holed"), held("other")]
    offered = np.stack(list(plate_views().values()))
    # at equal prices every view is looked at
    whole = separating_views(trio, LAYOUT, offered, np.full(len(offered), 5.0), OPENING_MM)
    margins = whole.separations.margins
    for seed in range(3):
        seconds = np.random.default_rng(seed).uniform(4.0, 9.0, len(offered))
        found = separating_views(trio, LAYOUT, offered, seconds, OPENING_MM)
        assert found.first is not None
        parting = margins.min(axis=2).max(axis=1)
        costs = [s * (1 + 0.5 / m) for s, m in zip(seconds, parting, strict=True) if m >= 1.0]
        chosen = seconds[found.first.view] * (1 + 0.5 / found.first.margin)
        assert found.first.view_count > 1 or chosen <= min(costs) + 1e-6


@pytest.mark.slow
def test_a_gear_is_told_from_its_mirror_image() -> None:
    gear, mirror = (load_solid(part_file(f"cycloidal_gear{end}.stl")) for end in ("", "_mirror"))
    extent = gear.mesh.extents
    thin = int(np.argmin(extent))
    y, x = np.eye(3)[thin], np.eye(3)[(thin + 1) % 3]
    T = np.eye(4)
    T[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    T[:3, 3] = gear.centroid_mm - x * (extent[(thin + 1) % 3] / 2 - 15)
    opening = float(extent[thin])
    held_gear = HeldHypothesis("gear", gear, inverse_pose(T))
    # end for end about its middle the mirror image lies best in the gear, of all turns about it
    over = np.eye(4)
    over[:3, :3] = np.diag([1.0, -1.0, -1.0])
    over[:3, 3] = gear.centroid_mm - over[:3, :3] @ mirror.centroid_mm
    for twin in (inverse_pose(T), inverse_pose(T) @ over):
        pair = [held_gear, HeldHypothesis("mirror image", mirror, twin)]
        q, seconds = offered_views(pair, LAYOUT, opening, LAYOUT.park_q, 30)
        found = separating_views(pair, LAYOUT, q, seconds, opening)
        assert found.first is not None
        assert found.first.margin > 2.0
        assert found.worst_s == pytest.approx(seconds[found.first.view])
    same = separating_views([held_gear, held_gear], LAYOUT, q, seconds, opening)
    assert same.first is None


@settings(max_examples=60, deadline=None)
@given(
    apart_px=st.lists(st.floats(0, 900), min_size=6, max_size=6),
    truth=st.integers(0, 3),
    clutter_px=st.floats(0, 15),
    order=st.permutations(range(4)),
)
def test_the_truth_is_never_ruled_out_by_a_picture_that_fits_it_and_names_do_not_matter(
    apart_px: list[float], truth: int, clutter_px: float, order: list[int]
) -> None:
    table = np.zeros((4, 4))
    table[np.triu_indices(4, 1)] = apart_px
    table += table.T
    differs = table[truth] + clutter_px
    left = discriminate(differs, table, "front", range(4)).left
    assert truth in left
    # gone are those, and only those, that look different enough from what it is
    assert {c for c in range(4) if c not in left} == {
        c for c in range(4) if table[left[0], c] >= 40.0 and c not in left
    }
    assert set(left) >= {c for c in range(4) if table[truth, c] < 20.0}
    renamed = discriminate(differs[order], table[np.ix_(order, order)], "front", range(4)).left
    if len(set(differs)) == 4:
        assert [order[c] for c in renamed] == list(left)
