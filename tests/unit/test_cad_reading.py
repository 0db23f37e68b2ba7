"""What a CAD file is read as: its unit, its size, its soundness; each refusal by its own name."""

from __future__ import annotations

import os
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, rod
from data_files import listed_parts, part_file

from controller.cad import (
    CadError,
    CoordinatesCadError,
    InsideOutCadError,
    LargeCadError,
    ManySolidsCadError,
    OpenCadError,
    SelfIntersectingCadError,
    UnitCadError,
    UnreadableCadError,
    load_solid,
    make_solid,
)
from controller.cad.soundness import check_soundness, touch_of
from controller.cad.welding import weld


def block(x: float = 10.0, y: float = 20.0, z: float = 30.0) -> trimesh.Trimesh:
    return trimesh.creation.box((x, y, z))


def save(folder: Path, mesh: trimesh.Trimesh, name: str = "part.stl") -> Path:
    path = folder / name
    mesh.export(path)
    return path


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.util.concatenate(list(meshes))


def solid_from(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return make_solid(mesh, "part", "5eed" * 16, where="part").mesh


def refused(mesh: trimesh.Trimesh, kind: type[CadError]) -> str:
    with pytest.raises(kind) as caught:
        solid_from(mesh)
    assert type(caught.value) is kind
    return str(caught.value)


# units


@pytest.mark.parametrize(
    ("unit", "mm", "name"),
    [
        ("mm", 1, "mm"),
        ("cm", 10, "cm"),
        ("m", 1000, "m"),
        ("inch", 25.4, "inch"),
        ("in", 25.4, "inch"),
    ],
)
def test_a_declared_unit_is_believed(tmp_path: Path, unit: str, mm: float, name: str) -> None:
    path = save(tmp_path, block(*np.array([10.0, 20.0, 30.0]) / mm))
    solid = load_solid(path, unit=unit)
    assert solid.mesh.extents == pytest.approx([10, 20, 30], rel=1e-6)
    assert solid.volume_mm3 == pytest.approx(6000, rel=1e-6)
    assert (solid.unit, solid.unit_is_declared) == (name, True)


def test_millimetres_are_assumed_and_said_so(tmp_path: Path) -> None:
    solid = load_solid(save(tmp_path, block()))
    assert (solid.unit, solid.unit_is_declared) == ("mm", False)


def test_a_part_that_looks_like_inches_is_asked_for_its_unit(tmp_path: Path) -> None:
    path = save(tmp_path, block(1.0, 2.0, 3.0))
    with pytest.raises(UnitCadError) as caught:
        load_solid(path)
    message = str(caught.value)
    assert "1 x 2 x 3 mm in millimetres" in message
    assert "25.4 x 50.8 x 76.2 mm if these were inches" in message
    assert "1000 x 2000 x 3000 mm if they were metres" in message
    assert "--unit" in message
    assert "unit:" in message
    assert load_solid(path, unit="mm").volume_mm3 == pytest.approx(6)


@pytest.mark.parametrize(
    ("longest_mm", "is_read"), [(9.9, False), (10.1, True), (1999, True), (2001, False)]
)
def test_an_undeclared_size_makes_sense_from_10_mm_to_2_m(
    tmp_path: Path, longest_mm: float, is_read: bool
) -> None:
    path = save(tmp_path, block(longest_mm, longest_mm / 2, longest_mm / 3))
    if is_read:
        assert load_solid(path).mesh.extents.max() == pytest.approx(longest_mm)
    else:
        with pytest.raises(UnitCadError, match="names no unit"):
            load_solid(path)
        assert load_solid(path, unit="mm").unit_is_declared


def test_no_jaw_holds_a_part_of_half_a_millimetre_whatever_is_declared(tmp_path: Path) -> None:
    with pytest.raises(UnitCadError, match="no jaw holds it"):
        load_solid(save(tmp_path, block(0.5, 0.3, 0.2)), unit="mm")


def test_an_unknown_unit_is_told_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(UnitCadError, match="'furlong' is not known; declare one of mm, cm"):
        load_solid(save(tmp_path, block()), unit="furlong")


@pytest.mark.parametrize(
    ("unit", "name", "mm"),
    [
        ("millimeter", "mm", 1),
        ("inch", "inch", 25.4),
        ("micron", "micron", 1e-3),
        ("meter", "m", 1e3),
    ],
)
def test_a_3mf_file_says_its_unit(tmp_path: Path, unit: str, name: str, mm: float) -> None:

    path = save(tmp_path, block(*np.array([10.0, 20.0, 30.0]) / mm), "part.3mf")
    with zipfile.ZipFile(path) as package:
        files = {entry: package.read(entry) for entry in package.namelist()}
    model = next(entry for entry in files if entry.endswith(".model"))
    assert b'unit="millimeter"' in files[model]
    files[model] = files[model].replace(b'unit="millimeter"', f'unit="{unit}"'.encode())
    with zipfile.ZipFile(path, "w") as package:
        for entry, data in files.items():
            package.writestr(entry, data)
    solid = load_solid(path)
    assert solid.mesh.extents == pytest.approx([10, 20, 30], rel=1e-6)
    assert (solid.unit, solid.unit_is_declared) == (name, True)
    with pytest.raises(UnitCadError, match=f"is in {name} by its own statement, not in cm"):
        load_solid(path, unit="cm")


# size and coordinates


def test_two_million_triangles_and_more_are_refused_from_the_size_alone(tmp_path: Path) -> None:
    path = tmp_path / "large.stl"
    count = 2_000_001
    with path.open("wb") as file:
        file.write(b"\0" * 80 + struct.pack("<I", count))
        os.truncate(path, 84 + 50 * count)  # sparse: nothing of it is on the disk
    with pytest.raises(LargeCadError, match="2,000,001 triangles, the most is 2,000,000"):
        load_solid(path)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 9\nelement face 3000000\nend_header\n"),
        ("a.off", b"OFF\n9 3000000 0\n"),
    ],
)
def test_a_header_that_promises_more_than_the_bytes_hold_is_unreadable(
    tmp_path: Path, name: str, data: bytes
) -> None:
    path = tmp_path / name
    path.write_bytes(data + b"0 0 0\n" * 20)
    with pytest.raises(UnreadableCadError, match="promises 3,000,000 triangles"):
        load_solid(path)


