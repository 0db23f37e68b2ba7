"""What we make of the parts against the STEP kernel: volumes, surfaces, visible edges.

python benchmarks/bench_step.py [--json] [--parts NAME...] [--slanting 4] [--seed 7] [--only mass]

Each part with a STEP file beside its STL. Mass: volume, area, centroid and inertia of the solid
read from STEP and of the mesh of its STL against the kernel's integrals. Surfaces: each triangle of
the STL against the STEP face it lies on. Lines: the line drawing of each stable pose and of some
slanting directions against the kernel's exact hidden-line removal, with the solid from STEP and
with that from STL.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "cross"), str(ROOT / "tests" / "unit")]

from line_agreement import compare  # noqa: E402
from occ_views import ask  # noqa: E402
from shared_files import SHARED  # noqa: E402  (path set above)

from controller.cad import Solid, load_solid  # noqa: E402
from controller.cad.boundary import Face  # noqa: E402
from controller.cad.reading.step.files import StepPart, read_step_part  # noqa: E402
from controller.cad.views import line_view, prepare_views  # noqa: E402

SAME_RAD = np.radians(0.5)
SAME_MM = 0.02  # twice the chord error of the STL files
SAME_SHARE = 0.01


def mass_row(name: str, source: str, solid: Solid, part: StepPart) -> dict[str, Any]:
    """Relative errors; of the centroid by the diagonal, of the inertia by its largest moment."""
    exact = part.solid
    mesh = solid.mesh
    inertia = np.asarray(mesh.moment_inertia)
    return {
        "part": name,
        "source": source,
        "triangles": len(mesh.faces),
        "volume": abs(solid.volume_mm3 / exact.volume_mm3 - 1),
        "mesh_volume": abs(mesh.volume / exact.volume_mm3 - 1),
        "area": abs(mesh.area / part.area_mm2 - 1),
        "face_areas": abs(sum(f.area_mm2 for f in solid.faces) / part.area_mm2 - 1),
        "centroid": float(np.linalg.norm(solid.centroid_mm - exact.centroid_mm) / mesh.scale),
        "inertia": float(
            np.abs(inertia - part.inertia_mm5).max() / np.linalg.eigvalsh(part.inertia_mm5).max()
        ),
    }


def same_surface(ours: Face, exact: Face) -> tuple[bool, bool, bool]:
    """Whether kind, then radius, then axis are those of the STEP face."""
    if ours.kind != exact.kind:
        return False, False, False
    same_radius = all(
        abs(a - b) <= max(SAME_MM, SAME_SHARE * b)
        for a, b in (
            (ours.radius_mm, exact.radius_mm),
            (ours.minor_radius_mm, exact.minor_radius_mm),
        )
    )
    if exact.kind == "cone":  # its radius is at its centre, which moves with what belongs to it
        same_radius = abs(ours.half_angle_rad - exact.half_angle_rad) <= SAME_RAD
    if exact.kind in {"cylinder", "cone", "torus"}:
        along = abs(float(ours.axis @ exact.axis))
        offset = np.cross(ours.centre_mm - exact.centre_mm, exact.axis)
        same_axis = along >= np.cos(SAME_RAD) and float(np.linalg.norm(offset)) <= SAME_MM
    elif exact.kind == "plane":
        same_axis = float(ours.normal @ exact.normal) >= np.cos(SAME_RAD)
    elif exact.kind == "sphere":
        same_axis = float(np.linalg.norm(ours.centre_mm - exact.centre_mm)) <= SAME_MM
    else:
        same_axis = True
    return True, same_radius, same_radius and same_axis


def surface_row(name: str, stl: Solid, part: StepPart) -> dict[str, Any]:
    """Shares of the STL's area whose face is of the kind, radius and axis of the STEP face."""
    rng = np.random.default_rng(1)
    step = part.solid.mesh
    points, triangle = step.sample(400_000, return_index=True, seed=1)
    points += rng.normal(0, 1e-9, points.shape)  # no ties between faces at shared edges
    normals = np.asarray(step.face_normals)[triangle]
    scale = 0.5 * np.sqrt(step.area / len(points))  # a turn of 90 degrees weighs as some spacings
    tree = cKDTree(np.column_stack([points, 20 * scale * normals]))
    middle = np.asarray(stl.mesh.triangles_center)
    query = np.column_stack([middle, 20 * scale * np.asarray(stl.mesh.face_normals)])
    step_face = part.solid.face_of_triangle[triangle[tree.query(query)[1]]]
    pairs, which = np.unique(
        np.column_stack([stl.face_of_triangle, step_face]), axis=0, return_inverse=True
    )
    verdicts = np.array(
        [same_surface(stl.faces[ours], part.solid.faces[exact]) for ours, exact in pairs]
    )
    area = np.asarray(stl.mesh.area_faces)
    shares = (verdicts[which.ravel()] * area[:, None]).sum(axis=0) / area.sum()
    lost: dict[str, float] = {}
    for pair, ok, of in zip(pairs, verdicts, range(len(pairs)), strict=True):
        if not ok[2]:
            key = f"{part.solid.faces[pair[1]].kind} as {stl.faces[pair[0]].kind}"
            lost[key] = lost.get(key, 0.0) + float(area[which.ravel() == of].sum() / area.sum())
    return {
        "part": name,
        "step_faces": len(part.solid.faces),
        "stl_faces": len(stl.faces),
        "kind": float(shares[0]),
        "radius": float(shares[1]),
        "axis": float(shares[2]),
        "lost": {k: round(v, 5) for k, v in sorted(lost.items(), key=lambda x: -x[1])[:4]},
    }


