"""What the store cannot do."""

from controller.results import ResultsError, UnknownRunError


class HistoryError(ResultsError):
    """The store cannot be opened, filled or read; the message names why and what helps."""


class NoSuchPartError(HistoryError, UnknownRunError):
    """There is no part of the name given."""
