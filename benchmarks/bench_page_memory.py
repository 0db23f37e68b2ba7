"""Memory of the page over a shift: `cellctl serve`, followed by a browser while parts go by.

First a whole emulated run of each recipe. Then the rows of those runs are written into the journal
again and again, each time as a new run and a part in --part-s seconds, so that hours of a cell fit
into minutes of a machine. A client does what a browser with *Now* open does: it reads the live
stream, and fetches scene and mesh for each run and recipe and each picture once. In between it
looks at *Cell*, *History*, *Review*, *Recipes* and at the part that was done last, one request
every few seconds. Once a second the memory that a process shares with nobody (anonymous pages) is
read, of the page and of its process for drawing.

The first look at each screen loads libraries: growth that ends. What counts is the second half: its
slope is the median slope of all pairs of its minutes (Theil-Sen), given for an hour.

Usage: python benchmarks/bench_page_memory.py [--minutes 25] [--speed 10] [--part-s 10] [--json]
       python benchmarks/bench_page_memory.py --recorded RUNS ...  the runs of a folder, no new ones
       python benchmarks/bench_page_memory.py --part-s 0 ...       whole runs alone
"""

import argparse
import contextlib
import http.client
import json
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from itertools import combinations, cycle
from pathlib import Path
from typing import Any, Final, cast

from bench_page import serve

from controller.cell.journal import JOURNAL_NAME, Journal, Row, RowKind, read_rows

ROOT: Final = Path(__file__).resolve().parents[1]
RECIPES: Final = ("holder", "featuretype", "idler_riser")
LOOK_EVERY_S: Final = 5.0
SAMPLE_EVERY_S: Final = 1.0
MB: Final = 1e6


class Browser:
    """A browser with *Now* open, which looks at the other screens now and then.

    Parameters
    ----------
    port, link : of the page; the link logs in once
    """

    def __init__(self, port: int, link: str) -> None:
        self._port = port
        reply, _ = self._get(link.partition(str(port))[2])
        cookies = reply.headers.get_all("Set-Cookie") or []
        self._headers = {"Cookie": "; ".join(one.partition(";")[0] for one in cookies)}
        self._is_over = threading.Event()
        self._part = ("", 0)
        self.events = self.pictures = self.meshes = self.looks = 0
        self.failures: list[str] = []
        self._threads = [threading.Thread(target=one) for one in (self._follow, self._look)]
        for one in self._threads:
            one.start()

    def close(self) -> None:
        """Hang up."""
        self._is_over.set()
        for one in self._threads:
            one.join()

    def _get(self, path: str) -> tuple[http.client.HTTPResponse, bytes]:
        line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=120)
        try:
            line.request("GET", path, headers=getattr(self, "_headers", {}))
            reply = line.getresponse()
            return reply, reply.read()
        finally:
            line.close()

    def _fetch(self, path: str) -> None:
        try:
            reply, _ = self._get(path)
        except (OSError, http.client.HTTPException) as error:
            self.failures.append(f"{path}: {error}")
            return
        if reply.status not in (200, 404):  # what a run has not got yet is no failure
            self.failures.append(f"{path}: {reply.status}")

    def _events(self) -> Iterator[tuple[str, Any]]:
        line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=120)
        with contextlib.suppress(OSError, http.client.HTTPException):
            line.request("GET", "/now/events", headers=self._headers)
            kind = ""
            for text in line.getresponse():
                if self._is_over.is_set():
                    break
                name, _, value = text.decode().rstrip("\n").partition(": ")
                if name == "event":
                    kind = value
                elif name == "data":
                    yield kind, json.loads(value)
        line.close()

    def _follow(self) -> None:
        drawn: tuple[object, ...] = ()
        run, seen = "", set[int]()
        for kind, body in self._events():
            self.events += 1
            if kind != "now":
                continue
            if (about := body.get("run")) is not None:
                if about["run"] != run:
                    run, seen = about["run"], set()
                if drawn != (drawn := (run, about["recipe"])):
                    self.meshes += 1
                    self._fetch("/now/mesh")
                    self._fetch("/now/scene")
            for done in body.get("run.parts") or ():
                self._part = (run, done["part"])
            for view in body.get("run.views") or ():
                for one in view["pictures"][:1]:
                    if one["picture"] not in seen:
                        seen.add(one["picture"])
                        self.pictures += 1
                        self._fetch(f"/now/picture/{run}/{one['picture']}")

    def _look(self) -> None:
        screens = ("/history", "/cell/pictures", "part", "/cell", "/review", "/recipes/list")
        for screen in cycle(screens):
            if self._is_over.wait(LOOK_EVERY_S):
                return
            run, number = self._part
            path = f"/history/part/{run}/{number}" if screen == "part" else screen
            if number or screen != "part":
                self.looks += 1
                self._fetch(path)