@pytest.mark.parametrize("ending", ["stl", "obj"])
def test_a_text_of_too_many_triangles_is_refused_before_it_is_parsed(
    tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_bytes(
        {"stl": b"solid\n" + b"endfacet\n" * 2_000_001, "obj": b"\nf 1 2 3" * 2_000_001}[ending]
    )
    with pytest.raises(LargeCadError, match="the most is 2,000,000"):
        load_solid(path)


@pytest.mark.parametrize("value", [1e30, -3e38, 5e8])
def test_a_coordinate_beyond_sense_is_told(value: float) -> None:
    mesh = block()
    mesh.vertices[3, 1] = value
    assert "beyond sense" in refused(mesh, CoordinatesCadError)


def test_a_part_far_from_its_origin_is_told_to_be_moved() -> None:
    mesh = block()
    mesh.apply_translation((2e5, 0, 0))
    assert "reaches 200 m from its origin" in refused(mesh, CoordinatesCadError)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "pipe.stl"
    os.mkfifo(path)
    with pytest.raises(UnreadableCadError, match="not a regular file"):
        load_solid(path)


# shells


def hollow(outer: trimesh.Trimesh, *voids: trimesh.Trimesh) -> trimesh.Trimesh:
    turned = [v.copy() for v in voids]
    for void in turned:
        void.invert()
    return joined(outer, *turned)


def moved(mesh: trimesh.Trimesh, *by: float) -> trimesh.Trimesh:
    out = mesh.copy()
    out.apply_translation(by)
    return out


def test_a_hollow_part_is_one_solid() -> None:
    mesh = solid_from(hollow(block(30, 30, 30), block(10, 10, 10)))
    assert mesh.volume == pytest.approx(27_000 - 1000)


def test_many_voids_are_one_solid_too() -> None:
    small = [moved(block(2, 2, 2), x, y, 0) for x in range(-12, 13, 6) for y in range(-12, 13, 6)]
    assert solid_from(hollow(block(30, 30, 30), *small)).volume == pytest.approx(27_000 - 25 * 8)


def test_a_void_beside_the_body_is_refused() -> None:
    mesh = hollow(block(30, 30, 30), moved(block(10, 10, 10), 40, 0, 0))
    assert "1 of its 2 shells are turned inwards" in refused(mesh, ManySolidsCadError)


def test_a_void_within_a_void_is_refused() -> None:
    # from the inner one's wall the body is round it once and the outer void once less; from the
    # outer one's wall only the body is round it
    mesh = hollow(block(30, 30, 30), block(20, 20, 20), block(10, 10, 10))
    assert "1 of its 3 shells are turned inwards" in refused(mesh, ManySolidsCadError)


def test_a_body_loose_in_a_void_is_a_second_body() -> None:
    mesh = joined(hollow(block(30, 30, 30), block(20, 20, 20)), block(10, 10, 10))
    assert "2 separate bodies" in refused(mesh, ManySolidsCadError)


def test_a_void_that_breaks_through_the_wall_is_a_self_intersection() -> None:
    mesh = hollow(block(30, 30, 30), moved(block(10, 10, 10), 12, 0, 0))
    assert "runs through itself near" in refused(mesh, SelfIntersectingCadError)


def test_a_hollow_part_inside_out_is_told_to_flip() -> None:
    mesh = hollow(block(30, 30, 30), block(10, 10, 10))
    mesh.invert()
    assert "volume -26000.0 mm3); flip its normals" in refused(mesh, InsideOutCadError)


def test_a_sheet_with_two_sides_encloses_nothing() -> None:
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, 2], [0, 2, 1]], process=False
    )
    assert "encloses no volume" in refused(sheet, OpenCadError)


