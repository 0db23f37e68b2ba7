"""The errors that end a step of commissioning."""

from ..errors import CellError


class StepFailedError(CellError):
    """The step's result is outside its limits; the message says what to do about it."""


class NobodyThereError(CellError):
    """A person is required and nobody is there."""


class DeclinedError(CellError):
    """A person ended the step."""
