"""What machined surfaces cost a picture: plain and machined in turn, in one run.

``python benchmarks/bench_surfaces.py [--part NAME]... [--cell FILE] [--json]``: milliseconds of one
core a picture, the best of some; what is found once for a part stands apart.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import cv2  # noqa: E402  (threads and path come first)
from bench_pictures import CELL, poses_in_hand  # noqa: E402

from emulators.world import build_scene, load_solid, read_layout  # noqa: E402
from emulators.world.pictures.machined import MachinedPart  # noqa: E402
from emulators.world.pictures.picture import Eye  # noqa: E402

PARTS = ("holder", "featuretype")  # with the fewest triangles, and with the most
SEED = 1
REPEATS = 3


def cpu_ms(eyes: list[Eye], poses: dict, levels: dict[int, float]) -> list[float]:  # type: ignore[type-arg]
    """Return CPU milliseconds of a picture by each eye, the best of some, taken in turn."""
    best = [float("inf")] * len(eyes)
    for _ in range(REPEATS):
        for number, eye in enumerate(eyes):
            begun = time.process_time()
            eye.picture(poses, levels)
            best[number] = min(best[number], 1e3 * (time.process_time() - begun))
    return best


def measured(cell: Path, name: str) -> list[dict[str, object]]:
    """Return the rows of one part."""
    layout = read_layout(cell)
    solid = load_solid(ROOT / "recipes" / "parts" / f"{name}.stl")
    scenes = [build_scene(layout, [solid], seed) for seed in (None, SEED)]
    lamps = [lamp.name for lamp in scenes[0].lamps]
    places = {
        "table": (0, {"part 0": solid.pose_at_rest(solid.rests[0], 360.0, 0.0, 0.4)}),
        "station": (1, poses_in_hand(cell, solid.centre_mm)),
    }
    rows: list[dict[str, object]] = []
    kept: dict[str, MachinedPart] = {}
    for place, (camera, poses) in places.items():
        eyes = [Eye(scene, camera, kept) for scene in scenes]
        for light in (("backlight",), ("ring",), ("side",), ("ring", "side")):
            levels = {lamps.index(f"{place}_{one}"): 1.0 for one in light}
            for eye in eyes:
                for lamp in levels:
                    eye.layer(lamp)  # what stands still is painted once
            is_first = not kept
            begun = time.process_time()
            eyes[1].picture(poses, levels)
            once_ms = 1e3 * (time.process_time() - begun)
            plain_ms, machined_ms = cpu_ms(eyes, poses, levels)
            row = {"part": name, "light": f"{place} {'+'.join(light)}", "plain_ms": plain_ms,
                   "machined_ms": machined_ms, "ratio": machined_ms / plain_ms}  # fmt: skip
            if is_first and kept:
                row["once_ms"] = once_ms - machined_ms
            rows.append(row)
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--part", action="append", help="name in recipes/parts; may be repeated")
    parser.add_argument("--cell", type=Path, default=CELL)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rows = [row for name in args.part or PARTS for row in measured(args.cell, name)]
    if args.json:
        print(json.dumps({"seed": SEED, "repeats": REPEATS, "rows": rows}))
        return
    print(f"{'part, light':32}{'plain ms':>10}{'machined ms':>13}{'ratio':>8}{'once ms':>9}")
    for row in rows:
        once = f"{row['once_ms']:9.0f}" if "once_ms" in row else ""
        print(f"{row['part']!s:12}{row['light']!s:20}{row['plain_ms']:10.0f}"
              f"{row['machined_ms']:13.0f}{row['ratio']:8.2f}{once}")  # fmt: skip


if __name__ == "__main__":
    main()
