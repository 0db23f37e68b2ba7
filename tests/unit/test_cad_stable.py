"""How a part can lie: odds, heights and tip energies against geometry done on paper."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from cad_solids import SHARED, Body, box, mesh_of, prism, rod, solid_of

from controller.cad import StablePose, load_solid, make_solid, stable_poses

MANIFEST = SHARED / "parts" / "manifest.json"
G = 9.81


def solid_angle_share(a: float, b: float, d: float) -> float:
    """Share of the full sphere that a rectangle a x b takes, seen from d above its middle."""
    p, q = a / 2, b / 2
    return 4 * float(np.arctan2(p * q, d * np.sqrt(p * p + q * q + d * d))) / (4 * np.pi)


def lift_mm(height: float, to_edge: float) -> float:
    return float(np.hypot(height, to_edge) - height)


def down(pose: StablePose) -> np.ndarray:
    """The direction in the CAD frame that points to the table."""
    return -pose.R[2]


def assert_sound(poses: tuple[StablePose, ...]) -> None:
    assert [p.index for p in poses] == list(range(len(poses)))
    odds = [p.probability for p in poses]
    assert odds == sorted(odds, reverse=True)
    for pose in poses:
        np.testing.assert_allclose(pose.R @ pose.R.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(pose.R) == pytest.approx(1.0)


def test_a_box_lies_on_each_of_six_faces_with_its_solid_angle_as_odds() -> None:
    size = np.array([40.0, 30.0, 20.0])
    poses = stable_poses(solid_of(box(*size)))
    assert_sound(poses)
    assert len(poses) == 6
    assert sum(p.probability for p in poses) == pytest.approx(1.0, abs=1e-6)
    for pose in poses:
        axis = int(np.argmax(np.abs(down(pose))))
        a, b = np.delete(size, axis)
        assert abs(down(pose)[axis]) == pytest.approx(1.0)
        assert pose.com_height_mm == pytest.approx(size[axis] / 2, abs=1e-6)
        assert pose.probability == pytest.approx(solid_angle_share(a, b, size[axis] / 2), abs=1e-6)
        expected = G * lift_mm(size[axis] / 2, min(a, b) / 2)
        assert pose.tip_energy_mj_per_kg == pytest.approx(expected, rel=1e-3)
        assert not pose.rolling


def test_a_tetrahedron_lies_on_any_side_alike() -> None:
    poses = stable_poses(solid_of(Body.tetrahedron().scale((10, 10, 10))))
    assert_sound(poses)
    assert [p.probability for p in poses] == pytest.approx([0.25] * 4, abs=1e-6)
    # corners at (+-10, +-10, +-10): edge a = 20 sqrt 2, in-radius a / sqrt 24, a side's a / sqrt 12
    edge = 20 * np.sqrt(2)
    height, to_edge = edge / np.sqrt(24), edge / np.sqrt(12)
    for pose in poses:
        assert pose.com_height_mm == pytest.approx(height, rel=1e-6)
        assert pose.tip_energy_mj_per_kg == pytest.approx(G * lift_mm(height, to_edge), rel=1e-3)


def test_a_side_the_centre_of_mass_does_not_stand_over_is_no_way_to_lie() -> None:
    # triangle (0,0) (10,0) (60,20): its centroid x = 23.3 stands beside the 10 mm side
    solid = solid_of(prism([(0, 0), (10, 0), (60, 20)], 30))
    poses = stable_poses(solid)
    assert_sound(poses)
    assert sum(p.probability for p in poses) == pytest.approx(1.0, abs=1e-6)
    assert all(down(pose) @ np.array([0.0, -1.0, 0.0]) < 0.99 for pose in poses)
    for pose in poses:
        upright = (solid.mesh.vertices - solid.centroid_mm) @ pose.R.T
        feet = upright[upright[:, 2] < upright[:, 2].min() + 1e-6]
        assert (feet[:, :2].min(axis=0) <= 1e-6).all()
        assert (feet[:, :2].max(axis=0) >= -1e-6).all()


def test_a_rod_stands_on_its_ends_and_rolls_on_its_wall() -> None:
    radius, length, segments = 10.0, 30.0, 64
    poses = stable_poses(solid_of(rod(radius, length, segments)))
    assert_sound(poses)
    standing = [p for p in poses if abs(down(p)[2]) > 0.99]
    assert len(standing) == 2
    # solid angle of a disc: 2 pi (1 - cos alpha)
    share = 0.5 * (1 - (length / 2) / np.hypot(length / 2, radius))
    assert [p.probability for p in standing] == pytest.approx([share] * 2, abs=1e-3)
    assert not any(p.rolling for p in standing)
    (lying,) = (p for p in poses if abs(down(p)[2]) < 0.01)
    assert lying.rolling
    assert lying.probability == pytest.approx(1 - 2 * share, abs=1e-3)
    assert lying.com_height_mm == pytest.approx(radius * np.cos(np.pi / segments), abs=1e-4)
    # to leave the wall it must stand on its rim's end
    assert lying.tip_energy_mj_per_kg == pytest.approx(
        G * (np.hypot(radius * np.cos(np.pi / segments), length / 2) - lying.com_height_mm),
        rel=1e-6,
    )


def test_ways_to_lie_rarer_than_asked_are_left_out() -> None:
    solid = solid_of(box(40, 30, 2))
    edgeways = solid_angle_share(30, 2, 20)
    assert edgeways < 0.02
    assert len(stable_poses(solid)) == 6
    assert len(stable_poses(solid, min_probability=0.02)) == 2


def test_a_hollow_does_not_let_a_part_lie_deeper() -> None:
    # a cup: the table carries it on the rim's hull, not on the bottom of the hollow
    solid = solid_of(box(40, 40, 30) - box(30, 30, 30).translate((0, 0, 10)))
    poses = stable_poses(solid)
    rim_down = next(p for p in poses if down(p)[2] > 0.99)
    assert rim_down.com_height_mm == pytest.approx(15 - solid.centroid_mm[2], abs=1e-4)
    bottom_down = next(p for p in poses if down(p)[2] < -0.99)
    # centre of mass on paper: 48000 mm3 at z = 0 less 18000 mm3 (z -5 to 15) at z = 5
    z = -18000 * 5 / (48000 - 18000)
    assert bottom_down.com_height_mm == pytest.approx(15 + z, abs=1e-4)


def test_the_odds_do_not_depend_on_where_the_cad_frame_stands() -> None:
    mesh = mesh_of(box(40, 30, 20))
    mesh.apply_translation((500, -300, 70))
    moved = stable_poses(make_solid(mesh, "moved", "0" * 64, "moved"))
    here = stable_poses(solid_of(box(40, 30, 20)))
    assert [p.probability for p in moved] == pytest.approx([p.probability for p in here], abs=1e-6)


def test_the_same_file_gives_the_same_poses() -> None:
    solid = solid_of(box(40, 30, 20) - rod(5, 40, 32))
    for a, b in zip(stable_poses(solid), stable_poses(solid), strict=True):
        assert np.array_equal(a.R, b.R)
        assert a.probability == b.probability


def manifest() -> list[dict[str, Any]]:
    if not MANIFEST.is_file():
        return []
    return list(json.loads(MANIFEST.read_text())["parts"])


@pytest.mark.skipif(not MANIFEST.is_file(), reason=f"the shared parts are not at {SHARED}")
@pytest.mark.parametrize("entry", manifest(), ids=lambda e: str(e["name"]))
def test_the_shared_parts_lie_as_their_manifest_says(entry: dict[str, Any]) -> None:
    poses = stable_poses(load_solid(SHARED / "parts" / entry["stl"]))
    assert_sound(poses)
    for expected in entry["stable_poses"]:
        toward = -np.array(expected["R"])[2]
        same = [p for p in poses if down(p) @ toward > np.cos(np.radians(1.5))]
        alone = sum(p.probability for p in same)
        # the manifest pools what cannot be told apart: both sides of a disc, every tooth of a gear
        height = same[0].com_height_mm
        pooled = sum(p.probability for p in poses if abs(p.com_height_mm - height) < 0.05)
        assert min(abs(o - expected["probability"]) for o in (alone, pooled)) < 0.003
        assert height == pytest.approx(expected["centroid_height_mm"], abs=0.05)
