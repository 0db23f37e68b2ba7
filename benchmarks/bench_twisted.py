"""Good specimens' pictures judged by a CAD file that is changed: how many wrong PASSes?

    python benchmarks/bench_twisted.py FOLDER... [--kinds hole_missing,boss_extra] [--count 4]
           [--seed 1] [--jobs 2] [--json] [--out outcomes.jsonl] [--scratch FOLDER]
           [--only dev/s0001,...] [--skip-good]
    python benchmarks/bench_twisted.py --tables outcomes.jsonl... [--json]

FOLDER as benchmarks/trace_held.py writes it. Against the changed file (benchmarks/twisted_parts.py)
the part in the pictures has a defect that is known: COUNT of each kind, taken in turn from the
good specimens, each by its own seed. Every one is judged by `cellctl inspect` in a process of its
own. The unchanged sets are judged in the same run, and again with their CAD file written the way
changed ones are (`rewritten`). Rays say whether a view shows the change; what none shows is counted
apart: a PASS of it is wrong all the same.

PASS is wrong but for the unchanged. alike: PASS, or no finding, nothing failed and no more reasons
against a PASS than the good part has (`rewritten`). would: PASS, but for faces compared too little.
found: something failed within 4 mm of the change beyond its size, or at its hole. silent: not FAIL,
and nothing there is failed or open. "<" and ">" are exact one-sided limits, 95 %.

A mirrored file counts only where no turn lays the mirror image on the part (solids subtracted,
principal axes laid on each other, open axes turned in steps and refined).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from bench_inspect import Sets, run_command
from inspection_counts import (
    Item,
    Outcome,
    by_kind,
    outcome,
    print_counts,
    read_outcomes,
    run_all,
)
from trace_held_defects import NoPlaceError
from trace_held_parts import NOMINAL_SAG_MM, write_stl
from twisted_good import Good, Twist, good_of, part_of
from twisted_parts import KINDS, twisted
from twisted_sight import visible_views

Body = Any  # manifold3d's solid
Words = dict[str, Any]
CONTROLS = ("unchanged", "rewritten")
DRAWS = 30  # of which one must find a place on the part


@dataclass(frozen=True, eq=False)
class Case:
    """What is judged: a good specimen, the kind of change, its seed, the changed file."""

    sets: Sets
    good: Good
    kind: str
    seed: int
    twist: Twist | None = None


def goods_of(sets: Sets) -> list[Good]:
    """Return the good specimens of a folder, each with what else is there."""
    names = sorted({s["part"] for s in sets.specimens})
    others = {name: part_of(name).build(sag_mm=NOMINAL_SAG_MM) for name in names}
    return [good_of(s, sets.words(s), others) for s in sets.specimens if s["cls"] == "good"]


def chosen(folders: Sequence[Sets], only: Sequence[str]) -> list[tuple[Sets, Good]]:
    """Return the good specimens of folders, all or those named as FOLDER/SPECIMEN."""
    found = [(sets, good) for sets in folders for good in goods_of(sets)]
    return [
        (sets, good)
        for sets, good in found
        if not only or f"{sets.path.name}/{good.truth['specimen']}" in only
    ]


def cases_of(
    goods: Sequence[tuple[Sets, Good]], kinds: Sequence[str], count: int, seed: int,
    *, with_good: bool = True,
) -> Iterator[Case]:  # fmt: skip
    """Yield the unchanged sets, then one of each kind in turn until there are enough.

    Parameters
    ----------
    goods : to be judged by changed files
    kinds, count : of changes, and how many of each
    seed : of the first of each kind
    with_good : with the unchanged sets
    """
    for kind in CONTROLS if with_good else ():
        for sets, good in goods:
            yield Case(sets, good, kind, 0)
    turns = {kind: seed + nth for nth, kind in enumerate(kinds)}
    for nth in range(seed, seed + count):
        for kind in kinds:
            for _ in goods:  # the next good specimen that can have it
                sets, good = goods[turns[kind] % len(goods)]
                turns[kind] += 1
                twist = twist_of(good, kind, nth)
                if twist is not None:
                    yield Case(sets, good, kind, nth, twist)
                    break


def twist_of(good: Good, kind: str, seed: int) -> Twist | None:
    """Return a changed file; None where the part cannot have it."""
    rng = np.random.default_rng([seed, zlib.crc32(f"{kind} {good.truth['seed']}".encode())])
    for _ in range(DRAWS):
        try:
            return twisted(good, kind, rng)
        except NoPlaceError:
            continue
    return None


def judge(case: Case, scratch: Path) -> Outcome:
    """Write a case's set, and return what the command says of it."""
    truth, name = case.good.truth, ""
    set_file = case.sets.folder(truth) / "SET.json"
    if case.kind != "unchanged":
        body = case.good.body
        if (twist := case.twist) is not None:
            views = visible_views(case.sets.words(truth), truth["poses"], body, twist.body)
            truth, body = twist.truth | {"visible_views": views}, twist.body
            name = f"{truth['size_mm']:.2f} mm {json.dumps(truth['dims'])}"
        folder = scratch / f"{case.sets.path.name}_{truth['specimen']}_{case.kind}_{case.seed}"
        set_file = write_set(case.sets.folder(truth), folder, truth, body)
    lines, message = run_command(set_file, None)
    done = outcome(truth, case.kind, case.seed, name, lines, message)
    done = replace(done, specimen=f"{case.sets.path.name}/{done.specimen}")
    return done if case.kind not in CONTROLS else replace(done, is_shown=True)


