"""Whole runs in which the table does not tell what lies there: is every part sorted right?

    python benchmarks/bench_ambiguity.py [--cases lever,twin_there] [--seed 951] [--speed 10]
           [--keep FOLDER] [--json]

One part a run, dropped in a random pose: one of two blocks that differ by a blind hole, on the
underside, or a block with a hole in one of its two ends, which looks the same from above in two
turns; or, with --cases, one of a mirror pair. The first two are dropped again until the hole does
not show. The recipe
names the other part under `others`. Judged by the emulated world: what the disambiguation view left
has to be what lies there; the recipe's own part has to be inspected and go to the accept tray, or
to quarantine with a verdict of its own that is no FAIL; the other one goes to quarantine. Nobody
may be called. With it: whether the recognition on the table was in doubt at all.
"""

import argparse
import contextlib
import json
import math
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from runs_whole import ask, run_beside
from shift_parts import GLOWING_MM

from controller.cad import load_solid
from controller.cell.journal import JOURNAL_NAME, read_rows_named, rows

ROOT = Path(__file__).parents[1]
PARTS = ROOT / "benchmarks" / "parts"
LIMIT_WALL_S = 1800.0
Words = dict[str, Any]

RECIPE = """\
name: {name}
part: {name}.csg.yaml
{others}density_g_cm3: 2.7
inspection: {{min_coverage: 0.30, smallest_defect_mm: 3.0, required: stated}}
grasp: {{force_n: 60, width_tolerance_mm: 2.0}}
"""
# A block with one corner cut off, so that no turn of it looks like another; and what is taken off.
BLOCK = """\
unit: mm
tolerance_mm: 0.02
part:
  difference:
    - extrude: {{outline: [[0, 0], [52, 0], [52, 22], [44, 32], [0, 32]], height: 18}}
{cuts}"""
UNDER = "    - cylinder: {{diameter: 12, height: 10}}\n      move: [{x}, 13, -5]\n"
# A plain block with a blind hole in one end.
ENDED = """\
unit: mm
tolerance_mm: 0.02
part:
  difference:
    - block: {from: [0, 0, 0], to: [50, 30, 20]}
    - cylinder: {diameter: 10, height: 12}
      turn: {about: y, deg: 90}
      move: [-6, 15, 10]
"""
OWN = {
    "under_near": BLOCK.format(cuts=UNDER.format(x=12)),
    "under_far": BLOCK.format(cuts=UNDER.format(x=36)),
    "ended": ENDED,
}


# The direction that is up, in the part's frame, when the hole does not show from above.
HIDING: dict[str, Callable[[np.ndarray], bool]] = {
    "under_near": lambda up: up[2] > 0.9,
    "ended": lambda up: abs(up[0]) < 0.1,
}


@dataclass(frozen=True, slots=True)
class Case:
    """One run: the recipe's part, what else the recipe names, and what really lies there."""

    recipe: str
    others: tuple[str, ...]
    truth: str

    @property
    def is_own(self) -> bool:
        """Whether the recipe's own part lies there."""
        return self.truth == self.recipe


PAIRS = (
    ("lever", "lever_mirror"),
    ("angle_bracket", "angle_bracket_mirror"),
    ("l_profile", "l_profile_mirror"),
    ("under_near", "under_far"),
)
CASES = {
    **{f"{a}_itself": Case(a, (b,), a) for a, b in PAIRS},
    **{f"{a}_other": Case(a, (b,), b) for a, b in PAIRS},
    "ended_alone": Case("ended", (), "ended"),
}
# What the lamps do not tell either: a hole that is underneath, or in one of two ends.
DOUBTFUL = (
    *("under_near_itself", "under_near_other", "ended_alone", "under_near_itself"),
    *("ended_alone", "under_near_other", "ended_alone", "under_near_itself", "ended_alone"),
    "under_near_other",
)


