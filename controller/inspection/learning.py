"""Learning what good parts look like, from the pictures of some that were accepted.

Parts are brought to one grid by their measured poses, view by view. What is kept is the median of
picture over prediction, and how far each part is from the median of the others: so the scatter has
in it all that differs from one good part to the next, the errors of the poses too. A part that
shows a defect against the others is named, and left out.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray

from ._gathered import PlacedFinding, gather
from ._judge import confirm
from ._part_types import ViewSet
from ._types import OUTLINE, Verdict, ViewResult
from .grasp_pose import OutlinedView, PoseSettings
from .kept import Kept
from .lit import (
    COARSE,
    FILTER_COUNT,
    STEP_PX,
    Appearance,
    LearnedPicture,
    LearnedView,
    LitPictures,
    contrast,
    filtered,
    finish_of,
    on_grid,
    pose_gap,
    regridded,
    unusual,
)
from .stages import PosedViews, pose_views
from .view import ComparedView, NotEvaluated, Strictness, compare_view

MIN_PARTS: Final = 5  # with fewer, one defective part is not told from the others
# Poses in which parts show the same view: farther apart, the prediction carries too much.
ALIKE_MM: Final = 3.0
ALIKE_RAD: Final = float(np.radians(3.0))
# Window of nodes whose largest answer counts: of 1.3 mm at 0.19 mm a pixel, by which a shadow's
# border moves when a part slips by half a millimetre. With 3 nodes 7 of 12 good parts showed a
# mark at the tip of a shadow, with 7 nodes none, and 0.3 % less was compared (ADR 118).
NEAR_NODES: Final = 7
MIN_SCATTER: Final = 1e-3  # of an answer: below the noise of any camera


class TooFewPartsError(Exception):
    """Fewer good parts than learning needs."""


@dataclass(frozen=True, eq=False, slots=True)
class GoodPart:
    """An accepted part.

    Attributes
    ----------
    name : for people
    views : its pictures
    """

    name: str
    views: ViewSet


@dataclass(frozen=True, eq=False, slots=True)
class Tried:
    """One part judged by what the others look like.

    Attributes
    ----------
    name : of the part
    compared, in_sight : share of the surface that lit pictures compared, and had in sight
    odd : places where it differs from the others; empty for a good part
    """

    name: str
    compared: float
    in_sight: float
    odd: tuple[PlacedFinding, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Lesson:
    """What was learned.

    Attributes
    ----------
    appearance : of the good parts
    tried : each of them, judged by the others
    left_out : parts that differ from the others
    unlearned : views that too few parts show, in words
    """

    appearance: Appearance
    tried: tuple[Tried, ...]
    left_out: tuple[Tried, ...]
    unlearned: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class _Shown:
    """A part in one view."""

    part: int
    view: OutlinedView
    T_world_part_measured: FloatArray


def learn(
    parts: Sequence[GoodPart],
    settings: PoseSettings | None = None,
    told: Callable[[str], None] = lambda words: None,
) -> Lesson:
    """Return what good parts look like.

    Parameters
    ----------
    parts : of one CAD model, with their pictures
    settings : what is known of arm, parts and light before the pictures
    told : hears what is done

    Raises
    ------
    TooFewPartsError : fewer than five parts, or than five that are alike, are left
    """
    settings = settings or PoseSettings()
    left: list[GoodPart] = list(parts)
    posed: dict[str, PosedViews] = {}
    left_out: list[Tried] = []
    while True:
        if len(left) < MIN_PARTS:
            named = "".join(f"; {one.name} differs from the others" for one in left_out)
            raise TooFewPartsError(
                f"{len(left)} good parts, {MIN_PARTS} are needed to tell what is usual{named}"
            )
        posed = posed or {one.name: pose_views(one.views, settings, Kept()) for one in left}
        lesson = _Lesson(left, [posed[part.name] for part in left], told).lesson()
        odd = [one for one in lesson.tried if one.odd]
        if not odd:
            return replace(lesson, left_out=tuple(left_out))
        # the oddest alone: what it does to the others' median goes with it
        worst = max(odd, key=lambda one: max(f.area_mm2 for f in one.odd))
        told(f"{worst.name} differs from the others and is left out")
        left_out.append(worst)
        left = [part for part in left if part.name != worst.name]


def require_usable(view: LearnedView) -> None:
    """Require that a learned view from outside is what `learn` makes, so that pictures fit it.

    Parameters
    ----------
    view : of a file

    Raises
    ------
    ValueError : its grid is another or not in the picture, or its arrays do not belong together
    """
    shape = view.depth_mm.shape
    if view.step_px != STEP_PX:
        raise ValueError(f"its nodes are {view.step_px} px apart, here they are {STEP_PX} px apart")
    if len(shape) != 2 or not (np.isfinite(view.depth_mm).all() and (view.depth_mm >= 0).all()):
        raise ValueError("its depths are no map of distances")
    ends = np.add(view.corner_px, STEP_PX * (np.array(shape[::-1]) - 1))
    if min(view.corner_px) < 0 or (ends >= view.camera.size_px).any():
        raise ValueError("its grid is not in the picture")
    coarse = (FILTER_COUNT, *(-(-length // COARSE) for length in shape))
    for lamp, picture in view.pictures.items():
        if picture.mean.shape != shape or picture.scatter.shape != coarse:
            raise ValueError(f"the arrays of {lamp} have other sizes than its grid")
        is_told = np.isfinite(picture.scatter).all() and (picture.scatter > 0).all()
        if np.isinf(picture.mean).any() or not is_told:
            raise ValueError(f"the arrays of {lamp} have values that cannot be")


class _Lesson:
    """One round: learn from parts, and judge each by the others."""

    def __init__(
        self,
        parts: Sequence[GoodPart],
        posed: Sequence[PosedViews],
        told: Callable[[str], None],
    ) -> None:
        self._parts, self._posed, self._told = parts, posed, told
        self._samples = parts[0].views.samples
        self._solid = parts[0].views.part.solid
        self._middle = np.asarray(self._solid.centroid_mm, np.float64)
        self._results: list[list[ViewResult]] = [[] for _ in parts]

    def lesson(self) -> Lesson:
        """Return what was learned, with each part judged by the others."""
        views, unlearned = [], []
        for group in _alike(self._shown(), self._middle):
            names = sorted({one.view.task.view_id for one in group})
            if len({one.part for one in group}) < MIN_PARTS:
                unlearned.append(f"{', '.join(names)}: shown alike by {len(group)} parts")
                continue
            self._told(f"view {names[0]}, {len(group)} parts")
            if (view := self._view(group)) is not None:
                views.append(view)
        return Lesson(
            Appearance(tuple(views), self._middle),
            tuple(self._tried(i) for i in range(len(self._parts))),
            (),
            tuple(unlearned),
        )

    def _shown(self) -> Iterator[_Shown]:
        for number, posed in enumerate(self._posed):
            for view in posed.outlined:
                pose = posed.pose(view.view.task.view_id)
                if isinstance(view, OutlinedView) and pose is not None and view.task.lamps:
                    yield _Shown(number, view, pose.T_world_part_measured)

    def _view(self, group: Sequence[_Shown]) -> LearnedView | None:
        """Return a learned view, None where too few pictures of it can be used."""
        some = [
            (one, held) for one in group if not isinstance(held := self._held(one), NotEvaluated)
        ]
        if len(some) < MIN_PARTS:
            return None
        shown, helds = [one for one, _ in some], [held for _, held in some]
        away = _apart(shown, self._middle)
        mid = int(np.argmin(away.sum(axis=1).sum(axis=1)))
        base = replace(
            _grid(helds[mid]),
            reach_mm=float(away[mid, :, 0].max()),
            reach_rad=float(away[mid, :, 1].max()),
            parts=len(some),
        )
        onto = [_Onto.of(base, helds[mid], held) for held in helds]
        pictures: dict[str, LearnedPicture] = {}
        without: list[dict[str, LearnedPicture]] = [{} for _ in some]
        for lamp in [lamp.name for lamp in helds[mid].task.lamps]:
            good = [i for i, held in enumerate(helds) if held.lit.refusal(lamp) == ""]
            if len(good) < MIN_PARTS:
                continue
            found = _learned([onto[i] for i in good], lamp)
            pictures[lamp] = found.picture
            for i, mean in zip(good, found.others, strict=True):
                without[i][lamp] = replace(found.picture, mean=mean)
        for (one, held), known in zip(some, without, strict=True):
            others = replace(base, pictures=known, parts=len(some) - 1)
            self._results[one.part].append(held.result(finish_of(held.lit.polish), others))
        return replace(base, pictures=pictures)

    def _held(self, one: _Shown) -> ComparedView | NotEvaluated:
        posed = self._posed[one.part]
        views = self._parts[one.part].views
        return compare_view(
            views.part,
            views.samples,
            one.view,
            posed.pose(one.view.task.view_id),
            Strictness(view_count=len(views.views)),
        )

    def _tried(self, number: int) -> Tried:
        results = self._results[number]
        areas = self._samples.areas_mm2
        compared, in_sight = (np.zeros(len(areas), dtype=bool) for _ in range(2))
        for one in results:
            in_sight |= one.unobstructed
            for check in one.checks:
                if check.name != OUTLINE:
                    compared |= check.compared
        limits = self._parts[number].views.views[0].task.limits
        placed = gather(confirm(results, self._samples, limits, {}))
        return Tried(
            self._parts[number].name,
            float(areas[compared].sum() / areas.sum()),
            float(areas[in_sight].sum() / areas.sum()),
            tuple(one for one in placed if one.verdict is Verdict.FAIL),
        )


def _alike(shown: Iterator[_Shown], middle: FloatArray) -> list[list[_Shown]]:
    """Return the views that show a part alike, part by part, each in the group of its nearest."""
    groups: list[list[_Shown]] = []
    for one in shown:
        near: list[tuple[float, int, list[_Shown]]] = []
        for group in groups:
            mm, rad = _between(group[0], one, middle)
            off = max(mm / ALIKE_MM, rad / ALIKE_RAD)
            if off <= 1.0 and all(other.part != one.part for other in group):
                near.append((off, len(near), group))
        if near:
            min(near)[2].append(one)
        else:
            groups.append([one])
    return groups


def _between(one: _Shown, other: _Shown, middle: FloatArray) -> tuple[float, float]:
    """Return the distance [mm] and the turn [rad] between two poses, each before its camera."""
    a, b = one.view.task.camera, other.view.task.camera
    return pose_gap(a, one.T_world_part_measured, b, other.T_world_part_measured, middle)


def _apart(shown: Sequence[_Shown], middle: FloatArray) -> FloatArray:
    """Return distances and turns between poses (n, n, 2) [mm, rad]."""
    return np.array([[_between(a, b, middle) for b in shown] for a in shown])


def _grid(held: ComparedView) -> LearnedView:
    """Return a view without pictures on the grid of one part, learned from that part alone."""
    return LearnedView(
        camera=held.task.camera,
        T_world_part=held.fit.T_world_part,
        corner_px=held.lit.corner_px,
        step_px=STEP_PX,
        depth_mm=held.lit.surface.depth_mm,
        reach_mm=0.0,
        reach_rad=0.0,
        parts=1,
        pictures={},
    )


OnGrid = tuple[Float32Array, Float32Array, BoolArray]  # columns, rows and mask, from `on_grid`


@dataclass(frozen=True, eq=False, slots=True)
class _Onto:
    """The pictures of a part, and the ways between its grid and that of the learned view.

    Attributes
    ----------
    lit : its pictures
    out, back : nodes of the view on the part's grid, and nodes of the part on the view's
    """

    lit: LitPictures
    out: OnGrid
    back: OnGrid

    @classmethod
    def of(cls, base: LearnedView, own: ComparedView, held: ComparedView) -> "_Onto":
        """Return the ways between a view's grid, which one part has, and another part's."""
        return cls(
            held.lit,
            on_grid(_grid(held), own.lit.surface, base.T_world_part),
            on_grid(base, held.lit.surface, held.fit.T_world_part),
        )


@dataclass(frozen=True, eq=False, slots=True)
class _Found:
    """A learned picture, and for each part the mean of the others."""

    picture: LearnedPicture
    others: list[Float32Array]


def _learned(parts: Sequence[_Onto], lamp: str) -> _Found:
    """Return the appearance of parts under a lamp, on the grid of the learned view.

    How far a part is from the others is found on its own grid, as a part is judged later.
    """
    told_by = [part.lit.ratio(lamp) for part in parts]
    ratios = [np.where(good, r, np.float32("nan")) for r, good in told_by]
    stack = np.stack([regridded(r, *part.out) for part, r in zip(parts, ratios, strict=True)])
    shown = np.isfinite(stack).sum(axis=0) >= max(MIN_PARTS - 1, 3 * len(stack) // 4)
    level = _median(stack, shown)
    for one in stack:
        both = shown & np.isfinite(one)
        one -= np.median(one[both] - level[both]) if both.any() else np.float32(0)
    others = [_median(np.delete(stack, i, axis=0), shown) for i in range(len(stack))]
    answered = []
    for part, mean, mine in zip(parts, others, ratios, strict=True):
        there = regridded(mean, *part.back)
        mask = np.isfinite(there) & np.isfinite(mine)
        found = np.abs(filtered(contrast(mine, there, mask), mask))
        found[:, ~mask] = np.nan
        answered.append(np.stack([regridded(one, *part.out) for one in found]))
    every = np.stack(answered)
    told = np.isfinite(every[:, 0]).sum(axis=0) >= len(every) - 1
    scatter = _pooled(_scatter(every, told), told)
    fine = np.repeat(np.repeat(scatter, COARSE, axis=1), COARSE, axis=2)
    fine = fine[:, : shown.shape[0], : shown.shape[1]]
    usual = [unusual(one, np.isfinite(one[0]) & told, fine) for one in every]
    nan = np.float32("nan")
    mean = np.where(told, _median(stack, shown), nan)
    without = [np.where(told, other, nan) for other in others]
    return _Found(LearnedPicture(mean, scatter, max(usual)), without)


def _median(stack: Float32Array, shown: BoolArray) -> Float32Array:
    """Return the median (..., h, w) over parts where enough show it, else nan."""
    out = np.full(stack.shape[1:], np.nan, dtype=np.float32)
    out[..., shown] = np.nanmedian(stack[..., shown], axis=0)
    return out


def _scatter(every: Float32Array, told: BoolArray) -> Float32Array:
    """Return the scale (filters, h, w) of parts' answers: the largest near by but for one part's.

    At an edge a part that lies a little further off answers much more than most; a mean would not
    know of it. One part of them all may have a defect, or dust.

    Parameters
    ----------
    every : (parts, filters, h, w) sizes of the answers, nan where unseen
    told : (h, w) where enough parts show it
    """
    kernel = np.ones((NEAR_NODES, NEAR_NODES), np.uint8)
    near = np.nan_to_num(every)
    for part in near:
        for one in part:
            one[:] = cv2.dilate(one, kernel)
    second = np.asarray(np.partition(near, -2, axis=0)[-2], np.float32)
    return np.asarray(np.where(told, second, np.float32("nan")), np.float32)


def _pooled(scale: Float32Array, shown: BoolArray) -> Float32Array:
    """Return the scale of answers (filters, h / 2, w / 2): the mean of a value's nodes.

    Parameters
    ----------
    scale : (filters, h, w) of the parts' answers
    shown : (h, w) where it is known
    """
    height, width = shown.shape
    pad = ((0, 0), (0, -height % COARSE), (0, -width % COARSE))
    known = np.pad(np.where(shown, scale, np.float32(0)), pad)
    count, rows, columns = known.shape
    cells = known.reshape(count, rows // COARSE, COARSE, columns // COARSE, COARSE)
    pooled = np.sqrt((cells**2).mean(axis=(2, 4)))
    return np.asarray(np.maximum(pooled, MIN_SCATTER), np.float32)
