"""Are faults of commissioning found in an emulated cell, and each by its right name?

For each seed a cell as built goes through the steps `devices` and `light` once; then each fault
befalls a copy of it, at the moment that the table below has, while the step runs that should find
it. A fault is found if the step fails, and named if the message has the words; a step that goes on
rightly (swapped lamps) has to state the words among its findings. `none` is the step without a
fault: it has to pass.

    python benchmarks/bench_commissioning_faults.py --seeds 1301-1303 --json
    python benchmarks/bench_commissioning_faults.py --seeds 7 --faults knocked,pads
"""

import argparse
import contextlib
import json
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from controller.config import EMULATED_CELL, SHIPPED

BOARDS: Final = SHIPPED / "boards"
HANDS_WALL_S: Final = 60.0  # for the emulator to open its control port


@dataclass(frozen=True)
class Case:
    """One fault.

    Attributes
    ----------
    step : that has to find it
    when : text of the note of the step at which it happens; empty: before all
    orders : to the control port
    words : one of these has to be in the message or the findings
    stops : the step has to fail
    """

    step: str
    when: str
    orders: tuple[Mapping[str, Any], ...]
    words: tuple[str, ...]
    stops: bool = True


def _misprint(name: str, scale: float) -> dict[str, Any]:
    return {"do": "misprint", "file": str(BOARDS / f"{name}.json"), "scale": scale}


CASES: Final[Mapping[str, Case]] = {
    "none": Case("arm", "", (), (), stops=False),
    "paddle scaled 1 %": Case(
        "arm", "", (_misprint("paddle", 1.01),), ("% too large for its file",)
    ),
    "flat board scaled 1 %": Case(
        "arm", "", (_misprint("charuco", 0.99),), ("% too small for its file",)
    ),
    "station camera knocked": Case(
        "arm",
        "picture 20 of",
        ({"do": "knock", "camera": "inspection", "mm": [1.5, 0.5, 0], "turn_deg": [0, 0.3, 0]},),
        ("the camera inspection was moved",),
    ),
    "overhead camera knocked": Case(
        "arm",
        "picture 24 of",
        ({"do": "knock", "camera": "overhead", "mm": [0, 2.0, 0], "turn_deg": [0.2, 0, 0.2]},),
        ("the camera overhead was moved",),
    ),
    "overhead camera knocked before the plate": Case(
        "arm",
        "working out where to show",
        ({"do": "knock", "camera": "overhead", "mm": [0, 0, 2.5]},),
        ("the camera overhead was moved",),
    ),
    "lamps swapped": Case(
        "light",
        "",
        ({"do": "swap_lamps", "one": "station_ring", "other": "station_side"},),
        ("swapped channels",),
        stops=False,
    ),
    "pads missing": Case("arm", "", ({"do": "pads", "thinner_mm": 1.5},), ("pads are missing",)),
    "another board on the arm's line": Case(
        "devices", "", ({"do": "arm_line", "monitor_rom": True},), ("unsupported ROM",)
    ),
    "play of 1 deg": Case(
        "arm",
        "",
        ({"do": "gear_play", "axis": "shoulder", "deg": 1.0},),
        ("gears of shoulder have",),
    ),
}


def order(port: Path, orders: Sequence[Mapping[str, Any]]) -> None:
    """Give verbs to an emulated cell."""
    with contextlib.closing(socket.socket(socket.AF_UNIX)) as line:
        line.connect(str(port))
        stream = line.makefile("rwb")
        for one in orders:
            stream.write(json.dumps(one).encode() + b"\n")
            stream.flush()
            reply = json.loads(stream.readline())
            if not reply.get("ok"):
                raise SystemExit(f"{one}: {reply}")


def rows_of(stream: Iterator[str]) -> Iterator[dict[str, Any]]:
    for line in stream:
        with contextlib.suppress(ValueError):
            yield json.loads(line)


