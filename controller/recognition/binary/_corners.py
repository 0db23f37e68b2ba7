"""Corners of a dense loop in the table plane: where its turn stands out.

The paper (references.md P3.1) filters the turns of the chain code by a triangle, two box-cars one
after the other, and takes the peaks above a threshold. Here the turn is that of a loop seen to a
fraction of a pixel: where parts may touch, a cluster's outline turns inwards.
"""

from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from controller.arrays import FloatArray, IntArray

MIN_AREA_MM2: Final = 1e-6  # area that rounding leaves of a line traced there and back
MIN_SAMPLES: Final = 12  # samples of the smallest loop
CHORD_PX: Final = 4.0  # shorter chords turn by the stairs of pixels

Number = TypeVar("Number", np.float64, np.complex128)


class NoOutlineError(ValueError):
    """A loop of too few points, or one that encloses nothing."""


@dataclass(frozen=True, slots=True)
class CornerTolerances:
    """Tolerances of corners, for pixels of about a quarter mm.

    Attributes
    ----------
    spacing_mm : spacing of samples; a pixel, since anything finer is invisible
    chord_mm : length of the chords whose turn is a corner: 0.03 mm of noise over 2 mm turn a chord
        by 1 degree, and corners 2 mm apart are still two
    turn_rad : a smaller turn is no corner: ten times that noise, less than the 30 degrees of a
        usual lead-in chamfer
    sharpness : share of its turn a corner keeps at half the chord's length; a sharp one keeps all,
        an arc half
    """

    spacing_mm: float = 0.25
    chord_mm: float = 2.0
    turn_rad: float = 0.35
    sharpness: float = 0.75

    @classmethod
    def for_pixels(cls, mm_per_px: float) -> "CornerTolerances":
        """Return the tolerances for pixels of another size, the longer side of one where oblong.

        They grow with the pixel. Pixels finer than a quarter mm change nothing, since the lens is
        then the limit.
        """
        usual = cls()
        return cls(
            spacing_mm=max(usual.spacing_mm, mm_per_px),
            chord_mm=max(usual.chord_mm, CHORD_PX * mm_per_px),
        )


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


def outline_corners(loop_mm: FloatArray, limits: CornerTolerances | None = None) -> OutlineCorners:
    """Return the corners of a dense loop.

    Parameters
    ----------
    loop_mm : (n, 2) closed, the first point not repeated, in the table plane
    limits : spacing and sizes of corners; None for pixels of a quarter mm

    Raises
    ------
    NoOutlineError : fewer than three points, or they enclose nothing
    """
    limits = limits or CornerTolerances()
    if len(loop_mm) < 3:
        raise NoOutlineError(f"a loop of {len(loop_mm)} points, at least 3 are needed")
    x, y = (loop_mm - loop_mm[0]).T
    area_mm2 = 0.5 * float((x * next_of(y) - next_of(x) * y).sum())
    if abs(area_mm2) < MIN_AREA_MM2:
        raise NoOutlineError("the loop encloses nothing")
    loop = (loop_mm if area_mm2 > 0 else loop_mm[::-1]) @ np.array([1.0, 1.0j])
    rough = _at_equal_steps(loop, limits.spacing_mm)
    smooth = 0.5 * rough + 0.25 * (np.roll(rough, 1) + next_of(rough))
    side = next_of(smooth) - smooth
    step_mm = float(np.abs(side).mean())
    turn = np.angle(side * np.roll(side, 1).conj())
    # filtered, it is the turn between the chord behind and the chord ahead: on an arc it grows
    # with the chord, at a corner it does not
    chord = max(2, round(limits.chord_mm / step_mm))
    half = max(1, chord // 2)
    wide, narrow = triangular(turn, chord) / chord, np.abs(triangular(turn, half) / half)
    at = find_peaks(wide, limits.turn_rad, chord)
    beside = narrow[(at[:, None] + np.array([-1, 0, 1])) % len(narrow)].max(axis=1)
    at = at[beside >= limits.sharpness * np.abs(wide[at])]
    return OutlineCorners(np.column_stack([smooth[at].real, smooth[at].imag]), wide[at])


def triangular(turns: FloatArray, length: int) -> FloatArray:
    """Return turns (n,) round a loop filtered by a triangle.

    Its height is ``length``, its base 2 ``length`` - 1. The sum of the answer is that of the turns
    times the square of the length.

    Raises
    ------
    ValueError : a box-car shorter than one sample
    """
    if length < 1:
        raise ValueError(f"a box-car of {length} samples, at least 1 is needed")
    if len(turns) == 0:
        return turns
    around = np.take(turns, np.arange(1 - length, len(turns) + length - 1), mode="wrap")
    return _box_car(_box_car(around.astype(np.float64), length), length)


def _box_car(values: FloatArray, length: int) -> FloatArray:
    """Return running sums of ``length`` neighbours: (n - length + 1,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return np.asarray(total[length:] - total[:-length])


def find_peaks(filtered: FloatArray, threshold: float, reach: int) -> IntArray:
    """Return the samples at which filtered turns round a loop peak, in order, of either sign.

    Parameters
    ----------
    filtered : (n,) of a closed boundary, from `triangular`
    threshold : least size of a peak
    reach : samples on either side within which a peak is the highest; the filter's length, since
        nearer corners are one hill. Of peaks of equal height within it the middle one counts.
    """
    found: list[int] = []
    size = min(2 * reach + 1, max(len(filtered), 1))
    for height in (filtered, -filtered):
        highest = ndimage.maximum_filter1d(height, size, mode="wrap")
        at = np.flatnonzero((height == highest) & (height >= threshold))
        if len(at) == 0:
            continue
        gaps = np.diff(at, append=at[0] + len(filtered))
        ends = np.flatnonzero(gaps > reach)  # none: all round, no corner stands out
        begins = at[(np.roll(ends, 1) + 1) % len(at)]
        width = (at[ends] - begins) % len(filtered)
        found += ((begins + width // 2) % len(filtered)).tolist()
    return np.array(sorted(found), dtype=np.int64)


def next_of(values: NDArray[Number]) -> NDArray[Number]:
    """Return the values (n, ...) of a loop, each replaced by the next."""
    return np.concatenate([values[1:], values[:1]])


def _at_equal_steps(loop: NDArray[np.complex128], step: float) -> NDArray[np.complex128]:
    """Return points at equal steps of about a length along a loop."""
    closed = np.append(loop, loop[0])
    along = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(closed)))])
    count = max(MIN_SAMPLES, round(float(along[-1]) / step))
    return np.asarray(np.interp(np.arange(count) * (along[-1] / count), along, closed))
