"""Does the cell take the right part from among several, and leave the others as they are?

    python benchmarks/bench_several.py [--seeds 921-926] [--speed 20] [--lying] [--json]

Each seed makes one whole run of `cellctl run` on the emulated cell with two to five objects on the
table: parts of the recipe, parts of other recipes that this one does not know, dropped apart; on
odd seeds the second one is pushed up to the first until they touch, before anything is looked at.
With --lying the second one falls onto the first instead, so that it leans on it or lies across it,
and the batch is all that lies there, as in a shift: what lies on top has to be taken first.
Judged by the emulated world alone: which part the gripper took and in which tray it ended, what ran
into what, and how far anything moved that was never taken. A run has to end with all its parts
sorted, or held with the reason. Seeds below 900 are there to develop with.
"""

import argparse
import contextlib
import json
import subprocess
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from runs_whole import ask
from scipy.spatial import ConvexHull

ROOT = Path(__file__).parents[1]
PARTS = ROOT / "recipes" / "parts"
RECIPES = ("holder", "idler_riser", "featuretype", "flange_xy")
LIMIT_WALL_S = 1500.0
TOUCH_MM = 0.05  # what is left between outlines that touch
OVERLAP_MM = 12.0  # by which the shadow of what falls onto a part lies over that part's
FALL_MM = 3.0
Words = dict[str, Any]


def seeds_of(text: str) -> list[int]:
    """Return the seeds of "921-926" or "921,930"."""
    found: list[int] = []
    for piece in text.split(","):
        first, _, last = piece.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def hull_of(name: str, T: np.ndarray) -> np.ndarray:
    """Return the outline (n, 2) of a part's hull on the table."""
    points = trimesh.load_mesh(PARTS / f"{name}.stl").vertices @ T[:3, :3].T + T[:3, 3]
    return np.asarray(points[ConvexHull(points[:, :2]).vertices, :2])


def top_of(name: str, T: np.ndarray) -> float:
    """Return how high a part on the table is."""
    z_mm = trimesh.load_mesh(PARTS / f"{name}.stl").vertices @ T[2, :3] + T[2, 3]
    return float(np.ptp(z_mm))


