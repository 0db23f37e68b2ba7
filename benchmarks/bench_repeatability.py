"""How well measuring repeats: one part pictured again and again, studied by `cellctl gauge`.

    python benchmarks/bench_repeatability.py [--cells emulated metrology] [--readings 10]
           [--part benchmarks/parts/t_slot_nut.csg.yaml] [--seed 1] [--json]

The emulated station takes four views of a part before the panel and under the ring: two from one
side, two from the other, some degrees off square. Ten readings are of one grasp, the arm going to
each view anew (0.1 mm, 0.08 degrees); ten more are of a grasp each (0.8 mm, 0.8 degrees). Every
reading is a set of its own, and `cellctl gauge` does the statistics. Told: six standard deviations
per kind of characteristic, median and 90th percentile.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench import ROOT, Arguments, show
from inspection_scenes import (
    HOLD_DEG,
    HOLD_MM,
    VIEW_DEG,
    VIEW_MM,
    Held,
    Station,
    disturbed,
    grasps,
    looks,
    rotation,
)
from numpy.typing import NDArray

from controller.cell.services.views.part_file import box_section, camera_section, pose_rows
from controller.config.view_set import SCHEMA, SetView, ViewSetFile
from controller.inspection import InspectionLimits
from controller.setup.optics import light_of

Array = NDArray[np.float64]
Words = dict[str, Any]
PANEL, RING = "station_backlight", "station_ring"
TILT_DEG = (3.0, 12.0)


class Readings:
    """Readings of one part at one station.

    Parameters
    ----------
    part : its CAD file
    cell_file : of the cell
    seed : draws poses and noise
    """

    def __init__(self, part: Path, cell_file: Path, seed: int) -> None:
        self.part, self.held = part, Held.load(part)
        self.station = Station(self.held.solid.mesh, cell_file)
        self.rng = np.random.default_rng(seed)
        self.T_part_tcp, self.opening_mm = grasps(self.held.solid)[0]
        self.count = 0
        size = np.ptp(self.held.solid.mesh.bounds, axis=0)
        flat = int(np.argmin(size))  # the sides with the most to measure
        sides = [R for i, (R, is_square) in enumerate(looks()) if is_square and i // 2 == flat]
        about = self.rng.normal(size=(2, 3))
        self.turns = [
            rotation(axis, np.radians(tilt)) @ R
            for R in sides
            for axis, tilt in zip(about, TILT_DEG, strict=True)
        ]

    def grasp(self) -> Array:
        """Return how a part slips in the jaws as it is taken, (4, 4)."""
        return disturbed(np.eye(4), self.held.solid.centroid_mm, HOLD_MM, HOLD_DEG, self.rng)

    def take(self, slip: Array, folder: Path) -> Path:
        """Write the pictures of one reading, and its set."""
        folder.mkdir()
        station, centre = self.station, self.held.solid.centroid_mm
        middle = station.layout.station_mm
        views = []
        for number, R in enumerate(self.turns):
            T = np.eye(4)
            T[:3, :3] = R
            T[:3, 3] = middle - R @ centre
            true = disturbed(T @ slip, middle, VIEW_MM, VIEW_DEG, self.rng)
            T_tcp = T @ self.T_part_tcp
            self.count += 1
            pictures = station.shoot(true, T_tcp, self.opening_mm, (RING,), self.count)
            task = station.task(
                f"v{number}", T, T_tcp, self.opening_mm, (RING,), InspectionLimits(), False
            )
            files = {PANEL: Path(f"v{number}_panel.png"), RING: Path(f"v{number}_ring.png")}
            cv2.imwrite(str(folder / files[PANEL]), pictures.backlit)
            cv2.imwrite(str(folder / files[RING]), pictures.lit[RING])
            boxes = tuple(map(box_section, task.holder))
            views.append(
                SetView(id=task.view_id, T_world_part=pose_rows(T), gripper_boxes=boxes,
                        pictures=files, grasp=0)
            )  # fmt: skip
        camera, cell = station.layout.inspection, station.cell
        file = ViewSetFile(
            schema=SCHEMA, part=self.part, unit="mm",
            camera=camera_section(camera),
            lamps={name: light_of(cell.lamps[name], cell) for name in (PANEL, RING)},
            views=tuple(views), accuracy=cell.accuracy,
        )  # fmt: skip
        path = folder / "SET.json"
        path.write_text(file.model_dump_json(by_alias=True, exclude_none=True))
        return path


def study(part: Path, cell_file: Path, count: int, seed: int, scratch: Path) -> list[Words]:
    """Return the lines of `cellctl gauge` on readings in one grasp and in a grasp each."""
    readings = Readings(part, cell_file, seed)
    slip = readings.grasp()
    sources = [f"A/1/1={readings.take(slip, scratch / f'same{i}')}" for i in range(count)]
    sources += [
        f"A/1/{i + 2}={readings.take(readings.grasp(), scratch / f'new{i}')}" for i in range(count)
    ]
    done = subprocess.run(
        [sys.executable, "-m", "controller.cli", "gauge", *sources, "--json",
         "--runs", str(scratch / "runs")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode == 2:
        raise SystemExit(done.stderr)
    return [json.loads(line) for line in done.stdout.splitlines()]


def spreads(cell: str, lines: list[Words]) -> list[Words]:
    """Return six standard deviations [um] by kind, median and 90th percentile."""
    found = [line for line in lines if line["event"] == "characteristic"]
    rows = []
    for kind in ("all", *sorted({_kind(line) for line in found})):
        mine = [line["six_sigma"] for line in found if kind in ("all", _kind(line))]
        row: Words = {"cell": cell, "kind": kind, "values": len(mine)}
        for which in ("in_grasp", "with_regrasps"):
            known = [1000 * six[which]["value"] for six in mine if six.get(which)]
            row[f"{which}, median um"] = float(np.median(known)) if known else None
            row[f"{which}, 90 % um"] = float(np.quantile(known, 0.9)) if known else None
        rows.append(row)
    return rows


def _kind(line: Words) -> str:
    words = str(line["id"]).split()
    return words[-1] if words[-1] in ("diameter", "position", "length", "radius") else words[0]


def main() -> int:
    """Take the readings of each cell, print what repeats."""
    parser = Arguments(__doc__, cells=["emulated"], readings=2)
    parser.add_argument("--cells", nargs="+", default=["emulated", "metrology"])
    parser.add_argument("--readings", type=int, default=10)
    parser.add_argument(
        "--part", type=Path, default=ROOT / "benchmarks" / "parts" / "t_slot_nut.csg.yaml"
    )
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    rows: list[Words] = []
    figures: Words = {}
    for cell in args.cells:
        with tempfile.TemporaryDirectory(prefix="repeat") as scratch:
            lines = study(
                args.part.resolve(), ROOT / "recipes" / "cells" / f"{cell}.yaml", args.readings,
                args.seed, Path(scratch),
            )  # fmt: skip
        rows += spreads(cell, lines)
        figures[cell] = lines[-1]["data_allow"][0]
    show(args, rows, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
