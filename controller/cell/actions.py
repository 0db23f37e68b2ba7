"""What the cell does in each state: one coroutine per effect, each ending in one event.

Everything that moves or switches goes through here, journaled before and after. *Once* actions
(grip, release, hand-off, sort) are on the disk before their bytes leave and are never repeated
without a look at the jaws (DESIGN.md 5).
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.cad import inverse_pose
from controller.config import Cell, Recipe
from controller.planning import (
    HandOver,
    NoPlanError,
    Pick,
    Place,
    Plan,
    Present,
    Step,
    TakeBack,
    shown_pose,
)
from controller.planning.layout import CellLayout
from controller.recognition import Sighting
from drivers.clock import CellClock
from drivers.gripper_modbus import Hold
from drivers.io_modbus import Signal
from drivers.umi_scara import AxisStalledError, Stop

from . import workers
from .custody import Custody
from .devices import Devices
from .errors import GripMissedError, InterlockError, PartProblemError
from .holder import holder_boxes, tip_pose
from .journal import Journal
from .machine import Effect, Event

log = logging.getLogger(__name__)

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]
Result = TypeVar("Result")

GRIP_TRIES = 3
LOOK_TIMEOUT_S = 30.0  # a camera that stalls is a fault, a slow one is not
SETTLE_S = 0.3  # a long arm rings after it stops
NOTHING_MM = 3.0  # jaws this near to each other hold nothing
LOST_MM = 1.5  # jaws that close by more than this while carrying have lost the part
REQUIRED_SIGNALS = {
    "estop_ok": "the emergency stop is pressed, or its chain is open; release and reset it",
    "guard_closed": "the door is open; close it",
    "supply_ok": "the 24 V supply is missing; check the fuse",
}


@dataclass(slots=True)
class Progress:
    """What the operator sees of the run at a moment."""

    state: str = "stopped"
    step: int = 0
    step_count: int = 0
    label: str = ""
    part_pose: str = ""
    remaining_s: float | None = None
    custody: Custody = Custody.NONE


@dataclass(slots=True)
class PartRecord:
    """All that is known of the part at hand."""

    number: int
    custody: Custody = Custody.ON_TABLE
    pictures: dict[str, Grey] = field(default_factory=dict)
    sighting: Sighting | None = None
    plan: Plan | None = None
    next_step: int = 0
    grip_tries: int = 0
    gripped_mm: float = 0.0
    T_part_hand: Array | None = None
    is_hold_seen: bool = False
    pending: list[tuple[Array, asyncio.Task[inspecting.ViewResult]]] = field(default_factory=list)
    results: list[inspecting.ViewResult] = field(default_factory=list)
    verdict: inspecting.PartVerdict | None = None
    tray: str | None = None


def check_interlocks(devices: Devices) -> None:
    """Raise InterlockError unless every safety copy is known to be healthy."""
    for name, remedy in REQUIRED_SIGNALS.items():
        signal = devices.io.signal(name)
        if signal is Signal.NOT_OK:
            raise InterlockError(f"{name}: {remedy}")
        if signal is Signal.UNKNOWN:
            raise InterlockError(
                f"{name}: the I/O block gives no fresh reading, which counts as not healthy; "
                "check its cable and power"
            )


class Actions:
    """Runs effects for one job on one set of devices."""

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
        self._effects: Mapping[Effect, Callable[[], Awaitable[Event]]] = {
            Effect.HOME: self.home,
            Effect.ACQUIRE: self.acquire,
            Effect.RECOGNISE: self.recognise,
            Effect.PLAN: self.plan,
            Effect.GRASP: self.grasp,
            Effect.PRESENT: self.present,
            Effect.INSPECT: self.inspect,
            Effect.HAND_OFF: self.hand_off,
            Effect.PLACE: self.place,
            Effect.COMPLETE: self.complete,
            Effect.HOLD: self.hold,
            Effect.STOP_MOTION: self.stop_motion,
            Effect.ABORT_MOTION: self.abort_motion,
            Effect.CLEAR_FAULT: self.clear_fault,
        }

    async def perform(self, effect: Effect) -> Event:
        """Run one effect to its end and return what came of it."""
        return await self._effects[effect]()

    # ---- helpers -------------------------------------------------------------------------------
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

    def _step(self, kind: type[Step]) -> Step | None:
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

    # ---- effects -------------------------------------------------------------------------------
    async def home(self) -> Event:
        """Power, home, activate; interlocks first. The planner's long work starts beside it."""
        check_interlocks(self._devices)
        self._preparing = asyncio.ensure_future(self._compute(workers.prepare))
        self._tell("homing the arm; it sweeps its whole reach")
        arm, gripper = self._devices.arm, self._devices.gripper
        await self._devices.lights.all_off()
        if (await gripper.hold()) is Hold.HELD:
            raise PartProblemError(
                "fixture_not_empty", "the fixed gripper holds something; take it out first"
            )

        async def ready_gripper() -> None:
            await gripper.activate()
            await gripper.open_to(gripper.config.open_mm)

        async def ready_arm() -> None:
            await arm.enable_power()
            if not arm.is_homed:
                await arm.home()
            await arm.move_gripper_mm(self._layout.hand.max_mm * 0.5)
            await arm.move_joints(self._layout.park_q)

        async with asyncio.TaskGroup() as both:
            both.create_task(ready_gripper())
            both.create_task(ready_arm())
        self._journal.record("outcome", "homed", {})
        return Event.RESET_DONE

    async def acquire(self) -> Event:
        """Take the pictures of the table: glowing, then under each of its lamps."""
        if self.part.tray is not None or self.part.number == 0:
            self.part = PartRecord(number=self.part.number + 1)
        self.part.next_step = 0
        self._tell("taking pictures of the table", step=0, step_count=0, remaining_s=None)
        camera = self._devices.overhead
        try:
            self.part.pictures = {
                "table_backlight": await self._shoot("overhead", {"table_backlight": 1.0})
            }
            for lamp in workers.TABLE_LAMPS:
                self.part.pictures[lamp] = await self._shoot("overhead", {lamp: 1.0})
        finally:
            await camera.pause()
        names = {lamp: await self._save(lamp, image) for lamp, image in self.part.pictures.items()}
        self._journal.record("observation", "table_pictures", names, self.part.number)
        return Event.PICTURE_TAKEN

    async def recognise(self) -> Event:
        """Find out which part it is, which way up it lies and where."""
        self._tell("recognising")
        lit = {lamp: self.part.pictures[lamp] for lamp in workers.TABLE_LAMPS}
        sightings = await self._compute(
            workers.recognise, self.part.pictures["table_backlight"], lit
        )
        self._journal.record(
            "observation",
            "sightings",
            {"sightings": [describe_sighting(s) for s in sightings]},
            self.part.number,
        )
        self.part.sighting = self._choose(sightings)
        s = self.part.sighting
        self._tell(
            "recognised",
            part_pose=f"{s.part}, pose {s.pose_index}, x {s.x_mm:.1f} y {s.y_mm:.1f} mm, "
            f"{np.degrees(s.theta_rad):.1f} deg",
        )
        return Event.PART_RECOGNISED

    def _choose(self, sightings: tuple[Sighting, ...]) -> Sighting:
        if not sightings:
            raise PartProblemError(
                "no_part", "no part on the table: lay one on the glowing area and start again"
            )
        if len(sightings) > 1:
            where = "; ".join(
                f"{s.part or 'unknown object'} at x {s.x_mm:.0f}, y {s.y_mm:.0f} mm"
                for s in sightings
            )
            raise PartProblemError(
                "many_parts", f"{len(sightings)} objects on the table, one is allowed: {where}"
            )
        (seen,) = sightings
        expected = self._recipe.part.stem
        if seen.part is None:
            raise PartProblemError(
                "unknown_object",
                f"the object at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm: {seen.reason}",
            )
        if seen.part != expected:
            raise PartProblemError(
                "wrong_part",
                f"{seen.part} lies at x {seen.x_mm:.0f}, y {seen.y_mm:.0f} mm, the recipe is for "
                f"{expected}",
            )
        others = [a for a in seen.ambiguous_with if a.part != seen.part]
        if others:
            raise PartProblemError(
                "ambiguous", f"the object may be {seen.part} or {others[0].part}; turn it over"
            )
        return seen

    async def plan(self) -> Event:
        """Decide how to take it, what to show, where to pass it over."""
        self._tell("planning")
        if self._preparing is not None:
            await self._preparing
        sighting = self.part.sighting
        assert sighting is not None
        assert sighting.T_world_part is not None
        try:
            plan = await self._compute(workers.plan, sighting.pose_index, sighting.T_world_part)
        except NoPlanError as error:
            raise PartProblemError("no_plan", str(error)) from error
        self.part.plan = plan
        self.part.next_step = 0
        self._journal.record(
            "decision",
            "plan",
            {
                "steps": [label for label, _ in plan.seconds_by_step],
                "seconds": [round(seconds, 2) for _, seconds in plan.seconds_by_step],
                "forecast_s": round(plan.forecast_s, 1),
                "covered_fraction": round(plan.covered_fraction, 4),
                "reachable_fraction": round(plan.reachable_fraction, 4),
                "unseen": [
                    {"face": u.face_id, "area_fraction": u.area_fraction, "reason": u.reason}
                    for u in plan.unseen
                ],
            },
            self.part.number,
        )
        return Event.PLANNED

    async def grasp(self) -> Event:
        """Take the part off the table and prove that it is held."""
        step = self._step(Pick)
        assert isinstance(step, Pick)
        started = self._begin(step)
        arm = self._devices.arm
        await arm.move_gripper_mm(step.pre_open_mm)
        await self._move(step.motion_in)
        await self._move(step.motion_down)
        width = await self._close(step.expected_opening_mm, "grip")
        if width < step.expected_opening_mm - self._recipe.grip.width_tolerance_mm:
            self.part.grip_tries += 1
            found = "on nothing" if width < NOTHING_MM else f"to {width:.1f} mm"
            message = (
                f"the jaws closed {found}, {step.expected_opening_mm:.1f} mm was expected "
                f"(try {self.part.grip_tries} of {GRIP_TRIES})"
            )
            self._journal.record("outcome", "grip_missed", {"message": message}, self.part.number)
            await arm.move_gripper_mm(step.pre_open_mm)
            await self._custody(Custody.ON_TABLE)
            await self._move(step.motion_up)
            # back the way it came: that way is known to be free
            await self._move((*reversed(step.motion_in[:-1]), self._layout.park_q))
            if self.part.grip_tries >= GRIP_TRIES:
                raise GripMissedError("grip_missed", message + "; check the fingers and the part")
            return Event.GRIP_MISSED
        if width > step.expected_opening_mm + self._recipe.grip.width_tolerance_mm:
            raise PartProblemError(
                "grip_wrong",
                f"the jaws stopped at {width:.1f} mm, {step.expected_opening_mm:.1f} mm was "
                "expected: they hold something else, or other faces",
            )
        await self._custody(Custody.IN_ARM, f"jaws at {width:.1f} mm")
        await self._move(step.motion_up)
        await self._require_held()
        self._hold_anew(step.grip.T_part_hand)
        self._end(step, started, jaw_mm=round(width, 2), expected_mm=step.expected_opening_mm)
        return Event.GRASPED

    def _hold_anew(self, T_part_hand: Array) -> None:
        self.part.T_part_hand = T_part_hand
        self.part.is_hold_seen = False

    async def _close(self, expected_mm: float, name: str) -> float:
        width = await self._once(
            name, {"expected_mm": expected_mm}, lambda: self._devices.arm.grip(self._grip_force)
        )
        self.part.gripped_mm = width
        return width

    async def present(self) -> Event:
        """Show views to the inspection camera until something must be judged first.

        After each new grip one view is judged before the next: the hold is verified by sight.
        """
        camera = self._devices.inspection
        try:
            while (step := self._step(Present)) is not None:
                assert isinstance(step, Present)
                started = self._begin(step)
                await self._move(step.motion)
                await self._require_held()
                await self._clock.sleep(SETTLE_S)
                pictures = {
                    "station_backlight": await self._shoot("inspection", {"station_backlight": 1.0})
                }
                for lamp in _lamps_for(step):
                    pictures[lamp] = await self._shoot("inspection", {lamp: 1.0})
                q = await self._devices.arm.read_q()
                names = {
                    lamp: await self._save(f"{step.view_id}_{lamp}", image)
                    for lamp, image in pictures.items()
                }
                self._journal.record(
                    "observation",
                    "view_pictures",
                    {"view": step.view_id, "pictures": names, "q": q.tolist()},
                    self.part.number,
                )
                self._submit(step, q, pictures)
                self._end(step, started, view=step.view_id)
                if not self.part.is_hold_seen:
                    return Event.SHOWN
        finally:
            await camera.pause()
        return Event.SHOWN

    def _submit(self, step: Present, q: Array, pictures: Mapping[str, Grey]) -> None:
        """Hand a view to the worker; it is judged while the arm goes to the next one."""
        grip = self.part.T_part_hand
        assert grip is not None
        expected = shown_pose(self._layout, q, grip)
        holder = holder_boxes(self._layout, q, self.part.gripped_mm)
        lit = {lamp: pictures[lamp] for lamp in _lamps_for(step)}
        task = asyncio.ensure_future(
            self._compute(
                workers.inspect,
                step.view_id,
                expected,
                holder,
                pictures["station_backlight"],
                lit,
                self.part.is_hold_seen,
            )
        )
        self.part.pending.append((q, task))

    async def inspect(self) -> Event:
        """Wait for the views shown so far; decide what comes next."""
        self._tell("judging what was shown")
        while self.part.pending:
            q, task = self.part.pending[0]
            result = await task
            self.part.pending.pop(0)
            self.part.results.append(result)
            self._journal.record("observation", "view", describe_view(result), self.part.number)
            log.info(
                "view %s: %s",
                result.view_id,
                f"{len(result.findings)} findings" if result.evaluated else result.reason,
            )
            if not self.part.is_hold_seen:
                self._see_hold(q, result)
        if self._step(Present) is not None:
            return Event.INSPECTED
        if self._step(HandOver) is not None:
            return Event.HAND_OFF_DUE
        await self._judge()
        return Event.ALL_SEEN

    def _see_hold(self, q: Array, result: inspecting.ViewResult) -> None:
        """Take the first view under a grip as proof of the hold, and its pose as the true one."""
        if not result.evaluated:
            raise PartProblemError(
                "hold_not_seen",
                f"the camera does not confirm how the part is held: {result.reason}",
            )
        self.part.is_hold_seen = True
        self.part.T_part_hand = inverse_pose(result.T_world_part) @ tip_pose(self._layout, q)

    async def _judge(self) -> None:
        plan = self.part.plan
        assert plan is not None
        unseen = {u.face_id: u.reason for u in plan.unseen}
        verdict = await self._compute(workers.judge, tuple(self.part.results), unseen)
        self.part.verdict = verdict
        self._journal.record("decision", "verdict", describe_verdict(verdict), self.part.number)

    async def hand_off(self) -> Event:
        """Pass the part to the fixed gripper and take it back with another grip.

        Two-phase, both ways: the receiver's width is confirmed before the giver opens.
        """
        over = self._step(HandOver)
        assert isinstance(over, HandOver)
        started = self._begin(over)
        arm, fixture = self._devices.arm, self._devices.gripper
        await fixture.open_to(over.fixture_pre_open_mm)
        await self._move(over.motion)
        await self._require_held()
        await self._fixture_takes(over.fixture_expected_opening_mm)
        await self._custody(Custody.IN_BOTH)
        await self._once(
            "release",
            {"open_mm": over.hand_open_mm},
            lambda: arm.move_gripper_mm(over.hand_open_mm),
        )
        await self._require_fixture_holds()
        await self._custody(Custody.IN_FIXTURE)
        await self._move(over.retreat)
        self._end(over, started)

        back = self._step(TakeBack)
        assert isinstance(back, TakeBack)
        started = self._begin(back)
        await self._move(back.motion_in)
        await arm.move_gripper_mm(back.pre_open_mm)
        await self._move(back.approach)
        width = await self._close(back.expected_opening_mm, "take_back")
        off = abs(width - back.expected_opening_mm)
        if off > self._recipe.grip.width_tolerance_mm:
            raise PartProblemError(
                "take_back_failed",
                f"taking the part back: the hand's jaws stopped at {width:.1f} mm, "
                f"{back.expected_opening_mm:.1f} mm was expected; the fixed gripper still holds it",
            )
        await self._custody(Custody.IN_BOTH)
        await self._once(
            "fixture_release",
            {"open_mm": back.fixture_open_mm},
            lambda: fixture.open_to(back.fixture_open_mm),
        )
        await self._require_held()
        await self._custody(Custody.IN_ARM, f"jaws at {width:.1f} mm")
        self._hold_anew(back.grip.T_part_hand)
        await self._move(back.motion_out)
        await self._require_held()
        self._end(back, started, jaw_mm=round(width, 2), expected_mm=back.expected_opening_mm)
        return Event.HANDED_OFF

    async def _fixture_takes(self, expected_mm: float) -> None:
        fixture = self._devices.gripper
        result = await self._once(
            "hand_off",
            {"expected_mm": expected_mm},
            lambda: fixture.close_on(expected_mm, force_n=self._recipe.grip.force_n),
        )
        off = abs(result.width_mm - expected_mm)
        if not result.object_detected or off > self._recipe.grip.width_tolerance_mm:
            await fixture.open_to(fixture.config.open_mm)
            raise PartProblemError(
                "hand_off_failed",
                f"hand-off: the fixed gripper closed to {result.width_mm:.1f} mm, "
                f"{expected_mm:.1f} mm was expected; the arm still holds the part",
            )

    async def _require_fixture_holds(self) -> None:
        if (await self._devices.gripper.hold()) is not Hold.HELD:
            await self._custody(Custody.LOST, "at the fixture")
            raise PartProblemError(
                "part_lost", "the part left the fixed gripper; look below it before anything moves"
            )

    async def place(self) -> Event:
        """Put the part into the tray its verdict names."""
        plan, verdict = self.part.plan, self.part.verdict
        assert plan is not None
        assert verdict is not None
        tray = {
            inspecting.Verdict.PASS: "accept",
            inspecting.Verdict.FAIL: "reject",
        }.get(verdict.verdict, "quarantine")
        step: Place = plan.place[tray]
        started = self._begin(step)
        await self._move(step.motion)
        await self._move(step.motion_down)
        await self._require_held()
        await self._once(
            "sort", {"tray": tray}, lambda: self._devices.arm.move_gripper_mm(step.open_mm)
        )
        self.part.tray = tray
        await self._custody(Custody.PLACED, tray)
        await self._move(step.motion_up)
        self._end(step, started, tray=tray)
        await self._move(plan.park[tray].motion)
        return Event.PLACED

    async def complete(self) -> Event:
        """Book the part; go on with the next one or end the batch."""
        self.finished.append(self.part)
        self.parts_left -= 1
        verdict = self.part.verdict
        assert verdict is not None
        self._journal.record(
            "outcome",
            "part_done",
            {"verdict": verdict.verdict.value, "tray": self.part.tray},
            self.part.number,
        )
        if self.parts_left > 0:
            return Event.PART_DONE
        await self._devices.lights.all_off()
        return Event.BATCH_DONE

    async def hold(self) -> Event:
        """Stand still, keep holding."""
        self._drop_pending()
        await self._devices.arm.stop(Stop.RAMP)
        return Event.HOLD_DONE

    async def stop_motion(self) -> Event:
        """Stop on request; release nothing."""
        self._drop_pending()
        await self._devices.arm.stop(Stop.RAMP)
        await self._devices.gripper.stop()
        await self._devices.lights.all_off()
        return Event.STOP_DONE

    async def abort_motion(self) -> Event:
        """Stop at once whatever still answers; release nothing."""
        self._drop_pending()
        for name, stopping in (
            ("arm", lambda: self._devices.arm.stop(Stop.DEAD)),
            ("gripper", self._devices.gripper.stop),
            ("lights", self._devices.lights.all_off),
        ):
            try:
                async with self._clock.timeout(3.0):
                    await stopping()
                self._journal.record("outcome", "stopped", {"device": name})
            except Exception as error:  # noqa: BLE001 - the next device must be stopped all the same
                self._journal.record(
                    "outcome", "stop_not_confirmed", {"device": name, "error": str(error)}
                )
                log.warning("%s did not confirm the stop: %s", name, error)
        return Event.ABORT_DONE

    async def clear_fault(self) -> Event:
        """Check that what stopped the cell is gone."""
        check_interlocks(self._devices)
        return Event.CLEAR_DONE

    def _drop_pending(self) -> None:
        for _, task in self.part.pending:
            task.cancel()
        self.part.pending.clear()


