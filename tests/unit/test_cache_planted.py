"""Damaged, planted and foreign files are never trusted and never run, by any user of the cache."""

from __future__ import annotations

import io
import json
import logging
import os
import pickle
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cad_solids import box, mesh_of
from same_values import assert_same

from controller.cache import DiskCache
from controller.cache.file import DIGEST_BYTES, MAX_BYTES, pack, sealed, unpack
from controller.cad.compiled import CompileOptions, load_part
from controller.cad.compiled.cache import part_cache
from controller.cell.plans import PlanCache
from controller.cell.plans.stored import PartCaches
from controller.config import load_cell
from controller.planning import GraspRules, PlanOptions
from controller.recognition.stored import entry_cache, open_library, shape_cache
from controller.setup.layout import build_layout

CELL = Path(__file__).parents[2] / "recipes" / "cells" / "emulated.yaml"
FEW = PlanOptions(
    arm_grasps_per_pose=3,
    arm_grasps_round=4,
    fixed_grasps=4,
    direction_count=30,
    rules=GraspRules().coarse(),
)
USERS = ("part", "views", "edges", "plan", "prepared")


@dataclass(frozen=True)
class User:
    """A cache, a file of it, that file's sound bytes and what they hold."""

    cache: DiskCache[Any]
    file: Path
    sound: bytes
    value: Any

    def is_missed(self, data: bytes) -> bool:
        """Whether a file of these bytes in its place is a miss."""
        self.file.write_bytes(data)
        return self.cache.load(self.file) is None


class Trap:
    """What a planted pickle does when it is read."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str]]:
        return os.mkdir, (str(self._path),)


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, User]:
    """One file of each user, as the program writes it."""
    folder = tmp_path_factory.mktemp("planted")
    path = folder / "block.stl"
    mesh_of(box(60, 40, 30)).export(path)
    layout = build_layout(load_cell(CELL))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        part = load_part(path)
        open_library([(path, CompileOptions())], layout.overhead).model(0)
        PlanCache(part, layout, FEW).plan_at(part.poses[0], 360.0, 0.0, 0.4)
    kept = PartCaches(part)
    caches: dict[str, DiskCache[Any]] = {
        "part": part_cache(),
        "views": entry_cache(),
        "edges": shape_cache(),
        "plan": kept.plans,
        "prepared": kept.prepared,
    }
    users = {}
    for name in USERS:
        (file,) = (folder / "cellctl").glob(f"{name}-block-*.npz")
        value = caches[name].load(file)
        assert value is not None
        users[name] = User(caches[name], file, file.read_bytes(), value)
    return users


@pytest.fixture(params=USERS)
def user(request: pytest.FixtureRequest, filled: dict[str, User]) -> User:
    found = filled[request.param]
    if found.file.is_dir():
        found.file.rmdir()
    found.file.unlink(missing_ok=True)
    found.file.write_bytes(found.sound)
    return found


def test_a_flipped_byte_anywhere_is_noticed(user: User) -> None:
    rng = np.random.default_rng(20)
    size = len(user.sound)
    places = [*range(64), *rng.integers(0, size, 100).tolist(), *range(size - 100, size)]
    for place in places:
        data = bytearray(user.sound)
        data[place] ^= int(rng.integers(1, 256))
        assert user.is_missed(data), f"byte {place}"


@pytest.mark.parametrize(
    "damage",
    [
        lambda sound: b"",
        lambda sound: sound[:10],
        lambda sound: sound[: len(sound) // 2],
        lambda sound: sound[:-1],
        lambda sound: sound + b"\0",
        lambda sound: b"PK\x03\x04" + sound,
        lambda sound: sound[::-1],
        lambda sound: b"\0" * len(sound),
        lambda sound: b"0" * DIGEST_BYTES,
        lambda sound: sealed(b"0" * DIGEST_BYTES),
        lambda sound: sealed(sound[:-100]),
        lambda sound: sealed(sound[100:]),
    ],
)
def test_a_file_cut_short_or_foreign_is_a_miss(user: User, damage: Any) -> None:
    assert user.is_missed(damage(user.sound))
    assert not user.is_missed(user.sound)


def test_a_planted_pickle_runs_nothing(user: User, tmp_path: Path) -> None:
    witness = tmp_path / "it ran"
    body = pickle.dumps(Trap(witness))
    pickle.loads(body)  # the trap works
    witness.rmdir()
    tree, arrays = unpack(user.sound)
    trap = np.array([Trap(witness)], dtype=object)
    for data in (
        body,
        sealed(body + b"0" * DIGEST_BYTES),
        planted_npz(tree=trap),
        planted_npz(tree=np.frombuffer(json.dumps(tree).encode(), dtype=np.uint8), f8=trap),
        planted_npz(**arrays, tree=np.frombuffer(body, dtype=np.uint8)),
        with_member(user.sound, "f8", body),
        with_member(user.sound, "f8.npy", b"\x80\x04N." + body),
        with_member(user.sound, "note.pickle", body),
    ):
        assert user.is_missed(data)
    assert not witness.exists()


def planted_npz(**arrays: Any) -> bytes:
    """A file with any arrays, under the digest that belongs to it."""
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.comment = b"0" * DIGEST_BYTES
    return sealed(buffer.getvalue())


def with_member(sound: bytes, name: str, content: bytes) -> bytes:
    """A sound file with one member of any content instead of, or beside, its own."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(sound)) as old, zipfile.ZipFile(buffer, "w") as new:
        for member in old.namelist():
            if member.removesuffix(".npy") != name.removesuffix(".npy"):
                new.writestr(member, old.read(member))
        new.writestr(name, content)
        new.comment = b"0" * DIGEST_BYTES
    return sealed(buffer.getvalue())


