"""One view against the CAD: measure the pose, then look for what should not be or is not there.

Two kinds of comparison: the silhouette before the backlight panel (`_outline`), and the brightness
under each lamp (`lit`). Each returns which surface samples it compared, so that a defect of the
smallest size there would have been a finding; samples in sight that none compared keep the reason.
A picture that does not lie where the pose says, or is not sharp (`registration`), proves nothing
and is not evaluated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray
from controller.cad import SurfaceSamples
from controller.imaging import mask_contour, subpixel_contour, threshold_levels
from controller.recognition.fitting import OutlineMeasure

from ._outline import compare_outline
from ._pose import PosedPart, PoseFit, measure_pose, moved, poses_as_good
from ._scene import ViewScene, make_scene, samples_in_sight
from ._types import InspectionLimits, ViewPictures, ViewResult, ViewTask
from .lit import BURNT_GREY, LitPictures
from .registration import Registration, register


def inspect_view(
    part: PosedPart, samples: SurfaceSamples, task: ViewTask, pictures: ViewPictures
) -> ViewResult:
    """Return what one view of a held part showed: findings, and what each check compared.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose
    """
    scene = make_scene(task)
    limits = task.limits
    low, level, high = threshold_levels(pictures.backlit, scene.panel)
    if high - low < limits.min_contrast:
        return _not_evaluated(
            task,
            samples,
            f"backlight contrast {high - low:.0f} grey levels, {limits.min_contrast:.0f} "
            "are required: is the panel's lamp on?",
        )
    burnt = float((pictures.backlit[scene.panel] >= BURNT_GREY).mean())
    if burnt > limits.max_burnt_share:
        return _not_evaluated(
            task, samples, f"{100 * burnt:.0f} % of the panel are burnt out: its edges are not true"
        )
    dark = (pictures.backlit < level) & scene.panel
    judged = scene.panel & ~scene.holder_mask
    outline = OutlineMeasure(subpixel_contour(pictures.backlit, level), judged)
    fit = measure_pose(part, task, outline)
    if fit is None:
        return _not_evaluated(task, samples, "no outline of the part where it should be")
    refusal = _pose_refusal(fit, *moved(part, task, fit), limits)
    sharp = None if refusal else register(pictures.backlit, fit.edge_px, fit.edge_normals)
    if not refusal and sharp is not None and sharp.width_px > limits.max_edge_px:
        refusal = (
            f"edges are {sharp.width_px:.1f} px wide, {limits.max_edge_px:.1f} px is allowed: out "
            "of focus, or moved"
        )
    if refusal:
        return _not_evaluated(task, samples, refusal)
    if missing := [lamp.name for lamp in task.lamps if lamp.name not in pictures.lit]:
        return _not_evaluated(task, samples, f"no picture under {missing[0]}")
    view = _View(part, samples, task, pictures, scene, dark, judged, sharp)
    best = view.compare_at(fit)
    if not any(f.kind.is_lit for f in best.findings):
        return best
    # what a lit picture shows against one pose, and not against another that the outline allows as
    # well, speaks of the pose and not of the part
    for other in poses_as_good(part, task, fit, outline):
        if _pose_refusal(other, *moved(part, task, other), limits):
            continue
        result = view.compare_at(other)
        if _explains_more(result, best):
            best = result
        if not best.findings:
            break
    return best


def _explains_more(result: ViewResult, best: ViewResult) -> bool:
    """Return whether half of the findings go, or more, and every check is still made."""
    if len(result.failures) > len(best.failures):
        return False
    left, before = (sum(f.area_mm2 for f in view.findings) for view in (result, best))
    return left <= 0.5 * before


@dataclass(frozen=True, eq=False, slots=True)
class _View:
    """One view's pictures, and what they are compared with, wherever the part is."""

    part: PosedPart
    samples: SurfaceSamples
    task: ViewTask
    pictures: ViewPictures
    scene: ViewScene
    dark: BoolArray
    judged: BoolArray
    sharp: Registration | None

    def compare_at(self, fit: PoseFit) -> ViewResult:
        """Return what the pictures tell of the part if this is its pose."""
        part, samples, task, scene = self.part, self.samples, self.task, self.scene
        shift, turn = moved(part, task, fit)
        visible = samples_in_sight(part, samples, task.camera, fit.T_world_part, scene)
        outline = compare_outline(part, fit, self.dark, self.judged, task, samples)
        findings = outline.findings
        checks = [outline.check]
        codes: list[NDArray[np.uint8]] = []
        if task.lamps:
            shading = LitPictures(part, samples, task, scene, fit, visible, self.sharp)
            for lamp in task.lamps:
                picture = self.pictures.lit[lamp.name]
                check, differing, code = shading.check(lamp.name, picture)
                checks.append(check)
                codes.append(code)
                findings = findings + differing
        free = visible.free & ~visible.beside_gripper
        checks = [replace(c, compared=c.compared & free) for c in checks]
        compared = np.logical_or.reduce([c.compared for c in checks])
        x0, y0, _, _ = fit.maps.roi
        return ViewResult(
            view_id=task.view_id,
            evaluated=True,
            reason="",
            T_world_part=fit.T_world_part,
            shift_mm=shift,
            turn_rad=turn,
            residual_px=fit.residual_px,
            findings=tuple(f for f in findings if f.evidence >= 1.0),
            hints=tuple(f for f in findings if f.evidence < 1.0),
            compared=compared,
            outline_px=mask_contour(fit.maps.mask) + np.array([x0, y0]),
            beside_gripper=visible.beside_gripper,
            unobstructed=free,
            checks=tuple(checks),
            unjudged=_best_excuse(codes, free & ~compared),
        )


def _pose_refusal(fit: PoseFit, shift: float, turn: float, limits: InspectionLimits) -> str:
    """Return what speaks against a fitted pose, empty if nothing does."""
    if fit.paired < limits.min_outline_share:
        return (
            f"{100 * fit.paired:.0f} % of the part's outline found, "
            f"{100 * limits.min_outline_share:.0f} % is required: slipped, or another part"
        )
    if fit.residual_px > limits.max_residual_px:
        return (
            f"outline off by {fit.residual_px:.2f} px, {limits.max_residual_px:.2f} px is allowed: "
            "not this part, not this pose, or a wrong dimension"
        )
    if shift > limits.max_shift_mm or turn > limits.max_turn_rad:
        return (
            f"part is {shift:.1f} mm and {np.degrees(turn):.1f} degrees off its pose in the "
            "gripper: it slipped"
        )
    return ""


def _best_excuse(codes: Sequence[NDArray[np.uint8]], missing: BoolArray) -> NDArray[np.uint8]:
    """Return per sample why no check compared it: of several lamps the one that came closest."""
    if not codes:
        return np.zeros(len(missing), dtype=np.uint8)
    best = np.maximum.reduce(codes)
    return np.where(missing, best, 0).astype(np.uint8)


def _not_evaluated(task: ViewTask, samples: SurfaceSamples, reason: str) -> ViewResult:
    return ViewResult(
        view_id=task.view_id,
        evaluated=False,
        reason=reason,
        T_world_part=task.T_world_part,
        shift_mm=0.0,
        turn_rad=0.0,
        residual_px=float("inf"),
        findings=(),
        compared=np.zeros(len(samples.points_mm), dtype=bool),
        outline_px=np.zeros((0, 2)),
    )
