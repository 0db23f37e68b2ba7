"""Candidates straight down on a part that lies on the table, tried densely.

For stable poses with few grasps from seeds: flat parts, whose walls are lower than a pad, and parts
with few opposed walls. Every heading is tried, every place across it, as deep as the table allows.
"""

from __future__ import annotations

import numpy as np

from controller.arrays import FloatArray
from controller.cad import Solid
from controller.imaging import RayCaster

from ...model import TABLE_MARGIN_MM, GraspRules, Jaw
from ._candidates import GraspCandidates
from ._faces import across

HEADING_COUNT = 24  # headings over half a turn: a jaw turned by half is the same
# spacing of places across a heading, half a pad's compliance at a slope of 15 degrees
PLACE_MM = 3.0
PLACE_COUNT = 40  # largest number of places for a heading
HIGHER_MM = (0.0, 5.0, 12.0, 24.0)  # heights of the fingertips above the lowest possible
ROOM_MM = 0.05  # added to the margin, so that rounding does not take it
BITE_MIN_MM = 1.0  # least depth of the pads on the part


def from_above(
    solid: Solid,
    caster: RayCaster,
    down: FloatArray,
    jaw: Jaw,
    rules: GraspRules,
    clearance_mm: float = 0.0,
) -> GraspCandidates:
    """Return grippers straight down over a resting part, centred between the pads' first contacts.

    Parameters
    ----------
    solid : the part
    caster : rays against its mesh
    down : (3,) unit, the way down in the CAD frame
    jaw : the gripper that is to hold it
    rules : opening to keep
    clearance_mm : distance kept from the table beside the usual margin
    """
    hull = solid.hull_mm
    u, v = across(down)
    turn = np.arange(HEADING_COUNT) * np.pi / HEADING_COUNT
    axes = np.outer(np.cos(turn), u) + np.outer(np.sin(turn), v)
    low, high = float((hull @ down).max()), float((hull @ down).min())  # of the table, of the top
    deepest = low - TABLE_MARGIN_MM - clearance_mm - ROOM_MM
    tips = np.array([deepest - more for more in HIGHER_MM])
    tips = tips[tips >= high + BITE_MIN_MM]
    T: list[FloatArray] = []
    for axis in axes:
        side = np.cross(down, axis)
        reach = hull @ side
        count = min(PLACE_COUNT, 1 + int(np.ptp(reach) / PLACE_MM))
        for place in np.linspace(reach.min(), reach.max(), count + 2)[1:-1]:
            for tip in tips:
                pose = np.eye(4)
                pose[:3, :3] = np.column_stack([down, axis, side])
                pose[:3, 3] = down * tip + side * place
                T.append(pose)
    poses = np.reshape(T, (-1, 4, 4))
    near, far = _walls(poses, hull, caster, jaw)
    met = np.isfinite(near) & np.isfinite(far)
    poses, near, far = poses[met], near[met], far[met]
    poses[:, :3, 3] += poses[:, :3, 1] * ((near + far) / 2)[:, None]
    found = GraspCandidates(poses, far - near, np.zeros(len(poses), dtype=bool))
    return found.take((found.gap > 1.0) & (found.gap <= jaw.max_mm - rules.jaw_reserve_mm))


def _walls(
    T: FloatArray, hull: FloatArray, caster: RayCaster, jaw: Jaw
) -> tuple[FloatArray, FloatArray]:
    """Return the first contacts (n,) and (n,) of both closing pads, along the jaws' axis.

    Measured from the TCP; inf and -inf where a pad meets nothing. A few rays of each pad: those at
    the fingertips, where a flat part is.
    """
    depth = -np.array([0.3, 1.0, 3.0, 8.0, jaw.pad_length_mm])
    wide = np.array([-0.5, -0.25, 0.0, 0.25, 0.5]) * jaw.finger_width_mm
    at = np.array(np.meshgrid(depth, wide, indexing="ij")).reshape(2, -1).T
    points = T[:, None, :3, 3] + np.einsum("nij,kj->nki", T[:, :3, [0, 2]], at)
    out = float(np.linalg.norm(np.ptp(hull, axis=0))) + float(np.abs(hull).max()) + jaw.max_mm
    found = []
    for sign in (-1.0, 1.0):
        axis = np.broadcast_to(T[:, None, :3, 1], points.shape)
        _, distance = caster.first_hit(
            (points + sign * out * axis).reshape(-1, 3), (-sign * axis).reshape(-1, 3)
        )
        found.append(sign * (out - distance.reshape(len(T), len(at)).min(axis=1)))
    return found[0], found[1]
