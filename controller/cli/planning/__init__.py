"""`check` and `plan`: what is known before anything moves."""

from .commands import check, plan

__all__ = ["check", "plan"]
