"""What all actions share: telling, journaling, moving, taking a picture, booking steps.

*Once* actions (grip, release, hand-off, sort) are on the disk before their bytes leave and are
never repeated without a look at the jaws (DESIGN.md 5).
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.config import Cell, Recipe
from controller.planning import Step
from controller.planning.layout import CellLayout
from drivers.clock import CellClock

from .custody import Custody
from .devices import Devices
from .errors import PartProblemError, PartTroubleError
from .experts import Experts
from .interlocks import check_interlocks
from .jaws import LOST_MM, NOTHING_MM, Jaws
from .journal import Journal
from .records import Hold, PartRecord, Progress, Shown
from .recovery import REMEDIES, Recovery, Remedy, Trouble, remedy_for

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Result = TypeVar("Result")
SomeStep = TypeVar("SomeStep", bound=Step)

LOOK_TIMEOUT_S = 30.0  # a camera that stalls is a fault, a slow one is not


class Toolkit:
    """One job on one set of devices, and the part at hand."""

    def __init__(
        self,
        experts: Experts,
        recipe: Recipe,
        cell: Cell,
        layout: CellLayout,
        devices: Devices,
        clock: CellClock,
        journal: Journal,
        folder: Path,
        progress: Progress,
        on_progress: Callable[[], None],
    ) -> None:
        self._experts = experts
        self._layout = layout
        self._devices = devices
        self._clock = clock
        self._journal = journal
        self._jaws = Jaws(devices.arm, devices.gripper, devices.io)
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
        # where the arm has been since it last stood free of everything: the way back is free too
        self._trail: list[Array] = []
        self._last_shown: Shown | None = None
        self._is_drop_booked = False

    def _tell(self, label: str, **more: object) -> None:
        self.progress.label = label
        self.progress.custody = self.part.custody
        for name, value in more.items():
            setattr(self.progress, name, value)
        self._on_progress()

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
            self._trail.append(q)
            await self._devices.arm.move_joints(q)

    async def _go_back(self, count: int) -> None:
        """Drive the last ``count`` waypoints backwards, to where the arm stood before them."""
        way = [self._trail[-2 - i] for i in range(count)]
        del self._trail[-count:]
        check_interlocks(self._devices)
        for q in way:
            await self._devices.arm.move_joints(q)

    async def _require_held(self) -> None:
        """Press once more and look at the jaws: with nothing between them they close.

        A jaw that stalled on the part stands where it stalled even when the part has gone
        (umi_rtx.md 7), so that its width alone proves nothing.
        """
        hold = self._held()
        width = await self._devices.arm.grip(self._grip_force)
        if width >= hold.width_mm - LOST_MM and width >= NOTHING_MM:
            return
        self.part.hold = None
        message = (
            f"the part is gone from the arm's hand: jaws at {width:.1f} mm, "
            f"{hold.width_mm:.1f} mm while it was held"
        )
        if self.part.custody is Custody.IN_BOTH:
            await self._custody(Custody.IN_FIXTURE, f"jaws of the hand at {width:.1f} mm")
            raise PartTroubleError(Trouble.TAKE_BACK_FAILED, message)
        await self._custody(Custody.LOST, f"jaws at {width:.1f} mm")
        raise PartTroubleError(Trouble.DROPPED, message)

    def _held(self) -> Hold:
        """Return how the hand has the part; it must have it."""
        hold = self.part.hold
        assert hold is not None, "the hand is empty"
        return hold

    def _may_recover(self, trouble: Trouble) -> bool:
        return remedy_for(trouble, self.part.recoveries) is not None

    def _book_recovery(self, error: PartTroubleError) -> Remedy:
        """Write down what the cell sets out to get over by itself.

        Raises
        ------
        PartProblemError : it has tried that often enough
        """
        part = self.part
        if error.trouble is Trouble.DROPPED and self._is_drop_booked:
            return REMEDIES[error.trouble]  # noticed twice: by the jaws and by the keep-alive
        remedy = remedy_for(error.trouble, part.recoveries)
        if remedy is None:
            raise PartProblemError(
                error.code,
                f"{error} (the cell has helped itself {len(part.recoveries)} times with this part "
                "and now asks for you)",
            ) from error
        self._is_drop_booked = error.trouble is Trouble.DROPPED
        part.recoveries.append(Recovery(error.trouble, str(error)))
        self._journal.record(
            "decision",
            "recovery",
            {
                "trouble": error.trouble.value,
                "reason": str(error),
                "remedy": remedy.words,
                "number": len(part.recoveries),
                "custody": part.custody.name.lower(),
            },
            part.number,
        )
        self._tell(f"{error}; {remedy.words}", remaining_s=None)
        return remedy

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
        del self._trail[:-1]  # every step ends where the arm stands free

    def _drop_pending(self) -> None:
        for shown in self.part.pending:
            shown.task.cancel()
        self.part.pending.clear()
