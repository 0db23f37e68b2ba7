"""One view against the CAD: measure the pose, then look for what should not be or is not there.

Three comparisons, from sure to less sure: the silhouette before the glowing panel (material
missing or too much, holes that should let the light through), and the shading under each lamp on
plane surfaces, in bores and through them (a filled hole, a missing pocket). Each is made with
`slack_px` of play and only where the prediction is trustworthy: not where the gripper, its
shadow, or a curved highlight is. A view that fails its self-checks is not evaluated.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from controller.cad import (
    Camera,
    RayCaster,
    SurfaceSamples,
    ViewMaps,
    inverse_pose,
    predict_light,
    render_maps,
    transform,
)
from controller.recognition import (
    Contour,
    PosedPart,
    mask_contour,
    subpixel_contour,
    threshold_levels,
)
from controller.recognition import fit_pose as fit_outline

from ._types import Finding, Kind, Mask, ViewPictures, ViewResult, ViewTask, WorldBox

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]

HOLDER_MARGIN_PX = 9  # the hand's shape and place are known to about a millimetre
SHADING_STEP_PX = 2  # shading is compared on every second pixel: defects are many pixels large
PLANNED_HOLD = (1.5, 0.03)  # [mm, rad] how far a fresh grip may be from the planned one
SEEN_HOLD = (0.3, 0.005)  # the same once a view has measured it
HIGHLIGHT = 2.0  # of a matt surface square to the lamp
MAX_INCIDENCE_COS = np.cos(np.radians(75.0))


@dataclass(frozen=True, eq=False, slots=True)
class _Scene:
    """What the prediction needs besides the part."""

    holder: RayCaster | None
    holder_mask: Mask  # (height, width), grown
    panel: Mask  # (height, width), where the panel glows, shrunk


def inspect_view(
    part: PosedPart, samples: SurfaceSamples, task: ViewTask, pictures: ViewPictures
) -> ViewResult:
    """Judge one view of a held part.

    Parameters
    ----------
    part, samples : the CAD model and its surface samples
    pictures : taken while the arm stood still at the view's pose
    """
    scene = _make_scene(task)
    low, level, high = threshold_levels(pictures.backlit, scene.panel)
    if high - low < task.limits.min_contrast:
        return _not_evaluated(
            task,
            samples,
            f"backlight contrast {high - low:.0f} grey levels, {task.limits.min_contrast:.0f} "
            "are asked: is the panel's lamp on?",
        )
    dark = (pictures.backlit < level) & scene.panel
    dark_part = dark & ~scene.holder_mask
    contour = subpixel_contour(pictures.backlit, dark, level)
    contour = _outside(contour, scene.holder_mask | ~scene.panel)
    prior_mm, prior_rad = SEEN_HOLD if task.is_hold_seen else PLANNED_HOLD
    fit = fit_outline(
        part,
        task.T_world_part,
        task.camera,
        contour,
        ignore=scene.holder_mask,
        prior_mm=prior_mm,
        prior_rad=prior_rad,
    )
    if fit is None:
        return _not_evaluated(task, samples, "no outline of the part where it should be")
    moved = fit.T_world_part @ inverse_pose(task.T_world_part)
    turn = float(np.arccos(np.clip((np.trace(moved[:3, :3]) - 1) / 2, -1.0, 1.0)))
    com = part.solid.centroid_mm[None]
    shift = float(
        np.linalg.norm(transform(fit.T_world_part, com) - transform(task.T_world_part, com))
    )
    limits = task.limits
    if fit.residual_px > limits.max_residual_px:
        return _not_evaluated(
            task,
            samples,
            f"outline off by {fit.residual_px:.2f} px, {limits.max_residual_px:.2f} px is allowed: "
            "not this part, or not this pose",
        )
    if fit.paired < limits.min_outline_share:
        return _not_evaluated(
            task,
            samples,
            f"{100 * fit.paired:.0f} % of the part's outline found, "
            f"{100 * limits.min_outline_share:.0f} % is asked: it slipped, or is another part",
        )
    if shift > limits.max_shift_mm or turn > limits.max_turn_rad:
        return _not_evaluated(
            task,
            samples,
            f"part lies {shift:.1f} mm and {np.degrees(turn):.1f} degrees from where the jaws "
            "should hold it: it slipped",
        )
    findings = [*_silhouette(part, fit.maps, dark_part, scene, task, fit.T_world_part)]
    for lamp in task.lamps:
        picture = pictures.lit.get(lamp.name)
        if picture is None:
            return _not_evaluated(task, samples, f"no picture under {lamp.name}")
        differing = _shading(part, fit.maps, scene, task, fit.T_world_part, lamp.name, picture)
        if differing is None:
            return _not_evaluated(task, samples, f"{lamp.name} gives no light: is the lamp on?")
        findings += differing
    seen, beside_hand = _seen(part, samples, task.camera, fit.T_world_part, scene)
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
        beside_hand=beside_hand,
        outline_px=mask_contour(fit.maps.mask) + np.array([x0, y0]),
    )


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


def _box_mesh(boxes: tuple[WorldBox, ...]) -> trimesh.Trimesh:
    return trimesh.util.concatenate(
        [trimesh.creation.box(extents=2 * box.half_mm, transform=box.T) for box in boxes]
    )


def _grow(mask: Mask, px: int) -> Mask:
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * px + 1, 2 * px + 1))
    grown: Mask = cv2.dilate(mask.astype(np.uint8), kernel) > 0
    return grown


def _make_scene(task: ViewTask) -> _Scene:
    width, height = task.camera.size_px
    holder: RayCaster | None = None
    holder_mask = np.zeros((height, width), dtype=bool)
    if task.holder:
        mesh = _box_mesh(task.holder)
        holder = RayCaster(mesh)
        # every fourth pixel is enough under a margin of nine
        maps = render_maps(holder, np.eye(4), task.camera, (0, 0, width, height), step_px=4)
        coarse = np.repeat(np.repeat(maps.mask, 4, axis=0), 4, axis=1)[:height, :width]
        holder_mask = _grow(coarse, HOLDER_MARGIN_PX)
    panel = np.zeros((height, width), dtype=np.uint8)
    edges = [
        task.panel_mm[i] + t * (task.panel_mm[(i + 1) % 4] - task.panel_mm[i])
        for i in range(4)
        for t in np.linspace(0, 1, 20, endpoint=False)
    ]
    outline = task.camera.project(np.array(edges))
    cv2.fillPoly(panel, [np.round(outline).astype(np.int32)], 1)
    panel = cv2.erode(panel, np.ones((9, 9), np.uint8), borderValue=1)
    return _Scene(holder, holder_mask, panel > 0)


def _outside(contour: Contour, forbidden: Mask) -> Contour:
    height, width = forbidden.shape
    x = np.clip(np.round(contour.points_px[:, 0]).astype(int), 0, width - 1)
    y = np.clip(np.round(contour.points_px[:, 1]).astype(int), 0, height - 1)
    keep = ~forbidden[y, x]
    return Contour(contour.points_px[keep], contour.normals[keep])


def _silhouette(
    part: PosedPart, maps: ViewMaps, dark: Mask, scene: _Scene, task: ViewTask, T: Array
) -> list[Finding]:
    """Compare silhouettes; the gripper's part of the picture says nothing."""
    margin = 40
    x0, y0 = max(maps.roi[0] - margin, 0), max(maps.roi[1] - margin, 0)
    x1 = min(maps.roi[2] + margin, task.camera.size_px[0])
    y1 = min(maps.roi[3] + margin, task.camera.size_px[1])
    expected = np.zeros((y1 - y0, x1 - x0), dtype=bool)
    expected[maps.roi[1] - y0 : maps.roi[3] - y0, maps.roi[0] - x0 : maps.roi[2] - x0] = maps.mask
    window = (slice(y0, y1), slice(x0, x1))
    valid = scene.panel[window] & ~scene.holder_mask[window]
    observed = dark[window]
    slack = task.limits.slack_px
    sure_part = ~_grow(~expected, slack)
    sure_ground = ~_grow(expected, slack)
    # Where hand and part overlap in the picture no ground is left to compare with
    found = _blobs(
        sure_part & ~observed & valid, Kind.MISSING, "backlit", part, maps, task, T, (x0, y0)
    )
    found += _blobs(
        sure_ground & observed & valid, Kind.EXTRA, "backlit", part, maps, task, T, (x0, y0)
    )
    return found


