"""Good specimens' pictures with a fault of the station put in: how many verdicts for its sake?

    python benchmarks/bench_traps.py FOLDER... [--kinds glare_one,covered_all] [--count 2]
           [--seed 1] [--over hole_missing,...] [--jobs 2] [--json] [--out outcomes.jsonl]
           [--scratch FOLDER] [--only dev/s0001,...] [--skip-good]
    python benchmarks/bench_traps.py --tables outcomes.jsonl... [--json]

FOLDER as benchmarks/trace_held.py writes it. COUNT of each fault (benchmarks/trap_pictures.py) are
put into the pictures of its good specimens in turn, each by its own seed, and judged by
`cellctl inspect` in a process of its own, beside the untouched sets in the same run.

The part is good: a FAIL where the untouched set has none is for the fault's sake. A PASS is not
wrong of the part, but was given on pictures that are not what the set says.

With --over, the CAD file is changed as well (benchmarks/twisted_parts.py), so that the part has a
defect: then every PASS is a wrong one, and the fault may be what hides the defect.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from bench_inspect import Sets, run_command
from bench_twisted import add_arguments, outcomes_of, parsed, twist_of, write_set
from inspection_counts import (
    Outcome,
    by_kind,
    outcome,
    print_counts,
)
from trace_held_sensor import Picture, Pictures
from trap_pictures import FAULTS
from twisted_good import Good, Twist
from twisted_parts import KINDS

Words = dict[str, Any]
UNTOUCHED = "untouched"


@dataclass(frozen=True, eq=False)
class Case:
    """What is judged: a good specimen, the fault, its seed; against which changed CAD file."""

    sets: Sets
    good: Good
    kind: str
    seed: int
    over: str = ""
    twist: Twist | None = None

    @property
    def name(self) -> str:
        return f"{self.kind} over {self.over}" if self.over else self.kind


def cases_of(
    goods: Sequence[tuple[Sets, Good]], kinds: Sequence[str], over: Sequence[str], count: int,
    seed: int, *, with_good: bool = True,
) -> Iterator[Case]:  # fmt: skip
    """Yield the untouched sets, then one of each fault in turn until there are enough.

    Parameters
    ----------
    goods : whose pictures are spoilt
    kinds, count : of faults, and how many of each
    over : changes of the CAD file, in turn; none: the right one
    seed : of the first of each fault
    with_good : with the untouched sets
    """
    for sets, good in goods if with_good else ():
        yield Case(sets, good, UNTOUCHED, 0)
    turn = 0
    for nth in range(seed, seed + count):
        for kind in kinds:
            turn += 1
            for ahead in range(len(goods)):
                sets, good = goods[(turn + nth + ahead) % len(goods)]
                defect = over[turn % len(over)] if over else ""
                twist = twist_of(good, defect, nth) if defect else None
                if twist is not None or not defect:
                    yield Case(sets, good, kind, nth, defect, twist)
                    break


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


def spoilt(case: Case) -> tuple[Pictures, Pictures, Words]:
    """Return a case's pictures as they were and with the fault, and what was drawn."""
    source = case.sets.folder(case.good.truth)
    start = [case.seed, zlib.crc32(f"{case.kind} {case.good.truth['seed']}".encode())]
    rng = np.random.default_rng(start)
    before = read_pictures(source)
    others = [s for s in case.sets.specimens if s["part"] != case.good.truth["part"]]
    other: Pictures = []
    if case.kind.startswith("other_part") and others:
        other = read_pictures(case.sets.folder(others[int(rng.integers(len(others)))]))
    after = [dict(view) for view in before]
    drawn = FAULTS[case.kind](after, rng, other or before)
    return before, after, drawn


def judge(case: Case, scratch: Path) -> Outcome:
    """Write a case's set, and return what the command says of it."""
    truth = case.good.truth if case.twist is None else case.twist.truth
    source, drawn = case.sets.folder(truth), {}
    set_file = source / "SET.json"
    if case.kind != UNTOUCHED:
        where = f"{case.sets.path.name}_{truth['specimen']}_{case.name}_{case.seed}"
        folder = scratch / where.replace(" ", "_")
        body = case.good.body if case.twist is None else case.twist.body
        set_file = write_set(source, folder, truth, body)
        if case.twist is None:  # its own CAD file
            words = json.loads(set_file.read_text())
            part = source / json.loads((source / "SET.json").read_text())["part"]
            set_file.write_text(json.dumps(words | {"part": os.path.relpath(part, folder)}))
        before, after, drawn = spoilt(case)
        write_spoilt(set_file, before, after)
    lines, message = run_command(set_file, None)
    done = outcome(truth, case.name, case.seed, json.dumps(drawn), lines, message)
    return replace(done, is_shown=True, specimen=f"{case.sets.path.name}/{done.specimen}")


def write_spoilt(set_file: Path, before: Pictures, after: Pictures) -> None:
    """Write the pictures that changed, and the set without those that are gone."""
    words = json.loads(set_file.read_text())
    kept = []
    for view, was, now in zip(words["views"], before, after, strict=True):
        files = {}
        for lamp, picture in now.items():
            files[lamp] = view["pictures"][lamp]
            if picture is not was[lamp]:
                files[lamp] = f"{view['id']}_{lamp}.png"
                cv2.imwrite(str(set_file.parent / files[lamp]), picture)
        if files:
            kept.append(view | {"pictures": files})
    set_file.write_text(json.dumps(words | {"views": kept}))


def report(done: Sequence[Outcome]) -> Words:
    """Return counts by fault, with how many failed where the untouched set did not."""
    was = {o.specimen: o.verdict for o in done if o.kind == UNTOUCHED}
    every = [*done, *(replace(o, kind="all faults") for o in done if o.kind != UNTOUCHED)]
    rows = by_kind(every, UNTOUCHED)
    for kind, row in rows.items():
        mine = [o for o in every if o.kind == kind and o.verdict == "fail"]
        row["for_its_sake"] = sum(was.get(o.specimen) not in (None, "fail") for o in mine)
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_arguments(parser, FAULTS, "fault")
    parser.add_argument("--over", type=lambda s: s.split(","), default=[], help="defects, in turn")
    parser.add_argument("--count", type=int, default=2, help="of each fault (default: 2)")
    args = parsed(parser, argv)
    for given, known in ((args.kinds, FAULTS), (args.over, KINDS)):
        if unknown := set(given) - set(known):
            parser.error(f"not known: {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    cv2.setNumThreads(1)
    try:
        done = outcomes_of(
            args,
            lambda goods: cases_of(
                goods, args.kinds, args.over, args.count, args.seed, with_good=not args.skip_good
            ),
            judge,
        )
    except (OSError, ValueError) as error:
        print(f"bench_traps: {error}", file=sys.stderr)
        return 2
    told = report(done)
    if args.json:
        print(json.dumps({"counts": told, "outcomes": [asdict(o) for o in done]}))
    else:
        print_counts(told, "good parts" if not args.over else "parts with a defect")
        sake = {kind: row["for_its_sake"] for kind, row in told.items() if row["for_its_sake"]}
        print(f"FAIL where the untouched set has none: {sake or 'none'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