def push_up(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return by how much (2,) an outline has to be moved towards another to touch it."""
    towards = one.mean(axis=0) - other.mean(axis=0)
    low, high = 0.0, float(np.linalg.norm(towards))  # there the one lies within the other
    towards /= high
    while high - low > 0.001:
        middle = (low + high) / 2
        if _apart(one, other + middle * towards):
            low = middle
        else:
            high = middle
    return np.asarray((low - TOUCH_MM) * towards)


def _apart(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether a line separates two convex outlines."""
    for a in (one, other):
        edges = np.roll(a, -1, axis=0) - a
        normals = np.column_stack([edges[:, 1], -edges[:, 0]])
        ours, theirs = one @ normals.T, other @ normals.T
        if (
            (ours.max(axis=0) < theirs.min(axis=0)) | (theirs.max(axis=0) < ours.min(axis=0))
        ).any():
            return True
    return False


class Case:
    """One run: what is on the table, and what came of it."""

    def __init__(self, seed: int, speed: float, is_lying: bool, scratch: Path) -> None:
        rng = np.random.default_rng(seed)
        self.seed, self.speed, self.scratch = seed, speed, scratch
        self.recipe = RECIPES[seed % len(RECIPES)]
        self.own = int(rng.integers(1, 4))
        others = [name for name in RECIPES if name != self.recipe]
        self.strangers = list(rng.choice(others, int(rng.integers(0 if self.own > 1 else 1, 3))))
        self.names = [self.recipe] * self.own + self.strangers
        if is_lying:
            self.own = len(self.names)
        self.is_lying = is_lying
        self.touches = seed % 2 == 1 or is_lying
        self.control = scratch / "control.sock"
        self.placed = False
        self.start: list[np.ndarray] = []
        self.taken: set[int] = set()
        self.moved: dict[int, float] = {}
        self.wrong: set[int] = set()
        self.trays: dict[int, str] = {}
        self.collisions: list[Words] = []

    def run(self) -> Words:
        """Make the run; return what came of it."""
        counts = Counter(self.names[: self.own])
        command = [
            sys.executable, "-m", "controller.cli", "run",
            *(f"recipes/{name}.yaml={count}" for name, count in counts.items()), "--json",
            "--speed", f"{self.speed:g}", "--seed", str(self.seed),
            "--runs", str(self.scratch / "runs"), "--control", str(self.control),
        ]  # fmt: skip
        for name in self.names:
            command += ["--lay", f"recipes/parts/{name}.stl"]
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        limit = threading.Timer(LIMIT_WALL_S, process.kill)
        limit.start()
        result: Words = {}
        last = ""
        assert process.stdout is not None
        for line in process.stdout:
            body = json.loads(line)
            if body["event"] == "result":
                result = body
            elif body.get("state") != last:
                last = str(body.get("state"))
                with contextlib.suppress(OSError, ValueError):
                    self._look(last)
        process.wait()
        limit.cancel()
        still = [mm for k, mm in self.moved.items() if k not in self.taken]
        parts = result.get("parts", [])
        return {
            "seed": self.seed,
            "recipe": self.recipe,
            "objects": self.names,
            "second_one": self._how(),
            "asked": self.own,
            "sorted": sum(p["custody"] == "placed" for p in parts),
            "verdicts": dict(Counter(p["verdict"] for p in parts if p["verdict"])),
            "end": result.get("end", "none"),
            "message": result.get("message", ""),
            "wrong_parts_taken": len(self.wrong),
            "collisions": len(self.collisions),
            "moved_mm": round(max(still, default=0.0), 2),
        }

    def _how(self) -> str:
        if self.is_lying:
            return "lying on the first"
        return "touching" if self.touches else "apart"

    def _look(self, state: str) -> None:
        truth = ask(self.control, "truth")
        if state == "resetting" and not self.placed:
            self.placed = True
            if self.touches and len(self.names) > 1:
                T = [np.array(p["T_world_part"]) for p in truth["parts"][:2]]
                by = push_up(*(hull_of(n, t) for n, t in zip(self.names, T, strict=False)))
                T[1][:2, 3] += by
                if self.is_lying:
                    T[1][:2, 3] += OVERLAP_MM * by / np.linalg.norm(by)
                    T[1][2, 3] += top_of(self.names[0], T[0]) + FALL_MM
                ask(self.control, "place", part=1, T_world_part=T[1].tolist())
                truth = ask(self.control, "truth")
        if state == "acquiring" and not self.start:  # by then all that fell lies still
            self.start = [np.array(p["T_world_part"]) for p in truth["parts"]]
            (self.scratch / "truth.json").write_text(json.dumps({"names": self.names, **truth}))
        self.collisions = truth["collisions"]
        for k, part in enumerate(truth["parts"]):
            if part["custody"] in ("arm", "fixture", "both"):
                self.taken.add(k)
                if k >= self.own:
                    self.wrong.add(k)
            if part["T_world_part"] is not None and self.start and k not in self.taken:
                now = np.array(part["T_world_part"])
                self.moved[k] = float(np.linalg.norm(now[:3, 3] - self.start[k][:3, 3]))


def most_moved(found: list[Words], how: tuple[str, ...]) -> float:
    """Return how far anything moved that was left alone, of the runs where the second lay so."""
    return max((c["moved_mm"] for c in found if c["second_one"] in how), default=0.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=seeds_of, default=seeds_of("921-926"))
    parser.add_argument("--speed", type=float, default=20.0)
    parser.add_argument("--lying", action="store_true", help="the second one falls on the first")
    parser.add_argument("--keep", type=Path, help="folder for the runs")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found = []
    for seed in args.seeds:
        with tempfile.TemporaryDirectory(prefix="sev-") as scratch:
            kept = args.keep / str(seed) if args.keep else Path(scratch)
            kept.mkdir(parents=True, exist_ok=True)
            case = Case(seed, args.speed, args.lying, kept).run()
        found.append(case)
        if not args.json:
            print(
                f"{seed}: {case['recipe']} {case['second_one']}, {len(case['objects'])} objects: "
                f"{case['sorted']} of {case['asked']} sorted {case['verdicts']}, {case['end']}; "
                f"wrong {case['wrong_parts_taken']}, collisions {case['collisions']}, left alone "
                f"moved {case['moved_mm']} mm {case['message']}",
                flush=True,
            )
    total = {
        "asked": sum(c["asked"] for c in found),
        "sorted": sum(c["sorted"] for c in found),
        "wrong_parts_taken": sum(c["wrong_parts_taken"] for c in found),
        "collisions": sum(c["collisions"] for c in found),
        "moved_apart_mm": most_moved(found, ("apart",)),
        "moved_touching_mm": most_moved(found, ("touching", "lying on the first")),
    }
    if args.json:
        print(json.dumps({"runs": found, "total": total}))
    else:
        print("  ".join(f"{name} {value}" for name, value in total.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
