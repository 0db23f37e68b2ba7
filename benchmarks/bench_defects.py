"""Seeded defects on parts the limits were not tuned on: is any of them called "no difference"?

Each defect is cut from the exact mesh, or added to it; 14 views, pictures of the emulated world. A
wrong PASS is a verdict PASS (faces compared too little left out by name) although most of the
defect's surface was counted as compared. Defects in surface that is not counted are told apart; so
is what was found.

    python benchmarks/bench_defects.py [--json] [--parts tee_bracket] [--defects "pit 8 mm"]
"""

import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import manifold3d
import numpy as np
import trimesh
from bench import ROOT, Arguments, note, show
from inspection_scenes import Held, Station, judged_views
from numpy.typing import NDArray

from controller.cad import Face
from controller.inspection import InspectionLimits, Verdict, judge

Array = NDArray[np.float64]
Body = manifold3d.Manifold
FOLDER = ROOT / "benchmarks" / "corner_parts"
HELD_OUT = ("tee_bracket", "v_block", "corner_jig", "pocket_plate", "rib_bracket")
NEAR_MM = 1.0  # surface of the nominal part this near to changed surface is where a defect is


def rod(axis: Array, at: Array, radius: float, length: float) -> Body:
    """Return a cylinder about a line."""
    T = trimesh.geometry.align_vectors([0, 0, 1], axis)
    T[:3, 3] = at
    return Body.cylinder(length, radius, radius, 96, True).transform(T[:3])


def bores(held: Held) -> list[Any]:
    return [f for f in held.solid.faces if f.kind == "cylinder" and f.concave and f.radius_mm < 9]


def planes(held: Held) -> list[Any]:
    return [f for f in held.solid.faces if f.kind == "plane"]


