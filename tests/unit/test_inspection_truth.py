"""Lines of `cellctl inspect` against truth: places, sizes, rates."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

from inspection_rivals import best_line, laid_over
from inspection_truth import compare, is_at_place, judged, lower_limit, upper_limit

Words = dict[str, Any]
HOLE = {
    "id": "hole_1",
    "axis": [0.0, 0.0, 1.0],
    "nominal_d_mm": 6.5,
    "nominal_ends": [[20.0, 5.0, 10.0], [20.0, 5.0, 0.0]],
    "exists": True,
    "true_d_mm": 6.52,
    "true_ends": [[20.3, 5.4, 10.0], [20.3, 5.4, 0.0]],
}
TRUTH: Words = {
    "specimen": "s0001", "part": "plate", "cls": "defect", "kind": "hole_position",
    "size_mm": 0.5, "place_mm": [20.3, 5.4, 10.0], "faces": ["hole_1"], "dims": {},
    "visible_views": ["v00"], "scale": [1.001, 1.0, 1.0], "scale_about": [0, 0, 0],
    "holes": [HOLE], "poses": [],
}  # fmt: skip


def characteristic(kind: str, at: list[float], measured: float, **more: Any) -> Words:
    line: Words = {
        "event": "characteristic", "kind": kind, "p_part_mm": at, "axis": [0.0, 0.0, -1.0],
        "nominal_mm": 6.5, "measured_mm": measured, "U_mm": 0.05, "verdict": "fail",
    }  # fmt: skip
    return line | more


def finding(at: list[float], verdict: str = "fail", size: float = 1.0) -> Words:
    return {"event": "finding", "kind": "missing", "p_part_mm": at, "size_mm": size,
            "faces": [3], "verdict": verdict}  # fmt: skip


def end(verdict: str) -> Words:
    return {"event": "verdict", "verdict": verdict, "seconds": 6.0}


def test_none_of_59_is_below_five_percent_at_95() -> None:
    # the exact limit solves (1 - p)^n = 0.05
    assert upper_limit(0, 59) == pytest.approx(1 - 0.05 ** (1 / 59))
    assert upper_limit(0, 58) > 0.05 > upper_limit(0, 59)
    assert lower_limit(59, 59) == pytest.approx(0.05 ** (1 / 59))


def test_limits_of_a_rate_are_those_of_the_binomial_distribution() -> None:
    # with p at the limit, as few as seen (or fewer) come up once in twenty
    from scipy.stats import binom

    assert binom.cdf(3, 40, upper_limit(3, 40)) == pytest.approx(0.05)
    assert binom.sf(36, 40, lower_limit(37, 40)) == pytest.approx(0.05)


def test_a_diameter_is_compared_with_the_hole_that_it_is_of() -> None:
    (one,) = compare(TRUTH, [characteristic("diameter", [20.1, 5.0, 9.0], 6.50)])
    assert one.error_mm == pytest.approx(-0.02)
    assert compare(TRUTH, [characteristic("diameter", [30.0, 5.0, 9.0], 6.50)]) == []
    assert compare(TRUTH, [characteristic("diameter", [20.1, 5.0, 9.0], 9.0, nominal_mm=9.0)]) == []
    assert compare(TRUTH, [characteristic("diameter", [20.1, 5.0, 30.0], 6.50)]) == []


def test_a_position_is_compared_with_how_far_the_axis_is_off() -> None:
    (one,) = compare(TRUTH, [characteristic("position", [20.0, 5.0, 5.0], 0.47)])
    assert one.error_mm == pytest.approx(-0.03)


def test_a_distance_is_compared_with_the_scale_of_the_part() -> None:
    line = characteristic("distance", [0, 0, 0], 50.07, axis=[1.0, 0, 0], nominal_mm=50.0)
    (one,) = compare(TRUTH | {"cls": "good"}, [line])
    assert one.error_mm == pytest.approx(0.02)


def test_a_failed_characteristic_of_the_hole_is_at_the_right_place() -> None:
    assert is_at_place(TRUTH, characteristic("diameter", [20.0, 5.0, 0.0], 6.0))
    assert not is_at_place(TRUTH, characteristic("diameter", [-20.0, 5.0, 0.0], 6.0))


def test_a_finding_elsewhere_does_not_count_as_found() -> None:
    found = judged(TRUTH, [finding([21.0, 6.0, 3.0]), end("fail")], 6)
    missed = judged(TRUTH, [finding([-40.0, 6.0, 3.0]), end("fail")], 6)
    assert (found.is_found, found.elsewhere) == (True, 0)
    assert (missed.is_found, missed.elsewhere) == (False, 1)
    assert found.seconds == pytest.approx(1.0)


def test_what_is_left_open_at_the_place_is_a_hint() -> None:
    hinted = judged(TRUTH, [finding([21.0, 6.0, 3.0], "indeterminate"), end("indeterminate")], 6)
    assert (hinted.is_found, hinted.is_hinted, hinted.verdict) == (False, True, "indeterminate")


def test_a_command_without_a_verdict_is_an_error() -> None:
    assert judged(TRUTH, [], 6, "no such file").verdict == "error"


def test_a_wrong_part_is_found_wherever_it_is_said_to_be_wrong() -> None:
    mirrored = TRUTH | {"kind": "mirrored", "faces": []}
    assert judged(mirrored, [finding([90.0, 0.0, 0.0]), end("fail")], 6).is_found


def test_the_best_line_parts_what_can_be_parted() -> None:
    line = best_line(np.array([1.0, 2.0, 3.0, 8.0, 9.0]), np.array([False] * 3 + [True] * 2))
    assert 3.0 < line < 8.0


def test_a_moved_picture_is_laid_over_its_golden_view() -> None:
    rng = np.random.default_rng(1)
    import cv2

    golden = cv2.GaussianBlur(rng.uniform(0, 255, (300, 400)), (0, 0), 6).astype(np.float32)
    golden = (golden - golden.min()) / np.ptp(golden) * 200 + 10
    A = np.array([[0.999, -0.01, 4.0], [0.01, 0.999, -3.0]])  # noqa: N806
    picture = cv2.warpAffine(golden, A, (400, 300), borderMode=cv2.BORDER_REPLICATE) * 0.8
    laid, valid = laid_over(picture.astype(np.float32), golden)
    inner = np.s_[30:-30, 30:-30]
    assert valid[inner].all()
    assert np.abs(laid - golden)[inner].mean() < 2.0
