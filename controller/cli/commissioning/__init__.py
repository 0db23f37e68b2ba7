"""`commission` finds out how the cell really stands; `print-target` writes the boards for it."""

from .commands import commission, print_target

__all__ = ["commission", "print_target"]
