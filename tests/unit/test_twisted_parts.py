"""CAD files twisted against good specimens: what truth says is what was changed, and what shows."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import bench_traps
import bench_twisted
from inspection_counts import by_kind, is_only_uncovered, outcome
from inspection_truth import is_at_place
from trace_held_defects import NoPlaceError, tolerance_mm
from trace_held_parts import block, drawn, rod
from trap_pictures import FAULTS, LAMPS
from twisted_features import CHAMFERS_MM
from twisted_good import Good, good_of
from twisted_parts import KINDS, twisted
from twisted_sight import visible_views
from twisted_whole import is_handed, is_turned

Words = dict[str, Any]
CAMERA: Words = {
    "size_px": [1280, 1024],
    "K": [[3600.0, 0, 640], [0, 3600.0, 512], [0, 0, 1]],
    "distortion": [0.0] * 5,
    "T_world_cam": [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 900], [0, 0, 0, 1]],
}


def good(name: str, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Good:
    family, number = name.split("_")
    part = drawn(family, int(number))
    holes = [
        {
            "id": h.id,
            "axis": h.axis.tolist(),
            "nominal_d_mm": h.diameter_mm,
            "nominal_ends": [h.mouth_mm.tolist(), h.bottom_mm.tolist()],
            "exists": True,
            "true_d_mm": h.diameter_mm + 0.04,
            "true_ends": [h.mouth_mm.tolist(), h.bottom_mm.tolist()],
        }
        for h in part.holes
    ]
    return good_of(
        {"specimen": "s0001", "part": name, "cls": "good", "kind": "as_built", "holes": holes,
         "scale": scale, "scale_about": [0.0, 0.0, 0.0], "poses": [], "seed": 1}
    )  # fmt: skip


def some(kind: str, specimen: Good, count: int = 3) -> list[Any]:
    """Return twists of several seeds; those of a part that has no place are left out."""
    out = []
    for seed in range(40):
        try:
            out.append(twisted(specimen, kind, np.random.default_rng(seed)))
        except NoPlaceError:
            continue
        if len(out) == count:
            break
    assert out
    return out


@pytest.fixture(scope="module")
def plate() -> Good:
    return good("plate_3")


def volumes(specimen: Good, twist: Any) -> tuple[float, float]:
    """Return what the CAD file has more than the part, and less."""
    more, less = twist.body - specimen.body, specimen.body - twist.body
    return float(more.volume()), float(less.volume())


def test_a_hole_more_in_the_file_is_as_wide_and_deep_as_truth_says(plate: Good) -> None:
    for twist in some("hole_missing", plate):
        more, less = volumes(plate, twist)
        dims = twist.truth["dims"]
        assert more < 1e-3
        assert less == pytest.approx(np.pi / 4 * dims["hole_d"] ** 2 * dims["depth"], rel=0.02)
        added = [h for h in twist.truth["holes"] if not h["exists"]]
        assert [h["id"] for h in added] == twist.truth["faces"] == ["added"]


def test_a_hole_less_in_the_file_is_filled_flush(plate: Good) -> None:
    for twist in some("hole_extra", plate):
        more, less = volumes(plate, twist)
        gone = {h.id for h in plate.part.holes} - {h["id"] for h in twist.truth["holes"]}
        (hole,) = [h for h in plate.part.holes if h.id in gone]
        assert less < 1e-3
        assert more == pytest.approx(np.pi / 4 * hole.diameter_mm**2 * hole.depth_mm, rel=0.02)


@pytest.mark.parametrize(("kind", "sign"), [("hole_small", -1), ("hole_large", 1)])
def test_a_resized_hole_is_beyond_its_tolerance_as_built(plate: Good, kind: str, sign: int) -> None:
    for twist in some(kind, plate):
        (name,) = twist.truth["faces"]
        (hole,) = [h for h in twist.truth["holes"] if h["id"] == name]
        off = sign * (hole["true_d_mm"] - hole["nominal_d_mm"])
        assert off > tolerance_mm(hole["nominal_d_mm"])
        assert off < 1.0 + 0.04 + 1e-9  # the largest change, and what the part was built off


def test_a_shifted_hole_is_further_off_than_the_part_allows_anywhere(plate: Good) -> None:
    size = np.ptp(np.array(plate.body.bounding_box()).reshape(2, 3), axis=0)
    for twist in some("hole_position", plate):
        (hole,) = [h for h in twist.truth["holes"] if h["id"] in twist.truth["faces"]]
        off = np.linalg.norm(np.subtract(hole["true_ends"][0], hole["nominal_ends"][0]))
        assert off > tolerance_mm(float(np.linalg.norm(size)))
        more, less = volumes(plate, twist)
        assert more == pytest.approx(less, rel=0.05)  # as much is filled as is cut


def test_a_hole_that_is_drawn_deeper_cuts_only_below_its_bottom(plate: Good) -> None:
    for twist in some("hole_half_deep", plate):
        (hole,) = [h for h in twist.truth["holes"] if h["id"] in twist.truth["faces"]]
        was = np.linalg.norm(np.subtract(*hole["true_ends"]))
        now = np.linalg.norm(np.subtract(*hole["nominal_ends"]))
        more, less = volumes(plate, twist)
        assert more < 1e-3
        assert less == pytest.approx(np.pi / 4 * hole["nominal_d_mm"] ** 2 * (now - was), rel=0.02)


def test_a_hole_of_another_depth_keeps_its_mouth_and_its_width(plate: Good) -> None:
    for twist in some("hole_depth_off", plate):
        (hole,) = [h for h in twist.truth["holes"] if h["id"] in twist.truth["faces"]]
        was = np.linalg.norm(np.subtract(*hole["true_ends"]))
        now = np.linalg.norm(np.subtract(*hole["nominal_ends"]))
        assert 0.2 <= abs(now / was - 1) <= 0.4
        assert abs(now - was) > tolerance_mm(float(now))
        assert hole["nominal_ends"][0] == hole["true_ends"][0]
        expected = np.pi / 4 * hole["nominal_d_mm"] ** 2 * abs(now - was)
        assert sum(volumes(plate, twist)) == pytest.approx(expected, rel=0.02)


def test_a_cut_less_in_the_file_only_adds_and_a_moved_one_is_as_large(plate: Good) -> None:
    for twist in some("cut_extra", plate):
        more, less = volumes(plate, twist)
        assert more > 10
        assert less < 1e-3
    for twist in some("cut_moved", plate):
        by = np.array(twist.truth["dims"]["shift_mm"])
        more, less = volumes(plate, twist)
        assert 0.5 <= np.abs(by).max() <= 1.0
        if by[2] == 0:  # along the plate, slot and pocket keep their volume
            assert more == pytest.approx(less, rel=1e-3)


def test_a_notch_takes_away_less_than_its_ball_and_touches_the_edge(plate: Good) -> None:
    for twist in some("notch_missing", plate):
        more, less = volumes(plate, twist)
        assert more < 1e-3
        assert 0 < less < twist.truth["size_mm"] ** 3


@pytest.mark.parametrize("kind", ["boss_missing", "rib_missing"])
def test_a_body_more_in_the_file_stands_on_the_part(plate: Good, kind: str) -> None:
    for twist in some(kind, plate):
        more, less = volumes(plate, twist)
        dims = twist.truth["dims"]
        base = np.pi / 4 * dims["d"] ** 2 if "d" in dims else dims["long"] * dims["wide"]
        assert less < 1e-3
        assert more == pytest.approx(base * dims["high"], rel=0.02)


def test_a_boss_less_in_the_file_is_a_step_of_the_part(plate: Good) -> None:
    (twist, *_) = some("boss_extra", plate)
    boss = next(s for s in plate.part.steps if s.name == "boss")
    more, less = volumes(plate, twist)
    assert more < 1e-3
    assert less > 0
    assert twist.truth["place_mm"] == pytest.approx(boss.place_mm.tolist())


def test_a_face_is_off_by_what_truth_says_to_the_other_side(plate: Good) -> None:
    before = np.array(plate.body.bounding_box()).reshape(2, 3)
    for twist in some("face_off", plate):
        n = np.array(twist.truth["faces"][0]["normal"])
        after = np.array(twist.body.bounding_box()).reshape(2, 3)
        moved = (after - before)[1 if n.sum() > 0 else 0] @ n  # of the file, outwards
        assert moved == pytest.approx(-twist.truth["dims"]["off_mm"], abs=1e-6)


def test_a_face_off_by_less_than_its_tolerance_as_built_is_no_defect() -> None:
    # ten per cent larger than drawn: a file that is larger by 0.5 to 1 mm is nearer to the part
    size = np.ptp(np.array(good("plate_3").body.bounding_box()).reshape(2, 3), axis=0)
    stretch = 1 + 2 * 0.7 / size  # each side out by 0.7
    for twist in some("face_off", good("plate_3", tuple(stretch)), 8):
        by = twist.truth["dims"]["off_mm"]
        n = np.abs(twist.truth["faces"][0]["normal"])
        out = abs(float(np.array(twist.truth["place_mm"]) @ n * ((stretch - 1) @ n)))
        assert by > 0 or abs(by + out) > tolerance_mm(float(size @ n))


def test_a_chamfer_takes_away_its_triangle(plate: Good) -> None:
    for twist in some("chamfer_missing", plate):
        more, less = volumes(plate, twist)
        leg, length = twist.truth["dims"]["leg"], twist.truth["dims"]["length"]
        assert leg in CHAMFERS_MM
        assert more < 1e-3
        assert less == pytest.approx(leg**2 / 2 * length, rel=0.45)  # 45 to 135 degrees
        assert less < leg**2 / 2 * length * 1.01


def test_a_block_is_its_mirror_image_and_a_block_with_three_unlike_corners_is_not() -> None:
    plain = block((0, 0, 0), (30, 20, 10))
    assert is_turned(plain.mirror([1.0, 0, 0]), plain)
    handed = plain
    for at, d in (((4, 4, 10), 3.0), ((25, 5, 10), 4.0), ((5, 16, 10), 5.0)):
        handed = handed - rod(np.array([*at[:2], 5.0]), np.array([*at[:2], 11.0]), d, 0.01)
    assert not is_turned(handed.mirror([1.0, 0, 0]), handed)
    assert is_turned(handed.rotate((20, 30, 40)).translate((5, 6, 7)), handed)


def test_a_turned_body_with_an_open_axis_is_found_by_turning() -> None:
    disc = rod(np.zeros(3), np.array([0.0, 0, 8]), 40.0, 0.3)
    for a in np.arange(3) * 2 * np.pi / 3:
        x, y = 14 * np.cos(a), 14 * np.sin(a)
        disc = disc - rod(np.array([x, y, -1.0]), np.array([x, y, 9.0]), 7.0, 0.3)
    assert is_turned(disc.rotate((0, 0, 13.0)), disc)


def test_a_hub_with_a_keyway_a_flat_and_a_pin_has_a_hand() -> None:
    assert is_handed("hub_5")


def test_every_change_keeps_one_solid_and_changes_it(plate: Good) -> None:
    for kind in set(KINDS) - {"wrong_part"}:
        (twist,) = some(kind, plate, 1)
        assert twist.truth["cls"] == "defect"
        assert twist.truth["kind"] == kind
        assert len([b for b in twist.body.decompose() if b.volume() > 1]) == 1
        assert sum(volumes(plate, twist)) > 0.01


def test_the_same_seed_draws_the_same_change(plate: Good) -> None:
    a, b = (twisted(plate, "hole_position", np.random.default_rng(5)) for _ in range(2))
    assert a.truth == b.truth


def test_a_finding_beside_the_change_is_at_its_place_and_one_far_off_is_not(plate: Good) -> None:
    for kind in ("hole_missing", "hole_extra", "boss_missing", "chamfer_missing"):
        (twist, *_) = some(kind, plate)
        place = np.array(twist.truth["place_mm"])
        line = {"event": "finding", "size_mm": 1.0, "verdict": "fail"}
        assert is_at_place(twist.truth, line | {"p_part_mm": place.tolist()})
        assert not is_at_place(twist.truth, line | {"p_part_mm": (place + 80).tolist()})


# ------------------------------------------------------------------ sight


def pose(turn: float = 0.0, at: tuple[float, float, float] = (0, 0, 200)) -> list[list[float]]:
    c, s = np.cos(turn), np.sin(turn)  # about the world's x axis
    return [[1, 0, 0, at[0]], [0, c, -s, at[1]], [0, s, c, at[2]], [0, 0, 0, 1]]


def seen(views: list[tuple[list[list[float]], list[Words]]], change: Any) -> list[str]:
    plain = block((-20, -15, 0), (20, 15, 10))
    words = {"camera": CAMERA, "views": [
        {"id": f"v{i}", "gripper_boxes": boxes} for i, (_, boxes) in enumerate(views)]}  # fmt: skip
    poses = [{"T_world_part_true": T} for T, _ in views]
    return visible_views(words, poses, plain, change(plain))


def _bored(plain: Any) -> Any:
    """A blind hole in the upper face."""
    return plain - rod(np.array([5.0, 0, 5]), np.array([5.0, 0, 11]), 4.0, 0.01)


def test_a_blind_hole_shows_from_above_and_not_from_below_or_the_side() -> None:
    views = [(pose(), []), (pose(np.pi), []), (pose(np.pi / 2), [])]
    assert seen(views, _bored) == ["v0"]


def test_a_box_before_the_change_hides_it() -> None:
    over = {"T": pose(at=(5, 0, 240)), "half_mm": [4, 4, 2]}
    beside = {"T": pose(at=(-12, 0, 240)), "half_mm": [4, 4, 2]}
    assert seen([(pose(), [over]), (pose(), [beside])], _bored) == ["v1"]


def test_a_change_beyond_the_picture_shows_nowhere() -> None:
    assert seen([(pose(at=(400, 0, 200)), [])], _bored) == []


def test_a_boss_more_shows_from_the_side_as_well() -> None:
    def bossed(plain: Any) -> Any:
        return plain + rod(np.array([0.0, 0, 9]), np.array([0.0, 0, 15]), 6.0, 0.01)

    assert seen([(pose(), []), (pose(np.pi / 2), []), (pose(np.pi), [])], bossed) == ["v0", "v1"]


# ------------------------------------------------------------------ counting


def ends(verdict: str, *reasons: str) -> Words:
    return {"event": "verdict", "verdict": verdict, "reasons": list(reasons), "seconds": 2.0}


UNCOVERED = "F7 bore 7.5 mm: 0 % compared, 50 % is required; in no view that was evaluated"


def test_only_uncovered_faces_stop_a_pass() -> None:
    assert is_only_uncovered(ends("pass"), [])
    assert is_only_uncovered(ends("indeterminate", UNCOVERED), [])
    assert not is_only_uncovered(ends("indeterminate"), [])
    assert not is_only_uncovered(ends("fail", UNCOVERED), [])
    assert not is_only_uncovered(
        ends("indeterminate", UNCOVERED, "hole 4 mm, diameter: 4.1 mm with U = 0.1 mm"), []
    )
    finding = {"event": "finding", "verdict": "indeterminate", "kind": "burr", "view": "v00",
               "lamp": "ring", "size_mm": 1.0, "p_part_mm": [0, 0, 0]}  # fmt: skip
    assert not is_only_uncovered(ends("indeterminate", UNCOVERED), [finding])


def test_rows_count_verdicts_and_places_by_kind(plate: Good) -> None:
    (twist, *_) = some("hole_missing", plate)
    truth = twist.truth | {"visible_views": ["v0"], "poses": [{}]}
    there = {"event": "finding", "verdict": "fail", "kind": "missing", "view": "v00",
             "lamp": "ring", "size_mm": 1.0, "p_part_mm": truth["place_mm"]}  # fmt: skip
    done = [
        outcome(truth, "hole_missing", 1, "", [there, ends("fail", "missing")], ""),
        outcome(truth, "hole_missing", 2, "", [ends("pass")], ""),
        outcome(truth, "hole_missing", 3, "", [ends("indeterminate", UNCOVERED)], ""),
        outcome(truth, "hole_missing", 4, "", [], "no answer in 900 s"),
    ]
    good_one = outcome(truth, "rewritten", 0, "", [ends("indeterminate", UNCOVERED)], "")
    row = by_kind([*done, good_one], "rewritten")["hole_missing"]
    assert [row[k] for k in ("n", "pass", "fail", "indeterminate", "error")] == [4, 1, 1, 1, 1]
    assert row["found"] == 1
    assert row["only_uncovered"] == 2  # the PASS is one of them
    assert row["alike"] == 2  # as many reasons as the good one has
    assert row["silent"] == 3
    # 1 of 4, one-sided 95 %: the p of which four draws give one or none with 5 %
    p = row["pass_below"]
    assert (1 - p) ** 4 + 4 * p * (1 - p) ** 3 == pytest.approx(0.05, abs=1e-9)


def test_a_fail_is_for_the_faults_sake_where_the_untouched_set_has_none(plate: Good) -> None:
    truth = plate.truth | {"poses": [{}]}
    failed, passed = [ends("fail", "stain")], [ends("pass")]
    done = [outcome(truth, bench_traps.UNTOUCHED, 0, "", passed, ""),
            outcome(truth, "hair", 1, "", failed, ""),
            outcome(truth, "hair", 2, "", passed, "")]  # fmt: skip
    told = bench_traps.report([replace(o, is_shown=True) for o in done])
    assert told["hair"]["for_its_sake"] == told["all faults"]["for_its_sake"] == 1
    assert told["all faults"]["n"] == 2
    bad = [outcome(truth, bench_traps.UNTOUCHED, 0, "", failed, ""), *done[1:]]
    told = bench_traps.report([replace(o, is_shown=True) for o in bad])
    assert told["hair"]["for_its_sake"] == 0


def test_changes_that_no_view_shows_are_counted_apart(plate: Good) -> None:
    truth = plate.truth | {"poses": [{}]}
    told = bench_twisted.report([
        replace(outcome(truth, "rewritten", 0, "", [ends("pass")], ""), is_shown=True),
        outcome(truth | {"cls": "defect"}, "hole_missing", 1, "", [ends("pass")], ""),
    ])  # fmt: skip
    assert told["good"]["rewritten"]["pass"] == 1
    assert told["in a view"] == {}
    assert told["in no view"]["hole_missing"]["pass"] == 1


# ------------------------------------------------------------------ faults


@pytest.mark.parametrize("kind", FAULTS)
def test_every_fault_changes_pictures_and_leaves_what_it_was_given(kind: str) -> None:
    rng = np.random.default_rng(3)
    panel = np.full((240, 320), 220, np.uint8)
    panel[60:180, 80:240] = 10
    lit = [rng.integers(20, 180, panel.shape, np.uint8) for _ in range(9)]
    names = {LAMPS[0]: 0, LAMPS[1]: 1, LAMPS[2]: 2}
    before = [
        {lamp: panel - np.uint8(v) if i == 0 else lit[3 * v + i] for lamp, i in names.items()}
        for v in range(3)
    ]
    kept = [{lamp: p.copy() for lamp, p in view.items()} for view in before]
    other = [{lamp: np.full_like(panel, 90) for lamp in LAMPS} for _ in range(2)]
    after = [dict(view) for view in before]
    json.dumps(FAULTS[kind](after, np.random.default_rng(1), other), default=float)
    assert all((a[k] == b[k]).all() for a, b in zip(before, kept, strict=True) for k in LAMPS)
    changed = [
        (i, lamp) for i, view in enumerate(before) for lamp in LAMPS
        if lamp not in after[i] or (after[i][lamp] != view[lamp]).any()
    ]  # fmt: skip
    assert changed
    if kind.endswith("_one"):
        assert len({i for i, _ in changed}) == 1
    for view in after:
        for picture in view.values():
            assert picture.dtype == np.uint8
            assert picture.shape == panel.shape
