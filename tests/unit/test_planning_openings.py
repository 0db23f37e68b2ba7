"""Light through bores: which views show it, past part and gripper, and that plans take them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from planning_cell import emulated_layout

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid, counted_samples, sample_surface, stable_poses
from controller.imaging import RayCaster, inverse_pose
from controller.planning import (
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    Present,
    plan_from,
    prepare_part,
    resting_pose,
)
from controller.planning.geometry import Box, segments_hit
from controller.planning.model import FaceToShowAgain
from controller.planning.planner.prepare import without_short
from controller.planning.views import (
    VisibilityRules,
    by_element,
    directions_to_openings,
    find_openings,
    holding_boxes,
    lit_from,
    lit_past,
)

LAYOUT = emulated_layout()
DEPTH_MM, RADIUS_MM = 20.0, 4.0
# a through bore off the middle, square to the plate, and a blind one
PLATE = solid_of(
    box(60, 40, DEPTH_MM)
    - rod(RADIUS_MM, 60, 64).translate((-14, 6, 0))
    - rod(RADIUS_MM, 20, 64).translate((16, -6, 15)),
    "plate",
)
CASTER = RayCaster(PLATE.mesh)
AWAY_MM = 700.0


def walls(solid: Solid) -> list[int]:
    return [f.id for f in solid.faces if f.kind == "cylinder" and f.concave]


def is_blind(face: int) -> bool:
    """Return whether a wall of the plate is that of the blind bore, to the right."""
    mine = PLATE.mesh.triangles_center[PLATE.face_of_triangle == face]
    return bool(mine[:, 0].mean() > 0)


(THROUGH,) = (f for f in walls(PLATE) if not is_blind(f))
(BLIND,) = (f for f in walls(PLATE) if is_blind(f))
BORE_MM = PLATE.mesh.triangles_center[PLATE.face_of_triangle == THROUGH].mean(axis=0)
FLOOR_MM = np.array([16.0, -6.0, 5.0])


def eye_at(tilt_deg: float, at_mm: FloatArray = BORE_MM) -> FloatArray:
    """Return an eye (1, 3) that looks at a place from above, so far off the plate's normal."""
    tilt = np.radians(tilt_deg)
    return np.array([at_mm + AWAY_MM * np.array([0.0, np.sin(tilt), np.cos(tilt)])])


def shown_of(face: int, lit: BoolArray) -> int:
    """Return how many elements of a bore are shown: sectors, or the one of a floor."""
    openings = find_openings(PLATE)
    return int(by_element(openings, lit)[0][openings.faces == face].sum())


def open_sectors(lit: BoolArray) -> int:
    return shown_of(THROUGH, lit)


def test_along_the_axis_all_of_a_through_bore_is_open_and_none_of_a_blind_one() -> None:
    openings = find_openings(PLATE)
    assert set(openings.faces.tolist()) == set(walls(PLATE))
    lit = by_element(openings, lit_from(openings, CASTER, eye_at(0.0)))[0]
    assert lit[openings.faces == THROUGH].all()
    assert not lit[openings.faces != THROUGH].any()


def test_no_light_passes_at_an_angle_that_the_wall_cuts_off() -> None:
    openings = find_openings(PLATE)
    # at this angle the far rim has moved by the bore's width against the near one
    steepest = np.degrees(np.arctan2(2 * RADIUS_MM, DEPTH_MM))
    counts = [
        open_sectors(lit_from(openings, CASTER, eye_at(share * steepest)))
        for share in (0.2, 0.6, 1.1)
    ]
    assert counts[0] > counts[-1] == 0
    assert counts == sorted(counts, reverse=True)


@pytest.mark.parametrize(
    ("tilt_deg", "is_shown"),
    # along the axis a floor shows at the same place however deep it is; from below it is hidden,
    # and past 58 degrees the mouth hides all of it (8 mm wide, 5 mm deep)
    [(0.0, False), (15.0, True), (30.0, True), (65.0, False), (170.0, False)],
)
def test_a_slanting_look_shows_the_floor_of_a_blind_bore(tilt_deg: float, is_shown: bool) -> None:
    lit = lit_from(find_openings(PLATE), CASTER, eye_at(tilt_deg, FLOOR_MM))
    assert shown_of(BLIND, lit) == is_shown


