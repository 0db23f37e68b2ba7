"""Requirements on every arm."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError, LinkError
from drivers.kinds import Stop

from . import _common
from .requirement import (
    MeasuredFigure,
    NotMetError,
    NotTriedError,
    Requirement,
    TestBench,
    require,
    timed,
)

HOME_S: Final = 300.0
MOVE_S: Final = 60.0
STEP_RAD: Final = math.radians(2.0)
STEP_MM: Final = 5.0  # step of a joint that slides
FAR_RAD: Final = math.radians(20.0)
FAR_MM: Final = 100.0
WITHIN_RAD: Final = math.radians(0.3)
WITHIN_MM: Final = 0.5
MOVING_SHARE: Final = 0.02  # share of the distance after which a joint is known to move
JAWS_MM: Final = 1.0


async def _jaws(device: Any) -> Any:  # noqa: ANN401  (an arm, a reading)
    return await device.read_jaws()


async def _usable(bench: TestBench) -> None:
    reading = await bench.device.read_jaws()
    require(isinstance(reading.is_pressing, bool), "`is_pressing` is no bool")


async def _connected(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    require(isinstance(bench.answered.was_restarted, bool), "`was_restarted` is no bool")
    require(device.identity is not None, "connected, it has no identity")
    require(device.max_opening_mm > 0.0, f"its jaws open to {device.max_opening_mm} mm")
    await _usable(bench)
    return MeasuredFigure(device.max_opening_mm, "mm", None, "opening of its jaws")


async def _not_homed(bench: TestBench) -> MeasuredFigure:
    await bench.close()
    device = await bench.opened()
    if device.is_homed:
        raise NotTriedError("it keeps its positions while it is not connected")
    park_q = bench.facts["park_q"]
    verbs: tuple[tuple[str, Callable[[], Awaitable[Any]]], ...] = (
        ("read_q", device.read_q),
        ("move_joints", partial(device.move_joints, park_q)),
    )
    for what, verb in verbs:
        try:
            await verb()
        except DeviceError:
            continue
        except Exception as error:
            raise NotMetError(f"{what}, not homed: raised {error!r:.80}") from error
        raise NotMetError(f"{what}, not homed: it has positions that mean nothing")
    return MeasuredFigure()


async def _ready(bench: TestBench) -> Any:  # noqa: ANN401  (an arm)
    device = await bench.opened()
    if not device.is_homed:
        await device.enable_power()
        await timed(bench, HOME_S, device.home(), "homing")
        require(device.is_homed, "homed, it claims not to be")
    return device


def _steps(bench: TestBench, rad: float, mm: float) -> NDArray[np.float64]:
    """Return a step of each joint (6,), in its unit."""
    slides = np.asarray(bench.facts["slides"], dtype=bool)
    return np.where(slides, mm, rad)


def _inside(bench: TestBench, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return joints (6,), moved into the range where they read beyond its end."""
    slack = 2.0 * np.diag(_steps(bench, WITHIN_RAD, WITHIN_MM))
    for nudge in (np.zeros(q.shape), *slack, *-slack):
        if bench.facts["within_limits"](q + nudge):
            return np.asarray(q + nudge)
    return q


def _beside(
    bench: TestBench, q: NDArray[np.float64], joint: int, step: float
) -> NDArray[np.float64]:
    """Return joints (6,) with one of them moved by a step, to the free side.

    Raises
    ------
    NotTriedError : there is room on neither side
    """
    for sign in (1.0, -1.0):
        target = q.copy()
        target[joint] += sign * step
        if bench.facts["within_limits"](target):
            return target
    raise NotTriedError(f"joint {joint} has no room for {step:.3f}")


async def _units(bench: TestBench) -> MeasuredFigure:
    device = await _ready(bench)
    allowed = _steps(bench, WITHIN_RAD, WITHIN_MM)
    steps = _steps(bench, STEP_RAD, STEP_MM)
    worst = 0.0
    for joint in range(len(steps)):
        start = _inside(bench, await device.read_q())
        target = _beside(bench, start, joint, steps[joint])
        for q in (target, start):
            await timed(bench, MOVE_S, device.move_joints(q, speed_share=0.25), "a small move")
            worst = max(worst, float(np.max(np.abs(await device.read_q() - q) / allowed)))
    require(worst <= 1.0, f"a joint ended {worst:.1f} times what is allowed off its target")
    return MeasuredFigure(
        worst, "of the tolerance", 1.0, "0.3 degrees or 0.5 mm, by its own counters"
    )


async def _limits(bench: TestBench) -> MeasuredFigure:
    device = await _ready(bench)
    before = await device.read_q()
    wild = [np.full(before.shape, math.nan), before[:-1]]
    for joint in range(len(before)):
        out = before.copy()
        out[joint] += 1e4
        wild.append(out)
    widest_mm = device.max_opening_mm
    calls: list[tuple[str, Callable[[], Awaitable[Any]]]] = [
        *((f"joints {np.round(q, 2)}", partial(device.move_joints, q)) for q in wild),
        *(
            (f"speed_share {share}", partial(device.move_joints, before, speed_share=share))
            for share in (0.0, 1.5, math.nan)
        ),
        *(
            (f"opening {mm:g} mm", partial(device.move_gripper_mm, mm))
            for mm in (widest_mm + 5.0, -5.0, math.nan)
        ),
        *((f"force {force}", partial(device.grasp, force)) for force in (-1, 1000)),
    ]
    for what, call in calls:
        try:
            await call()
        except ValueError:
            continue
        except Exception as error:
            raise NotMetError(f"{what}: raised {error!r:.100}, expected ValueError") from error
        raise NotMetError(f"{what}: was taken")
    moved = np.abs(await device.read_q() - before) / _steps(bench, WITHIN_RAD, WITHIN_MM)
    require(bool(moved.max() <= 1.0), "a joint moved all the same")
    return MeasuredFigure(float(len(calls)), "values")


