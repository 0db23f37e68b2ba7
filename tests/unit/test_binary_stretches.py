"""Stretches of outlines: found again wherever the outline lies, whatever the rest of it is."""

import numpy as np
import pytest

from controller.arrays import FloatArray
from controller.recognition.binary import like, observed_stretches, stretch_index

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
    views = stretch_index(outline(L, 192)[None].astype(np.float16)).by_length[0]
    seen = moved(outline(L, 800), turn_rad, (30.0, -12.0))
    everything = [np.ones(800, dtype=np.bool_)]
    known = [np.arange(800) < 400]
    observed = observed_stretches([seen], known, everything, LENGTH_MM, 1.0)
    mine, theirs = like(observed, views, 0.5, 1000)
    turn = observed.direction[mine] * views.direction[theirs].conj()
    shift = observed.middle[mine] - turn * views.middle[theirs]
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
    index = stretch_index(np.full((2, 192, 2), np.nan, dtype=np.float16))
    assert [len(stretches.middle) for stretches in index.by_length] == [0, 0]
