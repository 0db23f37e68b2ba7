"""README's run at several speeds beside busy loops: does it end the same, only later?

Asked: end `complete` at each speed, no device that times out. The verdict is printed beside it; it
is other benchmarks' subject.

    python benchmarks/bench_busy.py                            speeds 1, 10, 50; four loops
    python benchmarks/bench_busy.py --short --speeds 1 --loops 0
    python benchmarks/bench_busy.py --json                     one JSON object at the end
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench_readme import busy_loops

ROOT = Path(__file__).parents[1]
LIMIT_WALL_S = 5400.0  # a guard against a hang, far above what a slow machine needs
SHORT_MIN_GAIN = 0.08  # of the surface: a handful of views instead of twenty


@dataclass
class Trial:
    """One run."""

    speed_asked: float
    loops: int
    seed: int
    exit_code: int
    end: str = "-"
    code: str = ""
    message: str = ""
    verdict: str = "-"
    views: int = 0
    wall_s: float = 0.0
    speed_reached: float = 0.0
    slow_notices: int = 0


def one_run(recipe: Path, speed: float, loops: int, seed: int, folder: Path) -> Trial:
    """Run the recipe once; what it says of itself is what is reported."""
    command = [
        *(sys.executable, "-m", "controller.cli", "run", str(recipe), "--json"),
        *("--speed", f"{speed:g}", "--seed", str(seed), "--runs", str(folder / "runs")),
    ]
    started = time.monotonic()
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=LIMIT_WALL_S, check=False
    )
    trial = Trial(speed, loops, seed, done.returncode, wall_s=round(time.monotonic() - started, 1))
    trial.slow_notices = sum("machine is slow" in line for line in done.stderr.splitlines())
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    result: dict[str, Any] = next((one for one in lines if one.get("event") == "result"), {})
    if not result:
        trial.message = (done.stderr.strip().splitlines() or ["no output"])[-1]
        return trial
    trial.end, trial.code, trial.message = result["end"], result["code"], result["message"]
    trial.speed_reached = result["speed"]["reached"]
    for part in result["parts"]:
        trial.verdict, trial.views = str(part["verdict"]), part["views"]
    return trial


def short_recipe(folder: Path) -> Path:
    """Return README's recipe with few views, in a copy of the recipes."""
    shutil.copytree(ROOT / "recipes", folder / "recipes")
    recipe = folder / "recipes" / "featuretype.yaml"
    lines = recipe.read_text().splitlines()
    kept = [f"  least_gain: {SHORT_MIN_GAIN}" if "least_gain:" in x else x for x in lines]
    recipe.write_text("\n".join(kept) + "\n")
    return recipe


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--speeds", type=float, nargs="+", default=[1.0, 10.0, 50.0])
    parser.add_argument("--loops", type=int, default=4, help="busy loops beside the run")
    parser.add_argument("--times", type=int, default=1, help="runs per speed, seeds 1, 2, ...")
    parser.add_argument("--short", action="store_true", help="few views, for speed 1")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    trials: list[Trial] = []
    row = "{:>6} {:>5} {:>5}  {:10} {:14} {:>6} {:>8} {:>8}  {}"
    if not args.json:
        print(
            row.format("asked", "loops", "seed", "end", "verdict", "views", "wall s", "reached", "")
        )
    with tempfile.TemporaryDirectory(prefix="busy") as scratch, busy_loops(args.loops):
        folder = Path(scratch)
        recipe = short_recipe(folder) if args.short else ROOT / "recipes" / "featuretype.yaml"
        for speed in args.speeds:
            for seed in range(1, args.times + 1):
                trial = one_run(recipe, speed, args.loops, seed, folder)
                trials.append(trial)
                if not args.json:
                    print(
                        row.format(
                            f"{speed:g}x", trial.loops, seed, trial.end, trial.verdict,
                            trial.views, trial.wall_s, f"{trial.speed_reached:.1f}x",
                            trial.message[:80],
                        ),
                        flush=True,
                    )  # fmt: skip
    failed = sum(trial.end != "complete" for trial in trials)
    summary = {"runs": len(trials), "not_complete": failed, "cores": os.cpu_count()}
    if args.json:
        print(json.dumps(summary | {"rows": [asdict(trial) for trial in trials]}))
    else:
        print("  ".join(f"{k} {v}" for k, v in summary.items()))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
