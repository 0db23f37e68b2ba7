"""A code on a face: nothing is compared there, and everything beside it as before."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from shown_part import CAMERA, hand, part, perfect, photograph, samples, shown, task

from benchmarks.printed_codes import modules
from controller.imaging import transform
from controller.imaging.codes import read_codes
from controller.inspection import PartFacts, Unjudged, ViewPictures, ViewResult, inspect_view
from controller.inspection.lit.coded import on_code

Array = NDArray[np.float64]
T = shown(8, 6)
TOP_MM = 12.0  # height of the face with the code
# top left, top right, bottom right, bottom left; free of bore, boss and pocket
CORNERS = np.array(
    [(-17.5, -5.5, TOP_MM), (-8.5, -5.5, TOP_MM), (-8.5, -14.5, TOP_MM), (-17.5, -14.5, TOP_MM)]
)
FINE = 8


def marked(pictures: ViewPictures) -> ViewPictures:
    """The pictures with a code on the part, five times as dark as its ground."""
    cells = np.kron(modules("data_matrix", "SN-0042"), np.ones((FINE, FINE))).astype(np.float32)
    height, width = cells.shape
    own = np.array([(0, 0), (width, 0), (width, height), (0, height)], np.float32) - 0.5
    seen = CAMERA.project(transform(T, CORNERS)).astype(np.float32)
    warp = cv2.getPerspectiveTransform(own, (seen + 0.5) * 4 - 0.5)
    fine = cv2.warpPerspective(cells, warp, tuple(4 * side for side in CAMERA.size_px))
    share = cv2.resize(fine, CAMERA.size_px, interpolation=cv2.INTER_AREA)
    share = cv2.GaussianBlur(share, (0, 0), 0.7)
    lit = {
        lamp: np.round(picture * (1 - 0.8 * share)).astype(np.uint8)
        for lamp, picture in pictures.lit.items()
    }
    return replace(pictures, lit=lit)


@pytest.fixture(scope="module")
def pictures() -> ViewPictures:
    return marked(photograph(perfect(), T, hand(T)))


def look(pictures: ViewPictures, *codes_mm: Array) -> ViewResult:
    return inspect_view(part(), samples(), replace(task(T), facts=PartFacts(codes_mm)), pictures)


def test_a_code_where_the_recipe_has_one_is_no_finding(pictures: ViewPictures) -> None:
    (read,) = read_codes(pictures.lit["ring"], ("data_matrix",))
    assert read.text == "SN-0042"
    assert any(one.kind.is_lit for one in look(pictures).findings)
    result = look(pictures, CORNERS)
    assert result.evaluated
    assert result.findings == ()


def test_what_it_covers_is_not_compared_for_that_reason(pictures: ViewPictures) -> None:
    result = look(pictures, CORNERS)
    covered = on_code(samples().points_mm, CORNERS)
    assert 8 < covered.sum() < 0.1 * len(covered)
    assert (result.unjudged[covered] == Unjudged.CODE.number).all()
    assert not result.compared[covered].any()
    elsewhere = result.unjudged == Unjudged.CODE.number
    # the rest of the face is compared: the reason stands on the code alone, by its grid of pixels
    far = np.abs(samples().points_mm[elsewhere] - CORNERS.mean(axis=0)).max(axis=1)
    assert far.max() < 4.5 + 9.0 * 4 / 21 + 0.8 + 0.5


def test_the_rest_of_the_part_is_compared_as_before(pictures: ViewPictures) -> None:
    plain = look(photograph(perfect(), T, hand(T)))
    coded = look(pictures, CORNERS)
    beside = ~on_code(samples().points_mm, CORNERS)
    away = np.linalg.norm(samples().points_mm - CORNERS.mean(axis=0), axis=1) > 15.0
    lost = plain.compared & ~coded.compared & beside & away
    assert lost.sum() <= 0.01 * plain.compared.sum()


@pytest.mark.parametrize("turn_deg", [0.0, 30.0])
def test_the_area_is_the_code_with_its_quiet_zone_on_its_own_plane(turn_deg: float) -> None:
    turn = cv2.Rodrigues(np.radians(turn_deg) * np.array([0.3, 0.2, 0.9]))[0]
    square = CORNERS @ turn.T
    middle = square.mean(axis=0)
    across = (square[1] - square[0]) / 9.0
    normal = turn[:, 2]
    within = np.array([middle, middle + 5.9 * across, middle + 0.7 * normal])
    beyond = np.array([middle + 8.0 * across, middle + 1.0 * normal, middle - 3.0 * normal])
    assert on_code(within, square).all()
    assert not on_code(beyond, square).any()