def line_rows(
    name: str, solids: dict[str, Solid], file: Path, R: np.ndarray, resting: int
) -> list[dict[str, Any]]:
    """Both directions of agreement per view and solid."""
    origin_mm = solids["step"].centroid_mm
    begin = time.perf_counter()
    drawn = ask(file, R, origin_mm, timeout_s=60.0)
    kernel_s = time.perf_counter() - begin
    rows = []
    for source, solid in solids.items():
        prepared = prepare_views(solid)
        for i, lines in enumerate(drawn):
            row: dict[str, Any] = {
                "part": name,
                "source": source,
                "view": f"pose {i}" if i < resting else f"slanting {i - resting}",
                "kernel_s": round(kernel_s / len(R), 2),
            }
            rows.append(row)
            if lines is None:
                row["failed"] = "the kernel crashed or did not finish"
                continue
            begin = time.perf_counter()
            view = line_view(solid, R[i], prepared=prepared)
            row["ours_ms"] = round(1e3 * (time.perf_counter() - begin))
            shift = (R[i] @ (solid.centroid_mm - origin_mm))[:2]
            moved = dict(lines, points=lines["points"] - shift)
            agreement = compare(view, moved)
            row |= {
                "ours_mm": round(agreement.ours_mm, 1),
                "kernel_mm": round(agreement.kernel_mm, 1),
                "found": round(agreement.found, 5),
                "right": round(agreement.right, 5),
            }
    return rows


def bench(
    names: list[str], slanting: int, seed: int, only: set[str]
) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of each table."""
    parts = SHARED / "parts"
    manifest = {p["name"]: p for p in json.loads((parts / "manifest.json").read_text())["parts"]}
    rows: dict[str, list[dict[str, Any]]] = {"mass": [], "surfaces": [], "lines": []}
    for name in names or [n for n, p in manifest.items() if p.get("step")]:
        told = manifest[name]
        file = parts / told["step"]
        part, stl = read_step_part(file), load_solid(parts / told["stl"])
        if "mass" in only:
            rows["mass"].append(mass_row(name, "step", part.solid, part))
            rows["mass"].append(mass_row(name, "stl", stl, part))
        if "surfaces" in only:
            rows["surfaces"].append(surface_row(name, stl, part))
        if "lines" in only:
            poses = [np.array(pose["R"]) for pose in told["stable_poses"]]
            R = np.array([*poses, *Rotation.random(slanting, random_state=seed).as_matrix()])
            solids = {"step": part.solid, "stl": stl}
            rows["lines"] += line_rows(name, solids, file, R, len(poses))
    return rows


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--parts", nargs="*", default=[])
    parser.add_argument("--slanting", type=int, default=4)
    parser.add_argument("--seed", type=int, default=7)
    tables = ["mass", "surfaces", "lines"]
    parser.add_argument("--only", nargs="*", default=tables, choices=tables)
    args = parser.parse_args()
    rows = bench(args.parts, args.slanting, args.seed, set(args.only))
    if args.json:
        print(json.dumps(rows))
        return 0
    if rows["mass"]:
        print(
            "relative errors     from  triangles    volume      mesh      area  centroid   inertia"
        )
    for r in rows["mass"]:
        print(
            f"{r['part']:22}{r['source']:5}{r['triangles']:8}  "
            + "".join(
                f"{r[k]:10.1e}" for k in ("volume", "mesh_volume", "area", "centroid", "inertia")
            )
        )
    if rows["surfaces"]:
        print("\nshare of area          faces STEP  STL    kind %  radius %  axis %  not found")
    for r in rows["surfaces"]:
        print(
            f"{r['part']:28}{r['step_faces']:5}{r['stl_faces']:5}{100 * r['kind']:10.2f}"
            f"{100 * r['radius']:10.2f}{100 * r['axis']:8.2f}  {r['lost']}"
        )
    if rows["lines"]:
        print("\nvisible edges         from  view         ours mm kernel mm  found %  right %  ms")
    for r in rows["lines"]:
        print(
            f"{r['part']:22}{r['source']:6}{r['view']:12}"
            + (
                r["failed"]
                if "failed" in r
                else f"{r['ours_mm']:8.1f}{r['kernel_mm']:10.1f}{100 * r['found']:9.2f}"
                f"{100 * r['right']:9.2f}{r['ours_ms']:5}"
            )
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
