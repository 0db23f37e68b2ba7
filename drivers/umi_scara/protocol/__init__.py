"""The data on the line, as tables and bytes: no link, no clock, no log (umi_rtx.md 1, 2)."""

from . import codec, constants

__all__ = ["codec", "constants"]
