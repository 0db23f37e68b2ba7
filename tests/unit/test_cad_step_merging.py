"""Faces of one surface are one, whatever their kind; others stay apart."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from controller.cad.reading.step.merging import KINDS, distance, merge_faces

PLACE = np.array([1.0, 2.0, 3.0])


def arrays(
    kind: str, pieces: list[np.ndarray], axes: list[Any], radii: list[tuple[float, float, float]]
) -> dict[str, Any]:
    """Return two faces that share an edge; each has the points given, in triangles of their own."""
    points = np.vstack(pieces)
    starts = np.cumsum([0, *(len(piece) for piece in pieces)])
    triangles = [
        (i, i + 1, i + 2) for start, end in pairwise(starts) for i in range(start, end - 2)
    ]
    of = [int(np.searchsorted(starts, t[0], side="right")) - 1 for t in triangles]
    return {
        "vertices_mm": points,
        "triangles": np.array(triangles),
        "face_of_triangle": np.array(of),
        "edge_faces": np.array([[0, 1], [1, -1]]),
        "kind": np.full(2, KINDS.index(kind)),
        "place_mm": np.array([PLACE, PLACE]),
        "axis": np.array(axes, dtype=float),
        "radii": np.array(radii),
        "area_mm2": np.array([3.0, 1.0]),
        "mean_mm": np.array([[0.0, 0, 0], [4.0, 0, 0]]),
    }


def on(kind: str, angles: np.ndarray, radii: tuple[float, float, float]) -> np.ndarray:
    """Return points on a surface about z through PLACE, between two angles round it."""
    radius, minor, half_angle = radii
    u, v = (grid.ravel() for grid in np.meshgrid(angles, np.linspace(0.1, 1.2, 5)))
    away, height = {
        "plane": (v, 0 * v),
        "cylinder": (radius + 0 * v, v),
        "cone": (radius + v * np.tan(half_angle), v),
        "sphere": (radius * np.cos(v), radius * np.sin(v)),
        "torus": (radius + minor * np.cos(v), minor * np.sin(v)),
    }[kind]
    return PLACE + np.column_stack([away * np.cos(u), away * np.sin(u), height])


Z = (0.0, 0.0, 1.0)
RADII = {
    "plane": (0.0, 0.0, 0.0),
    "cylinder": (5.0, 0.0, 0.0),
    "cone": (5.0, 0.0, 0.4),
    "sphere": (5.0, 0.0, 0.0),
    "torus": (5.0, 2.0, 0.0),
}
HALVES = np.linspace(0, np.pi, 9), np.linspace(np.pi, 2 * np.pi, 9)


@pytest.mark.parametrize("kind", list(RADII))
def test_two_halves_of_a_surface_are_one_face(kind: str) -> None:
    radii = RADII[kind]
    # a system may turn the axis of a plane or a cylinder over, from face to face
    other = (0.0, 0.0, -1.0) if kind in ("plane", "cylinder") else Z
    found = arrays(kind, [on(kind, half, radii) for half in HALVES], [Z, other], [radii, radii])
    merged, into = merge_faces(found)
    assert into.tolist() == [0, 0]
    assert merged["area_mm2"] == pytest.approx([4.0])
    assert merged["mean_mm"][0] == pytest.approx([1.0, 0, 0])
    assert merged["edge_faces"].tolist() == [[0, 0], [0, -1]]
    assert set(merged["face_of_triangle"].tolist()) == {0}
    assert merged["axis"][0] == pytest.approx(Z)


@pytest.mark.parametrize("kind", ["cylinder", "cone", "sphere", "torus"])
def test_a_step_of_two_micrometres_is_an_edge(kind: str) -> None:
    radii = RADII[kind]
    other = (radii[0] + 0.002, *radii[1:])
    pieces = [on(kind, half, r) for half, r in zip(HALVES, (radii, other), strict=True)]
    assert merge_faces(arrays(kind, pieces, [Z, Z], [radii, other]))[1].tolist() == [0, 1]


def test_planes_at_an_angle_and_free_forms_stay_apart() -> None:
    tilt = np.radians(0.3)
    pieces = [on("plane", half, RADII["plane"]) for half in HALVES]
    tilted = (np.sin(tilt), 0.0, np.cos(tilt))
    found = arrays("plane", pieces, [Z, tilted], [RADII["plane"]] * 2)
    assert merge_faces(found)[1].tolist() == [0, 1]
    assert merge_faces(found | {"kind": np.full(2, 5)})[1].tolist() == [0, 1]


def test_faces_of_one_surface_that_do_not_touch_stay_apart() -> None:
    radii = RADII["cylinder"]
    found = arrays("cylinder", [on("cylinder", h, radii) for h in HALVES], [Z, Z], [radii, radii])
    found["edge_faces"] = np.array([[0, 0], [1, 1]])
    assert merge_faces(found)[1].tolist() == [0, 1]


def test_the_distance_from_a_cone_is_square_to_it() -> None:
    found = arrays(
        "cone", [on("cone", h, RADII["cone"]) for h in HALVES], [Z, Z], [RADII["cone"]] * 2
    )
    point = PLACE + np.array([[5.0 + 1.0, 0.0, 0.0]])
    assert distance(found, 0, point) == pytest.approx([np.cos(0.4)])
