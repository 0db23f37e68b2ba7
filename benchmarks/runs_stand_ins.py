"""How `bench_runs.py` reaches the emulated cell: its control port, and cameras that tell its truth.

Handed to the controller's own dispatcher and actions. A picture is not rendered: its first bytes
say where the part truly was when it was taken, and recognition and inspection answer from that
(`simulation/stand_ins.py`). Planning is the real one, in the worker process.
"""

import asyncio
import json
import sys
import time
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np

from controller.cell.compute import Job
from controller.planning import Plan
from drivers.clock import CellClock

sys.path.insert(0, str(Path(__file__).parents[1]))

from simulation.stand_ins import (
    Noise,
    StandIns,
    TruthFrame,
    stamped_picture,
)

FRAME_S = 0.26  # a period of 5 Hz, the exposure, and its transfer


class World:
    """The control port of the emulated cell, asked from asyncio."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = asyncio.Lock()
        self._line: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def __call__(self, do: str, **order: object) -> dict[str, Any]:
        """Send an order, return the answer; RuntimeError if it was refused."""
        async with self._lock:
            if self._line is None:
                self._line = await asyncio.open_unix_connection(str(self._path), limit=1 << 24)
            reader, writer = self._line
            writer.write(json.dumps({"do": do, **order}).encode() + b"\n")
            await writer.drain()
            answer = json.loads(await reader.readline())
        if not answer.pop("ok"):
            raise RuntimeError(answer["error"])
        return dict(answer)

    async def aclose(self) -> None:
        """Hang up."""
        if self._line is not None:
            self._line[1].close()
            self._line = None


class TruthCamera:
    """In place of a camera's driver: takes a frame's time, and notes the truth in the picture."""

    def __init__(self, world: World, clock: CellClock) -> None:
        self._world = world
        self._clock = clock
        self.is_paused = False

    async def connect(self) -> None:
        """Nothing to open."""

    async def close(self) -> None:
        """Nothing to close."""

    async def pause(self) -> None:
        """As the driver."""
        self.is_paused = True

    async def resume(self) -> None:
        """As the driver."""
        self.is_paused = False

    model = "no camera: truth with noise"

    def identity(self) -> Any:  # noqa: ANN401 - duck-typed
        """Say what this is."""

        class _Identity:
            card, driver = "no camera: truth with noise", "bench"

        return _Identity()

    async def frame_after(self, t_s: float, timeout_s: float | None = None) -> TruthFrame:
        """Return a white picture whose first bytes tell where the part is."""
        await self._clock.sleep(FRAME_S)
        part = (await self._world("truth"))["parts"][0]
        T = None if part["T_world_part"] is None else np.array(part["T_world_part"])
        return TruthFrame(stamped_picture(T, part["custody"]))


class TimedStandIns(StandIns):
    """The worker process, except for what needs pictures; notes how long plans took."""

    def __init__(self, job: Job, pool: Executor, rng: np.random.Generator) -> None:
        super().__init__(job, pool, Noise(), rng)
        self.plan_wall_s: list[float] = []

    async def plan(self, *asked: Any, **more: Any) -> Plan:  # noqa: ANN401 - goes on as it is
        """Return the worker's plan, and note how long it took."""
        started = time.monotonic()
        try:
            return await super().plan(*asked, **more)
        finally:
            self.plan_wall_s.append(time.monotonic() - started)
