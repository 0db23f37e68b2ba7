"""Lamps by their pictures: told from each other by their patterns, timed, judged for evenness."""

from __future__ import annotations

import numpy as np
import pytest

from controller.bring_up.steps.light import lights_of, panel_mask, surfaces_of
from controller.calibration.lamps import (
    PatternLamp,
    TooFewSamplesError,
    assign,
    evenness,
    expected_pattern,
    saturated_share,
    seconds_to_steady,
    seen_pattern,
)
from controller.config import load_cell
from controller.config.shipped import EMULATED_CELL
from controller.setup.optics import build_camera, panel_corners

CELL = load_cell(EMULATED_CELL)


def patterns() -> dict[str, np.ndarray]:
    surfaces = surfaces_of(CELL)
    return {light.name: expected_pattern(light, surfaces) for light in lights_of(CELL)}


def test_a_lamp_straight_above_lights_a_point_as_cosine_and_square_have_it() -> None:
    table, _ = surfaces_of(CELL)
    # 1 m over the table, under the middle of the overhead picture, and 0.5 m beside it
    above = expected_pattern(PatternLamp("a", np.array([[360.0, 0.0, 1000.0]])), (table,))
    high = expected_pattern(PatternLamp("b", np.array([[360.0, 0.0, 2000.0]])), (table,))
    # near the middle the light falls to a quarter at twice the height; fields are up to 0.2 m off
    assert above.max() / high.max() == pytest.approx(4.0, rel=0.1)
    assert (
        expected_pattern(PatternLamp("c", np.array([[360.0, 0.0, -50.0]])), (table,)) == 0
    ).all()


def test_every_lamp_is_told_from_the_others_in_noise_and_partial_shadow() -> None:
    rng = np.random.default_rng(77)
    expected = patterns()
    for _ in range(20):
        seen = {}
        for name, pattern in expected.items():
            shadow = rng.random(len(pattern)) < 0.1
            level = rng.uniform(0.5, 2.0) * pattern / pattern.max()
            seen[name] = np.where(shadow, 0.0, level) + rng.normal(0, 0.01, len(pattern))
        assert all(one.lit == one.switched for one in assign(seen, expected))


@pytest.mark.parametrize(
    ("a", "b"),
    [
        ("table_ring", "table_side"),
        ("table_backlight", "station_backlight"),
        ("station_ring", "station_side"),
        ("table_ring", "station_ring"),
    ],
)
def test_swapped_lamps_are_found_and_named(a: str, b: str) -> None:
    expected = patterns()
    seen = dict(expected) | {a: 30 * expected[b], b: 40 * expected[a]}
    found = {one.switched: one.lit for one in assign(seen, expected)}
    assert found == {name: name for name in expected} | {a: b, b: a}


def test_a_pattern_is_the_light_over_the_dark_field_by_field() -> None:
    dark = np.full((40, 40), 10, np.uint8)
    lit = dark.copy()
    lit[:10, 30:] = 110
    pattern = seen_pattern([lit, dark], [dark, dark])
    expected = np.zeros(32)
    expected[3] = 100.0
    np.testing.assert_allclose(pattern, expected)


def test_evenness_is_the_darkest_field_over_the_brightest_on_the_panel_alone() -> None:
    dark = np.full((256, 256), 5, np.uint8)
    lit = np.full((256, 256), 105, np.uint8)
    lit[64:128, 64:128] = 85
    lit[:, 192:] = 5  # beside the panel
    inside = np.ones((256, 256), bool)
    inside[:, 192:] = False
    assert evenness(lit, dark, inside) == pytest.approx(0.8)
    with pytest.raises(ValueError, match="wholly on the panel"):
        evenness(lit, dark, np.zeros((256, 256), bool))


def test_saturated_pixels_are_counted() -> None:
    picture = np.zeros((10, 10), np.uint8)
    picture[0, :3] = 255
    assert saturated_share(picture) == pytest.approx(0.03)


def test_a_ramp_is_steady_where_it_ends() -> None:
    delay_s = np.arange(0.0, 0.8, 0.01)
    light = 100 * np.clip(delay_s / 0.25, 0, 1)
    # the last sample below 98 % is at 0.24 s
    assert seconds_to_steady(delay_s, light) == pytest.approx(0.25, abs=0.0101)
    mixed = np.random.default_rng(3).permutation(len(delay_s))
    assert seconds_to_steady(delay_s[mixed], light[mixed]) == seconds_to_steady(delay_s, light)


def test_a_lamp_that_still_changes_is_not_steady() -> None:
    delay_s = np.linspace(0.0, 0.8, 20)
    with pytest.raises(TooFewSamplesError, match="still changes"):
        seconds_to_steady(delay_s, 100 * delay_s)
    with pytest.raises(TooFewSamplesError, match="too few"):
        seconds_to_steady(delay_s[:3], delay_s[:3])


def test_a_panels_mask_is_where_its_middle_is_and_not_all_of_the_picture() -> None:
    camera = build_camera(CELL.cameras.inspection)
    mask = panel_mask(camera, panel_corners(CELL, "station_backlight"))
    (u, v) = camera.project(panel_corners(CELL, "station_backlight").mean(axis=0)[None])[0]
    assert mask[round(v), round(u)]
