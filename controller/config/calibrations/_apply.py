"""Put measured values in the place of a cell file's drawing values."""

from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from controller.arrays import FloatArray

from ..cell import Cell
from ..errors import ConfigError
from ..yaml_models import load_yaml
from ._files import first_problem, read_calibrations
from ._models import (
    ArmCalibration,
    CameraCalibration,
    FixedGripperCalibration,
    LampsCalibration,
    Matrix4,
    TraysCalibration,
    pose_of,
)


def load_cell(path: Path) -> Cell:
    """Return the cell that a cell file describes, corrected by its calibrations.

    Raises
    ------
    ConfigError : the file or a calibration is wrong, or they do not belong together
    """
    cell = load_yaml(path, Cell).read_from(path)
    if not cell.calibration:
        return cell
    found = read_calibrations(path, cell.calibration)
    tree = cell.model_dump(by_alias=True)
    for name, calibration in found.items():
        where = f"{path}: `calibration.{name}`"
        if calibration.cell and calibration.cell != cell.name:
            raise ConfigError(f"{where}: is of cell `{calibration.cell}`, this one is {cell.name}")
        if isinstance(calibration, CameraCalibration):
            _camera(tree["cameras"][name], calibration, where)
        elif isinstance(calibration, ArmCalibration):
            _arm(tree, calibration, cell.arm.pose.build())
        elif isinstance(calibration, FixedGripperCalibration):
            tree["fixture"] |= {
                "pose": _pose(calibration.T_world_tcp),
                "opening_zero_mm": calibration.opening_zero_mm,
                "opening_scale": calibration.opening_scale,
                "held": {"mm": calibration.held_mm, "deg": calibration.held_deg},
            }
        elif isinstance(calibration, TraysCalibration):
            for tray, centre in calibration.centres.items():
                tree["trays"][tray]["centre"] = centre
        elif isinstance(calibration, LampsCalibration):
            _lamps(tree["lamps"], calibration, where)
    try:
        return Cell.model_validate(tree).read_from(path)
    except ValidationError as error:
        raise ConfigError(f"{path}: as calibrated, {first_problem(error)}") from error


def _pose(rows: Matrix4) -> dict[str, Any]:
    return _axes(pose_of(rows))


def _axes(T: FloatArray) -> dict[str, Any]:
    return {
        "position": tuple(T[:3, 3].tolist()),
        "x_axis": tuple(T[:3, 0].tolist()),
        "y_axis": tuple(T[:3, 1].tolist()),
    }


def _camera(section: dict[str, Any], found: CameraCalibration, where: str) -> None:
    if tuple(section["size_px"]) != found.size_px:
        width, height = found.size_px
        raise ConfigError(
            f"{where}: was measured with {width} x {height} px, the cell file has "
            f"{section['size_px'][0]} x {section['size_px'][1]}"
        )
    K = found.K
    section |= {
        "focal_px": K[0][0],
        "focal_y_px": K[1][1],
        "centre_px": (K[0][2], K[1][2]),
        "distortion": found.distortion,
        "pose": _pose(found.T_world_cam),
        "calibrated": found.measured.date(),
    }
    if found.exposure_s is not None:
        section["exposure_s"] = found.exposure_s


def _arm(tree: dict[str, Any], found: ArmCalibration, T_drawn: FloatArray) -> None:
    # the column stands on the base: it is moved and turned as that is
    T_world_column = pose_of(found.T_world_arm) @ np.linalg.inv(T_drawn)
    tree["arm"] |= {
        "column_pose": _axes(T_world_column),
        "pose": _pose(found.T_world_arm),
        "figures": dict(found.figures),
        "uncertainty": {"position_mm": found.u_mm, "angle_deg": found.u_deg},
    }
    settings = tree["devices"]["arm"]["settings"]
    if found.jaw_zero_mm is not None:
        settings["jaw_zero_mm"] = found.jaw_zero_mm
    if found.play_deg:
        settings["play_deg"] = dict(found.play_deg)


def _lamps(sections: dict[str, Any], found: LampsCalibration, where: str) -> None:
    for name, lamp in found.lamps.items():
        if name not in sections:
            raise ConfigError(f"{where}: has a lamp `{name}`, the cell file has none of that name")
        sections[name] |= {
            "analog": lamp.analog,
            "relay": lamp.relay,
            "drive": lamp.drive,
            "settle_s": lamp.settle_s,
        }
