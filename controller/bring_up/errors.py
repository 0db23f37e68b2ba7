"""The errors that end a step of commissioning."""

from controller.cell.errors import CellError


class StepFailedError(CellError):
    """A result outside the limits of a step; the message says what to do about it."""


class NobodyThereError(CellError):
    """A person is required and nobody is there."""


class DeclinedError(CellError):
    """A person ended the step."""
