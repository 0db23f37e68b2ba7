"""What a gripper takes from sight: what stands before the part, not what stands behind it."""

from __future__ import annotations

import numpy as np
from cad_solids import box, solid_of
from numpy.typing import NDArray

from controller.imaging import Camera, RayCaster, render_maps, view_roi
from controller.inspection import (
    InspectionLimits,
    ViewTask,
    WorldBox,
    before_part,
    make_scene,
)

# straight down from 600 mm, 3 px a millimetre; a plate 60 x 60 x 10 about the origin
CAMERA = Camera(
    (640, 512),
    np.array([[1800.0, 0, 319.5], [0, 1800.0, 255.5], [0, 0, 1.0]]),
    np.zeros(5),
    np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 600], [0, 0, 0, 1]]),
)


def masked(z_mm: float) -> NDArray[np.bool_]:
    """The gripper's mask with a finger 20 mm wide at that height, beside and over the plate."""
    T = np.eye(4)
    T[:3, 3] = 20, 0, z_mm
    finger = WorldBox(T, np.array([30.0, 10, 2]))
    corners = np.array([[-90.0, -80, -100], [90, -80, -100], [90, 80, -100], [-90, 80, -100]])
    task = ViewTask("v", CAMERA, np.eye(4), (finger,), corners, (), InspectionLimits())
    solid = solid_of(box(60, 60, 10))
    roi = view_roi(solid.mesh.vertices, np.eye(4), CAMERA)
    assert roi is not None
    maps = render_maps(RayCaster(solid.mesh), np.eye(4), CAMERA, roi)
    return np.asarray(before_part(make_scene(task), maps, CAMERA).holder_mask)


def at(x: float, y: float) -> tuple[int, int]:
    """Row and column of a point of the plate's upper face."""
    (pixel,) = np.round(CAMERA.project(np.array([[x, y, 5.0]]))).astype(int)
    return int(pixel[1]), int(pixel[0])


def test_a_finger_before_the_part_hides_it_and_what_is_near() -> None:
    mask = masked(20.0)
    assert mask[at(10, 0)]
    assert mask[at(10, 11)]
    assert not mask[at(-20, 0)]


def test_a_finger_behind_the_part_hides_nothing_of_it() -> None:
    mask = masked(-20.0)
    assert not mask[at(10, 0)]
    # beside the part it still stands before the panel
    assert mask[at(40, 0)]
    # wherever beside its place it stands, it is behind the part's border as well
    assert not mask[at(29, 0)]