def deep(sound: bytes) -> bytes:
    text = b'{"value":' + b"[" * 200_000 + b"]" * 200_000 + b"}"
    return planted_npz(tree=np.frombuffer(text, dtype=np.uint8))


def endless_shapes(sound: bytes) -> bytes:
    """Each array of so many empty rows that they would fill the memory one by one."""
    tree, arrays = unpack(sound)
    return pack(on_references(tree, lambda name, start, shape: [name, 0, [2**40, 0]]), arrays)


def beyond_the_end(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    return pack(on_references(tree, lambda name, start, shape: [name, 2**40, shape]), arrays)


def endless_member(sound: bytes) -> bytes:
    text = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        text, {"descr": "<f8", "fortran_order": False, "shape": (2**42,)}
    )
    return with_member(sound, "f8.npy", text.getvalue() + b"\0" * 64)


def mad_member(sound: bytes) -> bytes:
    return with_member(sound, "f8.npy", b"\x93NUMPY\x01\x00\x10\x00" + b"(((((((((((((((\n")


def other_types(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    narrow = {name: array.astype(np.float32) for name, array in arrays.items() if name == "f8"}
    return pack(
        on_references(tree, lambda name, *rest: ["f4" if name == "f8" else name, *rest]),
        {name: array for name, array in arrays.items() if name != "f8"} | {"f4": narrow["f8"]},
    )


def renamed_types(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    return pack(tree, arrays | {"f8": arrays["f8"].astype(np.float32)})


def other_tree(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    return pack(tree | {"value": {"__reduce__": "os.system"}}, arrays)


def other_format(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    return pack(tree | {"format": tree["format"] - 1}, arrays)


def of_another_key(sound: bytes) -> bytes:
    tree, arrays = unpack(sound)
    return pack(tree | {"key": tree["key"] + "9"}, arrays)


def no_mapping(sound: bytes) -> bytes:
    _, arrays = unpack(sound)
    return planted_npz(**arrays, tree=np.frombuffer(b"[1, 2]", dtype=np.uint8))


def on_references(tree: Any, change: Callable[..., Any]) -> Any:
    """A tree with all references to arrays changed."""
    match tree:
        case [str(name), int(start), [*shape]]:
            return change(name, start, shape)
        case list():
            return [on_references(inner, change) for inner in tree]
        case dict():
            return {key: on_references(inner, change) for key, inner in tree.items()}
    return tree


@pytest.mark.parametrize(
    "planted",
    [
        deep,
        endless_shapes,
        beyond_the_end,
        endless_member,
        mad_member,
        other_types,
        renamed_types,
        other_tree,
        other_format,
        of_another_key,
        no_mapping,
    ],
)
def test_a_planted_file_is_not_believed_and_reported(
    user: User, planted: Callable[[bytes], bytes], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        assert user.is_missed(planted(user.sound))
    assert caplog.text.count("it is made anew") == 1
    assert user.file.name in caplog.text


def test_a_tree_changed_anywhere_is_a_value_or_a_miss(user: User) -> None:
    tree, arrays = unpack(user.sound)
    text = json.dumps(tree).encode()
    start = text.index(b'"value"')
    letters = np.frombuffer(b'0123456789[]{},:"-.eN', dtype=np.uint8)
    rng = np.random.default_rng(22)
    missed = 0
    for _ in range(150):
        changed = bytearray(text)
        for place in rng.integers(start, len(text), 3):
            changed[place] = int(rng.choice(letters))
        data = planted_npz(**arrays, tree=np.frombuffer(bytes(changed), dtype=np.uint8))
        user.file.write_bytes(data)
        found = user.cache.load(user.file)  # and does not raise
        missed += found is None
        assert found is None or type(found) is type(user.value)
    assert missed > 75


def test_what_is_no_regular_file_is_left_alone(user: User) -> None:
    with user.file.open("wb") as wide:
        wide.truncate(MAX_BYTES + 1)  # takes no room on the disk
    assert user.cache.load(user.file) is None
    user.file.unlink()
    os.mkfifo(user.file)
    assert user.cache.load(user.file) is None
    user.file.unlink()
    user.file.symlink_to(user.file)
    assert user.cache.load(user.file) is None
    user.file.unlink()
    user.file.mkdir()
    assert user.cache.load(user.file) is None


def test_a_miss_is_mended_by_the_next_write(user: User) -> None:
    assert user.is_missed(user.sound[:-1])
    user.cache.save(user.file, user.value)
    assert_same(user.cache.load(user.file), user.value)
    assert user.file.read_bytes() == user.sound


def test_a_folder_that_cannot_be_written_is_a_warning(
    user: User, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        user.cache.save(user.cache.file("block", "1", tmp_path / "file"), user.value)
    assert "cannot be kept" in caplog.text
