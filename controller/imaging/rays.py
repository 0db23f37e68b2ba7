"""Rays cast on one mesh: the first hit of a straight line of sight.

Embree works in single precision: with lengths in mm and a scene of one metre, hit distances are
right to about 1e-4 mm. A ray that grazes an edge shared by two triangles may miss both, so callers
never rely on one ray along an edge (planning-facts.md 3.2).
"""

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from controller.arrays import BoolArray, FloatArray, Int32Array


class RayCaster:
    """Ray caster on a fixed mesh; origins, directions and results are in the mesh's frame."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._scene = EmbreeScene()
        vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float32)
        faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
        self._geometry = TriangleMesh(self._scene, vertices, faces)
        self.normals: FloatArray = np.asarray(mesh.face_normals, dtype=np.float64)

    def first_hit(
        self, origins_mm: FloatArray, directions: FloatArray, within: FloatArray | None = None
    ) -> tuple[Int32Array, FloatArray]:
        """Return the triangle that each ray meets first, and its distance.

        Parameters
        ----------
        origins_mm, directions : (n, 3), or (3,) where all rays begin at one point or are parallel;
            directions need not have unit length
        within : (n,) end of each ray, in units of its direction's length; a short ray is cheap

        Returns
        -------
        triangle : (n,) int, -1 where the ray meets nothing
        distance_mm : (n,) distance in units of the direction's length, inf without a hit
        """
        shape = np.broadcast_shapes(origins_mm.shape, directions.shape)
        hits = self._scene.run(
            np.ascontiguousarray(np.broadcast_to(origins_mm, shape), dtype=np.float32),
            np.ascontiguousarray(np.broadcast_to(directions, shape), dtype=np.float32),
            dists=None if within is None else np.ascontiguousarray(within, dtype=np.float32),
            output=1,
        )
        triangle = np.asarray(hits["primID"], dtype=np.int32)
        distance = np.asarray(hits["tfar"], dtype=np.float64)
        return triangle, np.where(triangle >= 0, distance, np.inf)

    def blocked(
        self,
        origins_mm: FloatArray,
        directions: FloatArray,
        max_distance_mm: float | FloatArray | None = None,
    ) -> BoolArray:
        """Return a mask (n,) of the rays that hit anything.

        Parameters
        ----------
        origins_mm, directions : as in `first_hit`
        max_distance_mm : (n,) or one for all, where the ray ends, in units of the direction's
            length; None for rays without end
        """
        if max_distance_mm is None:  # anything will do, and need not be the first
            shape = np.broadcast_shapes(origins_mm.shape, directions.shape)
            met = self._scene.run(
                np.ascontiguousarray(np.broadcast_to(origins_mm, shape), dtype=np.float32),
                np.ascontiguousarray(np.broadcast_to(directions, shape), dtype=np.float32),
                query="OCCLUDED",
            )
            return np.asarray(met) >= 0
        _, distance = self.first_hit(origins_mm, directions)
        return np.isfinite(distance) & (distance < max_distance_mm)
