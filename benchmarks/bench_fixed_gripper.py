"""Does the step `grippers` find the plane between the fixed jaws, the arm being calibrated?

For each seed the cell is drawn as built and simulated on virtual time; all but the fixed gripper is
calibrated from the truth (`oracle_calibration.py`), so that what is judged is the step alone. No
picture is taken: the shake is left out. Errors are those of the plane at the fixed gripper's TCP,
against the arm as calibrated, over places about the hand-off, as in `bench_commissioning.py`.

    python benchmarks/bench_fixed_gripper.py --seeds 200-209
"""

import argparse
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from bench_commissioning import TrueCell, hand_off_rows, planes
from oracle_calibration import write_cell

from controller.cell.commissioning import CommissionOrder, Errand, Session
from controller.cell.commissioning.person import HELPER
from controller.cell.commissioning.steps import grippers
from controller.cell.devices.clocks import FoundClock
from controller.cell.operator import Answer, Question
from controller.commissioning.procedure import Folder, Outcome, StepRecord
from controller.config import EMULATED_CELL, load_cell
from controller.config.calibrations import FixedGripperCalibration, read_calibration
from controller.planning.motion import tcp_pose
from controller.setup.layout import build_layout
from simulation.cell import BEAT_S, Scene, SimulatedCell
from simulation.loop import SimulatedLoop, SimulatedProcess


class Hands:
    """Answers for a person, and does errands in the simulated cell."""

    def __init__(self, cell: SimulatedCell) -> None:
        self._cell = cell

    async def decide(self, question: Question) -> Answer:
        return Answer(question.choices[0].key, HELPER)

    async def do(self, errand: Errand) -> None:
        for order in errand.orders:
            given = dict(order)
            self._cell.befall(given.pop("do"), **given)


async def no_shake(*_: object) -> None:
    return None


def commission(seed: int, folder: Path) -> tuple[StepRecord, int]:
    """Run the step; return its record and how many collisions there were."""
    os.environ["XDG_STATE_HOME"] = str(folder / "state")  # no other run's journals count
    loop = SimulatedLoop(seed)
    cell = SimulatedCell(loop, seed, Scene("holder"), folder / "cell", as_built=seed)

    async def step() -> StepRecord:
        async with cell:
            hands: Any = Hands(cell)
            write_cell(cell.cell_path, seed, folder / "out", ("fixed_gripper", "trays"))
            session = Session(
                CommissionOrder(cell.cell_path, Folder(folder / "out"), "a benchmark"),
                {},
                FoundClock(monotonic=loop.time, beat_wall_s=BEAT_S),
                hands,
                hands,
                lambda line: None,
                cell.controller()._devices,
            )
            records = session.run(("grippers",), lambda record: None)
            (record,) = await loop.spawn(SimulatedProcess("session"), records)
            return record

    try:
        record = loop.run_until_complete(step())
        return record, len(cell.cell.world.collisions)
    finally:
        cell.close()
        loop.bury()
        loop.close()


def judge(seed: int, out: Path) -> dict[str, Any]:
    """Return the errors of the plane before and after, what was stated, and of the openings."""
    true = TrueCell(EMULATED_CELL, seed)
    truth = true.built.truth()["fixed_gripper"]
    found = read_calibration(out / "calibrations" / "fixed_gripper.json", "fixed_gripper")
    assert isinstance(found, FixedGripperCalibration)
    layout = build_layout(load_cell(out / "cell.yaml"))
    drawn = build_layout(load_cell(EMULATED_CELL)).T_world_fixed_tcp
    rows = hand_off_rows(layout, np.random.default_rng([seed, 7]))
    T_true = np.linalg.inv(np.array(truth["T_world_tcp"])) @ true.tcp(rows)
    T_arm = tcp_pose(layout, rows)
    row: dict[str, Any] = {"u_mm": found.u_mm, "u_deg": found.u_deg}
    for name, T_fixed in (("before", drawn), ("after", layout.T_world_fixed_tcp)):
        off = planes(T_true, np.linalg.inv(T_fixed) @ T_arm)
        row[f"{name} mm"] = float(np.percentile(off["mm"], 95))
        row[f"{name} deg"] = float(np.percentile(off["deg"], 95))
    row["inside"] = [row["after mm"] <= 2 * found.u_mm, row["after deg"] <= 2 * found.u_deg]
    for true_mm in (10.0, 40.0, 80.0):
        reads = (true_mm - truth["opening_zero_mm"]) / truth["opening_scale"]
        off_mm = found.opening_zero_mm + found.opening_scale * reads - true_mm
        row[f"opening at {true_mm:g} mm"] = off_mm
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", required=True, help="A or A-B")
    args = parser.parse_args()
    grippers.shake = no_shake  # type: ignore[assignment]  # it needs pictures of a board
    first, _, last = args.seeds.partition("-")
    rows = []
    for seed in range(int(first), int(last or first) + 1):
        with tempfile.TemporaryDirectory() as scratch:
            record, collision_count = commission(seed, Path(scratch))
            row: dict[str, Any] = {"seed": seed, "collisions": collision_count}
            if record.outcome is Outcome.PASSED:
                row |= judge(seed, Path(scratch) / "out")
            else:
                row["message"] = record.message
        rows.append(row)
        print(json.dumps(row), flush=True)
    passed = [row for row in rows if "inside" in row]
    print(f"{len(passed)} of {len(rows)} passed")
    if not passed:
        return
    for key in ("before mm", "after mm", "before deg", "after deg"):
        print(f"{key}: p95 {np.percentile([row[key] for row in passed], 95):.3f}")
    inside = np.mean([one for row in passed for one in row["inside"]])
    print(f"inside 2u: {100 * inside:.0f} %; collisions: {sum(row['collisions'] for row in rows)}")


if __name__ == "__main__":
    main()
