"""Edges that a part makes by itself: flanks of highlights, borders of its own shade.

A lamp is mirrored on a cylinder as a streak along it, whose flanks are as sharp as a part's own
edges. On a surface that is straight in one direction, brightness changes across that direction
alone, whatever the lamps are: an edge that runs along it says nothing against the pose. Down in a
groove the part stands in the light of most lamps, and where a shadow ends there is no edge of it.
"""

import numpy as np

from controller.arrays import BoolArray, FloatArray
from controller.imaging import Camera, inverse_pose, meet_part, transform

from ._model import EdgeModel

ASKEW = 0.3  # cosine between a gradient and the straight direction: 17 degrees, and noise turns it
AHEAD_MM = 0.5  # step along the straight direction, to find its direction in the picture
END_ON_PX = 0.2  # length of that step in the picture below which it is seen end-on
SKY = np.array(
    [
        [np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)]
        for up in np.radians([30.0, 60.0])
        for turn in np.arange(8) * np.pi / 4
    ]
)  # where a lamp may be
OFF_MM = 0.05  # distance from a surface at which lines of sight to the sky begin
SHADED = 0.4  # share of the sky hidden by the part itself; beside one wall on a plane it is 3 in 8


def are_highlights(
    model: EdgeModel,
    T_world_part: FloatArray,
    camera: Camera,
    points_px: FloatArray,
    normals: FloatArray,
) -> BoolArray:
    """Return a mask (n,) of the picture's edges that may be highlights of a posed part.

    Parameters
    ----------
    model : edges of the part, and how its surfaces are curved
    T_world_part : (4, 4) the pose asked about
    camera : calibrated, in the world's frame
    points_px : (n, 2) in the picture
    normals : (n, 2) unit, up the gradient
    """
    answer = np.zeros(len(points_px), dtype=np.bool_)
    if len(points_px) == 0:
        return answer
    lines = camera.sight_lines(points_px)
    triangle, depth = meet_part(model.caster, T_world_part, camera.position_mm, lines)
    straight = np.where((triangle >= 0)[:, None], model.straight[triangle], np.nan)
    at = np.flatnonzero(np.isfinite(straight[:, 0]))
    points_mm = camera.position_mm + depth[at, None] * lines[at]
    ahead_mm = points_mm + AHEAD_MM * (straight[at] @ T_world_part[:3, :3].T)
    ahead_px = camera.project(ahead_mm) - camera.project(points_mm)
    size = np.linalg.norm(ahead_px, axis=1)
    off = np.abs((ahead_px * normals[at]).sum(axis=1))
    is_round = ~straight[at].any(axis=1)
    answer[at] = is_round | ((off < ASKEW * size) & (size > END_ON_PX))
    return answer


def are_shaded(
    model: EdgeModel, T_world_part: FloatArray, camera: Camera, points_px: FloatArray
) -> BoolArray:
    """Return a mask (n,) of the points of a picture where a posed part hides most of the sky.

    Parameters
    ----------
    model : edges of the part
    T_world_part : (4, 4) the pose asked about
    camera : calibrated, in the world's frame
    points_px : (n, 2) in the picture
    """
    answer = np.zeros(len(points_px), dtype=np.bool_)
    if len(points_px) == 0:
        return answer
    lines = camera.sight_lines(points_px)
    triangle, depth = meet_part(model.caster, T_world_part, camera.position_mm, lines)
    at = np.flatnonzero(triangle >= 0)
    T_part_world = inverse_pose(T_world_part)
    points_mm = transform(T_part_world, camera.position_mm + depth[at, None] * lines[at])
    points_mm += OFF_MM * model.normals[triangle[at]]
    hidden = np.zeros(len(at))
    for direction in SKY @ T_part_world[:3, :3].T:
        hidden += model.caster.first_hit(points_mm, direction)[0] >= 0
    answer[at] = hidden > SHADED * len(SKY)
    return answer
