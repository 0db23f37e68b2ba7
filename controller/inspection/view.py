"""One view against the CAD: the pose of the part, then extra and missing material.

Two kinds of comparison: the silhouette before the backlight panel (`integrity`), and the brightness
under each lamp (`lit`). Each returns which surface samples it compared, so that a defect of the
smallest size there would have been a finding; samples in sight that none compared keep the reason.
A picture that does not lie where the pose says, or is not sharp (`registration`), proves nothing
and is not evaluated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray
from controller.cad import SurfaceSamples
from controller.imaging import mask_contour, render_maps, threshold_levels, transform, view_roi
from messages import key, say

from ._holder import with_measured_holder
from ._pose import (
    PosedPart,
    PoseFit,
    moved,
    point_spread,
    poses_as_good,
)
from ._scene import ViewScene, before_part, make_scene, samples_in_sight
from ._types import (
    OUTLINE,
    Check,
    Finding,
    InspectionLimits,
    PicturedView,
    ViewPictures,
    ViewResult,
    ViewTask,
)
from .grasp_pose import (
    GraspPose,
    OutlinedView,
    PoseSettings,
    ViewPose,
    backlit_outline,
    fit_grasp,
    settle_turn,
)
from .integrity import Allowances, OutlineResult, compare_outline
from .limits import MEASURED_HOLD, PLANNED_HOLD, POSE_SPREADS
from .lit import (
    BURNT_GREY,
    MIN_WIDTH_PX,
    Appearance,
    Finish,
    LearnedView,
    LitPictures,
    finish_of,
)
from .registration import Registration, register

# What they may be in the picture: half the width that a defect must have to be seen.
MAX_OPEN_PX: Final = 0.5 * MIN_WIDTH_PX
SPREAD_STEP_PX: Final = 8  # distance between pixels whose surface is asked
NEAR_SHARE: Final = 0.9  # share of the outline found in its place
ROUGH: Final = 3.0  # standard deviations of noise and light: the unevenness allowed of an outline


@dataclass(frozen=True, eq=False, slots=True)
class NotEvaluated:
    """A view whose pictures prove nothing, and why.

    Attributes
    ----------
    view : with its pictures
    reason : why they do not
    T_world_part : (4, 4) pose of the part by its outline alone, where its turn about an axis is not
        known; None otherwise
    """

    view: PicturedView
    reason: str
    T_world_part: FloatArray | None = None

    def result(self, samples: SurfaceSamples) -> ViewResult:
        """Return the result of the view: nothing found, nothing compared.

        Parameters
        ----------
        samples : of the part's surface
        """
        return ViewResult(
            view_id=self.view.task.view_id,
            evaluated=False,
            reason=self.reason,
            T_world_part_expected=self.view.task.T_world_part_expected,
            T_world_part_measured=None,
            shift_mm=0.0,
            turn_rad=0.0,
            residual_px=float("inf"),
            findings=(),
            compared=np.zeros(len(samples.points_mm), dtype=bool),
            outline_px=np.zeros((0, 2)),
        )


@dataclass(frozen=True, slots=True)
class Strictness:
    """Differences allowed of a good part, and knowledge before the pictures.

    Attributes
    ----------
    allowances : of its outline
    pose : of its pose
    view_count : views of the part
    appearance : of good parts; None where none was learned
    """

    allowances: Allowances = field(default_factory=Allowances)
    pose: PoseSettings = field(default_factory=PoseSettings)
    view_count: int = 1
    appearance: Appearance | None = None


@dataclass(frozen=True, eq=False, slots=True)
class CheckedView:
    """A view that passed its self-checks with the part at its measured pose.

    Attributes
    ----------
    outlined : the view, with the outline in its picture before the panel
    pose : measured pose, and the agreement of the outline
    fit : the same pose with its predicted picture
    sharp : sharpness of the picture before the panel; None where no outline shows it
    """

    outlined: OutlinedView
    pose: ViewPose
    fit: PoseFit
    sharp: Registration | None

    @property
    def task(self) -> ViewTask:
        """The view: camera, pose expected, limits."""
        return self.outlined.task


def outline_view(view: PicturedView) -> OutlinedView | NotEvaluated:
    """Return the outline in a view's picture before the panel, or the reason for none.

    Parameters
    ----------
    view : with its pictures
    """
    backlit, limits = view.pictures.backlit, view.task.limits
    scene = make_scene(view.task)
    low, _, high = levels = threshold_levels(backlit, scene.panel)
    if high - low < limits.min_contrast:
        return NotEvaluated(
            view,
            say(
                "backlight contrast {contrast:.0f} grey levels, {min_contrast:.0f} are "
                "required: is the panel's lamp on?",
                contrast=high - low,
                min_contrast=limits.min_contrast,
            ),
        )
    burnt = float((backlit[scene.panel] >= BURNT_GREY).mean())
    if burnt > limits.max_burnt_share:
        return NotEvaluated(
            view,
            say(
                "{burnt_percent:.0f} % of the panel are burnt out: its edges are not true",
                burnt_percent=100 * burnt,
            ),
        )
    return OutlinedView(view, scene, backlit_outline(backlit, scene, levels))


def locate_view(
    part: PosedPart,
    task: ViewTask,
    pictures: ViewPictures,
    before: Sequence[PicturedView] = (),
) -> CheckedView | NotEvaluated:
    """Return the pose of a held part by one view alone, for the arm; nothing is compared yet.

    Parameters
    ----------
    part : the CAD model
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose; of lit ones only which there are
    before : views that left the part's turn open, expected at the same guess of it
    """
    prior = MEASURED_HOLD if task.is_hold_measured else PLANNED_HOLD
    outlined = outline_view(PicturedView(task, pictures, 0, *prior))
    if isinstance(outlined, NotEvaluated):
        return outlined
    strictness = Strictness()
    # round jaws that took a round part over have let it turn, by some degrees
    may_have_spun = task.facts.free_turn is not None and not task.is_hold_measured
    if task.facts.is_turn_open or may_have_spun:
        others = (one for one in map(outline_view, before) if isinstance(one, OutlinedView))
        views = (*((one,) for one in others), (outlined,))  # the hold may be known better by now
        *_, (outlined,) = settle_turn(part, views, strictness.pose)
    grasp = fit_grasp(part, [outlined], strictness.pose)
    if task.is_hold_measured and not _is_near(grasp):
        # the view that measured the hold may have known it badly
        outlined = replace(outlined, view=PicturedView(task, pictures, 0, *PLANNED_HOLD))
        grasp = fit_grasp(part, [outlined], strictness.pose)
    return check_view(part, outlined, None if grasp is None else grasp.views[0], strictness)


def inspect_view(
    part: PosedPart,
    samples: SurfaceSamples,
    task: ViewTask,
    pictures: ViewPictures,
    located: CheckedView | NotEvaluated | None = None,
) -> ViewResult:
    """Return one view's result on a held part by itself: findings, and samples compared.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose
    located : what `locate_view` returned; None to find it
    """
    located = located or locate_view(part, task, pictures)
    if isinstance(located, NotEvaluated):
        return located.result(samples)
    return _to_compare(part, samples, located, Strictness()).judged()


def _is_near(grasp: GraspPose | None) -> bool:
    return grasp is not None and grasp.views[0].paired >= NEAR_SHARE


@dataclass(frozen=True, eq=False, slots=True)
class ComparedView:
    """Pictures of a view with the part at one pose, and what they are compared with there.

    Attributes
    ----------
    part, samples : the CAD model and its surface samples
    checked : the view at its measured pose
    scene : scene without the part, with gripper and arm as measured in the picture
    outline : result of the picture before the panel
    appearance : of good parts; None where none was learned
    fit : pose of the part, the measured one or another that the outline allows
    lit : pictures under lamps, to be compared at that pose
    """

    part: PosedPart
    samples: SurfaceSamples
    checked: CheckedView
    scene: ViewScene
    outline: OutlineResult
    appearance: Appearance | None
    fit: PoseFit
    lit: LitPictures

    @property
    def task(self) -> ViewTask:
        """The view: camera, pose expected, limits."""
        return self.checked.task

    def at(self, fit: PoseFit) -> "ComparedView":
        """Return the pictures with the part at another pose."""
        lit = _lit_pictures(self.part, self.samples, self.checked, self.scene, fit)
        return replace(self, fit=fit, lit=lit)

    def learned(self) -> LearnedView | None:
        """Return the same view of good parts, None where none was learned."""
        if self.appearance is None:
            return None
        return self.appearance.view(self.task.camera, self.fit.T_world_part)

    def judged(self, finish: Finish | None = None) -> ViewResult:
        """Return the view's result: at this pose, or at one that explains more of what is found.

        Parameters
        ----------
        finish : of the part; None to find it in this view
        """
        finish = finish_of(self.lit.polish) if finish is None else finish
        best = self.result(finish, self.learned())
        if not any(f.kind.is_lit for f in best.findings):
            return best
        # what a lit picture shows against one pose, and not against another that the outline allows
        # as well, speaks of the pose and not of the part
        part, task = self.part, self.task
        for pose in poses_as_good(part, task, self.fit, self.checked.outlined.outline):
            if _pose_refusal(pose, *moved(part, task, pose), task.limits):
                continue
            other = self.at(pose)
            result = other.result(finish, other.learned())
            if _explains_more(result, best):
                best = result
            if not best.findings:
                break
        return best

    def result(self, finish: Finish, learned: LearnedView | None) -> ViewResult:
        """Return the result of the pictures if this is the part's pose.

        Parameters
        ----------
        finish : of the part
        learned : the same view of good parts; None for none
        """
        task, fit, outline = self.task, self.fit, self.outline
        shift, turn = moved(self.part, task, fit)
        findings: list[Finding] = list(outline.findings)
        checks: list[Check] = [outline.check]
        codes: list[NDArray[np.uint8]] = []
        for lamp in task.lamps:
            check, differing, code = self.lit.check(lamp.name, finish, learned)
            checks.append(check)
            codes.append(code)
            findings = findings + differing
        free = self.lit.in_sight
        checks = [replace(c, compared=c.compared & free) for c in checks]
        compared = np.logical_or.reduce([c.compared for c in checks])
        x0, y0, _, _ = fit.maps.roi
        return ViewResult(
            view_id=task.view_id,
            evaluated=True,
            reason="",
            T_world_part_expected=task.T_world_part_expected,
            T_world_part_measured=fit.T_world_part,
            shift_mm=shift,
            turn_rad=turn,
            residual_px=fit.residual_px,
            findings=tuple(f for f in findings if f.evidence >= 1.0),
            hints=tuple(f for f in findings if f.evidence < 1.0),
            compared=compared,
            outline_px=mask_contour(fit.maps.mask) + np.array([x0, y0]),
            beside_gripper=self.lit.visible.beside_gripper,
            unobstructed=free,
            checks=tuple(checks),
            unjudged=_best_excuse(codes, free & ~compared),
        )


def compare_view(
    part: PosedPart,
    samples: SurfaceSamples,
    outlined: OutlinedView | NotEvaluated,
    pose: ViewPose | None,
    strictness: Strictness,
) -> ComparedView | NotEvaluated:
    """Return a view's pictures at the part's pose, to be compared there, or why they cannot be.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    outlined : the view, with the outline in its picture before the panel
    pose : of the part; None where no outline was found
    strictness : what a good part may show
    """
    if isinstance(outlined, NotEvaluated):
        return outlined
    checked = check_view(part, outlined, pose, strictness)
    if isinstance(checked, NotEvaluated):
        return checked
    return _to_compare(part, samples, checked, strictness)


def check_view(
    part: PosedPart, outlined: OutlinedView, pose: ViewPose | None, strictness: Strictness
) -> CheckedView | NotEvaluated:
    """Return a view that passed its self-checks at the part's pose, or which one it failed.

    Parameters
    ----------
    part : the CAD model
    outlined, pose, strictness : see `compare_view`
    """
    view, task, limits = outlined.view, outlined.task, outlined.task.limits
    fit = None if pose is None else _as_fit(part, outlined, pose)
    if pose is None or fit is None:
        return NotEvaluated(view, key("no outline of the part where it should be"))
    if task.facts.is_turn_open:
        reason = key("nothing in it shows how far the part is turned about its axis")
        return NotEvaluated(view, reason, pose.T_world_part_measured)
    refusal = _pose_refusal(fit, *moved(part, task, fit), limits)
    if not refusal and pose.is_hidden:
        refusal = _open_refusal(part, task, fit)
    rough_px = ROUGH * float(np.hypot(pose.noise_px, strictness.pose.light_px))
    if not refusal and pose.residual_px > rough_px:
        refusal = say(
            "outline uneven by {residual_px:.2f} px, {rough_px:.2f} px is what "
            "noise and light can do: not this part, or not before the panel",
            residual_px=pose.residual_px,
            rough_px=rough_px,
        )
    sharp = None
    if not refusal and not pose.is_hidden:
        sharp = register(view.pictures.backlit, fit.edge_px, fit.edge_normals)
    if not refusal and sharp is not None and sharp.width_px > limits.max_edge_px:
        refusal = say(
            "edges are {width_px:.1f} px wide, {max_edge_px:.1f} px is "
            "allowed: out of focus, or moved",
            width_px=sharp.width_px,
            max_edge_px=limits.max_edge_px,
        )
    if refusal:
        return NotEvaluated(view, refusal)
    if missing := [lamp.name for lamp in task.lamps if lamp.name not in view.pictures.lit]:
        return NotEvaluated(view, say("no picture under {missing}", missing=missing[0]))
    return CheckedView(outlined, pose, fit, sharp)


def _to_compare(
    part: PosedPart, samples: SurfaceSamples, checked: CheckedView, strictness: Strictness
) -> ComparedView:
    """Return a view's pictures at its measured pose; see `compare_view`."""
    outlined, fit = checked.outlined, checked.fit
    outline = _outline(part, samples, checked, strictness)
    scene = with_measured_holder(
        outlined.scene, outlined.task.camera, fit.maps, outlined.backlit.share
    )
    lit = _lit_pictures(part, samples, checked, scene, fit)
    return ComparedView(
        part, samples, checked, scene, outline, strictness.appearance, fit, lit
    )  # fmt: skip


