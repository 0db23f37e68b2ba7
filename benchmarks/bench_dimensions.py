"""Errors of measured dimensions over their stated uncertainty, on sets of path-traced views.

    python benchmarks/bench_dimensions.py FOLDER [--sets s004,s005] [--lens 0.1] [--json]

FOLDER has sets as ``cellctl.views/1`` describes them (SET.json) and a truth.json beside them with
each view's true pose and each hole's true diameter. The part's pose is taken from there, with the
uncertainty of ``--pose-mm`` and ``--pose-deg`` and no error: what is judged is the measuring
alone. Holes are matched with the derived characteristics by their axis and place. Printed per
set: looks by lamp with their errors [um] and errors over U, what was not evaluated and why, then
all together: the share of errors inside U and the mean of their size over U.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from controller.cad import load_solid, sample_surface
from controller.imaging import Camera
from controller.inspection import (
    HeldView,
    InspectionLimits,
    PosedPart,
    ViewPictures,
    ViewSet,
    ViewTask,
    WorldBox,
)
from controller.inspection.characteristics import CharacteristicKind, RimGeometry, derive, place_of
from controller.inspection.dimensions import PosedView, look, measure
from controller.inspection.grasp_pose import PoseSettings
from controller.inspection.part import pose_views


def corners(panel: dict) -> np.ndarray:
    normal, up = np.array(panel["normal"], float), np.array(panel["up"], float)
    side = np.cross(up, normal) * panel["size"][0] / 2
    up = up * panel["size"][1] / 2
    centre = np.array(panel["centre"], float)
    return centre + np.array([-side - up, side - up, side + up, -side + up])


def joint(part: PosedPart, stored: dict, views: list[PosedView]) -> list[PosedView]:
    """Return views with the poses that the inspection itself finds, as far as it finds them."""
    held = []
    for view, one in zip(views, stored["views"], strict=True):
        task = replace(view.task, T_world_part=np.array(one["T_world_part"]))
        prior = one["prior_mm"], np.radians(one["prior_deg"])
        held.append(HeldView(task, view.pictures, view.grasp, *prior))
    samples = sample_surface(part.solid, 2.0)
    posed = pose_views(ViewSet(part, samples, tuple(held)), PoseSettings())
    return [
        replace(v, T_world_part=pose.T_world_part, covariance=pose.covariance)
        for v in views
        if (pose := posed.pose(v.task.view_id)) is not None
    ]


def load(folder: Path, truth: dict, pose_mm: float, pose_deg: float) -> list[PosedView]:
    stored = json.loads((folder / "SET.json").read_text())
    camera = Camera(
        tuple(stored["camera"]["size_px"]),
        np.array(stored["camera"]["K"]),
        np.array(stored["camera"]["distortion"]),
        np.array(stored["camera"]["T_world_cam"]),
    )
    poses = {p["view"]: np.array(p["T_world_part_true"]) for p in truth["poses"]}
    grasps = {p["view"]: p["grasp"] for p in truth["poses"]}
    covariance = np.diag([pose_mm**2] * 3 + [np.radians(pose_deg) ** 2] * 3)
    views = []
    for view in stored["views"]:
        pictures = {
            name: cv2.imread(str(folder / file), cv2.IMREAD_GRAYSCALE)
            for name, file in view["pictures"].items()
        }
        boxes = tuple(
            WorldBox(np.array(b["T"]), np.array(b["half_mm"])) for b in view["gripper_boxes"]
        )
        task = ViewTask(
            view["id"], camera, poses[view["id"]], boxes, corners(stored["lamps"]["backlight"]),
            (), InspectionLimits(),
        )  # fmt: skip
        backlit = pictures.pop("backlight")
        views.append(
            PosedView(
                task, ViewPictures(backlit, pictures), poses[view["id"]], covariance,
                grasps[view["id"]],
            )
        )  # fmt: skip
    return views


def true_values(truth: dict, characteristic: object) -> float | None:
    """Return the true value of a diameter or a distance, None where it is not known."""
    scale = np.array(truth["scale"])
    if not isinstance(characteristic.geometry, RimGeometry):
        # as built by a scale along each axis of the CAD frame
        return characteristic.nominal_mm * float(scale @ characteristic.geometry.direction**2)
    rim = characteristic.geometry.rims[0]
    if characteristic.kind is not CharacteristicKind.DIAMETER:
        return None
    if not rim.is_hole:
        across = np.sqrt(1.0 - np.square(rim.axis))
        return characteristic.nominal_mm * float((across * scale).sum() / across.sum())
    for hole in truth["holes"]:
        axis = np.array(hole["axis"])
        away = rim.centre_mm - np.array(hole["nominal_ends"][0])
        beside = np.linalg.norm(away - (away @ axis) * axis)
        alike = abs(hole["nominal_d_mm"] - characteristic.nominal_mm) < 0.05
        if abs(axis @ rim.axis) > 0.99 and beside < 0.05 and alike and hole["exists"]:
            return hole["true_d_mm"]
    return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sets", default="")
    parser.add_argument("--pose-mm", type=float, default=0.05)
    parser.add_argument("--pose-deg", type=float, default=0.05)
    parser.add_argument("--joint", action="store_true", help="the poses that inspection finds")
    parser.add_argument("--looks", action="store_true")
    args = parser.parse_args()
    truths = json.loads((args.folder / "truth.json").read_text())["specimens"]
    chosen = set(args.sets.split(",")) if args.sets else None
    ratios, look_ratios = {}, {}
    for truth in truths:
        if chosen is not None and truth["specimen"] not in chosen:
            continue
        folder = args.folder / truth["specimen"]
        stored = json.loads((folder / "SET.json").read_text())
        part = PosedPart(load_solid((folder / stored["part"]).resolve()))
        asked = derive(part.solid)
        views = load(folder, truth, args.pose_mm, args.pose_deg)
        if args.joint:
            views = joint(part, stored, views)
        if not views:
            print(f"{truth['specimen']} {truth['part']} {truth['kind']}: no pose")
            continue
        look(part, asked, views[0])
        begin = time.perf_counter()
        by_view = [look(part, asked, view) for view in views]
        spent = (time.perf_counter() - begin) / len(views)
        results = measure(part, asked, views)
        print(
            f"{truth['specimen']} {truth['part']} {truth['kind']}: {len(asked)} characteristics, "
            f"{1000 * spent:.0f} ms a view"
        )
        reasons: Counter[str] = Counter()
        for i, (characteristic, result) in enumerate(zip(asked, results, strict=True)):
            true = true_values(truth, characteristic)
            for found in by_view:
                for e in found[i]:
                    if e.look.reason:
                        reasons[f"{e.look.lamp}: {e.look.reason}"] += 1
                    elif true is not None:
                        off = e.look.measured_mm - true
                        look_ratios.setdefault(e.look.lamp, []).append((off, off / e.look.u_mm / 2))
                        if args.looks:
                            axis = place_of(characteristic.geometry)[1]
                            tilt = np.degrees(np.arccos(min(abs(e.towards @ axis), 1.0)))
                            parts = ", ".join(
                                f"{k} {1000 * v:.0f}" for k, v in e.look.budget.items() if v > 1e-3
                            )
                            print(
                                f"   {e.look.view_id} {e.look.lamp:9} tilt {tilt:3.0f}: "
                                f"{1000 * off:+6.0f} um of U {2000 * e.look.u_mm:.0f} ({parts})"
                            )
            text = f"  {characteristic.id}: "
            if result.measured_mm is None:
                print(text + result.reason)
                continue
            text += f"{result.measured_mm:.4f} of {characteristic.nominal_mm:g}"
            text += f" U {1000 * result.U_mm:.0f} um, {len(result.views)} views {result.reason}"
            if true is not None:
                off = result.measured_mm - true
                ratios.setdefault(characteristic.kind.value, []).append(off / result.U_mm)
                text += f", error {1000 * off:+.0f} um, {off / result.U_mm:+.2f} U"
            print(text)
        for reason, count in reasons.most_common(8):
            print(f"    {count} x {reason}")
    for lamp, found in look_ratios.items():
        off, ratio = np.array(found).T
        print(
            f"{lamp}: {len(off)} looks, error median {1000 * np.median(off):+.0f} size "
            f"{1000 * np.median(abs(off)):.0f} um, inside U {100 * (abs(ratio) <= 1).mean():.0f} %"
        )
    for kind, found in sorted(ratios.items()):
        ratio = np.abs(found)
        print(
            f"{len(ratio)} x {kind}: {100 * (ratio <= 1).mean():.1f} % inside U, mean size "
            f"{ratio.mean():.2f} U, largest {ratio.max():.2f} U"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
