"""A shift on the emulated cell, one command: is each part sorted right, without help?

    python benchmarks/bench_shift.py [--parts 12] [--seed 901] [--speed 2] [--json]

Parts of four recipes lie in random poses, up to five at once, strangers (3 %, at least one) and
defective ones (5 %, at least one) among them. Once the last part of a lot is off the table, the
next five come. Judged by the emulated world's truth alone: which part the arm had, and in which
tray it ended. A good part has to be accepted, a defective one rejected, a stranger left where it
is; what goes to quarantine, and what a person is called for, is not sorted. A part that rolls off
the light table as it is laid is laid again. With it: seconds a part
against the forecast, what the arm's time went into, and how late the controller's event loop was.
A busy machine makes the arm wait for the worker process, which itself waits for a processor: how
long it did is measured (/proc/PID/schedstat), and what the arm's share would be without that is
estimated.
Seeds below 900 are there to develop with.
"""

import contextlib
import json
import math
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bench import ROOT, Arguments, show
from inspection_truth import lower_limit
from kill_world import ask
from shift_parts import RECIPES, ShiftPart, is_on_table, make_parts, spots_for

from controller.cell.control import AnswerOrder, ControlError, RunningCell
from controller.cell.journal import JOURNAL_NAME, read_rows_named, rows
from controller.results.takt import grouped, takt_json, takt_line, takts_of

AT_ONCE = 5
LIMIT_WALL_S = 4 * 3600.0
FIRST_SERIAL = "SH001"
ON_TABLE = ("no_part", "many_parts", "unknown_object", "part_cut_off", "wrong_part", "no_plan")
MOST_CALLS = 20
MOVED_MM = 3.0  # what was left alone may have been brushed by so much
Words = dict[str, Any]


def run_beside(
    command: Sequence[str],
    log: Path,
    limit_wall_s: float,
    person: Callable[[threading.Event], None],
) -> dict[str, Any]:
    """Make one run with `--json`, and let a person look at it and act all the while.

    Parameters
    ----------
    command : of the run
    log : file for what it prints as errors
    limit_wall_s : it is killed after so long
    person : called in a thread of its own, with what is set at its end

    Returns
    -------
    the run's result; empty where it printed none
    """
    result: dict[str, Any] = {}
    has_ended = threading.Event()
    with log.open("w") as errors:
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=errors, text=True
        )
    limit = threading.Timer(limit_wall_s, process.kill)
    limit.start()
    beside = threading.Thread(target=person, args=(has_ended,))
    beside.start()
    assert process.stdout is not None
    for line in process.stdout:
        body = json.loads(line)
        if body["event"] == "result":
            result = body
    process.wait()
    has_ended.set()
    beside.join()
    limit.cancel()
    return result


