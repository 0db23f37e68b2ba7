"""Pausing and resuming. The running action is not ended: its task waits at the gate."""

from dataclasses import dataclass

from controller.cell.devices.interlocks import check_interlocks
from controller.cell.devices.stopping import Stopping
from controller.cell.machine import Event, PauseKind
from drivers.kinds import IoBlock, Stop

from ..services import Gate, Grippers, Mover, Standstill
from ..services.records import BatchRecord


@dataclass(frozen=True, slots=True, eq=False)
class SuspendAction:
    """Brings the cell to its pause.

    Attributes
    ----------
    gate : gate that holds the work at the requested point
    stopping : stops the arm, where the pause is to begin now, and jaws, where a door is open
    standstill : remembers how the cell stands from then on
    """

    gate: Gate
    stopping: Stopping
    standstill: Standstill

    async def run(self) -> Event:
        """Wait until nothing moves or will move; *now* stops the arm; return ``PAUSED``.

        Raises
        ------
        DeviceError : a device does not confirm that it has stopped
        """
        stopped: frozenset[Mover] = frozenset()
        while not self.gate.is_settled:
            # what the arm has stored ends with it: before its next motion the driver sets every
            # target to where the axis stands
            due = self._to_be_stopped() - stopped
            if due:
                stopped |= due
                await self._stop(due)
            else:
                await self.gate.changed()
        await self.standstill.note()
        return Event.PAUSED

    def _to_be_stopped(self) -> frozenset[Mover]:
        if self.gate.wanted is not PauseKind.NOW:
            return frozenset()
        return self.gate.movers if self.gate.halts_jaws else self.gate.movers & {Mover.ARM}

    async def _stop(self, movers: frozenset[Mover]) -> None:
        if not self.gate.halts_jaws:
            await self.stopping.stop_arm(Stop.RAMP)
            return
        await self.stopping.stop_moving(
            is_arm=bool(movers - {Mover.FIXED_JAWS}), is_fixed=Mover.FIXED_JAWS in movers
        )


@dataclass(frozen=True, slots=True, eq=False)
class UnsuspendAction:
    """Checks that a paused cell may go on.

    Attributes
    ----------
    gate : gate with the first motion
    io : the interlocks
    grippers : check that what is held is still held
    record : journals the motion that comes first
    standstill : knows whether the cell still stands as it was left
    """

    gate: Gate
    io: IoBlock
    grippers: Grippers
    record: BatchRecord
    standstill: Standstill

    async def run(self) -> Event:
        """Check interlocks and hold; return ``RESUMED``, or ``STEP_BEGUN`` for a single step.

        Where the door has been open and no gripper has the part, return ``LOOK_AGAIN``.

        Raises
        ------
        InterlockError : a safety copy is not healthy
        NotProvenError : after an open door, the arm or a jaw stands elsewhere than it was left
        PartFaultError : the part is gone
        """
        check_interlocks(self.io)
        await self.standstill.prove()
        first = await self.standstill.next_motion()
        if first is not None:
            self.record.note(first)
        if self.standstill.looks_again:
            self.standstill.forget()
            return Event.LOOK_AGAIN
        if not self.record.is_once_open:  # its own confirmation follows
            with self.gate.checking():
                await self.grippers.require_held()
        self.standstill.forget()
        return Event.STEP_BEGUN if self.gate.is_single_step else Event.RESUMED