def _lamps_for(step: Present) -> tuple[str, ...]:
    """Return the lamps a view is lit with.

    The side lamp's shadows tell pockets and steps on a plane that is looked at squarely; on
    slanting views they fall mostly where the prediction is not trusted.
    """
    return workers.STATION_LAMPS if step.square_to >= 0 else workers.STATION_LAMPS[:1]


def explain_stall(error: AxisStalledError) -> str:
    """Return what a stalled axis means for the operator."""
    return f"the arm met something it should not have: {error}; look before you clear it"


def describe_sighting(s: Sighting) -> dict[str, Any]:
    """Return a sighting as the journal keeps it."""
    return {
        "part": s.part,
        "pose_index": s.pose_index,
        "stable_pose_R": None if s.R is None else s.R.tolist(),
        "x_mm": round(s.x_mm, 3),
        "y_mm": round(s.y_mm, 3),
        "theta_deg": round(float(np.degrees(s.theta_rad)), 3),
        "score": round(s.score, 4),
        "grey_score": s.grey_score,
        "residual_px": None if not np.isfinite(s.residual_px) else round(s.residual_px, 3),
        "ambiguous_with": [
            {
                "part": a.part,
                "pose_index": a.pose_index,
                "theta_deg": float(np.degrees(a.theta_rad)),
            }
            for a in s.ambiguous_with
        ],
        "box_px": list(s.box_px),
        "reason": s.reason,
    }


