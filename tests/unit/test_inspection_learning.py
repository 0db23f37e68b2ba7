"""Learning from good parts: what is usual, what differs from it, and where it does not apply."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cad_solids import Body
from manifold3d import Manifold
from shown_part import hand, moved, part, perfect, photograph, samples, shown, task

from controller.inspection import (
    GoodPart,
    InspectionLimits,
    Lesson,
    PartInspection,
    PartSettings,
    PicturedView,
    TooFewPartsError,
    Verdict,
    ViewSet,
    inspect_part,
    learn,
)
from messages.words import teller

LOOKS = ((8.0, 6.0), (-18.0, 10.0))
SETTINGS = PartSettings(InspectionLimits(), min_coverage=0.01)


def slipped(number: int) -> tuple[tuple[float, float, float], float]:
    """A slip in the jaws, another for each part: some tenths of a millimetre and of a degree."""
    rng = np.random.default_rng([37, number])
    x, y, z = rng.uniform(-0.4, 0.4, 3)
    return (float(x), float(y), float(z)), float(rng.uniform(-0.5, 0.5))


@cache
def good(number: int) -> ViewSet:
    return shown_as(perfect(), number)


def shown_as(body: Body, number: int, dim: float = 1.0) -> ViewSet:
    """All views of a real body that slipped; the first lamp's light dimmed by a factor."""
    views = []
    for look, (turn, tilt) in enumerate(LOOKS):
        T = shown(turn, tilt)
        seen = task(T, hand(T), f"v{look}")
        pictures = photograph(body, moved(T, *slipped(number)), hand(T))
        lit = {k: (dim * p).astype(np.uint8) for k, p in pictures.lit.items()}
        views.append(PicturedView(seen, replace(pictures, lit=lit)))
    return ViewSet(part(), samples(), tuple(views))


def dented() -> Body:
    """The block with a dent 4 mm wide in its front."""
    return perfect() - Manifold.sphere(3.0, 48).translate((-1.0, 11.0, 14.2))


def parts(*numbers: int) -> list[GoodPart]:
    return [GoodPart(f"part {n}", good(n)) for n in numbers]


@cache
def lesson() -> Lesson:
    return learn(parts(*range(8)))


def judged(views: ViewSet, *, learned: bool = True) -> PartInspection:
    appearance = lesson().appearance if learned else None
    return inspect_part(views, (), replace(SETTINGS, appearance=appearance))


def test_a_good_part_differs_from_no_other() -> None:
    assert [one.name for one in lesson().tried] == [f"part {n}" for n in range(8)]
    assert not any(one.odd for one in lesson().tried)
    assert lesson().left_out == ()
    assert len(lesson().appearance.views) == len(LOOKS)


def test_another_good_part_is_compared_with_them_under_every_lamp() -> None:
    found = judged(good(11))
    assert found.findings == ()
    assert all(c.learned_from == 8 for v in found.views for c in v.checks[1:])
    cold = judged(good(11), learned=False)
    assert found.ledger.compared_fraction > 0.9 * cold.ledger.compared_fraction


def test_a_dent_that_no_good_part_has_is_found_under_both_lamps() -> None:
    found = [f for f in judged(shown_as(dented(), 12)).findings if f.verdict is Verdict.FAIL]
    assert found
    assert all(np.linalg.norm(f.p_part_mm - [-1.0, 11.0, 12.0]) < 3.0 for f in found)


def test_a_part_with_a_defect_is_named_and_left_out() -> None:
    bad = GoodPart("the dented one", shown_as(dented(), 13))
    found = learn([*parts(0, 1, 2), bad, *parts(3, 4)])
    assert [one.name for one in found.left_out] == ["the dented one"]
    place = found.left_out[0].odd[0].plainest.p_part_mm
    assert np.linalg.norm(place - [-1.0, 11.0, 12.0]) < 3.0
    assert [one.name for one in found.tried] == [f"part {n}" for n in range(5)]


def test_four_parts_are_too_few() -> None:
    with pytest.raises(TooFewPartsError, match="4 good parts, 5 are needed"):
        learn(parts(0, 1, 2, 3))


def test_too_few_parts_name_those_left_out_in_each_language() -> None:
    bad = GoodPart("the dented one", shown_as(dented(), 13))
    named = "; the dented one differs from the others$"
    with pytest.raises(TooFewPartsError, match=named) as refused:
        learn([*parts(0, 1, 2, 3), bad])
    told = teller("de")(str(refused.value))
    assert told.endswith("; the dented one weicht von den anderen ab")


def test_a_lamp_that_is_dimmer_as_a_whole_changes_nothing() -> None:
    assert judged(shown_as(perfect(), 14, dim=0.9)).findings == ()


def test_a_view_far_from_those_learned_is_judged_by_prediction() -> None:
    T = shown(40.0, -20.0)
    far = PicturedView(task(T, hand(T), "v0"), photograph(perfect(), T, hand(T)))
    found = judged(ViewSet(part(), samples(), (far,)))
    assert all(check.learned_from == 0 for view in found.views for check in view.checks)


def test_a_rough_finish_is_no_finish_that_was_learned() -> None:
    rng = np.random.default_rng(5)
    views = []
    for view in good(15).views:
        lit = {
            k: np.clip(p * rng.normal(1.0, 0.25, p.shape), 0, 255).astype(np.uint8)
            for k, p in view.pictures.lit.items()
        }
        views.append(replace(view, pictures=replace(view.pictures, lit=lit)))
    found = judged(ViewSet(part(), samples(), tuple(views)))
    assert not any(check.learned_from for view in found.views for check in view.checks)
