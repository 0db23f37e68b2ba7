import numpy as np
import pytest
from grey_drawings import L_PLATE, Plane, Plate, covered, plate, shown
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from controller.recognition.grey import ImageFeatures, image_features

SIZE = (280, 260)
PITCH = (0.25, 0.25)
PLANE = Plane(SIZE, PITCH)
SOME = settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])
turns = st.floats(0.0, 2 * np.pi, allow_nan=False)


def seen(
    shape: Plate, *, table: float = 40, part: float = 160, noise: float = 1.0
) -> ImageFeatures:
    return image_features(
        shown(covered(shape, SIZE, PITCH), table=table, part=part, noise=noise), PLANE
    )


def side_gaps(shape: Plate, features: ImageFeatures) -> list[float]:
    """Return how far the nearest line's ends are beside each long side; far if there is none."""
    gaps = []
    for a, b in zip(shape.corners, np.roll(shape.corners, -1, axis=0), strict=True):
        length = np.linalg.norm(b - a)
        along = (b - a) / length
        ends = features.lines_mm.reshape(-1, 2, 2) - a
        beside = np.abs(ends[..., 0] * along[1] - ends[..., 1] * along[0]).max(axis=1)
        t = ends @ along
        covers = (np.minimum(t.max(1), length) - np.maximum(t.min(1), 0)) > 0.8 * length
        gaps.append(float(np.where(covers, beside, 99.0).min()))
    return gaps


@given(turns)
@SOME
def test_sides_are_found_to_a_quarter_of_a_pixel_whichever_way_they_run(turn: float) -> None:
    shape = L_PLATE.placed(turn, np.array([0.7, -0.4]))
    assert max(side_gaps(shape, seen(shape))) < 0.25 * PITCH[0]


@given(turns)
@SOME
def test_every_corner_of_a_plate_is_found_with_its_angle(turn: float) -> None:
    shape = L_PLATE.placed(turn, np.zeros(2))
    corners = seen(shape).corners
    for at in shape.corners:
        gap = np.linalg.norm(corners.positions - at, axis=1)
        assert gap.min() < 0.5 * PITCH[0]
        assert corners.angles_rad[gap.argmin()] == pytest.approx(np.pi / 2, abs=0.03)


def test_a_corner_need_not_be_square() -> None:
    sixty = plate([(-15, -10), (15, -10), (0, -10 + 15 * 3**0.5)], [])
    corners = seen(sixty).corners
    assert len(corners.positions) == 3
    assert corners.angles_rad == pytest.approx(np.pi / 3, abs=0.03)


@given(turns, st.floats(2.5, 9.0), st.floats(-3, 3), st.floats(-3, 3))
@SOME
def test_a_hole_is_a_circle_to_a_tenth_of_a_pixel(
    turn: float, radius: float, x: float, y: float
) -> None:
    shape = plate([(-25, -20), (25, -20), (25, 20), (-25, 20)], [(x, y, radius)])
    shape = shape.placed(turn, np.zeros(2))
    circles = seen(shape).circles
    gap = np.linalg.norm(circles.centres - shape.holes[0, :2], axis=1)
    best = int(gap.argmin())
    assert gap[best] < 0.1 * PITCH[0]
    # blur draws a small rim inwards by about (blur / radius) / 2 of the blur
    assert circles.radii[best] == pytest.approx(radius, abs=0.15 * PITCH[0])
    # the smallest rim has some thirty pixels, of which the noise may hide three
    assert circles.cover[best] > 0.87
    assert not circles.bright_inside[best]


def test_a_disc_is_bright_inside_and_a_half_disc_an_arc_of_half_the_turn() -> None:
    angle = np.linspace(0, np.pi, 60)
    half = Plate(15 * np.stack([np.cos(angle), np.sin(angle)], axis=1), np.zeros((0, 3)))
    circles = seen(half).circles
    assert circles.bright_inside[0]
    assert circles.radii[0] == pytest.approx(15, abs=0.05)
    assert circles.centres[0] == pytest.approx([0, 0], abs=0.08)
    assert circles.extents_rad[0] == pytest.approx(np.pi, abs=0.4)
    middle = circles.starts_rad[0] + circles.extents_rad[0] / 2
    assert np.cos(middle - np.pi / 2) > 0.98


