"""Limits of a recipe, of a set of views and of a drawing, put on the right characteristics."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from cad_solids import box, rod, solid_of

from controller.cad import Solid
from controller.cad.compiled import CompiledPart, compile_solid
from controller.cad.surfaces.tolerances import Datum, Dimension, GeometricTolerance
from controller.config import ConfigError, Recipe, load_recipe
from controller.config.characteristics import GivenSection
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    RimGeometry,
    derive,
    place_of,
)
from controller.setup.characteristics import part_characteristics

UNKNOWN_CLASS = "ZZ7"


def block() -> Solid:
    """A block 60 x 40 x 20 with two holes of 8 mm and one of 12 mm."""
    body = box(60, 40, 20) - rod(6, 30, 128)
    for x in (-20, 20):
        body = body - rod(4, 30, 128).translate((x, 8, 0))
    return solid_of(body, "block")


@cache
def part() -> CompiledPart:
    return compile_solid(block())


def asked(folder: Path, *entries: str, tolerance_class: str = "m") -> dict[str, Characteristic]:
    (folder / "block.stl").write_bytes(b"solid")
    lines = "".join(f"    - {entry}\n" for entry in entries)
    path = folder / "block.yaml"
    path.write_text(
        f"name: block\npart: block.stl\ninspection:\n  tolerance_class: {tolerance_class}\n"
        + (f"  characteristics:\n{lines}" if entries else "")
    )
    return {c.id: c for c in part_characteristics(path, load_recipe(path), part())}


def limits(characteristic: Characteristic) -> tuple[float, float]:
    return characteristic.lower_mm, characteristic.upper_mm


def test_the_class_is_the_recipes(tmp_path: Path) -> None:
    assert limits(asked(tmp_path)["hole 12 mm diameter"]) == pytest.approx((11.8, 12.2))
    fine = asked(tmp_path, tolerance_class="f")["hole 12 mm diameter"]
    assert limits(fine) == pytest.approx((11.9, 12.1))
    assert fine.source == "ISO 2768-f"


@pytest.mark.parametrize(
    ("entry", "lower", "upper", "source"),
    [
        ("{id: hole 12 mm diameter, lower: 12.05, upper: 12.3}", 12.05, 12.3, "recipe"),
        ("{id: hole 12 mm diameter, plus: 0.4, minus: 0}", 12.0, 12.4, "recipe"),
        ("{id: hole 12 mm diameter, fit: H11}", 12.0, 12.11, "recipe H11"),
        ("{id: Hole  12 mm Diameter, nominal: 12.1}", 11.9, 12.3, "ISO 2768-m"),
        ("{id: hole 12 mm, kind: diameter, plus: 0.3, minus: 0.3}", 11.7, 12.3, "recipe"),
    ],
)
def test_limits_in_every_way(
    tmp_path: Path, entry: str, lower: float, upper: float, source: str
) -> None:
    one = asked(tmp_path, entry)["hole 12 mm diameter"]
    assert limits(one) == pytest.approx((lower, upper), abs=1e-6)
    assert one.source == source


def test_a_name_without_its_number_means_all_alike(tmp_path: Path) -> None:
    found = asked(tmp_path, "{id: hole 8 mm diameter, plus: 0.5, minus: 0.5, critical: true}")
    for i in (1, 2):
        assert limits(found[f"hole 8 mm ({i}) diameter"]) == pytest.approx((7.5, 8.5))
        assert found[f"hole 8 mm ({i}) diameter"].is_critical
    only = asked(tmp_path, "{id: hole 8 mm (2) diameter, plus: 0.5, minus: 0.5}")
    assert limits(only["hole 8 mm (1) diameter"]) == pytest.approx((7.8, 8.2))
    assert limits(only["hole 8 mm (2) diameter"]) == pytest.approx((7.5, 8.5))


def test_what_is_ignored_is_not_measured_and_says_why(tmp_path: Path) -> None:
    found = asked(tmp_path, "{id: hole 8 mm (1), ignore: gauged by hand}")
    for name in ("hole 8 mm (1) diameter", "hole 8 mm (1) position"):
        assert not found[name].is_measured
        assert "gauged by hand" in found[name].exempt
    assert found["hole 8 mm (2) diameter"].is_measured


def face_at(normal: tuple[float, float, float]) -> int:
    faces = part().solid.faces
    return next(f.id for f in faces if f.kind == "plane" and f.normal @ np.array(normal) > 0.99)


def test_two_planes_may_be_named_by_their_faces(tmp_path: Path) -> None:
    low, high = face_at((-1, 0, 0)), face_at((1, 0, 0))
    found = asked(tmp_path, f"{{faces: [F{high}, F{low}], plus: 0.4, minus: 0.4}}")
    length = next(c for c in found.values() if set(c.faces) == {low, high})
    assert limits(length) == pytest.approx((59.6, 60.4))
    assert len(found) == len(asked(tmp_path))  # it was there


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("{id: hole 13 mm diameter, plus: 1, minus: 1}", "no characteristic 'hole 13 mm diameter'"),
        ("{id: hole 12 mm, plus: 0.3, minus: 0.3}", "write one of `hole 12 mm diameter`"),
        ("{id: hole 12 mm diameter, lower: 12.3, upper: 12.1}", "12.3 mm is above `upper`"),
        ("{id: hole 12 mm diameter, upper: 11}", "11.8 mm is above the upper one, 11 mm"),
        ("{id: hole 12 mm diameter, fit: ZZ7}", "known are the letters"),
        ("{id: hole 12 mm diameter, fit: H7, plus: 1}", "limits in two ways"),
        ("{id: hole 12 mm diameter}", "states nothing"),
        ("{plus: 1, minus: 1}", "either `id` or `faces`"),
        ("{faces: [F99], plus: 1, minus: 1}", "no face F99"),
        ("{faces: [top], plus: 1, minus: 1}", "faces by their numbers"),
        ("{id: hole 12 mm diameter, pluss: 1}", "nearest"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, entry: str, says: str) -> None:
    with pytest.raises(ConfigError) as error:
        asked(tmp_path, entry)
    message = str(error.value)
    assert says in message or (says == "nearest" and "plus" in message)
    assert "block.yaml:6" in message


def test_an_unknown_name_has_its_nearest(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nearest: hole 12 mm diameter"):
        asked(tmp_path, "{id: hole 12.1 mm diameter, plus: 1, minus: 1}")


def given(**keys: object) -> tuple[Characteristic, ...]:
    section = GivenSection.model_validate(keys)
    return part_characteristics(Path("SET.json"), None, part(), [section])


def test_a_set_names_characteristics_by_id() -> None:
    (one,) = given(id="hole 12 mm diameter", lower=11.95, upper=12.05, critical=True)
    assert limits(one) == (11.95, 12.05)
    assert (one.balloon, one.is_critical, one.source) == (1, True, "set")


def test_a_set_names_characteristics_by_place() -> None:
    (one,) = given(
        id="B7",
        kind="diameter",
        p_part_mm=[20, 8, 3],
        axis=[0, 0, -1],
        nominal_mm=8.0,
        lower=7.9,
        upper=8.1,
    )
    assert one.id == "B7"
    assert place_of(one.geometry)[0] == pytest.approx([20, 8, 0], abs=1e-3)
    assert limits(one) == (7.9, 8.1)
    (position,) = given(kind="position", p_part_mm=[20, 8, 10])
    assert position.kind is CharacteristicKind.POSITION


@pytest.mark.parametrize(
    "keys",
    [
        {"kind": "diameter", "p_part_mm": [20, 3, 0]},  # 5 mm beside the hole
        {"kind": "diameter", "p_part_mm": [20, 8, 0], "nominal_mm": 12},
        {"kind": "diameter", "p_part_mm": [20, 8, 0], "axis": [1, 0, 0]},
        {"kind": "width", "p_part_mm": [20, 8, 0]},
    ],
)
def test_a_place_without_such_a_feature_is_refused(keys: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match=r"SET.json: `characteristics.0`: no "):
        given(**keys)


def test_every_line_of_results_can_be_given_back() -> None:
    """Each derived characteristic is found again by kind, place and nominal value alone."""
    for c in derive(part()):
        p_mm, axis = place_of(c.geometry)
        (found,) = given(
            kind=c.kind.value,
            p_part_mm=p_mm.tolist(),
            axis=axis.tolist(),
            nominal_mm=c.nominal_mm,
            lower=c.lower_mm,
            upper=c.upper_mm,
            verdict="pass",
            U_mm=0.01,
            measured_mm=1.0,
        )
        assert found.faces == c.faces
        assert limits(found) == limits(c)


def drawn(*tolerances: Dimension | GeometricTolerance | Datum) -> dict[str, Characteristic]:
    return {c.id: c for c in derive(compile_solid(block(), tolerances=tolerances))}


def wall_of(name: str) -> int:
    return next(c for c in derive(part()) if c.id == name).faces[0]


def test_a_drawings_limits_go_before_general_ones() -> None:
    wall = wall_of("hole 12 mm diameter")
    found = drawn(
        Dimension("size_diameter", 12.0, -0.05, 0.1, (wall,)),
        GeometricTolerance("position", 0.3, True, ("A",), (wall,)),
        Datum("A", (0,)),
    )
    diameter, position = found["hole 12 mm diameter"], found["hole 12 mm position"]
    assert limits(diameter) == pytest.approx((11.95, 12.1))
    assert (diameter.source, diameter.is_critical) == ("AP242", True)
    assert limits(position) == pytest.approx((0, 0.15))
    assert found["hole 8 mm (1) diameter"].source == "ISO 2768-m"


def test_a_drawings_fit_is_looked_up() -> None:
    wall = wall_of("hole 12 mm diameter")
    found = drawn(Dimension("size_diameter", 12.0, None, None, (wall,), fit="H9"))
    assert limits(found["hole 12 mm diameter"]) == pytest.approx((12.0, 12.043))
    unknown = drawn(Dimension("size_diameter", 12.0, None, None, (wall,), fit=UNKNOWN_CLASS))
    assert unknown["hole 12 mm diameter"].source == "ISO 2768-m"


def test_a_drawings_distance_is_between_its_planes() -> None:
    low, high = face_at((0, 0, -1)), face_at((0, 0, 1))
    found = drawn(
        Dimension("location_linear_distance", 20.0, -0.2, 0.0, (high,), (low,)),
        Dimension("location_linear_distance", 25.0, -0.2, 0.0, (high,), (low,)),  # of another
    )
    thickness = next(c for c in found.values() if set(c.faces) == {low, high})
    assert limits(thickness) == pytest.approx((19.8, 20.0))


def test_a_drawings_angle_and_bare_dimensions_change_nothing() -> None:
    found = drawn(
        Dimension("angularity", 1.0, -0.1, 0.1, (0,), is_angle=True),
        Dimension("size_diameter", 12.0, -0.1, 0.1, ()),
    )
    assert {c.source for c in found.values()} == {"ISO 2768-m"}


def test_a_drawings_position_is_seen_from_its_round_datum() -> None:
    wide, one = wall_of("hole 12 mm diameter"), wall_of("hole 8 mm (1) diameter")
    zones = (
        GeometricTolerance("position", 0.2, False, ("A",), (one,)),
        GeometricTolerance("position", 0.5, True, ("A", "B"), (one,)),
        GeometricTolerance("position", 0.4, True, ("A",), (wide,)),
    )
    found = drawn(*zones, Datum("A", (0,)), Datum("B", (wide,)))
    position = found["hole 8 mm (1) position"]
    assert limits(position) == (0, 0.25)  # the round zone, and not the flat one
    assert isinstance(position.geometry, RimGeometry)
    assert {round(rim.radius_mm, 2) for rim in position.geometry.datum} == {6}
    from_planes = found["hole 12 mm position"].geometry
    assert isinstance(from_planes, RimGeometry)
    assert from_planes.datum == ()


def test_a_recipe_written_with_a_set_of_views_reads_back_the_same(tmp_path: Path) -> None:
    asked(
        tmp_path,
        "{id: hole 8 mm diameter, plus: 0.5, minus: 0.5, critical: true}",
        "{id: hole 12 mm, ignore: gauged by hand}",
        "{faces: [F0, F1], lower: 19.5, upper: 20.5}",
    )
    recipe = load_recipe(tmp_path / "block.yaml")
    text = recipe.model_dump_json(by_alias=True, exclude_none=True)
    assert Recipe.model_validate_json(text).inspection == recipe.inspection