def describe_view(r: inspecting.ViewResult) -> dict[str, Any]:
    """Return a view's result as the journal keeps it."""
    return {
        "view": r.view_id,
        "evaluated": r.evaluated,
        "reason": r.reason,
        "T_world_part": r.T_world_part.tolist(),
        "shift_mm": round(r.shift_mm, 3),
        "turn_deg": round(float(np.degrees(r.turn_rad)), 3),
        "residual_px": None if not np.isfinite(r.residual_px) else round(r.residual_px, 3),
        "seen_samples": int(r.seen.sum()),
        "outline_px": np.round(r.outline_px[::3]).astype(int).tolist(),
        "findings": [
            {
                "kind": f.kind.value,
                "lamp": f.lamp,
                "area_mm2": round(f.area_mm2, 2),
                "size_mm": round(f.size_mm, 2),
                "at_px": [round(v, 1) for v in f.at_px],
                "box_px": list(f.box_px),
                "p_part_mm": np.round(f.p_part_mm, 2).tolist(),
                "faces": list(f.face_ids),
            }
            for f in r.findings
        ],
    }


def describe_verdict(v: inspecting.PartVerdict) -> dict[str, Any]:
    """Return a verdict as the journal keeps it."""
    return {
        "verdict": v.verdict.value,
        "reasons": list(v.reasons),
        "covered_fraction": round(v.covered_fraction, 4),
        "confirmed": [
            {"view": view_id, "kind": f.kind.value, "lamp": f.lamp, "faces": list(f.face_ids)}
            for view_id, f in v.confirmed
        ],
        "faces": [
            {
                "face": f.face_id,
                "label": f.label,
                "area_mm2": round(f.area_mm2, 2),
                "seen_fraction": round(f.seen_fraction, 4),
                "verdict": f.verdict.value,
                "views": list(f.views),
                "reason": f.reason,
            }
            for f in v.faces
        ],
    }
