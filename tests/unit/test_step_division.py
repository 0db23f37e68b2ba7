"""How finely solids of STEP files are divided: against formulas, and no finer than is of use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from step_bodies import BALL_MM, RING_MM, write_bodies
from step_files import needs_kernel

from controller.cad import Solid, load_solid

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
