"""Codes on emulated parts: drawn on the roomiest plane, seen by the camera, counted up."""

import numpy as np
import pytest
import trimesh
from test_emu_surfaces import CELL, RING, shape

from controller.config.serial_code import SerialCodeSection
from controller.imaging.codes import read_codes
from emulators.app import build_parser, options_of
from emulators.codes import codes_of
from emulators.world import LayoutError, build_scene, coded, part_surface, read_layout
from emulators.world.pictures.geometry import Surface
from emulators.world.pictures.picture import Eye

BLOCK = shape(trimesh.creation.box((60.0, 40.0, 20.0)), "block")


def marked(text: str = "SN-0041") -> Surface:
    codes = codes_of(f"data_matrix:{text}")
    assert codes is not None
    return coded(part_surface("part 0", BLOCK), codes.next())


@pytest.mark.parametrize("finish_seed", [None, 7])
def test_the_camera_over_the_table_reads_the_code_on_the_upper_side(
    finish_seed: int | None,
) -> None:
    layout = read_layout(CELL)
    surface = marked()
    marks = surface.vertices_mm[len(BLOCK.vertices_mm) :]
    T = np.eye(4)
    T[:3, 3] = 370.0, 20.0, 10.0
    if marks[:, 2].mean() < 0:  # it is on the lower of the two largest planes
        T[:3, :3] = np.diag((1.0, -1.0, -1.0))
    eye = Eye(build_scene(layout, [BLOCK], finish_seed).with_mover(surface), 0)
    light = eye.picture({"part 0": T}, {RING: 1.0})
    rng = np.random.default_rng(1)
    picture = np.clip(205 * light + rng.normal(0, 0.8, light.shape), 0, 255).astype(np.uint8)
    (code,) = read_codes(picture, ("data_matrix",))
    assert code.text == "SN-0041"
    x_mm, y_mm, _ = (T[:3, :3] @ marks.mean(axis=0) + T[:3, 3]).tolist()
    # the camera looks straight down from 1250 mm at (360, 0); picture right is -y, up is x
    scale = 3571.0 / 1230.0
    expected = np.array((639.5 - scale * y_mm, 511.5 - scale * (x_mm - 360.0)))
    assert np.linalg.norm(code.centre_px - expected) < 3.0


def test_a_code_lies_on_one_plane_of_the_part_and_within_it() -> None:
    marks = marked().vertices_mm[len(BLOCK.vertices_mm) :]
    assert np.ptp(marks[:, 2]) < 1e-9
    assert abs(abs(marks[0, 2]) - 10.0) < 0.1
    assert (np.abs(marks[:, :2]) < (30.0, 20.0)).all()


def test_a_part_without_a_plane_has_no_code() -> None:
    ball = part_surface("part 0", shape(trimesh.creation.icosphere(subdivisions=4), "ball"))
    assert coded(ball, np.ones((10, 10), bool)) is ball


def test_numbers_count_up_with_each_part() -> None:
    codes = codes_of("qr:A-099")
    assert codes is not None
    first, then = codes.next(), codes.next()
    assert (codes.text, first.shape) == ("A-101", then.shape)
    assert (first != then).any()


@pytest.mark.parametrize("text", ["aztec:A1", "qr", "qr:", "qr:" + "x" * 201])
def test_a_code_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(LayoutError, match="--code"):
        codes_of(text)


def test_the_option_is_passed_on() -> None:
    given = ["--cell", str(CELL), "--code", "qr:A1"]
    assert options_of(build_parser().parse_args(given)).code == "qr:A1"


@pytest.mark.parametrize(
    ("keys", "first"),
    [
        ({}, "E0001"),
        ({"form": "SN-####"}, "SN-0001"),
        ({"form": "@#-*"}, "A0-0001"),
        ({"form": "##X"}, "00X"),
        ({"field": "21", "form": "A##"}, "(21)A01"),
        ({"field": "S"}, ""),  # an envelope of ISO 15434 is not emulated
    ],
)
def test_an_emulated_part_has_a_number_that_its_recipe_takes(
    keys: dict[str, str], first: str
) -> None:
    asked = SerialCodeSection(code="qr", **keys)
    assert asked.example == first
    number = first.removeprefix("(21)")
    assert not first or asked.why_not(number) == ""


def test_gs1_codes_say_their_fields() -> None:
    codes = codes_of("data_matrix:(21)A01")
    assert codes is not None
    cells = np.pad(codes.next(), 3)
    picture = np.kron(np.where(cells, 20, 200), np.ones((6, 6))).astype(np.uint8)
    (code,) = read_codes(picture, ("data_matrix",))
    assert (code.text, code.fields) == ("(21)A01", {"21": "A01"})
