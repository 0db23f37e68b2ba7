"""What segmentation finds in pictures of known truth, how near its outlines are, and its time.

python benchmarks/bench_segmentation.py [--json] [--worst N] [--parts FOLDER] [FOLDER ...]

A folder holds pictures and a truth.json of the form of the shared pictures'; these are taken
where none is named. The true silhouette is the CAD outline at the true pose through the true
camera. Pictures whose number leaves 3 when divided by 4 are kept aside: nothing is tuned to them.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit"), str(ROOT / "benchmarks")]

from bench_views import FINE, filled, true_pose  # noqa: E402  (path set above)
from shared_files import SHARED  # noqa: E402

from controller.cad import LineView, load_solid, outline, prepare_views  # noqa: E402
from controller.imaging import Camera  # noqa: E402
from controller.recognition.segmentation import Region, Segmentation, segment  # noqa: E402

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

FOUND_IOU = 0.5
NEAR_PX = 3.0  # loop points farther off are of another border
REPEATS = 5
LO_SCALE = np.array([5.0, 4.0])  # tests/data/README.md
MIN_HOLE_PX = 8.0  # smaller ones in the picture are not counted
PERIODS = 4


def camera_of(truth: dict[str, Any]) -> Camera:
    given = truth["camera"]
    T = np.eye(4)
    T[:3, :3] = np.array(given["R_wc"]).T
    T[:3, 3] = given["position"]
    return Camera(
        (given["width"], given["height"]), np.array(given["K"]), np.array(given["dist"]), T
    )


class TrueShape:
    """An outline in a picture: the mask at the pixels, and its loops."""

    def __init__(self, view: LineView, size: tuple[int, int], is_small: bool) -> None:
        self.loops: list[Array] = [
            (loop.points + 0.5) / LO_SCALE - 0.5 if is_small else loop.points for loop in view.loops
        ]
        self.is_hole = [loop.is_hole for loop in view.loops]
        every = np.vstack(self.loops)
        self.origin = np.maximum(np.floor(every.min(axis=0)).astype(int) - 3, 0)
        end = np.minimum(np.ceil(every.max(axis=0)).astype(int) + 4, size)
        width, height = (end - self.origin).tolist()
        small = _Loops([_Points(p) for p in self.loops])
        fine = filled(small, int(self.origin[0]), int(self.origin[1]), width, height)  # type: ignore[arg-type]
        share = fine.reshape(height, FINE, width, FINE).mean(axis=(1, 3))
        self.mask: Bools = share >= 0.5

    def overlap(self, region: Region, mask: Bools | None = None) -> float:
        """Return the IoU with a region, or with another mask of it."""
        mask = region.mask if mask is None else mask
        x0, y0 = (int(c) for c in self.origin)
        h, w = self.mask.shape
        a0, b0, a1, b1 = region.box_px
        left, top = max(x0, a0), max(y0, b0)
        right, bottom = min(x0 + w, a1), min(y0 + h, b1)
        if left >= right or top >= bottom:
            return 0.0
        mine = self.mask[top - y0 : bottom - y0, left - x0 : right - x0]
        its = mask[top - b0 : bottom - b0, left - a0 : right - a0]
        both = int((mine & its).sum())
        return both / (int(self.mask.sum()) + int(mask.sum()) - both)

    def covered(self, region: Region) -> float:
        """Return which share of it lies in a region."""
        union = self.overlap(region)
        both = union / (1 + union) * (int(self.mask.sum()) + int(region.mask.sum()))
        return both / max(int(self.mask.sum()), 1)

    def distances(self, points: Array) -> Array:
        """Return signed distances [px] of points (n, 2) to the loops, positive outside."""
        places, outward = [], []
        for loop in self.loops:
            following = np.roll(loop, -1, axis=0)
            length = np.hypot(*(following - loop).T)
            for p, q, d in zip(loop, following, length, strict=True):
                if d < 1e-9:
                    continue
                count = max(int(np.ceil(d * 4)), 1)
                t = (np.arange(count) + 0.5) / count
                places.append(p + t[:, None] * (q - p))
                # the part lies on the left to the eye, v runs down
                outward.append(np.tile(np.array([-(q - p)[1], (q - p)[0]]) / d, (count, 1)))
        at, normals = np.vstack(places), np.vstack(outward)
        far, index = cKDTree(at).query(points)
        along = ((points - at[index]) * normals[index]).sum(axis=1)
        # between two samples the foot is on the side, at a corner it is the corner
        is_beside = far < 1.0
        return np.where(is_beside, along, np.copysign(far, along))

    def hole_count(self) -> int:
        areas = [_area(p) for p, hole in zip(self.loops, self.is_hole, strict=True) if hole]
        return sum(area >= MIN_HOLE_PX for area in areas)

    def holes_found(self, region: Region) -> int:
        """Return how many holes have one of the region's whose middle lies in them."""
        found = 0
        middles = [loop.mean(axis=0) for loop in region.loops_px[1:]]
        for loop, hole in zip(self.loops, self.is_hole, strict=True):
            if hole and _area(loop) >= MIN_HOLE_PX:
                polygon = loop.astype(np.float32).reshape(-1, 1, 2)
                found += any(
                    cv2.pointPolygonTest(polygon, (float(m[0]), float(m[1])), False) >= 0
                    for m in middles
                )
        return found