def private_mb(pid: int) -> float | None:
    """Anonymous memory of a process [MB]; None where it has ended."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Anonymous:"):
                return int(line.split()[1]) * 1024 / MB
    return None


def children(pid: int) -> list[int]:
    """Processes that a process has started and that live."""
    with contextlib.suppress(OSError):
        tasks = Path(f"/proc/{pid}/task").iterdir()
        return [int(one) for task in tasks for one in (task / "children").read_text().split()]
    return []


class Memory:
    """Samples the memory of the page in a thread of its own.

    Parameters
    ----------
    pid : of the page
    """

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._is_over = threading.Event()
        self.samples: list[tuple[float, float, float]] = []  # s, MB of the page, MB of children
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        """Sample no more."""
        self._is_over.set()
        self._thread.join()

    def _run(self) -> None:
        began_s = time.monotonic()
        while not self._is_over.wait(SAMPLE_EVERY_S):
            own = private_mb(self._pid)
            if own is None:
                return
            others = sum(private_mb(one) or 0.0 for one in children(self._pid))
            at_s = time.monotonic() - began_s
            if not self.samples or at_s // 60 > self.samples[-1][0] // 60:
                print(f"minute {at_s // 60:.0f}: {own:.0f} MB", file=sys.stderr, flush=True)
            self.samples.append((at_s, own, others))


def minutes_of(samples: list[tuple[float, float, float]]) -> list[tuple[float, float]]:
    """Medians of each minute: of the page, and of its children [MB]."""
    by_minute: dict[int, list[tuple[float, float]]] = {}
    for at_s, own, others in samples:
        by_minute.setdefault(int(at_s // 60), []).append((own, others))
    return [
        (statistics.median(own for own, _ in one), statistics.median(other for _, other in one))
        for _, one in sorted(by_minute.items())
    ]


def slope_per_hour(values: list[float]) -> float:
    """Median slope of all pairs of minutes, for an hour; 0 for fewer than two."""
    pairs = combinations(enumerate(values), 2)
    slopes = [(after - before) / (m - n) for (n, before), (m, after) in pairs]
    return 60.0 * statistics.median(slopes) if slopes else 0.0


def judged(values: list[float]) -> dict[str, float]:
    """Begin, end, highest minute of the middle and the last third, slope of the second half."""
    third = max(1, len(values) // 3)
    return {
        "first": values[0],
        "last": values[-1],
        "middle_third_max": max(values[third : 2 * third] or values),
        "last_third_max": max(values[-third:]),
        "mb_per_hour": slope_per_hour(values[len(values) // 2 :]),
    }


def whole_run(runs: Path, recipe: str, part_count: int, seed: int, speed: float) -> int:
    """Make a run; return its exit code."""
    command = [sys.executable, "-m", "controller.cli", "run", f"recipes/{recipe}.yaml={part_count}"]
    command += ["--speed", f"{speed:g}", "--seed", str(seed), "--runs", str(runs), "--json"]
    quiet = subprocess.DEVNULL
    return subprocess.run(command, cwd=ROOT, stdout=quiet, stderr=quiet, check=False).returncode


def recorded(runs: Path) -> list[tuple[str, list[Row]]]:
    """Runs of a folder, with their rows."""
    found: dict[str, list[Row]] = {}
    for row in read_rows(runs / JOURNAL_NAME):
        found.setdefault(row.run, []).append(row)
    return list(found.items())


def write_again(runs: Path, name: str, old: Path, rows: list[Row], part_s: float) -> int:
    """Write the rows of a run as a new one; return how many parts it had."""
    (runs / name).symlink_to(old)
    part_count = max((row.part or 0 for row in rows), default=0)
    began_s, total_s = time.monotonic(), part_s * part_count
    journal = Journal(runs / JOURNAL_NAME, name)
    for number, row in enumerate(rows):
        journal.record(cast(RowKind, row.kind), row.name, row.body, row.part)
        time.sleep(max(0.0, began_s + total_s * number / len(rows) - time.monotonic()))
    journal.close()
    return part_count


def work(runs: Path, minutes: float, options: argparse.Namespace) -> dict[str, Any]:
    """Make whole runs, then write their rows again, until the time is over."""
    end_s = time.monotonic() + 60 * minutes
    codes: list[int] = []
    recipes = enumerate(cycle(RECIPES), 1)
    while options.recorded is None and time.monotonic() < end_s:
        if len(codes) == len(RECIPES) and options.part_s > 0:
            break
        seed, recipe = next(recipes)
        codes.append(whole_run(runs, recipe, options.parts, seed, options.speed))
    source = runs if options.recorded is None else options.recorded.resolve()
    part_count = 0
    for number, (run, rows) in enumerate(cycle(recorded(source))):
        if time.monotonic() >= end_s:
            break
        name = f"{time.strftime('%Y%m%d-%H%M%S')}-{number % 1000:03}-again"
        part_count += write_again(runs, name, source / run, rows, options.part_s)
    return {"whole_run_codes": codes, "parts_again": part_count}


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """Return the figures of a page that is followed for a time."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder) / "runs"
        runs.mkdir()
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        page, link = serve(runs, port)
        memory, browser = Memory(page.pid), Browser(port, link)
        try:
            done = work(runs, options.minutes, options)
        finally:
            memory.close()
            page.terminate()
            browser.close()
            page.wait()
    by_minute = minutes_of(memory.samples)
    return {
        "minutes": len(by_minute),
        **done,
        "client": {
            "events": browser.events,
            "pictures": browser.pictures,
            "meshes": browser.meshes,
            "looks": browser.looks,
            "failures": browser.failures,
        },
        "page_mb": judged([own for own, _ in by_minute]),
        "child_mb": judged([other for _, other in by_minute]),
        "by_minute_mb": [[round(one, 1) for one in pair] for pair in by_minute],
        "load": os.getloadavg()[0],
    }


