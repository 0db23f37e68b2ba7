"""How true emulated pictures of printed boards are, and what they cost.

``python benchmarks/bench_boards.py [--count N] [--seed S] [--json]``: each board at random poses
under the ring, found by the project's own calibration, against OpenCV's projection of the true
corners.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402

from controller.commissioning.calibration import find_board  # noqa: E402
from controller.commissioning.target import load_board  # noqa: E402
from emulators.world import board_surface, build_scene, read_board, read_layout  # noqa: E402
from emulators.world.pictures.picture import Eye  # noqa: E402
from emulators.world.pictures.sensor import Exposure, blurred, develop  # noqa: E402

CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
BOARDS = ("charuco", "chessboard", "paddle")
BLUR_PX = (0.6, 1.1)  # as built, lenses are between these


def errors_px(name: str, count: int, seed: int) -> dict[str, float | str]:
    """Return what `count` pictures of a board came to."""
    file = ROOT / "recipes" / "boards" / f"{name}.json"
    board, target = read_board(file), load_board(file).build()
    layout = read_layout(CELL)
    scene = build_scene(layout, [])
    ring = [lamp.name for lamp in scene.lamps].index("table_ring")
    eye = Eye(scene, 0)
    eye.add(board_surface("board", board))
    eye.layer(ring)
    camera = scene.cameras[0]
    K = np.diag((camera.focal_px, camera.focal_px, 1.0))
    K[:2, 2] = camera.centre_px
    rng = np.random.default_rng([seed, len(name)])
    middle = ((board.low_mm + board.high_mm) / 2.0)[:2]
    off: dict[bool, list[float]] = {False: [], True: []}
    cpu_s = []
    for number in range(count):
        theta = rng.uniform(-np.pi, np.pi)
        c, s = np.cos(theta), np.sin(theta)
        at = np.array((360.0, 0.0)) + rng.uniform(-20.0, 20.0, 2)
        at -= (c * middle[0] - s * middle[1], s * middle[0] + c * middle[1])
        T = board.pose_on_table(float(at[0]), float(at[1]), theta, rng.uniform(0.0, 0.45))
        begun = time.process_time()
        sharp = eye.picture({"board": T}, {ring: 1.0})
        cpu_s.append(time.process_time() - begun)
        soft = blurred(sharp, float(rng.uniform(*BLUR_PX)))
        for is_noisy in (False, True):
            exposure = Exposure(0.010, seed=int(rng.integers(2**31)))
            grey = develop(soft, exposure, noisy=is_noisy).astype(np.uint8)
            found = find_board(grey, target)
            points = np.column_stack((found.board_mm, np.zeros(len(found.board_mm))))
            T_cam = np.linalg.inv(camera.T_world_cam) @ T
            rvec = cv2.Rodrigues(T_cam[:3, :3])[0]
            there, _ = cv2.projectPoints(points, rvec, T_cam[:3, 3], K, camera.distortion)
            off[is_noisy] += np.linalg.norm(found.pixels - there[:, 0], axis=1).tolist()
        print(f"{name} {number + 1} of {count}", file=sys.stderr)
    rms = {key: float(np.sqrt(np.mean(np.square(one)))) for key, one in off.items()}
    return {
        "board": name,
        "corners": float(len(off[True])),
        "clean_rms_px": rms[False],
        "noisy_rms_px": rms[True],
        "noisy_max_px": max(off[True]),
        "cpu_ms": 1e3 * float(np.median(cpu_s)),
    }


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--count", type=int, default=8, help="pictures of each board")
    parser.add_argument("--seed", type=int, default=4301)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    rows = [errors_px(name, args.count, args.seed) for name in BOARDS]
    if args.json:
        print(json.dumps({"seed": args.seed, "count": args.count, "rows": rows}))
        return
    print("board        corners  clean rms px  noisy rms px  noisy max px   CPU ms")
    for row in rows:
        figures = (row["clean_rms_px"], row["noisy_rms_px"], row["noisy_max_px"])
        print(
            f"{row['board']:12}{row['corners']:8.0f}"
            + "".join(f"{one:14.4f}" for one in figures)
            + f"{row['cpu_ms']:9.0f}"
        )


if __name__ == "__main__":
    main()
