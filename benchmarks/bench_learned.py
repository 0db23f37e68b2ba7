"""Appearance learned from good parts, against prediction alone, on series with known truth.

    python benchmarks/bench_learned.py FOLDER... [--learn 8] [--json]

Each FOLDER is a series as `trace_series.py` writes it. Learns from its first good pieces and judges
all others twice, cold and learned, without a recipe: what counts is how much of what is in sight is
compared, what is found at the defect's place, and what is found elsewhere. Dimensions are left out,
as learning says nothing of them. Nothing of the judged pieces is known to what judges them.

Seconds are of one core's own work, with nothing kept from another piece but what follows from the
CAD model: `view_s` of one view with all its pictures, the median of the pieces, and `learn_s`.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import cv2  # noqa: E402  (threads come first)
import numpy as np  # noqa: E402
from bench import Arguments, need_sets, show  # noqa: E402

from controller.cad.compiled import CompiledPart  # noqa: E402
from controller.config import ConfigError  # noqa: E402
from controller.config.view_set import load_view_set  # noqa: E402
from controller.inspection import (  # noqa: E402
    Appearance,
    GoodPart,
    InspectionLimits,
    PartSettings,
    TooFewPartsError,
    ViewSet,
    inspect_part,
    learn,
)
from controller.stored import build_view_set, compiled_part, read_pictures  # noqa: E402

Words = dict[str, Any]
PLACE_MM = 3.0  # beyond half the defect's size, a finding is elsewhere
LIMITS = InspectionLimits()


def read(folder: Path, name: str, part: CompiledPart | None) -> tuple[CompiledPart, ViewSet]:
    """Return a piece's part and views."""
    path = folder / name / "SET.json"
    file = load_view_set(path)
    part = part or compiled_part(path, file)
    return part, build_view_set(file, part, read_pictures(path, file), LIMITS)


def judged(views: ViewSet, appearance: Appearance | None, truth: Words) -> Words:
    """Return what an inspection says of a piece."""
    began = time.process_time()
    settings = PartSettings(LIMITS, min_coverage=0.01, appearance=appearance)
    found = inspect_part(views, (), settings)
    seconds = time.process_time() - began
    at, elsewhere = [], []
    for one in found.findings:
        place = truth.get("place_mm")
        is_there = (
            truth["cls"] == "defect"
            and place is not None
            and np.linalg.norm(np.asarray(one.p_part_mm) - place)
            <= PLACE_MM + 0.5 * (truth.get("size_mm") or 0.0)
        )
        (at if is_there else elsewhere).append(one)
    return {
        "verdict": found.verdict.value,
        "compared": found.ledger.compared_fraction,
        "in_sight": found.ledger.in_sight_fraction,
        # "fail" comes before "indeterminate"
        "at_place": min((f.verdict.value for f in at), default=""),
        "elsewhere": len(elsewhere),
        "elsewhere_fail": sum(f.verdict.value == "fail" for f in elsewhere),
        "short_faces": len(found.ledger.short_faces),
        "pictures": sum(
            c.name != "outline" and not c.reason for v in found.views for c in v.checks
        ),
        "learned_pictures": sum(bool(c.learned_from) for v in found.views for c in v.checks),
        "view_s": round(seconds / len(views.views), 3),
    }


def of_series(folder: Path, count: int, *, quiet: bool) -> Words:
    """Return the results of a series."""
    specimens = json.loads((folder / "truth.json").read_text())["specimens"]
    good = [s for s in specimens if s["cls"] == "good"][:count]
    rest = [s for s in specimens if s not in good]
    part: CompiledPart | None = None
    parts = []
    for one in good:
        part, views = read(folder, one["specimen"], part)
        parts.append(GoodPart(one["specimen"], views))
    began = time.process_time()
    lesson = learn(parts)
    seconds = time.process_time() - began
    rows = []
    for one in rest:
        part, views = read(folder, one["specimen"], part)
        row: Words = {
            "specimen": one["specimen"],
            "kind": one["kind"],
            "cls": one["cls"],
            "size_mm": one.get("size_mm"),
            "views_showing": len(one["visible_views"]),
            "cold": judged(views, None, one),
            "learned": judged(views, lesson.appearance, one),
        }
        rows.append(row)
        if not quiet:
            cold, now = row["cold"], row["learned"]
            print(
                f"{folder.name} {row['specimen']} {row['kind']:12} "
                f"{row['size_mm'] or 0:5.1f} mm, shown by {row['views_showing']}:  "
                + "  ".join(
                    f"{how} {r['verdict']:13} {100 * r['compared'] / r['in_sight']:5.1f} %, "
                    f"there {r['at_place'] or '-':13} elsewhere {r['elsewhere']}"
                    for how, r in (("cold", cold), ("learned", now))
                ),
                flush=True,
            )
    return {
        "series": folder.name,
        "part": specimens[0]["part"],
        "learned_from": len(lesson.tried),
        "left_out": [one.name for one in lesson.left_out],
        "learn_s": round(seconds, 1),
        "pictures_a_view": max(1 + len(view.pictures.lit) for view in parts[0].views.views),
        "views": len(parts[0].views.views),
        "rows": rows,
    }


def totals(results: Sequence[Words]) -> Words:
    """Return sums over all series, cold and learned."""
    rows = [row for result in results for row in result["rows"]]
    good = [r for r in rows if r["cls"] == "good"]
    shown = [r for r in rows if r["cls"] == "defect" and r["views_showing"]]
    out: Words = {"good": len(good), "defects_shown": len(shown)}
    for how in ("cold", "learned"):
        of_good = [r[how] for r in good]
        of_bad = [r[how] for r in shown]
        shares = [r[how]["compared"] / r[how]["in_sight"] for r in rows]
        out[how] = {
            "compared_of_in_sight": [round(min(shares), 4), round(float(np.mean(shares)), 4)],
            "good_failed": sum(r["verdict"] == "fail" for r in of_good),
            "good_with_findings": sum(r["elsewhere"] > 0 for r in of_good),
            "defects_passed": sum(r["verdict"] == "pass" for r in of_bad),
            "defects_failed_there": sum(r["at_place"] == "fail" for r in of_bad),
            "defects_shown_there": sum(bool(r["at_place"]) for r in of_bad),
            "findings_elsewhere": sum(r["elsewhere"] for r in of_bad),
            "view_s": round(float(np.median([r[how]["view_s"] for r in rows])), 3),
        }
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Parse, judge, print; an error becomes one sentence."""
    parser = Arguments(__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    parser.add_argument("--learn", type=int, default=8, help="good pieces to learn from")
    args = parser.parse_args(argv)
    need_sets(args.folders, "trace_series.py")
    cv2.setNumThreads(1)
    try:
        results = [of_series(folder, args.learn, quiet=args.json) for folder in args.folders]
    except (ConfigError, TooFewPartsError, OSError, KeyError) as error:
        print(f"bench_learned: {error}", file=sys.stderr)
        return 2
    summed = totals(results)
    rows = [
        {
            "how": how,
            "good": summed["good"],
            "defects shown": summed["defects_shown"],
            **summed[how],
            "learn_s": max(result["learn_s"] for result in results) if how == "learned" else None,
        }
        for how in ("cold", "learned")
    ]
    show(args, rows, {"series": results} if args.json else {})
    return int(any(row["good_failed"] or row["defects_passed"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