def print_table(found: dict[str, Any]) -> None:
    """Print the figures as a table."""
    client = found["client"]
    print(
        f"{found['minutes']} minutes; whole runs ended with {found['whole_run_codes']}, "
        f"{found['parts_again']} parts written again"
    )
    print(
        f"client: {client['events']} events, {client['pictures']} pictures, {client['meshes']} "
        f"meshes, {client['looks']} looks at other screens, {len(client['failures'])} failures"
    )
    print("| private memory, MB | first minute | middle third | last third | MB in an hour |")
    print("|---|---|---|---|---|")
    for words, key in (("the page", "page_mb"), ("its process for drawing", "child_mb")):
        one = found[key]
        print(
            f"| {words} | {one['first']:.0f} | {one['middle_third_max']:.0f} | "
            f"{one['last_third_max']:.0f} | {one['mb_per_hour']:+.0f} |"
        )
    print(f"load {found['load']:.1f}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=25.0)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--parts", type=int, default=3, help="in each whole run")
    parser.add_argument("--part-s", type=float, default=10.0, help="of a part written again")
    parser.add_argument("--recorded", type=Path, metavar="RUNS", help="folder of runs to write")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(options)
    if options.json:
        print(json.dumps(found))
    else:
        print_table(found)


if __name__ == "__main__":
    main()
