"""Wrong poses: how closing jaws align a part, and in what share of poses a grasp holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from grasp_bench import HAND, RULES, stood
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from controller.cad import Solid
from controller.imaging import RayCaster
from controller.planning import GraspRules
from controller.planning.grasps.judge import Judge
from controller.planning.grasps.robust import flattened, margins, wrong_poses

OUTER = np.array([False])
BLOCK = solid_of(box(60, 40, 30))


def judge_of(solid: Solid, rules: GraspRules = RULES) -> Judge:
    return Judge(solid, RayCaster(solid.mesh), HAND, rules, None)


def share_of(solid: Solid, T: np.ndarray, gap: float, rules: GraspRules) -> float:
    judge = judge_of(solid, rules)
    found = judge.close(T[None], np.array([gap]), OUTER, judge.fine)
    return float(margins(judge, found, OUTER)[0])


def test_wrong_poses_fill_the_box_they_are_taken_from() -> None:
    rules = replace(RULES, wrong_count=400)
    T = wrong_poses(rules)
    shift = T[:, :3, 3]
    turn = np.degrees(Rotation.from_matrix(T[:, :3, :3]).as_rotvec())
    for values, most in ((shift, rules.wrong_mm), (turn, rules.wrong_deg)):
        assert np.all(np.abs(values) <= most + 1e-9)
        # uniform: mean none, mean square a third of the most squared
        assert np.abs(values.mean(axis=0)).max() < 0.03 * most
        assert (values**2).mean(axis=0) == pytest.approx(most**2 / 3, rel=0.05)


def test_on_a_table_height_and_tilt_are_never_wrong() -> None:
    down = np.array([0.0, 0.6, -0.8])
    T = wrong_poses(RULES, down)
    assert np.abs(T[:, :3, 3] @ down).max() < 1e-12
    assert np.abs(T[:, :3, :3] @ down - down).max() < 1e-12
    assert np.linalg.norm(T[:, :3, 3], axis=1).max() > 0.9


@settings(max_examples=25, deadline=None)
@given(
    st.floats(-2, 2, allow_nan=False),
    st.floats(-2, 2, allow_nan=False),
    st.floats(-2, 2, allow_nan=False),
)
def test_pads_closing_on_a_block_turn_it_flat(
    about_x: float, about_y: float, about_z: float
) -> None:
    judge = judge_of(BLOCK)
    T = stood((0.0, 0.0, -12.0), (0, 0, -1), (0, 1, 0))
    turn = Rotation.from_euler("xyz", [about_x, about_y, about_z], degrees=True).as_matrix()
    T[:3, :3] = turn @ T[:3, :3]
    first = judge.close(T[None], np.array([40.0]), OUTER, judge.coarse, slopes=True)
    flat = flattened(first, OUTER, HAND, judge.coarse)[0]
    # what is left between the jaws' axis and the walls' normal, within the lattice's step
    left = np.degrees(np.arccos(np.clip(abs(flat[1, 1]), 0, 1)))
    assert left < 0.45
    # the turn about the closing axis itself is nothing a pad can undo
    assert flat[2, 0] == pytest.approx(-np.cos(np.radians(about_y)), abs=0.01)


def test_a_pad_well_inside_a_large_wall_holds_at_every_wrong_pose() -> None:
    assert share_of(BLOCK, stood((0, 0, -12.0), (0, 0, -1), (0, 1, 0)), 40.0, RULES) == 1.0


def test_the_share_of_wrong_poses_is_what_the_overlap_says() -> None:
    # tips 4 mm past the upper edge of a wall; half of that must stay: shifts of +-4 mm along the
    # approach leave enough in 3 of 4 poses, shifts square to it never matter
    rules = replace(
        RULES, wrong_mm=4.0, wrong_deg=0.0, wrong_count=120, ray_step_mm=0.5, density_kg_mm3=1e-8
    )
    long_bar = solid_of(box(200, 40, 60), "bar")
    T = stood((0.0, 0.0, 30.0 - 4.0), (0, 0, -1), (0, 1, 0))
    assert rules.min_line_contact_mm2 == 2.0 * 12.0
    assert share_of(long_bar, T, 40.0, replace(rules, max_offset_mm=12.0)) == pytest.approx(
        0.75, abs=0.03
    )


def test_a_ring_held_across_its_wall_turns_into_the_jaws() -> None:
    # one pad in the bore, 1 mm off: it touches with one edge until the ring has turned
    ring = solid_of(rod(58, 20, 128) - rod(16, 30, 96))
    T = stood((37.0, 1.0, -10.0), (0, 0, -1), (1, 0, 0))
    judge = judge_of(ring, replace(RULES, wrong_count=0))
    first = judge.close(T[None], np.array([42.0]), OUTER, judge.coarse, slopes=True)
    assert first.offset[0] > 5.0
    turned = flattened(first, OUTER, HAND, judge.coarse)
    last = judge.close(turned, np.array([42.0]), OUTER, judge.coarse)
    assert last.offset[0] < 1.0
    assert last.area[0] > 1.5 * first.area[0]
