"""Stretches where an edge leaves its own course: material is broken off, or adheres to it.

An edge as a whole may be displaced within tolerances, and by light. The residuals about its own
course are tested like outlines (`integrity`): windows of neighbouring rays against noise, and
against common displacements of neighbours.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray, median

from ..integrity import Run, RunTest, find_runs
from ..limits import SURE_SIGMAS
from ._edges import PartEdges
from ._looks import EdgeLook, EdgeLooks, State

MIN_POINTS: Final = 8  # least number of points of an edge with a course of its own
MIN_RUN: Final = 3  # least number of neighbouring rays in a run
ROUNDS: Final = 4
# Share of a run's depth above which points belong to the run; the others are on course.
BELONGS: Final = 0.25
FLANK: Final = 2  # least number of points on course at each end of a run
GAP: Final = 2  # largest number of missing points within a run
SAME_LIGHT: Final = 2.0  # largest ratio between the contrasts along a run and beside it
OUTWARD: Final = 0.3  # least share of a ray that leads out of the material, for a clear sign
LIMIT: Final = 2.0  # robust deviations from which a point has less weight in the course


@dataclass(frozen=True, eq=False, slots=True)
class Displaced:
    """A run of neighbouring points of an edge that one picture shows off its course.

    Attributes
    ----------
    look : the look at the picture
    points : (k,) numbers of the edge points
    deepest : number of the point farthest off
    depth_px : largest difference, positive out of the material
    depth_mm : the same on the part
    mean_mm : mean of the absolute differences at all its points
    length_mm : length along the edge
    is_burr : True if it is off away from the material, and the picture shows that direction
    """

    look: EdgeLook
    points: IndexArray
    deepest: int
    depth_px: float
    depth_mm: float
    mean_mm: float
    length_mm: float
    is_burr: bool


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """Residuals of one edge in one picture about its own course.

    Attributes
    ----------
    known : (n,) numbers of the edge points found, in order
    off_px : (n,) their distances from the edge's course, out of the material
    step_px : distance between two of them in the picture
    scatter_px : robust scatter about the course
    wave_px : standard deviation of common displacements of neighbours by light and form
    """

    known: IndexArray
    off_px: FloatArray
    step_px: float
    scatter_px: float
    wave_px: float

    def noise_px(self, look: EdgeLook, points: IndexArray) -> float:
        """Return the noise of points (k,), some of which may be faint: standard deviation [px]."""
        own = float(np.sqrt(np.mean(np.square(look.sigma_px[points]))))
        return max(self.scatter_px, own)


def known_points(look: EdgeLook) -> BoolArray:
    """Return a mask (n,) of the points that a picture shows in undisturbed light.

    Elsewhere a wall may reflect the panel's light, or the border of the gripper's shadow may lie
    beside an edge and look like damage.
    """
    is_lit_so = ~look.may_glare & ~look.may_shade
    return np.asarray(np.isfinite(look.offset_px) & (look.state != State.HIDDEN) & is_lit_so)


def course_of(edges: PartEdges, look: EdgeLook, known: IndexArray, wave_px: float) -> Course:
    """Return the residuals of one edge in one picture about its own course.

    Parameters
    ----------
    edges : edges of the part
    look : look at the picture
    known : (n,) numbers of the edge points found, in order; `MIN_POINTS` or more
    wave_px : see `EdgeLooks.wave_px`
    """
    off = _off_course(edges, look, known)
    step = median(np.linalg.norm(np.diff(look.pixels[known], axis=0), axis=1))
    return Course(known, off, step, 1.4826 * median(np.abs(off)), wave_px)


def find_displaced(shown: EdgeLooks, shortest_mm: float) -> list[Displaced]:
    """Return the runs of edges not explained by chance, look by look.

    Parameters
    ----------
    shown : looks at the edges
    shortest_mm : length of the shortest run; a shorter one may be dust
    """
    edges = shown.edges
    total = sum(int(np.isfinite(look.offset_px).sum()) for look in shown.every)
    starts = np.flatnonzero(np.diff(edges.edge, prepend=-1))
    ends = np.append(starts[1:], len(edges.edge))
    found: list[Displaced] = []
    for look in shown.every:
        wave_px = shown.wave_px(look)
        is_known = known_points(look)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            known = start + np.flatnonzero(is_known[start:end])
            # If all of an edge is this close to its course, no window can exceed chance.
            if (
                len(known) >= MIN_POINTS
                and float(np.ptp(look.offset_px[known])) >= SURE_SIGMAS * wave_px
            ):
                share = max(round(total / len(known)), 1)
                test = RunTest(0.0, wave_px, shown.allowances.false_alarms, share)
                found += _runs(edges, look, course_of(edges, look, known, wave_px), test)
    return [run for run in found if run.length_mm >= shortest_mm]


def _runs(edges: PartEdges, look: EdgeLook, course: Course, test: RunTest) -> Iterator[Displaced]:
    """Yield the runs of one edge in one picture.

    Parameters
    ----------
    edges : edges of the part
    look : look at the picture
    course : course of the edge in it
    test : test of a run against chance, without the noise
    """
    known, off = course.known, course.off_px
    typical = median(look.sigma_px[known])
    test = replace(test, noise_px=max(course.scatter_px, typical))
    for run in find_runs(look.pixels[known], look.normals[known], off, course.step_px, test):
        whole = _whole_run(look, known, off, run)
        if whole is None:
            continue
        mine = known[whole]
        # Points of a faint edge are less certain than others.
        weaker = replace(test, noise_px=course.noise_px(look, mine))
        sigma = float(weaker.sigma_px(np.array([len(mine) * course.step_px]))[0])
        if abs(float(off[whole].mean())) < test.limit(len(known)) * sigma:
            continue
        deepest = int(mine[np.argmax(np.abs(off[whole]))])
        across = look.across[deepest]
        size = max(float(np.linalg.norm(across)), 1e-9)
        out = float(edges.normals[deepest].sum(axis=0) @ across) / size
        yield Displaced(
            look=look,
            points=mine,
            deepest=deepest,
            depth_px=run.depth_px,
            depth_mm=abs(run.depth_px) / size,
            mean_mm=abs(float(off[whole].mean())) / size,
            length_mm=float(edges.length_mm[mine].sum()),
            is_burr=run.depth_px > 0 and out > OUTWARD,
        )


def _whole_run(look: EdgeLook, known: IndexArray, off: FloatArray, run: Run) -> IndexArray | None:
    """Return all points (k,) of `known` in a run; None if the edge itself is not displaced.

    Where material is missing, the edge still lies between the same two levels of light, and returns
    to its course at both ends. The border of a shadow that meets the edge leads away from it, and
    the levels of light change across it, or as near to the run as it is long.

    Parameters
    ----------
    look : look at the picture, with the contrasts
    known : (n,) numbers of the edge points found, in order
    off : (n,) their distances from its course
    run : run among these points
    """
    sign, depth = np.sign(run.depth_px), abs(run.depth_px)
    low, high = int(run.points.min()), int(run.points.max())
    while low > 0 and sign * off[low - 1] > BELONGS * depth:
        low -= 1
    while high < len(known) - 1 and sign * off[high + 1] > BELONGS * depth:
        high += 1
    if low < FLANK or high + FLANK >= len(known):
        return None
    whole = np.arange(low, high + 1)
    around = np.arange(low - FLANK, high + FLANK + 1)
    beside = np.setdiff1d(around, whole)
    contrast = look.contrast[known[around]]
    is_near = (known >= 2 * known[low] - known[high]) & (known <= 2 * known[high] - known[low])
    is_near[around] = True
    least, most = np.sort(np.abs(look.contrast[known[is_near]]))[[0, -1]]
    is_one_edge = (
        len(whole) >= MIN_RUN
        and bool((np.diff(known[around]) <= GAP).all())
        and bool((sign * off[whole] > 0).all())
        and bool((np.abs(off[beside]) <= BELONGS * depth).all())
        and abs(float(np.sign(contrast).sum())) == len(contrast)
        and most <= SAME_LIGHT * least
    )
    return whole if is_one_edge else None


def _off_course(edges: PartEdges, look: EdgeLook, known: IndexArray) -> FloatArray:
    """Return the distances (k,) of points of one edge from its own course [px].

    The course of a straight edge may be shifted and turned; that of a closed edge may be shifted,
    grown and out of round.
    """
    place = (known - known[0]) / max(len(edges.edge), 1)
    if edges.is_closed[known[0]]:
        mine = np.flatnonzero(edges.edge == edges.edge[known[0]])
        turn = 2 * np.pi * (known - mine[0]) / len(mine)
        waves = [wave(k * turn) for k in (1, 2) for wave in (np.cos, np.sin)]
        design = np.column_stack([np.ones(len(known)), *waves])
    else:
        design = np.column_stack([np.ones(len(known)), place - place.mean()])
    offset = look.offset_px[known]
    weight = np.ones(len(known))
    off = offset - np.median(offset)
    for _ in range(ROUNDS):
        scale = max(LIMIT * 1.4826 * median(np.abs(off)), 1e-3)
        weight = np.minimum(1.0, scale / np.maximum(np.abs(off), 1e-9))
        root = np.sqrt(weight)
        solution, *_ = np.linalg.lstsq(design * root[:, None], offset * root, rcond=None)
        off = offset - design @ solution
    return np.asarray(off)
