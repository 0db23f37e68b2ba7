"""Refutation of damage by other looks that had to show it and do not.

Missing or extra material is present in every view; the border of a shadow, a highlight and light
from a neighbour are not. A look counts where it had to show the damage under any light: an outline,
which moves only with the material (ADR 79).
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from controller.arrays import IndexArray

from ..integrity import RunTest
from ..limits import SURE_SIGMAS
from ._displaced import MIN_POINTS, Course, Displaced, course_of, known_points
from ._edges import PartEdges
from ._looks import EdgeLook, EdgeLooks

VIEW_COUNT: Final = 2  # number of views that had to show the damage and do not


def refuted(shown: EdgeLooks, runs: Sequence[Displaced]) -> list[bool]:
    """Return a mask of runs refuted by two other views, which show the edge on its course.

    Parameters
    ----------
    shown : looks at the edges
    runs : runs of edges off their course
    """
    return [
        len(
            {
                look.view_id
                for look in shown.every
                if shown.is_turned(run.look.view_id, look.view_id)
                and _is_clear(shown.edges, run, look, shown.wave_px(look))
            }
        )
        >= VIEW_COUNT
        for run in runs
    ]


def _is_clear(edges: PartEdges, run: Displaced, look: EdgeLook, wave_px: float) -> bool:
    """Return True if a look had to show a run but shows the edge on its course there."""
    is_outline = look.faces_camera[run.points].sum(axis=1) == 1
    is_known = known_points(look)
    if not (is_outline & is_known[run.points]).all():
        return False
    expected_px = _expected_px(edges, run, look)
    if expected_px < 2 * SURE_SIGMAS * wave_px:
        return False
    known = np.flatnonzero(is_known & (edges.edge == edges.edge[run.deepest]))
    if len(known) < MIN_POINTS:
        return False
    course = course_of(edges, look, known, wave_px)
    sigma_px = _sigma_px(course, look, run.points)
    seen_px = float(course.off_px[np.isin(known, run.points)].mean())
    return expected_px >= 2 * SURE_SIGMAS * sigma_px and abs(seen_px) <= 0.5 * expected_px


def _expected_px(edges: PartEdges, run: Displaced, look: EdgeLook) -> float:
    """Return the mean offset of a look's outline along a run [px].

    A break ends on either face at least as far from the edge as it is deep; the outline passes
    through the outer end.
    """
    ends = np.abs(np.einsum("nj,nkj->nk", look.across[run.points], edges.into[run.points]))
    return run.mean_mm * float(ends.min(axis=1).mean())


def _sigma_px(course: Course, look: EdgeLook, points: IndexArray) -> float:
    """Return the standard deviation of the mean offset of some points (k,) of an edge [px]."""
    test = RunTest(course.noise_px(look, points), course.wave_px)
    return float(test.sigma_px(np.array([len(points) * course.step_px]))[0])
