"""Is the side on which a part lies told right, by the light table and the lamps together?

    python benchmarks/bench_table_sides.py [--parts flange_xy CAD...] [--seeds 1000-1004]
           [--surfaces machined plain] [--off-mm 0.1] [--json]

Some sides of a part have nearly one outline: a flange whose two hubs differ by 2 mm. Each stable
pose of each part is laid on the emulated table once per seed, anywhere in the drop area, 0.1 mm too
large or too small as real parts are, and recognised as a run does it: by the light table first, and
by each of the table's lamps. Marks, dust and oil film are drawn by the seed.

Right is an answer by which the part's surface is everywhere within 1 mm of where it truly is. An
answer that is wrong and names the right one beside it is undecided: the cell looks again. Seeds
below 1000 are there to develop with.
"""

import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from bench import ROOT, SHARED, Arguments, show
from inspection_scenes import Array, Station
from recognition_symmetry import Surface

from controller.cad.compiled import CompileOptions, load_part
from controller.cell.compute.job import glowing_mask
from controller.cell.devices.lamps import TABLE_LAMPS
from controller.imaging import inverse_pose
from controller.recognition import recognise
from controller.recognition.stored import open_library
from controller.setup.optics import table_corners

Words = dict[str, Any]
RIGHT_MM = 1.0
MARGIN_MM = 10.0  # of the drop area that a part's middle keeps off
LIKELY = 0.01  # poses that a part falls into less often are left out


def cad_files() -> list[Path]:
    """Return the parts of the recipes, and others."""
    mine = sorted((ROOT / "recipes" / "parts").glob("*.stl"))
    names = {path.name for path in mine}
    other = [path for path in sorted((SHARED / "parts").glob("*.stl")) if path.name not in names]
    return [*mine, ROOT / "recipes" / "parts" / "widget.csg.yaml", *other]


def run_one(case: tuple[Path, int, str, float]) -> list[Words]:
    """Lay every stable pose of a part on the table once, and recognise it."""
    path, seed, surfaces, off_mm = case
    options = CompileOptions(unit=None if path.name.endswith(".csg.yaml") else "mm")
    part = load_part(path, options)
    rng = np.random.default_rng([seed, 41])
    mesh = part.solid.mesh
    sign = rng.choice([-1.0, 1.0])
    scale = 1.0 + sign * off_mm / float(np.ptp(mesh.bounds, axis=0).max())
    body = mesh.copy()
    body.apply_scale(scale)
    surface = Surface(mesh)
    station = Station(body, finish_seed=seed if surfaces == "machined" else None)
    camera = station.layout.overhead
    library = open_library([(path, options)], camera)
    usable = glowing_mask(camera, table_corners(station.cell))
    area = station.cell.table.drop_area
    rows = []
    for number, pose in enumerate(part.poses):
        if pose.probability < LIKELY:
            continue
        T = lying(pose.R, body.vertices, area, rng)
        pictures = station.shoot_lying(T, TABLE_LAMPS, 100 * seed + number)
        begun = time.process_time()
        lit = [pictures.lit[lamp] for lamp in TABLE_LAMPS]
        seen = recognise(pictures.backlit, camera, library, "backlit", usable=usable, lit=lit)
        row: Words = {
            "part": path.name.split(".")[0],
            "pose": number,
            "probability": float(pose.probability),
            "seed": seed,
            "surfaces": surfaces,
            "seconds": time.process_time() - begun,
            "kind": "missed",
        }
        if seen.sightings:
            one = seen.sightings[0]
            row |= {"score": one.score, "answer": one.pose_index}
            answers = [one.T_world_part, *(a.T_world_part for a in one.ambiguous_with)]
            right = [T_ is not None and is_right(T_, T, surface) for T_ in answers]
            row["kind"] = (
                "unknown"
                if one.part is None
                else "right"
                if right[0]
                else "undecided"
                if any(right)
                else "wrong"
            )
        rows.append(row)
    return rows


def lying(R: Array, vertices: Array, area: Any, rng: np.random.Generator) -> Array:  # noqa: ANN401
    """Return where a part lies, (4, 4): on its side, anywhere in the drop area, turned anyhow."""
    turn = rng.uniform(-np.pi, np.pi)
    c, s = np.cos(turn), np.sin(turn)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ R
    points = vertices @ T[:3, :3].T
    low, high = points.min(axis=0), points.max(axis=0)
    half = 0.5 * (high - low)[:2]
    for k, (first, last) in enumerate((area.x, area.y)):
        room = max(0.5 * (last - first) - max(half[k] - MARGIN_MM, 0.0), 0.0)
        T[k, 3] = 0.5 * (first + last) + rng.uniform(-room, room) - 0.5 * (low + high)[k]
    T[2, 3] = -low[2]
    return T


def is_right(T_answer: Array, T_true: Array, surface: Surface) -> bool:
    """Say whether a part that lies as answered fills the same place."""
    points = surface.probes_mm + surface.centroid_mm
    for one, other in ((T_answer, T_true), (T_true, T_answer)):
        T = inverse_pose(other) @ one
        moved = points @ T[:3, :3].T + T[:3, 3]
        if not surface.is_near(moved - surface.centroid_mm, RIGHT_MM):
            return False
    return True


def main() -> int:
    parser = Arguments(__doc__, parts=["holder"], seeds="1011")
    parser.add_argument("--parts", nargs="*", help="names of parts of the recipes, or CAD files")
    parser.add_argument("--seeds", default="1000-1001", help="A or A-B")
    parser.add_argument("--surfaces", nargs="*", default=["machined"])
    parser.add_argument("--off-mm", type=float, default=0.1)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    files = cad_files()
    if args.parts:
        known = {path.name.split(".")[0]: path for path in files}
        files = [known.get(name, Path(name)) for name in args.parts]
    first, _, last = args.seeds.partition("-")
    cases = [
        (path, seed, surfaces, args.off_mm)
        for path in files
        for seed in range(int(first), int(last or first) + 1)
        for surfaces in args.surfaces
    ]
    rows: list[Words] = []
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        for found in pool.map(run_one, cases):
            rows += found
    kinds = Counter(row["kind"] for row in rows)
    show(args, rows, {**kinds, "mean s": float(np.mean([row["seconds"] for row in rows]))})
    return int(kinds["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
