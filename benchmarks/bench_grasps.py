"""How many ways two jaws hold each part, what each demand leaves, and how long that takes.

python benchmarks/bench_grasps.py [--coarse | --materials] [--part NAME ...] [--json]

Parts are those of recipes/parts, of benchmarks/parts and, where the papers lie beside the checkout,
of shared/parts; the jaws are those of the emulated cell. Seconds are processor time. With
--materials: the share of each part's grips (found for aluminium, friction 0.5, 30 N) that hold with
safety 2 when the part is of steel, the pads oily or the jaw weaker (planning-facts.md 2.3).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from planning_cell import emulated_layout  # noqa: E402
from shared_files import SHARED  # noqa: E402  (path set above)

from controller.cad.compiled import CompiledPart, load_part  # noqa: E402
from controller.imaging import RayCaster  # noqa: E402
from controller.planning import Grasp, GraspRules, Jaw  # noqa: E402
from controller.planning.grasps import (  # noqa: E402
    GraspProblem,
    Seeds,
    Synthesis,
    find_seeds,
    judge_grasps,
    still_gravities,
)
from controller.planning.grasps.judge import Judge  # noqa: E402
from controller.planning.model import Holder  # noqa: E402

STEEL_KG_MM3 = 7.85e-6
BASE = GraspRules(friction=0.5)
MATERIALS = {  # name: density, friction, force
    "aluminium, 0.5, 30 N": (BASE.density_kg_mm3, 0.5, 30.0),
    "steel, 0.5, 30 N": (STEEL_KG_MM3, 0.5, 30.0),
    "steel, 0.2 (oily), 30 N": (STEEL_KG_MM3, 0.2, 30.0),
    "steel, 0.2, 15 N": (STEEL_KG_MM3, 0.2, 15.0),
}
SHOWN = {  # stages that make the table's columns, and what heads them
    "tried": "tried",
    "approach seems free": "approach",
    "enough contact": "contact",
    "strong enough": "strong",
    "clear of the part": "clear",
    "measured finely: strong enough": "fine",
    "measured finely: sure": "sure",
    "on the table: sure": "on table",
}


def part_files(names: Sequence[str]) -> list[Path]:
    """Return the CAD files, each part once, recipes' own first."""
    files = [
        *sorted((ROOT / "recipes" / "parts").glob("*.stl")),
        *sorted((ROOT / "recipes" / "parts").glob("*.csg.yaml")),
        *sorted((ROOT / "benchmarks" / "parts").glob("*.csg.yaml")),
    ]
    if (SHARED / "parts").is_dir():
        files += sorted((SHARED / "parts").glob("*.stl"))
    else:
        print("no shared/parts beside the checkout: its parts are left out", file=sys.stderr)
    once = {f.name: f for f in reversed(files)}
    return [f for f in once.values() if not names or any(n in f.name for n in names)][::-1]


def downs_of(part: CompiledPart) -> tuple[np.ndarray, list[Any]]:
    """Return which way is down in each pose the part rests in, and these poses."""
    poses = [p for p in part.poses if not p.rolling]
    return np.stack([-p.R[2] for p in poses]) if poses else np.zeros((0, 3)), poses


def measure(path: Path, rules: GraspRules) -> dict[str, Any]:
    """Return one part's row: both jaws."""
    layout = emulated_layout()
    part = load_part(path)
    solid, caster = part.solid, RayCaster(part.solid.mesh)
    downs, _ = downs_of(part)
    jaws: dict[Holder, tuple[Jaw, Any]] = {"arm": (layout.arm_gripper, None)}
    if layout.fixed_gripper is not None:
        jaws["fixture"] = (layout.fixed_gripper, still_gravities(layout.T_world_fixed_tcp))
    started = time.process_time()
    widest = max(j.max_mm for j, _ in jaws.values()) - rules.jaw_reserve_mm
    seeds = find_seeds(solid, part.chosen_by, caster, widest, rules, [j for j, _ in jaws.values()])
    row: dict[str, Any] = {
        "part": path.name.split(".")[0],
        "triangles": len(solid.mesh.faces),
        "face_pairs": seeds.face_pairs,
        "seeds": len(seeds.gap),
        "seeds_s": round(time.process_time() - started, 3),
        "jaws": {},
    }
    problem = GraspProblem(solid, seeds, caster, downs, rules)
    for holder, (jaw, gravities) in jaws.items():
        begun = time.process_time()
        found = judge_grasps(problem, jaw, holder, gravities)
        row["jaws"][holder] = jaw_row(found, downs, time.process_time() - begun)
    row["seconds"] = round(time.process_time() - started, 3)
    return row


