"""Decides whether the cell recovers from a part fault once more, and journals that."""

from controller.cell.errors import PartFaultError, PartProblemError
from controller.cell.journal.rows import RecoveryBegun
from controller.cell.machine import (
    RECOVERY_ACTIONS,
    PartFault,
    Recovery,
    RecoveryAction,
    recovery_for,
)

from .records import BatchRecord


class Recoveries:
    """The recovery policy, applied to the part at hand."""

    def __init__(self, record: BatchRecord) -> None:
        self._record = record
        self._is_drop_booked = False

    def may_recover(self, fault: PartFault) -> bool:
        """Return whether a fault of this kind would be recovered from."""
        return recovery_for(fault, self._record.part.recoveries) is not None

    def book(self, error: PartFaultError) -> RecoveryAction:
        """Return the recovery action for a fault, and journal it.

        Raises
        ------
        PartProblemError : it has been tried often enough
        """
        part = self._record.part
        if error.fault is PartFault.DROPPED and self._is_drop_booked:
            return RECOVERY_ACTIONS[error.fault]  # both grippers may report the same drop
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
        """Count a part that is dropped from now on as another drop."""
        self._is_drop_booked = False
