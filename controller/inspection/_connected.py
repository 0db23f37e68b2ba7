"""Findings on the part from connected differences in a picture."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray
from controller.imaging import Camera, ViewMaps, inverse_pose, transform

from ._pose import PosedPart
from ._types import Finding, FindingKind

BORDER_ZOOM: Final = 4
LARGE_PX: Final = 500  # masks of this size or more are not enlarged, to save memory
BORDER_OFF_PX: Final = 0.5  # largest error of the border drawn round a finding


def grow(mask: BoolArray, px: int) -> BoolArray:
    """Return a mask (h, w) grown by a disc."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * px + 1, 2 * px + 1))
    grown: BoolArray = cv2.dilate(mask.astype(np.uint8), kernel) > 0
    return grown


def border_of(mask: BoolArray, corner: tuple[float, float], step_px: float = 1.0) -> FloatArray:
    """Return the border (k, 2) of a mask's largest connected piece, in pixels of the picture.

    Parameters
    ----------
    mask : (h, w) with at least one pixel set
    corner : (x, y) centre of the mask's first pixel
    step_px : distance between neighbouring pixels of the mask
    """
    rows, columns = np.nonzero(mask)
    top, left = int(rows.min()), int(columns.min())
    piece = np.pad(mask[top : rows.max() + 1, left : columns.max() + 1].astype(np.uint8), 1)
    # Enlarge the mask, so that a line one pixel wide has a border too.
    zoom = BORDER_ZOOM if max(piece.shape) <= LARGE_PX else 1
    large = cv2.resize(piece, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST)
    contours, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(contours, key=len)
    border = cv2.approxPolyDP(longest, BORDER_OFF_PX * zoom / step_px, closed=True)
    at = (border.reshape(-1, 2).astype(np.float64) + 0.5) / zoom - 0.5 - 1.0
    return np.asarray((at + np.array([left, top])) * step_px + np.array(corner))


def connected_findings(
    wrong: BoolArray,
    kind: FindingKind,
    lamp: str,
    part: PosedPart,
    maps: ViewMaps,
    camera: Camera,
    T_world_part: FloatArray,
    corner: tuple[int, int],
    area_mm2: Float32Array,
    min_area_mm2: float,
) -> list[Finding]:
    """Return a finding for each connected difference that is large enough.

    Parameters
    ----------
    wrong : (h, w) mask of the pixels that differ, in a window of the picture
    kind, lamp : kind and lamp recorded with the findings
    part : the solid, with ray casting
    maps : predicted picture of the part
    camera : calibrated, in the world's frame
    T_world_part : (4, 4) measured pose
    corner : (x0, y0) corner of the window in the picture
    area_mm2 : (h, w) area of the surface that each pixel covers
    min_area_mm2 : smallest area of a finding
    """
    com = transform(T_world_part, part.solid.centroid_mm[None])[0]
    mm = camera.mm_per_px(com)
    count, labels, stats, centres = cv2.connectedComponentsWithStats(
        wrong.astype(np.uint8), connectivity=8
    )
    areas = np.bincount(labels.ravel(), weights=area_mm2.ravel(), minlength=count)
    found = []
    for i in range(1, count):
        if areas[i] < min_area_mm2:
            continue
        x, y, w, h, _ = (int(v) for v in stats[i])
        at = (float(centres[i][0] + corner[0]), float(centres[i][1] + corner[1]))
        rows, columns = np.nonzero(grow(labels == i, 5))
        point, faces = nearest_on_part(
            part, maps, camera, T_world_part, columns + corner[0], rows + corner[1]
        )
        found.append(
            Finding(
                kind=kind,
                lamp=lamp,
                area_mm2=float(areas[i]),
                size_mm=float(np.hypot(w, h) * mm),
                at_px=at,
                box_px=(x + corner[0], y + corner[1], x + w + corner[0], y + h + corner[1]),
                p_part_mm=point,
                face_ids=faces,
                outline_px=border_of(
                    labels[y : y + h, x : x + w] == i, (x + corner[0], y + corner[1])
                ),
            )
        )
    return found


def nearest_on_part(
    part: PosedPart,
    maps: ViewMaps,
    camera: Camera,
    T: FloatArray,
    xs: NDArray[np.integer],
    ys: NDArray[np.integer],
) -> tuple[FloatArray, tuple[int, ...]]:
    """Return the centre of the surface seen in some pixels, CAD frame, and its most common faces.

    Parameters
    ----------
    part : the part
    maps : predicted picture of it
    camera : calibrated, in the world's frame
    T : (4, 4) pose of the part in the world
    xs, ys : (n,) the pixels; where none of them shows the part, the nearest one that does is used
    """
    u, v = xs - maps.roi[0], ys - maps.roi[1]
    height, width = maps.mask.shape
    inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
    u, v = u[inside], v[inside]
    on = maps.mask[v, u] if len(u) else np.zeros(0, dtype=bool)
    if not on.any():
        rows, columns = np.nonzero(maps.mask)
        middle = np.array([xs.mean() - maps.roi[0], ys.mean() - maps.roi[1]])
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