class _Points:
    def __init__(self, points: Array) -> None:
        self.points = points


class _Loops:
    def __init__(self, loops: list[_Points]) -> None:
        self.loops = loops


def _area(p: Array) -> float:
    q = np.roll(p, -1, axis=0)
    return 0.5 * abs(float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum()))


def judge_folder(folder: Path, parts: Path, solids: dict[str, Any]) -> list[dict[str, Any]]:
    """Return a row for each picture of a folder, small ones included where there are any."""
    truth = json.loads((folder / "truth.json").read_text())
    camera = camera_of(truth)
    rows = []
    for number, entry in enumerate(truth["images"]):
        views: list[LineView | None] = []
        for thing in entry["objects"]:
            name = str(thing.get("part"))
            if name not in solids:
                files = [p for p in parts.iterdir() if p.name.split(".")[0] == name]
                solid = load_solid(files[0]) if files else None
                solids[name] = (solid, prepare_views(solid) if solid else None)
            solid, prepared = solids[name]
            if not thing.get("known", True) or solid is None:
                views.append(None)
                continue
            views.append(outline(solid, true_pose(solid, thing), camera, prepared=prepared))
        for size, path in (
            ("full", folder / entry["image"]),
            ("lo", folder / "lo" / entry["image"]),
        ):
            picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            if picture is None:
                continue
            rows.append(
                {
                    "folder": folder.name,
                    "image": entry["image"],
                    "light": entry["mode"],
                    "size": size,
                    "aside": number % PERIODS == PERIODS - 1,
                    **judge_picture(picture, views, size == "lo"),
                }
            )
    return rows


def judge_picture(
    picture: NDArray[np.uint8], views: list[LineView | None], is_small: bool
) -> dict[str, Any]:
    took = []
    result: Segmentation = segment(picture)
    for _ in range(REPEATS):
        begin = time.process_time()
        segment(picture)
        took.append(1e3 * (time.process_time() - begin))
    size = (picture.shape[1], picture.shape[0])
    shapes = [TrueShape(v, size, is_small) for v in views if v is not None]
    objects, used = [], set()
    merged = 0
    for region in result.regions:
        merged += max(0, sum(shape.covered(region) > 0.5 for shape in shapes) - 1)
    for shape in shapes:
        ious = [shape.overlap(region) for region in result.regions]
        k = int(np.argmax(ious)) if ious else -1
        if k < 0 or ious[k] < FOUND_IOU:
            objects.append({"iou": ious[k] if ious else 0.0, "is_found": False})
            continue
        used.add(k)
        region = result.regions[k]
        others = [shape.overlap(region, mask) for mask in region.alternatives]
        off = shape.distances(np.vstack(region.loops_px))
        near = off[np.abs(off) < NEAR_PX]
        objects.append(
            {
                "is_found": True,
                "iou": ious[k],
                "iou_best": max([ious[k], *others]),
                "hole_count": shape.hole_count(),
                "holes_found": shape.holes_found(region),
                "distance_px": float(np.median(np.abs(off))),
                "bias_px": float(np.median(near)) if len(near) else float("nan"),
                "near_share": len(near) / len(off),
            }
        )
    strangers = sum(v is None for v in views)
    return {
        "lighting": result.lighting,
        "objects": objects,
        "spurious": max(0, len(result.regions) - len(used) - strangers),
        "merged": merged,
        "time_ms": float(np.median(took)),
        "object_count": len(views),
        "remarks": list(result.remarks),
    }


