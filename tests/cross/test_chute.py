"""The chute under the fixed gripper: one file, read twice; what falls comes to the table."""

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import trimesh

from controller.config import load_cell
from controller.setup.layout import build_layout
from emulators.gripper_modbus import JawModel
from emulators.umi_scara import ArmJoints
from emulators.world import Solid, World, load_solid, read_layout
from emulators.world.poses import transform, turn_z

ROOT = Path(__file__).resolve().parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))
PARK = ArmJoints(shoulder_rad=math.radians(80.0), pitch_rad=-math.pi / 2.0, jaw_opening_mm=85.0)


class ParkedArm:
    grasp_limit_mm: float | None = None

    def advance(self, dt_s: float) -> None:
        pass

    def joints(self) -> ArmJoints:
        return PARK


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Solid]:
    folder = tmp_path_factory.mktemp("block")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        trimesh.creation.box((60.0, 40.0, 20.0)).export(folder / "block.stl")
        yield load_solid(folder / "block.stl")


def test_world_and_planning_read_the_same_chute() -> None:
    standing = {
        one.box.name: transform(one.T_world_box, one.box.centre_mm + SIGNS * one.box.half_mm)
        for one in read_layout(CELL).chute
    }
    planned = {
        name: box.T[:3, 3] + SIGNS * box.half_mm @ box.T[:3, :3].T
        for name, box in build_layout(load_cell(CELL)).obstacles.items()
        if name.startswith("chute ")
    }
    assert standing.keys() == planned.keys()
    assert len(planned) == 12
    for name, corners in planned.items():
        np.testing.assert_allclose(np.sort(corners, 0), np.sort(standing[name], 0), atol=0.01)


def test_the_chute_is_out_of_the_pictures_of_the_table() -> None:
    layout = build_layout(load_cell(CELL))
    grid = np.array(list(product(np.linspace(-1.0, 1.0, 41), repeat=3)))
    grid = grid[(np.abs(grid) == 1.0).any(axis=1)]
    width, height = layout.overhead.size_px
    for name, box in layout.obstacles.items():
        if not name.startswith("chute "):
            continue
        points = box.T[:3, 3] + (grid * box.half_mm) @ box.T[:3, :3].T
        u, v = layout.overhead.project(points[points[:, 2] >= 0.0]).T
        assert not ((u > 0) & (u < width - 1) & (v > 0) & (v < height - 1)).any(), name


@pytest.mark.parametrize("turn_deg", [0.0, 35.0, 80.0, 125.0, 170.0])
def test_a_part_that_falls_from_the_fixed_gripper_comes_to_the_table(
    block: Solid, turn_deg: float
) -> None:
    layout, jaws = read_layout(CELL), JawModel()
    world = World(layout, [block], ParkedArm(), jaws, lambda *_: None, seed=1)
    try:
        jaws.opening_mm = 21.0
        world.advance(1.0 / 240.0)
        T = turn_z(math.radians(turn_deg))
        T[:3, 3] = layout.fixed_gripper.T_world_tcp[:3, 3]
        world.place(0, T)
        jaws.drive(0.0, 150.0, 60.0)
        world.advance(0.2)
        assert world.fixed_gripper.hold is not None
        world.lose_grasp("fixture")
        jaws.drive(85.0, 150.0, 60.0)
        assert world.settle(15.0)
        low, high = world.parts[0].bounds_mm
        area = load_cell(CELL).table.glowing_area
        assert abs(low[2]) < 0.01
        assert area.x[0] < low[0] < high[0] < area.x[1]
        assert area.y[0] < low[1] < high[1] < area.y[1]
        assert world.collisions == []
    finally:
        world.close()