def test_a_deep_bore_gets_directions_of_its_own_to_its_floor() -> None:
    deep = solid_of(box(40, 30, 40) - rod(4.0, 60, 64).translate((0, 0, 26)), "deep")
    caster, openings = RayCaster(deep.mesh), find_openings(deep)
    few = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    eyes = deep.centroid_mm + AWAY_MM * few
    assert not by_element(openings, lit_from(openings, caster, eyes)).any()
    rules = replace(VisibilityRules.of_station(LAYOUT, 70.0), distance_mm=AWAY_MM)
    added = directions_to_openings(openings, deep, caster, few, rules)
    assert len(added)
    eyes = deep.centroid_mm + AWAY_MM * added
    assert by_element(openings, lit_from(openings, caster, eyes)).all()
    # what is shown already gets none
    assert not len(directions_to_openings(openings, deep, caster, added, rules))


# a cross hole of 4.2 mm, 4 mm below the top of a tube: light that comes in over the far rim of the
# tube falls by 4 - 2.1 mm at least on the 12 mm or less to the hole
TUBE_MM, WALL_MM, CROSS_MM, BELOW_MM = 6.0, 12.0, 2.1, 4.0
LEAST_RAD = np.arctan((BELOW_MM - CROSS_MM) / (2 * TUBE_MM))
TUBE = solid_of(
    rod(WALL_MM, 40.0, 96)
    - rod(TUBE_MM, 60.0, 96)
    - rod(CROSS_MM, 30.0, 64).rotate((0, 90, 0)).translate((15, 0, 20.0 - BELOW_MM)),
    "tube",
)
(CROSS,) = (f for f in walls(TUBE) if abs(TUBE.faces[f].axis[0]) > 0.9)


def cross_sectors(directions: FloatArray) -> int:
    """Return how many sectors of the cross hole some directions (v, 3) to the camera show."""
    openings = find_openings(TUBE)
    lit = lit_from(openings, RayCaster(TUBE.mesh), TUBE.centroid_mm + AWAY_MM * directions)
    return int(by_element(openings, lit)[:, openings.faces == CROSS].any(axis=0).sum())


def test_light_along_a_bore_shows_nothing_of_a_hole_across_it() -> None:
    # the rim of the hole is a saddle, of which two ends stick out into the light
    tilt = np.radians(np.arange(0.0, 16.0, 3.0))
    along = np.column_stack([np.sin(tilt), 0 * tilt, np.cos(tilt)])
    assert cross_sectors(along * [-1, 1, 1]) == cross_sectors(along) == 0


def test_a_hole_that_ends_in_a_bore_gets_directions_in_which_light_passes_it() -> None:
    along = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    few = np.vstack([along, [[1.0, 0.0, 0.0], [0.8, 0.0, 0.6]]])
    assert cross_sectors(few) == 0
    caster, openings = RayCaster(TUBE.mesh), find_openings(TUBE)
    rules = replace(VisibilityRules.of_station(LAYOUT, 70.0), distance_mm=AWAY_MM)
    added = directions_to_openings(openings, TUBE, caster, few, rules)
    assert cross_sectors(added) > 0.5 * 12
    to_eye = TUBE.centroid_mm + AWAY_MM * added - [WALL_MM, 0.0, 20.0 - BELOW_MM]
    slope = np.arctan2(np.abs(to_eye[:, 2]), np.hypot(to_eye[:, 0], to_eye[:, 1]))
    assert (slope > 0.9 * LEAST_RAD).all()  # 4 of 360 mm wide, it is no point


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_finger_before_the_part_or_behind_it_takes_the_light(side: float) -> None:
    openings, eye = find_openings(PLATE), eye_at(0.0)
    lit = lit_from(openings, CASTER, eye)
    T = np.eye(4)
    T[:3, 3] = BORE_MM + np.array([0.0, 0.0, side * 60.0])
    finger = Box(T, np.array([20.0, 10.0, 4.0]))
    assert open_sectors(lit_past(openings, lit, eye, np.eye(4), [finger])) == 0
    T[:3, 3] += [0.0, 40.0, 0.0]
    beside = Box(T, finger.half_mm)
    assert (lit_past(openings, lit, eye, np.eye(4), [beside]) == lit).all()


def test_a_finger_behind_a_floor_takes_nothing() -> None:
    openings, eye = find_openings(PLATE), eye_at(20.0, FLOOR_MM)
    lit = lit_from(openings, CASTER, eye)
    T = np.eye(4)
    T[:3, 3] = FLOOR_MM - np.array([0.0, 0.0, 40.0])
    behind = Box(T, np.array([30.0, 30.0, 4.0]))
    assert shown_of(BLIND, lit_past(openings, lit, eye, np.eye(4), [behind]))
    T[:3, 3] += np.array([0.0, 0.0, 80.0])
    assert not shown_of(BLIND, lit_past(openings, lit, eye, np.eye(4), [Box(T, behind.half_mm)]))


