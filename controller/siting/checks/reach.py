"""Find what the joints allow at a site, by closed-form kinematics: no collisions, no motions.

The arm gripper's possible turns at the station depend on the part only through the position of its
centre of mass in the arm gripper. So one table per site, over directions in the arm gripper's
frame, serves every grasp of every part (planning-facts.md 3.1). The exact check, grasp by grasp,
follows for the promising sites.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from controller.arrays import BoolArray, FloatArray, IntArray
from controller.imaging import inverse_pose
from controller.planning.model import CellLayout
from controller.planning.motion import inverse_rows

from .._family import FamilyMember
from ..site import CellSite, camera_frame, standoff_mm

TCP_DIRECTION_COUNT = 200  # 7 degrees apart, half the angle between neighbouring view directions
ROLL_COUNT = 12
# Length of the part's straight path into the fixed gripper, and of the arm gripper's path away.
ENTRY_MM = 80.0


def sphere(count: int) -> FloatArray:
    """Return evenly spread unit vectors (count, 3), the same ones each time."""
    k = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    ring = np.sin(polar)
    return np.column_stack([np.cos(azimuth) * ring, np.sin(azimuth) * ring, np.cos(polar)])


def _frames(vectors: FloatArray) -> FloatArray:
    """Return rotations (n, 3, 3) whose z axes are the vectors."""
    helper = np.eye(3)[np.argmin(np.abs(vectors), axis=1)]
    u = helper - vectors * np.einsum("ij,ij->i", helper, vectors)[:, None]
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([u, np.cross(vectors, u), vectors], axis=2)


def shown_directions(
    layout: CellLayout, site: CellSite, to_camera: FloatArray, centre_mm: FloatArray
) -> BoolArray:
    """Return which directions of the TCP frame (h, 3) the arm can turn to the camera: (h,) bool.

    Parameters
    ----------
    layout : the cell with its arm
    site : station, and the side the camera is on
    to_camera : (h, 3) unit, from the part to the camera, TCP frame
    centre_mm : (3,) centre of the part in the arm gripper's frame, brought to the station
    """
    towards = camera_frame(site.station_mm, site.towards, standoff_mm(layout))[:3, :3]
    at_station = np.column_stack([towards[:, 0], -towards[:, 1], -towards[:, 2]])
    angle = 2 * np.pi * np.arange(ROLL_COUNT) / ROLL_COUNT
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros(ROLL_COUNT), np.ones(ROLL_COUNT)
    rolls = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    T = np.zeros((len(to_camera), ROLL_COUNT, 4, 4))
    T[..., 3, 3] = 1.0
    T[..., :3, :3] = (at_station @ rolls)[None] @ np.swapaxes(_frames(to_camera), 1, 2)[:, None]
    T[..., :3, 3] = site.station_mm - T[..., :3, :3] @ centre_mm
    index, _, _ = inverse_rows(layout, T.reshape(-1, 4, 4))
    found = np.zeros(len(to_camera) * ROLL_COUNT, dtype=bool)
    found[index] = True
    return np.asarray(found.reshape(len(to_camera), ROLL_COUNT).any(axis=1))


def nearest_directions(member: FamilyMember, to_camera: FloatArray) -> IntArray:
    """Return the nearest direction for each grasp, turned-over ones included, and view (2g, v)."""
    R = np.stack([g.T_part_tcp[:3, :3] for g in member.arm_grasps])
    own = np.einsum("gki,vk->gvi", R, member.vectors)
    return np.asarray(np.argmax(own @ to_camera.T, axis=2))


def table_views(nearest: IntArray, reached: BoolArray) -> BoolArray:
    """Return which (grasp, view) pairs the reached directions allow: (g, v) bool."""
    each = reached[nearest]
    half = len(each) // 2
    return np.asarray(each[:half] | each[half:])


def covered_bits(member: FamilyMember, views: BoolArray) -> NDArray[np.uint8]:
    """Return the coverage of each grasp in its views, packed: (g, bytes)."""
    out = np.zeros((len(views), member.bits.shape[2]), dtype=np.uint8)
    for k, row in enumerate(views):
        if row.any():
            out[k] = np.bitwise_or.reduce(member.bits[k, row], axis=0)
    return out


def shown_share(member: FamilyMember, views: BoolArray) -> float:
    """Return the share of the surface that all grasps together show in their views."""
    return float(member.share(np.bitwise_or.reduce(covered_bits(member, views), axis=0)))


def meetings(member: FamilyMember, fixed_count: int) -> FloatArray:
    """Return the arm's TCP in the fixed TCP frame for pairs of grasps (f, g, 4, 4).

    Parameters
    ----------
    member : the part, with its grasps
    fixed_count : grasps of the fixed gripper to use; the most different first, each turned over too
    """
    if not member.fixed_grasps:
        return np.zeros((0, len(member.arm_grasps), 4, 4))
    arm = np.stack([g.T_part_tcp for g in member.arm_grasps])
    half = len(member.fixed_grasps) // 2
    some = [*member.fixed_grasps[:half][:fixed_count], *member.fixed_grasps[half:][:fixed_count]]
    fixed = np.stack([inverse_pose(f.T_part_tcp) for f in some])
    return np.asarray(fixed[:, None] @ arm[None])


def met_grasps(
    layout: CellLayout, T_world_fixed_tcp: FloatArray, T_fixed_tcp: FloatArray
) -> BoolArray:
    """Return a mask (f, g) of the arm grasps that meet fixed ones, by the joints alone.

    Checked are the pose in which both hold, the start of the part's path in, and the end of the arm
    gripper's path out.

    Parameters
    ----------
    layout : the cell with its arm
    T_world_fixed_tcp : (4, 4) pose of the fixed gripper's TCP
    T_fixed_tcp : (f, g, 4, 4) pose of `meetings`
    """
    T_hold = T_world_fixed_tcp @ T_fixed_tcp.reshape(-1, 4, 4)
    ahead = T_world_fixed_tcp[:3, 0]
    rows = np.arange(len(T_hold))
    for entry, back in ((0.0, 0.0), (ENTRY_MM, 0.0), (0.0, ENTRY_MM)):
        T = T_hold[rows]
        T[:, :3, 3] += entry * ahead - back * T[:, :3, 0]
        if len(rows):
            index, _, _ = inverse_rows(layout, T)
            rows = rows[np.unique(index)]
    met = np.zeros(len(T_hold), dtype=bool)
    met[rows] = True
    return met.reshape(T_fixed_tcp.shape[:2])


def hand_off_shares(member: FamilyMember, met: BoolArray) -> tuple[float, float]:
    """Return the shares of `PartScore.partners_share` and `hand_offs_share`.

    Parameters
    ----------
    member : the part, with its grasps
    met : (f, base_count) mask of the grasps that meet the fixed gripper's
    """
    pairs = (met.T.astype(int) @ met.astype(int)) > 0
    half, wanted = member.base_count, int(member.completes.sum())
    from_table: BoolArray = np.asarray(member.from_pose.any(axis=0))
    lonely = (from_table[:half] | from_table[half:]) & member.completes.any(axis=1)
    joined = (pairs & member.completes).any(axis=1)
    partners = float(joined[lonely].mean()) if lonely.any() else 1.0
    return partners, float((pairs & member.completes).sum() / wanted) if wanted else 1.0
