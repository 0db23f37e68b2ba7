"""The page in Chromium beside a process that writes a journal as a cell does.

Measures the first paint, the delay from a journal's row to the text in a browser, and what page and
five browsers cost the writer: the lateness of its event loop, in blocks with and without them, one
after the other. In the last block the page is killed and started again.

The writer is no whole cell: it writes rows with the journal's own writer every 50 ms and has no
control socket.

With --cell N it is a whole emulated run, `cellctl run holder`, N times without the page and N times
beside it, by turns, each pair with one seed: `cellctl serve` on the run's own folder, whose history
has 100,000 parts; five clients that read the live stream of *Now* and two that ask for a page of
*History*, one a second. They are plain HTTP clients: what browsers compute to draw is no matter of
the cell's machine. In a last run the page is killed and started again. Per run: the seconds from
the part's first row to its last, the event loop's lateness (as bench_loop.py has it), and the CPU
seconds of run, compute service and emulated cell.

Usage: python benchmarks/bench_page.py [--json] [--block-s 20] [--blocks 3]
       python benchmarks/bench_page.py --cell 3 [--speed 10] [--parts 100000] [--json]
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import http.client
import json
import os
import resource
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import Any

import bench_history
import bench_loop
import numpy as np
from playwright.sync_api import Playwright, sync_playwright

from controller.cell.journal import JOURNAL_NAME, Journal, newest_run, read_rows, rows
from controller.config import load_cell
from controller.history import STORE_NAME, open_store

ROOT = Path(__file__).resolve().parents[1]
CELL = ROOT / "recipes" / "cells" / "emulated.yaml"
CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"]
BROWSER_COUNT = 5
HISTORY_COUNT = 2
HISTORY_EVERY_S = 1.0
KILLED_AFTER_S = 20.0
FIRST_SEED = 7101
TICK_S = 0.005
ROW_S = 0.05
WATCHED_S = 0.7  # between rows whose way to the browser is timed
LOOKS = 5
# Notes when each text of the counts was there; the page's policy allows no script of ours in it.
OBSERVE = """() => {
  window.seen = [];
  const counts = document.getElementById("counts");
  new MutationObserver(() => window.seen.push([counts.textContent, Date.now()]))
    .observe(counts, { childList: true, characterData: true, subtree: true });
}"""


async def write(runs: Path, seconds: float, first: int) -> dict[str, Any]:
    """Write rows for a time; return the loop's lateness [s] and when each part was done."""
    journal = Journal(runs / JOURNAL_NAME, "20261127-000000-000-bench")
    if first == 0:
        cell = load_cell(CELL).model_dump(mode="json")
        journal.write(rows.RunBegan(recipe={"name": "bench", "part": "none.stl"}, cell=cell))
    late_s: list[float] = []
    done: list[tuple[int, float]] = []
    next_row_s = next_done_s = time.monotonic()
    row_count = 0
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        began_s = time.monotonic()
        await asyncio.sleep(TICK_S)
        now_s = time.monotonic()
        late_s.append(now_s - began_s - TICK_S)
        if now_s >= next_row_s:
            next_row_s += ROW_S
            row_count += 1
            journal.write(rows.StepDone(label="a step", forecast_s=1.0, seconds=1.0), 1)
        if now_s >= next_done_s:
            next_done_s += WATCHED_S
            at_s = time.time()
            journal.write(rows.PartDone(verdict="pass", tray="accept"), 1)
            done.append((first + len(done) + 1, at_s))
    journal.close()
    late = np.array(late_s)
    return {
        "p99_ms": 1e3 * float(np.percentile(late, 99)),
        "max_ms": 1e3 * float(late.max()),
        "rows": row_count,
        "done": done,
    }


def writer(runs: Path, seconds: float, first: int) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, "--writer", str(runs), str(seconds)]
    return subprocess.Popen([*command, str(first)], stdout=subprocess.PIPE, text=True)


