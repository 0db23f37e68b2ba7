"""What the tests cost: seconds of the whole, CPU seconds of each file and its dearest tests.

python benchmarks/bench_suite.py [--json] [--keep] [PATH_OR_OPTION_OF_PYTEST ...]

CPU is user and system time of the process that runs a test and of the programs that it started and
waited for; a busy machine hardly changes it. What a fixture of a file costs counts for the first
test that uses it. `rest` is imports, collection, and what belongs to no test. `--keep` writes the
CPU seconds of each unit that `tests/scheduling.py` hands out; run the whole default set with it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest
from bench import ROOT, Arguments, show

NOTES = "CELLCTL_SUITE_NOTES"  # folder that each process of pytest writes its file to
SHOWN_COUNT = 30
KEPT_S = 1.0  # units of less do not matter for the order


def used_s() -> tuple[float, float]:
    """Return CPU seconds of this process, and of the programs that it waited for."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    programs = resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime, programs.ru_utime + programs.ru_stime


def _note(**row: object) -> None:
    with (Path(os.environ[NOTES]) / f"{os.getpid()}.jsonl").open("a") as file:
        file.write(json.dumps(row) + "\n")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Note what a test costs, with the fixtures that it is first to use or last to need."""
    began_s, began = time.monotonic(), used_s()
    result = yield
    own_s, programs_s = (after - before for after, before in zip(used_s(), began, strict=True))
    _note(test=item.nodeid, own_s=own_s, programs_s=programs_s, seconds=time.monotonic() - began_s)
    return result


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Note what this process took in all; of the one that hands out tests, without the others."""
    own_s, programs_s = used_s()
    if hasattr(session.config, "workerinput") or not session.config.getoption("numprocesses"):
        _note(own_s=own_s, programs_s=programs_s)


def measured(arguments: list[str]) -> dict[str, Any]:
    """Run pytest and return its exit code, seconds, and what each unit and each test cost."""
    sys.path.insert(0, str(ROOT / "tests"))
    from scheduling import unit_of

    with tempfile.TemporaryDirectory() as notes:
        paths = [str(ROOT / "benchmarks"), os.environ.get("PYTHONPATH", "")]
        env = os.environ | {NOTES: notes, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
        began_s = time.monotonic()
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-q", "-p", "bench_suite", *arguments],
            cwd=ROOT, env=env, stdout=sys.stderr, check=False,
        )  # fmt: skip
        seconds = time.monotonic() - began_s
        texts = [path.read_text() for path in Path(notes).glob("*.jsonl")]
    rows = [json.loads(line) for text in texts for line in text.splitlines()]
    tests = [row for row in rows if "test" in row]
    units: dict[str, Counter[str]] = {}
    for row in tests:
        sums = units.setdefault(unit_of(row["test"]), Counter())
        sums.update({"count": 1, **{key: row[key] for key in ("own_s", "programs_s", "seconds")}})
    cpu_s = sum(row["own_s"] + row["programs_s"] for row in rows if "test" not in row)
    in_tests_s = sum(row["own_s"] + row["programs_s"] for row in tests)
    return {
        "code": done.returncode,
        "test_count": len(tests),
        "seconds": seconds,
        "cpu_s": cpu_s,
        "rest_cpu_s": cpu_s - in_tests_s,
        "units": {unit: dict(sums) for unit, sums in sorted(units.items())},
        "dearest": sorted(tests, key=lambda row: -row["own_s"] - row["programs_s"])[:SHOWN_COUNT],
    }


def main() -> int:
    parser = Arguments(__doc__)
    parser.add_argument("--keep", action="store_true")
    args, more = parser.parse_known_args()
    if args.quick:
        more = more or ["-n", "0", "tests/unit/test_benchmarks.py"]
    suite = measured(more)
    if args.keep:
        units = suite["units"].items()
        kept = {unit: round(sums["own_s"] + sums["programs_s"], 1) for unit, sums in units}
        text = json.dumps({unit: s for unit, s in kept.items() if s >= KEPT_S}, indent=1)
        (ROOT / "tests" / "data" / "typical_seconds.json").write_text(text + "\n")
    units = sorted(suite["units"].items(), key=lambda u: -u[1]["own_s"] - u[1]["programs_s"])
    rows = [{"unit": unit, **sums} for unit, sums in units]
    figures = {key: suite[key] for key in ("test_count", "seconds", "cpu_s", "rest_cpu_s")}
    dearest = {row["test"]: row["own_s"] + row["programs_s"] for row in suite["dearest"]}
    show(args, rows if args.json else rows[:SHOWN_COUNT], dearest | figures)
    return int(suite["code"])


if __name__ == "__main__":
    sys.exit(main())
