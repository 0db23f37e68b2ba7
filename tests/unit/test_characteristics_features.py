"""Each feature of a part has its sizes as characteristics, measured or listed with the reason."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from cad_solids import solid_of
from data_files import part_file
from featured_parts import PARTS

from controller.cad import Feature, Solid, load_solid
from controller.cad.surfaces import find_features
from controller.inspection.characteristics import (
    Characteristic,
    CharacteristicKind,
    EdgePairGeometry,
    derive,
)

FILES = (
    "angle_block.stl", "cycloidal_gear.stl", "disc_cam_a.stl", "featuretype.stl", "flange_xy.stl",
    "holder.stl", "idler_riser.stl", "nist_ftc06.stl",
)  # fmt: skip
NAMES = (*PARTS, *FILES)
KIND = CharacteristicKind


@cache
def part(name: str) -> tuple[Solid, tuple[Feature, ...], tuple[Characteristic, ...]]:
    made = name in PARTS
    solid = solid_of(PARTS[name](), name) if made else load_solid(part_file(name), unit="mm")
    return solid, find_features(solid), derive(solid)


def words_of(feature: Feature) -> tuple[str, ...]:
    """What a drawing gives of a feature."""
    match feature.kind:
        case "hole":
            return ("diameter", "position", *(() if feature.is_through else ("depth",)))
        case "boss":
            return "diameter", "position", "depth"
        case "slot" | "keyway":
            return ("width", "position", *(() if feature.is_through else ("depth",)))
        case "pocket" | "opening":
            return ("width", "length", "position", *(() if feature.is_through else ("depth",)))
        case "chamfer":
            return ("width",)
        case "fillet":
            return ("radius",)


def planes_joined(solid: Solid, rows: tuple[Characteristic, ...]) -> dict[int, int]:
    """Planes by id, each with a number that is the same where rows say their distance."""
    planes = [f for f in solid.faces if f.kind == "plane"]
    label = {f.id: f.id for f in planes}

    def join(one: int, other: int) -> None:
        old, new = label[one], label[other]
        for i, own in label.items():
            label[i] = new if own == old else own

    for i, one in enumerate(planes):
        for other in planes[:i]:
            is_parallel = abs(float(one.normal @ other.normal)) > 0.99999
            if is_parallel and abs((one.centre_mm - other.centre_mm) @ one.normal) < 0.02:
                join(one.id, other.id)
    for row in rows:
        pair = row.geometry
        # The floor of a drilled hole is a cone.
        faces = {pair.one_face, pair.other_face} if isinstance(pair, EdgePairGeometry) else set()
        if len(faces & set(label)) == 2:
            join(pair.one_face, pair.other_face)
    return label


def says(
    word: str, feature: Feature, rows: tuple[Characteristic, ...], joined: dict[int, int]
) -> bool:
    """Whether rows have a size of a feature."""
    own = [row for row in rows if set(row.faces) & set(feature.faces)]
    named = [row for row in own if row.id.endswith(word)]
    if word in ("diameter", "position"):
        rounds = [s.face for s in feature.steps if s.kind == "cylinder"]
        if rounds:
            return all(any(face in row.faces for row in named) for face in rounds)
    if named or (word == "depth" and any(row.id.endswith("height") for row in own)):
        return True
    if word in ("radius", "width") and not feature.across:
        return any(row.kind in (KIND.RADIUS, KIND.DIAMETER, KIND.WIDTH) for row in own)
    others = set(joined) - set(feature.faces)
    if word in ("width", "length"):
        pair = feature.across[word == "length"]
        return joined[pair[0]] == joined[pair[1]]
    planes = feature.ends if word == "depth" else [i for pair in feature.across for i in pair]
    return bool(planes) and all(any(joined[i] == joined[j] for j in others) for i in planes)


def test_there_are_parts_of_all_kinds() -> None:
    assert len(NAMES) >= 25
    kinds = {f.kind for name in PARTS for f in part(name)[1]}
    assert kinds == {
        "hole", "slot", "keyway", "pocket", "opening", "boss", "chamfer", "fillet"
    }  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_each_size_of_each_feature_has_a_row(name: str) -> None:
    solid, features, rows = part(name)
    joined = planes_joined(solid, rows)
    missing = [
        (feature.label, word)
        for feature in features
        for word in words_of(feature)
        if not says(word, feature, rows, joined)
    ]
    assert missing == []


@pytest.mark.parametrize("name", NAMES)
def test_a_row_that_is_not_measured_says_why(name: str) -> None:
    _, _, rows = part(name)
    assert [row.id for row in rows if row.is_measured == bool(row.exempt)] == []
    assert len({row.id for row in rows}) == len(rows)
    assert [row.balloon for row in rows] == list(range(1, len(rows) + 1))


def test_a_feature_that_is_left_out_of_what_is_found_has_no_row() -> None:
    """The rows follow from features: without one of them its rows are missing."""
    solid, features, rows = part("collar")
    keyway = next(f for f in features if f.kind == "keyway")
    without = tuple(row for row in rows if "keyway" not in row.id)
    joined = planes_joined(solid, without)
    assert not says("depth", keyway, without, joined)
    assert says("width", keyway, without, joined)


def test_the_sizes_of_a_keyway_that_no_plane_faces_are_listed() -> None:
    by_id = {row.id: row for row in part("collar")[2]}
    depth = by_id["keyway 6 x 24 mm F5 depth"]
    assert not depth.is_measured
    assert depth.nominal_mm == pytest.approx(4.05, abs=0.1)
    assert depth.exempt == "no plane of the part is measured against its floor"
    assert np.allclose(depth.geometry.direction[[0, 2]], 0.0, atol=1e-6)  # type: ignore[union-attr]  # of two planes
