"""A small set of views on the disk: the block of `shown_part` in a gripper, three times."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from cad_solids import Body, mesh_of
from numpy.typing import NDArray
from shown_part import CAMERA, LAMPS, hand, perfect, photograph, shown

from controller.inspection import ViewPictures, WorldBox

Array = NDArray[np.float64]
POSES = {"v00": shown(8, 6), "v01": shown(20, 12, 5), "v02": shown(-25, -8, 10)}


@cache
def pictures(body: str = "perfect") -> dict[str, ViewPictures]:
    """The pictures of all views; of a bare block by another name."""
    from shown_part import blank

    real: Body = perfect() if body == "perfect" else blank()
    return {name: photograph(real, T, hand(T)) for name, T in POSES.items()}


def rows(T: Array) -> list[list[float]]:
    return [[float(x) for x in row] for row in T]


def view(name: str, T: Array, boxes: tuple[WorldBox, ...] | None = None) -> dict[str, Any]:
    held = hand(T) if boxes is None else boxes
    return {
        "id": name,
        "T_world_part": rows(T),
        "prior_mm": 1.5,
        "prior_deg": 1.7,
        "gripper_boxes": [{"T": rows(b.T), "half_mm": b.half_mm.tolist()} for b in held],
        "pictures": {
            "backlight": f"{name}_backlight.png",
            "ring": f"{name}_ring.png",
            "side": f"{name}_side.png",
        },
    }


def tree() -> dict[str, Any]:
    """The set as its file has it; a fresh one for each call."""
    return {
        "schema": "cellctl.views/1",
        "part": "shown.stl",
        "unit": "mm",
        "camera": {
            "size_px": list(CAMERA.size_px),
            "K": rows(CAMERA.K),
            "distortion": CAMERA.distortion.tolist(),
            "T_world_cam": rows(CAMERA.T_world_cam),
        },
        "lamps": {
            "backlight": {
                "kind": "panel",
                "centre": [0.0, 250.0, 0.0],
                "normal": [0.0, -1.0, 0.0],
                "up": [0.0, 0.0, 1.0],
                "size": [350.0, 290.0],
            },
            "ring": {"kind": "ring", "centre": [0.0, -690.0, 0.0], "radius": 60.0},
            "side": {"kind": "spot", "centre": LAMPS[1].points_mm[0].tolist()},
        },
        "views": [view(name, T) for name, T in POSES.items()],
    }


def write(folder: Path, body: dict[str, Any] | None = None, real: str = "perfect") -> Path:
    """Write part, pictures and set; return the set's file."""
    folder.mkdir(parents=True, exist_ok=True)
    mesh_of(perfect()).export(folder / "shown.stl")
    for name, shots in pictures(real).items():
        for lamp, picture in {"backlight": shots.backlit, **shots.lit}.items():
            cv2.imwrite(str(folder / f"{name}_{lamp}.png"), picture)
    path = folder / "SET.json"
    path.write_text(json.dumps(tree() if body is None else body), encoding="utf-8")
    return path
