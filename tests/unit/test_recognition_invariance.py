"""The whole recogniser: what may change in a picture without changing the answer, and what must.

Backlit pictures by exact area coverage, those under lamps by a renderer of the tests' own. The
everyday set draws few examples; the slow one more, of the same properties.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import shapely
from cad_solids import solid_of
from fitting_bodies import body, motion, solid
from hypothesis import given, settings
from hypothesis import strategies as st
from lit_pictures import Renderer, Scene, placed
from numpy.typing import NDArray
from table_pictures import SIZE, overhead, picture, resting, silhouette

from controller.cad import Solid, StablePose, stable_poses
from controller.cad.compiled import compile_solid
from controller.imaging import PointLamp
from controller.recognition import Library, Sighting, make_library, recognise

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
CAMERA = overhead()
TABLE = np.array([[-150.0, -120, 0], [150, -120, 0], [150, 120, 0], [-150, 120, 0]])
RING = PointLamp.ring("ring", np.array([0.0, 0, 690]), np.array([0.0, 0, -1]), 150.0)
# ways to lie of which neither a turn, nor another pose, nor another of these parts is the same
OWN = [("elbow", 0), ("elbow", 1), ("plate", 0), ("plate", 1), ("hand", 0)]
KNOWN = ("elbow", "plate", "hand", "nut", "block")

few = settings(max_examples=4, deadline=None, derandomize=True)
many = settings(max_examples=60, deadline=None, derandomize=True)
paths = st.sampled_from(OWN)
places = st.tuples(st.floats(-48, 48), st.floats(-30, 30))
angles = st.floats(-np.pi, np.pi)


@cache
def library() -> Library:
    return make_library([compile_solid(solid(name)) for name in KNOWN], CAMERA)


@cache
def pose(name: str, at: int) -> StablePose:
    return stable_poses(solid(name))[at]


def laid(way: tuple[str, int], place: tuple[float, float], theta: float) -> Array:
    return resting(solid(way[0]), pose(*way).R, *place, theta)


def shape_of(of: Solid, T: Array) -> shapely.Geometry:
    return silhouette(of.mesh, T, CAMERA)


def backlit(image: Grey, known: Library | None = None) -> tuple[Sighting, ...]:
    return recognise(image, CAMERA, known or library(), "backlit").sightings


def front(image: Grey, known: Library | None = None) -> tuple[Sighting, ...]:
    return recognise(image, CAMERA, known or library(), "front").sightings


def gap(a_rad: float, b_rad: float) -> float:
    return abs((a_rad - b_rad + np.pi) % (2 * np.pi) - np.pi)


def assert_seen(
    seen: tuple[Sighting, ...],
    way: tuple[str, int],
    T: Array,
    theta: float,
    within_mm: float,
    within_deg: float,
) -> None:
    assert [s.part for s in seen] == [way[0]], [s.reason for s in seen]
    (one,) = seen
    assert one.T_world_part is not None
    assert one.pose_index == pose(*way).index
    assert one.ambiguous_with == ()
    assert np.abs(motion(way[0], one.T_world_part, T)[:2]).max() < within_mm
    assert gap(one.theta_rad, theta) < np.radians(within_deg)


# --- on a light table -------------------------------------------------------------------------


def check_backlit_anywhere(
    way: tuple[str, int], place: tuple[float, float], theta: float, seed: int
) -> None:
    T = laid(way, place, theta)
    seen = backlit(picture([shape_of(solid(way[0]), T)], seed=seed))
    assert_seen(seen, way, T, theta, within_mm=0.03, within_deg=0.1)
    assert seen[0].score > 0.95


@few
@given(way=paths, place=places, theta=angles, seed=st.integers(0, 99))
def test_wherever_and_however_turned_a_part_is_the_same_part(
    way: tuple[str, int], place: tuple[float, float], theta: float, seed: int
) -> None:
    check_backlit_anywhere(way, place, theta, seed)


@pytest.mark.slow
@many
@given(way=paths, place=places, theta=angles, seed=st.integers(0, 99))
def test_wherever_and_however_turned_a_part_is_the_same_part_at_length(
    way: tuple[str, int], place: tuple[float, float], theta: float, seed: int
) -> None:
    check_backlit_anywhere(way, place, theta, seed)


@cache
def dark_elbow() -> tuple[Array, Grey, Sighting]:
    T = laid(("elbow", 0), (21.0, -13.0), 0.9)
    image = picture([shape_of(solid("elbow"), T)], seed=4)
    (seen,) = backlit(image)
    return T, image, seen


gains = st.floats(0.4, 1.2)
offsets = st.floats(-5.0, 25.0)


def dimmed(image: Grey, gain: float, offset: float) -> Grey:
    return np.asarray(np.clip(np.round(gain * image + offset), 0, 255), dtype=np.uint8)


@settings(max_examples=12, deadline=None, derandomize=True)
@given(gain=gains, offset=offsets)
def test_a_brighter_or_duller_glow_shows_the_same(gain: float, offset: float) -> None:
    T, image, plain = dark_elbow()
    seen = backlit(dimmed(image, gain, offset))
    assert_seen(seen, ("elbow", 0), T, 0.9, within_mm=0.03, within_deg=0.1)
    assert seen[0].x_mm == pytest.approx(plain.x_mm, abs=0.01)
    assert seen[0].y_mm == pytest.approx(plain.y_mm, abs=0.01)


def specks(part: shapely.Geometry) -> st.SearchStrategy[list[shapely.Geometry]]:
    """Dirt of up to 3 mm on the table, clear of a part and of the picture's border."""
    spot = st.builds(
        lambda u, v, r: shapely.Point(u, v).buffer(r),
        st.floats(30, SIZE[0] - 30),
        st.floats(30, SIZE[1] - 30),
        st.floats(1.0, 5.5),
    )
    return st.lists(spot, min_size=1, max_size=12).map(
        lambda found: [s for s in found if s.distance(part) > 12.0]
    )


