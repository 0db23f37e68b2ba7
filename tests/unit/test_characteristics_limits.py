"""General tolerances against cells of the standard's tables."""

from __future__ import annotations

from math import degrees

import pytest

from controller.inspection.characteristics.limits import (
    angle_tolerance_rad,
    linear_tolerance_mm,
    radius_tolerance_mm,
)


@pytest.mark.parametrize(
    ("size_mm", "f", "m", "c", "v"),
    [
        (0.5, 0.05, 0.1, 0.2, None),
        (3, 0.05, 0.1, 0.2, None),
        (3.01, 0.05, 0.1, 0.3, 0.5),
        (6, 0.05, 0.1, 0.3, 0.5),
        (30, 0.1, 0.2, 0.5, 1.0),
        (30.1, 0.15, 0.3, 0.8, 1.5),
        (400, 0.2, 0.5, 1.2, 2.5),
        (2500, None, 2.0, 4.0, 8.0),
    ],
)
def test_lengths(size_mm: float, f: float | None, m: float, c: float, v: float | None) -> None:
    assert linear_tolerance_mm(size_mm, "f") == f
    assert linear_tolerance_mm(size_mm, "m") == m
    assert linear_tolerance_mm(size_mm, "c") == c
    assert linear_tolerance_mm(size_mm, "v") == v


def test_a_size_a_rounding_above_a_row_belongs_to_the_row() -> None:
    assert linear_tolerance_mm(6 + 1e-9, "m") == 0.1


@pytest.mark.parametrize(("radius_mm", "m", "v"), [(2, 0.2, 0.4), (5, 0.5, 1.0), (20, 1.0, 2.0)])
def test_radii(radius_mm: float, m: float, v: float) -> None:
    assert radius_tolerance_mm(radius_mm, "m") == m
    assert radius_tolerance_mm(radius_mm, "v") == v


@pytest.mark.parametrize(
    ("side_mm", "m_deg", "c_deg"),
    [(10, 1, 1.5), (50, 0.5, 1), (120, 20 / 60, 0.5), (500, 5 / 60, 10 / 60)],
)
def test_angles(side_mm: float, m_deg: float, c_deg: float) -> None:
    assert degrees(angle_tolerance_rad(side_mm, "m")) == pytest.approx(m_deg)
    assert degrees(angle_tolerance_rad(side_mm, "c")) == pytest.approx(c_deg)
