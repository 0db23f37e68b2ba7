"""Chips and burrs on edges, found in pictures under lamps and before the panel."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray

from .._apart import SAME_PIXELS_PX
from .._types import Finding, FindingKind
from ._displaced import Displaced
from ._edges import PartEdges
from ._looks import EdgeLooks

BESIDE: Final = 1  # largest number of points between two runs of one place


def find_damage(
    shown: EdgeLooks, runs: Sequence[Displaced], is_refuted: Sequence[bool] = ()
) -> dict[str, tuple[Finding, ...]]:
    """Return the findings from runs of displaced points by view, one for each place and view.

    A place is sure if two views show it in different pixels with the part turned between them; two
    lamps in one view share the dirt on the lens and the dust on the part. A place that is not sure
    is dropped if other looks refute it.

    Parameters
    ----------
    shown : looks at the edges
    runs : all runs found
    is_refuted : for each run, True if other looks had to show it and do not; empty for none
    """
    contradicted = {id(run) for run, is_it in zip(runs, is_refuted, strict=False) if is_it}
    by_place: dict[tuple[int, str], list[Displaced]] = {}
    for place, run in zip(_places(shown.edges, runs), runs, strict=True):
        by_place.setdefault((place, run.look.view_id), []).append(run)
    out: dict[str, list[Finding]] = {}
    for (place, view_id), mine in by_place.items():
        plainest = max(mine, key=lambda run: run.depth_mm)
        others = [
            run
            for (other, other_view), those in by_place.items()
            if other == place and other_view != view_id
            for run in those
        ]
        is_sure = any(_is_other_look(shown, plainest, other) for other in others)
        if not is_sure and all(id(run) in contradicted for run in mine):
            continue
        out.setdefault(view_id, []).append(_finding(shown.edges, plainest, is_sure))
    return {view_id: tuple(found) for view_id, found in out.items()}


def _places(edges: PartEdges, runs: Sequence[Displaced]) -> list[int]:
    """Return the number of each run's place; runs on the same points share one."""
    numbers = list(range(len(runs)))
    for i, one in enumerate(runs):
        for j, other in enumerate(runs[:i]):
            if numbers[i] != numbers[j] and _overlap(edges, one, other):
                low, high = sorted((numbers[i], numbers[j]))
                numbers = [low if number == high else number for number in numbers]
    return numbers


def _overlap(edges: PartEdges, one: Displaced, other: Displaced) -> bool:
    if edges.edge[one.points[0]] != edges.edge[other.points[0]]:
        return False
    if (one.depth_px > 0) != (other.depth_px > 0):
        return False
    low = max(int(one.points.min()), int(other.points.min()))
    high = min(int(one.points.max()), int(other.points.max()))
    return low <= high + BESIDE


def _is_other_look(shown: EdgeLooks, one: Displaced, other: Displaced) -> bool:
    away = one.look.pixels[one.deepest] - other.look.pixels[other.deepest]
    is_other = shown.is_turned(one.look.view_id, other.look.view_id)
    return bool(is_other and np.hypot(*away) > SAME_PIXELS_PX)


def _finding(edges: PartEdges, run: Displaced, is_sure: bool) -> Finding:
    at = run.look.pixels[run.points]
    low, high = at.min(axis=0), at.max(axis=0)
    x, y = run.look.pixels[run.deepest].tolist()
    return Finding(
        kind=FindingKind.BURR if run.is_burr else FindingKind.CHIP,
        lamp=run.look.lamp,
        area_mm2=0.5 * run.length_mm * run.depth_mm,
        size_mm=float(np.hypot(run.length_mm, run.depth_mm)),
        at_px=(x, y),
        box_px=(int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1),
        p_part_mm=edges.points_mm[run.deepest],
        face_ids=tuple(int(face) for face in edges.faces[run.deepest]),
        is_sure=is_sure,
        outline_px=_between(run),
    )


def _between(run: Displaced) -> FloatArray:
    """Return the border (k, 2) of the area between an edge and its nominal place."""
    nominal = run.look.pixels[run.points]
    there = nominal + run.look.normals[run.points] * run.look.offset_px[run.points, None]
    return np.concatenate([nominal, there[::-1]])
