"""The pose of the fixed gripper from touches made up of a truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from controller.calibration.grippers import (
    FixedGripperFit,
    Touch,
    TouchError,
    TouchNoise,
    locate_fixed_gripper,
)

# the shipped cell's: x along the world's y, y upwards
NOMINAL = np.array([[0.0, 0, 1, 150], [1, 0, 0, -330], [0, 1, 0, 430], [0, 0, 0, 1]])
STD = np.array([np.radians(1.0) / 5**0.5] * 3 + [4.0 / 5**0.5] * 3)
THICK_MM, FINGER_MM = 10.0, 12.0
NOISE = TouchNoise(touch_mm=0.2, least_mm=0.02, opening_mm=0.1, arm_mm=0.0, arm_rad=0.0)


def moved(T: np.ndarray, turn_rad: np.ndarray, by_mm: np.ndarray) -> np.ndarray:
    """A pose turned about, then moved along its own axes."""
    d = np.eye(4)
    d[:3, :3], d[:3, 3] = Rotation.from_rotvec(turn_rad).as_matrix(), by_mm
    out: np.ndarray = T @ d
    return out


def true_fixed(seed: int) -> np.ndarray:
    d = STD * np.random.default_rng(seed).standard_normal(6)
    return moved(NOMINAL, d[:3], d[3:])


def opening(fixed: np.ndarray, arm: np.ndarray, pad: int, face: int) -> float:
    """How wide the jaws are when a tip first meets a face, closed from wide open by halving."""
    low, high = 0.0, 200.0
    n = fixed[:3, 1]
    for _ in range(40):
        wide = (low + high) / 2
        corners = [
            arm[:3, :3] @ np.array([0.0, pad * wide / 2, z]) + arm[:3, 3]
            for z in (-FINGER_MM / 2, FINGER_MM / 2)
        ]
        heights = [face * float(n @ (p - fixed[:3, 3])) for p in corners]
        if min(heights) > THICK_MM / 2:
            high = wide
        else:
            low = wide
    return high


def touches(
    fixed: np.ndarray, rng: np.random.Generator, std_mm: float, wider_mm: float = 0.0
) -> list[Touch]:
    out = []
    for flip in (1, -1):
        for across in (-26.0, 26.0):
            for along in (80.0, 57.0, 34.0):
                for face in (1, -1):
                    tilt = -face * np.radians(3.0)
                    x = np.array([-np.cos(tilt), np.sin(tilt), 0.0])
                    y = flip * np.array([np.sin(tilt), np.cos(tilt), 0.0])
                    local = np.eye(4)
                    local[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
                    local[:3, 3] = along, -10.0 * face, across
                    arm = NOMINAL @ local
                    pad = face * flip
                    reads = opening(fixed, arm, pad, face) - wider_mm
                    reads += std_mm * rng.standard_normal()
                    out.append(Touch(f"touch {len(out)}", arm, reads, pad, face))
    return out


def off_by(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """How far the plane between the jaws is off along its normal [mm], and its tilt [rad]."""
    d = np.linalg.inv(true) @ found
    return abs(float(d[1, 3])), float(np.arccos(np.clip(d[1, 1], -1, 1)))


def locate(made: list[Touch], noise: TouchNoise = NOISE) -> FixedGripperFit:
    return locate_fixed_gripper(
        NOMINAL, STD, made, thickness_mm=THICK_MM, finger_width_mm=FINGER_MM, noise=noise
    )


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_touches_on_both_faces_show_the_jaws_plane_and_no_more(seed: int) -> None:
    fixed, rng = true_fixed(seed), np.random.default_rng(seed)
    found = locate(touches(fixed, rng, 0.0))
    assert set(found.observed) == {"y_mm", "rx_rad", "rz_rad"}
    assert set(found.held) == {"x_mm", "z_mm", "ry_rad"}
    mm, rad = off_by(found.T_world_tcp, fixed)
    # freedoms along the plane are not known, and move a tilted plane by their product
    assert mm < 0.01
    assert rad < np.radians(0.02)
    assert found.rms_mm < 0.01


def test_an_opening_that_reads_too_small_is_found_and_moves_nothing() -> None:
    fixed = true_fixed(5)
    exact = locate(touches(fixed, np.random.default_rng(0), 0.0))
    found = locate(touches(fixed, np.random.default_rng(0), 0.0, wider_mm=0.15))
    assert found.opening_off_mm == pytest.approx(0.15, abs=0.02)
    np.testing.assert_allclose(found.T_world_tcp, exact.T_world_tcp, atol=2e-3)


def test_the_stated_uncertainty_holds_for_many_truths() -> None:
    rng, inside = np.random.default_rng(9), []
    for seed in range(100, 116):
        fixed = true_fixed(seed)
        found = locate(touches(fixed, rng, 0.2))
        mm, rad = off_by(found.T_world_tcp, fixed)
        inside += [mm < 2 * found.u_mm, rad < 2 * found.u_rad]
        # 24 touches of 0.1 mm, on a plate: no wonder, but no more than that either
        assert found.u_mm < 0.15
        assert np.degrees(found.u_rad) < 0.15
    assert np.mean(inside) > 0.9


def test_what_the_arm_is_uncertain_by_comes_on_top() -> None:
    made = touches(true_fixed(6), np.random.default_rng(6), 0.1)
    alone = locate(made)
    arm = locate(made, replace(NOISE, arm_mm=0.3, arm_rad=0.004))
    assert arm.u_mm == pytest.approx(np.hypot(alone.u_mm, 0.3), rel=1e-6)
    assert arm.u_rad > alone.u_rad + 0.002
    np.testing.assert_allclose(arm.T_world_tcp, alone.T_world_tcp)


def test_without_touches_the_drawing_stays() -> None:
    found = locate([])
    np.testing.assert_allclose(found.T_world_tcp, NOMINAL)
    np.testing.assert_allclose(np.sqrt(np.diag(found.cov)), STD)
    assert found.observed == ()


def test_a_touch_of_something_else_is_named() -> None:
    made = touches(true_fixed(7), np.random.default_rng(7), 0.05)
    made[4] = replace(made[4], opening_mm=made[4].opening_mm + 6.0)
    with pytest.raises(TouchError, match="touch 4 is"):
        locate(made)