def on_plane(held: Held, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a sample of one of the four largest planes, 6 mm off its edges if there is one."""
    face = planes(held)[int(rng.integers(min(4, len(planes(held)))))]
    mine = held.samples.points_mm[held.samples.face_ids == face.id]
    others = held.samples.points_mm[held.samples.face_ids != face.id]
    room = np.array([np.linalg.norm(others - p, axis=1).min() for p in mine])
    good = np.flatnonzero(room > min(6.0, room.max() * 0.99))
    return mine[int(rng.choice(good))], face.normal


def bore_small(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A bore 2 mm too small in diameter."""
    face = bores(held)[int(rng.integers(len(bores(held))))]
    lining = rod(face.axis, face.centre_mm, face.radius_mm + 0.3, bore_length(held, face))
    lining -= rod(face.axis, face.centre_mm, face.radius_mm - 1.0, 200.0)
    return body + (lining ^ body.hull())


def bore_length(held: Held, face: Face) -> float:
    mine = np.asarray(held.solid.mesh.triangles)[held.solid.face_of_triangle == face.id]
    along = mine.reshape(-1, 3) @ face.axis
    return float(np.ptp(along)) - 1e-3


def bore_moved(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A bore 1 mm out of place."""
    face = bores(held)[int(rng.integers(len(bores(held))))]
    side = np.cross(face.axis, rng.normal(size=3))
    side /= np.linalg.norm(side)
    length = bore_length(held, face)
    filled = body + rod(face.axis, face.centre_mm, face.radius_mm + 0.2, length)
    return filled - rod(face.axis, face.centre_mm + side, face.radius_mm, length + 0.01)


def filled_hole(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A bore that is not there."""
    face = bores(held)[int(rng.integers(len(bores(held))))]
    return body + rod(face.axis, face.centre_mm, face.radius_mm + 0.2, bore_length(held, face))


def thick(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """One large flat side 1 mm too thick."""
    low, high = held.solid.mesh.bounds
    size = high - low
    axis = int(np.argmin(size))
    scale = np.ones(3)
    scale[axis] = (size[axis] + 1.0) / size[axis]
    return body.translate(tuple(-low)).scale(tuple(scale)).translate(tuple(low))


def chip(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A chip of 3 mm off a convex edge: a ball of that diameter about a point of it."""
    edges = held.solid.mesh.face_adjacency_edges[
        held.solid.mesh.face_adjacency_convex & (held.solid.mesh.face_adjacency_angles > 1.2)
    ]
    ends = np.asarray(held.solid.mesh.vertices)[edges]
    long = ends[np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > 12]
    a, b = long[int(rng.integers(len(long)))]
    at = a + rng.uniform(0.3, 0.7) * (b - a)
    return body - Body.sphere(1.5, 48).translate(tuple(at))


def groove(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A groove 22 mm long, 3 mm wide and 1.5 mm deep in a plane."""
    at, normal = on_plane(held, rng)
    side = np.cross(normal, rng.normal(size=3))
    side /= np.linalg.norm(side)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([side, np.cross(normal, side), normal])
    T[:3, 3] = at
    return body - Body.cube((22.0, 3.0, 3.0), True).transform(T[:3])


def pit(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A pit 8 mm wide and 2 mm deep, in a round boss if there is one, else in a plane."""
    rounds = [f for f in held.solid.faces if f.kind == "cylinder" and not f.concave]
    if rounds:
        mine = held.samples.face_ids == rounds[0].id
        i = int(rng.choice(np.flatnonzero(mine)))
        at, normal = held.samples.points_mm[i], held.samples.normals[i]
    else:
        at, normal = on_plane(held, rng)
    return body - Body.sphere(5.0, 64).translate(tuple(at + 3.0 * normal))


def missing_block(held: Held, body: Body, rng: np.random.Generator) -> Body:
    """A corner of 12 mm that is not there."""
    low, high = held.solid.mesh.bounds
    vertices = np.asarray(held.solid.mesh.vertices)
    corner = np.where(rng.random(3) < 0.5, low, high)
    at = vertices[int(np.argmin(np.linalg.norm(vertices - corner, axis=1)))]
    return body - Body.cube((12.0, 12.0, 12.0), True).translate(tuple(at))


DEFECTS: dict[str, Callable[[Held, Body, np.random.Generator], Body]] = {
    "bore 2 mm too small": bore_small,
    "bore moved 1 mm": bore_moved,
    "flange 1 mm too thick": thick,
    "chip 3 mm": chip,
    "groove 22 mm": groove,
    "pit 8 mm": pit,
    "filled hole": filled_hole,
    "missing block": missing_block,
}


def as_body(mesh: trimesh.Trimesh) -> Body:
    return Body(
        manifold3d.Mesh(np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.uint32))
    )


def as_mesh(body: Body) -> trimesh.Trimesh:
    mesh = body.to_mesh()
    return trimesh.Trimesh(
        np.asarray(mesh.vert_properties, dtype=float)[:, :3], np.asarray(mesh.tri_verts)
    )


def run_one(held: Held, name: str, seed: int) -> dict[str, Any] | None:
    """Return what became of one defect; None where the part has no place for it."""
    rng = np.random.default_rng(seed)
    if ("bore" in name or "hole" in name) and not bores(held):
        return None
    spoilt = as_mesh(DEFECTS[name](held, as_body(held.solid.mesh), rng))
    limits = InspectionLimits()
    views = [v for v, _, _ in judged_views(held, Station(spoilt), seed, limits)]
    strict = judge(held.solid, held.samples, views, {}, 0.3, limits)
    named = {
        f.face_id: "compared too little"
        for f in strict.faces
        if f.verdict is Verdict.NOT_EVALUATED and f.area_mm2 >= limits.min_area_mm2
    }
    got = judge(held.solid, held.samples, views, {}, 0.3, limits, named)
    # where the nominal surface is no longer: nominal samples off the spoilt part
    _, distance, _ = trimesh.proximity.closest_point(spoilt, held.samples.points_mm)
    gone = distance > 0.15
    # and where material came on top, or a hollow opened between samples
    extra, _ = trimesh.sample.sample_surface(spoilt, 20000, seed=1)
    _, off, _ = trimesh.proximity.closest_point(held.solid.mesh, extra)
    changed = extra[off > 0.15]
    if len(changed):
        tree = np.min(
            np.linalg.norm(held.samples.points_mm[:, None] - changed[None, ::7], axis=2), axis=1
        )
        gone |= tree < NEAR_MM
    seen = np.logical_or.reduce([v.compared for v in views if v.evaluated] or [gone & False])
    lit = np.logical_or.reduce(
        [c.compared for v in views for c in v.checks if c.name != "outline"] or [gone & False]
    )
    return {
        "part": held.solid.name,
        "defect": name,
        "seed": seed,
        "verdict": got.verdict.value,
        "samples": int(gone.sum()),
        "counted": round(float(seen[gone].mean()), 3) if gone.any() else 0.0,
        "counted_lit": round(float(lit[gone].mean()), 3) if gone.any() else 0.0,
        "findings": sum(len(v.findings) for v in views),
        "views_failed": sum(not v.evaluated for v in views),
        "why": got.reasons[0],
        "claim": got.claim,
    }


def main() -> int:
    parser = Arguments(__doc__, parts=["tee_bracket"], defects=["pit 8 mm"])
    parser.add_argument("--parts", nargs="+", default=list(HELD_OUT))
    parser.add_argument("--defects", nargs="+", default=list(DEFECTS))
    parser.add_argument("--seed", type=int, default=101)
    args = parser.parse_args()
    rows = []
    for part in args.parts:
        held = Held.load(FOLDER / f"{part}.csg.yaml")
        for name in args.defects:
            row = run_one(held, name, args.seed)
            if row is not None:
                rows.append(row)
                note(row)
    passed = [r for r in rows if r["verdict"] == "pass"]
    wrong = sum(r["counted"] > 0.5 for r in passed)
    verdicts = Counter(r["verdict"] for r in rows)
    show(args, rows, {"defects": len(rows), **verdicts, "passed though counted": wrong})
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
