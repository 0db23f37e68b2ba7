"""Registration: whether a picture shows the part at its pose, and sharply.

Grey-level profiles are taken across the predicted outline. Of the steps in a profile the
outermost that counts is measured, its place and its width; one shift in the picture, robustly, is
fitted to all places.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey
from controller.imaging import sample_picture, slopes_of

REACH_PX: Final = 9.0  # reach to either side: a picture may lie some pixels off
STEP_PX: Final = 0.5
NEAR_PX: Final = 2.0  # distance from a step's middle of pixels that belong to it
WIDE_PX: Final = 4.5  # reach of a blurred step
MIN_STEP_GREY: Final = 12.0
OUTERMOST: Final = 0.35  # share of the steepest step from which another one in a profile counts
FLOOR: Final = 0.2  # share of a step's steepest part below which all is noise
MAX_PROFILES: Final = 1200
MIN_PROFILES: Final = 40
STACK_ROUNDS: Final = 6
RIM_PRIOR: Final = 1.0  # weight of "no rim", for each profile
# Weight of "no shift", in profiles. Neighbouring profiles err together: where hardly more than
# these few show a direction, another edge beside the outline would pass for a shift along it.
SHIFT_PRIOR: Final = 20.0


@dataclass(frozen=True, eq=False, slots=True)
class Registration:
    """Shift and blur of a picture against the predicted outline.

    Attributes
    ----------
    shift_px : (2,) of the picture against the prediction, x before y
    width_px : median standard deviation of the steps' blur
    growth_px : how much more it is than
        in the picture expected, 0 without one
    """

    shift_px: FloatArray
    width_px: float
    growth_px: float


def register(
    picture: Grey, edge_px: FloatArray, normals: FloatArray, expected: Float32Array | None = None
) -> Registration | None:
    """Return the shift and blur of a picture on an outline (n, 2); None if nothing shows it.

    Parameters
    ----------
    picture : (height, width) grey
    edge_px : (n, 2) points of the outline, x before y
    normals : (n, 2) unit, square to it
    expected : the same picture as predicted; where the strongest step is another one than the
        outline, as beside a dark wall, it is so there too. Without it steps lie on the outline
    """
    if len(edge_px) > MAX_PROFILES:
        chosen = np.linspace(0, len(edge_px) - 1, MAX_PROFILES).astype(np.intp)
        edge_px, normals = edge_px[chosen], normals[chosen]
    if len(edge_px) < MIN_PROFILES:
        return None
    is_clear, place, width = _steps(picture, edge_px, normals)
    growth = np.zeros_like(width)
    if expected is not None:
        is_expected, expected_place, expected_width = _steps(expected, edge_px, normals)
        is_clear &= is_expected
        place, growth = place - expected_place, width - expected_width
    if is_clear.sum() < MIN_PROFILES:
        return None
    place, normals = place[is_clear], normals[is_clear]
    # a lit rim or a dark one moves all steps outwards alike: that is no shift, but it is small, and
    # where the outline is seen on few sides the two are hard to tell apart
    design = np.column_stack([normals, np.ones(len(place))])
    solution = np.array([0.0, 0.0, np.median(place)])
    prior = np.diag([SHIFT_PRIOR, SHIFT_PRIOR, RIM_PRIOR * len(place)])
    for _ in range(STACK_ROUNDS):
        off = place - design @ solution
        scale = max(0.3, 1.5 * float(np.median(np.abs(off))))
        trust = 1.0 / np.maximum(1.0, np.abs(off) / scale)
        normal = (design * trust[:, None]).T @ design + prior
        solution = np.linalg.solve(normal, (design * trust[:, None]).T @ place)
    return Registration(
        shift_px=solution[:2],
        width_px=float(np.median(width[is_clear])),
        growth_px=float(np.median(growth[is_clear])),
    )


def _steps(
    picture: Grey | Float32Array,
    edge_px: FloatArray,
    normals: FloatArray,
) -> tuple[BoolArray, FloatArray, FloatArray]:
    """Return a mask of profiles with one step, its place on the normal and its width; (n,) each."""
    offsets = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    where = edge_px[:, None, :] + offsets[None, :, None] * normals[:, None, :]
    profile = sample_picture(picture, where[..., 0], where[..., 1]).astype(np.float64)
    rise = np.diff(profile, axis=1)
    slope = np.abs(rise)
    middles = offsets[:-1] + STEP_PX / 2
    smooth = cv2.GaussianBlur(slope, (5, 1), 1.0)
    before = np.pad(smooth, ((0, 0), (1, 0)))[:, :-1]
    after = np.pad(smooth, ((0, 0), (0, 1)))[:, 1:]
    is_peak = (smooth >= before) & (smooth >= after)
    is_peak &= smooth >= OUTERMOST * smooth.max(axis=1, keepdims=True)
    # a chamfer makes two steps: the outer one is the outline's
    peak = middles[len(middles) - 1 - np.argmax(is_peak[:, ::-1], axis=1)]
    near = np.abs(middles[None, :] - peak[:, None]) <= NEAR_PX
    change = np.where(near, slope, 0.0).sum(axis=1)
    signed = np.abs(np.where(near, rise, 0.0).sum(axis=1))
    is_clear = (signed > MIN_STEP_GREY) & (signed > 0.7 * change)
    is_clear &= np.abs(peak) < REACH_PX - NEAR_PX / 2
    weight = np.where(near, slope, 0.0)
    weight = np.maximum(weight - FLOOR * weight.max(axis=1, keepdims=True), 0.0)
    total = np.maximum(weight.sum(axis=1), 1e-9)
    place = (weight * middles).sum(axis=1) / total
    wide = np.where(np.abs(middles[None, :] - peak[:, None]) <= WIDE_PX, slope, 0.0)
    wide = np.maximum(wide - FLOOR * wide.max(axis=1, keepdims=True), 0.0)
    total = np.maximum(wide.sum(axis=1), 1e-9)
    middle = (wide * middles).sum(axis=1) / total
    width = np.sqrt((wide * (middles - middle[:, None]) ** 2).sum(axis=1) / total)
    return is_clear, place, width


SEARCHED_PX: Final = 7.0  # reach of the search to either side
SHIFT_STEP_PX: Final = 0.5
CAPPED: Final = 10.0  # cap in noises of slopes: a few strong edges do not outvote the others
STEP_NOISES: Final = 3.0  # least height of a step, in standard deviations of its surroundings
MIN_SHOWN_GREY: Final = 1.5  # least height of a step, in grey levels of eight bits
MIN_CLEAR: Final = 20
TOGETHER: Final = 5.0  # neighbouring points of an edge that show the same
SURE: Final = 6.0  # in standard deviations of a shift's mean slope
ASIDE_PX: Final = 2.5
FALL_SHARE: Final = 0.08  # share of the peak that must be lost at a distance in any direction


@dataclass(frozen=True, eq=False, slots=True)
class _Scores:
    """How well shifts put slopes of a picture on predicted edges.

    Attributes
    ----------
    shifts_px : (k,) of both axes
    slopes : (n, k * k) at each edge point, by shift: in noises, capped
    mean : (k, k) of the points, row for y, column for x
    """

    shifts_px: FloatArray
    slopes: Float32Array
    mean: FloatArray

    @property
    def chance(self) -> tuple[float, float]:
        """Level and standard deviation of the mean by chance, from the farthest shifts."""
        x, y = (np.abs(s) for s in np.meshgrid(self.shifts_px, self.shifts_px))
        far = np.maximum(x, y) > SEARCHED_PX - SHIFT_STEP_PX
        spread = float(self.slopes[:, far.ravel()].std()) / np.sqrt(len(self.slopes) / TOGETHER)
        return float(np.median(self.mean[far])), spread

    def loss(self, best: tuple[int, int], other: tuple[int, int]) -> tuple[float, float]:
        """Return what is lost of the mean from one shift (row, column) to another, and its error.

        Parameters
        ----------
        best, other : row and column of each
        """
        here, there = (row * len(self.shifts_px) + column for row, column in (best, other))
        lost = self.slopes[:, here] - self.slopes[:, there]
        return float(lost.mean()), float(lost.std()) / np.sqrt(len(self.slopes) / TOGETHER)


def register_edges(picture: Grey, edge_px: FloatArray, normals: FloatArray) -> Registration | None:
    """Return the shift and blur of a picture on predicted edges (n, 2); None if nothing shows it.

    For pictures whose outline hardly shows: each shift is weighed by the slopes that it puts on
    the edges, outline and inner edges alike. The width is of those that show clearly.

    Parameters
    ----------
    picture : (height, width) grey
    edge_px : (n, 2) points of edges, x before y
    normals : (n, 2) unit, square to them
    """
    if len(edge_px) < MIN_PROFILES:
        return None
    scores = _scored(picture, edge_px, normals)
    shifts, score = scores.shifts_px, scores.mean
    row, column = np.unravel_index(int(score.argmax()), score.shape)
    best = (int(row), int(column))
    level, chance = scores.chance
    height = float(score[best]) - level
    aside = round(ASIDE_PX / SHIFT_STEP_PX)
    if not (
        height > SURE * chance
        and aside <= row < len(shifts) - aside
        and aside <= column < len(shifts) - aside
    ):
        return None
    ring = [(a, b) for a in (-aside, 0, aside) for b in (-aside, 0, aside) if a or b]
    beside = [(best[0] + a, best[1] + b) for a, b in ring]
    lost, doubt = scores.loss(best, max(beside, key=lambda at: float(score[at])))
    if lost < max(FALL_SHARE * height, SURE / 2 * doubt):
        return None  # along some direction another shift would do as well
    near = score[row - aside : row + aside + 1, column - aside : column + aside + 1] - level
    weight = np.maximum(near - 0.3 * height, 0.0)
    steps = shifts[: 2 * aside + 1] - shifts[aside]
    total = weight.sum()
    mean = np.array([(weight.sum(axis=0) @ steps), (weight.sum(axis=1) @ steps)]) / total
    shift = np.array([shifts[column], shifts[row]]) + mean
    width = _stacked_width(picture, edge_px + shift, normals)
    return None if width is None else Registration(shift, width, 0.0)


def confirm_edges(
    picture: Grey, edge_px: FloatArray, normals: FloatArray, within_px: float
) -> Registration | None:
    """Return the shift and blur of a picture that agrees with a pose; None if it may not.

    For pictures that show too little for a pose of their own, as edges of one direction: some of
    the edges must show where a pose puts them, within what this may be off, and no shift beyond
    that may show more of them. What the picture leaves open is left to the pose.

    Parameters
    ----------
    picture : (height, width) grey
    edge_px : (n, 2) points of edges, x before y
    normals : (n, 2) unit, square to them
    within_px : what the pose may be off in the picture
    """
    if len(edge_px) < MIN_PROFILES:
        return None
    scores = _scored(picture, edge_px, normals)
    shifts, score = scores.shifts_px, scores.mean
    x, y = np.meshgrid(shifts, shifts)
    is_near = np.hypot(x, y) <= within_px
    row, column = np.unravel_index(int(np.where(is_near, score, -np.inf).argmax()), score.shape)
    best = (int(row), int(column))
    level, chance = scores.chance
    if float(score[best]) - level < SURE * chance or float(score[best]) < float(score.max()):
        return None
    shift = np.array([shifts[column], shifts[row]])
    width = _stacked_width(picture, edge_px + shift, normals)
    return None if width is None else Registration(shift, width, 0.0)


def _scored(picture: Grey, edge_px: FloatArray, normals: FloatArray) -> _Scores:
    """Return how well shifts put a picture's slopes on predicted edges (n, 2)."""
    x0, y0 = (np.floor(edge_px.min(axis=0) - SEARCHED_PX - 4)).astype(int)
    x1, y1 = (np.ceil(edge_px.max(axis=0) + SEARCHED_PX + 5)).astype(int)
    x0, y0 = max(x0, 0), max(y0, 0)
    dx, dy = slopes_of(picture[y0:y1, x0:x1])
    shifts = np.arange(-SEARCHED_PX, SEARCHED_PX + SHIFT_STEP_PX / 2, SHIFT_STEP_PX)
    sx, sy = (s.ravel() for s in np.meshgrid(shifts, shifts))
    u, v = edge_px[:, :1] - x0 + sx, edge_px[:, 1:] - y0 + sy
    slope = np.abs(
        sample_picture(dx, u, v) * normals[:, :1].astype(np.float32)
        + sample_picture(dy, u, v) * normals[:, 1:].astype(np.float32)
    )
    noise = max(float(np.median(slope)) / 0.6745, 0.05)
    capped = np.minimum(slope / noise, CAPPED)
    return _Scores(shifts, capped, capped.mean(axis=0).reshape(len(shifts), len(shifts)))


