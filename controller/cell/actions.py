"""What the cell does in each state: one coroutine per effect, each ending in one event.

Looking and handling stand in files of their own; here are the effects of the cell as a whole:
homing, booking, holding, stopping.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from drivers.gripper_modbus import Hold
from drivers.umi_scara import Stop

from .custody import Custody
from .errors import PartProblemError, PartTroubleError
from .interlocks import check_interlocks
from .journal import JournalError
from .looking import Looking
from .machine import Effect, Event
from .stopping import stop_side_by_side

log = logging.getLogger(__name__)


class Actions(Looking):
    """All effects of the table."""

    async def perform(self, effect: Effect) -> Event:
        """Run one effect to its end and return what came of it, or how to get over it."""
        effects: Mapping[Effect, Callable[[], Awaitable[Event]]] = {
            Effect.HOME: self.home,
            Effect.ACQUIRE: self.acquire,
            Effect.RECOGNISE: self.recognise,
            Effect.PLAN: self.plan,
            Effect.GRASP: self.grasp,
            Effect.PRESENT: self.present,
            Effect.INSPECT: self.inspect,
            Effect.HAND_OFF: self.hand_off,
            Effect.SET_DOWN: self.set_down,
            Effect.WITHDRAW: self.withdraw,
            Effect.PLACE: self.place,
            Effect.COMPLETE: self.complete,
            Effect.HOLD: self.hold,
            Effect.STOP_MOTION: self.stop_motion,
            Effect.ABORT_MOTION: self.abort_motion,
            Effect.CLEAR_FAULT: self.clear_fault,
        }
        try:
            return await effects[effect]()
        except PartTroubleError as trouble:
            return self._book_recovery(trouble).event

    async def note_fixture_loss(self) -> PartTroubleError | None:
        """Book what the fixed gripper has lost, if it alone had the part.

        While the hand has it too, or already, the hand's own look decides.
        """
        if self.part.custody is not Custody.IN_FIXTURE:
            return None
        trouble = await self.lose_from_fixture()
        self._book_recovery(trouble)
        return trouble

    async def home(self) -> Event:
        """Power, home, activate; interlocks first. The planner's long work starts beside it."""
        check_interlocks(self._devices)
        self._preparing = asyncio.ensure_future(self._experts.prepare())
        self._tell("homing the arm; it sweeps its whole reach")
        arm, gripper = self._devices.arm, self._devices.gripper
        await self._devices.lights.all_off()
        if (await gripper.hold()) is Hold.HELD:
            raise PartProblemError(
                "fixture_not_empty", "the fixed gripper holds something; take it out first"
            )

        async def ready_gripper() -> None:
            await gripper.activate()
            await self._jaws.open_fixture(gripper.config.open_mm, Custody.NONE, 0.0)

        async def ready_arm() -> None:
            await arm.enable_power()
            if not arm.is_homed:
                await arm.home()
            await self._jaws.open_hand(self._layout.hand.max_mm * 0.5, Custody.NONE)
            await arm.move_joints(self._layout.park_q)
            self._trail = [self._layout.park_q]

        async with asyncio.TaskGroup() as both:
            both.create_task(ready_gripper())
            both.create_task(ready_arm())
        self._journal.record("outcome", "homed", {})
        return Event.RESET_DONE

    async def complete(self) -> Event:
        """Book the part; go on with the next one or end the batch."""
        self.finished.append(self.part)
        self.parts_left -= 1
        verdict = self.part.verdict
        assert verdict is not None
        self._journal.record(
            "outcome",
            "part_done",
            {
                "verdict": verdict.verdict.value,
                "tray": self.part.tray,
                "recoveries": [one.trouble.value for one in self.part.recoveries],
            },
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
        failures = await self._stop_all(Stop.RAMP)
        for error in failures.values():
            raise error
        return Event.STOP_DONE

    async def abort_motion(self) -> Event:
        """Stop at once whatever still answers; release nothing."""
        self._drop_pending()
        failures = await self._stop_all(Stop.DEAD)
        for name in ("arm", "gripper", "lights"):
            error = failures.get(name)
            if error is None:
                self._journal.record("outcome", "stopped", {"device": name})
                continue
            log.warning("%s did not confirm the stop: %s", name, error)
            with suppress(JournalError):
                self._journal.record(
                    "outcome", "stop_not_confirmed", {"device": name, "error": str(error)}
                )
        return Event.ABORT_DONE

    async def _stop_all(self, kind: Stop) -> dict[str, Exception]:
        """Stop arm, fixed gripper and lamps side by side; return who did not confirm, and why."""
        return await stop_side_by_side(
            {"arm": lambda: self._devices.arm.stop(kind), **self._other_stops()}, self._clock
        )

    async def stop_others(self) -> None:
        """Stop what is not the arm while the arm is being halted."""
        for name, error in (await stop_side_by_side(self._other_stops(), self._clock)).items():
            log.warning("%s did not confirm the stop: %s", name, error)

    def _other_stops(self) -> dict[str, Callable[[], Awaitable[object]]]:
        return {"gripper": self._devices.gripper.stop, "lights": self._devices.lights.all_off}

    async def clear_fault(self) -> Event:
        """Check that what stopped the cell is gone."""
        check_interlocks(self._devices)
        return Event.CLEAR_DONE
