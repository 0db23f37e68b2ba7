"""Errors of the store."""

from controller.results.run import ResultsError, UnknownRunError


class HistoryError(ResultsError):
    """The store cannot be opened, filled or read; the message says why, and what to do."""


class NoSuchPartError(HistoryError, UnknownRunError):
    """There is no part of the name given."""
