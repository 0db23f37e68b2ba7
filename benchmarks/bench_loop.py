"""How long the controller's event loop keeps anything waiting, in whole runs with pictures.

    python benchmarks/bench_loop.py [--recipes holder featuretype] [--seed N] [--speed X] [--json]

A beat every 5 ms on the run's own loop; its delay is what any event would have waited. Beside each
delay above 50 ms stands what the loop ran last. Each run is a `cellctl run` in this process. On a
machine that is busy with other programs the delays are theirs as well: compare with --idle, which
beats on an empty loop for so many seconds.
"""

import asyncio
import contextlib
import io
import logging
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from bench import Arguments, show

from controller.cli.app import main as cellctl

BEAT_S = 0.005
LIMIT_S = 0.050
SLOW = "Executing "


class Beat:
    """Beats on a loop and keeps how late each beat was [s]."""

    def __init__(self) -> None:
        self.delays_s: list[float] = []
        self._due_s = 0.0

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        self._due_s = loop.time() + BEAT_S
        loop.call_at(self._due_s, self._beat, loop)

    def _beat(self, loop: asyncio.AbstractEventLoop) -> None:
        self.delays_s.append(loop.time() - self._due_s)
        self.start(loop)


class BeatingLoop(asyncio.SelectorEventLoop):
    """A loop that beats from its first turn on, and names what runs for too long."""

    beat: Beat

    def run_forever(self) -> None:
        self.set_debug(True)  # it logs every callback that takes longer than the limit
        self.slow_callback_duration = LIMIT_S
        type(self).beat.start(self)
        super().run_forever()


class Policy(asyncio.DefaultEventLoopPolicy):
    """Makes beating loops."""

    _loop_factory = BeatingLoop


class Slow(logging.Handler):
    """Keeps what asyncio says of slow callbacks."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text.startswith(SLOW):
            what = text.removeprefix(SLOW)
            self.found.append(f"{what[-14:]}: {what[:90]}")


def run_one(recipe: str, seed: int, speed: float, runs: Path) -> dict[str, Any]:
    """Make one run and return the delays of its loop."""
    BeatingLoop.beat, slow = Beat(), Slow()
    log = logging.getLogger("asyncio")
    log.setLevel(logging.WARNING)  # whatever the command sets for the others
    log.addHandler(slow)
    arguments = [
        "run", recipe, "--seed", str(seed), "--speed", f"{speed:g}", "--runs", str(runs), "--json",
    ]  # fmt: skip
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            code = cellctl(arguments)
        except SystemExit as end:
            code = end.code
    log.removeHandler(slow)
    return {"recipe": recipe, "exit": code, **figures(BeatingLoop.beat), "slow": slow.found}


def figures(beat: Beat) -> dict[str, Any]:
    """Return quantiles of the delays [ms]."""
    late = 1e3 * np.array(beat.delays_s)
    p50, p99, p999 = (round(float(v), 1) for v in np.quantile(late, [0.5, 0.99, 0.999]))
    return {
        "beats": len(late),
        "p50_ms": p50,
        "p99_ms": p99,
        "p999_ms": p999,
        "max_ms": round(float(late.max()), 1),
        "above_50_ms": int((late > 1e3 * LIMIT_S).sum()),
    }


async def _idle(seconds: float, beat: Beat) -> None:
    beat.start(asyncio.get_running_loop())
    await asyncio.sleep(seconds)


def main() -> int:
    parser = Arguments(__doc__, recipes=["holder"], speed=10.0, idle=1.0)
    parser.add_argument("--recipes", nargs="*", default=["holder", "featuretype"])
    parser.add_argument("--seed", type=int, default=6001)
    parser.add_argument("--speed", type=float, default=5.0)
    parser.add_argument("--idle", type=float, default=10.0, help="seconds on an empty loop first")
    args = parser.parse_args()
    started, beat = time.monotonic(), Beat()
    asyncio.run(_idle(args.idle, beat))
    rows: list[dict[str, Any]] = [{"recipe": "(idle)", "exit": 0, **figures(beat), "slow": []}]
    asyncio.set_event_loop_policy(Policy())
    with tempfile.TemporaryDirectory() as folder:
        for number, recipe in enumerate(args.recipes):
            rows.append(run_one(recipe, args.seed + number, args.speed, Path(folder)))
    show(args, rows, {"wall s": time.monotonic() - started})
    return int(any(row["exit"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
