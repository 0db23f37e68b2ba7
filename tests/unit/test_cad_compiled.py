"""Compiled parts: what is read back is what was computed, and nothing else is believed."""

from __future__ import annotations

import hashlib
import json
import logging
import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, rod
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from controller.cad import OpenCadError, Solid, UnreadableCadError
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    cached_part,
    compile_part,
    load_part,
    make_part,
    part_name,
)
from controller.cad.compiled import _cache as cache_module
from controller.cad.compiled._codec import make_codec
from controller.cad.compiled._columns import CodecError, Reader, Writer
from controller.cad.compiled._container import BODY_AT, DIGEST_AT, pack, unpack

OWN = {Solid: ("boundary",)}  # what is found when first asked for, beside the fields
RECIPE_PARTS = Path(__file__).resolve().parents[2] / "recipes" / "parts"


def drilled(folder: Path, name: str = "drilled.stl") -> Path:
    """A plate with a bore, as a file."""
    path = folder / name
    mesh_of(box(40, 30, 10) - rod(5, 20, 24)).export(path)
    return path


def assert_same(a: Any, b: Any, where: str = "part") -> None:
    """Same types, same values, to the bit; only a mesh is compared by what is asked of it."""
    assert type(a) is type(b), f"{where}: {type(a)} {type(b)}"
    if isinstance(a, trimesh.Trimesh):
        for name in ("vertices", "faces", "face_normals", "area_faces", "bounds", "triangles"):
            assert_same(np.asarray(getattr(a, name)), np.asarray(getattr(b, name)), name)
        assert a.volume == b.volume
        assert np.array_equal(a.center_mass, b.center_mass)
        for name in ("vertices", "faces", "face_normals", "area_faces"):
            one, other = getattr(a.convex_hull, name), getattr(b.convex_hull, name)
            assert_same(np.asarray(one), np.asarray(other), f"hull {name}")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), where
    elif is_dataclass(a):
        for name in (*(field.name for field in fields(a)), *OWN.get(type(a), ())):
            assert_same(getattr(a, name), getattr(b, name), f"{where}.{name}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}[{i}]")
    else:
        assert a == b or (a != a and b != b), f"{where}: {a!r} {b!r}"


def round_trip(value: Any, kind: Any) -> Any:
    to = Writer()
    tree = make_codec(kind).write([value], to)
    header, arrays = unpack(bytearray(pack({"tree": tree}, to.arrays)))
    (back,) = make_codec(kind).read(header["tree"], 1, Reader(arrays))
    return back


class Colour(Enum):
    RED = "r"
    BLUE = "b"


class Level(IntEnum):
    LOW = 1
    HIGH = 7


@dataclass(frozen=True, eq=False, slots=True)
class Leaf:
    number: float
    count: int
    is_on: bool
    word: str
    colour: Colour
    level: Level
    kind: Literal["a", 2, None]
    maybe: float | None
    points: NDArray[np.float64]
    ids: NDArray[np.int32]
    mask: NDArray[np.bool_]
    anything: NDArray[Any]


@dataclass(frozen=True, eq=False)
class Tree:
    leaves: tuple[Leaf, ...]
    pair: tuple[int, str]
    either: int | str | Leaf | None
    nested: tuple[tuple[float, ...], ...]


number = st.floats(allow_nan=True, allow_infinity=True)
int64 = st.integers(-(2**63), 2**63 - 1)
leaves = st.builds(
    Leaf,
    number=number,
    count=int64,
    is_on=st.booleans(),
    word=st.text(st.characters(exclude_categories=["Cs"])),
    colour=st.sampled_from(Colour),
    level=st.sampled_from(Level),
    kind=st.sampled_from(["a", 2, None]),
    maybe=st.none() | number,
    points=hnp.arrays(np.float64, st.tuples(st.integers(0, 4), st.just(2))),
    ids=hnp.arrays(np.int32, st.integers(0, 3)),
    mask=hnp.arrays(np.bool_, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=2)),
    anything=st.sampled_from([np.uint8, np.float32, np.int64]).flatmap(
        lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=2, max_side=3))
    ),
)
trees = st.builds(
    Tree,
    leaves=st.lists(leaves, max_size=4).map(tuple),
    pair=st.tuples(int64, st.text(st.characters(exclude_categories=["Cs"]))),
    either=st.none() | int64 | st.text(st.characters(exclude_categories=["Cs"])) | leaves,
    nested=st.lists(st.lists(number, max_size=3).map(tuple), max_size=3).map(tuple),
)


