"""Made-up scenes of parts that touch: they do, none lies on another, and what is free is stated."""

import sys
from pathlib import Path

import numpy as np
import pytest
import shapely
from cad_solids import box, solid_of

from controller.cad import stable_poses

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from trace_placing import Part, camera_of, camera_words, turn
from trace_touching import free_shares, put_touching


def a_block(name: str, size: tuple[float, float, float]) -> Part:
    solid = solid_of(box(*size), name)
    poses = (stable_poses(solid)[0],)
    return Part(solid, poses, np.ones(1))


@pytest.mark.parametrize("seed", range(6))
def test_blocks_are_slid_until_they_touch_and_none_lies_on_another(seed: int) -> None:
    parts = [a_block("block", (40, 25, 10)), a_block("bar", (70, 12, 8))]
    camera = camera_of(camera_words(None))
    kind, placed = put_touching(parts, [], False, camera, np.random.default_rng(seed))
    assert kind == "touching"
    footprints = []
    for one in placed:
        points = one.triangles_mm.reshape(-1, 3)[:, :2]
        footprints.append(shapely.MultiPoint(points).convex_hull)
    for k, one in enumerate(footprints):
        others = [other for j, other in enumerate(footprints) if j != k]
        assert max(one.intersection(other).area for other in others) < 0.01
        assert min(one.distance(other) for other in others) < 0.05


def test_of_a_block_against_another_the_side_between_them_is_not_free() -> None:
    part = a_block("block", (40, 20, 0.5))
    camera = camera_of(camera_words(None))
    about = {
        "part": "block",
        "stable_pose_R": np.eye(3).tolist(),
        "theta_deg": 0.0,
        "centroid_height_mm": 0.25,
    }
    first = about | {"x_mm": 0.0, "y_mm": 0.0}
    beside = about | {"x_mm": 40.02, "y_mm": 0.0}
    assert np.allclose(turn(first), np.eye(3))
    assert free_shares([(part, first)], camera) == [1.0]
    shares = free_shares([(part, first), (part, beside)], camera)
    assert shares == pytest.approx([1 - 20 / 120] * 2, abs=0.03)
