"""What all actions share: telling, journaling, moving, taking a picture, booking steps.

*Once* actions (grip, release, hand-off, sort) are on the disk before their bytes leave and are
never repeated without a look at the jaws (DESIGN.md 5).
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.config import Cell, Recipe
from controller.planning import Step
from controller.planning.layout import CellLayout
from drivers.clock import CellClock

from . import workers
from .custody import Custody
from .devices import Devices
from .errors import PartProblemError
from .interlocks import check_interlocks
from .journal import Journal
from .records import PartRecord, Progress

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Result = TypeVar("Result")
SomeStep = TypeVar("SomeStep", bound=Step)

LOOK_TIMEOUT_S = 30.0  # a camera that stalls is a fault, a slow one is not
LOST_MM = 1.5  # jaws that close by more than this while carrying have lost the part


class Toolkit:
    """One job on one set of devices, and the part at hand."""

    def __init__(
        self,
        job: workers.Job,
        recipe: Recipe,
        cell: Cell,
        layout: CellLayout,
        devices: Devices,
        clock: CellClock,
        journal: Journal,
        pool: Executor,
        folder: Path,
        progress: Progress,
        on_progress: Callable[[], None],
    ) -> None:
        self._job = job
        self._layout = layout
        self._devices = devices
        self._clock = clock
        self._journal = journal
        self._pool = pool
        self._folder = folder
        self.progress = progress
        self._on_progress = on_progress
        self.part = PartRecord(number=0)
        self.parts_left = 0
        self.finished: list[PartRecord] = []
        self._recipe = recipe
        # MAX_FORCE has no unit of its own; 20 to 60 have been used (umi_rtx.md 5.6)
        self._grip_force = max(20, min(60, round(recipe.grip.force_n)))
        self._is_quick = {
            name: getattr(cell.cameras, name).settle_frames == 0
            for name in ("overhead", "inspection")
        }
        self._preparing: asyncio.Future[float] | None = None

    def _tell(self, label: str, **more: object) -> None:
        self.progress.label = label
        self.progress.custody = self.part.custody
        for name, value in more.items():
            setattr(self.progress, name, value)
        self._on_progress()

    async def _compute(self, function: Callable[..., Result], *args: object) -> Result:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._pool, function, self._job, *args)

    async def _custody(self, custody: Custody, detail: str = "") -> None:
        self.part.custody = custody
        self.progress.custody = custody
        await self._journal.secure(
            "custody", custody.name.lower(), {"detail": detail}, self.part.number
        )

    async def _once(
        self, name: str, body: Mapping[str, Any], doing: Callable[[], Awaitable[Result]]
    ) -> Result:
        """Do something that must never be repeated blindly; its intent is on the disk before."""
        await self._journal.secure("intent", name, body, self.part.number)
        result = await doing()
        self._journal.record("outcome", name, {}, self.part.number)
        return result

    async def _move(self, motion: tuple[Array, ...]) -> None:
        check_interlocks(self._devices)
        for q in motion:
            await self._devices.arm.move_joints(q)

    async def _require_held(self) -> None:
        """Press once more and look at the jaws: with nothing between them they close.

        A jaw that stalled on the part stands where it stalled even when the part has gone
        (umi_rtx.md 7), so that its width alone proves nothing.
        """
        width = await self._devices.arm.grip(self._grip_force)
        if width < self.part.gripped_mm - LOST_MM:
            await self._custody(Custody.LOST, f"jaws at {width:.1f} mm")
            raise PartProblemError(
                "part_lost",
                f"the part is gone from the arm's hand: jaws at {width:.1f} mm, "
                f"{self.part.gripped_mm:.1f} mm while it was held; look below the arm's last way",
            )

    async def _shoot(self, camera: str, lamps: Mapping[str, float]) -> Grey:
        """Return a picture exposed wholly after the lamps were as told."""
        everything = dict.fromkeys(self._devices.lights.names, 0.0) | dict(lamps)
        lit_at_s = await self._devices.lights.set(everything, settle=True)
        device = self._devices.overhead if camera == "overhead" else self._devices.inspection
        if device.is_paused:
            await device.resume()
        try:
            frame = await device.frame_after(lit_at_s, LOOK_TIMEOUT_S)
        finally:
            if self._is_quick[camera]:
                # a stream that starts at once need not run while nobody looks
                await device.pause()
        image = frame.image
        if image.dtype != np.uint8:
            image = (image.astype(np.float32) * (255.0 / frame.white)).astype(np.uint8)
        return np.ascontiguousarray(image)

    async def _save(self, name: str, image: Grey) -> str:
        path = self._folder / "pictures" / f"part{self.part.number:03d}_{name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        level = [cv2.IMWRITE_PNG_COMPRESSION, 1]
        if not await asyncio.to_thread(cv2.imwrite, str(path), image, level):
            raise OSError(f"{path}: cannot be written; is the disk full?")
        return str(path.relative_to(self._folder))

    def _step(self, kind: type[SomeStep]) -> SomeStep | None:
        plan = self.part.plan
        if plan is None or self.part.next_step >= len(plan.steps):
            return None
        step = plan.steps[self.part.next_step]
        return step if isinstance(step, kind) else None

    def _begin(self, step: Step) -> float:
        plan = self.part.plan
        remaining = None
        if plan is not None:
            done = sum(s.seconds for s in plan.steps[: self.part.next_step])
            remaining = max(0.0, plan.forecast_s - done)
        self._tell(
            step.label,
            step=self.part.next_step + 1,
            step_count=len(plan.steps) + 1 if plan else 0,
            remaining_s=remaining,
        )
        return self._clock.now_s()

    def _end(self, step: Step, started_s: float, **body: object) -> None:
        self._journal.record(
            "outcome",
            "step",
            {
                "label": step.label,
                "forecast_s": round(step.seconds, 2),
                "seconds": round(self._clock.now_s() - started_s, 2),
                **body,
            },
            self.part.number,
        )
        self.part.next_step += 1

    def _drop_pending(self) -> None:
        for _, task in self.part.pending:
            task.cancel()
        self.part.pending.clear()
