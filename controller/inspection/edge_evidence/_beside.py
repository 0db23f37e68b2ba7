"""Surface beside edges, compared by the edges themselves.

No lit picture shows a defect whole where it reaches an edge: the edge's own blur and play hide its
border there. But a chip, a burr or a dent that reaches an edge moves the edge. So an edge that is
in place compares the strip beside it: a defect of the smallest size, centred at a distance from the
edge, moves the edge by half its size less that distance, and counts where that is more than a
picture's limit for the edge (ADR 122).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples

from ._faces import OF_ITS_EDGES, FaceEdges, confirmed
from ._looks import EdgeLook, EdgeLooks, State


def compared_beside(
    samples: SurfaceSamples, shown: EdgeLooks, faces: Mapping[int, FaceEdges]
) -> BoolArray:
    """Return a mask (n,) of the surface samples that the edges beside them compare.

    Parameters
    ----------
    samples : n samples of the surface
    shown : looks at the part's edges
    faces : evidence by face id; a face that its edges verify is compared as far as they are in
        place
    """
    edges, smallest_mm = shown.edges, shown.smallest_mm
    out = np.zeros(len(samples.points_mm), dtype=bool)
    if not shown.every:
        return out
    least_mm = _least_mm(shown.every)
    reach_mm = 0.5 * smallest_mm - least_mm
    for face in np.unique(edges.faces).tolist():
        points, side = np.nonzero(edges.faces == face)
        mine = np.flatnonzero(samples.face_ids == face)
        if face in faces and faces[face].how == OF_ITS_EDGES:
            # no defect of the smallest size fits between the edges
            reach_mm_here = np.where(least_mm[points, side] < smallest_mm, np.inf, -np.inf)
        else:
            reach_mm_here = reach_mm[points, side]
        if len(mine) == 0 or not (reach_mm_here > 0).any():
            continue
        away, nearest = cKDTree(edges.points_mm[points]).query(samples.points_mm[mine])
        out[mine] = away <= reach_mm_here[nearest]
    return out


def _least_mm(looks: Sequence[EdgeLook]) -> FloatArray:
    """Return the least displacement (n, 2) along either face that any picture excludes, else inf.

    Parameters
    ----------
    looks : looks at edges, at least one
    """
    in_place = np.stack([look.state == State.IN_PLACE for look in looks])
    counts = in_place & confirmed(looks, in_place)
    out = np.full(looks[0].least_mm.shape, np.inf)
    for look, one in zip(looks, counts, strict=True):
        out[one] = np.minimum(out[one], look.least_mm[one])
    return out
