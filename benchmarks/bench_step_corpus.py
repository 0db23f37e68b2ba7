"""Public STEP files: every sound solid compiles, the rest is refused for a true reason.

python benchmarks/bench_step_corpus.py FOLDER [--json] [--only NAME...]

The list is step_corpus.json: where each file is from (repository, commit, path), its SHA-256, the
licence of its repository, how many of its distinct bodies compile, and why others do not. Nothing
is downloaded: FOLDER holds the files under the last part of their paths, and each has to have its
hash. Each file is given to `cellctl compile --all` without the cache; told are bodies compiled and
refused, the processor's seconds, the kernel's process included, and what differs from the list.
"""

from __future__ import annotations

import hashlib
import json
import os
import resource
import subprocess
import sys
from pathlib import Path, PurePosixPath
from typing import Any

from bench import ROOT, Arguments, leave_out, note, show

CORPUS = Path(__file__).with_name("step_corpus.json")


def _children_cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run_file(listed: dict[str, Any], folder: Path, limit_s: float) -> dict[str, Any]:
    """What comes of one file, and whether it is what the list states."""
    name = PurePosixPath(listed["path"]).name
    row: dict[str, Any] = {"file": name, "repository": listed["repository"]}
    file = folder / name
    if not file.is_file():
        return row | {"state": "not there"}
    if hashlib.sha256(file.read_bytes()).hexdigest() != listed["sha256"]:
        return row | {"state": "another file"}
    command = [sys.executable, "-m", "controller.cli", "compile", "--all", "--json", "--no-cache"]
    begin_s = _children_cpu_s()
    try:
        done = subprocess.run(
            [*command, name],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return row | {"state": "hangs", "cpu_s": round(_children_cpu_s() - begin_s, 1)}
    bodies = [json.loads(line) for line in done.stdout.splitlines()]
    reasons = [body["refused"] for body in bodies if "refused" in body]
    if not bodies or done.returncode not in (0, 2):
        reasons += [line for line in done.stderr.splitlines() if line.startswith("cellctl: ")]
    compiled = [body for body in bodies if "refused" not in body]
    expected = listed.get("refused", [])
    is_right = len(compiled) == listed["compiles"] and len(reasons) == len(expected)
    is_right &= all(any(words in reason for reason in reasons) for words in expected)
    return row | {
        "state": "as listed" if is_right else "differs",
        "compiled": len(compiled),
        "refused": reasons,
        "triangles": sum(body["triangles"] for body in compiled),
        "cpu_s": round(_children_cpu_s() - begin_s, 1),
    }


def main() -> int:
    parser = Arguments(__doc__)
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--only", nargs="*", help="names of files")
    parser.add_argument("--limit-s", type=float, default=900.0, help="of one file")
    args = parser.parse_args()
    if args.folder is None:
        leave_out("needs a folder with the public STEP files that step_corpus.json lists")
    rows = []
    for listed in json.loads(CORPUS.read_text()):
        if args.only and PurePosixPath(listed["path"]).name not in args.only:
            continue
        rows.append(run_file(listed, args.folder, args.limit_s))
        note(rows[-1])
    right = sum(row["state"] == "as listed" for row in rows)
    show(args, rows, {"files": len(rows), "as listed": right})
    return 0 if right == len(rows) else 1


if __name__ == "__main__":
    sys.exit(main())
