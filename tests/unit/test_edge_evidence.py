"""What edges in place prove of a face, and that a wrong hole is never proven by them."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from edge_views import edge_views, evidence_of
from manifold3d import CrossSection, Manifold
from shown_part import Array, face_id, hand, part, perfect

from controller.cad import find_mouths, find_recesses, sample_surface
from controller.inspection import FindingKind, InspectionLimits, PosedPart, WorldBox
from controller.inspection.edge_evidence import (
    EdgeEvidence,
    FaceEdges,
)

LOOKS = ((-15.0, 5.0), (20.0, -12.0), (8.0, 14.0))  # turn and tilt [deg]
LIMITS = InspectionLimits(smallest_defect_mm=3.0, dust_mm=0.5)


def evidence(
    nominal: PosedPart,
    body: Body,
    looks: tuple[tuple[float, ...], ...],
    limits: InspectionLimits = LIMITS,
) -> EdgeEvidence:
    samples = sample_surface(nominal.solid, spacing_mm=0.5)
    return evidence_of(nominal, samples, edge_views(body, looks), limits)


@cache
def of_perfect() -> EdgeEvidence:
    return evidence(part(), perfect(), LOOKS)


def bore_wall() -> int:
    return next(f.id for f in part().solid.faces if f.concave and abs(f.radius_mm - 5) < 0.1)


def blind(depth_mm: float, radius_mm: float = 4.0) -> Body:
    """A block with a blind bore in its front."""
    return box(46, 34, 24) - rod(radius_mm, 2 * depth_mm, 64).translate((-8, 2, 12))


@cache
def blind_part(radius_mm: float = 4.0) -> PosedPart:
    return PosedPart(solid_of(blind(8.0, radius_mm), "blind"))


def blind_wall(found: EdgeEvidence) -> FaceEdges:
    solid = blind_part().solid
    return found.faces[next(f.id for f in solid.faces if f.kind == "cylinder")]


def test_holes_and_pockets_are_known_by_what_bounds_them() -> None:
    found = find_recesses(part().solid)
    through = [r for r in found if r.is_through]
    # the bore runs through 24 mm, the cross bore through 46 mm; the pocket is 6 mm deep
    assert sorted(round(r.depth_mm, 3) for r in through) == [24.0, 46.0]
    (pocket,) = [r for r in found if not r.is_through]
    assert (len(pocket.walls), round(pocket.depth_mm, 3)) == (4, 6.0)
    assert pocket.axis == pytest.approx([0, 0, 1], abs=1e-9)


def test_a_boss_and_a_block_are_no_recess() -> None:
    assert find_recesses(solid_of(box(46, 34, 24) + rod(6, 8, 48).translate((0, 0, 14)))) == ()


def test_a_keyway_in_a_shaft_is_a_recess_and_its_shoulders_are_none() -> None:
    shaft = rod(12, 60, 96) + rod(8, 90, 96)
    assert find_recesses(solid_of(shaft)) == ()
    (keyway,) = find_recesses(solid_of(shaft - box(8, 6, 24).translate((12, 0, 0))))
    assert (len(keyway.walls), keyway.is_through) == (4, False)
    assert keyway.axis == pytest.approx([1, 0, 0], abs=1e-6)


def walls_of_mouths(body: Body) -> list[set[str]]:
    """The kinds and sizes of the walls that lead inwards from each mouth."""
    solid = solid_of(body)
    labels = [face.label.split(" ", 1)[1] for face in solid.faces]
    return [{labels[wall] for wall in mouth.walls} for mouth in find_mouths(solid)]


def test_a_cross_hole_opens_into_a_bore_and_no_bore_into_its_cross_hole() -> None:
    tube = rod(14, 48, 96) - rod(7, 60, 96) - rod(3, 80, 64).rotate((90, 0, 0))
    told = sorted(walls_of_mouths(tube), key=str)
    # two ends of the bore; each half of the cross hole opens outwards and into the bore
    assert told == [{"bore 14.0 mm"}] * 2 + [{"bore 6.0 mm"}] * 4


def test_a_hollow_that_another_one_cuts_has_its_mouths() -> None:
    mouths = find_mouths(keyed_part().solid)
    assert sum(len(m.walls) == 4 for m in mouths) == 2
    assert len(find_recesses(keyed_part().solid)) == 1  # the half of the cross hole off the keyway


@pytest.mark.parametrize(
    "length_mm", [20.0, 100.0], ids=["short", "longer than the shaft is round"]
)
def test_a_keyway_opens_to_the_outside_of_its_shaft(length_mm: float) -> None:
    (keyway,) = find_mouths(solid_of(rod(10, 150, 96) - box(6, 6, length_mm).translate((10, 0, 0))))
    assert len(keyway.walls) == 4


@pytest.mark.parametrize(
    "cut", [box(6, 30, 200).translate((11, 0, 0)), box(6, 6, 100).translate((10, 0, 40))],
    ids=["flat", "keyway to the end"],
)  # fmt: skip
def test_what_is_open_at_the_end_of_a_shaft_has_no_mouth(cut: Body) -> None:
    assert find_mouths(solid_of(rod(10, 150, 96) - cut)) == ()


def test_the_light_through_a_bore_shows_its_wall() -> None:
    wall = of_perfect().faces[bore_wall()]
    assert wall.is_verified
    assert "light" in wall.how
    assert wall.share > 0.8
    assert wall.look_count >= len(LOOKS)


def test_a_large_face_is_not_shown_by_its_edges() -> None:
    front = of_perfect().faces[face_id("plane", (0, 0, 12))]
    assert front.share > 0.8
    assert not front.is_verified


def compared_along(found: EdgeEvidence, x: float, half_mm: float, y0: float, y1: float) -> float:
    """Share that edges compare of the front's samples about an x, from y0 to y1."""
    samples = sample_surface(part().solid, spacing_mm=0.5)
    u, v, _ = samples.points_mm.T
    near = (samples.face_ids == face_id("plane", (0, 0, 12))) & (np.abs(u - x) < half_mm)
    near &= (v > y0) & (v < y1)
    assert near.sum() >= 3
    return float(found.compared[near].mean())


