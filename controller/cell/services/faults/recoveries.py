"""Applies the fault policy to the current part, journals its decisions, and learns from it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from controller.cell.alarms import alarm_of
from controller.cell.errors import PartFaultError, PartProblemError, PolicyAbortError
from controller.cell.journal.rows import SourceDemoted
from controller.cell.machine import (
    BACK,
    GRASP,
    PARKING,
    Act,
    Event,
    FaultPolicy,
    PartFault,
    Recovery,
    Rung,
    decide,
)
from controller.config import Cell, FaultsSection, Recipe
from drivers.clock import CellClock
from messages import key, say

from ..records import BatchRecord

HOLDS: Final = key(
    "{error} (the cell has recovered {recovery_count} times with this part and now waits for you)"
)
ABORTS: Final = key(
    "{error} (the cell has recovered {recovery_count} times with this part; its policy ends in a "
    "stop)"
)


@dataclass(frozen=True, slots=True)
class RecoveryAction:
    """The action that leads back to the work after a part fault.

    Attributes
    ----------
    event : leads to the state that does it
    words : for the operator
    delay_s : wait so long first [cell s]
    """

    event: Event
    words: str
    delay_s: float = 0.0


def faults_section(cell: Cell, recipe: Recipe) -> FaultsSection:
    """Return the cell's section on faults, with the recipe's settings in its place."""
    return cell.faults if recipe.faults is None else cell.faults.replaced_by(recipe.faults)


def fault_policy(section: FaultsSection) -> FaultPolicy:
    """Return the policy that a section `faults` describes."""
    ladders = {
        name: tuple(Rung(Act(step.do), step.times, step.delay_s) for step in value)
        for name in FaultsSection.model_fields
        if isinstance(value := getattr(section, name), tuple)
    }
    return FaultPolicy(ladders, section.times_in_all)


class Recoveries:
    """The fault policy, applied to the current part.

    Parameters
    ----------
    record : record of the batch; keeps what was recovered from, and what the batch learns
    policy : function that returns the policy of the cell and of the current part's recipe
    clock : clock of the cell
    """

    def __init__(
        self, record: BatchRecord, policy: Callable[[], FaultPolicy], clock: CellClock
    ) -> None:
        self._record = record
        self._policy = policy
        self._clock = clock
        self._is_drop_booked = False

    def decision(self, fault: PartFault) -> Act:
        """Return the act that the policy has for a fault of the current part."""
        return self._decide(fault).act

    def may_recover(self, fault: PartFault) -> bool:
        """Return whether work would go on after a fault, other than by parking the part."""
        return self.decision(fault) not in (Act.PARK, Act.HOLD, Act.ABORT)

    def _decide(self, fault: PartFault) -> Rung:
        part = self._record.part
        return decide(self._policy(), fault, part.recoveries, is_parked=part.parked is not None)

    def book(self, error: PartFaultError) -> RecoveryAction:
        """Return the recovery action for a fault; journal it and count it against its source.

        Raises
        ------
        PartProblemError : the policy ends here: the cell holds
        PolicyAbortError : the policy ends here: the cell aborts
        """
        part = self._record.part
        if error.fault is PartFault.DROPPED and self._is_drop_booked:
            return RecoveryAction(*BACK[error.fault])  # both grippers may report the same drop
        self._learn(error)
        rung = self._decide(error.fault)
        if rung.act in (Act.HOLD, Act.ABORT):
            template = ABORTS if rung.act is Act.ABORT else HOLDS
            ended = say(template, error=error, recovery_count=len(part.recoveries))
            if rung.act is Act.ABORT:
                raise PolicyAbortError(ended, error.code)
            raise PartProblemError(error.code, ended) from error
        self._is_drop_booked = error.fault is PartFault.DROPPED
        event, words = PARKING if rung.act is Act.PARK else BACK[error.fault]
        recovery = Recovery(error.fault, str(error), rung.act)
        if rung.act in (Act.REGRASP, Act.PARK) and error.source.startswith(GRASP):
            self._record.avoid(error.source.removeprefix(GRASP))
        self._record.begin_recovery(recovery, words, error.source, error.code)
        return RecoveryAction(event, words, rung.delay_s)

    async def wait(self, action: RecoveryAction) -> None:
        """Wait for the policy's delay before a recovery action."""
        if action.delay_s > 0:
            await self._clock.sleep(action.delay_s)

    def forget_drop(self) -> None:
        """Count a part dropped from now on as another drop."""
        self._is_drop_booked = False

    def fail(self, source: str, reason: str) -> None:
        """Count a failure of a grasp or view; journal if it is avoided from now on.

        Parameters
        ----------
        source : source to look up
        reason : description of the event
        """
        demotion = self._record.budgets.fail(source, reason)
        if demotion is not None:
            self._record.note(
                SourceDemoted(
                    source=source,
                    failures=demotion.failure_count,
                    uses=demotion.use_count,
                    reason=reason,
                    alarm=alarm_of("demoted").number,
                )
            )

    def _learn(self, error: PartFaultError) -> None:
        if error.source:
            self.fail(error.source, str(error))
