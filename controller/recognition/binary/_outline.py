"""Corners of a loop seen to a fraction of a pixel: where its turn stands out, its lines meet.

The paper's corners (references.md P3.1) on dense loops in the table plane [mm], with the lines
beside them: where parts may touch, a cluster's outline turns inwards.
"""

from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, IntArray

from ._corners import find_corners, triangular
from ._primitives import PrimitiveFit, RunningSums, fit_runs, is_circle
from ._tolerances import BinaryTolerances

Number = TypeVar("Number", np.float64, np.complex128)

MIN_AREA_MM2 = 1e-6  # area that rounding leaves of a line traced there and back
MIN_CROSSING = 0.3  # sine of the least angle of two lines that meet in a corner
FARTHEST_CROSSING_MM = 1.5  # distance from the filter's peak; farther off it is another corner's
DEFAULT: Final = BinaryTolerances()


class NoOutlineError(ValueError):
    """A loop of too few points, or one that encloses nothing."""


@dataclass(frozen=True, eq=False, slots=True)
class OutlineCorners:
    """Corners of a loop in the order in which it runs, anticlockwise.

    Attributes
    ----------
    at_mm : (c, 2) in the table plane
    turn_rad : (c,) positive where what the loop encloses juts out
    """

    at_mm: FloatArray
    turn_rad: FloatArray


def outline_corners(loop_mm: FloatArray, limits: BinaryTolerances = DEFAULT) -> OutlineCorners:
    """Return the corners of a dense loop.

    Parameters
    ----------
    loop_mm : (n, 2) closed, the first point not repeated, in the table plane
    limits : spacing and sizes of corners follow the pixel's

    Raises
    ------
    NoOutlineError : fewer than three points, or they enclose nothing
    """
    if len(loop_mm) < 3:
        raise NoOutlineError(f"a loop of {len(loop_mm)} points, at least 3 are needed")
    area_mm2 = _area(loop_mm)
    if abs(area_mm2) < MIN_AREA_MM2:
        raise NoOutlineError("the loop encloses nothing")
    anticlockwise = loop_mm if area_mm2 > 0 else loop_mm[::-1]
    points, step = _resampled(anticlockwise, limits.spacing_mm)
    closed = np.concatenate([points, points[:1]])
    corner, turn = _corners(points, step, limits)
    if len(corner) == 0 or is_circle(RunningSums(closed), len(closed), limits):
        return OutlineCorners(np.zeros((0, 2)), np.zeros(0))
    begin = int(corner[0])
    points = np.concatenate([points[begin:], points[:begin]])
    closed = np.concatenate([points, points[:1]])
    corner = corner - begin
    runs = _runs_between(corner, len(points), max(1, round(limits.trim_mm / step)))
    fit = fit_runs(RunningSums(closed), closed, runs, limits)
    return OutlineCorners(_sharpened(points, corner, fit), turn)


def _corners(
    points: FloatArray, step: float, limits: BinaryTolerances
) -> tuple[IntArray, FloatArray]:
    """Return the corner samples of a loop at equal steps, and their turns.

    The triangular filter of the turn per sample is the turn between the chord behind and the chord
    ahead. On an arc it grows with the chord, at a corner it does not.
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
    return corner, (found.size * found.sign)[sharp]


def _runs_between(corner: IntArray, count: int, trim: int) -> IntArray:
    """Return first and last samples (c, 2) of the runs between corners, the corners trimmed."""
    ends = np.append(corner[1:], count)
    cut = np.clip((ends - corner - 4) // 2, 0, trim)
    return np.stack([corner + cut, ends - cut], axis=1)


def _sharpened(points: FloatArray, corner: IntArray, fit: PrimitiveFit) -> FloatArray:
    """Return the corners where their lines meet; beside an arc, the samples themselves."""
    out = points[corner]
    after, before = fit.of_run, (fit.of_run - 1) % len(fit.is_arc)
    d, e = fit.direction[before], fit.direction[after]
    cross = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    gap = fit.middle[after] - fit.middle[before]
    clear = ~fit.is_arc[before] & ~fit.is_arc[after] & (np.abs(cross) > MIN_CROSSING)
    run = (gap[:, 0] * e[:, 1] - gap[:, 1] * e[:, 0]) / np.where(clear, cross, 1.0)
    meet = fit.middle[before] + d * run[:, None]
    clear &= np.linalg.norm(meet - out, axis=1) < FARTHEST_CROSSING_MM
    return np.where(clear[:, None], meet, out)


def _area(points: FloatArray) -> float:
    p = points - points[0]
    q = next_of(p)
    return 0.5 * float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())


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
