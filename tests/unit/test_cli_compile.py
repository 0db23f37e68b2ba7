"""`cellctl compile` and what the other commands take from it."""

from __future__ import annotations

import html.parser
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from cad_solids import box, mesh_of, rod

from controller.cad import compiled as compiling
from controller.cad import load_solid, solid
from controller.cad.compiled import CompiledPart, CompileOptions, compile_part, load_part
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance
from controller.cad.views import Loop, Stroke
from controller.cli import main
from controller.cli.parts.part_json import part_json
from controller.config import ConfigError, load_recipe
from controller.imaging import RayCaster
from controller.results import line_drawing as _drawings
from controller.results.sheet import picture as _picture
from controller.results.sheet.sheet import render_sheet
from controller.results.sheet.tables import tolerance_rows

ROOT = Path(__file__).parents[2]
HOLDER = ROOT / "recipes/parts/holder.stl"
CELL = ROOT / "recipes/cells/emulated.yaml"


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(autouse=True)
def _small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_picture, "SIZE_PX", (120, 90))


@pytest.fixture
def plate(tmp_path: Path) -> Path:
    """A block of 40 x 30 x 10 mm with a bore of 10 mm through it."""
    path = tmp_path / "plate.stl"
    mesh_of(box(40, 30, 10) - rod(5, 20, 64)).export(path)
    return path


