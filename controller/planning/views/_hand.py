"""What the hand that holds the part hides of it."""

from __future__ import annotations

import numpy as np
import trimesh

from controller.cad import RayCaster, Solid, SurfaceSamples, inverse_pose

from ..boxes import BoolArray
from ..grip import Grip
from ..layout import Box, FloatArray, Jaw

# Inspection compares nothing within nine pixels of the hand (inspection/_view.py), 1.7 mm at the
# station; a plan that counts what lies there as shown leaves it unseen
FINGER_SHADOW_MM = 2.0
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def holding_boxes(jaw: Jaw, grip: Grip) -> list[Box]:
    """Return body and fingers of a jaw while it holds, in its tip frame.

    Fingers that spread inside a bore stand between the two contacts, not beside them.
    """
    opening = grip.opening_mm - (2 * jaw.finger_thickness_mm if grip.is_inner else 0.0)
    return [*jaw.body, *jaw.fingers(opening)]


def box_caster(boxes: list[Box] | tuple[Box, ...], grow_mm: float = 0.0) -> RayCaster:
    """Return a ray caster of boxes, each grown on all sides; a box has 12 triangles, in order."""
    vertices = [(_CORNERS * (b.half_mm + grow_mm)) @ b.T[:3, :3].T + b.T[:3, 3] for b in boxes]
    faces = [_TRIANGLES + 8 * k for k in range(len(boxes))]
    return RayCaster(trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False))


def hidden_by_hand(
    solid: Solid,
    samples: SurfaceSamples,
    visible: BoolArray,
    vectors: FloatArray,
    distance_mm: float,
    T_part_hand: FloatArray,
    boxes: list[Box] | tuple[Box, ...],
) -> BoolArray:
    """Return which visible samples (v, n) a hand (boxes in its tip frame) hides.

    Lines that pass well beside every box are sorted out by angles, seen from the sample; the rest
    are cast as rays.
    """
    T_hand_part = inverse_pose(T_part_hand)
    centre = T_hand_part[:3, :3] @ solid.centroid_mm + T_hand_part[:3, 3]
    points = samples.points_mm @ T_hand_part[:3, :3].T + T_hand_part[:3, 3]
    ahead = vectors @ T_hand_part[:3, :3].T
    # the camera is not infinitely far: a sight line leans this much from the view's direction
    reach = float(np.linalg.norm(points - centre, axis=1).max())
    lean = float(np.arcsin(min(1.0, reach / distance_mm)))
    near = _maybe_hidden(points, ahead, lean, boxes)
    view, sample = np.nonzero(near & visible)
    hidden = np.zeros_like(visible)
    if len(view):
        start = points[sample]
        sight = centre + distance_mm * ahead[view] - start
        hit, along = box_caster(boxes, FINGER_SHADOW_MM).first_hit(start, sight, np.ones(len(view)))
        hidden[view, sample] = (hit >= 0) & (along < 1.0)
    return hidden


def _maybe_hidden(
    points: FloatArray, ahead: FloatArray, lean_rad: float, boxes: list[Box] | tuple[Box, ...]
) -> BoolArray:
    """Tell for which directions (v, 3) a box may stand before each point (n, 3): (v, n) bool."""
    result = np.zeros((len(ahead), len(points)), dtype=bool)
    directions = ahead.astype(np.float32)
    for centre, radius in _balls(boxes):
        to = centre - points
        away = np.linalg.norm(to, axis=1)
        inside = away <= radius
        angle = np.arcsin(np.where(inside, 1.0, radius / np.maximum(away, radius))) + lean_rad
        least = np.where(inside | (angle >= np.pi), -1.0, np.cos(angle))
        # slack for single precision
        turned = (to / np.maximum(away, 1e-9)[:, None]).astype(np.float32)
        result |= directions @ turned.T >= (least - 1e-5).astype(np.float32)
    return result


def _balls(boxes: list[Box] | tuple[Box, ...]) -> list[tuple[FloatArray, float]]:
    """Return balls (centre, radius) that hold the grown boxes; long boxes are cut in cubes' way."""
    balls = []
    for box in boxes:
        half = box.half_mm + FINGER_SHADOW_MM
        axis = int(np.argmax(half))
        others = np.delete(half, axis)
        pieces = max(1, round(float(half[axis] / max(others.max(), 8.0))))
        part = half.copy()
        part[axis] = half[axis] / pieces
        for k in range(pieces):
            offset = np.zeros(3)
            offset[axis] = (2 * k + 1 - pieces) * part[axis]
            balls.append((box.T[:3, :3] @ offset + box.T[:3, 3], float(np.linalg.norm(part))))
    return balls
