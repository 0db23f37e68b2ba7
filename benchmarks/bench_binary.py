"""What the binary chain names for backlit pictures, how surely, and in what time.

``python benchmarks/bench_binary.py [--json] [--pictures DIR] [--parts FILES] [--turns N]
[--small]``: share of objects of which the best candidate, any of the best 3 and any of the best 10
is the right part and pose, up to the part's symmetry, turned right to 3 degrees. Models are all
poses of the parts, seen from the camera where the object's outline has its centroid, at N turns
all round. A tall part's shadow depends on how it is turned, so the best 12 are drawn again as
found and compared once more ("second look"). The truth file gives the camera, and judges.

``python benchmarks/bench_binary.py --table IMAGE``: the paper's Table 2 of the largest outline.
"""

import argparse
import json
import math
import os
import sys
import time
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

from controller.cad import StablePose, ViewModel, outline, prepare_views  # noqa: E402
from controller.cad.compiled import CompiledPart, load_part, part_name  # noqa: E402
from controller.imaging import Camera, inverse_pose  # noqa: E402
from controller.recognition import pose_on_table  # noqa: E402
from controller.recognition.binary import (  # noqa: E402
    BinaryTolerances,
    BoundaryString,
    StringMatch,
    boundary_string,
    chain_code,
    corner_table,
    correlate,
    curvature_code,
    find_corners,
    model_string,
    triangular,
)
from controller.recognition.library import shadow_camera  # noqa: E402
from controller.recognition.segmentation import Region, segment  # noqa: E402

Array = NDArray[np.float64]
SHARED = ROOT.parent / "shared"
RIGHT_DEG = 3.0
NAMED = (1, 3, 10)
SECOND_LOOK = 12
MIN_PROBABILITY = 0.005


@dataclass(frozen=True, eq=False)
class Model:
    """A part in one of its poses, turned."""

    name: str
    part: CompiledPart
    prepared: ViewModel
    pose: StablePose
    turn_rad: float

    def string(
        self, table: Camera, x_mm: float, y_mm: float, limits: BinaryTolerances
    ) -> BoundaryString:
        """Return the string of its shadow at a place on the table."""
        solid = self.part.solid
        T = pose_on_table(solid, self.pose, x_mm, y_mm, self.turn_rad)
        view = outline(solid, T, table, prepared=self.prepared)
        foot = table.position_mm
        return model_string(view.loops, limits, from_view=(float(foot[0]), float(foot[1])))

    def off_deg(self, truth: dict[str, Any], turn_rad: float) -> float:
        """Return how far it is turned from the truth, up to symmetry; 180 for another part."""
        if self.name != truth["part"]:
            return 180.0
        there = about_z(math.radians(truth["theta_deg"])) @ np.array(truth["stable_pose_R"])
        here = about_z(self.turn_rad + turn_rad) @ self.pose.R
        symmetry = self.part.symmetry
        if symmetry.axis is not None:
            ends = (
                [symmetry.axis] if len(symmetry.rotations) < 2 else [symmetry.axis, -symmetry.axis]
            )
            cosine = max(float((here @ end) @ (there @ symmetry.axis)) for end in ends)
        else:
            cosine = max((float(np.trace(here @ S @ there.T)) - 1) / 2 for S in symmetry.rotations)
        return math.degrees(math.acos(min(1.0, max(-1.0, cosine))))


