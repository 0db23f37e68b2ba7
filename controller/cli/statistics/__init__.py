"""`cellctl stats` and `gauge`: measurements over parts, and the scatter of measuring itself."""

from .commands import gauge, stats

__all__ = ["gauge", "stats"]
