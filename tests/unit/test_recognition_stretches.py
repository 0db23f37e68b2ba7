"""Stretches of outlines: found again wherever the outline lies, whatever the rest of it is."""

import numpy as np
import pytest

from controller.arrays import FloatArray
from controller.recognition.stretches import (
    MAX_ALIKE,
    Stretches,
    ViewStretches,
    like,
    observed_stretches,
    view_stretches,
)

LENGTH_MM = 16.0


def outline(corners: FloatArray, count: int) -> FloatArray:
    """Return points at equal steps along a polygon."""
    closed = np.concatenate([corners, corners[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.arange(count) * along[-1] / count
    return np.column_stack([np.interp(at, along, closed[:, k]) for k in (0, 1)])


# An L of 60 x 40 mm, 20 mm wide, anticlockwise
L = np.array([[0, 0], [60, 0], [60, 20], [20, 20], [20, 40], [0, 40]], dtype=np.float64)


def moved(points: FloatArray, turn_rad: float, shift: tuple[float, float]) -> FloatArray:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    return points @ np.array([[c, s], [-s, c]]) + shift


@pytest.mark.parametrize("turn_rad", [0.0, 0.7, -2.4])
def test_stretches_of_an_outline_half_gone_propose_where_it_lies(turn_rad: float) -> None:
    views = view_stretches(outline(L, 192)[None].astype(np.float16))[0]
    seen = moved(outline(L, 800), turn_rad, (30.0, -12.0))
    everything = [np.ones(800, dtype=np.bool_)]
    known = [np.arange(800) < 400]
    observed = observed_stretches([seen], known, everything, LENGTH_MM, 1.0)
    mine, theirs = like(observed, views, 0.5, 1000)
    found = views.stretches
    turn = observed.direction[mine] * found.direction[theirs].conj()
    shift = observed.middle[mine] - turn * found.middle[theirs]
    # near enough for a fit that looks 5 mm about
    right = (np.abs(np.angle(turn * np.exp(-1j * turn_rad))) < 0.1) & (
        np.abs(shift - (30.0 - 12.0j)) < 4.0
    )
    # two corners are seen whole, and five of the six are alike: of ten pairs two are right
    assert right.sum() >= 2
    assert len(right) < 20


def test_straight_stretches_are_left_out() -> None:
    square = np.array([[0, 0], [100, 0], [100, 100], [0, 100]], dtype=np.float64)
    seen = outline(square, 1600)
    every = [np.ones(1600, dtype=np.bool_)]
    observed = observed_stretches([seen], every, every, LENGTH_MM, 1.0)
    corner_mm = np.abs(
        np.stack([observed.middle.real, observed.middle.imag], axis=1)[:, None] - square
    ).max(axis=2)
    assert 0 < len(observed.middle) < 4 * LENGTH_MM + 4
    assert corner_mm.min(axis=1).max() < LENGTH_MM


def test_stretches_that_are_not_the_parts_own_or_explained_already_are_left_out() -> None:
    seen = outline(L, 800)
    every, none = [np.ones(800, dtype=np.bool_)], [np.zeros(800, dtype=np.bool_)]
    assert len(observed_stretches([seen], every, every, LENGTH_MM, 1.0).middle) > 0
    assert len(observed_stretches([seen], none, every, LENGTH_MM, 1.0).middle) == 0
    assert len(observed_stretches([seen], every, none, LENGTH_MM, 1.0).middle) == 0


def test_views_without_an_outline_have_no_stretches() -> None:
    every_length = view_stretches(np.full((2, 192, 2), np.nan, dtype=np.float16))
    assert [len(views.stretches.middle) for views in every_length] == [0, 0]
    seen = outline(L, 800)
    every = [np.ones(800, dtype=np.bool_)]
    observed = observed_stretches([seen], every, every, LENGTH_MM, 1.0)
    assert [len(pairs) for pairs in like(observed, every_length[0], 0.5, 1000)] == [0, 0]


def blobs(count: int, size_mm: float) -> FloatArray:
    """Return round outlines (count, 192, 2) with ripples of their own."""
    rng = np.random.default_rng(8)
    turns = np.linspace(0, 2 * np.pi, 192, endpoint=False)
    harmonics = np.arange(2, 9)
    phases = rng.uniform(0, 6.3, (count, 7, 1))
    ripples = np.cos(harmonics[None, :, None] * turns + phases)
    sizes = rng.normal(0.0, size_mm, (count, 7)) / harmonics
    radius = 25.0 + np.einsum("vh,vht->vt", sizes, ripples)
    return radius[..., None] * np.column_stack([np.cos(turns), np.sin(turns)])


def distances(
    outline_mm: FloatArray, views: ViewStretches
) -> tuple[Stretches, FloatArray, FloatArray]:
    """Return an outline's stretches, their distances from a library's, and those of the nearest.

    The nearest is that of neighbours along the outline; elsewhere the distance is inf.
    """
    every = [np.ones(len(outline_mm), dtype=np.bool_)]
    observed = observed_stretches([outline_mm], every, every, LENGTH_MM, 1.0)
    a, b = observed.shape.astype(np.float64), views.stretches.shape.astype(np.float64)
    far = np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2))
    padded = np.pad(far, ((1, 1), (0, 0)), constant_values=np.inf)
    return observed, far, np.where((far <= padded[:-2]) & (far <= padded[2:]), far, np.inf)


def test_every_pair_that_is_alike_is_returned_once_of_neighbours() -> None:
    outlines = blobs(30, 12.0)
    views = view_stretches(outlines.astype(np.float16))[0]
    observed, far, best = distances(outlines[7], views)
    assert (far < 0.5).sum(axis=1).max() < MAX_ALIKE  # or some would be left out
    expected = set(zip(*(at.tolist() for at in np.nonzero(best < 0.5)), strict=True))
    mine, theirs = like(observed, views, 0.5, 10**6)
    found = set(zip(mine.tolist(), theirs.tolist(), strict=True))
    # rounding may decide otherwise between two that are as near
    assert len(expected) > 50
    assert len(expected ^ found) <= 0.01 * len(expected)


def test_of_very_many_pairs_the_most_alike_are_returned() -> None:
    outlines, most = blobs(300, 2.0), 60
    views = view_stretches(outlines.astype(np.float16))[0]
    observed, far, best = distances(outlines[7], views)
    mine, theirs = like(observed, views, 1.5, most)
    assert (best < 1.5).sum() > 20 * most  # or there was nothing to choose among
    assert len(mine) == most
    # rounding may decide otherwise between two that are as near
    assert far[mine, theirs].max() < np.sort(best, axis=None)[most] + 1e-3
