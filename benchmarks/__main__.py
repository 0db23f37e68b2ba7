"""All benchmarks, one after the other: what each said, how long it took, which were left out.

python -m benchmarks [--quick] [--only NAME...] [--json]

`--quick` takes the reduced, seeded form of each: all of them within 20 minutes on two cores.
Without it they take days. Exit code 1: one of them did not hold what it asks for, or failed.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from bench import LEFT_OUT, ROOT, Arguments, show  # noqa: E402  (path set above)

QUICK_LIMIT_S = 600.0  # of one benchmark's reduced form, before it is given up
ENDS = {0: "held", 1: "not held", LEFT_OUT: "left out"}
NAMES = sorted(
    [f.stem for f in HERE.glob("bench_*.py")] + ["paper_widget", "plan_digests", "trace_held_check"]
)


def run(name: str, *, quick: bool) -> dict[str, Any]:
    """Run one benchmark, and return how it ended and the last line it printed."""
    command = [sys.executable, str(HERE / f"{name}.py"), *(["--quick"] if quick else [])]
    began = time.monotonic()
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
            timeout=QUICK_LIMIT_S if quick else None,
        )
        ended = ENDS.get(done.returncode, f"exit {done.returncode}")
        said = done.stdout if done.returncode in (0, 1) and done.stdout.strip() else done.stderr
    except subprocess.TimeoutExpired:
        ended, said = "too long", f"not done after {QUICK_LIMIT_S:.0f} s"
    last = (said.strip().splitlines() or [""])[-1].strip()
    return {
        "benchmark": name,
        "ended": ended,
        "s": round(time.monotonic() - began, 1),
        "said": last,
    }


def main() -> int:
    parser = Arguments(__doc__)
    parser.add_argument("--only", nargs="+", choices=NAMES, default=NAMES, metavar="NAME")
    args = parser.parse_args()
    rows = []
    for name in args.only:
        rows.append(run(name, quick=args.quick))
        row = rows[-1]
        print(f"{row['benchmark']}: {row['ended']}, {row['s']} s", file=sys.stderr, flush=True)
    ends = [row["ended"] for row in rows]
    figures = {end: ends.count(end) for end in dict.fromkeys(ends)}
    show(args, rows, {**figures, "seconds": round(sum(row["s"] for row in rows), 1)})
    return 0 if all(end in ("held", "left out") for end in ends) else 1


if __name__ == "__main__":
    sys.exit(main())
