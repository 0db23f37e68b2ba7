"""SIGKILL a controller that holds a part, start again, and ask the world what was let go.

    python benchmarks/bench_kill.py [--stages presenting handing ...] [--speed 10] [--json]

The emulated cell is a process of its own and lives on. The first controller is killed in a stage,
in the middle of a motion; once the world is still, a second one is started on the same folder of
runs. What moved and what was let go is the world's own word (its control port). Then the part is
taken out by hand, and a third start with `--part-removed` must get to work.
"""

import argparse
import json
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

from kill_world import kill_world, let_go_count, lines_of, start

RECIPE, PART, SEED = "recipes/holder.yaml", "recipes/parts/holder.stl", 8
# states of the cell, and one of custody: while the fixed gripper alone has the part
STAGES = ("presenting", "handing", "in_fixture", "placing")


def kill_in(stage: str, speed: float, folder: Path) -> dict[str, Any]:
    """Kill a controller in a stage, start again, and return what happened."""
    runs = folder / "runs"
    with kill_world(folder, PART, seed=SEED, speed=speed) as world:
        first = start(world, RECIPE, runs)
        with first:
            for line in lines_of(first):
                if stage in (line.get("state"), line.get("custody")):
                    world.until_moving()
                    os.kill(first.pid, signal.SIGKILL)
                    break
        killed = world.when_still()
        second = start(world, RECIPE, runs)
        with second:
            *_, result = lines_of(second)
        after = world.when_still()
        # the operator takes the part out by hand and says so
        for gripper in ("arm", "fixture"):
            world.ask("lose_part", gripper=gripper)
        world.ask("remove")
        third = start(world, RECIPE, runs, "--part-removed")
        reached = ""
        with third:
            for line in lines_of(third):
                reached = line.get("state", line.get("message"))
                if reached == "acquiring":
                    break
            os.kill(third.pid, signal.SIGKILL)
    part = killed["parts"][0]
    outcome = {
        "stage": stage,
        "held_by": part["custody"],
        "height_mm": round(part["T_world_part"][2][3], 1),
        "exit_code": second.returncode,
        "end": result.get("end"),
        "let_go_by_the_start": let_go_count(after) - let_go_count(killed),
        "moved_by_the_start": [
            name
            for name, at_s in after["last_motion_s"].items()
            if at_s != killed["last_motion_s"][name]
        ],
        "part_stayed": after["parts"][0]["T_world_part"] == part["T_world_part"],
        "with_part_removed": reached,
        "message": result.get("message"),
    }
    outcome["ok"] = (
        (outcome["exit_code"], outcome["end"]) == (1, "refused")
        and outcome["let_go_by_the_start"] == 0
        and not outcome["moved_by_the_start"]
        and outcome["part_stayed"]
        and outcome["with_part_removed"] == "acquiring"
    )
    return outcome


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stages", nargs="+", default=STAGES)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    outcomes = []
    for stage in args.stages:
        with tempfile.TemporaryDirectory() as folder:
            outcomes.append(kill_in(stage, args.speed, Path(folder)))
        if not args.json:
            one = outcomes[-1]
            print(f"killed in {stage}: {'ok' if one['ok'] else 'NOT OK'}")
            for name, value in one.items():
                print(f"  {name:20} {value}", flush=True)
    if args.json:
        print(json.dumps({"bench": "kill", "kills": outcomes}))
    return 0 if all(one["ok"] for one in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
