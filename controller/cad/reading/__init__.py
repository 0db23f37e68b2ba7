"""CAD files of every kind, read into one solid, or refused with the reason."""

from ._ahead import check_ahead
from ._files import load_solid

__all__ = ["check_ahead", "load_solid"]
