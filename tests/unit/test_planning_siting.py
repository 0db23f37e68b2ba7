"""Where camera and fixed gripper may stand, and that the search finds the right sites."""

from __future__ import annotations

from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
import trimesh
from planning_cell import emulated_layout

from controller.cad import Solid, make_solid, sample_surface
from controller.imaging import inverse_pose
from controller.planning import Box, CellLayout, PlanOptions, PreparedPart, Tray, prepare_part
from controller.planning.motion import tcp_pose
from controller.siting import (
    CellSite,
    PartScore,
    SiteOptions,
    SiteScore,
    find_sites,
    placed_at,
    reasons_to_move,
    site_of,
    site_report,
)
from controller.siting.checks.checked import passed_on
from controller.siting.checks.keepouts import (
    glowing_area,
    standing_boxes,
    why_not_here,
)
from controller.siting.checks.reach import shown_directions, sphere
from controller.siting.checks.visibility import links_in_sight
from controller.siting.report import least_moved
from controller.siting.score import value_of
from controller.siting.search.grids import (
    camera_grid,
    direction,
    fixed_gripper_frame,
    fixed_gripper_grid,
)
from controller.siting.site import fellows_of, standoff_mm

LAYOUT = emulated_layout()
FELLOWS = fellows_of(LAYOUT)
AT_TIPS = np.zeros(3)
FEW = SiteOptions(
    arm_grasps=3,
    fixed_grasps=2,
    directions=24,
    checked_cameras=2,
    checked_fixed_poses=2,
    local_steps=0,
)


def block(x: float, y: float, z: float) -> Solid:
    mesh = trimesh.creation.box((x, y, z))
    return make_solid(mesh, "block", "0123456789abcdef", where="block")


@pytest.fixture(scope="module")
def prepared_block() -> PreparedPart:
    solid = block(60.0, 40.0, 30.0)
    options = PlanOptions(
        direction_count=24, arm_grasps_per_pose=2, arm_grasps_round=4, fixed_grasps=3
    )
    return prepare_part(solid, sample_surface(solid, 8.0), LAYOUT, options)


def seen_from(side: np.ndarray) -> float:
    """Share of the view sphere that one free hand at the station turns towards a side."""
    site = CellSite(np.array([350.0, 0.0, 450.0]), side, None)
    return float(shown_directions(LAYOUT, site, sphere(300), AT_TIPS).mean())


def test_a_hand_shows_most_to_a_camera_at_its_side_and_least_to_one_overhead() -> None:
    # the order of planning-facts.md 3.1; of the whole sphere 0.99 sideways, about half from above
    side, above = seen_from(direction(90.0, 0.0)), seen_from(direction(0.0, 45.0))
    ahead, overhead = seen_from(direction(0.0, 0.0)), seen_from(direction(0.0, 90.0))
    assert side > above > ahead > overhead
    assert side > 0.97
    assert overhead < 0.6


def test_the_fingers_ends_are_never_shown_to_a_camera_overhead() -> None:
    # the hand would have to point up: pitch ends at +4 degrees (umi_rtx.md 5.2)
    site = CellSite(np.array([350.0, 0.0, 450.0]), direction(0.0, 90.0), None)
    hand = sphere(300)
    shown = shown_directions(LAYOUT, site, hand, AT_TIPS)
    pitch = np.degrees(np.arcsin(hand[:, 0]))  # of the approach, when that direction is up
    assert not shown[pitch > 4.0].any()
    # below, all that a roll of 313 degrees of a full turn (-132 to +181) leaves
    assert shown[(pitch < 2.0) & (pitch > -85.0)].mean() == pytest.approx(313 / 360, abs=0.03)