def write_set(source: Path, folder: Path, truth: Words, body: Body) -> Path:
    """Write a set of a source's pictures with another CAD file; return the file to inspect."""
    folder.mkdir(parents=True, exist_ok=True)
    words = json.loads((source / "SET.json").read_text())
    write_stl(body, folder / "changed.stl")
    words["part"], words["unit"] = "changed.stl", "mm"
    for view in words["views"]:
        view["pictures"] = {
            lamp: os.path.relpath(source / file, folder) for lamp, file in view["pictures"].items()
        }
    (folder / "truth.json").write_text(json.dumps(truth))
    out = folder / "SET.json"
    out.write_text(json.dumps(words))
    return out


def report(done: Sequence[Outcome]) -> Words:
    """Return counts by kind: of the controls, of what a view shows, of what none shows."""
    twists = [o for o in done if o.kind not in CONTROLS]
    every = [*done, *(replace(o, kind="all kinds") for o in twists)]
    shown = by_kind(every, CONTROLS[1])
    return {
        "good": {kind: row for kind, row in shown.items() if kind in CONTROLS},
        "in a view": {kind: row for kind, row in shown.items() if kind not in CONTROLS},
        "in no view": by_kind(every, CONTROLS[1], shown=False),
    }


def add_arguments(parser: argparse.ArgumentParser, known: Sequence[str], what: str) -> None:
    """Add what this bench and bench_traps.py take alike.

    Parameters
    ----------
    parser : of the command line
    known : kinds that there are
    what : a word for one of a kind
    """
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER")
    parser.add_argument("--kinds", type=lambda s: s.split(","), default=list(known))
    parser.add_argument("--seed", type=int, default=1, help=f"of the first of each {what}")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--out", type=Path, help="outcomes are added to it, one a line")
    parser.add_argument("--only", type=lambda s: s.split(","), default=[],
                        help="good specimens, as dev/s0001 (default: all)")  # fmt: skip
    parser.add_argument("--skip-good", action="store_true", help="judge no set as it is")
    parser.add_argument("--tables", type=Path, nargs="+", help="outcomes to count; judge nothing")
    parser.add_argument("--scratch", type=Path, help="where sets are written, and kept")


def parsed(parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> argparse.Namespace:
    """Return the arguments; there is something to judge, or to count."""
    args = parser.parse_args(argv)
    if not args.folders and not args.tables:
        parser.error("FOLDER or --tables is required")
    return args


def outcomes_of(
    args: argparse.Namespace,
    cases: Callable[[list[tuple[Sets, Good]]], Iterator[Item]],
    judge: Callable[[Item, Path], Outcome],
) -> list[Outcome]:
    """Return the outcomes that are asked for: judged now, or counted again.

    Parameters
    ----------
    args : as `add_arguments` has them
    cases : of good specimens, what is to be judged
    judge : one of them, with a folder to write to

    Raises
    ------
    OSError, ValueError : a file is missing or wrong
    """
    if args.tables:
        return list(read_outcomes(args.tables))
    goods = chosen([Sets(path.resolve(), [], 0) for path in args.folders], args.only)
    with tempfile.TemporaryDirectory() as temporary:
        scratch = (args.scratch or Path(temporary)).resolve()
        return run_all(lambda c: judge(c, scratch), cases(goods), args.jobs, args.out, args.json)


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_arguments(parser, KINDS, "kind")
    parser.add_argument("--count", type=int, default=4, help="of each kind (default: 4)")
    args = parsed(parser, argv)
    if unknown := set(args.kinds) - set(KINDS):
        parser.error(f"no such kind: {', '.join(sorted(unknown))}; known: {', '.join(KINDS)}")
    try:
        done = outcomes_of(
            args,
            lambda goods: cases_of(
                goods, args.kinds, args.count, args.seed, with_good=not args.skip_good
            ),
            judge,
        )
    except (OSError, ValueError) as error:
        print(f"bench_twisted: {error}", file=sys.stderr)
        return 2
    told = report(done)
    if args.json:
        print(json.dumps({"counts": told, "outcomes": [asdict(o) for o in done]}))
    else:
        for title, rows in told.items():
            if rows:
                print_counts(rows, title)
    return 0


if __name__ == "__main__":
    sys.exit(main())
