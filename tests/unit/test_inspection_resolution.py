"""Resolution that a face needs: enough for a defect, and for the strips beside its edges."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from cad_solids import box, solid_of
from shown_part import CAMERA, task

from controller.cad import Solid, inner_mm, sample_surface
from controller.inspection import (
    PosedPart,
    inspect_view,
    needed_px_per_mm,
    predict_pictures,
)

SMALLEST_MM = 3.0
PIXEL_MM = CAMERA.mm_per_px(np.zeros(3))


def bar(height_mm: float) -> Solid:
    return solid_of(box(40, 30, height_mm), f"bar {height_mm}")


def wall(solid: Solid) -> int:
    """The long side that is turned to the camera."""
    return min(solid.faces, key=lambda face: float(face.centre_mm[1])).id


def test_the_largest_disc_on_a_face() -> None:
    inner = inner_mm(solid_of(box(30, 20, 4)))
    # half the shorter side, which random points reach to some per cent
    assert sorted(inner) == pytest.approx([2, 2, 2, 2, 10, 10], rel=0.1)
    assert (inner <= np.array([10, 10, 2, 2, 2, 2]) + 1e-9).all()


@pytest.mark.parametrize("height_mm", [4.6, 5.0, 5.4])
def test_strips_beside_edges_leave_half_of_a_low_wall(height_mm: float) -> None:
    solid = bar(height_mm)
    needed = needed_px_per_mm(solid, SMALLEST_MM, PIXEL_MM)[wall(solid)]
    cosine = needed * PIXEL_MM
    # 0.3 mm of play and two pixels of blur beside either edge, wider on a wall seen aslant
    strips_mm = 2 * (0.3 + 2.0 * PIXEL_MM) / cosine
    assert strips_mm == pytest.approx(0.5 * height_mm, rel=0.1)


@pytest.mark.parametrize("height_mm", [2.0, 4.0, 8.0, 20.0])
def test_a_high_wall_needs_what_a_defect_needs_and_a_narrow_one_no_more(height_mm: float) -> None:
    solid = bar(height_mm)
    needed = needed_px_per_mm(solid, SMALLEST_MM, PIXEL_MM)[wall(solid)]
    assert needed == pytest.approx(7.0 / SMALLEST_MM)


@pytest.mark.parametrize("height_mm", [4.7, 5.2])
def test_in_a_view_with_that_resolution_most_of_a_low_wall_is_compared(height_mm: float) -> None:
    solid = bar(height_mm)
    part, samples = PosedPart(solid), sample_surface(solid)
    cosine = needed_px_per_mm(solid, SMALLEST_MM, PIXEL_MM)[wall(solid)] * PIXEL_MM

    def compared(cosine: float) -> float:
        tilt = np.arccos(cosine)
        T = np.eye(4)
        T[:3, :3] = cv2.Rodrigues(np.array([-tilt, 0.0, 0.0]))[0]
        T[:3, 3] = -T[:3, :3] @ solid.centroid_mm
        asked = replace(task(T, ()), is_hold_measured=True)
        found = inspect_view(part, samples, asked, predict_pictures(part, asked))
        mine = samples.face_ids == wall(solid)
        return float(found.compared[mine].mean())

    assert compared(cosine) > 0.5
    assert compared(0.6 * cosine) < 0.5