def lay_out(case: Case, folder: Path) -> Path:
    """Write a case's recipe and its CAD files into a folder; return the recipe."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in {case.recipe, case.truth, *case.others}:
        file = folder / f"{name}.csg.yaml"
        if name in OWN:
            file.write_text(OWN[name])
        else:
            shutil.copy(PARTS / file.name, file)
    # the world takes meshes alone
    load_solid(folder / f"{case.truth}.csg.yaml").mesh.export(folder / f"{case.truth}.stl")
    others = "".join(f"  - {name}.csg.yaml\n" for name in case.others)
    recipe = folder / "recipe.yaml"
    recipe.write_text(
        RECIPE.format(name=case.recipe, others=f"others:\n{others}" if others else "")
    )
    return recipe


class Run:
    """One run of `cellctl run`, with one part dropped on the table."""

    def __init__(self, case: Case, seed: int, speed: float, folder: Path) -> None:
        self.case, self.seed, self.speed, self.folder = case, seed, speed, folder
        self.control, self.runs = folder / "control.sock", folder / "runs"
        self.result: Words = {}
        self.tray, self.was_held, self.collisions = "", False, 0
        self.was_laid = False

    def run(self) -> Words:
        """Make the run and return what came of it."""
        recipe = lay_out(self.case, self.folder)
        command = [sys.executable, "-m", "controller.cli", "run", str(recipe), "--json"]
        command += ["--cell", str(ROOT / "recipes" / "cells" / "emulated.yaml"), "--empty"]
        command += ["--speed", f"{self.speed:g}", "--seed", str(self.seed)]
        command += ["--runs", str(self.runs), "--control", str(self.control)]
        self.result = run_beside(
            command, self.folder / "stderr.txt", LIMIT_WALL_S, self._lay_and_look
        )
        return self.words()

    def _lay_and_look(self, _: int, has_ended: threading.Event) -> None:
        rng = np.random.default_rng(self.seed)
        file = str(self.folder / f"{self.case.truth}.stl")
        while not has_ended.wait(0.3):
            with contextlib.suppress(OSError, ValueError, KeyError):
                truth = ask(self.control, "truth")
                if not truth["ok"]:
                    continue
                if not truth["parts"]:
                    ask(self.control, "add", file=file)
                elif not self.was_laid or not self.hides_it(truth["parts"][-1]):
                    x_mm = rng.uniform(sum(GLOWING_MM[0]) / 2 - 60.0, sum(GLOWING_MM[0]) / 2 + 60.0)
                    turn = math.degrees(rng.uniform(0.0, math.tau))
                    told = ask(
                        self.control, "drop", part=len(truth["parts"]) - 1, x_mm=float(x_mm),
                        y_mm=float(rng.uniform(-90.0, 90.0)), theta_deg=turn,
                    )  # fmt: skip
                    self.was_laid = bool(told["ok"])
                self._look(truth)

    def hides_it(self, part: Words) -> bool:
        """Return whether a part on the table hides what tells it, as far as it was laid on purpose.

        Until then it is dropped again, before anything has moved but the arm that homes.
        """
        hides = HIDING.get(self.case.recipe)
        if self.was_held or hides is None or part["T_world_part"] is None or not part["at_rest"]:
            return True
        up = np.array(part["T_world_part"])[2, :3]
        return bool(hides(up))

    def _look(self, truth: Words) -> None:
        self.collisions = len(truth["collisions"])
        for part in truth["parts"][-1:]:
            self.was_held |= part["custody"] in ("arm", "fixture", "both")
            self.tray = part["tray"] or self.tray

    def words(self) -> Words:
        """Return what came of it."""
        (part,) = self.result.get("parts", []) or [{}]
        seen = [rows.Sightings.model_validate(r.body) for r in self._rows(rows.Sightings.row_name)]
        doubts = [
            rows.AmbiguityResolved.model_validate(r.body)
            for r in self._rows(rows.AmbiguityResolved.row_name)
        ]
        end = self.result.get("end", "none")
        is_known = all(set(d.left) == {self.case.truth} for d in doubts)
        trays = ("accept", "quarantine") if self.case.is_own else ("quarantine",)
        return {
            "recipe": self.case.recipe,
            "others": list(self.case.others),
            "truth": self.case.truth,
            "seed": self.seed,
            "in_doubt": any(s.ambiguous_with for one in seen for s in one.sightings),
            "named": next((s.part or "" for one in seen for s in one.sightings), ""),
            "doubts": [{"between": list(d.between), "left": list(d.left)} for d in doubts],
            "verdict": part.get("verdict"),
            "tray": self.tray,
            "reasons": [str(r) for r in part.get("reasons", [])][:2],
            "end": end,
            "message": self.result.get("message", ""),
            "collisions": self.collisions,
            "is_right": is_known and self.tray in trays and not self.collisions,
            "is_passed": self.tray == "accept",
        }

    def _rows(self, name: str) -> list[Any]:
        return list(read_rows_named(self.runs / JOURNAL_NAME, [name]))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", default=",".join(DOUBTFUL), help="separated by commas")
    parser.add_argument("--seed", type=int, default=951)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--keep", type=Path, help="folder that runs and files are left in")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    found = []
    with tempfile.TemporaryDirectory(prefix="amb-") as scratch:
        for number, name in enumerate(args.cases.split(",")):
            folder = (args.keep or Path(scratch)).resolve() / f"{number}_{name}"
            one = Run(CASES[name], args.seed + number, args.speed, folder).run()
            found.append({"case": name, **one})
            if not args.json:
                said = "; ".join(" | ".join(d["left"]) or "none" for d in one["doubts"])
                doubt = "doubt" if one["in_doubt"] else ""
                print(
                    f"{name:22} named {one['named']:22} {doubt:5} "
                    f"left: {said or '-':40} {one['verdict'] or '-':13} {one['tray'] or '-':10} "
                    f"{'right' if one['is_right'] else 'WRONG'} {one['end']} {one['message'][:60]}",
                    flush=True,
                )
    doubtful = [one for one in found if one["in_doubt"] or one["doubts"]]
    total = {
        "runs": len(found),
        "in_doubt": len(doubtful),
        "right_of_those": sum(one["is_right"] for one in doubtful),
        "passed_of_those": sum(one["is_passed"] for one in doubtful),
        "right": sum(one["is_right"] for one in found),
        "load": [round(x, 1) for x in os.getloadavg()],
    }
    if args.json:
        print(json.dumps({"runs": found, "total": total}))
    else:
        print("  ".join(f"{name} {value}" for name, value in total.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
