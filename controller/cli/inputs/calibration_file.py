"""The calibration file, written and read: a camera, and the data of its calibration.

Only size_px, K, distortion and T_world_cam are required, so a file written by hand or by another
program is enough.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller.arrays import FloatArray
from controller.calibration.camera import PARAMETERS, CalibratedCamera, PlacedBoard
from controller.config import ConfigError
from controller.config.cell import MAX_HEIGHT_MM, MIN_HEIGHT_MM
from controller.config.files import parse_json, read_text
from controller.imaging import Camera
from controller.stored.pictures import MAX_PIXELS

MAX_BYTES = 16 * 2**20  # a calibration from hundreds of pictures lists each of them


def load_calibration(path: Path) -> Camera:
    """Return a camera read from JSON: size_px, K, distortion, T_world_cam.

    Raises
    ------
    ConfigError : the file is missing or is no calibration
    """
    body = parse_json(read_text(path, "a calibration", MAX_BYTES), path, "a calibration")
    try:
        width, height = (_count(number) for number in body["size_px"])
        K = _numbers(body, "K", 3, 3)
        distortion = _numbers(body, "distortion", 5)
        T = _numbers(body, "T_world_cam", 4, 4)
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ConfigError(
            f"{path}: no camera calibration ({type(error).__name__}: {error!s:.120}); required "
            "are size_px [width, height], K (3 x 3), distortion (5) and T_world_cam (4 x 4)"
        ) from error
    _check(path, (width, height), K, T)
    return Camera((width, height), K, distortion, T)


def _numbers(body: Mapping[str, Any], key: str, *shape: int) -> FloatArray:
    """Return the numbers of a key; raise ValueError, which names the key, if they are wrong."""
    try:
        return np.array(body[key], dtype=float).reshape(shape)
    except ValueError:
        size = " x ".join(map(str, shape))
        raise ValueError(
            f"`{key}` is not {size} numbers; a decimal comma would make two of one"
        ) from None


def _count(number: object) -> int:
    """Return a number of pixels; raise ValueError if it is not one."""
    if isinstance(number, bool) or not isinstance(number, int | float) or number != int(number):
        raise ValueError(f"size_px of {number!r:.40}")
    return int(number)


def _check(path: Path, size_px: tuple[int, int], K: FloatArray, T: FloatArray) -> None:
    """Raise ConfigError unless the numbers describe a camera above the table."""
    width, height = size_px
    if not (width > 0 and height > 0 and width * height <= MAX_PIXELS):
        raise ConfigError(f"{path}: `size_px`: no camera has {width} x {height} px")
    if min(K[0, 0], K[1, 1]) <= 0 or not np.array_equal(K[2], [0, 0, 1]):
        raise ConfigError(f"{path}: `K`: focal lengths must be positive, and the last row 0 0 1")
    R = T[:3, :3]
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
        raise ConfigError(
            f"{path}: `T_world_cam`: not a pose: its axes must be orthogonal, "
            "right-handed and of length 1"
        )
    if not MIN_HEIGHT_MM <= T[2, 3] <= MAX_HEIGHT_MM:
        raise ConfigError(
            f"{path}: `T_world_cam`: the camera would stand {T[2, 3]:g} mm above the table; "
            "lengths are in millimetres"
        )


def write_calibration(path: Path, body: Mapping[str, Any]) -> None:
    """Write the result of `calibration_body`.

    Raises
    ------
    ConfigError : the file cannot be written
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(body, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def calibration_body(found: CalibratedCamera) -> dict[str, Any]:
    """Return a calibration in the file's format: lengths in mm, angles in degrees."""
    camera = found.camera
    placed = [view.placed for view in found.views]
    return {
        "size_px": list(camera.size_px),
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "T_world_cam": camera.T_world_cam.tolist(),
        "counts": {
            "boards": len(placed),
            "flat": placed.count(PlacedBoard.FLAT),
            "tilted": placed.count(PlacedBoard.TILTED),
            "corners": sum(view.corner_count for view in found.views),
            "outliers": sum(view.outlier_count for view in found.views),
        },
        "residuals": {
            "rms_px": found.rms_px,
            "noise_px": found.noise_px,
            "views": [
                {
                    "image": view.name,
                    "placed": view.placed.value,
                    "tilt_deg": float(np.degrees(view.tilt_rad)),
                    "corners": view.corner_count,
                    "outliers": view.outlier_count,
                    "rms_px": view.rms_px,
                    "worst_px": view.worst_px,
                }
                for view in found.views
            ],
        },
        "uncertainty": {
            "std": {name: found.std.get(name) for name in PARAMETERS},
            "held_at_0": {name: float(std) for name, std in found.held_std.items()},
            "position_mm": camera.position_mm.tolist(),
            "position_std_mm": found.position_std_mm.tolist(),
            "tilt_deg": float(np.degrees(found.tilt_rad)),
            "tilt_std_deg": float(np.degrees(found.tilt_std_rad)),
            "table": [
                {
                    "z_mm": plane.height_mm,
                    "worst_std_mm": plane.worst_mm,
                    "worst_at_px": list(plane.worst_at_px),
                    "covered_worst_std_mm": plane.covered_worst_mm,
                    "median_std_mm": plane.median_mm,
                }
                for plane in found.table
            ],
            "focal_height_correlation": found.focal_height_correlation,
            "condition": found.condition,
            "coverage": found.coverage,
        },
        "world": {
            "image": found.world.name,
            "origin_mm": list(found.world.origin_mm),
            "x_axis_angle_deg": float(np.degrees(found.world.x_axis_angle_rad)),
        },
    }
