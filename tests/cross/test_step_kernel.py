"""Our solids, surfaces and line drawings against the STEP kernel's, on parts made elsewhere."""

from __future__ import annotations

import dataclasses
import importlib.util
from functools import cache
from typing import Any

import numpy as np
import pytest
from data_files import listed_parts, part_file
from line_agreement import compare
from occ_views import ask
from scipy.spatial.transform import Rotation

from controller.cad import load_solid
from controller.cad.reading.step.files import StepPart, read_step_part
from controller.cad.views import line_view

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("OCP") is None,
    reason="the STEP kernel is not installed: pip install 'cellctl[step]'",
)
SLOW = pytest.mark.slow
EVERY = [
    "flange_xy",
    pytest.param("featuretype", marks=SLOW),
    pytest.param("nist_ftc06", marks=SLOW),
    pytest.param("cycloidal_gear", marks=SLOW),
    pytest.param("cycloidal_gear_mirror", marks=SLOW),
]


@cache
def told(name: str) -> dict[str, Any]:
    """The manifest's entry of a part."""
    return next(part for part in listed_parts() if part["name"] == name)


@cache
def step(name: str) -> StepPart:
    return read_step_part(part_file(told(name)["step"]))


@pytest.mark.parametrize("name", EVERY)
def test_the_mesh_of_a_step_file_is_the_exact_solid_within_a_thousandth(name: str) -> None:
    part = step(name)
    mesh = part.solid.mesh
    moments = np.linalg.eigvalsh(part.inertia_mm5)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(part.solid.volume_mm3, rel=1e-3)
    assert mesh.area == pytest.approx(part.area_mm2, rel=1e-3)
    assert mesh.center_mass == pytest.approx(part.solid.centroid_mm, abs=1e-3 * mesh.scale)
    assert mesh.moment_inertia == pytest.approx(part.inertia_mm5, abs=1e-3 * moments.max())
    assert len(mesh.faces) <= 60_000


@pytest.mark.parametrize("name", EVERY)
def test_faces_areas_add_up_to_the_surface(name: str) -> None:
    part = step(name)
    faces = part.solid.faces
    assert sum(face.area_mm2 for face in faces) == pytest.approx(part.area_mm2, rel=1e-6)
    of = part.solid.face_of_triangle
    assert sorted(set(of)) == [face.id for face in faces]
    areas = np.bincount(of, weights=part.solid.mesh.area_faces)
    expected = np.array([face.area_mm2 for face in faces])
    assert areas == pytest.approx(expected, rel=0.02, abs=1e-3)


@pytest.mark.parametrize("name", EVERY)
def test_every_corner_of_a_face_is_on_its_exact_surface(name: str) -> None:
    solid = step(name).solid
    for face in solid.faces:
        used = np.unique(solid.mesh.faces[solid.face_of_triangle == face.id])
        arm = solid.mesh.vertices[used] - face.centre_mm
        along = arm @ face.axis
        radial = np.linalg.norm(arm - along[:, None] * face.axis, axis=1)
        match face.kind:
            case "plane":
                off = arm @ face.normal
            case "cylinder":
                off = radial - face.radius_mm
            case "cone":
                off = radial - face.radius_mm - along * np.tan(face.half_angle_rad)
            case "sphere":
                off = np.linalg.norm(arm, axis=1) - face.radius_mm
            case "torus":
                off = np.hypot(radial - face.radius_mm, along) - face.minor_radius_mm
            case _:
                continue
        assert np.abs(off).max() < 2e-3, face.label  # tolerances of the STEP files' edges


@pytest.mark.parametrize("name", EVERY)
def test_the_stl_beside_it_is_the_same_solid(name: str) -> None:
    stl, part = load_solid(part_file(told(name)["stl"])), step(name)
    assert stl.volume_mm3 == pytest.approx(part.solid.volume_mm3, rel=1e-3)
    assert stl.mesh.area == pytest.approx(part.area_mm2, rel=1e-3)
    assert stl.centroid_mm == pytest.approx(part.solid.centroid_mm, abs=1e-3 * stl.mesh.scale)


@pytest.mark.parametrize("name", EVERY)
def test_visible_edges_are_those_of_exact_hidden_line_removal(name: str) -> None:
    solid = step(name).solid
    poses = [np.array(pose["R"]) for pose in told(name)["stable_poses"]]
    R = np.array([*poses, *Rotation.random(2, random_state=7).as_matrix()])
    drawn = ask(part_file(told(name)["step"]), R, solid.centroid_mm, timeout_s=60.0)
    for i, lines in enumerate(drawn):
        assert lines is not None, f"view {i}: the kernel drew nothing"
        agreement = compare(line_view(solid, R[i]), lines)
        assert agreement.found >= 0.99, f"view {i}: missing near {agreement.missing[:3]}"
        assert agreement.right >= 0.99, f"view {i}: too much near {agreement.extra[:3]}"


def test_drawings_that_lie_a_tenth_of_a_millimetre_apart_do_not_agree() -> None:
    solid = step("flange_xy").solid
    R = np.array([told("flange_xy")["stable_poses"][0]["R"]])
    view = line_view(solid, R[0])
    points = np.concatenate([edge.points for edge in view.edges])
    lines = {
        "points": points + 0.1,
        "length_mm": np.ones(len(points)),
        "kind": np.zeros(len(points)),
    }
    assert compare(view, lines).found < 0.5
    half = dataclasses.replace(view, edges=view.edges[: len(view.edges) // 2])
    assert compare(half, dict(lines, points=points)).found < 0.9
