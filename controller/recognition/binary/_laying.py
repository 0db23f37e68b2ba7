"""Fit of model outlines to an object: rigid motions that bring them closest, many at once.

Point to line as Chen and Medioni (1992) have it: each sample of the model asks for the nearest
sample of the object and is pulled along that one's normal. Which is nearest is looked up in a map
made once for the object (`cv2.distanceTransformWithLabels`), so that a candidate costs no search.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import FloatArray, IntArray

from ._strings import BoundaryString
from ._tolerances import BinaryTolerances

CELLS = 160  # cells of the map along the object's longer side
MARGIN = 0.15  # share of that side kept free round the object
FINE = 4  # samples inserted between two of the outline
_T = np.arange(FINE) / FINE
CUBICS = np.stack(  # Hermite cubics of begin, slope there, end, slope there
    [
        (1 + 2 * _T) * (1 - _T) ** 2,
        _T * (1 - _T) ** 2,
        _T**2 * (3 - 2 * _T),
        _T**2 * (_T - 1),
    ]
)
LOOK_SKIP, FIRST_SKIP, LAST_SKIP = 8, 4, 2  # one in so many samples: many candidates, then few
LOOK_FACTOR, LOOK_MM = (
    3.0,
    1.5,
)  # before fitting, what is further off than the best by this is not it
FIRST_STEPS, LAST_STEPS = 3, 2
SAME_TURN_RAD = 0.05  # candidates of a model this close after fitting are one
STIFFNESS = (
    1e-3  # of a motion nothing resists, as the turn of a circle, beside 1 for one along a normal
)


@dataclass(frozen=True, eq=False, slots=True)
class LaidViews:
    """Model views with turn and shift: which (n,), turn (n,), shift (n, 2)."""

    model: IntArray
    turn_rad: FloatArray
    shift_mm: FloatArray

    @classmethod
    def none(cls) -> "LaidViews":
        """Return no candidates."""
        return cls(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 2)))


@dataclass(frozen=True, eq=False, slots=True)
class Alignments:
    """Fitted candidates, and the distances of the outlines, root mean square."""

    model: IntArray
    turn_rad: FloatArray
    shift_mm: FloatArray
    error_mm: FloatArray


class _NearestMap:
    """Nearest sample of an object's outline and holes, with its normal, for any place."""

    def __init__(self, observed: BoundaryString) -> None:
        loops = [observed.outline_mm, *observed.hole_outline_mm]
        points, normals = zip(*(_fine(loop) for loop in loops), strict=True)
        self.points: NDArray[np.complex128] = np.concatenate(points)
        self.normals: NDArray[np.complex128] = np.concatenate(normals)
        low, high = observed.outline_mm.min(axis=0), observed.outline_mm.max(axis=0)
        margin = MARGIN * float((high - low).max()) + 1.0
        self.low = low - margin
        size = high - low + 2 * margin
        self.per_mm = CELLS / float(size.max())
        self.shape = np.ceil(size * self.per_mm).astype(int) + 1
        ground = np.ones((self.shape[1], self.shape[0]), dtype=np.uint8)
        column, row = self._cell(self.points)
        ground[row, column] = 0
        _, label = cv2.distanceTransformWithLabels(
            ground, cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
        )
        sample_of = np.zeros(int(label.max()) + 1, dtype=np.int64)
        sample_of[label[row, column]] = np.arange(len(self.points))
        self.nearest = sample_of[label]

    def _cell(self, points: NDArray[np.complex128]) -> tuple[IntArray, IntArray]:
        column = np.round((points.real - self.low[0]) * self.per_mm).astype(np.int64)
        row = np.round((points.imag - self.low[1]) * self.per_mm).astype(np.int64)
        return np.clip(column, 0, self.shape[0] - 1), np.clip(row, 0, self.shape[1] - 1)

    def look(
        self, points: NDArray[np.complex128]
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Return the nearest samples and their normals."""
        column, row = self._cell(points)
        i = self.nearest[row, column]
        return self.points[i], self.normals[i]


def _fine(loop: FloatArray) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return a loop with points inserted on cubics (Catmull and Rom), and normals.

    Chords would cut an arc of 20 mm by 0.1 mm at the spacing of a hole's samples.
    """
    z = _complex(loop)
    after = np.concatenate([z[1:], z[:1]])
    slope = 0.5 * (after - np.concatenate([z[-1:], z[:-1]]))
    slope_after = np.concatenate([slope[1:], slope[:1]])
    terms = np.stack([z, slope, after, slope_after], axis=1)
    fine: NDArray[np.complex128] = np.asarray(terms @ CUBICS, dtype=np.complex128).ravel()
    side = np.concatenate([fine[1:], fine[:1]]) - np.concatenate([fine[-1:], fine[:-1]])
    normal: NDArray[np.complex128] = -1j * side / np.maximum(np.abs(side), 1e-9)
    return fine, normal


def lay(
    observed: BoundaryString,
    models: Sequence[BoundaryString],
    candidates: LaidViews,
    limits: BinaryTolerances,
) -> Alignments:
    """Return candidates fitted to an object without repeats, the best few of each model.

    Parameters
    ----------
    observed : the object's boundary, table plane [mm]
    models : views of the library
    candidates : at least one, in any order; each turns a model about its origin, then shifts it
    limits : among them the cap on a sample's distance from the outline
    """
    nearest = _NearestMap(observed)
    model = candidates.model
    turn = candidates.turn_rad
    shift = _complex(candidates.shift_mm)
    cap = limits.outline_cap_mm
    # most candidates are far off, which few samples show
    samples, weight = _samples(models, LOOK_SKIP)
    error = _error(nearest, samples[model], turn, shift, 4 * cap, weight[model])
    keep = error <= LOOK_FACTOR * error.min() + LOOK_MM
    model, turn, shift = model[keep], turn[keep], shift[keep]
    samples, weight = _samples(models, FIRST_SKIP)
    for step in range(FIRST_STEPS):
        wide = 2 * cap / (step + 1)
        turn, shift, error = _step(nearest, samples[model], turn, shift, wide, weight[model])
    keep_at = _distinct(model, turn, error, limits)
    model, turn, shift = model[keep_at], turn[keep_at], shift[keep_at]
    samples, weight = _samples(models, LAST_SKIP)
    samples, weight = samples[model], weight[model]
    for _ in range(LAST_STEPS):
        turn, shift, _ = _step(nearest, samples, turn, shift, cap, weight)
    error = _error(nearest, samples, turn, shift, cap, weight)
    turn = np.angle(np.exp(1j * turn))
    return Alignments(model, turn, np.stack([shift.real, shift.imag], axis=1), error)


def _samples(
    models: Sequence[BoundaryString], skip: int
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Return a selection of samples (m, s) of outlines and holes, with weights, 0 for none.

    A sample weighs by the length of boundary it stands for; the weights of a model sum to 1.
    """
    outline = _complex(np.stack([m.outline_mm for m in models]))[:, ::skip]
    count = outline.shape[1]
    per_hole = len(range(0, models[0].hole_outline_mm.shape[1], skip))
    most = max(len(m.hole_outline_mm) for m in models)
    samples = np.zeros((len(models), count + most * per_hole), dtype=np.complex128)
    weight = np.zeros(samples.shape)
    samples[:, :count] = outline
    for row, m in enumerate(models):
        weight[row, :count] = m.perimeter_mm / count
        stop = count + len(m.hole_outline_mm) * per_hole
        if stop > count:
            hole = _complex(m.hole_outline_mm)
            samples[row, count:stop] = hole[:, ::skip].ravel()
            length = np.abs(np.diff(hole, axis=1)).mean(axis=1) * hole.shape[1]
            weight[row, count:stop] = np.repeat(length / per_hole, per_hole)
    return samples, weight / weight.sum(axis=1, keepdims=True)


def _complex(points: FloatArray) -> NDArray[np.complex128]:
    z: NDArray[np.complex128] = points[..., 0] + 1j * points[..., 1]
    return z


def _distances(
    nearest: _NearestMap,
    samples: NDArray[np.complex128],
    turn: FloatArray,
    shift: NDArray[np.complex128],
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], FloatArray]:
    """Return the moved samples, the outline's normals there, and the distances from the outline."""
    moved = np.exp(1j * turn)[:, None] * samples + shift[:, None]
    foot, normal = nearest.look(moved)
    gap = moved - foot
    off = gap.real * normal.real + gap.imag * normal.imag
    # past a corner the line runs on where the outline does not: then the point itself counts
    far = np.abs(gap)
    beside = far > 2.0 + 2.0 * np.abs(off)
    return moved, normal, np.where(beside, far, off)


def _step(
    nearest: _NearestMap,
    samples: NDArray[np.complex128],
    turn: FloatArray,
    shift: NDArray[np.complex128],
    cap: float,
    weight: FloatArray,
) -> tuple[FloatArray, NDArray[np.complex128], FloatArray]:
    """Return turns and shifts one Gauss-Newton step on, and the errors before it."""
    moved, normal, off = _distances(nearest, samples, turn, shift)
    inside = weight * (np.abs(off) < cap)
    middle = (weight * samples).sum(axis=1)
    centre = shift + np.exp(1j * turn) * middle
    arm = moved - centre[:, None]
    # turning by a small angle moves a sample by i angle arm
    lever = arm.real * normal.imag - arm.imag * normal.real
    j = np.stack([lever, normal.real, normal.imag], axis=-1)
    wj = j * inside[..., None]
    a = wj.transpose(0, 2, 1) @ j
    b = wj.transpose(0, 2, 1) @ off[..., None]
    a[:, [0, 1, 2], [0, 1, 2]] += STIFFNESS
    delta = -np.linalg.solve(a, b)[..., 0]
    new_turn = turn + np.clip(delta[:, 0], -0.3, 0.3)
    # about the middle of the samples, which itself is shifted
    new_shift = centre + delta[:, 1] + 1j * delta[:, 2] - np.exp(1j * new_turn) * middle
    error = np.sqrt((weight * np.minimum(off**2, cap**2)).sum(axis=1))
    return new_turn, new_shift, error


def _error(
    nearest: _NearestMap,
    samples: NDArray[np.complex128],
    turn: FloatArray,
    shift: NDArray[np.complex128],
    cap: float,
    weight: FloatArray,
) -> FloatArray:
    _, _, off = _distances(nearest, samples, turn, shift)
    error: FloatArray = np.sqrt((weight * np.minimum(off**2, cap**2)).sum(axis=1))
    return error


def _distinct(
    model: IntArray, turn: FloatArray, error: FloatArray, limits: BinaryTolerances
) -> IntArray:
    """Return each model's best few candidates, one of equal turns, without the hopeless."""
    worst = limits.keep_factor * float(error.min()) + limits.keep_mm
    kept: list[int] = []
    taken: dict[int, list[float]] = {}
    models, turns = model.tolist(), turn.tolist()
    for i in np.argsort(error).tolist():
        if error[i] > worst:
            break
        mine = taken.setdefault(models[i], [])
        if len(mine) >= limits.keep_per_model:
            continue
        apart = [abs((turns[i] - other + np.pi) % (2 * np.pi) - np.pi) for other in mine]
        if min(apart, default=np.inf) < SAME_TURN_RAD:
            continue
        mine.append(turns[i])
        kept.append(i)
    return np.array(kept, dtype=np.int64)
