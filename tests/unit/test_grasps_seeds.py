"""Where to try a jaw: overlaps of opposed faces by area, bisected walls, friction angles needed."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from cad_solids import box, polygon_area, prism, rod, solid_of
from grasp_bench import HAND, RULES, SPREADING

from controller.cad import make_solid, sample_surface
from controller.imaging import RayCaster
from controller.planning.grasps import FacePair, find_seeds, needed_friction, opposed_faces


def across_z(pairs: list[FacePair]) -> list[FacePair]:
    return [p for p in pairs if abs(p.first.normal[2]) > 0.99]


def test_the_overlap_of_a_drilled_plates_faces_leaves_the_holes_out() -> None:
    plate = (
        box(80, 50, 10)
        - rod(8, 20, 48).translate((20, 0, 0))
        - rod(5, 20, 32).translate((-20, 5, 0))
    )
    (pair,) = across_z(opposed_faces(solid_of(plate), 80.0))
    assert pair.gap_mm == pytest.approx(10.0, abs=1e-6)
    holes = polygon_area(8, 48) + polygon_area(5, 32)
    assert pair.overlap.area == pytest.approx(80 * 50 - holes, rel=1e-6)


def test_steps_that_only_partly_face_each_other_overlap_where_both_are() -> None:
    # upper slab x -40..10, lower slab x -10..40, both 30 wide, joined where they cross
    upper = box(50, 30, 10).translate((-15, 0, 5))
    lower = box(50, 30, 10).translate((15, 0, -5))
    pairs = across_z(opposed_faces(solid_of(upper + lower), 80.0))
    areas = sorted((round(p.gap_mm, 3), round(p.overlap.area, 3)) for p in pairs)
    # top against the lower slab's bottom 20 mm apart over 20 x 30; each slab's own faces 10 apart
    assert areas == [(10.0, 900.0), (10.0, 900.0), (20.0, 600.0)]


def test_walls_of_a_channel_face_each_other_across_a_negative_gap() -> None:
    channel = box(80, 60, 40) - box(80, 30, 40).translate((0, 0, 15))
    solid = solid_of(channel)
    assert all(p.gap_mm > 0 for p in opposed_faces(solid, 80.0))
    inner = [p for p in opposed_faces(solid, 80.0, 10.0, 100.0) if p.gap_mm < 0]
    assert [p.gap_mm for p in inner] == [pytest.approx(-30.0, abs=1e-6)]
    assert inner[0].overlap.area == pytest.approx(80 * 25, rel=1e-6)


def test_only_a_jaw_that_spreads_gets_seeds_inside() -> None:
    solid = solid_of(box(80, 60, 40) - rod(20, 60, 64))
    samples, caster = sample_surface(solid, 5.0), RayCaster(solid.mesh)
    assert not find_seeds(solid, samples, caster, 80.0, RULES, [HAND]).inner.any()
    seeds = find_seeds(solid, samples, caster, 80.0, RULES, [SPREADING])
    assert seeds.inner.any()
    middles, gaps = seeds.middle[seeds.inner], seeds.gap[seeds.inner]
    # diameters of the bore, all through its axis
    assert np.all(np.hypot(middles[:, 0], middles[:, 1]) < 0.2)
    assert np.all(np.abs(gaps - 40.0) < 0.2)


def test_walls_at_an_angle_are_tried_along_what_bisects_them() -> None:
    # a wedge whose walls are 16 degrees from each other, 40 mm wide at its foot
    half = np.tan(np.radians(8.0))
    solid = solid_of(prism([(-20, 0), (20, 0), (20 - 60 * half, 60), (-20 + 60 * half, 60)], 50.0))
    seeds = find_seeds(solid, sample_surface(solid, 5.0), RayCaster(solid.mesh), 80.0, RULES)
    square = np.abs(seeds.axis[:, 0]) > 1 - 1e-6
    # the line through both walls square to the wedge's middle plane: its gap is the wedge's width
    assert square.any()
    height = seeds.middle[square, 1]
    assert seeds.gap[square] == pytest.approx(40 - 2 * half * height, abs=0.1)


def test_a_regular_tetrahedron_needs_half_of_what_its_faces_lack_of_being_opposed() -> None:
    # normals are arccos(-1/3) = 109.47 degrees apart; the line that bisects is 35.26 from both
    corners = 25.0 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    solid = make_solid(
        trimesh.convex.convex_hull(corners), "tetra", "0123456789abcdef", where="tetra"
    )
    caster = RayCaster(solid.mesh)
    seeds = find_seeds(solid, sample_surface(solid, 5.0), caster, 80.0, RULES)
    assert len(seeds.gap) == 0
    need_deg, width_mm = needed_friction(solid, seeds, caster)
    assert need_deg == pytest.approx((180 - np.degrees(np.arccos(-1 / 3))) / 2, abs=0.01)
    assert width_mm < 71.0  # no chord is longer than an edge, 25 x 2 x sqrt 2
