"""Dimensions of a plate whose pictures come from formulas of the tests' own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from plate_pictures import (
    HEIGHT_MM,
    NOMINAL,
    PIXEL_MM,
    Plate,
    asked,
    camera,
    length_edges,
    part,
    pictures,
    pose,
    rims,
    view,
)
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from controller.arrays import FloatArray
from controller.imaging import inverse_pose, transform
from controller.inspection import PosedPart, Verdict, ViewPictures, WorldBox
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgeLine,
    EdgePairGeometry,
    Look,
    RimGeometry,
)
from controller.inspection.dimensions import BACKLIT, PosedView, look, measure

DIAMETER, POSITION = CharacteristicKind.DIAMETER, CharacteristicKind.POSITION
TILTED = pose(22.0, 35.0)
SQUARE = pose(0.0)


@cache
def plate() -> PosedPart:
    return part()


@cache
def shown(tilt_deg: float, about_deg: float, built: Plate = NOMINAL) -> ViewPictures:
    return pictures(built, pose(tilt_deg, about_deg))


def tilted(built: Plate = NOMINAL, **options: object) -> PosedView:
    return view(shown(22.0, 35.0, built), TILTED, **options)  # type: ignore[arg-type]


def holes(kind: CharacteristicKind, *, datum: int | None = None) -> list[Characteristic]:
    body = plate().solid
    given = () if datum is None else rims(NOMINAL, datum, body)
    return [
        asked(kind, RimGeometry(rims(NOMINAL, i, body), given), 2 * bore.radius)
        if kind is DIAMETER
        else asked(kind, RimGeometry(rims(NOMINAL, i, body), given), 0.0)
        for i, bore in enumerate(NOMINAL.bores)
    ]


def looks(characteristic: Characteristic, seen: PosedView) -> dict[str, Look]:
    return {e.look.lamp: e.look for e in look(plate(), [characteristic], seen)[0]}


# --- holes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("lamp", [BACKLIT, "ring"])
def test_diameters_are_right_to_a_few_hundredths_of_a_pixel(index: int, lamp: str) -> None:
    found = looks(holes(DIAMETER)[index], tilted())[lamp]
    assert found.reason == ""
    true = 2 * NOMINAL.bores[index].radius
    assert found.measured_mm == pytest.approx(true, abs=0.05 * PIXEL_MM)
    assert abs(found.measured_mm - true) < 2 * found.u_mm < PIXEL_MM


def test_a_tilted_circle_is_not_placed_by_the_centre_of_its_ellipse() -> None:
    found = looks(holes(POSITION)[0], tilted())
    # fitting the ellipse's centre would put a bore of 9 mm radius, tilted by 22 degrees at 600 mm,
    # r² sin(t) cos(t) / z = 47 um off; near and far rim in one ellipse far more
    for one in found.values():
        assert one.reason == ""
        assert one.measured_mm < 0.005


@pytest.mark.parametrize("change", [-1.0, -0.25, 0.25, 1.0])
def test_a_bore_of_another_size_is_measured_as_it_is(change: float) -> None:
    built = NOMINAL.with_bore(2, radius=5.5 + change)
    one = looks(holes(DIAMETER)[2], tilted(built))[BACKLIT]
    assert one.reason == ""
    assert one.measured_mm == pytest.approx(11.0 + 2 * change, abs=2 * one.u_mm)
    assert 2 * one.u_mm < 0.1


def test_a_bore_out_of_place_is_measured_where_it_is() -> None:
    built = NOMINAL.with_bore(1, x=20.8, y=9.4)
    by_lamp = looks(holes(POSITION)[1], tilted(built))
    for one in by_lamp.values():
        if not one.reason:
            assert one.measured_mm == pytest.approx(1.0, abs=2 * one.u_mm)
    assert by_lamp[BACKLIT].reason == ""


def test_a_place_is_given_from_its_datum() -> None:
    # the whole pattern is 0.3 mm off: from the pose the bore is out of place, from the datum not
    moved = NOMINAL.with_bore(0, x=0.3)
    moved = moved.with_bore(1, x=20.3)
    seen = tilted(moved)
    by_pose = looks(holes(POSITION)[1], seen)[BACKLIT]
    by_datum = looks(holes(POSITION, datum=0)[1], seen)[BACKLIT]
    assert by_pose.measured_mm == pytest.approx(0.3, abs=0.02)
    assert by_datum.measured_mm < 0.02
    # the pose's error is in both, and falls out of their difference
    assert by_datum.budget["pose"] < 0.5 * by_pose.budget["pose"]


@pytest.mark.parametrize("foot_px", [2.2, 2.6, 3.2])
def test_a_bright_floor_does_not_draw_the_rim_above_it(foot_px: float) -> None:
    # a blind bore under a ring of lamps: its floor is lit, but for its border in the wall's shade
    one = shown(0.0, 0.0)
    seen = view(one, SQUARE)
    bore = NOMINAL.bores[1]
    rim = transform(SQUARE, np.array([[bore.x, bore.y, HEIGHT_MM]]))
    middle = seen.task.camera.project(rim)[0]
    rows, columns = np.mgrid[0 : one.backlit.shape[0], 0 : one.backlit.shape[1]]
    radius_px = bore.radius / seen.task.camera.mm_per_px(rim[0]) - foot_px
    far = np.hypot(columns - middle[0], rows - middle[1])
    lit = one.lit["ring"] + 120.0 * ndtr((radius_px - far) / np.hypot(0.8, 12**-0.5))
    bright = ViewPictures(one.backlit, {"ring": np.round(lit).astype(np.uint8)})
    found = looks(holes(DIAMETER)[1], view(bright, SQUARE))["ring"]
    assert found.reason == ""
    assert found.measured_mm == pytest.approx(2 * bore.radius, abs=0.1 * PIXEL_MM)


def lit_bore(rim_step: float, patch_px: float, turn_rad: float) -> tuple[Look, float]:
    """Return the look at a bore whose wall is lit from some way down, and the patch's diameter.

    Parameters
    ----------
    rim_step : by which the wall is darker than the plate, where it shows beside the patch [grey]
    patch_px : from the rim to where the wall is bright
    turn_rad : so far to either side of the left of the picture the darker wall shows
    """
    one = shown(0.0, 0.0)
    seen = view(one, SQUARE)
    bore = NOMINAL.bores[1]
    rim = transform(SQUARE, np.array([[bore.x, bore.y, HEIGHT_MM]]))
    x, y = seen.task.camera.project(rim)[0]
    rows, columns = np.mgrid[0 : one.backlit.shape[0], 0 : one.backlit.shape[1]]
    far, angle = np.hypot(columns - x, rows - y), np.arctan2(rows - y, columns - x)
    radius_px = bore.radius / seen.task.camera.mm_per_px(rim[0])
    soft = float(np.hypot(0.8, 12**-0.5))
    wall = np.where(np.abs(angle) > np.pi - turn_rad, rim_step, 0.0)
    level = 120.0 - wall * ndtr((radius_px - far) / soft)
    level += (80.0 + wall) * ndtr((radius_px - patch_px - far) / soft)
    noise = np.random.default_rng(8).normal(0.0, 1.0, level.shape)
    lit = np.where(far < radius_px + 15.0, np.round(level + noise), one.lit["ring"])
    bright = ViewPictures(one.backlit, {"ring": lit.astype(np.uint8)})
    found = looks(holes(DIAMETER)[1], view(bright, SQUARE))["ring"]
    return found, 2 * bore.radius * (1.0 - patch_px / radius_px)


def test_where_light_in_a_bore_begins_is_not_its_rim_where_the_rim_shows_as_well() -> None:
    # the wall is as bright as the plate but for a third of the way round, where it is in the shade
    found, patch_mm = lit_bore(30.0, 4.0, np.radians(60.0))
    true_mm = 2 * NOMINAL.bores[1].radius
    assert abs(patch_mm - true_mm) > PIXEL_MM
    assert found.measured_mm != pytest.approx(true_mm, abs=PIXEL_MM)
    assert abs(found.measured_mm - true_mm) <= 2 * found.u_mm


def test_a_bore_with_nothing_else_round_it_is_as_small_as_it_looks() -> None:
    found, patch_mm = lit_bore(0.0, 4.0, 0.0)
    assert found.reason == ""
    assert found.measured_mm == pytest.approx(patch_mm, abs=0.1 * PIXEL_MM)
    assert 2 * found.u_mm < PIXEL_MM


def test_an_edge_that_light_hides_a_part_of_has_a_value_that_decides_nothing() -> None:
    one = shown(22.0, 35.0)
    lit = one.lit["ring"].copy()
    x, _ = view(one, TILTED).task.camera.project(
        transform(TILTED, np.array([[NOMINAL.bores[0].x, 0.0, HEIGHT_MM]]))
    )[0]  # fmt: skip
    grain = np.random.default_rng(5).normal(40, 1.5, lit.shape).round().astype(np.uint8)
    # from here on in the dark: of a rim of 63 px radius the quarter where cos > 45 / 63
    lit[:, round(x) + 45 :] = grain[:, round(x) + 45 :]
    dark = np.minimum(grain, 8)  # nothing shows before the panel
    characteristic = replace(holes(DIAMETER)[0], source="ISO 2768-m")
    for built, value in ((lit, 18.0), (grain, None)):
        seen = view(ViewPictures(dark, {"ring": built}), TILTED)
        (found,) = measure(plate(), [characteristic], [seen])
        assert "found where it must show" in found.reason
        assert found.verdict is (Verdict.NOT_EVALUATED if value is None else Verdict.INDETERMINATE)
        if value is not None:
            assert found.measured_mm == pytest.approx(value, abs=0.05)
            assert not found.is_disputed


def waved(picture: FloatArray, T: FloatArray, middle_rad: float, by_px: float) -> FloatArray:
    """A picture whose edge of the first bore bulges at an angle, and is dented 45 degrees off."""
    rows, columns = np.mgrid[0 : picture.shape[0], 0 : picture.shape[1]].astype(np.float64)
    at = np.column_stack([columns.ravel(), rows.ravel()])
    into = inverse_pose(T)
    eye = transform(into, camera().position_mm[None])[0]
    d = camera().sight_lines(at) @ into[:3, :3].T
    on_top = eye + ((HEIGHT_MM - eye[2]) / d[:, 2])[:, None] * d
    angle = np.arctan2(on_top[:, 1], on_top[:, 0])
    round_it = np.column_stack([-np.sin(angle), np.cos(angle), np.zeros(len(angle))])
    along = camera().project(transform(T, on_top + 0.1 * round_it)) - at
    out = np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    source = at - by_px * np.cos(4 * (angle - middle_rad))[:, None] * out
    x, y = source.T.reshape(2, *picture.shape).astype(np.float32)
    return np.asarray(cv2.remap(picture.astype(np.float32), x, y, cv2.INTER_CUBIC))


@pytest.mark.parametrize("by_px", [-0.1, 0.1])
@pytest.mark.parametrize("start_rad", [0.8, 1.6])
def test_light_may_bend_a_short_arc_seen_flat(start_rad: float, by_px: float) -> None:
    T = pose(55.0, 20.0)
    one = shown(55.0, 20.0)
    upper = rims(NOMINAL, 0, plate().solid)[0]
    start = np.array([np.cos(start_rad), np.sin(start_rad), 0.0])
    quarter = replace(upper, start=start, sweep_rad=np.pi / 2)
    wanted = asked(CharacteristicKind.RADIUS, RimGeometry((quarter,)), 9.0, 3.0)
    bent = waved(one.lit["ring"], T, start_rad + np.pi / 4, by_px)
    lit = np.clip(np.round(bent), 0, 255).astype(np.uint8)
    found = looks(wanted, view(ViewPictures(one.backlit, {"ring": lit}), T))["ring"]
    assert found.reason == ""
    # a tenth of a pixel is what light is known to do; the arc is too flat to show that it is bent
    assert 0.1 < abs(found.measured_mm - 9.0) < 2 * found.u_mm < 0.4


@pytest.mark.parametrize("lamp", [BACKLIT, "ring"])
@pytest.mark.parametrize(("made", "turn"), [(0, 0.0), (24, 0.0), (24, 0.25), (24, 0.58)])
def test_a_coarse_mesh_is_told_from_a_part_that_is_round(made: int, turn: float, lamp: str) -> None:
    # corners on the circle: the mean of the chords' diameter is 4/3 of their height less
    height_mm = 9.0 * (1 - np.cos(np.pi / 24))
    coarse = part(sides=24)
    wanted = asked(DIAMETER, RimGeometry(rims(NOMINAL, 0, coarse.solid)), 18.0)
    seen = view(pictures(NOMINAL.with_bore(0, sides=made, turn=turn), TILTED), TILTED)
    (found,) = (e.look for e in look(coarse, [wanted], seen)[0] if e.look.lamp == lamp)
    assert found.reason == ""
    assert found.measured_mm == pytest.approx(18.0, abs=0.2 * 4 / 3 * height_mm)
    assert abs(found.measured_mm - 18.0) < 2 * found.u_mm
    # were it not known which of the two it is, it would be half of the difference
    assert found.budget["CAD facets"] < 0.5 * 0.5 * 4 / 3 * height_mm


def test_square_on_the_wall_seen_flat_is_in_the_uncertainty() -> None:
    seen = view(shown(0.0, 0.0), SQUARE)
    one = looks(holes(DIAMETER)[0], seen)[BACKLIT]
    # the far rim is nearer to the axis in the picture by r h / z; a wall may be bright or dark
    wall = NOMINAL.bores[0].radius * HEIGHT_MM / 600.0
    assert one.reason == ""
    assert one.budget["walls seen flat"] == pytest.approx(2 * wall / np.sqrt(12), rel=0.3)
    assert abs(one.measured_mm - 18.0) < 2 * one.u_mm


# --- uncertainty --------------------------------------------------------------------------------


def test_the_uncertainty_covers_errors_of_the_pose() -> None:
    sigma = (0.15, 0.003)
    rng = np.random.default_rng(12)
    characteristics = [*holes(DIAMETER), *holes(POSITION)]
    inside = total = 0
    sizes = []
    true = [2 * bore.radius for bore in NOMINAL.bores]
    for _ in range(25):
        T = pose_off(TILTED, rng.normal(0, sigma[0], 3), rng.normal(0, sigma[1], 3))
        seen = view(shown(22.0, 35.0), T, sigma=sigma)
        for k, found in enumerate(look(plate(), characteristics, seen)):
            for e in found:
                if e.look.reason:
                    continue
                off = e.look.measured_mm - (true[k] if k < 3 else 0.0)
                sizes.append(abs(off) / e.look.u_mm / 2)
                inside += sizes[-1] <= 1
                total += 1
    assert total > 100
    assert inside >= 0.95 * total
    # and is no larger than it must be
    assert np.mean(sizes) > 0.15


def pose_off(T: FloatArray, shift_mm: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """A pose off by a shift of the centre of mass and a small rotation about it."""
    centre = transform(T, plate().solid.centroid_mm[None])[0]
    x, y, z = turn_rad
    turn = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]])
    u, _, vt = np.linalg.svd(turn)
    off = T.copy()
    off[:3, :3] = u @ vt @ T[:3, :3]
    off[:3, 3] = u @ vt @ (T[:3, 3] - centre) + centre + shift_mm
    return off


def test_depth_is_scale() -> None:
    near, far = (view(shown(22.0, 35.0), TILTED, sigma=(mm, 1e-6)) for mm in (0.01, 0.5))
    length = asked(CharacteristicKind.LENGTH, length_edges(NOMINAL, plate().solid), 60.0)
    budget = [looks(length, seen)[BACKLIT].budget["pose"] for seen in (near, far)]
    # dL / L = dZ / Z, for all but the little that tilt makes of a shift
    assert budget[1] == pytest.approx(60.0 * 0.5 / 600.0, rel=0.25)
    assert budget[0] == pytest.approx(budget[1] / 50, rel=0.01)


def test_each_uncertainty_is_named_and_their_squares_sum_up() -> None:
    one = looks(holes(DIAMETER)[0], tilted())[BACKLIT]
    assert one.u_mm == pytest.approx(np.sqrt(sum(v**2 for v in one.budget.values())), rel=1e-6)
    assert {"edge noise", "pose", "lens", "temperature", "scale"} <= set(one.budget)
    # aluminium by 5 K
    assert one.budget["temperature"] == pytest.approx(18.0 * 5 * 23e-6)


# --- edges --------------------------------------------------------------------------------------


@pytest.mark.parametrize("change", [0.0, 0.4, -0.4])
def test_the_length_of_the_plate(change: float) -> None:
    built = Plate(length=60.0 + change)
    length = asked(CharacteristicKind.LENGTH, length_edges(NOMINAL, plate().solid), 60.0)
    one = looks(length, tilted(built))[BACKLIT]
    assert one.reason == ""
    assert one.measured_mm == pytest.approx(60.0 + change, abs=2 * one.u_mm)
    assert one.measured_mm == pytest.approx(60.0 + change, abs=0.012)


def test_a_straight_edge_is_straight() -> None:
    edges = length_edges(NOMINAL, plate().solid)
    straight = asked(CharacteristicKind.STRAIGHTNESS, edges, 0.0)
    one = looks(straight, view(shown(0.0, 0.0), SQUARE))[BACKLIT]
    assert one.reason == ""
    assert one.measured_mm < 2 * one.u_mm


def test_a_round_hole_is_round() -> None:
    body = plate().solid
    form = asked(CharacteristicKind.ROUNDNESS, RimGeometry(rims(NOMINAL, 0, body)), 0.0)
    one = looks(form, tilted())["ring"]
    assert one.reason == ""
    assert one.measured_mm < 2 * one.u_mm


def test_the_angle_of_two_sides() -> None:
    body = plate().solid
    edges = length_edges(NOMINAL, body)
    end = edges.one[0]
    top = end.faces[1]
    side = next(f.id for f in body.faces if f.kind == "plane" and f.normal[1] < -0.9)
    low = EdgeLine(np.array([-30.0, -21, HEIGHT_MM]), np.array([30.0, -21, HEIGHT_MM]), (side, top))
    geometry = EdgePairGeometry((end,), (low,), np.array([0.0, 0, 1]), edges.one_face, side)
    angle = asked(CharacteristicKind.ANGLE, geometry, np.pi / 2, 0.01)
    one = looks(angle, view(shown(0.0, 0.0), SQUARE))[BACKLIT]
    assert one.reason == ""
    assert one.measured_mm == pytest.approx(np.pi / 2, abs=2 * one.u_mm)
    assert one.u_mm < np.radians(0.1)


@pytest.mark.parametrize("is_first", [True, False])
def test_a_face_without_a_straight_edge_leaves_a_length_open(is_first: bool) -> None:
    edges = length_edges(NOMINAL, plate().solid)
    none = (edges.one, ()) if is_first else ((), edges.other)
    geometry = EdgePairGeometry(*none, edges.direction, edges.one_face, edges.other_face)
    length = asked(CharacteristicKind.LENGTH, geometry, 60.0, 0.3)
    (found,) = measure(plate(), [length], [view(shown(0.0, 0.0), SQUARE)])
    assert found.measured_mm is None
    assert found.verdict is Verdict.NOT_EVALUATED
    assert found.reason


# --- self-checks --------------------------------------------------------------------------------


def test_a_rim_behind_the_gripper_is_not_measured() -> None:
    bore = NOMINAL.bores[1]
    at = transform(TILTED, np.array([[bore.x, bore.y, HEIGHT_MM + 30.0]]))[0]
    T = np.eye(4)
    T[:3, 3] = at
    box = WorldBox(T, np.array([12.0, 12.0, 2.0]))
    seen = tilted(holder=(box,))
    by_lamp = looks(holes(DIAMETER)[1], seen)
    assert {one.reason for one in by_lamp.values()} == {"no edge of it is in sight"}
    assert looks(holes(DIAMETER)[2], seen)[BACKLIT].reason == ""


def changed(by: Callable[[FloatArray], FloatArray]) -> PosedView:
    one = shown(22.0, 35.0)

    def applied(picture: FloatArray) -> FloatArray:
        return np.clip(np.round(by(picture.astype(float))), 0, 255).astype(np.uint8)

    lit = {name: applied(p) for name, p in one.lit.items()}
    return view(ViewPictures(applied(one.backlit), lit), TILTED)


@pytest.mark.parametrize(
    ("by", "word"),
    [
        (lambda p: 0 * p + 8, "found"),
        (lambda p: gaussian_filter(p, 2.6), "wide"),
        (lambda p: 1.6 * p, "burnt out"),
    ],
    ids=["lamp off", "defocused", "burnt out"],
)
def test_bad_pictures_are_not_measured(by: Callable[[FloatArray], FloatArray], word: str) -> None:
    one = looks(holes(DIAMETER)[0], changed(by))[BACKLIT]
    assert word in one.reason


def test_a_bore_that_is_not_there_is_not_measured() -> None:
    built = Plate(bores=NOMINAL.bores[:2])
    for one in looks(holes(DIAMETER)[2], tilted(built)).values():
        assert "found where it must show" in one.reason


def test_a_chipped_rim_keeps_its_diameter_or_is_not_measured() -> None:
    one = shown(22.0, 35.0)
    picture = one.backlit.copy()
    # a bite of 8 px at the rim of the largest bore lets light through
    x, y = np.round(view(one, TILTED).task.camera.project(
        transform(TILTED, np.array([[9.0, 0.0, HEIGHT_MM]]))
    )[0]).astype(int)  # fmt: skip
    rows, columns = np.mgrid[0 : picture.shape[0], 0 : picture.shape[1]]
    picture[np.hypot(columns - x, rows - y) < 8] = 210
    found = looks(holes(DIAMETER)[0], view(ViewPictures(picture, one.lit), TILTED))[BACKLIT]
    assert found.reason or found.measured_mm == pytest.approx(18.0, abs=2 * found.u_mm)


# --- all views ----------------------------------------------------------------------------------


def test_two_views_of_all_holes_make_one_value_each() -> None:
    other = pose(18.0, 200.0)
    views = [tilted(), view(pictures(NOMINAL, other), other, "v01", grasp=1)]
    characteristics = holes(DIAMETER)
    results = measure(plate(), characteristics, views)
    for bore, result in zip(NOMINAL.bores, results, strict=True):
        assert result.views == ("v00", "v01")
        assert result.verdict is Verdict.PASS
        assert result.measured_mm == pytest.approx(2 * bore.radius, abs=result.U_mm)
        assert result.U_mm is not None
        assert result.U_mm < min(2 * one.u_mm for one in result.looks if not one.reason) + 1e-9


def test_a_view_without_anything_to_measure_says_why() -> None:
    built = Plate(bores=NOMINAL.bores[:2])
    (result,) = measure(plate(), holes(DIAMETER)[2:], [tilted(built)])
    assert result.measured_mm is None
    assert result.U_mm is None
    assert result.verdict is Verdict.NOT_EVALUATED
    assert "found where it must show" in result.reason
    assert measure(plate(), holes(DIAMETER)[2:], [])[0].reason == "no view of it"


def test_a_datum_in_another_view_will_do() -> None:
    # in each view the gripper hides one of the two bores
    body = plate().solid
    geometry = RimGeometry(rims(NOMINAL, 2, body), rims(NOMINAL, 1, body))
    place = asked(POSITION, geometry, 0.0)
    built = NOMINAL.with_bore(2, x=-18.4)
    views = []
    for i, hidden in enumerate((1, 2)):
        bore = NOMINAL.bores[hidden]
        T = np.eye(4)
        T[:3, 3] = transform(TILTED, np.array([[bore.x, bore.y, HEIGHT_MM + 30.0]]))[0]
        box = WorldBox(T, np.array([12.0, 12.0, 2.0]))
        views.append(view(shown(22.0, 35.0, built), TILTED, f"v{i}", (box,), grasp=i))
    (alone,) = measure(plate(), [place], views[:1])
    assert alone.verdict is Verdict.NOT_EVALUATED
    (both,) = measure(plate(), [place], views)
    assert both.measured_mm == pytest.approx(0.4, abs=0.02)
    assert both.verdict is Verdict.FAIL
    assert "beyond the upper limit" in both.reason
    # nothing falls out: the uncertainty is that of two places from the pose
    (one,) = measure(plate(), [asked(POSITION, RimGeometry(geometry.rims), 0.0)], views)
    assert both.U_mm is not None
    assert one.U_mm is not None
    assert both.U_mm > one.U_mm


def test_a_slots_length_is_from_end_to_end() -> None:
    # two round ends on axes of their own, here whole circles of unlike radius
    body = plate().solid
    ends = RimGeometry((*rims(NOMINAL, 1, body), *rims(NOMINAL, 2, body)))
    length = float(np.hypot(38.0, 19.0) + 4.0 + 5.5)
    slot = asked(CharacteristicKind.LENGTH, ends, length)
    built = NOMINAL.with_bore(1, x=20.2, radius=4.1)
    one = looks(slot, tilted(built))[BACKLIT]
    true = float(np.hypot(38.2, 19.0) + 4.1 + 5.5)
    assert one.reason == ""
    assert one.measured_mm == pytest.approx(true, abs=0.012)
    assert abs(one.measured_mm - true) < 2 * one.u_mm


def test_a_thickness_shows_by_the_rims_of_a_bore() -> None:
    body = plate().solid
    upper, lower = rims(NOMINAL, 0, body)
    geometry = EdgePairGeometry(
        (), (), np.array([0.0, 0, 1.0]), lower.beyond, upper.beyond, (lower,), (upper,)
    )
    thick = asked(CharacteristicKind.DISTANCE, geometry, HEIGHT_MM, 0.3)
    one = looks(thick, view(shown(38.0, 70.0), pose(38.0, 70.0)))[BACKLIT]
    assert one.reason == ""
    assert one.measured_mm == pytest.approx(HEIGHT_MM, abs=2 * one.u_mm)
    assert 2 * one.u_mm < 0.3


@pytest.mark.parametrize("is_measured", [True, False])
def test_what_no_edge_shows_is_not_measured(is_measured: bool) -> None:
    depth = asked(CharacteristicKind.DISTANCE, RimGeometry(rims(NOMINAL, 0, plate().solid)), 8.0)
    if not is_measured:
        depth = replace(depth, is_measured=False, exempt="no camera shows a depth")
    between = [holes(DIAMETER)[1], depth, holes(DIAMETER)[2]]
    first, found, last = measure(plate(), between, [tilted()])
    assert found.measured_mm is None
    assert found.verdict is Verdict.NOT_EVALUATED
    assert found.reason == (
        "no edge of the CAD model shows it" if is_measured else "no camera shows a depth"
    )
    assert first.measured_mm == pytest.approx(8.0, abs=0.05)
    assert last.measured_mm == pytest.approx(11.0, abs=0.05)
