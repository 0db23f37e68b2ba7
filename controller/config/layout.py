"""From the cell's file to what the geometry rooms need: layout, lamps, glowing areas."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from controller.cad import PointLamp
from controller.planning.layout import Box, CellLayout, Jaw, Tray
from drivers.umi_scara.kinematics import ArmGeometry

from .cell import Box as BoxNumbers
from .cell import Cell, FingersSection, LampSection

Array = NDArray[np.float64]

PARK_ZED_MM = -10.0  # below the noisy last counts under the top stop (umi_rtx.md 5.2)


def build_layout(cell: Cell) -> CellLayout:
    """Return the layout that planning works on [mm, rad]."""
    arm, park = cell.arm, cell.arm.park_deg
    obstacles = {name: Box.from_bounds(*box) for name, box in cell.obstacles.items()}
    obstacles["fixture_post"] = Box.from_bounds(*cell.fixture.post)
    return CellLayout(
        arm=ArmGeometry(arm.upper_mm, arm.fore_mm, arm.tool_mm, arm.wrist_height_mm),
        T_world_arm=arm.pose.build(),
        column=Box.from_bounds(*arm.links.column),
        carriage=Box.from_bounds(*arm.links.carriage),
        upper=Box.from_bounds(*arm.links.upper),
        fore=Box.from_bounds(*arm.links.fore),
        hand=_jaw(arm.hand.values(), arm.fingers, arm.jaw_max_mm),
        fixture=_jaw(cell.fixture.body.values(), cell.fixture.fingers, cell.fixture.jaw_max_mm),
        T_world_fixture=cell.fixture.pose.build(),
        obstacles=obstacles,
        station_mm=np.array(cell.station.position, dtype=float),
        inspection=cell.cameras.inspection.build(),
        overhead=cell.cameras.overhead.build(),
        set_down_mm=np.array([cell.table.drop_area.x, cell.table.drop_area.y], dtype=float),
        trays={
            name: Tray(section.centre, section.size)
            for name, section in (
                ("accept", cell.trays.accept),
                ("reject", cell.trays.reject),
                ("quarantine", cell.trays.quarantine),
            )
        },
        park_q=np.array(
            [
                *np.radians([park.shoulder, park.elbow, park.yaw]),
                PARK_ZED_MM,
                *np.radians([park.pitch, park.roll]),
            ]
        ),
    )


def _jaw(body: Iterable[BoxNumbers], fingers: FingersSection, max_mm: float) -> Jaw:
    boxes = tuple(Box.from_bounds(*box) for box in body)
    return Jaw(
        body=boxes,
        finger_length_mm=fingers.length_mm,
        finger_width_mm=fingers.width_mm,
        finger_thickness_mm=fingers.thickness_mm,
        pad_length_mm=fingers.pad_length_mm,
        max_mm=max_mm,
    )


def build_lamps(cell: Cell, names: Sequence[str]) -> tuple[PointLamp, ...]:
    """Return lamps as the points their light comes from, in the order of ``names``."""
    return tuple(_lamp(name, cell.lamps[name], cell) for name in names)


def _lamp(name: str, lamp: LampSection, cell: Cell) -> PointLamp:
    centre = np.array(lamp.centre, dtype=float)
    if lamp.kind == "ring":
        # a ring stands round the lens of the camera it is nearest to
        cameras = (cell.cameras.overhead, cell.cameras.inspection)
        nearest = min(cameras, key=lambda c: np.linalg.norm(np.array(c.pose.position) - centre))
        return PointLamp.ring(name, centre, nearest.pose.build()[:3, 2], lamp.radius or 50.0)
    return PointLamp(name, centre[None])


def panel_corners(cell: Cell, name: str) -> Array:
    """Return the corners of a glowing panel in the world, (4, 3) [mm], in order round it.

    Raises
    ------
    ValueError : the lamp is no panel
    """
    lamp = cell.lamps[name]
    if lamp.kind != "panel" or lamp.normal is None or lamp.up is None or lamp.size is None:
        raise ValueError(f"{name} is no panel with normal, up and size")
    up = np.array(lamp.up, dtype=float)
    right = np.cross(up, np.array(lamp.normal, dtype=float))
    half_w, half_h = lamp.size[0] / 2, lamp.size[1] / 2
    centre = np.array(lamp.centre, dtype=float)
    return np.array(
        [
            centre + sx * half_w * right + sy * half_h * up
            for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )


def table_corners(cell: Cell) -> Array:
    """Return the corners of the glowing area, (4, 3) [mm], in order round it."""
    (x0, x1), (y0, y1) = cell.table.glowing_area.x, cell.table.glowing_area.y
    return np.array([[x0, y0, 0.0], [x1, y0, 0.0], [x1, y1, 0.0], [x0, y1, 0.0]])
