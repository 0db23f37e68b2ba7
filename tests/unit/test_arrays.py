"""Sums over short axes, and medians: NumPy's own values to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from controller.arrays import inner, lengths, median

RNG = np.random.default_rng(7)


@pytest.mark.parametrize("shape", [(500, 3), (500, 2), (20, 30, 3)])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_products_and_lengths_are_those_of_numpy(shape: tuple[int, ...], kind: type) -> None:
    a, b = (RNG.normal(size=shape).astype(kind) for _ in range(2))
    assert np.array_equal(inner(a, b), (a * b).sum(axis=-1))
    assert np.array_equal(lengths(a), np.linalg.norm(a, axis=-1))
    assert inner(a, b).dtype == kind


@pytest.mark.parametrize("count", [1, 2, 3, 10, 501, 1000])
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_medians_are_those_of_numpy(count: int, kind: type) -> None:
    values = RNG.normal(size=count).astype(kind)
    assert median(values) == float(np.median(values))
