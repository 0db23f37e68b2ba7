"""Getting an arm ready that knows where it stands: it parks by a path free of contact, or not."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace as Fake
from typing import Any

import numpy as np
import pytest

from controller.bring_up.bench import Bench as CommissioningBench
from controller.cell.actions import HomeAction
from controller.cell.errors import PartProblemError
from controller.cell.machine import Event, SafePoint
from controller.cell.services.motion import sweeps_to_home
from controller.config import load_cell
from controller.planning import NoMotionError
from controller.setup.layout import build_layout
from drivers.kinds import Signal

CELLS = Path(__file__).parents[2] / "recipes" / "cells"
AT = np.array([0.3, -1.0, 1.0, 0.0, -1.5, 0.2])
PATH = (np.array([0.1, -1.5, 1.2, 0.0, -1.5, 0.0]), np.zeros(6))


class Bench:
    """The action with services that note what they are asked for."""

    def __init__(self, path: tuple[np.ndarray, ...] | None) -> None:
        self.done: list[Any] = []
        self.asked: tuple[Any, ...] = ()
        self._path = path
        motion: Any = Fake(
            sweeps_to_home=False,
            homing_words="getting the arm ready",
            homing_preview=None,
            home=self._note("home"),
            start_from=self._note("straight to park"),
            follow=self._note("follow"),
            read_q=self._gives(AT),
            mark_free=lambda: None,
            reach=lambda point, ends_step: self.done.append(point),
        )
        empty = Fake(occupancy=None)
        grippers: Any = Fake(
            read_fixed=self._gives(empty),
            activate_fixed=self._gives(None),
            open_fixed=self._gives(None),
            open_arm=self._note("open"),
            openings_mm=self._gives((42.0, 85.0)),
        )
        gate: Any = Fake(until_admitted=self._gives(None))
        layout: Any = Fake(arm_gripper=Fake(max_mm=84.0), park_q=np.zeros(6))
        self.shown: list[str] = []
        record: Any = Fake(show=self.shown.append, around="nothing else")
        nothing: Any = Fake(begin=lambda: None, all_dark=self._gives(None), write=lambda row: None)
        io: Any = Fake(signal=lambda name: Signal.OK)
        self.action = HomeAction(
            io, layout, Fake(path_home=self._path_home), motion, grippers, nothing, nothing,
            record, nothing, gate,
        )  # fmt: skip

    def _gives(self, answer: object) -> Any:
        async def give(*_: object) -> object:
            return answer

        return give

    def _note(self, what: str) -> Any:
        async def note(*given: object) -> None:
            self.done.append((what, *given) if what == "follow" else what)

        return note

    async def _path_home(self, *asked: object) -> tuple[np.ndarray, ...]:
        self.asked = asked
        if self._path is None:
            raise NoMotionError("holder: path home: no way round")
        return self._path


async def test_it_parks_by_the_path_that_is_proven_from_where_it_stands() -> None:
    bench = Bench(PATH)
    assert await bench.action.run() is Event.RESET_DONE
    assert bench.done == ["home", "open", ("follow", PATH), SafePoint.PARKED]
    assert bench.asked == (AT, 42.0, 85.0, None, "nothing else")
    assert bench.shown == ["getting the arm ready"]


async def test_without_such_a_path_it_does_not_move_and_says_what_to_do() -> None:
    bench = Bench(None)
    with pytest.raises(PartProblemError, match="cellctl jog") as raised:
        await bench.action.run()
    assert raised.value.code == "no_way_home"
    assert bench.done == ["home", "open"]


@pytest.mark.parametrize("cell", ["emulated", "ur5e"])
async def test_a_step_of_commissioning_parks_by_a_proven_path_where_homing_moves_no_joint(
    cell: str,
) -> None:
    layout = build_layout(load_cell(CELLS / f"{cell}.yaml"))
    at = layout.park_q + np.radians([25.0, 0.0, 0.0, 0.0, 0.0, 10.0])
    driven: list[np.ndarray] = []
    parked: list[np.ndarray] = []

    async def follow(path: tuple[np.ndarray, ...], first_speed: float = 1.0) -> None:
        assert first_speed < 1.0
        driven.extend(path)

    async def start_from(q: np.ndarray) -> None:
        parked.append(q)

    async def read_q() -> np.ndarray:
        return at

    async def opened(opening_mm: float) -> float:
        return opening_mm

    @asynccontextmanager
    async def moving(*_: object) -> AsyncIterator[None]:
        yield

    motion: Any = Fake(sweeps_to_home=sweeps_to_home(layout), follow=follow, start_from=start_from)
    arm: Any = Fake(read_q=read_q, move_gripper_mm=opened)
    interlocks: Any = Fake(admit_jaws=lambda: None)
    nothing: Any = None
    bench = CommissioningBench(
        cell=nothing, layout=layout, devices=nothing, arm=arm, clock=nothing, motion=motion,
        imaging=nothing, gate=Fake(moving=moving), interlocks=interlocks, person=nothing,
        evidence=nothing, emulated=frozenset(), by="Ada", based_on={}, note=nothing,
    )  # fmt: skip
    await bench.park()
    np.testing.assert_array_equal(parked, [layout.park_q])
    if sweeps_to_home(layout):
        assert driven == []
    else:
        np.testing.assert_array_equal(driven[-1], layout.park_q)


@pytest.mark.parametrize(("cell", "sweeps"), [("emulated", True), ("ur5e", False)])
def test_an_arm_with_absolute_encoders_sweeps_nothing(cell: str, sweeps: bool) -> None:
    assert sweeps_to_home(build_layout(load_cell(CELLS / f"{cell}.yaml"))) == sweeps
