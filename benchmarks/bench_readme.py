"""README's commands, word by word, on fresh clones beside busy loops.

Each trial clones the checkout's last commit into an empty folder, gives it a home without caches,
and runs one of README's commands there as a shell would, while the busy loops compete for the
processor. What counts is the exit code; how long it took is told beside it.

    python benchmarks/bench_readme.py                       both commands, five times, four loops
    python benchmarks/bench_readme.py --only run --times 2 --loops 0
    python benchmarks/bench_readme.py --json                one JSON object at the end
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
MARK = "<!-- test command -->"
LIMIT_S = 5400.0  # a guard against a hang, far above what a slow machine needs


@dataclass
class Trial:
    """One command on one fresh clone."""

    command: str
    number: int
    exit_code: int
    wall_s: float
    last_lines: list[str]


def readme_commands() -> dict[str, str]:
    """Return README's two commands: `run` (the main job) and `test`."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    first = re.search(r"```sh\n(.+?)\n```", text, re.DOTALL)
    second = re.search(re.escape(MARK) + r"\s+```sh\n(.+?)\n```", text, re.DOTALL)
    if first is None or second is None:
        raise SystemExit("README.md: the two commands are not where they are expected")
    return {"run": first[1], "test": second[1]}


@contextmanager
def busy_loops(count: int) -> Iterator[None]:
    """Keep ``count`` processes computing; they are ended by their own id."""
    loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def one_trial(name: str, command: str, number: int, folder: Path) -> Trial:
    """Run one command in a fresh clone; its output stays in ``folder``."""
    clone = folder / "cellctl"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    home = folder / "home"
    home.mkdir()
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    environment["XDG_CACHE_HOME"] = str(home / ".cache")
    log = folder / "output.txt"
    started = time.monotonic()
    with log.open("wb") as output:
        try:
            code = subprocess.run(
                ["sh", "-c", command], cwd=clone, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, env=environment, timeout=LIMIT_S, check=False,
            ).returncode  # fmt: skip
        except subprocess.TimeoutExpired:
            code = -1
    lines = [x for x in log.read_text(errors="replace").splitlines() if x.strip()]
    return Trial(name, number, code, round(time.monotonic() - started, 1), lines[-4:])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=("run", "test"), default=None)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--loops", type=int, default=4)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    commands = readme_commands()
    trials: list[Trial] = []
    with busy_loops(args.loops):
        for name in ("run", "test") if args.only is None else (args.only,):
            for number in range(1, args.times + 1):
                with tempfile.TemporaryDirectory(prefix="readme") as scratch:
                    trial = one_trial(name, commands[name], number, Path(scratch))
                trials.append(trial)
                if not args.json:
                    print(
                        f"{name:5} {number}  exit {trial.exit_code:>3}  {trial.wall_s:7.1f} s",
                        flush=True,
                    )
                    for line in trial.last_lines:
                        print(f"      {line[:150]}", flush=True)
    failed = sum(t.exit_code != 0 for t in trials)
    summary = {
        "trials": len(trials),
        "failed": failed,
        "loops": args.loops,
        "cores": os.cpu_count(),
    }
    if args.json:
        print(json.dumps(summary | {"rows": [asdict(t) for t in trials]}))
    else:
        print("  ".join(f"{k} {v}" for k, v in summary.items()))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
