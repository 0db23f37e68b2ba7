"""From the event of an opened door to the halt on every wire, with vision and planning busy.

    python benchmarks/bench_estop.py [--presses 100] [--busy 2] [--json]
    python benchmarks/bench_estop.py --line 300 [--seed 7] [--json]

An emulated cell at real time on its real wires. The run's own dispatcher homes arm and fixed
gripper; at a random moment the door is opened over the emulator's control port, and the interlock
stops the cell as an emergency stop does (both are inputs of one I/O block, watched alike; the door
leaves the emulated arm its power, so that a hundred presses take minutes). Meanwhile the worker
prepares plans, and --busy processes compute.

The event is its row in the journal. The halt is, on the arm's line, the answered dead stop of each
board, so that the time of the bytes on the wire at 9600 baud is in it; on a Modbus line, the first
frame sent that writes. From the door itself to the event passes the poll of the I/O block, too.

With --line, what the arm's line alone takes: on the virtual clock of `simulation/`, where computing
takes no time, so many motions of arm and wrist are stopped at random moments. Counted is from the
call to the last bit of each board's first dead stop.
"""

import argparse
import asyncio
import logging
import multiprocessing
import os
import random
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from bench import EMULATED, ROOT, Arguments, show
from kill_world import ask

from controller.cell.batch import assemble, product_of
from controller.cell.compute import Compute, Job, context
from controller.cell.devices import Devices, resolve
from controller.cell.devices.clocks import FoundClock, find_clock
from controller.cell.devices.emulator import emulated_cell, emulator_command
from controller.cell.journal import Journal, read_rows
from controller.cell.services.records import Progress
from controller.processes import make_pool
from controller.setup.layout import build_layout
from drivers.errors import DeviceError
from drivers.kinds import Signal, Stop
from drivers.umi_scara import Axis, UmiScara, WireExchange
from simulation.cell import Scene, SimulatedCell
from simulation.loop import SimulatedLoop

RECIPE, CELL = ROOT / "recipes/holder.yaml", EMULATED
DEAD_STOP = "24 ->"  # umi_rtx.md 2.3
WRITES = (5, 6, 15, 16)
FUNCTION_AT = 7  # in a Modbus TCP frame, behind its header
REST_S = 1.5
BYTE_S = 10 / 9600  # umi_rtx.md 1.2
TARGETS = {  # counts between which the axes are sent to and fro, clear of everything
    Axis.SHOULDER: (-900, 900),
    Axis.ZED: (-500, -60),
    Axis.WRIST1: (-1400, -1000),
    Axis.WRIST2: (-1400, -1000),
}


class Wires(logging.Handler):
    """Notes what goes over the wires, and when."""

    def __init__(self) -> None:
        super().__init__(logging.DEBUG)
        self.seen: list[tuple[float, str, str]] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.seen.append((time.monotonic(), record.name, record.getMessage()))

    def halts_ms(self, after_s: float, gripper: str, lights: str) -> dict[str, float | None]:
        """Return for each wire how long after an instant its halt was out [ms]."""
        later = [(t, name, text) for t, name, text in self.seen if t >= after_s]
        arm = [t for t, name, text in later if name.endswith("arm") and text.startswith(DEAD_STOP)]
        found: dict[str, float | None] = {
            "arm, first board": arm[0] if arm else None,
            "arm, second board": arm[1] if len(arm) > 1 else None,
        }
        for wire, address in (("fixed gripper", gripper), ("lamps", lights)):
            sent = [t for t, _, text in later if f"{address} > " in text and _writes(text)]
            found[wire] = sent[0] if sent else None
        return {k: None if t is None else 1e3 * (t - after_s) for k, t in found.items()}


def _writes(text: str) -> bool:
    frame = bytes.fromhex(text.split(" > ")[1])
    return len(frame) > FUNCTION_AT and frame[FUNCTION_AT] in WRITES


def burn() -> None:
    """Compute until ended, at the priority that programs usually have."""
    os.setpriority(os.PRIO_PROCESS, 0, 0)
    a = np.random.default_rng(1).normal(size=(300, 300))
    while True:
        a = np.tanh(a @ a.T / 300.0)