def answers(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_a_drilled_block_is_told_as_on_paper(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compile", str(plate), "--json", "--density", "7.8"]) == 0
    (body,) = answers(capsys)
    bore_mm2 = 0.5 * 64 * 25 * np.sin(2 * np.pi / 64)  # as tessellated
    volume_mm3 = 10 * (40 * 30 - bore_mm2)
    assert body["part"] == "plate"
    assert body["size_mm"] == pytest.approx([40, 30, 10])
    assert body["volume_mm3"] == pytest.approx(volume_mm3)
    assert body["mass_g"] == pytest.approx(7.8e-3 * volume_mm3)
    assert (body["unit"], body["unit_declared"]) == ("mm", False)
    # 8 corners and one on each rim of the bore; 12 sides and 2 rims; 6 planes and the bore
    assert (body["vertices"], body["edges"], len(body["faces"])) == (10, 14, 7)
    # a loop round each plane, a hole in two, two rims of the bore
    assert (body["loops"], body["genus"], body["shells"], body["euler_defect"]) == (10, 1, 1, 0)
    poses = body["stable_poses"]
    assert len(poses) == 6
    assert sum(p["probability"] for p in poses) == pytest.approx(1.0)
    assert sum(p["drop_probability"] for p in poses) == pytest.approx(1.0)
    for p in poses:
        R = np.array(p["R"])
        assert np.allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-12)
        assert np.linalg.det(R) == pytest.approx(1.0)
        assert R[2].tolist() == p["up"]
        assert p["rolling"] is False
    flat = [p for p in poses if abs(p["up"][2]) > 0.99]
    assert [p["index"] for p in flat] == [0, 1]
    for p in flat:
        assert p["com_height_mm"] == pytest.approx(5.0)
        # over the long side: from 5 mm to the half diagonal of 30 x 10
        assert p["tip_energy_mj_per_kg"] == pytest.approx(9.81 * (np.hypot(15, 5) - 5), rel=1e-3)
        assert p["view"]["area_mm2"] == pytest.approx(40 * 30 - np.pi * 25, rel=1e-3)
        assert p["view"]["perimeter_mm"] == pytest.approx(140 + 10 * np.pi, rel=1e-3)
        assert (p["view"]["loops"], p["view"]["holes"]) == (2, 1)


def test_the_second_answer_comes_from_the_cache_and_is_the_same(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        assert main(["compile", str(plate), "--json"]) == 0
    first, second = answers(capsys)
    assert (first.pop("from_cache"), second.pop("from_cache")) == (False, True)
    first.pop("seconds"), second.pop("seconds")
    assert first == second


def test_without_a_cache_nothing_is_read_or_written(
    plate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        assert main(["compile", str(plate), "--json", "--no-cache"]) == 0
    assert [body["from_cache"] for body in answers(capsys)] == [False, False]
    assert not (tmp_path / "cache").exists()


def test_people_get_a_table_and_are_told_that_the_unit_is_a_guess(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compile", str(plate)]) == 0
    told = capsys.readouterr()
    assert "40.0 x 30.0 x 10.0 mm" in told.out
    assert "14 edges" in told.out
    assert "0 0 -1" in told.out
    assert "names no unit" in told.err
    assert main(["compile", str(plate), "--unit", "mm"]) == 0
    assert "unit" not in capsys.readouterr().err


def test_the_widget_stands_as_in_table_1_of_the_paper(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["compile", str(ROOT / "recipes/parts/paper_widget.csg.yaml"), "--json"]) == 0
    (body,) = answers(capsys)
    assert body["part"] == "paper_widget"
    assert body["unit_declared"] is True
    ranked = sorted(body["stable_poses"], key=lambda p: p["stability_rank"])
    # the paper prints four digits
    slope, bevel = np.array([0.5547, 0, 0.8321]), np.array([0.2594, 0.5718, 0.7783])
    table = [[0, 1, 0], [0, -1, 0], -slope, [1, 0, 0], [0, 0, 1], slope, [-1, 0, 0]]
    table += [bevel * [1, -1, 1], bevel]
    assert np.allclose([p["up"] for p in ranked], table, atol=1.5e-4)


def test_a_declared_unit_is_what_the_lengths_are_read_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "inches.stl"
    mesh_of(box(2, 1, 0.5)).export(path)
    assert main(["compile", str(path), "--json"]) == 2  # 2 mm is no part
    assert "--unit" in capsys.readouterr().err
    assert main(["compile", str(path), "--json", "--unit", "inch"]) == 0
    (body,) = answers(capsys)
    assert body["size_mm"] == pytest.approx([50.8, 25.4, 12.7])
    assert (body["unit"], body["unit_declared"]) == ("inch", True)
    assert body["warnings"] == []


def test_a_bad_file_among_good_ones_is_told_and_the_others_are_done(
    plate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.stl"
    broken.write_bytes(plate.read_bytes()[:-7])
    page = tmp_path / "page.html"
    asked = ["compile", str(plate), str(broken), str(HOLDER), "--json", "--report", str(page)]
    assert main(asked) == 2
    told = capsys.readouterr()
    assert [json.loads(line)["part"] for line in told.out.splitlines()] == ["plate", "holder"]
    assert "broken.stl" in told.err
    assert page.read_text().count('class="part"') == 2


def test_a_report_that_cannot_be_written_is_the_command_lines_fault(
    plate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("in the way")
    assert main(["compile", str(plate), "--report", str(tmp_path / "file" / "page.html")]) == 2
    assert "--report" in capsys.readouterr().err


class Page(html.parser.HTMLParser):
    """What a page loads, and whether its tags close."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.open: list[str] = []
        self.paths: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = dict(attrs)
        self.loads += [v for k, v in told.items() if k in {"src", "href", "xlink:href"} and v]
        if tag == "path":
            self.paths.append(told.get("d") or "")
        if tag in {"table", "tr", "svg", "figure", "article", "section", "div", "ul", "dl"}:
            self.open.append(tag)
        assert tag != "script"

    def handle_endtag(self, tag: str) -> None:
        if self.open and tag in {*self.open}:
            assert self.open.pop() == tag


def test_the_page_needs_nothing_but_itself_and_draws_every_pose(
    plate: Path, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    assert main(["compile", str(plate), "--report", str(page)]) == 0
    text = page.read_text()
    read = Page()
    read.feed(text)
    assert read.open == []
    assert all(load.startswith(("data:image/png;base64,", "#")) for load in read.loads)
    assert sum(load.startswith("data:") for load in read.loads) == 6
    assert text.count('class="posecard"') == 6
    assert "url(" not in text
    assert "@import" not in text
    for d in read.paths:
        assert re.fullmatch(r"[MLAHVhZ0-9eE .\-]*", d), d


def test_a_parts_name_is_text_and_never_markup(tmp_path: Path, plate: Path) -> None:
    path = tmp_path / "<b>&.stl"
    path.write_bytes(plate.read_bytes())
    text = render_sheet([compile_part(path)], None)
    assert "<b>&" not in text
    assert "&lt;b&gt;&amp;" in text


def test_a_bore_is_drawn_as_arcs_that_bulge_the_right_way(plate: Path) -> None:
    part = compile_part(plate)
    view = part.views[0]
    (hole,) = [loop for loop in view.loops if loop.is_hole]
    path = _drawings.loop_path(hole)
    # what the arcs enclose, from their own words: chords' polygon and the segments they cut off
    start = np.array(re.match(r"M(\S+) (\S+?)A", path).groups(), dtype=float)  # type: ignore[union-attr]
    area = 0.0
    for words in re.findall(r"A(\S+) (\S+) (\S+) ([01]) ([01]) (\S+) ([-\d.]+)", path):
        rx, ry, _, large, sweep, x, y = (float(word) for word in words)
        assert rx == pytest.approx(5.0, abs=0.01)
        assert ry == pytest.approx(5.0, abs=0.01)
        end = np.array([x, y])
        chord = float(np.linalg.norm(end - start))
        angle = 2 * np.arcsin(min(1.0, chord / 2 / rx))
        angle = 2 * np.pi - angle if large else angle
        turn = 1 if sweep else -1  # in SVG, whose y runs down
        area += 0.5 * (start[0] * end[1] - start[1] * end[0])
        area += turn * 0.5 * rx**2 * (angle - np.sin(angle))
        start = end
    # clockwise to the eye, which in SVG's own axes is a positive turn
    assert area == pytest.approx(np.pi * 25, rel=1e-2)


@pytest.mark.parametrize("sweep_rad", [np.pi / 3, -np.pi / 3, 5.0, -5.0, 2 * np.pi, -2 * np.pi])
@pytest.mark.parametrize("is_mirrored", [False, True])
def test_an_arc_is_drawn_through_the_points_it_runs_through(
    sweep_rad: float, is_mirrored: bool
) -> None:
    centre, axes = np.array([3.0, -2.0]), np.array([[4.0, 3.0], [-0.9, 1.2]])
    if is_mirrored:
        axes[1] = -axes[1]

    def at(angle: float) -> np.ndarray:
        return centre + np.cos(angle) * axes[0] + np.sin(angle) * axes[1]

    end = at(0.4 + sweep_rad)
    stroke = Stroke(at(0.4), end, centre, axes, sweep_rad, edge=0, face=-1)
    ids = np.zeros(2, dtype=np.int32)
    points = np.stack([stroke.start, end])
    loop = Loop(points, ids, ids, ids.astype(bool), is_hole=False, strokes=(stroke,))
    drawn = sampled(_drawings.loop_path(loop))
    wanted = np.stack([at(a) for a in 0.4 + sweep_rad * np.linspace(0, 1, 60)]) * [1, -1]
    for point in wanted:
        assert np.linalg.norm(drawn - point, axis=1).min() < 0.12


def sampled(path: str) -> np.ndarray:
    """Points along a path of arcs, by the formulas of the SVG standard (1.1, F.6.5)."""
    x1, y1 = (float(v) for v in re.match(r"M(\S+) (\S+?)[AZ]", path).groups())  # type: ignore[union-attr]
    points = []
    for words in re.findall(r"A(\S+) (\S+) (\S+) ([01]) ([01]) (\S+) ([-\d.]+)", path):
        rx, ry, phi, large, sweep, x2, y2 = (float(word) for word in words)
        c, s = np.cos(np.radians(phi)), np.sin(np.radians(phi))
        turn = np.array([[c, s], [-s, c]])
        a, b = turn @ np.array([(x1 - x2) / 2, (y1 - y2) / 2])
        grown = max(1.0, np.sqrt(a**2 / rx**2 + b**2 / ry**2))
        rx, ry = rx * grown, ry * grown
        under = (rx * ry) ** 2 - (rx * b) ** 2 - (ry * a) ** 2
        root = np.sqrt(max(0.0, under) / ((rx * b) ** 2 + (ry * a) ** 2))
        root = -root if large == sweep else root
        ca, cb = root * rx * b / ry, -root * ry * a / rx
        start = np.arctan2((b - cb) / ry, (a - ca) / rx)
        swept = np.arctan2((-b - cb) / ry, (-a - ca) / rx) - start
        swept %= 2 * np.pi
        swept = swept if sweep else swept - 2 * np.pi
        angles = start + swept * np.linspace(0, 1, 200)
        own = np.stack([ca + rx * np.cos(angles), cb + ry * np.sin(angles)], axis=1)
        points.append(own @ turn + [(x1 + x2) / 2, (y1 + y2) / 2])
        x1, y1 = x2, y2
    return np.vstack(points)


def test_tolerances_are_written_as_a_drawing_has_them(plate: Path) -> None:
    demands = (
        Dimension("size_diameter", 10.0, -0.05, 0.05, faces=(6,), fit="H7"),
        Dimension("location_linear_distance", 20.0, -0.2, 0.1, faces=(2,), other_faces=(3,)),
        Dimension("size_angle", np.pi / 6, None, None, faces=(1,), is_angle=True),
        GeometricTolerance("position", 0.2, True, ("A", "B"), (6,), at_maximum_material=True),
        Datum("A", (0,)),
    )
    part = replace(compile_part(plate), tolerances=demands)
    assert tolerance_rows(part) == (
        ("size diameter", "⌀ 10 mm H7 ±0.05", "", "F6"),
        ("location linear distance", "20 mm +0.1 / -0.2", "", "F2 to F3"),
        ("size angle", "30°", "", "F1"),
        ("position", "⌀ 0.2 mm, at maximum material", "A | B", "F6"),
        ("datum", "A", "", "F0"),
    )
    assert "at maximum material" in render_sheet([part], None)
    assert [t["tolerance"] for t in part_json(part, None, ())["tolerances"]] == [
        *["dimension"] * 3,
        "geometric",
        "datum",
    ]


def test_every_view_fits_into_the_frame_they_share(plate: Path) -> None:
    part = compile_part(plate)
    frame = _drawings.frame_of(part.views)
    assert frame.width / frame.height == pytest.approx(4 / 3)
    for view in part.views:
        for loop in view.loops:
            assert (loop.points[:, 0] > frame.x).all()
            assert (loop.points[:, 0] < frame.x + frame.width).all()
            assert (-loop.points[:, 1] > frame.y).all()
            assert (-loop.points[:, 1] < frame.y + frame.height).all()
    assert frame.bar_mm in (1, 2, 5, 10, 20, 50, 100)


def test_the_picture_shows_the_part_whole_on_white(plate: Path) -> None:
    part = compile_part(plate)
    image = _picture.shade(part.solid, RayCaster(part.solid.mesh), part.poses[0].R)
    assert image.shape == _picture.SIZE_PX[::-1]
    rim = np.concatenate([image[0], image[:, 0]])
    assert (rim == 255).all()
    count, _ = cv2.connectedComponents((image < 200).astype(np.uint8))
    assert count == 2  # the white round it, and the part in one piece
    assert 0.15 < (image < 250).mean() < 0.8


def test_a_recipe_declares_the_unit_of_its_cad(tmp_path: Path, plate: Path) -> None:
    recipe = tmp_path / "recipe.yaml"
    (tmp_path / "plate.stl").write_bytes(plate.read_bytes())
    recipe.write_text("name: x\npart: plate.stl\nunit: inch\n")
    assert load_recipe(recipe).unit == "inch"
    recipe.write_text("name: x\npart: plate.stl\nunit: ell\n")
    with pytest.raises(ConfigError, match=r"recipe.yaml:3"):
        load_recipe(recipe)


def test_the_recipes_in_the_house_leave_no_unit_to_be_assumed() -> None:
    for path in sorted((ROOT / "recipes").glob("*.yaml")):
        recipe = load_recipe(path)
        part = load_solid(recipe.part, unit=recipe.unit)
        assert (part.unit, part.unit_is_declared) == ("mm", True), path.name


def test_a_unit_for_several_files_is_for_those_that_name_none(tmp_path: Path) -> None:
    assert compiling.options_among(tmp_path / "a.stl", "inch").unit == "inch"
    assert compiling.options_among(tmp_path / "a.step", "inch").unit is None
    assert compiling.options_among(tmp_path / "a.csg.yaml", "inch").unit is None


def test_the_planner_takes_a_unit_for_a_bare_cad_file(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh_of(box(2, 1, 0.5)).export(plate)
    asked = ["plan", str(plate), "--cell", str(CELL), "--pose", "99"]
    assert main(asked) == 2
    assert "names no unit" in capsys.readouterr().err
    assert main([*asked, "--unit", "inch"]) == 2
    assert "has stable poses 0 to 5" in capsys.readouterr().err


def test_a_part_as_large_as_a_house_has_no_more_samples_than_any(plate: Path) -> None:
    part = compile_part(plate, CompileOptions(unit="m"))
    assert len(part.samples.points_mm) < 210_000
    assert part.samples.areas_mm2.sum() == pytest.approx(part.solid.mesh.area)


def test_a_loaded_part_is_as_good_as_a_compiled_one_for_its_page(plate: Path) -> None:
    compiled = compile_part(plate)
    load_part(plate)
    loaded = load_part(plate)
    assert isinstance(loaded, CompiledPart)
    assert render_sheet([loaded], 2.7) == render_sheet([compiled], 2.7)
    assert isinstance(loaded.solid, solid.Solid)


def test_drawings_are_the_mesh_and_a_picture_of_each_pose(
    plate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "new" / "drawings"
    assert main(["compile", str(plate), "--json", "--drawings", str(folder)]) == 0
    [body] = answers(capsys)
    mesh = json.loads((folder / "mesh.json").read_text())
    assert len(mesh["triangles"]) == 3 * body["triangles"] == 3 * len(mesh["face_of_triangle"])
    assert set(mesh["face_of_triangle"]) == {face["face"] for face in body["faces"]}
    extents = np.ptp(np.reshape(mesh["vertices"], (-1, 3)), axis=0)
    assert extents == pytest.approx(body["size_mm"], abs=2e-3)
    for pose in body["stable_poses"]:
        image = cv2.imread(str(folder / pose["picture"]), cv2.IMREAD_GRAYSCALE)
        assert image.min() < 150 < image.max()  # a part on white paper


def test_drawings_of_two_parts_are_refused(
    plate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "drawings"
    assert main(["compile", str(plate), str(HOLDER), "--drawings", str(folder)]) == 2
    assert "takes one part" in capsys.readouterr().err
    assert not folder.exists()
