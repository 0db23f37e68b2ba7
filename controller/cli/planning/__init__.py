"""`check` and `plan`: everything known before anything moves."""

from .commands import check, plan

__all__ = ["check", "plan"]
