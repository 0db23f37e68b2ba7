"""Is the coverage that a plan states true of the surface? Face by face, on points of its own.

python benchmarks/bench_coverage.py [--parts NAME...] [--files FILE...] [--poses 1] [--seed 1]

Points are drawn at random, by trimesh, and seen or not by planning_sight, which is exact and shares
no code with the planner. A plan counts what is clear of gripper and arm by 2 mm and of the
picture's border by 12 px; so does the judge (`error`), and once more without these margins
(`bare`), which the plan may fall short of and must not exceed. Shares are in percent of a face;
faces of 2 mm2 or less are left out. `hidden` points that the plan calls hidden by the part itself
are searched for a free line within the limit by lines all round (`false`). Seconds are CPU seconds.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from bench import Arguments, show
from known_parts import planning_parts, start_poses
from numpy.typing import NDArray
from planning_cell import emulated_layout
from planning_checker import Moment, follow
from planning_contacts import Checker, finger_boxes, frames
from planning_sight import (
    VisibilityRules,
    box_triangles,
    in_sight,
    pixels_of,
)

from controller.cad import Solid, SurfaceSamples, surface_normals
from controller.cad.compiled import CompileOptions, load_part
from controller.planning import (
    CellLayout,
    Look,
    NoPlanError,
    OnTable,
    Plan,
    PlanOptions,
    PreparedPart,
    plan_from,
    prepare_part,
    resting_pose,
)

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MARGIN_MM, BORDER_PX = 2.0, 12.0
FIRST_COUNT, FULL_COUNT = 1500, 24_000  # points on a face; the second where only some are seen
LEAST_MM2 = 2.0


@dataclass
class Points:
    """Random points of some faces."""

    at: Array
    normals: Array
    faces: NDArray[np.int64]


@dataclass
class FaceRow:
    """One face: what the plan states, and what is true, in percent."""

    face: int
    label: str
    area_mm2: float
    stated: float
    true: float
    bare: float

    @property
    def error(self) -> float:
        return self.stated - self.true


@dataclass
class Row:
    """One part in one pose."""

    part: str
    pose: int
    samples: int = 0
    counted: int = 0
    prepare_s: float = float("nan")
    plan_s: float = float("nan")
    failure: str = ""
    views: int = 0
    stated: float = 0.0
    stated_uncertainty: float = 0.0
    true: float = 0.0
    reachable: float = 0.0
    faces: list[FaceRow] = field(default_factory=list)

    @property
    def errors(self) -> Array:
        return np.array([abs(f.error) for f in self.faces])


def drawn(solid: Solid, face: int, count: int, seed: int) -> Points:
    """Return random points on one face, with the normals of its surface."""
    (rows,) = np.nonzero(solid.face_of_triangle == face)
    piece = solid.mesh.submesh([rows], append=True, repair=False)
    at, triangle = trimesh.sample.sample_surface(piece, count, seed=seed)
    at = np.asarray(at, dtype=np.float64)
    facets = np.asarray(solid.mesh.face_normals)[rows[triangle]]
    ids = np.full(count, face)
    return Points(at, surface_normals(solid.faces, ids, at, facets), ids)


class Judge:
    """Sees points from the views of a plan."""

    def __init__(self, solid: Solid, layout: CellLayout, options: PlanOptions) -> None:
        self.solid, self.layout = solid, layout
        self.triangles = np.asarray(solid.mesh.triangles)
        self.checker = Checker(layout, solid)
        angle = float(np.radians(options.max_incidence_deg))
        least = options.min_px_per_mm
        self.held = VisibilityRules(angle, least, layout.inspection_sharp_mm)
        self.lying = VisibilityRules(angle, least, layout.overhead_sharp_mm)

    def seen(self, moments: list[Moment], points: Points, margin_mm: float, border: float) -> Mask:
        seen = np.zeros(len(points.at), dtype=bool)
        for moment in moments:
            (left,) = np.nonzero(~seen)
            seen[left] = self._in(moment, points.at[left], points.normals[left], margin_mm, border)
        return seen

    def _in(
        self, moment: Moment, at: Array, normals: Array, margin_mm: float, border: float
    ) -> Mask:
        is_look = isinstance(moment.step, Look)
        layout = self.layout
        camera = layout.overhead if is_look else layout.inspection
        R, t = moment.T_world_part[:3, :3], moment.T_world_part[:3, 3]
        occluders = [self.triangles @ R.T + t]
        eye = camera.T_world_cam[:3, 3]
        if not is_look:
            tip = frames(layout, moment.q)["tip"]
            hand = [
                *((b.T, b.half_mm) for b in layout.arm_gripper.body),
                *finger_boxes(layout.arm_gripper, moment.arm_opening_mm),
            ]
            f = frames(layout, moment.q)
            boxes = [(tip @ T, half) for T, half in hand]
            boxes += [(f[link.name] @ link.T, link.half_mm) for link in layout.arm.links]
            still = self.checker.still_parts(moment.fixed_opening_mm)
            boxes += [(T, half) for _, _, T, half in still]
            for T, half in boxes:
                if (np.abs((eye - T[:3, 3]) @ T[:3, :3]) > half).any():
                    occluders.append(box_triangles(T, half + margin_mm))
        world = at @ R.T + t
        rules = self.lying if is_look else self.held
        found = in_sight(world, normals @ R.T, camera, np.vstack(occluders), rules).seen
        pixels = pixels_of(camera, world)
        inset = np.minimum(pixels, np.array(camera.size_px) - 1 - pixels).min(axis=1)
        return np.asarray(found & (inset >= border))


def shares(samples: SurfaceSamples, seen: Mask, count: int) -> Array:
    """Return the share of each face (f,) that a plan states, in percent."""
    whole = np.bincount(samples.face_ids, samples.areas_mm2, count)
    part = np.bincount(samples.face_ids[seen], samples.areas_mm2[seen], count)
    return np.asarray(100.0 * part / np.maximum(whole, 1e-300))


def seen_by(plan: Plan, count: int) -> Mask:
    seen = np.zeros(count, dtype=bool)
    for step in plan.steps:
        mask = getattr(step, "seen", None)
        if mask is not None:
            seen |= np.asarray(mask)
    return seen


def judge_plan(
    row: Row, part: PreparedPart, layout: CellLayout, plan: Plan, start: OnTable, seed: int
) -> None:
    solid, samples = part.solid, part.counted_samples
    judge = Judge(solid, layout, part.options)
    moments = follow(plan, layout, solid, start).moments
    seen = seen_by(plan, len(samples.points_mm))
    stated = shares(samples, seen, len(solid.faces))
    row.views, row.stated = len(moments), 100.0 * plan.covered_fraction
    row.stated_uncertainty, row.reachable = 100.0 * plan.covered_U, 100.0 * plan.reachable_fraction
    total = 0.0
    for face in solid.faces:
        points = drawn(solid, face.id, FIRST_COUNT, seed)
        true = 100.0 * float(judge.seen(moments, points, MARGIN_MM, BORDER_PX).mean())
        if 0.0 < true < 100.0 or 0.0 < stated[face.id] < 100.0:
            points = drawn(solid, face.id, FULL_COUNT, seed + 1)
            true = 100.0 * float(judge.seen(moments, points, MARGIN_MM, BORDER_PX).mean())
        total += true * face.area_mm2
        if face.area_mm2 > LEAST_MM2:
            bare = 100.0
            if true < 100.0:
                bare = 100.0 * float(judge.seen(moments, points, 0.0, 0.0).mean())
            row.faces.append(
                FaceRow(face.id, face.label, face.area_mm2, float(stated[face.id]), true, bare)
            )
    row.true = total / sum(f.area_mm2 for f in solid.faces)


def bench(name: str, path: Path, args: argparse.Namespace) -> list[Row]:
    needs_unit = path.suffix in (".stl", ".obj", ".ply", ".off")
    compiled = load_part(path, CompileOptions(unit="mm" if needs_unit else None))
    layout, options, solid = emulated_layout(), PlanOptions(), compiled.solid
    begin = time.process_time()
    rows: list[Row] = []
    try:
        prepared = prepare_part(solid, compiled.chosen_by, layout, options, compiled.samples)
    except NoPlanError as error:
        return [Row(name, -1, failure=str(error))]
    prepare_s = time.process_time() - begin
    x, y = layout.set_down_mm.mean(axis=1)
    for pose in start_poses(compiled):
        if len([r for r in rows if not r.failure]) >= args.poses:
            break
        row = Row(
            name, pose.index, len(prepared.samples.points_mm), len(compiled.samples.points_mm)
        )
        row.prepare_s = prepare_s
        start = OnTable(pose.index, resting_pose(solid, pose, float(x), float(y)))
        begin = time.process_time()
        try:
            plan = plan_from(prepared, layout, start)
        except NoPlanError as error:
            row.failure = str(error)
            rows.append(row)
            continue
        row.plan_s = time.process_time() - begin
        judge_plan(row, prepared, layout, plan, start, args.seed)
        rows.append(row)
    return rows


def main() -> int:
    parser = Arguments(__doc__, parts=["cover_plate"])
    parser.add_argument("--parts", nargs="*", default=None)
    parser.add_argument("--files", nargs="*", type=Path, default=[])
    parser.add_argument("--poses", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    files = {} if args.parts is None and args.files else planning_parts(args.parts or ())
    files |= {f.name.split(".")[0]: f for f in args.files}
    rows: list[Row] = []
    for name, path in files.items():
        rows += bench(name, path, args)
    done = [r for r in rows if not r.failure]
    figures: dict[str, object] = {"parts": len({r.part for r in done})}
    if done:
        errors = np.concatenate([r.errors for r in done])
        figures |= {
            "faces": len(errors),
            "|stated - true| of a face, mean %": float(errors.mean()),
            "largest %": float(errors.max()),
            "faces over 0.5 %": int((errors > 0.5).sum()),
            "of a whole part at most %": max(abs(r.stated - r.true) for r in done),
        }
    show(args, [row_of(r) for r in rows], figures)
    return 0


def row_of(row: Row) -> dict[str, object]:
    """Return one part in one pose as a table has it, with its face that is most off."""
    told = {key: value for key, value in asdict(row).items() if key != "faces"}
    worst = max(row.faces, key=lambda f: abs(f.error), default=None)
    return told if worst is None else told | {"worst face": worst.label, "off %": worst.error}


if __name__ == "__main__":
    sys.exit(main())
