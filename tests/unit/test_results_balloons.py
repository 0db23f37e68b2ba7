"""The balloon drawing: each number beside what it numbers, and no two leaders cross."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely

from controller.cad import Solid
from controller.cad.compiled import CompiledPart, load_part
from controller.cad.views import line_view
from controller.cell.journal.rows import CharacteristicFields
from controller.cell.services.records import measured_row
from controller.inspection import Verdict
from controller.inspection.characteristics import Measured, derive
from controller.results.report import render_parts
from controller.results.report.signed.balloons import (
    DETAIL_RADIUS_MM,
    MIN_CROWD,
    MIN_SIDE_SHARE,
    PAPER_MM,
    SIDES,
    BalloonDrawing,
    Callout,
    balloon_drawing,
)
from controller.results.report.signed.leaders import GAP_MM, PITCH_MM, BalloonRing, arrange
from controller.results.run import PartFold
from tests.data_files import part_file
from tests.unit import judged_bench as bench

# parts that the arrangement was looked at with, then parts that it was not
PARTS = ("featuretype.stl", "flange_xy.stl", "holder.stl", "angle_block.stl", "nist_ftc06.stl")


def changed(one: CharacteristicFields, **values: object) -> CharacteristicFields:
    return one.model_copy(update=values)


def reports_of(part: CompiledPart) -> tuple[CharacteristicFields, ...]:
    """Return all that is asked of a part without a recipe, as a report of a run has it."""
    made = [Measured(c, None, None, Verdict.NOT_EVALUATED, (), "no picture") for c in derive(part)]
    fold = PartFold(1)
    fold.take(measured_row(made))
    return fold.characteristics


def leader(callout: Callout) -> shapely.LineString:
    return shapely.LineString([callout.balloons[0].at, callout.end])


def leaders_cross(drawing: BalloonDrawing) -> int:
    return sum(
        leader(one).crosses(leader(other))
        for side in drawing.sides
        for one, other in combinations(side.callouts, 2)
    )


def ways_out_mm(part: Solid, drawing: BalloonDrawing) -> list[float]:
    """Return from the end of each leader the shortest way to where balloons may stand."""
    found = []
    for side in drawing.sides:
        if side.border is not None:
            outline = shapely.Point(side.border.at).buffer(side.border.radius)
        else:
            view = line_view(part, SIDES[side.words])
            points = np.vstack([loop.points for loop in view.loops]) * (1, -1) * side.scale
            outline = shapely.MultiPoint(points).convex_hull
        ring = outline.buffer(GAP_MM).exterior
        found += [float(ring.distance(shapely.Point(c.end))) for c in side.callouts]
    return found


def gaps_mm(drawing: BalloonDrawing) -> np.ndarray:
    """Return the distances between the middles of balloons of one side."""
    found = [np.inf]
    for side in drawing.sides:
        at = np.array([b.at for c in side.callouts for b in c.balloons]).reshape(-1, 2)
        apart = np.linalg.norm(at[:, None] - at[None], axis=2)
        found += apart[np.triu_indices(len(at), 1)].tolist()
    return np.array(found)


@pytest.fixture(scope="module")
def solid() -> Solid:
    return load_part(part_file("flange_xy.stl")).solid


@pytest.fixture(scope="module", params=PARTS)
def drawn(request: pytest.FixtureRequest) -> tuple[Solid, tuple[CharacteristicFields, ...]]:
    part = load_part(part_file(request.param))
    return part.solid, reports_of(part)


def test_no_leaders_of_real_parts_cross_and_all_balloons_are_on_the_paper(
    drawn: tuple[Solid, tuple[CharacteristicFields, ...]],
) -> None:
    part, reports = drawn
    drawing = balloon_drawing(part, reports)
    callouts = [c for side in drawing.sides for c in side.callouts]
    assert leaders_cross(drawing) == 0
    numbers = [b.number for c in callouts for b in c.balloons]
    assert sorted([*numbers, *drawing.left_out]) == [c.balloon for c in reports]
    assert gaps_mm(drawing).min() >= 2 * drawing.radius - 1e-6
    for row in drawing.rows:
        assert sum(side.width for side in row) <= PAPER_MM[0]
    assert sum(max(side.height for side in row) for row in drawing.rows) <= PAPER_MM[1]
    # a balloon stands beside what it numbers: all ways together are little longer than the shortest
    lengths = [leader(c).length for c in callouts]
    assert sum(lengths) < 1.25 * sum(ways_out_mm(part, drawing))
    assert min(lengths) > drawing.radius  # the end shows beside the balloon


def test_no_leader_runs_through_the_balloon_of_another(
    drawn: tuple[Solid, tuple[CharacteristicFields, ...]],
) -> None:
    drawing = balloon_drawing(*drawn)
    through = [
        (one.balloons[0].number, ball.number)
        for side in drawing.sides
        for one in side.callouts
        for other in side.callouts
        if other is not one
        for ball in other.balloons
        if leader(one).distance(shapely.Point(ball.at)) < drawing.radius
    ]
    assert through == []


@pytest.mark.parametrize("seed", range(8))
def test_leaders_to_random_shapes_never_cross(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rings, targets = [], []
    sizes = rng.uniform(20, 90, size=(2, 2))
    for size in sizes:
        rings.append(BalloonRing.about(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size))
    room = sum(len(ring.slots) for ring in rings)
    for k in range(room):  # every slot is taken
        at = [rng.uniform(-1, 1, 2) * size for size in sizes]
        shapes = [shapely.Point(p).buffer(2).exterior if k % 3 else shapely.Point(p) for p in at]
        targets.append(shapes)
    placed = arrange(rings, targets)
    assert placed is not None
    for view in (0, 1):
        lines = [shapely.LineString([p.start, p.end]) for p in placed if p.view == view]
        assert sum(a.crosses(b) for a, b in combinations(lines, 2)) == 0
        starts = np.array([p.start for p in placed if p.view == view])
        apart = np.linalg.norm(starts[:, None] - starts[None], axis=2)
        # along the ring it is a pitch; a chord over a rounded corner is a little shorter
        chord = 2 * GAP_MM * np.sin(PITCH_MM / GAP_MM / 2)
        assert apart[np.triu_indices(len(starts), 1)].min() >= chord - 1e-6
    one_more = [*targets, targets[0]]
    assert arrange(rings, one_more) is None


def test_balloons_point_at_what_they_number(solid: Solid) -> None:
    x, y, z = solid.centroid_mm
    hole, other = bench_reports()[0], bench_reports()[5]
    hole = changed(hole, anchors_mm=((x + 10, y + 5, z),), axis=(0.0, 0.0, 1.0))
    other = changed(other, kind="diameter", anchors_mm=((x - 7, y, z + 3),), axis=(0.0, -1.0, 0.0))
    drawing = balloon_drawing(solid, [hole, other])
    sides = {side.words: side for side in drawing.sides}
    assert set(sides) == {"from +z", "from -y"}
    for words, middle, report in (("from +z", (10, -5), hole), ("from -y", (-7, -3), other)):
        (callout,) = sides[words].callouts  # SVG's y points down
        assert [b.number for b in callout.balloons] == [report.balloon]
        assert report.rim_radius_mm is not None
        off = np.array(callout.end) / drawing.scale - middle
        assert np.linalg.norm(off) == pytest.approx(report.rim_radius_mm, rel=0.01)
    assert drawing.left_out == ()


def test_a_distance_is_drawn_along_its_axis_at_its_true_length(solid: Solid) -> None:
    x, y, z = solid.centroid_mm
    one = changed(
        bench_reports()[2],
        anchors_mm=((x - 6, y + 9, z), (x + 6, y - 4, z + 2)),
        axis=(1.0, 0.0, 0.0),
        rim_radius_mm=None,
    )
    drawing = balloon_drawing(solid, [one])
    (callout,) = [c for side in drawing.sides for c in side.callouts]
    (x0, y0), (x1, y1) = callout.line
    assert abs(x1 - x0) / drawing.scale == pytest.approx(12.0)
    assert y0 == pytest.approx(y1)


@pytest.mark.parametrize(("up", "words"), [(1, "from +z"), (-1, "from -z")])
def test_a_distance_is_drawn_from_the_half_of_the_part_that_it_is_in(
    solid: Solid, up: int, words: str
) -> None:
    low, high = solid.mesh.bounds
    x, y, z = (low + high) / 2
    depth_mm = 0.3 * (high - low)[2]
    one = changed(
        bench_reports()[2],
        anchors_mm=((x - 6, y, z + up * depth_mm), (x + 6, y, z + up * depth_mm)),
        axis=(1.0, 0.0, 0.0),
        rim_radius_mm=None,
    )
    hole = changed(bench_reports()[0], balloon=9, anchors_mm=((x, y, z),), axis=(0.0, 0.0, up))
    drawing = balloon_drawing(solid, [one, hole])
    assert [side.words for side in drawing.sides] == [words]


def test_many_balloons_in_one_place_do_not_cover_each_other(solid: Solid) -> None:
    x, y, z = solid.centroid_mm
    one = bench_reports()[0]
    many = [
        changed(one, id=f"h{i}", balloon=i, anchors_mm=((x + i % 3, y + i % 5, z + i),))
        for i in range(1, 31)
    ]
    drawing = balloon_drawing(solid, many)
    assert gaps_mm(drawing).min() >= 2 * drawing.radius - 1e-6
    assert leaders_cross(drawing) == 0


def crowd(solid: Solid, count: int) -> list[CharacteristicFields]:
    """Return small holes in the middle of a side, and a few at its border."""
    x, y, z = solid.centroid_mm
    width_mm, *_ = np.ptp(solid.mesh.bounds, axis=0)
    one = changed(bench_reports()[0], axis=(0.0, 1.0, 0.0), rim_radius_mm=0.01 * width_mm)
    turns = 2 * np.pi * np.arange(count) / count
    at = [(0.04 * width_mm * np.cos(t), 0.04 * width_mm * np.sin(t)) for t in turns]
    at += [(sign * 0.45 * width_mm, 0.0) for sign in (-1, 1)]
    return [
        changed(one, id=f"h{i}", balloon=i, anchors_mm=((x + dx, y, z + dz),))
        for i, (dx, dz) in enumerate(at, start=1)
    ]


def test_a_crowd_far_from_the_border_is_drawn_as_a_detail(solid: Solid) -> None:
    drawing = balloon_drawing(solid, crowd(solid, 6))
    side, detail = drawing.sides
    assert detail.border is not None
    assert side.marks[0].letter == detail.border.letter == "A"
    assert {b.number for c in detail.callouts for b in c.balloons} == set(range(1, 7))
    assert {b.number for c in side.callouts for b in c.balloons} == {7, 8}
    assert detail.scale >= 2 * side.scale
    enlarged = detail.scale / side.scale
    # both circles are about the same place of the part, and what is pointed at is in them
    assert np.array(detail.border.at) == pytest.approx(enlarged * np.array(side.marks[0].at))
    assert detail.border.radius == pytest.approx(enlarged * side.marks[0].radius)
    for callout in detail.callouts:
        assert np.linalg.norm(np.subtract(callout.end, detail.border.at)) < detail.border.radius
    assert leaders_cross(drawing) == 0
    assert max(leader(c).length for c in detail.callouts) < 2 * DETAIL_RADIUS_MM


def test_a_few_long_leaders_are_no_crowd(solid: Solid) -> None:
    (side,) = balloon_drawing(solid, crowd(solid, MIN_CROWD - 1)).sides
    assert side.marks == ()


def test_details_make_sides_little_smaller_and_do_not_overlap(
    drawn: tuple[Solid, tuple[CharacteristicFields, ...]], monkeypatch: pytest.MonkeyPatch
) -> None:
    drawing = balloon_drawing(*drawn)
    for side in drawing.sides:
        for one, other in combinations(side.marks, 2):
            apart = np.linalg.norm(np.subtract(one.at, other.at))
            assert apart > one.radius + other.radius
    monkeypatch.setattr("controller.results.report.signed.balloons.MAX_DETAILS", 0)
    without = balloon_drawing(*drawn)
    assert not any(side.border for side in without.sides)
    assert without.scale >= drawing.scale >= MIN_SIDE_SHARE * without.scale
    assert drawing.left_out == without.left_out


def test_details_of_several_parts_are_cut_by_their_own_circle(tmp_path: Path, solid: Solid) -> None:
    judged = bench.judged(tmp_path)
    part = replace(judged.part, characteristics=tuple(crowd(solid, 6)))
    parts = [replace(judged, part=replace(part, number=number)) for number in (1, 2)]
    page = render_parts(parts, solid)
    cut = re.findall(r'<clipPath id="([^"]+)"', page)
    assert len(set(cut)) == len(cut) == 2
    assert re.findall(r'clip-path="url\(#([^)]+)\)"', page) == cut


def test_what_no_side_shows_is_named(solid: Solid) -> None:
    slanted = changed(bench_reports()[0], axis=tuple(np.ones(3) / np.sqrt(3)))
    assert balloon_drawing(solid, [slanted]).left_out == (1,)


def test_what_is_measured_at_one_place_hangs_on_one_leader(solid: Solid) -> None:
    x, y, z = solid.centroid_mm
    one = changed(bench_reports()[0], anchors_mm=((x + 9, y, z),), axis=(0.0, 0.0, 1.0))
    drawing = balloon_drawing(solid, [one, changed(one, id="b", balloon=2)])
    (callout,) = [c for side in drawing.sides for c in side.callouts]
    assert [b.number for b in callout.balloons] == [1, 2]


def bench_reports() -> tuple[CharacteristicFields, ...]:
    fold = PartFold(1)
    fold.take(measured_row(bench.all_kinds()))
    return fold.characteristics


def test_a_part_without_characteristics_is_drawn_from_two_sides(solid: Solid) -> None:
    drawing = balloon_drawing(solid, ())
    assert [side.words for side in drawing.sides] == ["from +z", "from -y"]
