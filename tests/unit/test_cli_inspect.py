"""`cellctl inspect`: stored pictures of a part are judged; wrong files end with exit code 2."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import view_sets
from shown_part import perfect

from controller.cli import main
from messages.form import from_said


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the set of a perfect part; tests copy it."""
    folder = tmp_path_factory.mktemp("stored") / "perfect"
    view_sets.write(folder)
    return folder


@pytest.fixture
def folder(stored: Path, tmp_path: Path) -> Path:
    shutil.copytree(stored, tmp_path / "set")
    return tmp_path / "set"


def lines_of(text: str) -> list[dict[str, Any]]:
    return [from_said(json.loads(line)) for line in text.splitlines()]


@pytest.fixture(scope="module")
def answer(stored: Path) -> tuple[int, list[dict[str, Any]]]:
    """The exit code and lines for the set as it is."""
    with redirect_stdout(io.StringIO()) as out:
        code = main(["inspect", str(stored / "SET.json"), "--json"])
    return code, lines_of(out.getvalue())


def test_the_last_line_is_the_verdict(answer: tuple[int, list[dict[str, Any]]]) -> None:
    code, lines = answer
    assert [line["event"] for line in lines].count("verdict") == 1
    end = lines[-1]
    assert set(end) == {
        "event", "verdict", "covered_fraction", "reasons", "unproven", "found", "seconds",
    }  # fmt: skip
    # three views from one side cannot have shown the back
    assert end["verdict"] == "indeterminate"
    assert code == 1
    assert 0 < end["covered_fraction"] < 0.9


def test_every_face_is_accounted_for(answer: tuple[int, list[dict[str, Any]]]) -> None:
    _, lines = answer
    faces = [line for line in lines if line["event"] == "face"]
    assert [face["face"] for face in faces] == list(range(len(faces)))
    area_mm2 = sum(face["area_mm2"] for face in faces)
    # of the block, as the tool that cut it has it
    assert area_mm2 == pytest.approx(float(perfect().surface_area()), rel=0.01)
    for face in faces:
        assert face["compared_fraction"] + sum(face["rest"].values()) == pytest.approx(1.0)
        assert face["reason"] or face["verdict"] == "pass"
    compared = sum(face["area_mm2"] * face["compared_fraction"] for face in faces) / area_mm2
    assert compared == pytest.approx(lines[-1]["covered_fraction"], abs=0.02)


def test_a_missing_bore_is_a_finding_where_it_should_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = view_sets.write(tmp_path / "set", real="blank")
    assert main(["inspect", str(path), "--json"]) == 1
    lines = lines_of(capsys.readouterr().out)
    assert lines[-1]["verdict"] == "fail"
    found = [line for line in lines if line["event"] == "finding" and line["verdict"] == "fail"]
    mouth = np.array([-11.0, 3.0, 12.0])  # of the bore that light falls through, CAD frame
    assert min(np.linalg.norm(np.array(line["p_part_mm"]) - mouth) for line in found) < 5.0
    # as extra material before the panel, and as a mouth that is not there
    assert {line["kind"] for line in found} <= {"extra", "missing_edge"}


def test_pictures_of_a_lamp_that_was_off_are_not_evaluated(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in folder.glob("*_side.png"):
        cv2.imwrite(str(path), np.zeros((512, 640), np.uint8))
    assert main(["inspect", str(folder / "SET.json"), "--json"]) == 1
    lines = lines_of(capsys.readouterr().out)
    assert lines[-1]["verdict"] == "indeterminate"
    assert not any("side" in face["by_check"] for face in lines if face["event"] == "face")


def test_a_person_gets_words(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(folder / "SET.json")]) == 1
    out = capsys.readouterr().out
    assert "shown: INDETERMINATE" in out
    assert not out.startswith("{")