def test_both_sides_of_the_arm_are_alike() -> None:
    # mirrored across y = 0, the arm is itself but for which way its hand is turned over; the ends
    # of its joints' travel are not quite mirrored, so a direction in a hundred may differ
    hand = sphere(200)
    hand = np.vstack([hand * s for s in ([1, 1, 1], [1, -1, 1], [1, 1, -1], [1, -1, -1])])
    n = len(hand) // 4
    for x, y, side in ((350.0, 80.0, (60.0, 0.0)), (300.0, -120.0, (20.0, 30.0))):
        shown = [
            shown_directions(
                LAYOUT,
                CellSite(np.array([x, sign * y, 450.0]), direction(sign * a, e), None),
                hand,
                AT_TIPS,
            )
            for sign in (1.0, -1.0)
            for a, e in (side,)
        ]
        # a reflection takes direction (x, y, z) of the hand to (x, -y, z); either hand will do
        here = shown[0].reshape(4, n)
        there = shown[1].reshape(4, n)[[1, 0, 3, 2]]
        turned_here, turned_there = here | here[[3, 2, 1, 0]], there | there[[3, 2, 1, 0]]
        assert (turned_here != turned_there).mean() < 0.01
        assert 0.3 < turned_here.mean() < 1.0 or turned_here.all()


def test_obstacles_go_with_what_they_belong_to() -> None:
    assert set(FELLOWS.camera) == {"inspection camera", "station panel"}
    assert FELLOWS.fixed_gripper == ("fixture's post",)


@pytest.mark.parametrize("side", [(90.0, 0.0), (0.0, 45.0), (-30.0, -20.0), (0.0, 90.0)])
def test_a_moved_camera_sees_the_station_and_its_panel_as_before(side: tuple[float, float]) -> None:
    site = CellSite(np.array([300.0, 120.0, 500.0]), direction(*side), LAYOUT.T_world_fixed_tcp)
    moved = placed_at(LAYOUT, site, FELLOWS)
    assert standoff_mm(moved) == pytest.approx(standoff_mm(LAYOUT))
    before = LAYOUT.inspection.project(LAYOUT.station_mm[None])
    np.testing.assert_allclose(moved.inspection.project(site.station_mm[None]), before, atol=1e-6)
    for name in FELLOWS.camera:
        seen = [
            inverse_pose(cell.inspection.T_world_cam) @ cell.obstacles[name].T
            for cell in (LAYOUT, moved)
        ]
        np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    # upright: the picture's down is not up in the world
    assert moved.inspection.T_world_cam[2, 1] <= 1e-9


def test_the_present_site_is_the_present_cell() -> None:
    same = placed_at(LAYOUT, site_of(LAYOUT), FELLOWS)
    np.testing.assert_array_equal(same.inspection.T_world_cam, LAYOUT.inspection.T_world_cam)
    for name, box in LAYOUT.obstacles.items():
        np.testing.assert_array_equal(same.obstacles[name].T, box.T)
        np.testing.assert_array_equal(same.obstacles[name].half_mm, box.half_mm)
    assert why_not_here(same, FELLOWS) is None


@pytest.mark.parametrize("turn", [0.0, 90.0, 135.0, 270.0])
def test_a_fixture_put_elsewhere_keeps_its_post_behind_it_and_on_the_table(turn: float) -> None:
    along = direction(turn, 0.0)
    T = fixed_gripper_frame(np.array([300.0, 400.0, 500.0]), along, np.array([0.0, 0.0, 1.0]))
    post = placed_at(LAYOUT, replace(site_of(LAYOUT), T_world_fixed_tcp=T), FELLOWS).obstacles[
        "fixture's post"
    ]
    assert post.T[2, 3] - post.half_mm[2] == pytest.approx(0.0)
    # in the cell as it is: centre 195 mm behind the tips, top 90 mm over them
    np.testing.assert_allclose(T[:2, 3] - 195.0 * along[:2], post.T[:2, 3], atol=1e-9)
    assert post.T[2, 3] + post.half_mm[2] == pytest.approx(590.0)


def test_an_upright_fixture_stands_on_its_post() -> None:
    T = fixed_gripper_frame(
        np.array([300.0, -400.0, 500.0]), np.array([0.0, 0.0, 1.0]), direction(30, 0)
    )
    cell = placed_at(LAYOUT, replace(site_of(LAYOUT), T_world_fixed_tcp=T), FELLOWS)
    post = cell.obstacles["fixture's post"]
    np.testing.assert_allclose(post.T[:2, 3], T[:2, 3])
    assert post.T[2, 3] - post.half_mm[2] == pytest.approx(0.0)
    palm_end = 500.0 - 163.0
    assert palm_end - 5.0 <= post.T[2, 3] + post.half_mm[2] <= palm_end + 5.0


