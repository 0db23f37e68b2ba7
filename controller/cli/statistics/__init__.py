"""`cellctl stats`: what was measured over the parts of a recipe."""

from .commands import stats

__all__ = ["stats"]
