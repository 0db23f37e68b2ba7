"""Ways to lie: time against trimesh's, side by side, and growth with the number of triangles.

python benchmarks/bench_resting.py [--json] [--parts FOLDER] [--largest 1000000] [--runs 5]

Each comparison times both in one process, in turn, on fresh meshes, and takes medians. Sets are the
same if every hull facet with odds above 0.5 % is in both with the same odds to 0.01 %. Growth is of
ours alone, since trimesh takes hours at the largest size; in processor time, so that other work on
the machine does not count, and with qhull's share, which is no code of ours.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import manifold3d
import numpy as np
import trimesh
from scipy.spatial import ConvexHull

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from controller.cad import Solid, find_resting, load_solid  # noqa: E402  (path set above)
from controller.cad.resting import Resting  # noqa: E402

LIKELY = 0.005
SAME_ODDS = 1e-4


def hull_mesh(points: np.ndarray) -> trimesh.Trimesh:
    shell = ConvexHull(points)
    a, b, c = (points[shell.simplices[:, i]] for i in range(3))
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), shell.equations[:, :3]) > 0
    simplices = np.where(outward[:, None], shell.simplices, shell.simplices[:, ::-1])
    used, faces = np.unique(simplices, return_inverse=True)
    return trimesh.Trimesh(points[used], faces.reshape(-1, 3), process=False)


def ball_points(count: int) -> np.ndarray:
    """Points spread evenly on the unit sphere (Fibonacci)."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    turn = np.pi * (1 + np.sqrt(5)) * i
    r = np.sqrt(1 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])


