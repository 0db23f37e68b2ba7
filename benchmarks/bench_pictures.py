"""How long pictures take: ray casting as built, against pybullet's own renderer.

``python benchmarks/bench_pictures.py [--cell FILE] [--json]``: milliseconds of one core a picture.
The clock is kept up with while a picture takes less than the camera's frame time, 200 ms.
"""

import argparse
import json
import math
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"
ROOT = Path(__file__).parents[1]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
sys.path.insert(0, str(ROOT))

import cv2  # noqa: E402  (threads and path come first)
import numpy as np  # noqa: E402
import pybullet  # noqa: E402

from emulators.world import build_scene, load_solid, read_layout  # noqa: E402
from emulators.world.layout import Array  # noqa: E402
from emulators.world.pictures.picture import Eye  # noqa: E402
from emulators.world.pictures.sensor import Exposure, blurred, develop  # noqa: E402
from emulators.world.poses import JointValues, forward, rotation_about  # noqa: E402

REPEATS = 5


def poses_in_hand(cell: Path, centre_mm: Array) -> dict[str, Array]:
    """Return a cell whose arm shows a part at the station, approach level and away."""
    layout = read_layout(cell)
    arm, psi = layout.arm, math.radians(30.0)
    tip = layout.station_mm - 15.0 * np.array((math.cos(psi), math.sin(psi), 0.0))
    wrist = tip - arm.tool_mm * np.array((math.cos(psi), math.sin(psi), 0.0))
    reach = float(np.hypot(*wrist[:2]))
    elbow = 2.0 * math.acos(reach / (2.0 * arm.upper_mm))
    phi = math.atan2(wrist[1], wrist[0])
    joints = JointValues(
        shoulder_rad=phi - elbow / 2.0,
        elbow_rad=elbow,
        yaw_rad=psi - phi,
        zed_mm=float(tip[2]) - arm.wrist_height_mm,
    )
    poses = forward(arm, joints)
    for sign in (1.0, -1.0):
        T = poses["arm gripper"].copy()
        T[:3, 3] += sign * 32.0 * T[:3, 1]
        poses["arm finger +" if sign > 0 else "arm finger -"] = T
    T = poses["arm gripper"].copy()
    T[:3, :3] = T[:3, :3] @ rotation_about(np.array((0.0, 1.0, 0.0)), 0.5)
    T[:3, 3] = layout.station_mm - T[:3, :3] @ centre_mm
    return {**poses, "part 0": T}


def ready_ms(cell_file: Path, part: Path) -> dict[str, float]:
    """Return wall and CPU milliseconds until an emulated cell is ready, both processes, as one."""
    command = [sys.executable, "-m", "emulators", "--cell", str(cell_file), "--part", str(part)]
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with subprocess.Popen(
        [*command, "--die-with-parent"], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as cell:
        assert cell.stdin is not None
        assert cell.stdout is not None
        cell.stdout.readline()
        wall_ms = 1e3 * (time.perf_counter() - begun)
        cell.stdin.close()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return {"cpu_ms": 1e3 * cpu_s, "wall_ms": wall_ms}


def cast_ms(eye: Eye, poses: dict[str, Array], lamps: list[int]) -> dict[str, float]:
    """Return wall and CPU milliseconds of one picture, the best of some."""
    levels = dict.fromkeys(lamps, 1.0)
    eye.picture(poses, levels)
    cpu, wall = [], []
    for _ in range(REPEATS):
        c, w = time.process_time(), time.perf_counter()
        develop(blurred(eye.picture(poses, levels)), Exposure(0.010))
        cpu.append(time.process_time() - c)
        wall.append(time.perf_counter() - w)
    return {"cpu_ms": 1e3 * min(cpu), "wall_ms": 1e3 * min(wall)}


def tiny_renderer_ms(path: Path) -> dict[str, float]:
    """Return what pybullet's software renderer takes for one part and a plane; hard edges."""
    client = pybullet.connect(pybullet.DIRECT)
    shape = pybullet.createVisualShape(
        pybullet.GEOM_MESH, fileName=str(path), meshScale=[1e-3] * 3, physicsClientId=client
    )
    pybullet.createMultiBody(0.0, -1, shape, physicsClientId=client)
    view = pybullet.computeViewMatrix([0.05, 0.03, 0.6], [0.05, 0.03, 0.0], [0, 1, 0])
    lens = pybullet.computeProjectionMatrixFOV(20.0, 1280 / 1024, 0.1, 2.0)
    cpu, wall = [], []
    for _ in range(3):
        c, w = time.process_time(), time.perf_counter()
        pybullet.getCameraImage(
            1280, 1024, view, lens, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=client
        )
        cpu.append(time.process_time() - c)
        wall.append(time.perf_counter() - w)
    pybullet.disconnect(client)
    return {"cpu_ms": 1e3 * min(cpu), "wall_ms": 1e3 * min(wall)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--part", default="featuretype")
    parser.add_argument("--cell", type=Path, default=CELL)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    path = ROOT / "recipes" / "parts" / f"{args.part}.stl"
    solid = load_solid(path)
    scene = build_scene(read_layout(args.cell), [solid])
    lamps = [lamp.name for lamp in scene.lamps]
    begun, begun_cpu = time.perf_counter(), time.process_time()
    eyes = [Eye(scene, number) for number in range(2)]
    for eye, place in zip(eyes, ("table", "station"), strict=True):
        for number, name in enumerate(lamps):
            if name.startswith(place):
                eye.layer(number)
    wall_ms = 1e3 * (time.perf_counter() - begun)
    cpu_ms = 1e3 * (time.process_time() - begun_cpu)
    result = {"what stands still": {"cpu_ms": cpu_ms, "wall_ms": wall_ms}}
    table = {"part 0": solid.pose_at_rest(solid.rests[0], 360.0, 0.0, 0.4)}
    hand = poses_in_hand(args.cell, solid.centre_mm)
    for place, eye, poses in (("table", eyes[0], table), ("station", eyes[1], hand)):
        for light in (("backlight",), ("ring",), ("side",), ("ring", "side")):
            numbers = [lamps.index(f"{place}_{one}") for one in light]
            result[f"{place} {'+'.join(light)}"] = cast_ms(eye, poses, numbers)
    width, height = scene.cameras[1].width_px, scene.cameras[1].height_px
    sharp = np.full((height, width), 0.5, np.float32)
    c, w = time.process_time(), time.perf_counter()
    for _ in range(REPEATS):
        develop(blurred(sharp), Exposure(0.010))
    result["blur, noise, digits alone"] = {
        "cpu_ms": 1e3 * (time.process_time() - c) / REPEATS,
        "wall_ms": 1e3 * (time.perf_counter() - w) / REPEATS,
    }
    result["pybullet TinyRenderer"] = tiny_renderer_ms(path)
    result["an emulated cell, until it is ready"] = ready_ms(args.cell, path)
    if args.json:
        print(json.dumps(result))
        return
    print(f"{f'{width} x {height} px, {args.part}':36}{'CPU ms':>9}{'wall ms':>9}")
    for name, row in result.items():
        print(f"{name:36}{row['cpu_ms']:9.0f}{row['wall_ms']:9.0f}")


if __name__ == "__main__":
    main()
