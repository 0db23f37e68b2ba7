"""What colour a place on the part has: that of the nearest sample on the same face."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from controller.cad import Solid, SurfaceSamples, inverse_pose, transform

from ._bodies import Stage
from ._render import Sight

Array = NDArray[np.float64]
Floats = NDArray[np.float32]

APART_MM = 1e4  # between two faces, so that no sample speaks for a place on another face


class Painter:
    """Colours of one part's surface, by sample."""

    def __init__(self, solid: Solid, samples: SurfaceSamples) -> None:
        self._faces = np.asarray(solid.face_of_triangle)
        apart = APART_MM * samples.face_ids[:, None].astype(np.float64)
        self._tree = cKDTree(np.hstack([samples.points_mm, apart]))
        self._count = len(samples.points_mm)

    def sample_at(self, stage: Stage, sight: Sight) -> NDArray[np.int64]:
        """Return the sample that speaks for each ray (height, width), -1 off the part."""
        out = np.full(sight.triangle.shape, -1, dtype=np.int64)
        on_part = sight.triangle >= stage.first_of_part
        if on_part.any():
            faces = self._faces[sight.triangle[on_part] - stage.first_of_part]
            points = transform(inverse_pose(stage.T_world_part), sight.points_mm[on_part])
            _, nearest = self._tree.query(np.column_stack([points, APART_MM * faces]))
            out[on_part] = np.minimum(nearest, self._count - 1)
        return out

    def paint(self, stage: Stage, sight: Sight, colours: Floats) -> Floats:
        """Return the colours (height, width, 3) of a picture, NaN off the part.

        Parameters
        ----------
        colours : (n, 3) of the samples
        """
        sample = self.sample_at(stage, sight)
        out = np.full((*sample.shape, 3), np.nan, dtype=np.float32)
        out[sample >= 0] = colours[sample[sample >= 0]]
        return out