OPTIONS = PlanOptions(
    direction_count=50, arm_grasps_per_pose=4, arm_grasps_round=6, fixed_grasps=6, least_gain=0.02
)


@pytest.fixture(scope="module")
def prepared() -> PreparedPart:
    samples = sample_surface(PLATE, 8.0, 2)
    return prepare_part(PLATE, samples, LAYOUT, OPTIONS, counted_samples(PLATE, 1.5))


def planned(part: PreparedPart) -> Plan:
    pose = stable_poses(PLATE)[0]
    start = OnTable(pose.index, resting_pose(PLATE, pose, 350.0, 40.0, 0.4))
    return plan_from(part, LAYOUT, start)


def open_share(plan: Plan) -> float:
    """Return the share of the bore's rim along which some view of a plan shows light.

    By lines of the test's own: a ring half a millimetre inside the wall, at either mouth.
    """
    turns = np.arange(72) * np.pi / 36
    ring = (RADIUS_MM - 0.5) * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    shown = np.zeros(len(turns), dtype=bool)
    for step in plan.steps:
        if not isinstance(step, Present):
            continue
        eye = inverse_pose(step.T_world_part) @ [*LAYOUT.inspection.position_mm, 1.0]
        T_tcp_part = inverse_pose(step.grasp.T_part_tcp)
        boxes = holding_boxes(LAYOUT.arm_gripper, step.grasp)
        for end in (-0.5 * DEPTH_MM, 0.5 * DEPTH_MM):
            points = BORE_MM + ring + [0.0, 0.0, end]
            ways = points - eye[:3]
            free = ~CASTER.blocked(np.broadcast_to(eye[:3], ways.shape), ways)
            far, near = (
                np.column_stack([p, np.ones(len(ways))]) @ T_tcp_part[:3].T
                for p in (points + 0.3 * ways, np.broadcast_to(eye[:3], ways.shape))
            )
            shown |= free & ~segments_hit(far, near, tuple(boxes))
    return float(shown.mean())


def test_a_plan_shows_light_through_the_greater_part_of_a_bores_rim(
    prepared: PreparedPart,
) -> None:
    assert open_share(planned(prepared)) > 0.5
    nothing_asked = replace(
        prepared, shown_open=tuple(np.zeros_like(table) for table in prepared.shown_open)
    )
    # the surface alone does not make the plan look through the bore
    assert open_share(planned(nothing_asked)) < 0.5


def floor_is_shown(plan: Plan) -> bool:
    """Return whether a view, tilted by ten degrees, sees a quarter of the blind floor's edge."""
    turns = np.arange(72) * np.pi / 36
    edge = FLOOR_MM + (RADIUS_MM - 0.4) * np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    edge[:, 2] += 0.4
    best = 0.0
    for step in plan.steps:
        if isinstance(step, Present):
            eye = (inverse_pose(step.T_world_part) @ [*LAYOUT.inspection.position_mm, 1.0])[:3]
            ways = edge - eye
            seen = ~CASTER.blocked(np.broadcast_to(eye, ways.shape), ways, np.ones(len(ways)))
            tilt = np.arccos(-ways.mean(axis=0)[2] / np.linalg.norm(ways.mean(axis=0)))
            best = max(best, float(seen.mean()) if tilt > np.radians(9.5) else 0.0)
    return best > 0.25


def test_a_plan_shows_the_floor_of_a_blind_bore(prepared: PreparedPart) -> None:
    assert floor_is_shown(planned(prepared))


def test_a_bore_that_a_grasp_left_unproven_is_open_from_other_grasps_only(
    prepared: PreparedPart,
) -> None:
    grasp = prepared.arm_grasps[0].id
    left = without_short(prepared, [FaceToShowAgain(grasp, THROUGH)])
    mine = prepared.openings.faces == THROUGH
    assert not left.shown_open[0][:, mine].any()
    assert (left.shown_open[0][:, ~mine] == prepared.shown_open[0][:, ~mine]).all()
    other = next(
        k
        for k, g in enumerate(prepared.arm_grasps)
        if g.id.removesuffix("'") != grasp.removesuffix("'")
    )
    assert (left.shown_open[other] == prepared.shown_open[other]).all()
