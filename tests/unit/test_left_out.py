"""Parts with one wrong feature, every face left out by name: what pictures show stops a PASS."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from manifold3d import CrossSection
from shown_part import hand, photograph, shown, task

from controller.cad import sample_surface
from controller.inspection import (
    InspectionLimits,
    PartInspection,
    PartSettings,
    PicturedView,
    PosedPart,
    Verdict,
    ViewSet,
    inspect_part,
)

LOOKS = ((0.0, 3.0), (18.0, 6.0), (-15.0, -10.0), (8.0, 16.0))  # turn and tilt [deg]
STEEP = ((38.0, 3.0), (-36.0, 6.0), (5.0, 40.0), (-8.0, -37.0))


def obround(length: float, width: float) -> CrossSection:
    end = CrossSection.circle(width / 2, 64)
    half = (length - width) / 2
    return CrossSection.batch_hull([end.translate((-half, 0)), end.translate((half, 0))])


def pocketed(depth: float = 0.0, width: float = 0.0, place: float = 0.0) -> Body:
    return box(46, 34, 24) - box(20 + width, 14, 2 * (5 + depth)).translate((place, 2, 12))


def slotted(depth: float = 0.0, width: float = 0.0, place: float = 0.0) -> Body:
    hollow = obround(22.0, 8.0 + width).extrude(2 * (4 + depth))
    return box(46, 34, 24) - hollow.translate((0, 2 + place, 12 - 4 - depth))


def bored(depth: float = 0.0, width: float = 0.0, place: float = 0.0) -> Body:
    return box(46, 34, 24) - rod(6 + width / 2, 2 * (7 + depth)).translate((place, 2, 12))


def counterbored(depth: float = 0.0, width: float = 0.0, place: float = 0.0) -> Body:
    return bored(depth - 2, width, place) - rod(3, 60).translate((0, 2, 0))


def keyed(depth: float = 0.0, width: float = 0.0, place: float = 0.0) -> Body:
    key = box(5 + width, 12 + depth, 40).translate((place, 2 + (12 + depth) / 2, 0))
    return box(46, 34, 24) - rod(8, 60).translate((0, -2, 0)) - key


@cache
def judged(
    made: Callable[..., Body],
    feature: str,
    off_mm: float,
    looks: tuple[tuple[float, float], ...] = LOOKS,
    *,
    is_counted: bool = True,
) -> PartInspection:
    """Return what a part comes to whose feature is off, its faces all left out by name."""
    part = PosedPart(solid_of(made(), "nominal"))
    samples = sample_surface(part.solid)
    nowhere = None if is_counted else np.zeros(len(samples.points_mm), dtype=np.bool_)
    body = made(**{feature: off_mm}) if off_mm else made()
    views = []
    for number, (turn, tilt) in enumerate(looks):
        T = shown(turn, tilt)
        pictures = photograph(body, T, hand(T))
        views.append(PicturedView(task(T, hand(T), f"v{number}"), pictures, counted=nowhere))
    settings = PartSettings(
        InspectionLimits(),
        min_coverage=0.01,
        not_inspected=dict.fromkeys(range(len(part.solid.faces)), "gauged by hand"),
    )
    return inspect_part(ViewSet(part, samples, tuple(views)), (), settings)


def test_a_pocket_too_shallow_does_not_pass_and_the_verdict_says_by_how_much() -> None:
    got = judged(pocketed, "depth", -1.0)
    assert got.verdict is not Verdict.PASS
    assert "the floor shows about 1.0 mm higher" in got.reasons[0]
    assert got.findings[0].kind == "dimension"
    floor = got.findings[0].faces[0]
    assert got.ledger.faces[floor].verdict is not Verdict.PASS


def test_a_good_part_passes_with_every_face_left_out() -> None:
    got = judged(pocketed, "depth", 0.0)
    assert (got.verdict, got.findings) == (Verdict.PASS, ())


# Seen so flat, a floor 2.2 mm higher shows its edges 6 pixels off, farther than the search about
# their place goes.
def test_a_floor_farther_off_than_the_search_goes_is_looked_for_there() -> None:
    got = judged(slotted, "depth", -2.2, STEEP)
    assert got.verdict is Verdict.FAIL
    assert "the floor shows about 2.2 mm higher" in got.reasons[0]


def test_a_view_that_does_not_count_there_shows_no_floor_at_another_depth() -> None:
    got = judged(slotted, "depth", -2.2, STEEP, is_counted=False)
    assert [one for one in got.findings if one.kind == "dimension"] == []


@pytest.mark.slow
@pytest.mark.parametrize("made", [pocketed, slotted])
@pytest.mark.parametrize("off_mm", [-1.4, 1.8])
def test_floors_seen_flat_are_found_at_other_depths(
    made: Callable[..., Body], off_mm: float
) -> None:
    assert judged(made, "depth", off_mm, STEEP).verdict is not Verdict.PASS


@pytest.mark.slow
@pytest.mark.parametrize("made", [pocketed, slotted, bored, counterbored])
def test_a_good_floor_seen_flat_is_found_nowhere_else(made: Callable[..., Body]) -> None:
    got = judged(made, "depth", 0.0, STEEP)
    assert (got.verdict, got.findings) == (Verdict.PASS, ())


# The width of a slot is measured, which no face left out takes away; nothing is measured here.
@pytest.mark.slow
@pytest.mark.parametrize(
    ("made", "feature", "off_mm"),
    [
        (pocketed, "depth", 1.0),
        (pocketed, "width", 1.0),
        (pocketed, "place", 0.7),
        (slotted, "depth", -1.0),
        (slotted, "place", 0.7),
        (bored, "depth", -1.2),
        (counterbored, "depth", -1.0),
        (counterbored, "width", 0.9),
        (keyed, "depth", 0.9),
        (keyed, "width", 0.9),
    ],
)
def test_a_wrong_feature_does_not_pass_though_every_face_is_left_out(
    made: Callable[..., Body], feature: str, off_mm: float
) -> None:
    assert judged(made, feature, off_mm).verdict is not Verdict.PASS


@pytest.mark.slow
@pytest.mark.parametrize("made", [slotted, bored, counterbored, keyed])
def test_good_features_have_nothing_against_them(made: Callable[..., Body]) -> None:
    got = judged(made, "depth", 0.0)
    assert (got.verdict, got.findings) == (Verdict.PASS, ())
