"""Which side is up of a machined part on the emulated table, as the controller sees it."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from controller.cad.compiled import CompiledPart, CompileOptions, load_part
from controller.cell.compute.job import glowing_mask
from controller.config import Cell, load_cell
from controller.imaging import Camera
from controller.recognition import Library, Sighting, recognise
from controller.recognition.stored import open_library
from controller.setup.layout import build_layout
from controller.setup.optics import table_corners
from emulators import world
from emulators.world.pictures.picture import Eye
from emulators.world.pictures.sensor import Exposure, blurred, develop

RECIPES = Path(__file__).resolve().parents[2] / "recipes"
CELL = RECIPES / "cells" / "emulated.yaml"
FLANGE = RECIPES / "parts" / "flange_xy.stl"
OVERHEAD = 0  # the camera's number
SHOWN = 0.010  # [s]


@cache
def known() -> tuple[CompiledPart, Cell, Camera, Library]:
    options = CompileOptions(unit="mm")
    cell = load_cell(CELL)
    camera = build_layout(cell).overhead
    return load_part(FLANGE, options), cell, camera, open_library([(FLANGE, options)], camera)


def seen_lying(side: int, turn_deg: float, seed: int, off_mm: float, tmp_path: Path) -> Sighting:
    """Lay the flange down on a side, larger by so much than its CAD model, and recognise it."""
    part, cell, camera, library = known()
    body = part.solid.mesh.copy()
    body.apply_scale(1.0 + off_mm / float(np.ptp(body.bounds, axis=0).max()))
    body.export(tmp_path / "part.stl")
    solid = world.load_solid(tmp_path / "part.stl")
    scene = world.build_scene(world.read_layout(CELL), [solid], seed)
    T = np.eye(4)
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ part.poses[side].R
    points = body.vertices @ T[:3, :3].T
    T[:3, 3] = (375.0, 15.0, -points[:, 2].min())
    eye, lamps = Eye(scene, OVERHEAD), [lamp.name for lamp in scene.lamps]

    def picture(lamp: str, number: int) -> NDArray[np.uint8]:
        light = eye.picture({"part 0": T}, {lamps.index(lamp): 1.0})
        return np.asarray(develop(blurred(light), Exposure(SHOWN, seed=number)), dtype=np.uint8)

    usable = glowing_mask(camera, table_corners(cell))
    lit = [picture("table_ring", 1), picture("table_side", 2)]
    backlit = picture("table_backlight", 3)
    (seen,) = recognise(backlit, camera, library, "backlit", usable=usable, lit=lit).sightings
    return seen


# its hubs differ by 4.8 mm in diameter and 1.7 mm in height; a part that is 0.1 mm too large or
# small moves its outline by more than which hub is up
@pytest.mark.parametrize(
    ("side", "turn_deg", "seed", "off_mm"),
    [
        (1, -155.2, 2, 0.1),
        pytest.param(1, -165.7, 3, 0.1, marks=pytest.mark.slow),
        (0, 31.7, 4, -0.1),
        pytest.param(0, -7.5, 5, -0.1, marks=pytest.mark.slow),
    ],
)
def test_a_machined_flange_is_told_from_itself_turned_over(
    side: int, turn_deg: float, seed: int, off_mm: float, tmp_path: Path
) -> None:
    seen = seen_lying(side, turn_deg, seed, off_mm, tmp_path)
    assert seen.pose_index == side
    assert seen.ambiguous_with == ()
