"""Sightings of parts under lamps that touch or lie on others: one cluster, separated.

Parts that are sure are named; the remaining pieces are examined again, with outlines of their own,
flat on the table or leaning on named parts. The final rest stays unknown.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from controller.arrays import BoolArray

from ...fitting import ImageEdges, is_predicted
from ...library import Candidate, Library
from ...partial import are_one_place
from ...segmentation import Region
from ..decide import Decision
from ..hypotheses import Hypothesis
from ..scene import TableScene
from ..touching import PartialSighting, connected, cut_out, within
from .choice import ClusterPlace, chosen
from .fits import LitFit
from .search import SAME_SHADOW, ClusterSearch

MAX_ROUNDS = 3
SAME_OUTLINE = 0.97  # overlap of two silhouettes from which one proposes the other's hypotheses
RIM_PX = 5  # width of the rim of a part's shadow
LEFT_PX = 9  # width below which a piece is a shadow or a rim
EDGED_SHARE = 0.3  # length of a piece's own edges, as a share of its rim
BORDER_PX = 6.0  # distance outside an outline where the neighbour of a part is probed
# Share of a part's outline that may border on something unknown. A strip along the edge of a thing
# borders on it with one long side, which is more than a third.
SURROUNDED = 0.33
OVERLAID_PX = 2.0  # offset from which an edge counts as absent
# Length of absent outline covered by a piece, from which the piece lies on the part.
OVERLAID_MM = 5.0
# Own probability required of a part beside something unknown: details of a stranger look like
# small parts. Of 70 right ones in clusters used in development one has 0.85 to 0.9; the best
# detail of something unknown has 0.88 (docs/adr/0092).
SURE = 0.9
RARE = 0.02  # share of dropped parts below which a stable pose needs more evidence to be named


def parts_of_lit(
    region: Region, scene: TableScene, known: Sequence[Hypothesis] = ()
) -> tuple[PartialSighting, ...]:
    """Return the parts of a cluster under lamps, and the rest; nothing if none is sure.

    Parameters
    ----------
    region : the cluster
    scene : its pictures under lamps, and the parts that may be there
    known : parts of it that lie flat on the table, as a look before a light table names them
    """
    search, library, least_px = ClusterSearch(region, scene), scene.library, scene.least_px
    proposed = search.proposed(outlines_of(search.region, least_px), is_first=True)
    named = search.fitted(known)
    fits = search.with_flat(named, proposed)
    places = chosen(fits, search, library)
    there = _with(places, named)
    if not there:
        return ()
    before, fits = fits, search.with_leaning(fits, (), there)
    if fits != before:
        places = chosen(fits, search, library)
    for _ in range(1, MAX_ROUNDS):
        there = _with(places, named)
        pieces = pieces_left(there, search, least_px)
        if not pieces:
            break
        proposed = search.proposed(pieces, is_first=False)
        before, fits = fits, search.with_flat(fits, proposed)
        fits = search.with_leaning(fits, proposed, there)
        if fits == before:  # of the same fits the same places are chosen
            break
        count, places = len(places), chosen(fits, search, library)
        if len(places) <= count:
            break
    before, fits = fits, search.with_flat(fits, _looking_like(places, search))
    if fits != before:
        places = chosen(fits, search, library)
    return _sightings(fits, places, search, library, least_px)


def _with(places: Sequence[ClusterPlace], named: Sequence[LitFit]) -> list[LitFit]:
    """Return the parts placed so far, and the named ones where none is placed."""
    there = [place.fit for place in places]
    return there + [f for f in named if not any(are_one_place(f, o, SAME_SHADOW) for o in there)]


def _looking_like(places: Sequence[ClusterPlace], search: ClusterSearch) -> list[Candidate]:
    """Return other parts with about the same outline as those placed so far.

    Of parts that differ only inside their outline, one may have been proposed and the other not.
    """
    found: list[Candidate] = []
    for fit in (place.fit for place in places if not place.fit.leans):
        own = fit.candidate.part, fit.candidate.pose
        piece = _with_loops(cut_out(fit.shadow, search.region, False))
        found += [one for one in search.like(piece) if (one.part, one.pose) != own]
    return found


def outlines_of(region: Region, least_px: float) -> list[Region]:
    """Return the connected pieces of all silhouettes that a cluster may have, each once.

    Parts that touch differ in brightness, and none of the silhouettes has all of their outlines.

    Parameters
    ----------
    region : the cluster
    least_px : pixels below which a piece is none
    """
    found: list[tuple[Region, BoolArray]] = []
    for mask in (region.mask, *region.alternatives):
        for piece in map(_with_loops, connected(mask, region, least_px, False)):
            own = within(piece, region)
            if not any(_are_alike(own, other) for _, other in found):
                found.append((piece, own))
    return [piece for piece, _ in found]


def _are_alike(a: BoolArray, b: BoolArray) -> bool:
    return int((a & b).sum()) > SAME_OUTLINE * int((a | b).sum())


def pieces_left(there: Sequence[LitFit], search: ClusterSearch, least_px: float) -> list[Region]:
    """Return the connected pieces on which no part is seen, with outlines of their own.

    Parameters
    ----------
    there : the parts
    search : search of the cluster
    least_px : pixels below which a piece is none
    """
    left = search.region.mask.astype(np.uint8)
    rim = np.ones((RIM_PX, RIM_PX), np.uint8)
    for fit in there:
        left[cv2.dilate(fit.shadow.astype(np.uint8), rim) > 0] = 0
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (LEFT_PX, LEFT_PX))
    left = np.asarray(cv2.morphologyEx(left, cv2.MORPH_OPEN, disc), np.uint8)
    return [_with_loops(piece) for piece in connected(left > 0, search.region, least_px, False)]


def _with_loops(region: Region) -> Region:
    """Return a region with the outlines of its mask."""
    mask = region.mask.astype(np.uint8)
    chains, _ = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    corner = np.array(region.box_px[:2], dtype=np.float64)
    loops = sorted((c.reshape(-1, 2) + corner for c in chains), key=len, reverse=True)
    return replace(region, loops_px=tuple(loops))


def _sightings(
    fits: Sequence[LitFit],
    places: Sequence[ClusterPlace],
    search: ClusterSearch,
    library: Library,
    least_px: float,
) -> tuple[PartialSighting, ...]:
    """Return the named parts, then the rest; parts that lie on others name these.

    Parameters
    ----------
    fits, places, search, library : as `held`
    least_px : pixels below which what is left is no object
    """
    nowhere: list[ClusterPlace] = []
    while True:  # what is given up is unknown to those beside it, and bears none
        fits, places = held(fits, places, search, library)
        there = [place.fit for place in (*places, *nowhere)]
        pieces = pieces_left(there, search, least_px)
        pieces = [piece for piece in pieces if _has_edges(piece, there, search)]
        masks = [within(piece, search.region) for piece in pieces]
        places, details = _details_left_out(places, masks, [one.fit.shadow for one in nowhere])
        is_unknown_left = bool(pieces or nowhere or details)
        places, unsure = sure_beside_unknown(places, library, is_unknown_left=is_unknown_left)
        if not (details or unsure):
            break
        nowhere += [*details, *unsure]
        fits = [f for f in fits if not any(f is q for one in nowhere for q in one.fits)]
    if not places:
        return ()
    fits = [place.fit for place in places]
    nothing = Decision(None, 1.0, (), None)
    left = [cut_out(place.fit.shadow, search.region, False) for place in nowhere] + pieces
    masks = [place.fit.shadow for place in nowhere] + masks
    below = [_below(fit, fits) for fit in fits]
    found = []
    for k, place in enumerate(places):
        others = [fit for fit in fits if fit is not place.fit]
        found.append(
            PartialSighting(
                region=cut_out(place.fit.visible_mask(others), search.region, False),
                decision=place.decision,
                hypotheses=place.hypotheses,
                free_share=place.fit.free_share(others),
                lies_on=below[k],
                is_covered=any(k in one for one in below) or _is_overlaid(place.fit, others, masks),
            )
        )
    return (*found, *(PartialSighting(piece, nothing, (), 0.0) for piece in left))


def _details_left_out(
    places: Sequence[ClusterPlace], pieces: Sequence[BoolArray], given_up: Sequence[BoolArray]
) -> tuple[list[ClusterPlace], list[ClusterPlace]]:
    """Return the places, and those of them that are details of something unknown."""
    fits = [place.fit for place in places]
    details = [
        place
        for place in places
        if is_detail(place.fit, [f for f in fits if f is not place.fit], pieces, given_up)
    ]
    return [p for p in places if not any(p is one for one in details)], details


def is_detail(
    fit: LitFit,
    others: Sequence[LitFit],
    pieces: Sequence[BoolArray],
    given_up: Sequence[BoolArray] = (),
) -> bool:
    """Return True if an apparent part is a detail of an unknown piece.

    A strip between two grooves has the outline of a washer that stands on its rim: beside most of
    it is more of the same thing. A section of a long rail has that of a short one but for where it
    goes on.

    Parameters
    ----------
    fit : fit of the part
    others : the parts beside it
    pieces : (h, w) each of the cluster's crop, of what no part explains
    given_up : (h, w) each of what seemed to be a part and is none that is known
    """
    if not (pieces or given_up):
        return False
    if _is_overlaid(fit, others, pieces):
        return True
    seen = fit.seen_fit(others)
    at = seen.edges.pixels + BORDER_PX * seen.edges.normals
    on = seen.edges.on_outline
    left = np.any([*pieces, *given_up], axis=0).astype(np.uint8)
    near = cv2.dilate(left, np.ones((RIM_PX, RIM_PX), np.uint8)) > 0
    y, x, is_in = fit.cluster.index(at)
    beside = (near[y, x] & is_in & fit.is_outside(at))[on]
    return bool(beside.sum() > SURROUNDED * on.sum())


def sure_beside_unknown(
    places: Sequence[ClusterPlace], library: Library, *, is_unknown_left: bool
) -> tuple[list[ClusterPlace], list[ClusterPlace]]:
    """Return the named places, and those too unsure beside something unknown.

    A washer that stands on its rim looks like a strip of anything, and hardly ever comes to stand
    so: in a cluster such a pose has to be sure, and beside something unknown it is not named.

    Parameters
    ----------
    places : possible objects there
    library : library whose stable poses they are of
    is_unknown_left : something else is there that no part explains
    """
    unsure = []
    for place in places:
        best = place.decision.best
        assert best is not None
        is_rare = library.entries[best.part].pose(best.pose).drop_probability < RARE
        is_sure = place.sureness >= SURE and not (is_rare and is_unknown_left)
        if (is_unknown_left or is_rare) and not is_sure:
            unsure.append(place)
    return [p for p in places if not any(p is one for one in unsure)], unsure


def _has_edges(piece: Region, there: Sequence[LitFit], search: ClusterSearch) -> bool:
    """Return True if a piece has borders that no part explains: shadows and glare have none."""
    mask = within(piece, search.region).astype(np.uint8)
    near = cv2.dilate(mask, np.ones((RIM_PX, RIM_PX), np.uint8)) > 0
    edges = ImageEdges.of(search.cluster.grey, np.asarray(near))
    own = np.ones(len(edges.points_px), dtype=np.bool_)
    for fit in there:
        step_px = fit.fit.edges.step_mm / fit.mm_per_px
        own &= ~is_predicted(edges.points_px, fit.fit.edges, step_px)
    rim_px = sum(len(loop) for loop in piece.loops_px)
    return bool(own.sum() * edges.every > EDGED_SHARE * rim_px)


def held(
    fits: Sequence[LitFit], places: Sequence[ClusterPlace], search: ClusterSearch, library: Library
) -> tuple[Sequence[LitFit], Sequence[ClusterPlace]]:
    """Return fits and places without those that would lean on nothing known.

    The next best explanation of such a place, or of its neighbours', gets its turn.

    Parameters
    ----------
    fits : all possible fits
    places : `chosen` of them
    search : search of the cluster
    library : library of the fits
    """
    while True:
        there = [place.fit for place in places]
        lost = [fit for fit in there if fit.leans and not _below(fit, there)]
        if not lost:
            return fits, places
        fits = [f for f in fits if not any(f is one for one in lost)]
        places = chosen(fits, search, library)


def _below(fit: LitFit, fits: Sequence[LitFit]) -> tuple[int, ...]:
    """Return the numbers of the parts that a leaning part lies on."""
    if not fit.leans:
        return ()
    return tuple(j for j, other in enumerate(fits) if other is not fit and fit.is_above(other))


def _is_overlaid(fit: LitFit, others: Sequence[LitFit], pieces: Sequence[BoolArray]) -> bool:
    """Return True if an unknown piece covers a stretch of a part's outline."""
    if not pieces:
        return False
    left = np.any(pieces, axis=0).astype(np.uint8)
    near = cv2.dilate(left, np.ones((3, 3), np.uint8)) > 0
    seen = fit.seen_fit(others)
    off = seen.off_px > OVERLAID_PX
    y, x, is_in = fit.cluster.index(seen.edges.pixels)
    missing = off & seen.edges.on_outline & is_in & near[y, x]
    return bool(missing.sum() * seen.edges.step_mm > OVERLAID_MM)
