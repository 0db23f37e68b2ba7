"""`commission` measures the cell as it really stands; `print-target` writes the boards for it."""

from .commands import commission, jog, print_target, teach

__all__ = ["commission", "jog", "print_target", "teach"]
