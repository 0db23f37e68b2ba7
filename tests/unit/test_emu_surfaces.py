"""Machined surfaces in emulated pictures: marks by seed, and light from wall to wall."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from controller.cell.devices.emulator import emulator_args
from emulators.app import build_parser, options_of
from emulators.world import Layout, Solid, build_scene, part_surface, read_layout
from emulators.world.pictures.geometry import Surface, corner_normals
from emulators.world.pictures.machined.bounce import Nodes
from emulators.world.pictures.machined.faces import machined_faces
from emulators.world.pictures.picture import Eye

Array = NDArray[np.float64]

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"
BACKLIGHT, RING, SIDE = 0, 1, 2  # the order of the lamps in the cell file
BLOCK_MM = (60.0, 40.0, 20.0)
WIDTH_PX, HEIGHT_PX = 320, 256
PX_PER_MM = 3571.0 / 1230.0  # at the height of the block's upper face
ALBEDO = 0.60  # of the material of parts


@pytest.fixture(scope="module")
def layout() -> Layout:
    """Return the cell with an overhead camera that sees a part and little else, undistorted."""
    layout = read_layout(CELL)
    camera = replace(
        layout.cameras["overhead"],
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        centre_px=((WIDTH_PX - 1) / 2.0, (HEIGHT_PX - 1) / 2.0),
        distortion=np.zeros(5),
    )
    return replace(layout, cameras={**layout.cameras, "overhead": camera})


def shape(mesh: trimesh.Trimesh, name: str) -> Solid:
    """Return a part as pictures know it: its triangles alone count."""
    vertices = np.array(mesh.vertices, dtype=float)
    return Solid(
        name=name,
        vertices_mm=vertices,
        faces=np.array(mesh.faces, dtype=np.int32),
        hull_mm=vertices,
        mass_kg=1.0,
        centre_mm=np.zeros(3),
        T_part_body=np.eye(4),
        inertia_kg_m2=np.ones(3),
        pieces_path=Path(),
        rests=(),
    )


@pytest.fixture(scope="module")
def solids() -> dict[str, Solid]:
    block = trimesh.creation.box(BLOCK_MM)
    pocket = trimesh.creation.box((40.0, 24.0, 12.0))
    pocket.apply_translation((0.0, 0.0, 6.0))
    hollow = trimesh.boolean.difference([block, pocket], engine="manifold")
    return {"block": shape(block, "block"), "pocket": shape(hollow, "pocket")}


def on_table(x_mm: float = 360.0, y_mm: float = 0.0) -> Array:
    T = np.eye(4)
    T[:3, 3] = x_mm, y_mm, BLOCK_MM[2] / 2.0
    return T


class Pictures:
    """Takes pictures of a part; an eye serves for all pictures of one part and seed."""

    def __init__(self, layout: Layout, solids: dict[str, Solid]) -> None:
        self._layout, self._solids = layout, solids
        self._eyes: dict[tuple[str, int | None], Eye] = {}

    def take(self, part: str, lamp: int, seed: int | None, y_mm: float = 0.0) -> Array:
        key = (part, seed)
        if key not in self._eyes:
            self._eyes[key] = Eye(build_scene(self._layout, [self._solids[part]], seed), 0)
        return self._eyes[key].picture({"part 0": on_table(y_mm=y_mm)}, {lamp: 1.0}).astype(float)


@pytest.fixture(scope="module")
def pictures(layout: Layout, solids: dict[str, Solid]) -> Pictures:
    return Pictures(layout, solids)


def top_of_block(image: Array) -> Array:
    """Return the pixels well within the block's upper face, which is about in the middle."""
    # 2.9 px/mm; the block's 60 mm are along the world's x, which is up in the picture
    v, u = HEIGHT_PX // 2, WIDTH_PX // 2
    return image[v - 75 : v + 75, u - 45 : u + 45]


def test_plain_is_the_default_and_as_built_cells_have_machined_parts() -> None:
    def seed(*words: str) -> int | None:
        given = ["--cell", str(CELL), "--seed", "4", *words]
        return options_of(build_parser().parse_args(given)).finish_seed

    assert seed() is None
    assert seed("--surfaces", "machined") == 4
    assert seed("--as-built", "9") == 9
    assert seed("--as-built", "9", "--surfaces", "plain") is None
    assert seed(*emulator_args(None, None, None, None, "machined")) == 4