# the surface through itself


def pulled_through(depth_mm: float) -> trimesh.Trimesh:
    """A cube whose top has a dent of a pyramid that goes ``depth_mm`` past the bottom."""
    mesh = block(20, 20, 20)
    top = np.flatnonzero(mesh.vertices[:, 2] > 9)
    ring = top[np.argsort(np.arctan2(*mesh.vertices[top, :2].T[::-1]))]
    keep = ~np.isin(mesh.faces, top).all(axis=1)
    tip = len(mesh.vertices)
    sides = [[ring[i], ring[(i + 1) % 4], tip] for i in range(4)]
    vertices = np.vstack([mesh.vertices, [0.7, 0.4, -10 - depth_mm]])
    return trimesh.Trimesh(vertices, np.vstack([mesh.faces[keep], sides]), process=False)


@pytest.mark.parametrize("depth_mm", [0.05, 1.0, 5.0])
def test_a_dent_through_the_bottom_is_a_self_intersection(depth_mm: float) -> None:
    assert "runs through itself near (" in refused(
        pulled_through(depth_mm), SelfIntersectingCadError
    )


def test_a_dent_that_only_just_leaves_the_bottom_whole_is_read() -> None:
    # a pyramid of 400 mm2 and 19.95 mm is taken out of the cube
    assert solid_from(pulled_through(-0.05)).volume == pytest.approx(8000 - 400 * 19.95 / 3)


def test_what_runs_through_itself_is_found_wherever_and_however_it_lies() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        mesh = pulled_through(1.0)
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        mesh.apply_translation(rng.uniform(-3000, 3000, 3))
        refused(mesh, SelfIntersectingCadError)


