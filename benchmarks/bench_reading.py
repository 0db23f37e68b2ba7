"""How long it takes to read a solid and to prove it sound, from 1k to 1M triangles.

python benchmarks/bench_reading.py [--json] [--largest 1310720]

A ball, as STL holds it: each corner three or six times, in single precision. `us_per_nlogn` is
flat where time grows as n log n. Processor seconds, so that neighbours on the machine count less.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from controller.cad.soundness import check_soundness  # noqa: E402  (path set above)
from controller.cad.welding import weld  # noqa: E402


def bench(largest: int) -> list[dict[str, Any]]:
    rows = []
    for subdivisions in (3, 4, 5, 6, 7, 8):
        ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=50.0)
        count = len(ball.faces)
        if count > largest:
            break
        loose = np.asarray(ball.triangles).astype(np.float32).astype(float).reshape(-1, 3)
        begin = time.process_time()
        points, triangles, _ = weld(loose, np.arange(len(loose)).reshape(-1, 3))
        weld_s = time.process_time() - begin
        mesh = trimesh.Trimesh(points, triangles, process=False)
        begin = time.process_time()
        check_soundness(mesh, "ball")
        sound_s = time.process_time() - begin
        rows.append(
            {
                "triangles": count,
                "weld_s": round(weld_s, 3),
                "sound_s": round(sound_s, 3),
                "us_per_nlogn": round((weld_s + sound_s) * 1e6 / (count * np.log2(count)), 3),
                "rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
            }
        )
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--largest", type=int, default=1_310_720)
    args = parser.parse_args()
    rows = bench(args.largest)
    if args.json:
        print(json.dumps({"rows": rows}))
        return 0
    print("triangles   weld s  sound s  us / (n log2 n)  most memory MB")
    for r in rows:
        print(
            f"{r['triangles']:9}  {r['weld_s']:7}  {r['sound_s']:7}  {r['us_per_nlogn']:15}"
            f"  {r['rss_mb']:14}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
