"""Everything that follows from a part alone, computed once and kept in the cache."""

from ._mesh import solids
from .cache import cache_key, cached_part, is_kept, load_part, make_part
from .part import (
    UNITLESS,
    CompiledPart,
    CompileOptions,
    compile_part,
    compile_solid,
    options_among,
    part_name,
    spacing_for,
)

__all__ = [
    "UNITLESS",
    "CompileOptions",
    "CompiledPart",
    "cache_key",
    "cached_part",
    "compile_part",
    "compile_solid",
    "is_kept",
    "load_part",
    "make_part",
    "options_among",
    "part_name",
    "solids",
    "spacing_for",
]
