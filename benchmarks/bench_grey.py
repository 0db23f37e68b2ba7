"""How often the grey chain's best hypotheses hold the right one, and how long it takes.

``python benchmarks/bench_grey.py [--json] [--small] [--parts DIR] [--pictures DIR ...]``: crops
of front-lit
pictures, cut by the truth's silhouettes, against all ways to lie of the shared parts. A
hypothesis is right if part and pose are, up to the part's symmetry, within 4 deg and 3 mm.
Pictures whose number is 3 modulo 4 are reported apart.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
from numpy.typing import NDArray  # noqa: E402

from controller.cad import LookAlike, PartSymmetry, Solid, StablePose, camera_view, prepare_views  # noqa: E402
from controller.cad.compiled import CompiledPart, load_part, part_name  # noqa: E402
from controller.imaging import Camera  # noqa: E402
from controller.recognition import pose_on_table  # noqa: E402
from controller.recognition.grey import (  # noqa: E402
    FeatureIndex,
    ViewHypothesis,
    feature_index,
    image_features,
    model_features,
    propose,
)
from controller.recognition.library import shadow_camera  # noqa: E402

Array = NDArray[np.float64]

SHARED = Path(os.environ.get("CELLCTL_SHARED", ROOT.parent / "shared"))
MIN_PROBABILITY = 0.01
MARGIN_PX = 15
WITHIN_RAD, WITHIN_MM = math.radians(4.0), 3.0
RANKS = (1, 5, 10)
REPEATS = 3


@dataclass(frozen=True, eq=False, slots=True)
class View:
    """One way to lie of one part."""

    solid: Solid
    symmetry: PartSymmetry
    look_alikes: tuple[LookAlike, ...]
    pose: StablePose


@dataclass(frozen=True, eq=False, slots=True)
class Seen:
    """One object of a picture: its crop and what it truly is."""

    name: str
    apart: bool
    grey: NDArray[np.uint8]
    corner_px: Array
    camera: Camera
    scale: Array
    part: str | None
    R: Array
    xy_mm: Array
    pose_id: int


def camera_of(truth: dict[str, Any]) -> Camera:
    """Return the camera of a truth file."""
    c = truth["camera"]
    T = np.eye(4)
    T[:3, :3] = np.array(c["R_wc"]).T
    T[:3, 3] = c["position"]
    return Camera((c["width"], c["height"]), np.array(c["K"]), np.array(c["dist"]), T)


def parts_in(folder: Path) -> dict[str, CompiledPart]:
    """Return the parts of a folder by name: those of its manifest, else its CSG files."""
    manifest = folder / "manifest.json"
    if manifest.exists():
        entries = json.loads(manifest.read_text())["parts"]
        return {e["name"]: load_part(folder / (e.get("step") or e["stl"])) for e in entries}
    return {part_name(f): load_part(f) for f in sorted(folder.glob("*.csg.yaml"))}


def library(parts: dict[str, CompiledPart]) -> list[View]:
    """Return the ways to lie of some parts."""
    views = []
    for part in parts.values():
        views += [
            View(part.solid, part.symmetry, part.look_alikes, pose)
            for pose in part.poses
            if pose.probability >= MIN_PROBABILITY
        ]
    return views


def index_at(views: list[View], eye_mm: float) -> FeatureIndex:
    """Return the library's features as seen by an eye straight above."""
    table = shadow_camera(np.array([0.0, 0.0, eye_mm]))
    prepared: dict[int, Any] = {}
    models = []
    for view in views:
        model = prepared.setdefault(id(view.solid), prepare_views(view.solid))
        T = pose_on_table(view.solid, view.pose, 0.0, 0.0, 0.0)
        drawing = camera_view(view.solid, T, table, prepared=model)
        models.append(model_features(drawing, T, eye_mm))
    return feature_index(models)


def objects(folder: Path, parts: dict[str, CompiledPart], *, small: bool) -> Iterator[Seen]:
    """Yield the known objects of a folder's front-lit pictures, cut out with a margin."""
    truth = json.loads((folder / "truth.json").read_text())
    camera = camera_of(truth)
    scale = np.array([5.0, 4.0]) if small else np.ones(2)
    for picture in truth["images"]:
        if picture["mode"] != "front":
            continue
        file = folder / ("lo" if small else ".") / picture["image"]
        if not file.exists():
            continue
        grey = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        number = int("".join(filter(str.isdigit, Path(picture["image"]).stem)) or 0)
        for thing in picture["objects"]:
            if not thing["known"] or thing["part"] not in parts:
                continue
            solid = parts[thing["part"]].solid
            a = math.radians(thing["theta_deg"])
            turn = np.array(
                [[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]]
            )
            R = turn @ np.array(thing["stable_pose_R"])
            points = (np.asarray(solid.mesh.vertices) - solid.centroid_mm) @ R.T
            points += [thing["x_mm"], thing["y_mm"], -points[:, 2].min()]
            pixels = (camera.project(points) + 0.5) / scale - 0.5
            margin = MARGIN_PX / scale
            low = np.maximum(np.floor(pixels.min(axis=0) - margin), 0).astype(int)
            high = np.ceil(pixels.max(axis=0) + margin + 1).astype(int)
            crop = np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]])
            yield Seen(
                f"{folder.name}/{picture['image']}",
                number % 4 == 3,
                crop,
                low.astype(float),
                camera,
                scale,
                thing["part"],
                R,
                np.array([thing["x_mm"], thing["y_mm"]]),
                thing["pose_id"],
            )


