"""`commission` measures the real cell; `print-target` writes the boards for it."""

from .commands import commission, jog, print_target, teach

__all__ = ["commission", "jog", "print_target", "teach"]
