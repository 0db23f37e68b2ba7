"""Which edges of a picture a part makes by itself, on surfaces known on paper."""

from __future__ import annotations

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from numpy.typing import NDArray
from table_pictures import overhead, resting

from controller.cad import Solid
from controller.recognition.fitting import are_highlights, are_shaded, edge_model

Array = NDArray[np.float64]
CAMERA = overhead()
LYING = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # what stood along z lies along x
TURN = 0.4  # of the part on the table [rad]
ALONG = np.array([np.cos(TURN), np.sin(TURN), 0.0])  # the cylinder's own direction
ACROSS = np.array([-np.sin(TURN), np.cos(TURN), 0.0])


def asked(part: Solid, R: Array, points_mm: Array, gradient: Array) -> list[bool]:
    """The answers for picture edges at points of the world, gradients along a direction there."""
    T = resting(part, R, 0.0, 0.0, TURN)
    at = CAMERA.project(points_mm)
    ahead = CAMERA.project(points_mm + 0.1 * gradient) - at
    normals = ahead / np.linalg.norm(ahead, axis=1)[:, None]
    return are_highlights(edge_model(part), T, CAMERA, at, normals).tolist()


def on_top(height_mm: float) -> Array:
    return np.outer(np.linspace(-12, 12, 7), ALONG) + np.array([0, 0, height_mm])


def test_a_streak_along_a_cylinder_is_a_highlight_and_a_ring_round_it_is_none() -> None:
    part = solid_of(rod(10, 40, 96), "rod")
    assert asked(part, LYING, on_top(20.0), ACROSS) == [True] * 7
    assert asked(part, LYING, on_top(20.0), ALONG) == [False] * 7
    assert asked(part, LYING, on_top(20.0), ALONG + ACROSS) == [False] * 7


def test_a_plane_face_makes_no_highlight_with_a_sharp_flank() -> None:
    block = solid_of(box(40, 30, 12), "block")
    assert asked(block, np.eye(3), on_top(12.0), ACROSS) == [False] * 7
    assert asked(block, np.eye(3), on_top(12.0), ALONG) == [False] * 7


def test_on_a_ball_a_highlight_runs_any_way() -> None:
    ball = solid_of(Body.sphere(12.0, 128), "ball")
    top = np.array([[0.0, 0.0, 24.0]])
    assert asked(ball, np.eye(3), top, ALONG) == asked(ball, np.eye(3), top, ACROSS) == [True]


def test_beside_the_part_nothing_is_a_highlight_of_it() -> None:
    part = solid_of(rod(10, 40, 96), "rod")
    assert asked(part, LYING, on_top(0.0) + 60.0 * ACROSS, ACROSS) == [False] * 7


@pytest.mark.parametrize("name", ["rod", "block"])
def test_no_edges_have_no_answer(name: str) -> None:
    part = solid_of({"rod": rod(10, 40, 96), "block": box(40, 30, 12)}[name], name)
    none = np.zeros((0, 2))
    assert are_highlights(edge_model(part), np.eye(4), CAMERA, none, none).tolist() == []


def shaded(part: Solid, points_mm: Array) -> list[bool]:
    """The answers for points of the world on a part that lies at the origin as it is drawn."""
    T = resting(part, np.eye(3), 0.0, 0.0, 0.0)
    return are_shaded(edge_model(part), T, CAMERA, CAMERA.project(points_mm)).tolist()


def test_a_part_shades_the_floor_of_its_grooves_and_no_face_that_lies_open() -> None:
    # a groove 8 mm wide and 14 deep, seen from straight above
    rail = solid_of(box(60, 40, 20) - box(80, 8, 14).translate((0, 0, 3)), "rail")
    along = np.linspace(-12, 12, 5)
    floor = np.column_stack([along, 0 * along, 0 * along + 6])
    face = np.column_stack([along, 0 * along + 12, 0 * along + 20])
    assert shaded(rail, floor) == [True] * 5
    assert shaded(rail, face) == [False] * 5


def test_one_wall_beside_a_plane_does_not_shade_it() -> None:
    step = solid_of(box(60, 40, 6) + box(60, 10, 30).translate((0, 15, 12)), "step")
    along = np.linspace(-12, 12, 5)
    assert shaded(step, np.column_stack([along, 0 * along + 8, 0 * along + 6])) == [False] * 5
    assert shaded(step, np.column_stack([along, 0 * along - 60, 0 * along])) == [False] * 5
