"""Everything that follows from a part alone, computed once and kept in one file."""

from ._cache import cache_key, cached_part, load_part, make_part, source_hash
from ._part import (
    UNITLESS,
    CompiledPart,
    CompileOptions,
    compile_part,
    compile_solid,
    options_among,
    part_name,
)
from .keeping import cache_dir

__all__ = [
    "UNITLESS",
    "CompileOptions",
    "CompiledPart",
    "cache_dir",
    "cache_key",
    "cached_part",
    "compile_part",
    "compile_solid",
    "load_part",
    "make_part",
    "options_among",
    "part_name",
    "source_hash",
]
