"""Parts that fall from the fixed gripper: how many come to lie where the camera sees them.

``python benchmarks/bench_chute.py [--count N] [--seed S] [--cell CELL] [--json]``: each part of
recipes/ is put between the fixed gripper's pads in random grasps (a stable pose's facet on a pad,
any turn, the part clear of the palm), is lost, and the jaws open.

A drop is *seen* if the part lies at rest in a stable pose on the table, the whole of it within the
glowing area and in the overhead camera's picture. *Stays* counts parts that hang on a finger: they
are still in the gripper. Then parts are let go over each tray, as a run does, and those are counted
that stay in it.
"""

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402  (the path comes first)

from controller.cad.reading import load_solid as read_part  # noqa: E402
from emulators.gripper_modbus import JawModel  # noqa: E402
from emulators.world import MAX_REST_OFF_RAD, Layout, Solid, World, load_solid, read_layout  # noqa: E402
from emulators.world.ground_truth import tray_of  # noqa: E402
from emulators.world.layout import Array  # noqa: E402
from emulators.world.pictures.geometry.optics import project  # noqa: E402
from emulators.world.poses import JointValues, turn_z  # noqa: E402

CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
STEP_S = 1.0 / 240.0
EDGE_PX = 1.0  # of the picture: what is nearer may be cut off
REST_LIMIT_S = 15.0
TRIES_MAX = 200  # grasps tried for one drop
PALM_MM = 60.0  # behind the TCP the palm begins
HANGS_MM = 250.0  # a part this high has not left the gripper
RELEASE_MM = 1.0  # a run lets parts go this high above a tray


class Arm:
    """An arm at its park."""

    grasp_limit_mm: float | None = None

    def advance(self, dt_s: float) -> None:
        """Nothing: it stands."""

    def joints(self) -> JointValues:
        return JointValues(
            shoulder_rad=math.radians(80.0), pitch_rad=-math.pi / 2.0, jaw_opening_mm=85.0
        )


def is_seen(world: World, layout: Layout, area_mm: Array) -> bool:
    """Return whether part 0 lies flat on the glowing area, the whole of it in the picture."""
    part, camera = world.parts[0], layout.cameras["overhead"]
    if not world.is_at_rest or abs(part.lowest_mm) > 0.1:
        return False
    R = part.T_world_part[:3, :3]
    level = max(-float((R @ rest.down)[2]) for rest in part.solid.rests)
    pixels, _ = project(camera, part.corners_mm)
    size_px = np.array((camera.width_px, camera.height_px))
    corners = part.corners_mm[:, :2]
    return bool(
        level > math.cos(MAX_REST_OFF_RAD)
        and (corners > area_mm[:, 0]).all()
        and (corners < area_mm[:, 1]).all()
        and (pixels > EDGE_PX).all()
        and (pixels < size_px - 1 - EDGE_PX).all()
    )


def hold(world: World, jaws: JawModel, rng: np.random.Generator) -> bool:
    """Let the fixed gripper hold part 0 in a random grasp; False if none was found."""
    part, gripper = world.parts[0], world.fixed_gripper
    tcp = world.layout.fixed_gripper.T_world_tcp[:3, 3]
    for _ in range(TRIES_MAX):
        world.remove(0)
        jaws.opening_mm, jaws.grasp_limit_mm = 85.0, None
        jaws.drive(85.0, 150.0, 60.0)
        world.advance(2.0 * STEP_S)
        gripper.must_open = False
        rests = part.solid.stable_rests or part.solid.rests
        T = turn_z(rng.uniform(0.0, math.tau))
        over = np.diag((1.0, -1.0, -1.0)) if rng.random() < 0.5 else np.eye(3)
        T[:3, :3] = T[:3, :3] @ over @ rests[rng.integers(len(rests))].R
        hull = part.solid.hull_mm @ T[:3, :3].T
        height_mm = float(np.ptp(hull[:, 2]))
        T[:2, 3] = tcp[:2] + rng.uniform((-25.0, -20.0), (25.0, 40.0))
        T[:2, 3] -= (T[:3, :3] @ part.solid.centre_mm)[:2]
        T[2, 3] = tcp[2] - (hull[:, 2].max() + hull[:, 2].min()) / 2.0
        if height_mm > 80.0 or hull[:, 1].min() + T[1, 3] < tcp[1] - PALM_MM:
            continue
        jaws.opening_mm = height_mm + 2.0
        world.advance(STEP_S)
        world.place(0, T)
        jaws.drive(0.0, 150.0, 60.0)
        world.advance(0.2)
        if gripper.hold is not None and gripper.hold.is_seated:
            return True
    return False


