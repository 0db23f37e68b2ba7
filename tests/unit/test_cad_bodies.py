"""STEP files of several bodies: listed, named, taken one by one, and what is missing of them."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import pi
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from step_assemblies import HANDLE, write_assemblies
from step_files import needs_kernel, write_all

from controller.arrays import FloatArray
from controller.cad import (
    CadError,
    ManySolidsCadError,
    OpenCadError,
    UnreadableCadError,
    load_solid,
)
from controller.cad.compiled import CompileOptions, cache_key, part_name
from controller.cad.reading import files_of
from controller.cad.reading.step import bodies as reading
from controller.cad.reading.step import files
from controller.cad.reading.step.bodies import Bodies
from controller.cad.reading.step.congruent import Marks, placing
from controller.cad.reading.step.files import list_bodies, read_step_part
from controller.cad.reading.step.kernel import KernelLimits, KernelRun
from controller.cad.reading.step.references import collect, decoded, referred
from controller.cell.batch import RunOrder, input_files
from controller.cell.journal import rows
from controller.cell.recovery import Interrupted
from controller.cli import main
from controller.cli.running.accepting import recipe_of
from controller.config import ConfigError, Recipe, load_recipe, split_cad
from controller.config.cad_files import body_name, body_path, cad_identity

Answer = Mapping[str, NDArray[np.generic]]

PIN_MM3 = pi * 9 * 20


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_assemblies(tmp_path_factory.mktemp("assemblies"))


@pytest.fixture(scope="module")
def rack(made: Path) -> Bodies:
    return list_bodies(made / "rack.step")


@pytest.fixture(scope="module", autouse=True)
def _kernel_once() -> Iterator[None]:
    """Have the STEP kernel answer once what several tests ask of the same file or body.

    Its start is most of the time; what it is started on, and what is made of its answer, stays as
    it is.
    """
    answers: dict[tuple[str, bytes, tuple[str, ...]], Answer] = {}

    @contextmanager
    def run(
        program: str,
        source: Path,
        out: Path,
        arguments: Sequence[str] = (),
        limits: KernelLimits | None = None,
    ) -> Iterator[SimpleNamespace]:
        key = (program, source.read_bytes(), tuple(arguments))
        if key not in answers:
            with KernelRun(program, source, out, arguments, limits) as real:
                answers[key] = real.result("the file")
        yield SimpleNamespace(result=lambda where: {k: a.copy() for k, a in answers[key].items()})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "KernelRun", run)
        yield


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


# -- names ----------------------------------------------------------------------------------------


def test_a_name_is_split_behind_the_cad_file(tmp_path: Path) -> None:
    for text, file, body in (
        ("a/rack.step#pin", "a/rack.step", "pin"),
        ("a/rack.STP#pin v2.stl", "a/rack.STP", "pin v2.stl"),
        ("a/rack.step#left/right", "a/rack.step", "left_right"),
        ("a/rack.step#", "a/rack.step", ""),
        ("a/rack.step", "a/rack.step", None),
        ("a/no#cad", "a/no#cad", None),
    ):
        found = split_cad(Path(text))
        assert (str(found.file), found.body) == (file, body)


def test_a_file_with_the_sign_in_its_name_is_that_file(tmp_path: Path) -> None:
    (tmp_path / "a.step#b.stl").touch()
    (tmp_path / "n#1.step#c.step").touch()
    assert split_cad(tmp_path / "a.step#b.stl").body is None
    found = split_cad(tmp_path / "n#1.step#c.step#pin")
    assert (found.file, found.body) == (tmp_path / "n#1.step#c.step", "pin")


@given(st.text(max_size=40))
def test_a_name_behind_the_sign_is_found_again(text: str) -> None:
    name = body_name(text)
    assert body_name(name) == name
    path = body_path(Path("parts/rack.step"), name)
    assert split_cad(path).body == name
    assert path.parent == Path("parts")
    assert part_name(path) == (name or "rack")


def test_composed_and_combining_letters_are_one_name() -> None:
    assert body_name("Griff u\u0308") == body_name("Griff \u00fc") == "Griff \u00fc"


def test_two_bodies_of_a_file_are_two_products() -> None:
    one, other = (cad_identity(f"rack.step#{name}", "ab12") for name in ("pin", "plate"))
    assert one != other
    assert cad_identity("rack.step", "ab12") == "ab12"
    assert cad_identity("rack.step#pin", "") == ""


# -- one shape ------------------------------------------------------------------------------------


def _marks(points: FloatArray) -> Marks:
    sizes = np.column_stack([np.full(len(points), 2.0), np.zeros(len(points))])
    return Marks(1.0, 1.0, points.mean(axis=0), np.ones(3), points, sizes)


def _turn(rng: np.random.Generator) -> FloatArray:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.asarray(q * np.linalg.det(q))


@given(st.integers(0, 10_000))
def test_a_body_moved_is_the_same_and_its_mirror_image_is_not(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-40, 40, (8, 3))
    R, t = _turn(rng), rng.uniform(-500, 500, 3)
    moved = (points @ R.T + t)[rng.permutation(8)]
    T = placing(_marks(points), _marks(moved))
    assert T is not None
    assert np.allclose(T[:3, :3], R, atol=1e-6)
    assert np.allclose(T[:3, 3], t, atol=1e-4)
    assert placing(_marks(points), _marks(moved * [1, 1, -1])) is None


def test_a_body_with_one_corner_elsewhere_is_another() -> None:
    points = np.random.default_rng(1).uniform(-40, 40, (8, 3))
    other = points.copy()
    other[3, 0] += 0.05
    assert placing(_marks(points), _marks(other)) is None


def test_a_body_of_another_volume_is_another() -> None:
    one = _marks(np.random.default_rng(1).uniform(-40, 40, (8, 3)))
    assert placing(one, replace(one, volume_mm3=1.001)) is None


def test_points_on_a_line_have_a_turn() -> None:
    line = np.array([[0, 0, -5], [0, 0, 1], [0, 0, 5.0]])
    T = placing(_marks(line), _marks(line[:, [2, 0, 1]] + 7))
    assert T is not None
    assert np.allclose(T[:3, :3] @ [0, 0, 1], [1, 0, 0])


# -- what is in a file ----------------------------------------------------------------------------


@needs_kernel
def test_each_shape_is_listed_once_with_its_places(rack: Bodies) -> None:
    found = {body.name: body for body in rack.distinct}
    assert set(found) == {"pin", "pin~2", "plate", "left", "right", body_name(HANDLE)}
    assert len(found["pin"].occurrences) == 5
    assert found["pin"].also == ("dowel",)
    assert sorted(place.within for place in found["pin"].occurrences) == [
        ("rack",),
        *[("rack", "pair")] * 4,
    ]
    assert rack.count == 10
    assert rack.open_names == ("skin",)
    assert np.allclose(found["pin~2"].size_mm, [6, 6, 30], atol=1e-6)
    assert found["pin"].volume_mm3 == pytest.approx(PIN_MM3)
    (place,) = found["plate"].occurrences
    assert np.allclose(place.T_file_body[:3, 3], [100, 0, 0])


@needs_kernel
def test_a_place_takes_the_body_to_where_it_is(rack: Bodies) -> None:
    (pin,) = (body for body in rack.distinct if body.name == "pin")
    ends = np.array([[0, 0, 0, 1], [0, 0, 20, 1.0]])
    lying = [p for p in pin.occurrences if p.within == ("rack",)]
    found = np.sort((ends @ lying[0].T_file_body.T)[:, :3], axis=0)
    assert np.allclose(found, [[0, 0, 0], [20, 0, 0]], atol=1e-6)
    corners = {tuple(np.round(p.T_file_body[:3, 3], 6)) for p in pin.occurrences}
    assert {(0, y, z) for y in (0, 15) for z in (0, 50)} <= corners


@needs_kernel
def test_bodies_without_names_are_grouped_by_shape(made: Path) -> None:
    bodies = list_bodies(made / "blocks.step")
    assert sorted(len(body.occurrences) for body in bodies.distinct) == [1, 2]
    (box,) = (body for body in bodies.distinct if len(body.occurrences) == 1)
    assert np.allclose(box.size_mm, [10, 10, 12], atol=1e-6)
    assert len({body.name for body in (*bodies.distinct, *bodies.others)}) == 3


@needs_kernel
def test_a_file_of_several_says_what_to_write(made: Path) -> None:
    path = made / "rack.step"
    with pytest.raises(ManySolidsCadError) as caught:
        load_solid(path)
    text = str(caught.value)
    assert "10 bodies of 6 shapes" in text
    for name in ("pin", "pin~2", "plate", "left", "right", body_name(HANDLE)):
        assert f"{path}#{name} " in text
    assert "5 times" in text
    assert "60.0 x 40.0 x 10.0 mm" in text


@needs_kernel
def test_the_kernel_reads_an_assembly_once_for_all_its_bodies(
    made: Path, rack: Bodies, monkeypatch: pytest.MonkeyPatch
) -> None:
    list_bodies(made / "rack.step")

    def listed(*_: object, **__: object) -> Bodies:
        raise AssertionError("read again")

    monkeypatch.setattr(reading, "_listed", listed)
    assert list_bodies(made / "rack.step").count == rack.count


# -- one body -------------------------------------------------------------------------------------


@needs_kernel
def test_a_body_is_read_in_its_own_coordinates(made: Path) -> None:
    solid = load_solid(made / "rack.step#plate")
    assert solid.name == "plate"
    assert solid.volume_mm3 == pytest.approx(60 * 40 * 10)
    assert np.allclose(solid.mesh.bounds, [[0, 0, 0], [60, 40, 10]], atol=1e-6)
    dowel = load_solid(made / "rack.step#dowel")
    assert np.allclose(dowel.mesh.extents, [20, 6, 6], atol=0.05)


@needs_kernel
@pytest.mark.parametrize("spelling", [HANDLE, "Griff u\u0308 1/2", body_name(HANDLE)])
def test_a_name_with_blanks_letters_and_a_slash_is_found(made: Path, spelling: str) -> None:
    solid = load_solid(Path(f"{made}/rack.step#{spelling}"))
    assert solid.volume_mm3 == pytest.approx(10 * 20 * 35)
    assert "/" not in solid.name


@needs_kernel
def test_mirror_images_differ_in_what_is_read(made: Path) -> None:
    left, right = (load_solid(made / f"rack.step#{name}") for name in ("left", "right"))
    assert left.volume_mm3 == pytest.approx(right.volume_mm3)
    assert left.centroid_mm[1] == pytest.approx(10 - right.centroid_mm[1])
    assert left.content_hash != right.content_hash


@pytest.mark.slow
@needs_kernel
def test_the_unit_of_the_file_is_the_bodys(tmp_path: Path) -> None:
    inches = write_all(tmp_path)["plate in inches"]
    (body,) = list_bodies(inches).distinct
    solid = load_solid(body_path(inches, body.name))
    assert solid.unit == "inch"
    assert np.allclose(sorted(solid.mesh.extents), [10, 40, 60], atol=1e-3)
    with pytest.raises(CadError, match="in inch by its own statement"):
        load_solid(body_path(inches, body.name), unit="mm")


@needs_kernel
def test_a_wrong_name_is_answered_with_the_right_ones(made: Path) -> None:
    path = made / "rack.step"
    for name, error, expected in (
        ("Plate", UnreadableCadError, f"did you mean {path}#plate"),
        ("nothing like it", UnreadableCadError, f"{path}#plate "),
        ("", UnreadableCadError, "no body is named"),
        ("pair", ManySolidsCadError, "is an assembly of the bodies pin;"),
        ("skin", OpenCadError, "enclose no solid"),
    ):
        with pytest.raises(error) as caught:
            load_solid(Path(f"{path}#{name}"))
        assert expected in str(caught.value)


def test_only_step_has_bodies_with_names(tmp_path: Path) -> None:
    (tmp_path / "a.stl").touch()
    with pytest.raises(UnreadableCadError, match=r"leave out #pin"):
        load_solid(tmp_path / "a.stl#pin")


def test_each_body_is_kept_by_itself(tmp_path: Path) -> None:
    file = tmp_path / "a.step"
    file.write_text("ISO-10303-21;")
    options = CompileOptions()
    keys = {cache_key(Path(f"{file}{body}"), options) for body in ("", "#", "#pin", "#plate")}
    assert len(keys) == 4
    assert None not in keys


# -- other files ----------------------------------------------------------------------------------


def _naming(*names: str) -> bytes:
    records = "".join(f"#{i}=DOCUMENT_FILE('{n}','','',#9,'',$);\n" for i, n in enumerate(names))
    return f"ISO-10303-21;\n{records}END-ISO-10303-21;".encode()


def test_the_files_that_a_file_names_are_found_with_those_they_name(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "b.stp").write_bytes(_naming("c.stp", "gone.stp", "drawing.pdf"))
    (tmp_path / "sub" / "c.stp").write_bytes(_naming("b.stp"))
    main_file = tmp_path / "a.stp"
    main_file.write_bytes(_naming("sub/b.stp", "sub\\b.stp"))
    found = collect(main_file, main_file.read_bytes())
    assert list(found.found) == ["a.stp", "sub/b.stp", "sub/c.stp"]
    assert found.missing == ("sub/gone.stp",)
    assert files_of(main_file) == tuple(tmp_path / name for name in found.found)


@pytest.mark.parametrize("name", ["../secret.stp", "/etc/secret.stp", "C:\\x\\secret.stp"])
def test_no_file_outside_the_folder_is_read(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.stp").write_bytes(_naming())
    (tmp_path / "in").mkdir()
    path = tmp_path / "in" / "a.stp"
    path.write_bytes(_naming(name.replace("\\", "\\\\")))
    assert list(collect(path, path.read_bytes()).found) == ["a.stp"]
    (tmp_path / "in" / "link.stp").symlink_to(tmp_path / "secret.stp")
    linked = collect(path, _naming("link.stp"))
    assert linked.missing == ("link.stp",)


def test_names_of_files_are_decoded() -> None:
    assert decoded(rb"Geh\X2\00E4\X0\use ''1''.stp") == "Geh\u00e4use '1'.stp"
    assert decoded(rb"Geh\X\E4use.stp") == "Geh\u00e4use.stp"
    assert referred(_naming(r"K\X2\00F6\X0\rper.stp")) == ["K\u00f6rper.stp"]


def test_a_part_is_another_once_a_file_that_it_names_changes(tmp_path: Path) -> None:
    path, other = tmp_path / "a.stp", tmp_path / "b.stp"
    path.write_bytes(_naming("b.stp"))
    keys = [cache_key(path, CompileOptions())]
    for content in (_naming(), _naming() + b" "):
        other.write_bytes(content)
        keys.append(cache_key(path, CompileOptions()))
    assert len(set(keys)) == 3


@needs_kernel
def test_bodies_in_other_files_are_read(made: Path) -> None:
    split = made / "split" / "rack.step"
    bodies = list_bodies(split)
    assert {body.name for body in bodies.distinct} >= {"pin", "plate", "left", "right"}
    assert load_solid(body_path(split, "plate")).volume_mm3 == pytest.approx(24_000)


@needs_kernel
def test_a_missing_file_is_named_with_its_folder(made: Path, tmp_path: Path) -> None:
    shutil.copytree(made / "split", tmp_path / "split")
    gone = next((tmp_path / "split").glob("*plate*"))
    gone.unlink()
    with pytest.raises(ManySolidsCadError) as caught:
        load_solid(tmp_path / "split" / "rack.step")
    assert gone.name in str(caught.value)
    assert str(tmp_path / "split") in str(caught.value)
    for other in (tmp_path / "split").glob("part-*"):
        other.unlink()
    with pytest.raises(UnreadableCadError, match=r"holds no shape of its own; it names files"):
        load_solid(tmp_path / "split" / "rack.step")


# -- recipes and commands -------------------------------------------------------------------------


@needs_kernel
def test_a_recipe_names_a_body(made: Path, tmp_path: Path) -> None:
    shutil.copy(made / "rack.step", tmp_path / "rack.step")
    recipe = tmp_path / "recipe.yaml"
    recipe.write_text("name: plates\npart: rack.step#plate\nothers: [rack.step#left]\n")
    found = load_recipe(recipe)
    assert load_solid(found.part).name == "plate"
    recipe.write_text("name: plates\npart: rock.step#plate\n")
    with pytest.raises(ConfigError, match=r"no file .*rock\.step; the folder has rack\.step"):
        load_recipe(recipe)


def test_a_run_is_started_with_all_files_of_its_part(tmp_path: Path) -> None:
    for name, content in (("rack.stp", _naming("pin.stp")), ("pin.stp", _naming())):
        (tmp_path / name).write_bytes(content)
    recipe = Recipe(name="pins", part=tmp_path / "rack.stp#pin", others=(tmp_path / "rack.stp",))
    order = SimpleNamespace(
        recipe_path=tmp_path / "recipe.yaml",
        cell_path=tmp_path / "cell.yaml",
        ordered=(SimpleNamespace(recipe=recipe),),
        beside=(),
        cell=SimpleNamespace(calibration={}),
    )
    names = [path.name for path in input_files(cast("RunOrder", order))]
    assert names == ["recipe.yaml", "cell.yaml", "rack.stp", "pin.stp"]


def test_a_changed_part_is_taken_from_the_runs_own_copies(tmp_path: Path) -> None:
    """The run's folder has the files as they were; each is put where the recipe has it."""
    there, kept = tmp_path / "there", tmp_path / "run" / "inputs"
    (there / "cad").mkdir(parents=True)
    kept.mkdir(parents=True)
    contents = {
        "recipe.yaml": b"name: pins\npart: cad/rack.stp#pin\n",
        "cad/rack.stp": _naming("pin.stp"),
        "cad/pin.stp": _naming(),
    }
    for name, content in contents.items():
        (there / name).write_bytes(content)
        (kept / Path(name).name).write_bytes(content)
    hashes = {str(there / n): hashlib.sha256(c).hexdigest() for n, c in contents.items()}
    recipe = {"part": str(there / "cad/rack.stp#pin")}
    left = Interrupted("run", 1, rows.RunBegan(files=hashes, recipe=recipe))
    assert recipe_of(left, tmp_path / "run") == there / "recipe.yaml"
    (there / "cad" / "pin.stp").write_bytes(b"another")
    again = recipe_of(left, tmp_path / "run")
    for name, content in contents.items():
        assert (again.parent / name).read_bytes() == content


