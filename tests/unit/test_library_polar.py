"""Polar grids: area and centroid against shapely, turns against turns that were made."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.recognition.library import polar_grid
from controller.recognition.library.polar import (
    ANGLES,
    RINGS,
    TURNS,
    area_and_centroid,
    features,
    spectra,
    turn_scores,
)

Array = NDArray[np.float64]
Grid = NDArray[np.uint8]


def turned(points: Array, angle_rad: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return points @ np.array([[c, s], [-s, c]])


def scores(model: Grid, seen: Grid) -> Array:
    return np.asarray(turn_scores(spectra(model[None]), spectra(seen))[0], dtype=np.float64)


def grid_of(*loops: Array) -> Grid:
    return polar_grid(loops)[0]


def gap(a_rad: float, b_rad: float) -> float:
    return abs((a_rad - b_rad + np.pi) % (2 * np.pi) - np.pi)


def outlines() -> st.SearchStrategy[Array]:
    """Polygons of 5 to 12 corners round a point, far from a disc, a few centimetres wide."""

    def build(radii: list[float]) -> Array:
        phi = np.arange(len(radii)) * 2 * np.pi / len(radii)
        r = np.array(radii)
        return np.column_stack([r * np.cos(phi), r * np.sin(phi)])

    return st.lists(st.floats(12.0, 40.0), min_size=5, max_size=12).map(build)


def has_one_turn(outline: Array) -> bool:
    """Whether no turn but 0 puts a polygon nearly on itself: its overlap, worked out by shapely."""
    shape = shapely.Polygon(outline)
    centred = shapely.affinity.translate(shape, -shape.centroid.x, -shape.centroid.y)
    for degrees in range(6, 360, 6):
        other = shapely.affinity.rotate(centred, degrees, origin=(0, 0))
        shared = centred.intersection(other).area
        if shared > 0.97 * centred.area:
            return False
    return True


angles = st.floats(-np.pi, np.pi)
places = st.tuples(st.floats(-300, 300), st.floats(-300, 300))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(outline=outlines(), angle=angles, place=places, scale=st.floats(0.3, 4.0))
def test_the_turn_is_found_wherever_and_however_large_a_shape_is(
    outline: Array, angle: float, place: tuple[float, float], scale: float
) -> None:
    assume(has_one_turn(outline))
    seen = scale * turned(outline, angle) + place
    told = scores(grid_of(outline), grid_of(seen))
    assert told.shape == (TURNS,)
    best = 2 * np.pi * int(told.argmax()) / TURNS
    assert gap(best, angle) < np.radians(1.5)
    assert told.max() > 0.97


@settings(max_examples=40, deadline=None, derandomize=True)
@given(outline=outlines(), angle=angles, place=places, scale=st.floats(0.3, 4.0))
def test_what_the_index_searches_by_hardly_changes_with_place_turn_and_scale(
    outline: Array, angle: float, place: tuple[float, float], scale: float
) -> None:
    here = features(grid_of(outline)[None])[0]
    there = features(grid_of(scale * turned(outline, angle) + place)[None])[0]
    # a tenth of the distance beyond which the index looks at nothing
    assert np.linalg.norm(here - there) < 0.06 * np.linalg.norm(here)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    outline=outlines(),
    hole=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(0.5, 4.0)),
    place=places,
    order=st.booleans(),
    backwards=st.tuples(st.booleans(), st.booleans()),
)
def test_area_and_centroid_are_shapelys_holes_left_out(
    outline: Array,
    hole: tuple[float, float, float],
    place: tuple[float, float],
    order: bool,
    backwards: tuple[bool, bool],
) -> None:
    phi = np.arange(40) * 2 * np.pi / 40
    inner = hole[:2] + hole[2] * np.column_stack([np.cos(phi), np.sin(phi)])
    assume(shapely.Polygon(outline).contains(shapely.Polygon(inner)))
    true = shapely.Polygon(outline + place, [inner + place])
    loops = [outline + place, inner + place]
    loops = [loop[::-1] if b else loop for loop, b in zip(loops, backwards, strict=True)]
    area, centroid = area_and_centroid(tuple(loops[::-1] if order else loops))
    assert area == pytest.approx(true.area, rel=1e-9)
    assert centroid == pytest.approx([true.centroid.x, true.centroid.y], abs=1e-7)
    _, grid_centroid, grid_area = polar_grid(tuple(loops))
    assert grid_area == pytest.approx(area)
    assert grid_centroid == pytest.approx(centroid, abs=1e-7)


def test_a_grid_is_white_where_the_shape_is() -> None:
    # a square of side 20: its circle of equal area is 11.28 wide, and rings go to 3.2 of them
    square = np.array([[-10.0, -10], [10, -10], [10, 10], [-10, 10]]) + np.array([50, 70])
    grid = grid_of(square)
    assert grid.shape == (RINGS, ANGLES)
    radius = (np.arange(RINGS) + 0.5) / RINGS * 3.2 * 20 / np.sqrt(np.pi)
    phi = np.arange(ANGLES) * 2 * np.pi / ANGLES
    x, y = radius[:, None] * np.cos(phi), radius[:, None] * np.sin(phi)
    off = shapely.distance(shapely.points(x, y), shapely.box(-10, -10, 10, 10).exterior)
    expected = np.where(np.maximum(np.abs(x), np.abs(y)) < 10, 255, 0)
    clear = off > 1.2  # the raster is smoothed over a third of a millimetre here
    assert (grid[clear] == expected[clear]).all()


def test_angles_run_from_x_towards_y() -> None:
    # a bar to the right with a lug upwards at its right end
    bar = np.array([[0.0, 0], [60, 0], [60, 30], [50, 30], [50, 10], [0, 10]])
    told = scores(grid_of(bar), grid_of(turned(bar, np.radians(40))))
    assert told.argmax() == pytest.approx(40, abs=1)


def test_a_mirrored_shape_overlaps_less_than_itself_at_every_turn() -> None:
    bar = np.array([[0.0, 0], [60, 0], [60, 30], [50, 30], [50, 10], [0, 10]])
    mirrored = bar * [1.0, -1.0]
    assert scores(grid_of(bar), grid_of(bar)).max() > 0.999
    assert scores(grid_of(bar), grid_of(mirrored)).max() < 0.9


def test_scores_are_the_cosine_of_the_two_silhouettes() -> None:
    # a disc, and the same disc with a bore of half its radius: concentric, so that no turn matters
    phi = np.arange(256) * 2 * np.pi / 256
    ring = np.column_stack([np.cos(phi), np.sin(phi)])
    told = scores(grid_of(20 * ring), grid_of(20 * ring, 10 * ring))
    assert np.ptp(told) < 0.01
    # each is scaled to equal area: the washer's radii are larger by sqrt(4 / 3), 1.155 and 0.577;
    # shared is 1 - 0.333 of the disc's area, both areas are 1
    assert told.mean() == pytest.approx(1 - 1 / 3, abs=0.06)  # in rings a tenth wide


def test_a_hole_tells_a_half_turn_apart() -> None:
    plate = np.array([[-30.0, -20], [30, -20], [30, 20], [-30, 20]])
    phi = np.arange(48) * 2 * np.pi / 48
    bore = np.array([18.0, 8.0]) + 4 * np.column_stack([np.cos(phi), np.sin(phi)])
    told = scores(grid_of(plate, bore), grid_of(turned(plate, 2.0), turned(bore, 2.0)))
    best = 2 * np.pi * int(told.argmax()) / TURNS
    assert gap(best, 2.0) < np.radians(1.5)
    assert told[(int(told.argmax()) + 180) % 360] < told.max() - 0.005


def test_what_has_no_area_is_refused() -> None:
    line = np.array([[0.0, 0], [10, 0], [20, 0]])
    with pytest.raises(ValueError, match="without area"):
        polar_grid((line,))
    # a hole as large as its outline leaves nothing
    square = np.array([[-10.0, -10], [10, -10], [10, 10], [-10, 10]])
    with pytest.raises(ValueError, match="without area"):
        polar_grid((square, square.copy()))
