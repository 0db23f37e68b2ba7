"""Triangles of one plane joined to facets, also where the file's rounding tilts thin triangles."""

from dataclasses import dataclass

import numpy as np
import trimesh

from controller.arrays import BoolArray, FloatArray, IntArray

from ...graph import components, distinct, grouped
from ...large import ADJACENCY, drop_derived, spans, sums_by
from .._normals import unit

COPLANAR_RAD = np.radians(0.2)
ROUNDING_MM = 1e-5  # least rounding; single precision keeps 7 digits of the part's size
ROUNDING_SHARE = 2e-7
SLIVER = 100.0  # in roundings; a triangle lower than this has no reliable normal
LONG_SIDE = 0.4  # share of a sliver's longest side; it has two sides of this length or more
# Largest distance of a facet's corners from its plane; beyond it the wall turns slowly.
FLAT_MM = 0.002
FLAT_RAD = np.radians(1.0)
STRAIGHT = 0.002  # an edge that turns by 0.1 degrees belongs to a circle of 3600 segments
SMOOTH_RAD = np.radians(22.0)  # strips of a bore of 17 segments and more count as smooth


@dataclass(frozen=True, eq=False, slots=True)
class Facets:
    """Coplanar pieces of a mesh; of a wall that turns too slowly for any, its triangles.

    Attributes
    ----------
    of_triangle : (n,) facet of each triangle
    triangles, start : triangles of facet i are ``triangles[start[i]:start[i + 1]]``
    normals, centres, areas : (m, 3), (m, 3), (m,)
    a, b : (k,) facets that meet in a smooth edge, each edge once
    lengths_mm : (k,) lengths of these edges
    rims_mm : (m,) length of all edges round each facet
    """

    of_triangle: IntArray
    triangles: IntArray
    start: IntArray
    normals: FloatArray
    centres: FloatArray
    areas: FloatArray
    a: IntArray
    b: IntArray
    lengths_mm: FloatArray
    rims_mm: FloatArray

    @property
    def count(self) -> int:
        """Number of facets."""
        return len(self.areas)


def rounding_mm(mesh: trimesh.Trimesh) -> float:
    """Return the largest displacement of a corner by a file's rounding [mm]."""
    return max(ROUNDING_MM, ROUNDING_SHARE * float(np.abs(mesh.bounds).max()))


def find_facets(mesh: trimesh.Trimesh) -> Facets:
    """Return the facets of a mesh."""
    count = len(mesh.faces)
    areas = np.asarray(mesh.area_faces)
    normals = np.asarray(mesh.face_normals)
    rounding = rounding_mm(mesh)
    longest, centres = _measured(mesh)
    heights = 2 * areas / np.maximum(longest, 1e-12)
    sliver = heights < SLIVER * rounding
    pairs = np.asarray(mesh.face_adjacency, dtype=np.int64)
    angles = np.asarray(mesh.face_adjacency_angles)
    drop_derived(mesh, *ADJACENCY)
    ambiguity = 2 * rounding / np.maximum(heights, 1e-12)
    limit = np.minimum(COPLANAR_RAD + ambiguity[pairs].sum(axis=1), SMOOTH_RAD / 4)
    sound = ~sliver[pairs].any(axis=1)
    flat = pairs[sound & (angles < limit)]
    raw = components(count, flat[:, 0], flat[:, 1])
    raw = _exploded(raw, sliver, mesh, centres)
    raw = _slivers_joined(raw, sliver, mesh, pairs, areas)
    of = np.asarray(np.unique(raw, return_inverse=True)[1], dtype=np.int64).ravel()
    total = np.bincount(of, weights=areas).astype(np.float64)
    weights = np.where(sliver, 1e-12, 1.0) * np.maximum(areas, 1e-12)
    mean = sums_by(of, normals * weights[:, None])
    middles = sums_by(of, centres * weights[:, None])
    middles /= np.bincount(of, weights=weights)[:, None]
    facet_normals = unit(mean)
    apart = of[pairs[:, 0]] != of[pairs[:, 1]]
    a, b = of[pairs[apart, 0]], of[pairs[apart, 1]]
    cosine = (facet_normals[a] * facet_normals[b]).sum(axis=1)
    smooth = cosine > np.cos(SMOOTH_RAD)
    lengths = _lengths(mesh, np.asarray(mesh.face_adjacency_edges)[apart])
    ends, both = np.append(a, b), np.append(lengths, lengths)
    rims = np.bincount(ends, weights=both, minlength=len(total)).astype(np.float64)
    a, b, lengths = a[smooth], b[smooth], lengths[smooth]
    order, start = grouped(of, len(total))
    return Facets(of, order, start, facet_normals, middles, total, a, b, lengths, rims)


