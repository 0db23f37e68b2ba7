"""What of the cell itself may stand in the inspection picture: hand, arm, fixture, as boxes."""

import numpy as np
from numpy.typing import NDArray

from controller.inspection import WorldBox
from controller.planning.layout import Box, CellLayout
from drivers.umi_scara import kinematics

Array = NDArray[np.float64]


def _turned(angle_rad: float, x: float, y: float, z: float) -> Array:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, z], [0, 0, 0, 1.0]])


def tip_pose(layout: CellLayout, q: Array) -> Array:
    """Return T_world_tip (4, 4) of the hand at joints (6,)."""
    T: Array = layout.T_world_arm @ kinematics.forward(q, layout.arm)
    return T


def link_poses(layout: CellLayout, q: Array) -> dict[str, Array]:
    """Return the frames of the arm's links in the world at joints (6,): carriage, upper, fore."""
    shoulder, elbow, _, zed_mm, _, _ = (float(value) for value in q)
    height = layout.arm.wrist_height_mm + zed_mm
    reach = layout.arm.upper_mm
    local = {
        "carriage": _turned(0.0, 0.0, 0.0, height),
        "upper": _turned(shoulder, 0.0, 0.0, height),
        "fore": _turned(
            shoulder + elbow, reach * np.cos(shoulder), reach * np.sin(shoulder), height
        ),
    }
    return {name: layout.T_world_arm @ T for name, T in local.items()}


def holder_boxes(layout: CellLayout, q: Array, opening_mm: float) -> tuple[WorldBox, ...]:
    """Return every box of arm, hand and fixture in the world, jaws at ``opening_mm``."""
    links = link_poses(layout, q)
    T_tip = tip_pose(layout, q)
    placed: list[Box] = [
        layout.carriage.placed(links["carriage"]),
        layout.upper.placed(links["upper"]),
        layout.fore.placed(links["fore"]),
        *(box.placed(T_tip) for box in layout.hand.body),
        *(box.placed(T_tip) for box in layout.hand.fingers(opening_mm)),
        *fixture_boxes(layout),
        *layout.obstacles.values(),
    ]
    # the panel's own housing stands behind the part and glows: it hides nothing
    panel = layout.obstacles.get("station_panel")
    camera = layout.obstacles.get("inspection_camera")
    return tuple(
        WorldBox(box.T, box.half_mm) for box in placed if box is not panel and box is not camera
    )


def fixture_boxes(layout: CellLayout) -> list[Box]:
    """Return the boxes of the fixed gripper, wide open, in the world; none where there is none."""
    if layout.fixture is None:
        return []
    boxes = (*layout.fixture.body, *layout.fixture.fingers(layout.fixture.max_mm))
    return [box.placed(layout.T_world_fixture) for box in boxes]
