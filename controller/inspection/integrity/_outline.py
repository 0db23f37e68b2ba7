"""Comparison of the silhouette before the panel with the CAD: extra, missing, moved material.

It has two methods. One finds runs of the outline that are off by a fraction of a pixel (`_runs`),
less the allowances: uncertainty of the pose, tolerances of faces, light on an edge as a whole. The
other finds areas of extra or missing material where the outline is too far off for its points to be
matched.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import SurfaceSamples
from controller.imaging import ViewMaps, inverse_pose, transform

from .._connected import LARGE_PX, border_of, connected_findings, grow
from .._pose import PosedPart
from .._types import OUTLINE, Check, Finding, FindingKind, ViewTask
from ..grasp_pose import Backlit, PoseSettings, ViewPose
from ..limits import DUST_SIZES, LOST_PX, PANEL_HALF
from ._allowed import Allowances, allowed_mm
from ._blurred import blur_rounds_px
from ._runs import Run, RunTest, alone, crowded, find_runs

MARGIN_PX: Final = 40  # width beyond the outline that is searched for extra material
NEAR_PX: Final = 6  # distance from unjudged pixels within which the observed outline ends
# Distance to either side of a lost point at which the picture is tested as dark or bright.
INSIDE_PX: Final = 2.0
MAJORITY: Final = 0.5  # share of some points above which it is most of them
LIGHT_SIGMAS: Final = 2.0  # allowance for light on an edge as a whole, in standard deviations
REACH_PX: Final = 4.0  # margin about a run for its blurred surroundings
MAX_RUNS: Final = 40  # largest number of runs tested as blurred corners; more have another cause
MAX_WINDOW_PX: Final = 60.0
AREA_PX: Final = 9  # least area; smaller differences are left to the runs
# Share of an edge's points that are off, from which the edge is out of place and not broken.
WHOLE_EDGE: Final = 0.7
BURR_PX: Final = 3.0  # size below which a finding may be dust
CHIP_PX: Final = 6.0
ROUNDED: Final = 3.0  # standard deviations of blur that round a corner
SURE_PX: Final = 3.0  # depth that no light removes from one place of an edge
CLEARLY_PX: Final = 0.3  # least excess of a face over its allowance
FULL_RUN: Final = 0.6  # least share of the points along a run that must have been compared
BETWEEN_ZOOM: Final = 4  # enlargement of a mask that is drawn for a border
CROWDED: Final = 4.0  # standard deviations of blur within which two edges move each other


@dataclass(frozen=True, eq=False, slots=True)
class OutlineResult:
    """Result of the comparison: findings, and the check with its compared samples."""

    findings: list[Finding]
    check: Check


def compare_outline(
    part: PosedPart,
    pose: ViewPose,
    maps: ViewMaps,
    backlit: Backlit,
    task: ViewTask,
    samples: SurfaceSamples,
    allowances: Allowances,
    settings: PoseSettings,
    view_count: int = 1,
) -> OutlineResult:
    """Return the differences of a view's silhouette from the CAD, and the compared area.

    Parameters
    ----------
    part : the solid, with ray casting
    pose : fitted pose, with the predicted outline and the offsets of the observed one
    maps : prediction at the pose
    backlit : the picture, normalised by the panel's light
    task : the view, with its camera
    samples : samples of the surface, for the area covered by the outline
    allowances : allowed deviations of a good part
    settings : prior knowledge of arm, parts and light
    view_count : number of views of the part, to bound its false alarms
    """
    look = _Look(part, pose, maps, backlit, task, allowances, settings)
    test = RunTest(
        noise_px=max(pose.noise_px, min(pose.residual_px, settings.light_px)),
        wave_px=float(np.hypot(settings.light_px / 3.0, allowances.form_mm / look.mm)),
        false_alarms=allowances.false_alarms,
        view_count=view_count,
    )
    points = pose.rims.points
    runs = find_runs(points.pixels, points.normals, look.off_px, look.step_px, test)
    if runs:
        look.take_off_blur(runs)
        runs = find_runs(points.pixels, points.normals, look.off_px, look.step_px, test)
    areas = _areas(look, maps)
    findings = [f for f in (look.finding(run) for run in runs) if f is not None]
    findings = [f for f in findings if not any(_same(f, area) for area in areas)] + areas
    limit_px = test.limit(len(points.pixels)) * float(test.sigma_px(np.array([CHIP_PX]))[0])
    near = look.compared(limit_px)
    compared: BoolArray = np.zeros(len(samples.points_mm), dtype=bool)
    size_mm = limit_px * look.mm
    # Half a disc of the smallest size must be long enough and deep enough for a run.
    smallest_mm = task.limits.smallest_defect_mm
    is_resolved = smallest_mm >= max(CHIP_PX * look.mm, 2 * size_mm)
    if near.any() and is_resolved:
        tree = cKDTree(points.points_mm[near])
        # A chip of the smallest size about such a point extends well across the outline.
        reach_mm = smallest_mm / 4
        placed = transform(pose.T_world_part_measured, samples.points_mm)
        far, _ = tree.query(placed, distance_upper_bound=np.nextafter(reach_mm, np.inf))
        compared |= far <= reach_mm
    return OutlineResult(findings, Check(OUTLINE, "", compared, size_mm, CHIP_PX * look.mm))


class _Look:
    """Outline of one view, less the allowances."""

    def __init__(
        self,
        part: PosedPart,
        pose: ViewPose,
        maps: ViewMaps,
        backlit: Backlit,
        task: ViewTask,
        allowances: Allowances,
        settings: PoseSettings,
    ) -> None:
        self.part, self.pose, self.backlit, self.task = part, pose, backlit, task
        self.maps = maps
        self.points = pose.rims.points
        centre = transform(pose.T_world_part_measured, part.solid.centroid_mm[None])[0]
        self.mm = task.camera.mm_per_px(centre)
        self.step_px = self.points.step_mm / self.mm
        self.judged = backlit.outline.is_judged(self.points.pixels)
        self.allowed_mm = allowed_mm(part, allowances.tolerance_class)
        self.light_px = LIGHT_SIGMAS * settings.light_px
        self.off_px = self._off()

    def _off(self) -> FloatArray:
        """Return the excess (n,) of the observed outline over the allowance; nan where unknown."""
        pose = self.pose
        shape = pose.gap_px - pose.left_px
        moves = np.abs(pose.rims.per_face)
        allowed = self.allowed_mm[pose.rims.faces]
        # Both faces of an edge may be off, and a curved one may be grown and moved.
        room = (moves[..., 0] * allowed.sum(axis=2)).sum(axis=1)
        light = np.clip(pose.edge_px, -self.light_px, self.light_px)
        self.beyond_px = shape - np.clip(shape, -room, room)
        off = pose.gap_px - np.clip(shape, -room, room) - light
        off[~self.judged] = np.nan
        off = self._with_lost(off)
        reach_px = CROWDED * self.backlit.width_px
        off[crowded(self.points.pixels, self.points.normals, reach_px)] = np.nan
        off[alone(self.points.pixels, self.points.normals)] = np.nan
        return off

    def _with_lost(self, off: FloatArray) -> FloatArray:
        """Return the offsets, also for points without a partner, where panel or part is visible."""
        lost = np.isnan(self.pose.gap_px) & self.judged & ~self._near_unjudged()
        if not lost.any():
            return off
        at, normals = self.points.pixels[lost], self.points.normals[lost]
        within, beyond = at - INSIDE_PX * normals, at + INSIDE_PX * normals
        is_dark_within, is_dark_beyond = (self._is_dark(p) for p in (within, beyond))
        # At a slender corner this far in is outside again; on a low step this far out is inside.
        fits = self._is_surely(within, part=True) & self._is_surely(beyond, part=False)
        out = off.copy()
        out[lost] = np.select(
            [fits & ~is_dark_within & ~is_dark_beyond, fits & is_dark_within & is_dark_beyond],
            [-LOST_PX, LOST_PX],
            np.nan,
        )
        return out

    def _is_dark(self, at_px: FloatArray) -> BoolArray:
        height, width = self.backlit.share.shape
        x, y = np.round(at_px).astype(np.int64).T
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        return np.asarray(self.backlit.share[y, x] < PANEL_HALF)

    def _is_surely(self, at_px: FloatArray, *, part: bool) -> BoolArray:
        """Return a mask (n,) of the places (n, 2) clearly on the part, or clearly off it."""
        mask = self.maps.mask if part else ~self.maps.mask
        beside = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
        all_about = cv2.erode(mask.astype(np.uint8), beside) > 0
        x0, y0, _, _ = self.maps.roi
        x, y = np.round(at_px).astype(np.int64).T
        x, y = np.clip(x - x0, 0, mask.shape[1] - 1), np.clip(y - y0, 0, mask.shape[0] - 1)
        return np.asarray(all_about[y, x])

    def _near_unjudged(self) -> BoolArray:
        x, y = np.round(self.points.pixels).astype(np.int64).T
        height, width = self.backlit.judged.shape
        x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
        return np.asarray(grow(~self.backlit.judged, NEAR_PX)[y, x])

    def compared(self, limit_px: float) -> BoolArray:
        """Return a mask (n,) of outline points where a run would have been found, and none was."""
        good: BoolArray = np.abs(np.nan_to_num(self.off_px, nan=np.inf)) <= limit_px
        if not good.any():
            return good
        tree = cKDTree(self.points.pixels[good])
        counts = tree.query_ball_point(self.points.pixels, CHIP_PX / 2, return_length=True)
        good &= np.array(counts, dtype=np.float64) >= FULL_RUN * CHIP_PX / self.step_px
        return good

    def take_off_blur(self, runs: Sequence[Run]) -> None:
        """Subtract the effect of blur on the predicted outline about some runs.

        Parameters
        ----------
        runs : runs that blur may have caused
        """
        at, normals = self.points.pixels, self.points.normals
        reach = max(REACH_PX, CROWDED * self.backlit.width_px)
        for run in runs[:MAX_RUNS]:
            low = at[run.points].min(axis=0) - reach
            high = at[run.points].max(axis=0) + reach
            if (high - low).max() > MAX_WINDOW_PX:
                continue  # no corner is as long
            inner = ((at > low + reach - 1) & (at < high - reach + 1)).all(axis=1)
            near = np.flatnonzero(inner & np.isfinite(self.off_px))
            window = np.concatenate([low, high])
            shift = blur_rounds_px(
                self.part, self.pose.T_world_part_measured, self.task.camera, window,
                self.backlit.width_px, at[near], normals[near],
            )  # fmt: skip
            self.off_px[near] -= np.nan_to_num(shift)

    def is_moved(self, points: IntArray) -> bool:
        """Return True if points show faces farther out of place than allowed."""
        beyond = self.beyond_px[points]
        here = np.isfinite(beyond)
        if not here.any():
            return False
        rest = np.abs(self.off_px[points] - beyond)[here]
        return bool((np.abs(beyond[here]) > np.maximum(rest, CLEARLY_PX)).mean() > MAJORITY)

    def near(self, box_px: tuple[int, int, int, int]) -> IntArray:
        """Return the outline points in or beside a box of the picture."""
        x0, y0, x1, y1 = box_px
        x, y = self.points.pixels.T
        inside = (x > x0 - 2) & (x < x1 + 2) & (y > y0 - 2) & (y < y1 + 2)
        return np.flatnonzero(inside)

    def finding(self, run: Run) -> Finding | None:
        """Return the finding of a run; None for possible dust."""
        kind = self._kind(run)
        if kind is None:
            return None
        at = self.points.pixels[run.points]
        deepest = run.points[np.argmax(np.abs(self.off_px[run.points]))]
        low, high = at.min(axis=0), at.max(axis=0)
        T_part_world = inverse_pose(self.pose.T_world_part_measured)
        middle = np.median(self.points.points_mm[run.points], axis=0)
        nearest = np.argmin(np.linalg.norm(self.points.points_mm[run.points] - middle, axis=1))
        chosen = run.points[nearest] if kind is not FindingKind.CHIP else deepest
        ids, counts = np.unique(self.pose.rims.faces[run.points], return_counts=True)
        order = np.argsort(-counts)
        shares = counts[order] / len(run.points)
        return Finding(
            kind=kind,
            lamp="backlit",
            area_mm2=run.area_px * self.mm**2,
            size_mm=float(np.hypot(run.length_px, run.depth_px)) * self.mm,
            at_px=(float(self.points.pixels[chosen][0]), float(self.points.pixels[chosen][1])),
            box_px=(int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1),
            p_part_mm=transform(T_part_world, self.points.points_mm[chosen][None])[0],
            face_ids=tuple(int(i) for i in ids[order][shares > 0.2]) or (int(ids[order][0]),),
            is_sure=kind is not FindingKind.DIMENSION and self._is_sure(run),
            outline_px=self._between(run),
        )

    def _between(self, run: Run) -> FloatArray:
        """Return the border (k, 2) of the area between predicted and observed outline."""
        ends = self.points.pixels[run.points]
        off = np.nan_to_num(self.off_px[run.points])
        others = ends + self.points.normals[run.points] * off[:, None]
        corner = np.floor(np.minimum(ends, others).min(axis=0)) - 1.0
        size = np.ceil(np.maximum(ends, others).max(axis=0) - corner).astype(int) + 2
        zoom = BETWEEN_ZOOM if BETWEEN_ZOOM * size.max() <= LARGE_PX else 1
        mask = np.zeros((zoom * size[1], zoom * size[0]), dtype=np.uint8)
        for one, other in zip(ends - corner, others - corner, strict=True):
            a, b = ([round(zoom * float(x)) for x in p] for p in (one, other))
            # Lines as thick as the distance to the next point leave no gap between two points.
            cv2.line(mask, a, b, 1, max(1, round(zoom * self.step_px)))
        return border_of(mask > 0, (float(corner[0]), float(corner[1])), 1 / zoom)

    def _is_sure(self, run: Run) -> bool:
        """Return True if neither light nor dust explains a run."""
        if run.depth_px < 0:
            return run.depth_px < -SURE_PX and run.length_px >= CHIP_PX
        grain_px = DUST_SIZES * self.task.limits.dust_mm / self.mm
        return min(run.depth_px, run.length_px) >= max(BURR_PX, grain_px)

    def _kind(self, run: Run) -> FindingKind | None:
        mine = np.zeros(len(self.off_px), dtype=bool)
        mine[run.points] = True
        faces = np.sort(self.pose.rims.faces, axis=1)
        _, edge = np.unique(faces, axis=0, return_inverse=True)
        edge = edge.reshape(-1)
        own = np.bincount(edge[run.points]).argmax()
        of_edge = (edge == own) & np.isfinite(self.off_px)
        if mine[of_edge].mean() >= WHOLE_EDGE and run.length_px >= CHIP_PX:
            return FindingKind.DIMENSION
        if self.is_moved(run.points):
            return FindingKind.DIMENSION
        if run.depth_px < 0:
            rounded_px = max(BURR_PX, ROUNDED * self.backlit.width_px)
            if -run.depth_px < rounded_px and run.length_px < rounded_px:
                return None  # a notch this small may be a corner rounded by blur
            is_sharp = faces[run.points, 0] != faces[run.points, 1]
            return FindingKind.CHIP if is_sharp.mean() > MAJORITY else FindingKind.MISSING
        grain_px = self.task.limits.dust_mm / self.mm
        if run.depth_px < max(BURR_PX, grain_px) and run.length_px < max(CHIP_PX, 2 * grain_px):
            return None
        return FindingKind.BURR


def _areas(look: _Look, maps: ViewMaps) -> list[Finding]:
    task, T = look.task, look.pose.T_world_part_measured
    x0, y0 = max(maps.roi[0] - MARGIN_PX, 0), max(maps.roi[1] - MARGIN_PX, 0)
    x1 = min(maps.roi[2] + MARGIN_PX, task.camera.size_px[0])
    y1 = min(maps.roi[3] + MARGIN_PX, task.camera.size_px[1])
    expected = np.zeros((y1 - y0, x1 - x0), dtype=bool)
    expected[maps.roi[1] - y0 : maps.roi[3] - y0, maps.roi[0] - x0 : maps.roi[2] - x0] = maps.mask
    window = (slice(y0, y1), slice(x0, x1))
    dark, judged = look.backlit.share[window] < PANEL_HALF, look.backlit.judged[window]
    allowed_px = float(look.allowed_mm.sum(axis=1).max()) / look.mm
    slack = int(np.ceil(max(allowed_px, BURR_PX)))
    area = np.full(expected.shape, look.mm**2, dtype=np.float32)
    found: list[Finding] = []
    # Where gripper and part overlap in the picture, there is no ground to compare with.
    for wrong, kind in (
        (expected & ~dark & judged, FindingKind.MISSING),
        (~expected & dark & judged, FindingKind.EXTRA),
    ):
        side = expected if kind is FindingKind.EXTRA else ~expected
        deep = wrong & ~grow(side, slack)
        if not deep.any():
            continue
        # Grow it back to the outline, to restore its size.
        whole = wrong & grow(deep, slack + 1)
        whole_found = connected_findings(
            whole, kind, "backlit", look.part, maps, task.camera, T, (x0, y0), area,
            AREA_PX * look.mm**2,
        )  # fmt: skip
        for f in whole_found:
            if not _touches_part(f, expected, (x0, y0)):
                continue
            is_moved = look.is_moved(look.near(f.box_px))
            found.append(
                replace(f, kind=FindingKind.DIMENSION) if is_moved else replace(f, is_sure=True)
            )
    return found


def _touches_part(finding: Finding, expected: BoolArray, corner: tuple[int, int]) -> bool:
    """Return True if a difference touches the part; other objects before the panel are dirt."""
    x0, y0, x1, y1 = finding.box_px
    left, top = corner
    window = expected[max(y0 - top - 3, 0) : y1 - top + 3, max(x0 - left - 3, 0) : x1 - left + 3]
    return bool(window.any())


def _same(run: Finding, area: Finding) -> bool:
    x0, y0, x1, y1 = area.box_px
    left, top, right, bottom = run.box_px
    return left <= x1 + 4 and right >= x0 - 4 and top <= y1 + 4 and bottom >= y0 - 4
