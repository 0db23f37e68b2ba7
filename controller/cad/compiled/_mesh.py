"""Codecs of mesh and solid, with the data that are costly to compute again.

A solid computes its boundary and its hull, and trimesh its normals and areas, on first use, and
caches them. The file stores the results that later stages need of every part, so that a part read
from the file is equal, bit for bit, to the one that was compiled.
"""

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from controller.arrays import FloatArray, IntArray
from controller.cache import CacheError, Codec, converted, make_codec

from ..boundary import Boundary
from ..large import drop_derived
from ..solid import Solid


@dataclass(frozen=True, eq=False, slots=True)
class StoredMesh:
    """The arrays of a mesh that the cache keeps."""

    vertices: FloatArray
    faces: IntArray
    face_normals: FloatArray
    area_faces: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class StoredSolid:
    """A solid, its boundary and the corners of its hull."""

    solid: Solid
    boundary: Boundary
    hull_mm: FloatArray


def meshes() -> Codec:
    """Return the codec of `trimesh.Trimesh`.

    Colours, materials and the name of its file are not of the part.
    """
    return converted(
        trimesh.Trimesh,
        make_codec(StoredMesh),
        _stored,
        _mesh,
    )


def solids() -> Codec:
    """Return the codec of `Solid`, with its boundary and hull in place."""
    return converted(
        Solid,
        make_codec(StoredSolid, {Solid: make_codec(Solid, {trimesh.Trimesh: meshes()})}),
        lambda solid: StoredSolid(solid, solid.boundary, solid.hull_mm),
        _solid,
    )


def _solid(stored: StoredSolid) -> Solid:
    if stored.hull_mm.shape[1:] != (3,):
        raise CacheError("corners of a hull that are no points")
    vars(stored.solid).update(boundary=stored.boundary, hull_mm=stored.hull_mm)
    return stored.solid


def _stored(mesh: trimesh.Trimesh) -> StoredMesh:
    stored = StoredMesh(
        np.asarray(mesh.vertices),
        np.asarray(mesh.faces),
        np.asarray(mesh.face_normals),
        np.asarray(mesh.area_faces),
    )
    drop_derived(mesh)
    return stored


def _mesh(stored: StoredMesh) -> trimesh.Trimesh:
    n = len(stored.faces)
    shapes = (stored.vertices.shape[1:], stored.faces.shape[1:], stored.face_normals.shape)
    if shapes != ((3,), (3,), (n, 3)) or stored.area_faces.shape != (n,):
        raise CacheError("arrays that make no mesh")
    if n and not 0 <= stored.faces.min() <= stored.faces.max() < len(stored.vertices):
        raise CacheError("triangles of corners that are not there")
    mesh = trimesh.Trimesh(stored.vertices, stored.faces, process=False)
    # the constructor's `initial_cache` is thrown away once the corners are set, and its
    # `face_normals` are not taken as they are, so what is known is put where it would be looked for
    cache = mesh._cache  # noqa: SLF001
    cache.verify()
    cache["face_normals"] = stored.face_normals
    cache["area_faces"] = stored.area_faces
    return mesh


def called(solid: Solid, name: str) -> Solid:
    """Return a solid under another name, with all its computed data."""
    if solid.name == name:
        return solid
    twin = replace(solid, name=name)
    vars(twin).update(boundary=solid.boundary, hull_mm=solid.hull_mm)
    return twin
