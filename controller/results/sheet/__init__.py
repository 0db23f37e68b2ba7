"""What was compiled of a part, as one HTML page for the process engineer."""

from .sheet import write_part_drawings, write_sheet

__all__ = ["write_part_drawings", "write_sheet"]
