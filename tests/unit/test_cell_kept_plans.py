"""Plans in the cache: what is read back is what was made, and no file can run, hang or mislead."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_solids import box, mesh_of

from controller.cad.compiled import CompiledPart, load_part
from controller.cad.compiled import _container as container
from controller.cell.kept_plans import FORMAT, Kept, KeptPlan, check_prepared, is_pose
from controller.cell.plans import Planning
from controller.config import load_cell
from controller.planning import GripRules, PlanOptions, PreparedPart, Present
from controller.setup.layout import build_layout

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"
FEW = PlanOptions(
    arm_grips_per_pose=3,
    arm_grips_round=4,
    fixture_grips=4,
    directions_n=30,
    rules=GripRules().coarse(),
)


class Trap:
    """What a planted pickle does when it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.mkdir, (str(self._path),)


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> CompiledPart:
    folder = tmp_path_factory.mktemp("kept")
    mesh_of(box(60, 40, 30)).export(folder / "block.stl")
    return load_part(folder / "block.stl", cache=folder / "cache")


@pytest.fixture(scope="module")
def made(part: CompiledPart) -> tuple[KeptPlan, PreparedPart]:
    """A plan and what it was made from, by no cache."""
    planning = Planning(part, build_layout(load_cell(CELL)), FEW, use_cache=False)
    kept = planning.lying(part.poses[0], 360.0, 0.0, 0.4)
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
    kept = Kept(part)
    path = kept.plans.file("block", "0123456789")
    kept.plans.save(path, made[0], FORMAT)
    assert kept.plans.load(path, FORMAT) is not None
    return path


def written(value: object) -> object:
    """Everything a value holds, as plain lists."""
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, value.tobytes()]
    if isinstance(value, tuple):
        return [written(item) for item in value]
    if hasattr(value, "items"):
        return [[key, written(item)] for key, item in value.items()]
    if hasattr(value, "__dataclass_fields__"):
        return [[name, written(getattr(value, name))] for name in value.__dataclass_fields__]
    return value


def sealed(header: dict[str, Any], arrays: list[Any]) -> bytes:
    header.pop("arrays", None)
    return container.pack(header, arrays)


def opened(file: Path) -> tuple[dict[str, Any], list[Any]]:
    return container.unpack(container.read_file(file))


