"""What a part claims would have been found, against the defects that are there.

    python benchmarks/bench_detection.py SETS... [--json]

SETS are folders as benchmarks/trace_held.py writes them. At the place of each chip, burr, dent,
scratch and stain: the size found there with 90 %, as `controller.inspection.detection` works it
out, the size that is there, and whether a finding is there. Where the claim is right, nine of ten
claimed ones are found; behind the rate stands its exact lower limit (Clopper and Pearson, 95 %).
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from inspection_truth import lower_limit

from controller.config.view_set import load_view_set
from controller.inspection import InspectionLimits, PartInspection
from controller.inspection.detection import AT_EDGES, KINDS, found_mm
from controller.stored import Judging, compiled_part, judge_views, read_pictures

NEAR_MM = 4.0  # beyond its size: how far from a defect a finding may be, as in bench_inspect.py
Words = dict[str, Any]


def compared(folder: Path, truth: Words) -> Words:
    path = folder / str(truth["specimen"]) / "SET.json"
    file = load_view_set(path)
    part = compiled_part(path, file)
    got = judge_views(file, part, read_pictures(path, file), Judging(None, path, path))
    place, kind = np.array(truth["place_mm"], dtype=float), str(truth["kind"])
    size = float(truth["size_mm"])
    checks = [c for v in got.views if v.evaluated for c in v.checks if not c.reason]
    sizes = found_mm(kind, checks, part.samples, InspectionLimits())
    # of an edge a sample within the defect's reach; of a face the next one
    away = np.linalg.norm(part.samples.points_mm - place, axis=1)
    reach = max(size, away.min()) if kind in AT_EDGES else away.min()
    claimed = float(sizes[away <= reach].min())
    return {
        "specimen": f"{folder.name}/{truth['specimen']}",
        "kind": kind,
        "size_mm": size,
        "claimed_mm": claimed if np.isfinite(claimed) else None,
        "found": is_found(got, place, size),
        "verdict": got.verdict.value,
    }


def is_found(got: PartInspection, place: np.ndarray, size: float) -> bool:
    return any(np.linalg.norm(f.p_part_mm - place) <= size + NEAR_MM for f in got.findings)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sets", nargs="+", type=Path)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    rows = []
    for folder in args.sets:
        for truth in json.loads((folder / "truth.json").read_text())["specimens"]:
            if truth["kind"] in KINDS and (folder / truth["specimen"] / "SET.json").is_file():
                rows.append(compared(folder, truth))
                if args.json:
                    print(json.dumps(rows[-1]))
    if args.json:
        return 0
    print(f"{'specimen':16} {'kind':8} {'size':>6} {'claimed':>8}  found  verdict")
    for row in rows:
        claim = "-" if row["claimed_mm"] is None else f"{row['claimed_mm']:.2f}"
        print(
            f"{row['specimen']:16} {row['kind']:8} {row['size_mm']:6.2f} {claim:>8}  "
            f"{'yes' if row['found'] else 'no ':5}  {row['verdict']}"
        )
    claimed = [r for r in rows if r["claimed_mm"] is not None and r["size_mm"] >= r["claimed_mm"]]
    hits = sum(r["found"] for r in claimed)
    if claimed:
        least = 100 * lower_limit(hits, len(claimed))
        print(f"claimed and found: {hits} of {len(claimed)}, at least {least:.0f} % (95 %)")
    else:
        print("no defect was as large as claimed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
