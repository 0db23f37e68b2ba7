"""Where an outline turns inwards: there parts may meet."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from recognise_bench import CAMERA, backlit

from controller.recognition.partial import Cluster
from controller.recognition.segmentation import segment

NEAR_PX = 12.0  # half of the longer chord


def meetings_px(*shapes: shapely.Geometry) -> NDArray[np.float64]:
    """Return where the outline of shapes [px] that touch turns inwards."""
    (region,) = segment(backlit(*shapes), "backlit").regions
    return Cluster(region, CAMERA).meetings_px


def bar(x0: float, y0: float, x1: float, y1: float, turn_deg: float = 0.0) -> shapely.Geometry:
    return shapely.affinity.rotate(shapely.box(x0, y0, x1, y1), turn_deg, origin=(400, 320))


@pytest.mark.parametrize("turn_deg", [0.0, 17.0, 45.0])
def test_two_bars_meet_at_the_ends_of_the_side_that_they_share(turn_deg: float) -> None:
    found = meetings_px(bar(300, 300, 500, 340, turn_deg), bar(380, 338, 420, 460, turn_deg))
    ends = shapely.affinity.rotate(
        shapely.MultiPoint([(380, 340), (420, 340)]), turn_deg, origin=(400, 320)
    )
    far = np.linalg.norm(found[:, None] - shapely.get_coordinates(ends), axis=2)
    assert far.min(axis=1).max() < NEAR_PX
    assert far.min(axis=0).max() < NEAR_PX / 2


def test_corners_that_jut_out_and_round_outlines_are_no_meetings() -> None:
    assert len(meetings_px(bar(300, 300, 500, 340, 30.0))) == 0
    assert len(meetings_px(shapely.Point(400, 320).buffer(80.0, 64))) == 0


def test_the_corners_of_a_square_hole_turn_inwards_for_the_part() -> None:
    hole = shapely.box(380, 300, 420, 340)
    found = meetings_px(bar(300, 260, 500, 380).difference(hole))
    far = np.linalg.norm(found[:, None] - shapely.get_coordinates(hole)[:4], axis=2)
    assert far.min(axis=1).max() < NEAR_PX
    assert far.min(axis=0).max() < NEAR_PX / 2
