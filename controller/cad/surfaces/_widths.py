"""Width of faces: the largest disc on each, clear of its edges."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..solid import Solid
from ._shares import KEPT_PARTS

PER_FACE: Final = 400  # random points per face, for its largest disc to a few per cent


@lru_cache(maxsize=KEPT_PARTS)
def inner_mm(solid: Solid) -> FloatArray:
    """Return the radius (f,) of the largest disc on each face, off its edges; inf without edges."""
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    corners = np.asarray(solid.mesh.triangles, dtype=np.float64)
    areas = np.asarray(solid.mesh.area_faces)
    rng = np.random.default_rng(0)
    out = np.full(len(solid.faces), np.inf)
    sides = b.face.reshape(-1, 2)
    for face in range(len(solid.faces)):
        polylines = [
            vertices[b.chain_of(e)] for e in np.flatnonzero((sides == face).any(axis=1)).tolist()
        ]
        mine = np.flatnonzero(solid.face_of_triangle == face)
        if not polylines or len(mine) == 0:
            continue
        drawn = rng.choice(mine, PER_FACE, p=areas[mine] / areas[mine].sum())
        u, v = rng.random((2, PER_FACE, 1))
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        a, p, q = np.moveaxis(corners[drawn], 1, 0)
        points = a + u * (p - a) + v * (q - a)
        out[face] = _max_distance(points, polylines)
    return out


def _max_distance(points: FloatArray, polylines: Sequence[FloatArray]) -> float:
    """Return the largest distance of points (n, 3) from the nearest of some polylines."""
    start = np.concatenate([line[:-1] for line in polylines])
    along = np.concatenate([np.diff(line, axis=0) for line in polylines])
    square = np.maximum((along**2).sum(axis=1), 1e-18)
    t = np.clip(((points[:, None] - start) * along).sum(axis=2) / square, 0.0, 1.0)
    off = points[:, None] - (start + t[..., None] * along)
    return float(np.sqrt((off**2).sum(axis=2)).min(axis=1).max())
