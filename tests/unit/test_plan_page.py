"""The page of a plan: pictures by rays against paper, colours by brute force, one whole file."""

from __future__ import annotations

import base64
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from cad_solids import box, mesh_of, solid_of
from hypothesis import given, settings
from hypothesis import strategies as st

from controller.cad import sample_surface
from controller.cad.compiled import CompiledPart, compile_part
from controller.cell.plans import KeptPlan
from controller.config import load_cell
from controller.imaging import Camera
from controller.planning import (
    Box,
    CellLayout,
    Certificate,
    GiveStep,
    Grasp,
    Look,
    Park,
    Pick,
    Place,
    Plan,
    Present,
    Proof,
    Reason,
    ReceiveStep,
    SetDown,
    Step,
    Unseen,
    resting_pose,
    shown_pose,
)
from controller.results.moments import MomentKind, moments
from controller.results.plan_page import PlanFacts, coverage, render_plan, strip, write_plan_page
from controller.results.plan_page.bodies import (
    box_body,
    make_stage,
    not_round,
    part_body,
    standing_bodies,
)
from controller.results.plan_page.paint import Painter
from controller.results.plan_page.render import Paint, look, shade
from controller.results.plan_page.timeline import timeline
from controller.results.plan_page.views import camera_eye, slant_over, slanting_eye, window_about
from controller.setup.layout import build_layout

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes/cells/emulated.yaml"
NASTY = "<script>alert('x')</script>&\"' {{ 7 * 7 }}"
VOID = {"meta", "img", "br", "hr", "link", "input"}
DOWN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # the hand's x is -z