def test_a_plan_is_read_back_to_the_bit(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    found = Kept(part).plans.load(file, FORMAT)
    assert written(found) == written(made[0])


def test_a_prepared_part_is_read_back_to_the_bit_and_plans_the_same(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    kept = Kept(part)
    path = kept.prepared.file("block", "42")
    kept.prepared.save(path, made[1], FORMAT)
    found = kept.prepared.load(path, FORMAT)
    assert found is not None
    bare: dict[str, Any] = {"solid": None, "shape": None}
    assert written(replace(found, **bare)) == written(replace(made[1], **bare))
    assert found.solid is part.solid
    assert np.array_equal(found.shape.hull_mm, made[1].shape.hull_mm)


def test_the_second_start_takes_what_the_first_has_kept(
    part: CompiledPart, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    layout = build_layout(load_cell(CELL))
    first = Planning(part, layout, FEW)
    plan = first.lying(part.poses[0], 360.0, 0.0, 0.0)
    second = Planning(part, layout, FEW)
    assert written(second.lying(part.poses[0], 360.0, 0.0, 0.0)) == written(plan)
    second.prepared()
    assert second.is_from_cache
    assert not first.is_from_cache


@pytest.mark.parametrize("with_digest", [False, True], ids=["bare", "as the old format had it"])
def test_a_planted_pickle_runs_nothing(
    with_digest: bool, part: CompiledPart, file: Path, tmp_path: Path
) -> None:
    witness = tmp_path / "it ran"
    body = pickle.dumps(Trap(witness))
    pickle.loads(body)  # the trap works
    assert witness.exists()
    witness.rmdir()
    planted = hashlib.sha256(body).digest() + body if with_digest else body
    for path in (file, file.with_suffix(".pickle")):
        path.write_bytes(planted)
    assert Kept(part).plans.load(file, FORMAT) is None
    assert not witness.exists()


def deep_header(file: Path) -> bytes:
    text = b'{"tree":' + b"[" * 200_000 + b"]" * 200_000 + b"}"
    body = len(text).to_bytes(8, "little") + text
    return container.NAME + hashlib.sha256(body).digest() + body


def endless_lengths(file: Path) -> bytes:
    """A stack of so many empty arrays that they would fill the memory once they are apart."""
    header, arrays = opened(file)
    empty = np.zeros((2**40, 0))
    return sealed(header, [empty if a.dtype == np.float64 else a for a in arrays])


def no_number(file: Path) -> bytes:
    header, arrays = opened(file)
    at = next(i for i, a in enumerate(arrays) if a.dtype == np.float64 and a.shape[1:] == (6,))
    arrays[at] = arrays[at].copy()
    arrays[at][0, 2] = np.nan
    return sealed(header, arrays)


def other_types(file: Path) -> bytes:
    header, arrays = opened(file)
    return sealed(header, [a.astype(np.float32) if a.dtype == np.float64 else a for a in arrays])


def no_rotation(file: Path) -> bytes:
    header, arrays = opened(file)
    at = next(i for i, a in enumerate(arrays) if a.shape[-2:] == (4, 4))
    arrays[at] = arrays[at] * 1.01
    return sealed(header, arrays)


def other_tree(file: Path) -> bytes:
    header, arrays = opened(file)
    return sealed(header | {"tree": {"__reduce__": "os.system"}}, arrays)


def other_format(file: Path) -> bytes:
    header, arrays = opened(file)
    return sealed(header | {"format": FORMAT - 1}, arrays)


def of_another_key(file: Path) -> bytes:
    header, arrays = opened(file)
    return sealed(header | {"key": "plan-block-99"}, arrays)


@pytest.mark.parametrize(
    "planted",
    [
        lambda file: b"",
        lambda file: file.read_bytes()[:20],
        lambda file: file.read_bytes()[:-1],
        deep_header,
        endless_lengths,
        no_number,
        other_types,
        no_rotation,
        other_tree,
        other_format,
        of_another_key,
    ],
    ids=[
        "empty",
        "cut off in its head",
        "cut off at its end",
        "deep JSON",
        "endless lengths",
        "NaN in a way",
        "other types",
        "a pose that scales",
        "another tree",
        "another format",
        "another plan under this name",
    ],
)
def test_a_planted_file_is_not_believed_and_said(
    planted: Callable[[Path], bytes],
    part: CompiledPart,
    file: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    file.write_bytes(planted(file))
    with caplog.at_level(logging.WARNING):
        assert Kept(part).plans.load(file, FORMAT) is None
    assert caplog.text.count("it is made anew") == 1
    assert file.name in caplog.text


def test_a_file_larger_than_any_and_a_pipe_are_left_alone(part: CompiledPart, file: Path) -> None:
    with file.open("wb") as wide:
        wide.truncate(container.MOST_BYTES + 1)  # takes no room on the disk
    assert Kept(part).plans.load(file, FORMAT) is None
    file.unlink()
    os.mkfifo(file)
    assert Kept(part).plans.load(file, FORMAT) is None


def test_a_plan_of_a_part_with_other_samples_is_refused(
    part: CompiledPart, made: tuple[KeptPlan, PreparedPart], file: Path
) -> None:
    plan = made[0].plan
    assert plan is not None
    steps = tuple(
        replace(step, seen=step.seen[:-1]) if isinstance(step, Present) else step
        for step in plan.steps
    )
    kept = Kept(part)
    kept.plans.save(file, replace(made[0], plan=replace(plan, steps=steps)), FORMAT)
    assert kept.plans.load(file, FORMAT) is None


def test_tables_that_do_not_fit_together_are_refused(
    made: tuple[KeptPlan, PreparedPart],
) -> None:
    sound = made[1]
    check_prepared(sound)
    wrongs: tuple[dict[str, Any], ...] = (
        {"covered": sound.covered[:-1]},
        {"shown": sound.shown[:-1]},
        {"hub": sound.hub[:, :5]},
        {"visible": sound.visible[:, :-1]},
        {"view_q": ({10_000: np.zeros((1, 6))}, *sound.view_q[1:])},
    )
    for wrong in wrongs:
        with pytest.raises(ValueError, match=r"another|other|no such"):
            check_prepared(replace(sound, **wrong))


def test_a_mirror_is_no_pose() -> None:
    assert is_pose(np.eye(4))
    assert not is_pose(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert not is_pose(np.full((4, 4), np.nan))


def test_the_header_is_plain_json(file: Path) -> None:
    data = file.read_bytes()
    length = int.from_bytes(data[container.BODY_AT : container.HEADER_AT], "little")
    header = json.loads(data[container.HEADER_AT : container.HEADER_AT + length])
    assert header["format"] == FORMAT
    assert header["key"] == file.stem


def test_the_oldest_plans_go_when_there_are_too_many(
    part: CompiledPart, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("controller.cell.kept_plans.KEPT_PLANS", 5)
    kept = Kept(part)
    refused = KeptPlan(part.poses[0].index, np.eye(4), None, "no")
    for i in range(9):
        kept.plans.save(kept.plans.file("block", f"{i}"), refused, FORMAT)
    assert len(list(file.parent.glob("*"))) == 5