class Shift:
    """One run of `cellctl run`, fed with parts, and what the world says of it."""

    def __init__(
        self, count: int, seed: int, speed: float, recipes: tuple[str, ...], folder: Path
    ) -> None:
        self.rng = np.random.default_rng(seed)
        self.seed, self.speed, self.recipes, self.folder = seed, speed, recipes, folder
        self.parts = make_parts(count, recipes, self.rng, folder)
        self.control, self.runs = folder / "control.sock", folder / "runs"
        self.waiting = list(range(len(self.parts)))  # not on the table yet
        self.first: dict[int, np.ndarray] = {}  # where each part came to rest
        self.moved_mm: dict[int, float] = {}
        self.trays: dict[int, str] = {}  # by number in `parts`
        self.held: list[int] = []  # numbers in `parts`, in the order they were taken
        self.collisions = 0
        self.laid_again = 0  # parts that came to rest off the light table
        self.calls: list[str] = []  # what a person was asked
        self.taken_away: list[int] = []
        self.is_fed = False  # something was laid since the last answer
        self.result: Words = {}
        self.labels: dict[int, tuple[str, str]] = {}

    def command(self) -> list[str]:
        """Return the one command of the shift."""
        counts = Counter(part.recipe for part in self.parts if part.recipe)
        command = [sys.executable, "-m", "controller.cli", "run"]
        command += [f"recipes/{name}.yaml={counts[name]}" for name in self.recipes if counts[name]]
        command += ["--serial-from", FIRST_SERIAL]
        command += ["--wait", "--json", "--speed", f"{self.speed:g}", "--seed", str(self.seed)]
        command += ["--empty"]
        command += ["--runs", str(self.runs), "--control", str(self.control)]
        return command

    def run(self) -> None:
        """Make the run; feed the table and look at the world all the while."""
        self.result = run_beside(
            self.command(), self.folder / "stderr.txt", LIMIT_WALL_S, self._feed_and_look
        )

    def _feed_and_look(self, has_ended: threading.Event) -> None:
        while not has_ended.wait(0.3):
            with contextlib.suppress(OSError, ValueError, KeyError):
                truth = ask(self.control, "truth")
                if truth["ok"]:
                    for part in self.parts[len(truth["parts"]) :]:
                        ask(self.control, "add", file=str(part.file))
                    self._look(truth)
                    self._feed(truth)
                    with contextlib.suppress(ControlError):
                        self._answer(truth)

    def _look(self, truth: Words) -> None:
        self.collisions = len(truth["collisions"])
        # between two looks a part may be laid into a tray and taken out of it
        self.trays |= {e["part"]: e["by"] for e in truth["events"] if e["what"] == "emptied"}
        for k, part in enumerate(truth["parts"][: len(self.parts)]):
            if part["custody"] in ("arm", "fixture", "both"):
                if not self.held or self.held[-1] != k:
                    self.held.append(k)
                continue
            if part["tray"] is not None and k in self.held:
                self.trays[k] = part["tray"]
            elif part["T_world_part"] is not None and k not in self.held:
                at = np.array(part["T_world_part"])[:3, 3]
                if part["at_rest"]:
                    self.first.setdefault(k, at)
                if k in self.first:
                    self.moved_mm[k] = float(np.linalg.norm(at - self.first[k]))

    def _answer(self, truth: Words) -> None:
        """Answer as who brings the parts: lay the next lot, take away what was not taken."""
        cell = RunningCell(self.runs)
        question = cell.status().question
        if question is None:
            return
        if question.code in ON_TABLE and not self.is_fed and self.waiting:
            for k in self._lying(truth):
                self.taken_away.append(k)
                ask(self.control, "remove", part=k)
            return  # the next lot is laid before the answer
        can_go_on = self.is_fed or (question.code not in ON_TABLE and len(self.calls) < MOST_CALLS)
        self.calls.append(question.code)
        self.is_fed = False
        key = "look" if can_go_on else "stop"
        cell.order("answer", AnswerOrder(key=key, number=question.number))

    def _lying(self, truth: Words) -> list[int]:
        return [
            k
            for k, part in enumerate(truth["parts"][: len(self.parts)])
            if part["custody"] == "free" and part["tray"] is None
        ]

    def _feed(self, truth: Words) -> None:
        """Lay the next lot once only strangers are left of the last one, and the arm is empty.

        Nobody reaches into a cell that moves: the door would end the run.
        """
        if any(part["custody"] in ("arm", "fixture", "both") for part in truth["parts"]):
            return
        for k, part in enumerate(truth["parts"][: len(self.parts)]):
            if k in self.held or k in self.waiting or not part["at_rest"]:
                continue
            at = part["T_world_part"]
            if at is not None and not is_on_table(at[0][3], at[1][3]):
                self.waiting.append(k)  # it rolled away as it was laid
                self.first.pop(k, None)
                self.laid_again += 1
                ask(self.control, "remove", part=k)
        lying = self._lying(truth)
        if not self.waiting or any(self.parts[k].recipe for k in lying):
            return
        # the strangers of earlier lots are taken away, as whoever brings parts does
        for k in lying:
            ask(self.control, "remove", part=k)
        lot = self.waiting[:AT_ONCE]
        spots = spots_for([self.parts[k] for k in lot], self.rng)
        for k, spot in zip(lot, spots, strict=True):
            if spot is not None:
                self.waiting.remove(k)
                turn = math.degrees(self.rng.uniform(0.0, math.tau))
                ask(self.control, "drop", part=k, x_mm=spot[0], y_mm=spot[1], theta_deg=turn)
                self.is_fed = True

    def figures(self) -> Words:
        """Return what came of the shift."""
        verdicts = {p["part"]: p for p in self.result.get("parts", [])}
        took = list(dict.fromkeys(self.held))  # a part that was dropped and taken again is one
        # the cell counts the parts it takes; the world says which ones those were
        self.labels = labels_of(self.runs / JOURNAL_NAME)
        told = {k: verdicts.get(number) for number, k in enumerate(took, start=1)}
        each = [self._part(k, told.get(k)) for k in range(len(self.parts))]
        serials = [one["serial"] for one in each if one["serial"]]
        good = sum(one["is_right"] for one in each)
        takts = list(takts_of(self.runs))
        (group,) = grouped(takts, "run")
        late = [
            rows.LoopLate.model_validate(row.body).longest_s
            for row in read_rows_named(self.runs / JOURNAL_NAME, [rows.LoopLate.row_name])
        ]
        return {
            "seed": self.seed,
            "speed": self.result.get("speed"),
            "end": self.result.get("end", "none"),
            "message": self.result.get("message", ""),
            "n": len(each),
            "strangers": sum(not part.recipe for part in self.parts),
            "defective": sum(bool(part.defect) for part in self.parts),
            "sorted_right": good,
            "sorted_right_share": round(good / len(each), 4),
            "at_least_95": round(lower_limit(good, len(each)), 3),
            "wrong_pass": sum(one["is_wrong_pass"] for one in each),
            # a number that two parts have is of the wrong one at least once
            "mixed_up": sum(one["is_mixed_up"] for one in each) + len(serials) - len(set(serials)),
            "serials": len(serials),
            "collisions": self.collisions,
            "laid_again": self.laid_again,
            "calls": self.calls,
            "taken_away": self.taken_away,
            "takt": takt_json(group),
            "line": takt_line(group),
            "longest_late_s": max(late, default=0.0),
            "parts": each,
        }

    def _part(self, k: int, told: Words | None) -> Words:
        part: ShiftPart = self.parts[k]
        tray = self.trays.get(k, "")
        said = "" if told is None else (told["tray"] or "")
        recipe, serial = self.labels.get(0 if told is None else told["part"], ("", ""))
        is_right = tray == part.right_tray
        if not part.recipe:
            is_right = k not in self.held and self.moved_mm.get(k, 0.0) <= MOVED_MM
        return {
            "number": k,
            "recipe": part.recipe or "stranger",
            "defect": part.defect,
            "tray": tray,
            "verdict": None if told is None else told["verdict"],
            "reasons": [] if told is None else told["reasons"][:2],
            "recoveries": [] if told is None else told["recoveries"],
            "is_right": is_right,
            "is_wrong_pass": tray == "accept" and bool(part.defect or not part.recipe),
            # what the cell says of it is of another part
            "is_mixed_up": told is not None and (said != tray or recipe != part.recipe),
            "serial": serial,
            "was_laid": k not in self.waiting,
        }


