"""Actions that take, pass over and put down; a giver opens after its receiver was confirmed."""

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.planning import HandOver, Pick, Place, TakeBack
from drivers.gripper_modbus import Hold

from .custody import Custody
from .errors import GripMissedError, PartProblemError
from .machine import Event
from .toolkit import Toolkit

Array = NDArray[np.float64]

GRIP_TRIES = 3
NOTHING_MM = 3.0  # jaws this near to each other hold nothing


class Handling(Toolkit):
    """What the cell's two grippers do to the part."""

    async def grasp(self) -> Event:
        """Take the part off the table and prove that it is held."""
        step = self._step(Pick)
        assert step is not None
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

    async def hand_off(self) -> Event:
        """Pass the part to the fixed gripper and take it back with another grip.

        Two-phase, both ways: the receiver's width is confirmed before the giver opens.
        """
        over = self._step(HandOver)
        assert over is not None
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
        assert back is not None
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
        # ways after this one are planned past an empty fixture that stands wide open
        await fixture.open_to(fixture.config.open_mm)
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
