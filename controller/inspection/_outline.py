"""The silhouette before the backlight panel against the CAD: what sticks out, what is missing.

Two looks at one thing: areas of material too much or too little, and runs of the outline that are
off. Both let `slack_px` pass. The pose was fitted to this outline, so that a part that is too large
all round shows half of it on either side: what is compared is its shape, not its size.
"""

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples
from controller.imaging import ViewMaps, transform

from ._connected import connected_findings, grow
from ._pose import PosedPart, PoseFit
from ._types import OUTLINE, Check, Finding, FindingKind, ViewTask

MARGIN_PX: Final = 40  # beyond the outline, where material may stick out
KERNEL_PX: Final = 3  # a difference is at least as wide
FULL_RUN: Final = 0.6  # of the pixels along a run that must have been compared
CHIP_SHARE: Final = 0.5  # of what the slack leaves of the smallest chip that must be found
NEAR_PX: Final = 6  # the observed outline is looked for so far from the predicted one
RUN_WIDTH_PX: Final = 6.0  # what a run without any partner counts as


@dataclass(frozen=True, eq=False, slots=True)
class OutlineResult:
    """What the silhouette showed: findings, and the check with what it compared."""

    findings: list[Finding]
    check: Check


def compare_outline(
    part: PosedPart,
    fit: PoseFit,
    dark: BoolArray,
    valid: BoolArray,
    task: ViewTask,
    samples: SurfaceSamples,
) -> OutlineResult:
    """Return where the silhouette of a view differs from the CAD, and what it compared.

    Parameters
    ----------
    part : the solid, with rays against it
    fit : the pose measured
    dark : (height, width) darker than half the panel
    valid : (height, width) the panel is in sight there, and neither gripper nor arm stands near
    task : the view; with its camera
    samples : of the surface, to know what the outline covers
    """
    limits = task.limits
    T = fit.T_world_part
    mm = task.camera.mm_per_px(transform(T, part.solid.centroid_mm[None])[0])
    run_px = limits.smallest_defect_mm / mm
    findings = _areas(part, fit.maps, dark, valid, task, T, mm)
    findings += _runs(part, fit, valid, task, mm, run_px, findings)
    size_mm = (limits.slack_px + 0.5) * mm
    compared: BoolArray = np.zeros(len(samples.points_mm), dtype=bool)
    if is_resolved(limits.slack_px, run_px):
        near = _compared_rim(fit, valid, limits.slack_px, run_px)
        if near.any():
            tree = cKDTree(fit.edge_points_mm[near])
            far, _ = tree.query(transform(T, samples.points_mm))
            # a chip of the smallest size about such a point reaches well across the outline
            compared |= far <= limits.smallest_defect_mm / 4
    return OutlineResult(findings, Check(OUTLINE, "", compared, size_mm, run_px * mm))


def is_resolved(slack_px: int, run_px: float) -> bool:
    """Return whether half a disc of the smallest size (its diameter in px) outgrows the slack."""
    return run_px / 2 >= slack_px + KERNEL_PX


def _chip_px(slack_px: int, run_px: float) -> float:
    """Return how much of half a disc on the outline lies beyond the slack [px]."""
    radius = run_px / 2
    if radius <= slack_px:
        return float("inf")
    angle = np.arccos(slack_px / radius)
    return float(radius**2 * (angle - 0.5 * np.sin(2 * angle)))


def _compared_rim(fit: PoseFit, valid: BoolArray, slack_px: int, run_px: float) -> BoolArray:
    """Return which outline points (n,) lie in a run that was compared for its whole length."""
    x, y = np.round(fit.edge_px).astype(int).T
    good: BoolArray = valid[y, x] & (np.abs(np.nan_to_num(fit.gap_px, nan=np.inf)) <= slack_px)
    if not good.any():
        return good
    tree = cKDTree(fit.edge_px[good])
    counts = tree.query_ball_point(fit.edge_px, run_px / 2, return_length=True)
    good &= np.array(counts, dtype=np.float64) >= FULL_RUN * run_px
    return good