def result(process: subprocess.Popen[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(process.communicate()[0])
    return found


def serve(runs: Path, port: int) -> tuple[subprocess.Popen[str], str]:
    command = [sys.executable, "-m", "controller.cli", "serve", "--json", "--runs", str(runs)]
    page = subprocess.Popen(
        [*command, f"--port={port}"], stdout=subprocess.PIPE, text=True, cwd=runs.parent
    )
    assert page.stdout is not None
    link = json.loads(page.stdout.readline())["link"]
    while True:  # the link is printed before the port listens
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port)):
            return page, link
        time.sleep(0.05)


def open_browsers(playwright: Playwright, link: str) -> tuple[list[Any], Any]:
    """Return five browsers that look, and the tab of the first; the link logs in once."""
    browsers = [
        playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for _ in range(BROWSER_COUNT)
    ]
    tabs = [one.new_context(locale="en").new_page() for one in browsers]
    tabs[0].goto(link, timeout=120_000)
    cookies = tabs[0].context.cookies()
    for tab in tabs[1:]:
        tab.context.add_cookies(cookies)
        tab.goto(link.partition("/enter")[0] + "/now", timeout=120_000)
    return browsers, tabs[0]


def measure(block_s: float, block_count: int) -> dict[str, Any]:
    paints_ms: list[float] = []
    delays_ms: list[float] = []
    alone: list[dict[str, Any]] = []
    beside: list[dict[str, Any]] = []
    part_count = 0
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        runs = Path(folder) / "runs"
        runs.mkdir()
        result(writer(runs, 1.0, 0))  # the first row, and the first parts
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        for number in range(block_count + 1):
            is_last = number == block_count
            if not is_last:
                alone.append(result(writer(runs, block_s, 1)))
            page, link = serve(runs, port)
            try:
                browsers, tab = open_browsers(playwright, link)
                if number == 0:
                    for _ in range(LOOKS):
                        context = browsers[0].new_context(locale="en")
                        context.add_cookies(tab.context.cookies())
                        fresh = context.new_page()
                        fresh.goto(link.partition("/enter")[0] + "/now")
                        fresh.wait_for_selector("#state-name:not(:empty)")
                        paint = (
                            "performance.getEntriesByName('first-contentful-paint')[0].startTime"
                        )
                        paints_ms.append(fresh.evaluate(paint))
                        context.close()
                tab.wait_for_selector("#counts:not(:empty)", timeout=120_000)
                tab.evaluate(OBSERVE)
                part_count = int(tab.inner_text("#counts").rpartition(" ")[2].replace(",", ""))
                writing = writer(runs, block_s, part_count)
                if is_last:
                    time.sleep(block_s / 3)
                    os.kill(page.pid, signal.SIGKILL)
                    page.wait()
                    page, link = serve(runs, port)
                    tab.goto(link, timeout=120_000)
                    killed = result(writing)
                else:
                    block = result(writing)
                    tab.wait_for_timeout(1500)
                    seen = dict(reversed(tab.evaluate("window.seen")))  # when it was there first
                    for part, at_s in block["done"]:
                        at_ms = seen.get(f"PASS: {part}")
                        delays_ms.append(float("inf") if at_ms is None else at_ms - 1e3 * at_s)
                    beside.append(block)
                for one in browsers:
                    one.close()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    page.kill()
                page.wait()

    def middle(blocks: list[dict[str, Any]]) -> float:
        return statistics.median(one["p99_ms"] for one in blocks)

    rate = statistics.mean(one["rows"] for one in beside) / statistics.mean(
        one["rows"] for one in alone
    )
    return {
        "first_paint_ms": {"median": statistics.median(paints_ms), "max": max(paints_ms)},
        "delay_ms": {
            "count": len(delays_ms),
            "median": statistics.median(delays_ms),
            "p95": float(np.percentile(delays_ms, 95)),
        },
        "loop_p99_ms": {"alone": middle(alone), "five_browsers": middle(beside)},
        "rows_written_share": rate,
        "page_killed": {"loop_p99_ms": killed["p99_ms"], "rows": killed["rows"]},
        "load": os.getloadavg()[0],
    }


