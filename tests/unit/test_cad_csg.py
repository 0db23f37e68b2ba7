"""CSG text: volumes known on paper, placements, and mistakes named with their line."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cad_solids import polygon_area

from controller.cad import (
    CadError,
    CsgCadError,
    ManySolidsCadError,
    UnitCadError,
    load_solid,
    stable_poses,
)
from controller.cad.resting import find_resting

ROOT = Path(__file__).resolve().parents[2]
WIDGET = ROOT / "recipes" / "parts" / "widget.csg.yaml"
PAPER_WIDGET = WIDGET.with_name("paper_widget.csg.yaml")
FINE = "tolerance_mm: 0.004\n"


def built(folder: Path, part: str, head: str = "unit: mm\n") -> trimesh.Trimesh:
    path = folder / "part.csg.yaml"
    path.write_text(head + "part:\n  " + part.strip() + "\n")
    return load_solid(path).mesh


def mistake(folder: Path, text: str, kind: type[CadError] = CsgCadError) -> str:
    path = folder / "part.csg.yaml"
    path.write_text(text)
    with pytest.raises(kind) as caught:
        load_solid(path)
    assert type(caught.value) is kind
    message = str(caught.value)
    assert all(line.startswith(str(path)) for line in message.splitlines())
    return message.replace(str(path), "part")


SOLIDS = {  # on paper: volume [mm3], lower and upper corner of the box round it
    "block": ("block: {size: [10, 20, 30]}", 6000.0, (-5, -10, 0), (5, 10, 30)),
    "corners": ("block: {from: [1, 2, 3], to: [11, 12, 13]}", 1000.0, (1, 2, 3), (11, 12, 13)),
    "cylinder": ("cylinder: {radius: 5, height: 8}", 200 * np.pi, (-5, -5, 0), (5, 5, 8)),
    "diameter": ("cylinder: {diameter: 10, height: 8}", 200 * np.pi, (-5, -5, 0), (5, 5, 8)),
    "frustum": (
        "cone: {radius: [6, 3], height: 10}",
        np.pi * 10 / 3 * (36 + 18 + 9),
        (-6, -6, 0),
        (6, 6, 10),
    ),
    "cone": ("cone: {radius: [6, 0], height: 10}", 120 * np.pi, (-6, -6, 0), (6, 6, 10)),
    "funnel": ("cone: {diameter: [0, 12], height: 10}", 120 * np.pi, (-6, -6, 0), (6, 6, 10)),
    "sphere": ("sphere: {radius: 6}", 288 * np.pi, (-6, -6, -6), (6, 6, 6)),
    "extrude": (
        "extrude: {outline: [[0, 0], [20, 0], [0, 10]], height: 7}",
        700.0,
        (0, 0, 0),
        (20, 10, 7),
    ),
    "clockwise with a hole": (
        "extrude: {outline: [[0, 0], [0, 10], [20, 10], [20, 0]],"
        " holes: [[[2, 2], [4, 2], [4, 4], [2, 4]]], height: 2}",
        392.0,
        (0, 0, 0),
        (20, 10, 2),
    ),
    "ring": (  # Pappus: area 4 on a circle of radius 10
        "revolve: {outline: [[9, 1], [11, 1], [11, 3], [9, 3]]}",
        4 * 20 * np.pi,
        (-11, -11, 1),
        (11, 11, 3),
    ),
    "union": (
        "union: [{block: {size: [10, 10, 10]}}, {block: {size: [4, 4, 20]}}]",
        1160.0,
        (-5, -5, 0),
        (5, 5, 20),
    ),
    "difference": (
        "difference: [{block: {size: [10, 10, 10]}}, {block: {size: [4, 4, 20]}}]",
        840.0,
        (-5, -5, 0),
        (5, 5, 10),
    ),
    "intersection": (
        "intersection: [{block: {size: [10, 10, 10]}}, {block: {size: [4, 20, 20]}}]",
        400.0,
        (-2, -5, 0),
        (2, 5, 10),
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_a_shape_has_the_volume_and_the_place_of_its_drawing(tmp_path: Path, name: str) -> None:
    text, volume, low, high = SOLIDS[name]
    mesh = built(tmp_path, text, "unit: mm\n" + FINE)
    # radii of 5 mm and more are short of at most 0.004 mm, thrice over in a sphere's volume
    assert volume * (1 - 3 * 0.004 / 5) < mesh.volume < volume * (1 + 1e-9)
    assert mesh.bounds == pytest.approx(np.array([low, high], dtype=float), abs=1e-9)


@pytest.mark.parametrize("tolerance", [0.1, 0.01])
@pytest.mark.parametrize("kind", ["cylinder: {radius: 40, height: 9}", "sphere: {radius: 40}"])
def test_a_curve_is_off_by_no_more_than_the_tolerance_and_only_inwards(
    tmp_path: Path, kind: str, tolerance: float
) -> None:
    mesh = built(tmp_path, kind, f"unit: mm\ntolerance_mm: {tolerance}\n")
    points, triangle = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    if "cylinder" in kind:
        wall = np.abs(mesh.face_normals[triangle][:, 2]) < 0.5
        points = points[wall] * (1, 1, 0)
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() <= 40 + 1e-9
    assert 40 - tolerance <= radius.min() < 40 - tolerance / 5, "and not much finer than asked"


def test_lengths_are_in_the_unit_the_text_names(tmp_path: Path) -> None:
    path = tmp_path / "brick.csg.yaml"
    path.write_text("unit: inch\ndensity_g_cm3: 7.85\npart: {block: {size: [1, 2, 3]}}\n")
    solid = load_solid(path)
    assert solid.mesh.extents == pytest.approx([25.4, 50.8, 76.2])
    assert (solid.name, solid.unit, solid.unit_is_declared) == ("brick", "inch", True)
    assert solid.density_g_cm3 == 7.85
    assert solid.content_hash == hashlib.sha256(path.read_bytes()).hexdigest()
    with pytest.raises(UnitCadError, match="is in inch by its own statement"):
        load_solid(path, unit="mm")


def test_a_shape_is_turned_in_the_order_said_and_then_moved(tmp_path: Path) -> None:
    part = """
  block: {from: [0, 0, 0], to: [10, 2, 1]}
  turn: [{about: z, deg: 90}, {about: x, deg: 90}]
  move: [100, 0, 0]"""
    # (x, y, z) -> (-y, x, z) about z -> (-y, -z, x) about x
    mesh = built(tmp_path, part)
    assert mesh.bounds == pytest.approx(np.array([[98.0, -1, 0], [100, 0, 10]]), abs=1e-9)


def test_a_turn_about_a_direction_is_right_handed(tmp_path: Path) -> None:
    # a third of a turn about (1, 1, 1) takes x to y, y to z, z to x
    part = "block: {from: [0, 0, 0], to: [10, 2, 1]}\n  turn: {about: [1, 1, 1], deg: 120}"
    mesh = built(tmp_path, part)
    assert mesh.bounds == pytest.approx(np.array([[0.0, 0, 0], [1, 10, 2]]), abs=1e-9)


def test_a_named_shape_is_used_where_it_is_placed(tmp_path: Path) -> None:
    part = """difference:
    - block: {size: [60, 40, 20]}
    - use: bore
    - use: bore
      move: [20, 0, 0]"""
    head = "unit: mm\nshapes:\n  bore: {cylinder: {diameter: 8, height: 30}, move: [0, 0, -5]}\n"
    mesh = built(tmp_path, part, head)
    sides = 4 * int(np.ceil(np.pi / np.arccos(1 - 0.01 / 4) / 4))
    assert mesh.volume == pytest.approx(48_000 - 2 * 20 * polygon_area(4, sides), rel=1e-9)
    assert mesh.euler_number == 2 - 2 * 2


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("part: {block: {size: [9, 9, 9]}}", "part:1: `unit`: is missing"),
        ("unit: mm", "part:1: `part`: is missing"),
        (
            "unit: furlong\npart: {sphere: {radius: 9}}",
            "part:1: `unit`: 'furlong' is not a known unit; use one of mm, cm, m, inch",
        ),
        (
            "unit: mm\npart:\n  cylinder:\n    diametre: 5\n    height: 9",
            "part:4: `part.cylinder.diametre`: unknown key; did you mean `diameter`?",
        ),
        (
            "unit: mm\npart:\n  union:\n    - block: {size: [9, 9, 9]}\n    - sphere: {radius: -2}",
            "part:5: `part.union[2].sphere.radius`: Input should be greater than 0",
        ),
        (
            "unit: mm\npart:\n  diference: []",
            "part:3: `part.diference`: unknown key; did you mean `difference`?",
        ),
        ("unit: mm\npart:\n  block: {size: [9, 9]}", "part:3: `part.block.size`: has too few"),
        ("unit: mm\npart:\n  block: {size: [9, 9, high]}", "must be a number (found 'high')"),
        (
            "unit: mm\npart:\n  block: {size: [9, 9, true]}",
            "`part.block.size[3]`: must be a number",
        ),
        ("unit: mm\npart:\n  block: [1]", "part:3: `part.block`: must be `key: value` pairs"),
        ("unit: mm\npart: {}", "is of one kind, none found"),
        (
            "unit: mm\npart:\n  sphere: {radius: 9}\n  block: {size: [9, 9, 9]}",
            "part:2: `part`: is of one kind, `block` and `sphere` found",
        ),
        (
            "unit: mm\npart:\n  cylinder: {radius: 5, diameter: 9, height: 9}",
            "part:3: `part.cylinder`: give either `radius` or `diameter`",
        ),
        (
            "unit: mm\nshapes:\n  bore: {sphere: {radius: 9}}\npart:\n  use: bohr",
            "part:5: `part.use`: no shape is named `bohr`; did you mean `bore`?",
        ),
        (
            "unit: mm\nshapes:\n  a: {use: b}\n  b: {use: a}\npart: {use: a}",
            "part:4: `shapes.b.use`: a shape cannot use itself: a -> b -> a",
        ),
        (
            "unit: mm\npart:\n  difference:\n    - sphere: {radius: 9}\n    - sphere: {radius: 10}",
            "part:3: `part.difference`: nothing is left of it",
        ),
        (
            "unit: mm\npart:\n  extrude:\n    outline: [[0,0],[9,9],[9,0],[0,9]]\n    height: 9",
            "part:4: `part.extrude.outline`: crosses itself or is flat (Self-intersection",
        ),
        (
            "unit: mm\npart:\n  extrude:\n    outline: [[0,0],[9,0],[9,9]]\n"
            "    holes:\n      - [[0,5],[1,5],[1,6]]\n    height: 9",
            "part:6: `part.extrude.holes[1]`: leaves the outline",
        ),
        (
            "unit: mm\npart:\n  extrude:\n    outline: [[0,0],[9,0],[9,9],[0,9]]\n"
            "    holes:\n      - [[0,5],[4,4],[9,5],[4,6]]\n    height: 9",
            "part:6: `part.extrude.holes[1]`: leaves the outline",
        ),
        (
            "unit: mm\npart:\n  sphere: {radius: 9}\n  turn: {about: up, deg: 9}",
            "part:4: `part.turn[1].about`: must be x, y, z or a direction",
        ),
        ("unit: mm\nunit: mm", "part:2: `unit` is there twice"),
        ("unit: mm\npart:\n\tblock: 1", "part:3: not valid YAML"),
        ("a: &x [1]\nb: *x", "part:1: anchors (&) and aliases (*) are not read"),
        ("unit: !!int 3", "part:1: tags (!) are not read"),
        ("unit: mm\n---\nunit: mm", "part:2: a second document"),
        ("just words", "is empty or not a list of `key: value` lines"),
        ("[" * 99, "part:1: nested deeper than 60"),
        ("unit: mm\n#" + "x" * 200_000, "at most 200,000 bytes"),
        (
            "unit: mm\ntolerance_mm: 0.0001\npart:\n  cylinder: {radius: 5000, height: 9}",
            "part:4: `part.cylinder`: takes 15,708 sides at `tolerance_mm: 0.0001`, the most is",
        ),
    ],
)
def test_a_mistake_is_named_with_its_line_and_key(tmp_path: Path, text: str, told: str) -> None:
    assert told in mistake(tmp_path, text)


def test_every_mistake_of_a_text_is_told_at_once_in_its_order(tmp_path: Path) -> None:
    text = "unit: mm\ntolerance_mm: 0\npart:\n  cylinder:\n    radius: 0\n    hight: 9\n"
    lines = mistake(tmp_path, text).splitlines()
    assert [line.split("`")[1] for line in lines] == [
        "tolerance_mm",
        "part.cylinder.height",
        "part.cylinder.radius",
        "part.cylinder.hight",
    ]


def test_uses_that_unfold_without_end_are_counted_and_not_built(tmp_path: Path) -> None:
    shapes = "".join(
        f"  s{i}: {{union: [{{use: s{i - 1}}}, {{use: s{i - 1}, move: [{i}, 0, 0]}}]}}\n"
        for i in range(1, 50)
    )
    text = f"unit: mm\nshapes:\n  s0: {{block: {{size: [9, 9, 9]}}}}\n{shapes}part: {{use: s49}}\n"
    assert f"is {2**49:,} shapes of {12 * 2**49:,} triangles" in mistake(tmp_path, text)


def test_two_bodies_that_nothing_joins_are_refused(tmp_path: Path) -> None:
    text = """unit: mm
