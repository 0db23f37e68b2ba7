"""One view against the CAD: measure the pose, then look for what should not be or is not there.

Two kinds of comparison: the silhouette before the glowing panel (`_outline`), and the brightness
under each lamp (`lit`). Each tells which surface samples it
compared, so that a defect of the smallest size there would have been a finding; samples in sight
that none compared keep the reason. A picture that does not lie where the pose says, or is not
sharp (`_register`), proves nothing and is not evaluated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, cast

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey, IntArray
from controller.cad import SurfaceSamples
from controller.imaging import (
    Camera,
    RayCaster,
    ViewMaps,
    inverse_pose,
    mask_contour,
    render_maps,
    subpixel_contour,
    threshold_levels,
    transform,
)
from controller.recognition.fitting import OutlineMeasure

from ._connected import connected_findings, grow
from ._outline import compare_outline
from ._pose import PosedPart, PoseFit, measure_pose, moved, poses_as_good
from ._register import Registration, register
from ._types import (
    Check,
    Finding,
    Kind,
    Limits,
    Unjudged,
    ViewPictures,
    ViewResult,
    ViewTask,
    WorldBox,
)
from .lit import BURNT_GREY, Compared, Light, Surface, bound_light, compare, find_surface

HOLDER_MARGIN_PX: Final = 9  # the gripper's shape and place are known to about a millimetre
SHADING_STEP_PX: Final = 2  # shading is compared on every second pixel: defects are many px large
MAX_INCIDENCE_COS: Final = float(np.cos(np.radians(75.0)))
LENS_PX: Final = 0.7  # about how a lens blurs
LENS_WIDTH_PX: Final = 0.56  # as `register` measures that
LEAST_NODES: Final = 3  # a difference in shading is at least as wide, on the grid
LEAST_WIDTH_PX: Final = 7.0  # and leaves so much of a defect, the blur of its border taken off
DISC_SHARE: Final = 0.6  # of a defect's disc that must lie on compared pixels


@dataclass(frozen=True, eq=False, slots=True)
class _Scene:
    """What the prediction needs besides the part."""

    holder: RayCaster | None
    holder_mask: BoolArray  # (height, width), grown
    panel: BoolArray  # (height, width), where the panel glows, shrunk


@dataclass(frozen=True, eq=False, slots=True)
class _Visibility:
    """Which samples are in sight, and where; (n,) each, pixels (n, 2)."""

    free: BoolArray
    beside_gripper: BoolArray
    pixels: IntArray


def inspect_view(
    part: PosedPart, samples: SurfaceSamples, task: ViewTask, pictures: ViewPictures
) -> ViewResult:
    """Judge one view of a held part.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    task : the view: camera, pose expected, limits
    pictures : taken while the arm stood still at the view's pose
    """
    scene = _make_scene(task)
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
    if not any(f.kind is Kind.SURFACE for f in best.findings):
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
    scene: _Scene
    dark: BoolArray
    judged: BoolArray
    sharp: Registration | None

    def compare_at(self, fit: PoseFit) -> ViewResult:
        """Return what the pictures tell of the part if this is its pose."""
        part, samples, task, scene = self.part, self.samples, self.task, self.scene
        shift, turn = moved(part, task, fit)
        visible = _in_sight(part, samples, task.camera, fit.T_world_part, scene)
        outline = compare_outline(part, fit, self.dark, self.judged, task, samples)
        findings = outline.findings
        checks = [outline.check]
        codes: list[NDArray[np.uint8]] = []
        if task.lamps:
            shading = _Shading(part, samples, task, scene, fit, visible, self.sharp)
            for lamp in task.lamps:
                picture = self.pictures.lit[lamp.name]
                check, differing, code = shading.check(lamp.name, picture)
                checks.append(check)
                codes.append(code)
                findings = findings + differing
        free = visible.free & ~visible.beside_gripper
        checks = [replace(c, compared=c.compared & free) for c in checks]
        seen = np.logical_or.reduce([c.compared for c in checks])
        x0, y0, _, _ = fit.maps.roi
        return ViewResult(
            view_id=task.view_id,
            evaluated=True,
            reason="",
            T_world_part=fit.T_world_part,
            shift_mm=shift,
            turn_rad=turn,
            residual_px=fit.residual_px,
            findings=tuple(findings),
            seen=seen,
            outline_px=mask_contour(fit.maps.mask) + np.array([x0, y0]),
            beside_gripper=visible.beside_gripper,
            in_sight=free,
            checks=tuple(checks),
            unjudged=_best_excuse(codes, free & ~seen),
        )


def _pose_refusal(fit: PoseFit, shift: float, turn: float, limits: Limits) -> str:
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
        seen=np.zeros(len(samples.points_mm), dtype=bool),
        outline_px=np.zeros((0, 2)),
    )


def box_mesh(boxes: tuple[WorldBox, ...]) -> trimesh.Trimesh:
    """Return the triangles of boxes, one box at least, in the world."""
    meshes = [trimesh.creation.box(extents=2 * box.half_mm, transform=box.T) for box in boxes]
    return cast("trimesh.Trimesh", trimesh.util.concatenate(meshes))


def _make_scene(task: ViewTask) -> _Scene:
    width, height = task.camera.size_px
    holder: RayCaster | None = None
    holder_mask = np.zeros((height, width), dtype=bool)
    if task.holder:
        mesh = box_mesh(task.holder)
        holder = RayCaster(mesh)
        # every fourth pixel is enough under a margin of nine
        maps = render_maps(holder, np.eye(4), task.camera, (0, 0, width, height), step_px=4)
        coarse = np.repeat(np.repeat(maps.mask, 4, axis=0), 4, axis=1)[:height, :width]
        holder_mask = grow(coarse, HOLDER_MARGIN_PX)
    panel = np.zeros((height, width), dtype=np.uint8)
    edges = [
        task.panel_mm[i] + t * (task.panel_mm[(i + 1) % 4] - task.panel_mm[i])
        for i in range(4)
        for t in np.linspace(0, 1, 20, endpoint=False)
    ]
    outline = task.camera.project(np.array(edges))
    cv2.fillPoly(panel, [np.round(outline).astype(np.int32)], 1)
    inner = cv2.erode(panel, np.ones((9, 9), np.uint8), borderValue=1)
    return _Scene(holder, holder_mask, inner > 0)


class _Shading:
    """The lit pictures of one view; what they share is found once."""

    def __init__(
        self,
        part: PosedPart,
        samples: SurfaceSamples,
        task: ViewTask,
        scene: _Scene,
        fit: PoseFit,
        visible: _Visibility,
        sharp: Registration | None,
    ) -> None:
        self._part, self._samples, self._task, self._scene = part, samples, task, scene
        self._fit, self._visibility, self._sharp = fit, visible, sharp
        step = SHADING_STEP_PX
        whole = fit.maps
        x0, y0, x1, y1 = whole.roi
        self._window = (slice(y0, y1, step), slice(x0, x1, step))
        maps = ViewMaps(whole.roi, whole.triangle[::step, ::step], whole.depth_mm[::step, ::step])
        self._surface: Surface = find_surface(part.solid, maps, fit.T_world_part, task.camera, step)
        com = transform(fit.T_world_part, part.solid.centroid_mm[None])[0]
        self._mm = task.camera.mm_per_px(com)
        # only inside the outline: beside it stands whatever stands behind the part
        filled = np.zeros(maps.mask.shape, dtype=np.uint8)
        contours, _ = cv2.findContours(
            maps.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(filled, contours, -1, 1, thickness=cv2.FILLED)
        slack = max(1, round(task.limits.slack_px / step))
        self._inside: BoolArray = ~grow(filled == 0, slack)
        self._unheld: BoolArray = ~scene.holder_mask[self._window]

    def check(
        self, lamp_name: str, picture: Grey
    ) -> tuple[Check, list[Finding], NDArray[np.uint8]]:
        """Return what a lamp's picture compared, what it found, and why not the rest (n,)."""
        task, limits = self._task, self._task.limits
        lamp = next(lamp for lamp in task.lamps if lamp.name == lamp_name)
        light = bound_light(
            self._surface, self._part.caster, self._fit.T_world_part, task.camera, lamp,
            self._scene.holder,
        )  # fmt: skip
        outcome = self._misfit(picture, light) or self._compare(picture, light)
        if isinstance(outcome, str):
            nothing = np.zeros(len(self._samples.points_mm), dtype=bool)
            code = np.where(self._visibility.free, Unjudged.LAMP.number, 0)
            return Check(lamp_name, outcome, nothing), [], code.astype(np.uint8)
        compared, code = self._per_sample(outcome)
        check = Check(lamp_name, "", compared, limits.smallest_defect_mm, misfit=outcome.misfit)
        step = SHADING_STEP_PX
        kernel = np.ones((LEAST_NODES, LEAST_NODES), np.uint8)
        opened = cv2.morphologyEx(outcome.wrong.astype(np.uint8), cv2.MORPH_OPEN, kernel)
        x0, y0, x1, y1 = self._fit.maps.roi
        area = np.where(self._surface.seen, self._surface.area_mm2, np.float32(self._mm**2))
        full, areas = (
            np.repeat(np.repeat(a, step, axis=0), step, axis=1)[: y1 - y0, : x1 - x0]
            for a in (opened > 0, area)
        )
        found = connected_findings(
            full, Kind.SURFACE, lamp_name, self._part, self._fit.maps, task.camera,
            self._fit.T_world_part, (x0, y0), areas, limits.min_area_mm2,
        )  # fmt: skip
        return check, found, code

    def _misfit(self, picture: Grey, light: Light) -> str:
        """Return why a lit picture does not lie on the pose, or is not sharp; empty if it does."""
        limits, fit = self._task.limits, self._fit
        expected = self._expected(picture, light)
        steps = register(picture, fit.edge_px, fit.edge_normals, expected)
        if steps is None:
            return "it shows too little of the part's outline to verify the pose"
        shift = float(np.linalg.norm(steps.shift_px))
        if shift > limits.max_lit_shift_px:
            return (
                f"it is {shift:.1f} px beside the backlit one, "
                f"{limits.max_lit_shift_px:.1f} px is allowed: the part or the camera moved"
            )
        # the expected picture is blurred by a good lens; the backlit one tells how good this one is
        lens = max(self._sharp.width_px - LENS_WIDTH_PX, 0.0) if self._sharp is not None else 0.0
        if steps.growth_px - lens > limits.max_edge_growth_px:
            return (
                f"its edges are {steps.growth_px:.1f} px wider than they should be, "
                f"{lens + limits.max_edge_growth_px:.1f} px is allowed: out of focus, or moved"
            )
        return ""

    def _expected(self, picture: Grey, light: Light) -> Float32Array:
        """Return the whole picture as predicted, to a grey level or ten, (height, width)."""
        step = SHADING_STEP_PX
        whole = self._fit.maps
        x0, y0, x1, y1 = whole.roi
        matt = 0.5 * (light.least + light.most)
        bright = self._surface.seen & (matt > 0.3)
        observed = picture[self._window].astype(np.float32)
        gain = float(np.median(observed[bright] / matt[bright])) if bright.any() else 0.0
        full = np.repeat(np.repeat(matt, step, axis=0), step, axis=1)[: y1 - y0, : x1 - x0]
        out = np.full(picture.shape, _ground_level(picture, whole, self._scene), dtype=np.float32)
        # a node may be seen where the pixel beside it is not: its neighbour's light then
        wide = cv2.dilate(full, np.ones((3, 3), np.uint8))
        lit = gain * np.where(full > 0, full, wide)
        out[y0:y1, x0:x1] = np.where(whole.mask, lit, out[y0:y1, x0:x1])
        return np.asarray(cv2.GaussianBlur(out, (0, 0), LENS_PX), dtype=np.float32)

    def _compare(self, picture: Grey, light: Light) -> Compared | str:
        task, scene, surface = self._task, self._scene, self._surface
        x0, y0, x1, y1 = self._fit.maps.roi
        step = SHADING_STEP_PX
        smooth = cv2.GaussianBlur(picture[y0:y1, x0:x1], (0, 0), 1.0)
        observed = smooth[::step, ::step].astype(np.float32)
        valid = self._unheld & ~grow(light.touched, HOLDER_MARGIN_PX // step + 1)
        return compare(
            observed, surface, light, self._inside, valid,
            _ground_level(picture, self._fit.maps, scene), self._part.solid.faces, task.limits,
            self._flattest,
        )  # fmt: skip

    @property
    def _flattest(self) -> float:
        """Return the cosine below which the smallest defect is too narrow in the picture."""
        return float(LEAST_WIDTH_PX * self._mm / self._task.limits.smallest_defect_mm)

    def _per_sample(self, outcome: Compared) -> tuple[BoolArray, NDArray[np.uint8]]:
        """Return which samples a picture compared (n,), and why not the others (n,)."""
        disc_px = self._task.limits.smallest_defect_mm / self._mm / SHADING_STEP_PX
        size = max(1, round(disc_px)) | 1
        share = cv2.blur(outcome.compared.astype(np.float32), (size, size))
        x0, y0, _, _ = self._fit.maps.roi
        u, v = ((self._visibility.pixels - [x0, y0]) // SHADING_STEP_PX).T
        height, width = outcome.compared.shape
        inside = self._visibility.free & (u >= 0) & (v >= 0) & (u < width) & (v < height)
        compared = np.zeros(len(u), dtype=bool)
        code = np.zeros(len(u), dtype=np.uint8)
        v, u = v[inside], u[inside]
        whole = outcome.compared[v, u] & (share[v, u] >= DISC_SHARE)
        compared[inside] = whole & (self._flattest < 1.0)
        edge = Unjudged.EDGE.number
        reason = outcome.reason[v, u]
        code[inside] = np.where(whole, 0, np.where(reason == 0, edge, reason))
        return compared, code


def _ground_level(picture: Grey, maps: ViewMaps, scene: _Scene) -> float:
    """Return how bright the wall behind the part is under a lamp, where no shadow falls."""
    clear = scene.panel & ~scene.holder_mask
    x0, y0, x1, y1 = maps.roi
    clear[y0:y1, x0:x1] = False
    values = picture[clear]
    return float(np.quantile(values[::7], 0.9)) if len(values) > 700 else 255.0


def _in_sight(
    part: PosedPart, samples: SurfaceSamples, camera: Camera, T: FloatArray, scene: _Scene
) -> _Visibility:
    """Return which surface samples are in sight, and which of them beside the gripper."""
    points = transform(T, samples.points_mm)
    normals = samples.normals @ T[:3, :3].T
    towards = camera.position_mm - points
    distance = np.linalg.norm(towards, axis=1)
    unit = towards / distance[:, None]
    seen: BoolArray = (unit * normals).sum(axis=1) > MAX_INCIDENCE_COS
    pixels = np.round(camera.project(points)).astype(int)
    width, height = camera.size_px
    seen &= (pixels[:, 0] >= 0) & (pixels[:, 0] < width)
    seen &= (pixels[:, 1] >= 0) & (pixels[:, 1] < height)
    start = points + 0.05 * normals
    T_part_world = inverse_pose(T)
    index = np.nonzero(seen)[0]
    hidden = part.caster.blocked(transform(T_part_world, start[index]), unit[index] @ T[:3, :3])
    if scene.holder is not None:
        hidden |= scene.holder.blocked(start[index], unit[index])
    seen[index[hidden]] = False
    x, y = np.clip(pixels, 0, [width - 1, height - 1]).T
    return _Visibility(seen, seen & scene.holder_mask[y, x], pixels)
