"""Evidence on a part's faces from its edges in all pictures that show them (ADR 34)."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IndexArray, inner, lengths, median
from controller.cad import Recess, Solid, SurfaceSamples, find_recesses
from controller.imaging import transform

from .._pose import PosedPart
from .._types import Finding, InspectionLimits
from ..dimensions import BACKLIT, MeasuringSettings, PosedView
from ..integrity import Allowances, allowed_mm
from ..limits import DUST_SIZES, FLATTEST_COS
from ..resolution import is_deep, is_narrow
from ._against import find_against
from ._beside import compared_beside
from ._damage import find_damage
from ._depth import Floor, find_floor
from ._displaced import find_displaced
from ._edges import PartEdges
from ._faces import FaceEdges, MissingEdge, missing_edges, prove_faces
from ._floor_light import blind_bore, rise_by_light
from ._looks import EdgeLook, EdgeLooks, look_at_edges
from ._other_looks import refuted
from ._rival_depths import look_at_other_depths

# Least cosine of incidence at which a face counts as shown when its width is judged.
MIN_COS: Final = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class EdgeEvidence:
    """All edges in all pictures that count, with their evidence.

    Attributes
    ----------
    edges : edges of the part; None where it has none
    looks : looks at the edges, picture by picture
    faces : evidence by face id
    findings : findings by view id: floors and edges out of place or missing, chips and burrs
    compared : (s,) mask of the surface samples that edges beside them compare
    missing : edges that must be visible but are found in no picture
    """

    edges: PartEdges | None
    looks: tuple[EdgeLook, ...]
    faces: Mapping[int, FaceEdges]
    findings: Mapping[str, tuple[Finding, ...]]
    compared: BoolArray
    missing: tuple[MissingEdge, ...] = ()


def find_evidence(
    part: PosedPart,
    samples: SurfaceSamples,
    views: Sequence[PosedView],
    edges: PartEdges | None,
    by_view: Sequence[Sequence[EdgeLook]],
    limits: InspectionLimits,
    allowances: Allowances,
    settings: MeasuringSettings,
) -> EdgeEvidence:
    """Return the evidence on a part's faces from its edges, and the damage to the edges.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    views : evaluated views, with the pictures that passed their self-checks
    edges : edges of the part, from `find_edges`; None without any, or without views
    by_view : looks of each view at them, from `look_at_edges`
    limits : limits of findings
    allowances : allowed deviations of a good part
    settings : prior uncertainties
    """
    if edges is None:
        return EdgeEvidence(None, (), {}, {}, np.zeros(len(samples.points_mm), dtype=bool))
    pixel_mm = closest_pixel_mm(views)
    counted = _Counted(samples, edges, views)
    looks: list[EdgeLook] = []
    for one, found in zip(views, by_view, strict=True):
        looks += counted.only(found, one, edges)
    smallest_mm = limits.smallest_defect_mm
    shown = EdgeLooks(
        edges,
        tuple(looks),
        {one.task.view_id: one.T_world_part_measured for one in views},
        pixel_mm,
        smallest_mm,
        allowances,
        settings,
    )
    cosine = np.maximum(_best_cosine(part.solid, samples, views), MIN_COS)
    narrow = is_narrow(part.solid, smallest_mm, pixel_mm, cosine)
    recesses = find_recesses(part.solid)
    deep = is_deep(part.solid, recesses, smallest_mm, pixel_mm, _least_slope(views))
    floors = _floors(part, recesses, shown, views, counted)
    faces = prove_faces(part.solid, recesses, shown, narrow, deep, floors)
    runs = find_displaced(shown, DUST_SIZES * limits.dust_mm)
    damage = find_damage(shown, runs, refuted(shown, runs))
    missing = missing_edges(part.solid, shown)
    against = find_against(part.solid, recesses, shown, floors.values(), missing)
    return EdgeEvidence(
        edges,
        shown.every,
        faces,
        {
            view_id: (*against.get(view_id, ()), *damage.get(view_id, ()))
            for view_id in (*against, *damage)
        },
        compared_beside(samples, shown, faces),
        missing,
    )


class _Counted:
    """Edges beside surface samples for which a view counts; elsewhere it shows nothing."""

    def __init__(
        self, samples: SurfaceSamples, edges: PartEdges, views: Sequence[PosedView]
    ) -> None:
        self._edge = edges.edge
        self._nearest: IndexArray | None = None
        if any(one.counted is not None for one in views):
            found_at = cKDTree(samples.points_mm).query(edges.points_mm)[1]
            self._nearest = np.asarray(found_at, np.intp)

    def _mask(self, view: PosedView, chosen: Iterable[int]) -> BoolArray | None:
        """Return a mask of the points of some edges; None where all count."""
        if view.counted is None or self._nearest is None:
            return None
        mine = np.isin(self._edge, list(chosen))
        return np.asarray(view.counted[self._nearest[mine]])

    def only(
        self, looks: Iterable[EdgeLook], view: PosedView, edges: PartEdges
    ) -> Sequence[EdgeLook]:
        """Return a view's looks at edges, also at moved ones, where the view counts."""
        mask = self._mask(view, np.unique(edges.edge).tolist())
        return list(looks) if mask is None else [look.only(mask) for look in looks]

    def counts_for(self, view: PosedView, chosen: Iterable[int]) -> bool:
        """Return True if a view counts for all points of some edges."""
        mask = self._mask(view, chosen)
        return mask is None or bool(mask.all())


