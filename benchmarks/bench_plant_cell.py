"""Whole runs of the emulated cell in a plant: the bridge's cost in a cycle, and an order's start.

    python benchmarks/bench_plant_cell.py                  two pairs of runs, three pairs of starts
    python benchmarks/bench_plant_cell.py --pairs 0 --starts 10

*Cycle.* Runs of the same recipe, seed and number of parts, one with no bridge and one beside
`cellctl connect` with every wire of `bench_plant.py` and a receiver at each, in turn. A part's
cycle is the time of the cell's clock between two parts that are done; the first begins with the
start of the work. That clock waits while the machine is late, so the machine's load is not in it;
a wait of the run for a lock, a disk or a reply is. The pace is a real cell's (`--speed`): where
pictures are the bottleneck, as at ten times that, whatever else runs decides. Beside it the share
of a core that the bridge takes meanwhile.

*First motion.* The same cell and recipe, ordered in turn by the page (`POST /now/start`, as the
browser does) and by `PUT /api/v1/orders/...` to a bridge that may start runs: wall seconds from the
request until the row that permits the run to move, with which it homes. The run is stopped then.
"""

from __future__ import annotations

import base64
import json
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from datetime import UTC, datetime
from http import HTTPStatus
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any, NamedTuple
from urllib.error import HTTPError
from urllib.request import HTTPCookieProcessor, Request, build_opener, urlopen

import numpy as np
from bench import EMULATED, Arguments, note, show
from bench_plant import PASSWORD, Connected, connected, cpu_s, free_port, wait_open

ASKED_MORE = 0.005  # of a cycle
START_SPEED = 10.0  # of the runs that are stopped as they begin to move
SEED = "11"
LIMIT_WALL_S = 3600.0  # a guard against a hang, no measure
RECIPE = "holder"
TOLD = ("webhook", "folder", "rest")


class Series(NamedTuple):
    """Parts run one after the other, and at how many times a real cell's pace."""

    parts: int
    speed: float


def rows_of(journal: Path, run: str, *names: str) -> list[tuple[str, datetime, dict[str, Any]]]:
    """Return rows of a run: name, time and body."""
    if not journal.exists():
        return []
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as db:
        query = "SELECT name, t_utc, body FROM journal WHERE run = ? ORDER BY seq"
        found = db.execute(query, (run,)).fetchall()
    return [
        (name, datetime.fromisoformat(at), json.loads(body))
        for name, at, body in found
        if name in names
    ]


def runs_in(journal: Path) -> set[str]:
    """Return the runs that a journal has begun."""
    if not journal.exists():
        return set()
    with closing(sqlite3.connect(f"file:{journal}?mode=ro", uri=True)) as db:
        try:
            found = db.execute("SELECT run FROM journal WHERE name = 'run_began'").fetchall()
        except sqlite3.OperationalError:  # just being made
            return set()
        return {run for (run,) in found}


def cycles_s(folder: Path, of: Series, environment: dict[str, str] | None) -> list[float]:
    """Run some parts; return the cycle of each [cell s]."""
    runs = folder / "runs"
    before = runs_in(runs / "journal.sqlite")
    subprocess.run(
        [sys.executable, "-m", "controller.cli", "run", RECIPE, "--cell", str(folder / "cell.yaml"),
         "--runs", str(runs), "--count", str(of.parts), "--speed", f"{of.speed:g}", "--seed", SEED,
         "--json"],
        stdout=subprocess.DEVNULL, check=True, env=environment, cwd=folder, timeout=LIMIT_WALL_S,
    )  # fmt: skip
    (run,) = runs_in(runs / "journal.sqlite") - before
    found = rows_of(runs / "journal.sqlite", run, "start", "part_done")
    ends = [body["cell_s"] for _, _, body in found]
    return [float(one) for one in np.diff(ends)]


def cycle(pair: int, of: Series) -> dict[str, Any]:
    """Return the mean cycle of a run beside a bridge, and of one without [cell s]."""

    def beside() -> dict[str, Any]:
        with ExitStack() as stack:
            bridge = connected(stack, "--from-start")
            used_s, began_s = cpu_s(bridge.pid), time.monotonic()
            found = cycles_s(bridge.folder, of, bridge.environment)
            share = (cpu_s(bridge.pid) - used_s) / (time.monotonic() - began_s)
            until(lambda: all(len(bridge.arrivals.at.get(w, {})) == of.parts for w in TOLD))
            return {"on_s": float(np.mean(found)), "bridge_cpu_share": round(share, 4)}

    def alone() -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            shutil.copy(EMULATED, folder / "cell.yaml")
            return {"off_s": float(np.mean(cycles_s(folder, of, None)))}

    of_pair: dict[str, Any] = {"pair": pair}
    for one in (alone, beside) if pair % 2 else (beside, alone):  # neither is always first
        of_pair |= one()
    of_pair["more"] = round(of_pair["on_s"] / of_pair["off_s"] - 1.0, 5)
    note(of_pair)
    return of_pair


