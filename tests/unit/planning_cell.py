"""The emulated cell's file as a `CellLayout`, for the planner's tests and its benchmark."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML

from controller.imaging import Camera
from controller.planning import Box, CellLayout, Jaw, Tray
from drivers.umi_scara import ArmGeometry, UmiModel

ROOT = Path(__file__).resolve().parents[2]
CELL_FILE = ROOT / "recipes" / "cells" / "emulated.yaml"
PARTS = ROOT / "recipes" / "parts"


def pose(entry: Any) -> np.ndarray:
    T = np.eye(4)
    x, y = np.array(entry["x_axis"], float), np.array(entry["y_axis"], float)
    T[:3, :4] = np.column_stack([x, y, np.cross(x, y), np.array(entry["position"], float)])
    return T


def camera(entry: Any) -> Camera:
    f, (cx, cy) = entry["focal_px"], entry["centre_px"]
    K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1.0]])
    width, height = entry["size_px"]
    return Camera((width, height), K, np.array(entry["distortion"], float), pose(entry["pose"]))


def jaw(body: Any, fingers: Any, max_mm: float) -> Jaw:
    return Jaw(
        tuple(Box.from_bounds(*b) for b in body.values()),
        fingers["length_mm"],
        fingers["width_mm"],
        fingers["thickness_mm"],
        fingers["pad_length_mm"],
        max_mm,
    )


def read_cell(path: Path = CELL_FILE) -> Any:
    return YAML(typ="safe").load(path.read_text())


def arm_model(arm: Any) -> UmiModel:
    names = ("upper_mm", "fore_mm", "tool_mm", "wrist_height_mm")
    lengths = {name: float(arm[name]) for name in names}
    boxes = {k: Box.from_bounds(*v) for k, v in arm["links"].items()}
    return UmiModel.of_boxes(
        ArmGeometry(**lengths), {k: (box.T, box.half_mm) for k, box in boxes.items()}
    )


def chute(section: dict[str, Any]) -> dict[str, Box]:
    """Return the chute's boxes, each plate from the middle of its face and the face's normal."""
    boxes = {f"chute {k}": Box.from_bounds(*v) for k, v in section["walls"].items()}
    for name, plate in section["plates"].items():
        along, across = np.array(plate["along"], float), np.array(plate["across"], float)
        normal = np.cross(along, across) / np.linalg.norm(np.cross(along, across))
        T = np.eye(4)
        T[:3, 0], T[:3, 2] = along / math.hypot(*along), normal
        T[:3, 1] = np.cross(normal, T[:3, 0])
        T[:3, 3] = plate["corner"] + (along + across - normal * plate["thickness_mm"]) / 2
        half = (math.hypot(*along), math.hypot(*across), plate["thickness_mm"])
        boxes[f"chute {name}"] = Box(T, np.array(half) / 2)
    return boxes


def layout_of(cell: Any) -> CellLayout:
    arm, fixture, park = cell["arm"], cell["fixed_gripper"], cell["arm"]["park_deg"]
    q = np.radians([park["shoulder"], park["elbow"], park["yaw"], 0.0, park["pitch"], park["roll"]])
    q[3] = -10.0  # as high as the soft limit below the top stop lets it (umi_rtx.md 5.2)
    return CellLayout(
        arm=arm_model(arm),
        T_world_arm=pose(arm["pose"]),
        column=Box.from_bounds(*arm["links"]["column"]),
        arm_gripper=jaw(arm["arm_gripper"], arm["fingers"], arm["jaw_max_mm"]),
        fixed_gripper=jaw(fixture["body"], fixture["fingers"], fixture["jaw_max_mm"]),
        T_world_fixed_tcp=pose(fixture["pose"]),
        obstacles={
            "fixture's post": Box.from_bounds(*fixture["post"]),
            **{k.replace("_", " "): Box.from_bounds(*v) for k, v in cell["obstacles"].items()},
            **chute(cell.get("chute", {"walls": {}, "plates": {}})),
        },
        station_mm=np.array(cell["station"]["position"], float),
        inspection=camera(cell["cameras"]["inspection"]),
        overhead=camera(cell["cameras"]["overhead"]),
        trays={k: Tray(tuple(v["centre"]), tuple(v["size"])) for k, v in cell["trays"].items()},
        park_q=q,
    )


@cache
def emulated_layout() -> CellLayout:
    """Return the emulated cell's layout; nobody changes it, so all modules have the same one."""
    return layout_of(read_cell())
