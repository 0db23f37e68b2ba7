"""Compiling parts: how long, how much memory, how fast from the cache, and how it grows.

python benchmarks/bench_compile.py [--json] [--parts FILE...] [--growth 1000 10000 100000 1000000]
                                   [--only parts|growth]

Each part is compiled in a process of its own: seconds of the complete compile (imports left out),
most memory the process ever held (imports taken in), and the middle of 15 loads from the cache with
its file in the disk's cache; beside wall time stands the processor's, which other jobs on the
machine stretch less. Growth: four families, a plate with bores, an organic body of smooth bumps, a
ball, and a scan (the organic body with seeded noise), at the triangle counts asked, stage by stage,
in seconds of processor time, keeping what was found included, and the most memory held; told is the
exponent between the last two sizes, and how their ratio compares with that of n log n: below 1.0 it
grows slower.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import manifold3d
import numpy as np
import trimesh
from bench import ROOT, Arguments, show

Result = TypeVar("Result")
LOADS = 15
LIMITS = {"compile_s": 5.0, "load_ms": 20.0, "rss_mb": 500.0}
GROWTH = (1_000, 10_000, 100_000, 1_000_000)
STAGES = ("read", "boundary", "symmetry", "poses", "views", "alike", "samples", "features", "keep")
SCAN_NOISE = 0.02  # of the mesh's mean side: with more of it a fine mesh would fold over itself
SLACK = 1.15  # of n log n: what one run's clock may be off by


def _cpu_s() -> float:
    """Seconds of processor so far, those of ended children (the STEP kernel) included."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _most_mb() -> float:
    """Most memory this process ever held [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def child(path: Path) -> dict[str, Any]:
    """What one process measures of one part."""
    from controller.cad.compiled import cached_part, make_part
    from controller.cad.errors import CadError

    before_mb = _most_mb()
    with tempfile.TemporaryDirectory() as folder:
        cache = Path(folder)
        begin, begin_cpu = time.perf_counter(), _cpu_s()
        try:
            part = make_part(path, cache=cache)
        except CadError as error:
            return {"part": path.name, "refused": str(error)}
        compile_s, compile_cpu_s = time.perf_counter() - begin, _cpu_s() - begin_cpu
        rss_mb = _most_mb()
        kept_mb = sum(file.stat().st_size for file in cache.iterdir()) / 1e6
        loads, loads_cpu = [], []
        for _ in range(LOADS):
            begin, begin_cpu = time.perf_counter(), time.process_time()
            assert cached_part(path, cache=cache) is not None
            loads.append(1e3 * (time.perf_counter() - begin))
            loads_cpu.append(1e3 * (time.process_time() - begin_cpu))
    return {
        "part": path.name,
        "triangles": len(part.solid.mesh.faces),
        "surfaces": len(part.solid.faces),
        "poses": len(part.poses),
        "compile_s": round(compile_s, 3),
        "compile_cpu_s": round(compile_cpu_s, 3),
        "rss_mb": round(rss_mb, 1),
        "imports_mb": round(before_mb, 1),
        "load_ms": round(float(np.median(loads)), 2),
        "load_cpu_ms": round(float(np.median(loads_cpu)), 2),
        "file_mb": round(kept_mb, 2),
    }


def bench_parts(paths: list[Path]) -> list[dict[str, Any]]:
    rows = []
    for path in paths:
        command = [sys.executable, str(Path(__file__)), "--child", str(path)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
        if done.returncode:
            rows.append({"part": path.name, "refused": done.stderr.strip().splitlines()[-1]})
            continue
        row = json.loads(done.stdout.splitlines()[-1])
        if "refused" not in row:
            row["within"] = all(row[key] <= limit for key, limit in LIMITS.items())
        rows.append(row)
    return rows


def plate(triangles: int) -> trimesh.Trimesh:
    """A plate with bores of 40 sides in rows; more bores, more triangles (about 160 a bore)."""
    count = max(1, round((triangles - 12) / 160))
    columns = math.ceil(math.sqrt(count))
    places = [(10.0 * (i % columns), 10.0 * (i // columns)) for i in range(count)]
    rows = math.ceil(count / columns)
    circle = [
        (3 * math.cos(a), 3 * math.sin(a))
        for a in np.linspace(0, 2 * math.pi, 40, endpoint=False).tolist()
    ]
    outline = [
        (-5.0, -5.0),
        (10.0 * columns - 5, -5.0),
        (10.0 * columns - 5, 10.0 * rows - 5),
        (-5.0, 10.0 * rows - 5),
    ]
    holes = [[(x + u, y + v) for u, v in reversed(circle)] for x, y in places]
    section = manifold3d.CrossSection([outline, *holes])
    return _mesh(section.extrude(8.0))


def organic(triangles: int) -> trimesh.Trimesh:
    """A ball of 50 mm with smooth bumps, subdivided as finely as asked."""
    ball = manifold3d.Manifold.sphere(50.0, 4 * max(2, round(math.sqrt(triangles / 8))))
    mesh = _mesh(ball)
    unit = np.asarray(mesh.vertices) / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    bump = 1 + 0.1 * np.sin(3 * unit[:, 0] + 1) * np.cos(4 * unit[:, 1]) + 0.05 * unit[:, 2]
    stretched = 50 * unit * bump[:, None] * np.array([1.0, 0.8, 0.6])
    return trimesh.Trimesh(stretched, mesh.faces, process=False)


def _mesh(body: manifold3d.Manifold) -> trimesh.Trimesh:
    mesh = body.to_mesh()
    return trimesh.Trimesh(
        np.asarray(mesh.vert_properties, dtype=float)[:, :3], np.asarray(mesh.tri_verts)
    )


def ball(triangles: int) -> trimesh.Trimesh:
    """A ball of 40 mm: an icosahedron halved as often as comes nearest."""
    halvings = max(1, round(math.log(triangles / 20, 4)))
    return trimesh.creation.icosphere(subdivisions=halvings, radius=40.0)


def scan(triangles: int) -> trimesh.Trimesh:
    """The organic body as a scanner has it: every corner off by a share of the mesh's sides."""
    mesh = organic(triangles)
    side_mm = float(np.sqrt(4 / np.sqrt(3) * mesh.area / len(mesh.faces)))
    rng = np.random.default_rng(triangles)
    noise_mm = rng.normal(0.0, SCAN_NOISE * side_mm, mesh.vertices.shape)
    return trimesh.Trimesh(mesh.vertices + noise_mm, mesh.faces, process=False)


