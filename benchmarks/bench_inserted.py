"""Marks painted into pictures of good parts: how probably is each kind found, by size and surface?

    python benchmarks/bench_inserted.py FOLDER [--json] [--seed 1] [--rounds 4] [--marks 5]
           [--limit N] [--out marks.jsonl]

FOLDER is one of benchmarks/trace_held.py; its good specimens alone are used. Some marks at a time
are painted into all pictures that show their places (`inserted_marks.py`), at places that the room
says it compared under a lamp, and the set is judged by what `cellctl inspect` calls. A mark is
found where a finding of any kind comes to be within 2 mm of it beyond half of its size, and proven
where that fails the part. What is found of marks is their probability of detection; behind each
share stands its exact one-sided limit (Clopper and Pearson, 95 %). a90/95 is the size found with
90 %, with the same confidence, by a logistic curve over the logarithm of the size.

Another seed, or another folder, is another draw: tune on one and tell of the other.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from inserted_marks import SCRATCH_MM, Mark, Scene, draw_marks
from inspection_truth import CONFIDENCE, lower_limit
from numpy.typing import NDArray
from scipy.stats import norm

from controller.cad import Solid
from controller.config.view_set import load_view_set
from controller.inspection import InspectionLimits, PartInspection, Verdict
from controller.stored import Judging, compiled_part, judge_views, read_pictures
from controller.stored.view_set import build_view_set

Array = NDArray[np.float64]
Words = dict[str, Any]
NARROW_MM = 8.0  # a plane no wider than this
APART_MM = 14.0  # marks of one round do not touch each other's surroundings
NEAR_MM = 2.0
WANTED = 0.9


@dataclass(frozen=True)
class Outcome:
    """What became of one mark."""

    specimen: str
    kind: str
    size_mm: float
    surface: str
    views: int
    is_found: bool
    is_proven: bool


def surface_kinds(solid: Solid) -> list[str]:
    """Return by face what kind of surface it is: plane, narrow (plane), cylinder, cone, other."""
    mesh = solid.mesh
    pairs, edges = mesh.face_adjacency, mesh.face_adjacency_edges
    of = solid.face_of_triangle
    border = of[pairs[:, 0]] != of[pairs[:, 1]]
    ends = mesh.vertices[edges[border]]
    share = np.linspace(0, 1, 9)[:, None]
    out = []
    for face in solid.faces:
        kind = face.kind if face.kind in ("plane", "cylinder", "cone") else "other"
        if kind == "plane":
            mine = (of[pairs[border]] == face.id).any(axis=1)
            rim = np.concatenate([a + share * (b - a) for a, b in ends[mine]])
            inside = mesh.submesh([np.flatnonzero(of == face.id)], append=True)
            points, _ = trimesh.sample.sample_surface(inside, 300, seed=1)
            away = np.linalg.norm(points[:, None] - rim[None], axis=2).min(axis=1)
            kind = "narrow" if 2 * away.max() < NARROW_MM else "plane"
        out.append(str(kind))
    return out


def judge_set(path: Path, truth: Words, args: argparse.Namespace) -> list[Outcome]:
    """Return the outcomes of all marks of one specimen."""
    set_path = path / "SET.json"
    words = json.loads(set_path.read_text())
    file = load_view_set(set_path)
    part = compiled_part(set_path, file)
    pictures = read_pictures(set_path, file)
    judging = Judging(None, set_path, set_path)
    before = judge_views(file, part, pictures, judging)
    views = build_view_set(file, part, pictures, InspectionLimits())
    solid, samples = views.part.solid, views.samples
    compared = np.zeros(len(samples.points_mm), dtype=bool)
    for view in before.views:
        for check in view.checks:
            if check.name != "outline" and not check.reason:
                compared |= check.compared
    claimed = np.flatnonzero(compared)
    if not len(claimed):
        return []
    kinds = surface_kinds(solid)
    surfaces = [kinds[i] for i in samples.face_ids[claimed]]
    scene = Scene(words, truth, solid.mesh, solid.face_of_triangle, views.views[0].task.camera)
    number = int(truth["specimen"].lstrip("s"))
    out = []
    for turn in range(args.rounds):
        rng = np.random.default_rng([args.seed, number, turn])
        marks = list(
            draw_marks(
                samples.points_mm[claimed], samples.normals[claimed], samples.face_ids[claimed],
                surfaces, rng, args.marks, APART_MM,
            )
        )  # fmt: skip
        painted = {v: {k: p.copy() for k, p in of.items()} for v, of in pictures.items()}
        shown = scene.paint(painted, marks)
        after = judge_views(file, part, painted, judging)
        for mark, count in zip(marks, shown, strict=True):
            found, proven = _fate(mark, before, after)
            out.append(
                Outcome(
                    truth["specimen"], mark.kind, mark.size_mm, mark.surface, count, found, proven
                )
            )
    return out


def _fate(mark: Mark, before: PartInspection, after: PartInspection) -> tuple[bool, bool]:
    """Return whether something new is said of a mark's place, and whether it is proven."""
    length = SCRATCH_MM if mark.kind == "scratch" else mark.size_mm
    reach = NEAR_MM + length / 2

    def said(part: PartInspection) -> list[Verdict]:
        return [
            f.verdict for f in part.findings if np.linalg.norm(f.p_part_mm - mark.p_part_mm) < reach
        ]

    new = said(after)
    if len(new) <= len(said(before)):
        return False, False
    return True, Verdict.FAIL in new


