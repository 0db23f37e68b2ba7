"""A boundary as a string of primitives, straight and arc: of a picture and of a model alike.

The paper (references.md P3.1), with the arcs it left for later. Both sides use the same code: a
model's outline is sampled as densely as pixels are and coded as an observed one, so that rounded
corners and shallow steps are coded alike in both.

All points are mm in the table plane. Outlines run anticlockwise and holes clockwise in the sense
of the shoelace formula, whichever way they came.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Loop, Stroke

from ._corners import find_corners, triangular
from ._primitives import PrimitiveFit, RunningSums, fit_runs, is_circle
from ._slits import without_slits
from ._tolerances import BinaryTolerances

Number = TypeVar("Number", np.float64, np.complex128)

OUTLINE_SAMPLES = 256  # samples of an outline: one each 1.6 mm at 400 mm
HOLE_SAMPLES = 32
MIN_AREA_MM2 = 1e-6  # area that rounding leaves of a line traced there and back
MIN_CROSSING = 0.3  # sine of the least angle of two lines that meet in a corner
FARTHEST_CROSSING_MM = 1.5  # distance from the filter's peak; farther off it is another corner's
DEFAULT = BinaryTolerances()


class NoOutlineError(ValueError):
    """There is no outer loop, or none that encloses anything."""


@dataclass(frozen=True, eq=False, slots=True)
class BoundaryString:
    """The boundary of an object, outline and holes, as primitives; lengths in mm.

    Attributes
    ----------
    loop : (k,) loop of the primitive: 0 the outline, then the holes
    is_arc : (k,)
    start_mm, end_mm : (k, 2) ends of the fitted primitive; the lens rounds what lies between two
    along_mm : (k,) begin along its loop, from the loop's start
    length_mm : (k,)
    radius_mm : (k,) radius of arcs, positive where they turn left; 0 for lines
    centre_mm : (k, 2) centre of arcs; for lines the middle
    turn_rad : (k,) turned through inside it
    joint_rad : (k,) turn from its end to the start of the next one of its loop
    corner_along_mm, corner_turn_rad : (c,) positions of the outline's corners and their turns,
        positive where the object juts out
    corner_mm : (c, 2)
    hole_mm : (h, 2) centroids of the holes
    hole_area_mm2 : (h,)
    outline_mm : (256, 2) the outline at equal steps
    hole_outline_mm : (h, 32, 2) each hole at equal steps
    perimeter_mm : perimeter of the outline
    area_mm2 : area of the object, holes taken out
    centroid_mm : (2,) centroid of the filled outline
    """

    loop: NDArray[np.int16]
    is_arc: BoolArray
    start_mm: FloatArray
    end_mm: FloatArray
    along_mm: FloatArray
    length_mm: FloatArray
    radius_mm: FloatArray
    centre_mm: FloatArray
    turn_rad: FloatArray
    joint_rad: FloatArray
    corner_along_mm: FloatArray
    corner_turn_rad: FloatArray
    corner_mm: FloatArray
    hole_mm: FloatArray
    hole_area_mm2: FloatArray
    outline_mm: FloatArray
    hole_outline_mm: FloatArray
    perimeter_mm: float
    area_mm2: float
    centroid_mm: FloatArray

    @property
    def filled_mm2(self) -> float:
        """Area of the filled outline, which perspective leaves unchanged, unlike the holes."""
        return self.area_mm2 + float(self.hole_area_mm2.sum())


def boundary_string(
    loops_mm: Sequence[FloatArray],
    is_hole: Sequence[bool],
    limits: BinaryTolerances = DEFAULT,
) -> BoundaryString:
    """Return the boundary string of dense sub-pixel loops.

    Parameters
    ----------
    loops_mm : each (n, 2) closed, the first point not repeated, in the table plane
    is_hole : mask of the loops that are holes; of several outer loops the largest is the outline
    limits : spacing and sizes of corners follow the pixel's

    Raises
    ------
    NoOutlineError : no outer loop of three points that encloses anything
    """
    outer = [p for p, hole in zip(loops_mm, is_hole, strict=True) if not hole and len(p) > 2]
    holes = [p for p, hole in zip(loops_mm, is_hole, strict=True) if hole and len(p) > 2]
    if not outer:
        raise NoOutlineError(f"no outer loop of three points among {len(loops_mm)} loops")
    outline = max(outer, key=lambda p: abs(_area(p)))
    if abs(_area(outline)) < MIN_AREA_MM2:
        raise NoOutlineError(f"the largest of {len(outer)} outer loops encloses nothing")
    coded = [_code_loop(_directed(outline, 1.0), limits)]
    coded += [
        _code_loop(_directed(p, -1.0), limits)
        for p in holes
        if abs(_area(p)) >= limits.min_hole_mm2
    ]
    return _string(coded)


def model_string(
    view_loops: Sequence[Loop],
    limits: BinaryTolerances = DEFAULT,
    *,
    from_view: tuple[float, float] | None = None,
) -> BoundaryString:
    """Return the boundary string of a model's outline.

    Parameters
    ----------
    view_loops : of a view whose unit is the mm: `outline` from above, or through a table camera
    limits : as for the pictures it is to be compared with
    from_view : (x, y) of the camera's foot on the table where the view's second axis runs down;
        its points then are taken to the table. None takes them as they are.

    Raises
    ------
    NoOutlineError : as in `boundary_string`
    """
    points = [_sampled(loop, limits.spacing_mm) for loop in view_loops]
    if from_view is not None:
        points = [np.array(from_view) + p * (1.0, -1.0) for p in points]
    is_hole = [loop.is_hole for loop in view_loops]
    found = boundary_string(points, is_hole, limits)
    if np.abs(found.corner_turn_rad).max(initial=0.0) < limits.slit_turn_rad:
        return found
    wide = without_slits(points, is_hole, limits.slit_mm)
    # a view that is all sliver, as of a sheet on edge, stays what it is
    return boundary_string(*wide, limits) if False in wide[1] else found


@dataclass(frozen=True, eq=False, slots=True)
class _Coded:
    """One loop: its samples, corners and primitives."""

    points: FloatArray
    step_mm: float
    corner: IntArray
    corner_turn: FloatArray
    fits: tuple[FloatArray, ...]
    corner_mm: FloatArray


def _code_loop(points: FloatArray, limits: BinaryTolerances) -> _Coded:
    points, step = _resampled(points, limits.spacing_mm)
    closed = np.concatenate([points, points[:1]])
    sums = RunningSums(closed)
    corner, turn, begin = np.zeros(0, dtype=np.int64), np.zeros(0), 0
    if not is_circle(sums, len(closed), limits):
        corner, turn, begin = _corners(points, step, limits)
        points = np.concatenate([points[begin:], points[:begin]])
        closed = np.concatenate([points, points[:1]])
        sums = RunningSums(closed)
    runs = np.array([[0, len(points)]])
    if len(corner):
        corner = corner - begin
        runs = _runs_between(corner, len(points), max(1, round(limits.trim_mm / step)))
    fit = fit_runs(sums, closed, runs, limits)
    return _Coded(
        points, step, corner, turn, _table(closed, step, fit), _sharpened(points, corner, fit)
    )


def _corners(
    points: FloatArray, step: float, limits: BinaryTolerances
) -> tuple[IntArray, FloatArray, int]:
    """Return corner samples, turns and a start of a loop at equal steps.

    The triangular filter of the turn per sample is the turn between the chord behind and the chord
    ahead. On an arc it grows with the chord, at a corner it does not. A loop begins at its first
    corner; one without, where its bend changes most, which is where two primitives meet.
    """
    z = points[:, 0] + 1j * points[:, 1]
    side = next_of(z) - z
    turn = np.angle(side * np.concatenate([side[-1:], side[:-1]]).conj())
    box = max(2, round(limits.corner_box_mm / step))
    half = max(1, box // 2)
    wide = triangular(turn, box) / box
    found = find_corners(wide, limits.corner_turn_rad, box)
    narrow = np.abs(triangular(turn, half) / half)
    at = found.index[:, None] + np.array([-1, 0, 1])
    near = narrow[at % len(narrow)].max(axis=1)
    sharp = near >= limits.corner_sharpness * found.size
    corner = found.index[sharp]
    begin = int(corner[0]) if len(corner) else int(np.abs(np.roll(wide, box) - wide).argmax())
    if len(corner) == 0:
        begin = (begin - box // 2) % len(points)
    return corner, (found.size * found.sign)[sharp], begin


def _runs_between(corner: IntArray, count: int, trim: int) -> IntArray:
    """Return first and last samples (c, 2) of the runs between corners, the corners trimmed."""
    ends = np.append(corner[1:], count)
    cut = np.clip((ends - corner - 4) // 2, 0, trim)
    return np.stack([corner + cut, ends - cut], axis=1)


def _table(closed: FloatArray, step: float, fit: PrimitiveFit) -> tuple[FloatArray, ...]:
    """Return start, end, along, length, radius, centre, turn, joint, is_arc, in order."""
    first, last, is_arc = fit.first, fit.last, fit.is_arc
    centre, radius, direction = fit.centre, fit.radius, fit.direction
    p, q = closed[first], closed[last]
    # the samples' feet on the line or on the circle
    foot = [_on(v, is_arc, centre, radius, direction) for v in (p, q)]
    arm = [v - centre for v in foot]
    # by quarters: half a circle or more has no sign
    on_way = [
        arm[0],
        *(closed[(k * first + (4 - k) * last) // 4] - centre for k in (3, 2, 1)),
        arm[1],
    ]
    turned = np.sum([_angle(u, v) for u, v in pairwise(on_way)], axis=0)
    turn: FloatArray = np.where(is_arc, turned, 0.0)
    sign: FloatArray = np.where(turn < 0, -1.0, 1.0)[:, None]
    heading = [
        np.where(is_arc[:, None], sign * np.stack([-a[:, 1], a[:, 0]], axis=1), direction)
        for a in arm
    ]
    joint = _angle(heading[1], next_of(heading[0]))
    chord = foot[1] - foot[0]
    length: FloatArray = np.where(is_arc, np.abs(turn) * radius, np.hypot(chord[:, 0], chord[:, 1]))
    along: FloatArray = first.astype(np.float64) * step
    curved: FloatArray = is_arc.astype(np.float64)
    return foot[0], foot[1], along, length, sign[:, 0] * radius, centre, turn, joint, curved


def _on(
    p: FloatArray,
    is_arc: BoolArray,
    centre: FloatArray,
    radius: FloatArray,
    along: FloatArray,
) -> FloatArray:
    arm = p - centre
    far = np.maximum(np.linalg.norm(arm, axis=1), 1e-9)
    on_circle = centre + arm * (radius / far)[:, None]
    on_line = centre + along * (arm * along).sum(axis=1)[:, None]
    foot: FloatArray = np.where(is_arc[:, None], on_circle, on_line)
    return foot


def _angle(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the turns (k,) from vectors (k, 2) to others, in (-pi, pi]."""
    angle: FloatArray = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1))
    return angle