def points_in(box: Box, rng: np.random.Generator) -> np.ndarray:
    inside = rng.uniform(-1.0, 1.0, (200, 3)) * box.half_mm
    return np.asarray(inside @ box.T[:3, :3].T + box.T[:3, 3])


def test_no_allowed_site_stands_where_something_has_to_stay_free() -> None:
    rng = np.random.default_rng(1)
    (x0, x1), (y0, y1) = glowing_area(LAYOUT)
    eye = LAYOUT.overhead.position_mm
    allowed = 0
    sites = [
        *list(camera_grid(LAYOUT))[::29],
        *[
            replace(site_of(LAYOUT), T_world_fixed_tcp=T)
            for T in list(fixed_gripper_grid(LAYOUT))[::37]
        ],
    ]
    for site in sites:
        cell = placed_at(LAYOUT, site, FELLOWS)
        if why_not_here(cell, FELLOWS) is not None:
            continue
        allowed += 1
        posts, hanging = standing_boxes(cell, FELLOWS)
        for _, box in (*posts, *hanging):
            p = points_in(box, rng)
            assert (p[:, 2] > 0.0).all()
            for tray in LAYOUT.trays.values():
                over = np.abs(p[:, :2] - tray.centre_mm) < np.array(tray.size_mm) / 2
                assert not over.all(axis=1).any()
            # carried on down along the overhead camera's sight they meet the table beside its area
            below = p[:, 2] < eye[2]
            ground = eye + (p[below] - eye) * (eye[2] / (eye[2] - p[below, 2]))[:, None]
            inner = np.array([0.98, 0.98])
            off = np.abs(ground[:, :2] - [(x0 + x1) / 2, (y0 + y1) / 2])
            assert not (off < inner * [(x1 - x0) / 2, (y1 - y0) / 2]).all(axis=1).any()
    assert allowed > 10


def test_what_stands_in_the_way_is_named() -> None:
    now = site_of(LAYOUT)

    def why(site: CellSite, cell: CellLayout = LAYOUT) -> str:
        return why_not_here(placed_at(cell, site, FELLOWS), FELLOWS) or "allowed"

    assert "light table" in why(replace(now, towards=direction(0.0, 90.0)))
    T = fixed_gripper_frame(
        np.array([100.0, 390.0, 430.0]), direction(0, 0), np.array([0.0, 0.0, 1.0])
    )
    assert "tray" in why(replace(now, T_world_fixed_tcp=T))
    low = replace(now, station_mm=np.array([350.0, 0.0, 120.0]))
    assert "below the table" in why(low)
    wall = {**LAYOUT.obstacles, "cupboard": Box.from_bounds(200, 500, 600, 900, 0, 900)}
    fenced = replace(LAYOUT, obstacles=wall)
    assert why(replace(now, towards=direction(90.0, 0.0))) == "allowed"
    assert "cupboard" in why(replace(now, towards=direction(90.0, 0.0)), fenced)


def test_a_hand_hanging_under_the_forearm_is_hidden_from_above_and_not_from_the_side() -> None:
    # hand straight down, arm stretched forward: the forearm ends above the part
    q = np.array([[np.radians(40.0), np.radians(-80.0), 0.0, -200.0, -np.pi / 2, 0.0]])
    tip = tcp_pose(LAYOUT, q)[0, :3, 3]
    for side, hidden in ((direction(0.0, 90.0), True), (direction(-90.0, 0.0), False)):
        cell = placed_at(LAYOUT, CellSite(tip, side, LAYOUT.T_world_fixed_tcp), FELLOWS)
        assert links_in_sight(cell, q, 20.0).tolist() == [hidden]


def test_grasps_come_by_over_any_number_of_hand_offs() -> None:
    rng = np.random.default_rng(2)
    for _ in range(50):
        met = rng.random((5, 12)) < 0.15
        start = rng.random(12) < 0.2
        graph = nx.Graph()
        graph.add_nodes_from(range(12))
        graph.add_edges_from((f"f{f}", int(g)) for f, g in np.argwhere(met))
        wanted = {
            n for s in np.flatnonzero(start).tolist() for n in nx.node_connected_component(graph, s)
        }
        assert passed_on(start, met).tolist() == [g in wanted for g in range(12)]


