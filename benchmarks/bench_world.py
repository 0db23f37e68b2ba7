"""How long the emulated world takes: a step at rest, while the arm moves, while jaws close.

``python benchmarks/bench_world.py [--json]``: microseconds of CPU in one step of 1/240 s, and how
long parts take to be decomposed into convex pieces for the first time.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402  (the path comes first)
import trimesh  # noqa: E402

from emulators.umi_scara import ArmModel, Axis  # noqa: E402
from emulators.world import World, load_solid, read_layout  # noqa: E402
from emulators.world.matter.solid import read_pieces  # noqa: E402
from emulators.world.poses import JointValues, transform  # noqa: E402

STEP_S = 1.0 / 240.0
PARTS = ("featuretype", "flange_xy", "holder", "idler_riser")


class Arm:
    """An arm that is where it is put."""

    def __init__(self) -> None:
        self.at = JointValues(shoulder_rad=1.4, pitch_rad=-math.pi / 2)
        self.grasp_limit_mm: float | None = None

    def advance(self, dt_s: float) -> None:
        """Nothing: the benchmark moves it."""

    def joints(self) -> JointValues:
        return self.at


class Jaws:
    """Jaws that stand still."""

    def __init__(self) -> None:
        self.opening_mm, self.grasp_limit_mm = 85.0, None

    def advance(self, dt_s: float) -> None:
        """Nothing."""


def above(z_mm: float, x_mm: float = 360.0) -> dict[str, float]:
    elbow = 2.0 * math.acos(x_mm / 507.0)
    return {
        "shoulder_rad": -elbow / 2.0,
        "elbow_rad": elbow,
        "yaw_rad": 0.0,
        "zed_mm": z_mm + 177.0 - 915.0,
    }


def per_step_us(world: World, steps: int, each: Callable[[int], None], slice_steps: int) -> float:
    begun = time.process_time()
    for i in range(0, steps, slice_steps):
        each(i)
        world.advance(slice_steps * STEP_S)
    return 1e6 * (time.process_time() - begun) / steps


def bench_steps(name: str) -> dict[str, float]:
    layout = read_layout(ROOT / "recipes" / "cells" / "emulated.yaml")
    solid = load_solid(ROOT / "recipes" / "parts" / f"{name}.stl")
    arm = Arm()
    world = World(layout, [solid], arm, Jaws(), lambda *_: None, seed=1)  # type: ignore[arg-type]  # bench jaws
    result: dict[str, float] = {}

    def still(_: int) -> None:
        pass

    world.drop(0, 360.0, 0.0, rest=0, theta_rad=0.3)
    count = 40
    result["falling"] = per_step_us(world, count, still, 1)
    world.settle()
    result["at_rest"] = per_step_us(world, 24_000, still, 4)
    start = above(250.0)

    def move(i: int) -> None:
        arm.at = replace(arm.at, **{**start, "shoulder_rad": start["shoulder_rad"] + 2e-4 * i})

    result["arm_moves"] = per_step_us(world, 1200, move, 4)
    arm.at = replace(arm.at, **above(max(3.0, 0.4 * float(world.parts[0].bounds_mm[1][2]))))
    world.advance(STEP_S)

    def close(_: int) -> None:
        limit = arm.grasp_limit_mm or 0.0
        arm.at = replace(arm.at, jaw_opening_mm=max(limit, arm.at.jaw_opening_mm - 0.3))

    result["jaws_close"] = per_step_us(world, 150, close, 1)
    world.close()
    return result


def bench_arm_model() -> float:
    arm = ArmModel(1)
    arm.reference()
    arm.place({Axis.ZED: -1000.0})
    begun = time.process_time()
    for _ in range(2000):
        arm.advance(4 * STEP_S)
    return 1e6 * (time.process_time() - begun) / 8000


def bench_pieces(name: str) -> dict[str, float]:
    before = os.environ.get("XDG_CACHE_HOME")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        begun = time.perf_counter()
        solid = load_solid(ROOT / "recipes" / "parts" / f"{name}.stl")
        seconds = time.perf_counter() - begun
        pieces = [transform(solid.T_part_body, p * 1000.0) for p in read_pieces(solid.pieces_path)]
        begun = time.perf_counter()
        load_solid(ROOT / "recipes" / "parts" / f"{name}.stl")
        again = time.perf_counter() - begun
    if before is None:
        del os.environ["XDG_CACHE_HOME"]
    else:
        os.environ["XDG_CACHE_HOME"] = before
    mesh = trimesh.Trimesh(solid.vertices_mm, solid.faces)
    hulls = [trimesh.convex.convex_hull(piece) for piece in pieces]
    points = np.vstack([trimesh.sample.sample_surface(hull, 150, seed=1)[0] for hull in hulls])
    outside = -trimesh.proximity.signed_distance(mesh, points)
    return {
        "triangles": len(solid.faces),
        "seconds_first": seconds,
        "seconds_again": again,
        "pieces": len(pieces),
        "outside_median_mm": float(np.median(outside)),
        "outside_p95_mm": float(np.quantile(outside, 0.95)),
        "volume_ratio": float(sum(hull.volume for hull in hulls) / mesh.volume),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    args = parser.parse_args()
    steps = {name: bench_steps(name) for name in PARTS}
    pieces = {name: bench_pieces(name) for name in PARTS}
    idle_us = bench_arm_model()
    if args.json:
        print(json.dumps({"us_per_step": steps, "pieces": pieces, "arm_model_idle_us": idle_us}))
        return
    kinds = list(next(iter(steps.values())))
    print("CPU microseconds a step of 1/240 s")
    print(f"{'part':14}" + "".join(f"{kind:>12}" for kind in kinds))
    for name, row in steps.items():
        print(f"{name:14}" + "".join(f"{row[kind]:12.1f}" for kind in kinds))
    print(f"the arm's own model at rest: {idle_us:.1f}\n")
    print("convex pieces (outside: how far their surface is from the part's)")
    names = list(next(iter(pieces.values())))
    print(f"{'part':14}" + "".join(f"{one:>19}" for one in names))
    for name, row in pieces.items():
        print(f"{name:14}" + "".join(f"{row[one]:19.2f}" for one in names))


if __name__ == "__main__":
    main()
