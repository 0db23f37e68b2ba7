"""Several parts in the emulated cell: none falls on another, and trays are emptied."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from emulators.in_process import Cell, CellOptions
from emulators.world import tray_of
from emulators.world.matter.parts import AWAY

ROOT = Path(__file__).parents[2]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"


@pytest.fixture(scope="module")
def blocks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("cad")
    paths = []
    for number, extents in enumerate([(70.0, 45.0, 20.0), (40.0, 40.0, 30.0), (60.0, 20.0, 20.0)]):
        paths.append(folder / f"block{number}.stl")
        trimesh.creation.box(extents).export(paths[-1])
    return tuple(paths)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_parts_rest_apart_from_each_other_on_the_table(
    blocks: tuple[Path, ...], seed: int, tmp_path: Path
) -> None:
    cell = Cell(CellOptions(cell=CELL, parts=(*blocks, blocks[0]), seed=seed), tmp_path)
    corners = [part.corners_mm for part in cell.world.parts]
    for k, own in enumerate(corners):
        assert own[:, 2].min() == pytest.approx(0.0, abs=0.2)  # none stands on another
        for other in corners[:k]:
            (low, high), (o, h) = (
                (c[:, :2].min(axis=0), c[:, :2].max(axis=0)) for c in (own, other)
            )
            assert (low > h).any() or (high < o).any()
    cell.world.close()


def test_the_first_part_is_where_it_is_without_the_others(
    blocks: tuple[Path, ...], tmp_path: Path
) -> None:
    poses = []
    for parts in (blocks[:1], blocks):
        cell = Cell(CellOptions(cell=CELL, parts=parts, seed=5), tmp_path)
        poses.append(cell.world.parts[0].T_world_part.copy())
        cell.world.close()
    np.testing.assert_allclose(poses[0], poses[1], atol=0.01)


def test_a_part_that_a_person_added_is_not_brought_again(
    blocks: tuple[Path, ...], tmp_path: Path
) -> None:
    """Whether it is in the cell, or still with whoever brings it."""
    cell = Cell(CellOptions(cell=CELL, parts=blocks[:1], seed=5, feed=(2,)), tmp_path)
    cell.faults.do("add", file=str(blocks[1]))
    cell._feed()
    assert cell.world.parts[1].state == AWAY
    cell.world.close()


@pytest.mark.parametrize("nests", [False, True])
def test_a_tray_without_nests_is_emptied_before_the_next_part_comes(
    blocks: tuple[Path, ...], nests: bool, tmp_path: Path
) -> None:
    text = CELL.read_text()
    line = "accept:     {centre: [100, 390], size: [150, 150]}"
    assert line in text
    if nests:
        more = "{centre: [100, 390], size: [150, 150], nests: {columns: 2, rows: 2}, walls_mm: 9}"
        text = text.replace(line, f"accept:     {more}")
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    cell = Cell(CellOptions(cell=file, parts=blocks[:2], seed=1), tmp_path)
    world, solid = cell.world, cell.world.parts[0].solid
    world.place(0, solid.pose_at_rest(solid.rests[0], 100.0, 390.0, 0.0))
    world.settle()
    cell._empty_trays()
    assert tray_of(world, 0) == "accept"  # the last one stays until the next one comes
    # the arm gripper takes the other block, across its width of 40 mm
    seat = world.arm_gripper.pads.seat(world.parts[1].scene, np.eye(4), 85.0)
    world.arm_gripper.capture(1, seat, np.eye(4), 40.0)
    cell._empty_trays()
    assert tray_of(world, 0) == ("accept" if nests else None)
    emptied = [(event.part, event.by) for event in world.events if event.what == "emptied"]
    assert emptied == ([] if nests else [(0, "accept")])
    walls = [box.name for box in cell.layout.obstacles if box.name.endswith("of accept")]
    assert len(walls) == (4 if nests else 0)
    world.close()


def fed_order(parts: tuple[Path, ...], seed: int, folder: Path) -> list[int]:
    """Return which parts come to the table, each once the one before it has left."""
    options = CellOptions(cell=CELL, parts=parts, seed=seed, feed=(2, 1, 3), on_table=1)
    cell = Cell(options, folder)
    world, order = cell.world, []
    while True:
        on_table = [part.index for part in world.parts if part.state != AWAY]
        if not on_table:
            break
        (index,) = on_table
        order.append(index)
        world.remove(index)  # out of a tray that was emptied
        cell._feed()
    world.close()
    return order


def test_parts_are_fed_in_the_order_that_the_seed_draws(
    blocks: tuple[Path, ...], tmp_path: Path
) -> None:
    orders = [fed_order(blocks, seed, tmp_path) for seed in (1, 1, 2)]
    # each lies there once of itself, and as often again as it is fed
    assert all(sorted(order) == [0, 0, 0, 1, 1, 2, 2, 2, 2] for order in orders)
    assert orders[0] == orders[1]
    assert len({tuple(order) for order in orders}) > 1


def test_without_a_limit_all_parts_lie_there_and_what_is_not_fed_stays_away(
    blocks: tuple[Path, ...], tmp_path: Path
) -> None:
    cell = Cell(CellOptions(cell=CELL, parts=blocks, seed=1, feed=(0, 1)), tmp_path)
    world = cell.world
    assert all(part.state != AWAY for part in world.parts)
    for index in (0, 1):
        solid = world.parts[index].solid
        world.place(index, solid.pose_at_rest(solid.rests[0], 100.0, 390.0, 0.0))
        world.settle()
        cell._feed()
        world.settle()
    assert [tray_of(world, index) for index in (0, 1, 2)] == ["accept", None, None]
    world.close()
