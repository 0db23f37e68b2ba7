"""Decides whether a part fault is recovered from once more, and writes that down."""

from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal.rows import RecoveryBegun
from controller.cell.machine import (
    RECOVERY_ACTIONS,
    PartFault,
    Recovery,
    RecoveryAction,
    recovery_for,
)

from ..records import BatchRecord


class Recoveries:
    """The recovery policy, applied to the part at hand."""

    def __init__(self, record: BatchRecord) -> None:
        self._record = record
        self._is_drop_booked = False

    def may_recover(self, fault: PartFault) -> bool:
        """Return whether a fault of this kind would be recovered from."""
        return recovery_for(fault, self._record.part.recoveries) is not None

    def book(self, error: PartFaultError) -> RecoveryAction:
        """Return what the cell does about a fault, and write it down.

        Raises
        ------
        PartProblemError : it has been tried often enough
        """
        part = self._record.part
        if error.fault is PartFault.DROPPED and self._is_drop_booked:
            return RECOVERY_ACTIONS[error.fault]  # noticed twice: by the jaws and by the keep-alive
        action = recovery_for(error.fault, part.recoveries)
        if action is None:
            raise PartProblemError(
                error.code,
                f"{error} (the cell has recovered {len(part.recoveries)} times with this part "
                "and now waits for you)",
            ) from error
        self._is_drop_booked = error.fault is PartFault.DROPPED
        part.recoveries.append(Recovery(error.fault, str(error)))
        self._record.note(
            RecoveryBegun(
                fault=error.fault.value,
                reason=str(error),
                action=action.words,
                number=len(part.recoveries),
                custody=part.custody.key,
            )
        )
        self._record.show(f"{error}; {action.words}", remaining_s=None)
        return action

    def forget_drop(self) -> None:
        """Take a part that falls from now on for another fall."""
        self._is_drop_booked = False
