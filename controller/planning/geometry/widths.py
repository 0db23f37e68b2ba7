"""Width of an outline."""

import numpy as np
from scipy.spatial import ConvexHull

from controller.arrays import FloatArray


def narrowest_mm(corners: FloatArray) -> float:
    """Return the least width of a convex outline between two parallel lines (exact) [mm].

    Parameters
    ----------
    corners : (n, 2) points whose hull is the outline
    """
    outline = corners[ConvexHull(corners).vertices]
    along = np.roll(outline, -1, axis=0) - outline
    across = np.column_stack([-along[:, 1], along[:, 0]])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return float(np.ptp(outline @ across.T, axis=0).min())
