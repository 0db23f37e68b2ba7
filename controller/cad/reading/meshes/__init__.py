"""Triangle files of each kind: bytes in, corners and triangles out, or refused with the reason."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Final

from controller.arrays import FloatArray, IntArray

from .obj import read_obj
from .off import read_off
from .ply import read_ply
from .stl import read_stl
from .threemf import read_3mf

__all__ = ["TRIANGLE_READERS", "read_3mf"]

# Readers of the formats that name no unit.
TRIANGLE_READERS: Final[Mapping[str, Callable[[bytes, Path], tuple[FloatArray, IntArray]]]] = (
    MappingProxyType({".stl": read_stl, ".obj": read_obj, ".ply": read_ply, ".off": read_off})
)