def run_part(runs: Path, seed: int, speed: float) -> dict[str, Any]:
    """Make a run in this process; return its loop's lateness, the part's seconds, CPU seconds."""
    asyncio.set_event_loop_policy(bench_loop.Policy())
    found = bench_loop.run_one("holder", seed, speed, runs)
    journal = runs / JOURNAL_NAME
    run = newest_run(journal)
    assert run is not None
    times = [row.t_utc for row in read_rows(journal, run) if row.part == 1]
    begin, end = (datetime.fromisoformat(times[k]) for k in (0, -1))
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return {
        "exit": found["exit"],
        "p99_ms": found["p99_ms"],
        "max_ms": found["max_ms"],
        "beats": found["beats"],
        "part_s": (end - begin).total_seconds(),
        "cpu_s": sum(one.ru_utime + one.ru_stime for one in used),
    }


class Clients:
    """Who looks at the page during a run, each in a thread of its own.

    Parameters
    ----------
    port, link : of the page; the link logs in once
    """

    def __init__(self, port: int, link: str) -> None:
        self._port = port
        line = http.client.HTTPConnection("127.0.0.1", port)
        line.request("GET", link.partition(str(port))[2])
        cookies = line.getresponse().headers.get_all("Set-Cookie") or []
        self._headers = {"Cookie": "; ".join(one.partition(";")[0] for one in cookies)}
        self._is_over = threading.Event()
        self.bytes_read = 0
        self.history_ms: list[float] = []
        threads = [threading.Thread(target=self._watch) for _ in range(BROWSER_COUNT)]
        threads += [threading.Thread(target=self._ask) for _ in range(HISTORY_COUNT)]
        self._threads = threads
        for one in threads:
            one.start()

    def end(self) -> None:
        """Hang up."""
        self._is_over.set()
        for one in self._threads:
            one.join()

    def _watch(self) -> None:
        line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=30)
        with contextlib.suppress(OSError, http.client.HTTPException):
            line.request("GET", "/now/events", headers=self._headers)
            reply = line.getresponse()
            while not self._is_over.is_set() and (found := reply.read1(65536)):
                self.bytes_read += len(found)
        line.close()

    def _ask(self) -> None:
        paths = ("/history", "/history?recipe=holder&sort=seconds", "/history?page=900")
        number = 0
        while not self._is_over.wait(HISTORY_EVERY_S):
            line = http.client.HTTPConnection("127.0.0.1", self._port, timeout=60)
            began_s = time.monotonic()
            with contextlib.suppress(OSError, http.client.HTTPException):
                line.request("GET", paths[number % len(paths)], headers=self._headers)
                reply = line.getresponse()
                reply.read()
                if reply.status == 200:
                    self.history_ms.append(1e3 * (time.monotonic() - began_s))
            line.close()
            number += 1


