"""The planner's layout from the cell file."""

from collections.abc import Iterable
from math import radians

import numpy as np

from controller.config import ConfigError
from controller.config.cell import (
    ArmSection,
    Cell,
    ChuteSection,
    OtherArmSection,
    TraySection,
    UmiSection,
)
from controller.config.cell import Box as BoxNumbers
from controller.config.grippers import ArmJawsSection, FingersSection, FixedJawsSection
from controller.planning.geometry import Box
from controller.planning.model import (
    JOINT_COUNT,
    ArmModel,
    CellLayout,
    CellTimes,
    Jaw,
    Nest,
    Pads,
    Tray,
)
from drivers.kinds import ArmDescription
from drivers.umi_scara import ArmGeometry, UmiModel
from messages import say

from .drivers import describe_arm
from .figures import as_measured
from .optics import build_camera

TRAY_WALL_MM = 3.0  # thickness of the walls of trays


def build_layout(cell: Cell) -> CellLayout:
    """Return the planner's layout [mm, rad].

    Raises
    ------
    ConfigError : the driver of an arm of another make refuses its shape, the arm has another
        number of joints, or measured figures are of another arm
    """
    arm = cell.arm
    described: ArmDescription[ArmModel]
    if isinstance(arm, OtherArmSection):
        described, column = describe_arm(cell.devices.arm.driver, arm.shape), arm.column
        if described.park_q.shape != (JOINT_COUNT,):
            raise ConfigError(
                f"`arm.shape`: planning requires an arm of {JOINT_COUNT} joints, this one has "
                f"{described.park_q.size}"
            )
    else:
        described, column = _umi(arm), arm.links.column
    obstacles = {name: Box.from_bounds(*box) for name, box in cell.obstacles.items()}
    obstacles |= _chute(cell.chute)
    trays = {
        "accept": cell.trays.accept,
        "reject": cell.trays.reject,
        "quarantine": cell.trays.quarantine,
    }
    for name, section in trays.items():
        obstacles |= _walls(name, section)
    obstacles["fixture_post"] = Box.from_bounds(*cell.fixed_gripper.post)
    return CellLayout(
        arm=as_measured(described.model, arm.figures),
        T_world_arm=arm.pose.build(),
        column=_column(arm, column),
        arm_gripper=_jaw(arm.arm_gripper.values(), arm.fingers, arm.jaw_max_mm, arm.jaws.force_n),
        fixed_gripper=_jaw(
            cell.fixed_gripper.body.values(),
            cell.fixed_gripper.fingers,
            cell.fixed_gripper.jaw_max_mm,
            cell.fixed_gripper.jaws.force_n,
        ),
        T_world_fixed_tcp=cell.fixed_gripper.pose.build(),
        fixed_held=(cell.fixed_gripper.held.mm, float(np.radians(cell.fixed_gripper.held.deg))),
        obstacles=obstacles,
        station_mm=np.array(cell.station.position, dtype=float),
        inspection=build_camera(cell.cameras.inspection),
        overhead=build_camera(cell.cameras.overhead),
        set_down_mm=np.array([cell.table.drop_area.x, cell.table.drop_area.y], dtype=float),
        trays={name: _tray(section) for name, section in trays.items()},
        park_q=described.park_q,
        cell_times=_times(arm.jaws, cell.fixed_gripper.jaws),
        place_u_mm=arm.uncertainty.position_mm,
    )


def _tray(section: TraySection) -> Tray:
    x, y = section.centre
    nests = tuple(
        Nest(
            (x + place.at[0], y + place.at[1]),
            place.size,
            None if place.turn is None else float(np.radians(place.turn)),
        )
        for place in section.places()
    )
    return Tray(section.centre, section.size, nests)


