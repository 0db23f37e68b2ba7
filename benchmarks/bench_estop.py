"""How long the arm's line takes to stop both boards, whatever goes over it just then.

    python benchmarks/bench_estop.py [--stops 300] [--seed 7] [--json]

On the virtual clock of `simulation/`, where computing takes no time, so many motions of arm and
wrist are stopped at random moments. Counted is from the call to the last bit of each board's first
dead stop, at 9600 baud. What a late controller adds to it, on real wires: `bench_blind.py`.
"""

import asyncio
import logging
import random
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
from bench import Arguments, show

from controller.cell.devices.clocks import FoundClock
from drivers.errors import DeviceError
from drivers.kinds import Stop
from drivers.umi_scara import Axis, UmiScara, WireExchange
from simulation.cell import Scene, SimulatedCell
from simulation.loop import SimulatedLoop

BYTE_S = 10 / 9600  # umi_rtx.md 1.2
TARGETS = {  # counts between which the axes are sent to and fro, clear of everything
    Axis.SHOULDER: (-900, 900),
    Axis.ZED: (-500, -60),
    Axis.WRIST1: (-1400, -1000),
    Axis.WRIST2: (-1400, -1000),
}


def stop_motions(count: int, seed: int, folder: Path) -> list[dict[str, float]]:
    """Stop motions of the simulated arm at random moments; return what each stop took [ms]."""
    loop, rng = SimulatedLoop(seed), random.Random(seed)
    cell = SimulatedCell(loop, seed, Scene(), folder)
    found: list[dict[str, float]] = []

    async def story() -> None:
        async with cell:
            clock, seen = FoundClock(monotonic=loop.time).open(), list[WireExchange]()
            arm = UmiScara(cell.arm_line.open, clock=clock, trace=seen.append)
            await arm.connect()
            await arm.enable_power()
            await arm.home()
            for _ in range(count):
                targets = {axis: rng.randrange(*ends) for axis, ends in TARGETS.items()}
                moving = asyncio.ensure_future(arm.move_counts(targets))
                await asyncio.sleep(rng.uniform(0.05, 1.0))
                seen.clear()
                begun_s = clock.now_s()
                await arm.stop(Stop.DEAD)
                with suppress(DeviceError):
                    await moving
                sent = [one.request for one in seen]
                first = sent.index(b"\x24")
                second = sent.index(b"\x24", sent.index(b"\x29", first))
                found.append(
                    {
                        "arm, first board": 1e3 * (seen[first].at_s + BYTE_S - begun_s),
                        "arm, second board": 1e3 * (seen[second].at_s + BYTE_S - begun_s),
                    }
                )

    try:
        loop.run_until_complete(story())
    finally:
        cell.close()
        loop.bury()
        loop.close()
    return found


def main() -> int:
    parser = Arguments(__doc__, stops=20)
    parser.add_argument("--stops", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    logging.disable(logging.CRITICAL)
    with tempfile.TemporaryDirectory() as folder:
        found = stop_motions(args.stops, args.seed, Path(folder))
    rows = []
    for board in found[0]:
        p50, p99, most = np.quantile([one[board] for one in found], [0.5, 0.99, 1.0]).tolist()
        rows.append({"board": board, "stops": len(found), "p50 ms": p50, "p99": p99, "max": most})
    show(args, rows, {"longest ms": max(row["max"] for row in rows)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
