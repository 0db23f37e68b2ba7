"""Large parts and parts of many poses: what is bounded, and what is stated at the bound."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from cad_solids import box, prism, solid_of

from controller.cad import find_resting, make_solid
from controller.cad.boundary import search_faces
from controller.cad.compiled.part import CompileOptions, compile_solid
from controller.cad.graph import distinct
from controller.cad.large import drop_derived, spans
from controller.cad.resting import look_alikes, search_look_alikes


@pytest.mark.parametrize("shape", [(0,), (1,), (1000,), (40, 3)])
def test_distinct_values_are_those_of_a_set_in_rising_order(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(5).integers(-20, 20, shape)
    assert distinct(values).tolist() == sorted(set(values.ravel().tolist()))


def test_a_search_that_is_cut_short_has_all_pairs_of_the_likeliest_poses() -> None:
    solid = solid_of(box(40, 30, 20))
    poses = find_resting(solid).poses
    every = {(pair.pose, pair.other) for pair in look_alikes(solid, poses)}
    assert len(every) == 3  # each side of a box looks as the opposite one
    # opposite sides are of equal size and all others are not: one comparison for each pair
    for allowed, pose_count in ((0, 1), (1, 3), (2, 5), (3, 6)):
        found = search_look_alikes(solid, poses, max_compared=allowed)
        assert found.pose_count == pose_count
        assert {(p.pose, p.other) for p in found.pairs} == {
            pair for pair in every if max(pair) < pose_count
        }


def test_a_part_states_which_look_alikes_were_not_worked_out() -> None:
    solid = solid_of(box(40, 30, 20))
    assert not compile_solid(solid).warnings
    options = CompileOptions(max_compared=1)
    part = compile_solid(solid, options, warnings=("The file lacks a date.",))
    first, second = part.warnings
    assert first == "The file lacks a date."
    assert "not worked out beyond the 3 likeliest of 6" in second
    assert second in part.cautions


def bumpy_plate(cells: int, side_mm: float) -> trimesh.Trimesh:
    """A plate of ``side_mm`` with a free-form top: waves of some microns a facet."""
    across = np.linspace(-side_mm / 2, side_mm / 2, cells + 1)
    x, y = (part.ravel() for part in np.meshgrid(across, across, indexing="ij"))
    z = 5 + 0.05 * np.sin(0.9 * x + 0.3) * np.cos(0.7 * y) + 0.04 * np.cos(0.5 * x * y / side_mm)
    count = cells + 1
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (
        part.ravel()
        for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:])
    )
    top = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    rim = np.concatenate([corner[:-1, 0], corner[-1, :-1], corner[:0:-1, -1], corner[0, :0:-1]])
    below, middle = count * count + np.arange(len(rim)), count * count + len(rim)
    after = np.roll(np.arange(len(rim)), -1)
    sides = np.concatenate(
        [
            np.column_stack([rim[after], rim, below]),
            np.column_stack([rim[after], below, below[after]]),
            np.column_stack([below[after], below, np.full(len(rim), middle)]),
        ]
    )
    ground = np.column_stack([x[rim], y[rim], np.zeros(len(rim))])
    vertices = np.concatenate([np.column_stack([x, y, z]), ground, [[0.0, 0.0, 0.0]]])
    return trimesh.Trimesh(vertices, np.concatenate([top, sides]), process=False)


@pytest.mark.parametrize("cells", [48, 96])
def test_a_free_surface_stays_one_however_finely_it_is_divided(cells: int) -> None:
    # some neighbours lie within 0.2 um of a plane that only touches the surface, the more the finer
    mesh = bumpy_plate(cells, 8.0)
    solid = make_solid(mesh, "plate", "5eed" * 16, "plate")
    assert sorted(face.kind for face in solid.faces) == ["freeform"] + ["plane"] * 5
    (top,) = (face for face in solid.faces if face.kind == "freeform")
    assert np.count_nonzero(solid.face_of_triangle == top.id) == 2 * cells**2


def stadium() -> trimesh.Trimesh:
    """Two half rounds of radius 6 that run smoothly into the flats between them."""
    half = np.linspace(-np.pi / 2, np.pi / 2, 13)
    right = [(10 + 6 * np.cos(a), 6 * np.sin(a)) for a in half]
    left = [(-10 - 6 * np.cos(a), -6 * np.sin(a)) for a in half]
    return solid_of(prism([*right, *left], 8)).mesh


def test_a_search_for_surfaces_without_a_try_left_says_that_it_is_not_complete() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=20.0)
    ball.vertices *= [1.0, 0.8, 0.6]  # smooth and of no formula: only tries could tell
    found, cut = search_faces(ball), search_faces(ball, max_seeds=0)
    assert found.is_complete
    assert not cut.is_complete
    for search in (found, cut):
        areas = np.bincount(search.face_of_triangle, weights=ball.area_faces)
        assert areas == pytest.approx([face.area_mm2 for face in search.faces])
    # what needs no try is found without one
    plain = search_faces(stadium(), max_seeds=0)
    kinds = sorted(face.kind for face in plain.faces)
    assert kinds == ["cylinder"] * 2 + ["plane"] * 4


def test_poses_beyond_the_budget_are_left_out_and_counted() -> None:
    solid = solid_of(box(40, 30, 20))
    assert len(solid.mesh.faces) == 12
    whole = compile_solid(solid)
    part = compile_solid(solid, CompileOptions(max_drawn_triangles=2 * 12 + 11))
    assert [pose.probability for pose in part.poses] == [
        pose.probability for pose in whole.poses[:2]
    ]
    assert len(part.views) == 2
    assert set(part.resting.facet_pose.tolist()) == {0, 1, -1}
    (stated,) = part.warnings
    share = 100 * sum(pose.probability for pose in whole.poses[:2])
    assert f"Of 6 stable poses the 2 likeliest are worked out, {share:.0f} % of all" in stated
    # a part has one at least
    assert len(compile_solid(solid, CompileOptions(max_drawn_triangles=0)).poses) == 1


def test_stages_are_announced_in_their_order() -> None:
    heard: list[str] = []
    compile_solid(solid_of(box(40, 30, 20)), on_stage=heard.append)
    assert heard.index("finding stable poses") < heard.index("drawing stable pose 1 of 6")
    assert [stage for stage in heard if stage.startswith("drawing")] == [
        f"drawing stable pose {number} of 6" for number in range(1, 7)
    ]


@pytest.mark.parametrize(("count", "at_once"), [(0, 4), (3, 4), (4, 4), (9, 4), (12, 4)])
def test_spans_take_every_row_once_and_in_order(count: int, at_once: int) -> None:
    rows = np.arange(count)
    taken = [rows[some] for some in spans(count, at_once)]
    assert all(0 < len(some) <= at_once for some in taken)
    assert np.concatenate([[], *taken]).tolist() == rows.tolist()


def test_what_is_forgotten_of_a_mesh_comes_back_the_same_and_normals_stay() -> None:
    mesh = stadium()
    normals, edges = mesh.face_normals, np.array(mesh.edges)
    assert mesh.triangles.shape == (len(mesh.faces), 3, 3)
    drop_derived(mesh, "edges")
    assert mesh.face_normals is normals
    assert "edges" in mesh._cache.cache
    assert "triangles" not in mesh._cache.cache
    drop_derived(mesh)
    assert "edges" not in mesh._cache.cache
    assert np.array_equal(mesh.edges, edges)
