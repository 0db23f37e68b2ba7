"""Differences in a picture -> findings on the part."""

from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, Float32Array, FloatArray
from controller.imaging import Camera, ViewMaps, inverse_pose, transform

from ._pose import PosedPart
from ._types import Finding, FindingKind

BORDER_ZOOM: Final = 4
LARGE_PX: Final = 500  # size from which a mask is not enlarged, to spare memory
BORDER_OFF_PX: Final = 0.5  # largest error of a finding's drawn border


def grow(mask: BoolArray, px: int) -> BoolArray:
    """Return a mask (h, w) grown by a disc."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * px + 1, 2 * px + 1))
    grown: BoolArray = cv2.dilate(mask.astype(np.uint8), kernel) > 0
    return grown


def border_of(mask: BoolArray, corner: tuple[float, float], step_px: float = 1.0) -> FloatArray:
    """Return the border (k, 2) of the largest piece of a mask, in pixels of the picture.

    Parameters
    ----------
    mask : (h, w) with at least one pixel set
    corner : (x, y) of the middle of the mask's first pixel
    step_px : from one of the mask's pixels to the next
    """
    rows, columns = np.nonzero(mask)
    top, left = int(rows.min()), int(columns.min())
    piece = np.pad(mask[top : rows.max() + 1, left : columns.max() + 1].astype(np.uint8), 1)
    # enlarged, so that a line one pixel wide has a border as well
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
    """Return the connected differences that are large enough.

    Parameters
    ----------
    wrong : (h, w) of a window of the picture, which pixels differ
    kind, lamp : of the findings, for the record
    part : the solid, with rays against it
    maps : what the picture is predicted to show of the part
    camera : calibrated, in the world's frame
    T_world_part : (4, 4) the pose measured
    corner : (x0, y0) of the window in the picture
    area_mm2 : (h, w) what a pixel stands for
    min_area_mm2 : smallest area that is a finding
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
    """Return the centre of the surface seen by pixels, CAD frame, and the faces most of them see.

    Parameters
    ----------
    part : the part
    maps : what the picture shows of it
    camera : calibrated, in the world's frame
    T : (4, 4) pose of the part in the world
    xs, ys : (n,) the pixels; where they see none of it, the nearest one that does
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
