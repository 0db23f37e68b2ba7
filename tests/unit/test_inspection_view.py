"""One view against the CAD, on pictures rendered by the tests' own renderer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from cad_solids import Body, box
from lit_pictures import STRAY_GREY
from numpy.typing import NDArray
from shown_part import (
    CAMERA,
    LAMPS,
    LIMITS,
    blank,
    bore,
    boss,
    cross_bore,
    face_id,
    hand,
    moved,
    part,
    perfect,
    photograph,
    pocket,
    samples,
    shown,
    solid,
    task,
)

from controller.imaging import inverse_pose, transform
from controller.inspection import (
    Finding,
    FindingKind,
    Verdict,
    ViewPictures,
    ViewResult,
    WorldBox,
    inspect_view,
    judge,
)

Array = NDArray[np.float64]
FRONT = shown(8, 6)
VIEWS = {
    "front": FRONT,
    "turned": shown(20, 12, 5),
    "from the left": shown(-25, -8, 10),
    "side": shown(80, 0),
    "from below": shown(10, -60),
    # three sides of the outline are left, and a turn with a little more depth looks much the same
    "from behind": shown(155, 4, -173),
}
LEISURELY = ("front", "from the left")  # the other four say as much
SLIP = ((0.5, 0.3, -0.4), 0.6)  # as a jaw leaves it: mm, degrees


@cache
def right_pictures() -> ViewPictures:
    return photograph(perfect(), FRONT, hand(FRONT))


def look(pictures: ViewPictures, T: Array = FRONT) -> ViewResult:
    return inspect_view(part(), samples(), task(T), pictures)


def inspect(body: Body, T: Array = FRONT, T_true: Array | None = None) -> ViewResult:
    return look(photograph(body, T if T_true is None else T_true, hand(T)), T)


@cache
def right_view() -> ViewResult:
    return look(right_pictures())


@cache
def with_a_lump() -> ViewResult:
    return inspect(perfect() + box(5, 6, 6).translate((5, -19, 0)))


def darkness(seed: int = 0) -> NDArray[np.uint8]:
    noise = np.random.default_rng(seed).normal(STRAY_GREY, 1.8, CAMERA.size_px[::-1])
    return np.clip(np.round(noise), 0, 255).astype(np.uint8)


def of_kind(result: ViewResult, kind: FindingKind) -> list[Finding]:
    return [f for f in result.findings if f.kind is kind]


def away_mm(finding: Finding, at: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(finding.p_part_mm - np.array(at)))


@pytest.mark.parametrize(
    "view", [pytest.param(v, marks=pytest.mark.slow) if v in LEISURELY else v for v in VIEWS]
)
def test_a_perfect_part_that_sits_a_little_askew_has_no_findings(view: str) -> None:
    T = VIEWS[view]
    T_true = moved(T, *SLIP)

    result = inspect(perfect(), T, T_true)

    assert result.evaluated, result.reason
    assert result.findings == ()
    assert result.view_id == "v1"
    # across the view the pose is measured to hundredths, along it to tenths
    com = solid().centroid_mm[None]
    off = transform(result.T_world_part_known, com)[0] - transform(T_true, com)[0]
    assert np.abs(off[[0, 2]]).max() < 0.03
    assert abs(off[1]) < 0.4
    turn = result.T_world_part_known[:3, :3] @ T_true[:3, :3].T
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 0.15
    assert result.shift_mm == pytest.approx(np.linalg.norm(off + SLIP[0]), abs=0.1)
    assert result.turn_rad == pytest.approx(np.radians(SLIP[1]), abs=np.radians(0.15))
    assert result.residual_px < 0.15


def test_a_filled_bore_keeps_the_light_out() -> None:
    result = inspect((blank() + boss()) - cross_bore() - pocket())
    (dark,) = of_kind(result, FindingKind.EXTRA)
    assert dark.lamp == "backlit"
    assert away_mm(dark, (-11, 3, 12)) < 5
    assert face_id("cylinder", (-11, 3, 0)) in dark.face_ids
    # seen at 10 degrees the 24 mm bore of 10 mm lets a lens of 5.8 mm through
    assert 20 < dark.area_mm2 < 45
    # and under the lamp there is a surface where a wall in the dark was expected
    assert any(away_mm(f, (-11, 3, 0)) < 14 for f in of_kind(result, FindingKind.SURFACE))
    assert of_kind(result, FindingKind.MISSING) == []


def test_a_filled_pocket_that_no_outline_shows_is_found_by_its_shadow() -> None:
    result = inspect((blank() + boss()) - bore() - cross_bore())
    assert of_kind(result, FindingKind.EXTRA) == of_kind(result, FindingKind.MISSING) == []
    surface = of_kind(result, FindingKind.SURFACE)
    assert surface
    floor = face_id("plane", (8, -9, 6))
    assert any(floor in f.face_ids for f in surface)
    assert all(away_mm(f, (8, -9, 9)) < 12 for f in surface)


def test_a_missing_boss_lacks_its_shadow_seen_from_the_front() -> None:
    result = inspect(blank() - bore() - cross_bore() - pocket())
    assert of_kind(result, FindingKind.EXTRA) == of_kind(result, FindingKind.MISSING) == []
    surface = of_kind(result, FindingKind.SURFACE)
    assert surface
    assert all(away_mm(f, (12, 8, 12)) < 14 for f in surface)


def test_a_missing_boss_leaves_the_outline_empty_seen_from_the_side() -> None:
    result = inspect(blank() - bore() - cross_bore() - pocket(), VIEWS["side"])
    (gap,) = of_kind(result, FindingKind.MISSING)
    assert gap.lamp == "backlit"
    assert set(gap.face_ids) & {
        face_id("cylinder", (12, 8, 15)),
        face_id("plane", (12, 8, 18)),
    }
    # 12 x 6 mm, less the slack and what the front's edge hides at 80 degrees
    assert 40 < gap.area_mm2 < 72
    assert gap.p_part_mm[2] > 12


def test_a_corner_cut_off_by_five_millimetres_is_missing() -> None:
    # a prism of 5 x 5 mm off the lower left edge, all along the part's depth
    wedge = Body.cube((5 * np.sqrt(2), 5 * np.sqrt(2), 60), True).rotate((0, 0, 45))
    pictures = photograph(perfect() - wedge.translate((-23, -17, 0)), FRONT, hand(FRONT))
    result = look(pictures)
    (gap,) = of_kind(result, FindingKind.MISSING)
    assert gap.lamp == "backlit"
    assert away_mm(gap, (-21.3, -15.3, 12)) < 5
    # what has become bright, by the pictures themselves
    brighter = pictures.backlit.astype(int) - right_pictures().backlit > 60
    mm = CAMERA.mm_per_px(np.zeros(3))
    assert gap.area_mm2 == pytest.approx(brighter.sum() * mm**2, rel=0.1)
    assert of_kind(result, FindingKind.EXTRA) == []
    assert set(gap.face_ids) & {face_id("plane", (0, 0, 12)), face_id("plane", (-23, 0, 0))}


def test_a_block_too_much_is_extra_material() -> None:
    result = with_a_lump()
    (lump,) = of_kind(result, FindingKind.EXTRA)
    assert lump.lamp == "backlit"
    # 5 mm wide, 5 mm beyond the lower face
    assert 15 < lump.area_mm2 < 25
    assert lump.p_part_mm[0] == pytest.approx(5, abs=3)
    assert lump.p_part_mm[1] < -14
    assert of_kind(result, FindingKind.MISSING) == []


def test_a_defect_smaller_than_asked_is_no_finding() -> None:
    result = inspect(perfect() + box(1.2, 2, 1.2).translate((5, -17.4, 0)))
    assert result.evaluated
    assert result.findings == ()


def test_a_finding_tells_where_it_is_in_the_picture_and_on_the_part() -> None:
    (lump,) = of_kind(with_a_lump(), FindingKind.EXTRA)
    x0, y0, x1, y1 = lump.box_px
    assert x0 < lump.at_px[0] < x1
    assert y0 < lump.at_px[1] < y1
    (pixel,) = CAMERA.project(transform(FRONT, np.array([[5.0, -19.5, 0.0]])))
    assert lump.at_px == pytest.approx(pixel, abs=8)
    assert lump.size_mm == pytest.approx(np.hypot(5, 5), abs=1.5)


def test_the_outline_told_is_the_parts_own() -> None:
    result = right_view()
    corners = np.array([[x, y, z] for x in (-23, 23) for y in (-17, 17) for z in (-12, 12)])
    pixels = CAMERA.project(transform(FRONT, corners.astype(float)))
    assert result.outline_px.min(axis=0) == pytest.approx(pixels.min(axis=0), abs=2)
    assert result.outline_px.max(axis=0) == pytest.approx(pixels.max(axis=0), abs=2)


# --- views that prove nothing are not evaluated --------------------------------------------------


def assert_not_evaluated(result: ViewResult, reason: str) -> None:
    assert not result.evaluated
    assert reason in result.reason
    assert result.findings == ()
    assert not result.compared.any()
    assert np.isinf(result.residual_px)


@pytest.mark.parametrize(
    ("shift_mm", "turn_deg", "reason"),
    [
        ((4.0, 0, -3), 0.0, "slipped"),
        ((0.0, 0, -9), 1.0, "slipped"),
        ((0.0, 0, 0), 9.0, "slipped"),
        ((0.0, 0, 0), 180.0, "of the part's outline found"),
    ],
)
def test_a_part_that_is_not_where_the_jaws_hold_it_is_not_judged(
    shift_mm: tuple[float, float, float], turn_deg: float, reason: str
) -> None:
    # told before any lamp is asked for
    pictures = photograph(perfect(), moved(FRONT, shift_mm, turn_deg), hand(FRONT), lamps=())
    assert_not_evaluated(look(pictures), reason)


def test_no_part_at_all_is_not_judged() -> None:
    speck = box(1, 1, 1).translate((12, 8, 14))
    pictures = photograph(speck, FRONT, hand(FRONT), lamps=())
    assert_not_evaluated(look(pictures), "no outline of the part")


def test_a_dead_panel_is_not_judged() -> None:
    pictures = replace(right_pictures(), backlit=darkness())
    assert_not_evaluated(look(pictures), "is the panel's lamp on?")


def test_a_panel_that_burns_out_the_picture_is_not_judged() -> None:
    burnt = np.full_like(right_pictures().backlit, 255)
    assert not look(replace(right_pictures(), backlit=burnt)).evaluated


@pytest.mark.parametrize("lamp", ["ring", "side"])
def test_a_dead_lamp_is_not_taken_for_a_part_without_fault(lamp: str) -> None:
    pictures = right_pictures()
    result = look(replace(pictures, lit={**pictures.lit, lamp: darkness()}))
    assert_lamp_not_evaluated(result, lamp, "too little of the part's outline")


def test_a_lamp_behind_the_arm_lights_nothing_and_that_is_no_failure() -> None:
    arm = np.eye(4)
    arm[:3, 3] = -235, -310, 185  # half-way to the lamp, out of the picture
    holder = (*hand(FRONT), WorldBox(arm, np.full(3, 90.0)))
    pictures = photograph(perfect(), FRONT, holder)
    result = inspect_view(part(), samples(), task(FRONT, holder), pictures)
    assert result.evaluated
    assert result.failures == ()
    (side,) = (c for c in result.checks if c.name == "side")
    assert not side.compared.any()
    assert not [f for f in result.findings if f.lamp == "side"]


def assert_lamp_not_evaluated(result: ViewResult, lamp: str, reason: str) -> None:
    """The lamp's check is not made; the others are, and count for themselves."""
    assert result.evaluated
    checks = {c.name: c for c in result.checks}
    assert reason in checks[lamp].reason
    assert not checks[lamp].compared.any()
    assert not any(f.lamp == lamp for f in result.findings)
    assert all(not c.reason for name, c in checks.items() if name != lamp)
    assert any(lamp in failure and reason in failure for failure in result.failures)