def step(folder: Path, seed: int, name: str, speed: float, case: Case | None) -> dict[str, Any]:
    """Run one step; return its record."""
    with tempfile.TemporaryDirectory(prefix="bench-") as place:
        port = Path(place) / "control"
        command = [sys.executable, "-m", "controller.cli", "commission", "--yes", "--json"]
        command += ["--cell", str(EMULATED_CELL), "--out", str(folder), "--step", name]
        command += ["--as-built", str(seed), "--seed", str(seed), "--speed", str(speed)]
        command += ["--control", str(port)]
        begun, record, due = time.monotonic(), {}, case is not None and bool(case.orders)
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as run:
            assert run.stdout is not None
            assert run.stderr is not None
            if due and case is not None and not case.when:
                until = time.monotonic() + HANDS_WALL_S
                while not port.exists() and run.poll() is None and time.monotonic() < until:
                    time.sleep(0.01)
                order(port, case.orders)
                due = False
            for row in rows_of(run.stdout):
                text = str(row.get("text", ""))
                if due and case is not None and case.when in text:
                    order(port, case.orders)
                    due = False
                if row.get("event") == "step":
                    record = row
            error = run.stderr.read()
        return {
            "wall_s": round(time.monotonic() - begun, 1),
            "record": record,
            "error": error[-300:],
        }


def is_off(figure: Mapping[str, Any]) -> bool:
    """Return whether a figure is beyond a limit of its own."""
    low, high, value = figure.get("low"), figure.get("high"), figure["value"]
    return (low is not None and value < low) or (high is not None and value > high)


def judge(case: Case, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return whether a fault was found, and named."""
    record = found["record"]
    said = " ".join([record.get("message", ""), *map(str, record.get("findings", []))])
    failed = record.get("outcome") == "failed"
    said = " ".join([said, *(one["name"] for one in record.get("figures", []) if is_off(one))])
    named = any(word in said for word in case.words) or not case.words
    return {
        "found": failed is case.stops,
        "named": named and failed is case.stops,
        "outcome": record.get("outcome", found["error"]),
        "message": (record.get("message") or "; ".join(map(str, record.get("findings", []))))[:160],
    }


def run_seed(seed: int, names: Sequence[str], speed: float, scratch: Path) -> list[dict[str, Any]]:
    base = scratch / str(seed)
    needs = {CASES[name].step for name in names}
    for name in ("devices", "light"):
        if needs != {"devices"}:
            step(base, seed, name, speed, None)
    rows = []
    for number, name in enumerate(names):
        case, folder = CASES[name], scratch / f"{seed}-{number}"
        if base.is_dir():
            shutil.copytree(base, folder, ignore=shutil.ignore_patterns("*.lock"))
        found = step(folder, seed, case.step, speed, case)
        row = {"seed": seed, "fault": name, "wall_s": found["wall_s"], **judge(case, found)}
        rows.append(row)
        print(
            f"{seed:>6}  {name:32} {row['found']!s:>6} {row['named']!s:>6} {row['wall_s']:>7}  "
            f"{row['outcome']}: {row['message']}",
            file=sys.stderr,
            flush=True,
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", required=True, help="A or A-B")
    parser.add_argument("--faults", default=",".join(CASES), help="by name, with commas")
    parser.add_argument("--speed", type=float, default=15.0)
    parser.add_argument("--out", type=Path, help="keep the folders here")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    first, _, last = args.seeds.partition("-")
    chosen = [n for n in CASES if any(w and w in n for w in args.faults.split(","))]
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as scratch:
        for seed in range(int(first), int(last or first) + 1):
            rows += run_seed(seed, chosen, args.speed, args.out or Path(scratch))
    real = [r for r in rows if r["fault"] != "none"]
    summary = {
        "faults": len(real),
        "found": sum(r["found"] for r in real),
        "named": sum(r["named"] for r in real),
        "false alarms": sum(not r["found"] for r in rows if r["fault"] == "none"),
    }
    if args.json:
        print(json.dumps({"rows": rows, "summary": summary}))
        return
    print(f"{'seed':>6}  {'fault':32} {'found':>6} {'named':>6} {'wall s':>7}  outcome")
    for row in rows:
        print(
            f"{row['seed']:>6}  {row['fault']:32} {row['found']!s:>6} {row['named']!s:>6} "
            f"{row['wall_s']:>7}  {row['outcome']}: {row['message']}"
        )
    print(summary)


if __name__ == "__main__":
    main()
