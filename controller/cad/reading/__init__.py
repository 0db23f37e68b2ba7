"""CAD files of every kind, read into one solid, or refused with the reason."""

from ._files import FORMATS, load_solid

__all__ = ["FORMATS", "load_solid"]
