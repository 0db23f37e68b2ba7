"""Colours the part's surface: each point like the nearest sample on the same face."""

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import Float32Array, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import inverse_pose, transform

from ..ray_drawing import FINER
from .bodies import SceneMesh
from .render import Paint, RayHits

# Faces are moved this far apart, so that the nearest sample is on the same face.
APART_MM = 1e4


class Painter:
    """Colours of one part's surface, by sample."""

    def __init__(self, solid: Solid, samples: SurfaceSamples) -> None:
        self._faces = np.asarray(solid.face_of_triangle)
        apart = APART_MM * samples.face_ids[:, None].astype(np.float64)
        self._tree = cKDTree(np.hstack([samples.points_mm, apart]))
        self._count = len(samples.points_mm)

    def sample_at(self, stage: SceneMesh, hits: RayHits) -> IntArray:
        """Return the nearest sample of each ray (height, width), -1 off the part."""
        out = np.full(hits.triangle.shape, -1, dtype=np.int64)
        on_part = hits.triangle >= stage.first_of_part
        if on_part.any():
            faces = self._faces[hits.triangle[on_part] - stage.first_of_part]
            points = transform(inverse_pose(stage.T_world_part), hits.points_mm[on_part])
            _, nearest = self._tree.query(np.column_stack([points, APART_MM * faces]))
            out[on_part] = np.minimum(nearest, self._count - 1)
        return out

    def paint(self, stage: SceneMesh, hits: RayHits, colours: Float32Array) -> Paint:
        """Return the colour of each ray's nearest sample; found once per pixel.

        Parameters
        ----------
        stage : the cell at the moment of the picture
        hits : hit of each ray of the picture
        colours : (n, 3) red, green, blue of each sample, 0 to 255
        """
        height, width = hits.triangle.shape
        coarse = RayHits(hits.triangle[::FINER, ::FINER], hits.points_mm[::FINER, ::FINER])
        sample = self.sample_at(stage, coarse).repeat(FINER, axis=0).repeat(FINER, axis=1)
        sample = sample[:height, :width]
        sample[hits.triangle < stage.first_of_part] = -1
        return Paint(sample, colours)
