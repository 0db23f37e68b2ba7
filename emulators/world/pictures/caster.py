"""Rays from a camera: the triangles they meet, and the surfaces there."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import Array32, Assembly
from .light import CHUNK, Index, Spots, chunks


@dataclass(slots=True, eq=False)
class Hits:
    """The hits of some rays: triangle (-1: nothing), distance in ray lengths, place in it."""

    triangle: NDArray[np.int32]
    far: Array32
    u: Array32
    v: Array32


class Caster:
    """Casts rays from one point.

    Parameters
    ----------
    origin_mm : (3,) the camera's, in the world
    """

    def __init__(self, origin_mm: Array32) -> None:
        self._origin_mm = origin_mm
        self._origins = np.tile(origin_mm, (CHUNK, 1))

    def meet(self, scene: Any, directions: Array32) -> Hits:  # noqa: ANN401  (embree has no types)
        """Return the hits of rays from the camera, directions (n, 3) of any length."""
        parts = []
        for part in chunks(len(directions), CHUNK) or [slice(0)]:
            some = directions[part]
            parts.append(scene.run(self._origins[: len(some)], some, output=True))
        if len(parts) == 1:
            found = parts[0]
            return Hits(found["primID"], found["tfar"], found["u"], found["v"])
        names = ("primID", "tfar", "u", "v")
        return Hits(*(np.concatenate([one[name] for one in parts]) for name in names))

    def spots(
        self,
        assembly: Assembly,
        hits: Hits,
        directions: Array32,
        *,
        curved: bool,
        met: Index | None = None,
    ) -> Spots:
        """Return the surface spots that rays met.

        Parameters
        ----------
        assembly : the triangles
        hits : return value of `meet` for them
        directions : (n, 3) directions of these rays
        curved : True if normals follow curved surfaces; otherwise they are the triangles'
        met : numbers of the rays that matter; None: all that met anything
        """
        if met is None:
            met = np.flatnonzero(hits.triangle >= 0)
        triangle, views = hits.triangle[met], directions[met]
        flat = _towards_camera(assembly.flat[triangle], views)
        normals = flat
        if curved:
            corner = assembly.normals[triangle]
            u, v = hits.u[met, None], hits.v[met, None]
            normals = corner[:, 0] * (1.0 - u - v) + corner[:, 1] * u + corner[:, 2] * v
            normals /= np.sqrt(np.einsum("ij,ij->i", normals, normals))[:, None] + np.float32(1e-9)
            normals = _towards_camera(normals, views)
        return Spots(
            met,
            self._origin_mm + views * hits.far[met, None],
            normals,
            flat,
            views,
            assembly.material[triangle],
            assembly.panel[triangle],
            triangle >= assembly.fixed_count,
        )


def _towards_camera(normals: Array32, views: Array32) -> Array32:
    """Return normals turned over where they point away."""
    away = np.einsum("ij,ij->i", normals, views) > 0.0
    normals[away] = -normals[away]
    return normals
