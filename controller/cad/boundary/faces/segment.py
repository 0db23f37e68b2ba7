"""Surfaces from triangles: planes, cylinders, cones, spheres, tori, and freeform ones.

A tessellated bore is many narrow coplanar strips; a plane is a facet much larger than the strips
that it may border on. So planes are taken first, the rest is grown across nearly smooth edges, and
finally neighbours on one surface are merged.
"""

from dataclasses import dataclass

import numpy as np
import trimesh

from controller.arrays import BoolArray, Int32Array, IntArray

from ...graph import components, grouped
from .._types import Face
from ..formulas.primitives import Primitive
from ._describe import describe
from ._facets import Facets, find_facets, rounding_mm, true_corners
from ._growth import MAX_SEEDS, Found, Grower
from ._neighbours import SmoothNeighbours, along_long_sides
from ._pieces import MIN_FACETS, Pieces
from ._specks import crescents_absorbed, specks_absorbed

STRIP_RATIO = 4.0  # a plane is this many times larger than the strips round it
LONE_RATIO = 50.0  # a single triangle with smooth edges all round must be this many times larger
ABSORB_ROUNDS = 3
NEAR = 20.0  # in tightest fits; planes with middles farther apart are distinct
ABSORB = 5.0  # in tolerances of the fit; kernels place corners less exactly where surfaces meet


@dataclass(frozen=True, eq=False, slots=True)
class FaceSearch:
    """The surfaces found in a mesh.

    Attributes
    ----------
    faces : faces from the largest to the smallest, each in one piece
    face_of_triangle : (n,) id of each triangle's surface
    is_complete : False where the budget ran out: surfaces with a formula may be among the free-form
    """

    faces: tuple[Face, ...]
    face_of_triangle: Int32Array
    is_complete: bool


def find_faces(mesh: trimesh.Trimesh) -> tuple[tuple[Face, ...], Int32Array]:
    """Return the surfaces of a mesh and, per triangle, the id of its surface (n,).

    Each surface is in one piece. Ids run from the largest surface to the smallest.
    """
    found = search_faces(mesh)
    return found.faces, found.face_of_triangle


def search_faces(mesh: trimesh.Trimesh, max_seeds: int = MAX_SEEDS) -> FaceSearch:
    """Return the surfaces of a mesh, within a budget.

    The budget is a number of tries, not of seconds, so that a part compiles to the same on any
    machine.

    Parameters
    ----------
    mesh : closed
    max_seeds : facets that surfaces are grown from at most, where they run into each other smoothly
    """
    if len(mesh.faces) == 0:
        return FaceSearch((), np.zeros(0, dtype=np.int32), is_complete=True)
    facets = find_facets(mesh)
    is_corner = true_corners(mesh, facets.of_triangle)
    pieces = Pieces(facets, mesh, is_corner, 10 * rounding_mm(mesh))
    curved = ~_planes(facets)
    grower = Grower(pieces, max_seeds)
    found = _surfaces(facets, grower, curved)
    owner, primitives = _owners(facets, found)
    tolerances_mm = [max(ABSORB * pieces.tight_mm, surface.tolerance_mm) for surface in found]
    _absorb(facets, pieces, owner, primitives, tolerances_mm)
    _leave_rest(facets, owner, primitives)
    owner = _merged(facets, pieces, owner, primitives)
    owner = specks_absorbed(facets, pieces, owner, primitives)
    owner = crescents_absorbed(mesh, facets, pieces, owner, primitives)
    faces, face_of_triangle = describe(mesh, owner[facets.of_triangle], primitives)
    return FaceSearch(faces, face_of_triangle, is_complete=not grower.is_spent)


def _planes(facets: Facets) -> BoolArray:
    """Return a mask (m,) of the facets that are large enough to count as planes."""
    largest = np.zeros(facets.count)
    np.maximum.at(largest, facets.a, facets.areas[facets.b])
    np.maximum.at(largest, facets.b, facets.areas[facets.a])
    # a triangle with smooth edges all round is rather the largest of a scan's than a plane
    smooth_edges = np.bincount(facets.a, minlength=facets.count)
    smooth_edges += np.bincount(facets.b, minlength=facets.count)
    lone = (np.diff(facets.start) == 1) & (smooth_edges == 3)
    return np.asarray(facets.areas > np.where(lone, LONE_RATIO, STRIP_RATIO) * largest)


def _surfaces(facets: Facets, grower: Grower, curved: BoolArray) -> list[Found]:
    inner = curved[facets.a] & curved[facets.b]
    a, b = facets.a[inner], facets.b[inner]
    run = components(facets.count, a, b)
    sizes = np.bincount(run)
    order, start = grouped(run, len(sizes))
    links, strips = SmoothNeighbours(facets.count, a, b), along_long_sides(facets, inner)
    free = curved.copy()
    areas = np.bincount(run, weights=facets.areas)
    found: list[Found] = []
    candidates = np.nonzero(sizes >= MIN_FACETS)[0]
    for i in candidates[np.argsort(-areas[candidates], kind="stable")].tolist():
        found += grower.run(order[start[i] : start[i + 1]], links, strips, free)
    # what a run's surfaces leave over may be one surface now that it stands alone
    inner = free[a] & free[b]
    rest = components(facets.count, a[inner], b[inner])
    sizes = np.bincount(rest, weights=free)
    touched = np.zeros(len(sizes), dtype=bool)
    for piece in found:
        touched[rest[links.of(piece.facets)]] = True
    order, start = grouped(rest, len(sizes))
    for i in np.nonzero(touched & (sizes >= MIN_FACETS))[0].tolist():
        piece_facets = order[start[i] : start[i + 1]]
        whole = grower.whole(piece_facets)
        if whole is not None:
            found.append(whole)
    return found


