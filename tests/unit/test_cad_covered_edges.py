"""Edges behind walls: removed where they are hidden, no further, and at a small cost."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from cad_solids import Body, box, rod, solid_of
from numpy.typing import NDArray

from controller.cad import LineView, camera_view, line_view, prepare_views
from controller.imaging import Camera

Array = NDArray[np.float64]

FROM_THE_SIDE = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # x stays right, z is up


def drilled(columns: int, rows: int, sides: int = 40) -> Body:
    """A plate 8 mm thick with a bore of 6 mm every 10 mm; its corner at the origin."""
    size = np.array([10.0 * columns, 10.0 * rows, 8.0])
    body = box(*size).translate((size / 2).tolist())
    for i in range(columns):
        for j in range(rows):
            body -= rod(3.0, 40.0, sides).translate((10.0 * i + 5, 10.0 * j + 5, 4.0))
    return body


def segments(view: LineView) -> list[tuple[float, ...]]:
    """All straight runs as (x, y, x, y) to a hundredth, the lower end first, sorted."""
    runs = []
    for edge in view.edges:
        ends = sorted(tuple(np.round(p, 2) + 0.0) for p in (edge.points[0], edge.points[-1]))
        runs.append((*ends[0], *ends[1]))
    return sorted(runs)


def test_a_drilled_plate_from_its_side_is_a_bare_rectangle() -> None:
    view = line_view(solid_of(drilled(5, 6)), FROM_THE_SIDE)
    w, h = 25.0, 4.0
    assert segments(view) == sorted(
        [(-w, -h, -w, h), (w, -h, w, h), (-w, -h, w, -h), (-w, h, w, h)]
    )
    assert len(view.loops) == 1


def test_what_rises_behind_the_front_wall_is_drawn_from_where_it_rises() -> None:
    # the stud's foot lies on the line of the plate's upper edge, as all bores' rims do
    stud = box(4.0, 4.0, 12.0).translate((30.0, 30.0, 6.0))
    solid = solid_of(drilled(5, 6) + stud)
    view = line_view(solid, FROM_THE_SIDE)
    x, z = solid.centroid_mm[0], solid.centroid_mm[2]
    rising = [(28 - x, 8 - z, 28 - x, 12 - z), (32 - x, 8 - z, 32 - x, 12 - z)]
    top = [(28 - x, 12 - z, 32 - x, 12 - z)]
    found = np.array([run for run in segments(view) if run[3] > 8.5 - z])
    assert found == pytest.approx(np.array(sorted(rising + top)), abs=0.011)


@pytest.mark.parametrize("slit_mm", [0.2, 2.0, 30.0])
@pytest.mark.parametrize("is_open", [True, False])
def test_an_edge_with_both_ends_hidden_shows_in_the_gap_between(
    slit_mm: float, is_open: bool
) -> None:
    # over a beam's long edges lies a cover, with a slit across from its rim or a window within it
    cover = box(80.0, 40.0, 4.0)
    slit = box(slit_mm, 40.0 if is_open else 20.0, 10.0)
    if is_open:
        slit = slit.translate((0.0, 10.0, 0.0))  # leaves a bridge of 10 mm
    beam = box(70.0, 4.0, 4.0).translate((0.0, 0.0, -20.0))
    posts = [box(4.0, 3.0, 24.0).translate((x, 0.0, -10.0)) for x in (-32.0, 32.0)]
    solid = solid_of(cover - slit + beam + posts[0] + posts[1])
    view = line_view(solid, np.eye(3))
    y = solid.centroid_mm[1]
    upper_mm = -20.0 + 2.0
    for side in (-2.0, 2.0):
        shown = [
            e.points
            for e in view.edges
            if np.allclose(e.points_mm[:, 2], upper_mm) and np.allclose(e.points[:, 1], side - y)
        ]
        assert sum(float(np.ptp(p[:, 0])) for p in shown) == pytest.approx(slit_mm, abs=0.01)


def test_a_camera_over_a_drilled_plates_edge_sees_no_bore() -> None:
    K = np.array([[1800.0, 0, 320.0], [0, 1800.0, 256.0], [0, 0, 1]])
    T_world_cam = np.diag([1.0, -1, -1, 1])
    T_world_cam[2, 3] = 600.0
    camera = Camera((640, 512), K, np.zeros(5), T_world_cam)
    solid = solid_of(drilled(5, 6))
    T_world_part = np.eye(4)
    T_world_part[:3, :3] = FROM_THE_SIDE
    T_world_part[:3, 3] = -FROM_THE_SIDE @ solid.centroid_mm
    # straight over the front wall, whose rectangle is nearer and hides all that is behind it
    view = camera_view(solid, T_world_part, camera)
    shown = [e for e in view.edges if not e.on_outline]
    assert shown == []
    assert len(view.edges) == 4


def test_four_times_the_bores_take_no_more_than_their_share_of_memory() -> None:
    # each bore's rims lie over those of all bores in its column: by pairs it would be 16 times
    peaks = []
    for rows in (12, 48):
        solid = solid_of(drilled(4, rows, sides=24))
        model = prepare_views(solid)
        tracemalloc.start()
        line_view(solid, FROM_THE_SIDE, prepared=model)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 6 * peaks[0]