def beside_page(runs: Path, seed: int, speed: float, *, kills: bool) -> dict[str, Any]:
    """Make a run beside the page with its clients; return its figures."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    page, link = serve(runs, port)
    clients = Clients(port, link)
    try:
        running = run_apart(runs, seed, speed)
        if kills:
            time.sleep(KILLED_AFTER_S)
            page.kill()
            page.wait()
            page, _ = serve(runs, port)
        found = result(running)
    finally:
        page.terminate()
        clients.end()
        page.wait()
    used = {"history_ms": clients.history_ms, "stream_kb": clients.bytes_read / 1e3}
    return found | used


def run_apart(runs: Path, seed: int, speed: float) -> subprocess.Popen[str]:
    command = [sys.executable, __file__, "--run", str(runs), str(seed), str(speed)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)


def measure_cell(count: int, speed: float, part_count: int) -> dict[str, Any]:
    alone: list[dict[str, Any]] = []
    beside: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder) / "runs"
        runs.mkdir()
        store = open_store(f"sqlite:///{runs / STORE_NAME}")
        bench_history.stock(store, part_count)
        store.close()
        result(run_apart(runs, FIRST_SEED - 1, speed))  # fills the cache
        for seed in range(FIRST_SEED, FIRST_SEED + count):
            first_alone = seed % 2 == 0
            if first_alone:
                alone.append(result(run_apart(runs, seed, speed)))
            beside.append(beside_page(runs, seed, speed, kills=False))
            if not first_alone:
                alone.append(result(run_apart(runs, seed, speed)))
        killed = beside_page(runs, FIRST_SEED, speed, kills=True)
    return {"alone": alone, "beside": beside, "killed": killed, "load": os.getloadavg()}


def print_cell(found: dict[str, Any]) -> None:
    rows_ = (("part, wall s", "part_s"), ("loop late, p99 ms", "p99_ms"), ("CPU s", "cpu_s"))
    print("| what | without: median (each) | with: median (each) | of the pairs, median |")
    print("|---|---|---|---|")
    for words, key in rows_:
        sides = [[one[key] for one in found[side]] for side in ("alone", "beside")]
        more = statistics.median(b - a for a, b in zip(*sides, strict=True))
        each = [
            f"{statistics.median(one):.1f} ({', '.join(f'{v:.1f}' for v in one)})" for one in sides
        ]
        share = 100 * more / statistics.median(sides[0])
        print(f"| {words} | {each[0]} | {each[1]} | {more:+.1f} ({share:+.1f} %) |")
    asked = [ms for one in found["beside"] for ms in one["history_ms"]]
    p95 = np.percentile(asked, 95)
    print(f"| page of History, ms, median (p95) of {len(asked)} | | ", end="")
    print(f"{statistics.median(asked):.0f} ({p95:.0f}) | |")
    killed = found["killed"]
    print(f"| page killed and restarted: exit {killed['exit']}, p99 ms | | ", end="")
    print(f"{killed['p99_ms']:.1f} | |\nload {found['load']}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--block-s", type=float, default=20.0)
    parser.add_argument("--blocks", type=int, default=3)
    parser.add_argument("--cell", type=int, metavar="RUNS", help="whole runs of each kind")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--parts", type=int, default=100_000)
    parser.add_argument("--run", nargs=3, metavar=("RUNS", "SEED", "SPEED"))
    parser.add_argument("--writer", nargs=3, metavar=("RUNS", "SECONDS", "FIRST"))
    options = parser.parse_args()
    if options.writer:
        runs, seconds, first = options.writer
        print(json.dumps(asyncio.run(write(Path(runs), float(seconds), int(first)))))
        return
    if options.run:
        runs, seed, speed = options.run
        print(json.dumps(run_part(Path(runs), int(seed), float(speed))))
        return
    if options.cell:
        whole = measure_cell(options.cell, options.speed, options.parts)
        if options.json:
            print(json.dumps(whole))
        else:
            print_cell(whole)
        return
    found = measure(options.block_s, options.blocks)
    if options.json:
        print(json.dumps(found))
        return
    paint, delay, loop = found["first_paint_ms"], found["delay_ms"], found["loop_p99_ms"]
    print("| what | asked | measured |\n|---|---|---|")
    print(f"| first paint, median (max) of {LOOKS} | 1000 ms | ", end="")
    print(f"{paint['median']:.0f} ms ({paint['max']:.0f}) |")
    print(f"| journal's row to browser, p95 of {delay['count']} | 200 ms | ", end="")
    print(f"{delay['p95']:.0f} ms (median {delay['median']:.0f}) |")
    print("| lateness of the writer's loop, p99, alone | | ", end="")
    print(f"{loop['alone']:.1f} ms |")
    print(f"| the same with the page and {BROWSER_COUNT} browsers | +5 ms | ", end="")
    print(f"{loop['five_browsers']:.1f} ms |")
    print(
        f"| rows written with them, of those without | 99 % | {found['rows_written_share']:.1%} |"
    )
    print("| the same loop while the page is killed and restarted | | ", end="")
    print(f"{found['page_killed']['loop_p99_ms']:.1f} ms |")
    print(f"| load of the machine | | {found['load']:.1f} |")


if __name__ == "__main__":
    main()