def _owners(facets: Facets, found: list[Found]) -> tuple[IntArray, list[Primitive | None]]:
    owner = np.full(facets.count, -1, dtype=np.int64)
    for i, surface in enumerate(found):
        owner[surface.facets] = i
    return owner, [surface.primitive for surface in found]


def _absorb(
    facets: Facets,
    pieces: Pieces,
    owner: IntArray,
    primitives: list[Primitive | None],
    tolerances_mm: list[float],
) -> None:
    """Give single facets to the neighbouring surface on which all their corners lie."""
    a = np.concatenate([facets.a, facets.b])
    b = np.concatenate([facets.b, facets.a])
    for _ in range(ABSORB_ROUNDS):
        open_pair = (owner[a] < 0) & (owner[b] >= 0)
        pairs = np.unique(np.column_stack([owner[b[open_pair]], a[open_pair]]), axis=0)
        if len(pairs) == 0:
            return
        taken = False
        surfaces, first = np.unique(pairs[:, 0], return_index=True)
        ends = np.append(first[1:], len(pairs))
        for surface, low, high in zip(surfaces.tolist(), first, ends, strict=True):
            primitive = primitives[surface]
            single = pairs[low:high, 1]
            single = single[owner[single] < 0]
            if primitive is None or len(single) == 0:
                continue
            fit = single[pieces.is_on(primitive, single, tolerances_mm[surface])]
            owner[fit] = surface
            taken = taken or len(fit) > 0
        if not taken:
            return


def _leave_rest(facets: Facets, owner: IntArray, primitives: list[Primitive | None]) -> None:
    """Make planes and freeform surfaces of the remaining facets."""
    left = owner < 0
    plane = _planes(facets) & left
    inner = left[facets.a] & left[facets.b] & ~plane[facets.a] & ~plane[facets.b]
    run = components(facets.count, facets.a[inner], facets.b[inner])
    sizes = np.bincount(run)
    # a roof or a slope is two planes or three, never a curve
    plane |= left & (sizes[run] < MIN_FACETS)
    for i in np.nonzero(plane)[0].tolist():
        owner[i] = len(primitives)
        primitives.append(Primitive("plane", facets.centres[i], facets.normals[i]))
    left &= ~plane
    numbers, rank = np.unique(run[left], return_inverse=True)
    owner[left] = len(primitives) + rank.ravel()
    primitives.extend([None] * len(numbers))


def _merged(
    facets: Facets, pieces: Pieces, owner: IntArray, primitives: list[Primitive | None]
) -> IntArray:
    """Return owners (m,) with neighbours on one surface merged, as the halves of a bore."""
    a, b = owner[facets.a], owner[facets.b]
    pairs = np.unique(np.sort(np.column_stack([a, b])[a != b], axis=1), axis=0)
    kinds = np.array([p.kind if p is not None else "freeform" for p in primitives])
    pairs = pairs[(kinds[pairs] != "freeform").all(axis=1)]
    order, start = grouped(owner, len(primitives))
    areas = np.bincount(owner, weights=facets.areas, minlength=len(primitives))
    # most planes of a noisy part are far from their neighbours': not worth a closer look
    flat = (kinds[pairs] == "plane").all(axis=1)
    weights = np.maximum(facets.areas, 1e-12)
    share = np.bincount(owner, weights=weights, minlength=len(primitives))
    middle = (
        np.column_stack(
            [np.bincount(owner, weights * x, len(primitives)) for x in facets.centres.T]
        )
        / np.maximum(share, 1e-12)[:, None]
    )
    places = np.array([p.centre_mm if p is not None else np.zeros(3) for p in primitives])
    axes = np.array([p.axis if p is not None else np.zeros(3) for p in primitives])
    off = np.min(
        [
            np.abs(((middle[i] - places[k]) * axes[k]).sum(axis=1))
            for i, k in (pairs.T, pairs.T[::-1])
        ],
        axis=0,
    )
    pairs = pairs[~flat | (off <= NEAR * pieces.tight_mm)]
    joins = []
    for pair in pairs.tolist():
        small, large = sorted(pair, key=lambda i: areas[i])
        first, second = primitives[small], primitives[large]
        if first is None or second is None:
            continue
        # the smaller may be of another kind: one row of a torus is a cone
        its, mine = order[start[small] : start[small + 1]], order[start[large] : start[large + 1]]
        tolerance = 2 * pieces.tight_mm
        if bool(pieces.is_on(second, its, tolerance).all()) or (
            first.kind == second.kind and bool(pieces.is_on(first, mine, tolerance).all())
        ):
            joins.append((small, large))
    if not joins:
        return owner
    both = np.array(joins)
    label = components(len(primitives), both[:, 0], both[:, 1])
    # the surface of the largest piece speaks for all
    by_area = np.argsort(areas, kind="stable")
    speaker = np.empty(len(primitives), dtype=np.int64)
    speaker[label[by_area]] = by_area
    return speaker[label[owner]]
