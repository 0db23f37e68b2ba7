"""Verification of faces by their edges: walls of holes, and faces too small to compare."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.spatial.distance import cdist

from controller.arrays import BoolArray, FloatArray, IndexArray, lengths
from controller.cad import Crease, Mouth, Recess, Solid, find_mouths
from messages import key, say

from ._depth import Floor
from ._edges import SPACING_PX, PartEdges, is_blurred
from ._looks import EdgeLook, EdgeLooks, State

TWO: Final = 2  # least number of pictures from which an edge must be missing
THREE: Final = 3  # the same for an edge shorter than the smallest defect
GREATER_PART: Final = 0.5  # least share of a face's edges that must be in place
# Where a gripper or the part itself hides the rest of a bore: least share round it at which light
# must end, and least share of these places, and of each whole rim, in place. A web, or a bore not
# drilled through, takes all the light; one blocked in part moves its border off the rim.
OPEN_PART: Final = 0.25
ALL_ROUND: Final = 0.8
CHANCE: Final = 0.1  # largest share of an edge in place by texture alone
BESIDE: Final = 1.5  # distance, in spacings, below which points of two mouths overlap
# Least cosine between the normals of pieces of one wall: between that of two places one spacing
# apart round a bore of three pixels' radius, and that of neighbouring walls of an octagon.
IN_LINE: Final = 0.75
NO_DEPTH: Final = key("no picture shows how deep its floor lies")
DISPUTED: Final = key("pictures disagree on how deep its floor lies")
UNLIT_FLOOR: Final = key("no picture along its axis shows the light on it")
UNEVEN_LIGHT: Final = key("the light on it is not what its depth explains")
NO_RIM: Final = key("its rim is too short to be looked for")
CLOSED: Final = key("no light is shown to pass the bore that it leads to")
OF_ITS_EDGES: Final = key("of its edges")  # how a face is verified that no defect fits on


@dataclass(frozen=True, slots=True)
class FaceEdges:
    """Evidence on a face from its edges.

    Attributes
    ----------
    share : share of the length of its sharp edges that is in place; for a wall, of its mouths
    look_count : number of pictures that show any of it in place
    is_verified : True if the edges verify a surface that cannot be compared
    how : proof in words; empty where it is not verified
    why : reason why edges that could verify the face do not; empty otherwise
    """

    share: float
    look_count: int
    is_verified: bool = False
    how: str = ""
    why: str = ""


def floor_words(off_mm: float) -> str:
    """Return the words for a floor that is out of place.

    Parameters
    ----------
    off_mm : height above nominal; negative for a deeper floor
    """
    way = "higher" if off_mm > 0 else "deeper"
    return say("the floor shows about {off_mm:.1f} mm {way}", off_mm=abs(off_mm), way=way)


@dataclass(frozen=True, slots=True)
class MissingEdge:
    """An edge that must be visible but is found in no picture.

    Attributes
    ----------
    edge : its number in the boundary
    faces : ids of its two adjacent faces
    length_mm : length of the edge
    look_count : number of pictures that must show it
    """

    edge: int
    faces: tuple[int, int]
    length_mm: float
    look_count: int


def missing_edges(solid: Solid, shown: EdgeLooks) -> tuple[MissingEdge, ...]:
    """Return the outer edges that must be mostly visible, and are nowhere found in place.

    An edge between two faces of equal brightness may be invisible in one picture, but not in two,
    so each place along an edge counts where two pictures must show it. An edge shorter than the
    smallest defect spans a few pixels and is more easily invisible: it takes three. An inner corner
    may be invisible in all pictures, and so may the edges of a face that is a pixel or two wide.

    Parameters
    ----------
    solid : the part
    shown : looks at its edges
    """
    edges, looks = shown.edges, shown.every
    blurred = is_blurred(solid, shown.pixel_mm)
    must = np.stack([look.state != State.HIDDEN for look in looks])
    held = np.any([look.state == State.IN_PLACE for look in looks], axis=0)
    out = []
    for edge in np.unique(edges.edge).tolist():
        mine = np.flatnonzero(edges.edge == edge)
        if solid.boundary.crease[edge] != Crease.CONVEX or blurred[edges.faces[mine[0]]].any():
            continue
        length = float(edges.length_mm[mine].sum())
        least = TWO if length >= shown.smallest_mm else THREE
        is_shown = must[:, mine].sum(axis=0) >= least
        if is_shown.mean() > GREATER_PART and held[mine].sum() < CHANCE * is_shown.sum():
            one, other = edges.faces[mine[0]].tolist()
            count = int(must[:, mine].any(axis=1).sum())
            out.append(MissingEdge(edge, (one, other), length, count))
    return tuple(out)


def prove_faces(
    solid: Solid,
    recesses: Sequence[Recess],
    shown: EdgeLooks,
    narrow: BoolArray,
    deep: BoolArray,
    floors: Mapping[frozenset[int], Floor],
) -> dict[int, FaceEdges]:
    """Return the evidence on faces from their edges, by face id.

    The wall of a through hole is verified by the light through it, since both rims may be in place
    with a web between them; where another hollow cuts the wall, by the light along all its pieces.
    Where a gripper hides a part of the light in all views, or the far side of a bore that the hole
    leads to, both rims have to be in place all round, each place in any picture. The wall of a
    blind hole is verified by its rim, once the floor is shown to be deeper than half. Any other
    narrow face is verified by its edges, in pictures in which the smallest defect would have moved
    them.

    Parameters
    ----------
    solid : the part
    recesses : its recesses
    shown : looks at its edges
    narrow : (f,) True where no disc of the smallest defect on the face is far enough from its edges
    deep : (f,) True for a floor of which light and edges leave too little to compare
    floors : floors of its blind holes, by their walls
    """
    edges, looks = shown.edges, shown.every
    recess_of = {wall: recess for recess in recesses for wall in recess.walls}
    mouths = find_mouths(solid)
    held = confirmed(looks, np.stack([look.state == State.IN_PLACE for look in looks]))
    out = {}
    for face in range(len(solid.faces)):
        own, side = np.nonzero(edges.faces == face)
        if len(own) == 0:
            continue
        share = _share(edges, own, held[own])
        count = sum(bool((look.state[own] == State.IN_PLACE).any()) for look in looks)
        how = why = ""
        recess = recess_of.get(face)
        rims = _rims(edges, face, recess, mouths)
        if rims:
            light = [_by_light(edges, looks, rim, face) for rim in rims]
            # A wall with one plain mouth is proven by it, one from end to end by both.
            share = min(light) if recess is not None else max(light)
            how = key("of its rims, by the light through it,") if share > GREATER_PART else ""
            why = say(
                "light through it is shown at {percent:.0f} % of its rims", percent=100 * share
            )
            if not how and recess is not None and share >= OPEN_PART:
                round_ = _beside_light(edges, looks, rims, held, face)
                if round_ >= ALL_ROUND:
                    share = round_
                    how = key("of its rims, by the light through the part of it in sight,")
        elif recess is not None and not recess.is_through:
            share, how, why = _blind(edges, looks, face, floors[recess.walls])
        is_hole = solid.faces[face].concave and solid.faces[face].kind != "cone"
        # A rim in place does not prove the depth of a hole: walls of bores are excluded here, and
        # those of a keyway through one count by their edges from end to end.
        asks_edges = narrow[face] and not is_hole
        if asks_edges and recess is not None:
            asks_edges = _proven_without_edges(solid, recess, narrow)
            inner = ~np.isin(edges.edge[own], [e for mouth in mouths for e in mouth.edges])
            own, side = own[inner], side[inner]
        if asks_edges and len(own):
            told = _told(edges, looks, own, side, shown.smallest_mm)
            why = say(
                "{told_percent:.0f} % of its edges shown in place where a defect would move them",
                told_percent=100 * told,
            )
            if told > GREATER_PART:
                share, how = told, OF_ITS_EDGES
        out[face] = FaceEdges(share, count, bool(how), how, "" if how else why)
    for floor in floors.values():
        _prove_floor(solid, narrow, deep, floor, out)
    return {
        face: replace(one, is_verified=False, how="", why=CLOSED)
        if solid.faces[face].kind == "cone" and not _is_open(solid, face, recess_of, out)
        else one
        for face, one in out.items()
    }


def _proven_without_edges(solid: Solid, recess: Recess, narrow: BoolArray) -> bool:
    """Return True for a through hole of which a wall has to be compared, or proven by light."""
    return recess.is_through and any(
        solid.faces[wall].concave or not narrow[wall] for wall in recess.walls
    )


def _told(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    own: IndexArray,
    side: IndexArray,
    smallest_mm: float,
) -> float:
    """Return the share of a face's edges along which the smallest defect would be visible.

    Parameters
    ----------
    edges, looks : edges of the part, and looks at them
    own, side : (k,) points on the face's edges, and the face's number among the two adjacent ones
    smallest_mm : size of the smallest defect
    """
    told = [look.state == State.IN_PLACE for look in looks]
    for look, one in zip(looks, told, strict=True):
        one[own] &= look.least_mm[own, side] < smallest_mm
    return _share(edges, own, confirmed(looks, np.stack(told))[own])


def _prove_floor(
    solid: Solid, narrow: BoolArray, deep: BoolArray, floor: Floor, faces: dict[int, FaceEdges]
) -> None:
    """Add the floor of a blind hole if it has no room to compare, and all its walls are verified.

    On a deep one, which is wide enough for a defect, the light has to be as its depth explains.

    Parameters
    ----------
    solid : the part
    narrow, deep : see `prove_faces`
    floor : of the hole
    faces : evidence by face id
    """
    recess = floor.recess
    bottom = recess.bottom(solid)
    walls = [faces[wall] for wall in recess.walls if wall in faces]
    if len(bottom) != 1:
        return
    (face,) = bottom
    if not (narrow[face] or deep[face]) or faces[face].is_verified:
        return
    if not narrow[face] and not (floor.is_lit and floor.is_even):
        faces[face] = replace(faces[face], why=UNEVEN_LIGHT if floor.is_lit else UNLIT_FLOOR)
    elif all(wall.is_verified for wall in walls):
        share = min(wall.share for wall in walls)
        how = key("of the rim above it, and it at its depth,")
        faces[face] = replace(faces[face], share=share, is_verified=True, how=how, why="")
    else:
        why = next((wall.why for wall in walls if wall.why), "")
        faces[face] = replace(faces[face], why=faces[face].why or why)


def _is_open(
    solid: Solid, face: int, recess_of: Mapping[int, Recess], faces: Mapping[int, FaceEdges]
) -> bool:
    """Return True if a cone is not hollow, or if light passes through its bore."""
    if not solid.faces[face].concave:
        return True
    sides = solid.boundary.face.reshape(-1, 2)
    beside = set(sides[(sides == face).any(axis=1)].ravel().tolist()) - {face}
    return any(
        solid.faces[other].concave
        and solid.faces[other].kind == "cylinder"
        and other in faces
        and faces[other].is_verified
        and (other not in recess_of or recess_of[other].is_through)
        for other in beside
    )


def confirmed(looks: Sequence[EdgeLook], in_place: BoolArray) -> BoolArray:
    """Return a mask (n,) of edge points found in place at least as often as elsewhere.

    Parameters
    ----------
    looks : looks at k pictures
    in_place : (k, n) mask of the points that each shows in place
    """
    elsewhere = np.sum([look.state == State.ELSEWHERE for look in looks], axis=0)
    times = in_place.sum(axis=0)
    return np.asarray((times > 0) & (times >= elsewhere))


@dataclass(frozen=True, eq=False, slots=True)
class _Rim:
    """A mouth of a wall: (k,) points of the wall on it, (m,) all its points, (3,) its axis."""

    own: IndexArray
    around: IndexArray
    axis: FloatArray


def _rims(
    edges: PartEdges, face: int, recess: Recess | None, mouths: Sequence[Mouth]
) -> list[_Rim]:
    """Return the mouths of a wall through which light may pass.

    A wall that another hollow cuts, or that leads to one, need have one mouth alone. The pictures
    show whether light can pass at all.

    Parameters
    ----------
    edges : edges of the part
    face : id of the wall
    recess : its hole, if that runs straight from end to end
    mouths : all mouths of the part
    """
    if recess is not None and not recess.is_through:
        return []
    out = []
    for mouth in mouths:
        if face not in mouth.walls:
            continue
        around = np.flatnonzero(np.isin(edges.edge, list(mouth.edges)))
        own = around[(edges.faces[around] == face).any(axis=1)]
        if len(own):
            walls = edges.normals[around][np.isin(edges.faces[around], list(mouth.walls))]
            # square to the walls, or as nearly as can be
            out.append(_Rim(own, around, np.asarray(np.linalg.svd(walls)[2][2])))
        elif recess is not None:
            return []  # too short to be looked for
    return out


def _by_light(edges: PartEdges, looks: Sequence[EdgeLook], rim: _Rim, face: int) -> float:
    """Return the share of a mouth where light ends at a wall's edge, or at an edge in line with it.

    A hollow that cuts a wall leaves pieces in line, with one normal. Light that passes the mouth
    along one of them passes along all, as it does along a wall that nothing cuts. It counts for no
    place of the mouth at which light has to end in any picture, and does in none.
    """
    must = [
        (look.state != State.HIDDEN)[:, None]
        & look.light_through
        & _passes(look, rim.around)[:, None]
        for look in looks
    ]
    light = np.stack([
        one & (look.state == State.IN_PLACE)[:, None]
        for one, look in zip(must, looks, strict=True)
    ])  # fmt: skip
    shown = _ends(looks, [one.any(axis=1) for one in must])
    there, side = np.nonzero(light.any(axis=0) & shown[:, None])
    is_dark = np.any(must, axis=(0, 2)) & ~shown
    flat = edges.points_mm - (edges.points_mm @ rim.axis)[:, None] * rim.axis
    normals = edges.normals[rim.own, (edges.faces[rim.own, 1] == face).astype(np.intp)]
    near = cdist(flat[rim.own], flat[there]) <= BESIDE * edges.length_mm[rim.own, None]
    is_wall = normals @ edges.normals[there, side].T >= IN_LINE
    return _share(edges, rim.own, (near & is_wall).any(axis=1) & ~is_dark[rim.own])


def _ends(looks: Sequence[EdgeLook], must: Sequence[BoolArray]) -> BoolArray:
    """Return a mask (n,) of edge points at which light ends, where it must in some pictures (n,).

    What pictures under lamps show of an edge says nothing of the light that passes it.
    """
    light = [look.only(one) for look, one in zip(looks, must, strict=True)]
    return confirmed(light, np.stack([look.state == State.IN_PLACE for look in light]))


def _passes(look: EdgeLook, around: IndexArray) -> BoolArray:
    """Return a mask (n,) of the edge points whose lines of sight pass a mouth in a picture.

    Parameters
    ----------
    look : look at the picture
    around : points round the mouth
    """
    out = np.asarray(look.light_through.any(axis=1))
    corners = cv2.convexHull(look.pixels[around].astype(np.float32))[:, 0].astype(np.float64)
    if len(corners) < 3 or not out.any():
        return np.zeros_like(out)
    along = np.roll(corners, -1, axis=0) - corners
    outward = np.column_stack([along[:, 1], -along[:, 0]]) / lengths(along)[:, None]
    outward *= np.sign(((corners - corners.mean(axis=0)) * outward).sum(axis=1).mean())
    off = look.pixels[out] @ outward.T - (corners * outward).sum(axis=1)
    out[out] = off.max(axis=1) <= SPACING_PX
    return out


def _beside_light(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    rims: Sequence[_Rim],
    held: BoolArray,
    face: int,
) -> float:
    """Return the share of the rims in place of a bore of which a part lets the light through.

    Parameters
    ----------
    edges, looks : edges of the part, and looks at them
    rims : its two mouths
    held : (n,) True where any picture shows the edge in place
    face : id of the wall

    Returns
    -------
    share : that of the worse rim; 0 where too much of the light ends off the rims
    """
    is_wall = edges.faces == face
    own = np.concatenate([rim.own for rim in rims])
    through = [
        (look.light_through & is_wall).any(axis=1) & (look.state != State.HIDDEN) for look in looks
    ]
    in_sight = own[np.any(through, axis=0)[own]]
    ends = _ends(looks, through)
    if not len(in_sight) or _share(edges, in_sight, ends[in_sight]) < ALL_ROUND:
        return 0.0
    return min(_share(edges, rim.own, held[rim.own]) for rim in rims)


def _blind(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    face: int,
    floor: Floor,
) -> tuple[float, str, str]:
    """Return the visible share of a wall's mouth, with the proof or the reason against it.

    Parameters
    ----------
    edges, looks : edges of the part, and looks at them
    face : id of the wall
    floor : floor of its hole
    """
    is_wall = edges.faces == face
    mouth = np.flatnonzero(is_wall.any(axis=1) & np.isin(edges.edge, list(floor.recess.mouths[0])))
    if len(mouth) == 0:
        return 0.0, "", NO_RIM
    shown = confirmed(
        looks,
        np.stack([
            (look.state == State.IN_PLACE) & (look.faces_camera & ~is_wall).any(axis=1)
            for look in looks
        ]),
    )  # fmt: skip
    share = _share(edges, mouth, shown[mouth])
    bound_mm = floor.bound_mm
    if floor.elsewhere:
        return share, "", floor_words(floor.off_mm)
    if floor.is_doubted:
        return share, "", DISPUTED
    if share <= GREATER_PART:
        return share, "", say("{percent:.0f} % of its rim shown in place", percent=100 * share)
    if np.isfinite(bound_mm):
        return (
            share,
            say("of its rim, its floor within {bound_mm:.1f} mm of its depth,", bound_mm=bound_mm),
            "",
        )
    return share, "", NO_DEPTH


def _share(edges: PartEdges, points: IndexArray, shown: BoolArray) -> float:
    """Return the share of the length of some points (k,) for which a mask (k,) is True."""
    length = edges.length_mm[points]
    return float((length * shown).sum() / length.sum())
