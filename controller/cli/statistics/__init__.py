"""`cellctl stats` and `gauge`: what was measured over parts, and what measuring itself scatters."""

from .commands import gauge, stats

__all__ = ["gauge", "stats"]
