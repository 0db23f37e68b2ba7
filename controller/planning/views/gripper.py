"""Surface of a part hidden by the arm gripper that holds it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.cad import Solid, SurfaceSamples
from controller.imaging import inverse_pose, transform

from ..geometry import Box
from ..model import Grasp, Jaw

# Inspection compares nothing that the arm gripper would hide if it were nine pixels larger on all
# sides (inspection/_scene.py), 1.7 mm at the station; a plan that counted that would leave it open.
FINGER_SHADOW_MM = 2.0
_MIN_STEP_MM = np.float32(1e-5)


def holding_boxes(jaw: Jaw, grasp: Grasp) -> list[Box]:
    """Return body and fingers of a holding jaw, in its TCP frame.

    Fingers that spread inside a bore stand between the two contacts, not beside them.
    """
    opening = grasp.opening_mm - (2 * jaw.finger_thickness_mm if grasp.is_inner else 0.0)
    return [*jaw.body, *jaw.fingers(opening)]


def hidden_by_gripper(
    solid: Solid,
    samples: SurfaceSamples,
    visible: BoolArray,
    vectors: FloatArray,
    distance_mm: float,
    T_part_tcp: FloatArray,
    boxes: Sequence[Box],
) -> BoolArray:
    """Return a mask (v, n) of the visible samples that a gripper hides.

    Parameters
    ----------
    solid : the part
    samples : n, of its surface
    visible : (v, n) mask of those to test
    vectors : (v, 3) unit, from the part to the camera, CAD frame
    distance_mm : distance of the camera from the part's centre of mass
    T_part_tcp : (4, 4) T_part_tcp
    boxes : boxes of the gripper, in its TCP frame
    """
    view, sample = np.nonzero(visible)
    hidden = np.zeros_like(visible)
    upright: list[Box] = []
    for box in boxes:
        if np.array_equal(box.T[:3, :3], np.eye(3)):
            upright.append(box)
        else:
            turned = Box(np.eye(4), box.half_mm)
            T_part_box = T_part_tcp @ box.T
            hidden[view, sample] |= _crossed(
                solid, samples, vectors, distance_mm, T_part_box, [turned], view, sample
            )
    hidden[view, sample] |= _crossed(
        solid, samples, vectors, distance_mm, T_part_tcp, upright, view, sample
    )
    return hidden


def _crossed(
    solid: Solid,
    samples: SurfaceSamples,
    vectors: FloatArray,
    distance_mm: float,
    T_part_frame: FloatArray,
    boxes: Sequence[Box],
    view: IntArray,
    sample: IntArray,
) -> BoolArray:
    """Return a mask (m,) of lines of sight that cross a box upright in a frame of the part.

    All boxes share one division per axis; in single precision, good to 1e-4 mm here.
    """
    T = inverse_pose(T_part_frame)
    points = transform(T, samples.points_mm).astype(np.float32)
    eyes = transform(T, solid.centroid_mm + distance_mm * vectors).astype(np.float32)
    enter = [np.zeros(len(view), np.float32) for _ in boxes]  # lines end at both of their ends
    leave = [np.ones(len(view), np.float32) for _ in boxes]
    for axis in range(3):
        start = points[:, axis][sample]
        step = eyes[:, axis][view] - start
        step[np.abs(step) < _MIN_STEP_MM] = _MIN_STEP_MM
        per_mm = np.float32(1.0) / step
        for k, box in enumerate(boxes):
            half = float(box.half_mm[axis]) + FINGER_SHADOW_MM
            low = (np.float32(box.T[axis, 3] - half) - start) * per_mm
            high = (np.float32(box.T[axis, 3] + half) - start) * per_mm
            np.maximum(enter[k], np.minimum(low, high), out=enter[k])
            np.minimum(leave[k], np.maximum(low, high), out=leave[k])
    crossed = np.zeros(len(view), dtype=bool)
    for first, last in zip(enter, leave, strict=True):
        crossed |= first <= last
    return crossed
