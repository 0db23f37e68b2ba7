"""The doubly connected edge list: pointers, curves, creases, and counts known on paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, prism, rod, solid_of
from data_files import listed_parts, part_file

from controller.cad import load_solid
from controller.cad.boundary import (
    Boundary,
    Crease,
    Curve,
    check_boundary,
    euler_defect,
    face_genera,
    find_boundary,
    find_faces,
)
from controller.cad.boundary.edges.halfedges import components

PARTS = [part_file(part["stl"]) for part in listed_parts()]
LONG = ("nist_ftc06", "cycloidal_gear", "cycloidal_gear_mirror")  # half a second and more each


def tetrahedron() -> Body:
    return Body.hull_points([(0, 0, 0), (30, 0, 0), (0, 30, 0), (0, 0, 30)])


def ell() -> Body:
    return prism([(0, 0), (40, 0), (40, 10), (10, 10), (10, 30), (0, 30)], 20)


def frame() -> Body:
    """A picture frame: a square ring of square section."""
    return box(40, 40, 10) - box(20, 20, 30)


def counts(b: Boundary) -> tuple[int, int, int]:
    return len(b.vertex_ids), b.edge_count, len(b.first)


def boundary_of(body: Body) -> Boundary:
    mesh = mesh_of(body)
    return find_boundary(mesh, *find_faces(mesh))


def assert_right(b: Boundary, mesh: trimesh.Trimesh, of: np.ndarray, face_count: int) -> None:
    """Pointers fit, Euler-Poincare holds, loops and traversals visit each half-edge once."""
    assert check_boundary(b) == []
    genera = face_genera(mesh, of, face_count)
    assert (genera >= 0).all()
    assert euler_defect(b, genera) == 0
    walked = [h for loop in range(len(b.first)) for h in b.loop_edges(loop)]
    assert sorted(walked) == list(range(2 * b.edge_count))


@pytest.mark.parametrize(
    ("make", "faces", "expected", "shells", "genus"),
    [
        # vertices, edges, loops on paper
        (tetrahedron, 4, (4, 6, 4), 1, 0),
        (lambda: box(40, 30, 20), 6, (8, 12, 6), 1, 0),
        (ell, 8, (12, 18, 8), 1, 0),
        # a through bore: two circles, each with one vertex; two rings more in the planes, two on
        # the wall
        (lambda: box(40, 30, 20) - rod(5, 30), 7, (10, 14, 10), 1, 1),
        # a blind bore: wall and bottom more
        (lambda: box(40, 30, 20) - rod(5, 20).translate((0, 0, 10)), 8, (10, 14, 10), 1, 0),
        (frame, 10, (16, 24, 12), 1, 1),
        (lambda: box(40, 30, 20) - box(10, 10, 10), 12, (16, 24, 12), 2, 0),
        (lambda: rod(10, 30), 3, (2, 2, 4), 1, 0),
        (lambda: rod(10, 30) - rod(5, 40), 4, (4, 4, 8), 1, 1),
        (lambda: Body.sphere(15, 32), 1, (0, 0, 0), 1, 0),
        (lambda: Body.sphere(15, 32) - Body.sphere(8, 32), 2, (0, 0, 0), 2, 0),
    ],
    ids=[
        "tetrahedron", "box", "L", "bored box", "blind bore", "frame", "box with a void", "rod",
        "tube", "ball", "hollow ball",
    ],
)  # fmt: skip
def test_vertices_edges_loops_shells_and_handles_are_those_on_paper(
    make: Callable[[], Body], faces: int, expected: tuple[int, int, int], shells: int, genus: int
) -> None:
    mesh = mesh_of(make())
    found, of = find_faces(mesh)
    b = find_boundary(mesh, found, of)
    assert_right(b, mesh, of, len(found))
    assert len(found) == faces
    assert counts(b) == expected
    assert (b.shell_count, b.genus) == (shells, genus)


def test_a_whole_torus_is_a_surface_with_a_handle_of_its_own() -> None:
    mesh = trimesh.creation.torus(20, 5, major_sections=48, minor_sections=32)
    one = np.zeros(len(mesh.faces), dtype=np.int32)
    faces, _ = find_faces(mesh)
    b = find_boundary(mesh, faces[:1], one)
    assert (b.shell_count, b.genus, b.edge_count) == (1, 1, 0)
    assert face_genera(mesh, one, 1).tolist() == [1]
    assert euler_defect(b, [1]) == 0
    assert euler_defect(b, [0]) != 0


def test_two_blocks_that_touch_in_a_corner_keep_their_vertices_apart() -> None:
    a, b = mesh_of(box(2, 2, 2)), mesh_of(box(2, 2, 2))
    b.apply_translation((2, 2, 2))
    mesh = trimesh.util.concatenate([a, b])
    mesh.merge_vertices()
    assert len(mesh.vertices) == 15
    faces, of = find_faces(mesh)
    found = find_boundary(mesh, faces, of)
    assert counts(found) == (16, 24, 12)
    assert (found.shell_count, found.genus) == (2, 0)
    assert check_boundary(found) == []
    assert euler_defect(found, face_genera(mesh, of, len(faces))) == 0


def test_loops_run_anticlockwise_round_faces_and_clockwise_round_holes() -> None:
    solid = solid_of(box(40, 30, 20) - rod(5, 30))
    b = solid.boundary
    for loop in range(len(b.first)):
        face = solid.faces[b.loop_face[loop]]
        if face.kind != "plane":
            continue
        swept = np.zeros(3)
        for h in b.loop_edges(loop):
            run = solid.mesh.vertices[b.chain_of(h // 2)]
            run = run if h % 2 == 0 else run[::-1]
            swept += sum(np.cross(p, q) for p, q in pairwise(run))
        assert (swept @ face.normal > 0) == (not b.is_hole[loop])
    assert int(b.is_hole.sum()) == 3  # in both planes, and one end of the wall


def test_the_edges_round_a_corner_of_a_box_are_three_and_leave_it() -> None:
    b = solid_of(box(40, 30, 20)).boundary
    for h in range(24):
        star = [h]  # once round the vertex: before the edge, and over to its twin
        while (here := int(b.prev[star[-1]]) ^ 1) != h:
            star.append(here)
        assert len(star) == len(set(star)) == 3
        assert {int(b.origin[x]) for x in star} == {int(b.origin[h])}
        assert len({int(b.face[x]) for x in star}) == 3


def test_a_bores_two_circles_know_centre_axis_and_radius() -> None:
    body = box(40, 30, 20) - rod(5, 30, 48).translate((3, -2, 0))
    turn, shift = (20.0, 30.0, 40.0), (7.0, 8.0, 9.0)
    solid = solid_of(body.rotate(turn).translate(shift))
    b = solid.boundary
    circles = np.nonzero(b.curve == Curve.CIRCLE)[0]
    assert len(circles) == 2
    assert np.isnan(b.radius_mm[b.curve == Curve.LINE]).all()
    assert b.radius_mm[circles] == pytest.approx([5, 5], abs=1e-3)
    # where manifold itself puts the two centres
    R = trimesh.transformations.euler_matrix(*np.radians(turn), axes="sxyz")[:3, :3]
    ends = [R @ np.array([3, -2, z]) + shift for z in (-10, 10)]
    for end in ends:
        assert np.linalg.norm(b.centre_mm[circles] - end, axis=1).min() < 1e-3
    assert np.abs(b.axis[circles] @ R[:, 2]) == pytest.approx([1, 1], abs=1e-6)


def test_a_fillets_short_arcs_are_circles_and_its_long_edges_smooth_lines() -> None:
    turns = np.linspace(np.pi / 2, 0, 9)
    arc = [(34 + 6 * np.sin(a), 14 + 6 * np.cos(a)) for a in turns]
    b = solid_of(prism([(0, 0), (40, 0), *arc, (0, 20)], 50)).boundary
    circles = b.curve == Curve.CIRCLE
    assert b.radius_mm[circles] == pytest.approx([6, 6], abs=1e-3)
    assert b.crease[circles].tolist() == [Crease.CONVEX] * 2
    smooth = b.crease == Crease.SMOOTH
    assert int(smooth.sum()) == 2
    assert (b.curve[smooth] == Curve.LINE).all()
    assert (b.angle_rad[smooth] == 0).all()


def test_an_oblique_cut_through_a_rod_is_neither_line_nor_circle() -> None:
    cut = rod(10, 60, 64).trim_by_plane((0.5, 0, 1), -5)
    b = solid_of(cut).boundary
    assert sorted(b.curve) == [Curve.CIRCLE, Curve.OTHER]


def test_creases_and_their_angles_are_those_of_the_profile() -> None:
    # a trapezium with 60 degrees at its foot, and an L with one inner corner
    rise = 10 * np.sqrt(3)
    b = solid_of(prism([(0, 0), (60, 0), (50, rise), (10, rise)], 25)).boundary
    assert (b.crease == Crease.CONVEX).all()
    turned = np.sort(np.degrees(b.angle_rad))
    assert turned == pytest.approx([60, 60] + [90] * 8 + [120] * 2)
    b = solid_of(ell()).boundary
    assert np.bincount(b.crease).tolist() == [17, 1]
    (inner,) = np.nonzero(b.crease == Crease.CONCAVE)[0]
    assert b.vertices_mm[b.origin[2 * inner]][:2] == pytest.approx([10, 10])
    assert b.angle_rad[inner] == pytest.approx(np.pi / 2)


def test_the_sides_of_a_void_are_concave() -> None:
    b = boundary_of(box(40, 30, 20) - box(10, 10, 10))
    assert np.bincount(b.crease).tolist() == [12, 12]


@pytest.mark.parametrize(
    ("field", "sentence"),
    [
        ("next", "inverse"),
        ("prev", "inverse"),
        ("origin", "start where"),
        ("face", "same face|different faces"),
        ("loop", "different loops"),
        ("chain", "vertex to vertex"),
    ],
)
def test_a_pointer_bent_at_random_is_noticed(field: str, sentence: str) -> None:
    b = solid_of(box(40, 30, 20) - rod(5, 30)).boundary
    rng = np.random.default_rng(3)
    for _ in range(20):
        bent = getattr(b, field).copy()
        at = int(rng.integers(len(bent))) if field != "chain" else int(b.chain_start[3])
        bent[at] = (bent[at] + 1 + rng.integers(bent.max())) % (bent.max() + 1)
        faults = check_boundary(replace(b, **{field: bent}))
        assert faults
    assert check_boundary(b) == []


def test_euler_poincare_notices_a_missing_handle_and_a_missing_hole() -> None:
    solid = solid_of(box(40, 30, 20) - rod(5, 30))
    b = solid.boundary
    assert euler_defect(replace(b, genus=0), [0] * 7) == -2
    assert euler_defect(replace(b, loop_face=b.loop_face[:-1]), [0] * 7) == 1
    assert euler_defect(replace(b, shell_count=2), [0] * 7) == -2


def test_an_open_mesh_has_no_boundary() -> None:
    mesh = mesh_of(box(40, 30, 20))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    faces, of = find_faces(mesh)
    with pytest.raises(ValueError, match="not closed"):
        find_boundary(mesh, faces, of)


@pytest.mark.parametrize("kept", [0.1, 0.4, 0.6, 0.8])
def test_any_parting_of_a_mesh_into_surfaces_gives_a_right_boundary(kept: float) -> None:
    """Not only sensible surfaces: triangles joined at random make pinched and many-ringed ones."""
    mesh = mesh_of(box(40, 40, 10) - rod(6, 30, 12) - box(4, 50, 4))
    rng = np.random.default_rng(11)
    (face, *_), _ = find_faces(mesh)
    for _ in range(5):
        joins = mesh.face_adjacency[rng.random(len(mesh.face_adjacency)) < kept]
        of = components(len(mesh.faces), joins[:, 0], joins[:, 1])
        some = tuple(replace(face, id=i, kind="freeform") for i in range(int(of.max()) + 1))
        b = find_boundary(mesh, some, of)
        assert check_boundary(b) == []
        genera = face_genera(mesh, of, len(some))
        assert (genera >= 0).all()
        assert euler_defect(b, genera) == 0


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] if p.stem in LONG else []) for p in PARTS],
)
def test_the_parts_from_outside_have_right_boundaries(path: Path) -> None:
    solid = load_solid(path)
    assert_right(solid.boundary, solid.mesh, solid.face_of_triangle, len(solid.faces))
