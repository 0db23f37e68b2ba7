"""From views to a verdict: no pass while a surface is unaccounted for."""

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
    OUTLINE,
    Check,
    Finding,
    FindingKind,
    InspectionLimits,
    PartVerdict,
    Unjudged,
    Verdict,
    ViewResult,
    judge,
)
from controller.inspection.edge_evidence import EdgeEvidence, FaceEdges

Array = NDArray[np.float64]
LIMITS = InspectionLimits(smallest_defect_mm=3.0)
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


def turned(deg: float) -> Array:
    T = np.eye(4)
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    T[:2, :2] = [[c, -s], [s, c]]
    return T


def view(
    name: str = "v1",
    compared: NDArray[np.bool_] | None = None,
    findings: tuple[Finding, ...] = (),
    reason: str = "",
    turn_deg: float = 0.0,
) -> ViewResult:
    return ViewResult(
        view_id=name,
        evaluated=not reason,
        reason=reason,
        T_world_part_expected=turned(turn_deg),
        T_world_part_measured=turned(turn_deg),
        shift_mm=0.1,
        turn_rad=0.0,
        residual_px=0.3,
        findings=findings,
        compared=everything() if compared is None else compared,
        outline_px=np.zeros((0, 2)),
    )


def all_in_sight(one: ViewResult) -> ViewResult:
    lit = Check("ring", "", one.compared, 3.0, 0.0)
    return replace(one, unobstructed=everything(), checks=(lit,))


def finding(
    area_mm2: float,
    at: tuple[float, float, float] = (0.0, 0.0, 5.0),
    lamp: str = "ring",
    faces: tuple[int, ...] = (0,),
    kind: FindingKind = FindingKind.SURFACE,
) -> Finding:
    x, y = 300.0 + 5 * at[0], 300.0 + 5 * at[1]  # about where it shows
    box = int(x) - 5, int(y) - 5, int(x) + 5, int(y) + 5
    return Finding(kind, lamp, area_mm2, 3.0, (x, y), box, np.array(at), faces)


def verdict(
    *views: ViewResult,
    unseen: dict[int, str] | None = None,
    coverage: float = 0.9,
    left_out: dict[int, str] | None = None,
    planned: dict[str, NDArray[np.bool_]] | None = None,
    find_mm: dict[str, float] | None = None,
) -> PartVerdict:
    return judge(
        plate(), samples(), views, unseen or {}, coverage, LIMITS, left_out or {}, planned or {},
        find_mm=find_mm or {},
    )  # fmt: skip


def everywhere(weak: float, **more: object) -> tuple[ViewResult, ViewResult]:
    """The same finding in two views, the part turned by 40 degrees between them."""
    f = finding(weak * SMALLEST_MM2, **more)  # type: ignore[arg-type]
    return view("v1", findings=(f,)), view("v2", findings=(replace(f),), turn_deg=40.0)


def bore_id() -> int:
    return next(f.id for f in plate().faces if f.kind == "cylinder")


def test_a_part_seen_whole_without_findings_passes() -> None:
    got = verdict(view())
    assert got.verdict is Verdict.PASS
    assert got.compared_fraction == pytest.approx(1.0)
    assert {f.verdict for f in got.faces} == {Verdict.PASS}
    assert {f.reason for f in got.faces} == {""}
    assert got.findings == ()
    (sentence,) = got.reasons
    assert "100.0 % of the surface compared" in sentence


def check(name: str, size_mm: float, length_mm: float = 0.0, reason: str = "") -> Check:
    compared = everything() & (reason == "")
    return Check(name, reason, compared, size_mm, length_mm)


def test_a_pass_claims_what_the_bluntest_check_could_have_found_and_no_more() -> None:
    one = replace(view("a"), checks=(check(OUTLINE, 0.4, 2.0), check("ring", 3.0)))
    two = replace(view("b"), checks=(check(OUTLINE, 0.6, 2.4), check("side", 3.0)))
    (sentence,) = verdict(one, two).reasons
    assert "no outline off by 0.6 mm or more over 2.4 mm" in sentence
    assert "no area of 3 mm or more half as bright as predicted, or twice as bright" in sentence
    assert "beyond the tolerances of its faces" in sentence
    (only_outline,) = verdict(replace(view(), checks=(check(OUTLINE, 0.4, 2.0),))).reasons
    assert "bright" not in only_outline


