"""Grips of parts whose right answer is plain: a block, a tetrahedron, a slab, a tube."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from planning_cell import emulated_layout

from controller.cad import RayCaster, Solid, make_solid, sample_surface
from controller.planning import Grip, GripRules, NotGraspableError
from controller.planning.grips import find_seeds, synthesise_grips

HAND = emulated_layout().hand
RULES = GripRules()
WIDEST_MM = HAND.max_mm - RULES.jaw_reserve_mm
DOWN = np.array([[0.0, 0.0, -1.0]])


def solid_of(mesh: trimesh.Trimesh, name: str = "part") -> Solid:
    return make_solid(mesh, name, "0123456789abcdef", where=name)


def grips_of(solid: Solid) -> tuple[Grip, ...]:
    caster = RayCaster(solid.mesh)
    seeds = find_seeds(solid, sample_surface(solid, 5.0), caster, WIDEST_MM, RULES)
    return synthesise_grips(solid, seeds, caster, HAND, "arm", DOWN, RULES)


def test_a_block_is_held_across_its_widths_and_nothing_else() -> None:
    grips = grips_of(solid_of(trimesh.creation.box((60.0, 40.0, 30.0))))
    widths = np.array([60.0, 40.0, 30.0])
    for grip in grips:
        axis = np.abs(grip.T_part_hand[:3, 1])
        across = int(np.argmax(axis))
        assert axis[across] > 0.999
        assert grip.opening_mm == pytest.approx(widths[across], abs=0.05)
        # both pads stand on opposite faces: the jaw's middle is the block's middle
        assert grip.T_part_hand[across, 3] == pytest.approx(0.0, abs=0.05)
        assert grip.pre_open_mm >= grip.opening_mm + 2.0
        # a pad is 12 x 24 mm, no contact can be larger
        assert RULES.min_contact_mm2 <= grip.contact_mm2 <= 12 * 24 + 1e-6
        assert np.linalg.det(grip.T_part_hand[:3, :3]) == pytest.approx(1.0)
    assert {int(np.argmax(np.abs(g.T_part_hand[:3, 1]))) for g in grips} == {0, 1, 2}


def test_the_open_hand_never_reaches_into_the_block_on_its_way_in() -> None:
    mesh = trimesh.creation.box((60.0, 40.0, 30.0))
    rng = np.random.default_rng(0)
    for grip in grips_of(solid_of(mesh))[::25]:
        for behind in (0.0, 30.0, 60.0):
            T = grip.T_part_hand.copy()
            T[:3, 3] -= behind * T[:3, 0]
            for box in (*HAND.body, *HAND.fingers(grip.pre_open_mm)):
                points = rng.uniform(-1, 1, (300, 3)) * box.half_mm
                placed = T @ box.T
                world = points @ placed[:3, :3].T + placed[:3, 3]
                assert not np.any(np.all(np.abs(world) < [30.0, 20.0, 15.0], axis=1))


def test_a_tetrahedron_cannot_be_held_between_two_flat_pads() -> None:
    corners = 25.0 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
    mesh = trimesh.convex.convex_hull(corners)
    with pytest.raises(NotGraspableError, match="tetra"):
        grips_of(solid_of(mesh, "tetra"))


def test_a_cube_wider_than_the_jaw_is_refused_with_the_width_that_would_do() -> None:
    with pytest.raises(NotGraspableError, match="at most 80 mm"):
        grips_of(solid_of(trimesh.creation.box((120.0, 120.0, 120.0)), "cube"))


def test_a_ring_wider_than_the_jaw_is_held_across_its_wall() -> None:
    # as a flange: 116 mm outside, 36 mm bore, 20 mm thick; the wall is 40 mm
    mesh = trimesh.creation.annulus(r_min=18.0, r_max=58.0, height=20.0, sections=96)
    grips = grips_of(solid_of(mesh, "ring"))
    radial = [g for g in grips if abs(g.T_part_hand[2, 1]) < 0.1]
    assert radial
    for grip in radial:
        assert grip.opening_mm == pytest.approx(40.0, abs=1.5)
        middle = grip.T_part_hand[:2, 3]
        assert np.linalg.norm(middle) == pytest.approx(38.0, abs=3.0)
    assert any(g.T_part_hand[2, 0] < -0.999 for g in radial), "from above, for a ring lying flat"


def test_a_heavy_part_leaves_only_grips_near_its_centre_of_mass() -> None:
    # steel bar 200 x 30 x 20 mm, 0.94 kg: weight x arm against 2 x 0.6 x 40 N on a 24 mm pad
    solid = solid_of(trimesh.creation.box((200.0, 30.0, 20.0)))
    caster = RayCaster(solid.mesh)
    rules = GripRules(density_kg_mm3=7.85e-6)
    seeds = find_seeds(solid, sample_surface(solid, 6.0), caster, WIDEST_MM, rules)
    grips = synthesise_grips(solid, seeds, caster, HAND, "arm", DOWN, rules)
    weight_n = 200 * 30 * 20 * 7.85e-6 * 9.81
    # the friction couple of two whole pads cannot exceed force x friction x half the diagonal
    most_nmm = 2 * 0.6 * 40.0 * np.hypot(12, 24) / 2
    for grip in grips:
        assert abs(grip.T_part_hand[0, 3]) - 12.0 < most_nmm / weight_n
