"""Find forbidden places: over the table or a tray, in a camera's sight, against the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from shapely import MultiPoint, box
from shapely.geometry.base import BaseGeometry

from controller.arrays import FloatArray
from controller.planning.geometry import Box, lowest_z, overlap, segments_hit
from controller.planning.model import CellLayout

from ..site import Fellows, standoff_mm

TRAY_GAP_MM = 20.0
COLUMN_GAP_MM = 20.0
GAP_MM = 5.0  # least distance between things bolted down
ABOVE_TABLE_MM = 0.0
GRID_SIDE_COUNT = 5  # points on each side of an area that a camera must see
# The picture must be free up to this distance from the camera [standoffs], where the panel stands.
BEYOND = 1.45
_CORNERS = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T


def glowing_area(layout: CellLayout) -> FloatArray:
    """Return the area of the table that the overhead camera sees: rows x and y, low and high."""
    camera = layout.overhead
    width, height = camera.size_px
    corners = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], float)
    rays = camera.sight_lines(corners)
    on_table = camera.position_mm + rays * (-camera.position_mm[2] / rays[:, 2:])
    # the rectangle inside the quadrilateral: a lens bends its sides by a few pixels
    xs, ys = np.sort(on_table[:, 0]), np.sort(on_table[:, 1])
    return np.array([[xs[1], xs[2]], [ys[1], ys[2]]])


def standing_boxes(
    layout: CellLayout, fellows: Fellows
) -> tuple[list[tuple[str, Box]], list[tuple[str, Box]]]:
    """Return named boxes in the world: those down to the table (camera, panel, post), the jaws."""
    posts = [(n, layout.obstacles[n]) for n in (*fellows.camera, *fellows.fixed_gripper)]
    hanging: list[tuple[str, Box]] = []
    if (jaw := layout.fixed_gripper) is not None:
        T = layout.T_world_fixed_tcp
        hanging = [("fixture", b.placed(T)) for b in (*jaw.body, *jaw.fingers(jaw.max_mm))]
    return posts, hanging


def why_not_here(
    layout: CellLayout,
    fellows: Fellows,
    keep_free_mm: FloatArray | None = None,
    look: bool = True,
) -> str | None:
    """Return the reason why camera and fixed gripper are at forbidden places, None if they are not.

    Parameters
    ----------
    layout : with camera and fixed gripper where they are to stand
    fellows : obstacles that move with camera and fixed gripper
    keep_free_mm : (2, 2) rows x and y of the table's backlit area; None for the area of the table
        that the overhead camera sees
    look : inspection camera whose picture must be free
    """
    area = glowing_area(layout) if keep_free_mm is None else np.asarray(keep_free_mm, float)
    posts, hanging = standing_boxes(layout, fellows)
    for check in (_on_the_table, _against_the_arm, _against_each_other):
        if (why := check(layout, fellows, posts, hanging)) is not None:
            return why
    if (why := _over_what_is_kept_free(layout, area, posts, hanging)) is not None:
        return why
    if (why := _over_the_table(layout, area, posts, hanging)) is not None:
        return why
    return _in_the_picture(layout, fellows, hanging) if look else None


def _on_the_table(
    layout: CellLayout,
    fellows: Fellows,
    posts: Sequence[tuple[str, Box]],
    hanging: Sequence[tuple[str, Box]],
) -> str | None:
    for name, b in (*posts, *hanging):
        low = float(lowest_z(b.T, b.half_mm))
        if low < ABOVE_TABLE_MM - 1e-6:
            return f"{name} would reach {-low:.0f} mm below the table"
    return None


def _against_the_arm(
    layout: CellLayout,
    fellows: Fellows,
    posts: Sequence[tuple[str, Box]],
    hanging: Sequence[tuple[str, Box]],
) -> str | None:
    arm = {"column": layout.column} | {
        what: Box(box.T, box.half_mm).placed(layout.T_world_arm)
        for what, box in layout.arm.swept.items()
    }
    for name, b in (*posts, *hanging):
        for what, fixed in arm.items():
            if _touch(b, fixed, COLUMN_GAP_MM):
                return f"{name} would stand in the arm's {what}"
    return None


def _against_each_other(
    layout: CellLayout,
    fellows: Fellows,
    posts: Sequence[tuple[str, Box]],
    hanging: Sequence[tuple[str, Box]],
) -> str | None:
    of_camera = [(n, b) for n, b in posts if n in fellows.camera]
    of_fixed_gripper = [(n, b) for n, b in posts if n in fellows.fixed_gripper] + list(hanging)
    others = [
        (n, b)
        for n, b in layout.obstacles.items()
        if n not in fellows.camera and n not in fellows.fixed_gripper
    ]
    for group, rest in ((of_camera, [*of_fixed_gripper, *others]), (of_fixed_gripper, others)):
        for name, a in group:
            for other, b in rest:
                if _touch(a, b, GAP_MM):
                    return f"{name} and {other} would touch"
    return None


def _over_what_is_kept_free(
    layout: CellLayout,
    area: FloatArray,
    posts: Sequence[tuple[str, Box]],
    hanging: Sequence[tuple[str, Box]],
) -> str | None:
    glowing = box(area[0, 0], area[1, 0], area[0, 1], area[1, 1])
    for name, b in posts:
        if _shadow(b).intersects(glowing):
            return f"{name} would stand over the light table"
    for tray_name, tray in layout.trays.items():
        (x, y), (w, h) = tray.centre_mm, tray.size_mm
        w, h = w / 2 + TRAY_GAP_MM, h / 2 + TRAY_GAP_MM
        ground = box(x - w, y - h, x + w, y + h)
        for name, b in (*posts, *hanging):
            if _shadow(b).intersects(ground):
                return f"{name} would stand over the tray {tray_name}"
    return None


def _over_the_table(
    layout: CellLayout,
    area: FloatArray,
    posts: Sequence[tuple[str, Box]],
    hanging: Sequence[tuple[str, Box]],
) -> str | None:
    share = np.linspace(0.0, 1.0, GRID_SIDE_COUNT)
    on_table = np.array(
        [
            [area[0, 0] + a * (area[0, 1] - area[0, 0]), area[1, 0] + b * np.ptp(area[1]), 0.5]
            for a in share
            for b in share
        ]
    )
    eye = layout.overhead.position_mm
    for name, b in (*posts, *hanging):
        if segments_hit(on_table, eye, [b], GAP_MM).any():
            return f"{name} would hide part of the table from the overhead camera"
    return None


def _in_the_picture(
    layout: CellLayout, fellows: Fellows, hanging: Sequence[tuple[str, Box]]
) -> str | None:
    share = np.linspace(0.0, 1.0, GRID_SIDE_COUNT)
    camera = layout.inspection
    width, height = camera.size_px
    pixels = np.array([[a * (width - 1), b * (height - 1)] for a in share for b in share])
    ends = camera.position_mm + camera.sight_lines(pixels) * standoff_mm(layout) * BEYOND
    fixed = [(n, b) for n, b in layout.obstacles.items() if n not in fellows.camera]
    for name, b in (*fixed, *hanging, ("the arm's column", layout.column)):
        if segments_hit(ends, camera.position_mm, [b], GAP_MM).any():
            return f"{name} would stand in the inspection camera's picture"
    return None


def _touch(a: Box, b: Box, gap_mm: float) -> bool:
    return bool(overlap(a.T[None], a.half_mm[None] + gap_mm, b.T[None], b.half_mm[None])[0])


def _shadow(b: Box) -> BaseGeometry:
    """Return the outline of a box seen from above."""
    corners = (_CORNERS * b.half_mm) @ b.T[:3, :3].T + b.T[:3, 3]
    return MultiPoint(corners[:, :2]).convex_hull


__all__ = ["glowing_area", "standing_boxes", "why_not_here"]
