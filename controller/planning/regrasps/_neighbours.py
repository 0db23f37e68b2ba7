"""Taking a part off the table from among other objects, which stay as they are (ADR 66).

A part that touches another one is freed by lifting it straight up, unless the other lies over it.
So the lift checks the space above the part; the gripper keeps its distance from all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controller.arrays import FloatArray
from controller.imaging import inverse_pose
from messages import say

from ..geometry import PlacedShape, Triangles, stack
from ..model import CellLayout, Grasp, HandOff, PreparedPart
from ..motion import Scene

LIFT_MM = 80.0
STEP_MM = 5.0
OVER_MM = 12.0  # margin between a lifted part and the top of an object that it passes over
NEAR_MM = 150.0  # objects farther off than this are passed beside, not over
# Overlap allowed to parts that only touch, since both positions were measured in pictures.
INTO_MM = 0.5


def beside_alone(layout: CellLayout) -> CellLayout:
    """Return the cell with nothing in it but the arm, its column, the table and the neighbours."""
    return replace(layout, obstacles={}, fixed_gripper=None, stored=())


def lift_mm(part: PreparedPart, layout: CellLayout, T_world_part: FloatArray) -> float:
    """Return the height by which the part is lifted over its near neighbours [mm].

    Parameters
    ----------
    part : prepared
    layout : the cell
    T_world_part : (4, 4) pose of the part on the table [mm]
    """
    own = PlacedShape(part.shape, T_world_part)
    low, _ = _bounds(own)
    tops = [_bounds(one)[1][2] for one in layout.neighbours if _gap_mm(own, one) <= NEAR_MM]
    return max([LIFT_MM, *(float(top - low[2]) + OVER_MM for top in tops)])


def what_covers(part: PreparedPart, layout: CellLayout, T_world_part: FloatArray) -> str | None:
    """Return the obstacle to lifting the part straight up, as a clause; None where there is none.

    Parameters
    ----------
    part : prepared
    layout : the cell
    T_world_part : (4, 4) pose of the part on the table [mm]
    """
    own = PlacedShape(part.shape, T_world_part)
    near = [one for one in layout.neighbours if _gap_mm(own, one) <= 0.0]
    if not near:
        return None
    lifted = Triangles(part.shape.shrunk(INTO_MM))
    T = T_world_part.copy()
    for one in near:
        still = Triangles(one.shape)
        still.place(one.T)
        for up in np.arange(STEP_MM, _bounds(one)[1][2] - _bounds(own)[0][2] + STEP_MM, STEP_MM):
            T[2, 3] = T_world_part[2, 3] + up
            lifted.place(T)
            if lifted.meets(still):
                x, y = one.box.T[:2, 3]
                return say(
                    "the object at ({x:.0f}, {y:.0f}) is over it; take that one away first",
                    x=x,
                    y=y,
                )
    return None


def clear_hand_offs(part: PreparedPart, layout: CellLayout) -> PreparedPart:
    """Return the part without the hand-offs whose straight paths meet a neighbour.

    Parameters
    ----------
    part : prepared for the cell without neighbours
    layout : the cell
    """
    around = beside_alone(layout)
    return replace(
        part,
        hand_offs=tuple(
            {g: p for g, p in table.items() if _is_clear(around, part, part.arm_grasps[g], p)}
            for table in part.hand_offs
        ),
    )


def _is_clear(around: CellLayout, part: PreparedPart, grasp: Grasp, path: HandOff) -> bool:
    jaw = around.arm_gripper
    T_box, half = stack([*jaw.body, *jaw.fingers(grasp.opening_mm, until_mm=grasp.pre_open_mm)])
    rows = np.vstack([path.entry, path.retreat])
    gripper = (
        np.broadcast_to(T_box, (len(rows), *T_box.shape)),
        np.broadcast_to(half, (len(rows), *half.shape)),
    )
    T_tcp_part = np.broadcast_to(inverse_pose(grasp.T_part_tcp), (len(rows), 4, 4))
    scene = Scene(around, 0.0, 0.0)
    return bool(scene.free(rows, arm_gripper=gripper, part=(part.shape, T_tcp_part)).all())


def free_spot(layout: CellLayout) -> FloatArray:
    """Return x and y (2,) [mm] for a set-down: the middle of the area, or farthest from neighbours.

    Parameters
    ----------
    layout : the cell; `set_down_mm` is that area
    """
    middle: FloatArray = layout.set_down_mm.mean(axis=1)
    if not layout.neighbours:
        return middle
    x_mm, y_mm = (np.linspace(low, high, 7) for low, high in layout.set_down_mm)
    spots = np.array([middle, *((x, y) for x in x_mm for y in y_mm)])
    gaps = []
    for one in layout.neighbours:
        low, high = _bounds(one)
        out = np.maximum(np.maximum(low[:2] - spots, spots - high[:2]), 0.0)
        gaps.append(np.linalg.norm(out, axis=1))
    best: FloatArray = spots[int(np.argmax(np.min(gaps, axis=0)))]
    return best


def _bounds(placed: PlacedShape) -> tuple[FloatArray, FloatArray]:
    """Return the lowest and highest coordinates (3,) of a placed part."""
    points = placed.shape.hull_mm @ placed.T[:3, :3].T + placed.T[:3, 3]
    return points.min(axis=0), points.max(axis=0)


def _gap_mm(one: PlacedShape, other: PlacedShape) -> float:
    """Return the distance of two placed parts' bounds on the table; 0 where they overlap."""
    (low_a, high_a), (low_b, high_b) = _bounds(one), _bounds(other)
    apart = np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0.0)
    return float(np.linalg.norm(apart[:2]))
