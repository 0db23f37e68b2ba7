"""Numbers, counts, times and durations as people read them."""

from datetime import datetime
from typing import Final

# Coverage factor k: an expanded uncertainty in standard ones.
K_U: Final = 2


def num(value: float | None, decimals: int = 1) -> str:
    """Return a number with a fixed count of decimals; a dash if it is unknown."""
    return "–" if value is None else f"{value:.{decimals}f}"


def utc(at: datetime) -> str:
    """Return a time in UTC, to the second."""
    return f"{at:%Y-%m-%d %H:%M:%S} UTC"


def span(seconds: float) -> str:
    """Return a duration in seconds, minutes or hours, as people read it."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min"


def count_of(count: int, noun: str) -> str:
    """Return a number with its noun, as in ``1 part`` or ``2 parts``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
