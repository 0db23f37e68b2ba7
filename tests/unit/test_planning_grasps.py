"""Grasps of parts with a plain right answer: blocks, balls, rings, wedges, a tetrahedron."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import manifold3d
import numpy as np
import pytest
import trimesh
from cad_solids import box, prism, rod
from cad_solids import solid_of as cad_solid
from grasp_bench import DOWN, HAND, QUICK, RULES, SPREADING, downs_of, judged
from planning_cell import PARTS, emulated_layout

from controller.cad import Solid, make_solid, sample_surface, stable_poses
from controller.cad.compiled import load_part
from controller.imaging import RayCaster
from controller.planning import Grasp, GraspRules, NotGraspableError, PlanOptions
from controller.planning.grasps import (
    GraspProblem,
    clear_of_table,
    find_seeds,
    judge_grasps,
    resting_pose,
    synthesise_grasps,
)
from controller.planning.grasps.clearance import lifts_off_table
from controller.planning.grasps.seeds import from_above
from controller.planning.model import Pads

WIDEST_MM = HAND.max_mm - RULES.jaw_reserve_mm


def solid_of(mesh: trimesh.Trimesh, name: str = "part") -> Solid:
    return make_solid(mesh, name, "0123456789abcdef", where=name)


def grips_of(solid: Solid, rules: GraspRules = QUICK) -> tuple[Grasp, ...]:
    caster = RayCaster(solid.mesh)
    seeds = find_seeds(solid, sample_surface(solid, 5.0), caster, WIDEST_MM, rules)
    return synthesise_grasps(GraspProblem(solid, seeds, caster, DOWN, rules), HAND, "arm")


def test_a_block_is_held_across_its_widths_and_nothing_else() -> None:
    grasps = grips_of(solid_of(trimesh.creation.box((60.0, 40.0, 30.0))))
    widths = np.array([60.0, 40.0, 30.0])
    for grasp in grasps:
        axis = np.abs(grasp.T_part_tcp[:3, 1])
        across = int(np.argmax(axis))
        assert axis[across] > 0.999
        assert grasp.opening_mm == pytest.approx(widths[across], abs=0.05)
        # both pads stand on opposite faces: the jaw's middle is the block's middle
        assert grasp.T_part_tcp[across, 3] == pytest.approx(0.0, abs=0.05)
        assert grasp.pre_open_mm >= grasp.opening_mm + 2.0
        # a pad is 12 x 24 mm, no contact can be larger
        assert RULES.min_contact_mm2 <= grasp.contact_mm2 <= 12 * 24 + 1e-6
        assert np.linalg.det(grasp.T_part_tcp[:3, :3]) == pytest.approx(1.0)
    assert {int(np.argmax(np.abs(g.T_part_tcp[:3, 1]))) for g in grasps} == {0, 1, 2}


def test_the_open_hand_never_reaches_into_the_block_above_tray_in() -> None:
    mesh = trimesh.creation.box((60.0, 40.0, 30.0))
    rng = np.random.default_rng(0)
    for grasp in grips_of(solid_of(mesh))[::25]:
        for behind in (0.0, 30.0, 60.0):
            T = grasp.T_part_tcp.copy()
            T[:3, 3] -= behind * T[:3, 0]
            for part in (*HAND.body, *HAND.fingers(grasp.pre_open_mm)):
                points = rng.uniform(-1, 1, (300, 3)) * part.half_mm
                placed = T @ part.T
                world = points @ placed[:3, :3].T + placed[:3, 3]
                assert not np.any(np.all(np.abs(world) < [30.0, 20.0, 15.0], axis=1))


def test_a_tetrahedron_is_refused_with_the_friction_angle_it_would_need() -> None:
    corners = 25.0 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    mesh = trimesh.convex.convex_hull(corners)
    # half of what the faces' 109.47 degrees lack of 180; friction 0.6 is 30.96 degrees
    with pytest.raises(NotGraspableError, match=r"needed 35\.3 deg, have 31\.0"):
        grips_of(solid_of(mesh, "tetra"))


def test_a_cube_wider_than_the_jaw_is_refused_with_the_width_that_would_do() -> None:
    with pytest.raises(NotGraspableError, match=r"at most 80 mm apart.* are 120\.0 mm apart"):
        grips_of(solid_of(trimesh.creation.box((120.0, 120.0, 120.0)), "cube"))


def test_a_lead_block_is_refused_with_the_load_it_would_be() -> None:
    solid = solid_of(trimesh.creation.box((60.0, 60.0, 60.0)), "lead")
    rules = replace(QUICK, density_kg_mm3=11.34e-6)
    weight_n = 60**3 * 11.34e-6 * 9.81
    # even with no lever: W / (2 mu N)
    least = weight_n / (2 * rules.friction * HAND.force_n)
    assert least > rules.max_load
    with pytest.raises(NotGraspableError, match=rf"best {least:.2g}\d*, 0.5 of the friction limit"):
        grips_of(solid, rules)
    # the force at which that share is just allowed
    needed_n = int(np.ceil(weight_n / (2 * rules.friction * rules.max_load)))
    with pytest.raises(NotGraspableError, match=rf"press with {needed_n} N or more, or fit pads"):
        grips_of(solid, rules)


def test_each_gripper_is_judged_with_its_own_pads() -> None:
    solid = solid_of(trimesh.creation.box((60.0, 60.0, 60.0)), "steel")
    rules = replace(QUICK, density_kg_mm3=7.85e-6)
    caster = RayCaster(solid.mesh)
    seeds = find_seeds(solid, sample_surface(solid, 5.0), caster, WIDEST_MM, rules)

    def held(assumed: float, pads: float) -> tuple[Grasp, ...]:
        problem = GraspProblem(solid, seeds, caster, DOWN, replace(rules, friction=assumed))
        jaw = replace(HAND, pads=Pads(friction=pads, compliance_mm=rules.compliance_mm))
        return synthesise_grasps(problem, jaw, "arm")

    assert held(0.2, 0.6)
    with pytest.raises(NotGraspableError, match=r"friction 0\.2 use"):
        held(0.6, 0.2)


def test_oil_refuses_what_dry_pads_hold() -> None:
    solid = solid_of(trimesh.creation.box((60.0, 60.0, 60.0)), "steel")
    steel = replace(QUICK, density_kg_mm3=7.85e-6)
    assert grips_of(solid, steel)
    with pytest.raises(NotGraspableError, match="of the friction limit required"):
        grips_of(solid, replace(steel, friction=0.2))


def test_every_grip_keeps_what_the_rules_ask() -> None:
    for grasp in grips_of(solid_of(trimesh.creation.box((60.0, 40.0, 30.0)))):
        assert grasp.contact_mm2 >= RULES.min_contact_mm2
        assert grasp.load <= RULES.max_load
        assert grasp.margin >= RULES.min_margin
        assert 0.0 < grasp.score <= 1.0


def test_a_ball_is_held_on_two_caps_as_deep_as_the_pads_give() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=20.0)
    grasps = grips_of(solid_of(mesh, "ball"))
    depth = RULES.compliance_mm
    cap_mm2 = np.pi * (2 * 20.0 * depth - depth**2)
    for grasp in grasps:
        assert grasp.opening_mm == pytest.approx(40.0, abs=0.1)
        # the jaws' axis goes through the centre as far as a pad's length lets it miss it
        assert grasp.contact_mm2 <= cap_mm2 + 4.0
    assert max(g.contact_mm2 for g in grasps) == pytest.approx(cap_mm2, rel=0.1)


def test_a_small_ball_is_refused_with_the_contact_it_offers() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=8.0)
    cap_mm2 = np.pi * (2 * 8.0 * RULES.compliance_mm - RULES.compliance_mm**2)
    assert cap_mm2 < RULES.min_line_contact_mm2
    with pytest.raises(NotGraspableError, match="mm2 required") as refusal:
        grips_of(solid_of(mesh, "pea"))
    last = str(refusal.value).rsplit("(best ", 1)[1]
    # as well as rays 2 mm apart tell an area 5 mm across
    assert float(last.split(",")[0]) == pytest.approx(cap_mm2, abs=6.0)


def test_a_cone_is_held_by_its_ends_alone() -> None:
    cone = manifold3d.Manifold.cylinder(40.0, 30.0, 14.0, 96, True)
    grasps = grips_of(cad_solid(cone, "cone"))
    for grasp in grasps:
        assert abs(grasp.T_part_tcp[2, 1]) > np.cos(np.radians(1.0))
        assert grasp.opening_mm == pytest.approx(40.0, abs=0.1)


def test_drafted_walls_are_held_along_what_bisects_them() -> None:
    # walls 4 degrees from parallel, 90 mm long, so that only they are within the jaws
    half = np.radians(2.0)
    top = 20.0 - 40 * np.tan(half)
    wedge = prism([(-20, 0), (20, 0), (top, 40), (-top, 40)], 90.0)
    grasps = [g for g in grips_of(cad_solid(wedge, "draft")) if abs(g.T_part_tcp[0, 1]) > 0.9]
    assert grasps
    square = [g for g in grasps if abs(g.T_part_tcp[0, 1]) > np.cos(np.radians(0.3))]
    assert square
    for grasp in square:
        along = abs(grasp.T_part_tcp[1, 0])  # of the approach, up or down the slope
        if along > 0.999:
            # what is within the pads' compliance of the first touch: c / tan(half) long, 12 wide
            longest = 12.0 * RULES.compliance_mm / np.tan(half)
            assert grasp.contact_mm2 <= longest + 12.0 * RULES.fine_step_mm
        # both pads lean on their walls by half the draft
        assert grasp.load >= np.tan(half) / RULES.friction - 1e-3


def test_steep_walls_are_left_alone() -> None:
    # each 20 degrees from the pads: the slope alone is 0.61 of friction 0.6
    top = 30.0 - 40 * np.tan(np.radians(20.0))
    wedge = prism([(-30, 0), (30, 0), (top, 40), (-top, 40)], 60.0)
    for grasp in grips_of(cad_solid(wedge, "steep")):
        assert abs(grasp.T_part_tcp[0, 1]) < 0.1


def test_a_wedge_standing_on_a_triangle_has_no_grip_from_above() -> None:
    # its walls are 45 degrees from opposed: half of that slope is tan 22.5 of friction 0.6, 0.69
    wedge = prism([(0, 0), (45, 0), (0, 45)], 60.0)
    for grasp in grips_of(cad_solid(wedge, "wedge")):
        assert abs(grasp.T_part_tcp[2, 1]) > 0.999, "by its triangles"
        assert abs(grasp.T_part_tcp[2, 0]) < 0.5


def test_a_thin_plate_lying_flat_is_taken_by_what_its_rim_offers() -> None:
    # 7 mm thick; tips stay 1 mm off the table, so at most 6 mm of the rim meet 12 mm of pad;
    # a pose 1 mm and 2 degrees wrong would leave too little, which lying on a table it cannot be
    plate = cad_solid(box(100, 60, 7), "plate")
    down = np.array([[0.0, 0.0, -1.0]])
    flat = [g for g in judged(plate, RULES, HAND, down).grasps if g.T_part_tcp[2, 0] < -0.99]
    assert flat
    for grasp in flat:
        assert RULES.min_line_contact_mm2 <= grasp.contact_mm2 <= 12 * 6
        assert grasp.opening_mm == pytest.approx(60.0, abs=0.01)
    assert any(g.on_table for g in flat)


def test_a_plate_of_3_mm_lying_flat_is_taken_by_its_rim() -> None:
    plate = cad_solid(box(60, 40, 3), "plate")
    flat = [g for g in judged(plate, RULES, HAND).grasps if g.T_part_tcp[2, 0] < -0.99]
    assert flat
    for grasp in flat:
        assert grasp.on_table
        across = int(np.argmax(np.abs(grasp.T_part_tcp[:2, 1])))
        assert grasp.opening_mm == pytest.approx((60.0, 40.0)[across], abs=0.1)
        assert grasp.T_part_tcp[2, 3] >= -1.5 + 1.0  # the tips, over the table's 1 mm
        assert grasp.contact_mm2 <= 12 * 2.0


def test_a_plate_of_2_mm_lying_flat_leaves_too_little_rim() -> None:
    plate = cad_solid(box(60, 40, 2), "plate")
    assert not [g for g in judged(plate, RULES, HAND).grasps if g.T_part_tcp[2, 0] < -0.5]


def test_the_room_over_the_table_grows_with_what_is_not_known_of_the_arm() -> None:
    plate = cad_solid(box(60, 40, 3), "plate")
    caster = RayCaster(plate.mesh)
    tried = from_above(plate, caster, DOWN[0], HAND, RULES, clearance_mm=0.4)
    assert tried.T[:, 2, 3].min() == pytest.approx(-1.5 + 1.4, abs=0.1)
    tried = from_above(cad_solid(box(60, 40, 0.5), "foil"), caster, DOWN[0], HAND, RULES)
    assert len(tried.T) == 0  # no rim stands above the room


def test_a_bracket_with_a_jog_is_taken_as_its_mirror_image_is() -> None:
    # lying so that no two of its walls face each other under the top: edge against wall holds it
    left = prism([(0, 0), (34, 0), (34, 6), (8, 22), (0, 22)], 90.0)
    right = left.mirror((1, 0, 0))
    taken = []
    for solid in (cad_solid(left, "left"), cad_solid(right, "right")):
        downs = downs_of(solid)
        arm = judged(solid, RULES, HAND, downs).grasps
        poses = [p for p in stable_poses(solid) if not p.rolling]
        able = [clear_of_table(resting_pose(solid, p), arm, HAND).any() for p in poses]
        taken.append(sum(p.probability for p, ok in zip(poses, able, strict=True) if ok))
    assert taken[0] == pytest.approx(taken[1], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["featuretype.stl", "flange_xy.stl", "holder.stl", "idler_riser.stl", "widget.csg.yaml"],
)
def test_every_pose_of_a_recipe_part_leaves_grips_from_above_to_choose_from(
    name: str,
) -> None:
    part = load_part(PARTS / name)
    layout, options = emulated_layout(), PlanOptions()
    downs = downs_of(part.solid)
    arm = judged(part.solid, RULES, layout.arm_gripper, downs, part.chosen_by).grasps
    for pose in stable_poses(part.solid):
        if not pose.rolling:
            able = clear_of_table(resting_pose(part.solid, pose), arm, layout.arm_gripper)
            assert able.sum() >= options.arm_grasps_per_pose // 2
    assert all(g.contact_mm2 >= 40.0 for g in arm if not g.on_table)
    assert layout.fixed_gripper is not None
    fixture = judged(part.solid, RULES, layout.fixed_gripper, downs, part.chosen_by).grasps
    assert len(fixture) >= options.fixed_grasps


@pytest.mark.slow
@pytest.mark.parametrize("name", ["featuretype.stl", "idler_riser.stl", "flange_xy.stl"])
def test_no_open_hand_cuts_into_a_recipe_part_by_exact_solids(name: str) -> None:
    part = load_part(PARTS / name)
    mesh = part.solid.mesh
    body = manifold3d.Manifold(
        manifold3d.Mesh(
            np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
        )
    )
    assert body.volume() == pytest.approx(part.solid.volume_mm3, rel=1e-3)
    for grasp in judged(part.solid, QUICK, HAND, downs_of(part.solid), part.chosen_by).grasps:
        for behind in (0.0, 20.0, 55.0):
            T = grasp.T_part_tcp.copy()
            T[:3, 3] -= behind * T[:3, 0]
            for piece in (*HAND.body, *HAND.fingers(grasp.open_gap_mm(HAND))):
                placed = T @ piece.T
                solid_box = box(*(2 * piece.half_mm)).transform(placed[:3])
                assert (body ^ solid_box).volume() < 1e-3


@pytest.mark.parametrize(("slot_mm", "fits"), [(12.5, False), (13.5, True)])
def test_a_finger_goes_into_a_slot_with_room_for_a_wrong_pose(slot_mm: float, fits: bool) -> None:
    # walls 10 mm thick; a finger 8 mm thick, open 4 mm, and 1 mm for the pose: 13 mm of slot
    width = 2 * 10 + slot_mm
    channel = box(60, width, 50) - box(60, slot_mm, 50).translate((0, 0, 8))
    grasps = grips_of(cad_solid(channel, "slot"))
    across_a_wall = [g for g in grasps if g.opening_mm < 10.1 and abs(g.T_part_tcp[1, 1]) > 0.99]
    assert bool(across_a_wall) == fits
    assert any(abs(g.opening_mm - width) < 0.1 for g in grasps)


def test_a_jaw_that_spreads_holds_a_bore_from_inside() -> None:
    body = rod(70, 30, 128) - rod(20, 40, 128)
    found = judged(cad_solid(body, "ring"), QUICK, SPREADING).grasps
    inner = [g for g in found if g.is_inner]
    assert inner
    # the edges of a pad 12 mm wide meet a bore of 20 mm radius this far apart
    across_mm = 2 * np.sqrt(20.0**2 - 6.0**2)
    for grasp in inner:
        assert abs(grasp.T_part_tcp[2, 0]) > 0.999  # along the bore
        assert grasp.opening_mm == pytest.approx(across_mm, abs=0.15)
        assert np.hypot(*grasp.T_part_tcp[:2, 3]) < 0.5
        # closed in, the fingers' corners go into the bore with room to spare
        assert grasp.pre_open_mm < grasp.opening_mm - 2.0
        assert np.hypot(grasp.pre_open_mm / 2, 6.0) < 20.0 - 1.0
        # and the gap between the pads is not negative: there is a finger on either side
        assert grasp.pre_open_mm >= 2 * SPREADING.finger_thickness_mm
    assert not any(g.is_inner for g in judged(cad_solid(body, "ring"), QUICK, HAND).grasps)


def test_a_channel_is_held_between_its_walls() -> None:
    # 100 wide outside: only its inner walls, 40 apart, are within reach of the jaws
    channel = box(90, 100, 90) - box(90, 40, 90).translate((0, 0, 25))
    rules = replace(QUICK, density_kg_mm3=0.5e-6)
    grasps = judged(cad_solid(channel, "channel"), rules, SPREADING).grasps
    inner = [g for g in grasps if g.is_inner]
    assert inner
    for grasp in inner:
        assert grasp.opening_mm == pytest.approx(40.0, abs=0.05)
        assert abs(grasp.T_part_tcp[1, 1]) > 0.999
        assert grasp.T_part_tcp[1, 3] == pytest.approx(0.0, abs=0.05)


def test_a_part_that_only_rolls_is_held_all_the_same() -> None:
    assert judged(cad_solid(box(60, 40, 30), "block"), QUICK, HAND, np.zeros((0, 3))).grasps


def test_from_above_means_what_the_boxes_of_the_hand_say() -> None:
    solid = cad_solid(box(60, 40, 30), "block")
    poses = [p for p in stable_poses(solid) if not p.rolling]
    grasps = judged(solid, QUICK, SPREADING, downs_of(solid)).grasps
    T = np.stack([g.T_part_tcp for g in grasps])
    gap = np.array([g.open_gap_mm(HAND) for g in grasps])
    hull = np.asarray(solid.mesh.convex_hull.vertices)
    for pose in poses:
        by_boxes = clear_of_table(resting_pose(solid, pose), grasps, HAND)
        assert 0 < by_boxes.sum() < len(grasps)
        assert np.array_equal(lifts_off_table(T, gap, HAND, hull, -pose.R[2]), by_boxes)


def test_the_same_part_gives_the_same_bytes() -> None:
    def run() -> bytes:
        grasps = judged(
            cad_solid(box(60, 40, 30) - rod(8, 50, 48), "part"), QUICK, SPREADING
        ).grasps
        return b"".join(
            g.T_part_tcp.tobytes() + np.array([g.opening_mm, g.load, g.margin, g.score]).tobytes()
            for g in grasps
        )

    first = run()
    assert first
    assert run() == first


@pytest.mark.slow
def test_chosen_grips_come_from_every_side_and_lift_every_pose() -> None:
    solid = cad_solid(box(60, 40, 30), "block")
    downs = np.array([[0, 0, -1.0], [0, -1.0, 0], [-1.0, 0, 0], [0, 0, 1.0]])
    grasps = judged(solid, RULES, HAND, downs).grasps
    assert len(grasps) <= RULES.keep_count
    approach = np.stack([g.T_part_tcp[:3, 0] for g in grasps])
    for side in np.vstack([np.eye(3), -np.eye(3)]):
        assert (approach @ side).max() > 0.99
    for down in downs:
        assert (approach @ down > 0.5).sum() >= RULES.pick_count // 2


def test_a_fixture_that_does_not_turn_holds_what_its_own_gravity_allows() -> None:
    # gravity across the pads' width for ever: a lever along it does not twist
    solid = solid_of(trimesh.creation.box((160.0, 30.0, 20.0)), "bar")
    caster = RayCaster(solid.mesh)
    rules = replace(QUICK, density_kg_mm3=7.85e-6)
    seeds = find_seeds(solid, sample_surface(solid, 6.0), caster, WIDEST_MM, rules)
    fixed = [np.array([0.0, 0.0, 1.0])]
    problem = GraspProblem(solid, seeds, caster, DOWN, rules)
    turning = judge_grasps(problem, HAND, "arm").grasps
    still = judge_grasps(problem, HAND, "fixture", fixed).grasps

    def farthest(grasps: Sequence[Grasp]) -> float:
        return max(abs(g.T_part_tcp[0, 3]) for g in grasps)

    assert farthest(still) > farthest(turning) + 10.0


def test_a_ring_wider_than_the_jaw_is_held_across_its_wall() -> None:
    # as a flange: 116 mm outside, 36 mm bore, 20 mm thick; the wall is 40 mm
    mesh = trimesh.creation.annulus(r_min=18.0, r_max=58.0, height=20.0, sections=96)
    grasps = grips_of(solid_of(mesh, "ring"))
    radial = [g for g in grasps if abs(g.T_part_tcp[2, 1]) < 0.1]
    assert radial
    for grasp in radial:
        assert grasp.opening_mm == pytest.approx(40.0, abs=1.5)
        middle = grasp.T_part_tcp[:2, 3]
        assert np.linalg.norm(middle) == pytest.approx(38.0, abs=3.0)
    assert any(g.T_part_tcp[2, 0] < -0.999 for g in radial), "from above, for a ring lying flat"


def test_a_heavy_part_leaves_only_grips_near_its_centre_of_mass() -> None:
    # steel bar 200 x 30 x 20 mm, 0.94 kg: weight x arm against 2 x 0.6 x 40 N on a 24 mm pad
    solid = solid_of(trimesh.creation.box((200.0, 30.0, 20.0)))
    caster = RayCaster(solid.mesh)
    rules = replace(QUICK, density_kg_mm3=7.85e-6)
    seeds = find_seeds(solid, sample_surface(solid, 6.0), caster, WIDEST_MM, rules)
    grasps = synthesise_grasps(GraspProblem(solid, seeds, caster, DOWN, rules), HAND, "arm")
    weight_n = 200 * 30 * 20 * 7.85e-6 * 9.81
    # the friction couple of two whole pads cannot exceed force x friction x half the diagonal
    max_nmm = 2 * 0.6 * 40.0 * np.hypot(12, 24) / 2
    for grasp in grasps:
        assert abs(grasp.T_part_tcp[0, 3]) - 12.0 < max_nmm / weight_n
