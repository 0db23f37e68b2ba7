"""What all benchmarks share: where things lie, how they are called, and how figures are printed.

A benchmark is a script of its own: `python benchmarks/bench_NAME.py`. Each has `--json` (one JSON
object) and `--quick`, its reduced and seeded form. Exit code 0: what it asks for holds; 1: it does
not; 77: left out, since something that is not in the project is missing.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"  # the larger collection, of which tests/data has a selection
EMULATED = ROOT / "recipes" / "cells" / "emulated.yaml"
LEFT_OUT = 77  # exit code, as automake has it
WIDEST = 60  # letters of a cell of a table; JSON has all of them
for _folder in (ROOT / "tests" / "cross", ROOT / "tests" / "unit", ROOT):
    if str(_folder) not in sys.path:
        sys.path.insert(0, str(_folder))


class Arguments(argparse.ArgumentParser):
    """Arguments of a benchmark, `--json` and `--quick` among them.

    Parameters
    ----------
    doc : of the script: what it shows, and how
    quick : values that `--quick` puts in place of the usual ones, where none are given
    """

    def __init__(self, doc: str | None, **quick: object) -> None:
        super().__init__(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
        self._quick = quick
        self.add_argument("--json", action="store_true", help="one JSON object, no table")
        self.add_argument("--quick", action="store_true", help="the reduced form, seeded")

    def parse_known_args(  # type: ignore[override]
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401
    ) -> tuple[argparse.Namespace, list[str]]:
        """Return what was asked; `parse_args` goes through here."""
        if "--quick" in (sys.argv[1:] if args is None else args):
            known = {action.dest for action in self._actions}
            unknown = self._quick.keys() - known
            if unknown:
                raise ValueError(f"--quick sets {sorted(unknown)}, which is no argument")
            self.set_defaults(**self._quick)
        return super().parse_known_args(args, namespace)


def leave_out(why: str) -> NoReturn:
    """End with the exit code of what is left out, and say what is missing."""
    print(f"left out: {why}", file=sys.stderr)
    raise SystemExit(LEFT_OUT)


def need_module(name: str) -> None:
    """Leave the benchmark out where a Python package is not installed."""
    if importlib.util.find_spec(name) is None:
        leave_out(f"needs the Python package {name}, which is not installed")


def need_sets(folders: Iterable[Path], maker: str) -> None:
    """Leave the benchmark out where no sets are named.

    Parameters
    ----------
    folders : of sets, as given
    maker : how such sets are made
    """
    if not list(folders):
        leave_out(f"needs sets of pictures, which {maker} makes; name their folders")


def note(row: Mapping[str, Any]) -> None:
    """Print a row to the standard error output as soon as it is known: long ones are followed."""
    print(", ".join(f"{k} {words(v)}"[:120] for k, v in row.items()), file=sys.stderr, flush=True)


def words(value: object) -> str:
    """Return a value as a table has it: numbers by their size, nothing for None."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        size = abs(value)
        return f"{value:.0f}" if size >= 1000 else f"{value:.4g}" if size >= 1e-4 else f"{value:g}"
    if isinstance(value, Mapping):
        return ", ".join(f"{k} {words(v)}" for k, v in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(map(words, value))
    return str(value)


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as a table: a column for each key, numbers to the right."""
    if not rows:
        return "nothing"
    heads = list(dict.fromkeys(key for row in rows for key in row))
    cells = [[words(row.get(h))[:WIDEST] if h in row else "" for h in heads] for row in rows]
    right = [
        any(isinstance(row.get(h), int | float) for row in rows)
        and not any(isinstance(row.get(h), str) for row in rows)
        for h in heads
    ]
    widths = [max(len(h), *(len(c[k]) for c in cells)) for k, h in enumerate(heads)]
    return "\n".join(
        "  ".join(
            cell.rjust(w) if r else cell.ljust(w)
            for cell, w, r in zip(line, widths, right, strict=True)
        ).rstrip()
        for line in [heads, *cells]
    )


def show(
    args: argparse.Namespace, rows: Sequence[Mapping[str, Any]], figures: Mapping[str, Any]
) -> None:
    """Print a benchmark's result: as one JSON object, or its rows as a table and what they come to.

    Parameters
    ----------
    args : of `Arguments`
    rows : one for each thing measured
    figures : what is said of all of them together
    """
    if args.json:
        print(json.dumps({"figures": figures, "rows": rows}, default=str))
        return
    print(table(rows))
    print()
    for name, value in figures.items():
        print(f"{name}: {words(value)}")
