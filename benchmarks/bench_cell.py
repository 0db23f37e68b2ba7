"""The whole cell, many times: random places and stable poses, as-built parts and seeded defects.

Every run is a `cellctl run` of its own on a fresh emulated cell. What became of the part is asked
of the emulated world itself over its control port, which the run does not know: a part that the
controller thinks it placed and that lies elsewhere counts as dropped silently.

    python benchmarks/bench_cell.py                       three recipes, ten places each
    python benchmarks/bench_cell.py --recipes holder --places 3 --cell ur5e
    python benchmarks/bench_cell.py --twins chip burr      as-built twins, good and with defects
    python benchmarks/bench_cell.py --parts benchmarks/parts/clevis.csg.yaml --places 2
                                   parts as they come: with the recipe that `cellctl init` writes
"""

import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from bench import ROOT, Arguments, note, show
from trace_held_defects import DEFECTS, NoPlaceError, as_built, with_defect
from trace_held_parts import read_held_part, triangles_of

RECIPES = ("featuretype", "flange_xy", "idler_riser")
RUN_LIMIT_S = 1500.0
SLIVER_MM = 0.002
CELLCTL = str(Path(sys.executable).with_name("cellctl"))


@dataclass
class Trial:
    """One run and the truth about it."""

    recipe: str
    what: str
    seed: int
    exit_code: int
    wall_s: float
    end: str = ""
    code: str = ""
    message: str = ""
    verdict: str | None = None
    tray: str | None = None
    true_tray: str | None = None
    covered: float | None = None
    views: int = 0
    pose: int | None = None
    collisions: int = 0
    run: str = ""
    cell: str = ""

    @property
    def done(self) -> bool:
        return self.end == "complete" and self.verdict in ("pass", "fail")

    @property
    def dropped_silently(self) -> bool:
        return self.tray is not None and self.true_tray != self.tray


class Witness(threading.Thread):
    """Asks the emulated world where the part is, while a run lasts; keeps the last answer."""

    def __init__(self, path: Path) -> None:
        super().__init__(daemon=True)
        self._path = path
        self.over = threading.Event()
        self.last: dict[str, Any] = {}

    def run(self) -> None:
        while not self.over.wait(0.3):
            if not self._path.exists():
                continue
            try:
                with socket.socket(socket.AF_UNIX) as line:
                    line.settimeout(5)
                    line.connect(str(self._path))
                    with line.makefile("rwb") as file:
                        while not self.over.wait(0.3):
                            file.write(b'{"do": "truth"}\n')
                            file.flush()
                            answer = file.readline()
                            if not answer:
                                break
                            self.last = json.loads(answer)
            except (OSError, ValueError):
                continue


def one_run(
    recipe: Path, seed: int, speed: float, lay: Path | None, what: str, runs: Path, cell: str
) -> Trial:
    """Run once; never raises for what the cell does."""
    with tempfile.TemporaryDirectory(prefix="cellbench") as scratch:
        control = Path(scratch) / "control.sock"
        witness = Witness(control)
        witness.start()
        command = [
            CELLCTL, "run", str(recipe),
            "--speed", f"{speed:g}", "--seed", str(seed), "--json",
            "--runs", str(runs), "--control", str(control),
        ]  # fmt: skip
        if lay is not None:
            command += ["--lay", str(lay)]
        if cell:
            command += ["--cell", f"recipes/cells/{cell}.yaml"]
        started = time.monotonic()
        try:
            done = subprocess.run(
                command, cwd=ROOT, capture_output=True, text=True, timeout=RUN_LIMIT_S, check=False
            )
            code, out, err = done.returncode, done.stdout, done.stderr
        except subprocess.TimeoutExpired:
            code, out, err = -1, "", f"not done after {RUN_LIMIT_S:.0f} s"
        wall_s = time.monotonic() - started
        witness.over.set()
        witness.join()
    trial = Trial(name_of(recipe), what, seed, code, round(wall_s, 1), cell=cell)
    results = [json.loads(line) for line in out.splitlines() if line.startswith("{")]
    result = next((r for r in results if r.get("event") == "result"), None)
    if result is None:
        trial.end, trial.message = "no result", err.strip()[-300:]
        return trial
    trial.end, trial.code, trial.message = result["end"], result["code"], result["message"]
    trial.run = result["run"]
    if result["parts"]:
        part = result["parts"][-1]
        trial.verdict, trial.tray = part["verdict"], part["tray"]
        trial.covered, trial.views = part["covered_fraction"], part["views"]
        if part["sighting"]:
            trial.pose = part["sighting"]["pose_index"]
        if trial.verdict not in ("pass", None) and not trial.message:
            trial.message = "; ".join(part["reasons"][:3])
    truth = witness.last.get("parts") or []
    if truth:
        trial.true_tray = truth[0]["tray"]
    trial.collisions = len(witness.last.get("collisions") or [])
    return trial