ELBOW_SHAPE = silhouette(solid("elbow").mesh, laid(("elbow", 0), (21.0, -13.0), 0.9), CAMERA)


@few
@given(dirt=specks(ELBOW_SHAPE))
def test_dirt_on_the_table_changes_nothing(dirt: list[shapely.Geometry]) -> None:
    T, _, plain = dark_elbow()
    seen = backlit(picture([ELBOW_SHAPE, *dirt], seed=4))
    assert_seen(seen, ("elbow", 0), T, 0.9, within_mm=0.03, within_deg=0.1)
    assert seen[0].x_mm == pytest.approx(plain.x_mm, abs=0.005)
    assert seen[0].score == pytest.approx(plain.score, abs=0.01)


def test_dirt_at_the_parts_own_rim_moves_it_by_hundredths() -> None:
    T, _, _ = dark_elbow()
    rim = np.asarray(ELBOW_SHAPE.exterior.coords)[:-1]
    dirt = [shapely.Point(*((rim[i] + rim[i - 1]) / 2)).buffer(4.0) for i in (1, 3)]
    seen = backlit(picture([ELBOW_SHAPE, *dirt], seed=4))
    assert_seen(seen, ("elbow", 0), T, 0.9, within_mm=0.08, within_deg=0.2)


# --- mirror images ------------------------------------------------------------------------------


@cache
def other_hand() -> Solid:
    return solid_of(body("hand").mirror((1, 0, 0)), "other_hand")


@cache
def both_hands() -> Library:
    return make_library([compile_solid(s) for s in (solid("hand"), other_hand())], CAMERA)


def check_hands(is_other: bool, place: tuple[float, float], theta: float) -> None:
    shown = other_hand() if is_other else solid("hand")
    flat = next(p for p in stable_poses(shown) if abs(p.R[2, 2]) > 0.99)
    image = picture([shape_of(shown, resting(shown, flat.R, *place, theta))])
    assert [s.part for s in backlit(image, both_hands())] == [shown.name]
    # without its own kind in the library it is nobody, and not its partner
    (alone,) = backlit(image)
    assert alone.part == (None if is_other else "hand")


@few
@given(is_other=st.booleans(), place=places, theta=angles)
def test_a_part_is_never_named_as_its_mirror_image(
    is_other: bool, place: tuple[float, float], theta: float
) -> None:
    check_hands(is_other, place, theta)


@pytest.mark.slow
@many
@given(is_other=st.booleans(), place=places, theta=angles)
def test_a_part_is_never_named_as_its_mirror_image_at_length(
    is_other: bool, place: tuple[float, float], theta: float
) -> None:
    check_hands(is_other, place, theta)


@pytest.mark.parametrize("theta", [0.6, pytest.param(2.0, marks=pytest.mark.slow)])
def test_a_round_bar_is_not_ambiguous_with_itself_turned(theta: float) -> None:
    bar = solid_of(body("disc"), "bar")
    down = next(p for p in stable_poses(bar) if p.rolling)
    T = resting(bar, down.R, 10.0, 20.0, theta)
    known = make_library([compile_solid(bar)], CAMERA)
    (seen,) = backlit(picture([shape_of(bar, T)]), known)
    assert seen.part == "bar"
    assert seen.ambiguous_with == ()
    assert seen.score > 0.9


# --- under lamps --------------------------------------------------------------------------------


