"""Yield sites to try: a grid about the arm, and small steps from a good site."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from controller.arrays import FloatArray
from controller.planning.model import CellLayout

from ..site import STEEP, CellSite, site_of

STATION_AZIMUTHS_DEG = (-50.0, -25.0, 0.0, 25.0, 50.0)
STATION_RADII_MM = (250.0, 350.0, 430.0)
STATION_HEIGHTS_MM = (350.0, 450.0, 600.0)
CAMERA_AZIMUTHS_DEG = tuple(np.arange(0.0, 360.0, 30.0))
CAMERA_ELEVATIONS_DEG = (-30.0, 0.0, 30.0, 60.0)
FIXED_AZIMUTHS_DEG = (-90.0, -65.0, -40.0, 0.0, 40.0, 65.0, 90.0)
FIXED_RADII_MM = (260.0, 360.0, 460.0, 560.0)
FIXED_HEIGHTS_MM = (300.0, 430.0, 560.0)
FIXED_TURNS_DEG = tuple(np.arange(0.0, 360.0, 45.0))


def direction(azimuth_deg: float, elevation_deg: float) -> FloatArray:
    """Return the unit vector (3,) at an azimuth from x and an elevation over the table."""
    a, e = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])


def _about_arm(layout: CellLayout, radius: float, azimuth_deg: float, z: float) -> FloatArray:
    in_arm = np.array([*(radius * direction(azimuth_deg, 0.0))[:2], z, 1.0])
    return np.asarray((layout.T_world_arm @ in_arm)[:3])


def camera_grid(layout: CellLayout) -> Iterator[CellSite]:
    """Yield stations about the arm, the present one first, each seen from all sides."""
    now = site_of(layout)
    stations = [now.station_mm] + [
        _about_arm(layout, r, a, z)
        for z in STATION_HEIGHTS_MM
        for r in STATION_RADII_MM
        for a in STATION_AZIMUTHS_DEG
    ]
    # Sides are counted from the tangent at the station. So a turned arm has the same grid about it,
    # and every station has a view straight sideways.
    arm_mm = layout.T_world_arm[:3, 3]
    for k, station in enumerate(stations):
        out = station - arm_mm
        ahead = float(np.degrees(np.arctan2(out[1], out[0])))
        for elevation in CAMERA_ELEVATIONS_DEG:
            for azimuth in CAMERA_AZIMUTHS_DEG:
                yield replace(
                    now, station_mm=station, towards=direction(ahead + azimuth, elevation)
                )
        yield replace(now, station_mm=station, towards=np.array([0.0, 0.0, 1.0]))
        if k > 0:  # also square to the table's sides, as cells are built
            for azimuth in (90.0, -90.0):
                yield replace(now, station_mm=station, towards=direction(azimuth, 0.0))


def fixed_gripper_frame(
    position_mm: FloatArray, approach: FloatArray, jaws: FloatArray
) -> FloatArray:
    """Return the pose T_world_tcp (4, 4) of a fixed gripper.

    Parameters
    ----------
    position_mm : (3,) position of its TCP in the world
    approach : (3,) unit, its x in the world
    jaws : (3,) unit, its y, along which the pads open; square to the approach
    """
    T = np.eye(4)
    T[:3, :3] = np.column_stack([approach, jaws, np.cross(approach, jaws)])
    T[:3, 3] = position_mm
    return T


def fixed_gripper_grid(layout: CellLayout) -> Iterator[FloatArray]:
    """Yield poses (4, 4) of the fixed gripper, the present one first.

    They are level in eight directions, with jaws that close vertically or sideways, and upright.
    """
    yield layout.T_world_fixed_tcp
    up = np.array([0.0, 0.0, 1.0])
    for z in FIXED_HEIGHTS_MM:
        for radius in FIXED_RADII_MM:
            for azimuth in FIXED_AZIMUTHS_DEG:
                at = _about_arm(layout, radius, azimuth, z)
                for turn in FIXED_TURNS_DEG:
                    along = direction(turn, 0.0)
                    for jaws in (up, np.cross(up, along)):
                        yield fixed_gripper_frame(at, along, jaws)
                for turn in FIXED_TURNS_DEG[:4]:
                    yield fixed_gripper_frame(at, up, direction(turn, 0.0))


def camera_steps(site: CellSite, step_mm: float, step_deg: float) -> Iterator[CellSite]:
    """Yield sites with the station or the camera's side a small step away.

    Parameters
    ----------
    site : site to start the step from
    step_mm : step of the station, along each axis of the world, both ways
    step_deg : step of the side the camera is on, in azimuth and elevation
    """
    for offset in np.vstack([np.eye(3), -np.eye(3)]) * step_mm:
        yield replace(site, station_mm=site.station_mm + offset)
    azimuth = float(np.degrees(np.arctan2(site.towards[1], site.towards[0])))
    elevation = float(np.degrees(np.arcsin(np.clip(site.towards[2], -1.0, 1.0))))
    for turn in (step_deg, -step_deg):
        if abs(site.towards[2]) < STEEP:
            yield replace(site, towards=direction(azimuth + turn, elevation))
        yield replace(site, towards=direction(azimuth, min(elevation + turn, 90.0)))


def fixed_gripper_steps(site: CellSite, step_mm: float, step_deg: float) -> Iterator[CellSite]:
    """Yield sites with the fixed gripper a small step or turn away; none without a fixed gripper.

    Parameters
    ----------
    site : site to start the step from
    step_mm : along each axis of the world, both ways
    step_deg : about the vertical through the TCP, both ways
    """
    T = site.T_world_fixed_tcp
    if T is None:
        return
    for offset in np.vstack([np.eye(3), -np.eye(3)]) * step_mm:
        moved = T.copy()
        moved[:3, 3] += offset
        yield replace(site, T_world_fixed_tcp=moved)
    for turn in np.radians([step_deg, -step_deg]):
        c, s = np.cos(turn), np.sin(turn)
        moved = T.copy()
        moved[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ T[:3, :3]
        yield replace(site, T_world_fixed_tcp=moved)
