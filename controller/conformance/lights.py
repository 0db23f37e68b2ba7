"""Requirements on every lamp unit."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import Final

from drivers.kinds import LampUnit

from . import _common
from .requirement import MeasuredFigure, Requirement, TestBench, require, require_refused, timed


async def _off(device: LampUnit) -> float:
    return await device.all_off()


async def _usable(bench: TestBench) -> None:
    await _instants(bench, settle=False)


async def _instants(bench: TestBench, *, settle: bool) -> tuple[float, float]:
    """Light a lamp; return the instant before, and the instant from which it is lit [s]."""
    device = bench.device
    asked_s = bench.clock.now_s()
    since_s = await device.set({device.names[0]: 0.5}, settle=settle)
    require(isinstance(since_s, float), f"`set` returned {since_s!r:.60}, no instant")
    require(
        since_s <= bench.clock.now_s() + 1e-6, "the light is to be so at an instant still to come"
    )
    return asked_s, since_s


async def _names(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    expected = {lamp.name for lamp in bench.facts["lamps"]}
    require(set(device.names) == expected, f"lamps {sorted(device.names)}, not {sorted(expected)}")
    return MeasuredFigure(len(device.names), "lamps")


async def _limits(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    name = device.names[0]
    wrong: tuple[dict[str, float], ...] = (
        {name: 1.01},
        {name: -0.01},
        {name: math.nan},
        {"no such lamp": 0.5},
        {name: 0.5, "no such lamp": 0.5},
    )
    for levels in wrong:
        await require_refused(bench, f"set({levels})", partial(device.set, levels))
    return MeasuredFigure(remark="5 values")


async def _since(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await device.all_off()
    asked_s, since_s = await _instants(bench, settle=False)
    require(since_s >= asked_s, f"the light is said to be so {asked_s - since_s:.3f} s too early")
    return MeasuredFigure(
        (since_s - asked_s) * 1e3, "ms", None, "from the order to the acknowledge"
    )


async def _settled(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await device.all_off()
    asked_s, since_s = await _instants(bench, settle=True)
    returned_s = bench.clock.now_s()
    require(since_s > asked_s, "it does not wait until the light is steady")
    require(returned_s >= since_s - 1e-6, "it returns before the light is steady")
    return MeasuredFigure((since_s - asked_s) * 1e3, "ms", None, "from the order to a steady light")


async def _dark(bench: TestBench) -> MeasuredFigure:
    device = await bench.opened()
    await device.set(dict.fromkeys(device.names, 0.3))
    took_s = await timed(bench, bench.bounds.stop_s, device.all_off(), "all_off")
    limit_ms = bench.clock.patience_s(bench.bounds.stop_s) * 1e3
    return MeasuredFigure(took_s * 1e3, "ms", limit_ms)


async def _light(bench: TestBench) -> float:
    return float(await bench.device.set({bench.device.names[0]: 0.4}))


_COMMANDING: Final = (
    Requirement("limits", "Unknown lamps and levels are refused before anything is sent.", _limits),
    Requirement("since", "`set` returns an instant at which the light is so, in s.", _since),
    Requirement("settle", "With `settle` it waits until the light is steady.", _settled),
    Requirement("dark", "`all_off` takes effect in time.", _dark),
    _common.silence(_off, lambda bench: bench.bounds.answer_s),
    _common.reconnection(_off),
    _common.cancellation(_light, _usable),
)
REQUIREMENTS: Final = (
    _common.identity(),
    Requirement("names", "It has the lamps of the cell file.", _names),
    *(replace(one, acts=True) for one in _COMMANDING),  # of lamps nothing but their names is read
)
