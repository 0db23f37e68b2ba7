"""Perfect parts with inner corners, 14 views each: does any of them look wrong?

Ten parts of `corner_parts/`; limits were tuned on the first five with seeds below 100, the others
and other seeds are told apart. The verdict is `judge`'s with nothing left out by name; what it
lacks for a PASS (faces compared too little) is told, and whether the part passes once a recipe
leaves those faces out by name, as `cellctl run` asks for.

    python benchmarks/bench_perfect.py [--json] [--parts angle_bracket ...] [--seeds 1 101]
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from inspection_scenes import ROOT, Held, Station, judged_views

from controller.inspection import InspectionLimits, Unjudged, Verdict, judge

TUNED = ("angle_bracket", "channel_jig", "slotted_plate", "fillet_bracket", "step_block")
HELD_OUT = ("tee_bracket", "v_block", "corner_jig", "pocket_plate", "rib_bracket")
FOLDER = ROOT / "benchmarks" / "corner_parts"
MIN_COVERAGE = 0.5


def run_one(path: Path, seed: int, held: Held, station: Station) -> dict[str, Any]:
    """Return what 14 views of one perfect part come to."""
    limits = InspectionLimits()
    views, seconds = [], []
    started = time.process_time()
    for result, _, _ in judged_views(held, station, seed, limits):
        views.append(result)
        seconds.append(result)
    whole_s = time.process_time() - started
    strict = judge(held.solid, held.samples, views, {}, MIN_COVERAGE, limits)
    named = {
        f.face_id: "compared too little"
        for f in strict.faces
        if f.verdict is Verdict.NOT_EVALUATED and f.area_mm2 >= limits.min_area_mm2
    }
    final = judge(held.solid, held.samples, views, {}, MIN_COVERAGE, limits, named)
    areas = held.samples.areas_mm2 / held.samples.areas_mm2.sum()
    rest: dict[str, float] = {}
    for face in strict.faces:
        for reason, share in face.rest:
            mine = float(areas[held.samples.face_ids == face.face_id].sum())
            rest[reason] = rest.get(reason, 0.0) + share * mine
    words = {u.value: u.name.lower() for u in Unjudged}
    return {
        "part": path.name.split(".")[0],
        "seed": seed,
        "verdict": strict.verdict.value,
        "verdict_with_names": final.verdict.value,
        "findings": sum(len(v.findings) for v in views),
        "views_failed": sum(not v.evaluated for v in views),
        "lamps_failed": sum(len(v.failures) for v in views if v.evaluated),
        "covered": round(strict.compared_fraction, 4),
        "in_sight": round(strict.in_sight_fraction, 4),
        "faces_named": len(named),
        "faces": len(strict.faces),
        "rest": {
            words.get(k, k): round(v, 4) for k, v in sorted(rest.items(), key=lambda i: -i[1])
        },
        "reasons": [r for r in final.reasons if final.verdict is not Verdict.PASS][:4],
        "cpu_s": round(whole_s, 2),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--parts", nargs="+", default=[*TUNED, *HELD_OUT])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 101])
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args()
    rows = []
    for name in args.parts:
        path = FOLDER / f"{name}.csg.yaml"
        held = Held.load(path)
        station = Station(held.solid.mesh)
        for seed in args.seeds:
            row = run_one(path, seed, held, station)
            row["set"] = "tuned" if name in TUNED and seed < 100 else "apart"
            rows.append(row)
            if not args.json:
                print(
                    f"{row['part']:16}{seed:5}  {row['set']:6}{row['verdict_with_names']:14} "
                    f"{row['findings']} findings, {row['views_failed']}+{row['lamps_failed']} "
                    f"failed, {row['covered']:.1%} of {row['in_sight']:.1%}, "
                    f"{row['faces_named']}/{row['faces']} faces named, {row['cpu_s']} s",
                    flush=True,
                )
                print(f"{'':28}{row['rest']}")
                for reason in row["reasons"]:
                    print(f"{'':28}{reason}")
    summary = {
        which: {
            "sets": len(some),
            "pass": sum(r["verdict_with_names"] == "pass" for r in some),
            "fail": sum(r["verdict_with_names"] == "fail" for r in some),
            "indeterminate": sum(r["verdict_with_names"] == "indeterminate" for r in some),
        }
        for which in ("tuned", "apart")
        if (some := [r for r in rows if r["set"] == which])
    }
    if args.json:
        print(json.dumps({"rows": rows, "summary": summary}))
    else:
        print(summary)
    return 0


if __name__ == "__main__":
    sys.exit(main())
