"""The disk cache: any annotated value comes back to the bit, and files prove themselves."""

from __future__ import annotations

import io
import json
import logging
import os
import zipfile
from dataclasses import dataclass
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray
from same_values import assert_same
from typing_extensions import TypeAliasType

from controller.cache import CacheError, DiskCache, disk, make_codec, source_hash
from controller.cache import file as file_module
from controller.cache.file import ArrayReader, ArrayWriter, pack, sealed, unpack


def round_trip(value: Any, kind: Any) -> Any:
    to = ArrayWriter()
    tree = make_codec(kind).write(value, to)
    back, arrays = unpack(pack({"value": tree}, to.joined()))
    return make_codec(kind).read(back["value"], ArrayReader(arrays))


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
        make_codec(kind).write(value, ArrayWriter())


@dataclass(frozen=True)
class Knot:
    other: Knot | None


@pytest.mark.parametrize("kind", [object, Any, list[int], dict[str, int], set[int], Path, Knot])
def test_a_type_that_cannot_be_stored_is_refused_before_anything_is_written(kind: Any) -> None:
    with pytest.raises(TypeError, match="stored"):
        make_codec(kind)


First, Second = TypeVar("First"), TypeVar("Second")
Scalar = TypeVar("Scalar", bound=np.generic)
Alias: Any = TypeAliasType  # mypy takes only aliases that stand as statements
# as NumPy has NDArray from 2.5 on, where Python is 3.12 or newer
Array = Alias("Array", np.ndarray[tuple[Any, ...], np.dtype[Scalar]], type_params=(Scalar,))
Swapped = Alias("Swapped", tuple[Second, First], type_params=(First, Second))
Nested = Alias("Nested", tuple[Array[Scalar], ...] | None, type_params=(Scalar,))
Word = Alias("Word", str | None)


@pytest.mark.parametrize(
    ("kind", "same_as"),
    [
        (Array[np.float64], NDArray[np.float64]),
        (Array[Any], NDArray[Any]),
        (Array, np.ndarray[tuple[Any, ...], np.dtype[Any]]),
        (Nested[np.int32], tuple[NDArray[np.int32], ...] | None),
        (Swapped[int, str], tuple[str, int]),
        (Word, str | None),
    ],
    ids=str,
)
def test_an_alias_is_stored_as_what_it_stands_for(kind: Any, same_as: Any) -> None:
    assert make_codec(kind).name == make_codec(same_as).name


def test_an_array_comes_back_by_either_form_of_its_annotation() -> None:
    for kind in (Array[np.float32], NDArray[np.float32]):
        back = round_trip(np.float32([1, 2]), kind)
        assert (back.dtype, back.tolist()) == (np.float32, [1, 2])
        with pytest.raises(TypeError, match="float32 is declared"):
            make_codec(kind).write(np.array(["a"]), ArrayWriter())


def test_a_file_holds_pieces_as_it_would_hold_them_joined() -> None:
    pieces = [np.arange(5.0), np.zeros(0), np.linspace(0, 1, 7)]
    tree = {"value": 3}
    apart = pack(tree, {"f8": pieces, "i4": [np.arange(4, dtype=np.int32)]})
    joined = pack(tree, {"f8": np.concatenate(pieces), "i4": np.arange(4, dtype=np.int32)})
    assert unpack(apart)[1]["f8"].tolist() == np.concatenate(pieces).tolist()
    assert [unpack(file)[0] for file in (apart, joined)] == [tree, tree]
    for name, array in unpack(joined)[1].items():
        assert unpack(apart)[1][name].tobytes() == array.tobytes()


def test_an_array_of_a_narrower_type_is_widened_to_the_declared_one() -> None:
    back = round_trip(np.array([1, 2], dtype=np.int64), NDArray[np.int32])
    assert back.dtype == np.int32
    assert back.tolist() == [1, 2]


def test_numbers_that_are_not_finite_are_refused_where_they_must_be() -> None:
    for kind, value in ((float, np.inf), (NDArray[np.float64], np.array([0.0, np.nan]))):
        to = ArrayWriter()
        tree = json.loads(json.dumps(make_codec(kind).write(value, to)))
        with pytest.raises(CacheError, match="finite"):
            make_codec(kind).read(tree, ArrayReader(to.joined(), is_finite=True))