def _measured(mesh: trimesh.Trimesh) -> tuple[FloatArray, FloatArray]:
    """Return the longest side of each triangle (n,) and the middle of its corners (n, 3)."""
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    longest, centres = np.empty(len(triangles)), np.empty((len(triangles), 3))
    for some in spans(len(triangles)):
        corners = vertices[triangles[some]]
        sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        longest[some], centres[some] = sides.max(axis=1), corners.mean(axis=1)
    return longest, centres


def _lengths(mesh: trimesh.Trimesh, edges: IntArray) -> FloatArray:
    """Return the lengths of edges (e, 2), each between two vertices [mm]."""
    vertices, lengths = np.asarray(mesh.vertices), np.empty(len(edges))
    for some in spans(len(edges)):
        ends = vertices[edges[some]]
        lengths[some] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    return lengths


def _exploded(
    raw: IntArray, sliver: BoolArray, mesh: trimesh.Trimesh, centres: FloatArray
) -> IntArray:
    """Return facets (n,) with the bent ones split: walls of very many segments."""
    normals, areas = np.asarray(mesh.face_normals), np.asarray(mesh.area_faces)
    weights = np.where(sliver, 1e-12, 1.0) * np.maximum(areas, 1e-12)
    total = np.bincount(raw, weights=weights)
    mean = unit(sums_by(raw, normals * weights[:, None]))
    middle = sums_by(raw, centres * weights[:, None]) / total[:, None]
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    off = np.empty(len(triangles))
    for some in spans(len(triangles)):
        away = vertices[triangles[some]] - middle[raw[some]][:, None]
        off[some] = np.abs((away * mean[raw[some]][:, None]).sum(axis=2)).max(axis=1)
    tilted = (normals * mean[raw]).sum(axis=1) < np.cos(FLAT_RAD)
    bends = np.zeros(len(total), dtype=bool)
    bends[raw[~sliver & ((off > FLAT_MM) | tilted)]] = True
    # a coarse wall's pair of triangles may be warped by rounding; only many triangles can bend
    bends &= np.bincount(raw) > 2
    return np.where(bends[raw], len(total) + np.arange(len(raw)), raw)


def _slivers_joined(
    raw: IntArray,
    sliver: BoolArray,
    mesh: trimesh.Trimesh,
    pairs: IntArray,
    areas: FloatArray,
) -> IntArray:
    """Return facets (n,) with each sliver joined to the facet across its longest side."""
    if not sliver.any():
        return raw
    joined = raw.copy()
    lengths = _lengths(mesh, np.asarray(mesh.face_adjacency_edges))
    waiting = sliver.copy()
    one = np.concatenate([pairs[:, 0], pairs[:, 1]])
    other = np.concatenate([pairs[:, 1], pairs[:, 0]])
    long = np.concatenate([lengths, lengths])
    longest = np.zeros(len(raw))
    np.maximum.at(longest, one, long)
    # across a short side a sliver of one plane may meet another: that is the last resort
    share = LONG_SIDE
    while waiting.any():
        use = waiting[one] & ~waiting[other] & (long >= share * longest[one])
        if not use.any():
            if share == 0.0:
                break
            share = 0.0
            continue
        order = np.lexsort((areas[other[use]], long[use]))  # the last one written wins
        joined[one[use][order]] = joined[other[use][order]]
        waiting[one[use]] = False
    return joined


def true_corners(mesh: trimesh.Trimesh, of_triangle: IntArray) -> BoolArray:
    """Return a mask (n, 3) of the triangle corners that lie on the tessellated surface itself.

    On a vertex shared by only two facets, or on a straight sharp edge, the vertex may lie on a
    chord of the wall and not on the wall itself. Such vertices come from neighbours with other
    segments.
    """
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    count = int(of_triangle.max(initial=0)) + 1
    pairs = distinct(triangles.ravel() * count + np.repeat(of_triangle, 3))
    is_corner = np.bincount(pairs // count, minlength=len(mesh.vertices)) > 2
    sharp = np.asarray(mesh.face_adjacency_angles) > SMOOTH_RAD
    edges = np.asarray(mesh.face_adjacency_edges)[sharp]
    vertices = np.asarray(mesh.vertices)
    along = unit(vertices[edges[:, 1]] - vertices[edges[:, 0]])
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    leaving = np.concatenate([along, -along])
    turn = np.column_stack(
        [np.bincount(ends, leaving[:, k], minlength=len(vertices)) for k in range(3)]
    )
    passed = np.bincount(ends, minlength=len(vertices)) == 2
    is_corner &= ~(passed & (np.linalg.norm(turn, axis=1) < STRAIGHT))
    mine = is_corner[triangles]
    bare = np.bincount(of_triangle, weights=mine.any(axis=1)) == 0
    return np.asarray(mine | bare[of_triangle][:, None])
