"""How fast the drivers are on their emulated devices, against what the devices themselves need.

python benchmarks/bench_wires.py [--json] [--speed 10]

Ideal is the time that the metal (or the sensor) takes by its own speeds, divided by the speed of
the cell's clock; what lies above it is requests, polls and the host.
"""

import argparse
import asyncio
import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "cross"), str(ROOT / "tests" / "unit")]

from modbus_bench import Transport as Line  # noqa: E402  (path set above)
from test_camera_over_v4l2 import EXPOSURE_S, PERIOD_S, Transport, camera_bench  # noqa: E402
from test_gripper_over_modbus import gripper_bench  # noqa: E402
from test_lights_over_modbus import lights_bench  # noqa: E402
from test_umi_over_pty import random_targets  # noqa: E402
from umi_bench import arm_bench  # noqa: E402

from drivers.umi_scara import Axis, kinematics  # noqa: E402
from emulators.camera_v4l2 import can_mount  # noqa: E402

Row = dict[str, Any]
ORDER = [Axis.ELBOW, Axis.SHOULDER, Axis.ZED, Axis.WRIST1, Axis.WRIST2, Axis.YAW]
RAMP_S, LAG_S = 0.25, 0.05  # umi_rtx.md 7: to full speed; of the servo
NOMINAL = {  # umi_rtx.md 7 [counts/s]
    Axis.ZED: 412, Axis.SHOULDER: 672, Axis.ELBOW: 643, Axis.YAW: 1071,
    Axis.WRIST1: 1400, Axis.WRIST2: 1400,
}  # fmt: skip


@contextmanager
def timed(what: str, rows: list[Row], speed: float, exchanges: Callable[[], int]) -> Iterator[Row]:
    """Add a row with wall, CPU and exchanges; the block sets `ideal_s` [cell s] if there is one."""
    row: Row = {"what": what, "ideal_s": None}
    count, wall_s, cpu_s = exchanges(), time.perf_counter(), time.process_time()
    yield row
    row["wall_s"] = time.perf_counter() - wall_s
    row["cell_s"] = row["wall_s"] * speed
    row["cpu_s"] = time.process_time() - cpu_s
    row["exchanges"] = exchanges() - count
    rows.append(row)


async def arm(speed: float, move_count: int) -> list[Row]:
    rows: list[Row] = []
    rng = np.random.default_rng(1)
    async with arm_bench(speed=speed, seed=3) as bench:
        with timed("arm: connect", rows, speed, lambda: len(bench.trace)):
            await bench.arm.connect()
        await bench.arm.enable_power()
        with timed("arm: home", rows, speed, lambda: len(bench.trace)):
            await bench.arm.home()
        plans = []
        before = bench.true_counts()
        for _ in range(move_count):
            targets = random_targets(rng)
            far_s = max(abs(targets[axis] - before[axis]) / NOMINAL[axis] for axis in ORDER)
            plans.append((kinematics.counts_to_q([targets[axis] for axis in ORDER]), far_s))
            before = before | targets
        with timed(f"arm: {move_count} moves", rows, speed, lambda: len(bench.trace)) as row:
            for q, _ in plans:
                await bench.arm.move_joints(q)
            row["ideal_s"] = sum(far_s + RAMP_S + 2 * LAG_S for _, far_s in plans)
    return rows


async def gripper(speed: float, line: Line, folder: Path) -> list[Row]:
    rows: list[Row] = []
    async with gripper_bench(line, folder, speed=speed) as bench:
        trace = bench.line.trace
        await bench.gripper.connect()
        with timed(f"gripper ({line}): activate", rows, speed, lambda: len(trace) // 2) as row:
            await bench.gripper.activate()
            row["ideal_s"] = 1.5  # the emulated gripper's choreography
        what = f"gripper ({line}): close, open 10x"
        with timed(what, rows, speed, lambda: len(trace) // 2) as row:
            for _ in range(10):
                await bench.gripper.open_to(25.0, speed_mm_s=150.0)
                await bench.gripper.open_to(85.0, speed_mm_s=150.0)
            row["ideal_s"] = 20 * 60.0 / 150.0
    return rows


async def lights(speed: float, folder: Path) -> list[Row]:
    rows: list[Row] = []
    async with lights_bench("tcp", folder, speed=speed) as bench:
        await bench.lights.connect()
        trace = bench.line.trace
        with timed("lamps: 20 changes, settled", rows, speed, lambda: len(trace) // 2) as row:
            for n in range(20):
                await bench.lights.set({"ring": n % 2, "back": (n + 1) % 2}, settle=True)
            row["ideal_s"] = 20 * bench.lights.config.settle_s
    return rows


async def camera(speed: float, transport: Transport, margin_s: float | None) -> Row:
    """From a change of the light to the frame in hand, in frame periods."""
    with tempfile.TemporaryDirectory() as folder:
        async with camera_bench(
            Path(folder), transport, speed=speed, frame_margin_s=margin_s
        ) as bench:
            delay_periods, exposed_periods = [], []
            for _ in range(30):
                await bench.clock.sleep(PERIOD_S * 1.37)
                changed_s = bench.clock.now_s()
                frame = await bench.camera.frame_after(changed_s)
                delay_periods.append((bench.clock.now_s() - changed_s) / PERIOD_S)
                exposed_periods.append((frame.timestamp_s - changed_s) / PERIOD_S)
    return {
        "what": f"camera ({transport}), margin "
        f"{'of a period' if margin_s is None else f'{margin_s} s'}",
        "in_hand_periods_mean": float(np.mean(delay_periods)),
        "in_hand_periods_max": float(np.max(delay_periods)),
        "exposed_periods_mean": float(np.mean(exposed_periods)),
        "ideal_periods_mean": 0.5 + EXPOSURE_S / PERIOD_S,
    }


async def run(speed: float) -> list[Row]:
    rows = await arm(speed, 10)
    lines: list[Line] = ["tcp", "rtu", "rtu-tcp"]
    for line in lines:
        with tempfile.TemporaryDirectory() as folder:
            rows += await gripper(speed, line, Path(folder))
    with tempfile.TemporaryDirectory() as folder:
        rows += await lights(speed, Path(folder))
    transports: list[Transport] = ["socket"] if can_mount() else ["socket", "fuse"]
    for transport in transports:
        for margin_s in (None, 0.0):
            rows.append(await camera(speed, transport, margin_s))
    return rows


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="one object a row")
    parser.add_argument("--speed", type=float, default=10.0)
    args = parser.parse_args()
    rows = asyncio.run(run(args.speed))
    if args.json:
        for row in rows:
            print(json.dumps(row | {"speed": args.speed}))
        return 0
    print(f"at speed {args.speed:g}: wall s, ideal wall s, CPU s (both sides), exchanges")
    for row in rows:
        if "wall_s" in row:
            ideal = "      -" if row["ideal_s"] is None else f"{row['ideal_s'] / args.speed:7.3f}"
            print(
                f"{row['what']:38} {row['wall_s']:7.3f} {ideal} {row['cpu_s']:7.3f} "
                f"{row['exchanges']:6d}"
            )
        else:
            print(
                f"{row['what']:38} frame in hand {row['in_hand_periods_mean']:.2f} periods after "
                f"the light (most {row['in_hand_periods_max']:.2f}), "
                f"ideal {row['ideal_periods_mean']:.2f}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
