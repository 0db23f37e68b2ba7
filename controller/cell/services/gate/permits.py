"""The permit to move: issued when a person starts, resumes or recovers; gone with every stop.

The machine decides (`controller.cell.machine`), the dispatcher issues and withdraws the permit, and
every motion requires it. So an action that a stop has overtaken moves nothing, even if it
continues.
"""

from dataclasses import dataclass

from controller.cell.errors import NoPermitError
from controller.cell.journal import Journal
from controller.cell.journal.rows import PermitIssued, PermitWithdrawn
from messages import key, say


@dataclass(frozen=True, slots=True)
class Permit:
    """Leave to move.

    Attributes
    ----------
    number : counts from 1 in a run
    by : the event that issued it
    """

    number: int
    by: str


class Permits:
    """The one permit of a cell, if there is any.

    Parameters
    ----------
    journal : journal for each permit and its withdrawal
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._permit: Permit | None = None
        self._number = 0
        self._withdrawn_by = key("nobody has started the cell")

    @property
    def permit(self) -> Permit | None:
        """The permit that is valid now."""
        return self._permit

    def issue(self, by: str) -> Permit:
        """Issue a new permit in place of any other, for the event ``by``; return it."""
        self._number += 1
        self._permit = Permit(self._number, by)
        self._journal.write(PermitIssued(number=self._number, by=by))
        return self._permit

    def withdraw(self, by: str) -> None:
        """Withdraw the permit; ``by`` is the event that did. Nothing if there is none."""
        permit, self._permit = self._permit, None
        self._withdrawn_by = by
        if permit is not None:
            self._journal.write(PermitWithdrawn(number=permit.number, by=by))

    def require(self) -> Permit:
        """Return the valid permit.

        Raises
        ------
        NoPermitError : there is none
        """
        if self._permit is None:
            raise NoPermitError(
                say(
                    "nothing may move: no permit since `{withdrawn_by}`; start or "
                    "resume the cell to permit motion",
                    withdrawn_by=self._withdrawn_by,
                )
            )
        return self._permit
