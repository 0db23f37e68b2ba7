"""CAD files of every kind, read into one solid, or refused with the reason."""

from ._files import load_solid

__all__ = ["load_solid"]
