"""Joints and poses of an arm of this family: forward, and all eight branches back.

Joints q = [base, shoulder, elbow, wrist 1, wrist 2, wrist 3] in rad, as the pendant shows them. The
arm's frame is the controller's *base*: origin in the mounting face, z along the base's axis. Each
link's frame has its origin on the link's joint, z along that axis, and turns with the link (§1.3).
The flange's frame is the controller's tool frame without a TCP.

Sections (§) are those of ur.md.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from ._sizes import UrSize

__all__ = ["AS_DRAWN", "JOINTS", "LINKS", "MADE", "flange_branches", "link_frames", "moved_pose"]

Floats = NDArray[np.float64]

JOINTS: Final = ("base", "shoulder", "elbow", "wrist1", "wrist2", "wrist3")
LINKS: Final = ("shoulder", "upper", "fore", "wrist1", "wrist2", "wrist3")
# frames that may differ from their drawing: of the joints behind the base's, and of the TCP
MADE: Final = (*JOINTS[1:], "tool")
AS_DRAWN: Final = np.zeros((len(MADE), 6))
PARALLEL: Final = 1e-9  # sine of wrist 2 below which wrist 1 and wrist 3 turn about one axis
# a target beyond the stretched arm by less than this share of its reach is rounding
ROUNDING: Final = 1e-9


def link_frames(q: Floats, size: UrSize, made: Floats = AS_DRAWN) -> tuple[Floats, Floats]:
    """Return the links' frames at joints (..., 6): rotations (..., 6, 3, 3), origins (..., 6, 3).

    In the arm's frame [mm].

    Parameters
    ----------
    q : joints
    size : lengths of the arm
    made : (6, 6) turn [rad] and shift [mm] of each frame of `MADE` against its drawing, in its own
        axes
    """
    q = np.asarray(q, np.float64)
    x, y, z = (np.eye(3)[k] for k in range(3))
    # the turn before each joint's own, and where it stands in the frame before
    steps = (
        (np.eye(3), size.d1 * z),
        (_QUARTER, 0.0 * z),
        (np.eye(3), size.a2 * x),
        (np.eye(3), size.a3 * x + size.d4 * z),
        (_QUARTER, -size.d5 * y),
        (_QUARTER.T, size.d6 * y),
    )
    R = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3))
    origin = np.zeros((*q.shape[:-1], 3))
    turns, origins = [], []
    for joint, (before, offset) in enumerate(steps):
        if joint > 0 and made[joint - 1].any():
            off = moved_pose(made[joint - 1])
            before, offset = before @ off[:3, :3], offset + before @ off[:3, 3]
        origin = origin + R @ offset
        R = R @ (before @ _about_z(q[..., joint]))
        turns.append(R)
        origins.append(origin)
    return np.stack(turns, axis=-3), np.stack(origins, axis=-2)


def moved_pose(row: Floats) -> Floats:
    """Return the pose (4, 4) of a rotation vector [rad] and a shift [mm] (6,)."""
    T = np.eye(4)
    T[:3, 3] = row[3:]
    angle = float(np.linalg.norm(row[:3]))
    if angle > 0.0:
        x, y, z = row[:3] / angle
        K = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        T[:3, :3] += np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K
    return T


def flange_branches(T_arm_flange: Floats, size: UrSize) -> Floats:
    """Return the joints of all branches, (..., 8, 6), each from -pi to pi; NaN where there is none.

    Branch ``4 s + 2 w + e``: shoulder left or right (s), wrist 2 above or below 0 (w), elbow above
    or below 0 (e). Where wrist 1 and wrist 3 turn about one axis, wrist 3 is at 0.

    Parameters
    ----------
    T_arm_flange : (..., 4, 4) [mm]
    size : lengths of the arm
    """
    T = np.asarray(T_arm_flange, np.float64)
    R, tip = T[..., :3, :3], T[..., :3, 3]
    wrist = tip - size.d6 * R[..., :, 2]
    level = np.hypot(wrist[..., 0], wrist[..., 1])
    towards = np.arctan2(wrist[..., 1], wrist[..., 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        aside = _acos(size.d4 / level)
    rows = []
    for side in (1.0, -1.0):
        base = towards + np.pi / 2 + side * aside
        cos, sin, zero = np.cos(base), np.sin(base), np.zeros_like(base)
        ahead = np.stack([cos, sin, zero], axis=-1)
        axis = np.stack([sin, -cos, zero], axis=-1)  # of shoulder, elbow and wrist 1
        along = np.einsum("...i,...ij->...j", axis, R)  # the axis in the flange's frame
        sine = np.hypot(along[..., 0], along[..., 1])
        bend = np.arctan2(sine, along[..., 2])
        for up in (1.0, -1.0):
            wrist2 = up * bend
            wrist3 = np.arctan2(-up * along[..., 1], up * along[..., 0])
            wrist3 = np.where(sine < PARALLEL, 0.0, wrist3)
            # wrist 1's frame, by going back over wrist 3 and wrist 2
            back = _QUARTER @ _about_z(wrist2) @ _QUARTER.T @ _about_z(wrist3)
            R_wrist1 = R @ np.swapaxes(back, -1, -2)
            centre = wrist + size.d5 * R_wrist1[..., :, 1] - size.d4 * axis
            out = np.einsum("...i,...i", centre, ahead)
            rise = centre[..., 2] - size.d1
            a2, a3 = size.a2, size.a3
            bent = _acos((out**2 + rise**2 - a2**2 - a3**2) / (2 * a2 * a3))
            pitch = np.arctan2(R_wrist1[..., 2, 0], np.einsum("...i,...i", R_wrist1[..., 0], ahead))
            for over in (1.0, -1.0):
                elbow = over * bent
                shoulder = np.arctan2(rise, out) - np.arctan2(
                    a3 * np.sin(elbow), a2 + a3 * np.cos(elbow)
                )
                wrist1 = pitch - shoulder - elbow
                rows.append(np.stack([base, shoulder, elbow, wrist1, wrist2, wrist3], axis=-1))
    q = np.stack(rows, axis=-2)
    q = np.where(np.isfinite(q).all(axis=-1, keepdims=True), q, np.nan)
    return np.asarray(np.pi - (np.pi - q) % (2 * np.pi))


def _acos(cosine: Floats) -> Floats:
    """Return the angle of a cosine, NaN where it is beyond 1 by more than rounding."""
    is_there = np.abs(cosine) <= 1.0 + ROUNDING
    return np.where(is_there, np.arccos(np.clip(np.where(is_there, cosine, 0.0), -1, 1)), np.nan)


def _about_z(angle: Floats) -> Floats:
    R = np.zeros((*np.shape(angle), 3, 3))
    R[..., 2, 2] = 1.0
    R[..., 0, 0] = R[..., 1, 1] = np.cos(angle)
    R[..., 1, 0] = np.sin(angle)
    R[..., 0, 1] = -R[..., 1, 0]
    return R


# a quarter turn about x: alpha of joints 1 and 4, and back that of joint 5
_QUARTER: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
