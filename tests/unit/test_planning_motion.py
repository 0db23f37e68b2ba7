"""Paths of the arm: straight if nothing is in between, round obstacles, refused if closed in."""

from __future__ import annotations

import numpy as np
import pytest
from planning_cell import emulated_layout

from controller.planning import Box, NoMotionError
from controller.planning.motion import (
    Scene,
    connect,
    inverse_rows,
    move_seconds,
    path_free,
    tcp_pose,
)
from controller.planning.motion.trees import rrt_connect

LAYOUT = emulated_layout()
FREE = Scene(LAYOUT, 60.0, 85.0)


def q(*values: float) -> np.ndarray:
    """Degrees and, fourth, millimetres."""
    out = np.radians(np.array(values, float))
    out[3] = values[3]
    return out


LEFT, RIGHT = q(20, 0, 0, -500, -90, 0), q(-60, 60, 0, -500, -90, 0)
WALL = Box.from_bounds(300.0, 700.0, -12.0, 12.0, 0.0, 620.0)


def test_a_move_takes_as_long_as_its_slowest_motor_and_the_commands() -> None:
    start = q(0, 0, 0, -500, -90, 0)
    # shoulder 23 deg at 23 deg/s, zed 55 mm at 110 mm/s, both of one processor
    end = q(23, 0, 0, -555, -90, 0)
    timing = LAYOUT.arm.timing
    expected = 1.0 + timing.ramp_s + timing.command_s + 2 * timing.motor_s
    assert move_seconds(LAYOUT, [start, end]) == pytest.approx(expected)
    assert move_seconds(LAYOUT, [start, end, end]) == pytest.approx(expected)
    assert move_seconds(LAYOUT, [start]) == 0.0


def test_where_nothing_stands_the_way_is_one_joint_line() -> None:
    way = connect(LEFT, RIGHT, FREE, "test")
    assert len(way) == 1
    np.testing.assert_array_equal(way[0], RIGHT)


def test_a_wall_is_crossed_over_the_top() -> None:
    walled = Scene(LAYOUT, 60.0, 85.0, standing=(WALL,))
    assert not path_free(walled, [LEFT, RIGHT])
    way = connect(LEFT, RIGHT, walled, "test", search=False)
    np.testing.assert_array_equal(way[-1], RIGHT)
    assert len(way) > 1
    assert path_free(walled, [LEFT, *way])


def test_trees_find_a_way_too_and_the_same_one_each_time() -> None:
    walled = Scene(LAYOUT, 60.0, 85.0, standing=(WALL,))
    first = rrt_connect(LEFT, RIGHT, walled, seed=0)
    second = rrt_connect(LEFT, RIGHT, walled, seed=0)
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(np.stack(first), np.stack(second))
    np.testing.assert_array_equal(first[0], LEFT)
    np.testing.assert_array_equal(first[-1], RIGHT)
    assert path_free(walled, first)


def test_a_goal_inside_an_obstacle_is_refused_by_name() -> None:
    at = tcp_pose(LAYOUT, RIGHT)[:3, 3]
    block = Box.from_bounds(*np.column_stack([at - 60, at + 60]).ravel())
    with pytest.raises(NoMotionError, match="way to nowhere"):
        connect(
            LEFT,
            RIGHT,
            Scene(LAYOUT, 60.0, 85.0, standing=(block,)),
            "way to nowhere",
            search=False,
        )


def test_where_every_detour_is_closed_from_its_first_state_on_there_is_no_way() -> None:
    everywhere = Box.from_bounds(-3000.0, 3000.0, -3000.0, 3000.0, -3000.0, 3000.0)
    with pytest.raises(NoMotionError):
        connect(LEFT, RIGHT, Scene(LAYOUT, 60.0, 85.0, standing=(everywhere,)), "", search=False)


def test_every_row_of_the_inverse_leads_back_to_its_pose() -> None:
    rng = np.random.default_rng(2)
    joints = np.column_stack(
        [
            rng.uniform(-1.4, 1.4, 80),
            rng.uniform(-2.4, 2.4, 80),
            rng.uniform(-1.0, 1.0, 80),
            rng.uniform(-800, -50, 80),
            rng.uniform(-1.6, 0.0, 80),
            rng.uniform(-2.0, 2.5, 80),
        ]
    )
    joints[:20, 4] = -np.pi / 2  # straight down, where the heading is free
    poses = tcp_pose(LAYOUT, joints)
    index, _, rows = inverse_rows(LAYOUT, poses)
    np.testing.assert_allclose(tcp_pose(LAYOUT, rows), poses[index], atol=1e-6)
    down = np.bincount(index, minlength=80)[:20]
    assert down.min() > 2, "several headings straight down"
