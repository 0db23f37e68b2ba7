"""The examples of docs/conventions.md, worked by hand there.

Sections (§) are those of conventions.md.
"""

from __future__ import annotations

import numpy as np
import pytest
from cad_solids import box, solid_of

from controller.cad import stable_poses
from controller.imaging.camera import Camera, transform
from controller.recognition.library import pose_on_table
from drivers.umi_scara import kinematics
from emulators.world.poses import quat_xyzw_of


def test_a_part_is_turned_upright_then_by_theta_then_moved() -> None:
    """§8.1."""
    block = solid_of(box(40, 30, 20).translate((20, 15, 10)))
    (as_drawn,) = (p for p in stable_poses(block) if np.allclose(p.R[2], (0, 0, 1)))
    first_turn = np.arctan2(as_drawn.R[1, 0], as_drawn.R[0, 0])  # R is free up to a turn about z
    T = pose_on_table(block, as_drawn, 100.0, 50.0, np.pi / 2 - first_turn)
    assert transform(T, np.zeros((1, 3)))[0] == pytest.approx((115, 30, 0), abs=1e-6)


def test_pixels_count_from_the_centre_of_the_first_with_v_down() -> None:
    """§8.2."""
    T_world_cam = np.diag([1.0, -1.0, -1.0, 1.0])
    T_world_cam[2, 3] = 1000.0
    K = np.array([[1000.0, 0, 320], [0, 1000, 240], [0, 0, 1]])
    camera = Camera((640, 480), K, np.zeros(5), T_world_cam)
    pixels = camera.project(np.array([[10.0, 0, 0], [0, 10, 0]]))
    assert pixels == pytest.approx(np.array([[330.0, 240], [320, 230]]))


def test_the_arms_joints_turn_the_way_the_page_says() -> None:
    """§8.3, §8.4."""
    down = kinematics.forward(np.array([np.pi / 2, 0, 0, -100, -np.pi / 2, 0]))
    assert down[:3, 3] == pytest.approx((0, 507, 638), abs=1e-6)
    assert down[:3, 0] == pytest.approx((0, 0, -1), abs=1e-9)
    assert down[:3, 1] == pytest.approx((-1, 0, 0), abs=1e-9)
    bent = kinematics.forward(np.array([0, np.pi / 2, 0, 0, 0, 0]))
    assert bent[:3, 3] == pytest.approx((378.66, 378.66, 915), abs=0.01)
    assert np.degrees(np.arctan2(bent[1, 0], bent[0, 0])) == pytest.approx(45)


def test_quaternions_are_x_y_z_w() -> None:
    """§8.5."""
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert quat_xyzw_of(quarter) == pytest.approx((0, 0, 0.5**0.5, 0.5**0.5))