@pytest.mark.parametrize(
    "reference",
    [
        ["f8", 0, [4]],
        ["f8", 2, [2]],
        ["f8", -1, [1]],
        ["f8", 0, [-1]],
        ["f8", 0, [-1, -3]],
        ["f8", 0, [2**62, 2**62]],
        ["f8", 0, [1.5]],
        ["f8", 0.5, [1]],
        ["f8", 0, ["3"]],
        ["f8", 0, 3],
        ["f4", 0, [1]],
        ["tree", 0, [1]],
        [["f8"], 0, [1]],
        ["f8", 0],
        None,
        7,
    ],
)
def test_a_reference_to_an_array_that_is_not_there_is_refused(reference: Any) -> None:
    reader = ArrayReader({"f8": np.arange(3.0)})
    assert reader.get(["f8", 0, [3, 1]]).shape == (3, 1)
    with pytest.raises(CacheError, match="array"):
        reader.get(reference)


@dataclass(frozen=True, eq=False)
class Row:
    name: str
    values: NDArray[np.float64]


ROW = Row("a", np.arange(1000.0))


def test_numpy_opens_the_file_and_the_tree_in_it_is_plain_json(tmp_path: Path) -> None:
    cache = DiskCache(Row, "row", "a row")
    file = cache.file("a", "42", tmp_path)
    cache.save(file, ROW)
    with np.load(file, allow_pickle=False) as archive:
        assert archive["f8"].tolist() == ROW.values.tolist()
        tree = json.loads(archive["tree"].tobytes())
    assert tree["key"] == file.stem == "row-a-42"
    assert tree["value"] == {"name": "a", "values": ["f8", 0, [1000]]}


def test_another_format_is_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = DiskCache(Row, "row", "a row")
    data = cache.encode(ROW, "42")
    monkeypatch.setattr(disk, "FORMAT", disk.FORMAT + 1)
    with pytest.raises(CacheError, match="version"):
        cache.decode(data, "42")


def test_a_file_that_unfolds_to_more_than_it_is_is_refused() -> None:
    data = io.BytesIO()
    np.savez_compressed(data, tree=np.zeros(2**26, dtype=np.uint8))
    with zipfile.ZipFile(data, "a") as archive:
        archive.comment = b"0" * 64
    with pytest.raises(CacheError, match="stored as they are"):
        unpack(sealed(data.getvalue()))


def test_a_value_larger_than_is_read_again_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(file_module, "MAX_TREE_BYTES", 50)
    cache = DiskCache(Row, "row", "a row")
    with caplog.at_level(logging.WARNING):
        cache.save(cache.file("a", "1", tmp_path), ROW)
    assert "cannot be kept" in caplog.text
    assert list(tmp_path.iterdir()) == []


def test_the_oldest_files_go_where_they_take_too_many_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = DiskCache(Row, "row", "a row")
    monkeypatch.setattr(disk, "MAX_FOLDER_BYTES", 2.5 * len(cache.encode(ROW, "row-a-1")))
    (tmp_path / "other-a-1.npz").write_bytes(b"0" * 100_000)  # another cache's
    for number in range(4):
        file = cache.file("a", str(number), tmp_path)
        cache.save(file, ROW)
        os.utime(file, (number + 1, number + 1))
    assert {file.name for file in tmp_path.iterdir()} == {
        "other-a-1.npz",
        "row-a-2.npz",
        "row-a-3.npz",
    }


def test_a_file_larger_than_all_room_is_kept_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk, "MAX_FOLDER_BYTES", 10)
    cache = DiskCache(Row, "row", "a row")
    for number in range(3):
        cache.save(cache.file("a", str(number), tmp_path), ROW)
    assert [file.name for file in tmp_path.iterdir()] == ["row-a-2.npz"]


def test_source_that_changes_or_moves_is_another_key(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one.py").write_text("x = 1")
    (tmp_path / "a" / "notes.txt").write_text("1")

    def now() -> str:
        source_hash.cache_clear()
        return source_hash(tmp_path / "a")

    before = now()
    (tmp_path / "a" / "notes.txt").write_text("2")
    assert now() == before
    (tmp_path / "a" / "one.py").write_text("x = 2")
    changed = now()
    (tmp_path / "a" / "one.py").rename(tmp_path / "a" / "two.py")
    assert len({before, changed, now()}) == 3
