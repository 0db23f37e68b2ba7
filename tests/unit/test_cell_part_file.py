"""The file that a part is judged from says what its views were judged by, to the last bit."""

from __future__ import annotations

import asyncio
import hashlib
import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import view_sets
from numpy.typing import NDArray

from controller.cell.batch import product_of
from controller.cell.compute import Compute, Job, Located, answers
from controller.cell.compute.job import context
from controller.cell.services import PartFileWriter
from controller.cell.services.records import PartInGripper, PartRecord, Shown
from controller.config import EMULATED_CELL, find_recipe, load_cell, load_recipe
from controller.config.view_set import load_view_set
from controller.imaging import inverse_pose
from controller.inspection import PartFacts, ViewResult, ViewTask
from controller.planning import shown_pose
from controller.planning.motion import tcp_pose
from controller.recognition import FreeTurn
from controller.setup.holder import holder_boxes
from controller.setup.layout import build_layout
from controller.stored import (
    Judging,
    build_view_set,
    compiled_part,
    judge_views,
    lines_digest,
    read_pictures,
)
from controller.stored.pictures import read_grey

RECIPE = find_recipe(Path("holder"))
JOB = Job(RECIPE, EMULATED_CELL)
Q = np.array([0.3, 0.5, -0.4, 0.2, 0.1, -120.0])


class ReachedError(Exception):
    """The view has reached inspection."""


def live_task(monkeypatch: pytest.MonkeyPatch, ask: Any, *arguments: Any) -> ViewTask:
    """The task that a question of the cell comes to."""
    caught: list[ViewTask] = []

    def catch(part: Any, samples: Any, task: ViewTask, *_: Any) -> ViewResult:
        caught.append(task)
        raise ReachedError

    with monkeypatch.context() as patch:
        patch.setattr(answers.views.inspecting, "inspect_view", catch)
        with pytest.raises(ReachedError):
            ask(JOB, *arguments)
    return caught[0]


def result(view: str, T: NDArray[np.float64]) -> ViewResult:
    return ViewResult(
        view, True, "", T, T, 0.0, 0.0, 0.03, (), np.zeros(0, dtype=bool), np.zeros((0, 2))
    )


def shown_with(hold: PartInGripper, layout: Any, view: str, q: Any) -> Shown:
    blank = np.zeros((4, 4), np.uint8)
    return Shown(
        view=view,
        hold=hold,
        q=q,
        expected=shown_pose(layout, q, hold.T_part_tcp),
        holder=holder_boxes(layout, q, hold.opening_mm),
        backlit=blank,
        lamps=("station_ring",),
        is_hold_measured=hold.is_measured,
        T_part_tcp=hold.T_part_tcp,
        task=SimpleNamespace(),  # type: ignore[arg-type]  # nobody waits for it here
    )


def assert_same(one: ViewTask, other: ViewTask) -> None:
    assert one.view_id == other.view_id
    assert one.is_hold_measured == other.is_hold_measured
    assert one.limits == other.limits
    pairs = [
        (one.T_world_part_expected, other.T_world_part_expected),
        (one.panel_mm, other.panel_mm),
        (one.camera.K, other.camera.K),
        (one.camera.distortion, other.camera.distortion),
        (one.camera.T_world_cam, other.camera.T_world_cam),
        *((a.points_mm, b.points_mm) for a, b in zip(one.lamps, other.lamps, strict=True)),
        *((a.T, b.T) for a, b in zip(one.holder, other.holder, strict=True)),
        *((a.half_mm, b.half_mm) for a, b in zip(one.holder, other.holder, strict=True)),
    ]
    assert all(np.array_equal(a, b) for a, b in pairs)
    assert [lamp.name for lamp in one.lamps] == [lamp.name for lamp in other.lamps]


