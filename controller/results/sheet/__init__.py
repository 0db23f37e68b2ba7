"""What was compiled of a part, as one HTML page for the process engineer."""

from .sheet import write_sheet

__all__ = ["write_sheet"]