def test_every_surface_is_in_the_ledger_and_the_areas_add_up_to_the_whole() -> None:
    got = verdict(view(compared=all_but(0, 3)))
    assert [f.face_id for f in got.faces] == [f.id for f in plate().faces]
    assert [f.label for f in got.faces] == [f.label for f in plate().faces]
    assert sum(f.area_mm2 for f in got.faces) == pytest.approx(plate().mesh.area)
    compared = sum(f.area_mm2 * f.compared_fraction for f in got.faces)
    assert compared / plate().mesh.area == pytest.approx(got.compared_fraction)


def test_views_add_up_and_each_face_names_those_that_compared_it() -> None:
    one, two = samples().face_ids == 0, samples().face_ids == 1
    got = verdict(view("a", compared=one), view("b", compared=one | two), coverage=0.1)
    assert got.faces[0].views == ("a", "b")
    assert got.faces[1].views == ("b",)
    assert got.faces[2].views == ()
    area = plate().faces[0].area_mm2 + plate().faces[1].area_mm2
    assert got.compared_fraction == pytest.approx(area / plate().mesh.area)


def test_too_little_verified_of_what_can_be_seen_is_indeterminate_and_says_how_much() -> None:
    half = np.arange(len(samples().points_mm)) % 3 > 0  # two thirds of each face
    got = verdict(all_in_sight(view(compared=half)), coverage=0.9)
    assert got.verdict is Verdict.INDETERMINATE
    (short,) = got.reasons
    assert f"{100 * got.verified_fraction:.1f} % of what can be seen is verified" in short
    assert "90.0 % is required" in short
    assert got.verified_fraction == pytest.approx(2 / 3, abs=0.02)


def test_what_can_be_seen_is_in_sight_or_planned_and_not_left_out() -> None:
    top = samples().face_ids == 0
    share = plate().faces[0].area_mm2 / plate().mesh.area
    one = view(compared=top)
    assert verdict(one, coverage=0.1).verified_fraction == pytest.approx(1.0)
    planned = {"v1": everything()}
    got = verdict(one, coverage=0.1, planned=planned)
    assert got.verified_fraction == pytest.approx(share, abs=0.01)
    rest = {f.id: "gauged by hand" for f in plate().faces if f.id}
    got = verdict(one, coverage=0.1, planned=planned, left_out=rest)
    assert got.verified_fraction == pytest.approx(1.0)
    assert got.verdict is Verdict.PASS


@pytest.mark.parametrize("share", [0.0, 0.4, 0.6, 0.9])
def test_a_face_that_its_edges_verify_counts_as_verified_however_much_was_compared(
    share: float,
) -> None:
    bore = bore_id()
    mine = np.flatnonzero(samples().face_ids == bore)
    some = np.isin(np.arange(len(samples().points_mm)), mine[: int(share * len(mine))])
    seen = all_in_sight(view(compared=all_but(bore) | some))
    proof = evidence(FaceEdges(1.0, 2, is_verified=True, how="of its rims"))
    got = judge(plate(), samples(), (seen,), {}, 0.99, LIMITS, edges=proof)
    assert got.verified_fraction == pytest.approx(1.0)
    assert got.compared_fraction < 1.0
    assert got.faces[bore].is_by_edges is (share < 0.5)


@pytest.mark.parametrize("coverage", [0.0, -0.1, 1.1, float("nan")])
def test_a_pass_that_rests_on_nothing_cannot_be_asked_for(coverage: float) -> None:
    with pytest.raises(ValueError, match="min_coverage"):
        verdict(view(), coverage=coverage)


@pytest.mark.parametrize("plan_reason", ["", "deeper than wide"])
def test_a_face_that_was_not_compared_forbids_a_pass_whatever_the_plan_says(
    plan_reason: str,
) -> None:
    hidden = bore_id()
    unseen = {hidden: plan_reason} if plan_reason else {}
    got = verdict(view(compared=all_but(hidden)), unseen=unseen, coverage=0.5)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.faces[hidden].verdict is Verdict.NOT_EVALUATED
    stop, given_up = got.reasons
    assert "not_inspected" in given_up
    assert plate().faces[hidden].label in stop
    assert (plan_reason or "no view") in stop


