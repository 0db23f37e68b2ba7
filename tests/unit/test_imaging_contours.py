"""Outlines to a fraction of a pixel, on discs whose radius is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from controller.arrays import FloatArray, Grey
from controller.imaging import (
    Contour,
    loop_normals,
    signed_area,
    subpixel_contour,
    threshold_levels,
)

SIZE_PX, FINER = 260, 8
RING = (np.array([90.13, 84.4]), 61.3, 22.7)  # where, radius, radius of its hole
DISC = (np.array([205.6, 201.2]), 31.9)
DARK, BRIGHT = 20.0, 180.0


def picture(noise: float) -> Grey:
    """A ring and a disc before a bright ground, as a lens and its pixels see them."""
    at = (np.arange(SIZE_PX * FINER) + 0.5) / FINER - 0.5
    far = [np.hypot(at[None] - c[0], at[:, None] - c[1]) for c in (RING[0], DISC[0])]
    dark = ((far[0] < RING[1]) & (far[0] > RING[2])) | (far[1] < DISC[1])
    fine = np.where(dark, DARK, BRIGHT).astype(np.float32)
    image = cv2.resize(fine, (SIZE_PX, SIZE_PX), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    image = image + np.random.default_rng(4).normal(0.0, noise, image.shape)
    return np.clip(np.round(image), 0, 255).astype(np.uint8)


def near(found: Contour, centre: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
    """Distances from a centre of the points about so far from it; cosines of their normals."""
    away = found.points_px - centre
    far = np.hypot(*away.T)
    mine = np.abs(far - radius) < 3.0
    return far[mine], (away * found.normals).sum(axis=1)[mine] / far[mine]


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_outlines_are_right_to_a_fraction_of_a_pixel_and_look_at_the_ground(noise: float) -> None:
    found = subpixel_contour(picture(noise), 0.5 * (DARK + BRIGHT))
    circles = ((RING[0], RING[1], 1.0), (RING[0], RING[2], -1.0), (DISC[0], DISC[1], 1.0))
    for centre, radius, side in circles:
        far, turn = near(found, centre, radius)
        assert far.mean() == pytest.approx(radius, abs=0.02)
        assert far.std() < 0.05
        assert len(far) == pytest.approx(2 * np.pi * radius, rel=0.01)  # a point a pixel
        assert (side * turn).min() > 0.95
    assert len(found.points_px) == sum(len(near(found, c, r)[0]) for c, r, _ in circles)


def test_an_even_picture_has_no_outline() -> None:
    assert len(subpixel_contour(np.full((40, 50), 200, np.uint8), 100.0).points_px) == 0


def test_normals_look_out_of_a_loop_of_positive_area() -> None:
    turn = np.linspace(0.0, 2 * np.pi, 300, endpoint=False)
    loop = 40.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    assert signed_area(loop) == pytest.approx(np.pi * 40.0**2, rel=1e-3)
    assert (loop_normals(loop) * loop).sum(axis=1) == pytest.approx(40.0, rel=1e-3)
    assert signed_area(loop[::-1]) == pytest.approx(-signed_area(loop))


@pytest.mark.parametrize("seed", range(6))
def test_the_two_levels_are_medians_of_what_lies_on_either_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    share = (0.002, 0.4, 0.9)[seed % 3]  # that the dark object takes of the picture
    grey = np.where(rng.random((60, 80)) < share, rng.normal(DARK, 6, (60, 80)), 0.0)
    grey = np.where(grey > 0, grey, rng.normal(BRIGHT, 6, (60, 80)))
    image = np.clip(np.round(grey), 0, 255).astype(np.uint8)
    inside = rng.random(image.shape) < 0.8
    low, half, high = threshold_levels(image, inside)
    values = image[inside]
    # by its levels nothing is near the middle, wherever between the two the cut lies
    assert low == float(np.median(values[values < 100]))
    if share > 0.1:  # of a few dark pixels the ground's median may be all pixels'
        assert high == float(np.median(values[values > 100]))
    assert half == 0.5 * (low + high)
