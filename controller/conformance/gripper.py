"""Requirements on every fixed gripper."""

from __future__ import annotations

import asyncio
import math
from functools import partial
from typing import Any, Final

from drivers.kinds import FixedGripper, Hold

from . import _common
from .requirement import (
    MeasuredFigure,
    NotMetError,
    NotTriedError,
    Requirement,
    TestBench,
    require,
    require_refused,
    timed,
)

STILL_MM: Final = 0.6  # a reading of the same opening repeats to this
ARRIVED_MM: Final = 1.5
MOVE_S: Final = 20.0  # a full stroke of the slowest gripper, and more
MODEST_FORCE_N: Final = 40.0


async def _status(device: FixedGripper) -> Any:  # noqa: ANN401  (the driver's own reading)
    return await device.status()


async def _same_opening(bench: TestBench) -> None:
    reading = await bench.device.status()
    widest_mm = bench.device.max_opening_mm
    require(
        -STILL_MM <= reading.opening_mm <= widest_mm + STILL_MM,
        f"an opening of {reading.opening_mm:.1f} mm, of {widest_mm:.1f} mm",
    )


async def _reading(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await _same_opening(bench)
    reading = bench.answered
    for name in ("is_activated", "has_fault", "is_moving", "has_contact", "has_arrived"):
        require(isinstance(getattr(reading, name, None), bool), f"`{name}` is no bool")
    require(isinstance(await device.hold(), Hold), "`hold` returns no Hold")
    return MeasuredFigure(reading.opening_mm, "mm", device.max_opening_mm)


async def _connect_is_still(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    before_mm = (await device.status()).opening_mm
    await bench.close()
    device = await bench.opened()
    reading = await device.status()
    moved_mm = abs(reading.opening_mm - before_mm)
    require(not reading.is_moving, "the jaws move after `connect`")
    require(moved_mm <= STILL_MM, f"the jaws moved by {moved_mm:.1f} mm")
    return MeasuredFigure(moved_mm, "mm", STILL_MM)


async def _limits(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    widest_mm = device.max_opening_mm
    before_mm = (await device.status()).opening_mm
    for opening_mm in (widest_mm + 1.0, -1.0, math.nan):
        move = partial(device.open_to, opening_mm)
        await require_refused(bench, f"open_to({opening_mm:g} mm)", move)
    for opening_mm, force_n in (
        (widest_mm + 1.0, MODEST_FORCE_N),
        (math.nan, MODEST_FORCE_N),
        (0.0, -1.0),
        (0.0, 1e6),
        (0.0, math.nan),
    ):
        grasp = partial(device.close_on, opening_mm, force_n=force_n)
        await require_refused(bench, f"close_on({opening_mm:g} mm, {force_n:g} N)", grasp)
    moved_mm = abs((await device.status()).opening_mm - before_mm)
    require(moved_mm <= STILL_MM, f"the jaws moved by {moved_mm:.1f} mm")
    return MeasuredFigure(remark="8 values")


async def _ready(bench: TestBench) -> Any:  # noqa: ANN401  (the device)
    device = await bench.opened()
    await timed(bench, MOVE_S, device.activate(), "activation")
    return device


async def _units(bench: TestBench) -> MeasuredFigure:
    device = await _ready(bench)
    worst_mm = 0.0
    for share in (0.8, 0.3, 0.6):
        target_mm = share * device.max_opening_mm
        await timed(bench, MOVE_S, device.open_to(target_mm), f"open_to({target_mm:.1f} mm)")
        reading = await device.status()
        require(not reading.is_moving, "`open_to` returned while the jaws moved")
        worst_mm = max(worst_mm, abs(reading.opening_mm - target_mm))
    require(worst_mm <= ARRIVED_MM, f"{worst_mm:.1f} mm off the opening that was requested")
    return MeasuredFigure(worst_mm, "mm", ARRIVED_MM, "worst of 3 openings, by its own reading")


async def _nothing_there(bench: TestBench) -> MeasuredFigure:
    device = await _ready(bench)
    await device.open_to(0.8 * device.max_opening_mm)
    grasp = await device.close_on(0.4 * device.max_opening_mm, force_n=MODEST_FORCE_N)
    require(not grasp.object_detected, "something is between the jaws, or it is only claimed")
    hold = await device.hold()
    require(hold is Hold.NOTHING, f"after an empty grasp `hold` returns {hold}")
    return MeasuredFigure(grasp.opening_mm, "mm")


async def _under_way(bench: TestBench, share: float) -> tuple[Any, asyncio.Future[Any]]:
    """Return the device and a move that it has begun."""
    device = await _ready(bench)
    await device.open_to((1.0 - share) * device.max_opening_mm)
    move = asyncio.ensure_future(device.open_to(share * device.max_opening_mm))
    while not (await device.status()).is_moving:
        if move.done():
            move.exception()
            raise NotTriedError("the jaws arrived before they could be stopped")
        await bench.clock.sleep(0.005)
    return device, move


async def _at_rest(bench: TestBench, target_mm: float, limit_mm: float) -> float:
    """Return the distance that the jaws still moved within a while [mm]."""
    device = bench.device
    first = await device.status()
    await bench.clock.sleep(0.2)
    second = await device.status()
    moved_mm = float(abs(second.opening_mm - first.opening_mm))
    require(moved_mm <= limit_mm, f"the jaws moved on by {moved_mm:.1f} mm")
    require(
        abs(second.opening_mm - target_mm) > ARRIVED_MM, "the jaws went on to where they were sent"
    )
    return moved_mm


async def _stop(bench: TestBench) -> MeasuredFigure:
    device, move = await _under_way(bench, 0.95)
    try:
        took_s = await timed(bench, bench.bounds.stop_s, device.stop(), "stop")
        moved_mm = await _at_rest(bench, 0.95 * device.max_opening_mm, STILL_MM)
        await _ended(bench, move)
    finally:
        move.cancel()
        await asyncio.gather(move, return_exceptions=True)
    limit_ms = bench.clock.patience_s(bench.bounds.stop_s) * 1e3
    return MeasuredFigure(took_s * 1e3, "ms", limit_ms, f"{moved_mm:.1f} mm afterwards")


async def _ended(bench: TestBench, move: asyncio.Future[Any]) -> None:
    """Check that a move which was stopped ends with an error."""
    await bench.clock.wait([move], bench.bounds.answer_s)
    require(move.done(), "the stopped move goes on")
    require(move.exception() is not None, "the stopped move returned as if it had arrived")


async def _cancelled_move(bench: TestBench) -> MeasuredFigure:
    device, move = await _under_way(bench, 0.95)
    move.cancel()

    async def ended() -> None:
        await asyncio.gather(move, return_exceptions=True)

    took_s = await timed(bench, bench.bounds.stop_s, ended(), "a cancelled move")
    if not move.cancelled():
        raise NotMetError("the cancellation of a move was swallowed")
    moved_mm = await _at_rest(bench, 0.95 * device.max_opening_mm, STILL_MM)
    limit_ms = bench.clock.patience_s(bench.bounds.stop_s) * 1e3
    return MeasuredFigure(took_s * 1e3, "ms", limit_ms, f"{moved_mm:.1f} mm afterwards")


REQUIREMENTS: Final = (
    _common.identity(),
    Requirement("reading", "A reading has an opening in mm and says how it stands.", _reading),
    Requirement(
        "still", "Closing and connecting leave the jaws where they are.", _connect_is_still
    ),
    Requirement(
        "limits", "Values out of range are refused before anything is sent.", _limits, acts=True
    ),
    _common.silence(_status, lambda bench: bench.bounds.answer_s),
    _common.reconnection(_status),
    _common.cancellation(lambda bench: bench.device.status(), _same_opening),
    _common.closing("aclose", _status),
    Requirement("units", "Openings are mm: it goes where it is sent.", _units, moves=True),
    Requirement("empty", "An empty grasp is a result, not an error.", _nothing_there, moves=True),
    Requirement("stop", "A stop takes effect in time, and the move ends.", _stop, moves=True),
    Requirement("cancelled", "A cancelled move stops the jaws.", _cancelled_move, moves=True),
)
