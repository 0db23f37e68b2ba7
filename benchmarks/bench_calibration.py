"""How far off positions are with a camera calibrated from the shared board pictures.

Errors on the table plane and 40 mm over it [mm], over the whole picture, against the camera that
is known to have taken the pictures: our joint fit, and what OpenCV's `calibrateCamera` gives with
its own corners and with ours. `python -m benchmarks.bench_calibration [--json]`.
"""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.commissioning.calibration import (
    Chessboard,
    View,
    WorldFrame,
    calibrate,
    find_board,
)
from controller.commissioning.target import CalibrationTarget, load_target
from controller.imaging import Camera, inverse_pose

Array = NDArray[np.float64]
IMAGES = Path(__file__).resolve().parents[2] / "shared" / "images"
LO_HI = np.array([[0.2, 0, -0.4], [0, 0.25, -0.375], [0, 0, 1]])
GRID = (65, 53)


def true_camera(told: dict[str, Any], lo: bool) -> Camera:
    T_cam_world = np.eye(4)
    T_cam_world[:3, :3], T_cam_world[:3, 3] = told["R_wc"], told["t_wc"]
    K = np.array(told["K"])
    size = (256, 256) if lo else (told["width"], told["height"])
    return Camera(size, LO_HI @ K if lo else K, np.array(told["dist"]), inverse_pose(T_cam_world))


def opencv_camera(
    views: Sequence[View], pixels: Sequence[Array], size: tuple[int, int], world: WorldFrame
) -> Camera:
    """OpenCV's calibration, the camera over the table from the one board that fixes the world."""
    solid = [np.column_stack([v.board.board_mm, np.zeros(len(v.board.board_mm))]) for v in views]
    _, K, distortion, rvecs, tvecs = cv2.calibrateCamera(
        [s.astype(np.float32) for s in solid],
        [p.astype(np.float32).reshape(-1, 1, 2) for p in pixels],
        size,
        None,
        None,
    )
    anchor = next(i for i, v in enumerate(views) if v.name == world.name)
    T_cam_board, T_world_board = np.eye(4), np.eye(4)
    T_cam_board[:3, :3] = cv2.Rodrigues(rvecs[anchor])[0]
    T_cam_board[:3, 3] = np.ravel(tvecs[anchor])
    c, s = np.cos(world.x_axis_angle_rad), np.sin(world.x_axis_angle_rad)
    T_world_board[:2, :2] = [[c, -s], [s, c]]
    T_world_board[:3, 3] = world.origin_mm
    T_world_cam = T_world_board @ inverse_pose(T_cam_board)
    return Camera(size, np.asarray(K), np.ravel(distortion)[:5], T_world_cam)


def opencv_corners(grey: NDArray[np.uint8], target: Chessboard, like: Array) -> Array:
    """OpenCV's corners, in the order of ours (n, 2)."""
    _, corners = cv2.findChessboardCornersSB(grey, target.inner_corners)
    found = np.asarray(corners, dtype=np.float64).reshape(-1, 2)
    nearest = np.linalg.norm(like[:, None] - found, axis=2).argmin(axis=1)
    ordered: Array = found[nearest]
    return ordered


def errors_mm(found: Camera, truth: Camera, z: float) -> tuple[float, float, float]:
    """Median, 95th percentile and worst over the picture."""
    width, height = truth.size_px
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID[0]), np.linspace(0, height - 1, GRID[1]))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    off = np.linalg.norm(found.on_plane(pixels, z) - truth.on_plane(pixels, z), axis=1)
    return float(np.median(off)), float(np.percentile(off, 95)), float(off.max())


def row(name: str, found: Camera, truth: Camera) -> dict[str, Any]:
    out: dict[str, Any] = {"camera": name}
    for z in (0.0, 40.0):
        median, p95, worst = errors_mm(found, truth, z)
        out[f"z{z:.0f}_mm"] = {"median": median, "p95": p95, "worst": worst}
    out["position_error_mm"] = (found.position_mm - truth.position_mm).tolist()
    return out


def measure(prefix: str, target: CalibrationTarget, told: dict[str, Any]) -> list[dict[str, Any]]:
    truth = true_camera(told, lo=bool(prefix))
    board = target.build()
    if target.world is None or not isinstance(board, Chessboard):
        raise SystemExit("the shared target is a chessboard that fixes the world")
    world = target.world.build()
    pictures = {
        entry.image: np.asarray(
            cv2.imread(str(IMAGES / "calib" / f"{prefix}{entry.image}"), cv2.IMREAD_GRAYSCALE),
            dtype=np.uint8,
        )
        for entry in target.images
    }
    started = time.perf_counter()
    views = [
        View(name, target.placed(name), find_board(grey, board)) for name, grey in pictures.items()
    ]
    found_s = time.perf_counter() - started
    started = time.perf_counter()
    ours = calibrate(views, truth.size_px, world)
    fitted_s = time.perf_counter() - started
    name = "256 x 256" if prefix else "1280 x 1024"
    mine = row(f"{name}: joint fit", ours.camera, truth)
    mine |= {
        "rms_px": ours.rms_px,
        "free": list(ours.free),
        "position_std_mm": ours.position_std_mm.tolist(),
        "stated_worst_mm": [plane.worst_mm for plane in ours.table],
        "finding_s": found_s,
        "fitting_s": fitted_s,
    }
    pixels = [view.board.pixels for view in views]
    theirs = [opencv_corners(pictures[v.name], board, v.board.pixels) for v in views]
    size = truth.size_px
    return [
        mine,
        row(
            f"{name}: calibrateCamera, our corners",
            opencv_camera(views, pixels, size, world),
            truth,
        ),
        row(
            f"{name}: calibrateCamera, its corners",
            opencv_camera(views, theirs, size, world),
            truth,
        ),
    ]


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    arguments = parser.parse_args(argv)
    if not IMAGES.is_dir():
        raise SystemExit(f"{IMAGES} is not there: nothing to calibrate from")
    cv2.setNumThreads(1)
    target = load_target(IMAGES / "calib" / "calib.json")
    told = json.loads((IMAGES / "truth.json").read_text(encoding="utf-8"))["camera"]
    rows = measure("", target, told) + measure("lo_", target, told)
    if arguments.json:
        print(json.dumps({"cameras": rows}))
        return
    print(f"{'':44} {'z = 0 mm':>24} {'z = 40 mm':>24}   camera off")
    print(f"{'':44} {'median    p95  worst':>24} {'median    p95  worst':>24}   x, y, z mm")
    for r in rows:
        cells = [
            f"{r[key]['median']:10.4f} {r[key]['p95']:6.4f} {r[key]['worst']:6.4f}"
            for key in ("z0_mm", "z40_mm")
        ]
        off = ", ".join(f"{x:+.3f}" for x in r["position_error_mm"])
        print(f"{r['camera']:44} {cells[0]:>24} {cells[1]:>24}   {off}")
    for r in rows[::3]:
        stated = ", ".join(f"{x:.3f}" for x in r["stated_worst_mm"])
        std = ", ".join(f"{x:.3f}" for x in r["position_std_mm"])
        print(
            f"{r['camera']}: rms {r['rms_px']:.4f} px, stated worst (z = 0, 40) {stated} mm, "
            f"position std {std} mm, finding {r['finding_s']:.1f} s, fitting {r['fitting_s']:.1f} s"
        )


if __name__ == "__main__":
    main()
