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

from ._holder import with_measured_holder
from ._pose import (
    MEASURED_HOLD,
    PLANNED_HOLD,
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
    ViewPictures,
    ViewResult,
    ViewTask,
)
from .grasp_pose import (
    Backlit,
    GraspPose,
    OutlineView,
    PoseSettings,
    ViewPose,
    backlit_outline,
    fit_grasp,
)
from .integrity import Allowances, OutlineResult, compare_outline
from .lit import BURNT_GREY, MIN_WIDTH_PX, Appearance, LearnedView, LitPictures, gloss_of
from .registration import Registration, register

OPEN_SPREADS: Final = 2.0  # standard deviations of a pose that no outline shows
# What they may be in the picture: half the width that a defect must have to be seen.
MAX_OPEN_PX: Final = 0.5 * MIN_WIDTH_PX
SPREAD_STEP_PX: Final = 8  # distance between pixels whose surface is asked
NEAR_SHARE: Final = 0.9  # share of the outline found in its place
ROUGH: Final = 3.0  # standard deviations of noise and light: the unevenness allowed of an outline


@dataclass(frozen=True, eq=False, slots=True)
class SeenView:
    """A view's picture before the panel, and the scene in it.

    Attributes
    ----------
    scene : what stands there besides the part
    backlit : its outline; None where the picture proves nothing
    reason : why it does not; empty where it does
    """

    scene: ViewScene
    backlit: Backlit | None
    reason: str


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


def see_view(task: ViewTask, pictures: ViewPictures) -> SeenView:
    """Return the outline in a view's picture before the panel, or the reason for none."""
    scene = make_scene(task)
    limits = task.limits
    low, _, high = levels = threshold_levels(pictures.backlit, scene.panel)
    if high - low < limits.min_contrast:
        return SeenView(
            scene,
            None,
            f"backlight contrast {high - low:.0f} grey levels, {limits.min_contrast:.0f} "
            "are required: is the panel's lamp on?",
        )
    burnt = float((pictures.backlit[scene.panel] >= BURNT_GREY).mean())
    if burnt > limits.max_burnt_share:
        return SeenView(
            scene,
            None,
            f"{100 * burnt:.0f} % of the panel are burnt out: its edges are not true",
        )
    return SeenView(scene, backlit_outline(pictures.backlit, scene, levels), "")


def outline_view(
    task: ViewTask, seen: SeenView, prior_mm: float, prior_rad: float
) -> OutlineView | None:
    """Return a view's data for the pose, None where its picture proves nothing.

    Parameters
    ----------
    task : the view
    seen : its picture before the panel
    prior_mm, prior_rad : standard deviations of the pose expected
    """
    if seen.backlit is None:
        return None
    return OutlineView(
        task.view_id,
        task.camera,
        task.T_world_part,
        seen.backlit.outline,
        seen.backlit.noise_px,
        prior_mm,
        prior_rad,
    )


@dataclass(frozen=True, eq=False, slots=True)
class LocatedView:
    """Pose of a part by one view alone, for the arm.

    Attributes
    ----------
    seen : what stands in its picture before the panel
    stand : how the part stands in it
    """

    seen: SeenView
    stand: "Stand"

    @property
    def reason(self) -> str:
        """Reason why the view is not evaluated; empty where it is."""
        return self.stand.reason

    @property
    def T_world_part(self) -> FloatArray | None:
        """The measured pose (4, 4), None where the view is not evaluated."""
        return None if self.stand.fit is None else self.stand.fit.T_world_part


def locate_view(part: PosedPart, task: ViewTask, pictures: ViewPictures) -> LocatedView:
    """Return the pose of a held part in one view; nothing is compared yet.

    Parameters
    ----------
    part : the CAD model
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose; of lit ones only which there are
    """
    seen = see_view(task, pictures)
    own = outline_view(task, seen, *(MEASURED_HOLD if task.is_hold_measured else PLANNED_HOLD))
    strictness = Strictness()
    grasp = None if own is None else fit_grasp(part, [own], strictness.pose)
    if own is not None and task.is_hold_measured and not _is_near(grasp):
        # the view that measured the hold may have known it badly
        own = outline_view(task, seen, *PLANNED_HOLD)
        assert own is not None
        grasp = fit_grasp(part, [own], strictness.pose)
    pose = None if grasp is None else grasp.views[0]
    return LocatedView(seen, _stand_of(part, task, pictures, seen, pose, strictness))


