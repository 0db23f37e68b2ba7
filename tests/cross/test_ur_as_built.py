"""A UR arm as the emulated world builds it, and as its model can be told of it."""

from math import radians
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from controller.config import load_cell
from controller.setup.layout import build_layout
from controller.setup.measured_arm import measured_arm
from emulators.as_built import draw_as_built
from emulators.world import read_layout
from emulators.world.chain import TCP

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "ur5e.yaml"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_was_built_is_an_arm_that_its_figures_describe(seed: int) -> None:
    """From where its TCP is at some configurations its figures follow, and hold at all others."""
    layout = build_layout(load_cell(CELL))
    built = draw_as_built(read_layout(CELL), seed).layout.arm
    figures = measured_arm(layout)
    bounds = np.array([one.bound for one in figures.unknowns])
    nominal = np.array([one.nominal for one in figures.unknowns])
    rng = np.random.default_rng(seed)

    def true_tcp(q: np.ndarray) -> np.ndarray:
        return np.array([built.chain.poses(built.T_world_base, row.tolist())[TCP] for row in q])

    def told(x: np.ndarray, q: np.ndarray) -> np.ndarray:
        base = layout.T_world_arm.copy()
        base[:3, :3] = Rotation.from_rotvec(x[:3] * radians(0.5)).as_matrix() @ base[:3, :3]
        base[:3, 3] += x[3:6] * 3.0
        return np.asarray(base @ figures.tcp(q, nominal + x[6:] * bounds))

    seen, others = layout.arm.spread(rng.uniform(size=(60, 6))), rng.uniform(-3.0, 3.0, (200, 6))
    truth = true_tcp(seen)

    def off(x: np.ndarray) -> np.ndarray:
        d = told(x, seen) - truth
        # turns count at 300 mm; the bounds are knowledge, too
        return np.concatenate(
            [d[:, :3, 3].ravel(), 300.0 * d[:, :3, :3].ravel(), 1e-4 * np.asarray(x)]
        )

    x = least_squares(off, np.zeros(6 + len(bounds))).x
    assert np.abs(x[6:]).max() < 2.0  # nothing is far beyond what a calibration expects
    before_mm = np.linalg.norm((told(0.0 * x, others) - true_tcp(others))[:, :3, 3], axis=1)
    after_mm = np.linalg.norm((told(x, others) - true_tcp(others))[:, :3, 3], axis=1)
    assert before_mm.min() > 0.2
    assert after_mm.max() < 0.005


def test_the_jaws_of_a_ur_arm_read_less_than_they_are_open() -> None:
    built = draw_as_built(read_layout(CELL), 2)
    assert built.truth()["arm"]["jaw_zero_mm"] == built.arm.jaw_zero_mm != 0.0
