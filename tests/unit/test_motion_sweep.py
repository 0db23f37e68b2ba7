"""The space that homing with a part sweeps: proven free, or what comes too close.

Expectations are by construction: walls put where the arm must pass or well outside; and by random
configurations of the same phases, each looked at by itself with the part's own triangles.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controller.config import load_cell
from controller.planning.geometry import Box
from controller.planning.motion import Scene, prove_sweep, tcp_pose
from controller.setup.layout import build_layout
from drivers.umi_scara import kinematics

LAYOUT = build_layout(load_cell(Path(__file__).parents[2] / "recipes/cells/emulated.yaml"))
ARM = LAYOUT.arm
OFF = np.array([0.06, 0.06, 0.06, 12.0, 0.06, 0.06])
# over the table before the station, arm bent to the right of the panel
STANDS = np.array([*np.radians([-41.0, 51.0, 111.0]), -341.0, *np.radians([-45.0, 0.0])])
PART = Box.from_bounds(-20, 40, -15, 15, -30, 30)


def scene(part: Box = PART, **walls: Box) -> Scene:
    layout = replace(LAYOUT, obstacles={**LAYOUT.obstacles, **walls})
    return Scene(layout, 30.0, 85.0, part)


def phases(off: np.ndarray = OFF) -> list:
    return list(ARM.homing_sweep(STANDS - off, STANDS + off))


def test_homing_from_before_the_station_is_free() -> None:
    assert prove_sweep(scene(), phases()).is_free


def test_what_stands_above_the_arm_is_named_with_the_phase() -> None:
    x, y, z = tcp_pose(LAYOUT, STANDS)[:3, 3]
    lid = Box.from_bounds(x - 30, x + 30, y - 30, y + 30, z + 150, z + 160)
    found = prove_sweep(scene(lid=lid), phases())
    assert not found.is_free
    assert (found.touches, found.phase) == ("lid", "zed goes up to its stop")


def test_a_thing_that_only_an_arm_beside_its_estimate_meets_is_found() -> None:
    """A wall 18 mm beside the part is out of its way, and 3.4 degrees of shoulder are 23 mm."""
    bar = Box.from_bounds(-10, 10, -90, 90, -10, 10)  # wider than the hand
    part = bar.placed(tcp_pose(LAYOUT, STANDS))
    reach = np.abs(part.T[:3, :3]) @ part.half_mm
    low_x = part.T[0, 3] + reach[0] + 18.0
    y, z = part.T[1, 3], part.T[2, 3]
    wall = Box.from_bounds(low_x, low_x + 5, y - 300, y + 300, z - 5, z + 5)
    sharp = np.full(6, 1e-4)
    assert prove_sweep(scene(bar, wall=wall), phases(sharp)[:1]).is_free
    found = prove_sweep(scene(bar, wall=wall), phases()[:1])
    assert found.touches == "wall"


def test_each_random_configuration_of_a_free_sweep_is_free_by_itself() -> None:
    rng = np.random.default_rng(41)
    for phase in phases():
        angles = rng.uniform(phase.low, phase.high, (1500, 6))
        assert scene().free(angles @ phase.join.T, 9.9).all(), phase.what


def test_an_elbow_that_may_be_folded_behind_meets_the_column() -> None:
    stands = np.array([*np.radians([60.0, 140.0, 70.0]), -300.0, *np.radians([-10.0, 0.0])])
    found = prove_sweep(scene(), ARM.homing_sweep(stands - OFF, stands + OFF))
    assert found.touches == "column"


@pytest.mark.parametrize("joint", range(6))
def test_the_sweep_begins_where_the_arm_may_stand(joint: int) -> None:
    first = phases()[0]
    inside = np.linalg.solve(first.join, STANDS)
    assert (first.low <= inside).all()
    assert (inside <= first.high).all()
    assert (first.high - first.low)[joint] >= OFF[joint]


def test_a_sweep_ends_at_the_park_of_homing() -> None:
    park = kinematics.counts_to_q([0, 0, -38, 0, 0, 0])  # umi_rtx.md 4.7, step 8
    last = phases()[-1]
    angles = np.linalg.solve(last.join, park)
    assert (last.low - 1e-9 <= angles).all()
    assert (angles <= last.high + 1e-9).all()