def _lit_pictures(
    part: PosedPart,
    samples: SurfaceSamples,
    checked: CheckedView,
    scene: ViewScene,
    fit: PoseFit,
) -> LitPictures:
    task, pictures = checked.task, checked.outlined.view.pictures
    scene = before_part(scene, fit.maps, task.camera)
    visible = samples_in_sight(part, samples, task.camera, fit.T_world_part, scene)
    return LitPictures(part, samples, task, scene, fit, visible, checked.sharp, pictures.lit)


def _outline(
    part: PosedPart, samples: SurfaceSamples, checked: CheckedView, strictness: Strictness
) -> OutlineResult:
    pose, outlined = checked.pose, checked.outlined
    if pose.is_hidden:
        nothing = np.zeros(len(samples.points_mm), dtype=bool)
        return OutlineResult([], Check(OUTLINE, "", nothing))
    return compare_outline(
        part, pose, checked.fit.maps, outlined.backlit, outlined.task, samples,
        strictness.allowances, strictness.pose, strictness.view_count,
    )  # fmt: skip


def _as_fit(part: PosedPart, outlined: OutlinedView, pose: ViewPose) -> PoseFit | None:
    """Return a pose with its predicted outline, None where the part is out of the picture."""
    camera = outlined.task.camera
    roi = view_roi(part.solid.mesh.vertices, pose.T_world_part_measured, camera)
    if roi is None:
        return None
    points = pose.rims.points
    mine = pose.judged
    return PoseFit(
        T_world_part=pose.T_world_part_measured,
        residual_px=0.0 if pose.is_hidden else float(np.nanmedian(np.abs(pose.gap_px[mine]))),
        paired=pose.paired,
        maps=render_maps(part.caster, pose.T_world_part_measured, camera, roi),
        edge_px=points.pixels[mine],
        edge_normals=points.normals[mine],
        edge_points_mm=points.points_mm[mine],
        gap_px=pose.gap_px[mine],
        step_mm=points.step_mm,
        covariance=pose.covariance,
    )