FAMILIES: dict[str, Callable[[int], trimesh.Trimesh]] = {
    "plate": plate,
    "organic": organic,
    "ball": ball,
    "scan": scan,
}


def growth_child(family: str, path: Path) -> dict[str, Any]:
    """Seconds of each stage of one size of one family, and the most memory held."""
    from controller.cad import counted_samples, load_solid
    from controller.cad.compiled.cache import part_cache
    from controller.cad.compiled.part import CompiledPart
    from controller.cad.large import drop_derived
    from controller.cad.resting import (
        find_resting,
        look_alikes,
        name_duplicates,
        part_symmetries,
    )
    from controller.cad.surfaces.features import find_features
    from controller.cad.views import line_view, prepare_views

    seconds: dict[str, float] = {}

    def timed(stage: str, work: Callable[[], Result]) -> Result:
        begin = time.process_time()
        result = work()
        seconds[stage] = time.process_time() - begin
        return result

    solid = timed("read", lambda: load_solid(path, unit="mm"))
    timed("boundary", lambda: solid.boundary)
    symmetry = timed("symmetry", lambda: part_symmetries(solid))
    drop_derived(solid.mesh)
    resting = timed("poses", lambda: find_resting(solid))
    poses = name_duplicates(resting.poses, symmetry)

    def views() -> tuple[Any, ...]:
        prepared = prepare_views(solid)
        return tuple(line_view(solid, pose.R, prepared=prepared) for pose in poses)

    drawn = timed("views", views)
    alike = timed("alike", lambda: look_alikes(solid, poses, drawn))
    samples = timed("samples", lambda: counted_samples(solid, 1.0))
    features = timed("features", lambda: find_features(solid))
    part = CompiledPart(solid, resting, symmetry, drawn, alike, samples, 3.0, features, (), ())
    with tempfile.TemporaryDirectory() as folder:
        timed("keep", lambda: part_cache().save(Path(folder) / "part.npz", part))
    return {
        "family": family,
        "triangles": len(solid.mesh.faces),
        "surfaces": len(solid.faces),
        "poses": len(poses),
        "seconds": {stage: round(seconds[stage], 4) for stage in STAGES},
        "total_s": round(sum(seconds.values()), 3),
        "rss_mb": round(_most_mb()),
    }


