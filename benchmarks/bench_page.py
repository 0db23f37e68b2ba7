"""The page in Chromium beside a process that writes a journal as a cell does.

Measures the first paint, the delay from a journal's row to the text in a browser, and what page and
five browsers cost the writer: the lateness of its event loop, in blocks with and without them, one
after the other. In the last block the page is killed and started again.

The writer is no whole cell: it writes rows with the journal's own writer every 50 ms and has no
control socket.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from bench import EMULATED, Arguments, leave_out, need_module, show

from controller.cell.journal import JOURNAL_NAME, Journal, rows
from controller.config import load_cell

if TYPE_CHECKING:
    from playwright.sync_api import Playwright

CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"]
BROWSER_COUNT = 5
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
        cell = load_cell(EMULATED).model_dump(mode="json")
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
    from playwright.sync_api import sync_playwright

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


def main() -> int:
    parser = Arguments(__doc__, block_s=3.0, blocks=1)
    parser.add_argument("--block-s", type=float, default=20.0)
    parser.add_argument("--blocks", type=int, default=3)
    parser.add_argument("--writer", nargs=3, metavar=("RUNS", "SECONDS", "FIRST"))
    args = parser.parse_args()
    if args.writer:
        runs, seconds, first = args.writer
        print(json.dumps(asyncio.run(write(Path(runs), float(seconds), int(first)))))
        return 0
    if not Path(CHROMIUM).is_file():
        leave_out(f"needs Chromium at {CHROMIUM}")
    need_module("playwright")
    found = measure(args.block_s, args.blocks)
    paint, delay, loop = found["first_paint_ms"], found["delay_ms"], found["loop_p99_ms"]
    rows_ = [
        {"what": f"first paint, median of {LOOKS}, ms", "asked": 1000, "is": paint["median"]},
        {"what": "from the row to the browser, p95, ms", "asked": 200, "is": delay["p95"]},
        {"what": "writer's loop late, p99, alone, ms", "asked": None, "is": loop["alone"]},
        {"what": f"with the page and {BROWSER_COUNT} browsers, ms",
         "asked": loop["alone"] + 5, "is": loop["five_browsers"]},
        {"what": "while the page is killed and started, ms", "asked": None,
         "is": found["page_killed"]["loop_p99_ms"]},
    ]  # fmt: skip
    show(args, rows_, {"rows written, of those without": found["rows_written_share"],
                       "load": found["load"]})  # fmt: skip
    return int(any(row["asked"] is not None and row["is"] > row["asked"] for row in rows_))


if __name__ == "__main__":
    sys.exit(main())
