"""Pieces of a part: facets with their corners, tests against surfaces, rings round facets."""

import numpy as np
import trimesh

from controller.arrays import BoolArray, IntArray

from ...large import AT_ONCE, spans
from ..formulas.fits import Cloud, thinning
from ..formulas.primitives import Primitive
from ._facets import Facets
from ._neighbours import SmoothNeighbours, rows

# half a segment of a 16-sided rod; from 17 segments on it is a curved wall
COS_HALF_STEP = np.cos(np.radians(11.6))
# Cosine for a triangle of a ball or a ring, seen from its corners.
COS_FACET = np.cos(np.radians(16.0))
TIGHT_MM = 0.0002  # files keep 1e-4 mm or 7 digits; a guess from a few facets has to be this good
MIN_FACETS = 4  # three facets may be a bevelled corner or a fillet


class Pieces:
    """Pieces of one part, by the numbers of their facets.

    Parameters
    ----------
    facets : the m facets of the part
    mesh : the part, CAD frame [mm]
    is_corner : (t, 3) mask of those on the tessellated surface
    tight_mm : largest distance of corners from a surface guessed from few facets; never less than
        `TIGHT_MM`
    """

    def __init__(
        self, facets: Facets, mesh: trimesh.Trimesh, is_corner: BoolArray, tight_mm: float
    ) -> None:
        self.facets = facets
        self.tight_mm = max(TIGHT_MM, tight_mm)
        self._vertices = np.asarray(mesh.vertices, dtype=np.float64)
        # facet by facet, as their triangles are listed
        self._triangles = np.asarray(mesh.faces)[facets.triangles].astype(np.int32)
        self._is_corner = is_corner[facets.triangles]
        self._seen = np.zeros(facets.count, dtype=np.int64)
        self._tick = 0

    def cloud(self, facets: IntArray) -> Cloud:
        """Return corners and facets of a piece; of a large piece an even selection of corners."""
        f = self.facets
        at = rows(f.start, facets)
        vertices = self._triangles[at][self._is_corner[at]]
        if len(vertices) == 0:
            vertices = self._triangles[at].ravel()
        points = self._vertices[vertices[:: thinning(len(vertices))]]
        return Cloud(points, f.normals[facets], f.centres[facets], f.areas[facets])

    def is_on(self, primitive: Primitive, facets: IntArray, tolerance_mm: float) -> BoolArray:
        """Return a mask (k,) of the facets with all corners on a surface and the same normal.

        Parameters
        ----------
        primitive : the surface, in the frame of the part
        facets : (k,) numbers of the facets asked about
        tolerance_mm : largest distance of a corner from the surface
        """
        if len(facets) <= AT_ONCE:
            return self._lies_on(primitive, facets, tolerance_mm)
        return np.concatenate(
            [self._lies_on(primitive, facets[some], tolerance_mm) for some in spans(len(facets))]
        )

    def is_near(self, primitive: Primitive, facets: IntArray, tolerance_mm: float) -> bool:
        """Return True if all corners of a piece are near a surface, whatever its normals.

        Parameters
        ----------
        primitive, facets, tolerance_mm : as for `is_on`
        """
        vertices = self._triangles[rows(self.facets.start, facets)].ravel()
        return bool((np.abs(primitive.distances(self._vertices[vertices])) <= tolerance_mm).all())

    def _lies_on(self, primitive: Primitive, facets: IntArray, tolerance_mm: float) -> BoolArray:
        f = self.facets
        at = rows(f.start, facets)
        sizes = f.start[facets + 1] - f.start[facets]
        first = sizes.cumsum() - sizes
        is_corner = self._is_corner[at]
        normals = np.repeat(f.normals[facets], sizes, axis=0)[:, None]
        off, cosine, away = primitive.seen_from(self._vertices[self._triangles[at]], normals)
        bad = is_corner & (off > tolerance_mm)
        far = np.logical_or.reduceat(bad.any(axis=1), first)
        if primitive.kind == "plane":
            return np.asarray(~far)
        if primitive.kind in ("cylinder", "cone"):
            # a strip turns about the axis by one segment at most; its apex may turn as it likes
            tells = is_corner & (away >= 10 * tolerance_mm)
            turned = tells & (cosine < COS_HALF_STEP)
        else:
            turned = is_corner & (cosine < COS_FACET)
        # slivers may face anywhere; the facet's normal speaks for all its triangles
        return np.asarray(~(far | np.logical_or.reduceat(turned.any(axis=1), first)))

    def patch(self, seed: int, wanted: int, links: SmoothNeighbours, free: BoolArray) -> IntArray:
        """Return a facet and rings of facets round it, about as many as wanted.

        Parameters
        ----------
        seed : number of the facet in the middle
        wanted : number of facets wanted
        links : neighbours of each facet of the part
        free : (m,) mask of the facets that may be taken
        """
        patch = front = np.array([seed])
        self._tick += 1
        self._seen[patch] = self._tick
        while len(patch) < wanted:
            front = self._ring(front, links, free)
            if len(front) == 0:
                break
            if len(patch) + len(front) > 2 * wanted and len(patch) >= MIN_FACETS:
                break
            patch = np.concatenate([patch, front])
        return patch

    def spread(
        self,
        primitive: Primitive,
        facets: IntArray,
        links: SmoothNeighbours,
        free: BoolArray,
        tolerance_mm: float,
    ) -> IntArray:
        """Return a piece with the free facets round it that lie on a surface, ring by ring.

        Parameters
        ----------
        primitive : the surface, in the frame of the part
        facets : (k,) numbers of the facets to begin with
        links : neighbours of each facet of the part
        free : (m,) mask of the facets that may be taken
        tolerance_mm : largest distance of a corner from the surface
        """
        self._tick += 1
        self._seen[facets] = self._tick
        front, parts = facets, [facets]
        while len(front):
            ring = self._ring(front, links, free)
            if len(ring) == 0:
                break
            front = ring[self.is_on(primitive, ring, tolerance_mm)]
            parts.append(front)
        return np.concatenate(parts)

    def _ring(self, front: IntArray, links: SmoothNeighbours, free: BoolArray) -> IntArray:
        """Return the free neighbours not yet seen since the last tick, and mark them as seen."""
        ring = links.of(front)
        ring = np.unique(ring[free[ring] & (self._seen[ring] != self._tick)])
        self._seen[ring] = self._tick
        return ring

    def is_within(self, patch: IntArray, other: IntArray) -> bool:
        """Return True if all facets of one piece belong to another."""
        self._tick += 1
        self._seen[other] = self._tick
        return bool((self._seen[patch] == self._tick).all())