def name_of(recipe: Path) -> str:
    """Name of a recipe: its file's, or its project's."""
    return recipe.parent.name if recipe.name == "recipe.yaml" else recipe.stem


def project_of(part: Path, folder: Path) -> Path:
    """Recipe of a part as it comes, in a project of its own below a folder."""
    project = folder / part.name.split(".")[0]
    command = [CELLCTL, "init", str(project), "--part", str(part)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return project / "recipe.yaml"


def make_twins(
    recipe: Path, kinds: Sequence[str], seed: int, folder: Path
) -> list[tuple[str, Path]]:
    """Write a part as built, within its tolerances, and one with each defect that it can have.

    Parameters
    ----------
    recipe : its part
    kinds : names of `trace_held_defects.DEFECTS`
    seed : draws sizes and places
    folder : written to
    """
    words = recipe.read_text()
    named = next(line for line in words.splitlines() if line.startswith("part:"))
    part = read_held_part(recipe.parent / named.split()[1])
    made = []
    for kind in ("as_built", *kinds):
        rng = np.random.default_rng([seed, *kind.encode()])
        try:
            built = as_built(part, rng) if kind == "as_built" else with_defect(part, kind, rng)
        except NoPlaceError:
            continue
        if built.stain is not None:  # paint, which a mesh has none of
            continue
        # no slivers that the file's 32 bits would close
        points = triangles_of(built.body.simplify(SLIVER_MM)).reshape(-1, 3)
        points = built.scaled(points)
        path = folder / f"{name_of(recipe)}_{kind}.stl"
        faces = np.arange(len(points)).reshape(-1, 3)
        trimesh.Trimesh(points, faces, process=False).export(path)
        made.append((kind, path))
    return made


def main() -> int:
    parser = Arguments(__doc__, recipes=["holder"], places=1)
    parser.add_argument("--recipes", nargs="+", default=[])
    parser.add_argument("--parts", nargs="+", type=Path, default=[], metavar="CAD")
    parser.add_argument("--places", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument(
        "--twins", nargs="+", default=[], metavar="KIND",
        help="as-built twins instead, good and with these defects; all: every kind",
    )  # fmt: skip
    parser.add_argument("--cell", default="", help="of recipes/cells: ur5e, genicam")
    parser.add_argument("--runs", type=Path, default=None)
    args = parser.parse_args()
    trials: list[Trial] = []
    with tempfile.TemporaryDirectory(prefix="cellbench") as scratch:
        runs = args.runs or Path(scratch) / "runs"
        named = args.recipes or ([] if args.parts else RECIPES)
        recipes = [ROOT / "recipes" / f"{name}.yaml" for name in named]
        recipes += [project_of(part, Path(scratch)) for part in args.parts]
        jobs: list[tuple[Path, int, Path | None, str]] = [
            (recipe, args.first_seed + i, None, "perfect")
            for recipe in recipes
            for i in range(0 if args.twins else args.places)
        ]
        kinds = list(DEFECTS) if args.twins == ["all"] else args.twins
        for recipe in recipes if args.twins else []:
            twins = make_twins(recipe, kinds, args.first_seed, Path(scratch))
            jobs += [
                (recipe, args.first_seed + i, path, kind) for i, (kind, path) in enumerate(twins)
            ]
        for recipe, seed, lay, what in jobs:
            trials.append(one_run(recipe, seed, args.speed, lay, what, runs, args.cell))
            note(asdict(trials[-1]))
    good = [t for t in trials if t.what in ("perfect", "as_built")]
    bad = [t for t in trials if t not in good]
    summary = {
        "trials": len(trials),
        "done": sum(t.done for t in trials),
        "good": len(good),
        "good_pass": sum(t.verdict == "pass" for t in good),
        "false_fail": sum(t.verdict == "fail" for t in good),
        "defective": len(bad),
        "defective_fail": sum(t.verdict == "fail" for t in bad),
        "wrong_pass": sum(t.verdict == "pass" for t in bad),
        "dropped_silently": sum(t.dropped_silently for t in trials),
        "wall_s_median": sorted(t.wall_s for t in trials)[len(trials) // 2],
    }
    show(args, [asdict(t) for t in trials], summary)
    wrong = summary["false_fail"] + summary["wrong_pass"] + summary["dropped_silently"]
    return int(wrong > 0 or summary["done"] < len(trials))


if __name__ == "__main__":
    sys.exit(main())
