"""Which faces a recipe leaves out: named as the part names them, each with a reason."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
from cad_solids import box, rod, solid_of
from manifold3d import CrossSection

from controller.cad import Solid, find_features
from controller.config import ConfigError, load_recipe
from controller.setup.faces import faces_left_out


@cache
def plate() -> Solid:
    two = rod(4, 30, 48).translate((15, 5, 0)) + rod(4, 30, 48).translate((-15, 5, 0))
    return solid_of(box(60, 40, 10) - two - rod(3, 30, 48), "plate")


def recipe(folder: Path, named: str) -> Path:
    (folder / "plate.stl").write_bytes(b"solid")
    path = folder / "plate.yaml"
    path.write_text(f"name: plate\npart: plate.stl\ninspection:\n  min_coverage: 0.5\n{named}")
    return path


def left_out(folder: Path, *names: str) -> dict[int, str]:
    lines = "".join(f'    "{name}": gauged by hand\n' for name in names)
    path = recipe(folder, f"  not_inspected:\n{lines}")
    return faces_left_out(path, load_recipe(path), plate().faces, find_features(plate()))


def bores(diameter_mm: float) -> set[int]:
    return {f.id for f in plate().faces if f.label.endswith(f"bore {diameter_mm:.1f} mm")}


def test_a_face_is_named_by_number_or_label_and_alike_ones_by_their_label(tmp_path: Path) -> None:
    assert set(left_out(tmp_path, "F3")) == {3}
    label = plate().faces[3].label
    assert left_out(tmp_path, label) == {3: "gauged by hand"}
    assert set(left_out(tmp_path, "bore 8.0 mm")) == bores(8.0)
    assert len(bores(8.0)) == 2
    assert set(left_out(tmp_path, "f0", "Bore  6.0 mm")) == {0} | bores(6.0)


def test_a_run_of_numbers_names_all_its_faces(tmp_path: Path) -> None:
    assert set(left_out(tmp_path, "F3 to F6")) == {3, 4, 5, 6}


def test_nothing_named_leaves_nothing_out(tmp_path: Path) -> None:
    path = recipe(tmp_path, "")
    assert faces_left_out(path, load_recipe(path), plate().faces, ()) == {}


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("bore 8.5 mm", "nearest: bore 8.0 mm"),
        ("F99", "the part has F0 to F8"),
        ("plane", "planes are named by number"),
        ("F7 to F99", "the part has F0 to F8"),
        ("F5 to F3", "the part has F0 to F8"),
    ],
)
def test_a_name_no_face_has_is_refused_with_its_line_and_the_nearest(
    tmp_path: Path, name: str, hint: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        left_out(tmp_path, "F3", name)
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'plate.yaml'}:7: ")
    assert repr(name) in message
    assert hint in message


def test_every_wrong_name_is_told_at_once(tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        left_out(tmp_path, "F98", "F99")
    assert [line.split(":")[1] for line in str(caught.value).splitlines()] == ["6", "7"]


@cache
def filleted() -> Solid:
    """A pocket whose corners are rounded by 4 mm, beside a bore and a slot 8 mm wide."""

    def outline(x: float, y: float, radius: float) -> CrossSection:
        corner = CrossSection.circle(radius, 64)
        return CrossSection.batch_hull([
            corner.translate((sx * (x / 2 - radius), sy * (y / 2 - radius)))
            for sx in (-1, 1)
            for sy in (-1, 1)
        ])  # fmt: skip

    pocket = outline(22, 16, 4.0).extrude(20).translate((-12, 0, 0))
    slot = outline(20, 8.0, 3.999).extrude(40).translate((18, 8, -20))
    return solid_of(box(70, 40, 20) - pocket - slot - rod(4, 60, 64).translate((18, -8, 0)), "f")


def names_of(folder: Path, name: str) -> dict[int, str]:
    path = recipe(folder, f'  not_inspected:\n    "{name}": gauged by hand\n')
    solid = filleted()
    return faces_left_out(path, load_recipe(path), solid.faces, find_features(solid))


def test_a_concave_fillet_is_no_bore(tmp_path: Path) -> None:
    fillets = {f.id for f in filleted().faces if f.label.endswith("fillet R4.0 mm")}
    assert len(fillets) == 4
    found = find_features(filleted())
    features = {face for one in found if one.kind == "fillet" for face in one.faces}
    assert features == fillets  # one name for one face
    assert set(names_of(tmp_path, "fillet R4.0 mm")) == fillets


def test_a_name_of_features_of_two_kinds_is_refused_with_both_named(tmp_path: Path) -> None:
    alike = [f for f in filleted().faces if f.label.endswith("bore 8.0 mm")]
    assert len(alike) == 3  # the bore, and both ends of the slot
    with pytest.raises(ConfigError) as caught:
        names_of(tmp_path, "bore 8.0 mm")
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'plate.yaml'}:6: ")
    for feature in find_features(filleted()):
        assert (feature.label in message) == (feature.kind in ("hole", "slot"))
    assert set(names_of(tmp_path, alike[0].label)) == {alike[0].id}


def test_a_feature_as_compile_lists_it_names_all_its_faces(tmp_path: Path) -> None:
    (slot,) = (one for one in find_features(filleted()) if one.kind == "slot")
    assert set(names_of(tmp_path, slot.label)) == set(slot.faces)


def test_a_name_that_no_face_of_its_diameter_has_is_refused_with_theirs(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"of this diameter are: F\d+ "):
        names_of(tmp_path, "boss 8.0 mm")


@pytest.mark.parametrize("reason", ["", "''", "no"])
def test_a_face_left_out_needs_a_reason(tmp_path: Path, reason: str) -> None:
    path = recipe(tmp_path, f"  not_inspected:\n    F3: {reason}\n")
    with pytest.raises(ConfigError, match=r"plate\.yaml:6: "):
        load_recipe(path)


@pytest.mark.parametrize("coverage", ["0", "0.0", "-0.1", "1.01", ".nan"])
def test_a_coverage_that_asks_for_nothing_is_refused(tmp_path: Path, coverage: str) -> None:
    path = recipe(tmp_path, "")
    path.write_text(path.read_text().replace("0.5", coverage))
    with pytest.raises(ConfigError, match=r"plate\.yaml:4: `inspection\.min_coverage`"):
        load_recipe(path)