def side(a: np.ndarray, b: np.ndarray, c: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Six times the signed volume of the tetrahedron a b c p, over leading axes."""
    return np.einsum("...i,...i->...", np.cross(b - a, c - a), p - a)


def pierced_pairs(mesh: trimesh.Trimesh) -> int:
    """How many edges run through triangles they share no corner with: each with each, by signs."""
    points, faces, edges = np.asarray(mesh.vertices), mesh.faces, mesh.edges_unique
    a, b, c = (points[faces[:, i]][:, None] for i in range(3))
    p, q = points[edges[:, 0]][None], points[edges[:, 1]][None]
    apart = (faces[:, None, :, None] != edges[None, :, None, :]).all(axis=(2, 3))
    turns = np.stack([side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)])
    inside = (turns > 0).all(axis=0) | (turns < 0).all(axis=0)
    return int((apart & inside & (side(a, b, c, p) * side(a, b, c, q) < 0)).sum())


def test_crossings_are_those_that_comparing_each_with_each_finds() -> None:
    rng = np.random.default_rng(11)
    body = mesh_of(box(30, 20, 10) - rod(4, 30, 12).translate((6, 2, 0)))
    refused_count = 0
    for _ in range(60):
        mesh = body.copy()
        some = rng.integers(0, len(mesh.vertices), 2)
        mesh.vertices[some] += rng.uniform(-12, 12, (2, 3))
        crosses = pierced_pairs(mesh) > 0
        refused_count += crosses
        try:
            check_soundness(mesh, "part")
        except SelfIntersectingCadError:
            assert crosses
        except InsideOutCadError:
            continue
        else:
            assert not crosses
    assert 10 < refused_count < 50, "both answers are asked for"


def test_a_surface_that_lies_on_itself_is_found_by_its_two_sides() -> None:
    """A U whose legs overlap: in the overlap all lies in two planes and no edge pierces a face."""
    # foot 0-30 x 0-8; the left leg is 0-18 wide, the right one 12-30
    outline = [(0, 0), (30, 0), (30, 20), (12, 20), (12, 8), (18, 8), (18, 20), (0, 20)]
    pieces = [[0, 1, 4], [0, 4, 5], [0, 5, 6], [0, 6, 7], [1, 2, 3], [1, 3, 4]]
    mesh = trimesh.creation.extrude_triangulation(np.array(outline, float), pieces, height=10)
    assert mesh.is_watertight
    assert "itself near" in refused(mesh, SelfIntersectingCadError)


def test_faces_exported_twice_are_told() -> None:
    mesh = block()
    doubled = trimesh.Trimesh(mesh.vertices, np.vstack([mesh.faces, mesh.faces[:2]]), process=False)
    assert "2 triangles coincide with others" in refused(doubled, SelfIntersectingCadError)


def test_blocks_put_together_and_not_united_are_told_to_unite() -> None:
    same_face = joined(block(), moved(block(), 10, 0, 0))
    assert "unite them" in refused(same_face, SelfIntersectingCadError)
    other_face = joined(block(), moved(block(10, 7, 9), 10, 1, 2))
    assert "unite them" in refused(other_face, ManySolidsCadError)


def test_cubes_that_share_one_edge_are_told_where_they_touch() -> None:
    both = joined(block(10, 10, 10), moved(block(10, 10, 10), 10, 10, 0))
    assert "touches itself along 1 edges" in refused(both, SelfIntersectingCadError)


def test_touching_by_rounding_is_no_crossing() -> None:
    """Two walls that meet in one plane, in single precision after a turn, stay readable."""
    rng = np.random.default_rng(2)
    body = box(40, 30, 10) + rod(6, 30, 48).translate((5, 3, 0)) - rod(4, 60, 40)
    body += box(8, 8, 12).translate((-14, 9, 11))
    for _ in range(8):
        mesh = mesh_of(body)
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
        mesh.vertices = mesh.vertices.astype(np.float32).astype(float)
        check_soundness(mesh, "part")


@pytest.mark.parametrize("seed", range(12))
def test_whatever_manifold3d_makes_of_random_shapes_is_sound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body: Body = box(40, 40, 40)
    for i in range(8):
        other = (box(*rng.uniform(5, 30, 3)), rod(rng.uniform(2, 9), 50, 24), Body.sphere(9, 32))
        tool = other[i % 3].rotate(tuple(rng.uniform(0, 360, 3)))
        tool = tool.translate(tuple(rng.uniform(-20, 20, 3)))
        body = body - tool if rng.random() < 0.6 else body + tool
    body = max(body.decompose(), key=lambda b: b.volume())
    mesh = mesh_of(body)
    points, triangles, _ = weld(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    check_soundness(trimesh.Trimesh(points, triangles, process=False), "part")


def test_parts_of_others_are_sound_and_two_of_them_pushed_together_are_not() -> None:
    for entry in listed_parts():
        mesh = trimesh.load(part_file(entry["stl"]), force="mesh")
        check_soundness(mesh, entry["name"])
        pushed = joined(mesh, hollow(moved(mesh, *(mesh.extents * 0.05))))
        with pytest.raises((ManySolidsCadError, SelfIntersectingCadError)):
            check_soundness(pushed, entry["name"])


def test_how_deep_counts_as_touching_grows_with_the_reach_of_single_precision() -> None:
    assert touch_of(block()) == 1e-3
    large = block(2000, 2000, 2000)
    assert 1e-3 < touch_of(large) < 1e-2
    assert np.spacing(np.float32(1000.0)) < touch_of(large) / 20


# welding


def test_a_needle_between_two_triangles_is_flipped_away() -> None:
    """A side split on one side only: the flat triangle that closes it goes, the solid stays."""
    mesh = block()
    a, b, c = mesh.faces[0]
    middle = len(mesh.vertices)
    vertices = np.vstack([mesh.vertices, mesh.vertices[[a, b]].mean(axis=0)])
    faces = np.vstack([mesh.faces[1:], [[a, middle, c], [middle, b, c], [a, b, middle]]])
    points, triangles, kept = weld(vertices, faces)
    welded = trimesh.Trimesh(points, triangles, process=False)
    assert welded.is_watertight
    assert welded.volume == pytest.approx(6000)
    assert welded.area_faces.min() > 1.0
    assert len(kept) == len(triangles) == 14
    assert solid_from(trimesh.Trimesh(vertices, faces, process=False)).volume == pytest.approx(6000)


def test_flat_triangles_in_the_file_leave_its_named_surfaces_in_step() -> None:
    mesh = block()
    faces = np.vstack([[[0, 0, 1]], mesh.faces, [[2, 3, 3]]])
    _, triangles, kept = weld(np.asarray(mesh.vertices), faces)
    assert kept.tolist() == list(range(1, 13))
    assert len(triangles) == 12
