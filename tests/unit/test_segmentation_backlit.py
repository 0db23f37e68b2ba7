"""Dark objects on a light table: areas, outlines, what is ignored, which remarks are made."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from segmentation_pictures import bar, coverage, disc, fading, picture, ring

from controller.recognition.segmentation import Segmentation, segment


def only(result: Segmentation) -> object:
    assert len(result.regions) == 1
    return result.regions[0]


def area(radius: float) -> float:
    return float(np.pi * radius**2)


def radii(loop: np.ndarray, x: float, y: float) -> np.ndarray:
    return np.hypot(loop[:, 0] - x, loop[:, 1] - y)


def test_a_disc_is_found_with_its_area_and_its_edge_to_a_twentieth_of_a_pixel() -> None:
    region = segment(picture([(disc(150.3, 120.7, 40), 5)], 220)).regions[0]
    # a blurred curved edge moves inwards by about blur² / 2 r: 0.01 px here
    assert region.area_px == pytest.approx(area(40), rel=0.002)
    assert np.abs(radii(region.loops_px[0], 150.3, 120.7) - 40).max() < 0.05


def test_the_outline_is_closed_ordered_and_has_a_point_a_pixel() -> None:
    loop = segment(picture([(bar(160, 128, 120, 50, 0.4), 10)], 210)).regions[0].loops_px[0]
    steps = np.hypot(*(np.roll(loop, -1, axis=0) - loop).T)
    assert 0.7 < steps.min() <= steps.max() < 1.2
    assert len(loop) == pytest.approx(2 * (120 + 50), rel=0.02)


def test_outer_loops_run_anticlockwise_to_the_eye_and_holes_clockwise() -> None:
    region = segment(picture([(ring(150, 120, 50, 20), 10)], 210)).regions[0]

    def signed(p: np.ndarray) -> float:
        q = np.roll(p, -1, axis=0)
        return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())

    # v runs down: anticlockwise to the eye is a negative shoelace sum (cad/views/_types.py)
    assert signed(region.loops_px[0]) == pytest.approx(-area(50), rel=0.005)
    assert signed(region.loops_px[1]) == pytest.approx(area(20), rel=0.005)


def test_a_hole_four_pixels_wide_stays_open() -> None:
    region = segment(
        picture([(bar(160, 128, 90, 60), 6), (disc(150, 120, 2), 220)], 220, noise=1.0)
    ).regions[0]
    assert len(region.loops_px) == 2
    assert np.abs(region.loops_px[1].mean(axis=0) - (150, 120)).max() < 0.2


def test_uneven_glow_does_not_move_the_edge() -> None:
    ground = fading(230, 0.35)
    for x, y in ((40, 40), (160, 128), (285, 215)):
        region = segment(picture([(disc(x, y, 22), 4)], ground, noise=0.7)).regions[0]
        assert abs(np.median(radii(region.loops_px[0], x, y)) - 22) < 0.06


def test_a_saturated_table_that_shows_its_level_at_the_rim_does_not_move_the_edge() -> None:
    # 300 in the middle, saturated but for the rim; half of it is 150, half of white 127: cut
    # there a border blurred by 0.8 px would lie 0.15 px off
    ground = fading(310, 0.35)
    drawn = picture([(disc(160, 128, 40), 4)], ground, noise=0.5)
    assert np.mean(drawn == 255) > 0.5
    result = segment(drawn)
    assert result.levels.ground > 270
    assert abs(np.median(radii(result.regions[0].loops_px[0], 160, 128)) - 40) < 0.06
    assert any("saturated" in remark for remark in result.remarks)


def test_grey_walls_that_mirror_the_glow_stay_part_of_the_thing() -> None:
    layers = [(bar(160, 128, 100, 60), 5), (bar(115, 128, 10, 60), 75), (bar(160, 128, 8, 20), 60)]
    region = segment(picture(layers, 230, noise=1.0)).regions[0]
    assert len(region.loops_px) == 1
    assert region.area_px == pytest.approx(100 * 60, rel=0.004)
    left = region.loops_px[0][np.abs(region.loops_px[0][:, 1] - 128) < 20]
    # the thing's own level beside this border is 75, not 5
    assert abs(np.median(left[left[:, 0] < 160, 0]) - 110) < 0.06


def test_two_things_three_pixels_apart_are_two() -> None:
    layers = [(bar(120, 128, 60, 60), 5), (bar(183, 128, 60, 50), 5)]
    result = segment(picture(layers, 220, noise=1.0))
    assert [round(r.area_px, -2) for r in result.regions] == [3600, 3000]


def test_a_thing_that_lies_in_anothers_hole_is_one_of_its_own() -> None:
    layers = [(ring(160, 128, 80, 50), 5), (disc(160, 128, 20), 5)]
    result = segment(picture(layers, 220))
    assert [len(r.loops_px) for r in result.regions] == [2, 1]
    assert result.regions[1].area_px == pytest.approx(area(20), rel=0.01)


def test_things_cut_by_the_edge_of_the_picture_or_of_the_usable_area_are_flagged() -> None:
    layers = [(bar(2, 60, 60, 40), 5), (bar(160, 128, 60, 40), 5)]
    drawn = picture(layers, 220)
    result = segment(drawn)
    assert [r.touches_edge for r in result.regions] == [False, True]
    usable = np.ones(drawn.shape, dtype=bool)
    usable[:, :150] = False
    result = segment(drawn, usable=usable)
    assert [r.touches_edge for r in result.regions] == [True]
    assert any("cut by the edge" in remark for remark in result.remarks)


def test_dust_is_ignored_and_counted() -> None:
    rng = np.random.default_rng(2)
    specks = [(disc(*rng.uniform((20, 20), (300, 60)), 1.2), 30.0) for _ in range(6)]
    result = segment(picture([(disc(160, 160, 40), 5), *specks], 220))
    assert len(result.regions) == 1
    assert any("specks ignored" in remark for remark in result.remarks)


@pytest.mark.parametrize("level", [0, 3])
def test_darkness_gives_nothing_and_says_so(level: int) -> None:
    result = segment(np.full((256, 320), level, np.uint8))
    assert result.regions == ()
    assert any("too dark" in remark for remark in result.remarks)


def test_all_white_gives_nothing_and_says_saturated() -> None:
    result = segment(np.full((256, 320), 255, np.uint8))
    assert result.regions == ()
    assert result.lighting == "backlit"
    assert any("saturated" in remark for remark in result.remarks)


@pytest.mark.parametrize("level", [60, 210])
def test_an_empty_table_gives_nothing_and_is_not_bimodal(level: float) -> None:
    for lighting in ("auto", "backlit", "front"):
        result = segment(picture([], fading(level, 0.3), noise=1.0), lighting)
        assert result.regions == ()
        assert not result.is_bimodal
        assert any("one hump" in remark for remark in result.remarks)


@pytest.mark.parametrize("radius", [9, 20, 90])
def test_two_humps_are_seen_however_small_the_dark_one(radius: float) -> None:
    result = segment(picture([(disc(150, 120, radius), 5)], fading(220, 0.3), noise=1.0))
    assert result.is_bimodal
    assert result.lighting == "backlit"


def test_sixteen_levels_are_enough_for_a_tenth_of_a_pixel() -> None:
    drawn = picture([(disc(150, 120, 40), 10)], 200, noise=2.0) // 16 * 16
    result = segment(drawn)
    assert result.levels.step == 16
    assert abs(np.median(radii(result.regions[0].loops_px[0], 150, 120)) - 40) < 0.1


def test_pixels_need_not_be_square_nor_the_picture_large() -> None:
    # 256 x 256 of a 5:4 field, as the paper's digitiser: a circle becomes an ellipse
    share = coverage(disc(319.5, 255.5, 100), (640, 512))
    light = 210 - 200 * cv2.resize(share, (256, 256), interpolation=cv2.INTER_AREA)
    region = segment((np.round(light / 4) * 4).astype(np.uint8)).regions[0]
    assert region.area_px == pytest.approx(area(100) / 5, rel=0.004)


def test_what_is_no_grey_8_bit_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="8-bit"):
        segment(np.zeros((10, 10, 3), np.uint8))
    with pytest.raises(ValueError, match="usable"):
        segment(np.zeros((10, 10), np.uint8), usable=np.ones((5, 5), bool))


PLAIN = picture([(ring(130, 110, 50, 22), 12), (bar(250, 200, 70, 30, 0.5), 12)], 180)


@settings(max_examples=15, deadline=None)
@given(gain=st.floats(0.4, 1.3), offset=st.floats(0, 15))
def test_outlines_do_not_depend_on_brightness(gain: float, offset: float) -> None:
    before = segment(PLAIN).regions
    after = segment(np.round(PLAIN * gain + offset).astype(np.uint8)).regions
    assert len(after) == len(before) == 2
    for one, other in zip(before, after, strict=True):
        assert len(one.loops_px) == len(other.loops_px)
        assert other.area_px == pytest.approx(one.area_px, rel=0.003)


@settings(max_examples=10, deadline=None)
@given(dx=st.integers(-40, 20), dy=st.integers(-40, 20))
def test_outlines_move_with_the_things(dx: int, dy: int) -> None:
    before = segment(PLAIN).regions
    moved = cv2.warpAffine(
        PLAIN, np.array([[1.0, 0, dx], [0, 1.0, dy]]), (320, 256), borderValue=180
    )
    after = segment(moved).regions
    assert len(after) == 2
    for one, other in zip(before, after, strict=True):
        assert other.loops_px[0].mean(axis=0) - one.loops_px[0].mean(axis=0) == pytest.approx(
            (dx, dy), abs=0.02
        )
        assert other.area_px == pytest.approx(one.area_px, rel=0.002)
