"""`print-target`: boards to print; what commissioning a cell needs of the command line."""

from .commands import print_target

__all__ = ["print_target"]
