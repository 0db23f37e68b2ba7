"""Search for a blind hole's floor at other depths, if no picture shows it at its nominal one.

The search about an edge reaches a few pixels, where a floor farther off shows nothing or another
edge. The part is therefore modelled with its floor raised and lowered, and the floor's edges are
sought at their predicted places, with the matching visibility. One picture may show the border of a
shadow there. Unlike a floor, it does not move consistently with depth from view to view, so two
views must agree, or one with the depth that the light tells.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import trimesh

from controller.arrays import FloatArray
from controller.cad import Recess, Solid

from .._pose import PosedPart
from ._depth import FloorLook, floor_look
from ._edges import PartEdges
from ._looks import BEYOND_PX, EdgeLook, EdgeLooks

MIN_SOURCES: Final = 2  # least number of views, or of views and the light, that must agree
DEEPEST: Final = 1.0  # largest depth searched below nominal, in nominal depths
MAX_COUNT: Final = 40  # largest number of depths tried; deep holes are searched more coarsely


def look_at_other_depths(
    solid: Solid,
    shown: EdgeLooks,
    recess: Recess,
    look_at: Callable[[PosedPart, PartEdges], Iterable[EdgeLook]],
    by_light: Sequence[FloorLook],
) -> tuple[FloorLook, ...]:
    """Return more looks that agree on another depth of a floor; none if they do not.

    Parameters
    ----------
    solid : the part
    shown : looks at its edges at their nominal places
    recess : a blind recess
    look_at : function that looks at edges of a part in the same pictures
    by_light : looks that place it at another depth by light
    """
    edges = shown.edges
    at_place = {(look.view_id, look.lamp): look for look in shown.every}
    found: list[FloorLook] = []
    for raised_mm in _depths(recess, shown.pixel_mm):
        way = raised_mm * recess.axis
        rival = PosedPart(_with_floor_moved(solid, recess, way))
        moved = edges.moved(recess.floor, way)
        for look in look_at(rival, moved):
            own = at_place[look.view_id, look.lamp]
            one = floor_look(edges, own, recess, shown.settings, (raised_mm, moved, look))
            found += [one] if one is not None else []
    return tuple(one for one in _agreed([*found, *by_light]) if not one.is_by_light)


def _depths(recess: Recess, pixel_mm: float) -> Iterator[float]:
    """Yield the heights [mm] to which the floor is raised, close enough to miss no depth."""
    low, high = -DEEPEST * recess.depth_mm, recess.depth_mm
    count = int(np.clip(np.ceil((high - low) / (2 * BEYOND_PX * pixel_mm)), 2, MAX_COUNT))
    step = (high - low) / count
    yield from (low + step * (np.arange(count) + 0.5)).tolist()


def _with_floor_moved(solid: Solid, recess: Recess, by_mm: FloatArray) -> Solid:
    """Return the part with a moved floor and its walls extended to it."""
    vertices = np.array(solid.mesh.vertices, dtype=np.float64)
    bottom = np.isin(solid.face_of_triangle, sorted(recess.bottom(solid)))
    vertices[np.unique(solid.mesh.faces[bottom])] += by_mm
    return replace(solid, mesh=trimesh.Trimesh(vertices, solid.mesh.faces, process=False))


def _agreed(found: Sequence[FloorLook]) -> tuple[FloorLook, ...]:
    """Return the looks at the depth on which most views agree, the surest for each picture."""
    surest_last = sorted(found, key=lambda one: -one.u_mm)
    groups: list[tuple[FloorLook, ...]] = []
    for centre in found:
        alike = (one for one in surest_last if one.agrees_with(centre))
        groups.append(
            tuple({(one.view_id, one.lamp, one.is_by_light): one for one in alike}.values())
        )
    most = max(groups, key=lambda group: (_source_count(group), len(group)), default=())
    return most if _source_count(most) >= MIN_SOURCES else ()


def _source_count(looks: Sequence[FloorLook]) -> int:
    return len({look.source for look in looks})
