"""What a person is shown of a finding: the prediction against pictures made without it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from controller.cad import Solid
from controller.cad.solid import make_solid
from controller.config import load_cell
from controller.imaging import Camera, RayCaster
from controller.results.review import FindingCrops, border_in
from controller.results.review.place import place_drawing
from controller.results.review.prediction import PredictedPiece, Predictor
from controller.results.run import FindingReport, ViewReport
from controller.setup.optics import build_camera

ROOT = Path(__file__).resolve().parents[2]
CELL = load_cell(ROOT / "recipes" / "cells" / "emulated.yaml")
SETTINGS = CELL.model_dump(mode="json")
SIZE_MM = (60.0, 20.0, 50.0)
STATION = np.array([430.0, 0.0, 450.0])
FRONT_Y_MM = -10.0  # of the block at the station: its face towards the camera
DARK, BRIGHT = 18, 205


@pytest.fixture(scope="module")
def block() -> Solid:
    return make_solid(trimesh.creation.box(SIZE_MM), "block", "0" * 64, "the test")


@pytest.fixture(scope="module")
def camera() -> Camera:
    return build_camera(CELL.cameras.inspection)


def shown(T_world_part: NDArray[np.float64] | None = None) -> ViewReport:
    pose = np.eye(4) if T_world_part is None else T_world_part
    if T_world_part is None:
        pose[:3, 3] = STATION
    return ViewReport("V1", {}, True, T_world_part=tuple(map(tuple, pose.tolist())))


def outline_px(camera: Camera) -> NDArray[np.int32]:
    """Return the block's outline by its corners alone: it is convex."""
    half = np.array(SIZE_MM) / 2
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    pixels = camera.project(corners + STATION).astype(np.float32)
    return np.round(cv2.convexHull(pixels)).astype(np.int32)


def test_before_the_backlight_a_shadow_is_predicted(block: Solid, camera: Camera) -> None:
    picture = np.full((1024, 1280), BRIGHT, np.uint8)
    cv2.fillPoly(picture, [outline_px(camera)], DARK)
    inside = cv2.erode((picture == DARK).astype(np.uint8), np.ones((9, 9))) > 0
    x, y, w, h = cv2.boundingRect(outline_px(camera))
    # a bite is missing of the part: the picture is bright there, the prediction is not
    picture[y + 20 : y + 40, x + 30 : x + 60] = BRIGHT
    window = (x - 30, y - 30, x + w + 30, y + h + 30)
    found = Predictor(block, SETTINGS).predict(shown(), "station_backlight", picture, window)
    assert isinstance(found, PredictedPiece)
    assert found.known.all()
    x0, y0, x1, y1 = window
    assert np.abs(found.level[inside[y0:y1, x0:x1]] - DARK).max() < 1.0
    beside = cv2.dilate((picture == DARK).astype(np.uint8), np.ones((9, 9))) == 0
    assert np.abs(found.level[beside[y0:y1, x0:x1] & ~inside[y0:y1, x0:x1]] - BRIGHT).max() < 1.0


def front_lit(camera: Camera) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """Return the block's front under the side lamp, by Lambert's law alone, and where it is."""
    lines = camera.sight_line_table.astype(float)
    depth = (STATION[1] + FRONT_Y_MM - camera.position_mm[1]) / lines[..., 1]
    points = camera.position_mm + lines * depth[..., None]
    off = np.abs(points - STATION)
    on = (off[..., 0] < SIZE_MM[0] / 2 - 0.5) & (off[..., 2] < SIZE_MM[2] / 2 - 0.5)
    towards = np.array(CELL.lamps["station_side"].centre) - points
    distance = np.linalg.norm(towards, axis=-1)
    cosine = -towards[..., 1] / distance  # the face looks along -y
    light = cosine * (650.0 / distance) ** 2
    return np.where(on, np.clip(12 + 170 * light, 0, 255), 5).astype(np.uint8), on


def test_under_a_lamp_the_scale_is_found_in_spite_of_what_differs(
    block: Solid, camera: Camera
) -> None:
    picture, on = front_lit(camera)
    rows, columns = np.nonzero(on)
    x, y = int(columns.mean()), int(rows.mean())
    clean = picture.copy()
    cv2.circle(picture, (x + 20, y), 12, 250, -1)  # a highlight
    cv2.circle(picture, (x - 20, y), 12, 20, -1)  # a stain
    window = (x - 60, y - 60, x + 60, y + 60)
    found = Predictor(block, SETTINGS).predict(shown(), "station_side", picture, window)
    assert isinstance(found, PredictedPiece)
    there = clean[y - 60 : y + 60, x - 60 : x + 60].astype(float)
    assert clean[on].min() + 10 < clean[on].max()  # the light falls off over the face
    assert np.abs(found.level - there).max() < 3.0


def test_what_cannot_be_predicted_is_said(block: Solid, camera: Camera) -> None:
    picture = np.zeros((1024, 1280), np.uint8)
    window = (600, 500, 700, 600)
    found = Predictor.of(block, SETTINGS)
    assert isinstance(found, Predictor)
    away = np.eye(4)
    away[:3, 3] = (430.0, 0.0, 2000.0)
    unposed = ViewReport("V1", {}, False)
    assert "pose" in str(found.predict(unposed, "station_ring", picture, window))
    assert "out of this picture" in str(found.predict(shown(away), "station_ring", picture, window))
    assert "no lamp" in str(found.predict(shown(), "station_disco", picture, window))
    assert "size" in str(found.predict(shown(), "station_ring", picture[:500], window))
    assert Predictor.of("the file is gone", SETTINGS) == "the file is gone"
    assert "another version" in str(Predictor.of(block, {"name": "old"}))


@pytest.mark.parametrize(
    ("place", "side"),
    [((0.0, -10.0, 0.0), "front"), ((0.0, 10.0, 0.0), "back"), ((30.0, 0.0, 0.0), "right")],
)
def test_the_place_is_drawn_from_the_side_that_shows_it(
    block: Solid, place: tuple[float, float, float], side: str
) -> None:
    image = place_drawing(block, RayCaster(block.mesh), np.array(place), 480)
    assert image.shape == (384, 480, 3)
    mark = (image[..., 2].astype(int) - image[..., 0]) > 100  # the cross alone has a colour
    assert mark.sum() > 200
    rows, columns = np.nonzero(mark)
    # the middle of a face is in the middle of the part as drawn from there, about
    assert abs(columns.mean() - 240) < 100
    assert abs(rows.mean() - 192) < 80


def test_a_small_finding_is_framed_with_room_and_a_large_one_by_its_border() -> None:
    def framed(box: tuple[int, int, int, int], *border: tuple[float, float]) -> NDArray[np.float64]:
        finding = FindingReport(
            1, "V1", "pit", "station_ring", None, 1.0, None, box, (0.0, 0.0, 0.0), (),
            outline_px=border,
        )  # fmt: skip
        found = FindingCrops(finding, shown(), "a.png", "station_ring", (100, 100, 300, 260))
        return np.array(border_in(found)) * (200, 160) + (100, 100)

    small = framed((200, 180, 204, 184), (200.0, 180.0), (204.0, 184.0), (200.0, 184.0))
    np.testing.assert_allclose(small.mean(axis=0), (202, 182))
    assert np.ptp(small[:, 0]) == pytest.approx(32)
    border = ((150.0, 150.0), (250.0, 150.0), (250.0, 220.0))
    np.testing.assert_allclose(framed((150, 150, 250, 220), *border), np.array(border) + 0.5)