def about_z(angle_rad: float) -> Array:
    """Return the rotation (3, 3) about the vertical."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def cameras_of(truth: dict[str, Any]) -> tuple[Camera, Camera]:
    """Return the camera, and the one that sees shadows on the table in mm from its place."""
    told = truth["camera"]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = told["R_wc"], told["t_wc"]
    camera = Camera(
        (told["width"], told["height"]),
        np.array(told["K"]),
        np.array(told["dist"]),
        inverse_pose(T),
    )
    return camera, shadow_camera(camera.position_mm)


def models_of(paths: list[Path], turns: int) -> list[Model]:
    """Return all parts in all poses at some turns."""
    out = []
    for path in paths:
        part = load_part(path)
        prepared = prepare_views(part.solid)
        out += [
            Model(part_name(path), part, prepared, pose, 2 * math.pi * k / turns)
            for pose in part.poses
            if pose.probability >= MIN_PROBABILITY
            for k in range(turns)
        ]
    return out


@dataclass(frozen=True, eq=False)
class Optics:
    """The camera, the one that sees shadows in mm, and how the pictures' pixels lie in its own.

    A pixel of a small picture covers ``binning`` of the camera's, (across, down).
    """

    camera: Camera
    table: Camera
    binning: tuple[int, int]

    @property
    def limits(self) -> BinaryTolerances:
        """Tolerances for the size of the pixels."""
        fine = self.camera.mm_per_px(np.zeros(3))
        return BinaryTolerances.for_pixels(fine * max(self.binning))

    def on_table(self, pixels: Array) -> Array:
        """Return points (n, 2) of the table plane."""
        fine = (pixels + 0.5) * np.array(self.binning, dtype=float) - 0.5
        return self.camera.on_plane(fine)[:, :2]


def seen(region: Region, optics: Optics) -> BoundaryString:
    """Return the string of a thing in a picture, in the table plane."""
    loops = [optics.on_table(loop) for loop in region.loops_px]
    return boundary_string(loops, [i > 0 for i in range(len(loops))], optics.limits)


def nearest_truth(truth: dict[str, Any], image: str, at: Array) -> dict[str, Any]:
    """Return the object of a picture that lies nearest to a place."""
    (entry,) = (e for e in truth["images"] if e["image"] == image)
    objects: list[dict[str, Any]] = entry["objects"]
    return min(objects, key=lambda o: math.hypot(o["x_mm"] - at[0], o["y_mm"] - at[1]))


def hits(
    models: list[Model], matches: tuple[StringMatch, ...], truth: dict[str, Any]
) -> list[bool]:
    """Return whether a right one is among the first 1, 3 and 10."""
    right = [models[m.model_index].off_deg(truth, m.turn_rad) < RIGHT_DEG for m in matches]
    return [any(right[:count]) for count in NAMED]


def run(folder: Path, parts: list[Path], turns: int, is_small: bool) -> dict[str, Any]:
    """Return the rows of all objects in backlit pictures, and the summary."""
    truth = json.loads((folder / "truth.json").read_text())
    optics = Optics(*cameras_of(truth), (5, 4) if is_small else (1, 1))
    pictures = folder / "lo" if is_small else folder
    models = models_of(parts, turns)
    rows = []
    for entry in truth["images"]:
        if entry["mode"] != "back":
            continue
        picture = cv2.imread(str(pictures / entry["image"]), cv2.IMREAD_GRAYSCALE)
        for region in segment(picture, "backlit").regions:
            if region.touches_edge:
                continue
            rows.append(one(entry["image"], region, optics, models, truth))
    known = [row for row in rows if row["part"] is not None]
    summary: dict[str, Any] = {
        "objects": len(known),
        "unknown": len(rows) - len(known),
        "models": len(models),
        "turns": turns,
    }
    for look in ("first", "second"):
        for k, count in enumerate(NAMED):
            found = sum(row[look][k] for row in known)
            summary[f"{look}_look_best_{count}"] = round(found / max(len(known), 1), 4)
    for name in ("chain_ms", "string_ms", "correlate_ms", "correlate_12_ms"):
        values = [row[name] for row in rows]
        summary[f"{name}_median"] = round(float(np.median(values)), 2)
        summary[f"{name}_p95"] = round(float(np.percentile(values, 95)), 2)
    return {"summary": summary, "rows": rows}


def one(
    image: str,
    region: Region,
    optics: Optics,
    models: list[Model],
    truth: dict[str, Any],
) -> dict[str, Any]:
    """Return what is named for one object."""
    t0 = time.process_time()
    chain_code(region.mask)
    t1 = time.process_time()
    observed = seen(region, optics)
    t2 = time.process_time()
    x, y = observed.centroid_mm.tolist()
    table, limits = optics.table, optics.limits
    strings = [model.string(table, x, y, limits) for model in models]
    t3 = time.process_time()
    first = correlate(observed, strings, limits)
    t4 = time.process_time()
    again, drawn = [], []
    for match in first[:SECOND_LOOK]:
        model = models[match.model_index]
        # where the match puts the place the model was made for
        moved = complex(x, y) * np.exp(1j * match.turn_rad) + complex(*match.shift_mm)
        turned = Model(
            model.name, model.part, model.prepared, model.pose, model.turn_rad + match.turn_rad
        )
        again.append(turned)
        drawn.append(turned.string(table, moved.real, moved.imag, limits))
    t5 = time.process_time()
    second = correlate(observed, drawn, limits)
    t6 = time.process_time()
    told = nearest_truth(truth, image, observed.centroid_mm)
    best = [again[m.model_index] for m in second[:1]]
    return {
        "image": image,
        "part": told["part"] if told.get("known", True) else None,
        "first": hits(models, first, told),
        "second": hits(again, second, told),
        "named": [f"{b.name} {b.pose.index}" for b in best],
        "error_mm": [round(m.error_mm, 3) for m in second[:2]],
        "chain_ms": 1e3 * (t1 - t0),
        "string_ms": 1e3 * (t2 - t1),
        "correlate_ms": 1e3 * (t4 - t3),
        "correlate_12_ms": 1e3 * (t6 - t5),
    }


def table_of(path: Path) -> str:
    """Return the paper's Table 2 of the largest object in a backlit picture."""
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise SystemExit(f"{path}: no picture")
    regions = segment(picture, "backlit").regions
    if not regions:
        return "nothing lies on the table"
    chain = chain_code(regions[0].mask)[0]
    corners = find_corners(triangular(curvature_code(chain), 15), threshold=10, reach=15)
    return corner_table(corners)


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--pictures", type=Path, default=SHARED / "images")
    parser.add_argument(
        "--parts", type=Path, nargs="+", help="CAD files; the shared ones otherwise"
    )
    parser.add_argument("--small", action="store_true", help="the 256 x 256 pictures in lo/")
    parser.add_argument("--turns", type=int, default=1)
    parser.add_argument("--table", type=Path, metavar="IMAGE")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.table is not None:
        print(table_of(args.table))
        return
    if not args.pictures.is_dir():
        print(f"{args.pictures}: no pictures here")
        return
    parts = args.parts or sorted((SHARED / "parts").glob("*.stl"))
    found = run(args.pictures, parts, args.turns, args.small)
    if args.json:
        print(json.dumps(found, indent=1))
        return
    for row in found["rows"]:
        if row["part"] is None or not (row["first"][0] and row["second"][0]):
            marks = ["".join("+" if hit else "-" for hit in row[k]) for k in ("first", "second")]
            print(row["image"], row["part"] or "unknown", *marks, row["named"], row["error_mm"])
    for name, value in found["summary"].items():
        print(f"{name:26s} {value}")


if __name__ == "__main__":
    main()
