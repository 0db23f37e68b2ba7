"""Path-traced pictures of held parts, made elsewhere, as a judge the light model was not made for.

    python benchmarks/bench_traced.py [--folder ../shared/inspect] [--json]

Good specimens must not FAIL; what cannot be told is INDETERMINATE, with the reason.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from inspection_scenes import ROOT, Held
from numpy.typing import NDArray

from controller.imaging import Camera, PointLamp
from controller.inspection import (
    InspectionLimits,
    Verdict,
    ViewPictures,
    ViewTask,
    WorldBox,
    inspect_view,
    judge,
)

FOLDER = ROOT.parent / "shared" / "inspect"


def grey(path: Path) -> NDArray[np.uint8]:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None, path
    return np.asarray(picture, dtype=np.uint8)


def panel(lamp: dict[str, Any]) -> NDArray[np.float64]:
    up, normal = np.array(lamp["up"]), np.array(lamp["normal"])
    right = np.cross(up, normal)
    half = np.array(lamp["size"]) / 2
    return np.array(
        [
            np.array(lamp["centre"]) + sx * half[0] * right + sy * half[1] * up
            for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )


def judge_set(folder: Path, held: Held) -> dict[str, Any]:
    """Return what the views of one specimen come to."""
    body = json.loads((folder / "SET.json").read_text())
    c = body["camera"]
    camera = Camera(
        tuple(c["size_px"]), np.array(c["K"]), np.array(c["distortion"]), np.array(c["T_world_cam"])
    )
    lamps = body["lamps"]
    points = {
        "ring": PointLamp.ring(
            "ring", np.array(lamps["ring"]["centre"]), camera.T_world_cam[:3, 2],
            lamps["ring"]["radius"],
        ),
        "side": PointLamp("side", np.array([lamps["side"]["centre"]])),
    }  # fmt: skip
    limits = InspectionLimits()
    views = []
    for view in body["views"]:
        boxes = tuple(
            WorldBox(np.array(b["T"]), np.array(b["half_mm"])) for b in view["gripper_boxes"]
        )
        names = view["pictures"]
        task = ViewTask(
            view["id"], camera, np.array(view["T_world_part"]), boxes, panel(lamps["backlight"]),
            tuple(points[k] for k in names if k in points), limits,
        )  # fmt: skip
        lit = {k: grey(folder / v) for k, v in names.items() if k in points}
        pictures = ViewPictures(grey(folder / names["backlight"]), lit)
        views.append(inspect_view(held.part, held.samples, task, pictures))
    got = judge(held.solid, held.samples, views, {}, 0.3, limits)
    return {
        "set": folder.name,
        "verdict": got.verdict.value,
        "covered": round(got.compared_fraction, 3),
        "in_sight": round(got.in_sight_fraction, 3),
        "views": len(views),
        "residual_px": [round(v.residual_px, 2) for v in views if v.evaluated],
        "failures": [f for v in views for f in v.failures],
        "findings": [
            [v.view_id, f.lamp, f.kind.value, round(f.area_mm2, 1), list(f.face_ids)]
            for v in views
            for f in v.findings
        ],
        "confirmed": len(got.confirmed),
        "reasons": list(got.reasons),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args()
    truth_file = args.folder / "truth.json"
    truth = json.loads(truth_file.read_text()) if truth_file.is_file() else {}
    rows, parts = [], {}
    for folder in sorted(p for p in args.folder.iterdir() if (p / "SET.json").is_file()):
        part = (folder / json.loads((folder / "SET.json").read_text())["part"]).resolve()
        held = parts.setdefault(part, Held.load(part))
        row = judge_set(folder, held)
        said = truth.get(folder.name, {}) if isinstance(truth, dict) else {}
        row["kind"] = said.get("kind", "?") if isinstance(said, dict) else "?"
        rows.append(row)
        if not args.json:
            print(
                f"{row['set']} {row['kind']:20} {row['verdict']:14} {row['covered']:.0%} of "
                f"{row['in_sight']:.0%}, {len(row['findings'])} findings, {row['confirmed']} "
                f"confirmed, residuals {row['residual_px']}",
                flush=True,
            )
            for line in (*row["failures"], *map(str, row["findings"][:8])):
                print(f"    {line}")
    summary = {v.value: sum(r["verdict"] == v.value for r in rows) for v in Verdict}
    print(json.dumps({"rows": rows, "summary": summary}) if args.json else summary)
    return 0


if __name__ == "__main__":
    sys.exit(main())