def _sharpened(points: FloatArray, corner: IntArray, fit: PrimitiveFit) -> FloatArray:
    """Return the corners where their lines meet; beside an arc, the samples themselves."""
    out = points[corner]
    if len(corner) == 0:
        return out
    after, before = fit.of_run, (fit.of_run - 1) % len(fit.first)
    d, e = fit.direction[before], fit.direction[after]
    cross = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    gap = fit.centre[after] - fit.centre[before]
    clear = ~fit.is_arc[before] & ~fit.is_arc[after] & (np.abs(cross) > MIN_CROSSING)
    run = (gap[:, 0] * e[:, 1] - gap[:, 1] * e[:, 0]) / np.where(clear, cross, 1.0)
    meet = fit.centre[before] + d * run[:, None]
    clear &= np.linalg.norm(meet - out, axis=1) < FARTHEST_CROSSING_MM
    return np.where(clear[:, None], meet, out)


def _string(coded: Sequence[_Coded]) -> BoundaryString:
    columns = [np.concatenate(c) for c in zip(*(loop.fits for loop in coded), strict=True)]
    start, end, along, length, radius, centre, turn, joint, is_arc = columns
    outline, holes = coded[0], coded[1:]
    areas = np.array([_area(loop.points) for loop in coded])
    return BoundaryString(
        loop=np.repeat(np.arange(len(coded)), [len(c.fits[0]) for c in coded]).astype(np.int16),
        is_arc=is_arc.astype(bool),
        start_mm=start,
        end_mm=end,
        along_mm=along,
        length_mm=length,
        radius_mm=radius,
        centre_mm=centre,
        turn_rad=turn,
        joint_rad=joint,
        corner_along_mm=outline.corner.astype(np.float64) * outline.step_mm,
        corner_turn_rad=outline.corner_turn,
        corner_mm=outline.corner_mm,
        hole_mm=np.array([_centroid(loop.points) for loop in holes]).reshape(-1, 2),
        hole_area_mm2=-areas[1:],
        outline_mm=_at_equal_steps(outline.points, OUTLINE_SAMPLES),
        hole_outline_mm=np.array(
            [_at_equal_steps(loop.points, HOLE_SAMPLES) for loop in holes]
        ).reshape(-1, HOLE_SAMPLES, 2),
        perimeter_mm=len(outline.points) * outline.step_mm,
        area_mm2=float(areas.sum()),
        centroid_mm=_centroid(outline.points),
    )


