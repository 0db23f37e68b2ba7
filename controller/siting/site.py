"""A site for camera and fixed gripper, and the cell with both moved there.

The camera keeps its distance from the station, for which its focal length, resolution and depth of
field were chosen. Its own box and the backlight panel behind the station move with it. The post
between fixed gripper and table moves with the fixed gripper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import Camera, inverse_pose
from controller.planning.geometry import Box, overlap, segments_hit
from controller.planning.model import CellLayout

# |z| of the line of sight beyond which the world's z cannot define which way is up.
STEEP = 0.9
POST_REACH_MM = 25.0  # the fixed gripper's post is at most this far from its body
BEHIND_MM = 150.0  # the camera's own box is one that reaches this far behind the lens
SAME_MM = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class CellSite:
    """The station, the side of the camera, and the pose of the fixed gripper.

    Attributes
    ----------
    station_mm : (3,) world
    towards : (3,) unit vector from the station to the camera
    T_world_fixed_tcp : (4, 4) pose of its TCP frame; None if the cell has no fixed gripper
    """

    station_mm: FloatArray
    towards: FloatArray
    T_world_fixed_tcp: FloatArray | None

    @property
    def looks_along(self) -> FloatArray:
        """The camera's line of sight (3,)."""
        return -self.towards


@dataclass(frozen=True, slots=True)
class Fellows:
    """Names of the layout's obstacles that move with the camera and with the fixed gripper."""

    camera: tuple[str, ...]
    fixed_gripper: tuple[str, ...]


def site_of(layout: CellLayout) -> CellSite:
    """Return the site of a layout's camera and fixed gripper."""
    towards = layout.inspection.position_mm - layout.station_mm
    return CellSite(
        np.asarray(layout.station_mm, dtype=float),
        towards / np.linalg.norm(towards),
        None if layout.fixed_gripper is None else np.asarray(layout.T_world_fixed_tcp, dtype=float),
    )


def standoff_mm(layout: CellLayout) -> float:
    """Return the distance from the camera to the station [mm]."""
    return float(np.linalg.norm(layout.inspection.position_mm - layout.station_mm))


def fellows_of(layout: CellLayout) -> Fellows:
    """Return the obstacles that belong to the camera and to the fixed gripper, found by position.

    The optical axis runs through the camera's own box and through the panel behind the station. A
    post touches, or almost touches, the body that it carries.
    """
    post: list[str] = []
    if layout.fixed_gripper is not None:
        body = [b.placed(layout.T_world_fixed_tcp) for b in layout.fixed_gripper.body]
        for name, box in layout.obstacles.items():
            if any(
                overlap(b.T[None], b.half_mm[None] + POST_REACH_MM, box.T[None], box.half_mm[None])[
                    0
                ]
                for b in body
            ):
                post.append(name)
    site, far = site_of(layout), standoff_mm(layout)
    start = site.station_mm + (far + BEHIND_MM) * site.towards
    end = site.station_mm - far * site.towards
    camera = [
        name
        for name, box in layout.obstacles.items()
        if name not in post and _segment_meets(start, end, box)
    ]
    return Fellows(tuple(camera), tuple(post))


def _segment_meets(start: FloatArray, end: FloatArray, box: Box) -> bool:
    return bool(segments_hit(start[None], end, [box])[0])


def camera_frame(station_mm: FloatArray, towards: FloatArray, distance_mm: float) -> FloatArray:
    """Return the pose T_world_cam (4, 4) of an upright camera that looks at the station.

    Its picture has the world's z up. If it looks steeply, the direction away from the arm is up.

    Parameters
    ----------
    station_mm : (3,) in the world
    towards : (3,) unit, from the station to the camera
    distance_mm : distance between them
    """
    z = -np.asarray(towards, dtype=float)
    up = np.array([0.0, 0.0, 1.0])
    if abs(z[2]) > STEEP:
        out = np.array([station_mm[0], station_mm[1], 0.0])
        far = float(np.linalg.norm(out))
        up = out / far if far > 1.0 else np.array([1.0, 0.0, 0.0])
    y = -(up - z * (up @ z))
    y = y / np.linalg.norm(y)
    T = np.eye(4)
    T[:3, :3] = np.column_stack([np.cross(y, z), y, z])
    T[:3, 3] = station_mm + distance_mm * np.asarray(towards)
    return T


