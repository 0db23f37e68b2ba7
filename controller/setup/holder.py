"""Boxes of the cell itself that may be in the inspection picture: arm and both grippers."""

from controller.arrays import FloatArray
from controller.inspection import WorldBox
from controller.planning.geometry import Box
from controller.planning.model import CellLayout
from controller.planning.motion import Scene


def holder_boxes(layout: CellLayout, q: FloatArray, opening_mm: float) -> tuple[WorldBox, ...]:
    """Return every box of arm, arm gripper, fixed gripper and obstacles in the world.

    Parameters
    ----------
    layout : the cell
    q : (6,) joints of the configuration [rad, zed in mm]
    opening_mm : distance between the pads of the arm gripper
    """
    placed: list[Box] = [
        *Scene(layout, opening_mm, layout.fixed_open_mm).arm_boxes(q),
        *fixed_gripper_boxes(layout),
        *layout.obstacles.values(),
    ]
    # the backlight panel stands behind the part: it hides nothing; the camera does not see itself
    panel = layout.obstacles.get("station_panel")
    camera = layout.obstacles.get("inspection_camera")
    return tuple(
        WorldBox(box.T, box.half_mm) for box in placed if box is not panel and box is not camera
    )


def fixed_gripper_boxes(layout: CellLayout) -> list[Box]:
    """Return the boxes of the fixed gripper, wide open, in the world; none without a gripper."""
    if layout.fixed_gripper is None:
        return []
    boxes = (*layout.fixed_gripper.body, *layout.fixed_gripper.fingers(layout.fixed_gripper.max_mm))
    return [box.placed(layout.T_world_fixed_tcp) for box in boxes]