def shifted(picture: NDArray[np.uint8], x_px: float, y_px: float) -> NDArray[np.uint8]:
    M = np.array([[1.0, 0, x_px], [0, 1, y_px]])  # noqa: N806 - OpenCV's name
    moved = cv2.warpAffine(picture, M, picture.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, dtype=np.uint8)


def soft(picture: NDArray[np.uint8], sigma_px: float) -> NDArray[np.uint8]:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), dtype=np.uint8)


@pytest.mark.parametrize("lamp", ["ring", "side"])
@pytest.mark.parametrize(("x_px", "y_px"), [(2.0, 0.0), (0.0, -2.0), (-1.6, 1.6), (4.0, 0.0)])
def test_a_lit_picture_shifted_against_the_backlit_one_is_not_evaluated(
    lamp: str, x_px: float, y_px: float
) -> None:
    pictures = right_pictures()
    lit = {**pictures.lit, lamp: shifted(pictures.lit[lamp], x_px, y_px)}
    assert_lamp_not_evaluated(look(replace(pictures, lit=lit)), lamp, "px beside the backlit one")


@pytest.mark.parametrize("lamp", ["ring", "side"])
@pytest.mark.parametrize("sigma_px", [1.5, 2.5])
def test_a_lit_picture_out_of_focus_is_not_evaluated(lamp: str, sigma_px: float) -> None:
    pictures = right_pictures()
    lit = {**pictures.lit, lamp: soft(pictures.lit[lamp], sigma_px)}
    assert_lamp_not_evaluated(look(replace(pictures, lit=lit)), lamp, "edges are")


