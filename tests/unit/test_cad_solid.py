"""CAD files: what is one closed body in millimetres is read, all else is refused by its name."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cad_solids import box, mesh_of, polygon_area, rod, solid_of
from data_files import listed_parts, part_file

from controller.cad import (
    CadError,
    CoordinatesCadError,
    EmptyCadError,
    InsideOutCadError,
    ManySolidsCadError,
    OpenCadError,
    UnitCadError,
    UnreadableCadError,
    load_solid,
)

PARTS = Path(__file__).resolve().parents[2] / "recipes" / "parts"


def block() -> trimesh.Trimesh:
    return trimesh.creation.box((10.0, 20.0, 30.0))


def binary_stl(mesh: trimesh.Trimesh) -> bytes:
    return bytes(mesh.export(file_type="stl"))


def text_stl(mesh: trimesh.Trimesh) -> bytes:
    return str(mesh.export(file_type="stl_ascii")).encode()


def write(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def refusal(path: Path, kind: type[CadError]) -> str:
    """The message, after what every message owes: the file, one line, and what to do."""
    with pytest.raises(kind) as caught:
        load_solid(path)
    assert type(caught.value) is kind
    message = str(caught.value)
    assert message.startswith(str(path))
    assert "\n" not in message
    assert ";" in message, "names the trouble and then what to do about it"
    assert "Module" not in message, "no missing library of ours is the reader's trouble"
    return message


@pytest.mark.parametrize("ending", ["stl", "STL", "obj", "ply", "off"])
def test_every_format_gives_the_same_box(tmp_path: Path, ending: str) -> None:
    body = block()
    body.apply_translation((100.0, -50.0, 7.0))
    path = tmp_path / f"block.{ending}"
    body.export(path, file_type=ending.lower())

    solid = load_solid(path)

    assert solid.name == "block"
    assert solid.content_hash == hashlib.sha256(path.read_bytes()).hexdigest()
    assert solid.volume_mm3 == pytest.approx(6000.0, rel=1e-6)
    assert solid.centroid_mm == pytest.approx([100.0, -50.0, 7.0], abs=1e-4)
    assert len(solid.faces) == 6


def test_a_text_stl_and_a_binary_stl_are_one_solid(tmp_path: Path) -> None:
    text = load_solid(write(tmp_path, "t.stl", text_stl(block())))
    binary = load_solid(write(tmp_path, "b.stl", binary_stl(block())))
    assert text.volume_mm3 == pytest.approx(binary.volume_mm3)
    assert text.content_hash != binary.content_hash


def test_a_binary_stl_whose_header_says_solid_is_read_as_binary(tmp_path: Path) -> None:
    data = b"solid made by a CAD system".ljust(80, b" ") + binary_stl(block())[80:]
    assert load_solid(write(tmp_path, "b.stl", data)).volume_mm3 == pytest.approx(6000.0)


def test_an_obj_with_normals_of_its_own_per_face_is_closed_all_the_same(tmp_path: Path) -> None:
    # each corner comes three times, once per normal: sharp edges are written so by most tools
    body = block()
    lines = [f"v {x} {y} {z}" for x, y, z in body.vertices]
    lines += [f"vn {x} {y} {z}" for x, y, z in body.face_normals]
    lines += [
        "f " + " ".join(f"{corner + 1}//{i + 1}" for corner in face)
        for i, face in enumerate(body.faces)
    ]
    path = write(tmp_path, "normals.obj", "\n".join(lines).encode())
    assert load_solid(path).volume_mm3 == pytest.approx(6000.0)


def test_points_that_no_triangle_uses_are_no_part_of_the_solid(tmp_path: Path) -> None:
    text = str(block().export(file_type="obj")).replace("v ", "v 900 900 900\nv ", 1)
    # the stray point comes first: every index is one higher
    lines = [
        "f " + " ".join(str(int(word.split("/")[0]) + 1) for word in line.split()[1:])
        if line.startswith("f ")
        else line
        for line in text.splitlines()
        if not line.startswith("vn")
    ]
    solid = load_solid(write(tmp_path, "stray.obj", "\n".join(lines).encode()))
    assert solid.volume_mm3 == pytest.approx(6000.0)
    assert np.abs(solid.mesh.vertices).max() == pytest.approx(15.0)


@pytest.mark.parametrize("data", [b"", b" \r\n\t", b"solid x\nendsolid x\n", b"\0" * 84])
def test_a_file_without_triangles_is_empty(tmp_path: Path, data: bytes) -> None:
    refusal(write(tmp_path, "nothing.stl", data), EmptyCadError)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("p.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"),
        ("c.obj", b"# only a comment\n"),
        ("bytes.obj", b"\xff\xfe\x00\x01 v 1 2 3"),
        ("latin.stl", b"solid Kl\xf6tzchen\nendsolid\n"),
    ],
)
def test_points_without_triangles_are_empty_too(tmp_path: Path, name: str, data: bytes) -> None:
    assert "no triangles" in refusal(write(tmp_path, name, data), EmptyCadError)


@pytest.mark.parametrize("lost", [1, 30, 49, 50, 250, 500])
def test_a_binary_stl_cut_short_anywhere_says_how_much_is_missing(
    tmp_path: Path, lost: int
) -> None:
    message = refusal(write(tmp_path, "cut.stl", binary_stl(block())[:-lost]), UnreadableCadError)
    assert "promises 12 triangles" in message
    assert f"holds {12 - lost / 50:.1f}" in message


@pytest.mark.parametrize("share", [0.3, 0.6, 0.97])
def test_a_text_stl_cut_short_breaks_off(tmp_path: Path, share: float) -> None:
    data = text_stl(block())
    path = write(tmp_path, "cut.stl", data[: int(share * len(data))])
    assert "breaks off" in refusal(path, UnreadableCadError)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("letter.stl", b"Dear supplier, please find the part attached.\n" * 9),
        ("picture.stl", b"\x89PNG\r\n\x1a\n"),
        ("letter.ply", b"Dear supplier"),
        ("letter.off", b"Dear supplier"),
    ],
)
def test_what_is_no_cad_file_is_unreadable(tmp_path: Path, name: str, data: bytes) -> None:
    refusal(write(tmp_path, name, data), UnreadableCadError)


def test_a_missing_file_and_a_folder_are_unreadable(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "gone.stl", UnreadableCadError)
    (tmp_path / "folder.stl").mkdir()
    assert "directory" in refusal(tmp_path / "folder.stl", UnreadableCadError)


@pytest.mark.parametrize("name", ["part.dwg", "part.iges", "part"])
def test_an_unknown_format_is_told_with_the_known_ones(tmp_path: Path, name: str) -> None:
    message = refusal(write(tmp_path, name, b"anything"), UnreadableCadError)
    assert "STL, OBJ, PLY, OFF" in message


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("triangle", [0, 7])
def test_a_coordinate_that_is_no_number_is_named(
    tmp_path: Path, value: float, triangle: int
) -> None:
    data = bytearray(binary_stl(block()))
    at = 84 + 50 * triangle + 12 + 4
    data[at : at + 4] = np.float32(value).tobytes()
    path = write(tmp_path, "nan.stl", bytes(data))
    assert "no numbers" in refusal(path, CoordinatesCadError)


def test_a_missing_triangle_leaves_three_open_sides(tmp_path: Path) -> None:
    body = block()
    body.update_faces(np.arange(11))
    path = write(tmp_path, "open.stl", binary_stl(body))
    assert "3 open triangle sides" in refusal(path, OpenCadError)


def test_a_solid_inside_out_is_told_to_flip_its_normals(tmp_path: Path) -> None:
    body = block()
    body.invert()
    path = write(tmp_path, "inside_out.stl", binary_stl(body))
    assert "inside out (volume -6000.0 mm3)" in refusal(path, InsideOutCadError)


def test_one_turned_triangle_is_not_called_inside_out(tmp_path: Path) -> None:
    body = block()
    faces = body.faces.copy()
    faces[3] = faces[3][::-1]
    turned = trimesh.Trimesh(body.vertices, faces, process=False)
    message = refusal(write(tmp_path, "turned.stl", binary_stl(turned)), InsideOutCadError)
    assert "some triangles face inwards" in message


def test_two_bodies_are_counted(tmp_path: Path) -> None:
    other = block()
    other.apply_translation((50.0, 0.0, 0.0))
    both = trimesh.util.concatenate([block(), other])
    path = write(tmp_path, "two.stl", binary_stl(both))
    assert "2 separate bodies" in refusal(path, ManySolidsCadError)


@pytest.mark.parametrize("scale", [1e-3, 1e-5])
def test_a_part_in_metres_is_asked_for_its_unit(tmp_path: Path, scale: float) -> None:
    body = block()
    body.apply_scale(scale)
    path = write(tmp_path, "metres.stl", binary_stl(body))
    assert "metres" in refusal(path, UnitCadError)


def test_corners_that_differ_by_rounding_are_one(tmp_path: Path) -> None:
    body = block()
    triangles = body.triangles + np.random.default_rng(3).uniform(-2e-5, 2e-5, (12, 3, 3))
    loose = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles), process=False)
    solid = load_solid(write(tmp_path, "loose.stl", binary_stl(loose)))
    assert solid.volume_mm3 == pytest.approx(6000.0, rel=1e-4)
    assert len(solid.mesh.vertices) == 8


def test_volume_and_centroid_of_a_drilled_plate_are_those_on_paper() -> None:
    # plate 80 x 60 x 10 with one bore of 48 sides at (20, 10)
    plate = box(80, 60, 10) - rod(5, 30, 48).translate((20, 10, 0))
    solid = solid_of(plate)
    bore = polygon_area(5, 48) * 10
    assert solid.volume_mm3 == pytest.approx(48_000 - bore, rel=1e-6)
    centroid = -bore * np.array([20.0, 10.0, 0.0]) / (48_000 - bore)
    assert solid.centroid_mm == pytest.approx(centroid, abs=1e-4)


def test_the_body_count_does_not_mind_a_part_that_only_just_hangs_together() -> None:
    bridge = box(20, 20, 20).translate((-15, 0, 0)) + box(20, 20, 20).translate((15, 0, 0))
    assert solid_of(bridge + box(20, 0.5, 0.5)).volume_mm3 == pytest.approx(16_000 + 2.5)
    with pytest.raises(ManySolidsCadError):
        solid_of(bridge)


def test_the_shipped_parts_load() -> None:
    for path in sorted(PARTS.glob("*.stl")):
        assert load_solid(path).volume_mm3 > 1000


@pytest.mark.parametrize("entry", listed_parts(), ids=lambda e: str(e["name"]))
def test_parts_of_others_have_the_volume_and_centroid_their_manifest_says(
    entry: dict[str, Any],
) -> None:
    solid = load_solid(part_file(entry["stl"]))
    assert solid.content_hash == entry["sha256_stl"]
    assert solid.volume_mm3 == pytest.approx(entry["volume_mm3"], abs=0.06)  # rounded to 0.1
    assert solid.centroid_mm == pytest.approx(entry["centroid_mm"], abs=1e-3)
    assert solid.mesh.extents == pytest.approx(entry["size_mm"], abs=1e-3)
    assert sum(f.area_mm2 for f in solid.faces) == pytest.approx(solid.mesh.area, rel=1e-9)


def test_mesh_of_keeps_outward_normals() -> None:
    assert mesh_of(box(2, 2, 2)).volume == pytest.approx(8.0)