def bench_growth(sizes: list[int], limit_s: float) -> list[dict[str, Any]]:
    found = []
    for family in FAMILIES:
        rows: list[dict[str, Any]] = []
        for size in sizes:
            try:
                done = _grown(family, size, limit_s)
            except subprocess.TimeoutExpired:
                rows.append({"family": family, "asked": size, "over_s": limit_s})
                break
            if done.returncode:
                told = (done.stderr.strip().splitlines() or ["ended without a word"])[-1]
                rows.append({"family": family, "asked": size, "failed": told})
                break
            rows.append(json.loads(done.stdout.splitlines()[-1]))
        found.append({"family": family, "rows": rows, "growth": _growth(rows)})
    return found


def _grown(family: str, size: int, limit_s: float) -> subprocess.CompletedProcess[str]:
    """Return what the child that measures one size wrote; another one made the file before."""
    this = [sys.executable, str(Path(__file__))]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"{family}.stl"
        subprocess.run([*this, "--write", f"{family}:{size}:{file}"], check=True)
        return subprocess.run(
            [*this, "--child", f"{family}:{file}"],
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )


def _growth(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Exponents between the last two sizes, and the ratio to n log n."""
    done = [row for row in rows if "seconds" in row]
    if len(done) < 2:
        return {}
    first, last = done[-2], done[-1]  # where overheads no longer hide it
    n, m = first["triangles"], last["triangles"]
    n_log_n = m * math.log(m) / (n * math.log(n))
    told: dict[str, Any] = {"from": n, "to": m, "stages": {}}
    for stage in (*STAGES, "total"):
        a = first["total_s"] if stage == "total" else first["seconds"][stage]
        b = last["total_s"] if stage == "total" else last["seconds"][stage]
        if a <= 0:
            continue
        told["stages"][stage] = {
            "exponent": round(math.log(b / a) / math.log(m / n), 2),
            "of_n_log_n": round(b / a / n_log_n, 2),
        }
    told["within"] = told["stages"]["total"]["of_n_log_n"] <= SLACK
    return told


def main() -> int:
    parser = Arguments(
        __doc__, parts=[ROOT / "recipes" / "parts" / "holder.stl"], growth=[1_000, 10_000]
    )
    parser.add_argument("--parts", nargs="*", type=Path)
    parser.add_argument("--growth", nargs="*", type=int, default=list(GROWTH))
    parser.add_argument("--only", choices=("parts", "growth"))
    parser.add_argument("--limit-s", type=float, default=300.0, help="of one size of one family")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--write", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.write:
        family, size, file = args.write.split(":", 2)
        FAMILIES[family](int(size)).export(file)
        return 0
    if args.child:
        family, _, file = args.child.partition(":")
        row = growth_child(family, Path(file)) if family in FAMILIES else child(Path(args.child))
        print(json.dumps(row))
        return 0
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as a worker process has it
    rows: list[dict[str, Any]] = []
    figures: dict[str, Any] = {"load": os.getloadavg()[0], "asked of a part": LIMITS}
    if args.only != "growth":
        rows += bench_parts(args.parts or sorted((ROOT / "recipes" / "parts").glob("*.stl")))
        figures["parts within"] = sum(row.get("within", False) for row in rows)
    if args.only != "parts":
        for one in bench_growth(args.growth, args.limit_s):
            rows += [{**row, **row.pop("seconds", {})} for row in one["rows"]]
            figures[f"{one['family']}, of n log n"] = {
                stage: of["of_n_log_n"] for stage, of in one["growth"].get("stages", {}).items()
            }
    show(args, rows, figures)
    return 0


if __name__ == "__main__":
    sys.exit(main())
