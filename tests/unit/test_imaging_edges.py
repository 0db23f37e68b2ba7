"""Steps along rays, against pictures whose grey levels are integrals known on paper."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr

from controller.arrays import FloatArray, Grey
from controller.imaging import blur_shift_px, measure_edges, measure_sloped_edges

DARK, BRIGHT = 40.0, 200.0


def blurred_step(at: FloatArray, width: float) -> FloatArray:
    """The integral of a Gaussian step: its difference over a pixel is what the pixel collects."""
    z = at / width
    return at * ndtr(z) + width * np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)


def upright_edge(place: float, psf: float = 0.8, size: int = 60) -> FloatArray:
    """A picture dark to the left of x = place, exact for a Gaussian lens and square pixels."""
    x = np.arange(size)
    share = blurred_step(x + 0.5 - place, psf) - blurred_step(x - 0.5 - place, psf)
    return np.broadcast_to(DARK + (BRIGHT - DARK) * share, (size, size))


def slanted_edge(angle: float, psf: float, size: int = 60) -> FloatArray:
    """A picture dark on one side of a line through its middle, by 15 x 15 points a pixel."""
    fine = (np.arange(15) + 0.5) / 15 - 0.5
    y, x = np.mgrid[0:size, 0:size]
    total = np.zeros((size, size))
    for dy in fine:
        far = (y + dy - size / 2) * np.sin(angle)
        for dx in fine:
            total += ndtr(((x + dx - size / 2) * np.cos(angle) + far) / psf)
    return DARK + (BRIGHT - DARK) * total / 225


def grey(levels: FloatArray, noise: float = 0.0, seed: int = 1) -> Grey:
    rng = np.random.default_rng(seed)
    return np.clip(np.round(levels + rng.normal(0, noise, levels.shape)), 0, 255).astype(np.uint8)


def row_rays(x: float, count: int = 30) -> tuple[FloatArray, FloatArray]:
    origins = np.column_stack([np.full(count, x), 12.0 + np.arange(count)])
    return origins, np.tile([1.0, 0.0], (count, 1))


@pytest.mark.parametrize("place", [30.0, 30.13, 30.37, 30.5, 30.81])
@pytest.mark.parametrize("psf", [0.6, 0.9, 1.4])
def test_an_upright_edge_is_where_it_was_drawn(place: float, psf: float) -> None:
    origins, directions = row_rays(30.2)
    # a little noise, or rounding would be the same in all rows
    fits = measure_edges(grey(upright_edge(place, psf), 0.7), origins, directions, 3.0)
    assert fits.offset_px.mean() == pytest.approx(place - 30.2, abs=0.006)
    # lens and pixel together: variances add, a box of one has a twelfth
    assert fits.width_px.mean() == pytest.approx(np.sqrt(psf**2 + 1 / 12), rel=0.07)
    assert fits.contrast.mean() == pytest.approx(BRIGHT - DARK, rel=0.02)
    assert fits.level.mean() == pytest.approx(DARK, abs=1.0)


@pytest.mark.parametrize("angle", np.radians([11.0, 30.0, 45.0, 200.0]))
def test_a_slanted_edge_is_where_it_was_drawn(angle: float) -> None:
    picture = grey(slanted_edge(angle, 0.8))
    across = np.array([np.cos(angle), np.sin(angle)])
    along = np.array([-across[1], across[0]])
    origins = 30.0 + np.linspace(-12, 12, 40)[:, None] * along + 0.4 * across
    fits = measure_edges(picture, origins, np.tile(across, (40, 1)), 3.0)
    assert fits.offset_px.mean() == pytest.approx(-0.4, abs=0.003)
    assert fits.offset_px.std() < 0.01


def test_the_standard_error_is_what_many_pictures_scatter_by() -> None:
    origins, directions = row_rays(30.0)
    off, expected = [], []
    for seed in range(40):
        picture = grey(upright_edge(30.37), 2.0, seed)
        fits = measure_edges(picture, origins, directions, 3.0, noise=2.0)
        off.append(fits.offset_px - 0.37)
        expected.append(fits.sigma_px)
    assert abs(np.mean(off)) < 0.003
    # 1200 rays: their scatter is known to 2 %, rounding and neighbours let it be some more
    assert np.std(off) == pytest.approx(np.mean(expected), rel=0.15)


@pytest.mark.parametrize("is_hole", [False, True])
@pytest.mark.parametrize(("radius", "psf"), [(8.0, 0.8), (20.0, 1.2)])
def test_a_round_edge_needs_its_curvature(radius: float, psf: float, is_hole: bool) -> None:
    size = int(2 * radius + 24)
    fine = (np.arange(size * 12) + 0.5) / 12 - 0.5
    centre = size / 2 + np.array([0.21, -0.34])
    far = np.hypot(fine[None] - centre[0], fine[:, None] - centre[1])
    # the lens blurs with a Gaussian, here by its Fourier transform; the pixel is a mean of 12 x 12
    cover = np.clip((radius - far) * 12 + 0.5, 0, 1)
    frequency = np.fft.fftfreq(len(fine)) * 12
    lens = np.exp(-2 * (np.pi * psf * frequency) ** 2)
    cover = np.fft.ifft2(np.fft.fft2(cover) * lens * lens[:, None]).real
    share = cover.reshape(size, 12, size, 12).mean(axis=(1, 3))
    levels = DARK + (BRIGHT - DARK) * (share if is_hole else 1 - share)
    angle = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    out = np.column_stack([np.cos(angle), np.sin(angle)])
    rising = np.full(300, -1.0 if is_hole else 1.0)
    fits = measure_edges(grey(levels), centre + radius * out, out, 3.0, rising=rising)
    shrunk = -0.5 * (psf**2 + 1 / 12) / radius
    assert fits.offset_px.mean() == pytest.approx(shrunk, rel=0.15)
    back = fits.offset_px + blur_shift_px(fits.width_px, 1 / radius)
    assert abs(back.mean()) < 0.003


def test_of_two_steps_the_one_of_the_right_sign_is_taken() -> None:
    levels = upright_edge(26.0) + (DARK - BRIGHT) * (upright_edge(34.0) - DARK) / (BRIGHT - DARK)
    origins, directions = row_rays(30.0)
    up = measure_edges(grey(levels), origins, directions, 6.0, rising=np.ones(30))
    down = measure_edges(grey(levels), origins, directions, 6.0, rising=-np.ones(30))
    assert up.offset_px == pytest.approx(-4.0, abs=0.02)
    assert down.offset_px == pytest.approx(4.0, abs=0.02)


def test_the_nearer_of_two_alike_is_taken() -> None:
    levels = 0.5 * (upright_edge(28.0) + upright_edge(38.0))
    origins, directions = row_rays(30.0)
    fits = measure_edges(grey(levels), origins, directions, 9.0)
    assert fits.offset_px == pytest.approx(-2.0, abs=0.02)


def test_where_nothing_is_nothing_is_found() -> None:
    origins, directions = row_rays(30.0)
    flat = grey(np.full((60, 60), 90.0), 2.0)
    fits = measure_edges(flat, origins, directions, 3.0, noise=2.0)
    significant = np.abs(fits.contrast) > 12
    assert not (fits.is_found & significant).any()


def test_a_step_beyond_reach_or_picture_is_not_found() -> None:
    picture = grey(upright_edge(36.0))
    origins, directions = row_rays(30.0)
    assert not measure_edges(picture, origins, directions, 3.0).is_found.any()
    near_border = grey(upright_edge(2.0))
    at_border, _ = row_rays(2.0)
    assert not measure_edges(near_border, at_border, directions, 2.0).is_found.any()
    assert not measure_edges(picture, origins - 500.0, directions, 2.0).is_found.any()


def test_burnt_samples_are_counted() -> None:
    origins, directions = row_rays(30.0)
    bright = grey(upright_edge(30.0) * 2)
    burnt = measure_edges(bright, origins, directions, 3.0).burnt
    assert (burnt > 0.3).all()
    assert (measure_edges(grey(upright_edge(30.0)), origins, directions, 3.0).burnt == 0).all()


@pytest.mark.parametrize("foot", [0.0, 40.0, 80.0])
def test_an_edge_in_a_corner_lit_by_its_own_walls_is_where_it_was_drawn(foot: float) -> None:
    """On the dark side the light rises towards the corner, twice as much every 3 pixels."""
    place, psf, fine = 30.13, 0.6, 40
    x = (np.arange(60 * fine) + 0.5) / fine - 0.5
    dark = DARK + foot * np.exp((x - place) * np.log(2) / 3.0)
    sharp = np.where(x < place, dark, BRIGHT)
    blurred = gaussian_filter1d(sharp, psf * fine, mode="nearest")
    levels = np.broadcast_to(blurred.reshape(60, fine).mean(axis=1), (60, 60))
    picture = grey(levels, 0.7)
    origins, directions = row_rays(30.2)
    level = measure_edges(picture, origins, directions, 3.0, 0.7)
    width = float(np.sqrt(psf**2 + 1 / 12))
    found = measure_sloped_edges(picture, origins, directions, level, width, 0.7)
    assert found.offset_px.mean() == pytest.approx(place - 30.2, abs=0.05)
    # with level sides a steep foot is taken for a part of the step
    if foot == 80.0:
        assert level.offset_px.mean() < place - 30.2 - 0.15
    scatter = found.offset_px.std()
    assert 0.4 * scatter < np.median(found.sigma_px) < 0.1


def test_no_rays_are_no_fits() -> None:
    nothing = np.zeros((0, 2))
    fits = measure_edges(grey(upright_edge(30.0)), nothing, nothing, 3.0)
    assert len(fits.offset_px) == 0


@pytest.mark.parametrize("width", [3.0, 4.0, 6.0])
def test_a_narrow_shadow_beside_an_edge_does_not_draw_it(width: float) -> None:
    # bright face, a shadow some pixels wide, a bright floor beyond it
    levels = BRIGHT - (upright_edge(30.0) - DARK) + 0.8 * (upright_edge(30.0 + width) - DARK)
    origins, directions = row_rays(30.3)
    fits = measure_edges(grey(levels, 1.0), origins, directions, 2.0, 1.0, -np.ones(30))
    assert fits.offset_px.mean() == pytest.approx(-0.3, abs=0.06)


@pytest.mark.parametrize("ray", [1.0, -1.0])
def test_where_a_profile_leads_back_is_told(ray: float) -> None:
    # bright up to x = 30, dark for 2.5 px, bright again: from the left it leads back beyond it
    line = BRIGHT - (upright_edge(30.0) - DARK) + 0.8 * (upright_edge(32.5) - DARK)
    origins, directions = row_rays(30.0)
    for levels, back in ((line, ray), (upright_edge(30.0), 0.0)):
        fits = measure_edges(grey(levels, 1.0), origins, ray * directions, 1.5, 1.0)
        assert np.median(fits.back) == back
