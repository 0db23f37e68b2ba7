"""Characteristics of solids known on paper: what is dimensioned, from where, with which limits."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from data_files import part_file
from manifold3d import CrossSection

from controller.cad import Solid, load_solid
from controller.inspection.characteristics import (
    Asked,
    Characteristic,
    CharacteristicKind,
    EdgePairGeometry,
    RimGeometry,
    characteristics_of,
    derive,
)
from controller.inspection.characteristics.edges import round_walls
from controller.inspection.dimensions import features_of


def by_id(part: Solid, tolerance_class: str = "m") -> dict[str, Characteristic]:
    return {c.id: c for c in derive(part, tolerance_class)}  # type: ignore[arg-type]  # as read


def rims_of(characteristic: Characteristic) -> RimGeometry:
    assert isinstance(characteristic.geometry, RimGeometry)
    return characteristic.geometry


def plate(*holes: tuple[float, float, float]) -> Body:
    """A plate 80 x 50 x 8 round the origin with through holes (x, y, diameter)."""
    body = box(80, 50, 8)
    for x, y, diameter in holes:
        body = body - rod(diameter / 2, 20, 96).translate((x, y, 0))
    return body


def test_a_through_hole_has_a_diameter_and_a_position_with_both_its_rims() -> None:
    found = by_id(solid_of(plate((10, -5, 8))))
    diameter, position = found["hole 8 mm diameter"], found["hole 8 mm position"]
    assert (diameter.nominal_mm, diameter.lower_mm, diameter.upper_mm) == pytest.approx(
        (8, 7.8, 8.2)  # ISO 2768-m: above 6 up to 30, 0.2
    )
    assert diameter.source == "ISO 2768-m"
    rims = rims_of(diameter).rims
    assert sorted(rim.centre_mm[2] for rim in rims) == pytest.approx([-4, 4])
    for rim in rims:
        assert rim.centre_mm[:2] == pytest.approx([10, -5], abs=1e-3)
        assert rim.axis[2] * rim.centre_mm[2] > 3.9  # out of its mouth
        assert rim.sweep_rad == pytest.approx(2 * np.pi)
        assert rim.is_hole
    # 20 mm and 30 mm from the nearest sides: 0.2
    assert (position.nominal_mm, position.lower_mm, position.upper_mm) == pytest.approx((0, 0, 0.2))
    assert rims_of(position).datum == ()


def test_places_are_given_from_the_largest_feature_that_is_the_only_one_of_its_size() -> None:
    part = solid_of(plate((0, 0, 20), (-30, 0, 6), (30, 0, 6), (0, 15, 6)))
    found = by_id(part)
    far = found["hole 6 mm (3) position"]
    datum = rims_of(far).datum
    assert {round(rim.radius_mm, 3) for rim in datum} == {10}
    assert rims_of(found["hole 20 mm position"]).datum == ()
    # holes in the order they are read: the upper one first, then from left to right
    places = [rims_of(found[f"hole 6 mm ({i}) diameter"]).rims[0].centre_mm for i in (1, 2, 3)]
    assert [p[0] for p in places] == pytest.approx([0, -30, 30], abs=1e-3)
    assert found["hole 6 mm (1) position"].upper_mm == pytest.approx(0.2)  # 15 mm away
    assert far.upper_mm == pytest.approx(0.2)  # 30 mm away


def test_a_hole_on_its_datum_is_held_to_the_tolerance_of_its_own_size() -> None:
    turned = rod(40, 10, 128) - rod(4, 30, 96)
    found = by_id(solid_of(turned))
    assert found["hole 8 mm position"].upper_mm == pytest.approx(0.2)
    datum = rims_of(found["hole 8 mm position"]).datum
    assert [rim.radius_mm for rim in datum] == pytest.approx([40, 40])
    assert "boss 80 mm position" not in found  # it is the outline


def test_each_wall_of_a_stepped_hole_is_one_that_is_measured() -> None:
    body = plate((0, 0, 6)) - rod(6, 6, 96).translate((0, 0, 4))  # counterbore 12, down to z = 1
    found = by_id(solid_of(body))
    narrow, wide = found["hole 6 mm diameter"], found["hole 6 mm step 12 mm diameter"]
    assert sorted(rim.centre_mm[2] for rim in rims_of(narrow).rims) == pytest.approx([-4, 1])
    # at its bottom the wide wall has no edge that shows
    assert [rim.centre_mm[2] for rim in rims_of(wide).rims] == pytest.approx([4])


def test_a_size_that_a_class_has_no_tolerance_for_is_listed_and_not_measured() -> None:
    part = solid_of(plate((0, 0, 2.5)))
    assert by_id(part, "c")["hole 2.5 mm diameter"].is_measured
    diameter = by_id(part, "v")["hole 2.5 mm diameter"]
    assert not diameter.is_measured
    assert diameter.exempt == "ISO 2768-v has no tolerance for 2.5 mm"
    stated = Asked(name="hole 2.5 mm diameter", plus_mm=0.1, minus_mm=0.1)
    measured = {c.id: c for c in characteristics_of(part, "v", changes=[stated])}
    assert measured["hole 2.5 mm diameter"].is_measured
    assert measured["hole 2.5 mm diameter"].exempt == ""


def test_balloons_count_from_one_and_ids_are_unique() -> None:
    found = derive(load_solid(part_file("holder.stl"), unit="mm"))
    assert [c.balloon for c in found] == list(range(1, len(found) + 1))
    assert len({c.id for c in found}) == len(found)


def test_a_turned_part_has_the_same_characteristics() -> None:
    """Ids and limits do not depend on where the CAD frame has its origin."""
    body = plate((0, 0, 20), (-30, 0, 6), (30, 0, 6), (0, 15, 6))
    here, there = solid_of(body), solid_of(body.translate((100.3, -40.7, 12.1)))
    for one, other in zip(derive(here), derive(there), strict=True):
        assert (one.id, one.nominal_mm) == (other.id, other.nominal_mm)
        assert (one.lower_mm, one.upper_mm) == pytest.approx((other.lower_mm, other.upper_mm))


def test_a_rim_cut_by_a_slot_is_an_arc_from_its_begin_on() -> None:
    # a notch from the side, 45 degrees of the rim wide, takes the rim away towards +x
    body = plate((0, 0, 20)) - box(40, 2 * 10 * np.sin(np.radians(22.5)), 20).translate((20, 0, 0))
    wall = next(w for w in round_walls(solid_of(body)) if w.is_hole)
    rim = wall.rims[0]
    assert np.degrees(rim.sweep_rad) == pytest.approx(315, abs=8)  # segments are 3.75 deg
    end = np.cross(rim.axis, rim.start)
    last = np.cos(rim.sweep_rad) * rim.start + np.sin(rim.sweep_rad) * end
    assert rim.start[0] == pytest.approx(last[0], abs=0.06)
    assert rim.start[1] == pytest.approx(-last[1], abs=0.06)
    half = np.cos(rim.sweep_rad / 2) * rim.start + np.sin(rim.sweep_rad / 2) * end
    assert half[0] == pytest.approx(-1, abs=0.01)  # it goes round the far side


def pair_of(characteristic: Characteristic) -> EdgePairGeometry:
    assert isinstance(characteristic.geometry, EdgePairGeometry)
    return characteristic.geometry


def sizes(part: Solid, word: str) -> list[float]:
    return sorted(c.nominal_mm for c in derive(part) if c.id.startswith(word))


def test_a_box_has_three_lengths_and_nothing_else() -> None:
    found = derive(solid_of(box(40, 30, 20)))
    assert [c.kind for c in found] == [CharacteristicKind.LENGTH] * 3
    assert sorted(c.nominal_mm for c in found) == pytest.approx([20, 30, 40])
    longest = max(found, key=lambda c: c.nominal_mm)
    assert (longest.lower_mm, longest.upper_mm) == pytest.approx((39.7, 40.3))
    geometry = pair_of(longest)
    assert geometry.direction == pytest.approx([1, 0, 0])
    assert {round(line.start_mm[0]) for line in geometry.one} == {-20}
    assert {round(line.end_mm[0]) for line in geometry.other} == {20}
    assert len(geometry.one) == len(geometry.other) == 4


def test_no_chain_of_dimensions_is_closed() -> None:
    """A stair of four treads has four levels above its foot: four heights, four depths."""
    stair = box(10, 30, 10)
    for i in range(1, 4):
        stair = stair + box(10, 30, 10 + 6.0 * i).translate((10.0 * i, 0, 3.0 * i))
    found = [c for c in derive(solid_of(stair)) if isinstance(c.geometry, EdgePairGeometry)]
    across = [c for c in found if abs(pair_of(c).direction[2]) > 0.9]
    assert sorted(c.nominal_mm for c in across) == pytest.approx([10, 16, 22, 28])
    along = [c for c in found if abs(pair_of(c).direction[0]) > 0.9]
    assert sorted(c.nominal_mm for c in along) == pytest.approx([10, 20, 30, 40])


def test_a_groove_has_its_width_and_one_wall_from_outside() -> None:
    body = box(40, 30, 20) - box(6, 60, 10).translate((4, 0, 10))
    assert sizes(solid_of(body), "width") == pytest.approx([6])
    # 13 from its wall to the nearer side, 15 below its floor; the groove leaves two tops, of which
    # one is in the length over all and the other has its own height
    assert sizes(solid_of(body), "thickness") == pytest.approx([13, 15, 20])


def test_a_rib_has_its_thickness() -> None:
    body = box(60, 40, 6) + box(60, 4, 20).translate((0, 5, 10))
    assert 4 in [round(size, 3) for size in sizes(solid_of(body), "thickness")]


def test_the_depth_of_a_closed_pocket_is_measured_at_its_four_walls() -> None:
    body = box(60, 40, 20) - box(30, 20, 10).translate((0, 0, 9))
    found = derive(solid_of(body))
    assert not [c for c in found if c.exempt]
    (depth,) = [c for c in found if c.is_depth]
    assert depth.nominal_mm == pytest.approx(6)
    assert (depth.lower_mm, depth.upper_mm) == pytest.approx((5.9, 6.1))
    assert len(pair_of(depth).one) == len(pair_of(depth).other) == 4


def test_planes_deep_in_a_narrow_groove_show_from_no_side() -> None:
    # a T-slot: the undercut's ceiling is seen along the slot, from both ends
    slot = box(10, 80, 20).translate((0, 0, 10)) + box(30, 80, 6).translate((0, 0, 3))
    open_ended = box(60, 60, 30) - slot
    assert not [c.id for c in derive(solid_of(open_ended)) if c.exempt]
    closed = (
        open_ended + box(60, 5, 30).translate((0, 32, 0)) + box(60, 5, 30).translate((0, -32, 0))
    )
    assert [c.id for c in derive(solid_of(closed)) if "no view" in c.exempt or "outer" in c.exempt]


def test_a_disc_is_as_thick_as_its_rims_are_apart() -> None:
    disc = rod(30, 12, 128)
    found = by_id(solid_of(disc))
    length = next(c for c in found.values() if c.kind == CharacteristicKind.LENGTH)
    assert length.nominal_mm == pytest.approx(12)
    assert not length.exempt
    geometry = pair_of(length)
    assert [rim.centre_mm[2] for rim in geometry.one_rims] == pytest.approx([-6])
    assert [rim.axis[2] for rim in geometry.other_rims] == pytest.approx([1])
    assert geometry.other_rims[0].radius_mm == pytest.approx(30, abs=1e-3)


def test_a_counterbores_depth_is_measured_at_the_rims_of_mouth_and_floor() -> None:
    body = plate((0, 0, 6)) - rod(6, 6, 96).translate((0, 0, 4))
    depth = by_id(solid_of(body))["hole 6 mm step 12 mm depth"]
    assert depth.nominal_mm == pytest.approx(3)
    assert (depth.exempt, depth.is_measured, depth.is_depth) == ("", True, True)
    levels = [rim.centre_mm[2] for side in ("one_rims", "other_rims")
              for rim in getattr(pair_of(depth), side)]  # fmt: skip
    assert levels == pytest.approx([1, 4])
    assert "hole 6 mm depth" not in by_id(solid_of(body))


def test_rounded_corners_have_radii_with_the_tolerance_of_radii() -> None:
    rounded = CrossSection.square((40, 30), True).offset(5, manifold3d.JoinType.Round, 2.0, 128)
    found = by_id(solid_of(rounded.extrude(10)))
    radii = [c for c in found.values() if c.kind == CharacteristicKind.RADIUS]
    assert len(radii) == 4
    for radius in radii:
        assert radius.nominal_mm == pytest.approx(5, abs=2e-3)
        assert radius.upper_mm - radius.nominal_mm == pytest.approx(0.5)  # above 3 up to 6
        assert all(
            np.degrees(rim.sweep_rad) == pytest.approx(90, abs=1) for rim in rims_of(radius).rims
        )


def test_a_slot_with_round_ends_has_width_and_length() -> None:
    slot = Body.hull(rod(4, 20, 96).translate((-8, 0, 0)) + rod(4, 20, 96).translate((8, 0, 0)))
    found = by_id(solid_of(box(60, 40, 8) - slot))
    length = next(c for i, c in found.items() if i.startswith("slot") and i.endswith("length"))
    assert length.nominal_mm == pytest.approx(24, abs=2e-3)
    # it goes through: both ends show on both sides, those of the mouth first
    ends = [(rim.centre_mm[0], rim.centre_mm[2]) for rim in rims_of(length).rims]
    assert sorted(x for x, _ in ends) == pytest.approx([-8, -8, 8, 8])
    assert (
        ends[0][1] == ends[1][1] == pytest.approx(ends[2][1] + 8) == pytest.approx(ends[3][1] + 8)
    )
    assert sizes(solid_of(box(60, 40, 8) - slot), "width") == pytest.approx([8], abs=2e-3)
    position = next(c for i, c in found.items() if i.startswith("slot") and i.endswith("position"))
    # 20 mm from the nearest sides to the middle between both ends: 0.2
    assert position.upper_mm == pytest.approx(0.2)
    assert len(features_of(position)) == 2
    assert not [i for i in found if "radius" in i]


@pytest.mark.parametrize("name", ["featuretype.stl", "flange_xy.stl", "holder.stl"])
def test_a_real_part_has_each_plane_in_no_more_than_a_tree(name: str) -> None:
    part = load_solid(part_file(name), unit="mm")
    pairs = [c for c in derive(part) if isinstance(c.geometry, EdgePairGeometry)]
    by_direction: dict[tuple[float, ...], list[EdgePairGeometry]] = {}
    for c in pairs:
        key = tuple(np.round(pair_of(c).direction, 3) + 0.0)
        by_direction.setdefault(key, []).append(pair_of(c))
    for tree in by_direction.values():
        faces = {i for pair in tree for i in (pair.one_face, pair.other_face)}
        assert len(tree) == len(faces) - 1
        for pair in tree:
            for line in pair.one:
                assert pair.one_face in line.faces


def test_a_stepped_datum_is_one_of_its_walls() -> None:
    """All rims of a datum are of one radius, so that one circle fits them."""
    body = plate((0, 0, 14), (-30, 0, 6), (30, 0, 6)) - rod(10, 6, 96).translate((0, 0, 4))
    found = by_id(solid_of(body))
    datum = rims_of(found["hole 6 mm (1) position"]).datum
    assert [round(rim.radius_mm, 3) for rim in datum] == [7, 7]
    assert "from hole 14 mm" in found["hole 6 mm (1) position"].label
    # the counterbore is placed from the bore it is on
    centred = rims_of(found["hole 14 mm step 20 mm position"]).datum
    assert [id(rim) for rim in centred] == [id(rim) for rim in datum]


@pytest.mark.parametrize("turn_deg", [(90, 0, 0), (0, 90, 0), (0, 0, 180), (30, 40, 50)])
def test_a_part_turned_in_its_frame_has_the_same_sizes(turn_deg: tuple[float, ...]) -> None:
    body = plate((0, 0, 20), (-30, 10, 6), (30, 0, 6)) - box(10, 60, 4).translate((15, 0, 4))
    here, there = derive(solid_of(body)), derive(solid_of(body.rotate(turn_deg)))

    def sizes_of(found: tuple[Characteristic, ...]) -> list[tuple[str, float, float]]:
        limits = [(c.kind.value, c.nominal_mm, c.upper_mm) for c in found if "position" not in c.id]
        return sorted((kind, round(n, 2), round(upper, 2)) for kind, n, upper in limits)

    assert sizes_of(here) == sizes_of(there)
    assert len(here) == len(there)
