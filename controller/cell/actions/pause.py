"""Pausing and going on. The work at hand is not ended: its task waits at the gate meanwhile."""

from dataclasses import dataclass

from controller.cell.devices.interlocks import check_interlocks
from controller.cell.devices.stopping import Stopping
from controller.cell.journal.rows import FirstMotion
from controller.cell.machine import Event, PauseKind
from drivers.kinds import IoBlock, Stop

from ..services import Gate, Grippers
from ..services.records import BatchRecord


@dataclass(frozen=True, slots=True, eq=False)
class SuspendAction:
    """Brings the cell to its pause.

    Attributes
    ----------
    gate : holds the work at the point that is wanted
    stopping : stops the arm, where the pause is to begin now
    """

    gate: Gate
    stopping: Stopping

    async def run(self) -> Event:
        """Wait until nothing moves or will move; *now* stops the arm; return ``PAUSED``.

        Raises
        ------
        DeviceError : the arm does not confirm that it has stopped
        """
        is_stopped = False
        while not self.gate.is_settled:
            is_now = self.gate.wanted is PauseKind.NOW
            if is_now and self.gate.is_arm_moving and not is_stopped:
                # what the arm has stored ends with it: before its next motion the driver sets every
                # target to where the axis stands
                is_stopped = True
                await self.stopping.stop_arm(Stop.RAMP)
            else:
                await self.gate.changed()
        return Event.PAUSED


@dataclass(frozen=True, slots=True, eq=False)
class UnsuspendAction:
    """Checks that a paused cell may go on.

    Attributes
    ----------
    gate : has the motion that comes first
    io : the interlocks
    grippers : check that what is held is still held
    record : journals the motion that comes first
    """

    gate: Gate
    io: IoBlock
    grippers: Grippers
    record: BatchRecord

    async def run(self) -> Event:
        """Check interlocks and hold; return ``RESUMED``, or ``STEP_BEGUN`` for one step alone.

        Raises
        ------
        InterlockError : a safety copy is not healthy
        PartFaultError : the part is gone
        """
        check_interlocks(self.io)
        first = await self.gate.next_motion()
        if first is not None:
            self.record.note(
                FirstMotion(
                    words=first.words,
                    origin=first.origin,
                    goal=first.goal,
                    tcp_mm=first.tcp_mm,
                    turn_deg=first.turn_deg,
                    seconds=first.seconds,
                )
            )
        with self.gate.checking():
            await self.grippers.require_held()
        return Event.STEP_BEGUN if self.gate.is_single_step else Event.RESUMED