@pytest.mark.parametrize("sigma_px", [2.0, 2.5])
def test_a_view_out_of_focus_is_not_evaluated(sigma_px: float) -> None:
    pictures = right_pictures()
    assert_not_evaluated(
        look(replace(pictures, backlit=soft(pictures.backlit, sigma_px))), "out of focus"
    )


def exposed(lamp: str, factor: float) -> tuple[ViewResult, NDArray[np.uint8]]:
    pictures = right_pictures()
    burnt = np.clip(pictures.lit[lamp].astype(float) * factor, 0, 255).astype(np.uint8)
    return look(replace(pictures, lit={**pictures.lit, lamp: burnt})), burnt


@pytest.mark.parametrize(("lamp", "factor"), [("ring", 2.5), ("side", 4.0)])
def test_a_lit_picture_exposed_too_long_is_not_evaluated(lamp: str, factor: float) -> None:
    result, _ = exposed(lamp, factor)
    assert_lamp_not_evaluated(result, lamp, "burnt out")


def test_what_is_burnt_out_is_not_compared_and_no_finding() -> None:
    result, burnt = exposed("side", 2.5)
    (check,) = (c for c in result.checks if c.name == "side")
    assert not [f for f in result.findings if f.lamp == "side"]
    pixels = (
        CAMERA.project(transform(result.T_world_part_known, samples().points_mm))
        .round()
        .astype(int)
    )
    soft = cv2.blur(burnt, (9, 9))
    height, width = burnt.shape
    u, v = np.clip(pixels, 0, [width - 1, height - 1]).T
    assert (soft[v, u] == 255).sum() > 10
    assert not check.compared[soft[v, u] == 255].any()


