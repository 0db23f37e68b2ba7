"""Evidence of edges against a part: floors at another depth, edges out of place.

The absence of an edge from its place proves nothing, since two faces may be equally bright. So a
part fails by positive evidence: the same edge, complete and on a course of its own, where no good
part can have it; a floor at another depth, by its edges and by its light. A whole mouth is the
exception, since the dark of its hollow lies beside the light on the face about it all round. Such
evidence counts whatever else is compared or left out.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from controller.arrays import BoolArray, IndexArray
from controller.cad import Mouth, Recess, Solid, find_mouths
from messages import key, say

from .._types import Finding, FindingKind
from ..limits import SURE_SIGMAS
from ._depth import FOLLOWS, Floor
from ._displaced import MIN_POINTS, course_of, known_points
from ._edges import PartEdges
from ._faces import CHANCE, GREATER_PART, TWO, MissingEdge, floor_words
from ._looks import FORM_PX, EdgeLook, EdgeLooks, State


@dataclass(frozen=True, eq=False, slots=True)
class MovedEdge:
    """An edge that one picture shows completely, but where no good part can have it.

    Attributes
    ----------
    look : the look at the picture
    edge : number of the edge in the boundary
    points : (k,) its points found on its course
    farthest : the point farthest beyond its limit
    off_px : offset of its course there, out of the material
    limit_px : largest offset of a good part there
    """

    look: EdgeLook
    edge: int
    points: IndexArray
    farthest: int
    off_px: float
    limit_px: float

    @property
    def off_mm(self) -> float:
        """Distance on the part from its nominal place, across its course in the picture."""
        return abs(self.off_px) / float(np.linalg.norm(self.look.across[self.farthest]))


def find_against(
    solid: Solid,
    recesses: Iterable[Recess],
    shown: EdgeLooks,
    floors: Iterable[Floor],
    missing: Sequence[MissingEdge],
) -> dict[str, tuple[Finding, ...]]:
    """Return the findings of floors and edges that are out of place or missing, by view.

    Parameters
    ----------
    solid : the part
    recesses : its recesses
    shown : looks at its edges
    floors : floors of its blind holes
    missing : edges that must be visible, and are so in no picture
    """
    out: dict[str, list[Finding]] = {}
    of_look = {(look.view_id, look.lamp): look for look in shown.every}
    places = _Places(recesses)
    mouths = _absent_mouths(solid, shown, missing)
    for view_id, finding in (
        *(one for floor in floors for one in _floor_findings(solid, shown.edges, floor, of_look)),
        *_edge_findings(shown, places),
        *_missing_findings(shown, places, missing, mouths),
    ):
        out.setdefault(view_id, []).append(finding)
    return {view_id: tuple(found) for view_id, found in out.items()}


def _floor_findings(
    solid: Solid,
    edges: PartEdges,
    floor: Floor,
    of_look: Mapping[tuple[str, str], EdgeLook],
) -> Iterator[tuple[str, Finding]]:
    """Yield a finding for each view that shows a floor out of place.

    Floors placed by light count as one look for any number of pictures, since all share one light
    model.
    """
    told: set[str] = set()
    bottom = sorted(floor.recess.bottom(solid))
    points = np.flatnonzero(np.isin(edges.edge, list(floor.recess.floor)))
    for one in floor.elsewhere:
        if one.source in told or len(points) == 0:
            continue
        told.add(one.source)
        look = of_look[one.view_id, one.lamp]
        yield (
            one.view_id,
            _finding(
                edges,
                look,
                points,
                FindingKind.DIMENSION,
                faces=(*bottom, *sorted(floor.recess.walls)),
                area_mm2=sum(solid.faces[face].area_mm2 for face in bottom),
                words=floor_words(floor.off_mm),
                is_sure=floor.is_agreed,
            ),
        )


class _Places:
    """Features of edges: a recess by its walls, else the edge's two faces."""

    def __init__(self, recesses: Iterable[Recess]) -> None:
        self._walls_about = {wall: one.walls for one in recesses for wall in one.walls}

    def of(self, faces: Iterable[int]) -> frozenset[int]:
        """Return the faces of the feature to which an edge between two faces belongs."""
        walls = (self._walls_about[face] for face in sorted(faces) if face in self._walls_about)
        return next(walls, frozenset(faces))


