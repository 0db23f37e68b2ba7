"""Classes of tolerance against cells of ISO 286-2's tables, and against its own rules."""

from __future__ import annotations

import pytest

from controller.inspection.characteristics.limits import fit_limits_mm


@pytest.mark.parametrize(
    ("nominal_mm", "fit", "lower_um", "upper_um"),
    [
        (20, "H7", 0, 21),
        (20, "g6", -20, -7),
        (20, "f7", -41, -20),
        (20, "E8", 40, 73),
        (20, "F8", 20, 53),
        (20, "D9", 65, 117),
        (20, "G7", 7, 28),
        (50, "h6", -16, 0),
        (50, "k6", 2, 18),
        (50, "m6", 9, 25),
        (50, "n6", 17, 33),
        (50, "p6", 26, 42),
        (50, "K7", -18, 7),
        (50, "M7", -25, 0),
        (50, "N7", -33, -8),
        (50, "P7", -42, -17),
        (50, "N9", -62, 0),
        (25, "js6", -6.5, 6.5),
        (25, "JS6", -6.5, 6.5),
        (300, "M6", -41, -9),
        (100, "H11", 0, 220),
        (3, "H7", 0, 10),
        (3.01, "H7", 0, 12),
        (500, "h14", -1550, 0),
    ],
)
def test_cells_of_the_tables(nominal_mm: float, fit: str, lower_um: float, upper_um: float) -> None:
    lower, upper = fit_limits_mm(fit, nominal_mm)
    assert (lower * 1000, upper * 1000) == pytest.approx((lower_um, upper_um))


@pytest.mark.parametrize("letter", ["d", "e", "f", "g", "h"])
@pytest.mark.parametrize("nominal_mm", [2, 17, 49, 121, 401])
def test_a_hole_is_the_mirror_image_of_the_shaft_below_the_nominal_size(
    letter: str, nominal_mm: float
) -> None:
    shaft, hole = (
        fit_limits_mm(f"{letter}8", nominal_mm),
        fit_limits_mm(f"{letter.upper()}8", nominal_mm),
    )
    assert hole == pytest.approx((-shaft[1], -shaft[0]))


@pytest.mark.parametrize("fit", ["", "7H", "H", "H99", "Q7", "Hh7", "js", "K5"])
def test_what_is_no_known_class_is_refused(fit: str) -> None:
    with pytest.raises(ValueError, match=r"class of tolerance|known are|not known here"):
        fit_limits_mm(fit, 20)


def test_beyond_the_tables_there_is_none() -> None:
    with pytest.raises(ValueError, match="up to 500 mm"):
        fit_limits_mm("H7", 501)