def labels_of(journal: Path) -> dict[int, tuple[str, str]]:
    """Return recipe and serial number of each part by its number, as the journal has them."""
    found = {}
    for row in read_rows_named(journal, [rows.PartIdentified.row_name]):
        body = rows.PartIdentified.model_validate(row.body)
        found[row.part or 0] = (body.name, body.serial)
    return found


def main() -> int:
    parser = Arguments(__doc__, parts=1, speed=10.0, recipes="holder")
    parser.add_argument("--parts", type=int, default=12)
    parser.add_argument("--seed", type=int, default=901)
    parser.add_argument("--speed", type=float, default=2.0)
    parser.add_argument("--recipes", default=",".join(RECIPES), help="names, separated by commas")
    parser.add_argument("--keep", type=Path, help="folder that runs and files are left in")
    args = parser.parse_args()
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="shift-") as scratch:
        folder = args.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        recipes = tuple(args.recipes.split(","))
        shift = Shift(args.parts, args.seed, args.speed, recipes, folder.resolve())
        shift.run()
        found = {**shift.figures(), "wall_s": round(time.monotonic() - began, 1)}
    parts = found.pop("parts")
    show(args, parts, found)
    return int(found["sorted_right"] != found["n"])


if __name__ == "__main__":
    sys.exit(main())
