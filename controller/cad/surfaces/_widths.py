"""Width of faces: how far from its edges a face reaches, and how far a share of it."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from ..solid import Solid
from ._shares import KEPT_PARTS

PER_FACE: Final = 400  # random points per face, for its width to a few per cent


def inner_mm(solid: Solid, share: float = 0.0) -> FloatArray:
    """Return the distance (f,) from its edges beyond which a share of each face lies.

    By default that of its farthest place: the radius of the largest disc on the face, off its
    edges. It is inf for a face without edges.

    Parameters
    ----------
    solid : the part
    share : of the face's area, from 0 to 1
    """
    return np.array([np.quantile(away, 1.0 - share) for away in _distances(solid)])


@lru_cache(maxsize=KEPT_PARTS)
def _distances(solid: Solid) -> tuple[FloatArray, ...]:
    """Return the distances of random points on each face from its edges, (n,) each."""
    b = solid.boundary
    vertices = np.asarray(solid.mesh.vertices, dtype=np.float64)
    corners = np.asarray(solid.mesh.triangles, dtype=np.float64)
    areas = np.asarray(solid.mesh.area_faces)
    rng = np.random.default_rng(0)
    out = [np.full(1, np.inf)] * len(solid.faces)
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
        out[face] = _distance(points, polylines)
    return tuple(out)


def _distance(points: FloatArray, polylines: Sequence[FloatArray]) -> FloatArray:
    """Return the distances (n,) of points (n, 3) from the nearest of some polylines."""
    start = np.concatenate([line[:-1] for line in polylines])
    along = np.concatenate([np.diff(line, axis=0) for line in polylines])
    square = np.maximum((along**2).sum(axis=1), 1e-18)
    t = np.clip(((points[:, None] - start) * along).sum(axis=2) / square, 0.0, 1.0)
    off = points[:, None] - (start + t[..., None] * along)
    return np.asarray(np.sqrt((off**2).sum(axis=2)).min(axis=1))