def _shading(
    part: PosedPart,
    maps: ViewMaps,
    scene: _Scene,
    task: ViewTask,
    T: Array,
    lamp_name: str,
    picture: Grey,
) -> list[Finding] | None:
    """Compare grey levels on plane faces, in bores and through them.

    Nothing is found where the lamp lights nothing that is seen; None where it ought to and does
    not, since then a silence would be no proof.
    """
    whole = maps
    maps = ViewMaps(
        whole.roi,
        whole.triangle[::SHADING_STEP_PX, ::SHADING_STEP_PX],
        whole.depth_mm[::SHADING_STEP_PX, ::SHADING_STEP_PX],
    )
    lamp = next(lamp for lamp in task.lamps if lamp.name == lamp_name)
    x0, y0, x1, y1 = maps.roi
    window = (slice(y0, y1, SHADING_STEP_PX), slice(x0, x1, SHADING_STEP_PX))
    solid, limits = part.solid, task.limits
    slack = max(1, round(limits.slack_px / SHADING_STEP_PX))
    predicted, shaded = predict_light(
        solid.mesh, part.caster, maps, T, task.camera, lamp, scene.holder, SHADING_STEP_PX
    )
    valid = ~scene.holder_mask[window]
    valid &= ~_grow(shaded, HOLDER_MARGIN_PX // SHADING_STEP_PX + 1)
    face = np.where(maps.mask, solid.face_of_triangle[maps.triangle], -1)
    trusted = np.array([f.kind == "plane" or (f.kind == "cylinder" and f.concave)
                        for f in solid.faces])  # fmt: skip
    valid &= ~_grow(maps.mask & ~trusted[face], slack)
    # only inside the outline: beside it stands whatever stands behind the part
    outline = np.zeros(maps.mask.shape, dtype=np.uint8)
    contours, _ = cv2.findContours(
        maps.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    cv2.drawContours(outline, contours, -1, 1, thickness=cv2.FILLED)
    valid &= ~_grow(outline == 0, slack)
    observed = cv2.GaussianBlur(picture[y0:y1, x0:x1], (0, 0), 1.0)
    observed = observed[::SHADING_STEP_PX, ::SHADING_STEP_PX].astype(np.float32)
    expected = cv2.GaussianBlur(predicted, (0, 0), 0.7)
    bright = valid & maps.mask & (predicted > 0.25)
    if bright.sum() < 150:
        return []
    gain = float(np.median(observed[bright] / expected[bright]))
    if gain < limits.min_contrast / 2:
        return None
    gains = np.full(len(solid.faces) + 1, gain, dtype=np.float32)
    for face_id in np.unique(face[bright]):
        here = bright & (face == face_id)
        # a plane may throw the lamp's highlight back: its own brightness is its reference
        if solid.faces[face_id].kind == "plane" and here.sum() > 200:
            ratio = float(np.median(observed[here] / expected[here]))
            gains[face_id] = np.clip(ratio, 0.4 * gain, 2.5 * gain)
    scaled = expected * gains[face]
    # through a hole the wall behind is seen, lit or in the part's shadow
    ground = _ground_level(picture, whole, scene)
    kernel = np.ones((2 * slack + 1,) * 2, np.uint8)
    # a curved wall throws the lamp's highlight back somewhere: there, too bright means nothing
    curved = np.array([f.kind != "plane" for f in solid.faces] + [False])
    most = np.where(curved[face], np.maximum(scaled, HIGHLIGHT * gain), scaled)
    brightest = cv2.dilate(np.where(maps.mask, most, ground).astype(np.float32), kernel)
    darkest = cv2.erode(np.where(maps.mask, scaled, np.float32(0)), kernel)
    play = np.maximum(limits.grey_levels, limits.grey_share * brightest)
    wrong = valid & ((observed > brightest + play) | (observed < darkest - play))
    full = np.repeat(np.repeat(wrong, SHADING_STEP_PX, axis=0), SHADING_STEP_PX, axis=1)
    full = full[: y1 - y0, : x1 - x0]
    return _blobs(full, Kind.SURFACE, lamp_name, part, whole, task, T, (x0, y0))


def _ground_level(picture: Grey, maps: ViewMaps, scene: _Scene) -> float:
    """Return how bright the wall behind the part is under a lamp, where no shadow falls."""
    clear = scene.panel & ~scene.holder_mask
    x0, y0, x1, y1 = maps.roi
    clear[y0:y1, x0:x1] = False
    values = picture[clear]
    return float(np.quantile(values[::7], 0.9)) if len(values) > 700 else 255.0


def _blobs(
    wrong: Mask,
    kind: Kind,
    lamp: str,
    part: PosedPart,
    maps: ViewMaps,
    task: ViewTask,
    T: Array,
    corner: tuple[int, int],
) -> list[Finding]:
    """Return differences large enough to matter; `corner` is the window's in the picture."""
    com = transform(T, part.solid.centroid_mm[None])[0]
    mm = task.camera.mm_per_px(com)
    radius = max(1, round(0.12 * task.limits.smallest_defect_mm / mm))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    opened = cv2.morphologyEx(wrong.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    count, labels, stats, centres = cv2.connectedComponentsWithStats(opened, connectivity=8)
    found = []
    for i in range(1, count):
        x, y, w, h, area = (int(v) for v in stats[i])
        area_mm2 = area * mm**2
        if area_mm2 < task.limits.min_area_mm2:
            continue
        at = (float(centres[i][0] + corner[0]), float(centres[i][1] + corner[1]))
        point, faces = _nearest_on_part(part, maps, task.camera, T, labels == i, corner)
        found.append(
            Finding(
                kind=kind,
                lamp=lamp,
                area_mm2=area_mm2,
                size_mm=float(np.hypot(w, h) * mm),
                at_px=at,
                box_px=(x + corner[0], y + corner[1], x + w + corner[0], y + h + corner[1]),
                p_part_mm=point,
                face_ids=faces,
            )
        )
    return found


def _nearest_on_part(
    part: PosedPart, maps: ViewMaps, camera: Camera, T: Array, blob: Mask, corner: tuple[int, int]
) -> tuple[Array, tuple[int, ...]]:
    ys, xs = np.nonzero(_grow(blob, 5))
    u = xs + corner[0] - maps.roi[0]
    v = ys + corner[1] - maps.roi[1]
    height, width = maps.mask.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    u, v = u[inside], v[inside]
    on = maps.mask[v, u] if len(u) else np.zeros(0, dtype=bool)
    if not on.any():
        rows, columns = np.nonzero(maps.mask)
        middle = np.array(
            [xs.mean() + corner[0] - maps.roi[0], ys.mean() + corner[1] - maps.roi[1]]
        )
        nearest = int(np.argmin((columns - middle[0]) ** 2 + (rows - middle[1]) ** 2))
        u, v = columns[nearest : nearest + 1], rows[nearest : nearest + 1]
    else:
        u, v = u[on], v[on]
    lines = camera.sight_line_table[v + maps.roi[1], u + maps.roi[0]].astype(np.float64)
    points = camera.position_mm + lines * maps.depth_mm[v, u][:, None]
    ids, counts = np.unique(part.solid.face_of_triangle[maps.triangle[v, u]], return_counts=True)
    order = np.argsort(-counts)
    shares = counts[order] / counts.sum()
    named = tuple(int(i) for i in ids[order][shares > 0.2]) or (int(ids[order][0]),)
    return transform(inverse_pose(T), np.median(points, axis=0)[None])[0], named


def _seen(
    part: PosedPart, samples: SurfaceSamples, camera: Camera, T: Array, scene: _Scene
) -> tuple[Mask, Mask]:
    """Return which surface samples are compared, (n,), and which are in sight beside the hand."""
    points = transform(T, samples.points_mm)
    normals = samples.normals @ T[:3, :3].T
    towards = camera.position_mm - points
    distance = np.linalg.norm(towards, axis=1)
    unit = towards / distance[:, None]
    seen: Mask = (unit * normals).sum(axis=1) > MAX_INCIDENCE_COS
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
    beside = seen & scene.holder_mask[y, x]
    return seen & ~beside, beside  # what is not compared has not been seen
