"""Sub-pixel pose: move a part until its predicted outline lies on the one in the picture.

Gauss-Newton over the distance from predicted outline points to the observed outline, along its
normal. The prediction is cast anew after each step, so that the outline's points on the part are
the right ones for the pose reached.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid
from controller.imaging import (
    Camera,
    Contour,
    RayCaster,
    ViewMaps,
    mask_contour,
    meet_part,
    render_maps,
    view_roi,
)

from .fitting import edge_jacobian

MAX_PAIR_PX = 25.0  # a predicted point pairs with nothing farther away
HUBER_PX = 1.0
BISECTIONS = 5  # of 1.5 steps: to 0.05 px at full resolution


@dataclass(frozen=True, eq=False, slots=True)
class PosedPart:
    """A solid with what is needed to predict it."""

    solid: Solid
    caster: RayCaster


@dataclass(frozen=True, eq=False, slots=True)
class PoseFit:
    """A fitted pose.

    Attributes
    ----------
    T_world_part : (4, 4)
    residual_px : median distance of predicted outline points from the observed outline
    paired : share of predicted outline points that found a partner within 2 px
    maps : the prediction at the fitted pose
    edge_px, edge_normals : (n, 2) the predicted outline, and its normals, from part to ground
    edge_points_mm : (n, 3) the part's points there, world
    gap_px : (n,) how far beyond it the observed outline is; nan where there is none near
    """

    T_world_part: FloatArray
    residual_px: float
    paired: float
    maps: ViewMaps
    edge_px: FloatArray
    edge_normals: FloatArray
    edge_points_mm: FloatArray
    gap_px: FloatArray


def twist(rotation: FloatArray, shift: FloatArray, pivot: FloatArray) -> FloatArray:
    """Return the motion (4, 4) that turns about a point by a rotation vector and then shifts.

    Parameters
    ----------
    rotation : (3,) along the axis, as long as the angle [rad]
    shift : (3,) [mm]
    pivot : (3,) point that only the shift moves [mm]; all three in one frame
    """
    R, _ = cv2.Rodrigues(rotation.reshape(3, 1))
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = pivot + shift - R @ pivot
    return T


def _outline_points(
    part: PosedPart,
    T: FloatArray,
    maps: ViewMaps,
    camera: Camera,
    ignore: BoolArray | None,
    step_px: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the predicted outline [px], its outward normals, and the part's points there, world.

    Shapes are (n, 2), (n, 2) and (n, 3).

    The border pixels of the mask lie anywhere up to a step inside the outline, all by the same
    amount along an edge that runs with the rows; so each is pushed outwards to where its sight
    line leaves the part.
    """
    x0, y0, _, _ = maps.roi
    pixels = mask_contour(maps.mask)
    if len(pixels) == 0:
        return pixels, pixels, np.zeros((0, 3))
    xi, yi = pixels[:, 0].astype(int), pixels[:, 1].astype(int)
    width, height = camera.size_px
    gx, gy = xi * step_px + x0, yi * step_px + y0
    keep = (gx > 1) & (gy > 1) & (gx < width - 2) & (gy < height - 2)
    if ignore is not None:
        keep &= ~ignore[gy, gx]
    smooth = cv2.GaussianBlur(maps.mask.astype(np.float32), (0, 0), 1.5)
    inward = np.stack(
        [cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1)], axis=-1
    )[yi, xi].astype(np.float64)
    steepness = np.linalg.norm(inward, axis=1)
    keep &= steepness > 1e-3
    outward = -inward[keep] / steepness[keep][:, None]
    if not keep.any():
        return np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 3))
    start = np.column_stack([gx, gy])[keep].astype(np.float64)
    depth = maps.depth_mm[yi, xi][keep]
    inside, outside = np.zeros(len(start)), np.full(len(start), 1.5 * step_px)
    free = np.isinf(_depths(part, T, camera, start + outside[:, None] * outward))
    start, outward, depth = start[free], outward[free], depth[free]
    inside, outside = inside[free], outside[free]
    for _ in range(BISECTIONS):
        middle = 0.5 * (inside + outside)
        met = _depths(part, T, camera, start + middle[:, None] * outward)
        hit = np.isfinite(met)
        depth = np.where(hit, met, depth)
        inside, outside = np.where(hit, middle, inside), np.where(hit, outside, middle)
    edge = start + 0.5 * (inside + outside)[:, None] * outward
    points = camera.position_mm + camera.sight_lines(edge) * depth[:, None]
    return edge, outward, points