def closest_pixel_mm(views: Sequence[PosedView]) -> float:
    """Return the pixel size at the part in the closest of one or more views."""
    return min(v.task.camera.mm_per_px(v.T_world_part_measured[:3, 3]) for v in views)


def _least_slope(views: Sequence[PosedView]) -> float:
    """Return the tangent of the angle at the part between the camera and the lamp nearest to it.

    It is inf without a lamp.

    Parameters
    ----------
    views : with their lamps
    """
    least = np.inf
    for one in views:
        p_mm = one.T_world_part_measured[:3, 3]
        to_camera = one.task.camera.position_mm - p_mm
        for lamp in one.task.lamps:
            to_lamp = lamp.points_mm - p_mm
            along = to_lamp @ to_camera / np.linalg.norm(to_camera)
            across = np.sqrt(np.maximum((to_lamp**2).sum(axis=1) - along**2, 0.0))
            if (along > 0).all():
                least = min(least, float(np.mean(across / along)))
    return float(least)


def _floors(
    part: PosedPart,
    recesses: Sequence[Recess],
    shown: EdgeLooks,
    views: Sequence[PosedView],
    counted: "_Counted",
) -> dict[frozenset[int], Floor]:
    """Return the visible floors of blind holes, by their walls.

    Parameters
    ----------
    part : the CAD model
    recesses : its recesses
    shown : looks at its edges
    views : views with the pictures that count
    counted : places for which each of them counts
    """
    allowed = allowed_mm(part, shown.allowances.tolerance_class)

    def look_at(rival: PosedPart, moved: PartEdges) -> Iterator[EdgeLook]:
        for one in views:
            found = look_at_edges(rival, moved, one, allowed, shown.settings)
            yield from counted.only(found, one, moved)

    found: dict[frozenset[int], Floor] = {}
    for recess in recesses:
        if recess.is_through:
            continue
        bore = blind_bore(part.solid, recess)
        rises = (
            rise_by_light(part, bore, one, lamp, shown.smallest_mm)
            for one in views
            for lamp in one.lamps
            if lamp != BACKLIT and bore is not None and counted.counts_for(one, recess.floor)
        )
        by_light = [rise for rise in rises if rise is not None]
        floor = find_floor(shown, recess, by_light)
        # an edge at another depth is a finding as it is; one that light alone shows is sought
        if not np.isfinite(floor.bound_mm) and all(one.is_by_light for one in floor.elsewhere):
            others = look_at_other_depths(part.solid, shown, recess, look_at, floor.elsewhere)
            floor = replace(floor, looks=(*floor.looks, *others))
        found[recess.walls] = floor
    return found


def _best_cosine(solid: Solid, samples: SurfaceSamples, views: Sequence[PosedView]) -> FloatArray:
    """Return the largest cosine of incidence over all views at each face's middle (f,)."""
    out = np.zeros(len(solid.faces))
    order = np.argsort(samples.face_ids, kind="stable")
    points, normals = samples.points_mm[order], samples.normals[order]
    faces, begins = np.unique(samples.face_ids[order], return_index=True)
    for one in views:
        T = one.T_world_part_measured
        towards = one.task.camera.position_mm - transform(T, points)
        cosine = inner(towards, normals @ np.ascontiguousarray(T[:3, :3].T)) / lengths(towards)
        for face, of_face in zip(faces.tolist(), np.split(cosine, begins[1:]), strict=True):
            shown = of_face[of_face > FLATTEST_COS]
            if len(shown):
                out[face] = max(out[face], median(shown))
    return out