def bench_drops(layout: Layout, area_mm: Array, solid: Solid, count: int, seed: int) -> dict:
    jaws = JawModel()
    world = World(layout, [solid], Arm(), jaws, lambda *_: None, seed)
    rng = np.random.default_rng(seed)
    row = {"part": solid.name, "dropped": 0, "seen": 0, "stays": 0, "elsewhere": []}
    try:
        for _ in range(count):
            if not hold(world, jaws, rng):
                break
            world.lose_grasp("fixture")
            jaws.drive(85.0, 150.0, 60.0)
            world.settle(REST_LIMIT_S)
            row["dropped"] += 1
            if is_seen(world, layout, area_mm):
                row["seen"] += 1
            elif world.parts[0].lowest_mm > HANGS_MM:
                row["stays"] += 1
            else:
                row["elsewhere"].append(world.parts[0].centre_mm.round().tolist())
    finally:
        world.close()
    return row


def bench_trays(layout: Layout, solid: Solid, count: int, seed: int) -> dict:
    world = World(layout, [solid], Arm(), JawModel(), lambda *_: None, seed)
    rng = np.random.default_rng(seed)
    row = {"part": solid.name, "released": 0, "in_tray": 0}
    try:
        for tray in layout.trays:
            for _ in range(count):
                rest = solid.stable_rests[rng.integers(len(solid.stable_rests))]
                T = solid.pose_at_rest(rest, *tray.centre_mm, rng.uniform(0.0, math.tau))
                T[2, 3] += RELEASE_MM
                world.place(0, T)
                world.settle(REST_LIMIT_S)
                row["released"] += 1
                row["in_tray"] += tray_of(world, 0) == tray.name
    finally:
        world.close()
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=100, help="drops of each part")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cell", type=Path, default=CELL)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    layout = read_layout(args.cell)
    area_mm = glowing_area_mm(args.cell)
    drops, trays = [], []
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted((ROOT / "recipes" / "parts").glob("*.*")):
            if path.suffix not in (".stl", ".yaml"):
                continue
            mesh_path = Path(folder) / f"{path.name.split('.')[0]}.stl"
            read_part(path).mesh.export(mesh_path)
            solid = load_solid(mesh_path)
            drops.append(bench_drops(layout, area_mm, solid, args.count, args.seed))
            trays.append(bench_trays(layout, solid, max(1, args.count // 5), args.seed))
    if args.json:
        print(json.dumps({"drops": drops, "trays": trays}))
        return
    print(f"{'part':14} {'dropped':>8} {'seen':>6} {'stays':>6} {'elsewhere':>10}")
    for row in drops:
        print(
            f"{row['part']:14} {row['dropped']:8} {row['seen']:6} {row['stays']:6} "
            f"{len(row['elsewhere']):10}  {row['elsewhere'][:4]}"
        )
    fell = sum(row["dropped"] - row["stays"] for row in drops)
    seen = sum(row["seen"] for row in drops)
    print(f"of {fell} that fell, {100.0 * seen / max(fell, 1):.1f} % are seen")
    for row in trays:
        print(f"{row['part']:14} released over trays {row['released']}, in them {row['in_tray']}")


def glowing_area_mm(cell: Path) -> Array:
    """Return low and high of x and y, (2, 2), of the light table."""
    from ruamel.yaml import YAML

    area = YAML(typ="safe", pure=True).load(cell.read_text())["table"]["glowing_area"]
    return np.array([area["x"], area["y"]], dtype=float)


if __name__ == "__main__":
    main()
