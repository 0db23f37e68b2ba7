"""Surfaces, edges and features of a mesh: how long they take, from 1k to 1M triangles.

python benchmarks/bench_boundary.py [--json] [--largest 1000000] [--parts NAME...]

Two families of growing size: a plate with more and more bores, and a ball with the noise of a
scan, of which nothing but its facets can be told. Then the parts of shared/parts. Processor
seconds, so that neighbours on the machine count less; `us_per_nlogn` is flat where time grows as
n log n, and `to_nlogn` sets it against the row before (1.0: as n log n; 10 n: as n squared).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from bench_compile import SHARED_PARTS, plate  # noqa: E402  (path set above)

from controller.cad import Solid, load_solid  # noqa: E402
from controller.cad.boundary import find_boundary, find_faces  # noqa: E402
from controller.cad.surfaces import find_features  # noqa: E402

SIZES = (1_000, 10_000, 100_000, 1_000_000)
NOISE_MM = 0.03


def noisy_ball(triangles: int) -> trimesh.Trimesh:
    """A ball of 50 mm whose points lie off it by the noise of a scanner."""
    rows = max(3, round(np.sqrt(triangles / 8)))
    ball = trimesh.creation.uv_sphere(radius=50.0, count=[rows, 2 * rows])
    points = np.asarray(ball.vertices)
    out = np.random.default_rng(triangles).normal(0.0, NOISE_MM, len(points))
    return trimesh.Trimesh(points * (1 + out[:, None] / 50.0), ball.faces, process=False)


FAMILIES: dict[str, Callable[[int], trimesh.Trimesh]] = {"plate": plate, "noisy ball": noisy_ball}


def row(name: str, mesh: trimesh.Trimesh) -> dict[str, Any]:
    """Seconds of each step for one mesh."""
    # a mesh without what other steps may have computed and kept
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    times = [time.process_time()]
    faces, face_of_triangle = find_faces(mesh)
    times.append(time.process_time())
    boundary = find_boundary(mesh, faces, face_of_triangle)
    times.append(time.process_time())
    solid = Solid(
        name=name,
        mesh=mesh,
        content_hash="",
        volume_mm3=float(mesh.volume),
        centroid_mm=np.asarray(mesh.center_mass),
        faces=faces,
        face_of_triangle=face_of_triangle,
    )
    _ = solid.boundary  # computed once more, outside the clock
    begin = time.process_time()
    features = find_features(solid)
    features_s = time.process_time() - begin
    count = len(mesh.faces)
    spent = times[2] - times[0] + features_s
    return {
        "body": name,
        "triangles": count,
        "surfaces": len(faces),
        "edges": boundary.edge_count,
        "features": len(features),
        "faces_s": round(times[1] - times[0], 3),
        "boundary_s": round(times[2] - times[1], 3),
        "features_s": round(features_s, 3),
        "us_per_nlogn": round(1e6 * spent / (count * np.log2(count)), 3),
    }


def bench(largest: int, names: list[str]) -> Iterator[dict[str, Any]]:
    """Yield the rows of both families, then those of the parts."""
    for name, family in FAMILIES.items():
        before = None
        for size in SIZES:
            if size > largest:
                break
            told = row(name, family(size))
            now = told["us_per_nlogn"]
            yield {**told, "to_nlogn": round(now / before, 2) if before else None}
            before = now
    for file in sorted(SHARED_PARTS.glob("*.stl")):
        if not names or file.stem in names:
            yield {**row(file.stem, load_solid(file).mesh), "to_nlogn": None}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--largest", type=int, default=SIZES[-1])
    parser.add_argument("--parts", nargs="*", default=[])
    args = parser.parse_args()
    if not SHARED_PARTS.is_dir():
        print(f"no parts: {SHARED_PARTS} is not there", file=sys.stderr)
    rows = bench(args.largest, args.parts)
    if args.json:
        print(json.dumps({"rows": list(rows)}))
        return 0
    print(
        "body                  triangles surfaces   edges features   faces s boundary s features s"
        "  us / (n log2 n)  to n log n"
    )
    for r in rows:
        print(
            f"{r['body']:21} {r['triangles']:9} {r['surfaces']:8} {r['edges']:7} {r['features']:8} "
            f"{r['faces_s']:9.3f} {r['boundary_s']:10.3f} {r['features_s']:10.3f} "
            f"{r['us_per_nlogn']:16} {r['to_nlogn'] or '':>11}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
