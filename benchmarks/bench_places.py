"""Every way to lie, all over the table: is a part recognised wherever it was put down?

For each stable pose of 1 % or more (those that look the same by symmetry once), places and turns
by chance, the whole part over the light table; backlit pictures of the emulated world with its
noise and blur. Right: the pose, or one that the answer names as looking the same, and the centre
of mass within 1 mm. Tall poses are those whose outline changes most with the place.

    python benchmarks/bench_places.py [--json] [--places 12] [--seed 1] [--taller 60] [parts ...]
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from inspection_scenes import ROOT, Held, Station
from numpy.typing import NDArray

from controller.cad import StablePose
from controller.cad.compiled import CompiledPart, CompileOptions, load_part
from controller.cell.compute import glowing_mask
from controller.config import load_cell
from controller.recognition import Sighting, make_library, pose_on_table, recognise
from controller.setup.layout import build_layout
from controller.setup.optics import table_corners

Array = NDArray[np.float64]
CELL = load_cell(ROOT / "recipes" / "cells" / "emulated.yaml")
CAMERA = build_layout(CELL).overhead
GLOWING = glowing_mask(CAMERA, table_corners(CELL))
DEFAULT = sorted(p for p in (ROOT / "recipes" / "parts").iterdir() if p.suffix in (".stl", ".yaml"))
MIN_PROBABILITY = 0.01
RIGHT_MM = 1.0


def is_on_table(part: CompiledPart, T: Array) -> bool:
    """Tell whether all of a posed part is seen before the light table."""
    p = part.solid.mesh.vertices @ T[:3, :3].T + T[:3, 3]
    u, v = np.round(CAMERA.project(p)).astype(int).T
    inside = (u >= 3) & (u < CAMERA.size_px[0] - 3) & (v >= 3) & (v < CAMERA.size_px[1] - 3)
    return bool(inside.all() and GLOWING[v, u].all())


def place(part: CompiledPart, pose: StablePose, rng: np.random.Generator) -> Array:
    """Return T_world_part (4, 4) of a part put down somewhere."""
    corners = CAMERA.on_plane(np.array([[0.0, 0.0], CAMERA.size_px]))[:, :2]
    while True:
        x, y = rng.uniform(corners.min(axis=0), corners.max(axis=0))
        T = pose_on_table(part.solid, pose, float(x), float(y), float(rng.uniform(0, 2 * np.pi)))
        if is_on_table(part, T):
            return T


def grade(seen: tuple[Sighting, ...], part: CompiledPart, pose: StablePose, T: Array) -> str:
    """Return "right", "wrong" or why nothing was said."""
    if len(seen) != 1:
        return f"{len(seen)} objects"
    (s,) = seen
    if s.part is None or s.T_world_part is None:
        return f"refused: {s.reason}"
    told = [(s.pose_index, s.T_world_part)]
    told += [(other.pose_index, other.T_world_part) for other in s.ambiguous_with]
    alike = [Tk for index, Tk in told if same(index, part) == same(pose.index, part)]
    if not alike:
        return "wrong pose"
    centre = np.append(part.solid.centroid_mm, 1.0)
    off = min(float(np.linalg.norm(((Tk - T) @ centre)[:2])) for Tk in alike)
    return "right" if off < RIGHT_MM else f"off by {off:.1f} mm"


def same(index: int, part: CompiledPart) -> int:
    """Return the first of the poses that look the same by symmetry."""
    pose = next(p for p in part.poses if p.index == index)
    return pose.first_alike


def run(path: Path, places: int, seed: int, least_mm: float) -> list[dict[str, Any]]:
    """Return a row for each pose of a part."""
    options = CompileOptions(unit=None if path.suffix == ".yaml" else "mm")
    part = load_part(path, options)
    station = Station(Held.of(part.solid).solid.mesh)
    library = make_library([part], CAMERA)
    rows = []
    for pose in part.poses:
        if same(pose.index, part) != pose.index or pose.probability < MIN_PROBABILITY:
            continue
        height = float(np.ptp(part.solid.mesh.vertices @ pose.R[2]))
        if height < least_mm:
            continue
        rng = np.random.default_rng([seed, pose.index])
        grades, seconds = [], []
        for number in range(places):
            T = place(part, pose, rng)
            grey = station.shoot_lying(T, (), seed * 1000 + number).backlit
            started = time.process_time()
            seen = recognise(grey, CAMERA, library, "backlit", usable=GLOWING).sightings
            seconds.append(time.process_time() - started)
            grades.append(grade(seen, part, pose, T))
        rows.append(
            {
                "part": part.solid.name,
                "pose": pose.index,
                "likely_percent": round(100 * pose.probability, 1),
                "height_mm": round(height, 1),
                "places": places,
                "right": grades.count("right"),
                "recognise_s": round(float(np.median(seconds)), 3),
                "others": sorted({g for g in grades if g != "right"}),
            }
        )
    return rows


def main() -> int:
    """Print a table, or one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", type=Path, default=DEFAULT)
    parser.add_argument("--places", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--taller", type=float, default=0.0, help="than this, poses alone [mm]")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = []
    for path in args.parts:
        found = run(path, args.places, args.seed, args.taller)
        rows += found
        for r in found if not args.json else ():
            print(
                f"{r['part']:16} pose {r['pose']:2} {r['likely_percent']:5.1f} % "
                f"{r['height_mm']:6.1f} mm  right {r['right']:2}/{r['places']}  "
                f"{r['recognise_s']:.3f} s  {'; '.join(r['others'])}",
                flush=True,
            )
    right, count = sum(r["right"] for r in rows), sum(r["places"] for r in rows)
    if args.json:
        print(json.dumps({"right": right, "places": count, "rows": rows}))
    else:
        print(f"right {right} of {count}")
    return 0 if right == count else 1


if __name__ == "__main__":
    sys.exit(main())