@settings(max_examples=60, deadline=None)
@given(tree=trees)
def test_any_tree_of_dataclasses_comes_back_to_the_bit(tree: Tree) -> None:
    assert_same(round_trip(tree, Tree), tree)


def test_numpy_scalars_come_back_as_the_plain_numbers_they_are_declared_as() -> None:
    back = round_trip((np.float64(0.5), np.int64(3), np.True_), tuple[float, int, bool])
    assert back == (0.5, 3, True)
    assert [type(v) for v in back] == [float, int, bool]


@pytest.mark.parametrize(
    ("kind", "value"),
    [
        (float, "1.0"),
        (float, True),
        (float, None),
        (int, 1.0),
        (int, 2**63),
        (int, True),
        (bool, 1),
        (str, b"bytes"),
        (Literal["a", "b"], "c"),
        (Literal[1], True),
        (Colour, "r"),
        (Level, 1),
        (tuple[int, ...], [1, 2]),
        (tuple[int, str], (1, "a", "b")),
        (int | None, "word"),
        (NDArray[np.float64], [1.0]),
        (NDArray[np.int32], np.array([2**40])),
        (NDArray[np.int32], np.array([0.5])),
        (NDArray[np.float32], np.array([0.1])),
        (NDArray[Any], np.array([object()])),
        (NDArray[Any], np.array(["word"])),
        (Tree, 3),
    ],
)
def test_a_value_that_is_not_as_declared_is_refused_when_it_is_written(
    kind: Any, value: Any
) -> None:
    with pytest.raises(TypeError, match=r"declared|than"):
        make_codec(kind).write([value], Writer())


@dataclass(frozen=True)
class Knot:
    other: Knot | None


@pytest.mark.parametrize("kind", [object, Any, list[int], dict[str, int], set[int], Path, Knot])
def test_a_type_that_cannot_be_stored_is_refused_before_anything_is_written(kind: Any) -> None:
    with pytest.raises(TypeError, match="stored"):
        make_codec(kind)


def test_an_array_of_a_narrower_type_is_widened_to_the_declared_one() -> None:
    back = round_trip(np.array([1, 2], dtype=np.int64), NDArray[np.int32])
    assert back.dtype == np.int32
    assert back.tolist() == [1, 2]


def test_a_part_comes_back_from_its_file_as_it_was_compiled(tmp_path: Path) -> None:
    path = drilled(tmp_path)
    computed = compile_part(path)
    made = make_part(path, cache=tmp_path / "cache")
    kept = cached_part(path, cache=tmp_path / "cache")
    assert kept is not None
    assert_same(made, computed)
    assert_same(kept, computed)


def test_what_a_mesh_is_asked_on_hot_paths_is_there_without_computing(tmp_path: Path) -> None:
    path = drilled(tmp_path)
    mesh = load_part(path, cache=tmp_path / "cache").solid.mesh
    for name in ("face_normals", "area_faces", "convex_hull"):
        assert name in mesh._cache.cache, name
    fresh = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
    assert np.array_equal(fresh.face_normals, mesh.face_normals)
    assert np.array_equal(fresh.area_faces, mesh.area_faces)
    assert fresh.convex_hull.volume == mesh.convex_hull.volume


def test_a_mesh_that_is_changed_forgets_what_was_kept(tmp_path: Path) -> None:
    mesh = load_part(drilled(tmp_path), cache=tmp_path / "cache").solid.mesh
    before = mesh.area
    mesh.apply_scale(2.0)
    assert mesh.area == pytest.approx(4 * before)


def test_the_second_time_nothing_is_computed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = drilled(tmp_path)
    load_part(path, cache=tmp_path / "cache")
    monkeypatch.setattr(cache_module, "compile_part", None)  # would not answer
    assert load_part(path, cache=tmp_path / "cache").solid.name == "drilled"


def test_a_copy_of_the_same_file_is_called_by_its_own_name(tmp_path: Path) -> None:
    first = load_part(drilled(tmp_path), cache=tmp_path / "cache").solid
    other = tmp_path / "other.stl"
    other.write_bytes((tmp_path / "drilled.stl").read_bytes())
    copy = load_part(other, cache=tmp_path / "cache").solid
    assert (copy.name, first.name) == ("other", "drilled")
    assert "boundary" in vars(copy)