def carried(layout: CellLayout, site: CellSite) -> FloatArray:
    """Return the rigid motion (4, 4) that takes station and camera from the layout to the site."""
    now = site_of(layout)
    if (
        np.abs(now.station_mm - site.station_mm).max() < SAME_MM
        and np.abs(now.towards - site.towards).max() < SAME_MM
    ):
        return np.eye(4)
    far = standoff_mm(layout)
    return camera_frame(site.station_mm, site.towards, far) @ inverse_pose(
        camera_frame(now.station_mm, now.towards, far)
    )


def placed_at(layout: CellLayout, site: CellSite, fellows: Fellows | None = None) -> CellLayout:
    """Return the cell with camera, boxes, station, fixed gripper and post moved to a site.

    Parameters
    ----------
    layout : the cell as it stands; not changed
    site : target site; without a pose for the fixed gripper, that gripper stays
    fellows : obstacles that move along; None for those that `fellows_of` finds
    """
    fellows = fellows or fellows_of(layout)
    move = carried(layout, site)
    obstacles = dict(layout.obstacles)
    for name in fellows.camera:
        obstacles[name] = obstacles[name].placed(move)
    T_fixed_tcp = layout.T_world_fixed_tcp
    if layout.fixed_gripper is not None and site.T_world_fixed_tcp is not None:
        for name in fellows.fixed_gripper:
            obstacles[name] = moved_post(obstacles[name], T_fixed_tcp, site.T_world_fixed_tcp)
        T_fixed_tcp = site.T_world_fixed_tcp
    old: Camera = layout.inspection
    return replace(
        layout,
        station_mm=np.asarray(site.station_mm, dtype=float),
        inspection=replace(old, T_world_cam=move @ old.T_world_cam),
        obstacles=obstacles,
        T_world_fixed_tcp=T_fixed_tcp,
    )


def moved_post(post: Box, T_old: FloatArray, T_new: FloatArray) -> Box:
    """Return the post of a fixed gripper that was moved; the post stays upright on the table.

    It turns about z with a level fixed gripper. A fixed gripper that points up stands on it.

    Parameters
    ----------
    post : box under the fixed gripper, in the world
    T_old, T_new : (4, 4) pose of the fixed gripper's TCP in the world, before and after
    """
    if np.abs(T_old - T_new).max() < SAME_MM:
        return post
    low, high = _z_range(post)
    was_up, is_up = T_old[2, 0] > STEEP, T_new[2, 0] > STEEP
    offset = post.T[:3, 3] - T_old[:3, 3]
    back_mm = float(np.hypot(*offset[:2]))
    half = post.half_mm.copy()
    T = np.eye(4)
    if is_up:
        # its top is under the palm, as far below the fingertips as it was behind them
        top = T_new[2, 3] - (back_mm - min(half[0], half[1]) if not was_up else T_old[2, 3] - high)
        yaw = float(np.arctan2(T_new[1, 1], T_new[0, 1]))
        T[:3, 3] = [T_new[0, 3], T_new[1, 3], (top + low) / 2]
    else:
        turn = np.arctan2(T_new[1, 0], T_new[0, 0]) - np.arctan2(T_old[1, 0], T_old[0, 0])
        yaw = float(turn)
        c, s = np.cos(yaw), np.sin(yaw)
        xy = np.array([[c, -s], [s, c]]) @ offset[:2] + T_new[:2, 3]
        top = high + T_new[2, 3] - T_old[2, 3]
        T[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        T[:3, :3] = T[:3, :3] @ post.T[:3, :3]
        T[:3, 3] = [*xy, (top + low) / 2]
        half[2] = max((top - low) / 2, 1.0)
        return Box(T, half)
    c, s = np.cos(yaw), np.sin(yaw)
    T[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    half[2] = max((top - low) / 2, 1.0)
    return Box(T, half)


def _z_range(box: Box) -> tuple[float, float]:
    reach = float(np.abs(box.T[2, :3]) @ box.half_mm)
    return float(box.T[2, 3] - reach), float(box.T[2, 3] + reach)
