"""Learning what good parts look like, from the pictures of some that were accepted.

Parts are brought to one grid by their measured poses, view by view. What is kept is the median of
picture over prediction, and how far each part is from the median of the others: so the scatter has
in it all that differs from one good part to the next, the errors of the poses too. A part that
shows a defect against the others is named, and left out.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray
from controller.cad import SurfaceSamples
from messages import joined, say

from ._gathered import PlacedFinding, gather
from ._judge import confirm
from ._part_types import ViewSet
from ._pose import PosedPart
from ._types import OUTLINE, PicturedView, Verdict, ViewResult
from .grasp_pose import OutlinedView, PoseSettings, ViewPose
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
from .stages import outlined_view, pose_views
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

Spread = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


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
    """A part in one view, in which its outline and its pose were found."""

    part: int
    view: PicturedView
    pose: ViewPose
    view_count: int
    kept: Kept

    @property
    def T_world_part_measured(self) -> FloatArray:
        """The pose measured (4, 4)."""
        return self.pose.T_world_part_measured


@dataclass(frozen=True, eq=False, slots=True)
class _PoseOrder:
    """An order for the poses of a part in all its views."""

    views: ViewSet
    settings: PoseSettings
    kept: Kept


@dataclass(frozen=True, eq=False, slots=True)
class _ViewOrder:
    """An order for a learned view: the CAD model, and the parts that show it alike."""

    part: PosedPart
    samples: SurfaceSamples
    middle: FloatArray
    group: tuple[_Shown, ...]


@dataclass(frozen=True, eq=False, slots=True)
class _ViewLearned:
    """A learned view, None where too few pictures could be used; each part judged by the others."""

    view: LearnedView | None = None
    results: tuple[tuple[int, ViewResult], ...] = ()


def learn(
    parts: Sequence[GoodPart],
    settings: PoseSettings | None = None,
    told: Callable[[str], None] = lambda words: None,
    spread: Spread = map,
) -> Lesson:
    """Return what good parts look like.

    Parameters
    ----------
    parts : of one CAD model, with their pictures
    settings : what is known of arm, parts and light before the pictures
    told : hears what is done
    spread : how functions are called with orders, as `map` does: other processes may

    Raises
    ------
    TooFewPartsError : fewer than five parts, or than five that are alike, are left
    """
    settings = settings or PoseSettings()
    left: list[GoodPart] = list(parts)
    kept = {one.name: Kept() for one in left}
    posed: dict[str, Mapping[str, ViewPose]] = {}
    left_out: list[Tried] = []
    while True:
        if len(left) < MIN_PARTS:
            named = joined(
                "", [say("; {name} differs from the others", name=one.name) for one in left_out]
            )
            raise TooFewPartsError(
                say(
                    "{left_count} good parts, {min_parts} are needed to tell what is usual{named}",
                    left_count=len(left),
                    min_parts=MIN_PARTS,
                    named=named,
                )
            )
        if not posed:
            orders = [_PoseOrder(one.views, settings, kept[one.name]) for one in left]
            posed = dict(zip(kept, spread(_poses, orders), strict=True))
        shown = [
            _Shown(number, view, pose, len(part.views.views), kept[part.name])
            for number, part in enumerate(left)
            for view in part.views.views
            if (pose := posed[part.name].get(view.task.view_id)) is not None
        ]
        lesson = _Lesson(left, shown, told).lesson(spread)
        odd = [one for one in lesson.tried if one.odd]
        if not odd:
            return replace(lesson, left_out=tuple(left_out))
        # the oddest alone: what it does to the others' median goes with it
        worst = max(odd, key=lambda one: max(f.area_mm2 for f in one.odd))
        told(say("{name} differs from the others and is left out", name=worst.name))
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
        self, parts: Sequence[GoodPart], shown: Sequence[_Shown], told: Callable[[str], None]
    ) -> None:
        self._parts, self._shown, self._told = parts, shown, told
        self._samples = parts[0].views.samples
        self._solid = parts[0].views.part.solid
        self._middle = np.asarray(self._solid.centroid_mm, np.float64)
        self._results: list[list[ViewResult]] = [[] for _ in parts]

    def lesson(self, spread: Spread) -> Lesson:
        """Return what was learned, with each part judged by the others."""
        views, groups, unlearned = [], [], []
        for group in _alike(self._shown, self._middle):
            if len({one.part for one in group}) < MIN_PARTS:
                names = ", ".join(sorted({one.view.task.view_id for one in group}))
                unlearned.append(
                    say(
                        "{names}: shown alike by {group_count} parts",
                        names=names,
                        group_count=len(group),
                    )
                )
            else:
                groups.append(group)
        for found in spread(_learn_view, self._orders(groups)):
            for number, result in found.results:
                self._results[number].append(result)
            if found.view is not None:
                views.append(found.view)
        return Lesson(
            Appearance(tuple(views), self._middle),
            tuple(self._tried(i) for i in range(len(self._parts))),
            (),
            tuple(unlearned),
        )

    def _orders(self, groups: Sequence[Sequence[_Shown]]) -> Iterator[_ViewOrder]:
        part = self._parts[0].views.part
        for group in groups:
            first = min(one.view.task.view_id for one in group)
            self._told(f"view {first}, {len(group)} parts")
            yield _ViewOrder(part, self._samples, self._middle, tuple(group))

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


def _poses(order: _PoseOrder) -> Mapping[str, ViewPose]:
    """Return the pose of a part in each view that shows its outline and has a lit picture."""
    posed = pose_views(order.views, order.settings, order.kept)
    found = {}
    for view in posed.outlined:
        pose = posed.pose(view.view.task.view_id)
        if isinstance(view, OutlinedView) and pose is not None and view.task.lamps:
            found[view.task.view_id] = pose
    return found


def _learn_view(order: _ViewOrder) -> _ViewLearned:
    """Return a learned view, and each of its parts judged by the others."""
    some = [
        (one, held)
        for one in order.group
        if not isinstance(held := _held(order, one), NotEvaluated)
    ]
    if len(some) < MIN_PARTS:
        return _ViewLearned()
    shown, helds = [one for one, _ in some], [held for _, held in some]
    away = _apart(shown, order.middle)
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
    results = []
    for (one, held), known in zip(some, without, strict=True):
        others = replace(base, pictures=known, parts=len(some) - 1)
        results.append((one.part, held.result(finish_of(held.lit.polish), others)))
    return _ViewLearned(replace(base, pictures=pictures), tuple(results))


def _held(order: _ViewOrder, one: _Shown) -> ComparedView | NotEvaluated:
    return compare_view(
        order.part,
        order.samples,
        outlined_view(one.kept, one.view),
        one.pose,
        Strictness(view_count=one.view_count),
    )


def _alike(shown: Sequence[_Shown], middle: FloatArray) -> list[list[_Shown]]:
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
