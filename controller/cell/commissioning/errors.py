"""What ends a step of commissioning."""

from ..errors import CellError


class StepFailedError(CellError):
    """What the step found is not as it should be; the message says what to do about it."""


class NobodyThereError(CellError):
    """A person is required and nobody is there."""


class DeclinedError(CellError):
    """A person ended the step."""
