"""Mesh and solid with what is costly to find out about them again.

A solid finds its boundary, and trimesh normals, areas and hulls, when they are first asked for, and
keep them. What the rooms above ask of every part is kept in the file and put back, bit for bit, so
that a part read from the file answers as the one that was compiled.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from ..boundary import Boundary
from ..solid import Solid
from ._codec import make_codec
from ._columns import Codec, CodecError, Reader, Tree, Writer, parts_of

Array = NDArray[np.float64]
Triangles = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class StoredMesh:
    """What of a mesh is kept; also of its hull, which has no hull of its own."""

    vertices: Array
    faces: Triangles
    face_normals: Array
    area_faces: Array


@dataclass(frozen=True, eq=False, slots=True)
class StoredBody:
    """A mesh and its convex hull."""

    mesh: StoredMesh
    hull: StoredMesh


class Meshes(Codec):
    """`trimesh.Trimesh`; colours, materials and the name of its file are not of the part."""

    def __init__(self) -> None:
        self._body = make_codec(StoredBody)
        self.says = f"Trimesh {self._body.says}"

    def accepts(self, value: object) -> bool:
        return type(value) is trimesh.Trimesh

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        for value in column:
            if not self.accepts(value):
                raise TypeError(f"{type(value).__name__} where a mesh is declared")
        bodies = [StoredBody(_stored(mesh), _stored(mesh.convex_hull)) for mesh in column]
        return self._body.write(bodies, to)

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        return [_body(stored) for stored in self._body.read(tree, count, of)]


def _stored(mesh: trimesh.Trimesh) -> StoredMesh:
    return StoredMesh(
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces),
        np.asarray(mesh.face_normals),
        np.asarray(mesh.area_faces),
    )


def _body(stored: StoredBody) -> trimesh.Trimesh:
    mesh = _mesh(stored.mesh)
    mesh._cache["convex_hull"] = _mesh(stored.hull)  # noqa: SLF001  (as in _mesh)
    return mesh


def _mesh(stored: StoredMesh) -> trimesh.Trimesh:
    n = len(stored.faces)
    shapes = (stored.vertices.shape[1:], stored.faces.shape[1:], stored.face_normals.shape)
    if shapes != ((3,), (3,), (n, 3)) or stored.area_faces.shape != (n,):
        raise CodecError("arrays that make no mesh")
    if n and not 0 <= stored.faces.min() <= stored.faces.max() < len(stored.vertices):
        raise CodecError("triangles of corners that are not there")
    mesh = trimesh.Trimesh(stored.vertices, stored.faces, process=False)
    # the constructor's `initial_cache` is thrown away once the corners are set, and its
    # `face_normals` are not taken as they are, so what is known is put where it would be looked for
    cache = mesh._cache  # noqa: SLF001
    cache.verify()
    cache["face_normals"] = stored.face_normals
    cache["area_faces"] = stored.area_faces
    return mesh


class Solids(Codec):
    """`Solid`, with its boundary in place."""

    def __init__(self) -> None:
        self._solid = make_codec(Solid, {trimesh.Trimesh: Meshes()})
        self._boundary = make_codec(Boundary)
        self.says = f"{self._solid.says} {self._boundary.says}"

    def accepts(self, value: object) -> bool:
        return self._solid.accepts(value)

    def write(self, column: Sequence[Any], to: Writer) -> Tree:
        solids = self._solid.write(column, to)
        return [solids, self._boundary.write([solid.boundary for solid in column], to)]

    def read(self, tree: object, count: int, of: Reader) -> list[Any]:
        inner = parts_of(tree, 2)
        solids = self._solid.read(inner[0], count, of)
        for solid, boundary in zip(solids, self._boundary.read(inner[1], count, of), strict=True):
            vars(solid)["boundary"] = boundary
        return solids


def called(solid: Solid, name: str) -> Solid:
    """Return a solid under another name, with all it knows."""
    if solid.name == name:
        return solid
    twin = replace(solid, name=name)
    vars(twin)["boundary"] = solid.boundary
    return twin
