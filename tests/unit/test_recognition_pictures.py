"""Recognition on stored path-traced pictures: made by a renderer that is not of this project.

The everyday set is a cross-section; all 21 backlit pictures run with the slow tests.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from data_files import PICTURES, listed_parts, part_file, true_pictures
from numpy.typing import NDArray

from controller.cad import sample_surface
from controller.cad.compiled import CompiledPart, load_part
from controller.imaging import Camera, inverse_pose, transform
from controller.recognition import Library, Sighting, make_library, recognise

Array = NDArray[np.float64]
PLACE_MM = 0.3
TURN_DEG = 0.3

# one part alone, several, strangers, mirror images, a part on its edge, one that barely stands
EVERYDAY = ["0002", "0006", "0010", "0015", "0024", "0030", "0032"]


truth = cache(true_pictures)


def backlit() -> list[str]:
    return [im["image"][4:8] for im in truth()["images"] if im["mode"] == "back"]


@cache
def camera() -> Camera:
    told = truth()["camera"]
    R_cam_world, t_cam_world = np.array(told["R_wc"]), np.array(told["t_wc"])
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = R_cam_world.T
    T_world_cam[:3, 3] = -R_cam_world.T @ t_cam_world
    K, distortion = np.array(told["K"]), np.array(told["dist"])
    return Camera((told["width"], told["height"]), K, distortion, T_world_cam)


@cache
def parts() -> tuple[CompiledPart, ...]:
    return tuple(load_part(part_file(p["stl"])) for p in listed_parts())


@cache
def library() -> Library:
    return make_library(parts(), camera())


def true_pose(entry: CompiledPart, told: dict[str, Any]) -> Array:
    """T_world_part after the pictures' README: Rz(theta) R (X - c) + (x, y, h)."""
    theta = np.radians(told["theta_deg"])
    turn = np.array(
        [[np.cos(theta), -np.sin(theta), 0], [np.sin(theta), np.cos(theta), 0], [0, 0, 1]]
    )
    T = np.eye(4)
    T[:3, :3] = turn @ np.array(told["stable_pose_R"])
    T[:3, 3] = (
        np.array([told["x_mm"], told["y_mm"], told["centroid_height_mm"]])
        - T[:3, :3] @ entry.solid.centroid_mm
    )
    return T


def assert_placed(seen: Sighting, told: dict[str, Any]) -> None:
    """The answer puts the part's surfaces where they are, up to the part's own symmetry.

    Every surface by itself, so that a bore at the wrong place is not lost in the average: each
    may be off by the place allowed and by the turn allowed at its own distance from the centroid.
    """
    (entry,) = (e for e in parts() if e.solid.name == seen.part)
    assert seen.T_world_part is not None
    assert np.hypot(seen.x_mm - told["x_mm"], seen.y_mm - told["y_mm"]) < PLACE_MM
    samples = sample_surface(entry.solid, spacing_mm=12.0, per_face=4)
    T_true = true_pose(entry, told)
    points = transform(inverse_pose(seen.T_world_part), transform(T_true, samples.points_mm))
    gap = trimesh.proximity.closest_point(entry.solid.mesh, points)[1]
    reach = np.linalg.norm(samples.points_mm - entry.solid.centroid_mm, axis=1)
    allowed = PLACE_MM + np.radians(TURN_DEG) * reach
    for face in entry.solid.faces:
        mine = samples.face_ids == face.id
        assert np.median(gap[mine] / allowed[mine]) < 1.0, face.label


def check(number: str) -> None:
    (told,) = (im for im in truth()["images"] if im["image"] == f"img_{number}.png")
    picture = cv2.imread(str(PICTURES / told["image"]), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    lighting = {"back": "backlit", "front": "front"}[told["mode"]]
    sightings = list(
        recognise(np.asarray(picture, np.uint8), camera(), library(), lighting).sightings
    )
    assert len(sightings) == len(told["objects"])
    for thing in told["objects"]:
        seen = min(
            sightings, key=lambda s: np.hypot(s.x_mm - thing["x_mm"], s.y_mm - thing["y_mm"])
        )
        sightings.remove(seen)
        if not thing["known"]:
            assert seen.part is None
            assert seen.reason
            continue
        assert seen.part == thing["part"], seen.reason
        assert {a.part for a in seen.ambiguous_with} <= {thing["part"]}
        assert_placed(seen, thing)


@pytest.mark.parametrize("number", EVERYDAY)
def test_every_object_of_a_picture_is_named_and_placed(number: str) -> None:
    check(number)


@pytest.mark.slow
@pytest.mark.parametrize("number", [n for n in backlit() if n not in EVERYDAY])
def test_every_object_of_every_other_backlit_picture_is_named_and_placed(number: str) -> None:
    check(number)


def test_the_test_itself_would_see_a_turn_or_a_shift_too_much() -> None:
    (entry,) = (e for e in parts() if e.solid.name == "idler_riser")
    told = next(o for im in truth()["images"] for o in im["objects"] if o["part"] == "idler_riser")
    right = true_pose(entry, told)

    def answer(T: Array) -> Sighting:
        com = transform(T, entry.solid.centroid_mm[None])[0]
        return Sighting(
            "idler_riser", 0, None, com[0], com[1], 0.0, T, 1.0, None, (), 1.0, (0, 0, 1, 1), 0.0
        )  # fmt: skip

    assert_placed(answer(right), told)
    shifted = right.copy()
    shifted[0, 3] += 0.35
    turned = true_pose(entry, {**told, "theta_deg": told["theta_deg"] + 2.0})
    over = true_pose(entry, {**told, "theta_deg": told["theta_deg"] + 180.0})
    for wrong in (shifted, turned, over):
        with pytest.raises(AssertionError):
            assert_placed(answer(wrong), told)