def test_options_and_content_have_files_of_their_own(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    path = drilled(tmp_path)
    load_part(path, cache=cache)
    dense = load_part(path, CompileOptions(sample_spacing_mm=2.0), cache)
    assert len(dense.samples.points_mm) > 2 * len(load_part(path, cache=cache).samples.points_mm)
    mesh_of(box(40, 30, 12)).export(path)
    assert load_part(path, cache=cache).solid.volume_mm3 == pytest.approx(40 * 30 * 12)
    assert len(list(cache.iterdir())) == 3


def test_another_version_of_the_program_does_not_believe_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, cache = drilled(tmp_path), tmp_path / "cache"
    load_part(path, cache=cache)
    monkeypatch.setattr(cache_module, "FORMAT", cache_module.FORMAT + 1)
    assert cached_part(path, cache=cache) is None
    # nor under the new name, as a copy by hand would have it
    (file,) = cache.iterdir()
    with pytest.raises(CodecError, match="version"):
        cache_module.decode_part(bytearray(file.read_bytes()), file.stem)


def test_a_file_under_another_parts_name_is_not_believed(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    path = drilled(tmp_path)
    load_part(path, cache=cache)
    (wrong,) = cache.iterdir()
    mesh_of(box(40, 30, 12)).export(path)
    load_part(path, cache=cache)
    (right,) = set(cache.iterdir()) - {wrong}
    right.write_bytes(wrong.read_bytes())
    assert load_part(path, cache=cache).solid.volume_mm3 == pytest.approx(40 * 30 * 12)
    assert cached_part(path, cache=cache) is not None  # mended


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, bytes]:
    """CAD file, its compiled file, and that one's sound bytes."""
    folder = tmp_path_factory.mktemp("stored")
    path = drilled(folder)
    load_part(path, cache=folder / "cache")
    (file,) = (folder / "cache").iterdir()
    return path, file, file.read_bytes()


def test_a_flipped_byte_anywhere_is_noticed(stored: tuple[Path, Path, bytes]) -> None:
    path, file, sound = stored
    rng = np.random.default_rng(20)
    places = np.concatenate([np.arange(64), rng.integers(0, len(sound), 200), [len(sound) - 1]])
    for place in places:
        data = bytearray(sound)
        data[place] ^= int(rng.integers(1, 256))
        file.write_bytes(data)
        assert cached_part(path, cache=file.parent) is None, f"byte {place}"


def test_a_damaged_file_is_made_anew_and_gives_the_right_answer(
    stored: tuple[Path, Path, bytes],
) -> None:
    path, file, sound = stored
    expected = compile_part(path)
    rng = np.random.default_rng(21)
    for place in rng.integers(0, len(sound), 5):
        data = bytearray(sound)
        data[place] ^= 1 << int(rng.integers(8))
        file.write_bytes(data)
        assert_same(load_part(path, cache=file.parent), expected)
        assert file.read_bytes() == sound


@pytest.mark.parametrize(
    "damage",
    [
        lambda sound: b"",
        lambda sound: sound[:10],
        lambda sound: sound[:-1],
        lambda sound: sound + b"\0",
        lambda sound: b"\x80\x04N.",  # a pickle
        lambda sound: b"PK\x03\x04" + sound,
        lambda sound: sound[::-1],
        lambda sound: b"\0" * len(sound),
    ],
)
def test_a_file_cut_short_or_foreign_is_made_anew(
    stored: tuple[Path, Path, bytes], damage: Any
) -> None:
    path, file, sound = stored
    file.write_bytes(damage(sound))
    assert load_part(path, cache=file.parent).solid.name == "drilled"
    assert file.read_bytes() == sound


def sealed(data: bytearray) -> bytearray:
    """With the digest that belongs to it: damage that only the types can notice."""
    data[DIGEST_AT:BODY_AT] = hashlib.sha256(memoryview(data)[BODY_AT:]).digest()
    return data


def test_a_header_that_promises_what_is_not_there_is_no_crash(
    stored: tuple[Path, Path, bytes],
) -> None:
    _, file, sound = stored
    header_end = BODY_AT + 8 + int.from_bytes(sound[BODY_AT : BODY_AT + 8], "little")
    rng = np.random.default_rng(22)
    refused = 0
    for place in rng.integers(BODY_AT, header_end, 300):
        data = bytearray(sound)
        data[place] = int(rng.choice(np.frombuffer(b'0123456789[]{},:"-.eN', dtype=np.uint8)))
        try:
            cache_module.decode_part(sealed(data), file.stem)
        except CodecError:
            refused += 1
    assert refused > 200


def test_no_array_of_objects_is_read() -> None:
    data = bytearray(pack({}, [np.arange(3, dtype=np.int64)]))
    data = bytearray(bytes(data).replace(b'"<i8"', b'"|O8"'))
    with pytest.raises(CodecError, match="header"):
        unpack(sealed(data))


def test_a_folder_that_cannot_be_written_is_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = drilled(tmp_path)
    (tmp_path / "file").write_text("in the way")
    with caplog.at_level(logging.WARNING):
        part = load_part(path, cache=tmp_path / "file" / "cache")
    assert part.solid.volume_mm3 > 0
    assert "cannot be kept" in caplog.text


def test_a_full_disk_leaves_no_half_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    path = drilled(tmp_path)
    monkeypatch.setattr(Path, "replace", full)
    with caplog.at_level(logging.WARNING):
        load_part(path, cache=tmp_path / "cache")
    assert "No space left" in caplog.text
    assert list((tmp_path / "cache").iterdir()) == []


def test_a_refused_cad_file_leaves_nothing_behind(tmp_path: Path) -> None:
    mesh = mesh_of(box(40, 30, 10))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    mesh.export(tmp_path / "open.stl")
    with pytest.raises(OpenCadError):
        load_part(tmp_path / "open.stl", cache=tmp_path / "cache")
    with pytest.raises(UnreadableCadError):
        load_part(tmp_path / "missing.stl", cache=tmp_path / "cache")
    assert not (tmp_path / "cache").exists()


def test_the_oldest_files_go_when_there_are_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache_module, "KEPT_FILES", 3)
    cache = tmp_path / "cache"
    path = drilled(tmp_path)
    for i, spacing in enumerate((8.0, 9.0, 10.0, 11.0)):
        load_part(path, CompileOptions(sample_spacing_mm=spacing), cache)
        for file in cache.iterdir():
            if file.stat().st_mtime > 1000:
                os.utime(file, (i, i))
    assert len(list(cache.iterdir())) == 3
    assert cached_part(path, CompileOptions(sample_spacing_mm=8.0), cache) is None
    assert cached_part(path, CompileOptions(sample_spacing_mm=11.0), cache) is not None