async def _under_way(bench: TestBench) -> tuple[Any, asyncio.Future[Any], NDArray[np.float64]]:
    device = await _ready(bench)
    start = _inside(bench, await device.read_q())
    far = _steps(bench, FAR_RAD, FAR_MM)
    target = _beside(bench, start, 0, far[0])
    move = asyncio.ensure_future(device.move_joints(target, speed_share=0.5))
    while True:
        done = np.abs(await device.read_q() - start) / far
        if done.max() > MOVING_SHARE:
            return device, move, target
        if move.done():
            raise NotTriedError("it arrived before it could be stopped")
        await bench.clock.sleep(0.02)


async def _at_rest(bench: TestBench, target: NDArray[np.float64]) -> None:
    device = bench.device
    allowed = _steps(bench, WITHIN_RAD, WITHIN_MM)
    first = await device.read_q()
    await bench.clock.sleep(0.3)
    second = await device.read_q()
    require(
        bool((np.abs(second - first) <= allowed).all()), "a joint moves on after it was stopped"
    )
    require(bool((np.abs(second - target) > allowed).any()), "it went on to where it was sent")


async def _stop(bench: TestBench) -> MeasuredFigure:
    device, move, target = await _under_way(bench)
    try:
        took_s = await timed(bench, bench.bounds.stop_s, device.stop(Stop.DEAD), "stop")
        await bench.clock.wait([move], bench.bounds.answer_s)
        require(move.done(), "the stopped move goes on")
        require(
            isinstance(move.exception(), DeviceError),
            f"the stopped move ended with {move.exception()!r:.80}",
        )
        await _at_rest(bench, target)
    finally:
        move.cancel()
        await asyncio.gather(move, return_exceptions=True)
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(bench.bounds.stop_s) * 1e3)


async def _cancelled_move(bench: TestBench) -> MeasuredFigure:
    _, move, target = await _under_way(bench)
    move.cancel()

    async def ended() -> None:
        await asyncio.gather(move, return_exceptions=True)

    took_s = await timed(bench, bench.bounds.stop_s, ended(), "a cancelled move")
    require(move.cancelled(), "the cancellation of a move was swallowed")
    await _at_rest(bench, target)
    return MeasuredFigure(took_s * 1e3, "ms", bench.clock.patience_s(bench.bounds.stop_s) * 1e3)


async def _jaw_units(bench: TestBench) -> MeasuredFigure:
    device = await _ready(bench)
    worst_mm = 0.0
    for share in (0.3, 0.7):
        target_mm = share * device.max_opening_mm
        reached_mm = await device.move_gripper_mm(target_mm)
        read_mm = await device.read_opening_mm()
        worst_mm = max(worst_mm, abs(reached_mm - target_mm), abs(read_mm - target_mm))
    require(worst_mm <= JAWS_MM, f"the jaws are {worst_mm:.1f} mm off")
    return MeasuredFigure(worst_mm, "mm", JAWS_MM, "by its own counters")


async def _silence(bench: TestBench) -> MeasuredFigure:
    """Require that a silent line is noticed within `arm_silent_s` of the cell file."""
    device = await bench.opened()
    limit_s = bench.bounds.arm_silent_s
    await bench.line.silence()
    begun_s = bench.stopwatch.now_s()
    try:
        reading = asyncio.ensure_future(device.read_jaws())
        await bench.clock.wait([reading], 4.0 * limit_s)
        took_s = bench.stopwatch.now_s() - begun_s
        require(reading.done(), f"a silent line is not known after {took_s:.1f} s")
        error = reading.exception()
        require(isinstance(error, LinkError), f"a silent line ended with {error!r:.80}")
        # each of the two time-outs of which it is made may last longer by the clock's patience
        allowed_s = 2.0 * bench.clock.patience_s(limit_s) - limit_s
        require(took_s <= allowed_s, f"a silent line was known after {took_s:.2f} s")
    finally:
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
        await bench.line.mend()
        await bench.close()
    return MeasuredFigure(took_s * 1e3, "ms", allowed_s * 1e3)


REQUIREMENTS: Final = (
    _common.identity(),
    Requirement("reading", "It says who it is and how its jaws stand.", _connected),
    Requirement(
        "not homed", "Without homing it has no position and does not move.", _not_homed, acts=True
    ),
    Requirement("time-out", "A silent line is known in time.", _silence, cuts=True),
    _common.reconnection(_jaws),
    _common.cancellation(lambda bench: bench.device.read_jaws(), _usable),
    _common.closing("aclose", _jaws),
    Requirement("limits", "Values out of range are refused, nothing moves.", _limits, moves=True),
    Requirement("units", "Joints are rad and mm: they go where they are sent.", _units, moves=True),
    Requirement("jaws", "Openings of its jaws are mm.", _jaw_units, moves=True),
    Requirement("stop", "A stop takes effect in time, and the move ends.", _stop, moves=True),
    Requirement("cancelled", "A cancelled move stops the arm.", _cancelled_move, moves=True),
)