def _depths(part: PosedPart, T: FloatArray, camera: Camera, pixels: FloatArray) -> FloatArray:
    """Return the depth at which sight lines of pixels (n, 2) meet the part, inf where they miss."""
    return meet_part(part.caster, T, camera, camera.sight_lines(pixels))[1]


def fit_pose(
    part: PosedPart,
    T_world_part: FloatArray,
    camera: Camera,
    observed: Contour,
    ignore: BoolArray | None = None,
    steps_px: Sequence[int] = (2, 2, 1),
    prior_mm: float = 1.5,
    prior_rad: float = 0.03,
    T_expected: FloatArray | None = None,
) -> PoseFit | None:
    """Fit all six freedoms of a pose to an observed outline.

    It is drawn towards the pose expected by a prior, since depth and tilt hardly show in one view.

    Parameters
    ----------
    part : the solid, with rays against it
    T_world_part : (4, 4) where to begin
    camera : calibrated, in the world's frame
    observed : outline in the picture
    ignore : (height, width) pixels whose outline is not the part's own (the gripper's)
    steps_px : one round of fitting for each, the outline predicted on every so many-th pixel; a
        last prediction on every pixel is what the answer is judged by
    prior_mm, prior_rad : standard deviations of the pose expected
    T_expected : (4, 4) what the prior draws towards; the start without it

    Returns
    -------
    the fit, or None where the prediction leaves the picture
    """
    if len(observed.points_px) < 20:
        return None
    tree = cKDTree(observed.points_px)
    T = T_world_part.copy()
    pivot = T[:3, :3] @ part.solid.centroid_mm + T[:3, 3]
    start_shift, start_rotation = np.zeros(3), np.zeros(3)
    if T_expected is not None:
        start_shift = pivot - T_expected[:3, :3] @ part.solid.centroid_mm - T_expected[:3, 3]
        turn, _ = cv2.Rodrigues(T[:3, :3] @ T_expected[:3, :3].T)
        start_rotation = np.asarray(turn, np.float64).ravel()
    maps: ViewMaps | None = None
    rounds = len(steps_px)
    for step, step_px in enumerate((*steps_px, 1)):
        roi = view_roi(part.solid.mesh.vertices, T, camera)
        if roi is None:
            return None
        maps = render_maps(part.caster, T, camera, roi, step_px)
        pixels, outward, points = _outline_points(part, T, maps, camera, ignore, step_px)
        if len(pixels) < 20:
            return None
        reach = max(MAX_PAIR_PX / (1 + step), 3.0)
        distance, index = map(np.asarray, tree.query(pixels, distance_upper_bound=reach))
        ok = np.isfinite(distance)
        if ok.sum() < 20:
            return None
        normals = observed.normals[index[ok]]
        gap = ((observed.points_px[index[ok]] - pixels[ok]) * normals).sum(axis=1)
        if step == rounds:
            break
        jacobian = edge_jacobian(points[ok], normals, pivot, camera)
        weight = 1.0 / np.maximum(1.0, np.abs(gap) / HUBER_PX)
        scale = np.array([prior_mm] * 3 + [prior_rad] * 3)
        done = np.concatenate([start_shift, start_rotation])
        # outline points are many and correlated: they count as one in ten against the prior
        information = 0.1 * (jacobian * weight[:, None]).T @ jacobian / 0.25
        pull = 0.1 * (jacobian * weight[:, None]).T @ gap / 0.25
        information += np.diag(1 / scale**2)
        pull -= done / scale**2
        step_vector = np.linalg.solve(information, pull)
        start_shift = start_shift + step_vector[:3]
        start_rotation = start_rotation + step_vector[3:]
        T = twist(step_vector[3:], step_vector[:3], pivot) @ T
        pivot = pivot + step_vector[:3]
    assert maps is not None
    gaps = np.full(len(pixels), np.nan)
    gaps[ok] = gap
    every, _ = tree.query(pixels)
    return PoseFit(
        T_world_part=T,
        residual_px=float(np.median(np.abs(gap))),
        paired=float(np.mean(every < 2.0)),
        maps=maps,
        edge_px=pixels,
        edge_normals=outward,
        edge_points_mm=points,
        gap_px=gaps,
    )
