"""Pieces of edges of pictures drawn on paper."""

import numpy as np
import pytest
from grey_drawings import L_PLATE, Plane, Plate, covered, drawing, plate, shown
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.recognition.grey import Edgelets, picture_edgelets, view_edgelets

Array = NDArray[np.float64]
SIZE = (280, 260)
PITCH = (0.25, 0.25)
PLANE = Plane(SIZE, PITCH)
SOME = settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
turns = st.floats(0.0, 2 * np.pi, allow_nan=False)


def seen(shape: Plate, *, table: float = 40, part: float = 160, noise: float = 1.0) -> Edgelets:
    grey = shown(covered(shape, SIZE, PITCH), table=table, part=part, noise=noise)
    return picture_edgelets(grey, PLANE)


def beside_sides(shape: Plate, found: Edgelets) -> list[tuple[Array, Array, float]]:
    """Return of each side: how far edgelets along it are off, how they lean, what they cover."""
    out = []
    for a, b in zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True):
        length = float(np.linalg.norm(b - a))
        along = (b - a) / length
        at = found.points_mm - a
        off, t = at @ np.array([-along[1], along[0]]), at @ along
        # what is near a corner may be of either side
        mine = (np.abs(off) < 1.0) & (t > 2.0) & (t < length - 2.0)
        lean = np.sin(found.directions_rad[mine] - np.arctan2(along[1], along[0]))
        out.append((off[mine], lean, float(found.lengths_mm[mine].sum()) / (length - 4.0)))
    return out


@given(turns)
@SOME
def test_sides_are_covered_and_met_to_half_a_pixel_whichever_way_they_run(
    turn: float,
) -> None:
    shape = L_PLATE.placed(turn, np.array([0.7, -0.4]))
    for off, lean, share in beside_sides(shape, seen(shape)):
        assert abs(float(np.median(off))) < 0.5 * PITCH[0]
        assert abs(float(np.median(lean))) < np.sin(np.radians(1.0))
        # what begins or ends at a corner is counted whole or not at all, and each cell a pixel more
        assert 0.85 < share < 1.25


@given(turns, st.floats(2.5, 9.0), st.floats(-3, 3), st.floats(-3, 3))
@SOME
def test_a_rim_is_met_all_round(turn: float, radius: float, x: float, y: float) -> None:
    shape = plate([(-25, -20), (25, -20), (25, 20), (-25, 20)], [(x, y, radius)])
    shape = shape.placed(turn, np.zeros(2))
    found = seen(shape)
    ray = found.points_mm - shape.holes[0, :2]
    far = np.linalg.norm(ray, axis=1)
    on = np.abs(far - radius) < 1.0
    assert abs(float(np.median(far[on])) - radius) < 0.5 * PITCH[0]
    across = np.abs(np.cos(found.directions_rad[on] - np.arctan2(ray[on, 1], ray[on, 0])))
    assert float(np.median(across)) < np.sin(np.radians(3.0))
    eighths = np.unique(np.floor(np.arctan2(ray[on, 1], ray[on, 0]) / (np.pi / 4)))
    assert len(eighths) == 8


def test_sides_are_where_they_are_where_pixels_are_not_square() -> None:
    pitch, size = (0.5, 0.35), (140, 160)
    shape = plate([(-25, -20), (25, -20), (25, 20), (-25, 20)], [])
    grey = shown(covered(shape, size, pitch), table=30, part=150, noise=0.5)
    for off, lean, _ in beside_sides(shape, picture_edgelets(grey, Plane(size, pitch))):
        assert abs(float(np.median(off))) < 0.15
        assert abs(float(np.median(lean))) < np.sin(np.radians(1.0))


@given(st.floats(0.35, 1.5), st.floats(0, 60))
@SOME
def test_edges_do_not_move_with_brightness_and_contrast(gain: float, offset: float) -> None:
    shape = L_PLATE.placed(0.3, np.zeros(2))
    found = seen(shape, table=10 + offset, part=10 + offset + 110 * gain, noise=0.5)
    for off, _, _ in beside_sides(shape, found):
        assert abs(float(np.median(off))) < 0.5 * PITCH[0]
    assert float(np.median(found.strengths)) == 1.0


def test_two_edges_that_cross_in_a_cell_keep_their_directions() -> None:
    grey = np.full((200, 200), 60, np.uint8)
    grey[100:] = 110
    grey[:, 100:] += 80
    found = picture_edgelets(grey, Plane((200, 200), PITCH))
    far = np.linalg.norm(found.points_mm, axis=1) > 3.0
    lean = found.directions_rad[far] % (np.pi / 2)
    assert np.minimum(lean, np.pi / 2 - lean).max() < np.radians(2.0)


@pytest.mark.parametrize("noise", [0.0, 0.5, 3.0, 8.0])
def test_noise_alone_shows_hardly_an_edge(noise: float) -> None:
    found = picture_edgelets(shown(np.zeros((260, 280)), table=90, part=90, noise=noise), PLANE)
    # a millionth of the points, and each needs one beside it
    assert len(found.points_mm) <= 1


def test_what_is_no_grey_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="uint8"):
        picture_edgelets(np.zeros((20, 20, 3), np.uint8), PLANE)
    with pytest.raises(ValueError, match="float"):
        picture_edgelets(np.zeros((20, 20)), PLANE)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (2, 40)])
def test_a_crop_of_almost_nothing_has_no_edges(size: tuple[int, int]) -> None:
    assert len(picture_edgelets(np.zeros(size, np.uint8), PLANE).points_mm) == 0


def test_a_view_weighs_its_outline_more_and_its_smooth_joins_less() -> None:
    view = drawing(L_PLATE)
    smooth = [
        type(e)(
            points=e.points,
            points_mm=e.points_mm,
            edge=e.edge,
            face=e.face,
            kind="smooth",
            on_outline=e.on_outline,
            starts_phantom=e.starts_phantom,
            ends_phantom=e.ends_phantom,
        )
        for e in view.edges
    ]
    plain = view_edgelets(view, v_down=False)
    joined = view_edgelets(
        type(view)((), tuple(smooth), 0.0, 0.0, np.zeros(2), np.eye(2)), v_down=False
    )
    inside = np.hypot(plain[:, 0] + 15, plain[:, 1] - 12) < 3.2  # the hole's
    assert inside.sum() > 5
    assert joined[inside, 4] == pytest.approx(0.3 * plain[inside, 4])
    assert joined[~inside & (np.abs(plain[:, 1] + 15) < 0.1), 4] == pytest.approx(
        plain[~inside & (np.abs(plain[:, 1] + 15) < 0.1), 4]
    )
    of_outline = np.abs(plain[:, 1] + 15) < 0.1
    assert float(plain[of_outline, 4].sum()) == pytest.approx(1.5 * 50.0, rel=1e-3)
