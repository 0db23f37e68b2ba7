"""How solids of STEP files are divided: as finely as is of use, and with a face that cannot be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from step_bodies import BALL_MM, LUNE_MM, RING_MM, write_bodies
from step_files import needs_kernel

from controller.cad import OpenCadError, Solid, load_solid
from controller.cad.reading.step.files import read_step_part
from controller.cad.reading.step.kernel import KernelRun

PI = np.pi
STRAY_SHARE = 3.2e-4  # of the diagonal: 0.02 mm of a part of 50 mm, whose diagonal is about 65
STRAY_MM = 0.021  # what smaller parts may be off


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_bodies(tmp_path_factory.mktemp("bodies"))


def _inside(solid: Solid) -> np.ndarray:
    """Return points all over the triangles, 15 of each."""
    steps = [(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]
    return (np.array(steps) / 4 @ solid.mesh.triangles).reshape(-1, 3)


def _allowed_mm(size_mm: tuple[float, float, float]) -> float:
    return max(STRAY_MM, STRAY_SHARE * float(np.linalg.norm(size_mm)))


@needs_kernel
@pytest.mark.parametrize("radius", BALL_MM)
def test_a_ball_is_as_round_as_its_size_needs(files: dict[str, Path], radius: float) -> None:
    solid = load_solid(files[f"ball {radius:g}"])
    off = radius - np.linalg.norm(_inside(solid), axis=1)
    allowed = _allowed_mm((2 * radius,) * 3)
    assert off.min() >= -1e-6
    assert off.max() <= allowed
    assert solid.volume_mm3 == pytest.approx(4 / 3 * PI * radius**3, rel=1e-6)
    # all lost lies between the ball and one smaller by what is allowed
    assert solid.mesh.volume >= 4 / 3 * PI * (radius - allowed) ** 3
    # equal triangles of that error on all of a ball: c^2 = 2 r e, area 3 sqrt(3) / 4 c^2 each
    fewest = 4 * PI * radius**2 / (3 * np.sqrt(3) / 2 * radius * allowed)
    assert len(solid.mesh.faces) <= 8 * fewest


@needs_kernel
def test_a_thin_ring_is_as_round_as_its_size_needs(files: dict[str, Path]) -> None:
    ring, tube = RING_MM
    solid = load_solid(files["ring"])
    points = _inside(solid)
    away = np.hypot(np.hypot(points[:, 0], points[:, 1]) - ring, points[:, 2])
    assert np.abs(away - tube).max() <= _allowed_mm((2 * (ring + tube),) * 2 + (2 * tube,))
    assert solid.volume_mm3 == pytest.approx(2 * PI**2 * ring * tube**2, rel=1e-6)
    assert solid.mesh.volume == pytest.approx(solid.volume_mm3, rel=0.03)


@needs_kernel
def test_walls_that_are_straight_one_way_have_corners_at_their_rims_alone(
    files: dict[str, Path],
) -> None:
    rod = load_solid(files["rod"])
    heights = rod.mesh.vertices[:, 2]
    assert np.unique(heights.round(6)).tolist() == [0, 400]
    cone = load_solid(files["frustum"])
    points = _inside(cone)
    on_wall = points[(points[:, 2] > 1) & (points[:, 2] < 39)]
    off = 30 - on_wall[:, 2] / 2 - np.hypot(on_wall[:, 0], on_wall[:, 1])
    assert off.max() <= _allowed_mm((60, 60, 40))
    assert cone.volume_mm3 == pytest.approx(PI * 40 / 3 * (900 + 300 + 100), rel=1e-6)


@needs_kernel
def test_a_spline_is_as_close_as_its_size_needs(files: dict[str, Path]) -> None:
    solid = load_solid(files["drop"])
    points = _inside(solid)
    # a body stretched by 1.6 is off by 1.6 of what it is off before, at most
    round_again = points / (1, 1, 1.6)
    off = 25 - np.linalg.norm(round_again, axis=1)
    assert off.max() <= _allowed_mm((50, 50, 80))
    assert solid.volume_mm3 == pytest.approx(4 / 3 * PI * 25**3 * 1.6, rel=1e-5)


@needs_kernel
def test_a_larger_part_of_the_same_form_has_about_as_many_triangles(
    files: dict[str, Path],
) -> None:
    middle, large = (len(load_solid(files[f"ball {r:g}"]).mesh.faces) for r in (25, 120))
    assert large <= 4 * middle


def _with_cone(files: dict[str, Path], name: str, point: str, direction: str) -> Path:
    """Return the sunk plate's file with the cone somewhere else than its edges are."""
    text = re.sub(r"\n\s+", "", files["sunk"].read_text())
    place = re.search(r"= CONICAL_SURFACE\('',#(\d+),", text)
    assert place
    axis = re.search(rf"#{place[1]} = AXIS2_PLACEMENT_3D\('',#(\d+),#(\d+),", text)
    assert axis
    for number, stated in zip(axis.groups(), (point, direction), strict=True):
        text, count = re.subn(rf"(#{number} = \w+\('',)\([^)]*\)", rf"\1({stated})", text)
        assert count == 1
    path = files["sunk"].with_name(f"{name}.step")
    path.write_text(text)
    return path


