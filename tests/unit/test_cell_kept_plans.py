"""Plans in the cache: what is read back is what was made, and no file can run, hang or mislead."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cad_solids import box, mesh_of
from same_values import assert_same

from controller.cache.file import pack, read_file, unpack
from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, load_part
from controller.cell.plans import KeptPlan, PlanCache
from controller.cell.plans.stored import PartCaches, check_prepared, is_pose
from controller.config import load_cell
from controller.planning import Certificate, GraspRules, PlanOptions, PreparedPart, Present
from controller.setup.layout import build_layout

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"
EMPTY = SimpleNamespace(arm_grasps=(), fixed_grasps=())
FEW = PlanOptions(
    arm_grasps_per_pose=3,
    arm_grasps_round=4,
    fixed_grasps=4,
    direction_count=30,
    rules=GraspRules().coarse(),
)


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> CompiledPart:
    folder = tmp_path_factory.mktemp("kept")
    mesh_of(box(60, 40, 30)).export(folder / "block.stl")
    return load_part(folder / "block.stl", cache=folder / "cache")


@pytest.fixture(scope="module")
def made(part: CompiledPart) -> tuple[KeptPlan, PreparedPart]:
    """A plan and what it was made from, by no cache."""
    planning = PlanCache(part, build_layout(load_cell(CELL)), FEW, use_cache=False)
    kept = planning.plan_at(part.poses[0], 360.0, 0.0, 0.4)
    assert kept.plan is not None
    return kept, planning.prepared()


@pytest.fixture
def file(
    part: CompiledPart,
    made: tuple[KeptPlan, PreparedPart],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    """A sound file of that plan."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    kept = PartCaches(part)
    path = kept.plans.file("block", "0123456789")
    kept.plans.save(path, made[0])
    assert kept.plans.load(path) is not None
    return path


def test_a_plan_is_read_back_to_the_bit(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    found = PartCaches(part).plans.load(file)
    assert_same(found, made[0])


def test_a_prepared_part_is_read_back_to_the_bit_and_plans_the_same(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    kept = PartCaches(part)
    path = kept.prepared.file("block", "42")
    kept.prepared.save(path, made[1])
    found = kept.prepared.load(path)
    assert found is not None
    bare: dict[str, Any] = {"solid": None, "shape": None}
    assert_same(replace(found, **bare), replace(made[1], **bare))
    assert found.solid is part.solid
    assert np.array_equal(found.shape.hull_mm, made[1].shape.hull_mm)


def test_the_second_start_takes_what_the_first_has_kept(
    part: CompiledPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    layout = build_layout(load_cell(CELL))
    first = PlanCache(part, layout, FEW)
    plan = first.plan_at(part.poses[0], 360.0, 0.0, 0.0)
    second = PlanCache(part, layout, FEW)
    assert_same(second.plan_at(part.poses[0], 360.0, 0.0, 0.0), plan)
    second.prepared()
    assert second.is_from_cache
    assert not first.is_from_cache


def references(tree: Any) -> Iterator[tuple[int, list[int]]]:
    """Start and shape of all arrays of doubles in a tree."""
    match tree:
        case ["f8", int(start), [*shape]]:
            yield start, shape
        case list() | dict():
            for inner in tree.values() if isinstance(tree, dict) else tree:
                yield from references(inner)


def no_number(file: Path) -> bytes:
    tree, arrays = unpack(read_file(file))
    at = next(start for start, shape in references(tree) if shape == [6])
    arrays["f8"][at + 2] = np.nan
    return pack(tree, arrays)


def no_rotation(file: Path) -> bytes:
    tree, arrays = unpack(read_file(file))
    at = next(start for start, shape in references(tree) if shape == [4, 4])
    arrays["f8"][at : at + 16] *= 1.01
    return pack(tree, arrays)


@pytest.mark.parametrize(
    "planted", [no_number, no_rotation], ids=["NaN in a path", "a pose that scales"]
)
def test_a_planted_file_is_not_believed_and_said(
    planted: Callable[[Path], bytes],
    part: CompiledPart,
    file: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    file.write_bytes(planted(file))
    with caplog.at_level(logging.WARNING):
        assert PartCaches(part).plans.load(file) is None
    assert caplog.text.count("it is made anew") == 1
    assert file.name in caplog.text


def test_a_plan_of_a_part_with_other_samples_is_refused(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    plan = made[0].plan
    assert plan is not None
    steps = tuple(
        replace(step, seen=step.seen[:-1]) if isinstance(step, Present) else step
        for step in plan.steps
    )
    kept = PartCaches(part)
    kept.plans.save(file, replace(made[0], plan=replace(plan, steps=steps)))
    assert kept.plans.load(file) is None


def test_tables_that_do_not_fit_together_are_refused(
    made: tuple[KeptPlan, PreparedPart],
) -> None:
    sound = made[1]
    check_prepared(sound)
    table = sound.visibility_table
    wrongs: tuple[dict[str, Any], ...] = (
        {"covered": sound.covered[:-1]},
        {"shown": sound.shown[:-1]},
        {"home_q": sound.home_q[:, :5]},
        {"visibility_table": replace(table, visible=table.visible[:, :-1])},
        {"view_q": ({10_000: np.zeros((1, 6))}, *sound.view_q[1:])},
    )
    for wrong in wrongs:
        with pytest.raises(ValueError, match=r"another|other|no such"):
            check_prepared(replace(sound, **wrong))


def test_a_mirror_is_no_pose() -> None:
    assert is_pose(np.eye(4))
    assert not is_pose(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert not is_pose(np.full((4, 4), np.nan))


def test_the_plans_of_a_large_catalogue_are_all_kept(part: CompiledPart) -> None:
    kept = PartCaches(part)
    refused = KeptPlan(part.poses[0].index, np.eye(4), None, "no")
    files = [kept.plans.file("block", f"{i}") for i in range(600)]
    for each in files:
        kept.plans.save(each, refused)
    assert all(each.exists() for each in files)


def test_poses_that_a_symmetry_makes_one_are_planned_once(
    part: CompiledPart, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned: list[int] = []

    def certify(
        prepared: PreparedPart, layout: object, poses: Sequence[StablePose]
    ) -> tuple[Certificate, ...]:
        planned.extend(pose.index for pose in poses)
        return tuple(Certificate(p.index, p.probability, None, "no plan", 0.25) for p in poses)

    monkeypatch.setattr("controller.cell.plans.planning.certify", certify)
    monkeypatch.setattr(PlanCache, "prepared", lambda _: EMPTY)
    planning = PlanCache(part, build_layout(load_cell(CELL)), FEW, use_cache=False)
    found = [planning.certified(pose).certificate for pose in part.poses]
    # a block rests on six faces, and a half turn carries each to the one opposite
    assert [c.pose_index for c in found] == list(range(6))
    assert len(set(planned)) == 3
    for pose, certificate in zip(part.poses, found, strict=True):
        is_first = pose.same_as in (-1, pose.index)
        assert certificate.same_as == (-1 if is_first else pose.same_as)
        assert certificate.probability == pose.probability
        assert (certificate.reason, certificate.pickable) == ("no plan", 0.25)
