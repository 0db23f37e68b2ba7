"""`cellctl recognise`: stored pictures of the table, one answer per object."""

import time
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.cad import Camera
from controller.cad.compiled import is_cad_file, load_part, options_among, part_name
from controller.cad.reading import FORMATS
from controller.config import ConfigError
from controller.recognition import Sighting, make_library, recognise

from ._calibration_file import load_calibration
from ._output import emit, say

Grey = NDArray[np.uint8]
Lighting = Literal["backlit", "front", "auto"]


def recognise_images(
    images: list[Path],
    parts: list[Path],
    calibration: Path,
    lighting: Lighting,
    *,
    unit: str | None,
    as_json: bool,
) -> int:
    """Recognise what lies in each picture; 1 if a picture shows nothing known."""
    camera = load_calibration(calibration)
    files = _cad_files(parts)
    library = make_library([load_part(p, options_among(p, unit)) for p in files], camera)
    known = 0
    for path in images:
        picture = _read(path, camera)
        started = time.monotonic()
        sightings = recognise(picture, camera, library, lighting).sightings
        seconds = (time.monotonic() - started) / max(1, len(sightings))
        if not sightings and not as_json:
            say(f"{path.name}: nothing on the table")
        for sighting in sightings:
            known += sighting.part is not None
            body = _answer(path, sighting, seconds)
            if as_json:
                emit(body)
            else:
                say(_sentence(body))
    return 0 if known else 1


def _cad_files(parts: list[Path]) -> list[Path]:
    found: list[Path] = []
    for path in parts:
        found += _parts_in(path) if path.is_dir() else [path]
    if not found:
        raise ConfigError(f"--parts {', '.join(map(str, parts))}: no CAD file there")
    return found


def _parts_in(folder: Path) -> list[Path]:
    """Return a folder's CAD files, one a part: the quickest to read where it is there twice."""
    files = sorted(
        (file for file in folder.iterdir() if is_cad_file(file)),
        key=lambda file: (part_name(file), FORMATS.index(file.suffix.lower())),
    )
    return [next(same) for _, same in groupby(files, part_name)]


def _read(path: Path, camera: Camera) -> Grey:
    if not path.is_file():
        raise ConfigError(f"{path}: no such picture")
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ConfigError(f"{path}: is no picture that can be read (PNG, JPEG, TIFF)")
    width, height = camera.size_px
    if picture.shape != (height, width):
        raise ConfigError(
            f"{path}: {picture.shape[1]} x {picture.shape[0]} px, the calibration is for "
            f"{width} x {height} px"
        )
    return np.asarray(picture, dtype=np.uint8)


def _answer(path: Path, s: Sighting, seconds: float) -> dict[str, Any]:
    return {
        "image": path.name,
        "part": s.part,
        "stable_pose_R": None if s.R is None else s.R.tolist(),
        "x_mm": s.x_mm,
        "y_mm": s.y_mm,
        "theta_deg": float(np.degrees(s.theta_rad)),
        "score": s.score,
        "ambiguous_with": [
            {
                "part": a.part,
                "pose_index": a.pose_index,
                "theta_deg": float(np.degrees(a.theta_rad)),
            }
            for a in s.ambiguous_with
        ],
        "reason": s.reason,
        "seconds": seconds,
    }


def _sentence(body: dict[str, Any]) -> str:
    where = f"x {body['x_mm']:.1f} mm, y {body['y_mm']:.1f} mm"
    if body["part"] is None:
        return f"{body['image']}: unknown object at {where}: {body['reason']}"
    also = f"; could also be {len(body['ambiguous_with'])} others" if body["ambiguous_with"] else ""
    return (
        f"{body['image']}: {body['part']} at {where}, {body['theta_deg']:.1f} deg, "
        f"score {body['score']:.3f}{also}"
    )
