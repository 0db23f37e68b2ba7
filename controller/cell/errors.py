"""Errors of the cell: faults that stop it, and faults of one part."""

from .machine import PartFault


class CellError(Exception):
    """The cell cannot go on: it aborts, and a person has to look."""


class InterlockError(CellError):
    """An interlock rule does not hold: emergency stop, door, supply, or one of the cell file.

    Attributes
    ----------
    code : code of the rule's alarm
    holds : it holds the run, which can go on once the rule holds again
    """

    def __init__(self, message: str, code: str = "interlock", *, holds: bool = False) -> None:
        super().__init__(message)
        self.code = code
        self.holds = holds


class NotProvenError(CellError):
    """The cell moved while a door was open, so it cannot go on from there."""


class NoPermitError(CellError):
    """A motion without a permit: a bug, caught in time."""


class ReleaseRefusedError(CellError):
    """A gripper was to open that alone holds the part: a bug, caught in time."""


class LeaseError(CellError):
    """A device or space requested out of order, or never given back: a bug, caught in time."""


class PolicyAbortError(CellError):
    """The fault policy of cell or recipe has the cell abort.

    Attributes
    ----------
    code : code of the fault
    """

    def __init__(self, message: str, code: str) -> None:
        super().__init__(message)
        self.code = code


class PartProblemError(Exception):
    """A fault of the part, not the cell: hold safely; a person has to look.

    Attributes
    ----------
    code : stable short name, as in the manual
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


class PartFaultError(PartProblemError):
    """A part fault that the cell may recover from by itself.

    Attributes
    ----------
    fault : fault to raise
    source : the grasp or view that failed, as `machine.budgets` names it; empty if there is none
    """

    def __init__(
        self, fault: PartFault, message: str, *, source: str = "", code: str | None = None
    ) -> None:
        super().__init__(code or fault.value, message)
        self.fault = fault
        self.source = source
