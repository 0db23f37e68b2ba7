"""Other looks at an edge that had to show damage, and do not.

Material that is missing or too much is there in every view; the border of a shadow, a highlight
and light from a neighbour are not. A look counts where it had to show the damage, whatever the
light: an outline, which moves with the material alone (ADR 79).
"""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from controller.arrays import FloatArray, IndexArray

from .._apart import is_turned
from ..dimensions import MeasuringSettings
from ..integrity import Allowances, RunTest
from ._displaced import MIN_POINTS, Course, Displaced, course_of, known_points, wave_of
from ._edges import PartEdges
from ._looks import EdgeLook

SIGMAS: Final = 3.0  # in standard deviations, from full damage to half of it, and from half to none
VIEW_COUNT: Final = 2  # views that each had to show the damage, and do not


def refuted(
    edges: PartEdges,
    runs: Sequence[Displaced],
    looks: Sequence[EdgeLook],
    T_world_part: Mapping[str, FloatArray],
    pixel_mm: float,
    allowances: Allowances,
    settings: MeasuringSettings,
) -> list[bool]:
    """Return a mask of the runs that two other views had to show, but show the edge on its course.

    Parameters
    ----------
    edges : of the part
    runs : of edges off their course
    looks : all pictures that count
    T_world_part : (4, 4) by view id
    pixel_mm : size of a pixel at the part
    allowances : of unevenness
    settings : how far light moves an edge
    """
    return [
        len(
            {
                look.view_id
                for look in looks
                if is_turned(T_world_part[run.look.view_id], T_world_part[look.view_id])
                and _is_clear(edges, run, look, wave_of(look, pixel_mm, allowances, settings))
            }
        )
        >= VIEW_COUNT
        for run in runs
    ]


def _is_clear(edges: PartEdges, run: Displaced, look: EdgeLook, wave_px: float) -> bool:
    """Return True if a look had to show a run, and shows the edge on its course there."""
    is_outline = look.faces_camera[run.points].sum(axis=1) == 1
    is_known = known_points(look)
    if not (is_outline & is_known[run.points]).all():
        return False
    expected_px = _expected_px(edges, run, look)
    if expected_px < 2 * SIGMAS * wave_px:
        return False
    known = np.flatnonzero(is_known & (edges.edge == edges.edge[run.deepest]))
    if len(known) < MIN_POINTS:
        return False
    course = course_of(edges, look, known, wave_px)
    sigma_px = _sigma_px(course, look, run.points)
    seen_px = float(course.off_px[np.isin(known, run.points)].mean())
    return expected_px >= 2 * SIGMAS * sigma_px and abs(seen_px) <= 0.5 * expected_px


def _expected_px(edges: PartEdges, run: Displaced, look: EdgeLook) -> float:
    """Return the mean offset of a look's outline along a run [px].

    A broken edge ends on either face as far from the edge as it is deep, or farther; the outline
    goes through the end that is farther out.
    """
    ends = np.abs(np.einsum("nj,nkj->nk", look.across[run.points], edges.into[run.points]))
    return run.mean_mm * float(ends.min(axis=1).mean())


def _sigma_px(course: Course, look: EdgeLook, points: IndexArray) -> float:
    """Return the standard deviation of the mean of some points (k,) of an edge."""
    test = RunTest(course.noise_px(look, points), course.wave_px)
    return float(test.sigma_px(np.array([len(points) * course.step_px]))[0])
