"""The explanation of an answer: its tables hold what is known on paper, its drawing shows it."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pytest
import shapely
from cad_solids import box, solid_of
from numpy.typing import NDArray
from recognise_bench import (
    CAMERA,
    Grey,
    backlit,
    front_lit,
    library,
    shape,
    small,
    small_camera,
)
from table_pictures import resting, silhouette

from controller.cad.compiled import compile_solid
from controller.recognition import make_library, recognise
from controller.recognition.explain import Explanation, StageTable, explain
from controller.recognition.explain.draw import GREEN, ORANGE, PINK, RED, SKY, SOFT, WHITE, YELLOW

Array = NDArray[np.float64]
OVERVIEW_PX = (1280, 1600)  # twice the picture's 640 x 800


@cache
def plain() -> tuple[Grey, Explanation]:
    grey = backlit(shape())
    return grey, explained(grey)


def explained(grey: Grey, title: str = "") -> Explanation:
    return explain(grey, CAMERA, library(), recognise(grey, CAMERA, library()), title)


def table(told: Explanation, words: str) -> StageTable:
    (found,) = (t for t in told.tables if words in t.title)
    return found


def column(t: StageTable, heading: str) -> list[object]:
    k = t.columns.index(heading)
    return [row[k] for row in t.rows]


def has_colour(
    picture: NDArray[np.uint8], colour: tuple[int, int, int], least: int = 20, near: int = 40
) -> bool:
    # thin lines are drawn smooth, so that some of what lies below shows through
    off = np.abs(picture.astype(int) - np.array(colour)).max(axis=2)
    return int((off <= near).sum()) >= least


def below(told: Explanation) -> NDArray[np.uint8]:
    """Return the rows of the objects, below the picture and the legend."""
    empty = explained(backlit())
    return told.picture[len(empty.picture) :]


def on_table(outline: shapely.Geometry) -> shapely.Polygon:
    def taken(ring: shapely.LinearRing) -> Array:
        return CAMERA.on_plane(np.asarray(ring.coords))[:, :2]

    return shapely.Polygon(taken(outline.exterior), [taken(r) for r in outline.interiors])


def test_size_and_survivors_of_an_object_are_told() -> None:
    _, told = plain()
    objects = table(told, "objects:")
    (row,) = objects.rows
    shadow = on_table(shape())
    assert column(objects, "area [mm2]")[0] == pytest.approx(shadow.area, rel=0.01)
    assert column(objects, "holes") == [1]
    assert column(objects, "cut by edge") == ["no"]
    assert row[-1] == "elbow"
    library_ = table(told, "library:")
    survivors = [column(library_, h)[0] for h in ("views in library", "candidates", "fitted")]
    assert survivors == sorted(survivors, reverse=True)  # type: ignore[type-var]
    assert survivors[-1] >= 1  # type: ignore[operator]


def test_the_right_candidate_overlaps_most() -> None:
    _, told = plain()
    candidates = table(told, "candidates by silhouette")
    assert column(candidates, "part")[0] == "elbow"
    overlaps = column(candidates, "overlap")
    assert overlaps == sorted(overlaps, reverse=True)  # type: ignore[type-var]


def test_the_hypothesis_that_was_taken_and_the_decision_agree() -> None:
    grey, told = plain()
    (seen,) = recognise(grey, CAMERA, library()).sightings
    fitted = table(told, "fitted hypotheses")
    assert column(fitted, "taken").count("yes") == 1
    best = column(fitted, "taken").index("yes")
    assert column(fitted, "part")[best] == seen.part == "elbow"
    assert column(fitted, "pose")[best] == seen.pose_index
    # nothing else looks the same, so that it need not share its score
    assert column(fitted, "score alone")[best] == pytest.approx(seen.score)
    decision = dict(table(told, "decision").rows)
    assert decision["answer"] == f"elbow, stable pose {seen.pose_index}"
    assert decision["score"] == f"{seen.score:.3f}"
    assert decision["ambiguous with"] == "nothing else"


def test_readings_that_look_the_same_are_told_and_share_the_score() -> None:
    # a block with a pocket that the light does not reach: four ways to lie with one outline
    body = box(50, 30, 20) - box(20, 10, 4).translate((10, 5, 9))
    pocket = solid_of(body, "pocket")
    parts = make_library([compile_solid(pocket)], CAMERA)
    lies = silhouette(pocket.mesh, resting(pocket, np.eye(3), 10, 20, 0.4), CAMERA)
    grey = backlit(lies)
    seen = recognise(grey, CAMERA, parts)
    told = explain(grey, CAMERA, parts, seen)
    others = str(dict(table(told, "decision").rows)["ambiguous with"]).split("; ")
    assert len(others) == 3
    assert all(other.startswith("pocket, pose ") for other in others)
    fitted = table(told, "fitted hypotheses")
    alone = np.array(column(fitted, "score alone"), dtype=float)
    assert (alone > 0.9).sum() == 4
    # four readings share the score; by how much the first is ahead is the picture's noise
    assert alone.max() / 4 - 1e-9 <= seen.sightings[0].score < alone.max() / 2


def test_segmentation_is_told_with_its_threshold() -> None:
    _, told = plain()
    rows = dict(table(told, "segmentation").rows)
    assert rows["lighting"] == "backlit"
    assert rows["histogram"] == "two humps"
    # the picture was made with 210 and 18
    assert rows["table's level"] == "210 of 255"
    assert 18 < int(str(rows["threshold"])) < 210


def test_every_cell_is_a_plain_value_and_rows_are_as_wide_as_the_heading() -> None:
    _, told = plain()
    for t in told.tables:
        assert len(t.columns) == len(t.decimals)
        for row, text in zip(t.rows, t.text_rows(), strict=True):
            assert len(row) == len(text) == len(t.columns)
            assert all(type(cell) in {str, int, float, type(None)} for cell in row)


def test_the_drawing_is_coloured_along_the_contour_and_grey_elsewhere() -> None:
    grey, told = plain()
    height, width = OVERVIEW_PX
    overview = told.picture[:height, :width].astype(int)
    colour = np.ptp(overview, axis=2)
    u, v = np.asarray(shape().exterior.segmentize(2.0).coords).T
    across = np.round((u + 0.5) * 2 - 0.5).astype(int)
    down = np.round((v + 0.5) * 2 - 0.5).astype(int)
    assert (colour[down, across] > 60).mean() > 0.95
    # a corner of the table without anything: grey, and as even as the input
    assert colour[:200, :200].max() == 0
    assert np.ptp(overview[:200, :200]) < np.ptp(grey[:100, :100]) + 4


def test_each_kind_of_mark_has_its_colour_below_the_picture() -> None:
    _, told = plain()
    details = below(told)
    for colour in (GREEN, YELLOW):
        assert has_colour(details, colour)
    assert not has_colour(details, RED, near=15)  # every edge is where it should be


def test_missed_edges_of_what_came_nearest_are_drawn_in_their_colour() -> None:
    right = shape().bounds[2]
    told = explained(backlit(shape().difference(shapely.box(right - 25, 0, right + 5, 700))))
    objects = table(told, "objects:")
    assert column(objects, "answer") == ["unknown"]
    assert "none of the known parts" in str(dict(table(told, "decision").rows)["why"])
    assert column(table(told, "fitted hypotheses"), "taken").count("yes") == 0
    assert has_colour(below(told), RED)


def test_a_part_that_reaches_beyond_the_picture_is_framed_and_said_to_be_cut() -> None:
    told = explained(backlit(shape(x_mm=100.0)))
    assert column(table(told, "objects:"), "cut by edge") == ["yes"]
    height, width = OVERVIEW_PX
    assert has_colour(told.picture[:height, :width], RED, 100)
    assert "partly outside" in str(dict(table(told, "decision").rows)["why"])


def test_under_lamps_grey_edges_are_told_and_drawn() -> None:
    told = explained(front_lit(shape(theta_rad=0.4)))
    assert dict(table(told, "segmentation").rows)["lighting"] == "front"
    figures = dict(table(told, "grey edges").rows)
    rim_mm = shape(theta_rad=0.4).length * CAMERA.mm_per_px(np.zeros(3))
    assert figures["their length [mm]"] == pytest.approx(rim_mm, rel=0.15)
    assert figures["pieces of edges"] > rim_mm / 2  # type: ignore[operator]
    assert has_colour(below(told), SKY)


# Machado, Oliveira and Fernandes 2009: what linear red, green and blue become to the eye
PROTANOPE = [
    [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
]  # fmt: skip
DEUTERANOPE = [
    [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]  # fmt: skip


@pytest.mark.parametrize("eye", [np.eye(3).tolist(), PROTANOPE, DEUTERANOPE])
def test_marks_of_one_panel_differ_for_every_eye(eye: list[list[float]]) -> None:
    panels = [
        (WHITE, YELLOW, SKY, PINK, ORANGE, GREEN),
        (WHITE, SOFT, YELLOW, GREEN, RED),
        (YELLOW, ORANGE, PINK, SKY),
    ]
    for panel in panels:
        rgb = np.array(panel)[:, ::-1] / 255
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        seen = np.clip(linear @ np.array(eye).T, 0, 1).astype(np.float32)
        lab = cv2.cvtColor(seen[None], cv2.COLOR_LRGB2LAB)[0]
        apart = np.linalg.norm(lab[:, None] - lab[None], axis=2)
        # 2.3 is what is just noticed side by side (CIELAB)
        assert apart[~np.eye(len(panel), dtype=bool)].min() > 20


def test_an_empty_table_is_explained_too() -> None:
    told = explained(backlit())
    assert len(told.tables) == 3
    assert table(told, "objects:").rows == ()
    height, width = OVERVIEW_PX
    assert told.picture.shape[1] == width
    legend = told.picture[height:]
    assert len(legend) < 120
    for colour in (YELLOW, GREEN, RED):
        assert has_colour(legend, colour)


def test_small_pictures_are_enlarged_to_their_true_proportions() -> None:
    camera = small_camera()
    parts = library()
    grey = small(backlit(shape()))
    seen = recognise(grey, camera, parts)
    told = explain(grey, camera, parts, seen)
    height, width = told.picture.shape[:2]
    # pixels 5 wide and 4 high, of which there are 160 x 160
    assert column(table(told, "objects:"), "answer") == ["elbow"]
    tall = width * 4 / 5
    assert tall % 160 == 0
    assert 700 < tall < 1300
    assert height > tall


def test_explaining_changes_nothing_and_gives_the_same_twice() -> None:
    grey, told = plain()
    before = grey.copy()
    again = explained(grey)
    assert np.array_equal(grey, before)
    assert np.array_equal(told.picture, again.picture)
    assert told.tables == again.tables


def test_a_picture_of_another_camera_is_refused() -> None:
    grey, _ = plain()
    seen = recognise(grey, CAMERA, library())
    with pytest.raises(ValueError, match="800, 640"):
        explain(grey[:100], CAMERA, library(), seen)