def test_views_in_the_file_are_the_views_that_were_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, recipe = load_cell(EMULATED_CELL), load_recipe(RECIPE)
    layout, c = build_layout(cell), context(JOB)
    T = np.eye(4)
    T[:3, 3] = 3.1, -2.7, 11.3
    hold = PartInGripper(SimpleNamespace(), T, 31.7)  # type: ignore[arg-type]  # no grasp is read
    first = shown_with(hold, layout, "V1", Q)
    # the first view finds the part a little off; all later ones expect it there
    found = first.expected.copy()
    found[:3, 3] += 0.4, -0.2, 0.7
    known: Any = SimpleNamespace(result=lambda: Located(True, "", found))
    first = replace(first, located=known)
    hold.T_part_tcp = inverse_pose(found) @ tcp_pose(layout, Q)
    hold.is_measured = True
    second = shown_with(hold, layout, "V2", Q + 0.01)
    upright = np.eye(4)
    upright[:3, 3] = 310.0, 20.0, 7.0
    table = Shown(
        "T0", None, np.zeros(6), upright, (), first.backlit, ("table_ring",), True, None,
        first.task,
    )  # fmt: skip
    seen = np.arange(len(c.samples.points_mm)) % 3 == 0
    part = PartRecord(
        number=7,
        judged=[table],
        results=[result("T0", upright)],
        pending=[first, second],
        planned={"T0": seen, "V1": ~seen, "V2": seen},
        files={
            "T0": {"table_backlight": "a.png", "table_ring": "b.png"},
            "V1": {"station_backlight": "c.png", "station_ring": "d.png"},
            "V2": {"station_backlight": "e.png", "station_ring": "f.png"},
        },
    )
    product = product_of(Compute(JOB, None), recipe, cell)  # type: ignore[arg-type]  # not asked
    stored = PartFileWriter(cell, layout, tmp_path).write(part, product)
    path = tmp_path / "part007.views.json"
    assert stored.file == path.name
    assert stored.digest == hashlib.sha256(path.read_bytes()).hexdigest()

    file = load_view_set(path)
    assert file.recipe == recipe
    blank = {v.id: dict.fromkeys(v.pictures, np.zeros((4, 4), np.uint8)) for v in file.views}
    views = build_view_set(file, c.part, blank, first_limits(c)).views
    lit = {"station_ring": first.backlit}
    on_table = live_task(
        monkeypatch, answers.inspect_on_table, "T0", upright, first.backlit,
        {"table_ring": first.backlit},
    )  # fmt: skip
    in_hand = live_task(
        monkeypatch, answers.inspect, "V2", second.expected, second.holder, first.backlit, lit, True
    )
    assert_same(views[0].task, on_table)
    assert_same(views[2].task, in_hand)
    # the first view is restated by the hold that it taught
    assert np.allclose(views[1].task.T_world_part_expected, found)
    assert [view.grasp for view in views] == [0, 1, 1]
    assert views[0].counted is not None
    assert np.array_equal(views[0].counted, seen)
    assert views[1].counted is None


def test_views_before_a_turn_was_shown_are_restated_by_the_hold_that_showed_it(
    tmp_path: Path,
) -> None:
    cell, recipe = load_cell(EMULATED_CELL), load_recipe(RECIPE)
    layout = build_layout(cell)
    free = FreeTurn(np.array([0.0, 0.0, 1.0]), np.array([2.0, 1.0, 0.0]), np.array([0.0, np.pi]))
    guess = np.eye(4)
    guess[:3, 3] = 3.1, -2.7, 11.3
    hold = PartInGripper(SimpleNamespace(), guess, 31.7, is_measured=True)  # type: ignore[arg-type]  # no grasp is read
    before = replace(shown_with(hold, layout, "V1", Q), facts=PartFacts(free_turn=free))
    alone = shown_with(PartInGripper(hold.grasp, guess, 31.7), layout, "W1", Q)
    # a view shows the turn: the hold is another one from now on
    hold.T_part_tcp = inverse_pose(free.by(2.0)) @ guess
    after = replace(
        shown_with(hold, layout, "V2", Q + 0.01),
        facts=PartFacts(free_turn=replace(free, is_shown=True)),
    )
    shown = [before, after, replace(alone, facts=PartFacts(free_turn=free))]
    files = {one.view: {"station_backlight": "a.png", "station_ring": "b.png"} for one in shown}
    part = PartRecord(number=1, pending=shown, files=files)
    product = product_of(Compute(JOB, None), recipe, cell)  # type: ignore[arg-type]  # not asked
    PartFileWriter(cell, layout, tmp_path).write(part, product)
    first, second, other = load_view_set(tmp_path / "part001.views.json").views
    expected = shown_pose(layout, Q, hold.T_part_tcp)
    np.testing.assert_allclose(first.T_world_part, expected, atol=1e-9)
    assert first.grasp == second.grasp
    assert first.free_turn is not None
    assert first.free_turn == second.free_turn
    assert first.free_turn.is_shown
    assert first.free_turn.same_deg == pytest.approx((0.0, 180.0))
    # of another hold nothing has been learned
    np.testing.assert_allclose(other.T_world_part, alone.expected, atol=1e-9)
    assert other.free_turn is not None
    assert not other.free_turn.is_shown


def test_what_a_part_comes_to_can_leave_the_worker_process(tmp_path: Path) -> None:
    path = view_sets.write(tmp_path)
    file = load_view_set(path)
    found = judge_views(
        file, compiled_part(path, file), read_pictures(path, file), Judging(None, path, path)
    )
    assert any(look for one in found.measured for look in one.looks)
    assert lines_digest(pickle.loads(pickle.dumps(found))) == lines_digest(found)


def first_limits(c: Any) -> Any:
    from controller.cell.compute.job import inspection_limits

    return inspection_limits(c.recipe)


def test_a_picture_is_noted_by_what_was_written(tmp_path: Path) -> None:
    from controller.cell.services import Imaging

    noted: dict[str, str] = {}
    lights: Any = SimpleNamespace(names=())
    imaging = Imaging(lights, {}, frozenset(), tmp_path, noted.__setitem__)
    picture = np.random.default_rng(3).integers(0, 256, (40, 60)).astype(np.uint8)
    file = asyncio.run(imaging.save(2, "V1_ring", picture))
    assert noted == {file: hashlib.sha256((tmp_path / file).read_bytes()).hexdigest()}
    assert np.array_equal(read_grey(tmp_path / file, (60, 40)), picture)