def _explains_more(result: ViewResult, best: ViewResult) -> bool:
    """Return True if at least half of the finding area goes, and every check is still made."""
    if len(result.failures) > len(best.failures):
        return False
    left, before = (sum(f.area_mm2 for f in view.findings) for view in (result, best))
    return left <= 0.5 * before


def _pose_refusal(fit: PoseFit, shift: float, turn: float, limits: InspectionLimits) -> str:
    """Return the objection to a fitted pose, empty if there is none."""
    if fit.paired < limits.min_outline_share:
        return say(
            "{paired_percent:.0f} % of the part's outline found, "
            "{min_outline_percent:.0f} % is required: slipped, or another part",
            paired_percent=100 * fit.paired,
            min_outline_percent=100 * limits.min_outline_share,
        )
    if shift > limits.max_shift_mm or turn > limits.max_turn_rad:
        return say(
            "part is {shift:.1f} mm and {degrees:.1f} degrees off its pose in "
            "the gripper: it slipped",
            shift=shift,
            degrees=np.degrees(turn),
        )
    return ""


def _open_refusal(part: PosedPart, task: ViewTask, fit: PoseFit) -> str:
    """Return the objection to a pose that other views leave open, empty if there is none."""
    rows, columns = np.nonzero(fit.maps.mask[::SPREAD_STEP_PX, ::SPREAD_STEP_PX])
    triangles = fit.maps.triangle[::SPREAD_STEP_PX, ::SPREAD_STEP_PX][rows, columns]
    middles = part.solid.mesh.triangles_center[np.unique(triangles)]
    points = transform(fit.T_world_part, np.asarray(middles, np.float64))
    open_px = POSE_SPREADS * float(np.median(point_spread(part, task, fit, points)))
    if open_px <= MAX_OPEN_PX:
        return ""
    return say(
        "no outline of the part shows, and the other views leave its place "
        "open by {open_px:.1f} px, {max_open_px:.1f} px is allowed: show "
        "it in another view of this grasp",
        open_px=open_px,
        max_open_px=MAX_OPEN_PX,
    )


def _best_excuse(codes: Sequence[NDArray[np.uint8]], missing: BoolArray) -> NDArray[np.uint8]:
    """Return the reason for each sample not compared: that of the lamp that came closest."""
    if not codes:
        return np.zeros(len(missing), dtype=np.uint8)
    best = np.maximum.reduce(codes)
    return np.where(missing, best, 0).astype(np.uint8)