@pytest.mark.parametrize("view", VIEWS)
def test_good_pictures_raise_none_of_these_alarms(view: str) -> None:
    T = VIEWS[view]
    result = inspect(perfect(), T, moved(T, *SLIP))
    assert result.failures == ()


def test_a_spot_of_glare_in_one_picture_makes_a_part_doubtful_and_never_fails_it() -> None:
    pictures = right_pictures()
    glare = pictures.lit["side"].copy()
    (x, y) = CAMERA.project(transform(FRONT, np.array([[0.0, 12.0, 12.0]])))[0]
    cv2.circle(glare, (round(x), round(y)), 14, 255, -1)
    result = look(replace(pictures, lit={**pictures.lit, "side": glare}))
    assert any(f.lamp == "side" for f in result.findings)
    views = (result, replace(right_view(), view_id="v2"))
    got = judge(solid(), samples(), views, {}, 0.01, LIMITS)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.reasons[0].startswith("unconfirmed")


@pytest.mark.parametrize("lamp", ["ring", "side"])
def test_a_picture_that_was_not_taken_is_not_taken_for_one_without_fault(lamp: str) -> None:
    pictures = right_pictures()
    rest = {name: image for name, image in pictures.lit.items() if name != lamp}
    assert_not_evaluated(look(replace(pictures, lit=rest)), f"no picture under {lamp}")


def test_lamps_that_changed_places_do_not_go_unnoticed() -> None:
    pictures = right_pictures()
    ring, side = (pictures.lit[lamp.name] for lamp in LAMPS)
    swapped = look(replace(pictures, lit={"ring": side, "side": ring}))
    assert swapped.findings or swapped.failures


# --- what was seen -------------------------------------------------------------------------------


