"""Held parts with known truth, judged by the public command `cellctl inspect`, and by rivals.

    python benchmarks/bench_inspect.py HELD [--dev DEV] [--json] [--jobs 1] [--only good,trap]
           [--no-rivals] [--recipe R] [--out lines.jsonl] [--limit N]

HELD and DEV are folders as benchmarks/trace_held.py writes them (../shared/inspect is one, too).
Every set is judged in a process of its own; nothing of the room is imported. Rivals are scored on
the same sets in the same run where golden views are there; where they draw the line is chosen on
DEV alone.

A wrong PASS is a PASS of a specimen with a defect, whether or not a view shows it. Found: something
failed within 4 mm of the defect beyond its size, or at the hole or face that is wrong. Behind each
rate stands its exact one-sided limit (Clopper and Pearson, 95 %).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench import ROOT, Arguments, need_sets, note, show
from inspection_rivals import Score, best_line, ellipse_diameters, scores
from inspection_truth import Compared, Judged, judged, upper_limit

Words = dict[str, Any]
TIMEOUT_S = 900
VERDICTS = ("pass", "fail", "indeterminate", "error")
SAID = ("specimen", "kind", "part", "verdict", "is_shown", "is_found", "elsewhere", "message")


class Sets:
    """A folder of specimens with truth."""

    def __init__(self, path: Path, only: Sequence[str], limit: int) -> None:
        self.path = path
        truth = json.loads((path / "truth.json").read_text())
        every = [s for s in truth["specimens"] if (path / s["specimen"] / "SET.json").is_file()]
        self.specimens = [s for s in every if not only or s["cls"] in only or s["kind"] in only][
            : limit or None
        ]

    def folder(self, truth: Words) -> Path:
        return self.path / str(truth["specimen"])

    def words(self, truth: Words) -> Words:
        out: Words = json.loads((self.folder(truth) / "SET.json").read_text())
        return out


def run_command(set_file: Path, recipe: str | None) -> tuple[list[Words], str]:
    """Return the lines of `cellctl inspect`, and what it said where it failed."""
    command = [sys.executable, "-m", "controller.cli", "inspect", str(set_file), "--json"]
    if recipe:
        command += ["--recipe", recipe]
    quiet = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            command, cwd=ROOT, env={**os.environ, **quiet}, capture_output=True, text=True,
            timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return [], f"no answer in {TIMEOUT_S} s"
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    lines = [line for line in lines if "event" in line]
    if not any(line["event"] == "verdict" for line in lines):
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        return lines, said[-1] if said else f"exit {done.returncode}"
    return lines, ""


def judge_all(sets: Sets, args: argparse.Namespace) -> list[Judged]:
    """Return the outcome of every specimen; tells each as it comes."""

    def one(truth: Words) -> Judged:
        lines, message = run_command(sets.folder(truth) / "SET.json", args.recipe)
        if args.out:
            with args.out.open("a") as file:
                for line in lines:
                    file.write(json.dumps({"set": truth["specimen"], **line}) + "\n")
        return judged(truth, lines, len(truth["poses"]), message)

    out = []
    with ThreadPoolExecutor(args.jobs) as pool:
        for outcome in pool.map(one, sets.specimens):
            out.append(outcome)
            note({key: getattr(outcome, key) for key in SAID})
    return out


def summary(outcomes: Sequence[Judged]) -> Words:
    """Return counts by class and by kind, and how sizes compare with truth."""
    rows = {}
    for cls in ("good", "defect", "trap"):
        mine = [o for o in outcomes if o.cls == cls]
        rows[cls] = _counts(mine)
        for kind in sorted({o.kind for o in mine}):
            rows[f"{cls} {kind}"] = _counts([o for o in mine if o.kind == kind])
    seconds = [o.seconds for o in outcomes if np.isfinite(o.seconds)]
    return {
        "counts": rows,
        "sizes": {
            kind: sizes([c for o in outcomes for c in o.compared if c.kind == kind])
            for kind in sorted({c.kind for o in outcomes for c in o.compared})
        },
        "seconds_a_view": float(np.median(seconds)) if seconds else None,
    }


def _counts(mine: Sequence[Judged]) -> Words:
    out: Words = {"n": len(mine)}
    out |= {v: sum(o.verdict == v for o in mine) for v in VERDICTS}
    out["shown"] = sum(o.is_shown for o in mine)
    out["found"] = sum(o.is_found for o in mine)
    out["hinted"] = sum(o.is_hinted for o in mine)
    out["with_fails_elsewhere"] = sum(o.elsewhere > 0 for o in mine)
    return out


def sizes(compared: Sequence[Compared]) -> Words:
    """Return bias, spread and how the errors lie inside what was stated."""
    error = np.array([c.error_mm for c in compared])
    stated = np.array([c.U_mm for c in compared])
    out: Words = {
        "n": len(error),
        "bias_mm": float(error.mean()),
        "median_abs_mm": float(np.median(np.abs(error))),
        "rms_mm": float(np.sqrt((error**2).mean())),
        "max_abs_mm": float(np.abs(error).max()),
    }
    if (stated > 0).all():
        out["mean_U_mm"] = float(stated.mean())
        out["inside_U"] = float((np.abs(error) <= stated).mean())
        out["mean_error_over_U"] = float((np.abs(error) / stated).mean())
    return out


def judge_rivals(held: Sets, dev: Sets | None) -> Words:
    """Return the rivals' rates on HELD, their lines drawn on DEV."""
    out: Words = {}
    mine = _scored(held)
    other = _scored(dev) if dev is not None else []
    for name in ("difference", "ssim"):
        train = [(s[name].value, t["cls"] == "defect") for t, s in other if t["cls"] != "trap"]
        if not mine or len({bad for _, bad in train}) < 2:
            out[name] = {"n": 0, "why": "no golden views in both folders (trace_held.py --golden)"}
            continue
        values, bad = np.array([v for v, _ in train]), np.array([b for _, b in train])
        line = best_line(values, bad)
        out[name] = {"line": line, "chosen_on": len(train), "n": len(mine)} | _rival_counts(
            [(t, s[name]) for t, s in mine], line
        )
    ellipses = [c for t in held.specimens for c in
                ellipse_diameters(held.folder(t), held.words(t), t)
                if t["cls"] != "trap"]  # fmt: skip
    out["ellipses"] = sizes(ellipses) if ellipses else {"n": 0}
    return out