part:
  union:
    - block: {size: [20, 20, 20]}
    - block: {size: [20, 20, 20]}
      move: [30, 0, 0]
"""
    assert "2 separate bodies" in mistake(tmp_path, text, ManySolidsCadError)


def test_a_hollow_block_is_one_solid(tmp_path: Path) -> None:
    part = "difference: [{block: {size: [20, 20, 20]}}, {sphere: {radius: 6}, move: [0, 0, 10]}]"
    mesh = built(tmp_path, part)
    assert mesh.volume == pytest.approx(8000 - 288 * np.pi, rel=1e-3)


# the paper's Table 1, views 1 to 9: energy to tip over in a unit the paper does not name, and the
# vector that points up to the camera; 10 and 11 are "impossible" there, slivers of a polygon
TABLE_1 = np.array(
    [
        [1.240, 0, 1, 0],
        [1.157, 0, -1, 0],
        [0.6486, -0.5547, 0, -0.8321],
        [0.3500, 1, 0, 0],
        [0.2018, 0, 0, 1],
        [0.1745, 0.5547, 0, 0.8321],
        [0.1642, -1, 0, 0],
        [0.1043, 0.2594, -0.5718, 0.7783],
        [0.07001, 0.2594, 0.5718, 0.7783],
    ]
)
SLOPE = np.array([2.0, 0.0, 3.0]) / np.sqrt(13.0)


def test_the_papers_widget_rests_as_its_table_1_has_it() -> None:
    poses = sorted(stable_poses(load_solid(PAPER_WIDGET)), key=lambda p: p.stability_rank)
    assert not any(p.rolling or p.rocking or p.marginal for p in poses)
    ups = np.array([p.R[2] for p in poses])  # R turns the CAD frame upright: its last row is up
    assert ups == pytest.approx(TABLE_1[:, 1:], abs=1.5e-4), "four digits are printed"
    energies = np.array([p.tip_energy_mj_per_kg for p in poses])
    assert energies / energies.sum() == pytest.approx(TABLE_1[:, 0] / TABLE_1[:, 0].sum(), rel=1e-3)


def test_the_impossible_orientations_of_the_papers_widget_are_no_poses(tmp_path: Path) -> None:
    text = PAPER_WIDGET.read_text()
    assert "tolerance_mm: 0.02" in text
    held = []
    for tolerance in (0.02, 0.03, 0.1):
        path = tmp_path / "w.csg.yaml"
        path.write_text(text.replace("tolerance_mm: 0.02", f"tolerance_mm: {tolerance}"))
        resting = find_resting(load_solid(path))
        assert len(resting.poses) == len(TABLE_1)
        held.append(len(resting.facet_downs))
    assert max(held) > len(TABLE_1), "a sliver of a polygon holds the part, as 10 and 11 there"


@pytest.mark.parametrize("tolerance", [0.005, 0.02, 0.05])
def test_the_impossible_orientations_of_the_widgets_polygon_arc_are_no_poses(
    tmp_path: Path, tolerance: float
) -> None:
    text = WIDGET.read_text()
    assert "tolerance_mm: 0.02" in text
    path = tmp_path / "w.csg.yaml"
    path.write_text(text.replace("tolerance_mm: 0.02", f"tolerance_mm: {tolerance}"))
    resting = find_resting(load_solid(path))
    assert len(resting.facet_downs) > 7, "the hull itself has them, as the paper's 10 and 11"
    assert len(resting.poses) == 7


def test_the_widgets_curves_are_found_as_curves() -> None:
    solid = load_solid(WIDGET)
    bores = sorted(f.radius_mm for f in solid.faces if f.kind == "cylinder" and f.concave)
    assert bores == pytest.approx([4.0, 8.0], abs=0.02)
    slopes = [f.normal for f in solid.faces if f.kind == "plane"]
    for direction in (SLOPE, -SLOPE):
        assert max(float(direction @ n) for n in slopes) == pytest.approx(1.0, abs=1e-9)


def docs_blocks(kind: str) -> list[str]:
    text = (ROOT / "docs" / "csg.md").read_text()
    return [block.split("```")[0] for block in text.split(f"```{kind}\n")[1:]]


def test_the_example_of_the_docs_is_the_plate_it_says_it_is(tmp_path: Path) -> None:
    path = tmp_path / "plate.csg.yaml"
    path.write_text(docs_blocks("yaml")[0])
    solid = load_solid(path)
    assert solid.mesh.extents == pytest.approx([80, 40, 12])
    hole = np.pi * (3.3**2 * 9 + 3 / 3 * (3.3**2 + 3.3 * 6.3 + 6.3**2))
    trough = np.pi * 8**2 / 2 * 40
    assert solid.volume_mm3 == pytest.approx(80 * 40 * 12 - 2 * hole - trough, rel=2e-3)
    assert solid.mesh.euler_number == 2 - 2 * 2


def test_the_mistake_of_the_docs_is_told_as_they_say(tmp_path: Path) -> None:
    text = docs_blocks("yaml")[0].replace("diameter: 6.6", "diametre: 6.6", 1)
    told = mistake(tmp_path, text).splitlines()[0]
    assert told == docs_blocks("text")[0].strip().replace("plate.csg.yaml", "part")
