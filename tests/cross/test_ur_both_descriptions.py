"""A UR arm as planning and as the emulated world have it: two readings of one cell file."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.config import load_cell
from controller.planning.model import CellLayout
from controller.setup.layout import build_layout
from emulators.world import Layout, read_layout

Array = NDArray[np.float64]

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "ur5e.yaml"
# the boxes of both sides are rounded to whole millimetres
ROUNDED_MM = 1.0


@pytest.fixture(params=["ur3e", "ur5e", "ur10e"])
def both(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[CellLayout, Layout]:
    path = tmp_path / "cell.yaml"
    text = CELL.read_text().replace("model: ur5e", f"model: {request.param}, jaws_deg: 35")
    path.write_text(text)
    return build_layout(load_cell(path)), read_layout(path)


def test_both_have_the_tcp_at_the_same_place(both: tuple[CellLayout, Layout]) -> None:
    planned, world = both
    rows = np.random.default_rng(6).uniform(-np.pi, np.pi, (200, 6))
    T_world_tcp = planned.T_world_arm @ planned.arm.forward(rows)
    for q, T in zip(rows, T_world_tcp, strict=True):
        poses = world.arm.chain.poses(world.arm.T_world_base, q.tolist())
        np.testing.assert_allclose(poses["arm gripper"], T, atol=1e-9)


def test_what_can_be_run_into_is_within_what_is_kept_clear(both: tuple[CellLayout, Layout]) -> None:
    """A contact that planning does not know of would stop an arm that goes as planned."""
    planned, world = both
    q = np.random.default_rng(7).uniform(-np.pi, np.pi, (1, 6))
    R, origins_mm = planned.arm.link_frames(q)
    poses = world.arm.chain.poses(np.eye(4), q[0].tolist())
    for link in world.arm.chain.links:
        for box in link.boxes:
            sides = np.linspace(box.low_mm, box.high_mm, 7).T
            points = np.array(list(product(*sides)))
            points = points @ poses[link.name][:3, :3].T + poses[link.name][:3, 3]
            beyond_mm = np.min(
                [
                    beyond(points, R[0, number], origins_mm[0, number], one.T, one.half_mm)
                    for number, one in enumerate(planned.arm.links)
                ],
                axis=0,
            )
            assert beyond_mm.max() <= ROUNDED_MM, box.name


def beyond(points: Array, R: Array, origin_mm: Array, T: Array, half_mm: Array) -> Array:
    """Return how far points (n, 3) are outside a box in a link's frame [mm]."""
    in_link = (points - origin_mm) @ R
    in_box = (in_link - T[:3, 3]) @ T[:3, :3]
    away: Array = (np.abs(in_box) - half_mm).max(axis=1)
    return away