def _scored(sets: Sets) -> list[tuple[Words, dict[str, Score]]]:
    found = ((t, scores(sets.folder(t), t)) for t in sets.specimens)
    return [(t, s) for t, s in found if s is not None]


def _rival_counts(scored: Iterable[tuple[Words, Score]], line: float) -> Words:
    rows = list(scored)

    def those(cls: str) -> list[Score]:
        return [s for t, s in rows if t["cls"] == cls]

    good, bad, traps = those("good"), those("defect"), those("trap")
    return {
        "false_fail": [sum(s.value > line for s in good), len(good)],
        "wrong_pass": [sum(s.value <= line for s in bad), len(bad)],
        "found": [sum(s.value > line and s.is_at_place for s in bad), len(bad)],
        "trap_not_seen_through": [len(traps), len(traps)],
    }


def main(argv: Sequence[str] | None = None) -> int:
    parser = Arguments(__doc__)
    parser.add_argument("held", type=Path, nargs="?", metavar="HELD")
    parser.add_argument("--dev", type=Path, help="where rivals draw their lines")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--only", type=lambda s: s.split(","), default=[], help="classes or kinds")
    parser.add_argument("--limit", type=int, default=0, help="of specimens")
    parser.add_argument("--no-rivals", action="store_true")
    parser.add_argument("--recipe", help="given to the command")
    parser.add_argument("--out", type=Path, help="the command's lines are added to it")
    args = parser.parse_args(argv)
    need_sets([args.held] if args.held else [], "trace_held.py")
    cv2.setNumThreads(1)
    try:
        held = Sets(args.held, args.only, args.limit)
        dev = Sets(args.dev, args.only, args.limit) if args.dev else None
    except (OSError, ValueError) as error:
        print(f"bench_inspect: {error}", file=sys.stderr)
        return 2
    outcomes = judge_all(held, args)
    told = summary(outcomes)
    rivals = None if args.no_rivals else judge_rivals(held, dev)
    rows = [
        {"what": name, **counts, "PASS below": upper_limit(counts["pass"], counts["n"])}
        for name, counts in told["counts"].items()
        if counts["n"]
    ]
    figures = {**told["sizes"], "s a view": told["seconds_a_view"], **(rivals or {})}
    if args.json:
        figures["specimens"] = [asdict(o) for o in outcomes]
    show(args, rows, figures)
    counts = told["counts"]
    return int(bool(counts["good"]["fail"] or counts["defect"]["pass"] or counts["trap"]["pass"]))


if __name__ == "__main__":
    sys.exit(main())
