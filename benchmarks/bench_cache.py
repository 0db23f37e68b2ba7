"""The disk cache: how long reading takes, how large its files are; against another revision.

    python benchmarks/bench_cache.py [--against REVISION] [--parts FILE ...] [--library 100]
                                     [--rounds 9] [--json]

Measured by public functions alone, for all that uses the cache: compiled parts, recognition's
library (one of varied parts), plans and prepared parts. Times are the processor's, the median over
rounds; each round is a process of its own, imports and one read left out. With ``--against`` the
same is measured of another revision in the same run: each fills a cache of its own, then they read
in turns, so that other jobs on the machine disturb both alike. All is kept in a folder that is
removed afterwards.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CELL = ROOT / "recipes/cells/emulated.yaml"
PARTS = sorted([*ROOT.glob("recipes/parts/*.stl"), *ROOT.glob("recipes/parts/*.csg.yaml")])
PLANNED = ("widget", "featuretype")
SEED = 4


def child(asked: dict[str, Any]) -> dict[str, float]:
    """Return milliseconds of processor of each read."""
    # what the other revision does not have must not be taken from an editable install
    sys.meta_path[:] = [f for f in sys.meta_path if "__editable__" not in repr(f)]
    from controller.cad.compiled import load_part, options_among
    from controller.cell.plans import PlanCache
    from controller.config import load_cell
    from controller.recognition.stored import open_library

    try:
        setup = importlib.import_module("controller.setup.layout")
    except ImportError:  # a revision before ADR 19
        setup = importlib.import_module("controller.config")

    taken: dict[str, float] = {}

    def timed(name: str, work: Callable[[], Any]) -> Any:  # noqa: ANN401 - whatever the work returns
        gc.collect()
        begin = time.process_time()
        found = work()
        taken[name] = 1e3 * (time.process_time() - begin)
        return found

    layout = setup.build_layout(load_cell(CELL))
    parts = {path.name: (path, options_among(path, "mm")) for path in map(Path, asked["parts"])}
    load_part(*next(iter(parts.values())))
    for name, part in parts.items():
        timed(f"compiled {name}", lambda part=part: load_part(*part))
    library = [(path, options_among(path, "mm")) for path in map(Path, asked["library"])]
    if library:
        timed(f"compiled {len(library)} of a library", lambda: [load_part(*p) for p in library])
        timed(f"library of {len(library)}", lambda: open_library(library, layout.overhead))
    for name in parts:
        if name.split(".")[0] in PLANNED:
            part = load_part(*parts[name])
            planning = PlanCache(part, layout)
            timed(f"plan {name}", lambda p=part, q=planning: q.plan_at(p.poses[0], 360.0, 0.0, 0.0))
            timed(f"prepared {name}", planning.prepared)
    return taken


def run_child(tree: Path, cache: Path, asked: dict[str, Any]) -> dict[str, float]:
    environment = os.environ | {
        "PYTHONPATH": str(tree),
        "XDG_CACHE_HOME": str(cache),
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, str(Path(__file__)), "--child", json.dumps(asked)]
    done = subprocess.run(
        command, cwd=tree, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def sizes_mb(cache: Path) -> dict[str, float]:
    """Return megabytes of all files of each kind."""
    found: dict[str, float] = {}
    for file in (cache / "cellctl").iterdir():
        kind = file.name.split("-")[0]
        found[kind] = found.get(kind, 0.0) + file.stat().st_size / 1e6
    return found


def measure(trees: dict[str, Path], scratch: Path, args: argparse.Namespace) -> dict[str, Any]:
    from recognition_library import make_library

    library = []
    if args.library:
        library = make_library(scratch / "library", PARTS[:4], args.library, SEED)
    asked = {"parts": list(map(str, args.parts)), "library": list(map(str, library))}
    caches = {name: scratch / f"cache {name}" for name in trees}
    made = {name: run_child(tree, caches[name], asked) for name, tree in trees.items()}
    rounds: dict[str, list[dict[str, float]]] = {name: [] for name in trees}
    for _ in range(args.rounds):
        for name, tree in trees.items():
            rounds[name].append(run_child(tree, caches[name], asked))
    return {
        name: {
            "made_ms": made[name],
            "read_ms": {
                what: statistics.median(one[what] for one in rounds[name]) for what in made[name]
            },
            "files_mb": sizes_mb(caches[name]),
        }
        for name in trees
    }


def show(found: dict[str, Any]) -> None:
    names = list(found)
    print(f"{'read again, ms of processor':34}" + "".join(f"{name:>12.11}" for name in names))
    for what in found[names[0]]["read_ms"]:
        print(f"{what:34}" + "".join(f"{found[name]['read_ms'][what]:12.1f}" for name in names))
    print(f"\n{'files of a kind, MB':34}" + "".join(f"{name:>12.11}" for name in names))
    for what in found[names[0]]["files_mb"]:
        cells = (f"{found[name]['files_mb'].get(what, 0.0):12.2f}" for name in names)
        print(f"{what:34}" + "".join(cells))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--against", help="revision to measure in turns with this tree")
    parser.add_argument("--parts", nargs="*", type=Path, default=PARTS)
    parser.add_argument("--library", type=int, default=100, help="parts of the library; 0: none")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        print(json.dumps(child(json.loads(args.child))))
        return 0
    with tempfile.TemporaryDirectory() as folder:
        scratch = Path(folder)
        trees = {"this tree": ROOT}
        if args.against:
            trees[args.against] = scratch / "tree"
            archive = scratch / "tree.tar"
            git = ["git", "-C", str(ROOT), "archive", "-o", str(archive), args.against]
            subprocess.run(git, check=True)
            trees[args.against].mkdir()
            subprocess.run(["tar", "-xf", str(archive), "-C", str(trees[args.against])], check=True)
        found = measure(trees, scratch, args)
    if args.json:
        print(json.dumps({"cache": found}))
    else:
        show(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