def test_only_what_faces_the_camera_and_nothing_hides_is_in_sight_and_less_is_compared() -> None:
    result = right_view()
    ids, seen = samples().face_ids, result.unobstructed
    share = {f.id: float(seen[ids == f.id].mean()) for f in solid().faces}
    compared = {f.id: float(result.compared[ids == f.id].mean()) for f in solid().faces}
    assert all(compared[i] <= share[i] for i in share)
    # a face of 12 mm, whose rim a defect of 3 mm does not fit on
    assert compared[face_id("plane", (12, 8, 18))] > 0.5
    assert compared[face_id("plane", (0, 0, 12))] > 0.6
    assert share[face_id("plane", (12, 8, 18))] > 0.95  # the boss, towards the camera
    assert share[face_id("plane", (8, -9, 6))] > 0.6  # the pocket's floor, between its walls
    assert share[face_id("plane", (0, 0, 12))] > 0.75  # the front; the boss and the hand hide some
    assert share[face_id("plane", (0, 0, -12))] == 0  # the back
    assert share[face_id("cylinder", (0, -9, -4))] == 0  # the bore across


def test_what_is_beside_the_hand_is_neither_judged_nor_counted_as_seen() -> None:
    result = right_view()
    points = transform(FRONT, samples().points_mm)
    pixels = CAMERA.project(points)
    for held in hand(FRONT)[:2]:
        local = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        corners = CAMERA.project(transform(held.T, local * held.half_mm))
        low, high = corners.min(axis=0), corners.max(axis=0)
        inside = ((pixels > low) & (pixels < high)).all(axis=1)
        # what stands clearly before a finger is hidden by none
        away, nearest = (
            np.linalg.norm(p - CAMERA.position_mm, axis=1)
            for p in (points, transform(held.T, local * held.half_mm))
        )
        inside &= away > nearest.min() - 1.0
        assert inside.sum() > 5
        assert not result.compared[inside].any()


def test_fingers_before_a_face_take_what_is_beside_them_and_fingers_behind_it_nothing() -> None:
    nearer = FRONT.copy()
    nearer[:3, 3] += 10.0 * FRONT[:3, 2]  # the fingers' front from 6 mm behind the face to 4 before
    hands = {"none": (), "behind": hand(FRONT), "before": hand(nearer)}
    views = {
        where: inspect_view(
            part(), samples(), task(FRONT, boxes), photograph(perfect(), FRONT, boxes)
        )
        for where, boxes in hands.items()
    }
    assert all(view.evaluated and view.findings == () for view in views.values())
    in_sight = {where: int(view.in_sight.sum()) for where, view in views.items()}
    assert in_sight["none"] == in_sight["behind"] > in_sight["before"]
    # a face's own scatter is another one where more of it is in sight
    more = views["before"].compared & ~views["none"].compared
    assert more.sum() <= 0.02 * views["none"].compared.sum()


def test_a_defect_behind_a_finger_is_not_judged_and_not_seen() -> None:
    # a dent in the left flank, wholly under the finger that presses there
    at = np.array([-23.0, 12, 0])
    T = VIEWS["turned"]
    result = inspect(perfect() - box(4, 6, 8).translate(tuple(at)), T)
    assert result.evaluated
    assert result.findings == ()
    under = np.linalg.norm(samples().points_mm - at, axis=1) < 4
    assert under.any()
    assert not result.compared[under].any()
    # the same dent lower down is in the open
    open_dent = inspect(perfect() - box(4, 6, 8).translate((-23, -4, 4)), T)
    assert any(away_mm(f, (-22, -4, 4)) < 8 for f in open_dent.findings)


def test_a_hand_the_task_does_not_know_of_is_extra_material() -> None:
    pictures = right_pictures()
    result = inspect_view(part(), samples(), task(FRONT, ()), pictures)
    assert not result.evaluated or any(f.kind is FindingKind.EXTRA for f in result.findings)


def test_the_measured_pose_can_stand_in_for_the_expected_one() -> None:
    # the caller takes the first view's pose as the true hold and expects the next from it
    T_true = moved(FRONT, *SLIP)
    pictures = photograph(perfect(), T_true, hand(FRONT))
    first = look(pictures)
    again = inspect_view(part(), samples(), task(first.T_world_part_known, hand(FRONT)), pictures)
    assert again.evaluated
    step = inverse_pose(first.T_world_part_known) @ again.T_world_part_known
    assert step[:3, 3] == pytest.approx([0, 0, 0], abs=0.3)
    assert again.shift_mm < first.shift_mm