def test_a_set_without_views_is_open_not_wrong(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = view_sets.tree() | {"views": []}
    (folder / "SET.json").write_text(json.dumps(tree), encoding="utf-8")
    assert main(["inspect", str(folder / "SET.json"), "--json"]) == 1
    end = lines_of(capsys.readouterr().out)[-1]
    assert end["verdict"] == "indeterminate"
    assert end["covered_fraction"] == 0


def cut_off(folder: Path) -> None:
    path = folder / "v01_ring.png"
    path.write_bytes(path.read_bytes()[:2000])


def colour(folder: Path) -> None:
    picture = np.zeros((512, 640, 3), np.uint8)
    picture[..., 2] = 200
    cv2.imwrite(str(folder / "v01_ring.png"), picture)


WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "a picture missing": (lambda f: (f / "v01_ring.png").unlink(), "views.1.pictures.ring"),
    "a picture cut off": (cut_off, "cut off or damaged"),
    "a picture empty": (lambda f: (f / "v01_ring.png").write_bytes(b""), "the file is empty"),
    "a picture of another size": (
        lambda f: cv2.imwrite(str(f / "v01_ring.png"), np.zeros((100, 120), np.uint8)),
        "120 x 100 px, the calibration is for 640 x 512 px",
    ),
    "a picture in colour": (colour, "grey of 8 bits is expected"),
    "a picture of 16 bits": (
        lambda f: cv2.imwrite(str(f / "v01_ring.png"), np.zeros((512, 640), np.uint16)),
        "16 bits a pixel",
    ),
    "a picture is text": (lambda f: (f / "v01_ring.png").write_text("no picture"), "readable"),
    "the part missing": (lambda f: (f / "shown.stl").unlink(), "`part`: no file"),
    "the part is text": (lambda f: (f / "shown.stl").write_text("no part"), "shown.stl"),
    "the set is empty": (lambda f: (f / "SET.json").write_bytes(b""), "SET.json: is empty"),
    "the set missing": (lambda f: (f / "SET.json").unlink(), "SET.json: No such file"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_file_is_named(folder: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    spoil, words = WRONG[name]
    spoil(folder)
    assert main(["inspect", str(folder / "SET.json"), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert words in printed.err
    assert "Traceback" not in printed.err
    assert "bug" not in printed.err


def test_three_equal_channels_are_grey(
    answer: tuple[int, list[dict[str, Any]]], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, before = answer
    for path in folder.glob("*.png"):
        cv2.imwrite(str(path), cv2.cvtColor(cv2.imread(str(path), -1), cv2.COLOR_GRAY2BGR))
    main(["inspect", str(folder / "SET.json"), "--json"])
    after = lines_of(capsys.readouterr().out)
    assert after[:-1] == before[:-1]
    assert after[-1] | {"seconds": 0} == before[-1] | {"seconds": 0}


def test_the_recipe_sets_how_much_must_be_compared(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = folder / "shown.yaml"
    recipe.write_text("name: shown\npart: shown.stl\ninspection: {min_coverage: 0.99}\n")
    assert main(["inspect", str(folder / "SET.json"), "--recipe", str(recipe), "--json"]) == 1
    end = lines_of(capsys.readouterr().out)[-1]
    assert any("99.0 % is required" in reason for reason in end["reasons"])


def test_a_recipe_for_another_part_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(folder / "SET.json"), "--recipe", "holder"]) == 2
    assert "the recipe is for holder, the set shows shown" in capsys.readouterr().err


def test_a_recipe_that_names_what_the_part_lacks_is_refused_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = folder / "shown.yaml"
    recipe.write_text(
        "name: shown\npart: shown.stl\ninspection:\n  characteristics:\n"
        "    - {id: hole 99 mm diameter, plus: 0.1, minus: 0.1}\n"
    )
    assert main(["inspect", str(folder / "SET.json"), "--recipe", str(recipe), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert f"{recipe}:5: `inspection.characteristics`" in printed.err
    assert "no characteristic 'hole 99 mm diameter' on the part; nearest:" in printed.err


def test_a_tolerance_below_what_the_camera_can_do_is_never_a_pass(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipe = folder / "shown.yaml"
    recipe.write_text(
        "name: shown\npart: shown.stl\ninspection:\n  min_coverage: 0.01\n  characteristics:\n"
        "    - {id: hole 10 mm diameter, plus: 0.001, minus: 0.001}\n"
    )
    main(["inspect", str(folder / "SET.json"), "--recipe", str(recipe), "--json"])
    lines = lines_of(capsys.readouterr().out)
    bore = next(line for line in lines if line.get("id") == "hole 10 mm diameter")
    assert bore["verdict"] != "pass"
    assert lines[-1]["verdict"] != "pass"
    assert any("hole 10 mm" in reason for reason in lines[-1]["reasons"])


@pytest.mark.parametrize("form", ["html", "json"])
def test_the_report_has_the_verdict(
    folder: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    report = folder / "out" / f"part.{form}"
    main(["inspect", str(folder / "SET.json"), "--json", "--report", str(report)])
    end = lines_of(capsys.readouterr().out)[-1]
    assert end["verdict"] in report.read_text().lower()
    assert [path.name for path in report.parent.iterdir()] == [report.name]


def test_a_report_of_an_unknown_form_is_refused_before_any_work(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect", str(folder / "SET.json"), "--report", "part.docx"]) == 2
    printed = capsys.readouterr()
    assert ".html" in printed.err
    assert printed.out == ""


def test_a_full_disk_loses_no_verdict_and_no_earlier_report(folder: Path) -> None:
    report = folder / "out" / "part.html"
    report.parent.mkdir()
    report.write_text("the report of before", encoding="utf-8")
    one = view_sets.tree()
    (folder / "SET.json").write_text(json.dumps(one | {"views": one["views"][:1]}))
    # the file may not grow beyond what a full disk would take; checks before work need 4 KiB
    limited = (
        "import resource, sys; from controller.cli import main; "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192)); sys.exit(main(sys.argv[1:]))"
    )
    words = ["inspect", str(folder / "SET.json"), "--json", "--report", str(report)]
    done = subprocess.run(
        # -B: Python would keep a module that it compiled as far as the file could grow
        [sys.executable, "-B", "-c", limited, *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert lines_of(done.stdout)[-1]["verdict"] == "indeterminate"
    assert f"{report}: File too large" in done.stderr
    assert "Traceback" not in done.stderr
    assert report.read_text(encoding="utf-8") == "the report of before"
    assert [path.name for path in report.parent.iterdir()] == ["part.html"]


def test_a_part_expected_behind_the_camera_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = view_sets.tree()
    tree["views"][1]["T_world_part"][1][3] = -900.0  # the camera stands at y = -700
    (folder / "SET.json").write_text(json.dumps(tree), encoding="utf-8")
    assert main(["inspect", str(folder / "SET.json"), "--json"]) == 2
    assert "SET.json: `views.1.T_world_part`: the part would reach" in capsys.readouterr().err


ODD: list[Any] = [
    None, True, 0, -1, 1e308, "", "x", "\x00", "/dev/null", "..", [], {}, [None], [[0] * 4] * 4,
    10**400, "v00", [1, 0, 0],
]  # fmt: skip


def places(tree: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    below = tree.items() if isinstance(tree, dict) else enumerate(tree)
    found = []
    for key, value in below:
        found.append((*at, key))
        if isinstance(value, dict | list):
            found += places(value, (*at, key))
    return found


@pytest.mark.parametrize("seed", range(25))
def test_no_change_of_a_set_ends_in_a_bug(
    folder: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(seed)
    tree = view_sets.tree()
    tree["views"] = tree["views"][:1]
    every = places(tree)
    *way, key = every[rng.integers(len(every))]
    section: Any = tree
    for step in way:
        section = section[step]
    if isinstance(section[key], int | float) and rng.random() < 0.5:
        section[key] *= float(rng.choice([-1, 0, 1e-6, 1e3, 1e9]))
    else:
        section[key] = ODD[rng.integers(len(ODD))]
    (folder / "SET.json").write_text(json.dumps(tree), encoding="utf-8")
    code = main(["inspect", str(folder / "SET.json"), "--json"])
    printed = capsys.readouterr()
    assert code in (1, 2)
    assert "bug" not in printed.err
    assert (printed.out == "") == (code == 2)
    assert code == 1 or "SET.json" in printed.err
