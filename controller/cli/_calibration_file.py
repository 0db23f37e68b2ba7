"""The calibration file: a camera, and how it was come by. Both sides of one format.

Asked when read are size_px, K, distortion and T_world_cam alone, so that a file written by hand or
by another program does as well.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller.cad import Camera
from controller.config import ConfigError
from controller.recognition.calibration import PARAMETERS, Calibration, Placed


def load_calibration(path: Path) -> Camera:
    """Read a camera from JSON: size_px, K, distortion, T_world_cam.

    Raises
    ------
    ConfigError : missing, or not such a file
    """
    try:
        body = json.loads(path.read_text(encoding="utf-8"))
        width, height = body["size_px"]
        K = np.array(body["K"], dtype=float).reshape(3, 3)
        distortion = np.array(body["distortion"], dtype=float).reshape(5)
        T = np.array(body["T_world_cam"], dtype=float).reshape(4, 4)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; check the path") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{path}: no camera calibration ({type(error).__name__}: {error}); asked are size_px "
            "[width, height], K (3 x 3), distortion (5) and T_world_cam (4 x 4)"
        ) from error
    if not (np.isfinite(K).all() and np.isfinite(distortion).all() and np.isfinite(T).all()):
        raise ConfigError(f"{path}: the calibration holds values that are no numbers")
    return Camera((int(width), int(height)), K, distortion, T)


def write_calibration(path: Path, body: Mapping[str, Any]) -> None:
    """Write what `calibration_body` returns.

    Raises
    ------
    ConfigError : the file cannot be written
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(body, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def calibration_body(found: Calibration) -> dict[str, Any]:
    """Return what the file says of a calibration: lengths in mm, angles in deg."""
    camera = found.camera
    placed = [view.placed for view in found.views]
    return {
        "size_px": list(camera.size_px),
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "T_world_cam": camera.T_world_cam.tolist(),
        "counts": {
            "boards": len(placed),
            "flat": placed.count(Placed.FLAT),
            "tilted": placed.count(Placed.TILTED),
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