def _directed(points: FloatArray, sign: float) -> FloatArray:
    return points if _area(points) * sign > 0 else points[::-1]


def _area(points: FloatArray) -> float:
    p = points - points[0]
    q = next_of(p)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


def _centroid(points: FloatArray) -> FloatArray:
    p = points - points[0]
    q = next_of(p)
    cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    centroid: FloatArray = points[0] + (cross[:, None] * (p + q)).sum(axis=0) / (3 * cross.sum())
    return centroid


def _resampled(points: FloatArray, spacing_mm: float) -> tuple[FloatArray, float]:
    """Return a loop smoothed over neighbours at equal steps of about the spacing, and the step."""
    rough, _ = _equal_steps(points, spacing_mm)
    before = np.concatenate([rough[-1:], rough[:-1]])
    smooth = 0.5 * rough + 0.25 * (before + next_of(rough))
    length = _length(smooth)
    return smooth, length / len(smooth)


def _equal_steps(points: FloatArray, spacing_mm: float) -> tuple[FloatArray, float]:
    length = _length(points)
    count = max(12, round(length / spacing_mm))
    return _at_equal_steps(points, count), length / count


def next_of(values: NDArray[Number]) -> NDArray[Number]:
    """Return the values (n, ...) of a loop, each replaced by the next."""
    return np.concatenate([values[1:], values[:1]])


