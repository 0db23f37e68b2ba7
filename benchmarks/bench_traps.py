"""Good specimens' pictures with a fault of the station put in: how many verdicts for its sake?

    python benchmarks/bench_traps.py FOLDER... [--kinds glare_one,covered_all] [--count 2]
           [--seed 1] [--jobs 2] [--json]

FOLDER as benchmarks/trace_held.py writes it. COUNT of each fault (benchmarks/trap_pictures.py) are
put into the pictures of its good specimens in turn, each by its own seed, and judged by
`cellctl inspect` in a process of its own, beside the untouched sets in the same run.

The part is good: a FAIL where the untouched set has none is for the fault's sake. A PASS is not
wrong of the part, but was given on pictures that are not what the set says: it counts.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench import Arguments, need_sets, note, show
from bench_inspect import Sets, run_command
from inspection_truth import judged
from trace_held_sensor import Picture, Pictures
from trap_pictures import FAULTS

Words = dict[str, Any]
UNTOUCHED = "untouched"


@dataclass(frozen=True, eq=False)
class Case:
    """What is judged: the pictures of a good specimen, the fault, its seed."""

    sets: Sets
    truth: Words
    kind: str
    seed: int

    @property
    def specimen(self) -> str:
        return f"{self.sets.path.name}/{self.truth['specimen']}"


def cases_of(
    goods: Sequence[tuple[Sets, Words]], kinds: Sequence[str], count: int, seed: int
) -> Iterator[Case]:
    """Yield the untouched sets, then one of each fault in turn until there are enough.

    Parameters
    ----------
    goods : good specimens whose pictures are spoilt
    kinds, count : of faults, and how many of each
    seed : of the first of each fault
    """
    for sets, truth in goods:
        yield Case(sets, truth, UNTOUCHED, 0)
    turn = 0
    for nth in range(seed, seed + count):
        for kind in kinds:
            turn += 1
            yield Case(*goods[(turn + nth) % len(goods)], kind, nth)


def read_pictures(folder: Path) -> Pictures:
    """Return the pictures of a set, view by view, by lamp."""
    views = json.loads((folder / "SET.json").read_text())["views"]
    return [
        {lamp: _grey(folder / file) for lamp, file in view["pictures"].items()} for view in views
    ]


def _grey(path: Path) -> Picture:
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise ValueError(f"{path}: no picture")
    return np.asarray(picture)


def spoilt(case: Case) -> tuple[Pictures, Pictures]:
    """Return a case's pictures as they were, and with the fault."""
    start = [case.seed, zlib.crc32(f"{case.kind} {case.truth['seed']}".encode())]
    rng = np.random.default_rng(start)
    before = read_pictures(case.sets.folder(case.truth))
    others = [s for s in case.sets.specimens if s["part"] != case.truth["part"]]
    other: Pictures = []
    if case.kind.startswith("other_part") and others:
        other = read_pictures(case.sets.folder(others[int(rng.integers(len(others)))]))
    after = [dict(view) for view in before]
    FAULTS[case.kind](after, rng, other or before)
    return before, after


def write_spoilt(case: Case, folder: Path) -> Path:
    """Write a set with the pictures that changed, without those that are gone; return its file."""
    source = case.sets.folder(case.truth)
    folder.mkdir(parents=True)
    words = json.loads((source / "SET.json").read_text())
    words["part"] = os.path.relpath(source / words["part"], folder)
    kept = []
    for view, was, now in zip(words["views"], *spoilt(case), strict=True):
        files = {}
        for lamp, picture in now.items():
            files[lamp] = os.path.relpath(source / view["pictures"][lamp], folder)
            if picture is not was[lamp]:
                files[lamp] = f"{view['id']}_{lamp}.png"
                cv2.imwrite(str(folder / files[lamp]), picture)
        if files:
            kept.append(view | {"pictures": files})
    set_file = folder / "SET.json"
    set_file.write_text(json.dumps(words | {"views": kept}))
    return set_file


def judge(case: Case, scratch: Path) -> Words:
    """Return what the command says of a case."""
    set_file = case.sets.folder(case.truth) / "SET.json"
    if case.kind != UNTOUCHED:
        name = f"{case.specimen}_{case.kind}_{case.seed}".replace("/", "_")
        set_file = write_spoilt(case, scratch / name)
    lines, message = run_command(set_file, None)
    told = judged(case.truth, lines, len(case.truth["poses"]), message)
    row = {"specimen": case.specimen, "kind": case.kind, "seed": case.seed}
    return row | {"verdict": told.verdict, "s a view": told.seconds, "message": message}


def report(rows: Sequence[Words]) -> tuple[list[Words], Words]:
    """Return counts by fault, with how many failed where the untouched set did not; and sums."""
    was = {row["specimen"]: row["verdict"] for row in rows if row["kind"] == UNTOUCHED}
    counts: list[Words] = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        mine = [row for row in rows if row["kind"] == kind]
        verdicts = Counter(row["verdict"] for row in mine)
        sake = sum(row["verdict"] == "fail" != was.get(row["specimen"], "fail") for row in mine)
        shown = {v: verdicts[v] for v in ("pass", "fail", "indeterminate", "error")}
        counts.append({"fault": kind, "n": len(mine), **shown, "for its sake": sake})
    faults = [row for row in counts if row["fault"] != UNTOUCHED]
    keys = ("n", "pass", "fail", "for its sake")
    return counts, {key: sum(row[key] for row in faults) for key in keys}


def main(argv: Sequence[str] | None = None) -> int:
    parser = Arguments(__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--kinds", type=lambda s: s.split(","), default=list(FAULTS))
    parser.add_argument("--count", type=int, default=2, help="of each fault (default: 2)")
    parser.add_argument("--seed", type=int, default=1, help="of the first of each fault")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    args = parser.parse_args(argv)
    need_sets(args.folders, "trace_held.py")
    if unknown := set(args.kinds) - set(FAULTS):
        parser.error(f"not known: {', '.join(sorted(unknown))}; known: {', '.join(FAULTS)}")
    cv2.setNumThreads(1)
    goods = [
        (sets, truth)
        for sets in (Sets(path.resolve(), [], 0) for path in args.folders)
        for truth in sets.specimens
        if truth["cls"] == "good"
    ]
    rows = []
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(args.jobs) as pool:
        cases = cases_of(goods, args.kinds, args.count, args.seed)
        for row in pool.map(lambda case: judge(case, Path(scratch)), cases):
            rows.append(row)
            note(row)
    counts, sums = report(rows)
    show(args, counts, sums | ({"judged": rows} if args.json else {}))
    return int(bool(sums["pass"] or sums["for its sake"]))


if __name__ == "__main__":
    sys.exit(main())
