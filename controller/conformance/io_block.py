"""Requirements on every I/O block."""

from __future__ import annotations

import asyncio
from typing import Any, Final

from drivers.kinds import Signal

from . import _common
from .requirement import (
    MeasuredFigure,
    Requirement,
    TestBench,
    naming,
    require,
    require_refused,
    timed,
)

POLL_SLACK: Final = 5  # polls until a reading has been debounced, and one to spare


async def _known(bench: TestBench) -> None:
    """Wait until every input is known."""
    device, names = bench.device, bench.facts["inputs"]
    while any(device.signal(name) is Signal.UNKNOWN for name in names):
        await bench.clock.sleep(bench.bounds.poll_s / 2)


async def _usable(bench: TestBench) -> None:
    await timed(bench, bench.bounds.answer_s, _known(bench), "inputs")


async def _inputs(bench: TestBench) -> MeasuredFigure:
    await bench.opened()
    limit_s = bench.bounds.stale_s + POLL_SLACK * bench.bounds.poll_s
    took_s = await timed(bench, limit_s, _known(bench), "known inputs")
    return MeasuredFigure(
        took_s * 1e3,
        "ms",
        bench.clock.patience_s(limit_s) * 1e3,
        ", ".join(f"{name} {bench.device.signal(name).value}" for name in bench.facts["inputs"]),
    )


async def _limits(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()

    async def signal() -> None:
        device.signal("no such input")

    await require_refused(bench, "signal('no such input')", signal)
    await require_refused(
        bench, "wait_for('no such input')", lambda: device.wait_for("no such input", Signal.OK)
    )
    return MeasuredFigure(remark="2 values")


async def _stale(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await _known(bench)
    names = bench.facts["inputs"]

    async def forgotten() -> None:
        while any(device.signal(name) is not Signal.UNKNOWN for name in names):
            await bench.clock.sleep(bench.bounds.poll_s / 2)

    limit_s = bench.bounds.stale_s + bench.bounds.poll_s
    await bench.line.silence()
    try:
        took_s = await timed(bench, limit_s, forgotten(), "a silent block: unknown inputs")
    finally:
        await bench.line.mend()
        await bench.close()
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit_s) * 1e3)


async def _back(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await _known(bench)
    await bench.line.cut()
    try:
        while any(device.signal(name) is not Signal.UNKNOWN for name in bench.facts["inputs"]):
            await bench.clock.sleep(bench.bounds.poll_s)
    finally:
        await bench.line.mend()
    limit_s = bench.bounds.answer_s
    took_s = await timed(bench, limit_s, _known(bench), "after the line was mended")
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit_s) * 1e3)


async def _changes(bench: TestBench) -> MeasuredFigure:
    """Close the block: all inputs become unknown, which is a change."""
    device = await bench.opened()
    await _known(bench)
    begun_s = bench.clock.now_s()
    seen: dict[str, Any] = {}

    async def collect(changes: Any) -> None:  # noqa: ANN401  (the driver's own)
        async for change in changes:
            seen[change.name] = change

    bench.device = None
    with device.watch() as changes:
        task = asyncio.ensure_future(collect(changes))
        await device.aclose()
        await bench.clock.wait([task], bench.bounds.answer_s)
        is_over = task.done()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    require(is_over, "`watch` does not end when the block is closed")
    for name in bench.facts["inputs"]:
        require(name in seen, f"no change of `{name}` when the block was closed")
        require(seen[name].signal is Signal.UNKNOWN, f"`{name}` became {seen[name].signal}")
        off_s = seen[name].at_s - begun_s
        require(-1.0 <= off_s <= 60.0, f"the change of `{name}` is {off_s:.1f} s off")
    return MeasuredFigure(remark="all inputs became unknown")


async def _wait(bench: TestBench) -> None:
    """Wait to see that a known input does not change to the other value."""
    device, name = bench.device, bench.facts["inputs"][0]
    is_ok = device.signal(name) is Signal.OK
    await device.wait_for(name, Signal.NOT_OK if is_ok else Signal.OK)


async def _closed(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await _known(bench)
    bench.device = None
    for number in range(2):
        with naming(f"closed {number + 1} times"):
            await device.aclose()
    for name in bench.facts["inputs"]:
        require(device.signal(name) is Signal.UNKNOWN, f"closed, it still knows `{name}`")
    bench.device = device
    await device.connect()
    await _usable(bench)
    return MeasuredFigure()


async def _watchdog(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await _known(bench)
    before = {name: device.signal(name) for name in bench.facts["inputs"]}
    limit_s = bench.bounds.answer_s
    took_s = await timed(bench, limit_s, device.clear_watchdog(), "clear_watchdog")
    await _usable(bench)
    after = {name: device.signal(name) for name in before}
    require(after == before, f"inputs changed from {before} to {after}")
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(limit_s) * 1e3)


REQUIREMENTS: Final = (
    _common.identity(),
    Requirement("inputs", "Every input of the cell is known soon after `connect`.", _inputs),
    Requirement("limits", "Unknown inputs are refused.", _limits),
    Requirement("time-out", "Inputs that are read no more are unknown in time.", _stale, cuts=True),
    Requirement(
        "reconnect", "Cut off and mended, inputs are known again by themselves.", _back, cuts=True
    ),
    Requirement("changes", "`watch` has every change with its instant, and ends.", _changes),
    Requirement("watchdog", "Clearing the watchdog changes no input.", _watchdog, acts=True),
    _common.cancellation(_wait, _usable),
    Requirement("close", "Closed, it knows nothing; closing twice does no harm.", _closed),
)
