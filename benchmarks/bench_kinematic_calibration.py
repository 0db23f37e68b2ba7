"""Arm and cameras found in one fit: errors against synthetic cells, stated uncertainty, faults.

Each seed is a cell off its drawing as docs/adr/0041 has it, with corner and joint noise. Pictures:
the flat board five times, the plate in the gripper 18 times before each camera. Measured: how far
the TCP is from the truth over the table and at the station, in the world and as the camera there
sees it; whether the truth is within the stated U (k = 2); whether seeded faults get their name.

    python benchmarks/bench_kinematic_calibration.py --seeds 9000 9020 --faults 5 [--json]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "unit")]

import kinematic_cells as cells  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from controller.commissioning.kinematics import (  # noqa: E402
    CellFit,
    aim_uncertainty_mm,
    calibrate_cell,
    find_faults,
    tcp_poses,
    tcp_uncertainty,
)

# where parts are: grasps over the table, views at the station
PLACES = {
    "table": ("overhead", [[0.3, -0.9, 0.2, -760, -1.5, 0.4], [-0.5, 1.1, -0.4, -700, -1.2, 1.0]]),
    "station": ("inspection", [[0.6, -1.3, 0.5, -465, 0, 1.5], [-0.7, 1.2, 0.1, -465, -0.2, -0.6]]),
}
FAULTS = ("none", "plate scaled", "table board scaled", "overhead moved", "inspection moved")


def errors(cell: cells.TrueCell, fit: CellFit) -> dict[str, dict[str, list[float]]]:
    """Return for each place: errors, stated U and what is known of the tool aside."""
    out = {}
    for place, (camera, rows) in PLACES.items():
        q = np.array(rows)
        found, u = tcp_poses(fit, q), tcp_uncertainty(fit, q)
        true = np.array([cell.T_world_tcp(one) for one in q])
        turn = Rotation.from_matrix(found[:, :3, :3] @ true[:, :3, :3].transpose(0, 2, 1))
        eye, seen = cell.cameras[camera], fit.camera(camera)
        off_px = seen.project(found[:, :3, 3]) - eye.project(true[:, :3, 3])
        depth = (true[:, :3, 3] - eye.position_mm) @ eye.T_world_cam[:3, 2]
        out[place] = {
            "mm": np.linalg.norm(found[:, :3, 3] - true[:, :3, 3], axis=1).tolist(),
            "u_mm": [one.u_mm for one in u],
            "deg": np.degrees(turn.magnitude()).tolist(),
            "u_deg": [float(np.degrees(one.u_rad)) for one in u],
            "aim_mm": (np.linalg.norm(off_px, axis=1) * depth / eye.K[0, 0]).tolist(),
            "u_aim_mm": aim_uncertainty_mm(fit, camera, q).tolist(),
        }
    return out


def with_fault(seed: int, fault: str) -> list:
    """Return the pictures of a cell in which one thing is wrong."""
    cell = cells.true_cell(seed)
    if fault.endswith("scaled"):
        names = ("front", "back") if fault.startswith("plate") else ("flat",)
        by = 0.01 if seed % 2 else -0.01
        cell = replace(cell, scales={**cell.scales, **dict.fromkeys(names, by)})
        return cells.pictures(cell, 18, seed)
    if fault.endswith("moved"):
        camera = fault.split()[0]
        rng = np.random.default_rng([seed, 1])
        moved = cells.bumped(cell.cameras[camera], 3.0, 0.3, rng)
        return cells.pictures(cell, 18, seed, bump=(camera, moved))
    return cells.pictures(cell, 18, seed)


def name_expected(fault: str) -> set[tuple[str, str]]:
    """Return kind and subject that a seeded fault has to be given."""
    if fault == "none":
        return set()
    if fault == "plate scaled":
        return {("board_scaled", "front"), ("board_scaled", "back")}
    if fault == "table board scaled":
        return {("board_scaled", "flat")}
    return {("camera_moved", fault.split()[0])}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", nargs=2, type=int, default=(9000, 9020), metavar=("FROM", "TO"))
    parser.add_argument("--faults", type=int, default=5, help="seeds of each fault (default: 5)")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found: dict[str, dict[str, list[float]]] = {}
    began = time.perf_counter()
    for seed in range(*args.seeds):
        cell = cells.true_cell(seed)
        fit = calibrate_cell(cells.prior(), cells.pictures(cell, 18, seed))
        for place, values in errors(cell, fit).items():
            for key, row in values.items():
                found.setdefault(place, {}).setdefault(key, []).extend(row)
    fit_s = (time.perf_counter() - began) / max(1, args.seeds[1] - args.seeds[0])
    rows = {}
    for place, values in found.items():
        of = {key: np.array(row) for key, row in values.items()}
        rows[place] = {
            f"{key}_{what}": float(value)
            for key in ("mm", "deg", "aim_mm")
            for what, value in (
                ("median", np.median(of[key])),
                ("p95", np.percentile(of[key], 95)),
                ("inside", np.mean(of[key] <= 2 * of[f"u_{key}"])),
            )
        }
    named = {}
    for fault in FAULTS if args.faults else ():
        right = []
        for seed in range(args.seeds[0], args.seeds[0] + args.faults):
            pictures = with_fault(seed, fault)
            faults = find_faults(cells.prior(), pictures, calibrate_cell(cells.prior(), pictures))
            right.append({(f.kind, f.subject) for f in faults} == name_expected(fault))
        named[fault] = float(np.mean(right))
    if args.json:
        print(json.dumps({"places": rows, "faults_named": named, "seconds_a_cell": fit_s}))
        return 0
    print(f"{'TCP':10}{'what':8}{'median':>9}{'p95':>9}{'within U':>10}")
    for place, row in rows.items():
        for key in ("mm", "deg", "aim_mm"):
            shown = [row[f"{key}_{what}"] for what in ("median", "p95", "inside")]
            print(f"{place:10}{key:8}{shown[0]:9.3f}{shown[1]:9.3f}{shown[2]:10.2f}")
    for fault, share in named.items():
        print(f"fault {fault:22} named right: {share:.2f}")
    print(f"{fit_s:.1f} s a cell")
    return 0


if __name__ == "__main__":
    sys.exit(main())