def _areas(
    part: PosedPart,
    maps: ViewMaps,
    dark: BoolArray,
    valid: BoolArray,
    task: ViewTask,
    T: FloatArray,
    mm: float,
) -> list[Finding]:
    x0, y0 = max(maps.roi[0] - MARGIN_PX, 0), max(maps.roi[1] - MARGIN_PX, 0)
    x1 = min(maps.roi[2] + MARGIN_PX, task.camera.size_px[0])
    y1 = min(maps.roi[3] + MARGIN_PX, task.camera.size_px[1])
    expected = np.zeros((y1 - y0, x1 - x0), dtype=bool)
    expected[maps.roi[1] - y0 : maps.roi[3] - y0, maps.roi[0] - x0 : maps.roi[2] - x0] = maps.mask
    window = (slice(y0, y1), slice(x0, x1))
    observed, judged = dark[window], valid[window]
    slack = task.limits.slack_px
    least = CHIP_SHARE * _chip_px(slack, task.limits.smallest_defect_mm / mm) * mm**2
    area = np.full(expected.shape, mm**2, dtype=np.float32)
    # where gripper and part overlap in the picture no ground is left to compare with
    missing = ~grow(~expected, slack) & ~observed & judged
    extra = ~grow(expected, slack) & observed & judged
    found: list[Finding] = []
    for wrong, kind in ((missing, FindingKind.MISSING), (extra, FindingKind.EXTRA)):
        kernel = np.ones((KERNEL_PX, KERNEL_PX), np.uint8)
        opened = cv2.morphologyEx(wrong.astype(np.uint8), cv2.MORPH_OPEN, kernel) > 0
        found += connected_findings(
            opened, kind, "backlit", part, maps, task.camera, T, (x0, y0), area, least
        )
    return found


def _runs(
    part: PosedPart,
    fit: PoseFit,
    valid: BoolArray,
    task: ViewTask,
    mm: float,
    run_px: float,
    known: list[Finding],
) -> list[Finding]:
    """Return runs of the outline that are off all along; none where an area says it already."""
    slack = task.limits.slack_px
    gap = fit.gap_px
    x0, y0, x1, y1 = fit.maps.roi
    found: list[Finding] = []
    x, y = np.round(fit.edge_px).astype(int).T
    # beside what is not judged the observed outline ends
    lost = np.isnan(gap) & ~grow(~valid, NEAR_PX)[y, x]
    for off, kind in (
        (gap > slack, FindingKind.EXTRA),
        ((gap < -slack) | lost, FindingKind.MISSING),
    ):
        mask = np.zeros((y1 - y0 + 1, x1 - x0 + 1), dtype=np.uint8)
        u, v = np.clip(np.round(fit.edge_px[off]).astype(int) - [x0, y0], 0, [x1 - x0, y1 - y0]).T
        mask[v, u] = 1
        wide = cv2.dilate(mask, np.ones((5, 5), np.uint8))
        count, labels = cv2.connectedComponents(wide, connectivity=8)
        lengths = np.bincount(labels[v, u], minlength=count)
        width = np.where(lost, RUN_WIDTH_PX, np.minimum(np.abs(gap), RUN_WIDTH_PX))[off]
        for i in range(1, count):
            if lengths[i] < run_px:
                continue
            here = labels[v, u] == i
            points = fit.edge_px[off][here]
            low, high = points.min(axis=0), points.max(axis=0)
            if any(_touches(f.box_px, low, high) for f in known):
                continue
            each = np.where(labels == i, np.float32(mm**2), np.float32(0))
            region = connected_findings(
                labels == i, kind, "backlit", part, fit.maps, task.camera,
                fit.T_world_part, (x0, y0), each, 0.0,
            )  # fmt: skip
            area = float(width[here].sum()) * mm**2
            found += [_with_area(f, area) for f in region[:1]]
    return found


def _touches(box: tuple[int, int, int, int], low: FloatArray, high: FloatArray) -> bool:
    x0, y0, x1, y1 = box
    return bool(low[0] <= x1 + 4 and high[0] >= x0 - 4 and low[1] <= y1 + 4 and high[1] >= y0 - 4)


def _with_area(finding: Finding, area_mm2: float) -> Finding:
    return Finding(
        kind=finding.kind,
        lamp=finding.lamp,
        area_mm2=area_mm2,
        size_mm=finding.size_mm,
        at_px=finding.at_px,
        box_px=finding.box_px,
        p_part_mm=finding.p_part_mm,
        face_ids=finding.face_ids,
    )