def _load_often(path: Path, cache: Path, count: int, out: Any) -> None:
    out.put([load_part(path, cache=cache).solid.volume_mm3 for _ in range(count)])


def test_many_at_once_get_the_same_part(tmp_path: Path) -> None:
    path, cache = drilled(tmp_path), tmp_path / "cache"
    with ThreadPoolExecutor(4) as pool:
        parts = list(pool.map(lambda _: load_part(path, cache=cache), range(12)))
    for part in parts[1:]:
        assert_same(part, parts[0])
    assert [file.suffix for file in cache.iterdir()] == [".cell"]


@pytest.mark.slow
def test_two_processes_at_once_get_the_same_part(tmp_path: Path) -> None:
    path = drilled(tmp_path)
    context = multiprocessing.get_context("spawn")
    out = context.Queue()
    workers = [
        context.Process(target=_load_often, args=(path, tmp_path / "cache", 8, out))
        for _ in range(2)
    ]
    for worker in workers:
        worker.start()
    found = [volume for _ in workers for volume in out.get(timeout=600)]
    for worker in workers:
        worker.join(timeout=600)
    assert set(found) == {compile_part(path).solid.volume_mm3}
    assert [file.suffix for file in (tmp_path / "cache").iterdir()] == [".cell"]


def test_the_file_says_what_it_is_in_plain_json(stored: tuple[Path, Path, bytes]) -> None:
    _, file, sound = stored
    length = int.from_bytes(sound[BODY_AT : BODY_AT + 8], "little")
    header = json.loads(sound[BODY_AT + 8 : BODY_AT + 8 + length])
    assert header["format"] == cache_module.FORMAT
    assert header["key"] == file.stem


def test_a_recipe_part_is_read_from_its_file_as_it_was_compiled(tmp_path: Path) -> None:
    path = RECIPE_PARTS / "idler_riser.stl"
    made = make_part(path, cache=tmp_path)
    kept = load_part(path, cache=tmp_path)
    assert isinstance(kept, CompiledPart)
    assert_same(kept, made)


def test_a_ball_without_any_edge_is_stored_as_well(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    mesh_of(Body.sphere(10.0, 48)).export(path)
    assert_same(load_part(path, cache=tmp_path), compile_part(path))


@pytest.mark.parametrize("name", ["holder.stl", "widget.csg.yaml"])
def test_a_part_is_called_by_its_file_as_by_what_was_read_of_it(name: str, tmp_path: Path) -> None:
    # the cell compares what it recognised with what the recipe names
    file = Path(__file__).resolve().parents[2] / "recipes" / "parts" / name
    assert load_part(file, cache=tmp_path).solid.name == part_name(file)
    assert load_part(file, cache=tmp_path).solid.name == part_name(file)