def test_a_face_compared_to_less_than_half_forbids_a_pass() -> None:
    top = np.flatnonzero(samples().face_ids == 0)
    compared = everything()
    compared[top[: 1 + len(top) // 2]] = False
    got = verdict(view(compared=compared), coverage=0.1)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.faces[0].verdict is Verdict.NOT_EVALUATED
    assert "50 % is required" in got.reasons[0]


def test_a_face_that_the_recipe_leaves_out_by_name_lets_the_part_pass_and_is_reported() -> None:
    hidden = bore_id()
    got = verdict(view(compared=all_but(hidden)), left_out={hidden: "gauged by hand"}, coverage=0.5)
    assert got.verdict is Verdict.PASS
    face = got.faces[hidden]
    assert (face.verdict, face.compared_fraction) == (Verdict.NOT_EVALUATED, 0)
    assert face.reason == "left out by the recipe: gauged by hand"
    assert any("leaves out 1 of 7 faces" in reason for reason in got.reasons)


def test_a_difference_on_a_face_left_out_is_a_difference_all_the_same() -> None:
    got = verdict(*everywhere(2.0, faces=(bore_id(),)), left_out={bore_id(): "gauged by hand"})
    assert got.verdict is Verdict.FAIL


def test_a_face_too_small_for_the_smallest_difference_is_accounted_for_as_such() -> None:
    block = box(40, 30, 10) + box(1.0, 1.0, 1.0).translate((0, 0, 5.0))
    solid = solid_of(block)
    points = sample_surface(solid, 4.0)
    speck = solid.faces[-1]
    assert speck.area_mm2 < 0.5 * np.pi / 4 * 3.0**2  # of a difference 3 mm across
    compared = points.face_ids != speck.id
    got = judge(solid, points, (view(compared=compared),), {}, 0.5, LIMITS)
    assert got.verdict is Verdict.PASS
    assert got.faces[speck.id].verdict is Verdict.NOT_EVALUATED
    assert "smaller than the smallest difference" in got.faces[speck.id].reason


def evidence(edges: FaceEdges, compared: NDArray[np.bool_] | None = None) -> EdgeEvidence:
    beside = np.zeros(len(samples().points_mm), dtype=bool) if compared is None else compared
    return EdgeEvidence(None, (), {bore_id(): edges}, {}, beside)


def with_edges(*views: ViewResult, edges: FaceEdges) -> PartVerdict:
    return judge(plate(), samples(), views, {}, 0.5, LIMITS, edges=evidence(edges))


def test_a_wall_that_its_edges_show_passes_and_counts_as_not_compared() -> None:
    seen = view(compared=all_but(bore_id()))
    got = with_edges(seen, edges=FaceEdges(0.87, 5, is_verified=True, how="of its rims"))
    assert got.verdict is Verdict.PASS
    wall = got.faces[bore_id()]
    assert wall.verdict is Verdict.PASS
    assert wall.compared_fraction == 0.0
    assert ("edges", 0.87) in wall.by_check
    assert "not compared" in wall.reason
    assert "87 % of its rims" in wall.reason
    assert any("1 of 7 faces" in reason for reason in got.reasons)
    without = judge(plate(), samples(), (seen,), {}, 0.5, LIMITS)
    assert without.verdict is Verdict.INDETERMINATE
    assert got.compared_fraction == without.compared_fraction


def test_surface_beside_an_edge_in_place_counts_as_compared() -> None:
    wall = samples().face_ids == bore_id()
    seen = view(compared=~wall)
    beside = evidence(FaceEdges(0.0, 0), wall & (samples().points_mm[:, 2] > 0))
    got = judge(plate(), samples(), (seen,), {}, 0.5, LIMITS, edges=beside).faces[bore_id()]
    assert not got.is_by_edges
    assert got.compared_fraction == dict(got.by_check)["edges"] > 0.2


def test_an_edge_that_no_picture_shows_stops_a_pass_and_fails_no_part() -> None:
    lost = replace(finding(1.0, kind=FindingKind.MISSING_EDGE), words="an edge, 4.2 mm long")
    one, two = view("v1", findings=(lost,)), view("v2", findings=(lost,), turn_deg=40.0)
    got = verdict(one, two, left_out=dict.fromkeys(range(7), "gauged by hand"))
    assert got.verdict is Verdict.INDETERMINATE
    assert "an edge, 4.2 mm long" in got.reasons[0]
    assert got.faces[0].verdict is Verdict.INDETERMINATE


def test_edges_in_place_that_prove_nothing_leave_a_face_open() -> None:
    got = with_edges(view(compared=all_but(bore_id())), edges=FaceEdges(0.87, 5))
    assert got.verdict is Verdict.INDETERMINATE
    assert got.faces[bore_id()].verdict is Verdict.NOT_EVALUATED


def test_edges_in_place_do_not_outweigh_a_difference() -> None:
    one = everywhere(2.0, faces=(bore_id(),))
    got = with_edges(*one, edges=FaceEdges(1.0, 5, is_verified=True, how="of its rims"))
    assert got.verdict is Verdict.FAIL
    assert got.faces[bore_id()].verdict is Verdict.FAIL


def test_what_was_in_sight_and_not_compared_is_told_apart_from_what_was_not_in_sight() -> None:
    hidden = bore_id()
    mine = samples().face_ids == hidden
    codes = np.where(mine, 1 + list(Unjudged).index(Unjudged.BOUNCE), 0).astype(np.uint8)
    here = replace(view(compared=~mine), unobstructed=everything(), unjudged=codes,
                   checks=(check("ring", 3.0),))  # fmt: skip
    got = verdict(here, coverage=0.5)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.faces[hidden].rest == ((Unjudged.BOUNCE.value, 1.0),)
    assert got.faces[hidden].reason == Unjudged.BOUNCE.value
    assert got.in_sight_fraction == pytest.approx(1.0)
    assert got.compared_fraction < 1
    beside = verdict(replace(view(compared=~mine), beside_gripper=mine), coverage=0.5)
    assert "gripper" in beside.faces[hidden].reason


def test_a_face_names_the_checks_that_compared_it_with_their_shares() -> None:
    half = everything()
    half[np.flatnonzero(samples().face_ids == 0)[::2]] = False
    ring = Check("ring", "", half, 3.0)
    dead = Check("side", "it gives no light", half & False)
    got = verdict(replace(view(), checks=(ring, dead)))
    ((name, share),) = got.faces[0].by_check
    assert name == "ring"
    assert share == pytest.approx(0.5, abs=0.02)
    assert dict(got.faces[1].by_check) == {"ring": 1.0}


def test_a_face_compared_in_part_says_what_became_of_the_rest() -> None:
    top = np.flatnonzero(samples().face_ids == 0)
    compared = everything()
    compared[top[: len(top) // 4]] = False
    told = verdict(view(compared=compared), coverage=0.5).faces[0]
    assert told.verdict is Verdict.PASS
    share = (len(top) // 4) / len(top)
    assert told.reason.startswith(f"{100 * share:.0f} % of it")
    planned = verdict(view(compared=compared), unseen={0: "under the fingers"}, coverage=0.5).faces[
        0
    ]
    assert planned.reason.endswith("under the fingers")
    assert planned.rest == (("under the fingers", pytest.approx(share)),)


def test_no_views_at_all_prove_nothing_even_where_next_to_nothing_is_asked() -> None:
    reasons = {f.id: "not shown" for f in plate().faces}
    assert verdict(coverage=1e-9, left_out=reasons).verdict is Verdict.INDETERMINATE


def test_a_failed_view_forbids_a_pass_until_others_have_shown_what_it_was_to_show() -> None:
    broken = view("v2", reason="outline off by 0.64 px", findings=(finding(99.0),))
    whole = view("v1")
    told = "view v2 not evaluated: outline off by 0.64 px"
    got = verdict(whole, broken)
    assert got.verdict is Verdict.PASS  # v1 has shown all there is
    assert got.reasons[-1] == told
    less = view("v1", compared=all_but(0))
    left_out = {0: "checked by hand"}
    got = verdict(less, broken, left_out=left_out, coverage=0.1)
    assert got.verdict is Verdict.INDETERMINATE
    assert got.reasons[0].startswith("view v2 failed")
    planned = {"v2": samples().face_ids == 0}
    assert verdict(less, broken, left_out=left_out, coverage=0.1, planned=planned).verdict is (
        Verdict.INDETERMINATE
    )
    planned = {"v2": samples().face_ids == 1}
    got = verdict(less, broken, left_out=left_out, coverage=0.1, planned=planned)
    assert got.verdict is Verdict.PASS
    assert told in got.reasons
    assert verdict(broken).verdict is Verdict.INDETERMINATE


def test_a_lamp_that_failed_forbids_a_pass_unless_its_surface_was_judged_otherwise() -> None:
    dead = check("side", 3.0, reason="its picture lies 3.1 px beside the pose")
    alone = replace(view(), unobstructed=everything(), checks=(check(OUTLINE, 0.4, 2.0), dead))
    got = verdict(alone)
    assert got.verdict is Verdict.PASS  # every sample was compared all the same
    assert any("side not evaluated: its picture lies 3.1 px" in r for r in got.reasons)
    dark = replace(alone, compared=all_but(0))
    left_out = {0: "checked by hand"}
    assert verdict(dark, left_out=left_out, coverage=0.1).verdict is Verdict.INDETERMINATE
    other = replace(dark, checks=(*dark.checks, check("ring", 3.0)))
    assert verdict(other, left_out=left_out, coverage=0.1).verdict is Verdict.PASS


@pytest.mark.parametrize("size", [1.5, 2.6, 20.0])
def test_a_finding_in_one_picture_alone_never_fails_a_part_however_large(size: float) -> None:
    got = verdict(view(findings=(finding(size * SMALLEST_MM2, faces=(1, 2)),)), view("v2"))
    assert got.verdict is Verdict.INDETERMINATE
    assert [one.verdict for one in got.findings] == [Verdict.INDETERMINATE]
    assert got.reasons[0].startswith("unconfirmed: surface differs at")
    assert "view v1, ring" in got.reasons[0]
    # nor do the surfaces it lies on pass
    assert {f.face_id for f in got.faces if f.verdict is Verdict.INDETERMINATE} == {1, 2}
    assert "no second one" in got.faces[1].reason
    assert got.faces[0].verdict is Verdict.PASS


def test_a_finding_of_two_views_fails_the_part_and_its_faces() -> None:
    got = verdict(*everywhere(1.2, faces=(1, 2)))
    assert got.verdict is Verdict.FAIL
    assert [f.face_id for f in got.faces if f.verdict is Verdict.FAIL] == [1, 2]
    assert "differs from the CAD" in got.faces[1].reason
    (one,) = got.findings
    assert [view_id for view_id, _ in one.looks] == ["v1", "v2"]
    assert "surface differs at" in got.reasons[0]


@pytest.mark.parametrize(
    ("turn_deg", "other_lamp", "away_mm", "expected"),
    [
        (40.0, "ring", 3.0, Verdict.FAIL),
        (40.0, "side", 3.0, Verdict.FAIL),
        (40.0, "ring", 12.0, Verdict.INDETERMINATE),  # another place is another matter
        (5.0, "ring", 3.0, Verdict.INDETERMINATE),  # nearly the same look shares its errors
    ],
)
def test_a_second_look_is_of_the_same_place_from_elsewhere(
    turn_deg: float, other_lamp: str, away_mm: float, expected: Verdict
) -> None:
    first = finding(1.2 * SMALLEST_MM2)
    second = finding(1.2 * SMALLEST_MM2, at=(away_mm, 0.0, 5.0), lamp=other_lamp)
    one, two = view("v1", findings=(first,)), view("v2", findings=(second,), turn_deg=turn_deg)
    assert verdict(one, two).verdict is expected


@pytest.mark.parametrize(
    ("misfit", "kind", "expected"),
    [
        (0.01, FindingKind.SURFACE, Verdict.FAIL),
        (
            0.2,
            FindingKind.SURFACE,
            Verdict.INDETERMINATE,
        ),  # an uneven finish is odd from all sides
        (0.2, FindingKind.MISSING, Verdict.FAIL),  # which no finish explains
    ],
)
def test_lit_pictures_alone_fail_a_part_only_where_they_are_predicted_well(
    misfit: float, kind: FindingKind, expected: Verdict
) -> None:
    one, two = everywhere(2.0)
    poor = Check("ring", "", everything(), 3.0, misfit=misfit)
    one, two = (replace(v, checks=(poor,)) for v in (one, two))
    other = "ring" if kind is FindingKind.SURFACE else "backlit"
    two = replace(two, findings=(replace(two.findings[0], kind=kind, lamp=other),))
    assert verdict(one, two).verdict is expected


@pytest.mark.parametrize(
    ("kind", "lamp", "size", "expected"),
    [
        (
            FindingKind.SURFACE,
            "side",
            3.0,
            Verdict.INDETERMINATE,
        ),  # lamps share the pose's error
        (
            FindingKind.MISSING,
            "backlit",
            1.2,
            Verdict.INDETERMINATE,
        ),  # such an error makes that
        (FindingKind.MISSING, "backlit", 3.0, Verdict.FAIL),
    ],
)
def test_two_pictures_of_one_view_agree_only_as_outline_and_shading_and_both_large(
    kind: FindingKind, lamp: str, size: float, expected: Verdict
) -> None:
    first = finding(size * SMALLEST_MM2)
    second = finding(size * SMALLEST_MM2, at=(3.0, 0, 5.0), lamp=lamp, kind=kind)
    assert verdict(view("v1", findings=(first, second))).verdict is expected


def test_what_stays_in_its_pixels_as_the_part_turns_is_dirt_on_the_lens() -> None:
    here, there = (10.0, 5.0, 5.0), (-12.0, 5.0, 5.0)
    blots = [
        view(f"v{i}", findings=(replace(finding(40.0, at), at_px=(500.0, 400.0)),), turn_deg=turn)
        for i, (at, turn) in enumerate(((here, 0.0), (there, 30.0), (here, 60.0)))
    ]
    assert verdict(*blots).verdict is Verdict.INDETERMINATE
    on_the_part = [
        view(f"v{i}", findings=(finding(40.0, here),), turn_deg=30.0 * i) for i in range(3)
    ]
    assert verdict(*on_the_part).verdict is Verdict.FAIL


def test_confirmed_findings_come_largest_first() -> None:
    findings = tuple(
        finding(area * SMALLEST_MM2, at=(20.0 * i, 0, 5)) for i, area in enumerate((3, 9, 5))
    )
    one, two = view("v1", findings=findings), view("v2", findings=findings, turn_deg=90.0)
    got = verdict(one, replace(two, findings=tuple(replace(f) for f in findings)))
    assert [f.area_mm2 / SMALLEST_MM2 for f in got.findings] == pytest.approx([9, 5, 3])
    assert len(got.reasons) == len(got.findings)


def test_all_looks_at_one_place_are_one_finding_in_one_sentence() -> None:
    """A chip of 4 mm at the edge of two faces, as outlines and lamps show it, and a second one."""

    def shown(at: tuple[float, float, float]) -> list[Finding]:
        x, y, z = at
        return [
            replace(
                finding(3.0, (x + 1, y, z), "backlit", (0, 1), FindingKind.MISSING), is_sure=True
            ),
            finding(0.3, (x - 0.5, y, z - 2.0), "ring", (1,), FindingKind.PIT),
            finding(6.0, (x, y + 1.5, z), "side", (0,), FindingKind.SURFACE),
            replace(finding(0.04, (x, y, z), "backlit", (0, 1), FindingKind.CHIP), size_mm=4.0),
        ]

    first, second = shown((0.0, 15.0, 5.0)), shown((20.0, 15.0, 5.0))
    views = [
        view(f"v{i}", findings=tuple(replace(f) for f in (*first, *second)), turn_deg=30.0 * i)
        for i in range(4)
    ]
    got = verdict(*views)
    assert [len(one.looks) for one in got.findings] == [16, 16]
    assert len(got.reasons) == 2
    for one, reason in zip(got.findings, got.reasons, strict=True):
        assert one.plainest.kind is FindingKind.CHIP  # says most of it
        assert reason.startswith("chip at F0 plane and F1 plane: 4.0 mm across, 6.0 mm2, view v0")
        assert reason.endswith("; shown in 12 pictures")


def test_a_small_defect_has_an_area() -> None:
    speck = replace(finding(0.04, kind=FindingKind.CHIP), is_sure=True)
    assert "0.1 mm2" in verdict(view(findings=(speck,))).reasons[0]


def test_a_mark_elsewhere_is_not_taken_for_the_doing_of_a_long_edge_out_of_place() -> None:
    edge = replace(finding(20.0, faces=(0, 1), kind=FindingKind.DIMENSION), size_mm=60.0)
    mark = finding(9.0, (10.0, 3.0, -5.0), faces=(2,), kind=FindingKind.DENT)
    beside = finding(9.0, (10.0, 3.0, 5.0), faces=(0,))
    assert len(verdict(view(findings=(edge, mark))).findings) == 2
    assert len(verdict(view(findings=(edge, beside))).findings) == 1


def test_what_pictures_show_against_a_face_is_its_reason_before_the_light_on_it() -> None:
    hidden = bore_id()
    mine = samples().face_ids == hidden
    codes = np.where(mine, Unjudged.BOUNCE.number, 0).astype(np.uint8)
    dark = replace(view(compared=~mine), unobstructed=everything(), unjudged=codes,
                   checks=(check("ring", 3.0),))  # fmt: skip
    tried = FaceEdges(0.3, 5, why="no picture shows how deep its floor lies")
    got = with_edges(dark, edges=tried)
    assert got.faces[hidden].reason == tried.why
    assert got.reasons[0].endswith(tried.why)
    assert "given up" in got.reasons[1]  # what leaving it out by name costs
    assert with_edges(dark, edges=FaceEdges(0.3, 5)).faces[hidden].reason == Unjudged.BOUNCE.value


def test_a_fail_outweighs_doubt_and_poor_coverage() -> None:
    weak = finding(1.1 * SMALLEST_MM2, at=(25.0, 0, 5))
    one, two = everywhere(5.0)
    hidden = all_but(0, 1, 2)
    one = replace(one, findings=(*one.findings, weak), compared=hidden)
    assert verdict(one, replace(two, compared=hidden)).verdict is Verdict.FAIL


def test_the_smallest_area_is_half_the_disc_of_the_smallest_defect() -> None:
    assert LIMITS.min_area_mm2 == pytest.approx(SMALLEST_MM2)
    assert InspectionLimits(smallest_defect_mm=1.0).min_area_mm2 == pytest.approx(np.pi / 8)


faces = st.integers(0, 6)
some_findings = st.lists(
    st.builds(
        finding,
        st.floats(SMALLEST_MM2, 60),
        st.tuples(st.floats(-30, 30), st.floats(-20, 20), st.floats(-5, 5)),
        st.sampled_from(["backlit", "ring", "side"]),
        st.lists(faces, min_size=1, max_size=3, unique=True).map(tuple),
        st.sampled_from(list(FindingKind)),
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
        st.sampled_from([0.0, 10.0, 40.0, 100.0]),
    ),
    max_size=4,
)


@settings(max_examples=150, deadline=None)
@given(
    some_views,
    st.dictionaries(faces, st.just("hidden by the hand")),
    st.dictionaries(faces, st.just("gauged by hand")),
    st.floats(0.01, 1),
)
def test_a_pass_means_that_all_is_compared_or_left_out_by_name_and_nothing_was_found(
    views: list[ViewResult], unseen: dict[int, str], left_out: dict[int, str], coverage: float
) -> None:
    got = judge(plate(), samples(), views, unseen, coverage, LIMITS, left_out)
    used = [v for v in views if v.evaluated]
    found = [f for v in used for f in v.findings]
    assert sum(f.area_mm2 for f in got.faces) == pytest.approx(plate().mesh.area)
    assert got.reasons
    assert (got.verdict is Verdict.FAIL) == any(f.verdict is Verdict.FAIL for f in got.findings)
    assert {id(f) for one in got.findings for _, f in one.looks} <= {id(f) for f in found}
    assert (got.verdict is Verdict.FAIL) == any(f.verdict is Verdict.FAIL for f in got.faces)
    for face in got.faces:
        rest = sum(share for _, share in face.rest)
        assert face.compared_fraction + rest == pytest.approx(1.0)
    if got.verdict is Verdict.PASS:
        assert used
        assert not found
        assert got.verified_fraction >= coverage
        for face in got.faces:
            assert face.verdict is Verdict.PASS or face.face_id in left_out
            assert (face.verdict is Verdict.PASS) == (face.compared_fraction >= 0.5)
    if got.verdict is Verdict.FAIL:
        assert len(found) >= 2
    elif found:
        assert got.verdict is Verdict.INDETERMINATE
    assert 0 <= got.compared_fraction <= 1 + 1e-9
    assert 0 <= got.verified_fraction <= 1 + 1e-9


# --- marks: two looks at one place of the part ---------------------------------------------------


def mark(
    evidence: float = 2.0,
    at: tuple[float, float, float] = (0.0, 0.0, 5.0),
    at_px: tuple[float, float] = (10.0, 10.0),
    lamp: str = "ring",
    dipole: tuple[float, float] = (0.0, 0.0),
) -> Finding:
    return replace(
        finding(2.0, at=at, lamp=lamp, kind=FindingKind.DENT),
        evidence=evidence,
        at_px=at_px,
        dipole_px=dipole,
        size_mm=2.0,
    )


@pytest.mark.parametrize(
    ("turn_deg", "away_mm", "at_px", "expected"),
    [
        (40.0, 0.5, (300.0, 200.0), Verdict.FAIL),
        (5.0, 0.5, (300.0, 200.0), Verdict.INDETERMINATE),  # the same look again
        (40.0, 4.0, (300.0, 200.0), Verdict.INDETERMINATE),  # two things, or none
        (40.0, 0.5, (11.0, 12.0), Verdict.INDETERMINATE),  # dirt on the lens stays where it is
    ],
)
def test_a_mark_fails_a_part_where_two_looks_show_it(
    turn_deg: float, away_mm: float, at_px: tuple[float, float], expected: Verdict
) -> None:
    one = view("v1", findings=(mark(),))
    other = view("v2", findings=(mark(at=(away_mm, 0, 5), at_px=at_px),), turn_deg=turn_deg)
    assert verdict(one, other).verdict is expected


def test_a_weak_mark_confirms_another_and_is_nothing_alone() -> None:
    weak = replace(view("v2", turn_deg=40.0), hints=(mark(0.7, at_px=(300, 200)),))
    assert verdict(view("v1"), weak).verdict is Verdict.PASS
    assert verdict(view("v1", findings=(mark(),)), weak).verdict is Verdict.FAIL


@pytest.mark.parametrize(
    ("second", "expected"),
    [((-3.0, 1.0), Verdict.FAIL), ((3.0, 1.0), Verdict.INDETERMINATE)],
)
def test_two_lamps_of_one_view_decide_on_a_dent_whose_bright_side_turns(
    second: tuple[float, float], expected: Verdict
) -> None:
    ring, side = mark(dipole=(3.0, 0.0)), mark(lamp="side", dipole=second)
    assert verdict(view("v1", findings=(ring, side))).verdict is expected


@pytest.mark.parametrize(
    ("evidence", "width_mm", "expected"),
    [
        (1.5, 1.0, Verdict.PASS),
        (1.5, 2.5, Verdict.INDETERMINATE),  # the others would not have shown it
        (9.0, 1.0, Verdict.INDETERMINATE),  # too plain to be argued away
    ],
)
def test_what_two_other_looks_would_have_shown_and_did_not_was_a_reflection(
    evidence: float, width_mm: float, expected: Verdict
) -> None:
    widths = {"dent": np.full(len(everything()), width_mm, dtype=np.float32)}
    clear = replace(check("ring", 3.0), smallest_mm=widths)
    others = [replace(view(f"v{i}", turn_deg=40.0 * i), checks=(clear,)) for i in (1, 2)]
    assert verdict(view("v0", findings=(mark(evidence),)), *others).verdict is expected


@pytest.mark.parametrize(
    ("size_mm", "width_mm", "find_mm", "expected"),
    [
        (1.0, 1.5, {}, Verdict.PASS),  # no dent of 3 mm is there, which two looks had to show
        (1.0, 2.5, {}, Verdict.INDETERMINATE),  # each of them would have missed one in two
        (1.0, 1.5, {"dent": 1.2}, Verdict.INDETERMINATE),  # the recipe asks for smaller ones
        (1.0, 1.5, {"chip": 1.2}, Verdict.PASS),
        (3.5, 3.2, {}, Verdict.PASS),  # of what is as large as asked for, its own size counts
        (3.5, 3.6, {}, Verdict.INDETERMINATE),
    ],
)
def test_a_mark_smaller_than_asked_for_goes_where_two_looks_had_to_show_what_is_asked_for(
    size_mm: float, width_mm: float, find_mm: dict[str, float], expected: Verdict
) -> None:
    assert LIMITS.smallest_defect_mm == 3.0
    widths = {"dent": np.full(len(everything()), width_mm, dtype=np.float32)}
    clear = replace(check("ring", 3.0), smallest_mm=widths)
    others = [replace(view(f"v{i}", turn_deg=40.0 * i), checks=(clear,)) for i in (1, 2)]
    small = replace(mark(1.5), size_mm=size_mm)
    got = verdict(view("v0", findings=(small,)), *others, find_mm=find_mm)
    assert got.verdict is expected
    # a mark that is plain, or that one of the looks shows as well, stays
    plain = replace(small, evidence=9.0)
    assert verdict(view("v0", findings=(plain,)), *others).verdict is Verdict.INDETERMINATE
    hinted = replace(others[0], hints=(replace(small, evidence=0.5, at_px=(300.0, 200.0)),))
    again = verdict(view("v0", findings=(small,)), hinted, others[1], find_mm=find_mm)
    assert again.verdict is Verdict.FAIL
