"""The gripper's place in a picture before the panel, and the margin round it.

Calibration and joints say where the gripper's boxes stand, to about a millimetre. Before the panel
their outline shows: each straight stretch of it that neither the part nor another box touches
tells how far the gripper is off there, square to the stretch. One movement of the whole gripper
and one of each box are fitted to all stretches: a little one, and for the two fingers one along the
line between them, as jaws open wider or less. What the stretches leave open of a box's place, and
how far its true shape stands out of the box, make its margin.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from controller.arrays import BoolArray, Float32Array, FloatArray, Grey
from controller.imaging import Camera, Roi, ViewMaps, sample_picture

from ._scene import (
    FINGER_MM,
    GRIPPER_MM,
    ViewScene,
    margin_px,
    with_boxes,
)
from ._types import WorldBox

BOX_MM: Final = 0.1  # standard deviation of a box's place on the gripper
TURN_RAD: Final = 0.005  # standard deviation of the gripper's turn in the picture
NEAR_PX: Final = 150  # farther from the part, the gripper's place says little about it
OUTLINE_STEP_PX: Final = 2  # distance between points of the outline
MASK_STEP_PX: Final = 4  # distance between pixels of the masks of what is near
REACH_PX: Final = 14.0  # reach of the search across the outline: three standard deviations and more
SEARCH_PX: Final = 0.5  # step of this search; between steps the edge is interpolated
CLEAR_PX: Final = 16  # distance from part and other boxes at which a stretch is the box's own
EDGE_PX: Final = 0.3  # least standard deviation of a stretch's place: light and roundings
STRETCH_POINTS: Final = 8  # least points of a stretch
MIN_FOUND_SHARE: Final = 0.5  # least share of a stretch's points at which an edge is found
STANDS_OUT: Final = 95.0  # percentile of a shape's deviations that its margin covers
ALIKE: Final = 1e-3  # of the axes of two boxes that are parallel
SIDES: Final = 16  # points along an edge of a box: a lens bends it


@dataclass(frozen=True, eq=False, slots=True)
class _Stretch:
    """A straight stretch of a box's outline.

    Attributes
    ----------
    box : number of the box
    normal : (2,) unit, away from the box
    middle : (2,) of its points [px]
    gap_px : (n,) distance of the observed edge beyond the predicted one
    """

    box: int
    normal: FloatArray
    middle: FloatArray
    gap_px: FloatArray

    @property
    def sigma_px(self) -> float:
        """Standard deviation of its place."""
        spread = 1.48 * float(np.median(np.abs(self.gap_px - np.median(self.gap_px))))
        return float(np.hypot(EDGE_PX, spread))


def with_measured_holder(
    scene: ViewScene, camera: Camera, maps: ViewMaps, share: Float32Array
) -> ViewScene:
    """Return a scene with the gripper where the picture before the panel shows it.

    Boxes that nothing is seen of stay where they are expected, with the margin of that.

    Parameters
    ----------
    scene : scene from `make_scene`
    camera : camera of the view
    maps : predicted picture of the part at its measured pose
    share : (height, width) the picture, 0 for the level of the part, 1 for that of the panel
    """
    roi = _about(maps.roi, camera)
    outlines = {
        number: outline
        for number, box in enumerate(scene.boxes)
        if (outline := _outline(box, camera, roi)) is not None
    }
    if not outlines:
        return scene
    stretches = _stretches(outlines, roi, scene.panel, maps, share)
    if not stretches:
        return scene
    numbers = sorted(outlines)
    pivot = np.array([maps.roi[0] + maps.roi[2], maps.roi[1] + maps.roi[3]]) / 2
    pixel_mm = {i: camera.mm_per_px(scene.boxes[i].T[:3, 3]) for i in numbers}
    usual_mm = float(np.mean([*pixel_mm.values()]))
    priors = [_own_prior(i, scene.boxes, camera, pixel_mm[i]) for i in numbers]
    moves, covariance = _fitted(stretches, numbers, pivot, priors, usual_mm)
    boxes, margins = list(scene.boxes), list(scene.margins_px)
    for k, number in enumerate(numbers):
        own = slice(3 + 2 * k, 5 + 2 * k)
        shift_px = moves[:2] + moves[own]
        at_part = np.zeros((2, len(moves)))
        at_part[:, :2], at_part[:, own] = np.eye(2), np.eye(2)
        spread = at_part @ covariance @ at_part.T
        sigma_px = float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        out_px = _stands_out([s for s in stretches if s.box == number], shift_px, moves[2], pivot)
        margins[number] = margin_px(sigma_px, out_px)
        boxes[number] = _moved(boxes[number], camera, shift_px * pixel_mm[number], moves[2], pivot)
    return with_boxes(scene, tuple(boxes), tuple(margins), usual_mm)


def _about(roi: Roi, camera: Camera) -> Roi:
    width, height = camera.size_px
    x0, y0, x1, y1 = roi
    return (
        max(x0 - NEAR_PX, 0),
        max(y0 - NEAR_PX, 0),
        min(x1 + NEAR_PX, width),
        min(y1 + NEAR_PX, height),
    )


def _outline(box: WorldBox, camera: Camera, roi: Roi) -> FloatArray | None:
    """Return the outline of a box (n, 2) [px], counter-clockwise to the eye; None out of sight."""
    along = np.linspace(-1.0, 1.0, SIDES)
    ends = np.array([(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    points = np.concatenate(
        [np.insert(np.repeat(ends, SIDES, axis=0), k, np.tile(along, 4), axis=1) for k in range(3)]
    )
    world = (points * box.half_mm) @ box.T[:3, :3].T + box.T[:3, 3]
    if ((world - camera.position_mm) @ camera.T_world_cam[:3, 2]).min() <= 0:
        return None
    hull = cv2.convexHull(camera.project(world).astype(np.float32)).reshape(-1, 2)
    x0, y0, x1, y1 = roi
    low, high = hull.min(axis=0), hull.max(axis=0)
    if high[0] < x0 or high[1] < y0 or low[0] > x1 or low[1] > y1:
        return None
    corners = cv2.approxPolyDP(hull[:, None], 1.0, closed=True).reshape(-1, 2)
    return np.asarray(corners, np.float64) if len(corners) >= 3 else None


def _stretches(
    outlines: dict[int, FloatArray],
    roi: Roi,
    panel: BoolArray,
    maps: ViewMaps,
    share: Float32Array,
) -> list[_Stretch]:
    """Return the stretches of outlines that show before the panel."""
    x0, y0, x1, y1 = roi
    step = MASK_STEP_PX
    shape = (-(-(y1 - y0) // step), -(-(x1 - x0) // step))
    filled: dict[int, Grey] = {}
    for number, outline in outlines.items():
        mask = np.zeros(shape, np.uint8)
        cv2.fillPoly(mask, [np.round((outline - [x0, y0]) / step).astype(np.int32)], 1)
        filled[number] = mask
    every = np.zeros(shape, np.uint8)
    part = maps.mask[::step, ::step]
    row, column = (maps.roi[1] - y0) // step, (maps.roi[0] - x0) // step
    here = every[row : row + part.shape[0], column : column + part.shape[1]]
    here |= part[: here.shape[0], : here.shape[1]]
    every += sum(filled.values())
    reach = 2 * (CLEAR_PX // step) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    out: list[_Stretch] = []
    for number, outline in outlines.items():
        others = cv2.dilate((every > filled[number]).astype(np.uint8), disc) > 0
        for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
            found = _stretch(number, start, end, outline.mean(axis=0), roi, panel, others, share)
            if found is not None:
                out.append(found)
    return out


def _stretch(
    number: int,
    start: FloatArray,
    end: FloatArray,
    inside: FloatArray,
    roi: Roi,
    panel: BoolArray,
    others: BoolArray,
    share: Float32Array,
) -> _Stretch | None:
    """Return what shows of one side of an outline, None if that is too little."""
    length = float(np.linalg.norm(end - start))
    if length < STRETCH_POINTS * OUTLINE_STEP_PX:
        return None
    along = (end - start) / length
    normal = np.array([along[1], -along[0]])
    if (start - inside) @ normal < 0:
        normal = -normal
    step = OUTLINE_STEP_PX
    points = start + np.arange(step, length - step, step)[:, None] * along
    x0, y0, x1, y1 = roi
    points = points[
        (points >= [x0 + REACH_PX, y0 + REACH_PX]).all(axis=1)
        & (points <= [x1 - 1 - REACH_PX, y1 - 1 - REACH_PX]).all(axis=1)
    ]
    x, y = np.round(points).astype(int).T
    free = panel[y, x] & ~others[(y - y0) // MASK_STEP_PX, (x - x0) // MASK_STEP_PX]
    points = points[free]
    if len(points) < STRETCH_POINTS:
        return None
    offsets = np.arange(-REACH_PX, REACH_PX + SEARCH_PX / 2, SEARCH_PX)
    where = points[:, None] + offsets[:, None] * normal
    profile = sample_picture(share, where[..., 0], where[..., 1]) - 0.5
    before, after = profile[:, :-1], profile[:, 1:]
    rises = (before < 0) & (after >= 0)
    nearest = np.where(rises, np.abs(offsets[:-1]), np.inf).argmin(axis=1)
    rows = np.arange(len(points))
    low, high = before[rows, nearest], after[rows, nearest]
    is_found = rises.any(axis=1)
    if is_found.sum() < max(STRETCH_POINTS, MIN_FOUND_SHARE * len(points)):
        return None
    part_way = np.where(is_found, -low / np.where(is_found, high - low, 1.0), 0.0)
    gap = offsets[nearest] + SEARCH_PX * part_way
    return _Stretch(number, normal, points[is_found].mean(axis=0), gap[is_found])


def _own_prior(
    number: int, boxes: Sequence[WorldBox], camera: Camera, pixel_mm: float
) -> FloatArray:
    """Return the covariance (2, 2) of a box's place on the gripper, in the picture [px]."""
    box = boxes[number]
    prior = np.eye(2) * (BOX_MM / pixel_mm) ** 2
    for other in boxes:
        if other is box or not np.allclose(other.half_mm, box.half_mm):
            continue
        if not np.allclose(other.T[:3, :3], box.T[:3, :3], atol=ALIKE):
            continue
        apart = other.T[:3, 3] - box.T[:3, 3]
        line = camera.T_world_cam[:3, :2].T @ (apart / np.linalg.norm(apart))
        prior += np.outer(line, line) * (FINGER_MM / pixel_mm) ** 2
    return np.asarray(prior)