def inspect_view(
    part: PosedPart,
    samples: SurfaceSamples,
    task: ViewTask,
    pictures: ViewPictures,
    located: LocatedView | None = None,
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
    seen, stand = located.seen, located.stand
    return _judged(_at_stand(part, samples, task, pictures, seen, stand, Strictness()))


def _is_near(grasp: GraspPose | None) -> bool:
    return grasp is not None and grasp.views[0].paired >= NEAR_SHARE


@dataclass(frozen=True, eq=False, slots=True)
class PosedPictures:
    """Pictures of a view with the part at one pose, to be compared there.

    Attributes
    ----------
    view : pictures and models, for any pose
    fit : pose of the part, with the outline predicted there
    lit : pictures under lamps, to be compared
    """

    view: "_View"
    fit: PoseFit
    lit: LitPictures

    @property
    def task(self) -> ViewTask:
        """The view."""
        return self.view.task

    def judged(self, gloss: float | None = None) -> ViewResult:
        """Return the view's result: at this pose, or at one that explains more of what is found.

        Parameters
        ----------
        gloss : highest possible polish of the finish, from 0 to 1; None to find it in this view
        """
        view = self.view
        gloss = gloss_of(self.lit.polish) if gloss is None else gloss
        best = self.result(gloss, view.learned_at(self.fit))
        if not any(f.kind.is_lit for f in best.findings):
            return best
        # what a lit picture shows against one pose, and not against another that the outline allows
        # as well, speaks of the pose and not of the part
        for other in poses_as_good(view.part, view.task, self.fit, view.backlit.outline):
            if _pose_refusal(other, *moved(view.part, view.task, other), view.task.limits):
                continue
            result = view.at(other).result(gloss, view.learned_at(other))
            if _explains_more(result, best):
                best = result
            if not best.findings:
                break
        return best

    def result(self, gloss: float, learned: LearnedView | None) -> ViewResult:
        """Return the result of the pictures if this is the part's pose.

        Parameters
        ----------
        gloss : highest possible polish of the finish, from 0 to 1
        learned : the same view of good parts; None for none
        """
        task, fit, outline = self.task, self.fit, self.view.outline
        shift, turn = moved(self.view.part, task, fit)
        findings: list[Finding] = list(outline.findings)
        checks: list[Check] = [outline.check]
        codes: list[NDArray[np.uint8]] = []
        for lamp in task.lamps:
            check, differing, code = self.lit.check(lamp.name, gloss, learned)
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
            T_world_part=fit.T_world_part,
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
    task: ViewTask,
    pictures: ViewPictures,
    seen: SeenView,
    pose: ViewPose | None,
    strictness: Strictness,
) -> ViewResult:
    """Return a view's result on a part of known pose: findings, and samples compared.

    Parameters
    ----------
    part, samples, task, pictures, seen, pose, strictness : see `posed_pictures`
    """
    return _judged(posed_pictures(part, samples, task, pictures, seen, pose, strictness))


def posed_pictures(
    part: PosedPart,
    samples: SurfaceSamples,
    task: ViewTask,
    pictures: ViewPictures,
    seen: SeenView,
    pose: ViewPose | None,
    strictness: Strictness,
) -> PosedPictures | ViewResult:
    """Return a view's pictures at the part's pose, or the result of one that is not evaluated.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose
    seen : its picture before the panel
    pose : of the part; None where no outline was found
    strictness : what a good part may show
    """
    stand = _stand_of(part, task, pictures, seen, pose, strictness)
    return _at_stand(part, samples, task, pictures, seen, stand, strictness)


def _judged(pictures: PosedPictures | ViewResult) -> ViewResult:
    return pictures if isinstance(pictures, ViewResult) else pictures.judged()


@dataclass(frozen=True, eq=False, slots=True)
class Stand:
    """Pose of a part in a view, or the reason why the view is not evaluated.

    Attributes
    ----------
    reason : why it is not; empty where it is
    pose, fit, sharp : of the part, what it predicts, how sharp the picture is; None without
    """

    reason: str
    pose: ViewPose | None = None
    fit: PoseFit | None = None
    sharp: Registration | None = None


def _stand_of(
    part: PosedPart,
    task: ViewTask,
    pictures: ViewPictures,
    seen: SeenView,
    pose: ViewPose | None,
    strictness: Strictness,
) -> Stand:
    """Return the stand of a part in a view; see `posed_pictures`."""
    limits = task.limits
    if seen.backlit is None:
        return Stand(seen.reason)
    fit = None if pose is None else _as_fit(part, task, seen.backlit, pose)
    if pose is None or fit is None:
        return Stand("no outline of the part where it should be")
    refusal = _pose_refusal(fit, *moved(part, task, fit), limits)
    if not refusal and pose.is_hidden:
        refusal = _open_refusal(part, task, fit)
    rough_px = ROUGH * float(np.hypot(pose.noise_px, strictness.pose.light_px))
    if not refusal and pose.residual_px > rough_px:
        refusal = (
            f"outline uneven by {pose.residual_px:.2f} px, {rough_px:.2f} px is what noise and "
            "light can do: not this part, or not before the panel"
        )
    sharp = None
    if not refusal and not pose.is_hidden:
        sharp = register(pictures.backlit, fit.edge_px, fit.edge_normals)
    if not refusal and sharp is not None and sharp.width_px > limits.max_edge_px:
        refusal = (
            f"edges are {sharp.width_px:.1f} px wide, {limits.max_edge_px:.1f} px is allowed: out "
            "of focus, or moved"
        )
    if refusal:
        return Stand(refusal)
    if missing := [lamp.name for lamp in task.lamps if lamp.name not in pictures.lit]:
        return Stand(f"no picture under {missing[0]}")
    return Stand("", pose, fit, sharp)