def jaw_row(found: Synthesis, downs: np.ndarray, seconds: float) -> dict[str, Any]:
    """Return what one jaw came to."""
    grasps = found.grasps
    firm, flat = [g for g in grasps if not g.on_table], [g for g in grasps if g.on_table]
    approach = np.array([g.T_part_tcp[:3, 0] for g in grasps]).reshape(-1, 3)
    return {
        "stages": {s.name: s.left for s in found.stages},
        "grips": len(grasps),
        "inner": sum(g.is_inner for g in grasps),
        "on_table": sum(g.on_table for g in grasps),
        "worst_contact_mm2": round(min((g.contact_mm2 for g in firm), default=0.0), 1),
        "worst_contact_on_table_mm2": round(min((g.contact_mm2 for g in flat), default=0.0), 1),
        "worst_load": round(max((g.load for g in grasps), default=0.0), 3),
        "worst_margin": round(min((g.margin for g in grasps), default=0.0), 3),
        "from_above": [int((approach @ d >= 0.5).sum()) for d in downs],
        "seconds": round(seconds, 3),
    }


def materials(path: Path) -> dict[str, Any]:
    """Return the share of a part's grips that hold, per material."""
    part = load_part(path)
    jaw = replace(emulated_layout().arm_gripper, force_n=30.0)
    caster = RayCaster(part.solid.mesh)
    seeds: Seeds = find_seeds(
        part.solid, part.chosen_by, caster, jaw.max_mm - BASE.jaw_reserve_mm, BASE
    )
    problem = GraspProblem(part.solid, seeds, caster, downs_of(part)[0], BASE)
    grasps = judge_grasps(problem, jaw, "arm").grasps
    row: dict[str, Any] = {"part": path.name.split(".")[0], "grips": len(grasps)}
    for name, (density, friction, force) in MATERIALS.items():
        row[name] = round(holding(part, caster, jaw, grasps, density, friction, force), 2)
    return row


def holding(
    part: CompiledPart,
    caster: RayCaster,
    jaw: Jaw,
    grasps: Sequence[Grasp],
    density: float,
    friction: float,
    force: float,
) -> float:
    """Return the share of grips whose contact carries the part with safety 2."""
    if not grasps:
        return 0.0
    rules = replace(BASE, density_kg_mm3=density, friction=friction)
    judge = Judge(part.solid, caster, replace(jaw, force_n=force), rules, None)
    inner = np.array([g.is_inner for g in grasps])
    T, width = np.stack([g.T_part_tcp for g in grasps]), np.array([g.opening_mm for g in grasps])
    found = judge.close(T, width, inner, judge.fine)
    return float((judge.load(found, inner, judge.fine) <= rules.max_load).mean())


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows as people read them."""
    lines = [
        f"{'part':22} {'tri':>6} {'pairs':>5} {'seeds':>5} {'jaw':>7} "
        + " ".join(f"{head:>8}" for head in SHOWN.values())
        + "  grips  mm2 flat  load margin     s  from above"
    ]
    for row in rows:
        for holder, jaw in row["jaws"].items():
            lines.append(
                f"{row['part']:22} {row['triangles']:6} {row['face_pairs']:5} {row['seeds']:5} "
                f"{holder:>7} "
                + " ".join(f"{jaw['stages'].get(s, 0):8}" for s in SHOWN)
                + f"  {jaw['grips']:5} {jaw['worst_contact_mm2']:4.0f} "
                f"{jaw['worst_contact_on_table_mm2']:4.0f} {jaw['worst_load']:5.2f} "
                f"{jaw['worst_margin']:6.2f} {jaw['seconds']:5.2f}  {jaw['from_above']}"
            )
    seconds = [row["seconds"] for row in rows]
    lines.append(
        f"{len(rows)} parts: both jaws with seeds {np.mean(seconds):.2f} s on average, "
        f"{max(seconds):.2f} s at most"
    )
    return "\n".join(lines)


def material_table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the shares, a part a line."""
    head = f"{'part':22} {'grips':>5} " + " ".join(f"{m:>24}" for m in MATERIALS)
    body = [
        f"{r['part']:22} {r['grips']:5} " + " ".join(f"{r[m]:24.2f}" for m in MATERIALS)
        for r in rows
    ]
    return "\n".join([head, *body])


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--coarse", action="store_true", help="the quick look of a first plan")
    parser.add_argument("--materials", action="store_true", help="steel, oil and a weaker jaw")
    parser.add_argument("--part", action="append", default=[], help="only parts so named")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args(argv)
    files = part_files(args.part)
    if args.materials:
        rows = [materials(f) for f in files]
        text = material_table(rows)
    else:
        rules = GraspRules().coarse() if args.coarse else GraspRules()
        rows = [measure(f, rules) for f in files]
        text = table(rows)
    print(json.dumps(rows, indent=1) if args.json else text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