class Page(HTMLParser):
    """A page taken apart; fails on tags that do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, {k: v or "" for k, v in attrs}))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open[-1:] != ["style"]:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attrs for name, attrs in self.tags if name == tag]


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(strip, "WIDTHS_PX", (100, 80, 60))
    monkeypatch.setattr(coverage, "SIZE_PX", (80, 64))


@pytest.fixture(scope="module")
def layout() -> CellLayout:
    return build_layout(load_cell(CELL))


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> CompiledPart:
    path = tmp_path_factory.mktemp("part") / "block.stl"
    mesh_of(box(40, 30, 20)).export(path)
    return compile_part(path)


def grasp(name: str, holder: str = "arm") -> Grasp:
    """The block held across y from above, the tips 8 mm below its middle."""
    T = np.eye(4)
    T[:3, :3] = DOWN
    T[:3, 3] = (0.0, 0.0, -8.0)
    return Grasp(name, T, 30.0, 40.0, 100.0, 0.2, 0.9, holder)  # type: ignore[arg-type]


def every_kind(part: CompiledPart, layout: CellLayout) -> Plan:
    """A plan with each kind of step once; nothing of it has to be drivable to be drawn."""
    n = len(part.samples.points_mm)
    first = np.arange(n) < n // 2
    q = layout.park_q
    lying = resting_pose(part.solid, part.poses[0], 360.0, 0.0, 0.3)
    shown = np.eye(4)
    shown[:3, 3] = layout.station_mm
    hand, other, fixed = grasp("A1"), grasp("A2"), grasp("F1", "fixture")
    steps: tuple[Step, ...] = (
        Pick(
            seconds=10.0,
            label=f"pick {NASTY}",
            grasp=hand,
            motion_in=(q,),
            pre_open_mm=40.0,
            motion_down=(q,),
            expected_opening_mm=30.0,
            motion_up=(q,),
        ),
        Present(
            seconds=5.0,
            label="show",
            view_id="A1-V3",
            grasp=hand,
            motion=(q,),
            q=q,
            T_world_part=shown,
            direction_part=np.array([0.0, -1.0, 0.0]),
            seen=first,
            square_to=0,
            expected_opening_mm=30.0,
        ),
        GiveStep(
            seconds=8.0,
            label="hand off",
            grasp=hand,
            fixed_grasp=fixed,
            fixed_pre_open_mm=50.0,
            motion=(q,),
            fixed_expected_opening_mm=30.0,
            arm_open_mm=40.0,
            retreat=(q,),
        ),
        ReceiveStep(
            seconds=7.0,
            label="receive back",
            grasp=other,
            fixed_grasp=fixed,
            motion_in=(q,),
            pre_open_mm=40.0,
            approach=(q,),
            expected_opening_mm=30.0,
            fixed_open_mm=50.0,
            motion_out=(q,),
        ),
        SetDown(
            seconds=6.0,
            label="set down",
            grasp=other,
            motion=(q,),
            motion_down=(q,),
            open_mm=40.0,
            motion_up=(q,),
            T_world_part=lying,
            pose_index=0,
        ),
        Look(
            seconds=3.0,
            label="look",
            view_id="T0",
            T_world_part=lying,
            direction_part=np.array([0.0, 0.0, 1.0]),
            seen=~first & (np.arange(n) % 3 > 0),
        ),
    )
    place = Place(
        seconds=9.0,
        label="place in tray accept",
        tray="accept",
        grasp=other,
        motion=(q,),
        motion_down=(q,),
        open_mm=40.0,
        motion_up=(q,),
        T_world_part=lying,
        tilt_rad=0.0,
    )
    seen = first | (~first & (np.arange(n) % 3 > 0))
    weights = part.samples.areas_mm2 / part.samples.areas_mm2.sum()
    unseen = tuple(
        Unseen(
            face,
            float(weights[(part.samples.face_ids == face) & ~seen].sum()),
            NASTY,
            Reason.FINGERS,
            "a finger 2 mm thinner",
            tuple(np.flatnonzero((part.samples.face_ids == face) & ~seen).tolist()),
        )
        for face in (int(part.samples.face_ids[-1]),)
    )
    return Plan(
        steps=steps,
        place={"accept": place},
        park={"accept": Park(seconds=4.0, label="park", motion=(q,))},
        covered_fraction=float(weights[seen].sum()),
        covered_U=0.001,
        reachable_fraction=1.0,
        unseen=unseen,
        grasps=(hand, fixed, other),
        proof=Proof(30.0, 27.0, "2 grips, 3 views"),
    )


@pytest.fixture(scope="module")
def facts(block: CompiledPart, layout: CellLayout) -> PlanFacts:
    plan = every_kind(block, layout)
    kept = KeptPlan(block.poses[0].index, np.eye(4), plan)
    told = (
        Certificate(0, 0.6, plan, "", 0.75),
        Certificate(1, 0.4, None, f"no pick: {NASTY}", 0.0),
    )
    return PlanFacts(block, NASTY, layout, kept, told, (360.0, 0.0, 17.0), NASTY)


@pytest.fixture(scope="module")
def page(facts: PlanFacts) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strip, "WIDTHS_PX", (100, 80, 60))
        patch.setattr(coverage, "SIZE_PX", (80, 64))
        return render_plan(facts)


def test_the_page_nests_and_asks_for_nothing_from_outside(page: str) -> None:
    taken = Page(page)
    assert taken.all("script") == []
    assert taken.all("link") == []
    for _, attrs in taken.tags:
        assert not any(name.startswith("on") for name in attrs)
        for name in ("src", "href", "srcset", "action"):
            assert attrs.get(name, "#").startswith(("#", "data:image/png;base64,"))
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.DOTALL)
    assert "url(" not in style
    assert "@import" not in style
    assert "prefers-color-scheme: dark" in style
    assert "@media print" in style


def test_every_step_is_drawn_from_near_by_and_from_outside(page: str, facts: PlanFacts) -> None:
    assert facts.kept.plan is not None
    images = Page(page).all("img")
    count = len(facts.kept.plan.steps) + 2  # the way to a tray and home
    outside = [i for i in images if i["alt"].endswith("from outside")]
    near = [i for i in images if i["alt"].startswith("step") and i not in outside]
    assert (len(near), len(outside)) == (count, count)
    for image in images:
        data = base64.b64decode(image["src"].removeprefix("data:image/png;base64,"))
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (int(image["height"]), int(image["width"]), 3)
        assert np.ptp(picture) > 0 or "overhead" in image["alt"]  # an empty table is one colour


def test_names_and_reasons_are_text_whatever_they_hold(page: str) -> None:
    assert "<script>" not in page
    text = Page(page).text
    assert f"pick {NASTY}" in text
    assert f"no pick: {NASTY}" in text
    assert "a finger 2 mm thinner" in text


def test_the_gap_and_its_scope_are_told_as_on_paper(page: str) -> None:
    text = Page(page).text
    assert "At most 10.0 % from the optimum" in text  # (30 - 27) / 30
    assert "2 grips, 3 views" in text
    assert "Proven optimal" not in text


def test_a_proven_plan_says_so(facts: PlanFacts) -> None:
    assert facts.kept.plan is not None
    plan = replace(facts.kept.plan, proof=Proof(27.0, 27.0, "all of them"))
    text = Page(render_plan(replace(facts, kept=replace(facts.kept, plan=plan)))).text
    assert "Proven optimal" in text


def test_where_there_is_no_plan_the_page_says_why(facts: PlanFacts, tmp_path: Path) -> None:
    reason = f"{NASTY}: needs 48 degrees of friction, has 26.6"
    kept = replace(facts.kept, plan=None, reason=reason)
    path = write_plan_page(replace(facts, kept=kept), tmp_path / "new" / "page.html")
    taken = Page(path.read_text(encoding="utf-8"))
    assert "needs 48 degrees of friction, has 26.6" in taken.text
    assert taken.all("img") == []


def test_the_same_facts_give_the_same_page(facts: PlanFacts, page: str) -> None:
    assert render_plan(facts) == page


def test_moments_hold_the_part_where_the_hand_has_it(
    block: CompiledPart, layout: CellLayout
) -> None:
    plan = every_kind(block, layout)
    drawn = moments(plan, layout)
    assert [m.kind for m in drawn] == list(MomentKind)
    for moment in drawn:
        if moment.kind in (MomentKind.PICK, MomentKind.GIVE, MomentKind.RECEIVE):
            assert moment.grasp is not None
            expected = shown_pose(layout, moment.q, moment.grasp.T_part_tcp)
            assert np.allclose(moment.T_world_part, expected)
    assert [m.fixed_grasp is not None for m in drawn].count(True) == 2
    assert sum(m.step.seconds for m in drawn) == pytest.approx(plan.forecast_s)


def test_bars_follow_each_other_up_to_the_forecast(facts: PlanFacts) -> None:
    assert facts.kept.plan is not None
    drawn = moments(facts.kept.plan, facts.layout)
    painter = Painter(facts.part.solid, facts.part.samples)
    weights = facts.part.samples.areas_mm2 / facts.part.samples.areas_mm2.sum()
    frames = strip.Strip(facts.part.solid, facts.layout, painter, 40).frames(drawn, weights)
    told = timeline(frames)
    for before, after in zip(told.bars, told.bars[1:], strict=False):
        assert before.x + before.width == pytest.approx(after.x)
    # 10 + 5 + 8 + 7 + 6 + 3 + 9 + 4 seconds of the steps above
    assert frames[-1].to_s == pytest.approx(52.0)
    assert sum(seconds for _, _, seconds in told.totals) == pytest.approx(52.0)
    assert sum(f.new_fraction for f in frames) == pytest.approx(facts.kept.plan.covered_fraction)


def test_a_block_before_a_camera_is_as_wide_as_on_paper() -> None:
    # 40 mm wide, its front 500 mm before a camera of 1000 px focal length: 80 px; 30 mm high: 60 px
    solid = solid_of(box(40, 30, 20))
    camera = Camera((200, 160), np.array([[1000.0, 0, 99.5], [0, 1000, 79.5], [0, 0, 1]]),
                    np.zeros(5), np.eye(4))  # fmt: skip
    T = np.eye(4)
    T[2, 3] = 510.0
    stage = make_stage([], part_body(solid, T), T)
    eye = camera_eye(camera, (0.0, 0.0, 200.0, 160.0), (400, 320))
    on_part = look(stage, eye).triangle >= 0
    assert abs(on_part.any(axis=0).sum() / 2 - 80) <= 1
    assert abs(on_part.any(axis=1).sum() / 2 - 60) <= 1
    # and a window round it shows it just as large as the window says
    window = window_about(camera, stage.bodies[-1].vertices_mm, 0.5, 1.25)
    assert window[2] - window[0] == pytest.approx(1.25 * (window[3] - window[1]))
    seen = look(stage, camera_eye(camera, window, (400, 320))).triangle >= 0
    width_px = seen.any(axis=0).sum() / 400 * (window[2] - window[0])
    assert abs(width_px - 80) <= 1


@settings(max_examples=25, deadline=None)
@given(
    azimuth=st.floats(-3.0, 3.0),
    elevation=st.floats(-1.2, 1.2),
    point=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
def test_a_slanting_eye_meets_a_point_where_it_projects(
    azimuth: float, elevation: float, point: tuple[float, float, float]
) -> None:
    corners = np.array([[x, y, z] for x in (-50, 50) for y in (-40, 40) for z in (-30, 30)], float)
    slant = slant_over(corners, azimuth, elevation, 1.25)
    p = np.array(point) * np.array([50.0, 40.0, 30.0])
    ((u, v),) = slant.project(p[None], 200)
    assert -1e-6 <= u <= 200 + 1e-6
    assert -1e-6 <= v <= 160 + 1e-6
    eye = slanting_eye(slant, (200, 160), 500.0)
    row = min(int(v), 159) * 200 + min(int(u), 199)
    away = p - eye.origins_mm[row]
    across = away - (away @ eye.directions[row]) * eye.directions[row]
    assert np.abs(across @ eye.right) <= slant.width_mm / 200
    assert np.abs(across @ eye.up) <= slant.width_mm / 200


def test_what_stands_before_the_part_is_drawn_before_it() -> None:
    solid = solid_of(box(40, 30, 20))
    wall = box_body("wall", (10.0, 200.0, 30.0), Box.from_bounds(-5, 5, -90, -80, -50, 50))
    stage = make_stage([wall], part_body(solid, np.eye(4)), np.eye(4))
    slant = slant_over(stage.bodies[-1].vertices_mm, -np.pi / 2, 0.0, 1.25, 0.2)  # along +y
    sight = look(stage, slanting_eye(slant, (100, 80), 500.0))
    assert stage.body_of_triangle[sight.triangle[40, 50]] == 0  # the wall, in the middle
    beside = sight.triangle[40, 75]  # 25 of 100 columns to the right, beyond the wall's 5 mm
    assert beside >= stage.first_of_part


def test_a_camera_does_not_see_its_own_housing(layout: CellLayout) -> None:
    bodies = standing_bodies(layout)
    position = layout.inspection.position_mm
    left = {b.name for b in bodies} - {b.name for b in not_round(bodies, position)}
    assert left == {"inspection_camera"}


def test_a_place_has_the_colour_of_the_nearest_sample_of_its_face() -> None:
    solid = solid_of(box(40, 30, 20))
    samples = sample_surface(solid)
    T = np.eye(4)
    T[:3, :3] = DOWN
    stage = make_stage([], part_body(solid, T), T)
    slant = slant_over(stage.bodies[-1].vertices_mm, 0.7, 0.5, 1.25)
    sight = look(stage, slanting_eye(slant, (60, 48), 300.0))
    spoken = Painter(solid, samples).sample_at(stage, sight)
    assert np.array_equal(spoken >= 0, sight.triangle >= 0)
    for row, column in np.argwhere(spoken >= 0)[::40]:
        here = sight.points_mm[row, column] @ T[:3, :3]  # T has no offset
        away = np.linalg.norm(samples.points_mm - here, axis=1)
        away[samples.face_ids != solid.face_of_triangle[sight.triangle[row, column]]] = np.inf
        assert away[spoken[row, column]] == pytest.approx(away.min(), abs=1e-6)


def test_paint_is_seen_where_it_was_put_and_nowhere_else() -> None:
    solid = solid_of(box(40, 30, 20))
    samples = sample_surface(solid)
    stage = make_stage([], part_body(solid, np.eye(4)), np.eye(4))
    colours = np.full((len(samples.points_mm), 3), 200.0, dtype=np.float32)
    colours[samples.normals[:, 2] > 0.9] = (200.0, 0.0, 0.0)
    slant = slant_over(stage.bodies[-1].vertices_mm, 0.6, 0.6, 1.25)
    eye = slanting_eye(slant, (120, 96), 300.0)
    sight = look(stage, eye)
    paint = Paint(Painter(solid, samples).sample_at(stage, sight), colours)
    image = shade(stage, eye, sight, paint)
    up = stage.normals[sight.triangle][..., 2] > 0.9
    is_red = (image[..., 0] > 0) & (image[..., 1] == 0)
    assert np.array_equal(is_red, up & (sight.triangle >= 0))


def test_states_count_views_and_name_reasons(facts: PlanFacts) -> None:
    plan, samples = facts.kept.plan, facts.part.samples
    assert plan is not None
    state, _ = coverage.states(samples, plan)
    (look_step,) = [s for s in plan.steps if isinstance(s, Look)]
    (present,) = plan.presents
    for i in range(len(state)):
        views = int(look_step.seen[i]) + int(present.seen[i])
        if views:
            assert state[i] == views - 1
        elif samples.face_ids[i] == plan.unseen[0].face_id:
            assert state[i] == len(coverage.OFTEN) + list(coverage.WHY).index(Reason.FINGERS)
        else:
            assert state[i] == len(coverage.OFTEN) + len(coverage.WHY)
    told = coverage.coverage_map(
        facts.part.solid,
        samples,
        plan,
        Painter(facts.part.solid, samples),
        np.eye(3),
    )
    assert sum(key.share for key in told.keys) == pytest.approx(1.0)


def test_many_steps_get_smaller_pictures() -> None:
    widths = [strip.width_for(count) for count in (1, 24, 25, 48, 49, 400)]
    assert widths == sorted(widths, reverse=True)
    assert len(set(widths)) == 3