def _edge_findings(shown: EdgeLooks, places: _Places) -> Iterator[tuple[str, Finding]]:
    """Yield a finding of the edge farthest out of place, by feature and view."""
    edges, looks = shown.edges, shown.every
    by_place: dict[tuple[frozenset[int], str], list[MovedEdge]] = {}
    told = [(look, known_points(look), shown.wave_px(look)) for look in looks]
    for edge in np.unique(edges.edge).tolist():
        points = np.flatnonzero(edges.edge == edge)
        place = places.of(edges.faces[points[0]].tolist())
        moved = [
            one
            for look, is_known, wave_px in told
            if (one := _moved(edges, look, points, is_known, wave_px))
        ]
        for one in moved if _is_agreed(edges, moved, looks) else ():
            by_place.setdefault((place, one.look.view_id), []).append(one)
    for (_, view_id), every in by_place.items():
        plainest = max(every, key=lambda one: abs(one.off_px) / one.limit_px)
        faces = (int(f) for one in (plainest, *every) for f in edges.faces[one.farthest])
        yield (
            view_id,
            _finding(
                edges,
                plainest.look,
                plainest.points,
                FindingKind.DIMENSION,
                faces=tuple(dict.fromkeys(faces)),
                area_mm2=plainest.off_mm * float(edges.length_mm[plainest.points].sum()),
                words=say(
                    "an edge shows about {off_mm:.1f} mm out of its place", off_mm=plainest.off_mm
                ),
            ),
        )


def _absent_mouths(solid: Solid, shown: EdgeLooks, missing: Sequence[MissingEdge]) -> list[Mouth]:
    """Return the mouths that no picture shows: the part lacks the hollow.

    Nothing of it is in place, or close to it, in any picture that must show most of it and does
    show most of the other edges of the face about it; in two of them the part is turned. It is at
    least as long as that of a hole of the smallest defect's size: what is smaller is dark more
    easily, and nobody asks for it.

    Parameters
    ----------
    solid, shown, missing : see `find_against`
    """
    edges = shown.edges
    gone = {one.edge for one in missing}
    out = []
    for mouth in find_mouths(solid):
        is_own = np.isin(edges.edge, list(mouth.edges))
        own = np.flatnonzero(is_own)
        if not set(edges.edge[own].tolist()) <= gone:
            continue
        if edges.length_mm[own].sum() < np.pi * shown.smallest_mm:
            continue
        about = sorted(set(edges.faces[own].ravel().tolist()) - mouth.walls)
        beside = np.flatnonzero(np.isin(edges.faces, about).any(axis=1) & ~is_own)
        showing = [look for look in shown.every if _must_show(look, own, beside)]
        is_near = any(
            np.isin(look.state[own], (State.IN_PLACE, State.ELSEWHERE)).mean() >= CHANCE
            for look in showing
        )
        views = sorted({look.view_id for look in showing})
        is_other_look = any(shown.is_turned(*pair) for pair in combinations(views, 2))
        if is_other_look and not is_near:
            out.append(mouth)
    return out


def _must_show(look: EdgeLook, own: IndexArray, beside: IndexArray) -> bool:
    """Return True if a look must show most of some points, and shows most of those beside them.

    Parameters
    ----------
    look : look at the picture
    own, beside : (k,) points asked for, and (m,) those of other edges in the same light
    """
    state = look.state[beside]
    there = int((state == State.IN_PLACE).sum())
    is_shown = there > GREATER_PART * int((state != State.HIDDEN).sum())
    return is_shown and bool((look.state[own] != State.HIDDEN).mean() > GREATER_PART)


