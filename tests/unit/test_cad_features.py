"""Features of solids known on paper, and what turning, mirroring and scaling does to them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from cad_solids import Body, box, prism, rod, solid_of
from data_files import part_file
from manifold3d import CrossSection, JoinType

from controller.cad import Solid, load_solid
from controller.cad.boundary import check_boundary, euler_defect, face_genera
from controller.cad.surfaces import Feature, find_features


def features(body: Body) -> list[Feature]:
    return list(find_features(solid_of(body)))


def only(body: Body, kind: str) -> Feature:
    found = features(body)
    assert [f.kind for f in found] == [kind]
    return found[0]


def test_a_plain_box_and_a_plain_rod_have_no_features() -> None:
    assert features(box(40, 30, 20)) == []
    assert features(rod(10, 30)) == []
    assert features(Body.sphere(10, 48)) == []


def test_a_through_hole_knows_diameter_depth_axis_and_mouth() -> None:
    hole = only(box(40, 30, 20) - rod(4, 30, 48).translate((5, -3, 0)), "hole")
    assert hole.is_through
    assert hole.diameter_mm == pytest.approx(8, abs=1e-3)
    assert hole.depth_mm == pytest.approx(20, abs=1e-3)
    assert abs(hole.axis[2]) == pytest.approx(1)
    # the axis leads from the mouth into the part
    assert hole.position_mm == pytest.approx([5, -3, -10 * hole.axis[2]], abs=1e-3)
    assert hole.label == "hole 8.0 mm through"
    assert len(hole.faces) == 1


def test_a_blind_hole_ends_at_its_bottom() -> None:
    # from the top, z = 10, down to z = -2
    hole = only(box(40, 30, 20) - rod(3, 20, 48).translate((0, 0, 8)), "hole")
    assert not hole.is_through
    assert hole.depth_mm == pytest.approx(12, abs=1e-3)
    assert hole.axis == pytest.approx([0, 0, -1], abs=1e-6)
    assert hole.position_mm == pytest.approx([0, 0, 10], abs=1e-3)
    assert len(hole.faces) == 2
    assert hole.label == "hole 6.0 mm 12.0 mm deep"


def test_a_drilled_hole_reaches_to_its_tip() -> None:
    # 118 degrees at the tip: a cone 3 / tan 59 deg high below a cylinder down to z = 0
    tip = 3 / np.tan(np.radians(59))
    drill = rod(3, 20, 48).translate((0, 0, 10)) + Body.cylinder(tip, 0, 3, 48).translate(
        (0, 0, -tip)
    )
    hole = only(box(40, 30, 20) - drill, "hole")
    assert not hole.is_through
    assert hole.depth_mm == pytest.approx(10 + tip, abs=2e-3)
    assert [s.kind for s in hole.steps] == ["cylinder", "cone"]
    assert np.degrees(hole.steps[1].half_angle_rad) == pytest.approx(59, abs=0.05)


def test_a_hole_with_a_round_bottom_reaches_to_its_pole() -> None:
    # the ball's equator ring lies on the bore, so that both run into each other smoothly
    cutter = rod(4, 20, 64).translate((0, 0, 10)) + Body.sphere(4, 64)
    hole = only(box(40, 30, 20) - cutter, "hole")
    assert not hole.is_through
    assert hole.depth_mm == pytest.approx(14, abs=0.02)


def test_a_counterbored_hole_is_one_feature_with_two_steps() -> None:
    # 8 mm through, 16 mm from the top down to z = 2
    body = box(40, 40, 20) - rod(4, 30, 48) - rod(8, 10, 64).translate((0, 0, 7))
    hole = only(body, "hole")
    assert hole.is_through
    assert hole.diameter_mm == pytest.approx(8, abs=1e-3)
    assert hole.depth_mm == pytest.approx(20, abs=1e-3)
    assert hole.axis == pytest.approx([0, 0, -1], abs=1e-6)
    assert [s.diameter_mm for s in hole.steps] == pytest.approx([16, 8], abs=1e-3)
    assert [s.depth_mm for s in hole.steps] == pytest.approx([8, 12], abs=1e-3)
    assert len(hole.faces) == 3  # with the ledge
    assert hole.label == "stepped hole 8.0 mm through"


def test_a_countersunk_hole_is_one_feature_with_its_cone() -> None:
    # 6 mm through, 90 degrees countersunk to 12 mm
    sink = Body.cylinder(3, 3, 6, 64).translate((0, 0, 7)) + rod(6, 4, 64).translate((0, 0, 12))
    hole = only(box(40, 40, 20) - rod(3, 30, 64) - sink, "hole")
    assert hole.is_through
    assert hole.diameter_mm == pytest.approx(6, abs=1e-3)
    cone = hole.steps[0]
    assert cone.kind == "cone"
    assert cone.diameter_mm == pytest.approx(12, abs=1e-3)
    assert cone.depth_mm == pytest.approx(3, abs=1e-3)
    assert np.degrees(cone.half_angle_rad) == pytest.approx(45, abs=0.05)


def test_two_holes_on_one_axis_in_two_walls_are_two() -> None:
    body = box(40, 40, 40) - box(50, 20, 50) - rod(4, 60, 48).rotate((90, 0, 0))
    body = body + box(40, 40, 5).translate((0, 0, -20))
    holes = [f for f in features(body) if f.kind == "hole"]
    assert [h.depth_mm for h in holes] == pytest.approx([10, 10], abs=1e-3)
    assert all(h.is_through for h in holes)


def test_a_boss_stands_on_its_base() -> None:
    # plate up to z = 5, boss up to z = 17
    boss = only(box(60, 60, 10) + rod(8, 20, 48).translate((10, 0, 7)), "boss")
    assert boss.diameter_mm == pytest.approx(16, abs=1e-3)
    assert boss.depth_mm == pytest.approx(12, abs=1e-3)
    assert boss.axis == pytest.approx([0, 0, 1], abs=1e-6)
    assert boss.position_mm == pytest.approx([10, 0, 17], abs=1e-3)
    assert boss.label == "boss 16.0 mm, 12.0 mm high"


def test_a_boss_with_a_hole_is_a_boss_and_a_hole() -> None:
    body = box(60, 60, 10) + rod(8, 20, 48).translate((0, 0, 7)) - rod(3, 60, 32)
    assert [f.kind for f in features(body)] == ["hole", "boss"]


def obround(width: float, length: float) -> CrossSection:
    half, radius = (length - width) / 2, width / 2
    return (
        CrossSection.circle(radius, 64).translate((half, 0))
        + CrossSection.circle(radius, 64).translate((-half, 0))
        + CrossSection.square((2 * half, width), True)
    )


@pytest.mark.parametrize(("low", "depth", "through"), [(-15, 10, True), (-1, 6, False)])
def test_a_slot_with_round_ends_has_width_length_and_depth(
    low: float, depth: float, through: bool
) -> None:
    body = box(60, 40, 10) - obround(8, 28).extrude(30).translate((3, 4, low))
    slot = only(body, "slot")
    assert slot.width_mm == pytest.approx(8, abs=1e-3)
    assert slot.length_mm == pytest.approx(28, abs=1e-3)
    assert slot.depth_mm == pytest.approx(depth, abs=1e-3)
    assert slot.is_through == through
    assert slot.position_mm[:2] == pytest.approx([3, 4], abs=1e-3)
    assert len(slot.faces) == (4 if through else 5)
    if not through:
        assert slot.axis == pytest.approx([0, 0, -1], abs=1e-6)
        assert slot.position_mm[2] == pytest.approx(5, abs=1e-3)


def test_a_groove_is_a_slot_between_two_facing_walls() -> None:
    slot = only(box(60, 40, 20) - box(100, 6, 8).translate((0, 5, 10)), "slot")
    assert slot.width_mm == pytest.approx(6)
    assert slot.length_mm == pytest.approx(60)
    assert slot.depth_mm == pytest.approx(4)
    assert slot.axis == pytest.approx([0, 0, -1])
    assert slot.position_mm == pytest.approx([0, 5, 10])
    assert slot.is_through
    assert slot.label == "slot 6.0 x 60.0 mm, 4.0 mm deep, through"


def test_a_groove_that_stops_short_of_an_end_does_not_run_through() -> None:
    # 6 wide, from the face at x = 30 to x = -10, where a half-round of radius 3 ends it
    tool = box(40, 6, 8).translate((10, 5, 10)) + rod(3, 8, 48).translate((-10, 5, 10))
    assert not any(f.is_through for f in features(box(60, 40, 20) - tool))


def test_a_rectangular_opening_is_one_feature_and_no_slot() -> None:
    opening = only(box(60, 40, 20) - box(16, 12, 30).translate((5, -3, 0)), "opening")
    assert opening.is_through
    assert len(opening.faces) == 4
    assert (opening.width_mm, opening.length_mm) == pytest.approx((12, 16))
    assert opening.depth_mm == pytest.approx(20)
    assert abs(opening.axis[2]) == pytest.approx(1)
    assert opening.position_mm == pytest.approx([5, -3, -10 * opening.axis[2]])
    assert opening.label == "opening 12.0 x 16.0 mm, 20.0 mm deep, through"
    assert opening.ends == ()


def test_a_pocket_is_one_feature_with_its_floor() -> None:
    pocket = only(box(60, 40, 20) - box(16, 12, 20).translate((5, -3, 14)), "pocket")
    assert not pocket.is_through
    assert (pocket.width_mm, pocket.length_mm, pocket.depth_mm) == pytest.approx((12, 16, 6))
    assert pocket.axis == pytest.approx([0, 0, -1])
    assert pocket.position_mm == pytest.approx([5, -3, 10])
    assert len(pocket.faces) == 5
    assert len(pocket.ends) == 1


def test_rounded_corners_belong_to_their_opening_and_are_fillets_as_well() -> None:
    window = CrossSection.square((14, 10), True).offset(3, JoinType.Round, 2.0, 64)
    found = features(box(60, 40, 12) - window.extrude(30).translate((0, 0, -15)))
    assert [f.kind for f in found] == ["opening"] + 4 * ["fillet"]
    opening = found[0]
    assert (opening.width_mm, opening.length_mm) == pytest.approx((16, 20))
    assert all(set(f.faces) < set(opening.faces) for f in found[1:])


@pytest.mark.parametrize("corner_count", [3, 5, 6, 8])
def test_a_socket_of_any_number_of_walls_is_a_pocket(corner_count: int) -> None:
    turns = 2 * np.pi * np.arange(corner_count) / corner_count
    outline = CrossSection([list(zip(8 * np.cos(turns), 8 * np.sin(turns), strict=True))])
    pocket = only(box(40, 40, 20) - outline.extrude(20).translate((0, 0, 3)), "pocket")
    assert len(pocket.faces) == corner_count + 1
    assert pocket.depth_mm == pytest.approx(7)
    if corner_count % 2 == 0:  # across flats
        assert pocket.width_mm == pytest.approx(16 * np.cos(np.pi / corner_count))
        assert len(pocket.across) == corner_count // 2


def test_a_pocket_with_a_round_at_its_foot_is_no_opening() -> None:
    # each layer of the foot is narrower by its height on a round of radius 3
    turns = np.linspace(0, np.pi / 2, 13)
    body = box(60, 40, 20) - box(30, 20, 20).translate((0, 0, 11))
    for low, high in pairwise(turns):
        rings = [(3 * (1 - np.sin(a)), 3 * np.cos(a)) for a in (low, high)]
        body -= Body.hull_points(
            [
                (sx * (15 - inset), sy * (10 - inset), 1 + (3 - down))
                for inset, down in rings
                for sx in (-1, 1)
                for sy in (-1, 1)
            ]
        )
    kinds = [f.kind for f in features(body)]
    assert "opening" not in kinds


def test_a_closed_hollow_is_neither_pocket_nor_opening() -> None:
    assert features(box(60, 40, 20) - box(16, 12, 8)) == []


def test_keyways_are_told_from_slots_by_the_round_surface_they_open_into() -> None:
    bored = rod(20, 24, 192) - rod(10, 40, 128) - box(6, 10, 40).translate((0, -8.5, 0))
    keyway = next(f for f in features(bored) if f.kind == "keyway")
    assert (keyway.width_mm, keyway.length_mm) == pytest.approx((6, 24))
    assert keyway.label == "keyway 6.0 x 24.0 mm, 4.0 mm deep, through"
    key = Body.hull(rod(3, 10, 64).translate((-8, 0, 0)) + rod(3, 10, 64).translate((8, 0, 0)))
    shaft = rod(12, 50, 128) - key.rotate((0, 90, 0)).translate((14, 0, 0))
    keyway = only(shaft, "keyway")
    assert (keyway.width_mm, keyway.length_mm) == pytest.approx((6, 22), abs=1e-3)
    assert not keyway.is_through


def test_a_step_is_no_slot_and_a_rib_is_none() -> None:
    step = prism([(0, 0), (40, 0), (40, 10), (20, 10), (20, 20), (0, 20)], 30)
    rib = box(60, 40, 10) + box(60, 6, 20).translate((0, 0, 10))
    assert features(step) == []
    assert features(rib) == []


def test_a_chamfer_along_an_edge_has_a_width() -> None:
    body = prism([(0, 0), (40, 0), (40, 18), (38, 20), (0, 20)], 50)
    chamfer = only(body, "chamfer")
    assert chamfer.width_mm == pytest.approx(2 * np.sqrt(2))
    assert chamfer.length_mm == pytest.approx(50)
    assert abs(chamfer.axis[2]) == pytest.approx(1)
    assert chamfer.position_mm == pytest.approx([39, 19, 25])


def test_a_slope_is_no_chamfer() -> None:
    assert features(prism([(0, 0), (40, 0), (40, 10), (20, 30), (0, 30)], 50)) == []


def test_a_chamfered_shaft_has_a_chamfer_round_its_end() -> None:
    body = rod(10, 30, 64) + Body.cylinder(1, 10, 9, 64).translate((0, 0, 15))
    chamfer = only(body, "chamfer")
    assert chamfer.diameter_mm == pytest.approx(20, abs=1e-3)
    assert chamfer.width_mm == pytest.approx(np.sqrt(2), abs=1e-3)


def corner(radius: float, *, inner: bool) -> Body:
    """A block with one edge rounded, or an L with its inner corner filled round."""
    turns = np.linspace(0, np.pi / 2, 13)
    if inner:
        arc = [(10 + radius - radius * np.sin(a), 10 + radius - radius * np.cos(a)) for a in turns]
        return prism([(0, 0), (40, 0), (40, 10), *arc, (10, 30), (0, 30)], 20)
    arc = [(40 - radius + radius * np.cos(a), 20 - radius + radius * np.sin(a)) for a in turns]
    return prism([(0, 0), (40, 0), *arc, (0, 20)], 20)


@pytest.mark.parametrize("inner", [True, False])
def test_fillets_and_rounds_have_radius_and_length(inner: bool) -> None:
    fillet = only(corner(5, inner=inner), "fillet")
    assert fillet.diameter_mm == pytest.approx(10, abs=1e-3)
    assert fillet.length_mm == pytest.approx(20, abs=1e-3)
    assert fillet.is_concave == inner
    assert fillet.label == ("fillet R5.0 mm" if inner else "round R5.0 mm")


def test_a_fillet_round_the_foot_of_a_boss_belongs_to_both() -> None:
    # turned: plate of radius 40 up to z = 0, boss of radius 8 up to z = 20, foot rounded with 4
    turns = np.linspace(0, np.pi / 2, 9)
    foot = [(12 - 4 * np.sin(a), 4 - 4 * np.cos(a)) for a in turns]
    outline = CrossSection([[(0, -10), (40, -10), (40, 0), *foot, (8, 20), (0, 20)]])
    found = features(outline.revolve(96))
    assert [f.kind for f in found] == ["boss", "fillet"]
    boss, fillet = found
    assert boss.diameter_mm == pytest.approx(16, abs=1e-3)
    assert boss.depth_mm == pytest.approx(20, abs=1e-3)
    assert fillet.diameter_mm == pytest.approx(8, abs=2e-3)
    assert set(fillet.faces) < set(boss.faces)
    assert fillet.is_concave


# --- any solid, turned, mirrored, scaled ----------------------------------------------------------


def random_part(seed: int) -> Body:
    """A plate with holes, bosses and slots at places that leave each other alone."""
    rng = np.random.default_rng(seed)
    body = box(100, 80, 12)
    spots = [(x, y) for x in (-36, -12, 12, 36) for y in (-26, 0, 26)]
    for x, y in rng.permutation(spots)[:6]:
        radius = float(rng.uniform(2, 8))
        segments = int(rng.integers(24, 64))
        match int(rng.integers(5)):
            case 0:
                body -= rod(radius, 40, segments).translate((x, y, 0))
            case 1:
                depth = float(rng.uniform(3, 9))
                body -= rod(radius, 20, segments).translate((x, y, 16 - depth))
            case 2:
                body -= rod(radius / 2, 40, segments).translate((x, y, 0))
                body -= rod(radius, 20, segments).translate((x, y, 13))
            case 3:
                body += rod(radius, 20, segments).translate((x, y, 10))
            case _:
                body -= obround(radius, 2.5 * radius).extrude(40).translate((x, y, -20))
    return body


def facts(solid: Solid, scale: float = 1.0) -> list[tuple[object, ...]]:
    """What does not change when a part is turned or mirrored, lengths divided by ``scale``."""
    return sorted(
        (
            f.kind,
            f.is_through,
            f.is_concave,
            len(f.faces),
            *(round(x / scale, 2) for x in (f.diameter_mm, f.depth_mm, f.width_mm, f.length_mm)),
        )
        for f in find_features(solid)
    )


def surfaces(solid: Solid, scale: float = 1.0) -> list[tuple[object, ...]]:
    return sorted(
        (f.kind, f.concave, round(f.radius_mm / scale, 2), round(f.area_mm2 / scale**2, 1))
        for f in solid.faces
    )


def assert_euler(solid: Solid) -> None:
    assert check_boundary(solid.boundary) == []
    genera = face_genera(solid.mesh, solid.face_of_triangle, len(solid.faces))
    assert euler_defect(solid.boundary, genera) == 0


def assert_invariant(seed: int) -> None:
    body = random_part(seed)
    plain = solid_of(body)
    rng = np.random.default_rng(seed + 1000)
    turned = solid_of(body.rotate(tuple(rng.uniform(-180, 180, 3))).translate((30, -20, 10)))
    mirrored = solid_of(body.mirror(tuple(rng.normal(size=3))))
    scale = float(rng.uniform(0.5, 3))
    scaled = solid_of(body.scale((scale, scale, scale)))
    assert facts(plain) != []
    for other, size in ((turned, 1.0), (mirrored, 1.0), (scaled, scale)):
        assert_euler(other)
        near = zip(surfaces(plain), surfaces(other, size), strict=True)
        for one, two in near:
            assert one[:2] == two[:2]
            assert one[2:] == pytest.approx(two[2:], abs=0.11)
        for one, two in zip(facts(plain), facts(other, size), strict=True):
            assert one[:4] == two[:4]
            assert one[4:] == pytest.approx(two[4:], abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_turned_mirrored_and_scaled_parts_keep_surfaces_features_and_euler(seed: int) -> None:
    assert_invariant(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4, 40))
def test_many_more_parts_keep_theirs(seed: int) -> None:
    assert_invariant(seed)


def test_a_mirrored_parts_features_stand_at_mirrored_places() -> None:
    body = random_part(7)
    plain, mirrored = features(body), features(body.mirror((1, 0, 0)))
    flip = np.array([-1, 1, 1])
    places = sorted(np.round(f.position_mm * flip, 2).tolist() for f in plain)
    assert sorted(np.round(f.position_mm, 2).tolist() for f in mirrored) == [
        pytest.approx(p, abs=0.02) for p in places
    ]


def test_the_flange_has_the_holes_its_step_file_says() -> None:
    # flange_xy.step: eight cylinders; four bolt holes of 17 mm and the bores through the middle
    solid = load_solid(part_file("flange_xy.stl"))
    holes = [f for f in find_features(solid) if f.kind == "hole"]
    assert len(holes) == solid.boundary.genus == 5
    assert all(h.is_through for h in holes)