def test_a_hold_that_was_measured_badly_does_not_hold_a_later_view_back() -> None:
    # along its own sight line the first view knew little: the next one sees that from aside
    T = VIEWS["side"]
    T_true = moved(T, (2.5, 0.0, -1.5), 5.0)
    pictures = photograph(perfect(), T_true, hand(T), lamps=())
    seen = replace(task(T), is_hold_measured=True, lamps=())
    result = inspect_view(part(), samples(), seen, pictures)
    assert result.evaluated, result.reason
    assert result.residual_px < 0.12


def test_a_fresh_grip_far_from_the_plan_is_measured_to_the_end() -> None:
    T = VIEWS["from behind"]
    pictures = photograph(perfect(), moved(T, (2.5, 0.0, -1.5), 5.0), hand(T), lamps=())
    result = inspect_view(part(), samples(), replace(task(T), lamps=()), pictures)
    assert result.evaluated, result.reason
    assert result.residual_px < 0.12


# --- marks on a face -----------------------------------------------------------------------------


def marked(lamp: str, size_mm: float, factor: float) -> ViewResult:
    """The right pictures with a spot on the front face, in one lamp's picture."""
    pictures = right_pictures()
    lit = pictures.lit[lamp].astype(float)
    (at,) = CAMERA.project(
        transform(right_view().T_world_part_known, np.array([[-3.0, 10.0, 12.0]]))
    )
    mm = CAMERA.mm_per_px(np.zeros(3))
    v, u = np.mgrid[0 : lit.shape[0], 0 : lit.shape[1]]
    inside = np.clip(0.5 * size_mm / mm + 0.5 - np.hypot(u - at[0], v - at[1]), 0, 1)
    lit *= 1 + (factor - 1) * cv2.GaussianBlur(inside, (0, 0), 0.7)
    return look(replace(pictures, lit={**pictures.lit, lamp: np.round(lit).astype(np.uint8)}))


@pytest.mark.parametrize("lamp", ["ring", "side"])
@pytest.mark.parametrize("factor", [0.6, 1.3])
def test_a_pit_of_two_millimetres_a_third_off_is_found(lamp: str, factor: float) -> None:
    (pit,) = marked(lamp, 2.0, factor).findings
    assert pit.kind.is_mark
    assert pit.lamp == lamp
    assert away_mm(pit, (-3, 10, 12)) < 1
    assert pit.size_mm == pytest.approx(2.0, rel=0.35)
    assert pit.outline_px is not None
    (middle,) = CAMERA.project(
        transform(right_view().T_world_part_known, np.array([[-3.0, 10.0, 12.0]]))
    )
    away = np.linalg.norm(pit.outline_px - middle, axis=1) * CAMERA.mm_per_px(np.zeros(3))
    assert away.mean() == pytest.approx(1.0, rel=0.4)  # the pit's radius
    assert np.sign(pit.contrast) == np.sign(factor - 1)


def test_beside_a_glow_there_is_no_mark_of_the_other_sign() -> None:
    """Light from a finger on a dark face: filters answer around it, where the face is as it was."""
    pictures = right_pictures()
    (at,) = CAMERA.project(transform(FRONT, np.array([[0.0, 5.0, 12.0]])))
    lit = pictures.lit["side"].astype(float)
    v, u = np.mgrid[0 : lit.shape[0], 0 : lit.shape[1]]
    lit *= 1 + 1.5 * np.exp(-0.5 * ((u - at[0]) ** 2 + (v - at[1]) ** 2) / 10.0**2)
    glowing = np.clip(lit, 0, 255).astype(np.uint8)
    result = look(replace(pictures, lit={**pictures.lit, "side": glowing}))
    marks = [f for f in result.findings if f.kind.is_mark]
    assert marks
    assert min(abs(f.contrast) for f in marks) > 0.05


def test_a_speck_of_dust_is_none() -> None:
    result = marked("side", 0.3, 0.3)
    assert result.findings == ()
    assert result.hints == ()


def test_the_smallest_mark_claimed_is_found_by_half_more() -> None:
    widths = next(c for c in right_view().checks if c.name == "side").smallest_mm["dent"]
    near = np.linalg.norm(samples().points_mm - [-3.0, 10.0, 12.0], axis=1) < 3
    claimed = float(np.median(widths[near & np.isfinite(widths)]))
    assert 0.5 < claimed < 3.0
    assert marked("side", 1.5 * claimed, 0.7).findings
