"""Predicted pictures: judged, they say what the pictures of a good part would have compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shown_part import hand, part, perfect, photograph, samples, shown, task

from controller.cad import share_of
from controller.imaging import transform
from controller.inspection import (
    ViewResult,
    ViewTask,
    WorldBox,
    inspect_view,
    predict_pictures,
)

# none of these poses was looked at while the prediction was made
POSES = [(7.0, -12.0, 3.0), (-24.0, 19.0, 96.0)]


def results(turns: tuple[float, float, float]) -> tuple[ViewResult, ViewResult]:
    """Return the results of predicted pictures, and of a renderer that shares no code with them."""
    T = shown(*turns)
    asked = replace(task(T), is_hold_measured=True)
    pictures = photograph(perfect(), T, hand(T))
    return (
        inspect_view(part(), samples(), asked, predict_pictures(part(), asked)),
        inspect_view(part(), samples(), asked, pictures),
    )


@pytest.mark.parametrize("turns", POSES)
def test_what_is_compared_in_predicted_pictures_is_compared_in_those_of_a_good_part(
    turns: tuple[float, float, float],
) -> None:
    told, found = results(turns)
    assert told.evaluated, told.reason
    assert not told.findings
    assert found.evaluated, found.reason
    assert share_of(samples(), found.compared) > 0.1
    # the forecast may be three points of the surface off
    forecast, compared = (share_of(samples(), one.compared) for one in (told, found))
    assert forecast == pytest.approx(compared, abs=0.03)
    assert share_of(samples(), told.compared ^ found.compared) < 0.06


def test_behind_the_gripper_nothing_is_forecast() -> None:
    T, before = shown(*POSES[0]), np.eye(4)
    before[:3, 3] = 12.0, -60.0, 0.0  # between the camera and the part's right half
    bar = WorldBox(before, np.array([10.0, 4.0, 40.0]))
    free, held = (
        inspect_view(part(), samples(), asked, predict_pictures(part(), asked))
        for asked in (_measured(task(T, ())), _measured(task(T, (bar,))))
    )
    assert held.evaluated, held.reason
    places = transform(T, samples().points_mm)
    # seen from 640 mm the bar's shadow on the part is a tenth wider than it is itself
    behind = np.abs(places[:, 0] - 13.0) < 9.0
    assert (free.compared & behind).any()
    assert not (held.compared & behind).any()
    assert (held.compared & ~behind).any()


def test_the_same_view_has_the_same_pictures() -> None:
    asked = task(shown(*POSES[0]))
    one, other = predict_pictures(part(), asked), predict_pictures(part(), asked)
    assert (one.backlit == other.backlit).all()
    assert one.lit.keys() == {lamp.name for lamp in asked.lamps}
    assert all((one.lit[name] == other.lit[name]).all() for name in one.lit)


def test_a_part_beside_the_picture_is_refused() -> None:
    T = shown()
    T[:3, 3] += np.array([500.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="out of the picture"):
        predict_pictures(part(), task(T, ()))


def _measured(asked: ViewTask) -> ViewTask:
    return replace(asked, is_hold_measured=True)
