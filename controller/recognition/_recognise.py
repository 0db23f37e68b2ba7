"""Which part, which way up, where: silhouettes first, grey levels where silhouettes cannot decide.

The order is the paper's section 3.1: size features cut the list of candidates, the outline fixes
the turn and the place, and what remains is told apart by what lies inside the outline.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.cad import (
    CadError,
    Camera,
    PointLamp,
    RayCaster,
    Solid,
    StablePose,
    SurfaceSamples,
    inverse_pose,
    predict_radiance,
    render_maps,
    sample_surface,
    stable_poses,
    transform,
    view_roi,
)
from controller.cad.compiled import CompiledPart

from ._contours import Contour, subpixel_contour, threshold_levels
from ._pose_fit import PosedPart, PoseFit, fit_pose
from ._signature import Signature, best_turns, signature, turn_scores

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Grey = NDArray[np.uint8]

SAME_MM = 0.6  # surfaces this close are one: coarser than any fit, finer than any feature


@dataclass(frozen=True, slots=True)
class Limits:
    """Tolerances of recognition, each with its reason.

    Attributes
    ----------
    min_area_mm2 : smaller dark spots are chips and dust, not parts
    area_ratio : a silhouette off by more than this share of area is another view; perspective
        changes it by about 6 % over the table
    coarse_score : overlap of polar grids below which two outlines are different things
    min_iou, max_residual_px : a fit worse than this is no match
    near_iou, near_residual_px : hypotheses this close to the best are as good as it
    near_grey : grey-level scores this close to the best do not decide
    """

    min_area_mm2: float = 80.0
    area_ratio: float = 0.30
    coarse_score: float = 0.84
    min_iou: float = 0.95
    max_residual_px: float = 1.0
    near_iou: float = 0.012
    near_residual_px: float = 0.35
    near_grey: float = 0.03
    max_hypotheses: int = 12


@dataclass(frozen=True, eq=False, slots=True)
class CatalogueEntry:
    """One part that may lie on the table, with its ways to lie and their silhouettes."""

    solid: Solid
    poses: tuple[StablePose, ...]
    caster: RayCaster
    samples: SurfaceSamples
    signatures: tuple[Signature, ...]


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another reading of a sighting that the pictures do not rule out."""

    part: str
    pose_index: int
    theta_rad: float


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """One object on the table.

    Attributes
    ----------
    part : name, None for an object that is none of the catalogue's
    pose_index : stable pose, -1 if unknown
    R : (3, 3) CAD -> upright
    x_mm, y_mm, theta_rad : planar pose; the centre of mass stands over (x, y)
    T_world_part : (4, 4), None if unknown
    score : overlap of predicted and observed silhouette, 0..1
    grey_score : correlation of predicted and observed shading, None if it was not needed
    residual_px : median distance of the outlines
    ambiguous_with : readings that fit as well
    area_mm2, box_px : of the object in the picture (x0, y0, x1, y1)
    reason : why it is unknown
    """

    part: str | None
    pose_index: int
    R: Array | None
    x_mm: float
    y_mm: float
    theta_rad: float
    T_world_part: Array | None
    score: float
    grey_score: float | None
    residual_px: float
    ambiguous_with: tuple[Alternative, ...]
    area_mm2: float
    box_px: tuple[int, int, int, int]
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class _Hypothesis:
    entry: CatalogueEntry
    pose: StablePose
    fit: PoseFit
    iou: float
    grey: float | None = None
    theta_rad: float = field(default=0.0)


