"""Several parts in the emulated cell: none falls on another, and trays are emptied."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from emulators.in_process import Cell, CellOptions

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
