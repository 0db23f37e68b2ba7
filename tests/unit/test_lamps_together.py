"""Pictures of one scene under several lamps, judged as one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from recognise_bench import CAMERA, Files, Grey, backlit, front_lit, library, shape
from table_pictures import SIZE

from controller.cli import main
from controller.recognition import recognise
from controller.recognition.fitting import GreyMeasure, ModelEdgePoints
from controller.recognition.segmentation import brightest_of, segment


def half(which: int) -> shapely.Geometry:
    """What of the elbow one of two lamps lights: the other half is as grey as the table."""
    whole = shape(theta_rad=0.3)
    x0, y0, x1, y1 = whole.bounds
    middle = (x0 + x1) / 2
    return whole.intersection(shapely.box(*((x0, y0, middle, y1), (middle, y0, x1, y1))[which]))


def test_what_no_lamp_shows_alone_is_named_from_all_of_them() -> None:
    one, other = front_lit(half(0)), front_lit(half(1))
    for alone in (one, other):
        assert all(s.part is None for s in recognise(alone, CAMERA, library(), "front").sightings)
    (seen,) = recognise(one, CAMERA, library(), "front", lit=[other]).sightings
    (whole,) = recognise(front_lit(shape(theta_rad=0.3)), CAMERA, library(), "front").sightings
    assert seen.part == whole.part == "elbow"
    assert seen.pose_index == whole.pose_index
    assert np.hypot(seen.x_mm - whole.x_mm, seen.y_mm - whole.y_mm) < 0.1


def test_the_order_of_the_lamps_changes_no_name() -> None:
    one, other = front_lit(half(0)), front_lit(half(1))
    told = [
        recognise(first, CAMERA, library(), "front", lit=[second]).sightings
        for first, second in ((one, other), (other, one))
    ]
    names = [[(s.part, s.pose_index) for s in seen] for seen in told]
    assert names[0] == names[1]
    assert names[0][0][0] == "elbow"


def test_a_shadow_that_one_lamp_throws_is_no_thing() -> None:
    lit = np.full((240, 320), 90, np.uint8)
    shadowed = lit.copy()
    shadowed[60:160, 80:200] = 20
    assert (brightest_of([lit, shadowed]) == 90).all()


def test_a_dim_lamp_counts_as_much_as_a_bright_one() -> None:
    dim, bright = np.full((64, 64), 40, np.uint8), np.full((64, 64), 80, np.uint8)
    dim[:8, :8], bright[-8:, -8:] = 80, 160
    both = brightest_of([dim, bright])
    assert abs(int(both[0, 0]) - int(both[-1, -1])) <= 1
    assert both[0, 0] > both[32, 32]


@pytest.mark.parametrize("step", [4, 8])
def test_pictures_of_few_levels_make_one_of_few_levels(step: int) -> None:
    rng = np.random.default_rng(5)
    coarse = [(rng.integers(8, 200 // step, (64, 64)) * step).astype(np.uint8) for _ in range(3)]
    assert not (brightest_of(coarse) % step).any()


def test_an_edge_that_one_lamp_shows_is_found() -> None:
    blank = np.full((80, 80), 60, np.uint8)
    edged = blank.copy()
    edged[:, 40:] = 140
    at = np.column_stack([np.full(20, 39.5), np.linspace(20.0, 60.0, 20)])
    across = np.tile([1.0, 0.0], (20, 1))
    nothing = np.zeros(20)
    edges = ModelEdgePoints(np.zeros((20, 3)), at, across, nothing > 0, nothing, nothing + 9.0, 0.5)
    without = GreyMeasure(blank, (0, 0), is_lit=True)
    together = GreyMeasure(blank, (0, 0), is_lit=True, others=[blank, edged])
    assert np.isnan(without.gaps(at, across, edges, 3.0).gap_px).all()
    assert np.abs(together.gaps(at, across, edges, 3.0).gap_px).max() < 0.1
    # what a pose has to explain is what the first picture shows
    assert not together.own[0].any()


def test_a_light_table_is_cut_up_by_its_own_picture_whatever_the_lamps_show() -> None:
    table = backlit(shape(theta_rad=0.3))
    lit = [np.full(SIZE[::-1], 50, np.uint8), front_lit(half(0))]
    seen = recognise(table, CAMERA, library(), lit=lit)
    assert seen.segmentation.lighting == "backlit"
    (alone,) = segment(table, "backlit").regions
    assert np.array_equal(seen.traces[0].region.mask, alone.mask)


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def kept(files: Files) -> list[Path]:
    pictures: list[Grey] = [front_lit(half(0)), front_lit(half(1))]
    return [files.keep(f"a_{i}.png", one) for i, one in enumerate(pictures)]


def test_the_command_answers_once_for_each_scene(
    files: Files, capsys: pytest.CaptureFixture[str]
) -> None:
    kept(files)
    command = [*files.command(files.pictures), "--lighting", "front", "--lamps", "2"]
    assert main(command) == 0
    (told,) = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert (told["part"], told["images"]) == ("elbow", ["a_0.png", "a_1.png"])


def test_pictures_that_make_no_whole_scenes_are_refused_before_anything_is_compiled(
    files: Files, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*files.command(*kept(files)), "--lamps", "3"]) == 2
    assert "2 pictures cannot be divided into scenes of 3" in capsys.readouterr().err
