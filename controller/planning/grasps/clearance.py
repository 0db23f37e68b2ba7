"""Clearance of an open gripper that comes straight in and closes.

On the exact triangles of the part (python-fcl); boxes are those of the jaw. Source:
planning-facts.md 2.2, step 5. Clearance of the table is asked of many grasps at once.
"""

from __future__ import annotations

import fcl
import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.cad import Solid

from ..geometry import Box, stack
from ..model import TABLE_MARGIN_MM, GraspRules, Jaw
from .seeds import open_gap

STEEPEST = -0.5  # z of the approach direction at a pick: within 60 degrees of straight down


class PartTriangles:
    """The part for `fcl`, built once."""

    def __init__(self, solid: Solid) -> None:
        self._model = fcl.BVHModel()
        mesh = solid.mesh
        self._model.beginModel(len(mesh.faces), len(mesh.vertices))
        self._model.addSubModel(np.asarray(mesh.vertices), np.asarray(mesh.faces))
        self._model.endModel()
        self._part = fcl.CollisionObject(self._model)
        self._request = fcl.CollisionRequest()

    def touches(self, T: FloatArray, half_mm: FloatArray) -> bool:
        """Return True if any box, of poses (n, 4, 4) and half edges (n, 3), touches the part."""
        for pose, half in zip(T, half_mm, strict=True):
            box = fcl.CollisionObject(
                fcl.Box(*(2 * half)), fcl.Transform(pose[:3, :3], pose[:3, 3])
            )
            if fcl.collide(self._part, box, self._request, fcl.CollisionResult()):
                return True
        return False


def clear_of_part(
    part: PartTriangles,
    T: FloatArray,
    opening: FloatArray,
    inner: BoolArray,
    jaw: Jaw,
    rules: GraspRules,
) -> BoolArray:
    """Return a mask (n,) of grippers that approach and close without touching but at the contact.

    Parameters
    ----------
    part : its triangles
    T : (n, 4, 4) T_part_tcp
    opening : (n,) distance between the surfaces held, of inner grasps between the fingers' backs
    inner : (n,) the jaw spreads between the surfaces
    jaw : the gripper, with fingers and body
    rules : clearance while open, length of the approach, and what the pads give
    """
    wide = open_gap(opening, inner, jaw, rules)
    # closed, but for what the pads give: there they do touch the part
    back = np.where(inner, 2 * (jaw.finger_thickness_mm + rules.compliance_mm), 0.0)
    shut = np.where(inner, opening - back, opening + 2 * rules.compliance_mm)
    T_body, half_body = stack([_swept(b, rules.approach_mm) for b in jaw.body])
    length, thick = jaw.finger_length_mm, jaw.finger_thickness_mm
    low, high = np.minimum(wide, shut), np.maximum(wide, shut)
    # both fingers, open, along the approach; then each as it closes on the part
    centre = np.zeros((4, len(T), 3))
    half = np.full((4, len(T), 3), jaw.finger_width_mm / 2)
    centre[:2, :, 0], half[:2, :, 0] = (
        -(length + rules.approach_mm) / 2,
        (length + rules.approach_mm) / 2,
    )
    centre[2:, :, 0], half[2:, :, 0] = -length / 2, length / 2
    half[:2, :, 1], half[2:, :, 1] = thick / 2, thick / 2 + (high - low) / 4
    centre[0, :, 1] = wide / 2 + thick / 2
    centre[2, :, 1] = (low + high) / 4 + thick / 2
    centre[1::2, :, 1] = -centre[::2, :, 1]
    fingers = np.repeat(T[None], 4, axis=0)
    fingers[:, :, :3, 3] += np.einsum("nij,knj->kni", T[:, :3, :3], centre)
    # the part may lie that much beside, or higher, than it was seen
    half[:2] += rules.wrong_mm
    clear = np.zeros(len(T), dtype=bool)
    for k, pose in enumerate(T):
        clear[k] = not (
            part.touches(fingers[:, k], half[:, k]) or part.touches(pose @ T_body, half_body)
        )
    return clear


def _swept(box: Box, behind_mm: float) -> Box:
    """Return the volume of a box swept from `behind_mm` behind; of a turned box, a bound."""
    reach = np.abs(box.T[:3, :3]) @ box.half_mm
    low, high = box.T[:3, 3] - reach, box.T[:3, 3] + reach
    return Box.from_bounds(low[0] - behind_mm, high[0], low[1], high[1], low[2], high[2])


def lifts_off_table(
    T: FloatArray, gap_open: FloatArray, jaw: Jaw, hull: FloatArray, down: FloatArray
) -> BoolArray:
    """Return a mask (n,) of the open grippers that come from above and clear the table.

    Parameters
    ----------
    T : (n, 4, 4) TCP poses in the part frame
    gap_open : (n,) distance between the pads while open
    jaw : the gripper, with fingers and body
    hull : (h, 3) corners of the part, in the part frame
    down : (3,) direction down, in the part frame
    """
    table = float((hull @ down).max()) - TABLE_MARGIN_MM
    sinks = np.einsum("j,njk->nk", down, T[:, :3, :3])  # of each axis of the TCP, along down
    lowest = np.full(len(T), -np.inf)
    for box in jaw.body:
        axes = sinks @ box.T[:3, :3]
        lowest = np.maximum(lowest, sinks @ box.T[:3, 3] + np.abs(axes) @ box.half_mm)
    # fingers: from the fingertips back, out to their backs, both sides
    ahead = np.maximum(0.0, -jaw.finger_length_mm * sinks[:, 0])
    out = np.abs(sinks[:, 1]) * (gap_open / 2 + jaw.finger_thickness_mm)
    wide = np.abs(sinks[:, 2]) * jaw.finger_width_mm / 2
    lowest = np.maximum(lowest, ahead + out + wide) + T[:, :3, 3] @ down
    return np.asarray((sinks[:, 0] >= -STEEPEST) & (lowest <= table))