def lying(solid: Solid, pose: StablePose, x_mm: float, y_mm: float, theta_rad: float) -> Array:
    """Return T_world_part of a part at rest: turned upright, then by theta, then moved.

    The centre of mass stands over (x, y) and the lowest point at z = 0 (DESIGN.md 4).
    """
    c, s = np.cos(theta_rad), np.sin(theta_rad)
    T = np.eye(4)
    T[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose.R
    T[:3, 3] = np.array([x_mm, y_mm, pose.com_height_mm]) - T[:3, :3] @ solid.centroid_mm
    return T


def make_catalogue(
    parts: Sequence[Solid | CompiledPart], camera: Camera, min_probability: float = 0.01
) -> tuple[CatalogueEntry, ...]:
    """Prepare the parts that may turn up: silhouettes of all their ways to lie.

    Raises
    ------
    CadError : a part is too large for the camera's picture
    """
    return tuple(_entry(part, camera, min_probability) for part in parts)


def _entry(part: Solid | CompiledPart, camera: Camera, min_probability: float) -> CatalogueEntry:
    if isinstance(part, CompiledPart):
        solid, known, samples = part.solid, part.poses, part.samples
    else:
        solid, known, samples = part, stable_poses(part), sample_surface(part)
    caster = RayCaster(solid.mesh)
    poses = tuple(
        # what would roll on or tip at a touch is seen lying all the same; planning refuses it
        p
        for p in known
        if p.probability >= min_probability
    )
    width, height = camera.size_px
    aim = camera.on_plane(np.array([[width / 2, height / 2]]))[0]
    signatures = []
    for pose in poses:
        T = lying(solid, pose, aim[0], aim[1], 0.0)
        roi = view_roi(solid.mesh.vertices, T, camera, margin_px=0)
        if roi is None or min(roi[:2]) <= 0 or roi[2] >= width or roi[3] >= height:
            raise CadError(
                f"{solid.name}: {solid.mesh.extents.max():.0f} mm long, lying it does not fit into "
                "the overhead camera's picture; use another camera or a smaller part"
            )
        maps = render_maps(caster, T, camera, roi, step_px=2)
        mm = 2 * camera.mm_per_px(np.array([aim[0], aim[1], 0.0]))
        signatures.append(signature(maps.mask, mm, _reach_mm(solid)))
    return CatalogueEntry(solid, poses, caster, samples, tuple(signatures))


def _reach_mm(solid: Solid) -> float:
    return float(np.linalg.norm(solid.mesh.vertices - solid.centroid_mm, axis=1).max())


def find_objects(
    backlit: Grey, glowing: Mask, camera: Camera, limits: Limits
) -> list[tuple[Mask, tuple[int, int, int, int]]]:
    """Return the dark objects before the glowing table: mask in the whole picture, and box."""
    low, level, high = threshold_levels(backlit, glowing)
    if high - low < 20:  # an evenly bright table: nothing on it
        return []
    dark = (backlit < level) & glowing
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        dark.astype(np.uint8), connectivity=8
    )
    centre = np.array([[camera.size_px[0] / 2, camera.size_px[1] / 2]])
    mm = camera.mm_per_px(camera.on_plane(centre)[0])
    found = []
    for i in range(1, count):
        x, y, w, h, area = (int(v) for v in stats[i])
        if area * mm**2 >= limits.min_area_mm2:
            found.append((labels == i, (x, y, x + w, y + h)))
    return found


def recognise(
    backlit: Grey,
    glowing: Mask,
    camera: Camera,
    catalogue: Sequence[CatalogueEntry],
    lit: Mapping[str, Grey] | None = None,
    lamps: Sequence[PointLamp] = (),
    limits: Limits | None = None,
) -> tuple[Sighting, ...]:
    """Return what lies on the table, largest object first.

    Parameters
    ----------
    backlit : (height, width) picture before the glowing table
    glowing : (height, width) where the table glows
    lit : pictures by lamp name, for what silhouettes cannot decide
    lamps : where these lamps stand

    An empty table is an empty answer.
    """
    limits = limits or Limits()
    objects = find_objects(backlit, glowing, camera, limits)
    sightings = [
        _identify(mask, box, backlit, glowing, camera, catalogue, lit or {}, lamps, limits)
        for mask, box in objects
    ]
    return tuple(sorted(sightings, key=lambda s: -s.area_mm2))


