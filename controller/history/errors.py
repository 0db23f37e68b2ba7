"""What the store cannot do."""


class HistoryError(Exception):
    """The store cannot be opened, filled or read; the message names why and what helps."""


class NoSuchPartError(HistoryError):
    """There is no part of the name given."""
