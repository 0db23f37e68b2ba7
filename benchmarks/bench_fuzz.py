"""Coverage-guided fuzzing of everything that is read from a wire or a file; atheris does it.

``python benchmarks/bench_fuzz.py [TARGET...] [--seconds S] [--runs N] [--keep] [--json]``: each
target of `tests/fuzz/fuzz_targets.py` in a process of its own, from the corpus kept beside it and
from whole files of the project, until a million executions or the time is over. A finding is an
exception, an input that takes more than 10 s, or more than 1 GB of memory; its input is written
to the folder named, to become a file of the corpus and a test. ``--keep`` adds to the corpus what
reached new code, small and few.
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench import ROOT, Arguments, need_module, note, show

FUZZ = ROOT / "tests" / "fuzz"
CORPUS = FUZZ / "corpus"
KEPT_COUNT = 24  # files of one target in the corpus, the shortest of those that reach new code
KEPT_BYTES = 1500
INPUT_BYTES_MAX = 4096
MEMORY_MB = 1000
HANG_S = 10
OURS = ["controller", "drivers", "emulators", "pymodbus", "h11"]
PARTS = ROOT / "recipes" / "parts"
SEEDS = {  # whole files that a target begins with
    "recipe": [*(ROOT / "recipes").glob("*.yaml")],
    "csg": [PARTS / "widget.csg.yaml"],
}
CHILD = """
import sys
sys.path[:0] = [{root!r}, {fuzz!r}]
import atheris
with atheris.instrument_imports(include={ours!r}):
    import fuzz_targets
    target = fuzz_targets.load({name!r})
atheris.Setup(sys.argv, target)
atheris.Fuzz()
"""


def fuzz(name: str, seconds: int, runs: int, keep: bool, found: Path) -> dict[str, Any]:
    """Fuzz one target and return what it did."""
    kept = CORPUS / name
    with tempfile.TemporaryDirectory(prefix=f"fuzz-{name}-") as scratch:
        corpus = Path(scratch) / "corpus"
        corpus.mkdir()
        if kept.is_dir():
            shutil.copytree(kept, corpus, dirs_exist_ok=True)
        for seed in SEEDS.get(name, []):
            shutil.copy(seed, corpus / seed.name)
        process = subprocess.run(
            [
                *(sys.executable, "-c"),
                CHILD.format(root=str(ROOT), fuzz=str(FUZZ), ours=OURS, name=name),
                str(corpus),
                f"-max_total_time={seconds}",
                f"-runs={runs}",
                f"-max_len={max(INPUT_BYTES_MAX, _longest(corpus))}",
                f"-rss_limit_mb={MEMORY_MB}",
                f"-timeout={HANG_S}",
                f"-artifact_prefix={found}/{name}-",
                "-print_final_stats=1",
            ],
            cwd=scratch,
            env=os.environ | {"XDG_CACHE_HOME": scratch, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        if keep and process.returncode == 0:
            _keep(corpus, kept)
    log = process.stderr + process.stdout
    row = {
        "target": name,
        "runs": _number(r"number_of_executed_units:\s*(\d+)", log),
        "seconds": _number(r"Done \d+ runs in (\d+) second", log),
        "edges": _number(r".*cov: (\d+)", log),
        "memory_mb": _number(r"peak_rss_mb:\s*(\d+)", log),
        "finding": "",
    }
    if process.returncode != 0:
        (found / f"{name}.log").write_text(log)
        row["finding"] = _reason(log)
    return row


def _longest(corpus: Path) -> int:
    return max((one.stat().st_size for one in corpus.iterdir()), default=0)


def _number(pattern: str, log: str) -> int:
    found = re.findall(pattern, log)
    return int(found[-1]) if found else 0


def _reason(log: str) -> str:
    for pattern in (r"Uncaught Python exception:.*\n(.*)", r"ERROR: libFuzzer: (.*)", r"(.*)\n*$"):
        if match := re.search(pattern, log):
            return match.group(1)[:120]
    return "unknown"


def _keep(corpus: Path, kept: Path) -> None:
    """Keep the shortest inputs that reached new code, beside those that are kept already."""
    kept.mkdir(parents=True, exist_ok=True)
    before = {one.read_bytes() for one in kept.iterdir()}
    fresh = sorted((one for one in corpus.iterdir()), key=lambda one: one.stat().st_size)
    for one in fresh:
        if len(before) >= KEPT_COUNT:
            return
        if 0 < one.stat().st_size <= KEPT_BYTES and one.read_bytes() not in before:
            before.add(one.read_bytes())
            shutil.copy(one, kept / f"{one.name[:16]}")


def main() -> int:
    need_module("atheris")
    sys.path.insert(0, str(FUZZ))
    from fuzz_targets import TARGETS

    parser = Arguments(__doc__, targets=["arm_reply", "picture"], seconds=10)
    parser.add_argument("targets", nargs="*", help=f"default: all of {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=int, default=600, help="of each target")
    parser.add_argument("--runs", type=int, default=1_000_000, help="of each target")
    parser.add_argument("--keep", action="store_true", help="add to the corpus")
    found = Path(tempfile.gettempdir(), "fuzz-found")
    parser.add_argument("--found", type=Path, default=found, help="for findings")
    args = parser.parse_args()
    args.found.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in args.targets or TARGETS:
        row = fuzz(name, args.seconds, args.runs, args.keep, args.found.resolve())
        rows.append({"target": name, **row})
        note(rows[-1])
    with contextlib.suppress(OSError):
        args.found.rmdir()
    findings = sum(bool(row["finding"]) for row in rows)
    show(args, rows, {"executions": sum(row["runs"] for row in rows), "findings": findings})
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
