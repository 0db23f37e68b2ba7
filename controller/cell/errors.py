"""What goes wrong at the level of the cell; driver and room errors are turned into these words."""

from .machine import PartFault


class CellError(Exception):
    """The cell cannot go on: it aborts, and a person has to look."""


class InterlockError(CellError):
    """A safety copy is not healthy: emergency stop, door, supply."""


class ReleaseRefusedError(CellError):
    """A gripper was told to open that is the only one to hold the part: a bug, caught in time."""


class PartProblemError(Exception):
    """The part, not the cell, is the trouble: hold where it is safe and say so.

    Attributes
    ----------
    code : stable short name, as in the manual
    """

    def __init__(self, code: str, message: str) -> None:
        super().__init__(message)
        self.code = code


class PartFaultError(PartProblemError):
    """A fault of the part that the cell may recover from by itself.

    Attributes
    ----------
    fault : which
    """

    def __init__(self, fault: PartFault, message: str) -> None:
        super().__init__(fault.value, message)
        self.fault = fault