def part_score(shown: float = 0.98, worst: float = 0.95, **other: float) -> PartScore:
    values = {
        "showable": 1.0, "joints_allow": 1.0, "views_share": 0.9, "partners_share": 0.8,
        "hand_offs_share": 0.3, "picks_share": 1.0, "view_s": 40.0, "regrasp_s": 15.0,
    }  # fmt: skip
    return PartScore(name="part", shown=shown, shown_worst=worst, **{**values, **other})


def site_score(*parts: PartScore, forbidden: str | None = None) -> SiteScore:
    trays = {"accept": 0.6}
    return SiteScore(site_of(LAYOUT), parts, "checked", value_of(parts, trays), forbidden, trays)


def test_nobody_moves_a_camera_for_a_tenth_of_a_percent() -> None:
    options = SiteOptions()
    now = site_score(part_score())
    assert reasons_to_move(now, now, options) == ()
    assert reasons_to_move(now, site_score(part_score(0.981, 0.951)), options) == ()
    assert (
        "2.0 % more of the surface" in reasons_to_move(now, site_score(part_score(1.0)), options)[0]
    )
    assert "worst pose" in reasons_to_move(now, site_score(part_score(0.98, 0.99)), options)[0]
    assert "s a part" in reasons_to_move(now, site_score(part_score(view_s=25.0)), options)[0]
    bad = site_score(part_score(), forbidden="the post would stand over the tray accept")
    assert "over the tray accept" in reasons_to_move(bad, now, options)[0]


def test_no_part_is_given_up_for_the_others() -> None:
    alike = value_of([part_score(0.9, 0.9), part_score(0.9, 0.9)])
    uneven = value_of([part_score(1.0, 1.0), part_score(0.8, 0.8)])
    assert alike > uneven


def test_siting_needs_a_part() -> None:
    with pytest.raises(ValueError, match="at least one part"):
        find_sites([], LAYOUT)


@pytest.mark.slow
def test_the_search_answers_the_same_each_time_and_never_below_the_present(
    prepared_block: PreparedPart,
) -> None:
    steps: list[tuple[str, int, int]] = []
    first = find_sites([prepared_block], LAYOUT, FEW, lambda *s: steps.append(s))
    again = find_sites([prepared_block], LAYOUT, FEW)
    assert [s.value for s in first] == [s.value for s in again]
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.site.station_mm, b.site.station_mm)
        np.testing.assert_array_equal(a.site.towards, b.site.towards)
        assert a.parts == b.parts
    values = [s.value for s in first if s.forbidden is None]
    assert values == sorted(values, reverse=True)
    now = site_of(LAYOUT)
    present = [
        s
        for s in first
        if np.allclose(s.site.station_mm, now.station_mm)
        and np.allclose(s.site.towards, now.towards)
        and np.allclose(s.site.T_world_fixed_tcp, now.T_world_fixed_tcp)
    ]
    assert len(present) == 1
    assert first[0].value >= present[0].value
    assert {what for what, _, _ in steps} >= {"camera sites", "fixed gripper poses"}
    assert all(0 <= done <= total for _, done, total in steps)


@pytest.mark.slow
def test_a_block_is_shown_whole_to_a_camera_beside_the_arm(prepared_block: PreparedPart) -> None:
    # every outer face of a convex block shows from outside; pads hide two of them, the next grip
    # shows these: sideways there is nothing the joints forbid
    report = site_report([prepared_block], LAYOUT, FEW)
    assert report.joints_allow == pytest.approx(1.0, abs=0.005)
    assert report.best.shown_mean > 0.99
    assert report.sentences[0].startswith("As it stands")
    assert report.stay == (len(report.sentences) == 2)


@pytest.mark.slow
def test_a_camera_bolted_down_stays_where_it_is(prepared_block: PreparedPart) -> None:
    found = find_sites([prepared_block], LAYOUT, replace(FEW, move_camera=False))
    now = site_of(LAYOUT)
    for score in found:
        np.testing.assert_array_equal(score.site.station_mm, now.station_mm)
        np.testing.assert_array_equal(score.site.towards, now.towards)


