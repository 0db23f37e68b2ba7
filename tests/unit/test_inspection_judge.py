"""From views to a verdict: no pass with a surface nobody can account for."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cad_solids import box, rod, solid_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from controller.cad import Solid, SurfaceSamples, sample_surface
from controller.inspection import (
    Finding,
    Kind,
    Limits,
    PartVerdict,
    Verdict,
    ViewResult,
    judge,
)

Array = NDArray[np.float64]
LIMITS = Limits(smallest_defect_mm=3.0)
# half the disc of 3 mm
SMALLEST_MM2 = np.pi * 9 / 8


@cache
def plate() -> Solid:
    return solid_of(box(60, 40, 10) - rod(4, 30, 48).translate((15, 5, 0)), "plate")


@cache
def samples() -> SurfaceSamples:
    return sample_surface(plate())


def everything() -> NDArray[np.bool_]:
    return np.ones(len(samples().points_mm), dtype=bool)


def all_but(*faces: int) -> NDArray[np.bool_]:
    return ~np.isin(samples().face_ids, faces)


def view(
    name: str = "v1",
    seen: NDArray[np.bool_] | None = None,
    findings: tuple[Finding, ...] = (),
    reason: str = "",
) -> ViewResult:
    return ViewResult(
        view_id=name,
        evaluated=not reason,
        reason=reason,
        T_world_part=np.eye(4),
        shift_mm=0.1,
        turn_rad=0.0,
        residual_px=0.3,
        findings=findings,
        seen=everything() if seen is None else seen,
        outline_px=np.zeros((0, 2)),
    )


def finding(
    area_mm2: float,
    at: tuple[float, float, float] = (0.0, 0.0, 5.0),
    lamp: str = "ring",
    faces: tuple[int, ...] = (0,),
    kind: Kind = Kind.SURFACE,
) -> Finding:
    return Finding(kind, lamp, area_mm2, 3.0, (10.0, 10.0), (5, 5, 15, 15), np.array(at), faces)


def verdict(
    *views: ViewResult, unseen: dict[int, str] | None = None, coverage: float = 0.9
) -> PartVerdict:
    return judge(plate(), samples(), views, unseen or {}, coverage, LIMITS)


def bore_id() -> int:
    return next(f.id for f in plate().faces if f.kind == "cylinder")


def test_a_part_seen_whole_without_findings_passes() -> None:
    got = verdict(view())
    assert got.verdict is Verdict.PASS
    assert got.covered_fraction == pytest.approx(1.0)
    assert {f.verdict for f in got.faces} == {Verdict.PASS}
    assert {f.reason for f in got.faces} == {""}
    assert got.confirmed == ()
    (sentence,) = got.reasons
    assert "100.0 %" in sentence
    assert "3 mm" in sentence


def test_every_surface_is_in_the_ledger_and_the_areas_add_up_to_the_whole() -> None:
    got = verdict(view(seen=all_but(0, 3)))
    assert [f.face_id for f in got.faces] == [f.id for f in plate().faces]
    assert [f.label for f in got.faces] == [f.label for f in plate().faces]
    assert sum(f.area_mm2 for f in got.faces) == pytest.approx(plate().mesh.area)
    seen = sum(f.area_mm2 * f.seen_fraction for f in got.faces)
    assert seen / plate().mesh.area == pytest.approx(got.covered_fraction)


def test_views_add_up_and_each_face_names_those_that_showed_it() -> None:
    one, two = samples().face_ids == 0, samples().face_ids == 1
    got = verdict(view("a", seen=one), view("b", seen=one | two), coverage=0.1)
    assert got.faces[0].views == ("a", "b")
    assert got.faces[1].views == ("b",)
    assert got.faces[2].views == ()
    area = plate().faces[0].area_mm2 + plate().faces[1].area_mm2
    assert got.covered_fraction == pytest.approx(area / plate().mesh.area)


def test_too_little_seen_is_indeterminate_and_says_how_much_is_asked() -> None:
    got = verdict(view(seen=all_but(0)), unseen={0: "the hand is in front of it"}, coverage=0.9)
    assert got.verdict is Verdict.INDETERMINATE
    assert "90.0 % is asked" in got.reasons[0]


def test_a_face_nobody_can_account_for_forbids_a_pass_whatever_else_was_seen() -> None:
    hidden = bore_id()
    got = verdict(view(seen=all_but(hidden)), coverage=0.5)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.faces[hidden].verdict is Verdict.NOT_EVALUATED
    assert any(plate().faces[hidden].label in reason for reason in got.reasons)


def test_a_face_too_small_for_the_smallest_difference_is_accounted_for_as_such() -> None:
    block = box(40, 30, 10) + box(1.0, 1.0, 1.0).translate((0, 0, 5.0))
    solid = solid_of(block)
    points = sample_surface(solid, 4.0)
    speck = solid.faces[-1]
    assert speck.area_mm2 < 0.5 * np.pi / 4 * 3.0**2  # of a difference 3 mm across
    seen = points.face_ids != speck.id
    got = judge(solid, points, (view(seen=seen),), {}, 0.5, LIMITS)
    assert got.verdict is Verdict.PASS
    assert got.faces[speck.id].verdict is Verdict.NOT_EVALUATED
    assert "smaller than the smallest difference" in got.faces[speck.id].reason


def test_a_face_in_sight_only_beside_the_hand_is_accounted_for_as_such() -> None:
    hidden = bore_id()
    here = view(seen=all_but(hidden))
    got = verdict(replace(here, beside_hand=~all_but(hidden)), coverage=0.5)
    assert got.verdict is Verdict.PASS
    assert got.faces[hidden].verdict is Verdict.NOT_EVALUATED
    assert "hand" in got.faces[hidden].reason


def test_a_face_the_plan_could_not_show_is_accounted_for_by_its_reason() -> None:
    hidden = bore_id()
    got = verdict(view(seen=all_but(hidden)), unseen={hidden: "deeper than wide"}, coverage=0.5)
    assert got.verdict is Verdict.PASS
    face = got.faces[hidden]
    assert (face.verdict, face.reason) == (Verdict.NOT_EVALUATED, "deeper than wide")
    assert face.seen_fraction == 0


def test_a_face_seen_in_part_says_what_became_of_the_rest() -> None:
    top = np.flatnonzero(samples().face_ids == 0)
    seen = everything()
    seen[top[: len(top) // 4]] = False
    told = verdict(view(seen=seen), coverage=0.5).faces[0]
    assert told.verdict is Verdict.PASS
    share = (len(top) // 4) / len(top)
    assert told.reason.startswith(f"{100 * share:.0f} % of it")
    planned = verdict(view(seen=seen), unseen={0: "under the fingers"}, coverage=0.5).faces[0]
    assert planned.reason == "under the fingers"
    seen[top[: 3 * len(top) // 4]] = False
    assert verdict(view(seen=seen), coverage=0.1).faces[0].verdict is Verdict.NOT_EVALUATED


def test_no_views_at_all_prove_nothing_even_where_nothing_is_asked() -> None:
    reasons = {f.id: "not shown" for f in plate().faces}
    assert verdict(coverage=0.0, unseen=reasons).verdict is Verdict.INDETERMINATE


def test_a_view_that_was_not_evaluated_shows_nothing_and_is_told() -> None:
    broken = view("v2", reason="ring gives no light: is the lamp on?", findings=(finding(99.0),))
    got = verdict(view("v1", seen=all_but(0)), broken, unseen={0: "hidden"}, coverage=0.1)
    assert got.verdict is Verdict.PASS
    assert got.faces[0].verdict is Verdict.NOT_EVALUATED
    assert got.reasons[-1] == "view v2 not evaluated: ring gives no light: is the lamp on?"
    assert verdict(broken).verdict is Verdict.INDETERMINATE


def test_one_large_finding_fails_the_part_and_its_faces() -> None:
    got = verdict(view(findings=(finding(2.6 * SMALLEST_MM2, faces=(1, 2)),)))
    assert got.verdict is Verdict.FAIL
    assert [f.face_id for f in got.faces if f.verdict is Verdict.FAIL] == [1, 2]
    assert "differs from the CAD" in got.faces[1].reason
    ((view_id, confirmed),) = got.confirmed
    assert view_id == "v1"
    assert confirmed.face_ids == (1, 2)
    assert "surface differs at" in got.reasons[0]
    assert "view v1, ring" in got.reasons[0]


def test_a_single_weak_finding_is_doubtful_and_keeps_the_part_from_passing() -> None:
    got = verdict(view(findings=(finding(1.5 * SMALLEST_MM2, faces=(1,)),)))
    assert got.verdict is Verdict.INDETERMINATE
    assert got.confirmed == ()
    assert got.reasons[0].startswith("doubtful: ")
    # nor does the surface it lies on pass
    assert got.faces[1].verdict is Verdict.INDETERMINATE
    assert "weak" in got.faces[1].reason
    assert got.faces[0].verdict is Verdict.PASS


@pytest.mark.parametrize(
    ("other_view", "other_lamp", "away_mm", "expected"),
    [
        ("v2", "ring", 3.0, Verdict.FAIL),
        ("v1", "side", 3.0, Verdict.FAIL),
        ("v1", "ring", 3.0, Verdict.INDETERMINATE),  # the same picture is no second witness
        ("v2", "side", 9.0, Verdict.INDETERMINATE),  # another place is another matter
    ],
)
def test_two_weak_findings_of_one_place_confirm_each_other(
    other_view: str, other_lamp: str, away_mm: float, expected: Verdict
) -> None:
    first = finding(1.2 * SMALLEST_MM2)
    second = finding(1.2 * SMALLEST_MM2, at=(away_mm, 0.0, 5.0), lamp=other_lamp)
    if other_view == "v1":
        got = verdict(view("v1", findings=(first, second)))
    else:
        got = verdict(view("v1", findings=(first,)), view("v2", findings=(second,)))
    assert got.verdict is expected


def test_confirmed_findings_come_largest_first() -> None:
    findings = tuple(
        finding(area * SMALLEST_MM2, at=(20.0 * i, 0, 5)) for i, area in enumerate((3, 9, 5))
    )
    got = verdict(view(findings=findings))
    areas = [f.area_mm2 for _, f in got.confirmed]
    assert areas == sorted(areas, reverse=True)
    assert len(areas) == 3


def test_a_fail_outweighs_doubt_and_poor_coverage() -> None:
    weak, strong = finding(1.1 * SMALLEST_MM2, at=(25.0, 0, 5)), finding(5 * SMALLEST_MM2)
    got = verdict(view(seen=all_but(0, 1, 2), findings=(weak, strong)))
    assert got.verdict is Verdict.FAIL


def test_the_smallest_area_is_half_the_disc_of_the_smallest_defect() -> None:
    assert LIMITS.min_area_mm2 == pytest.approx(SMALLEST_MM2)
    assert Limits(smallest_defect_mm=1.0).min_area_mm2 == pytest.approx(np.pi / 8)


faces = st.integers(0, 6)
some_findings = st.lists(
    st.builds(
        finding,
        st.floats(SMALLEST_MM2, 60),
        st.tuples(st.floats(-30, 30), st.floats(-20, 20), st.floats(-5, 5)),
        st.sampled_from(["backlit", "ring", "side"]),
        st.lists(faces, min_size=1, max_size=3, unique=True).map(tuple),
        st.sampled_from(list(Kind)),
    ),
    max_size=3,
).map(tuple)
some_views = st.lists(
    st.builds(
        view,
        st.sampled_from(["v1", "v2", "v3"]),
        st.lists(faces, unique=True).map(lambda hidden: all_but(*hidden)),
        some_findings,
        st.sampled_from(["", "", "outline off"]),
    ),
    max_size=4,
)


@settings(max_examples=150, deadline=None)
@given(some_views, st.dictionaries(faces, st.just("hidden by the hand")), st.floats(0, 1))
def test_a_pass_means_that_everything_is_seen_or_explained_and_nothing_was_found(
    views: list[ViewResult], unseen: dict[int, str], coverage: float
) -> None:
    got = judge(plate(), samples(), views, unseen, coverage, LIMITS)
    used = [v for v in views if v.evaluated]
    found = [f for v in used for f in v.findings]
    assert sum(f.area_mm2 for f in got.faces) == pytest.approx(plate().mesh.area)
    assert got.reasons
    assert (got.verdict is Verdict.FAIL) == bool(got.confirmed)
    assert (got.verdict is Verdict.FAIL) == any(f.verdict is Verdict.FAIL for f in got.faces)
    if got.verdict is Verdict.PASS:
        assert used
        assert not found
        assert got.covered_fraction >= coverage
        for face in got.faces:
            assert face.verdict is Verdict.PASS or face.reason
    if any(f.area_mm2 >= 2.5 * SMALLEST_MM2 for f in found):
        assert got.verdict is Verdict.FAIL
    elif found:
        assert got.verdict in (Verdict.FAIL, Verdict.INDETERMINATE)
    assert 0 <= got.covered_fraction <= 1 + 1e-9