def _stacked_width(picture: Grey, edge_px: FloatArray, normals: FloatArray) -> float | None:
    """Return the width of the averaged edge profile; None where no edge shows.

    Faint steps are wider by noise alone; their mean, each turned to rise, is not.
    """
    offsets = np.arange(-REACH_PX, REACH_PX + STEP_PX / 2, STEP_PX)
    where = edge_px[:, None, :] + offsets[None, :, None] * normals[:, None, :]
    profile = sample_picture(picture, where[..., 0], where[..., 1]).astype(np.float64)
    beyond = (offsets > NEAR_PX / 2) & (offsets < WIDE_PX)
    before = (offsets < -NEAR_PX / 2) & (offsets > -WIDE_PX)
    rise = profile[:, beyond].mean(axis=1) - profile[:, before].mean(axis=1)
    rough = np.sqrt(profile[:, beyond].var(axis=1) + profile[:, before].var(axis=1))
    # beside a step there is nothing else, or the stack would be as wide as what there is
    clear = np.abs(rise) > STEP_NOISES * np.maximum(rough, MIN_SHOWN_GREY / STEP_NOISES)
    if clear.sum() < MIN_CLEAR:
        return None
    limit = 2.0 * float(np.median(np.abs(rise[clear])))
    turned = profile[clear] * np.sign(rise[clear])[:, None]
    turned *= np.minimum(1.0, limit / np.abs(rise[clear]))[:, None]
    slope = np.maximum(np.diff(turned.mean(axis=0)), 0.0)
    middles = offsets[:-1] + STEP_PX / 2
    near = np.where(np.abs(middles) <= WIDE_PX, slope, 0.0)
    weight = np.maximum(near - FLOOR * near.max(), 0.0)
    if weight.sum() <= 0:
        return None
    middle = float(weight @ middles) / weight.sum()
    return float(np.sqrt(weight @ (middles - middle) ** 2 / weight.sum()))


def picture_noise(window: Grey | Float32Array) -> float:
    """Return the standard deviation of a picture's noise [grey], by its finest detail."""
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6.0
    rest = cv2.filter2D(window.astype(np.float32), cv2.CV_32F, kernel)
    return 1.4826 * float(np.median(np.abs(rest[::2, ::2])))
