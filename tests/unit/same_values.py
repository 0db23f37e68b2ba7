"""Whether two values are the same to the bit, whatever they are made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import trimesh

from controller.cad import Solid

OWN = {Solid: ("boundary", "hull_mm")}  # what is found when first asked for, beside the fields


def assert_same(a: Any, b: Any, where: str = "part") -> None:
    """Same types, same values, to the bit; only a mesh is compared by what is asked of it."""
    assert type(a) is type(b), f"{where}: {type(a)} {type(b)}"
    if isinstance(a, trimesh.Trimesh):
        for name in ("vertices", "faces", "face_normals", "area_faces", "bounds", "triangles"):
            assert_same(np.asarray(getattr(a, name)), np.asarray(getattr(b, name)), name)
        assert a.volume == b.volume
        assert np.array_equal(a.center_mass, b.center_mass)
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), where
    elif is_dataclass(a):
        for name in (*(field.name for field in fields(a)), *OWN.get(type(a), ())):
            assert_same(getattr(a, name), getattr(b, name), f"{where}.{name}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            assert_same(x, y, f"{where}[{i}]")
    elif isinstance(a, Mapping):
        assert_same(tuple(a.items()), tuple(b.items()), where)
    else:
        assert a == b or (a != a and b != b), f"{where}: {a!r} {b!r}"
