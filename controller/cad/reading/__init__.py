"""CAD files of every kind, read into one solid, or refused with the reason."""

from ._ahead import check_ahead, is_binary_stl
from ._files import load_solid
from .step.references import digests_of, files_of

__all__ = ["check_ahead", "digests_of", "files_of", "is_binary_stl", "load_solid"]
