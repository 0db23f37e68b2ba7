"""What `cellctl` costs before it does anything: CPU seconds of `--help` and `--version`.

python benchmarks/bench_start.py [--json] [--repeat N]

Also of the help of each command. Each is a process of its own, user and system time together; the
least of N runs counts, since a busy machine only adds. `heavy` names libraries that were imported
though nothing was computed.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from bench import Arguments, show

CALLS: tuple[tuple[str, ...], ...] = (
    ("--help",),
    ("--version",),
    *(
        (*command.split(), "--help")
        for command in (
            "run", "check", "compile", "recognise", "calibrate camera", "plan", "recover",
            "emulate", "report", "doctor", "init",
        )
    ),
)  # fmt: skip
HEAVY = ("numpy", "scipy", "cv2", "trimesh", "pybullet", "shapely", "pydantic", "pymodbus")
PROBE = """
import json, os, sys
from controller.cli import main
null = os.open(os.devnull, os.O_WRONLY)
out = os.dup(1)
os.dup2(null, 1); os.dup2(null, 2)
code = main(sys.argv[1:])
heavy = [name for name in {heavy!r} if name in sys.modules]
os.write(out, json.dumps([code, heavy]).encode())
"""


def cpu_s(*arguments: str) -> float:
    """Return user and system seconds of one `cellctl` process."""
    cellctl = Path(sys.executable).with_name("cellctl")
    process = subprocess.Popen(
        [str(cellctl), *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    _, _, used = os.wait4(process.pid, 0)
    process.returncode = 0
    return used.ru_utime + used.ru_stime


def heavy_imports(*arguments: str) -> tuple[int, list[str]]:
    """Return the exit code of a command line, and which libraries it imported."""
    script = PROBE.format(heavy=HEAVY)
    done = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True
    )
    code, heavy = json.loads(done.stdout)
    return int(code), list(heavy)


def main() -> int:
    parser = Arguments(__doc__, repeat=1)
    parser.add_argument("--repeat", type=int, default=3)
    args = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for call in CALLS:
        code, heavy = heavy_imports(*call)
        least_s = min(cpu_s(*call) for _ in range(args.repeat))
        rows.append({"call": " ".join(call), "code": code, "cpu_s": least_s, "heavy": heavy})
    show(args, rows, {"most CPU s": max(row["cpu_s"] for row in rows)})
    return int(any(row["code"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
