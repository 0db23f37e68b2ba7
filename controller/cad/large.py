"""Passes over a mesh of a million triangles without all its corners in memory.

Nine numbers a triangle are 90 MB at 1.2 million triangles, and each step of a formula allocates as
many again. Computations per triangle are therefore done in chunks; the results are the same.
"""

from collections.abc import Iterator

import numpy as np
import trimesh

from controller.arrays import FloatArray, IntArray
from controller.memory import give_back

AT_ONCE = 100_000  # rows of a chunk: 7 MB of corners
LASTING = ("face_normals", "area_faces")  # trimesh's cached arrays that are kept

# trimesh's cached neighbours, kept from one stage of the compile to the next.
ADJACENCY = ("face_adjacency", "face_adjacency_edges", "face_adjacency_angles")


def spans(count: int, at_once: int = AT_ONCE) -> Iterator[slice]:
    """Yield slices that go through ``count`` rows in order, ``at_once`` at a time."""
    for begin in range(0, count, at_once):
        yield slice(begin, min(begin + at_once, count))


def sums_by(labels: IntArray, values: FloatArray, count: int | None = None) -> FloatArray:
    """Return the sums (k, 3) of rows by their label.

    Parameters
    ----------
    labels : (n,) from 0
    values : (n, 3)
    count : number of the sums at least, however large the labels; None for as many as there are
        labels
    """
    return np.column_stack(
        [np.bincount(labels, weights=values[:, i], minlength=count or 0) for i in range(3)]
    )


def drop_derived(mesh: trimesh.Trimesh, *kept: str) -> None:
    """Clear trimesh's cache except for normals, areas and the given keys.

    Parameters
    ----------
    mesh : stays as it is; what is forgotten is worked out again where it is needed
    kept : more names of `trimesh.Trimesh` whose values are worth their memory
    """
    lasting = {*LASTING, *kept}
    cache = mesh._cache  # noqa: SLF001 - trimesh has no other way to give up single values
    cache.verify()
    for name in [name for name in cache.cache if name not in lasting]:
        del cache.cache[name]
    if len(mesh.faces) > AT_ONCE:
        give_back()