def lit_picture(of: Solid, T: Array, seed: int = 0) -> Grey:
    return Renderer(Scene(placed(of.mesh, T), None, TABLE), CAMERA, seed=seed).lit(RING)


def check_lit_anywhere(way: tuple[str, int], place: tuple[float, float], theta: float) -> None:
    T = laid(way, place, theta)
    # the bound for nineteen of twenty
    seen = front(lit_picture(solid(way[0]), T))
    assert_seen(seen, way, T, theta, within_mm=0.3, within_deg=0.5)


@pytest.mark.parametrize(
    ("way", "place", "theta"),
    [
        (("elbow", 0), (30.0, -20.0), 2.0),
        pytest.param(("hand", 0), (-35.0, 22.0), -1.1, marks=pytest.mark.slow),
    ],
)
def test_under_lamps_a_part_is_the_same_part_wherever_it_lies(
    way: tuple[str, int], place: tuple[float, float], theta: float
) -> None:
    check_lit_anywhere(way, place, theta)


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True)
@given(way=paths, place=places, theta=angles)
def test_under_lamps_a_part_is_the_same_part_wherever_it_lies_at_length(
    way: tuple[str, int], place: tuple[float, float], theta: float
) -> None:
    check_lit_anywhere(way, place, theta)


@pytest.mark.slow
@pytest.mark.xfail(
    strict=True,
    reason="the rim of an upper face and the foot of its wall towards the camera are an edge down "
    "and an edge up within 2 px: blurred, they push each other apart, and the part outwards",
)
@pytest.mark.parametrize("place", [(28.0, 22.0), (-30.0, -18.0)])
@pytest.mark.parametrize("theta", [2.0])
def test_under_lamps_a_part_is_not_pushed_away_from_the_camera(
    place: tuple[float, float], theta: float
) -> None:
    T = laid(("elbow", 0), place, theta)
    (seen,) = front(lit_picture(solid("elbow"), T))
    assert seen.T_world_part is not None
    away = motion("elbow", seen.T_world_part, T)[:2]
    outwards = np.array(place) - CAMERA.position_mm[:2]
    assert away @ outwards / np.linalg.norm(outwards) < 0.08


@cache
def lit_elbow() -> tuple[Array, Grey, Sighting]:
    T = laid(("elbow", 0), (21.0, -13.0), 0.9)
    image = lit_picture(solid("elbow"), T)
    (seen,) = front(image)
    return T, image, seen


@settings(max_examples=4, deadline=None, derandomize=True)
@given(gain=gains, offset=offsets)
def test_brighter_or_duller_lamps_show_the_same(gain: float, offset: float) -> None:
    T, image, plain = lit_elbow()
    seen = front(dimmed(image, gain, offset))
    assert_seen(seen, ("elbow", 0), T, 0.9, within_mm=0.3, within_deg=0.5)
    assert seen[0].x_mm == pytest.approx(plain.x_mm, abs=0.05)
    assert seen[0].y_mm == pytest.approx(plain.y_mm, abs=0.05)


@settings(max_examples=3, deadline=None, derandomize=True)
@given(dirt=specks(ELBOW_SHAPE), level=st.sampled_from([35, 160]))
def test_dirt_under_lamps_changes_nothing(dirt: list[shapely.Geometry], level: int) -> None:
    T, image, plain = lit_elbow()
    dirty = image.copy()
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    for spot in dirt:
        centre, radius = spot.centroid, np.sqrt(spot.area / np.pi)
        dirty[(u - centre.x) ** 2 + (v - centre.y) ** 2 < radius**2] = level
    seen = front(dirty)
    assert_seen(seen, ("elbow", 0), T, 0.9, within_mm=0.3, within_deg=0.5)
    assert seen[0].x_mm == pytest.approx(plain.x_mm, abs=0.05)
    assert seen[0].y_mm == pytest.approx(plain.y_mm, abs=0.05)


def other_hand_lit(theta: float) -> Grey:
    shown = other_hand()
    flat = next(p for p in stable_poses(shown) if abs(p.R[2, 2]) > 0.99)
    return lit_picture(shown, resting(shown, flat.R, 15.0, -10.0, theta))


@pytest.mark.parametrize("theta", [0.4, pytest.param(2.5, marks=pytest.mark.slow)])
def test_under_lamps_a_part_is_not_taken_for_its_mirror_image(theta: float) -> None:
    assert [s.part for s in front(other_hand_lit(theta), both_hands())] == ["other_hand"]


@pytest.mark.slow
@pytest.mark.parametrize("theta", np.arange(0.0, 6.28, 0.7))
def test_under_lamps_a_mirror_image_not_in_the_library_is_unknown(theta: float) -> None:
    assert [s.part for s in front(other_hand_lit(theta))] == [None]