def ellipsoid(triangles: int) -> trimesh.Trimesh:
    return hull_mesh(ball_points(triangles // 2 + 2) * (20.0, 26.0, 34.0))


def rounded_box(triangles: int) -> trimesh.Trimesh:
    ball = ball_points(triangles // 2 + 2)
    return hull_mesh(6.0 * ball + np.sign(ball) * (20.0, 15.0, 8.0))


def turned(triangles: int) -> trimesh.Trimesh:
    """A knob: crowned, with a rounded rim and a foot; as many segments as steps of the profile."""
    segments = max(16, int(np.sqrt(triangles / 2)))
    steps = max(4, triangles // (2 * segments) - 2)
    t = np.linspace(0, np.pi, steps + 2)[1:-1]
    r, z = 24 * np.sin(t) ** 0.8, -14 * np.cos(t) + 4 * np.sin(t)
    turn = np.linspace(0, 2 * np.pi, segments, endpoint=False)
    points = np.stack(
        [np.outer(r, np.cos(turn)), np.outer(r, np.sin(turn)), np.outer(z, np.ones(segments))],
        axis=-1,
    )
    return hull_mesh(points.reshape(-1, 3))


def drilled_block(triangles: int) -> trimesh.Trimesh:
    """An ordinary part: a block with bores, whose hull is the block's."""
    bores = 9
    segments = max(8, triangles // (4 * bores))
    drills = [
        manifold3d.Manifold.cylinder(40, 4, 4, segments, True).translate((12 * i, 12 * j, 0))
        for i in (-1, 0, 1)
        for j in (-1, 0, 1)
    ]
    body = manifold3d.Manifold.cube((50, 44, 30), True) - manifold3d.Manifold.batch_boolean(
        drills, manifold3d.OpType.Add
    )
    out = body.to_mesh()
    return trimesh.Trimesh(
        np.asarray(out.vert_properties, dtype=float)[:, :3],
        np.asarray(out.tri_verts),
        process=False,
    )


SHAPES = {
    "ellipsoid": ellipsoid,
    "rounded box": rounded_box,
    "turned": turned,
    "drilled block": drilled_block,
}


def as_solid(mesh: trimesh.Trimesh, name: str) -> Solid:
    """Wrap a mesh that is known to be sound: what is timed is resting, not reading."""
    return Solid(
        name=name,
        mesh=mesh,
        content_hash="0" * 64,
        volume_mm3=float(mesh.volume),
        centroid_mm=np.asarray(mesh.center_mass, dtype=np.float64),
        faces=(),
        face_of_triangle=np.zeros(len(mesh.faces), dtype=np.int32),
    )


def fresh(solid: Solid) -> Solid:
    """Return a copy whose mesh remembers nothing."""
    mesh = trimesh.Trimesh(np.array(solid.mesh.vertices), np.array(solid.mesh.faces), process=False)
    return Solid(
        solid.name,
        mesh,
        solid.content_hash,
        solid.volume_mm3,
        solid.centroid_mm,
        (),
        solid.face_of_triangle,
    )


def timed(run: Callable[[], Any]) -> tuple[float, Any]:
    begin = time.perf_counter()
    answer = run()
    return time.perf_counter() - begin, answer


def processor_s(run: Callable[[], Any]) -> float:
    begin = time.process_time()
    run()
    return time.process_time() - begin


def differences(resting: Resting, transforms: np.ndarray, odds: np.ndarray) -> list[str]:
    """Return where the likely facets of both differ, in words."""
    theirs = [(-T[2, :3], p) for T, p in zip(transforms, odds, strict=True) if p > LIKELY]
    ours = resting.facet_probabilities > LIKELY
    found = []
    for down, p in theirs:
        same = resting.facet_downs @ -down * -1 > 1 - 1e-6
        mine = float(resting.facet_probabilities[same].sum())
        if abs(mine - p) > SAME_ODDS:
            found.append(f"{np.round(down, 3)}: trimesh {p:.5f}, ours {mine:.5f}")
    for down, p in zip(resting.facet_downs[ours], resting.facet_probabilities[ours], strict=True):
        if not any(down @ other > 1 - 1e-6 for other, _ in theirs) and p > LIKELY + SAME_ODDS:
            found.append(f"{np.round(down, 3)}: ours alone {p:.5f}")
    return found


def compare(solid: Solid, runs: int) -> dict[str, Any]:
    ours, theirs, wrong = [], [], []
    for _ in range(runs):
        part = fresh(solid)
        seconds, resting = timed(lambda p=part: find_resting(p))
        ours.append(seconds)
        part = fresh(solid)
        seconds, (transforms, odds) = timed(
            lambda p=part: trimesh.poses.compute_stable_poses(
                p.mesh, center_mass=p.centroid_mm, n_samples=1
            )
        )
        theirs.append(seconds)
        wrong = differences(resting, transforms, odds)
    return {
        "part": solid.name,
        "triangles": len(solid.mesh.faces),
        "hull_facets": len(ConvexHull(solid.mesh.vertices).simplices),
        "poses": len(resting.poses),
        "likely_facets": int((odds > LIKELY).sum()),
        "ours_ms": 1e3 * statistics.median(ours),
        "trimesh_ms": 1e3 * statistics.median(theirs),
        "times_faster": statistics.median(theirs) / statistics.median(ours),
        "differences": wrong,
    }


def growth(name: str, sizes: list[int], runs: int) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for size in sizes:
        solid = as_solid(SHAPES[name](size), name)
        count = runs if size <= 100_000 else max(1, runs // 3)
        parts = [fresh(solid) for _ in range(count)]
        seconds = statistics.median(processor_s(lambda p=part: find_resting(p)) for part in parts)
        points = np.array(solid.mesh.vertices)
        hull_s = statistics.median(
            processor_s(lambda p=points: ConvexHull(p)) for _ in range(count)
        )
        n = len(solid.mesh.faces)
        row = {"part": name, "triangles": n, "ms": 1e3 * seconds, "qhull_ms": 1e3 * hull_s}
        if rows:
            before = rows[-1]
            expected = (n * np.log(n)) / (before["triangles"] * np.log(before["triangles"]))
            row["growth"] = row["ms"] / before["ms"]
            row["n_log_n"] = float(expected)
        rows.append(row)
        say(row)
    return rows


def say(row: dict[str, Any]) -> None:
    """Tell a size as soon as it is measured, beside the table that comes at the end."""
    print(f"{row['part']}, {row['triangles']}: {row['ms']:.1f} ms", file=sys.stderr, flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--parts", type=Path, default=ROOT.parent / "shared" / "parts")
    parser.add_argument("--largest", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    solids = [as_solid(SHAPES[name](10_000), name) for name in SHAPES]
    if args.parts.is_dir():
        solids += [load_solid(path) for path in sorted(args.parts.glob("*.stl"))]
    compared = [compare(solid, args.runs) for solid in solids]
    sizes = [n for n in (1_000, 10_000, 100_000, 1_000_000) if n <= args.largest]
    grown = [row for name in SHAPES for row in growth(name, sizes, args.runs)]
    if args.json:
        print(json.dumps({"against_trimesh": compared, "growth": grown}))
        return 0
    print(
        "part                    triangles  on hull  poses  ours ms  trimesh ms  faster  same set"
    )
    for r in compared:
        print(
            f"{r['part']:22} {r['triangles']:10} {r['hull_facets']:8} {r['poses']:6} "
            f"{r['ours_ms']:8.1f} {r['trimesh_ms']:11.1f} {r['times_faster']:6.1f}x  "
            f"{'yes' if not r['differences'] else r['differences'][0]}"
        )
    print("\ngrowth of ours alone, in processor time; trimesh takes hours at 1,000,000")
    print("part                    triangles        ms  of these qhull   growth  n log n would be")
    for r in grown:
        more = f"{r['growth']:8.1f} {r['n_log_n']:10.1f}" if "growth" in r else ""
        print(f"{r['part']:22} {r['triangles']:10} {r['ms']:9.1f} {r['qhull_ms']:15.1f} {more}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
