"""A table with an elbow on it, known on paper, and the files `cellctl` needs for it."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import shapely
from cad_solids import Body, box, prism, rod, solid_of
from numpy.typing import NDArray
from table_pictures import overhead, picture, resting, silhouette

from controller.cad import Solid
from controller.cad.compiled import compile_solid
from controller.imaging import Camera
from controller.recognition import Library, make_library

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
CAMERA = overhead()

ELBOW = [(0, 0), (60, 0), (60, 18), (22, 18), (22, 42), (0, 42)]
SIDES_MM = (60, 18, 38, 24, 22, 42)  # in that order, anticlockwise
HOLE_MM = 4.0


def elbow() -> Body:
    outline = [(float(x), float(y)) for x, y in ELBOW]
    return prism(outline, 8) - rod(HOLE_MM, 40, 48).translate((45, 9, 0))


@cache
def solids() -> dict[str, Solid]:
    return {"elbow": solid_of(elbow(), "elbow"), "block": solid_of(box(50, 30, 20), "block")}


@cache
def library() -> Library:
    return make_library([compile_solid(s) for s in solids().values()], CAMERA)


def shape(x_mm: float = 10.0, y_mm: float = -5.0, theta_rad: float = 0.0) -> shapely.Geometry:
    """What the elbow covers of the picture, lying on its large face with the hole at the right."""
    T = resting(solids()["elbow"], np.eye(3), x_mm, y_mm, theta_rad)
    return silhouette(solids()["elbow"].mesh, T, CAMERA)


def backlit(*shapes: shapely.Geometry) -> Grey:
    return picture(list(shapes))


def front_lit(*shapes: shapely.Geometry) -> Grey:
    return picture(list(shapes), ground=40.0, dark=170.0)


def small_camera() -> Camera:
    """The same camera with pixels 5 wide and 4 high, as the paper's digitiser had them."""
    K = np.diag([1 / 5, 1 / 4, 1.0]) @ CAMERA.K
    K[:2, 2] = (CAMERA.K[0, 2] + 0.5) / 5 - 0.5, (CAMERA.K[1, 2] + 0.5) / 4 - 0.5
    return Camera((160, 160), K, CAMERA.distortion, CAMERA.T_world_cam)


def small(grey: Grey) -> Grey:
    return np.asarray(cv2.resize(grey, (160, 160), interpolation=cv2.INTER_AREA), np.uint8)


class Files:
    """A folder with a calibration and the elbow's CAD file."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.calibration = folder / "camera.json"
        self.part = folder / "elbow.stl"
        self.pictures = folder / "pictures"
        self.pictures.mkdir()
        self.calibration.write_text(
            json.dumps(
                {
                    "size_px": list(CAMERA.size_px),
                    "K": CAMERA.K.tolist(),
                    "distortion": CAMERA.distortion.tolist(),
                    "T_world_cam": CAMERA.T_world_cam.tolist(),
                }
            )
        )
        solids()["elbow"].mesh.export(self.part)

    def keep(self, name: str, stored: NDArray[np.generic]) -> Path:
        path = self.pictures / name
        assert cv2.imwrite(str(path), stored)
        return path

    def command(self, *images: Path | str, json_lines: bool = True) -> list[str]:
        asked = ["recognise", *map(str, images), "--parts", str(self.part)]
        asked += ["--calibration", str(self.calibration)]
        return [*asked, "--json"] if json_lines else asked