def _missing_findings(
    shown: EdgeLooks,
    places: _Places,
    missing: Sequence[MissingEdge],
    absent: Sequence[Mouth],
) -> Iterator[tuple[str, Finding]]:
    """Yield a finding for each feature's missing edges, in the picture that must show most."""
    edges, looks = shown.edges, shown.every
    by_place: dict[frozenset[int], list[MissingEdge]] = {}
    for edge in missing:
        by_place.setdefault(places.of(edge.faces), []).append(edge)
    for every in by_place.values():
        points = np.flatnonzero(np.isin(edges.edge, [one.edge for one in every]))
        look = max(looks, key=lambda look: int((look.state[points] != State.HIDDEN).sum()))
        length_mm = sum(one.length_mm for one in every)
        count = max(one.look_count for one in every)
        own = {one.edge for one in every}
        is_sure = any(mouth.edges & own for mouth in absent)
        if is_sure:
            what = key("a whole mouth")
        elif len(every) == 1:
            what = key("an edge")
        else:
            what = say("{every_count} edges", every_count=len(every))
        words = say(
            "{what}, {length_mm:.1f} mm long, shown by none of {count} pictures that must show it",
            what=what,
            length_mm=length_mm,
            count=count,
        )
        yield (
            look.view_id,
            _finding(
                edges,
                look,
                points,
                FindingKind.MISSING_EDGE,
                faces=tuple(dict.fromkeys(face for one in every for face in one.faces)),
                area_mm2=look.pixel_mm(points) * length_mm,
                words=words,
                is_sure=is_sure,
            ),
        )


def _moved(
    edges: PartEdges, look: EdgeLook, points: IndexArray, is_known: BoolArray, wave_px: float
) -> MovedEdge | None:
    """Return an edge that a picture shows beyond its limits; None for other edges.

    Parameters
    ----------
    edges : edges of the part
    look : look at one picture
    points : (k,) points of one edge, in order
    is_known : (n,) mask of all points, see `known_points`
    wave_px : see `EdgeLooks.wave_px`
    """
    shown = points[look.state[points] != State.HIDDEN]
    known = points[is_known[points]]
    if len(known) < MIN_POINTS or len(known) < FOLLOWS * len(shown):
        return None
    if (look.state[known] == State.IN_PLACE).mean() > GREATER_PART:
        return None
    course = course_of(edges, look, known, wave_px)
    place_px = look.offset_px[known] - course.off_px
    room_px = FORM_PX + SURE_SIGMAS * look.sigma_px[known]
    follows = np.abs(course.off_px) <= room_px
    if follows.sum() < FOLLOWS * len(shown):
        return None
    beyond_px = np.where(follows, np.abs(place_px) - look.limit_px[known], -np.inf)
    if (beyond_px > 0).sum() < MIN_POINTS:
        return None
    at = int(np.argmax(beyond_px))
    return MovedEdge(
        look, int(edges.edge[known[at]]), known[follows], int(known[at]), float(place_px[at]),
        float(look.limit_px[known[at]]),
    )  # fmt: skip


def _is_agreed(edges: PartEdges, moved: Sequence[MovedEdge], looks: Sequence[EdgeLook]) -> bool:
    """Return True if two pictures show an edge out of place, and not as many show it in place.

    A picture in which the same shift would be within the limits is no evidence.
    """
    if len(moved) < TWO:
        return False
    at = moved[0].farthest
    points = np.flatnonzero(edges.edge == moved[0].edge)
    across = np.stack([one.look.across[one.farthest] for one in moved])
    shift_mm, *_ = np.linalg.lstsq(across, np.array([one.off_px for one in moved]), rcond=None)
    off = np.abs(across @ shift_mm - [one.off_px for one in moved])
    agreed = [one for one, px in zip(moved, off, strict=True) if px <= one.limit_px]
    against = 0
    for look in looks:
        shown = points[look.state[points] != State.HIDDEN]
        if len(shown) < MIN_POINTS or abs(float(look.across[at] @ shift_mm)) <= look.limit_px[at]:
            continue
        against += bool((look.state[shown] == State.IN_PLACE).mean() > GREATER_PART)
    return len(agreed) >= TWO and len(agreed) > against


def _finding(
    edges: PartEdges,
    look: EdgeLook,
    points: IndexArray,
    kind: FindingKind,
    *,
    faces: tuple[int, ...],
    area_mm2: float,
    words: str,
    is_sure: bool = False,
) -> Finding:
    """Return a picture's finding along some points (k,) of edges."""
    at = look.pixels[points]
    low, high = at.min(axis=0), at.max(axis=0)
    x, y = at.mean(axis=0).tolist()
    return Finding(
        kind=kind,
        lamp=look.lamp,
        area_mm2=area_mm2,
        size_mm=float(np.ptp(edges.points_mm[points], axis=0).max()),
        at_px=(x, y),
        box_px=(int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1),
        p_part_mm=edges.points_mm[points].mean(axis=0),
        face_ids=faces,
        is_sure=is_sure,
        words=words,
    )
