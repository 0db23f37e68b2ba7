"""Stretches where an edge leaves its own course: broken off, or with something on it.

An edge as a whole may lie off its place within tolerances, and light may move it as a whole. What
is left once its own course is taken off is tested as outlines are (`integrity`): windows of
neighbouring rays against noise, and against what moves neighbours together.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from controller.arrays import BoolArray, FloatArray, IndexArray, median

from ..dimensions import BACKLIT, MeasuringSettings
from ..integrity import Allowances, Run, RunTest, find_runs
from ._edges import PartEdges
from ._looks import EdgeLook, State

MIN_POINTS: Final = 8  # least number of points of an edge with a course of its own
MIN_RUN: Final = 3  # least number of neighbouring rays that are off
ROUNDS: Final = 4
SIGMAS: Final = 3.0  # in standard deviations; the limit of any test is higher
# Share of a run's depth; points farther off belong to it, the others are on course.
BELONGS: Final = 0.25
FLANK: Final = 2  # points on course required at each end of a run
GAP: Final = 2  # missing points that do not end a run
SAME_LIGHT: Final = 2.0  # largest ratio of the contrasts along a run and beside it
OUTWARD: Final = 0.3  # share of a ray that leads out of the material, so that its sign is clear
LIMIT: Final = 2.0  # robust scatters from which a point has less weight in the course


@dataclass(frozen=True, eq=False, slots=True)
class Displaced:
    """Neighbouring points of an edge that one picture shows off its course.

    Attributes
    ----------
    look : which picture
    points : (k,) of the edges' points
    deepest : the one that is farthest off
    depth_px : the largest difference, positive out of the material
    depth_mm : the same on the part
    mean_mm : of the differences at all its points, without sign
    length_mm : along the edge
    is_burr : it is off away from the material, and the picture shows which way that is
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
    """One edge in one picture, less its own course.

    Attributes
    ----------
    known : (n,) which of the edges' points were found, in order
    off_px : (n,) how far they are off the edge's course, out of the material
    step_px : between two of them in the picture
    scatter_px : of them about the course, robust
    wave_px : what light and form move neighbours by together, standard deviation
    """

    known: IndexArray
    off_px: FloatArray
    step_px: float
    scatter_px: float
    wave_px: float

    def noise_px(self, look: EdgeLook, points: IndexArray) -> float:
        """Return the noise of a point (k,) of a set that may be faint, standard deviation [px]."""
        own = float(np.sqrt(np.mean(np.square(look.sigma_px[points]))))
        return max(self.scatter_px, own)


def wave_of(
    look: EdgeLook, pixel_mm: float, allowances: Allowances, settings: MeasuringSettings
) -> float:
    """Return the deviation of neighbouring edge points by light and form, one sigma [px].

    Light on the edge as a whole is in its course.

    Parameters
    ----------
    look : the picture
    pixel_mm : size of a pixel at the part
    allowances : of unevenness
    settings : how far light moves an edge
    """
    light = settings.backlit_edge_px if look.lamp == BACKLIT else settings.lit_edge_px
    return float(np.hypot(light / 3.0, allowances.form_mm / pixel_mm))


def known_points(look: EdgeLook) -> BoolArray:
    """Return a mask (n,) of the points that a picture shows in their own light.

    Elsewhere a wall may throw the panel's light back, or the gripper's shadow may end, whose border
    beside an edge looks like damage.
    """
    is_lit_so = ~look.may_glare & ~look.may_shade
    return np.asarray(np.isfinite(look.offset_px) & (look.state != State.HIDDEN) & is_lit_so)


def course_of(edges: PartEdges, look: EdgeLook, known: IndexArray, wave_px: float) -> Course:
    """Return one edge in one picture, less its own course.

    Parameters
    ----------
    edges : of the part
    look : the picture
    known : (n,) points of the edge that were found, in order; `MIN_POINTS` or more
    wave_px : see `wave_of`
    """
    off = _off_course(edges, look, known)
    step = median(np.linalg.norm(np.diff(look.pixels[known], axis=0), axis=1))
    return Course(known, off, step, 1.4826 * median(np.abs(off)), wave_px)


def find_displaced(
    edges: PartEdges,
    looks: Sequence[EdgeLook],
    pixel_mm: float,
    smallest_mm: float,
    allowances: Allowances,
    settings: MeasuringSettings,
) -> list[Displaced]:
    """Return the runs of edges that chance does not explain, look by look.

    Parameters
    ----------
    edges : of the part
    looks : at them
    pixel_mm : size of a pixel at the part
    smallest_mm : the shortest run; what is shorter may be dust
    allowances : of unevenness and false alarms
    settings : how far light moves an edge
    """
    total = sum(int(np.isfinite(look.offset_px).sum()) for look in looks)
    starts = np.flatnonzero(np.diff(edges.edge, prepend=-1))
    ends = np.append(starts[1:], len(edges.edge))
    found: list[Displaced] = []
    for look in looks:
        wave_px = wave_of(look, pixel_mm, allowances, settings)
        is_known = known_points(look)
        for start, end in zip(starts.tolist(), ends.tolist(), strict=True):
            known = start + np.flatnonzero(is_known[start:end])
            # where all of an edge lies so close, no window is off by what chance does not explain
            if (
                len(known) >= MIN_POINTS
                and float(np.ptp(look.offset_px[known])) >= SIGMAS * wave_px
            ):
                share = max(round(total / len(known)), 1)
                test = RunTest(0.0, wave_px, allowances.false_alarms, share)
                found += _runs(edges, look, course_of(edges, look, known, wave_px), test)
    return [run for run in found if run.length_mm >= smallest_mm]


def _runs(edges: PartEdges, look: EdgeLook, course: Course, test: RunTest) -> Iterator[Displaced]:
    """Yield the runs of one edge in one picture.

    Parameters
    ----------
    edges : of the part
    look : the picture
    course : of the edge in it
    test : how a run and chance are told apart; without the noise
    """
    known, off = course.known, course.off_px
    typical = median(look.sigma_px[known])
    test = replace(test, noise_px=max(course.scatter_px, typical))
    for run in find_runs(look.pixels[known], look.normals[known], off, course.step_px, test):
        whole = _whole_run(look, known, off, run)
        if whole is None:
            continue
        mine = known[whole]
        # where the edge is faint its points are known less well than elsewhere
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
    """Return all points (k,) of `known` in a run's displacement; None if it is no edge's own.

    Material that is missing leaves the edge between the same two levels of light, and the edge is
    back on its course at both ends. The border of a shadow that meets the edge leads away from it,
    and light changes as it is crossed.

    Parameters
    ----------
    look : with the contrast
    known : (n,) which points of an edge were found, in order
    off : (n,) how far they are off its course
    run : of these
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
    least, most = np.sort(np.abs(contrast))[[0, -1]]
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
    """Return the distances of points (k,) of one edge from its own course [px].

    A straight edge may be shifted and turned; one that closes on itself moved, grown and out of
    round.
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