def _identify(
    mask: Mask,
    box: tuple[int, int, int, int],
    backlit: Grey,
    glowing: Mask,
    camera: Camera,
    catalogue: Sequence[CatalogueEntry],
    lit: Mapping[str, Grey],
    lamps: Sequence[PointLamp],
    limits: Limits,
) -> Sighting:
    _, level, _ = threshold_levels(backlit, glowing)
    moments = cv2.moments(mask.astype(np.uint8), binaryImage=True)
    centroid = np.array([[moments["m10"], moments["m01"]]]) / moments["m00"]
    mm = camera.mm_per_px(camera.on_plane(centroid)[0])
    area_mm2 = float(moments["m00"]) * mm**2
    ground = camera.on_plane(centroid)[0]
    unknown = Sighting(
        part=None,
        pose_index=-1,
        R=None,
        x_mm=float(ground[0]),
        y_mm=float(ground[1]),
        theta_rad=0.0,
        T_world_part=None,
        score=0.0,
        grey_score=None,
        residual_px=float("inf"),
        ambiguous_with=(),
        area_mm2=area_mm2,
        box_px=box,
    )
    if _touches_border(mask, glowing):
        return replace(unknown, reason="partly outside the glowing area; move it inwards")
    contour = subpixel_contour(backlit, mask, level)
    hypotheses: list[_Hypothesis] = []
    for entry, pose, theta in _coarse(mask, mm, camera, catalogue, limits):
        hypothesis = _refine(mask, contour, centroid, camera, entry, pose, theta)
        if hypothesis is not None:
            hypotheses.append(hypothesis)
    good = [
        h
        for h in hypotheses
        if h.iou >= limits.min_iou and h.fit.residual_px <= limits.max_residual_px
    ]
    if not good:
        best = max(hypotheses, key=lambda h: h.iou, default=None)
        near = (
            f"nearest is {best.entry.solid.name} with an overlap of {best.iou:.2f}, "
            f"{limits.min_iou:.2f} is asked"
            if best
            else "no part has a silhouette of this size and shape"
        )
        return replace(unknown, reason=f"none of the known parts: {near}")
    good.sort(key=lambda h: h.fit.residual_px - 20 * h.iou)
    best = good[0]
    rivals = [
        h
        for h in good
        if h.iou >= best.iou - limits.near_iou
        and h.fit.residual_px <= best.fit.residual_px + limits.near_residual_px
    ]
    rivals = _distinct(rivals)
    if len(rivals) > 1 and lit:
        rivals = [replace(h, grey=_grey_score(h, camera, lit, lamps)) for h in rivals]
        rivals.sort(key=lambda h: -(h.grey or 0.0))
        top = rivals[0].grey or 0.0
        rivals = [h for h in rivals if (h.grey or 0.0) >= top - limits.near_grey]
    return _as_sighting(rivals, area_mm2, box)


def _as_sighting(
    rivals: list[_Hypothesis], area_mm2: float, box: tuple[int, int, int, int]
) -> Sighting:
    best = rivals[0]
    T = best.fit.T_world_part
    com = T[:3, :3] @ best.entry.solid.centroid_mm + T[:3, 3]
    return Sighting(
        part=best.entry.solid.name,
        pose_index=best.pose.index,
        R=best.pose.R,
        x_mm=float(com[0]),
        y_mm=float(com[1]),
        theta_rad=best.theta_rad,
        T_world_part=T,
        score=best.iou,
        grey_score=best.grey,
        residual_px=best.fit.residual_px,
        ambiguous_with=tuple(
            Alternative(h.entry.solid.name, h.pose.index, h.theta_rad) for h in rivals[1:]
        ),
        area_mm2=area_mm2,
        box_px=box,
    )


def _touches_border(mask: Mask, glowing: Mask) -> bool:
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    edge = np.zeros_like(mask)
    edge[[0, -1], :] = True
    edge[:, [0, -1]] = True
    return bool((grown & (~glowing | edge)).any())


def _coarse(
    mask: Mask, mm: float, camera: Camera, catalogue: Sequence[CatalogueEntry], limits: Limits
) -> list[tuple[CatalogueEntry, StablePose, float]]:
    """Return candidates (part, pose, theta) by area and best turns, best first."""
    ranked: list[tuple[float, CatalogueEntry, StablePose, float]] = []
    flip = _turn_of_image(camera)
    for entry in catalogue:
        observed = signature(mask, mm, _reach_mm(entry.solid))
        for pose, model in zip(entry.poses, entry.signatures, strict=True):
            if abs(observed.area_mm2 / model.area_mm2 - 1) > limits.area_ratio:
                continue
            scores = turn_scores(model, observed)
            if scores.max() < limits.coarse_score:
                continue
            ranked += [
                (float(scores[turn]), entry, pose, flip * np.radians(turn))
                for turn in best_turns(scores, within=0.03, apart_deg=12, most=6)
            ]
    ranked.sort(key=lambda item: -item[0])
    return [(e, p, t) for _, e, p, t in ranked[: limits.max_hypotheses]]


