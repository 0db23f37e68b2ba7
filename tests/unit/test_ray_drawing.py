"""Drawings by rays: what each ray meets, where neighbours differ, what comes out at the end."""

from __future__ import annotations

import base64

import cv2
import numpy as np
import pytest
from cad_solids import box, mesh_of

from controller.imaging import RayCaster
from controller.results.ray_drawing import FINER, cast, jumps, png_uri, smaller


def test_rays_from_one_point_and_parallel_ones_meet_a_box_where_it_is() -> None:
    caster = RayCaster(mesh_of(box(40, 20, 10)))
    x, y = np.meshgrid([-30.0, 0.5, 19.5], [0.25, 9.5])  # width 3, height 2; off the diagonals
    origins = np.stack([x.ravel(), y.ravel(), np.full(6, 100.0)], axis=1)
    triangle, distance = cast(caster, origins, np.array([[0.0, 0.0, -1.0]]), (3, 2))
    assert triangle.shape == distance.shape == (2, 3)
    assert (triangle[:, 0] == -1).all()
    assert np.isinf(distance[:, 0]).all()
    assert distance[:, 1:] == pytest.approx(95.0)
    eye = np.array([[0.0, 0.0, 100.0]])
    again, reach = cast(caster, eye, origins * [1, 1, 0] + [0, 0, 5.0] - eye, (3, 2))
    assert np.array_equal(again >= 0, triangle >= 0)
    assert reach[:, 1:] == pytest.approx(1.0)
    ways = origins * [1, 1, 0] + [0, 0, 5.0] - eye
    assert np.array_equal(caster.blocked(eye, ways), again.ravel() >= 0)
    assert not caster.blocked(eye, ways, 0.99).any()


def test_neighbours_differ_where_the_numbers_do_and_nowhere_else() -> None:
    rng = np.random.default_rng(5)
    triangle = rng.integers(-1, 2, (9, 7)).astype(np.int32)
    found = set()
    for here, there in jumps(triangle):
        for a, b in zip(zip(*here, strict=True), zip(*there, strict=True), strict=True):
            found.add((*map(int, a), *map(int, b)))
    expected = {
        (r, c, r + dr, c + dc)
        for r in range(9)
        for c in range(7)
        for dr, dc in ((1, 0), (0, 1))
        if r + dr < 9 and c + dc < 7 and triangle[r, c] != triangle[r + dr, c + dc]
    }
    assert found == expected


def test_a_drawing_is_shown_as_the_mean_of_its_rays() -> None:
    fine = np.random.default_rng(6).uniform(0, 255, (4 * FINER, 3 * FINER)).astype(np.float32)
    blocks = fine.reshape(4, FINER, 3, FINER).mean(axis=(1, 3))
    np.testing.assert_allclose(smaller(fine), blocks, atol=1e-3)


def test_a_picture_comes_back_from_its_data_uri() -> None:
    image = np.random.default_rng(7).integers(0, 256, (5, 8, 3)).astype(np.uint8)
    head, _, body = png_uri(image, compression=6).partition(",")
    assert head == "data:image/png;base64"
    data = np.frombuffer(base64.b64decode(body), dtype=np.uint8)
    assert np.array_equal(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), image)