def test_a_name_of_a_body_leads_to_no_other_folder(tmp_path: Path) -> None:
    (tmp_path / "secret.stl").touch()
    (tmp_path / "in" / "a.step#").mkdir(parents=True)
    recipe = tmp_path / "in" / "recipe.yaml"
    recipe.write_text("name: x\npart: a.step#/../../secret.stl\n")
    with pytest.raises(ConfigError, match="outside the recipe's folder"):
        load_recipe(recipe)


@needs_kernel
def test_all_bodies_are_compiled_one_object_each(
    made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compile", "--all", str(made / "blocks.step"), "--json"]) == 0
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(len(body["occurrences"]) for body in found) == [1, 2]
    assert all(body["stable_poses"] and body["body"] == body["part"] for body in found)
    assert {body["file"] for body in found} == {str(made / "blocks.step")}


@needs_kernel
def test_a_refused_body_leaves_the_others(
    made: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    real = read_step_part

    def read(path: Path, limits: object = None, body: str | None = None) -> object:
        if body == "left":
            raise OpenCadError(f"{path}#{body}: a surface is missing")
        return real(path, None, body)

    monkeypatch.setattr("controller.cad.reading.step.files.read_step_part", read)
    assert main(["compile", "--all", str(made / "rack.step")]) == 2
    out, err = capsys.readouterr()
    lines = {line.split("  ")[0]: line for line in out.splitlines()}
    assert lines["left"].endswith("refused")
    assert "stable poses" in lines["plate"]
    assert "5 of 6 compiled" in out
    assert "rack.step#left: a surface is missing" in err
    assert "skin is left out: its surfaces enclose no solid" in err


@needs_kernel
def test_all_wants_a_file(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compile", "--all", f"{made}/rack.step#pin"]) == 2
    assert "leave out #pin" in capsys.readouterr().err