def is_right(seen: Seen, view: View, found: ViewHypothesis) -> bool:
    """Tell whether a hypothesis is the truth up to the part's symmetry."""
    if view.solid.name != seen.part or np.abs(found.shift_mm - seen.xy_mm).max() > 20:
        return False
    if np.hypot(*(found.shift_mm - seen.xy_mm)) > WITHIN_MM:
        return False
    R = pose_on_table(view.solid, view.pose, 0, 0, found.turn_rad)[:3, :3]
    if view.symmetry.axis is not None:
        axis = np.array([R @ g @ view.symmetry.axis for g in view.symmetry.rotations])
        return bool((axis @ (seen.R @ view.symmetry.axis)).max() > math.cos(WITHIN_RAD))
    turns = np.einsum("ij,gjk,lk->gil", R, view.symmetry.rotations, seen.R)
    angle = np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1))
    return bool(angle.min() < WITHIN_RAD)


def timed(seen: Seen, index: FeatureIndex, foot: tuple[float, float]) -> dict[str, Any]:
    """Return features, hypotheses and the processor time of either."""
    best = [math.inf, math.inf]
    for _ in range(REPEATS):
        begun = time.process_time()
        features = image_features(
            seen.grey,
            lambda p: seen.camera.on_plane((p + seen.corner_px + 0.5) * seen.scale - 0.5)[:, :2],
        )
        between = time.process_time()
        found = propose(features, index, foot_mm=foot, most=max(RANKS))
        best = [min(best[0], between - begun), min(best[1], time.process_time() - between)]
    return {"features": features, "found": found, "ms": [1e3 * b for b in best]}


def judge(
    folders: list[Path], parts: dict[str, CompiledPart], *, small: bool
) -> list[dict[str, Any]]:
    """Return a row for every object."""
    views = library(parts)
    rows: list[dict[str, Any]] = []
    index = None
    for folder in folders:
        for seen in objects(folder, parts, small=small):
            foot = seen.camera.position_mm
            if index is None:
                index = index_at(views, float(foot[2]))
            result = timed(seen, index, (float(foot[0]), float(foot[1])))
            right = [is_right(seen, views[h.model_index], h) for h in result["found"]]
            first = result["found"][0] if result["found"] else None
            rows.append(
                {
                    "picture": seen.name,
                    "part": seen.part,
                    "pose": seen.pose_id,
                    "apart": seen.apart,
                    "rank": right.index(True) + 1 if any(right) else None,
                    "score": first.score if first else None,
                    "scores": [round(h.score, 3) for h in result["found"][:5]],
                    "first": _called(views[first.model_index]) if first else None,
                    "size": list(seen.grey.shape[::-1]),
                    "features_ms": result["ms"][0],
                    "hypotheses_ms": result["ms"][1],
                }
            )
    return rows


def _called(view: View) -> str:
    return f"{view.solid.name}/{view.pose.index}"


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return rates and times of some objects."""
    count = max(len(rows), 1)
    out: dict[str, Any] = {"objects": len(rows)}
    for rank in RANKS:
        out[f"right among best {rank}"] = (
            sum(r["rank"] is not None and r["rank"] <= rank for r in rows) / count
        )
    for name in ("features_ms", "hypotheses_ms"):
        times = [r[name] for r in rows]
        out[name] = {"median": float(np.median(times)), "most": max(times)} if times else None
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--small", action="store_true", help="256 x 256, 6 bit")
    parser.add_argument("--parts", type=Path, default=SHARED / "parts", help="folder")
    parser.add_argument("--pictures", type=Path, nargs="+", default=[SHARED / "images"])
    args = parser.parse_args()
    if not (SHARED / "images" / "truth.json").exists():
        print("the shared pictures are absent; nothing is measured", file=sys.stderr)
        return
    cv2.setNumThreads(1)
    rows = judge(args.pictures, parts_in(args.parts), small=args.small)
    groups = {
        "in use": [r for r in rows if not r["apart"]],
        "kept aside": [r for r in rows if r["apart"]],
    }
    result = {name: summary(group) for name, group in groups.items()}
    if args.json:
        print(json.dumps({"summary": result, "objects": rows}))
        return
    for r in rows:
        print(
            f"{r['picture'][-22:]:23}{r['part']:22}{r['pose']:3}{'*' if r['apart'] else ' '}"
            f" rank {r['rank'] or '-':>2}  {r['first'] or '-':26}{r['scores']}"
            f"  {r['size']} {r['features_ms']:6.1f}{r['hypotheses_ms']:6.1f} ms"
        )
    for name, group in result.items():
        print(f"{name}: {group}")


if __name__ == "__main__":
    main()
