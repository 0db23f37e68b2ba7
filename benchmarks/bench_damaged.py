"""Damaged CAD files: each gives a typed error or a right answer, within 10 s and 1 GB.

python benchmarks/bench_damaged.py [--json] [--count 500] [--seed 1] [--step] [--keep FOLDER]

Right: volume, area and size as before the damage or, where the damage made another shape of it, a
solid that manifold3d takes and whose volume it agrees with. With --step, STEP files too (the kernel
runs in a process of its own, whose memory is not in the table).
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter, defaultdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from damaged_files import Original, facts_of, make_cases, originals_of, run  # noqa: E402
from shared_files import SHARED  # noqa: E402  (path set above)

from controller.cad import load_solid  # noqa: E402

PARTS = ROOT / "recipes" / "parts"
STL_PARTS = ("holder", "idler_riser", "flange_xy", "angle_block", "disc_cam_a")
STEP_PARTS = ("flange_xy", "cycloidal_gear")


def find_originals(with_step: bool) -> list[Original]:
    found: list[Original] = []
    for name in STL_PARTS:
        paths = [folder / f"{name}.stl" for folder in (SHARED / "parts", PARTS)]
        path = next((p for p in paths if p.is_file()), None)
        if path is None:
            print(f"{name}: the shared parts are not at {SHARED}", file=sys.stderr)
            continue
        found += originals_of(name, load_solid(path).mesh)
    widget = PARTS / "widget.csg.yaml"
    text = Original("widget", "csg.yaml", widget.read_bytes(), facts_of(load_solid(widget).mesh))
    found += [text] * 6  # as likely as a part in one of the triangle formats
    if with_step:
        for name in STEP_PARTS:
            path = SHARED / "parts" / f"{name}.step"
            found.append(Original(name, "step", path.read_bytes(), facts_of(load_solid(path).mesh)))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--step", action="store_true")
    parser.add_argument("--keep", type=Path, help="folder for the files that went wrong")
    args = parser.parse_args()
    cases = make_cases(args.count, args.seed, find_originals(args.step))
    table: dict[str, Counter[str]] = defaultdict(Counter)
    worst: dict[str, dict[str, Any]] = {"seconds": {"seconds": 0.0}, "rss_mb": {"rss_mb": 0.0}}
    wrong: list[dict[str, Any]] = []
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for case, outcome, told in run(cases, Path(folder)):
            table[case.kind][outcome] += 1
            row = {"kind": case.kind, "name": case.name, "outcome": outcome, **told}
            for key in worst:
                if told[key] > worst[key][key]:
                    worst[key] = row
            if outcome.startswith("WRONG"):
                wrong.append({**row, "outcome": outcome})
                if args.keep:
                    args.keep.mkdir(parents=True, exist_ok=True)
                    (args.keep / case.name).write_bytes(case.data)
    summary = {
        "files": len(cases),
        "wrong": wrong,
        "worst_s": round(worst["seconds"]["seconds"], 2),
        "worst_s_at": worst["seconds"].get("kind"),
        "worst_rss_mb": round(worst["rss_mb"]["rss_mb"]),
        "worst_rss_at": worst["rss_mb"].get("kind"),
        "total_s": round(time.perf_counter() - begin, 1),
        "table": {kind: dict(row) for kind, row in table.items()},
    }
    if args.json:
        print(json.dumps(summary))
        return 1 if wrong else 0
    for kind, outcomes in table.items():
        told = ", ".join(f"{count} {name}" for name, count in outcomes.most_common())
        print(f"{kind:28} {sum(outcomes.values()):4}  {told}")
    print(
        f"\n{len(cases)} files in {summary['total_s']} s, {len(wrong)} wrong; "
        f"slowest {summary['worst_s']} s ({summary['worst_s_at']}), "
        f"most memory {summary['worst_rss_mb']} MB ({summary['worst_rss_at']})"
    )
    for row in wrong:
        print("  ", row["kind"], row["name"], row["outcome"], row.get("message", ""))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
