"""Collision tests of a part's triangles; the only module that uses FCL.

Margins are kept by growing the boxes that the triangles meet: FCL's `collide` is robust, its signed
distance is not (planning-facts.md 3.2). A box grown on all its faces holds every point within the
margin of it, so that growing errs on the safe side, at its edges by 0.41 of the margin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import fcl
import numpy as np
from scipy.spatial import ConvexHull

from controller.arrays import FloatArray, IntArray
from controller.cad import Solid

from .boxes import Box


class PartShape:
    """The triangles of a part in its CAD frame.

    Parameters
    ----------
    vertices_mm : (v, 3)
    faces : (f, 3) indices into them, closed and wound outwards
    hull_mm : (h, 3) corners of their convex hull; None to find them

    Attributes
    ----------
    box : its bounding box along the axes of the CAD frame
    hull_mm : (h, 3) points of the hull that can be its lowest one
    """

    def __init__(
        self, vertices_mm: FloatArray, faces: IntArray, hull_mm: FloatArray | None = None
    ) -> None:
        self._vertices_mm = np.ascontiguousarray(vertices_mm, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        low, high = self._vertices_mm.min(axis=0), self._vertices_mm.max(axis=0)
        self.box = Box.from_bounds(low[0], high[0], low[1], high[1], low[2], high[2])
        if hull_mm is None:
            hull_mm = self._vertices_mm[ConvexHull(self._vertices_mm).vertices]
        self.hull_mm = hull_mm
        self._model: fcl.BVHModel | None = None

    @classmethod
    def of(cls, solid: Solid) -> PartShape:
        """Return the shape of a solid."""
        return cls(np.asarray(solid.mesh.vertices), np.asarray(solid.mesh.faces), solid.hull_mm)

    def shrunk(self, by_mm: float) -> PartShape:
        """Return the shape made smaller in proportion: its bounding box by `by_mm` on each side.

        Parameters
        ----------
        by_mm : shrinkage; at most half of an edge of the box is removed
        """
        centre, half = self.box.T[:3, 3], self.box.half_mm
        scale = np.maximum(1.0 - by_mm / half, 0.5)
        vertices_mm, hull_mm = (
            centre + (points_mm - centre) * scale for points_mm in (self._vertices_mm, self.hull_mm)
        )
        return PartShape(vertices_mm, self._faces, hull_mm)

    def __getstate__(self) -> dict[str, Any]:
        """Leave FCL's model out of the state: it is built anew on demand."""
        return {**self.__dict__, "_model": None}

    @property
    def model(self) -> fcl.BVHModel:
        """FCL's tree over the triangles; the same one each time."""
        if self._model is None:
            self._model = fcl.BVHModel()
            self._model.beginModel(len(self._vertices_mm), len(self._faces))
            self._model.addSubModel(self._vertices_mm, self._faces)
            self._model.endModel()
        return self._model

    def holds(self, point_mm: FloatArray) -> bool:
        """Return True for a point (3,) inside the mesh, by the solid angle of its triangles."""
        if np.any(np.abs(point_mm - self.box.T[:3, 3]) > self.box.half_mm):
            return False
        a, b, c = np.moveaxis(self._vertices_mm[self._faces] - point_mm, 1, 0)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("ij,ij->i", a, np.cross(b, c))
        spread = la * lb * lc + lc * np.einsum("ij,ij->i", a, b)
        spread += lb * np.einsum("ij,ij->i", a, c) + la * np.einsum("ij,ij->i", b, c)
        # twice the sum of half solid angles; a full turn of 4 pi inside
        return bool(abs(np.arctan2(volume, spread).sum()) > np.pi)


@dataclass(frozen=True, slots=True, eq=False)
class PlacedShape:
    """A part's triangles at a pose T (4, 4) in some frame."""

    shape: PartShape
    T: FloatArray

    @property
    def box(self) -> Box:
        """The box round the part, in that frame."""
        return self.shape.box.placed(self.T)


class Triangles:
    """Collision tests of one part among boxes, at changing poses."""

    def __init__(self, shape: PartShape) -> None:
        self._shape = shape
        self._object = fcl.CollisionObject(shape.model)
        self._request = fcl.CollisionRequest()
        self._half = np.sort(shape.box.half_mm)

    def place(self, T_world_part: FloatArray) -> None:
        """Put the part at a pose (4, 4)."""
        self._T = T_world_part
        self._object.setTransform(fcl.Transform(T_world_part[:3, :3], T_world_part[:3, 3]))

    def meets(self, other: Triangles) -> bool:
        """Return True if the surfaces of two placed parts intersect."""
        result = fcl.CollisionResult()
        return bool(fcl.collide(self._object, other._object, self._request, result))

    def lowest_mm(self) -> float:
        """Return the height of the part's lowest point."""
        return float((self._shape.hull_mm @ self._T[2, :3]).min() + self._T[2, 3])

    def touch(self, R: FloatArray, centre_mm: FloatArray, half_mm: FloatArray) -> bool:
        """Return True if the part touches a solid box, or encloses it.

        Parameters
        ----------
        R : (3, 3) the box's axes in the world
        centre_mm : (3,) in the world
        half_mm : (3,) half of each edge
        """
        box = fcl.CollisionObject(fcl.Box(*(2.0 * half_mm)), fcl.Transform(R, centre_mm))
        if fcl.collide(self._object, box, self._request, fcl.CollisionResult()):
            return True
        if np.all(np.sort(half_mm) < self._half):  # small enough to be lost inside the part
            return self._shape.holds(self._T[:3, :3].T @ (centre_mm - self._T[:3, 3]))
        return False
