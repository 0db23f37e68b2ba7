"""Opens and closes both grippers, checks that they hold, and records a part that they lose.

Every motion of jaws passes the gate before its intent is written: a pause begins before a grasp or
a release, never within one.
"""

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import TypeVar

from controller.cell.custody import Custody
from controller.cell.custody.openings import Opening, judge_fixed
from controller.cell.custody.release_guard import NOTHING_MM, ReleaseGuard, least_held_mm
from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal.rows import FirstMotion, HoldPressed, Intent, Once
from controller.cell.machine import GRASP, PartFault
from controller.config.recipe import GraspSection
from controller.planning import JointPath
from drivers.errors import MotionStoppedError
from drivers.kinds import Arm, FixedGripper, GraspReading, Hold, IoBlock, Signal
from messages import joined, key, say

from .faults import Retries
from .gate import Gate, Mover
from .interlocks import Interlocks
from .motion import rounded
from .records import BatchRecord

Found = TypeVar("Found")


class Grippers:
    """The arm gripper and the fixed gripper.

    Parameters
    ----------
    arm, fixed, io : the devices; the light barrier of the fixed gripper is an input of ``io``
    record : record with the custody of the part
    grasp : function that returns the force, and the tolerance of an opening, for the current part
    gate : gate that holds a pause, and requires the permit to move
    interlocks : admit each motion of jaws
    retries : retries of a reading that does not come
    setting_per_n : slope of the arm gripper's force setting for each N of the recipe
    """

    def __init__(
        self,
        arm: Arm,
        fixed: FixedGripper,
        io: IoBlock,
        record: BatchRecord,
        grasp: Callable[[], GraspSection],
        gate: Gate,
        interlocks: Interlocks,
        retries: Retries,
        setting_per_n: float = 1.0,
    ) -> None:
        self._gate = gate
        self._interlocks = interlocks
        self._retries = retries
        self._arm = arm
        self._fixed = fixed
        self._record = record
        self._guard = ReleaseGuard(arm, fixed, io)
        self._io = io
        self._grasp = grasp
        self._setting_per_n = setting_per_n

    def beyond_mm(self, opening_mm: float, expected_mm: float) -> float:
        """Return by how much jaws stand too wide for the part that they should hold [mm].

        Below 0 they stand too near to each other; 0 is within the tolerance. Jaws below half of a
        thin part hold nothing of it, whatever the tolerance.
        """
        tolerance_mm = self._grasp().width_tolerance_mm
        too_near_mm = min(0.0, opening_mm - least_held_mm(expected_mm, tolerance_mm))
        return too_near_mm or max(0.0, opening_mm - expected_mm - tolerance_mm)

    @property
    def _force_n(self) -> float:
        return self._grasp().force_n

    @property
    def _arm_force(self) -> int:
        # MAX_FORCE has no unit; values from 20 to 60 have been used (umi_rtx.md 5.6)
        return max(20, min(60, round(self._setting_per_n * self._force_n)))

    async def open_arm(self, opening_mm: float) -> None:
        """Open the arm gripper; it must not be the only one to hold the part.

        Raises
        ------
        ReleaseRefusedError : no other gripper is known to hold what it holds
        """
        await self._move(
            Mover.ARM_JAWS,
            say("the arm gripper opens to {opening_mm:.0f} mm", opening_mm=opening_mm),
            lambda: self._guard.open_arm(opening_mm, self._record.part.custody),
        )

    async def release_to_fixed(self, opening_mm: float, retreat: JointPath) -> None:
        """Open the arm gripper once the fixed gripper has the part too.

        Parameters
        ----------
        opening_mm : opening of the jaws
        retreat : retreat of the arm afterwards, for the journal

        Raises
        ------
        ReleaseRefusedError : the fixed gripper does not confirm that it holds the part
        """
        intent = Intent(name=Once.RELEASE_ARM, open_mm=opening_mm, retreat=rounded(retreat))
        words = say(
            "the arm gripper leaves the part to the fixed gripper: {opening_mm:.0f} mm",
            opening_mm=opening_mm,
        )
        await self._move(
            Mover.ARM_JAWS,
            words,
            lambda: self._guard.open_arm(opening_mm, self._record.part.custody),
            intent,
        )
        self._end_hold()

    async def let_go(self, intent: Intent, opening_mm: float, retreat: JointPath) -> None:
        """Open the arm gripper where the part is meant to stay: on the table, over its tray.

        Parameters
        ----------
        intent : intent written before the motion
        opening_mm : opening of the jaws
        retreat : retreat of the arm afterwards, for the journal
        """
        more = {"open_mm": opening_mm, "retreat": rounded(retreat)}
        words = key("the arm gripper lets go of the part, where it is to stay")
        await self._move(
            Mover.ARM_JAWS,
            words,
            lambda: self._guard.open_arm(opening_mm, self._record.part.custody, lets_go=True),
            intent.model_copy(update=more),
        )
        self._end_hold()

    def _end_hold(self) -> None:
        """Count a grasp of the arm gripper that lasted until its release."""
        if self._record.part.hold is not None:
            self._record.budgets.succeed(GRASP + self._record.part.hold.grasp.id)
        self._record.part.hold = None

    async def open_fixed(self, opening_mm: float | None = None) -> None:
        """Open the fixed gripper; by default fully.

        Raises
        ------
        ReleaseRefusedError : no other gripper is known to hold what it holds
        """
        width_mm = self._fixed.max_opening_mm if opening_mm is None else opening_mm
        await self._move(
            Mover.FIXED_JAWS,
            say("the fixed gripper opens to {width_mm:.0f} mm", width_mm=width_mm),
            lambda: self._open_fixed(width_mm),
        )

    async def _open_fixed(self, opening_mm: float) -> None:
        part = self._record.part
        gripped_mm = 0.0 if part.hold is None else part.hold.opening_mm
        await self._guard.open_fixed(opening_mm, part.custody, gripped_mm)

    async def release_to_arm(self, opening_mm: float, retreat: JointPath) -> None:
        """Open the fixed gripper once the arm gripper has the part too.

        Parameters
        ----------
        opening_mm : opening of the jaws
        retreat : retreat of the arm with the part afterwards, for the journal

        Raises
        ------
        ReleaseRefusedError : the arm gripper's jaws do not stand on the part
        """
        intent = Intent(name=Once.RELEASE_FIXED, open_mm=opening_mm, retreat=rounded(retreat))
        words = say(
            "the fixed gripper leaves the part to the arm gripper: {opening_mm:.0f} mm",
            opening_mm=opening_mm,
        )
        await self._move(Mover.FIXED_JAWS, words, lambda: self._open_fixed(opening_mm), intent)
        if self._record.part.fixed_grasp is not None:
            self._record.budgets.succeed(GRASP + self._record.part.fixed_grasp.id)
        self._record.part.fixed_grasp = None

    async def close_arm(self, action: Once, expected_mm: float, retreat: JointPath = ()) -> float:
        """Close the arm gripper on the part; return the opening reached [mm].

        Parameters
        ----------
        action : off the table, or out of the fixed gripper
        expected_mm : the opening the plan expects
        retreat : retreat of the arm with the part afterwards, for the journal
        """
        intent = Intent(name=action, expected_mm=expected_mm, retreat=rounded(retreat))
        words = say(
            "the arm gripper closes on the part: {expected_mm:.0f} mm expected",
            expected_mm=expected_mm,
        )
        return await self._move(
            Mover.ARM_JAWS, words, lambda: self._arm.grasp(self._arm_force), intent
        )

    async def close_fixed(self, expected_mm: float, pre_open_mm: float) -> GraspReading:
        """Close the fixed gripper on the part in the arm gripper; return its reading.

        Parameters
        ----------
        expected_mm : the opening the plan expects
        pre_open_mm : opening for the approach, for the journal; any wider and it would touch the
            arm's fingers
        """
        words = say(
            "the fixed gripper closes on the part: {expected_mm:.0f} mm expected",
            expected_mm=expected_mm,
        )
        intent = Intent(name=Once.HAND_OFF, expected_mm=expected_mm, open_mm=pre_open_mm)
        return await self._move(
            Mover.FIXED_JAWS,
            words,
            lambda: self._fixed.close_on(expected_mm, force_n=self._force_n),
            intent,
        )

    async def press_and_require_hold(self) -> None:
        """Check that the arm gripper holds the part: press once more, and read the opening.

        The opening alone proves nothing: a jaw that stalled on the part stays where it stalled even
        when the part is gone (umi_rtx.md 7). Pressed again with nothing between, the jaws close.

        Raises
        ------
        PartFaultError : the part is gone; custody has where it may be
        """
        hold = self._record.held()
        opening_mm = await self._move(
            Mover.ARM_JAWS,
            key("the arm gripper presses on the part, to check that it is held"),
            lambda: self._arm.grasp(self._arm_force),
        )
        self._record.note(
            HoldPressed(opening_mm=round(opening_mm, 3), held_mm=round(hold.opening_mm, 3))
        )
        if opening_mm >= least_held_mm(hold.opening_mm):
            return
        self._record.part.hold = None
        source = GRASP + hold.grasp.id
        message = say(
            "the part is gone from the arm gripper: jaws at {opening_mm:.1f} "
            "mm, {held_mm:.1f} mm while it was held",
            opening_mm=opening_mm,
            held_mm=hold.opening_mm,
        )
        if self._record.part.custody is Custody.IN_BOTH:
            await self._record.set_custody(
                Custody.IN_FIXED,
                say("jaws of the arm gripper at {opening_mm:.1f} mm", opening_mm=opening_mm),
            )
            raise PartFaultError(PartFault.RECEIVE_FAILED, message, source=source)
        await self._record.set_custody(
            Custody.LOST, say("jaws at {opening_mm:.1f} mm", opening_mm=opening_mm)
        )
        raise PartFaultError(PartFault.DROPPED, message, source=source)

    async def press_fixed_and_require_hold(self, held_mm: float) -> None:
        """Have the fixed gripper press once more on its part, and require that it holds.

        It only closes. After a stop it reports no contact, even with a part between its jaws.

        Parameters
        ----------
        held_mm : its opening while it held the part

        Raises
        ------
        PartFaultError : nothing is between its jaws, and it alone had the part, which is LOST
        PartProblemError : the part is not held as it was; its custody is UNKNOWN
        """

        async def press() -> GraspReading:
            status = await self._retries.run("gripper", key("fixed gripper"), self._fixed.status)
            # from where the jaws stand, so that they cannot be sent wider
            expected_mm = min(held_mm, status.opening_mm)
            return await self._fixed.close_on(expected_mm, force_n=self._force_n)

        found = await self._move(
            Mover.FIXED_JAWS,
            key("the fixed gripper presses on the part, to check that it is held"),
            press,
        )
        is_there = found.opening_mm >= least_held_mm(held_mm)
        if found.object_detected and is_there and await self.does_fixed_hold():
            return
        if not found.object_detected and self._record.part.custody is Custody.IN_FIXED:
            raise await self.lose_from_fixed()
        message = say(
            "the fixed gripper, pressed once more, stands at {opening_mm:.1f} "
            "mm, {held_mm:.1f} mm while it held the part",
            opening_mm=found.opening_mm,
            held_mm=held_mm,
        )
        await self._record.set_custody(Custody.UNKNOWN, message)
        raise PartProblemError("recovery_contradicted", message)

    async def require_held(self) -> None:
        """Check that the holder by custody still has the part; nothing to check if there is none.

        Raises
        ------
        PartFaultError : it is gone
        """
        part = self._record.part
        if part.custody in (Custody.IN_ARM, Custody.IN_BOTH) and part.hold is not None:
            await self.press_and_require_hold()
        elif part.custody is Custody.IN_FIXED:
            await self.require_fixed_holds()

    async def require_empty(self) -> None:
        """Check that neither gripper holds anything, as a person has stated.

        Raises
        ------
        PartProblemError : one of them does
        """
        opening_mm = await self._move(
            Mover.ARM_JAWS,
            key("the arm gripper presses, to check that it is empty"),
            lambda: self._arm.grasp(self._arm_force),
        )
        found: list[str] = []
        if opening_mm >= NOTHING_MM:
            found.append(
                say("the arm gripper's jaws stop at {opening_mm:.1f} mm", opening_mm=opening_mm)
            )
        if self.is_something_in_fixed or await self.does_fixed_hold():
            found.append(key("the fixed gripper holds something"))
        if found:
            raise PartProblemError(
                "still_held",
                say(
                    "the part was reported as taken out, but {found}", found=joined(" and ", found)
                ),
            )

    async def activate_fixed(self) -> None:
        """Make the fixed gripper ready to move, which may move its jaws."""
        await self._move(
            Mover.FIXED_JAWS,
            key("the fixed gripper activates: its jaws may move"),
            lambda: self._fixed.activate(),
        )

    async def activate_empty_fixed(self) -> None:
        """Make a fixed gripper ready that lost its power, if nothing is between its jaws now.

        Raises
        ------
        PartProblemError : its light barrier or its contact does not say that it is empty
        """
        status = await self._retries.run("gripper", key("fixed gripper"), self._fixed.status)
        if status.has_contact or self._io.signal("part_in_gripper") is not Signal.NOT_OK:
            raise PartProblemError(
                "recovery_contradicted",
                key(
                    "the fixed gripper must be empty for its activation, but its contact or "
                    "its light barrier does not confirm that"
                ),
            )
        await self.activate_fixed()

    async def does_fixed_hold(self) -> bool:
        """Return whether the fixed gripper itself confirms that it holds something."""
        found = await self._retries.run("gripper", key("fixed gripper"), self._fixed.hold)
        return found is Hold.HELD

    async def read_fixed(self) -> Opening:
        """Return the fixed gripper's occupancy by its reading and light barrier now.

        Unlike `does_fixed_hold`, it needs no grasp that this run has seen.
        """
        status = await self._retries.run("gripper", key("fixed gripper"), self._fixed.status)
        barrier = Signal.OK if self.is_something_in_fixed else Signal.NOT_OK
        return judge_fixed(status, barrier, self._fixed.max_opening_mm)

    async def require_fixed_holds(self) -> None:
        """Check that the fixed gripper, which alone has the part, still holds it.

        Raises
        ------
        PartFaultError : the part has left it
        """
        if not await self.does_fixed_hold():
            raise await self.lose_from_fixed()

    async def lose_from_fixed(self) -> PartFaultError:
        """Record that the part left the fixed gripper, which alone had it; return the fault."""
        grasp, self._record.part.fixed_grasp = self._record.part.fixed_grasp, None
        await self._record.set_custody(Custody.LOST, key("at the fixed gripper"))
        return PartFaultError(
            PartFault.DROPPED,
            key("the part left the fixed gripper"),
            source="" if grasp is None else GRASP + grasp.id,
        )

    async def openings_mm(self) -> tuple[float, float]:
        """Return the openings of the arm gripper and of the fixed gripper [mm]."""
        status = await self._retries.run("gripper", key("fixed gripper"), self._fixed.status)
        return await self._arm.read_opening_mm(), status.opening_mm

    @property
    def is_something_in_fixed(self) -> bool:
        """Whether the light barrier of the fixed gripper sees something between its jaws."""
        return self._guard.is_something_in_fixed

    async def _move(
        self,
        mover: Mover,
        words: str,
        move: Callable[[], Awaitable[Found]],
        intent: Intent | None = None,
    ) -> Found:
        """Do a motion of jaws; one with an intent must never be repeated blindly.

        An open door stops it half-way. It goes on within the same intent, once a person has looked
        and both openings are as they were left.
        """
        async with AsyncExitStack() as stack:
            while True:
                async with self._at_the_gate(mover, words):
                    if intent is not None:
                        await stack.enter_async_context(self._record.once(intent))
                        intent = None
                    try:
                        return await move()
                    except MotionStoppedError:
                        if not self._gate.halts_jaws:
                            raise

    @asynccontextmanager
    async def _at_the_gate(self, mover: Mover, words: str) -> AsyncIterator[None]:
        async def preview() -> FirstMotion:
            return FirstMotion(words=words)

        async with self._gate.moving(preview, mover):
            self._interlocks.admit_jaws()
            yield
