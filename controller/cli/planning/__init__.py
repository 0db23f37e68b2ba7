"""Plans, and what is known to be wrong before a run: nothing moves."""

from .commands import check, plan

__all__ = ["check", "plan"]
