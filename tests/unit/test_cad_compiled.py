"""Compiled parts: what is read back is what was computed, and nothing else is believed."""

from __future__ import annotations

import logging
import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from cad_solids import Body, box, mesh_of, rod
from same_values import assert_same

from controller.cache import disk
from controller.cache.file import pack, unpack
from controller.cad import OpenCadError, UnreadableCadError
from controller.cad.compiled import (
    CompiledPart,
    CompileOptions,
    cached_part,
    compile_part,
    load_part,
    make_part,
    part_name,
)
from controller.cad.compiled import cache as cache_module

RECIPE_PARTS = Path(__file__).resolve().parents[2] / "recipes" / "parts"


def drilled(folder: Path, name: str = "drilled.stl") -> Path:
    """A plate with a bore, as a file."""
    path = folder / name
    mesh_of(box(40, 30, 10) - rod(5, 20, 24)).export(path)
    return path


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
    solid = load_part(path, cache=tmp_path / "cache").solid
    mesh = solid.mesh
    assert {"boundary", "hull_mm"} <= vars(solid).keys()
    for name in ("face_normals", "area_faces"):
        assert name in mesh._cache.cache, name
    fresh = trimesh.Trimesh(np.array(mesh.vertices), np.array(mesh.faces), process=False)
    assert np.array_equal(fresh.face_normals, mesh.face_normals)
    assert np.array_equal(fresh.area_faces, mesh.area_faces)
    assert np.array_equal(fresh.convex_hull.vertices, solid.hull_mm)


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
    load_part(path, CompileOptions(max_compared=7), cache)
    mesh_of(box(40, 30, 12)).export(path)
    assert load_part(path, cache=cache).solid.volume_mm3 == pytest.approx(40 * 30 * 12)
    assert len(list(cache.iterdir())) == 3


def test_samples_of_another_spacing_are_made_once_from_the_same_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache, path = tmp_path / "cache", drilled(tmp_path)
    usual, options = load_part(path, cache=cache), CompileOptions(sample_spacing_mm=0.4)
    dense = load_part(path, options, cache)
    # of four times the number on the large faces; small ones have theirs already
    assert len(dense.samples.points_mm) > 2 * len(usual.samples.points_mm)
    assert dense.samples.areas_mm2.sum() == pytest.approx(usual.solid.mesh.area)
    assert len(list(cache.iterdir())) == 2
    (kept,) = cache.glob("samples-*")
    with monkeypatch.context() as patch:
        patch.setattr(cache_module, "counted_samples", None)  # would not answer
        for load in (load_part, cached_part):
            again = load(path, options, cache)
            assert again is not None
            assert_same(again.samples, dense.samples)
    # samples of another part, under this one's key, are not believed
    mesh_of(box(40, 30, 12)).export(tmp_path / "other.stl")
    load_part(tmp_path / "other.stl", options, cache)
    (foreign,) = set(cache.glob("samples-*")) - {kept}
    tree, arrays = unpack(foreign.read_bytes())
    kept.write_bytes(pack(tree | {"key": kept.stem}, arrays))
    assert_same(load_part(path, options, cache).samples, dense.samples)


def test_another_version_of_the_program_does_not_believe_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, cache = drilled(tmp_path), tmp_path / "cache"
    load_part(path, cache=cache)
    monkeypatch.setattr(cache_module, "FORMAT", cache_module.FORMAT + 1)
    assert cached_part(path, cache=cache) is None
    # nor under the new name, as a copy by hand would have it
    (old,) = cache.iterdir()
    load_part(path, cache=cache)
    (new,) = set(cache.iterdir()) - {old}
    new.write_bytes(old.read_bytes())
    assert cached_part(path, cache=cache) is None


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


def test_the_oldest_files_go_when_they_are_too_large_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = tmp_path / "cache"
    path = drilled(tmp_path)
    for i, count in enumerate((8, 9, 10, 11)):
        load_part(path, CompileOptions(max_compared=count), cache)
        for file in cache.iterdir():
            if file.stat().st_mtime > 1000:
                os.utime(file, (i, i))
        if i == 0:  # room for three and a half: they differ by their samples alone
            (first,) = cache.iterdir()
            monkeypatch.setattr(disk, "MAX_FOLDER_BYTES", 3.5 * first.stat().st_size)
    assert len(list(cache.iterdir())) == 3
    assert cached_part(path, CompileOptions(max_compared=8), cache) is None
    assert cached_part(path, CompileOptions(max_compared=11), cache) is not None


def _load_often(path: Path, cache: Path, count: int, out: Any) -> None:
    out.put([load_part(path, cache=cache).solid.volume_mm3 for _ in range(count)])


def test_many_at_once_get_the_same_part(tmp_path: Path) -> None:
    path, cache = drilled(tmp_path), tmp_path / "cache"
    with ThreadPoolExecutor(4) as pool:
        parts = list(pool.map(lambda _: load_part(path, cache=cache), range(12)))
    for part in parts[1:]:
        assert_same(part, parts[0])
    assert [file.suffix for file in cache.iterdir()] == [".npz"]


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
    assert [file.suffix for file in (tmp_path / "cache").iterdir()] == [".npz"]


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