def _walls(name: str, section: TraySection) -> dict[str, Box]:
    """Return the walls of a tray as boxes to avoid, by name; none if it has none."""
    if section.walls_mm == 0:
        return {}
    (x, y), (half_x, half_y) = section.centre, (section.size[0] / 2, section.size[1] / 2)
    out = TRAY_WALL_MM
    sides = [
        (x - half_x - out, x - half_x, y - half_y - out, y + half_y + out),
        (x + half_x, x + half_x + out, y - half_y - out, y + half_y + out),
        (x - half_x, x + half_x, y - half_y - out, y - half_y),
        (x - half_x, x + half_x, y + half_y, y + half_y + out),
    ]
    return {
        f"wall {k} of tray {name}": Box.from_bounds(*side, 0.0, section.walls_mm)
        for k, side in enumerate(sides, start=1)
    }


def _column(arm: ArmSection, bounds: BoxNumbers) -> Box:
    """Return the column's box at its measured place, on the arm's base."""
    box = Box.from_bounds(*bounds)
    pose = arm.column_pose
    return box if pose is None else Box(pose.build() @ box.T, box.half_mm)


def _chute(section: ChuteSection | None) -> dict[str, Box]:
    """Return the chute as boxes to avoid, by name."""
    if section is None:
        return {}
    boxes: dict[str, Box] = {
        say("chute {name}", name=name): Box.from_bounds(*wall)
        for name, wall in section.walls.items()
    }
    for name, plate in section.plates.items():
        edges = np.array([plate.along, plate.across], dtype=float)
        lengths_mm = np.linalg.norm(edges, axis=1)
        x, across = edges / lengths_mm[:, None]
        # the file's edges are at right angles to its own digits only
        y = across - (across @ x) * x
        y /= np.linalg.norm(y)
        half_mm = np.array([*lengths_mm, plate.thickness_mm]) / 2
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
        T[:3, 3] = np.array(plate.corner) + T[:3, :3] @ (half_mm * [1, 1, -1])
        boxes[say("chute {name}", name=name)] = Box(T, half_mm)
    return boxes


def _umi(section: UmiSection) -> ArmDescription[ArmModel]:
    found, zero = section.corrections, section.corrections.zero_deg
    geometry = ArmGeometry(
        upper_mm=section.upper_mm,
        fore_mm=section.fore_mm,
        tool_mm=section.tool_mm,
        wrist_height_mm=section.wrist_height_mm,
        tool_off_mm=found.tool_off_mm,
        zero_rad=(
            radians(zero.shoulder),
            radians(zero.elbow),
            radians(zero.yaw),
            radians(zero.pitch),
            radians(zero.roll),
        ),
        zed_zero_mm=found.zed_zero_mm,
        yaw_per_elbow=found.yaw_per_elbow,
        sag_mm=found.sag_mm,
    )
    links = section.links
    boxes = {
        name: Box.from_bounds(*numbers)
        for name, numbers in (
            ("carriage", links.carriage),
            ("upper", links.upper),
            ("fore", links.fore),
        )
    }
    park = section.park_deg
    return ArmDescription(
        UmiModel.of_boxes(geometry, {n: (box.T, box.half_mm) for n, box in boxes.items()}),
        np.array(
            [
                *np.radians([park.shoulder, park.elbow, park.yaw]),
                section.park_zed_mm,
                *np.radians([park.pitch, park.roll]),
            ]
        ),
    )


def _times(arm: ArmJawsSection, fixed: FixedJawsSection) -> CellTimes:
    """Return the fixed times of a cycle, with those of both grippers' jaws."""
    return CellTimes(
        open_s=arm.open_s,
        release_s=arm.release_s,
        grasp_s=arm.grasp_s,
        press_s=arm.press_s,
        fixed_open_s=fixed.open_s,
        fixed_grasp_s=fixed.grasp_s,
        fixed_release_s=fixed.release_s,
    )


def _jaw(body: Iterable[BoxNumbers], fingers: FingersSection, max_mm: float, force_n: float) -> Jaw:
    boxes = tuple(Box.from_bounds(*box) for box in body)
    return Jaw(
        body=boxes,
        finger_length_mm=fingers.length_mm,
        finger_width_mm=fingers.width_mm,
        finger_thickness_mm=fingers.thickness_mm,
        pad_length_mm=fingers.pad_length_mm,
        max_mm=max_mm,
        force_n=force_n,
        pads=Pads(fingers.friction, fingers.compliance_mm),
    )