def summed_up(rows: list[dict[str, Any]]) -> dict[str, Any]:
    things = [thing for row in rows for thing in row["objects"]]
    found = [thing for thing in things if thing["is_found"]]
    single = [row["time_ms"] for row in rows if row["object_count"] == 1]

    def median(key: str) -> float:
        return float(np.nanmedian([thing[key] for thing in found])) if found else float("nan")

    holes = sum(thing["hole_count"] for thing in found)
    return {
        "pictures": len(rows),
        "objects": len(things),
        "found": len(found),
        "merged": sum(row["merged"] for row in rows),
        "spurious": sum(row["spurious"] for row in rows),
        "iou_median": float(np.median([t["iou"] for t in things])) if things else float("nan"),
        "iou_min": min((t["iou"] for t in things), default=float("nan")),
        "iou_best_median": median("iou_best"),
        "iou_best_min": min((t["iou_best"] for t in found), default=float("nan")),
        "hole_recall": sum(t["holes_found"] for t in found) / holes if holes else float("nan"),
        "distance_px": median("distance_px"),
        "bias_px": median("bias_px"),
        "near_share": median("near_share"),
        "single_ms": float(np.median(single)) if single else float("nan"),
        "light_right": sum((r["lighting"] == "backlit") == (r["light"] == "back") for r in rows),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path, default=[SHARED / "images"])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--parts", type=Path, default=SHARED / "parts", help="their CAD files")
    parser.add_argument("--worst", type=int, default=0, help="list so many objects of least IoU")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    missing = [str(f) for f in args.folders if not (f / "truth.json").is_file()]
    if missing:
        print(f"no truth.json in {', '.join(missing)}", file=sys.stderr)
        return 2
    solids: dict[str, Any] = {}
    rows = [row for folder in args.folders for row in judge_folder(folder, args.parts, solids)]
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        groups[f"{row['light']} {row['size']} {'aside' if row['aside'] else 'seen'}"].append(row)
    table = {key: summed_up(groups[key]) for key in sorted(groups)}
    if args.json:
        print(json.dumps({"groups": table, "pictures": rows}))
        return 0
    print(
        "group              light  found     merged spur  IoU med  min    best med  min    holes"
        "  dist px  bias px  near  1 part ms"
    )
    for key, t in table.items():
        print(
            f"{key:17} {t['light_right']:3}/{t['pictures']:<3} {t['found']:3}/{t['objects']:<3}"
            f" {t['merged']:8} {t['spurious']:4}   {t['iou_median']:.4f}  {t['iou_min']:.3f}"
            f"  {t['iou_best_median']:.4f}  {t['iou_best_min']:.3f}    {t['hole_recall']:.2f}"
            f"   {t['distance_px']:.3f}    {t['bias_px']:+.3f}   {t['near_share']:.2f}"
            f"  {t['single_ms']:6.1f}"
        )
    if args.worst:
        flat = [(thing["iou"], row, k) for row in rows for k, thing in enumerate(row["objects"])]
        for iou, row, k in sorted(flat, key=lambda f: f[0])[: args.worst]:
            best = row["objects"][k].get("iou_best", 0.0)
            where = f"{row['folder']}/{row['image']} {row['size']} {k}"
            print(f"{iou:.3f} (best mask {best:.3f}) {where}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