class Page:
    """The page as a browser uses it.

    Parameters
    ----------
    stack : ends its server
    bridge : the same folder of runs and cell file
    """

    def __init__(self, stack: ExitStack, bridge: Connected) -> None:
        port = free_port()
        self.origin = f"http://127.0.0.1:{port}"
        served = subprocess.Popen(
            [sys.executable, "-m", "controller.cli", "serve", f"--runs={bridge.runs}",
             f"--port={port}", "--json"],
            stdout=subprocess.PIPE, env=bridge.environment, cwd=bridge.folder,
        )  # fmt: skip
        stack.callback(served.wait)
        stack.callback(served.send_signal, signal.SIGTERM)
        assert served.stdout is not None
        link = json.loads(served.stdout.readline())["link"]
        wait_open(port)
        self._open = build_opener(HTTPCookieProcessor(CookieJar())).open
        self._open(link).close()
        with self._open(f"{self.origin}/now") as answer:
            found = re.search(r'name="csrf" content="([^"]+)"', answer.read().decode())
        assert found is not None
        self._csrf = found[1]

    def start(self, _: int) -> None:
        """Start a run as the button does."""
        order = {
            "recipes": [{"recipe": RECIPE}], "cell": "cell.yaml", "speed": START_SPEED,
            "seed": int(SEED),
        }  # fmt: skip
        headers = {
            "Origin": self.origin, "X-CSRF-Token": self._csrf, "Content-Type": "application/json",
        }  # fmt: skip
        sent = Request(f"{self.origin}/now/start", json.dumps(order).encode(), headers)
        self._open(sent).close()


class Plant:
    """A plant system that gives orders by REST."""

    def __init__(self, bridge: Connected) -> None:
        self._url = f"http://127.0.0.1:{bridge.rest}/api/v1"
        self._account = base64.b64encode(f"bench:{PASSWORD}".encode()).decode()

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        """Send a request; return the answer."""
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Basic {self._account}"}
        with urlopen(Request(self._url + path, data, headers, method=method)) as answer:
            found: dict[str, Any] = json.load(answer)
        return found

    def start(self, number: int) -> None:
        """Order one part."""
        self.ask("PUT", f"/orders/B-{number}", {"recipe": RECIPE})


def first_motion(starts: int) -> list[dict[str, Any]]:
    """Return the seconds from an order to the permit to move, by page and by REST in turn."""
    if not starts:
        return []
    with ExitStack() as stack:
        bridge = connected(stack, f"--speed={START_SPEED:g}", f"--seed={SEED}")
        page, plant = Page(stack, bridge), Plant(bridge)
        journal = bridge.runs / "journal.sqlite"

        def is_free() -> bool:
            return bool(plant.ask("GET", "/state")["state"] == "free")

        def moved_s(start: Callable[[int], None], number: int) -> float:
            before, began = runs_in(journal), None
            while began is None:
                began = datetime.now(UTC)
                try:
                    start(number)
                except HTTPError as error:
                    if error.code != HTTPStatus.CONFLICT:
                        raise
                    began = None  # whoever starts has not seen the end of the last run yet
                    time.sleep(0.2)
            until(lambda: bool(runs_in(journal) - before))
            (run,) = runs_in(journal) - before
            until(lambda: bool(rows_of(journal, run, "permit_issued")))
            _, at, _ = rows_of(journal, run, "permit_issued")[0]
            subprocess.run(
                [sys.executable, "-m", "controller.cli", "stop", f"--runs={bridge.runs}"],
                stdout=subprocess.DEVNULL, check=True, env=bridge.environment,
            )  # fmt: skip
            until(is_free)
            return round((at - began).total_seconds(), 2)

        found: list[dict[str, Any]] = []
        for number in range(starts):
            ways = [("page_s", page.start), ("rest_s", plant.start)]
            of_pair = {"start": number + 1}
            for name, start in ways if number % 2 else ways[::-1]:
                of_pair[name] = moved_s(start, number)
            note(of_pair)
            found.append(of_pair)
        return found


def until(is_so: Callable[[], bool]) -> None:
    """Wait until something is so, within a time."""
    end_s = time.monotonic() + LIMIT_WALL_S
    while not is_so():
        if time.monotonic() > end_s:
            raise TimeoutError("waited in vain")
        time.sleep(0.05)


def main() -> int:
    parser = Arguments(__doc__, pairs=0, starts=1)
    parser.add_argument("--pairs", type=int, default=2, help="runs without and with a bridge")
    parser.add_argument("--parts", type=int, default=2, help="parts of each run")
    parser.add_argument("--speed", type=float, default=1.0, help="of these runs")
    parser.add_argument("--starts", type=int, default=3, help="starts by page and by REST")
    args = parser.parse_args()
    cycles = [cycle(pair + 1, Series(args.parts, args.speed)) for pair in range(args.pairs)]
    starts = first_motion(args.starts)
    figures: dict[str, Any] = {}
    if cycles:
        figures["cycle more with all wires"] = float(np.mean([one["more"] for one in cycles]))
        offs_s = [one["off_s"] for one in cycles]
        # what the machine's other work makes of it: a smaller difference is not to be seen
        figures["runs without a bridge differ by"] = round(max(offs_s) / min(offs_s) - 1.0, 5)
        shares = [one["bridge_cpu_share"] for one in cycles]
        figures["bridge's share of a core"] = float(np.mean(shares))
    if starts:
        for name in ("page_s", "rest_s"):
            median_s = float(np.median([one[name] for one in starts]))
            figures[f"order to first motion, {name}"] = round(median_s, 2)
    show(args, [*cycles, *starts], figures)
    return int(figures.get("cycle more with all wires", 0.0) > ASKED_MORE)


if __name__ == "__main__":
    sys.exit(main())