def test_a_circle_is_round_where_pixels_are_not_square() -> None:
    pitch, size = (0.5, 0.35), (140, 160)
    shape = plate([(-25, -20), (25, -20), (25, 20), (-25, 20)], [(4, -3, 8)])
    grey = shown(covered(shape, size, pitch), table=30, part=150, noise=0.5)
    features = image_features(grey, Plane(size, pitch))
    assert features.circles.centres[0] == pytest.approx([4, -3], abs=0.06)
    assert features.circles.radii[0] == pytest.approx(8, abs=0.06)
    assert max(side_gaps(shape, features)) < 0.15


@given(st.floats(0.35, 1.5), st.floats(0, 60))
@SOME
def test_lines_do_not_move_with_brightness_and_contrast(gain: float, offset: float) -> None:
    shape = L_PLATE.placed(0.3, np.zeros(2))
    features = seen(shape, table=10 + offset, part=10 + offset + 110 * gain, noise=0.5)
    assert max(side_gaps(shape, features)) < 0.3 * PITCH[0]
    assert len(features.circles.radii) == 2


@given(st.integers(-15, 15), st.integers(-15, 15))
@SOME
def test_features_move_with_the_picture(right: int, down: int) -> None:
    grey = shown(
        covered(L_PLATE.placed(0.4, np.zeros(2)), SIZE, PITCH), table=40, part=160, noise=0
    )
    moved = np.roll(grey, (down, right), axis=(0, 1))
    a, b = image_features(grey, PLANE), image_features(moved, PLANE)
    shift = np.array([right * PITCH[0], -down * PITCH[1]])
    for old in a.circles.centres:
        assert np.linalg.norm(b.circles.centres - old - shift, axis=1).min() < 0.02
    for old in a.lines_mm[:6]:
        middle = (old[:2] + old[2:]) / 2 + shift
        found = (b.lines_mm[:, :2] + b.lines_mm[:, 2:]) / 2
        assert np.linalg.norm(found - middle, axis=1).min() < 0.5


def test_the_bright_side_is_to_the_right_of_a_line() -> None:
    bright = plate([(-15, -10), (15, -10), (15, 10), (-15, 10)], [])
    lines = seen(bright).lines_mm[:4]
    middle, way = (lines[:, :2] + lines[:, 2:]) / 2, lines[:, 2:] - lines[:, :2]
    # clockwise round the origin
    assert (middle[:, 0] * way[:, 1] - middle[:, 1] * way[:, 0] < 0).all()


def test_lines_end_at_lines_in_a_t_and_three_ends_meet_in_a_y() -> None:
    grey = np.full((200, 200), 60, np.uint8)
    grey[100:] = 110
    grey[100:, 100:] = 190
    features = image_features(grey, Plane((200, 200), PITCH))
    at = np.array([0.0, 0.0])
    # the edge above runs straight through: a T there
    assert (
        np.linalg.norm(features.junctions.positions[~features.junctions.is_y] - at, axis=1).min()
        < 4
    )
    u, v = np.meshgrid(np.arange(200) - 99.5, 99.5 - np.arange(200))
    sector = np.floor(((np.arctan2(v, u) - 0.2) % (2 * np.pi)) / (2 * np.pi / 3)).astype(int)
    star = np.array([60, 120, 200], np.uint8)[sector]
    features = image_features(star, Plane((200, 200), PITCH))
    assert (
        np.linalg.norm(features.junctions.positions[features.junctions.is_y] - at, axis=1).min() < 1
    )


@pytest.mark.parametrize("noise", [0.0, 0.5, 3.0, 8.0])
def test_noise_alone_shows_no_line(noise: float) -> None:
    grey = shown(np.zeros((260, 280)), table=90, part=90, noise=noise)
    features = image_features(grey, PLANE)
    assert len(features.lines_mm) == 0
    assert len(features.circles.radii) == 0


def test_what_is_no_grey_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="uint8"):
        image_features(np.zeros((20, 20, 3), np.uint8), PLANE)
    with pytest.raises(ValueError, match="float"):
        image_features(np.zeros((20, 20)), PLANE)  # type: ignore[arg-type]


@pytest.mark.parametrize("size", [(1, 1), (3, 2), (2, 40)])
def test_a_crop_of_almost_nothing_has_no_features(size: tuple[int, int]) -> None:
    features = image_features(np.zeros(size, np.uint8), PLANE)
    assert len(features.lines_mm) == len(features.edgelets.points_mm) == 0
