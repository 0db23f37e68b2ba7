"""Objects under lamps on a matt table: bright tops, dark walls, shadows, holes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from segmentation_pictures import Shape, bar, coverage, disc, fading, picture, ring

from controller.recognition.segmentation import segment

SIZE = (480, 384)


def shaded(ground: np.ndarray, shape: Shape, depth: float, width_px: float) -> np.ndarray:
    """Return a ground with the soft shadow of a thing, its depth a share of the level."""
    share = cv2.GaussianBlur(coverage(shape, SIZE), (0, 0), width_px)
    return ground * (1 - depth * share)


def textured(level: float, share: float, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = cv2.resize(rng.normal(0, share, (8, 10)), SIZE, interpolation=cv2.INTER_CUBIC)
    return fading(level, 0.25, SIZE) * (1 + coarse)


def test_a_bright_thing_on_a_textured_table_is_found_without_its_shadow() -> None:
    thing = bar(240, 190, 150, 90, 0.3)
    ground = shaded(textured(40, 0.03), bar(244, 195, 160, 100, 0.3), 0.5, 12)
    result = segment(picture([(thing, 150)], ground, SIZE, noise=0.5))
    assert result.lighting == "front"
    assert len(result.regions) == 1
    assert result.regions[0].area_px == pytest.approx(150 * 90, rel=0.004)


def test_dark_walls_that_end_sharply_belong_to_the_thing() -> None:
    ground = shaded(textured(45, 0.02), bar(240, 190, 200, 120), 0.3, 14)
    layers = [(bar(240, 190, 180, 100), 22.0), (bar(225, 190, 150, 100), 140.0)]
    region = segment(picture(layers, ground, SIZE, noise=0.5)).regions[0]
    assert region.area_px == pytest.approx(180 * 100, rel=0.01)


def test_the_bright_part_alone_is_among_the_alternatives() -> None:
    layers = [(bar(240, 190, 180, 100), 22.0), (bar(225, 190, 150, 100), 140.0)]
    region = segment(picture(layers, textured(45, 0.02), SIZE, noise=0.5)).regions[0]
    areas = [float(mask.sum()) for mask in region.alternatives]
    assert any(a == pytest.approx(150 * 100, rel=0.02) for a in areas)
    assert all(mask.shape == region.mask.shape for mask in region.alternatives)


def test_holes_through_which_the_table_is_seen_stay_open() -> None:
    thing = ring(240, 190, 80, 40)
    region = segment(picture([(thing, 120)], textured(40, 0.03), SIZE, noise=0.5)).regions[0]
    assert len(region.loops_px) == 2
    assert region.area_px == pytest.approx(np.pi * (80**2 - 40**2), rel=0.006)


def test_a_thing_darker_than_the_table_is_found_too() -> None:
    thing = bar(240, 190, 150, 90, 0.3)
    result = segment(picture([(thing, 70)], textured(110, 0.02), SIZE, noise=0.7), "front")
    assert [r.area_px for r in result.regions] == [pytest.approx(150 * 90, rel=0.006)]


def test_a_soft_shadow_alone_is_nothing() -> None:
    ground = shaded(textured(50, 0.03), disc(240, 190, 60), 0.5, 14)
    assert segment(picture([], ground, SIZE, noise=0.5), "front").regions == ()


def test_several_things_are_told_apart_and_the_cut_one_is_flagged() -> None:
    layers = [
        (disc(120, 120, 50), 130.0),
        (bar(300, 120, 100, 60, 1.0), 90.0),
        (bar(240, 384, 80, 60), 160.0),
    ]
    result = segment(picture(layers, textured(35, 0.02), SIZE, noise=0.5))
    assert [r.touches_edge for r in result.regions] == [False, False, True]
    assert result.regions[0].area_px == pytest.approx(np.pi * 50**2, rel=0.005)


def test_bright_tops_that_saturate_leave_the_light_front() -> None:
    layers = [(bar(200, 190, 200, 140), 400.0)]
    result = segment(picture(layers, textured(30, 0.02), SIZE, noise=0.5))
    assert result.lighting == "front"
    assert len(result.regions) == 1


PLAIN = picture([(ring(200, 170, 70, 30), 110.0)], 40.0, SIZE)


@settings(max_examples=10, deadline=None)
@given(gain=st.floats(0.6, 2.0))
def test_outlines_do_not_depend_on_brightness(gain: float) -> None:
    before, after = (segment(p).regions for p in (PLAIN, np.round(PLAIN * gain).astype(np.uint8)))
    assert len(before) == len(after) == 1
    assert after[0].area_px == pytest.approx(before[0].area_px, rel=0.006)
    assert len(after[0].loops_px) == 2


def test_rounding_to_few_levels_makes_no_things_of_a_dark_tables_grain() -> None:
    grain = cv2.GaussianBlur(np.random.default_rng(5).normal(size=SIZE[::-1]), (0, 0), 25, sigmaY=2)
    ground = 9.0 + 1.2 * np.clip(grain / grain.std(), -2.5, 2.5)
    fine = picture([(bar(240, 190, 150, 90, 0.3), 70)], ground, SIZE, noise=0.3)
    few = (4 * np.round(fine * 63.0 / 255.0)).astype(np.uint8)
    assert len(np.unique(few[:100])) > 1  # the grain shows, as steps
    result = segment(few, "front")
    assert [r.area_px for r in result.regions] == [pytest.approx(150 * 90, rel=0.02)]


def test_a_black_table_hides_nothing_that_is_brighter() -> None:
    thing = bar(240, 190, 150, 90, 0.3)
    result = segment(picture([(thing, 40)], textured(5, 0.02), SIZE, noise=0.3), "front")
    assert [r.area_px for r in result.regions] == [pytest.approx(150 * 90, rel=0.01)]
    empty = segment(picture([], textured(5, 0.02), SIZE, noise=0.3), "front")
    assert empty.regions == ()
    assert any("too dark" in remark for remark in empty.remarks)


def fading_into(table: float, level: float, shape: Shape) -> np.ndarray:
    """Return a thing that is ``level`` on its left and as grey as the table on its right."""
    share = coverage(shape, SIZE)
    right = np.clip((np.arange(SIZE[0]) - 165) / 150.0, 0, 1)[None]
    light = table + share * (1 - right) * (level - table)
    light = cv2.GaussianBlur(light, (0, 0), 0.8)
    light += np.random.default_rng(4).normal(0, 0.5, light.shape)
    return np.clip(np.round(light), 0, 255).astype(np.uint8)


def test_a_thing_whose_border_has_a_wide_gap_is_still_one_thing() -> None:
    # its right end, 90 px long, has no border at all
    result = segment(fading_into(110.0, 70.0, bar(240, 190, 150, 90)), "front")
    assert len(result.regions) == 1
    assert 0.7 * 150 * 90 < result.regions[0].area_px < 1.02 * 150 * 90
