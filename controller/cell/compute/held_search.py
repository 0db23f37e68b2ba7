"""Find a part that has slipped in the jaws: still held, but away from its expected pose.

Between flat pads a part can slide along the fingers and across them, and turn about the line
between the pads. The poses on a grid of these three are first compared by their shadows; then the
best ones are fitted edge by edge, as in any view.
"""

import itertools
from dataclasses import replace
from typing import Final

import numpy as np

from controller import inspection as inspecting
from controller.arrays import BoolArray, FloatArray, Grey
from controller.cad import SurfaceSamples
from controller.imaging import RayCaster, inverse_pose, render_maps, threshold_levels

ALONG_MM: Final = (0.0, 5.0, -5.0, 10.0, -10.0, 15.0)
ACROSS_MM: Final = (0.0, 4.0, -4.0)
TURN_RAD: Final = tuple(float(np.radians(d)) for d in (0.0, 8.0, -8.0, 16.0, -16.0, 30.0, -30.0))
STEP_PX: Final = 8
FITTED_COUNT: Final = 3
# Shadows that overlap less are of another part, or the arm gripper is empty.
MIN_OVERLAP: Final = 0.7


def find_hold(
    part: inspecting.PosedPart,
    samples: SurfaceSamples,
    task: inspecting.ViewTask,
    T_part_tcp: FloatArray,
    backlit: Grey,
) -> FloatArray | None:
    """Return T_world_part of a held part that slipped, None if it is not found.

    Parameters
    ----------
    part : the part, with its ray caster
    samples : its surface samples, in the part frame
    task : the view, with the pose the part should have
    T_part_tcp : (4, 4) intended grasp of the arm gripper
    backlit : picture in front of the backlight panel
    """
    width, height = task.camera.size_px
    low, level, high = threshold_levels(backlit, np.ones(backlit.shape, dtype=bool))
    if high - low < task.limits.min_contrast:
        return None
    roi = (0, 0, width, height)
    dark = backlit[::STEP_PX, ::STEP_PX] < level
    hidden = (
        _shadow(RayCaster(inspecting.box_mesh(task.holder)), np.eye(4), task, roi)
        if task.holder
        else np.zeros_like(dark)
    )
    ranked: list[tuple[float, int, FloatArray]] = []
    grid = itertools.product(ALONG_MM, ACROSS_MM, TURN_RAD)
    for number, (along, across, turn) in enumerate(grid):
        T = task.T_world_part_expected @ T_part_tcp @ _move(along, across, turn)
        T = T @ inverse_pose(T_part_tcp)
        overlap = _overlap(_shadow(part.caster, T, task, roi) & ~hidden, dark & ~hidden)
        if overlap >= MIN_OVERLAP:
            ranked.append((-overlap, number, T))
    for _, _, T in sorted(ranked, key=lambda item: item[:2])[:FITTED_COUNT]:
        near = replace(task, T_world_part_expected=T, is_hold_measured=False)
        pictures = inspecting.ViewPictures(backlit=backlit, lit={})
        result = inspecting.inspect_view(part, samples, near, pictures)
        if result.T_world_part_measured is not None:
            return result.T_world_part_measured
    return None


def _move(along_mm: float, across_mm: float, turn_rad: float) -> FloatArray:
    """Return a slip in the TCP frame: along the fingers, across them, about the pads' line."""
    T = np.eye(4)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    T[:3, :3] = [[c, 0, s], [0, 1, 0], [-s, 0, c]]
    T[:3, 3] = [along_mm, 0.0, across_mm]
    return T


def _shadow(
    caster: RayCaster, T: FloatArray, task: inspecting.ViewTask, roi: tuple[int, int, int, int]
) -> BoolArray:
    return render_maps(caster, T, task.camera, roi, step_px=STEP_PX).mask


def _overlap(expected: BoolArray, seen: BoolArray) -> float:
    """Return intersection over union near the expected shadow; pixels far off are not counted."""
    rows, columns = np.nonzero(expected)
    if len(rows) == 0:
        return 0.0
    near = (
        slice(max(0, rows.min() - 4), rows.max() + 5),
        slice(max(0, columns.min() - 4), columns.max() + 5),
    )
    both = (expected & seen)[near].sum()
    return float(both / (expected | seen)[near].sum())
