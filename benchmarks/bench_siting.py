"""Where camera and fixed gripper of the emulated cell should stand: the search's answer and cost.

python benchmarks/bench_siting.py [--json] [--parts FILE...] [--coarse | --here] [--shared FOLDER]

Without `--parts`, the parts of recipes/parts. `--coarse` ranks the grid by the joints alone;
`--here` scores the present site only, which is what many parts can be asked about. `--shared`
adds the CAD files of a folder and those of benchmarks/parts.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

from planning_cell import emulated_layout  # noqa: E402  (path set above)

from controller.cad import load_solid, sample_surface  # noqa: E402
from controller.commissioning.siting import SiteOptions, SiteScore, site_of, site_report  # noqa: E402
from controller.commissioning.siting.survey import survey  # noqa: E402
from controller.planning import CellLayout, NoPlanError, PreparedPart, prepare_part  # noqa: E402

RECIPE_PARTS = ROOT / "recipes" / "parts"
BENCH_PARTS = ROOT / "benchmarks" / "parts"
SAMPLE_MM = 4.0


def files_of(folder: Path) -> list[Path]:
    """Return the CAD files of a folder; of a part in two formats the triangles."""
    return sorted([*folder.glob("*.stl"), *folder.glob("*.csg.yaml")])


def prepared(files: list[Path], layout: CellLayout) -> tuple[list[PreparedPart], list[str]]:
    parts, refused = [], []
    for path in files:
        try:
            solid = load_solid(path)
            parts.append(prepare_part(solid, sample_surface(solid, SAMPLE_MM), layout))
        except NoPlanError as error:
            refused.append(f"{path.name}: {error}")
    return parts, refused


def row_of(score: SiteScore) -> dict[str, Any]:
    """Return a site's score as plain numbers; NaN becomes None."""

    def plain(value: str | float) -> str | float | None:
        if isinstance(value, str):
            return value
        return round(value, 4) if math.isfinite(value) else None

    T = score.site.T_world_fixed_tcp
    return {
        "station_mm": [round(float(v), 1) for v in score.site.station_mm],
        "looks_along": [round(float(v), 4) for v in score.site.looks_along],
        "fixture_mm": None if T is None else [round(float(v), 1) for v in T[:3, 3]],
        "fixture_approach": None if T is None else [round(float(v), 4) for v in T[:3, 0]],
        "fixture_jaws": None if T is None else [round(float(v), 4) for v in T[:3, 1]],
        "value": round(score.value, 4),
        "forbidden": score.forbidden,
        "trays": {k: round(v, 3) for k, v in score.trays.items()},
        "parts": [{k: plain(v) for k, v in asdict(p).items()} for p in score.parts],
    }


def print_score(title: str, score: SiteScore) -> None:
    row = row_of(score)
    print(
        f"{title}: station {row['station_mm']}, camera looks along {row['looks_along']}, "
        f"fixture at {row['fixture_mm']} along {row['fixture_approach']}, "
        f"jaws {row['fixture_jaws']}; "
        f"value {row['value']}, trays {row['trays']}"
    )
    print(
        "  part          shown  worst  joints showable  views partners pairs picks  view s regrip s"
    )
    for p in score.parts:
        print(
            f"  {p.name:13} {100 * p.shown:5.1f}  {100 * p.shown_worst:5.1f}  "
            f"{100 * p.joints_allow:5.1f}   {100 * p.showable:5.1f}  {100 * p.views_share:5.1f}   "
            f"{100 * p.partners_share:5.1f} {100 * p.hand_offs_share:5.1f} "
            f"{100 * p.picks_share:5.1f}  {p.view_s:6.1f} {p.regrasp_s:6.1f}"
        )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--coarse", action="store_true")
    parser.add_argument("--here", action="store_true")
    parser.add_argument("--parts", nargs="*", type=Path)
    parser.add_argument("--shared", type=Path)
    args = parser.parse_args()
    layout = emulated_layout()
    files = args.parts or files_of(RECIPE_PARTS)
    if args.shared is not None:
        known = {p.stem.split(".")[0] for p in files}
        more = [*files_of(args.shared), *files_of(BENCH_PARTS)]
        files = [*files, *[p for p in more if p.stem.split(".")[0] not in known]]
    begin = time.process_time()
    parts, refused = prepared(files, layout)
    prepare_s = time.process_time() - begin
    for line in refused:
        print("refused:", line, file=sys.stderr)
    begin = time.process_time()
    if args.here:
        scores = [survey(parts, layout).check(site_of(layout))]
        cpu_s = time.process_time() - begin
        if args.json:
            print(json.dumps({"cpu_s": round(cpu_s, 1), "present": row_of(scores[0])}))
            return 0
        print(f"{len(parts)} parts, prepared in {prepare_s:.0f} s CPU; {cpu_s:.1f} s CPU")
        print_score("present", scores[0])
        return 0
    report = site_report(parts, layout, SiteOptions(joints_only=args.coarse))
    cpu_s = time.process_time() - begin
    if args.json:
        print(
            json.dumps(
                {
                    "cpu_s": round(cpu_s, 1),
                    "sites_tried": report.sites_tried,
                    "sites_checked": report.sites_checked,
                    "stay": report.stay,
                    "sentences": report.sentences,
                    "present": row_of(report.present),
                    "best": row_of(report.best),
                    "others": [row_of(s) for s in report.others],
                }
            )
        )
        return 0
    print(
        f"{len(parts)} parts, prepared in {prepare_s:.0f} s CPU; {report.sites_tried} sites by the "
        f"joints, {report.sites_checked} checked, {cpu_s:.0f} s CPU"
    )
    print_score("present", report.present)
    print_score("best", report.best)
    for score in report.others:
        print_score("other", score)
    for sentence in report.sentences:
        print(sentence)
    return 0


if __name__ == "__main__":
    sys.exit(main())