SUNK_MM3 = 60 * 40 * 10 - PI * 16 * 6 - PI * 4 / 3 * (16 + 32 + 64)


@needs_kernel
@pytest.mark.parametrize(
    ("name", "point", "direction"),
    [("beside", "26.,15.,6.", "0.,0.,1."), ("upside down", "20.,15.,6.", "0.,0.,-1.")],
)
def test_a_cone_that_cannot_be_divided_is_left_out_by_name_and_the_part_is_whole(
    files: dict[str, Path], name: str, point: str, direction: str
) -> None:
    sound = read_step_part(files["sunk"])
    assert sound.warnings == ()
    assert sound.solid.volume_mm3 == pytest.approx(SUNK_MM3, rel=1e-9)
    part = read_step_part(_with_cone(files, name, point, direction))
    (warning,) = part.warnings
    place = re.search(r"Surface \d+ of the file, about \(([^)]*)\) mm", warning)
    assert place
    assert [float(x) for x in place[1].split(",")] == pytest.approx((20, 15, 8), abs=0.3)
    assert "left out" in warning
    # between two circles straight pieces are the cone itself, but for chords
    area = PI * (4 + 8) * np.hypot(4, 4)
    left_out = [face for face in part.solid.faces if face.kind == "freeform"]
    assert [face.area_mm2 for face in left_out] == pytest.approx([area], rel=0.01)
    assert [face.kind for face in part.solid.faces].count("plane") == 6
    assert part.solid.mesh.is_watertight
    assert part.solid.volume_mm3 == pytest.approx(SUNK_MM3, abs=2 * area * 0.02)
    assert part.area_mm2 == pytest.approx(sound.area_mm2, rel=1e-3)
    assert part.solid.centroid_mm == pytest.approx(sound.solid.centroid_mm, abs=0.01)
    assert part.inertia_mm5 == pytest.approx(sound.inertia_mm5, rel=1e-3, abs=1e-3 * 1e7)


@needs_kernel
def test_what_has_no_clear_border_is_refused_for_its_surface(files: dict[str, Path]) -> None:
    text = re.sub(r"\n\s+", "", files["sunk"].read_text())
    face = re.search(r"= ADVANCED_FACE\('',\(#\d+,#\d+\),#\d+,\.[TF]\.\)", text)
    assert face  # the top or the bottom, with the rim of the hole
    outer, inner = re.findall(r"#\d+", face[0])[:2]
    loops = [re.search(rf"{n} = FACE_BOUND\('',(#\d+),", text) for n in (outer, inner)]
    assert loops[0]
    assert loops[1]
    path = files["sunk"].with_name("no inside.step")
    path.write_text(text.replace(f"FACE_BOUND('',{loops[0][1]},", f"FACE_BOUND('',{loops[1][1]},"))
    with pytest.raises(OpenCadError):
        read_step_part(path)


@needs_kernel
@pytest.mark.parametrize("name", ["lune", "ball 25", "sunk"])
def test_new_borders_are_the_borders_that_were_there(
    files: dict[str, Path], name: str, tmp_path: Path
) -> None:
    volume_mm3 = {
        "lune": PI / 3 * LUNE_MM**3,
        "ball 25": 4 / 3 * PI * 25**3,
        "sunk": SUNK_MM3,
    }[name]
    with KernelRun("solid", files[name], tmp_path / "out.npz", ["1", "0.3", "2"]) as run:
        found = run.result(name)
    assert str(found["how"]) == "2"
    assert found["volume_mm3"] == pytest.approx(volume_mm3, rel=1e-5)
    mesh = trimesh.Trimesh(found["vertices_mm"], found["triangles"], process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(volume_mm3, rel=0.005)