def _at_stand(
    part: PosedPart,
    samples: SurfaceSamples,
    task: ViewTask,
    pictures: ViewPictures,
    seen: SeenView,
    stand: Stand,
    strictness: Strictness,
) -> PosedPictures | ViewResult:
    """Return a view's pictures with the part at a stand; see `posed_pictures`."""
    pose, fit, backlit = stand.pose, stand.fit, seen.backlit
    if stand.reason or backlit is None or pose is None or fit is None:
        return _not_evaluated(task, samples, stand.reason)
    outline = _outline(part, samples, task, backlit, pose, fit, strictness)
    scene = with_measured_holder(seen.scene, task.camera, fit.maps, backlit.share)
    appearance = strictness.appearance
    view = _View(
        part, samples, task, pictures, backlit, scene, stand.sharp, outline, appearance
    )  # fmt: skip
    return view.at(fit)


def _outline(
    part: PosedPart,
    samples: SurfaceSamples,
    task: ViewTask,
    backlit: Backlit,
    pose: ViewPose,
    fit: PoseFit,
    strictness: Strictness,
) -> OutlineResult:
    if pose.is_hidden:
        nothing = np.zeros(len(samples.points_mm), dtype=bool)
        return OutlineResult([], Check(OUTLINE, "", nothing))
    return compare_outline(
        part, pose, fit.maps, backlit, task, samples, strictness.allowances, strictness.pose,
        strictness.view_count,
    )  # fmt: skip


def _as_fit(part: PosedPart, task: ViewTask, backlit: Backlit, pose: ViewPose) -> PoseFit | None:
    """Return a pose with its predicted outline, None where the part is out of the picture."""
    roi = view_roi(part.solid.mesh.vertices, pose.T_world_part, task.camera)
    if roi is None:
        return None
    points = pose.rims.points
    mine = pose.judged
    return PoseFit(
        T_world_part=pose.T_world_part,
        residual_px=0.0 if pose.is_hidden else float(np.nanmedian(np.abs(pose.gap_px[mine]))),
        paired=pose.paired,
        maps=render_maps(part.caster, pose.T_world_part, task.camera, roi),
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


@dataclass(frozen=True, eq=False, slots=True)
class _View:
    """One view's pictures and the models they are compared with, for any pose of the part."""

    part: PosedPart
    samples: SurfaceSamples
    task: ViewTask
    pictures: ViewPictures
    backlit: Backlit
    scene: ViewScene
    sharp: Registration | None
    outline: OutlineResult
    appearance: Appearance | None

    def at(self, fit: PoseFit) -> PosedPictures:
        """Return the pictures with the part at a pose."""
        part, samples, task = self.part, self.samples, self.task
        scene = before_part(self.scene, fit.maps, task.camera)
        visible = samples_in_sight(part, samples, task.camera, fit.T_world_part, scene)
        lit = LitPictures(part, samples, task, scene, fit, visible, self.sharp, self.pictures.lit)
        return PosedPictures(self, fit, lit)

    def learned_at(self, fit: PoseFit) -> LearnedView | None:
        """Return the same view of good parts, None where none was learned."""
        if self.appearance is None:
            return None
        return self.appearance.view(self.task.camera, fit.T_world_part)


def _pose_refusal(fit: PoseFit, shift: float, turn: float, limits: InspectionLimits) -> str:
    """Return the objection to a fitted pose, empty if there is none."""
    if fit.paired < limits.min_outline_share:
        return (
            f"{100 * fit.paired:.0f} % of the part's outline found, "
            f"{100 * limits.min_outline_share:.0f} % is required: slipped, or another part"
        )
    if shift > limits.max_shift_mm or turn > limits.max_turn_rad:
        return (
            f"part is {shift:.1f} mm and {np.degrees(turn):.1f} degrees off its pose in the "
            "gripper: it slipped"
        )
    return ""


def _open_refusal(part: PosedPart, task: ViewTask, fit: PoseFit) -> str:
    """Return the objection to a pose that other views leave open, empty if there is none."""
    rows, columns = np.nonzero(fit.maps.mask[::SPREAD_STEP_PX, ::SPREAD_STEP_PX])
    triangles = fit.maps.triangle[::SPREAD_STEP_PX, ::SPREAD_STEP_PX][rows, columns]
    middles = part.solid.mesh.triangles_center[np.unique(triangles)]
    points = transform(fit.T_world_part, np.asarray(middles, np.float64))
    open_px = OPEN_SPREADS * float(np.median(point_spread(part, task, fit, points)))
    if open_px <= MAX_OPEN_PX:
        return ""
    return (
        f"no outline of the part shows, and the other views leave its place open by {open_px:.1f} "
        f"px, {MAX_OPEN_PX:.1f} px is allowed: show it in another view of this grasp"
    )


def _best_excuse(codes: Sequence[NDArray[np.uint8]], missing: BoolArray) -> NDArray[np.uint8]:
    """Return the reason for each sample not compared: that of the lamp that came closest."""
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
