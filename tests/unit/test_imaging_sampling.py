"""Values of a picture between its pixels, at any number of places."""

import cv2
import numpy as np
import pytest

from controller.imaging import sample_picture


@pytest.mark.parametrize("shape", [(50, 3), (40_000, 2), (2, 40_000), (1, 70_001)])
def test_a_plane_is_read_as_it_is_at_any_number_of_places(shape: tuple[int, int]) -> None:
    v, u = np.mgrid[0:60, 0:80].astype(np.float32)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(0, 79, shape), rng.uniform(0, 59, shape)
    values = sample_picture(2.0 * u - 3.0 * v, x, y)
    assert values.shape == shape
    # OpenCV places a sample to the 32nd of a pixel
    assert np.abs(values - (2.0 * x - 3.0 * y)).max() <= (2.0 + 3.0) / 64 + 1e-3


def test_beyond_the_picture_stands_what_was_asked_for() -> None:
    bright = np.full((20, 20), 9.0, dtype=np.float32)
    outside = np.array([[-5.0]]), np.array([[-5.0]])
    assert sample_picture(bright, *outside)[0, 0] == 0.0
    assert sample_picture(bright, *outside, border=cv2.BORDER_REPLICATE)[0, 0] == 9.0
