"""CPU seconds of the view tables: bare part, hand, arm and joints, at 80 grips and 200 directions.

python benchmarks/bench_view_tables.py [FILE...] [--grips 80] [--directions 200] [--json]

The grips are opposed points of the part's surface, each turned about the line between them: their
number and place are what the tables are timed on, whether they would hold is another matter.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from planning_cell import PARTS, emulated_layout  # noqa: E402  (path set above)

from controller.cad import Solid, SurfaceSamples, load_solid, sample_surface  # noqa: E402
from controller.imaging import RayCaster, inverse_pose  # noqa: E402
from controller.planning import Box, CellLayout, Grasp  # noqa: E402
from controller.planning.motion import Scene  # noqa: E402
from controller.planning.views import (  # noqa: E402
    VisibilityRules,
    candidate_directions,
    hidden_by_gripper,
    hold_up,
    holding_boxes,
    look_out,
    reachable_views,
    visible_from,
)

Array = NDArray[np.float64]
SPIN_COUNT = 8


def opposed_grips(
    solid: Solid, samples: SurfaceSamples, caster: RayCaster, widest_mm: float, count: int
) -> list[Grasp]:
    """Return hands that close on opposed points of the surface."""
    rng = np.random.default_rng(4)
    grasps: list[Grasp] = []
    for k in rng.permutation(len(samples.points_mm)):
        p, n = samples.points_mm[k], samples.normals[k]
        triangle, gap = caster.first_hit((p - 0.05 * n)[None], -n[None])
        if triangle[0] < 0 or gap[0] > widest_mm - 5.0:
            continue
        if np.asarray(solid.mesh.face_normals)[triangle[0]] @ n > -0.95:
            continue
        helper = np.eye(3)[int(np.argmin(np.abs(n)))]
        side = np.cross(n, helper) / np.linalg.norm(np.cross(n, helper))
        angle = 2 * np.pi * rng.integers(SPIN_COUNT) / SPIN_COUNT
        x = np.cos(angle) * side + np.sin(angle) * np.cross(n, side)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, n, np.cross(x, n)])
        T[:3, 3] = p - n * gap[0] / 2 + 10.0 * x
        grasps.append(Grasp(f"B{k}", T, float(gap[0]), float(gap[0]) + 10.0, 50.0, 0.2, 0.8, "arm"))
        if len(grasps) == count:
            break
    return grasps


def bench(path: Path, layout: CellLayout, grasp_count: int, direction_count: int) -> dict[str, Any]:
    """Return one part's figures."""
    clock = time.process_time
    solid = load_solid(path)
    samples = sample_surface(solid, 4.0)
    caster = RayCaster(solid.mesh)
    rules = VisibilityRules.of_station(layout, 70.0, 1.0)
    at = [clock()]
    base = candidate_directions(solid, direction_count)
    plain = visible_from(solid, samples, caster, base.vectors, rules)
    at.append(clock())
    visibility_table = look_out(solid, samples, caster, rules, direction_count)
    at.append(clock())
    grasps = opposed_grips(solid, samples, caster, layout.arm_gripper.max_mm, grasp_count)
    vectors, visible = visibility_table.directions.vectors, visibility_table.visible
    at.append(clock())
    left = [
        visible
        & ~hidden_by_gripper(
            solid,
            samples,
            visible,
            vectors,
            rules.distance_mm,
            g.T_part_tcp,
            holding_boxes(layout.arm_gripper, g),
        )
        for g in grasps
    ]
    at.append(clock())
    showing = hold_up(solid, samples, layout, vectors)
    at.append(clock())
    low, high = solid.mesh.bounds
    part_box = Box.from_bounds(low[0], high[0], low[1], high[1], low[2], high[2])
    found = []
    for g, shown in zip(grasps, left, strict=True):
        carried = part_box.placed(inverse_pose(g.T_part_tcp))
        scene = Scene(layout, g.opening_mm, layout.fixed_open_mm, carried)
        found.append(
            reachable_views(layout, scene, samples, showing, shown, g.T_part_tcp, layout.park_q)
        )
    at.append(clock())
    spent = np.diff(at)
    views = sum(len(f.q) for f in found)
    hidden = [
        float(shown[v].sum() - f.shown[v].sum()) / float(shown[v].sum())
        for f, shown in zip(found, left, strict=True)
        for v in f.q
        if (f.shown[v] != shown[v]).any()
    ]
    return {
        "part": path.stem,
        "triangles": len(solid.mesh.faces),
        "samples": len(samples.points_mm),
        "grips": len(grasps),
        "directions": [len(base.vectors), len(vectors)],
        "never_shown": [int((~plain.any(axis=0)).sum()), int((~visible.any(axis=0)).sum())],
        "visible_per_direction": round(float(visible.sum(axis=1).mean()), 1),
        "bare_s": round(spent[0], 3),
        "lookout_s": round(spent[1], 3),
        "hand_s": round(spent[3], 3),
        "hold_up_s": round(spent[4], 3),
        "reach_s": round(spent[5], 3),
        "views_per_grip": round(views / max(1, len(grasps)), 1),
        "q_per_view": round(sum(len(q) for f in found for q in f.q.values()) / max(1, views), 2),
        "arm_hides_in": round(len(hidden) / max(1, views), 4),
        "of_which_lost": round(float(np.mean(hidden)), 3) if hidden else 0.0,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--grips", type=int, default=80)
    parser.add_argument("--directions", type=int, default=200)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    layout = emulated_layout()
    for path in args.files or sorted(PARTS.glob("*.stl")):
        row = bench(path, layout, args.grips, args.directions)
        if args.json:
            print(json.dumps(row))
            continue
        print(", ".join(f"{k} {v}" for k, v in row.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