def a90_95(sizes: Array, found: NDArray[np.bool_]) -> tuple[float | None, float | None]:
    """Return the size found with 90 %, and its upper limit; None where the marks do not tell.

    Parameters
    ----------
    sizes : (n,) of marks [mm]
    found : (n,) which were
    """
    if found.all() or not found.any() or len(np.unique(sizes)) < 2:
        return None, None
    x = np.column_stack([np.ones(len(sizes)), np.log(sizes)])
    beta, ridge = np.zeros(2), 1e-3 * np.eye(2)
    for _ in range(50):
        p = 1 / (1 + np.exp(-np.clip(x @ beta, -30, 30)))
        information = (x * (p * (1 - p))[:, None]).T @ x + ridge
        beta = beta + np.linalg.solve(information, x.T @ (found - p) - ridge @ beta)
    if beta[1] <= 0:
        return None, None
    logit = np.log(WANTED / (1 - WANTED))
    middle = (logit - beta[0]) / beta[1]
    slope = np.array([-1 / beta[1], -middle / beta[1]])
    spread = float(np.sqrt(slope @ np.linalg.solve(information, slope)))
    return float(np.exp(middle)), float(np.exp(middle + norm.ppf(CONFIDENCE) * spread))


def table(outcomes: list[Outcome]) -> list[Words]:
    """Return rows by kind, surface and size, each with its share found; sizes all first."""
    rows = []
    surfaces = ["all", *sorted({o.surface for o in outcomes})]
    for kind in sorted({o.kind for o in outcomes}):
        for surface in surfaces:
            mine = [o for o in outcomes if o.kind == kind and surface in ("all", o.surface)]
            if not mine:
                continue
            sizes = np.array([o.size_mm for o in mine])
            a90, a90_limit = a90_95(sizes, np.array([o.is_found for o in mine]))
            row = {"kind": kind, "surface": surface, "a90_mm": a90, "a90_95_mm": a90_limit}
            by = []
            for size in [None, *np.unique(sizes).tolist()]:
                some = [o for o in mine if size is None or o.size_mm == size]
                found = sum(o.is_found for o in some)
                by.append(
                    {
                        "size_mm": size, "n": len(some), "found": found,
                        "proven": sum(o.is_proven for o in some),
                        "at_least": lower_limit(found, len(some)),
                    }
                )  # fmt: skip
            rows.append(row | {"sizes": by})
    return rows


def main(argv: list[str] | None = None) -> int:
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=4, help="of marks, for each specimen")
    parser.add_argument("--marks", type=int, default=5, help="in a round, at most")
    parser.add_argument("--limit", type=int, default=0, help="specimens at most")
    parser.add_argument("--out", type=Path, help="one line of JSON for each mark")
    args = parser.parse_args(argv)
    truth = json.loads((args.folder / "truth.json").read_text())
    good = [
        s
        for s in truth["specimens"]
        if s["cls"] == "good" and (args.folder / s["specimen"] / "SET.json").is_file()
    ]
    outcomes: list[Outcome] = []
    for specimen in good[: args.limit or None]:
        of_set = judge_set(args.folder / specimen["specimen"], specimen, args)
        outcomes += [o for o in of_set if o.views]
        if args.out:
            with args.out.open("a") as file:
                for o in of_set:
                    file.write(json.dumps(o.__dict__) + "\n")
        if not args.json:
            found = sum(o.is_found for o in of_set if o.views)
            count = sum(1 for o in of_set if o.views)
            print(f"{specimen['specimen']} {specimen['part']:16} {found} of {count}", flush=True)
    rows = table(outcomes)
    if args.json:
        print(json.dumps({"seed": args.seed, "folder": args.folder.name, "rows": rows}))
        return 0
    for row in rows:
        a90 = "-" if row["a90_mm"] is None else f"{row['a90_mm']:.2f} < {row['a90_95_mm']:.2f} mm"
        print(f"\n{row['kind']} on {row['surface']}: a90/95 {a90}")
        for by in row["sizes"]:
            size = " all" if by["size_mm"] is None else f"{by['size_mm']:4.2f}"
            print(
                f"  {size}  {by['found']:3} of {by['n']:3} found (> {by['at_least']:.0%}), "
                f"{by['proven']} proven"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
