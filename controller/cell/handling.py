"""Actions that take, pass over and put down; a giver opens after its receiver was confirmed."""

from contextlib import suppress
from dataclasses import replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from controller import inspection as inspecting
from controller.imaging import inverse_pose
from controller.planning import (
    Grip,
    HandOver,
    NoMotionError,
    Pick,
    Place,
    SetDown,
    TakeBack,
    shown_pose,
)
from drivers.gripper_modbus import Hold as FixtureHold

from .custody import Custody
from .errors import PartProblemError, PartTroubleError
from .jaws import NOTHING_MM
from .machine import Event
from .records import Hold
from .recovery import Trouble
from .toolkit import Toolkit

Array = NDArray[np.float64]


class Handling(Toolkit):
    """What the cell's two grippers do to the part."""

    async def grasp(self) -> Event:
        """Take the part off the table and prove that it is held.

        Raises
        ------
        PartTroubleError : the jaws closed on nothing, or on something else
        """
        step = self._step(Pick)
        assert step is not None
        started = self._begin(step)
        await self._jaws.open_hand(step.pre_open_mm, self.part.custody)
        await self._move(step.motion_in)
        await self._move(step.motion_down)
        width = await self._close("grip", step.expected_opening_mm)
        tolerance_mm = self._recipe.grip.width_tolerance_mm
        expected = f"{step.expected_opening_mm:.1f} mm was expected"
        if width < step.expected_opening_mm - tolerance_mm:
            found = "on nothing" if width < NOTHING_MM else f"to {width:.1f} mm"
            message = f"the jaws closed {found}, {expected}"
            self._journal.record("outcome", "grip_missed", {"message": message}, self.part.number)
            await self._leave_on_table(step)
            raise PartTroubleError(Trouble.GRIP_MISSED, message)
        if width > step.expected_opening_mm + tolerance_mm:
            await self._leave_on_table(step)
            raise PartTroubleError(
                Trouble.GRIP_WRONG,
                f"the jaws stopped at {width:.1f} mm, {expected}: they held other faces, or "
                "something else",
            )
        self._hold_anew(step.grip, width)
        await self._custody(Custody.IN_ARM, f"jaws at {width:.1f} mm")
        await self._move(step.motion_up)
        await self._require_held()
        self._end(step, started, jaw_mm=round(width, 2), expected_mm=step.expected_opening_mm)
        return Event.GRASPED

    async def _leave_on_table(self, step: Pick) -> None:
        """Open above what lies there, and go back the way it came: that way is free."""
        await self._jaws.open_hand(step.pre_open_mm, self.part.custody)
        await self._custody(Custody.ON_TABLE)
        await self._move(step.motion_up)
        self._trail.clear()
        await self._move((*reversed(step.motion_in[:-1]), self._layout.park_q))
        del self._trail[:-1]

    def _hold_anew(self, grip: Grip, width_mm: float) -> None:
        self.part.hold = Hold(grip, grip.T_part_hand, width_mm)

    async def _close(self, name: str, expected_mm: float) -> float:
        return await self._once(
            name, {"expected_mm": expected_mm}, lambda: self._devices.arm.grip(self._grip_force)
        )

    async def hand_off(self) -> Event:
        """Pass the part to the fixed gripper and take it back with another grip.

        Two-phase, both ways: the receiver's width is confirmed before the giver opens. A plan that
        begins while the fixed gripper has the part begins with the second half.

        Raises
        ------
        PartTroubleError : the part is lost, or one of the grippers did not get it
        """
        over = self._step(HandOver)
        if over is not None:
            await self._give(over)
        back = self._step(TakeBack)
        if back is not None:
            await self._take_back(back)
        return Event.HANDED_OFF

    async def _give(self, step: HandOver) -> None:
        started, fixture = self._begin(step), self._devices.gripper
        await self._jaws.open_fixture(step.fixture_pre_open_mm, self.part.custody, 0.0)
        await self._move(step.motion)
        await self._require_held()
        await self._fixture_takes(step)
        await self._custody(Custody.IN_BOTH)
        if (await fixture.hold()) is not FixtureHold.HELD:
            await self._hand_off_failed(step, "the fixed gripper lost the part at once")
        hold = self._held()
        T_world_part = shown_pose(self._layout, await self._devices.arm.read_q(), hold.T_part_hand)
        await self._once(
            "release",
            {"open_mm": step.hand_open_mm},
            lambda: self._jaws.open_hand(step.hand_open_mm, self.part.custody),
        )
        self.part.hold = None
        self.part.fixture_grip = replace(
            step.fixture_grip,
            T_part_hand=inverse_pose(T_world_part) @ self._layout.T_world_fixture,
        )
        await self._custody(Custody.IN_FIXTURE)
        await self._require_fixture_holds()
        await self._move(step.retreat)
        self._end(step, started)

    async def _fixture_takes(self, step: HandOver) -> None:
        expected_mm = step.fixture_expected_opening_mm
        result = await self._once(
            "hand_off",
            {"expected_mm": expected_mm},
            lambda: self._devices.gripper.close_on(expected_mm, force_n=self._recipe.grip.force_n),
        )
        off = abs(result.width_mm - expected_mm)
        if not result.object_detected or off > self._recipe.grip.width_tolerance_mm:
            await self._hand_off_failed(
                step,
                f"the fixed gripper closed to {result.width_mm:.1f} mm, {expected_mm:.1f} mm was "
                "expected",
            )

    async def _hand_off_failed(self, step: HandOver, why: str) -> NoReturn:
        """Keep the part in the hand and go back to where the step began."""
        part, hold = self.part, self._held()
        await self._custody(Custody.IN_ARM, "the fixed gripper did not get it")
        await self._jaws.open_fixture(
            self._devices.gripper.config.open_mm, part.custody, hold.width_mm
        )
        await self._require_held()
        # jaws that closed on the wrong faces may have turned it in the hand
        hold.is_seen = False
        await self._go_back(len(step.motion))
        if part.has_tried(Trouble.HAND_OFF_FAILED):
            part.avoid.add(step.fixture_grip.id)
        raise PartTroubleError(
            Trouble.HAND_OFF_FAILED, f"hand-off: {why}; the arm still holds the part"
        )

    async def _take_back(self, step: TakeBack) -> None:
        started, part, fixture = self._begin(step), self.part, self._devices.gripper
        await self._move(step.motion_in)
        await self._jaws.open_hand(step.pre_open_mm, part.custody)
        await self._move(step.approach)
        await self._require_fixture_holds()
        width = await self._close("take_back", step.expected_opening_mm)
        if abs(width - step.expected_opening_mm) > self._recipe.grip.width_tolerance_mm:
            await self._take_back_failed(step, width)
        self._hold_anew(step.grip, width)
        await self._custody(Custody.IN_BOTH)
        await self._once(
            "fixture_release",
            {"open_mm": step.fixture_open_mm},
            lambda: self._jaws.open_fixture(step.fixture_open_mm, part.custody, width),
        )
        part.fixture_grip = None
        await self._custody(Custody.IN_ARM, f"jaws at {width:.1f} mm")
        await self._require_held()
        await self._move(step.motion_out)
        # ways after this one are planned past an empty fixture that stands wide open
        await self._jaws.open_fixture(fixture.config.open_mm, part.custody, width)
        await self._require_held()
        self._end(step, started, jaw_mm=round(width, 2), expected_mm=step.expected_opening_mm)

    async def _take_back_failed(self, step: TakeBack, width_mm: float) -> NoReturn:
        """Leave the part in the fixed gripper and go back to where the step began."""
        part = self.part
        await self._jaws.open_hand(step.pre_open_mm, part.custody)
        await self._custody(Custody.IN_FIXTURE, "the arm gripper did not get it")
        await self._go_back(len(step.approach))
        await self._require_fixture_holds()
        await self._go_back(len(step.motion_in))
        # nothing sees the part in the fixed gripper: what failed once would fail again
        part.avoid.add(step.grip.id)
        raise PartTroubleError(
            Trouble.TAKE_BACK_FAILED,
            f"taking the part back: the hand's jaws stopped at {width_mm:.1f} mm, "
            f"{step.expected_opening_mm:.1f} mm was expected; the fixed gripper still holds it",
        )

    async def _require_fixture_holds(self) -> None:
        if (await self._devices.gripper.hold()) is not FixtureHold.HELD:
            raise await self.lose_from_fixture()

    async def lose_from_fixture(self) -> PartTroubleError:
        """Book a part that has left the fixed gripper while nobody else had it."""
        self.part.fixture_grip = None
        await self._custody(Custody.LOST, "at the fixture")
        return PartTroubleError(Trouble.DROPPED, "the part left the fixed gripper")

    async def set_down(self) -> Event:
        """Put the part on the table, to be looked at and taken with another grip."""
        step = self._step(SetDown)
        assert step is not None
        started = self._begin(step)
        await self._move(step.motion)
        await self._move(step.motion_down)
        await self._require_held()
        await self._once(
            "set_down",
            {"pose_index": step.pose_index},
            lambda: self._jaws.open_hand(step.open_mm, self.part.custody, lets_go=True),
        )
        self.part.hold = None
        await self._custody(Custody.ON_TABLE, "set down")
        await self._move(step.motion_up)
        self._end(step, started)
        return Event.SET_DOWN

    async def withdraw(self) -> Event:
        """Go where the arm is out of the camera's sight, so that the table can be looked at."""
        self._tell("taking the arm out of the way")
        self._is_drop_booked = False
        part, arm, fixture = self.part, self._devices.arm, self._devices.gripper
        held = part.hold.T_part_hand if part.hold is not None else None
        while True:
            hand_mm, width = await arm.jaw_width_mm(), (await fixture.status()).width_mm
            q = await arm.read_q()
            with suppress(NoMotionError):
                way = await self._experts.way_home(q, hand_mm, width, held)
                break
            if len(self._trail) < 2:
                raise PartProblemError(
                    "no_way_home",
                    "no way free of contact leads the arm out of the camera's sight; jog it there",
                )
            await self._go_back(1)
        await self._move(way)
        del self._trail[:-1]
        if part.custody is Custody.LOST:
            if self._jaws.is_between_fixture:
                raise PartProblemError(
                    "part_lost", "the part hangs in the fixed gripper, not held well; take it out"
                )
            await self._jaws.open_fixture(fixture.config.open_mm, part.custody, 0.0)
        return Event.WITHDRAWN

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
            "sort",
            {"tray": tray},
            lambda: self._jaws.open_hand(step.open_mm, self.part.custody, lets_go=True),
        )
        self.part.tray = tray
        self.part.hold = None
        await self._custody(Custody.PLACED, tray)
        await self._move(step.motion_up)
        self._end(step, started, tray=tray)
        await self._move(plan.park[tray].motion)
        del self._trail[:-1]
        return Event.PLACED
