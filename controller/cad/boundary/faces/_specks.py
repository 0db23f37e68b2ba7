"""Small flat pieces that belong to the curved surface round them, and are no planes.

Tessellations of free surfaces, and of walls near their seams, have single facets larger than
those round them. Such a facet looks like a plane, but its rim runs smoothly into its neighbour.
Where a cone and a bore of one diameter have different segments, crescents remain between them.
"""

import numpy as np
import trimesh

from controller.arrays import BoolArray, IntArray

from ...graph import grouped
from ..formulas.primitives import Primitive
from ._facets import Facets
from ._growth import LOOSE_MM, LOOSE_SHARE
from ._pieces import Pieces

SPECK = 4.0  # in mean facets of a neighbour; a larger flat piece is a plane
ROUNDS = 3  # rounds of absorption, for a few slivers side by side
# Share of the rim that must be smooth; ledges and chamfers have a crease on a long side.
SMOOTH_RIM = 0.8


def specks_absorbed(
    facets: Facets, pieces: Pieces, owner: IntArray, primitives: list[Primitive | None]
) -> IntArray:
    """Return owners (m,) with specks assigned to the curved surface round them.

    A surface without formula takes any speck; one with a formula must pass near its corners,
    or a narrow flat between two fillets would be lost.

    Parameters
    ----------
    facets : the m facets of the part
    pieces : pieces of the part
    owner : (m,) surface each facet is on, a number in ``primitives``; left as it is
    primitives : the surfaces, None for one without formula
    """
    is_plane = np.array([p is not None and p.kind == "plane" for p in primitives])
    for _ in range(ROUNDS):
        given = _absorbed_once(facets, pieces, owner, primitives, is_plane)
        if np.array_equal(given, owner):
            break
        owner = given
    return owner


def _absorbed_once(
    facets: Facets,
    pieces: Pieces,
    owner: IntArray,
    primitives: list[Primitive | None],
    is_plane: BoolArray,
) -> IntArray:
    count = len(primitives)
    areas = np.bincount(owner, weights=facets.areas, minlength=count)
    mean = areas / np.maximum(np.bincount(owner, minlength=count), 1)
    a, b = owner[facets.a], owner[facets.b]
    one, other = np.concatenate([a, b]), np.concatenate([b, a])
    lengths = np.concatenate([facets.lengths_mm, facets.lengths_mm])
    rims = np.bincount(owner, weights=facets.rims_mm, minlength=count)
    rims -= np.bincount(one, weights=np.where(one == other, lengths, 0.0), minlength=count)
    apart = one != other
    smooth = np.bincount(one[apart], weights=lengths[apart], minlength=count)
    curved = is_plane[one] & ~is_plane[other]
    bent = np.bincount(one[curved], weights=lengths[curved], minlength=count)
    use = curved & (areas[one] < SPECK * mean[other]) & (smooth >= SMOOTH_RIM * rims)[one]
    pairs, which = np.unique(one[use] * count + other[use], return_inverse=True)
    shared = np.bincount(which, weights=lengths[use])
    specks, takers = pairs // max(count, 1), pairs % max(count, 1)
    given = owner.copy()
    done: set[int] = set()
    order = np.argsort(-shared, kind="stable")
    for speck, taker in zip(specks[order].tolist(), takers[order].tolist(), strict=True):
        if speck in done:
            continue
        mine = np.nonzero(owner == speck)[0]
        surface = primitives[taker]
        if surface is None:
            fits = bool(bent[speck] >= SMOOTH_RIM * rims[speck])
        else:
            size = surface.minor_radius_mm or surface.radius_mm
            tolerance_mm = max(pieces.tight_mm, min(LOOSE_MM, LOOSE_SHARE * size))
            fits = bool(pieces.is_on(surface, mine, tolerance_mm).all())
        if fits:
            given[mine] = taker
            done.add(speck)
    return given


def crescents_absorbed(
    mesh: trimesh.Trimesh,
    facets: Facets,
    pieces: Pieces,
    owner: IntArray,
    primitives: list[Primitive | None],
) -> IntArray:
    """Return owners (m,) with planes as narrow as a chord is off its arc given to a curved wall.

    Parameters
    ----------
    mesh : the part
    facets, pieces, owner, primitives : as for `specks_absorbed`
    """
    count = len(primitives)
    kinds = np.array([p.kind if p is not None else "freeform" for p in primitives])
    areas = np.bincount(owner, weights=facets.areas, minlength=count)
    rims = np.bincount(owner, weights=facets.rims_mm, minlength=count)
    is_narrow = (kinds == "plane") & (2 * areas < LOOSE_MM * rims)
    if not is_narrow.any():
        return owner
    takes = (kinds != "plane") & (kinds != "freeform")
    of = owner[facets.of_triangle[np.asarray(mesh.face_adjacency)]]
    both = (of, of[:, ::-1])
    pairs = np.concatenate([one[is_narrow[one[:, 0]] & takes[one[:, 1]]] for one in both])
    order, start = grouped(owner, count)
    given = owner.copy()
    for crescent, wall in np.unique(pairs, axis=0).tolist():
        surface = primitives[wall]
        mine = order[start[crescent] : start[crescent + 1]]
        if surface is not None and pieces.is_near(surface, mine, LOOSE_MM):
            given[mine] = wall
    return given
