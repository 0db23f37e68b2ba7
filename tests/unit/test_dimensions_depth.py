"""Depths of blind holes and pockets, measured in pictures at an angle to their axis."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest
from cad_solids import Body, box, rod, solid_of
from edge_views import edge_views

from controller.inspection import PosedPart, Verdict
from controller.inspection.characteristics import Characteristic, Measured, standing_of
from controller.inspection.characteristics.derive import derive
from controller.inspection.dimensions import measure

LOOKS = ((-15.0, 5.0), (20.0, -12.0), (8.0, 14.0), (-4.0, -20.0))  # turn and tilt [deg]
DEPTH_MM = 8.0


def holed(depth_mm: float = DEPTH_MM, *, radius_mm: float = 4.0, x_mm: float = -8.0) -> Body:
    return box(46, 34, 24) - rod(radius_mm, 2 * depth_mm, 96).translate((x_mm, 2, 12))


def pocketed(depth_mm: float = DEPTH_MM, *, width_mm: float = 12.0, x_mm: float = -6.0) -> Body:
    return box(46, 34, 24) - box(16, width_mm, 2 * depth_mm).translate((x_mm, 2, 12))


def slotted(depth_mm: float = DEPTH_MM) -> Body:
    ends = rod(4, 2 * depth_mm, 96)
    return box(46, 34, 24) - (
        ends.translate((-12, 2, 12))
        + ends.translate((4, 2, 12))
        + box(16, 8, 2 * depth_mm).translate((-4, 2, 12))
    )


def keyed(depth_mm: float = DEPTH_MM) -> Body:
    """A shaft with a keyway, its depth from the shaft's crest."""
    shaft = rod(14, 46, 128).rotate((0, 90, 0))
    return shaft - box(26, 8, 20).translate((0, 0, 14 - depth_mm + 10))


MADE = {"hole": holed, "pocket": pocketed, "slot": slotted, "keyway": keyed}


@cache
def nominal(kind: str) -> tuple[PosedPart, Characteristic]:
    solid = solid_of(MADE[kind](), kind)
    (depth,) = [c for c in derive(solid) if c.is_depth]
    return PosedPart(solid), depth


def depth_of(kind: str, body: Body, looks: tuple[tuple[float, float], ...] = LOOKS) -> Measured:
    part, depth = nominal(kind)
    (found,) = measure(part, (depth,), edge_views(body, looks))
    return found


@pytest.mark.parametrize("kind", list(MADE))
@pytest.mark.parametrize("off_mm", [0.0, 0.5, -0.5])
def test_a_depth_is_measured_within_its_uncertainty(kind: str, off_mm: float) -> None:
    found = depth_of(kind, MADE[kind](DEPTH_MM + off_mm))
    assert found.measured_mm is not None
    assert found.U_mm is not None
    assert found.measured_mm == pytest.approx(DEPTH_MM + off_mm, abs=found.U_mm)
    assert found.U_mm < 0.16  # at 0.19 mm a pixel
    assert found.verdict is (Verdict.FAIL if off_mm else Verdict.PASS)


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("hole", holed(x_mm=-7.7)),
        ("hole", holed(radius_mm=4.15)),
        ("pocket", pocketed(x_mm=-5.7)),
        ("pocket", pocketed(width_mm=12.3)),
    ],
    ids=["hole elsewhere", "hole wider", "pocket elsewhere", "pocket wider"],
)
def test_walls_that_are_elsewhere_leave_the_depth_as_it_is(kind: str, body: Body) -> None:
    found = depth_of(kind, body)
    assert found.measured_mm is not None
    assert found.U_mm is not None
    assert found.measured_mm == pytest.approx(DEPTH_MM, abs=found.U_mm)


def test_a_depth_seen_along_its_axis_is_not_measured_and_a_pass_says_so() -> None:
    found = depth_of("hole", holed(), ((0.0, 0.0),))
    assert found.measured_mm is None
    standing = standing_of([found])
    assert standing.verdict is Verdict.PASS
    assert standing.unproven == ("hole 8 mm depth: not measured, no picture shows how deep it is",)


def test_a_depth_with_limits_of_its_own_has_to_be_shown() -> None:
    part, depth = nominal("hole")
    asked = replace(depth, source="recipe")
    views = edge_views(holed(), ((0.0, 0.0),))
    standing = standing_of(measure(part, (asked,), views))
    assert standing.verdict is Verdict.INDETERMINATE