def _rotated(p: FloatArray, pivot: FloatArray) -> FloatArray:
    """Return the shift (2,) of a point by a turn of one radian about another [px]."""
    x, y = p - pivot
    return np.array([-y, x])


def _fitted(
    stretches: Sequence[_Stretch],
    numbers: Sequence[int],
    pivot: FloatArray,
    priors: Sequence[FloatArray],
    pixel_mm: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the movement of the gripper (3,) and its boxes (2 each) [px, rad], and covariance."""
    size = 3 + 2 * len(numbers)
    information, pull = np.zeros((size, size)), np.zeros(size)
    information[:3, :3] = np.diag([pixel_mm / GRIPPER_MM, pixel_mm / GRIPPER_MM, 1 / TURN_RAD]) ** 2
    for k, prior in enumerate(priors):
        information[3 + 2 * k : 5 + 2 * k, 3 + 2 * k : 5 + 2 * k] = np.linalg.inv(prior)
    for stretch in stretches:
        row = np.zeros(size)
        row[:2] = stretch.normal
        row[2] = stretch.normal @ _rotated(stretch.middle, pivot)
        k = numbers.index(stretch.box)
        row[3 + 2 * k : 5 + 2 * k] = stretch.normal
        weight = 1.0 / stretch.sigma_px**2
        information += weight * np.outer(row, row)
        pull += weight * row * float(np.median(stretch.gap_px))
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    return covariance @ pull, covariance


def _stands_out(
    stretches: Sequence[_Stretch], shift_px: FloatArray, turn: float, pivot: FloatArray
) -> float:
    """Return how far a box's true outline stands out of the moved box [px], 0 if it does not."""
    beyond = [
        s.gap_px - s.normal @ (shift_px + turn * _rotated(s.middle, pivot)) for s in stretches
    ]
    if not beyond:
        return 0.0
    return max(float(np.percentile(np.concatenate(beyond), STANDS_OUT)), 0.0)


def _moved(
    box: WorldBox, camera: Camera, shift_mm: FloatArray, turn: float, pivot: FloatArray
) -> WorldBox:
    """Return a box moved across the view, and turned about the line of sight through a pixel."""
    R = camera.T_world_cam[:3, :3]
    axis = R[:, 2]
    depth_mm = float((box.T[:3, 3] - camera.position_mm) @ axis)
    ray = camera.sight_lines(pivot[None])[0]
    centre = camera.position_mm + ray * depth_mm / float(ray @ axis)
    rotation, _ = cv2.Rodrigues(axis * turn)
    T = box.T.copy()
    T[:3, :3] = rotation @ box.T[:3, :3]
    T[:3, 3] = centre + rotation @ (box.T[:3, 3] - centre) + R[:, :2] @ shift_mm
    return WorldBox(T, box.half_mm)