def _turn_of_image(camera: Camera) -> float:
    """Return +1 where a turn about world z looks anticlockwise in the picture, else -1."""
    looks_down = camera.T_world_cam[2, 2] < 0
    return 1.0 if looks_down else -1.0


def _refine(
    mask: Mask,
    contour: Contour,
    centroid_px: Array,
    camera: Camera,
    entry: CatalogueEntry,
    pose: StablePose,
    theta: float,
) -> _Hypothesis | None:
    # the silhouette's centroid is that of the outline at the part's own height
    at = camera.on_plane(centroid_px, pose.com_height_mm)[0]
    T = lying(entry.solid, pose, at[0], at[1], theta)
    roi = view_roi(entry.solid.mesh.vertices, T, camera)
    if roi is None:
        return None
    maps = render_maps(entry.caster, T, camera, roi, step_px=2)
    moments = cv2.moments(maps.mask.astype(np.uint8), binaryImage=True)
    if moments["m00"] == 0:
        return None
    seen = np.array([[moments["m10"], moments["m01"]]]) / moments["m00"] * 2 + roi[:2]
    shift = at - camera.on_plane(seen, pose.com_height_mm)[0]
    T[:2, 3] += shift[:2]
    part = PosedPart(entry.solid, entry.caster)
    fit = fit_pose(part, T, camera, contour, freedom="table")
    if fit is None:
        return None
    x0, y0, x1, y1 = fit.maps.roi
    predicted = np.zeros_like(mask)
    predicted[y0:y1, x0:x1] = fit.maps.mask
    iou = float((predicted & mask).sum() / max((predicted | mask).sum(), 1))
    R = fit.T_world_part[:3, :3] @ pose.R.T
    return _Hypothesis(entry, pose, fit, iou, theta_rad=float(np.arctan2(R[1, 0], R[0, 0])))


def _distinct(hypotheses: list[_Hypothesis]) -> list[_Hypothesis]:
    """Drop readings that put the same surface in the same place (a symmetric part turned)."""
    kept: list[_Hypothesis] = []
    for h in hypotheses:
        if not any(_same_surface(h, k) for k in kept):
            kept.append(h)
    return kept


def _same_surface(a: _Hypothesis, b: _Hypothesis) -> bool:
    if a.entry is not b.entry:
        return False
    samples = a.entry.samples
    T_b_a = inverse_pose(b.fit.T_world_part) @ a.fit.T_world_part
    # a surface must lie within SAME_MM of each sample of a taken into b's place
    normals = samples.normals @ T_b_a[:3, :3].T
    start = transform(T_b_a, samples.points_mm) + SAME_MM * normals
    met = b.entry.caster.blocked(start, -normals, 2 * SAME_MM)
    # every face by itself: a small hole elsewhere is few of all samples, and all of its own
    count = np.bincount(samples.face_ids)
    share = np.bincount(samples.face_ids, weights=met)[count > 0] / count[count > 0]
    return bool(share.min() >= 0.5 and met.mean() >= 0.97)


def _grey_score(
    h: _Hypothesis, camera: Camera, lit: Mapping[str, Grey], lamps: Sequence[PointLamp]
) -> float:
    """Return how well shading agrees inside the outline, mean over lamps, -1..1."""
    scores, weights = [], []
    for lamp in lamps:
        if lamp.name not in lit:
            continue
        maps = h.fit.maps
        x0, y0, x1, y1 = maps.roi
        predicted = predict_radiance(
            h.entry.solid.mesh, h.entry.caster, maps, h.fit.T_world_part, camera, lamp
        )
        predicted = cv2.GaussianBlur(predicted, (0, 0), 1.0)
        observed = lit[lamp.name][y0:y1, x0:x1].astype(np.float32)
        observed = cv2.GaussianBlur(observed, (0, 0), 0.7)
        inside = cv2.erode(maps.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        p, o = predicted[inside], observed[inside]
        if len(p) < 50:
            continue
        p, o = p - p.mean(), o - o.mean()
        contrast = float(p.std())
        scores.append(float((p * o).mean() / max(float(p.std() * o.std()), 1e-9)))
        weights.append(contrast + 1e-6)
    return float(np.average(scores, weights=weights)) if scores else 0.0