def _length(points: FloatArray) -> float:
    side = next_of(points) - points
    return float(np.hypot(side[:, 0], side[:, 1]).sum())


def _at_equal_steps(points: FloatArray, count: int) -> FloatArray:
    closed = np.concatenate([points, points[:1]])
    side = closed[1:] - closed[:-1]
    steps = np.hypot(side[:, 0], side[:, 1])
    along = np.concatenate([[0.0], np.cumsum(steps)])
    at = np.arange(count) * (along[-1] / count)
    return np.stack([np.interp(at, along, closed[:, k]) for k in (0, 1)], axis=1)


def _sampled(loop: Loop, spacing_mm: float) -> FloatArray:
    """Return the points (n, 2) of a loop, with arcs sampled at the pitch of pixels."""
    if not loop.strokes:
        return loop.points
    return np.concatenate([_stroke_points(stroke, spacing_mm) for stroke in loop.strokes])


def _stroke_points(stroke: Stroke, spacing_mm: float) -> FloatArray:
    """Return the points (n, 2) of a stroke without the last, with which the next one begins."""
    if stroke.centre is None or stroke.axes is None:
        return stroke.start[None]
    arm = stroke.axes @ (stroke.start - stroke.centre) / (stroke.axes**2).sum(axis=1)
    longest = float(np.linalg.norm(stroke.axes, axis=1).max())
    count = max(2, int(np.ceil(abs(stroke.sweep_rad) * longest / spacing_mm)))
    angle = np.arctan2(arm[1], arm[0]) + stroke.sweep_rad * np.arange(count) / count
    points: FloatArray = (
        stroke.centre + np.stack([np.cos(angle), np.sin(angle)], axis=1) @ stroke.axes
    )
    return points
