"""Obstacles between camera and part: the arm's links, the fixed gripper, posts.

The part's centre of mass is always at the station, so all its sight lines lie in one fixed cone:
boxes that miss it hide nothing, and in most configurations all of them do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import transform

from ..geometry import Box, overlap, segments_hit, stack
from ..model import CellLayout
from .gripper import FINGER_SHADOW_MM

_PIECE_COUNT = 4  # pieces of the cone, each held by a box
DIRECTION_COUNT = 12  # equal to the number of rolls
_MIN_DEPTH_MM = 1.0
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


@dataclass(frozen=True, slots=True, eq=False)
class ViewCone:
    """A cone round every line from the camera to a part of some radius about the station.

    Attributes
    ----------
    T, half_mm : (k, 4, 4), (k, 3) boxes that hold it, from the camera on
    """

    T: FloatArray
    half_mm: FloatArray

    @classmethod
    def of_station(cls, layout: CellLayout, radius_mm: float) -> ViewCone:
        """Return the cone of the inspection camera to a ball about the station."""
        eye = layout.inspection.position_mm
        along = layout.station_mm - eye
        distance = float(np.linalg.norm(along))
        along = along / distance
        side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        side = side / np.linalg.norm(side)
        sine = min(radius_mm / distance, 0.99)
        slope = sine / np.sqrt(1.0 - sine**2)
        ends = np.linspace(0.0, distance + radius_mm, _PIECE_COUNT + 1)
        T = np.tile(np.eye(4), (_PIECE_COUNT, 1, 1))
        half = np.zeros((_PIECE_COUNT, 3))
        for k in range(_PIECE_COUNT):
            low, high = ends[k], ends[k + 1]
            T[k, :3, :3] = np.column_stack([along, side, np.cross(along, side)])
            T[k, :3, 3] = eye + (low + high) / 2 * along
            wide = min(high * slope, radius_mm)
            half[k] = (high - low) / 2, wide, wide
        return cls(T, half)

    def meets(self, T_box: FloatArray, half_mm: FloatArray) -> BoolArray:
        """Return a mask (n,) of the boxes (n, 4, 4), (n, 3) that may stand in the cone."""
        met = np.zeros(len(T_box), dtype=bool)
        for T, half in zip(self.T, self.half_mm, strict=True):
            (left,) = np.nonzero(~met)
            pose = np.broadcast_to(T, (len(left), 4, 4))
            met[left] = overlap(pose, half, T_box[left], half_mm[left] + FINGER_SHADOW_MM)
        return met


def seen_extent(layout: CellLayout, points_mm: FloatArray) -> FloatArray:
    """Return the extent of points (..., n, 3) in the picture: (..., DIRECTION_COUNT).

    Ways are directions square to the line from the camera to the station, evenly turned; lengths
    are tangents. Points beside or behind the camera reach infinitely far every way.
    """
    eye = layout.inspection.position_mm
    towards = eye - layout.station_mm
    towards = towards / np.linalg.norm(towards)
    right = layout.inspection.T_world_cam[:3, 0]
    right = right - towards * (right @ towards)
    right = right / np.linalg.norm(right)
    offset = points_mm - eye
    depth = -(offset @ towards)
    behind = depth < _MIN_DEPTH_MM
    scale = 1.0 / np.where(behind, 1.0, depth)
    x, y = (offset @ right) * scale, (offset @ np.cross(towards, right)) * scale
    angle = 2 * np.pi * np.arange(DIRECTION_COUNT) / DIRECTION_COUNT
    extent = np.stack(
        [(c * x + s * y).max(axis=-1) for c, s in zip(np.cos(angle), np.sin(angle), strict=True)],
        axis=-1,
    )
    return np.where(np.asarray(behind.any(axis=-1))[..., None], np.inf, extent)


def may_cover(
    layout: CellLayout, T_box: FloatArray, half_mm: FloatArray, extent: FloatArray
) -> BoolArray:
    """Return a mask (n,) of the boxes that overlap a part in the picture.

    Parameters
    ----------
    layout : the cell, with camera and station
    T_box : (n, 4, 4) poses of the boxes' centres in the world
    half_mm : (n, 3) half of each edge
    extent : (n, k) extent of the part, one row for each box; see `seen_extent`
    """
    corners = _CORNERS * (half_mm + FINGER_SHADOW_MM)[:, None]
    points = np.einsum("nij,nkj->nki", T_box[:, :3, :3], corners) + T_box[:, None, :3, 3]
    own = seen_extent(layout, points)
    # apart if, some way, the box begins (the other way round) after the part has ended
    opposite = np.roll(own, DIRECTION_COUNT // 2, axis=1)
    return np.asarray(~(-opposite > extent).any(axis=1))


def standing_between(
    layout: CellLayout, statics: list[tuple[str, Box]], cone: ViewCone
) -> list[Box]:
    """Return the fixed boxes in the cone, without the one that holds the camera.

    Parameters
    ----------
    layout : the cell, with its inspection camera
    statics : static obstacles by name
    cone : the lines from the camera to the part
    """
    eye = layout.inspection.position_mm
    boxes = [b for _, b in statics if not holds(b, eye)]
    if not boxes:
        return []
    return [b for b, met in zip(boxes, cone.meets(*stack(boxes)), strict=True) if met]


def holds(box: Box, point: FloatArray) -> bool:
    """Return True if a point (3,) is in a box, or within a millimetre of it."""
    inside = np.abs(box.T[:3, :3].T @ (point - box.T[:3, 3])) <= box.half_mm + 1.0
    return bool(inside.all())


def hidden_by_boxes(
    layout: CellLayout,
    boxes: list[Box],
    T_world_part: FloatArray,
    points_mm: FloatArray,
    shown: BoolArray,
) -> BoolArray:
    """Return a mask (n,) of the samples of a part held up that boxes in the world hide.

    Parameters
    ----------
    layout : the cell, with its inspection camera
    boxes : in the world
    T_world_part : (4, 4) pose of the part
    points_mm : (n, 3) samples, CAD frame
    shown : (n,) mask of the boxes to test
    """
    hidden = np.zeros(len(points_mm), dtype=bool)
    (members,) = np.nonzero(shown)
    start = transform(T_world_part, points_mm[members])
    hidden[members] = segments_hit(start, layout.inspection.position_mm, boxes, FINGER_SHADOW_MM)
    return hidden