def test_an_edge_in_place_compares_the_strip_beside_it_and_no_more() -> None:
    # the front's upper edge is at y = 17; half of a defect of 3 mm, less the edge's own limit
    assert compared_along(of_perfect(), -10.0, 8.0, 16.4, 17.0) > 0.9
    assert compared_along(of_perfect(), -10.0, 8.0, 10.0, 15.5) == 0.0


@pytest.mark.parametrize("away_mm", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("kind", ["chip", "burr"])
def test_a_strip_is_not_compared_where_a_defect_reaches_its_edge(kind: str, away_mm: float) -> None:
    # 3 mm wide, centred so far from the front's upper edge
    at = (-10.0, 17.0 - away_mm, 12.0)
    lump = Manifold.sphere(1.5, 48).translate(at)
    body = perfect() - lump if kind == "chip" else perfect() + lump
    found = evidence(part(), body, LOOKS)
    is_found = any(
        abs(f.p_part_mm[0] - at[0]) < 3.0 and f.p_part_mm[1] > 14.0
        for of_view in found.findings.values()
        for f in of_view
    )
    assert is_found or compared_along(found, at[0], 1.0, 16.0, 17.0) < 0.5


WEB = rod(5, 1, 48).translate((-11, 3, 0))
PLUGS = {
    "missing": rod(5, 24, 48).translate((-11, 3, 0)),
    "front half": rod(5, 12, 48).translate((-11, 3, -6)),  # half deep, from the front
    "back half": rod(5, 12, 48).translate((-11, 3, 6)),
    "web": WEB,
}
PARTLY_PLUGGED = {
    "holed web": WEB - rod(2, 3, 48).translate((-11, 3, 0)),
    "half web": WEB ^ box(5, 20, 30).translate((-13.5, 3, 0)),  # in sight
    "web from behind": WEB ^ box(8, 20, 30).translate((-10, 3, 0)),  # part of it in sight
}


@pytest.mark.parametrize("plug", PLUGS.values(), ids=PLUGS)
def test_a_bore_that_is_no_through_bore_is_not_shown(plug: Body) -> None:
    found = evidence(part(), perfect() + plug, LOOKS)
    assert not found.faces[bore_wall()].is_verified


def half_covered(T_world_part: Array) -> tuple[WorldBox, ...]:
    """A finger over nearly half of the bore's front, x from -10.5 to -2.5."""
    at = np.eye(4)
    at[:3, 3] = -6.5, 32.0, 17.0
    return (WorldBox(T_world_part @ at, np.array((4.0, 34.0, 3.0))),)


def of_half_covered(body: Body) -> FaceEdges:
    """A bore half of which a finger hides from all views along it; others show both its rims."""
    views = [
        *edge_views(body, ((-4.0, 3.0), (5.0, -3.0)), half_covered, "A"),
        *edge_views(body, ((28.0, 8.0), (-28.0, 8.0), (152.0, 8.0), (208.0, 8.0)), hand, "B"),
    ]
    samples = sample_surface(part().solid)
    found = evidence_of(part(), samples, views, LIMITS)
    return found.faces[bore_wall()]


def test_a_bore_half_behind_the_gripper_is_shown_by_the_light_beside_it_and_both_rims() -> None:
    wall = of_half_covered(perfect())
    assert wall.is_verified
    assert "the part of it in sight" in wall.how
    assert wall.share > 0.8


@pytest.mark.parametrize(
    "plug",
    [*PLUGS.values(), *PARTLY_PLUGGED.values()],
    ids=[*PLUGS, *PARTLY_PLUGGED],
)
def test_a_bore_half_behind_the_gripper_that_is_no_through_bore_is_not_shown(plug: Body) -> None:
    assert not of_half_covered(perfect() + plug).is_verified


# a keyway, 4 mm wide and 2.3 mm deep, in a bore of 14 mm through a block
KEY = box(4, 9.2, 60).translate((0, 4.6, 0))
KEYED = box(46, 34, 24) - rod(7, 60, 96) - KEY
# from front and back, slantwise past the bore's end
SLANTED = tuple(
    (half + turn, tilt) for half in (0, 180) for turn in (-28, 28) for tilt in (-25, 15)
)


def walls_across(nominal: Body, body: Body) -> list[FaceEdges]:
    """The evidence on both walls across x, which are narrower than the smallest defect."""
    model = PosedPart(solid_of(nominal, "nominal"))
    found = evidence(model, body, SLANTED)
    walls = [
        f.id
        for f in model.solid.faces
        if f.kind == "plane" and abs(f.normal[0]) > 0.9 and abs(f.centre_mm[0]) < 3
    ]
    assert len(walls) == 2
    return [found.faces[wall] for wall in walls]


def test_a_wall_of_a_keyway_through_a_bore_is_shown_by_its_edges_from_end_to_end() -> None:
    for wall in walls_across(KEYED, KEYED):
        assert wall.is_verified
        assert wall.how == "of its edges"


@pytest.mark.parametrize("depth_mm", [24.0, 16.0])
def test_a_keyway_that_is_filled_is_not_shown_by_the_edges_at_its_ends(depth_mm: float) -> None:
    room = box(46, 34, depth_mm).translate((0, 0, 12 - depth_mm / 2))  # from the front
    filled = KEYED + ((KEY - rod(7, 60, 96)) ^ room)
    assert not any(wall.is_verified for wall in walls_across(KEYED, filled))


def test_the_walls_of_a_square_hole_need_the_light_through_it() -> None:
    square = box(46, 34, 4) - box(2.5, 2.5, 10)
    webbed = square + box(2.5, 2.5, 0.5)
    assert not any("edges" in wall.how for wall in walls_across(square, square))
    assert not any(wall.is_verified for wall in walls_across(square, webbed))


def test_a_bore_out_of_place_is_not_shown() -> None:
    moved = (perfect() + rod(5, 24, 48).translate((-11, 3, 0))) - rod(5, 40, 48).translate(
        (-11, 6, 0)
    )
    assert not evidence(part(), moved, LOOKS).faces[bore_wall()].is_verified


def test_a_blind_bore_is_shown_by_its_rim_and_its_floor() -> None:
    found = blind_wall(evidence(blind_part(), blind(8.0), LOOKS))
    assert found.is_verified
    assert "floor" in found.how


def places_against(found: EdgeEvidence) -> list[str]:
    every = [f for of_view in found.findings.values() for f in of_view]
    return [f.words for f in every if f.kind is FindingKind.DIMENSION]


@pytest.mark.parametrize(("depth_mm", "words"), [(6.5, "1.5 mm higher"), (9.5, "1.5 mm deeper")])
def test_a_floor_that_pictures_show_elsewhere_is_a_finding_with_its_number(
    depth_mm: float, words: str
) -> None:
    found = evidence(blind_part(), blind(depth_mm), LOOKS)
    told = places_against(found)
    assert told
    off = [float(re.search(r"about ([\d.]+) mm", one).group(1)) for one in told]  # type: ignore[union-attr]
    assert off == pytest.approx([1.5] * len(off), abs=0.3)
    assert all(words[-6:] in one for one in told)
    wall = blind_wall(found)
    assert not wall.is_verified
    assert wall.why in told


def test_a_good_part_has_nothing_against_it() -> None:
    assert places_against(of_perfect()) == []
    assert places_against(evidence(blind_part(), blind(8.0), LOOKS)) == []


def test_an_edge_that_pictures_show_whole_elsewhere_is_a_finding() -> None:
    def pocketed(x_mm: float) -> Body:
        return box(46, 34, 24) - box(16, 12, 8).translate((x_mm, 2, 12))

    nominal = PosedPart(solid_of(pocketed(0.0), "pocketed"))
    looks = ((0.0, 3.0), (4.0, -3.0), (18.0, 6.0))
    assert places_against(evidence(nominal, pocketed(0.0), looks)) == []
    told = places_against(evidence(nominal, pocketed(0.7), looks))
    assert told
    assert all("out of its place" in one for one in told)


def test_a_wall_that_edges_could_show_says_why_they_do_not() -> None:
    along = blind_wall(evidence(blind_part(), blind(8.0), ((0.0, 0.0),)))
    assert "of its rim shown in place" in along.why
    wall = next(f.id for f in part().solid.faces if f.concave and abs(f.radius_mm - 3) < 0.1)
    assert "light through it" in of_perfect().faces[wall].why
    assert of_perfect().faces[bore_wall()].why == ""


@pytest.mark.parametrize("depth_mm", [4.0, 0.001], ids=["half deep", "missing"])
def test_a_blind_bore_of_another_depth_is_not_shown(depth_mm: float) -> None:
    assert not blind_wall(evidence(blind_part(), blind(depth_mm), LOOKS)).is_verified


def proven(found: EdgeEvidence, kind: FindingKind) -> list[str]:
    """What is against a part for certain, by findings of a kind."""
    every = [f for of_view in found.findings.values() for f in of_view]
    return [f.words for f in every if f.kind is kind and f.is_sure]


ALMOST_ALONG = ((6.0, 6.0),)


@pytest.mark.parametrize("depth_mm", [4.0, 5.0])
def test_a_depth_that_edges_and_light_of_one_view_agree_on_is_certain(depth_mm: float) -> None:
    found = evidence(blind_part(3.0), blind(depth_mm, 3.0), ALMOST_ALONG)
    told = proven(found, FindingKind.DIMENSION)
    assert told
    assert all(f"{8.0 - depth_mm:.1f} mm higher" in one for one in told)


def test_a_depth_that_edges_alone_or_light_alone_show_in_one_view_is_not_certain() -> None:
    by_edges = evidence(blind_part(), blind(7.0), ((26.0, 8.0),))  # too flat for the light
    by_light = evidence(blind_part(3.0), blind(5.0, 3.0), ((0.0, 0.0),))
    for found in (by_edges, by_light):
        assert places_against(found)
        assert not proven(found, FindingKind.DIMENSION)


def test_a_hole_that_no_view_shows_any_of_is_certainly_missing() -> None:
    found = evidence(blind_part(), box(46, 34, 24), LOOKS)
    (words,) = proven(found, FindingKind.MISSING_EDGE)
    assert "a whole mouth, 25." in words


@pytest.mark.parametrize(
    ("radius_mm", "looks"), [(4.0, ((-5.0, 5.0), (5.0, -4.0))), (1.4, LOOKS)],
    ids=["hardly turned", "smaller than any defect"],
)  # fmt: skip
def test_a_mouth_that_light_may_hide_is_not_certainly_missing(
    radius_mm: float, looks: tuple[tuple[float, float], ...]
) -> None:
    found = evidence(blind_part(radius_mm), box(46, 34, 24), looks)
    assert found.missing
    assert not proven(found, FindingKind.MISSING_EDGE)


def test_a_hole_elsewhere_is_not_missing() -> None:
    body = box(46, 34, 24) - rod(4, 16, 64).translate((-7.5, 2, 12))
    assert not proven(evidence(blind_part(), body, LOOKS), FindingKind.MISSING_EDGE)


def test_a_floor_seen_along_the_axis_proves_no_depth() -> None:
    assert not blind_wall(evidence(blind_part(), blind(8.0), ((0.0, 0.0),))).is_verified


def evidence_on_floor(
    body: Body,
    radius_mm: float,
    smallest_mm: float,
    looks: tuple[tuple[float, float], ...] = LOOKS,
) -> FaceEdges:
    """The evidence on the floor of a bore that must be 8 mm deep."""
    nominal = blind_part(radius_mm)
    limits = InspectionLimits(smallest_defect_mm=smallest_mm)
    floor = next(
        f.id
        for f in nominal.solid.faces
        if f.kind == "plane" and np.allclose(f.centre_mm, (-8, 2, 4), atol=0.1)
    )
    return evidence(nominal, body, looks, limits).faces[floor]


def floor_is_shown(depth_mm: float, radius_mm: float, smallest_mm: float) -> bool:
    """Whether edges verify the floor of a bore of a depth where it must be 8 mm."""
    return evidence_on_floor(blind(depth_mm, radius_mm), radius_mm, smallest_mm).is_verified


def test_a_floor_too_narrow_to_be_compared_is_shown_with_its_wall() -> None:
    assert floor_is_shown(8.0, 8.0, 16.0)  # a defect of 16 mm is as wide as the floor
    assert not floor_is_shown(8.0, 8.0, 3.0)  # one of 3 mm has room on it
    assert not floor_is_shown(4.0, 8.0, 16.0)


def test_a_floor_so_deep_that_its_border_is_in_the_shade_is_shown_with_its_wall() -> None:
    # on a disc of 6 mm a defect of 3 mm has room, but next to none beside the shade of the mouth
    assert floor_is_shown(8.0, 3.0, 3.0)
    assert not floor_is_shown(4.0, 3.0, 3.0)
    assert not floor_is_shown(6.5, 3.0, 3.0)


@pytest.mark.parametrize("at_mm", [(0.0, 0.0), (0.8, -0.6)])
def test_a_deep_floor_with_something_on_it_is_not_shown(at_mm: tuple[float, float]) -> None:
    x, y = at_mm
    lump = box(3.0, 3.0, 2.0).translate((-8 + x, 2 + y, 5))
    found = evidence_on_floor(blind(8.0, 3.0) + lump, 3.0, 3.0)
    assert not found.is_verified
    assert "light on it" in found.why


def test_a_deep_floor_is_shown_only_where_a_lamp_lights_it() -> None:
    found = evidence_on_floor(blind(8.0, 3.0), 3.0, 3.0, ((35.0, 0.0), (-35.0, 0.0), (0.0, 33.0)))
    assert not found.is_verified


def countersunk() -> Body:
    """A plate with a bore that ends in a cone at its front."""
    cone = Manifold.cylinder(2.0, 3.0, 5.0, 64).translate((-6, 2, 4))
    return box(46, 34, 12) - rod(3, 30, 64).translate((-6, 2, 0)) - cone


def test_a_countersink_is_shown_by_its_edges_and_the_light_through_its_bore() -> None:
    sunk = PosedPart(solid_of(countersunk(), "sunk"))
    cone = next(f.id for f in sunk.solid.faces if f.kind == "cone")
    looks = ((-12.0, 5.0), (15.0, -10.0))
    limits = InspectionLimits(smallest_defect_mm=4.0)
    assert evidence(sunk, countersunk(), looks, limits).faces[cone].is_verified
    plugged = countersunk() + rod(3, 6, 64).translate((-6, 2, -3))
    assert not evidence(sunk, plugged, looks, limits).faces[cone].is_verified


def notched() -> Body:
    """A notch in the edge between front and top, smaller than the smallest defect."""
    return perfect() - box(2.0, 4.0, 3.0).translate((4, 17, 12))


def test_a_notch_that_the_part_lacks_shows_as_missing_edges() -> None:
    nominal = PosedPart(solid_of(notched(), "notched"))
    looks = ((20.0, -12.0), (-15.0, -10.0), (4.0, -18.0))  # edges of 2 mm need three
    without = evidence(nominal, perfect(), looks).missing
    # a finding, which no one look and no two looks can prove
    found = evidence(nominal, perfect(), looks).findings
    kinds = [f.kind for of_view in found.values() for f in of_view]
    assert FindingKind.MISSING_EDGE in kinds
    # two lamps of one view may leave a short edge dark, but not all of them
    missing = set(without) - set(evidence(nominal, notched(), looks).missing)
    assert len(missing) >= 2
    assert {nominal.solid.faces[i].kind for edge in missing for i in edge.faces} == {"plane"}
    assert max(edge.length_mm for edge in missing) <= 2.0 + 1e-6


@pytest.mark.parametrize(("ledge_mm", "is_asked"), [(0.15, False), (2.0, True)])
def test_the_edges_of_a_ledge_within_the_blur_need_not_show(
    ledge_mm: float, is_asked: bool
) -> None:
    whole = box(46, 34, 24)
    ledge = box(50, 20, 2 * ledge_mm).translate((0, 17, 12))
    nominal = PosedPart(solid_of(whole - ledge, "ledge"))
    looks = ((20.0, -12.0), (-15.0, -10.0), (4.0, -18.0))
    assert bool(evidence(nominal, whole, looks).missing) is is_asked


def test_a_perfect_part_lacks_no_edge() -> None:
    assert of_perfect().missing == ()


def test_no_view_proves_nothing() -> None:
    assert evidence(part(), perfect(), ()).faces == {}


def test_two_rims_without_light_between_them_show_no_wall() -> None:
    # the cross bore opens to both sides, and no view looks through it
    wall = next(f.id for f in part().solid.faces if f.concave and abs(f.radius_mm - 3) < 0.1)
    assert not of_perfect().faces[wall].is_verified


def crossed() -> Body:
    """A tube along y with a hole in its front, 4 mm below its end."""
    tube = (rod(11, 40, 96) - rod(6, 60, 96)).rotate((90, 0, 0))
    return tube - rod(2.5, 30, 64).translate((0, 16, 15))


@cache
def of_crossed(*plugs: Body) -> FaceEdges:
    """Its hole's wall: light passes in one view alone, slantwise past the tube's end."""
    nominal = PosedPart(solid_of(crossed(), "crossed"))
    rims = ((20.0, 25.0), (-20.0, 20.0), (0.0, 120.0), (0.0, 140.0, 20.0))
    inner = ((0.0, 125.0, 35.0), (0.0, 125.0, -35.0))
    body = sum(plugs, crossed())
    found = evidence(nominal, body, ((0.0, -14.0), *rims, *inner))
    return found.faces[next(f.id for f in nominal.solid.faces if abs(f.radius_mm - 2.5) < 0.1)]


CROSS_WEB = rod(2.5, 1, 48).translate((0, 16, 9))
NOT_DRILLED = {
    "web": CROSS_WEB,
    "half web": CROSS_WEB ^ box(2.5, 10, 30).translate((1.25, 16, 9)),
    "not through": rod(2.5, 2, 48).translate((0, 16, 6.5)),
}


def test_a_hole_that_ends_in_a_bore_is_shown_by_light_past_the_bores_end_and_both_rims() -> None:
    wall = of_crossed()
    assert wall.is_verified
    assert wall.share > 0.8


@pytest.mark.parametrize("plug", NOT_DRILLED.values(), ids=NOT_DRILLED)
def test_a_hole_that_does_not_reach_the_bore_is_not_shown(plug: Body) -> None:
    assert not of_crossed(plug).is_verified


KEYWAY_TOP = 12.0


def keyed() -> Body:
    """A bore with a keyway, both cut in two by a cross hole wider than the keyway."""
    keyway = box(8, KEYWAY_TOP, 30).translate((0, KEYWAY_TOP / 2, 0))
    return box(46, 34, 24) - rod(8, 40, 96) - keyway - rod(4.5, 60, 64).rotate((90, 0, 0))


@cache
def keyed_part() -> PosedPart:
    return PosedPart(solid_of(keyed(), "keyed"))


def keyway_floors(found: EdgeEvidence) -> tuple[FaceEdges, FaceEdges]:
    """The pieces of the keyway's floor, at the back and at the front, too wide to be narrow."""
    faces = [
        face
        for face in keyed_part().solid.faces
        if face.kind == "plane" and np.allclose(face.centre_mm[:2], (0, KEYWAY_TOP), atol=0.1)
    ]
    back, front = sorted(faces, key=lambda face: float(face.centre_mm[2]))
    return found.faces[back.id], found.faces[front.id]


FROM_THE_FRONT = ((1.0, 2.0), (-2.0, -1.0))


def test_light_along_one_piece_of_a_wall_shows_all_that_lie_in_line_with_it() -> None:
    # in sight from the front alone: the light ends at the back
    floors = keyway_floors(evidence(keyed_part(), keyed(), FROM_THE_FRONT))
    assert all(one.is_verified and "light" in one.how for one in floors)
    assert min(one.share for one in floors) > 0.8


BACK, FRONT = 0, 1
# what is in the keyway, and which piece of its floor is wrong
IN_THE_KEYWAY = {
    "not cut to the back": (box(8, 5, 12).translate((0, 10, -6)), BACK),
    "not cut to the front": (box(8, 5, 12).translate((0, 10, 6)), FRONT),
    "a web": (box(8, 5, 1).translate((0, 10, -9)), BACK),
    "too shallow": (box(8, 2, 24).translate((0, KEYWAY_TOP, 0)), BACK),
    "too shallow at the back": (box(8, 2, 12).translate((0, KEYWAY_TOP, -6)), BACK),
    "too shallow at the front": (box(8, 2, 12).translate((0, KEYWAY_TOP, 6)), FRONT),
}


@pytest.mark.parametrize(("lump", "wrong"), IN_THE_KEYWAY.values(), ids=IN_THE_KEYWAY)
def test_a_keyway_that_is_not_clear_is_not_shown_by_the_light_along_it(
    lump: Body, wrong: int
) -> None:
    found = evidence(keyed_part(), keyed() + lump, FROM_THE_FRONT)
    assert not keyway_floors(found)[wrong].is_verified


def clevis(*holes: float) -> Body:
    """A low leg before a high one, a hole through each, both in line, at two z."""
    legs = box(46, 34, 4).translate((0, 0, -10)) + box(46, 16, 4).translate((0, -9, 10))
    body = legs + box(46, 4, 24).translate((0, -15, 0))
    for z in holes:
        body -= rod(4, 8, 64).translate((0, -8, z))
    return body


def test_light_past_a_leg_says_nothing_of_the_hole_in_it() -> None:
    nominal = PosedPart(solid_of(clevis(-10.0, 10.0), "clevis"))
    found = evidence(nominal, clevis(-10.0), ((0.0, 28.0), (2.0, 30.0)))
    walls = [f for f in nominal.solid.faces if f.kind == "cylinder"]
    far, near = sorted(walls, key=lambda wall: float(wall.centre_mm[2]))
    assert found.faces[far.id].is_verified
    assert not found.faces[near.id].is_verified
    assert found.faces[near.id].share == 0.0


def test_a_sliver_of_a_wall_whose_rims_are_too_short_to_be_looked_for_is_not_shown() -> None:
    corner = CrossSection([[(-4, -3), (4, -3), (0.05, 4), (-0.05, 4)]])
    body = box(46, 34, 24) - Manifold.extrude(corner, 30).translate((0, 0, -15))
    nominal = PosedPart(solid_of(body, "sliver"))
    (recess,) = find_recesses(nominal.solid)
    assert recess.is_through
    areas = {wall: nominal.solid.faces[wall].area_mm2 for wall in recess.walls}
    sliver = min(areas, key=areas.__getitem__)
    found = evidence(nominal, body, LOOKS[:1])
    assert sliver not in found.faces or not found.faces[sliver].is_verified