def test_plain_pictures_load_no_scipy() -> None:
    code = "import sys, emulators.world.pictures.worker; print('scipy' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=CELL.parents[2], capture_output=True, check=True
    )
    assert done.stdout.split() == [b"False"]


def test_marks_are_drawn_from_the_seed(pictures: Pictures) -> None:
    plain = top_of_block(pictures.take("block", SIDE, None))
    once, again, other = (pictures.take("block", SIDE, seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(once, again)
    # the lamp's own light, which is the same under all marks, taken off
    marks = [(top_of_block(one) / plain).ravel() for one in (once, other)]
    assert np.corrcoef(*marks)[0, 1] < 0.5


def test_marks_change_nothing_but_the_part(pictures: Pictures) -> None:
    plain, machined = (pictures.take("block", SIDE, seed) for seed in (None, 5))
    differs = plain != machined
    rows, columns = np.nonzero(differs)
    # the block's outline, 60 x 40 mm at a height of 20 mm
    assert np.abs(rows - (HEIGHT_PX - 1) / 2.0).max() <= 30.0 * PX_PER_MM + 0.5
    assert np.abs(columns - (WIDTH_PX - 1) / 2.0).max() <= 20.0 * PX_PER_MM + 0.5
    assert top_of_block(differs.astype(float)).mean() > 0.9


def test_before_a_backlight_a_machined_part_is_as_dark_as_a_plain_one(pictures: Pictures) -> None:
    plain, machined = (pictures.take("pocket", BACKLIGHT, seed) for seed in (None, 5))
    np.testing.assert_array_equal(machined, plain)


@pytest.mark.parametrize("lamp", [RING, SIDE])
def test_marks_leave_a_faces_mean_light_as_it_is(pictures: Pictures, lamp: int) -> None:
    plain, machined = (top_of_block(pictures.take("block", lamp, seed)) for seed in (None, 5))
    assert machined.mean() == pytest.approx(plain.mean(), rel=0.08)
    assert (machined / plain).std() > 0.01  # and yet they are there


def test_marks_go_with_the_part(pictures: Pictures) -> None:
    step_px = 40
    step_mm = step_px / PX_PER_MM

    def marks(y_mm: float) -> Array:
        plain, machined = (pictures.take("block", SIDE, seed, y_mm) for seed in (None, 5))
        return np.where(plain > 0.01, machined / np.maximum(plain, 0.01), 1.0)

    here = marks(0.0)
    there = marks(-step_mm)  # to the picture's right, conventions.md
    moved = np.roll(there, -step_px, axis=1)

    def alike(one: Array, other: Array) -> float:
        return float(np.corrcoef(top_of_block(one).ravel(), top_of_block(other).ravel())[0, 1])

    assert alike(here, moved) > 0.6
    assert alike(here, np.roll(moved, 25, axis=0)) < 0.3


def test_a_length_on_a_turned_face_is_the_same_all_round() -> None:
    radius_mm, length_mm, count = 20.0, 30.0, 180
    mesh = trimesh.creation.cylinder(radius_mm, length_mm, sections=count)
    mesh.apply_translation((7.0, -4.0, 2.0))
    surface = part_surface("part 0", shape(mesh, "pin"))
    faces = machined_faces(surface, np.random.default_rng(1))
    corners = surface.vertices_mm[surface.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    (wall,) = set(faces.of_triangle[np.abs(normals[:, 2]) < 1e-6].tolist())
    angle = np.radians(np.arange(0.0, 360.0, 2.0))
    round_it = np.column_stack([
        7.0 + radius_mm * np.cos(angle), -4.0 + radius_mm * np.sin(angle), np.full(len(angle), 3.0)
    ])  # fmt: skip
    which = np.full(len(angle), wall)
    across_mm, along_mm = faces.places_mm(which, round_it)
    np.testing.assert_allclose(np.ptp(across_mm), 0.0, atol=1e-6)
    steps = np.abs(np.diff(along_mm))
    # an arc of two degrees, but where the way round begins again
    arc_mm = radius_mm * np.radians(2.0)
    assert (np.abs(steps - arc_mm) < 0.01 * arc_mm).sum() >= len(steps) - 1
    up = round_it + np.array([0.0, 0.0, 5.0])
    np.testing.assert_allclose(np.abs(faces.places_mm(which, up)[0] - across_mm), 5.0, atol=1e-6)


def quad(corners: list[tuple[float, float, float]]) -> Surface:
    vertices = np.array(corners, dtype=float)
    faces = np.array(
        [(4 * i + a, 4 * i + b, 4 * i + c) for i in range(len(corners) // 4)
         for a, b, c in ((0, 1, 2), (0, 2, 3))], dtype=np.int32
    )  # fmt: skip
    normals = corner_normals(vertices, faces, smooth=False)
    zeros = np.zeros(len(faces), np.int16)
    return Surface("corner", vertices, faces, normals, zeros, zeros - 1)


def test_what_a_floor_sees_of_a_wall_is_the_form_factor_of_long_strips() -> None:
    height = 20.0
    floor = [(0, -150, 0), (60, -150, 0), (60, 150, 0), (0, 150, 0)]
    wall = [(0, -150, 0), (0, 150, 0), (0, 150, height), (0, -150, height)]
    nodes = Nodes(quad([*floor, *wall]))  # type: ignore[list-item]  # ints are floats
    x, y, z = nodes.points_mm.T
    chosen = (z == 0.0) & (np.abs(y) < 60.0) & (x > 2.0)
    assert chosen.sum() > 50
    seen = np.asarray(nodes.seen.sum(axis=1)).ravel()[chosen]
    # of a point beside a long wall: half of 1 less the cosine to its upper edge
    expected = 0.5 * (1.0 - x[chosen] / np.hypot(x[chosen], height))
    np.testing.assert_allclose(seen, expected, atol=0.03)
    assert np.abs((seen - expected).mean()) < 0.01


def test_a_convex_part_throws_no_light_on_itself(solids: dict[str, Solid]) -> None:
    assert not Nodes(part_surface("part 0", solids["block"])).is_concave
    assert Nodes(part_surface("part 0", solids["pocket"])).is_concave


def test_places_between_nodes_are_weighted_so_that_a_linear_field_comes_back(
    solids: dict[str, Solid],
) -> None:
    surface = part_surface("part 0", solids["pocket"])
    nodes = Nodes(surface)
    rng = np.random.default_rng(2)
    triangle = rng.integers(0, len(surface.faces), 500)
    u, v = rng.dirichlet((1.0, 1.0, 1.0), 500)[:, :2].T
    number, weight = nodes.weights(triangle, u.astype(np.float32), v.astype(np.float32))
    found = np.einsum("nkj,nk->nj", nodes.points_mm[number], weight)
    corners = surface.vertices_mm[surface.faces[triangle]]
    expected = np.einsum("nk,nkj->nj", np.stack((1.0 - u - v, u, v), axis=1), corners)
    # nodes stand 3 % of the way to the triangle's middle, 40 mm off at most
    np.testing.assert_allclose(found, expected, atol=0.03 * 40.0)
    assert np.median(np.linalg.norm(found - expected, axis=1)) < 0.5


def test_a_shaded_pocket_gets_light_from_its_lit_wall(pictures: Pictures) -> None:
    plain, machined = (pictures.take("pocket", SIDE, seed) for seed in (None, 5))
    floor_px = np.zeros(plain.shape, bool)
    v, u = HEIGHT_PX // 2, WIDTH_PX // 2
    floor_px[v - 50 : v + 50, u - 28 : u + 28] = True  # of the floor of 40 x 24 mm
    shaded = floor_px & (plain < 0.003)
    assert shaded.sum() > 300
    assert np.median(machined[shaded]) > 0.01
    # a wall gives back its albedo of what falls on it, and a floor cannot see more than all of it
    assert machined[shaded].max() < ALBEDO * plain.max()


def test_facets_of_a_bore_are_one_face_and_planes_are_faces_of_their_own() -> None:
    ring = trimesh.creation.annulus(10.0, 25.0, 8.0, sections=64)
    vertices, faces = np.asarray(ring.vertices), np.asarray(ring.faces, dtype=np.int32)
    zeros = np.zeros(len(faces), np.int16)
    normals = corner_normals(vertices, faces, smooth=True)
    surface = Surface("ring", vertices, faces, normals, zeros, zeros - 1)
    found = machined_faces(surface, np.random.default_rng(1))
    assert found.of_triangle.max() + 1 == 4  # two ends, the bore, the outside
    flat = np.asarray(ring.face_normals)
    for face in range(4):
        upright = np.abs(flat[found.of_triangle == face][:, 2]).max() > 0.9
        across = np.abs(found.across[face])
        # a turned face has its marks side by side along the axis, a milled one in its plane
        assert across[2] == pytest.approx(0.0 if upright else 1.0, abs=1e-6)