async def press_doors(
    args: argparse.Namespace, ready: dict[str, Any], control: Path, folder: Path
) -> list[dict[str, float | None]]:
    """Home, open the door, let the cell stop, close the door: as often as asked for."""
    rng = random.Random(args.seed)
    job = Job(RECIPE, CELL)
    about = context(job)
    cell = about.cell
    clock = find_clock(cell, ready).open()
    where = resolve(cell, ready["devices"])
    devices = Devices.build(cell, where, clock)
    addresses = [str(where[name]["address"]) for name in ("gripper", "lights")]
    wires, path = Wires(), folder / "journal.sqlite"
    for name in ("cellctl.wire.arm", "cellctl.wire.modbus"):
        log = logging.getLogger(name)
        log.setLevel(logging.DEBUG)
        log.propagate = False
        log.addHandler(wires)
    found = []
    with make_pool("controller.cell.compute") as pool:
        async with clock.attending():
            try:
                await devices.connect()
                for number in range(args.presses):
                    run = f"press-{number:04d}"
                    journal = Journal(path, run)
                    batch = assemble(
                        (product_of(Compute(job, pool), about.recipe, cell),), cell,
                        build_layout(cell), devices,
                        clock, journal, folder, Progress(), lambda: None,
                    )  # fmt: skip
                    await devices.io.wait_for("guard_closed", Signal.OK)
                    wires.seen.clear()
                    running = asyncio.create_task(batch.dispatcher.run())
                    await clock.sleep(rng.uniform(0.3, 4.0))
                    await asyncio.to_thread(ask, control, "door", closed=False)
                    outcome = await running
                    await asyncio.to_thread(ask, control, "door", closed=True)
                    journal.close()
                    faults = [r for r in read_rows(path, run) if r.name == "fault"]
                    assert outcome.code == "guard_closed", outcome
                    found.append(wires.halts_ms(faults[0].t_mono_s, *addresses))
                    await clock.sleep(REST_S)
            finally:
                await devices.aclose()
    clock.close()
    return found


def stop_motions(count: int, seed: int, folder: Path) -> list[dict[str, float | None]]:
    """Stop motions of the simulated arm at random moments; return what each stop took [ms]."""
    loop, rng = SimulatedLoop(seed), random.Random(seed)
    cell = SimulatedCell(loop, seed, Scene(), folder)
    found: list[dict[str, float | None]] = []

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


def on_real_wires(args: argparse.Namespace, folder: Path) -> list[dict[str, float | None]]:
    """Open doors while other processes compute; return what each wire took [ms]."""
    burners = [multiprocessing.Process(target=burn, daemon=True) for _ in range(args.busy)]
    for burner in burners:
        burner.start()
    try:
        control = folder / "control.sock"
        command = emulator_command(
            CELL, [ROOT / "recipes/parts/holder.stl"], speed=1.0, seed=args.seed,
            more=("--empty", "--control", str(control), "--camera-transport", "socket"),
        )  # fmt: skip
        with emulated_cell(command, folder / "emulator.log") as ready:
            return asyncio.run(press_doors(args, ready, control, folder))
    finally:
        for burner in burners:
            burner.kill()


def main() -> int:
    parser = Arguments(__doc__, line=20)
    parser.add_argument("--presses", type=int, default=100)
    parser.add_argument("--busy", type=int, default=2, help="processes that compute meanwhile")
    parser.add_argument("--line", type=int, default=0, metavar="N", help="the arm's line alone")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        if args.line:
            logging.disable(logging.CRITICAL)
            found = stop_motions(args.line, args.seed, folder)
        else:
            found = on_real_wires(args, folder)
    table = []
    for wire in found[0]:
        ms = np.array([one[wire] for one in found if one[wire] is not None], dtype=float)
        quantiles = {
            f"p{q} ms": float(np.quantile(ms, q / 100)) if len(ms) else None for q in (50, 99, 100)
        }
        table.append({"wire": wire, "presses": len(found), "halted": len(ms), **quantiles})
    show(args, table, {"stops": len(found), "busy processes": 0 if args.line else args.busy})
    return int(any(row["halted"] != row["presses"] for row in table))


if __name__ == "__main__":
    sys.exit(main())