@pytest.mark.slow
def test_a_cell_without_a_fixed_gripper_gets_a_place_for_its_camera(
    prepared_block: PreparedPart,
) -> None:
    kept = {n: b for n, b in LAYOUT.obstacles.items() if n not in FELLOWS.fixed_gripper}
    alone = replace(LAYOUT, fixed_gripper=None, obstacles=kept)
    part = replace(prepared_block, fixed_grasps=(), hand_offs=())
    found = find_sites([part], alone, FEW)
    assert found[0].site.T_world_fixed_tcp is None
    assert found[0].parts[0].partners_share == 0.0
    assert found[0].shown_worst > 0.5


def test_a_tray_under_the_fixture_forbids_it_there() -> None:
    T = LAYOUT.T_world_fixed_tcp
    trays = {"odd": Tray((float(T[0, 3]), float(T[1, 3] - 100.0)), (80.0, 80.0))}
    cell = replace(LAYOUT, trays=trays)
    assert "tray odd" in (why_not_here(cell, FELLOWS) or "")


def test_of_equals_the_site_that_needs_the_smallest_moves_is_told() -> None:
    now = site_of(LAYOUT)
    far = replace(now, station_mm=now.station_mm + np.array([0.0, 0.0, 200.0]))
    near = replace(now, station_mm=now.station_mm + np.array([30.0, 0.0, 0.0]))
    turned = replace(now, towards=direction(-60.0, 0.0))  # 30 degrees, counted as 150 mm
    present = SiteScore(now, (), "checked", 0.90)
    found = [
        SiteScore(site, (), "checked", value)
        for site, value in ((far, 1.000), (turned, 0.9995), (near, 0.999))
    ]
    assert least_moved([*found, present], present, 0.002) is found[2]
    assert least_moved([*found, present], present, 0.0001) is found[0]
    assert least_moved([*found, present], present, 0.2) is present
    barred = replace(found[2], forbidden="no")
    assert least_moved([found[0], found[1], barred, present], present, 0.002) is found[1]


MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def mirrored_box(box: Box) -> Box:
    return Box(MIRROR @ box.T @ MIRROR, box.half_mm)


def mirrored_jaws(T: np.ndarray) -> np.ndarray:
    """A gripper across y = 0; its jaws' axis is a line and may point either way."""
    return np.asarray(MIRROR @ T @ np.diag([1.0, -1.0, 1.0, 1.0]))


def mirrored_cell(cell: CellLayout) -> CellLayout:
    def camera(T: np.ndarray) -> np.ndarray:
        return np.asarray(MIRROR @ T @ np.diag([-1.0, 1.0, 1.0, 1.0]))

    return replace(
        cell,
        obstacles={name: mirrored_box(box) for name, box in cell.obstacles.items()},
        station_mm=MIRROR[:3, :3] @ cell.station_mm,
        inspection=replace(cell.inspection, T_world_cam=camera(cell.inspection.T_world_cam)),
        overhead=replace(cell.overhead, T_world_cam=camera(cell.overhead.T_world_cam)),
        T_world_fixed_tcp=mirrored_jaws(cell.T_world_fixed_tcp),
        trays={
            name: replace(tray, centre_mm=(tray.centre_mm[0], -tray.centre_mm[1]))
            for name, tray in cell.trays.items()
        },
    )


def test_the_mirrored_cell_allows_the_mirrored_sites() -> None:
    other = mirrored_cell(LAYOUT)
    fellows = fellows_of(other)
    assert fellows == FELLOWS
    sites = [
        *list(camera_grid(LAYOUT))[::31],
        *[
            replace(site_of(LAYOUT), T_world_fixed_tcp=T)
            for T in list(fixed_gripper_grid(LAYOUT))[::41]
        ],
    ]
    allowed = 0
    for site in sites:
        there = CellSite(
            MIRROR[:3, :3] @ site.station_mm,
            MIRROR[:3, :3] @ site.towards,
            mirrored_jaws(site.T_world_fixed_tcp),
        )
        here_why = why_not_here(placed_at(LAYOUT, site, FELLOWS), FELLOWS)
        there_why = why_not_here(placed_at(other, there, fellows), fellows)
        assert (here_why is None) == (there_why is None), (site, here_why, there_why)
        allowed += here_why is None
    assert 0 < allowed < len(sites)
